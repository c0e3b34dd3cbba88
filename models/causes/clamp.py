"""Friction in the clamp."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from models.beam import Beam
from models.causes.cause import Cause, Unknown
from models.causes.structure import RIGID
from models.rig import Rig, beam_of

NEVER = 1e6
LIMITS = (NEVER, *np.geomspace(100.0, 0.5, 24).tolist())
"""Starts of the limit, in units of the moment that the excitation makes at rest; at the first nothing slips, the others
are what a resonance may make of it, dense since what only just slips is what is found."""

LEAST_MOMENT = 1e-3
"""Of the excitation times the length: a force over the support bends nothing."""


@dataclass(frozen=True)
class ClampFriction(Cause):
    """A clamp whose rotation is held by friction."""

    name: ClassVar[str] = "clamp-friction"
    meaning: ClassVar[str] = "one Jenkins element is all that holds the rotation of the clamp"
    looks_like: ClassVar[str] = "as clamp-rotation up to a level, then a loss that grows with it, and odd harmonics"
    confused_with: ClassVar[str] = "clamp-rotation, parameter:contact.radius"
    check: ClassVar[str] = (
        "put an accelerometer next to the clamp and repeat a record at a low and at a high level: only at the high "
        "one may its rotation lag behind the force"
    )
    abrupt: ClassVar[bool] = True
    contains: ClassVar[tuple[str, ...]] = ("clamp-rotation",)

    @classmethod
    def candidates(cls, rig: Rig) -> Iterator["ClampFriction"]:
        """Offer it for a beam whose clamp is rigid; where the tip can lift off it is not known."""
        if rig.beam is not None and rig.attachments.clamp_stiffness is None and not rig.contact.lift_off:
            yield cls()

    def unknowns(self, rig: Rig) -> tuple[Unknown, ...]:
        """Stiffness of the clamp, and the moment at which it slips; both infinite where the clamp is rigid."""
        beam = beam_of(rig)
        own, moment, infinite = beam.bending_stiffness / beam.length, _moment(rig, beam), float("inf")
        stiffness, limits = (tuple(k * own for k in RIGID), tuple(k * moment for k in LIMITS))
        return (
            Unknown("stiffness", "N m/rad", "attachments.clamp_stiffness", 1e-3 * own, infinite, infinite, stiffness),
            Unknown("limit", "N m", "attachments.clamp_limit", 1e-3 * moment, infinite, infinite, limits),
        )

    def extend(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        """Let the clamp turn and slip."""
        ends = replace(rig.attachments, clamp_stiffness=values["stiffness"], clamp_limit=values["limit"])
        return replace(rig, attachments=ends)


def _moment(rig: Rig, beam: Beam) -> float:
    """Moment of the clamp under the excitation at rest [N m]."""
    x = rig.excitation.position / beam.length
    shape = max(x * (1.0 - x) * (2.0 - x) / 2.0, LEAST_MOMENT)
    return float(rig.excitation.amplitude * beam.length * shape)
