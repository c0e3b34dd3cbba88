"""Mechanics without Fourier series and without solvers.

Read :class:`Rig` first: a body (:class:`Beam` or :class:`ModalBody`), its damping, the contact with its friction law,
the excitation, the channels, :class:`Attachments` of a beam and nonlinear elements along it (:class:`Element`).
`Rig.structure` is the linear :class:`ModalStructure`, which knows no friction, and :func:`structure_change` its exact
derivatives; a :class:`FrictionLaw` turns the contact's motion into a force. Equations and sign conventions follow
Hadji & Mureithi, Shock and Vibration 2019.
"""

from models.attachments import Attachments, PointMass, PointSpring, Resonator
from models.beam import Beam
from models.change import structure_change, structure_scalars
from models.elements import ELEMENTS, Element, ImpactStop, MidplaneStretching, QuadraticDrag
from models.friction import (
    LAWS,
    ContactSample,
    Coulomb,
    Dahl,
    ForceBalance,
    FrictionLaw,
    Frictionless,
    Hybrid,
    Iwan,
    Jenkins,
    Karnopp,
    LuGre,
    Parameter,
    SpringDamper,
    Stribeck,
    VelocityLimited,
    Viscous,
    describe,
    parameters,
)
from models.parts import Channel, Contact, Damping, Excitation, ModalBody
from models.rig import Rig
from models.structure import ModalStructure, Reaction

__all__ = [
    "ELEMENTS",
    "LAWS",
    "Attachments",
    "Beam",
    "Channel",
    "Contact",
    "ContactSample",
    "Coulomb",
    "Dahl",
    "Damping",
    "Element",
    "Excitation",
    "ForceBalance",
    "FrictionLaw",
    "Frictionless",
    "Hybrid",
    "ImpactStop",
    "Iwan",
    "Jenkins",
    "Karnopp",
    "LuGre",
    "MidplaneStretching",
    "ModalBody",
    "ModalStructure",
    "Parameter",
    "PointMass",
    "PointSpring",
    "QuadraticDrag",
    "Reaction",
    "Resonator",
    "Rig",
    "SpringDamper",
    "Stribeck",
    "VelocityLimited",
    "Viscous",
    "describe",
    "parameters",
    "structure_change",
    "structure_scalars",
]
