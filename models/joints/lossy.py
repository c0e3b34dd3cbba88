"""Joints that lose energy by what they remember: damping by a loss factor, friction behind a play."""

from dataclasses import dataclass, field
from typing import ClassVar

import casadi as ca
import numpy as np

from models.friction.elements import clip, mean_decay
from models.friction.law import parameter
from models.joints.law import JointSample, Value, check_bounds

APART, BRANCHES = 5.0, 7
"""Ratio of the relaxation times of neighbouring branches of a loss factor, and how many there are."""

TIMES = APART ** (np.arange(BRANCHES) - BRANCHES // 2)
"""Relaxation times, in units of 1/omega of the reference frequency."""

SHARE = 1.0 / float(np.sum(TIMES / (1.0 + TIMES**2)))
"""Stiffness of each branch, with which all of them together lose what one spring of loss modulus 1 does there."""


@dataclass(frozen=True, eq=False)
class HystereticDamping:
    """Damping by a loss factor: a force in quadrature with the displacement, in proportion to it at any frequency.

    A complex stiffness answers before it is asked: no motion in time obeys it. Branches of a spring and a dashpot each,
    their relaxation times evenly spread (Biot 1958), are its causal form. Their loss is constant to 2 % from a third to
    three times the reference frequency, to 4 % from a tenth to ten times. At the reference they add no stiffness. Away
    from it they must, by 2/pi ln(f / reference) of the loss modulus.

    References
    ----------
    M. A. Biot, Linear thermodynamics and the mechanics of solids, Proc. 3rd US Nat. Congr. Appl. Mech., 1958.
    """

    name: ClassVar[str] = "hysteretic-damping"
    ports: ClassVar[int] = 1
    states: ClassVar[int] = BRANCHES
    folds: ClassVar[bool] = False
    set_valued: ClassVar[bool] = False
    drifting: ClassVar[int] = 0

    loss: Value = field(metadata=parameter("N/m", "loss factor times stiffness", "textbook", strict=False))
    frequency: Value = field(metadata=parameter("Hz", "where it adds no stiffness", "Biot 1958"))

    def __post_init__(self) -> None:
        """Refuse numbers out of their bounds."""
        check_bounds(self)

    def advance(self, z: Value, before: JointSample, now: JointSample) -> tuple[Value, list[Value]]:
        """Relax the force of each branch over a step in which the displacement moves evenly."""
        stiffness, moved = SHARE * self.loss, now.u[0] - before.u[0]
        steps = [2.0 * np.pi * self.frequency * now.dt / time for time in TIMES]
        z = ca.vertcat(*(ca.exp(-x) * z[i] + stiffness * moved * mean_decay(x) for i, x in enumerate(steps)))
        return z, [BRANCHES / 2.0 * stiffness * now.u[0] - ca.sum1(z)]


@dataclass(frozen=True, eq=False)
class Backlash:
    """A slider behind a spring and a play: nothing acts within the play, which the slider drags along at its limit.

    Its state is where the middle of the play is.
    """

    name: ClassVar[str] = "backlash"
    ports: ClassVar[int] = 1
    states: ClassVar[int] = 1
    folds: ClassVar[bool] = False
    set_valued: ClassVar[bool] = False
    drifting: ClassVar[int] = 1

    stiffness: Value = field(metadata=parameter("N/m", "once the play is taken up", "textbook"))
    limit: Value = field(metadata=parameter("N", "at which it slides", "textbook"))
    play: Value = field(metadata=parameter("m", "whole way in which nothing acts", "textbook", strict=False))

    def __post_init__(self) -> None:
        """Refuse numbers out of their bounds."""
        check_bounds(self)

    def advance(self, z: Value, before: JointSample, now: JointSample) -> tuple[Value, list[Value]]:
        """Drag the middle along where the spring's force would exceed the limit."""
        half, k = self.play / 2.0, self.stiffness
        reach = half + self.limit / k
        from_middle = clip(now.u[0] - z, -reach, reach)
        pressed = ca.fmax(from_middle - half, 0.0) + ca.fmin(from_middle + half, 0.0)
        return now.u[0] - from_middle, [-k * pressed]
