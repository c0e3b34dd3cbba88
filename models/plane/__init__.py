"""Plane finite element models: a beam on a half cylinder, in the elements of Table 2; needs the extra ``fem``."""

from models.plane.elements import ELEMENTS, STATES, PlaneElement
from models.plane.mesh import HalfCylinder, beam_mesh
from models.plane.model import PlaneBeam, PlaneModel

__all__ = ["ELEMENTS", "STATES", "HalfCylinder", "PlaneBeam", "PlaneElement", "PlaneModel", "beam_mesh"]
