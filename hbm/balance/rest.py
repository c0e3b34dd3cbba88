"""Where a rig is at rest: joints that push with nobody moving it, such as a pressed stop, displace it."""

import numpy as np

from continuation import NewtonSettings, solve_at
from hbm.balance.jointed import JointBalance
from hbm.balance.problem import TOLERANCE
from hbm.balance.scaled import State
from hbm.fourier import FourierBasis
from models.jointed import AnyRig, JointedRig

SAMPLES = 64
"""Per period in which nothing moves."""

SLOWLY = 1e-2
"""Frequency at which nothing moves, in units of the first elastic mode: far from all of them."""


def at_rest(rig: AnyRig) -> State:
    """Means Q (1, n) of the modes and T (1, m) of the forces where something touches, without an excitation.

    They are zero on a rig with one contact: there displacements count from rest.

    Raises
    ------
    ArithmeticError
        If the joints find no balance.
    """
    n = rig.structure.n
    if not isinstance(rig, JointedRig):
        return State(np.zeros((1, n)), np.zeros((1, 1)), 0.0, 0.0)
    slow = SLOWLY * min((w for w in rig.structure.omega_n if w > 0.0), default=1.0)
    problem = JointBalance(rig, FourierBasis(1, SAMPLES), parameter="force", hz=slow / (2 * np.pi))
    still = np.zeros(problem.size)
    pushed = np.abs(problem.forces(problem.unpack(still, 0.0))[0]).max(initial=0.0)
    if not pushed:
        return State(np.zeros((1, n)), np.zeros((1, rig.ports)), 0.0, 0.0)
    closes = TOLERANCE * max(1.0, pushed / problem.F_ref)
    found = solve_at(problem, still, 0.0, NewtonSettings(tolerance=closes, max_iterations=30))
    if not found.converged:
        raise ArithmeticError(
            f"{rig.name}: no state at rest in which the forces of the joints and the body balance, last residual "
            f"{found.residual_norm:.2g}; {found.reason.value}; try other gaps or stiffnesses"
        )
    state = problem.unpack(found.x, 0.0)
    return State(state.Q[:1], state.T[:1], 0.0, 0.0)
