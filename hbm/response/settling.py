"""Steady states from time integration: a start where no way through the balance leads to a solution."""

import numpy as np

from hbm.balance.jointed import JointBalance
from hbm.balance.problem import AnyBalance, HarmonicBalance
from hbm.balance.scaled import State
from hbm.fourier import Array, FourierBasis
from hbm.integration.integrate import simulate
from hbm.integration.jointmarch import LEAST_STEPS, JointMarcher, resolving_steps

PERIODS = 60
"""Marched from rest: to what settles in them Newton's method is close enough, and near to what nearly does."""


def settled(problem: AnyBalance, lam: float) -> Array | None:
    """Unknowns of the motion of a rig some periods after rest; None where the march stops."""
    if problem.periods != 1:
        return None
    hz, F = problem.hz_at(lam), problem.at(lam)[1]
    try:
        q, f = _joints(problem, hz, F) if isinstance(problem, JointBalance) else _contact(problem, hz, F)
    except (ArithmeticError, ValueError):
        return None
    analysis = FourierBasis(problem.basis.H, len(q)).analysis
    return problem.pack(State(analysis @ q, analysis @ f, 2 * np.pi * hz, F))[0]


def _joints(problem: JointBalance, hz: float, F: float) -> tuple[Array, Array]:
    """Modes and forces at the samples of the last period."""
    n, marcher = problem.structure.n, JointMarcher(problem.rig, hz, F, resolving_steps(problem.rig, hz, LEAST_STEPS))
    X = np.zeros((1, marcher.size))
    for _ in range(PERIODS):
        X, _ = marcher.period(X[-1])
    X = np.roll(X, 1, axis=0)  # phase 0 is the last state of a period
    return X[:, :n], X[:, marcher.step.layout.f]


def _contact(problem: HarmonicBalance, hz: float, F: float) -> tuple[Array, Array]:
    """Modes and friction at the samples of the last period."""
    history = simulate(problem.rig, hz, level=F, duration=PERIODS / hz, last_periods=1)
    return history.q[:-1], history.friction[:-1]


def restless(problem: AnyBalance, lam: float) -> str:
    """How far a motion from rest is from periodic after as many periods, in words; nothing where it cannot be told."""
    if problem.periods != 1:
        return ""
    hz, F = problem.hz_at(lam), problem.at(lam)[1]
    try:
        change = simulate(problem.rig, hz, level=F, duration=PERIODS / hz, last_periods=2).steadiness
    except (ArithmeticError, ValueError):
        return ""
    return f"; marched in time, the motion still changes by {change:.2g} of itself over its {PERIODS}th period"
