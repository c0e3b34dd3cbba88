"""Stability of a body with joints: the monodromy of its time step along a solution of the harmonic balance.

The state holds the modes, the forces at the ports and all that the laws remember, so that laws with and without memory
are judged alike.
"""

from dataclasses import dataclass

import numpy as np

from hbm.aft.recurrence import monodromy
from hbm.balance.equations import Balance
from hbm.balance.jointed import JointBalance
from hbm.balance.scaled import State
from hbm.fourier import Array
from hbm.integration.jointed import state_at_phase_zero
from hbm.integration.jointmarch import JointMarcher, resolving_steps
from hbm.integration.jointstep import Layout
from hbm.parallel import one_thread
from hbm.stability.multipliers import SLIPPING, Stability, floquet, of_monodromy

DEPARTS = 0.1
"""Share of the motion by which a march over a period may miss a solution of the balance, made with other means."""


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
    """Stability of a solution of a balance of joints, in as many steps a period as the basis has samples, or more.

    Raises
    ------
    ArithmeticError
        If a step along the solution cannot be solved.
    """
    hz = state.Omega * problem.periods / (2 * np.pi)
    x, undying = state_at_phase_zero(problem, state), sum(j.undying for j in problem.joints)
    marcher, X = _following(problem, hz, state.F, x)
    matrix = marcher.monodromy(x, X)
    for _ in range(problem.periods - 1):
        x, X = X[-1], marcher.period(X[-1])[0]
        matrix = marcher.monodromy(x, X) @ matrix
    slips = any(j.functions.memory for j in problem.joints)
    error = SLIPPING / problem.basis.N_t if slips else 1.0 / problem.basis.N_t**2
    return of_monodromy(matrix, 2 * np.pi / state.Omega, undying, error)


@dataclass(frozen=True, eq=False)
class Along:
    """Time steps along a solution over a period of the force.

    Attributes
    ----------
    start : (size,) array
        State at phase 0.
    steps : (N, size, size) array
        Derivative of the state after each step to that before.
    layout : Layout
        Parts of a state.
    undying : int
        See :class:`hbm.stability.multipliers.Stability`.
    """

    start: Array
    steps: Array
    layout: Layout
    undying: int

    @property
    def monodromy(self) -> Array:
        """Derivative of the state after a period to that before, (size, size)."""
        return monodromy(self.steps)


def along_solution(problem: JointBalance, state: State) -> Along:
    """Time steps along a solution of a balance of joints that has the period of the force.

    Raises
    ------
    ArithmeticError
        If a step along the solution cannot be solved.
    """
    x, undying = state_at_phase_zero(problem, state), sum(j.undying for j in problem.joints)
    marcher, X = _following(problem, state.Omega / (2 * np.pi), state.F, x)
    steps = marcher.step.jacobians(np.vstack([x, X[:-1]]), X, marcher.told)
    return Along(x, steps, marcher.step.layout, undying)


def _following(problem: JointBalance, hz: float, level: float, x: Array) -> tuple[JointMarcher, Array]:
    """Marcher in steps short enough for the joints, and the states of the first period from a state on the solution."""
    steps, n = problem.basis.N_t // problem.periods, problem.rig.structure.n
    marcher = JointMarcher(problem.rig, hz, level, steps)
    if marcher.excess <= 0.0:
        X, _ = marcher.period(x)
        # stiff where it touches, but not at rest: the march leaves the solution
        if problem.periods > 1 or np.abs(X[-1, :n] - x[:n]).max() < DEPARTS * np.abs(x[:n]).max():
            return marcher, X
    marcher = JointMarcher(problem.rig, hz, level, resolving_steps(problem.rig, hz, steps))
    return marcher, marcher.period(x)[0]
