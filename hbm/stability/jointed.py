"""Stability of a body with joints: the monodromy of its time step along a solution of the harmonic balance.

The state holds the modes, the forces at the ports and all that the laws remember, so that laws with and without memory
are judged alike.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from hbm.aft.recurrence import monodromy
from hbm.balance.equations import Balance
from hbm.balance.jointed import JointBalance
from hbm.balance.scaled import State
from hbm.fourier import Array, FourierBasis
from hbm.integration.jointed import state_at_phase_zero
from hbm.integration.jointmarch import JointMarcher, resolving_steps
from hbm.integration.jointstep import Layout
from hbm.parallel import one_thread
from hbm.stability.multipliers import SLIPPING, Stability, floquet, of_monodromy

TOUCHING = 8.0
"""A stop touches and leaves at samples: multipliers err by up to about this over the samples per period."""

DEPARTS = 0.1
"""Share of the motion by which a march over a period may miss a solution of the balance, made with other means."""

_STRIDES = 1, 2, 4
_KINKED = 0.75  # a smooth slope changes half as much over half the step, one that jumps as much as before


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
    if momentary(problem):
        return _extrapolated(problem, state)
    hz = state.Omega * problem.periods / (2 * np.pi)
    x, undying = state_at_phase_zero(problem, state), sum(j.undying for j in problem.joints)
    marcher, X = _following(problem, hz, state.F, x)
    matrix = marcher.monodromy(x, X)
    for _ in range(problem.periods - 1):
        x, X = X[-1], marcher.period(X[-1])[0]
        matrix = marcher.monodromy(x, X) @ matrix
    error = SLIPPING / problem.basis.N_t if problem.remembers else 1.0 / problem.basis.N_t**2
    return of_monodromy(matrix, 2 * np.pi / state.Omega, undying, error)


def momentary(problem: Balance | JointBalance) -> bool:
    """Whether it is one of joints, the forces of which follow from the motion at the same instant."""
    if not isinstance(problem, JointBalance):
        return False
    layout = Layout.of(problem.structure.n, [j.law for j in problem.rig.joints])
    return bool(layout.size == layout.f.stop)


def _extrapolated(problem: JointBalance, state: State) -> Stability:
    """Stability where forces are momentary, by steps along the solution itself: a march would leave it by their error.

    It is extrapolated to the fourth order from the samples and every other one (Richardson). The error is what half as
    many samples would change, and at kinks of a force, as a stop has, of first order.
    """
    hz = state.Omega * problem.periods / (2 * np.pi)
    steps = _STRIDES[-1] * -(-problem.basis.N_t // (_STRIDES[-1] * problem.periods))
    if JointMarcher(problem.rig, hz, state.F, steps).excess > 0.0:
        steps = resolving_steps(problem.rig, hz, steps)
    if steps * problem.periods != problem.basis.N_t:
        problem = problem.on(FourierBasis(problem.basis.H, steps * problem.periods))
    synthesis = problem.basis.synthesis
    rate = state.Omega * (synthesis @ problem.basis.derivative(state.Q))
    X = np.hstack([synthesis @ state.Q, rate, problem.forces(state)[0]])
    found, jumps = [], []
    for stride in _STRIDES:
        marcher, at = JointMarcher(problem.rig, hz, state.F, steps // stride), X[::stride]
        told = np.tile(marcher.told, (problem.periods, 1))
        slopes = marcher.step.jacobians(at, np.roll(at, -1, axis=0), told)
        found.append(monodromy(slopes))
        jumps.append(np.abs(np.diff(slopes[:, marcher.step.layout.f], axis=0)).max(initial=0.0))
    better = [(4.0 * fine - coarse) / 3.0 for fine, coarse in pairwise(found)]
    changes = [np.abs(_magnitudes(a) - _magnitudes(b)).max() for a, b in (better, *pairwise(found))]
    error = max(changes[0], 1.0 / problem.basis.N_t**2)
    if jumps[0] > _KINKED * jumps[1]:
        error = max(*changes, TOUCHING / problem.basis.N_t)
    return of_monodromy(better[0], 2 * np.pi / state.Omega, error=float(error))


def _magnitudes(matrix: Array) -> Array:
    return np.sort(np.abs(np.linalg.eigvals(matrix)))


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
    """

    start: Array
    steps: Array
    layout: Layout

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
    x = state_at_phase_zero(problem, state)
    marcher, X = _following(problem, state.Omega / (2 * np.pi), state.F, x)
    steps = marcher.step.jacobians(np.vstack([x, X[:-1]]), X, marcher.told)
    return Along(x, steps, marcher.step.layout)


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
