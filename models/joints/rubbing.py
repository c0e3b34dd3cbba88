"""Joints that rub: any friction law along one direction, elastic dry friction in a plane.

What presses them is a constant load, the reaction of a support, or a normal direction of their own: an elastic contact
that is pressed where its displacement is positive, may separate, and carries its load at rest (displacements count
from there). One that is open at rest has a negative load: minus its gap times its stiffness.
"""

from dataclasses import dataclass, field
from numbers import Real
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from models.friction.law import ContactSample, FrictionLaw, parameter
from models.joints.law import JointSample, Value, check_bounds
from models.structure import Array

ANY = -float("inf")

TINY = 1e-30
"""Square of a force [N2] far below any that matters: the length of a vector has no derivative at zero."""


def pressure(load: Value, stiffness: Value, w: Value) -> Value:
    """Normal force of an elastic contact with its load at rest and a displacement into it, none once separated."""
    return ca.fmax(load + stiffness * w, 0.0)


def at_rest(load: Value) -> Value:
    """What of a load at rest is borne."""
    return ca.fmax(load, 0.0)


def _open(load: Value, changes: Array) -> Array:
    """Samples (N,) at which an elastic contact gives back all of its load, (N, 1); none without one, (N, 0)."""
    return np.asarray((changes >= float(at_rest(load))).any(axis=1))


def _loaded(where: str, load: Value, needed: str) -> None:
    """Refuse a load that says open at rest where nothing says how far."""
    if isinstance(load, Real) and load < 0.0:
        raise ValueError(f"{where} = {float(load):g}; must be >= 0; a contact that is open at rest has {needed}")


@dataclass(frozen=True, eq=False)
class Friction:
    """Friction along the first port, of any law; with a `normal_stiffness` the second port presses it.

    Without one the load is constant, or follows the reaction of a support, where the joint is loaded by one.
    """

    name: ClassVar[str] = "friction"
    folds: ClassVar[bool] = True
    drifting: ClassVar[int] = 1

    law: FrictionLaw
    normal_load: Value = field(metadata=parameter("N", "at rest; negative where open", "section 3", lower=ANY))
    normal_stiffness: Value | None = field(
        default=None, metadata=parameter("N/m", "stiffness of the contact along its normal", "textbook", strict=False)
    )
    reference_load: Value | None = field(
        default=None, metadata=parameter("N", "load that stiffnesses of the law refer to; the one at rest", "section 3")
    )

    def __post_init__(self) -> None:
        """Refuse numbers out of their bounds."""
        check_bounds(self)
        if self.normal_stiffness is None or self.reference_load is None:
            _loaded("Friction: normal_load", self.normal_load, "normal_stiffness and reference_load")
        if self.reference_load is None and isinstance(self.normal_load, Real) and self.normal_load == 0.0:
            raise ValueError(
                "Friction: normal_load = 0 and no reference_load; must have one > 0, stiffnesses of the law refer to it"
            )

    @property
    def ports(self) -> int:
        """The sliding direction, and the normal one if it has one of its own."""
        return 1 if self.normal_stiffness is None else 2

    @property
    def states(self) -> int:
        """Those of the law."""
        return self.law.states

    @property
    def set_valued(self) -> bool:
        """As the law is."""
        return self.law.set_valued

    def _normal(self, s: JointSample) -> Value:
        if self.normal_stiffness is None:
            return self.normal_load + s.load
        return pressure(self.normal_load, self.normal_stiffness, s.u[1])

    def separated(self, forces: Array) -> Array:
        """Samples (N,) at which its normal contact is open, of its forces (N, ports)."""
        return _open(self.normal_load, forces[:, 1:])

    def advance(self, z: Value, before: JointSample, now: JointSample) -> tuple[Value, list[Value]]:
        """Advance the friction law under the present load."""
        nominal = self.normal_load if self.reference_load is None else self.reference_load
        told = (ContactSample(s.u[0], s.v[0], self._normal(s), 0.0, s.C, nominal, s.dt, s.f[0]) for s in (before, now))
        z, T = self.law.advance(z, *told)
        if self.normal_stiffness is None:
            return z, [T]
        return z, [T, at_rest(self.normal_load) - self._normal(now)]


@dataclass(frozen=True, eq=False)
class PlaneFriction:
    """Elastic dry friction in a plane: two tangential directions, then the normal one; states are the anchor's place.

    The tangential spring's force keeps within the circle mu N by radial return: its direction is that of the trial
    force, its anchor is dragged along. This is exact where the contact slides along its force, and of first order in
    the step where it turns. Where the contact separates nothing is left of it.
    """

    name: ClassVar[str] = "plane-friction"
    ports: ClassVar[int] = 3
    states: ClassVar[int] = 2
    folds: ClassVar[bool] = False
    set_valued: ClassVar[bool] = False
    drifting: ClassVar[int] = 2

    mu: Value = field(metadata=parameter("1", "friction coefficient", "Coulomb", strict=False))
    tangential_stiffness: Value = field(metadata=parameter("N/m", "of either tangential direction", "textbook"))
    normal_load: Value = field(metadata=parameter("N", "at rest; negative where open", "section 3", lower=ANY))
    normal_stiffness: Value = field(
        metadata=parameter("N/m", "along the normal; 0 for a constant load", "textbook", strict=False)
    )

    def __post_init__(self) -> None:
        """Refuse numbers out of their bounds."""
        check_bounds(self)
        if isinstance(self.normal_stiffness, Real) and self.normal_stiffness == 0.0:
            _loaded("PlaneFriction: normal_load", self.normal_load, "a normal_stiffness")

    def separated(self, forces: Array) -> Array:
        """Samples (N,) at which it is open, of its forces (N, ports)."""
        return _open(self.normal_load, forces[:, 2:])

    def advance(self, z: Value, before: JointSample, now: JointSample) -> tuple[Value, list[Value]]:
        """Return to the circle mu N."""
        N, k = pressure(self.normal_load, self.normal_stiffness, now.u[2]), self.tangential_stiffness
        trial = [k * (z[i] - now.u[i]) for i in range(2)]
        size = ca.sqrt(trial[0] ** 2 + trial[1] ** 2 + TINY)
        kept = ca.fmin(self.mu * N / size, 1.0)
        force = [kept * t for t in trial]
        anchor: Any = ca.vertcat(*(now.u[i] + force[i] / k for i in range(2)))
        return anchor, [*force, at_rest(self.normal_load) - N]
