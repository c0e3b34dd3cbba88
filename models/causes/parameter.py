"""A nominal value of the rig file that is wrong."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

from models.beam import Beam
from models.causes.cause import EITHER, Cause, Unknown
from models.change import structure_scalars
from models.friction import describe, parameters
from models.jointed import AnyRig, JointedRig
from models.jointednumbers import GAINS
from models.numbers import number, with_number

NEAREST = 0.999
"""A force on the support itself moves nothing: so near, in lengths of the beam, it may come."""

LAW, POSITION, ALPHA = "contact.friction.", "excitation.position", "damping.mass_proportional"
OF_BEAM = ("beam.youngs_modulus", "beam.density", "beam.length", "beam.thickness", "contact.radius")
LOAD = "contact.normal_load"
NEAR, WIDE = (0.98, 1.02), (0.96, 1.04, 0.85, 1.18, 0.6, 1.6)
"""Fits start at these times the nominal value too: of a length, which is easily measured, and of anything else."""

CLOSE = (0.99, 1.01, 0.995, 1.005, 0.98, 1.02, 0.95, 1.05)
"""The same of a natural frequency, beside which a small damping ratio leaves no more."""

MOST = 10.0
"""How many times the nominal value a value may be, or the other way round."""


@dataclass(frozen=True)
class WrongParameter(Cause):
    """A nominal value of the rig file that is wrong.

    Attributes
    ----------
    key : str
        Dotted key of the rig file.
    """

    name: ClassVar[str] = "parameter"
    meaning: ClassVar[str] = "a nominal value of the rig file is wrong"
    looks_like: ClassVar[str] = "what a change of that value does"
    confused_with: ClassVar[str] = "causes that act in the same place"
    check: ClassVar[str] = (
        "measure this number by itself, or change it by a known amount and repeat the records missed most"
    )

    rigs: ClassVar[tuple[type, ...]] = EITHER

    key: str

    @classmethod
    def candidates(cls, rig: AnyRig) -> Iterator["WrongParameter"]:
        """Offer every positive value, which may have been measured wrongly."""
        if isinstance(rig, JointedRig):
            yield from (cls(key) for key in _of_joints(rig))
            return
        beam = isinstance(rig.body, Beam)
        keys = [*(OF_BEAM if beam else ()), LOAD, *(() if rig.damping.modal_ratios else (ALPHA,))]
        keys += [POSITION] if beam else []
        keys += [LAW + name for name in describe(type(rig.contact.law))]
        yield from (cls(key) for key in keys if number(rig, key) > 0.0)

    @property
    def label(self) -> str:
        """``parameter:`` and the key."""
        return f"{self.name}:{self.key}"

    def unknowns(self, rig: AnyRig) -> tuple[Unknown, ...]:
        """The value, nominal at first."""
        if isinstance(rig, JointedRig):
            return (_of_joint(rig, self.key),)
        now = number(rig, self.key)
        lower, upper = now / MOST, now * MOST
        known = describe(type(rig.contact.law))
        if self.key.startswith(LAW):
            name = self.key.removeprefix(LAW)
            of_law, others = known[name], parameters(rig.contact.law)
            upper, unit = min(upper, of_law.upper), of_law.unit
            if of_law.at_least:
                lower = others[of_law.at_least]
            upper = min([upper, *(others[other] for other, p in known.items() if p.at_least == name)])
        else:
            unit = "N" if self.key == LOAD else structure_scalars(rig)[self.key].unit
        if isinstance(rig.body, Beam):
            if self.key == POSITION:
                upper = NEAREST * rig.body.length
            if self.key == "beam.length":  # everything stays on the beam
                lower = max([rig.excitation.position, *(c.position for c in rig.channels)])
        tried = NEAR if unit == "m" and not self.key.startswith(LAW) else WIDE
        starts = (now, *(now * factor for factor in tried if lower <= now * factor <= upper))
        return (Unknown("value", unit, self.key, lower, upper, now, starts),)

    def extend(self, rig: AnyRig, values: Mapping[str, float]) -> AnyRig:
        """Set the value."""
        return with_number(rig, self.key, values["value"])


def _of_joints(rig: JointedRig) -> Iterator[str]:
    """Numbers of a rig with joints that may be wrong: of its modes where anything touches them, and of its joints."""
    touched = tuple(f"modal.ports.{place}[" for place in rig.places)
    for key, (value, _) in rig.numbers.items():
        if value and key.startswith(("modal.frequencies_hz", "damping.", "joints.", GAINS, *touched)):
            yield key


def _of_joint(rig: JointedRig, key: str) -> Unknown:
    """A number of a rig with joints, nominal at first, within the bounds of the rig file."""
    now, accepted = rig.numbers[key]
    if now < 0.0:
        lower, upper = max(now * MOST, accepted.lower), -now * MOST
    else:
        lower, upper = max(now / MOST, accepted.lower), min(now * MOST, accepted.upper)
    tried = CLOSE if key.startswith("modal.frequencies_hz") else WIDE
    starts = (now, *(now * factor for factor in tried if lower <= now * factor <= upper))
    return Unknown("value", accepted.unit, key, lower, upper, now, starts)
