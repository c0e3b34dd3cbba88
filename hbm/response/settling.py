"""A march in time from rest: a start where no way through the balance leads to a solution, or why there is none."""

import numpy as np

from hbm.balance.problem import AnyBalance
from hbm.balance.scaled import State
from hbm.fourier import Array, FourierBasis
from hbm.integration.history import TimeHistory
from hbm.integration.integrate import simulate
from hbm.integration.jointed import JointHistory

PERIODS = 60
"""Marched from rest: to what settles in them Newton's method is close enough, and near to what nearly does."""

March = TimeHistory | JointHistory


def march_from_rest(problem: AnyBalance, lam: float) -> March | None:
    """The last two periods of a motion of a rig from rest; None where the march stops."""
    if problem.periods != 1:
        return None
    hz = problem.hz_at(lam)
    try:
        return simulate(problem.rig, hz, level=problem.at(lam)[1], duration=PERIODS / hz, last_periods=2)
    except (ArithmeticError, ValueError):
        return None


def settled(problem: AnyBalance, march: March) -> Array:
    """Unknowns of the last period of a march."""
    period = slice(-march.samples_per_period - 1, -1)
    forces = march.f if isinstance(march, JointHistory) else march.friction
    analysis = FourierBasis(problem.basis.H, march.samples_per_period).analysis
    state = State(analysis @ march.q[period], analysis @ forces[period], 2 * np.pi * march.hz, march.level)
    return problem.pack(state)[0]


def restless(march: March | None) -> str:
    """How far the end of a march is from periodic, in words; nothing where it stopped."""
    if march is None:
        return ""
    return (
        f"; marched in time, the motion still changes by {march.steadiness:.2g} of itself over its {PERIODS}th period"
    )
