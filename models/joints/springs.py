"""Joints without memory: springs, dashpots, stops, clearances."""

from dataclasses import dataclass, field
from typing import ClassVar

import casadi as ca

from models.friction.law import parameter
from models.joints.law import Memoryless, Value

ANY = -float("inf")


@dataclass(frozen=True, eq=False)
class PolynomialSpring(Memoryless):
    """Spring with the restoring force k1 u + k2 u^2 + k3 u^3 + k4 u^4 + k5 u^5."""

    name: ClassVar[str] = "polynomial-spring"

    linear: Value = field(default=0.0, metadata=parameter("N/m", "k1", "textbook", lower=ANY))
    quadratic: Value = field(default=0.0, metadata=parameter("N/m2", "k2", "textbook", lower=ANY))
    cubic: Value = field(default=0.0, metadata=parameter("N/m3", "k3", "textbook", lower=ANY))
    quartic: Value = field(default=0.0, metadata=parameter("N/m4", "k4", "textbook", lower=ANY))
    quintic: Value = field(default=0.0, metadata=parameter("N/m5", "k5", "textbook", lower=ANY))

    def force(self, u: Value, v: Value) -> list[Value]:
        """Push back."""
        x = u[0]
        return [-x * (self.linear + x * (self.quadratic + x * (self.cubic + x * (self.quartic + x * self.quintic))))]


@dataclass(frozen=True, eq=False)
class CubicSpring(Memoryless):
    """Spring with the restoring force k3 u^3."""

    name: ClassVar[str] = "cubic-spring"

    cubic: Value = field(metadata=parameter("N/m3", "stiffness k3", "textbook", lower=ANY))

    def force(self, u: Value, v: Value) -> list[Value]:
        """Push back."""
        return [-self.cubic * u[0] ** 3]


@dataclass(frozen=True, eq=False)
class Dashpot(Memoryless):
    """Dashpot with the force c v + c2 v |v| against the motion."""

    name: ClassVar[str] = "dashpot"
    drifting: ClassVar[int] = 1

    linear: Value = field(default=0.0, metadata=parameter("N s/m", "c", "textbook", strict=False))
    quadratic: Value = field(default=0.0, metadata=parameter("N s2/m2", "c2", "textbook", strict=False))

    def force(self, u: Value, v: Value) -> list[Value]:
        """Brake."""
        return [-v[0] * (self.linear + self.quadratic * ca.fabs(v[0]))]


@dataclass(frozen=True, eq=False)
class Stop(Memoryless):
    """One-sided spring, in touch where u > gap; with a negative gap it pushes where u = 0, and moves the body.

    Its force is then the whole of it, not a change from rest.
    """

    name: ClassVar[str] = "impact-stop"

    stiffness: Value = field(metadata=parameter("N/m", "stiffness of the stop", "catalogue of causes", strict=False))
    gap: Value = field(default=0.0, metadata=parameter("m", "clearance", "catalogue of causes", lower=ANY))

    def force(self, u: Value, v: Value) -> list[Value]:
        """Push back what is beyond the gap."""
        return [-self.stiffness * ca.fmax(u[0] - self.gap, 0.0)]


@dataclass(frozen=True, eq=False)
class Separation(Memoryless):
    """What a contact pressed at rest, which the body holds as a spring, loses where it opens: it pulls no more."""

    name: ClassVar[str] = "separation"

    stiffness: Value = field(
        metadata=parameter("N/m", "stiffness of the contact while it is closed", "catalogue of causes", strict=False)
    )
    gap: Value = field(metadata=parameter("m", "displacement at which it opens", "catalogue of causes", strict=False))

    def force(self, u: Value, v: Value) -> list[Value]:
        """Push on where the spring would pull back."""
        return [self.stiffness * ca.fmax(u[0] - self.gap, 0.0)]


@dataclass(frozen=True, eq=False)
class Clearance(Memoryless):
    """Spring behind a clearance on both sides, in touch where |u| > gap."""

    name: ClassVar[str] = "clearance"

    stiffness: Value = field(metadata=parameter("N/m", "stiffness beyond the clearance", "textbook", strict=False))
    gap: Value = field(metadata=parameter("m", "clearance on either side", "textbook", strict=False))

    def force(self, u: Value, v: Value) -> list[Value]:
        """Push back what is beyond the clearance on either side."""
        return [-self.stiffness * (ca.fmax(u[0] - self.gap, 0.0) + ca.fmin(u[0] + self.gap, 0.0))]
