"""The complete derivative of a balance, dense and exact: for folds, and for given amplitudes."""

import numpy as np

from hbm.aft.force import ContactForce
from hbm.balance.elements import ElementSlope
from hbm.balance.equations import Balance, Kinematics
from hbm.balance.scaled import State
from hbm.fourier import Array


class CompleteBalance:
    """Linearised balance of all unknowns; `slope` is that of the elements, None where none acts.

    Attributes
    ----------
    by_unknowns : (size, size) array
        Derivative of the scaled balances to the scaled unknowns.
    """

    def __init__(
        self,
        problem: Balance,
        state: State,
        kin: Kinematics,
        contact: ContactForce,
        by_T: Array | None,
        slope: ElementSlope | None,
    ) -> None:
        self.problem, self.state, self.kin, self.contact = problem, state, kin, contact
        self.by_T, self.slope = by_T, slope
        self.by_unknowns = self._by_unknowns()

    def _by_unknowns(self) -> Array:
        problem, contact, size = self.problem, self.contact, self.problem.basis.size
        split = size * problem.structure.n
        J, slip = np.empty((problem.size, problem.size)), problem.slip_by_modes(self.kin)  # (2H+1, 2H+1, n)
        J[:split, :split] = self._modes().reshape(split, split)
        J[:split, split:] = -slip.transpose(0, 2, 1).reshape(split, size)  # what maps the modes to u takes T to them
        J[split:, :split] = -law_by_modes(problem, self.state.Omega, contact, self.slope, slip)
        J[split:, split:] = np.eye(size)
        if problem.dynamic_lagrangian and contact.by_u is not None:
            J[split:, split:] += problem.dynamic_lagrangian * contact.by_u
        J[:split] /= problem.modal_force_ref
        J[split:] /= problem.F_ref
        J[:, :split] *= problem.q_ref
        J[:, split:] *= problem.F_ref
        return J

    def _modes(self) -> Array:
        """Derivative of the modal balance to the modes, (2H+1, n, 2H+1, n)."""
        problem, basis, n = self.problem, self.problem.basis, self.problem.structure.n
        K = np.zeros((basis.size, n, basis.size, n)) if self.slope is None else -self.slope.by_Q[:, :n]
        if self.by_T is not None:
            K += self.by_T[:, None, :, None] * problem.structure.shortening[:, None, :]
        real, imaginary = problem.dynamic_stiffness(self.state.Omega)
        H, mode = basis.H, np.arange(n)
        cosine, sine = np.arange(H + 1)[:, None], np.arange(H + 1, 2 * H + 1)[:, None]
        K[cosine, mode, cosine, mode] += real
        K[sine, mode, sine, mode] += real[1:]
        K[cosine[1:], mode, sine, mode] += imaginary[1:]
        K[sine, mode, cosine[1:], mode] -= imaginary[1:]
        return np.asarray(K)


def law_by_modes(
    problem: Balance, Omega: float, contact: ContactForce, slope: ElementSlope | None, slip: Array
) -> Array:
    """Derivative of the law's force coefficients to the lowest m modes, (2H+1, (2H+1) m).

    Parameters
    ----------
    problem : Balance
    Omega : float
        [rad/s].
    contact : ContactForce
    slope : ElementSlope or None
        That of the elements, None where none acts.
    slip : (2H+1, 2H+1, m) array
        Derivative of the slip to these modes.
    """
    basis, (size, _, m) = problem.basis, slip.shape
    law = np.zeros((size, size * m)) if contact.by_u is None else contact.by_u @ slip.reshape(size, -1)
    if contact.by_rho is not None and slope is not None:
        law -= contact.by_rho @ slope.by_Q[:, problem.structure.n, :, :m].reshape(law.shape)
    if problem.structure.reaction.varies and not (contact.by_rho is None and contact.by_eta is None):
        by_rows = np.zeros((size, size, 4))  # inertia, damping and stiffness of the reaction, stretch
        if contact.by_rho is not None:
            by_rows[:, :, 0] = -contact.by_rho * (basis.k * Omega) ** 2
            by_rows[:, :, 1] = Omega * basis.derivative_on_right(contact.by_rho)
            by_rows[:, :, 2] = contact.by_rho
        if contact.by_eta is not None:
            by_rows[:, :, 3] = contact.by_eta
        law += (by_rows.reshape(-1, 4) @ problem.rows[:m, 1:].T).reshape(law.shape)
    return law
