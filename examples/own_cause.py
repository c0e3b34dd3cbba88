"""A cause of one's own for casadi-hbm: a magnet beside the beam. See docs/howto/own_cause.md."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from math import nan
from typing import ClassVar

from hbm.models import Rig
from hbm.models.causes import Cause, Unknown
from hbm.models.elements import Reading
from hbm.models.friction import Value, parameter


@dataclass(frozen=True, eq=False)
class _CubicSpring:
    """Restoring force -k y^3 at a point."""

    name: ClassVar[str] = "cubic-spring"
    reads: ClassVar[Reading] = Reading.POINT

    stiffness: Value = field(metadata=parameter("N/m3", "cubic stiffness", "example", strict=False))
    position: Value = field(metadata=parameter("m", "place on the beam", "example"))

    def force(self, y: Value, y_t: Value, weight: Value) -> Value:
        """CasADi differentiates it."""
        return -self.stiffness * y**3


@dataclass(frozen=True)
class Magnet(Cause):
    """A magnet that holds the beam the harder the further it moves."""

    name: ClassVar[str] = "magnet"
    meaning: ClassVar[str] = "a magnet holds a point of the beam with the cube of its deflection"
    looks_like: ClassVar[str] = "in phase, with the cube of the amplitude, at one place"
    confused_with: ClassVar[str] = "midplane-stretching, impact-stop"
    check: ClassVar[str] = "take the magnet away and repeat the records missed most"

    @classmethod
    def candidates(cls, rig: Rig) -> Iterator["Magnet"]:
        """Beside a beam."""
        if rig.beam is not None:
            yield cls()

    def unknowns(self, rig: Rig) -> tuple[Unknown, ...]:
        """Stiffness, nothing nominally; and place, which only shapes the effect."""
        key, L = f"elements[{len(rig.elements)}].", float(rig.beam.length)
        places = tuple(share * L for share in (0.5, 0.25, 0.75))
        return (
            Unknown("stiffness", "N/m3", key + "stiffness", 0.0, 1e14, 0.0, (1e3, 1e9, 1e10)),
            Unknown("position", "m", key + "position", 1e-3 * L, L, nan, places),
        )

    def extend(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        """Put the magnet beside the beam."""
        return replace(rig, elements=(*rig.elements, _CubicSpring(**values)))
