"""Steady states of joints from time integration: a start where no way through the balance leads to a solution."""

import numpy as np

from hbm.balance.jointed import JointBalance
from hbm.balance.problem import AnyBalance
from hbm.balance.scaled import State
from hbm.fourier import Array, FourierBasis
from hbm.integration.jointmarch import LEAST_STEPS, JointMarcher, resolving_steps

PERIODS = 60
"""Marched from rest: to what settles in them Newton's method is close enough."""


def settled(problem: AnyBalance, lam: float) -> Array | None:
    """Unknowns of the motion of a rig with joints some periods after rest; None where the march stops."""
    if not isinstance(problem, JointBalance) or problem.periods != 1:
        return None
    hz, F, n = problem.hz_at(lam), problem.at(lam)[1], problem.structure.n
    try:
        marcher = JointMarcher(problem.rig, hz, F, resolving_steps(problem.rig, hz, LEAST_STEPS))
        X = np.zeros((1, marcher.size))
        for _ in range(PERIODS):
            X, _ = marcher.period(X[-1])
    except ArithmeticError:
        return None
    # phase 0 is the last state of a period
    coefficients = FourierBasis(problem.basis.H, marcher.steps).analysis @ np.roll(X, 1, axis=0)
    found = State(coefficients[:, :n], coefficients[:, marcher.step.layout.f], 2 * np.pi * hz, F)
    return problem.pack(found)[0]
