"""Attachments of a beam: masses, springs, resonators, and how clamp and support yield."""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from models.structure import Array

Value = Any


class PointMass(NamedTuple):
    """A lumped mass [kg] at a position [m]."""

    mass: Value
    position: Value

    def force(self, omega: Array) -> Array:
        """On the beam, per unit of deflection that swings at `omega` [N/m]."""
        return np.asarray(self.mass * omega**2)


class PointSpring(NamedTuple):
    """A spring to the ground [N/m] at a position [m]."""

    stiffness: Value
    position: Value

    def force(self, omega: Array) -> Array:
        """On the beam, per unit of deflection that swings at `omega` [N/m]."""
        return np.full(np.shape(omega), -self.stiffness)


class Resonator(NamedTuple):
    """A mass [kg] on a spring that alone would swing at a frequency [Hz], attached at a position [m]."""

    mass: Value
    frequency_hz: Value
    position: Value

    @property
    def stiffness(self) -> Value:
        """Stiffness of its spring [N/m]."""
        return self.mass * (2 * np.pi * self.frequency_hz) ** 2

    def force(self, omega: Array) -> Array:
        """On the beam, per unit of deflection that swings at `omega` [N/m]."""
        inertia = self.mass * omega**2
        return np.asarray(self.stiffness * inertia / (self.stiffness - inertia))


@dataclass(frozen=True)
class Attachments:
    """Attachments of a clamped-supported beam, linear but for a clamp that slips; nothing by default.

    Attributes
    ----------
    clamp_stiffness : Value or None
        Rotational spring instead of the rigid clamp [N m/rad].
    clamp_limit : Value or None
        Moment of that spring at which the clamp slips [N m]; :mod:`models.clamp`.
    support_stiffness : Value or None
        Vertical spring under the support instead of a rigid one [N/m]; its force is the reaction, P - k y(L).
    tip_stiffness : Value or None
        Rotational spring at x = L [N m/rad].
    masses : tuple of PointMass
    springs : tuple of PointSpring
    resonators : tuple of Resonator
    """

    clamp_stiffness: Value | None = None
    clamp_limit: Value | None = None
    support_stiffness: Value | None = None
    tip_stiffness: Value | None = None
    masses: tuple[PointMass, ...] = ()
    springs: tuple[PointSpring, ...] = ()
    resonators: tuple[Resonator, ...] = ()

    def __bool__(self) -> bool:
        return self != Attachments()

    def scalars(self) -> dict[str, Value]:
        """Everything that is a number, with names like ``masses[0].position``."""
        ends = {name: getattr(self, name) for name in ENDS}
        return {name: value for name, value in ends.items() if value is not None} | {
            f"{kind}[{i}].{name}": value
            for kind in LISTS
            for i, entry in enumerate(getattr(self, kind))
            for name, value in entry._asdict().items()
        }

    def with_scalars(self, values: Iterator[Value]) -> "Attachments":
        """The same attachments with other values, in the order of :meth:`scalars`."""
        ends = {name: next(values) for name in ENDS if getattr(self, name) is not None}
        lists = {
            kind: tuple(entry._make(next(values) for _ in entry) for entry in getattr(self, kind)) for kind in LISTS
        }
        return Attachments(**ends, **lists)

    def mode_numbers(self, omega_n: Array) -> npt.NDArray[np.intp]:
        """Number of the bare beam's mode (n,) [rad/s] that each mode counts as: what has no mass changes nothing.

        The mode that a resonator adds among them counts as the first.
        """
        swinging = 2 * np.pi * np.array([float(r.frequency_hz) for r in self.resonators])
        added = swinging[swinging < omega_n[-1]]
        numbers = np.concatenate([np.arange(1, len(omega_n) + 1), np.ones(len(added), dtype=int)])
        return np.asarray(numbers[np.argsort(np.concatenate([omega_n, added]), kind="stable")])


ENDS = tuple(f.name for f in fields(Attachments) if f.default is None)

LISTS = tuple(f.name for f in fields(Attachments) if f.default is not None)
