"""Initial state of a time integration on a periodic solution of the harmonic balance."""

from hbm.balance.solution import PeriodicSolution
from hbm.integration.history import State


def state_at_phase_zero(solution: PeriodicSolution) -> State:
    """State of a periodic solution where the force is at its crest, to march or to shoot from.

    Returns
    -------
    hbm.integration.history.State
        Its time is 0. The friction law's state is the one just before, by a sample.
    """
    Q, H = solution.state.Q, solution.basis.H
    velocity = solution.state.Omega * solution.basis.derivative(Q)
    friction = float(solution.channels["friction"].samples[0])
    return State(Q[: H + 1].sum(axis=0), velocity[: H + 1].sum(axis=0), friction, solution.memory)
