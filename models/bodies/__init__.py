"""Bodies: linear structures that anything can touch at their ports; a body knows no friction."""

from models.bodies.finite import FiniteBeam
from models.bodies.laden import LumpedMass
from models.bodies.matrix import MatrixBody
from models.bodies.modal import ModalModel
from models.bodies.ported import Body, Everywhere, PortedModes

__all__ = ["Body", "Everywhere", "FiniteBeam", "LumpedMass", "MatrixBody", "ModalModel", "PortedModes"]
