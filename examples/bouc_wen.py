"""Bouc-Wen friction: a law of one's own for casadi-hbm. See docs/howto/own_law.md."""

from dataclasses import dataclass, field
from typing import ClassVar

import casadi as ca
from hbm.models.friction import ContactSample, Value, parameter


@dataclass(frozen=True, eq=False)
class BoucWen:
    """Bouc-Wen: T = -mu R z, dz/dt = stiffness / (mu R) [v - beta |v| |z|^(n-1) z - (1 - beta) v |z|^n].

    Sliding, |z| tends to 1. A larger exponent bends later and more sharply, and beta 0.5 unloads along a straight line.
    exponent 1 with beta 1 is Dahl's law where R is constant. Where R swings it is another law: T follows R even while
    the contact sticks, and Dahl's T = -stiffness z only through its limit.
    """

    name: ClassVar[str] = "bouc-wen"
    states: ClassVar[int] = 1
    set_valued: ClassVar[bool] = False

    mu: Value = field(metadata=parameter("1", "friction coefficient", "Wen 1976"))
    stiffness: Value = field(metadata=parameter("N/m", "stiffness where z = 0", "Wen 1976"))
    exponent: Value = field(default=1.0, metadata=parameter("1", "exponent n", "Wen 1976", lower=1.0, strict=False))
    beta: Value = field(
        default=0.5,
        metadata=parameter("1", "share that opposes sliding", "Wen 1976", lower=0.5, upper=1.0, strict=False),
    )

    def advance(self, z: Value, before: ContactSample, now: ContactSample) -> tuple[Value, Value]:
        """Relax over the distance slid, at the rate of the middle of the step."""
        limit = self.mu * ca.fmax((before.reaction + now.reaction) / 2, 1e-12 * now.P)
        slip = self.stiffness * (now.displacement - before.displacement) / limit
        middle = self._relaxed(z, z, slip / 2)
        z_new = self._relaxed(z, middle, slip)
        return z_new, -self.mu * now.reaction * z_new

    def _relaxed(self, z: Value, at: Value, slip: Value) -> Value:
        """Solve dz = d(slip) - rate z |d(slip)| exactly, with the rate of the state `at`."""
        sign = ca.if_else(slip < 0, -1.0, 1.0)
        size = ca.sqrt(at**2 + 1e-12)  # |at|^n has no derivative at 0
        rate = ca.fmax(size ** (self.exponent - 1) * (self.beta + (1 - self.beta) * sign * at / size), 1e-9)
        x = rate * sign * slip
        relaxed = z * ca.exp(-x) - sign * ca.expm1(-x) / rate
        return ca.fmin(ca.fmax(relaxed, -1.0), 1.0)  # the limit, which a long step could overshoot


PAPER_BEAM = BoucWen(mu=0.52, stiffness=1.04e7, exponent=2.0)  # assumed: the limit and stiffness of paper_beam.toml
