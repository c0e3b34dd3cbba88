"""Stability of a body with joints: the monodromy of its time step along a solution of the harmonic balance.

The state holds the modes, the forces at the ports and all that the laws remember, so that laws with and without memory
are judged alike.
"""

import numpy as np

from hbm.balance.equations import Balance, State
from hbm.balance.jointed import JointBalance
from hbm.integration.jointed import JointMarcher, state_at_phase_zero
from hbm.parallel import one_thread
from hbm.stability.multipliers import SLIPPING, Stability, floquet, of_monodromy


def by_monodromy(problem: Balance | JointBalance, state: State) -> Stability:
    """Stability of a solution of a balance from its monodromy, of one contact or of joints.

    Raises
    ------
    ValueError
        As :func:`hbm.stability.multipliers.floquet`.
    ArithmeticError
        As :func:`joint_stability`.
    """
    return joint_stability(problem, state) if isinstance(problem, JointBalance) else floquet(problem, state)


@one_thread
def joint_stability(problem: JointBalance, state: State) -> Stability:
    """Stability of a solution of a balance of joints, in as many steps a period as the basis has samples.

    Raises
    ------
    ArithmeticError
        If a step along the solution cannot be solved.
    """
    steps, hz = problem.basis.N_t // problem.periods, state.Omega * problem.periods / (2 * np.pi)
    marcher = JointMarcher(problem.rig, hz, state.F, steps)
    x, undying = state_at_phase_zero(problem, state), sum(j.undying for j in problem.joints)
    matrix = np.eye(len(x))
    for _ in range(problem.periods):
        X, _ = marcher.period(x)
        matrix, x = marcher.monodromy(x, X) @ matrix, X[-1]
    slips = any(j.functions.memory for j in problem.joints)
    error = SLIPPING / problem.basis.N_t if slips else 1.0 / problem.basis.N_t**2
    return of_monodromy(matrix, 2 * np.pi / state.Omega, undying, error)
