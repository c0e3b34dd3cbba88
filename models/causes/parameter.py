"""A nominal value of the rig file that is wrong."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import inf
from typing import ClassVar

from models.bodies.finite import FiniteBeam
from models.bodies.matrix import MatrixBody
from models.causes.cause import EITHER, Cause, Unknown
from models.friction import parameters
from models.jointed import AnyRig, JointedRig
from models.jointednumbers import GAINS

NEAREST = 0.999
"""A force on the support itself moves nothing: so near, in lengths of the beam, it may come."""

LAW, POSITION, ALPHA = "contact.friction.", "excitation.position", "damping.mass_proportional"
OF_BEAM = ("beam.youngs_modulus", "beam.density", "beam.length", "beam.thickness", "contact.radius")
LOAD = "contact.normal_load"
FREQUENCIES = "modal.frequencies_hz"
STIFFNESSES = (FiniteBeam.STIFFNESS, MatrixBody.STIFFNESS)
"""Keys of the stiffness of a whole body: a modulus, or a factor of a matrix."""

NEAR, WIDE = (0.98, 1.02), (0.96, 1.04, 0.85, 1.18, 0.6, 1.6)
"""Fits start at these times the nominal value too: of a length, which is easily measured, and of anything else."""

CLOSE = (0.99, 1.01, 0.995, 1.005, 0.98, 1.02, 0.97, 1.03, 0.96, 1.04, 0.95, 1.05)
"""The same of a natural frequency: resonances are hardly wider than the steps."""

FACTORS: dict[str, tuple[float, ...]] = {
    **dict.fromkeys(("beam.length", "beam.thickness", "contact.radius", POSITION), NEAR),
    FREQUENCIES: CLOSE,
}

APART = 0.9
"""Modes do not change places: a frequency may come so far of the way to that of the next mode."""

MOST, DAMPED = 10.0, 100.0
"""How many times the nominal value a value may be, or the other way round; and a damping, which is small and not easily
known."""


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
        beam = rig.beam is not None
        keys = [*(OF_BEAM if beam else ()), LOAD, *(() if rig.damping.modal_ratios else (ALPHA,))]
        keys += [POSITION] if beam else []
        keys += [LAW + name for name in parameters(rig.contact.law)]
        yield from (cls(key) for key in keys if rig.number(key) > 0.0)

    @property
    def label(self) -> str:
        """``parameter:`` and the key."""
        return f"{self.name}:{self.key}"

    def unknowns(self, rig: AnyRig) -> tuple[Unknown, ...]:
        """The value, nominal at first."""
        now, accepted = rig.numbers[self.key]
        table, _, name = self.key.rpartition(".")
        beside = {key.removeprefix(f"{table}."): n for key, n in rig.numbers.items() if key.startswith(f"{table}.")}
        most = DAMPED if self.key.startswith("damping.") else MOST
        if now < 0.0:
            lower, upper = max(now * most, accepted.lower), -now * most
        else:
            lower, upper = max(now / most, accepted.lower), min(now * most, accepted.upper)
        if self.key == POSITION:
            upper = NEAREST * accepted.upper
        if accepted.at_least:
            lower = beside[accepted.at_least][0]
        upper = min([upper, *(value for value, other in beside.values() if other.at_least == name)])
        if self.key.startswith(FREQUENCIES):
            below, above = _neighbours(rig, self.key)
            lower, upper = max(lower, now - APART * (now - below)), min(upper, now + APART * (above - now))
        tried = next((factors for kind, factors in FACTORS.items() if self.key.startswith(kind)), WIDE)
        starts = (now, *(now * factor for factor in tried if lower <= now * factor <= upper))
        return (Unknown("value", accepted.unit, self.key, lower, upper, now, starts),)

    def extend(self, rig: AnyRig, values: Mapping[str, float]) -> AnyRig:
        """Set the value."""
        return rig.with_number(self.key, values["value"])


def _neighbours(rig: AnyRig, key: str) -> tuple[float, float]:
    """Natural frequencies of the modes before and after the one of a key [Hz]."""
    hz = {name: value for name, (value, _) in rig.numbers.items() if name.startswith(FREQUENCIES)}
    values, at = list(hz.values()), list(hz).index(key)
    return max(values[:at], default=0.0), min(values[at + 1 :], default=inf)


def _of_joints(rig: JointedRig) -> Iterator[str]:
    """Numbers of a rig with joints that may be wrong: of its body, where anything touches it, and of its joints."""
    touched = tuple(f"modal.ports.{place}[" for place in rig.places)
    of_body = (*STIFFNESSES, FREQUENCIES, *touched)
    for key, (value, _) in rig.numbers.items():
        if value and key.startswith((*of_body, "damping.", "joints.", "masses[", GAINS)):
            yield key
