"""The complete derivative of a balance, dense and exact: for folds, and for given amplitudes."""

import numpy as np

from hbm.aft.force import ContactForce
from hbm.balance.elements import ElementSlope
from hbm.balance.equations import Balance, Kinematics, State
from hbm.fourier import Array


class CompleteBalance:
    """Linearised balance of all unknowns; `slope` is that of the elements, None where none acts.

    Attributes
    ----------
    by_unknowns : (size, size) array
        Derivative of the scaled balances to the scaled unknowns.
    """

    def __init__(
        self, problem: Balance, state: State, kin: Kinematics, contact: ContactForce, slope: ElementSlope | None
    ) -> None:
        self.problem, self.state, self.kin, self.contact, self.slope = problem, state, kin, contact, slope
        self.by_unknowns = self._by_unknowns()

    def _by_unknowns(self) -> Array:
        problem, contact, size = self.problem, self.contact, self.problem.basis.size
        split = size * problem.structure.n
        J, slip = np.empty((problem.size, problem.size)), problem.slip_by_modes(self.kin)  # (2H+1, 2H+1, n)
        J[:split, :split] = self._modes().reshape(split, split)
        J[:split, split:] = -slip.transpose(0, 2, 1).reshape(split, size)  # what maps the modes to u takes T to them
        J[split:, :split] = -self._law(slip.reshape(size, split))
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
        if self.kin.by_T is not None:
            K += self.kin.by_T[:, None, :, None] * problem.structure.shortening[:, None, :]
        real, imaginary = problem.dynamic_stiffness(self.state.Omega)
        H, mode = basis.H, np.arange(n)
        cosine, sine = np.arange(H + 1)[:, None], np.arange(H + 1, 2 * H + 1)[:, None]
        K[cosine, mode, cosine, mode] += real
        K[sine, mode, sine, mode] += real[1:]
        K[cosine[1:], mode, sine, mode] += imaginary[1:]
        K[sine, mode, cosine[1:], mode] -= imaginary[1:]
        return np.asarray(K)

    def _law(self, slip: Array) -> Array:
        """Derivative of the law's force coefficients to the modes, (2H+1, (2H+1) n), with that of the slip."""
        problem, contact, basis = self.problem, self.contact, self.problem.basis
        r, n, Omega = problem.structure.reaction, problem.structure.n, self.state.Omega
        law = np.zeros_like(slip)
        if contact.by_u is not None:
            law += contact.by_u @ slip
        if contact.by_rho is not None:
            rho = contact.by_rho[:, :, None] * (r.stiffness - (basis.k[:, None] * Omega) ** 2 * r.inertia)
            rho += Omega * basis.derivative_on_right(contact.by_rho)[:, :, None] * r.damping
            law += rho.reshape(law.shape)
            if self.slope is not None:
                law -= contact.by_rho @ self.slope.by_Q[:, n].reshape(law.shape)
        if contact.by_eta is not None:
            law += (contact.by_eta[:, :, None] * r.stretch).reshape(law.shape)
        return law
