"""Numbers of a rig file: what they may be off by, another value of one, and one that is wrong as a cause."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from hbm.sensitivity import ALPHA, FRICTION, LOAD
from models.beam import Beam
from models.causes.cause import Unknown
from models.change import structure_scalars
from models.friction import describe, parameters
from models.rig import Rig

TOLERANCES = {
    "beam.youngs_modulus": 0.01,
    LOAD: 0.02,
    ALPHA: 0.05,
    FRICTION + "mu": 0.02,
    FRICTION + "mu_static": 0.02,
    "friction": 0.05,
}
"""What numbers of a rig file are off by in a rig that nobody would call wrong, relative standard deviations.

`friction` stands for every other parameter of a friction law.
"""

REACH = 3.0
"""A wrong number is looked for within this factor of the nominal one."""

GEOMETRY = 1.1
"""The same of lengths, which are easily measured."""

WRONG = ("beam.youngs_modulus", "beam.density", "contact.radius", "excitation.position")
"""Numbers of a beam that may be wrong, beside load, damping and friction."""


def tolerances(rig: Rig) -> dict[str, float]:
    """Numbers of a rig that are calibrated, and the relative standard deviation of each."""
    known = nominal_scalars(rig)
    law = {key: TOLERANCES.get(key, TOLERANCES["friction"]) for key in known if key.startswith(FRICTION)}
    others = {key: std for key, std in TOLERANCES.items() if key in known}
    if rig.damping.modal_ratios is not None:
        others.pop(ALPHA, None)
    return {key: std for key, std in (law | others).items() if known[key] > 0.0}


def nominal_scalars(rig: Rig) -> dict[str, float]:
    """Numbers of a rig by their keys."""
    law = zip(describe(type(rig.contact.law)), parameters(rig.contact.law).values(), strict=True)
    return {
        **{FRICTION + name: float(value) for name, value in law},
        LOAD: float(rig.contact.normal_load),
        **{key: float(scalar.value) for key, scalar in structure_scalars(rig).items()},
    }


def unit_of(rig: Rig, key: str) -> str:
    """SI unit of a number of a rig."""
    if key == LOAD:
        return "N"
    if key.startswith(FRICTION):
        return describe(type(rig.contact.law))[key.removeprefix(FRICTION)].unit
    return structure_scalars(rig)[key].unit


def with_values(rig: Rig, values: Mapping[str, float]) -> Rig:
    """The rig with other values of some of its numbers."""
    for key, value in values.items():
        rig = _with(rig, key, value)
    return rig


def _with(rig: Rig, key: str, value: float) -> Rig:
    if key.startswith(FRICTION):
        law = replace(rig.contact.law, **{key.removeprefix(FRICTION): value})  # type: ignore[type-var]
        return replace(rig, contact=replace(rig.contact, law=law))
    table, _, name = key.partition(".")
    if table == "channels":
        moved = name.removesuffix(".position")
        return replace(rig, channels=tuple(replace(c, position=value) if c.name == moved else c for c in rig.channels))
    if table == "beam":
        assert isinstance(rig.body, Beam)
        fields: dict[str, Any] = {name: value}
        return replace(rig, body=replace(rig.body, **fields))
    return replace(rig, **{table: replace(getattr(rig, table), **{name: value})})


@dataclass(frozen=True)
class WrongValue:
    """A nominal value of the rig file is wrong."""

    name: ClassVar[str] = "parameter"
    meaning: ClassVar[str] = "a nominal value of the rig file is wrong"
    looks_like: ClassVar[str] = "the response of a rig with another value, at all levels and frequencies"
    confused_with: ClassVar[str] = "other nominal values of the same place, and effects that act there"

    key: str

    @classmethod
    def candidates(cls, rig: Rig) -> Iterator["WrongValue"]:
        """Numbers that may be wrong."""
        known = nominal_scalars(rig)
        for key in dict.fromkeys((*tolerances(rig), *(k for k in WRONG if k in known))):
            if known[key] > 0.0:
                yield cls(key)

    @property
    def label(self) -> str:
        """As a diagnosis names it."""
        return f"parameter:{self.key}"

    def unknowns(self, rig: Rig) -> tuple[Unknown, ...]:
        """Its value."""
        value = nominal_scalars(rig)[self.key]
        length = unit_of(rig, self.key) == "m" and not self.key.startswith(FRICTION)
        reach = GEOMETRY if length else REACH
        starts = tuple(value * f for f in (1.0, *((0.98, 1.02) if length else (0.96, 1.04, 0.85, 1.18, 0.6, 1.6))))
        upper = value * reach
        if self.key == "excitation.position" and isinstance(rig.body, Beam):
            upper = min(upper, float(rig.body.length))
        return (Unknown("value", unit_of(rig, self.key), self.key, value / reach, upper, value, starts),)

    def extend(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        """The rig with the value."""
        return with_values(rig, {self.key: values["value"]})
