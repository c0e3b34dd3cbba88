"""Friction laws, each one symbolic definition that serves every solver.

`law` says what a law is and what is known of its parameters, `elements` holds what laws are made of. The laws:
`linear` (none, viscous), `coulomb` (Coulomb's law and its kin), `bristle` (Dahl, LuGre, hybrid), `iwan`.
"""

from models.friction.bristle import Dahl, Hybrid, LuGre
from models.friction.coulomb import Coulomb, ForceBalance, Jenkins, Karnopp, SpringDamper, Stribeck, VelocityLimited
from models.friction.iwan import Iwan
from models.friction.law import (
    ContactSample,
    FrictionLaw,
    Parameter,
    Setting,
    Value,
    check_parameters,
    chosen,
    defaults,
    describe,
    idle,
    parameter,
    parameters,
    quantities_of,
    setting,
    settings,
    with_symbols,
)
from models.friction.linear import Frictionless, Viscous

LAWS: dict[str, type] = {
    law.name: law
    for law in (
        Coulomb,
        Jenkins,
        VelocityLimited,
        Karnopp,
        SpringDamper,
        ForceBalance,
        Stribeck,
        Dahl,
        LuGre,
        Hybrid,
        Iwan,
        Viscous,
        Frictionless,
    )
}
"""Every law by its name in rig files."""

__all__ = [
    "LAWS",
    "ContactSample",
    "Coulomb",
    "Dahl",
    "ForceBalance",
    "FrictionLaw",
    "Frictionless",
    "Hybrid",
    "Iwan",
    "Jenkins",
    "Karnopp",
    "LuGre",
    "Parameter",
    "Setting",
    "SpringDamper",
    "Stribeck",
    "Value",
    "VelocityLimited",
    "Viscous",
    "check_parameters",
    "chosen",
    "defaults",
    "describe",
    "idle",
    "parameter",
    "parameters",
    "quantities_of",
    "setting",
    "settings",
    "with_symbols",
]
