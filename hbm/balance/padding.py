"""A state of a balance on other harmonics and modes."""

import numpy as np

from hbm.balance.elements import ElementsOverPeriod
from hbm.balance.equations import Balance
from hbm.balance.jointed import JointBalance
from hbm.balance.scaled import State
from hbm.fourier import Array


def pad(problem: Balance | JointBalance, state: State) -> Array:
    """Scaled unknowns of a state on the problem's harmonics and modes.

    New harmonics start from zero, new modes from their linear response to excitation, friction and the lift of the tip.
    """
    if isinstance(problem, JointBalance):
        return problem.padded(state)
    n, m = problem.structure.n, min(problem.structure.n, state.Q.shape[1])
    Q, T = np.zeros((problem.basis.size, n)), problem.on_these_harmonics(state.T)
    Q[:, :m] = problem.on_these_harmonics(state.Q[:, :m])
    if n > m:
        s, basis = problem.structure, problem.basis
        forces = np.outer(T, s.slip_row[m:]) + np.outer(state.F * problem.force_shape, s.excitation[m:])
        forces += _lift_on_others(problem, Q[:, :m], state.Omega, state.F)
        real, imaginary = problem.dynamic_stiffness(state.Omega)
        Q[:, m:] = basis.real(basis.complex(forces) / (real[:, m:] + 1j * imaginary[:, m:]))
    return problem.pack(State(Q, T, state.Omega, state.F))[0]


def _lift_on_others(problem: Balance, Q: Array, Omega: float, F: float) -> Array:
    """Force (2H+1, n - m) of a tip that is off its support in the lowest m modes (2H+1, m), on all others."""
    m, rig = Q.shape[1], problem.rig
    others = problem.structure.n - m
    lifting, lifts = problem.elements, rig.contact.lift_off and m > 0
    if lifting is None or not lifts or rig.beam is None:
        return np.zeros((len(Q), others))
    if others >= rig.beam.modes:  # the state is of another rig
        return np.zeros((len(Q), others))
    fewer = ElementsOverPeriod(rig.with_modes(rig.beam.modes - others), problem.basis)
    force = fewer.along_rows(Q, Omega, F * problem.force_shape)[:, -1]
    return np.outer(force, lifting.rows[-1, m:])
