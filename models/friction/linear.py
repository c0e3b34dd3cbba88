"""Laws without dry friction: none, and a dashpot."""

from dataclasses import dataclass, field
from typing import ClassVar

import casadi as ca

from models.friction.elements import relax
from models.friction.law import Checked, ContactSample, Value, parameter


@dataclass(frozen=True, eq=False)
class Frictionless(Checked):
    """No friction: T = 0."""

    name: ClassVar[str] = "none"
    states: ClassVar[int] = 0
    set_valued: ClassVar[bool] = False

    def advance(self, z: Value, before: ContactSample, now: ContactSample) -> tuple[Value, Value]:
        """Return no state and no force."""
        return z, 0.0 * now.u


@dataclass(frozen=True, eq=False)
class Viscous(Checked):
    """Viscous contact, T = -coefficient times the contact's velocity v + C dT/dt.

    In series with the compliance C this is a Maxwell element; integrated exactly for a velocity that is linear between
    samples.
    """

    name: ClassVar[str] = "viscous"
    states: ClassVar[int] = 0
    set_valued: ClassVar[bool] = False

    coefficient: Value = field(
        metadata=parameter("N s/m", "viscous coefficient of the contact", "linear reference law", strict=False)
    )

    def advance(self, z: Value, before: ContactSample, now: ContactSample) -> tuple[Value, Value]:
        """Advance the Maxwell element; without compliance T = -coefficient v."""
        x = now.dt / ca.fmax(self.coefficient * now.C, 1e-9 * now.dt)  # relaxation times per sample
        return z, relax(before.T, -self.coefficient * before.v, -self.coefficient * now.v, x)
