"""The complete linearised balance: how it changes with its unknowns, and what they do about a change of the rig."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hbm.balance.jacobian import law_by_modes
from hbm.balance.problem import Linearization, Newton
from hbm.fourier import Array

REFINED = 1e-12
"""Refinement ends when one more would change the derivatives by less than this fraction."""

MOST_REFINEMENTS = 50

SLOW = 1e-2
"""A matrix from nearby that leaves more of the error than this at a refinement is replaced by that of the state."""


@dataclass(frozen=True, eq=False)
class Disturbance:
    """Forces on a steady state beside its excitation, p columns of Fourier coefficients a_0, a_1..a_H, b_1..b_H.

    Attributes
    ----------
    modes : (2H+1, n, p) array
        Force on each mode.
    friction : (2H+1, p) array
        Force beside that of the friction law, along +x on the beam [N].
    slip, reaction : (2H+1, p) array
        Change of the modal slip [m] and of the normal reaction [N] with the modes held.
    channels : dict of str to (2H+1, p) array
        Displacement at response channels with the modes held [m]; none at those left out.
    """

    modes: Array
    friction: Array
    slip: Array
    reaction: Array
    channels: Mapping[str, Array]


class LinearBalance:
    """The complete linearised balance of a state, for changes of its unknowns in p columns."""

    def __init__(self, here: Linearization) -> None:
        problem, state, kin = here.problem, here.state, here.kin
        self.here = here
        self.problem, self.state, self.by_T, self.contact = problem, state, here.by_T, here.contact
        self._slid = None if here.rotation is None else here.rotation.slid
        real, imaginary = problem.dynamic_stiffness(state.Omega)
        self._stiffness = (real + 1j * imaginary)[:, :, None]
        size, n = problem.basis.size, problem.structure.n
        slip_by_modes = problem.slip_by_modes(kin)  # (2H+1, 2H+1, n)
        self._modes_to_slip = slip_by_modes.reshape(size, size * n)
        # what maps the modes to u takes T to the modes
        self._friction_to_modes = np.ascontiguousarray(slip_by_modes.transpose(0, 2, 1)).reshape(size * n, size)
        self._law_by_modes = law_by_modes(problem, state.Omega, here.contact, None, slip_by_modes)
        self._rows = np.ascontiguousarray(problem.rows[:, 1:].T)

    def by_elements(self, d_Q: Array) -> Array:
        """Change (2H+1, r, p) of the forces of the elements that deflections bring, velocities held."""
        elements, slope = self.problem.elements, self.here.slope
        if elements is None or slope is None or not elements.static.any():
            return np.zeros((len(d_Q), 0 if elements is None else len(elements.rows), d_Q.shape[2]))
        return slope.along(np.einsum("ri,kip->krp", elements.rows, d_Q))

    def slid(self, d_Q: Array, d_T: Array) -> Array:
        """Change (2H+1, p) of the rotation slid in the clamp."""
        clamp = self.problem.clamp
        if clamp is None or self._slid is None:
            return np.zeros_like(d_T)
        return np.asarray(self._slid @ clamp.held(d_Q, d_T, np.zeros_like(d_T)))

    def signals(self, d_Q: Array, d_T: Array) -> Array:
        """Change (2H+1, 3, p) of u, rho, eta with the unknowns (2H+1, n, p) and (2H+1, p)."""
        problem = self.problem
        u = self._modes_to_slip @ d_Q.reshape(-1, d_Q.shape[2]) - problem.dynamic_lagrangian * d_T
        rows = self._rows @ d_Q
        rho = problem.reaction_of(rows, self.state.Omega)
        if self.here.slope is not None:
            rho -= self.here.slope.pushed(d_Q)[:, -1]
        signals = np.stack([u, rho, rows[:, 3]], axis=1)
        return signals if problem.clamp is None else signals + self._by_slid(self.slid(d_Q, d_T))

    def _by_slid(self, slid: Array) -> Array:
        """Change (2H+1, 3, p) of u, rho, eta with what is slid in the clamp (2H+1, p)."""
        residual = np.zeros(1) if self.problem.clamp is None else self.problem.clamp.port.residual
        return np.stack([residual[0] * slid, residual[-1] * slid, np.zeros_like(slid)], axis=1)

    def __matmul__(self, x: Array) -> Array:
        """Scaled change (size, p) of the balance with the scaled unknowns (size, p)."""
        basis, (d_Q, d_T) = self.problem.basis, self.unpack(x)
        modal = basis.real(basis.complex(d_Q) * self._stiffness)
        modal -= (self._friction_to_modes @ d_T).reshape(modal.shape)
        if self.by_T is not None:
            drawn_in = self.problem.structure.shortening.T @ d_Q
            modal += (self.by_T @ drawn_in.reshape(len(drawn_in), -1)).reshape(modal.shape)
        pushed = None if self.here.slope is None else self.here.slope.pushed(d_Q)
        if pushed is not None:
            modal -= pushed[:, :-1]
        if self.problem.clamp is not None:
            modal -= np.einsum("kp,i->kip", self.slid(d_Q, d_T), self.problem.clamp.port.row)
        law = self._law_by_modes @ d_Q.reshape(-1, d_Q.shape[2])
        if pushed is not None and self.contact.by_rho is not None:
            law -= self.contact.by_rho @ pushed[:, -1]
        if self.problem.dynamic_lagrangian and self.contact.by_u is not None:
            law -= self.problem.dynamic_lagrangian * (self.contact.by_u @ d_T)
        if self.problem.clamp is not None:
            law += self.law(self._by_slid(self.slid(d_Q, d_T)))
        return self.scaled(modal, d_T - law)

    def law(self, signals: Array) -> Array:
        """Change (2H+1, p) of the law's force coefficients with those of u, rho, eta."""
        change = np.zeros((len(signals), signals.shape[2]))
        for i, slope in enumerate((self.contact.by_u, self.contact.by_rho, self.contact.by_eta)):
            if slope is not None:
                change += slope @ signals[:, i]
        return change

    def disturbed(self, by: Disturbance) -> Array:
        """Forces beside the excitation in the units of the residual, (size, p)."""
        held = np.stack([by.slip, by.reaction, np.zeros_like(by.slip)], axis=1)
        return self.scaled(by.modes, by.friction + self.law(held))

    def scaled(self, modal: Array, contact: Array) -> Array:
        """Balances (size, p) in the units of the residual, of modal (2H+1, n, p) and contact (2H+1, p) forces."""
        problem = self.problem
        flat = modal.reshape(-1, modal.shape[2])
        return np.concatenate([flat / problem.modal_force_ref, contact / problem.F_ref])

    def unpack(self, x: Array) -> tuple[Array, Array]:
        """Q (2H+1, n, p) and T (2H+1, p) of scaled unknowns (size, p)."""
        problem = self.problem
        split = problem.basis.size * problem.structure.n
        Q = x[:split].reshape(problem.basis.size, problem.structure.n, -1) * problem.q_ref
        return Q, x[split:] * problem.F_ref


@np.errstate(all="ignore")  # what diverges ends in the message
def refined(here: Linearization, balance: LinearBalance, right: Array, near: Newton | None = None) -> tuple[Array, int]:
    """Solve the complete balance with a matrix of Newton's method; and count the refinements.

    Parameters
    ----------
    here : Linearization
    balance : LinearBalance
        The complete balance there.
    right : (size, p) array
    near : Newton, optional
        A matrix that is known, of a state close by.

    Raises
    ------
    ArithmeticError
        At a fold.
    """
    held, whole = np.zeros(len(right)), np.zeros_like(right)  # border that holds the frequency
    acting = np.flatnonzero(right.any(axis=0))
    if not acting.size:  # sensors alone change
        return whole, 0
    matrix = here.newton if near is None else near
    right = right[:, acting]
    x, left, before = np.zeros_like(right), right, np.full(right.shape[1], np.finfo(float).tiny)
    for count in range(MOST_REFINEMENTS + 1):
        step, _ = matrix.solve_columns(held, 1.0, left, 0.0)
        x += step
        size = np.abs(step).max(axis=0)
        following = size * np.minimum(size / before, 1.0)  # steps shrink in proportion
        if np.all(following <= REFINED * np.abs(x).max(axis=0)):
            whole[:, acting] = x
            return whole, count
        if count and not np.all(size <= SLOW * before):
            matrix = here.newton
        left, before = right - balance @ x, np.maximum(size, np.finfo(float).tiny)
    hz = here.state.Omega / (2 * np.pi)
    raise ArithmeticError(
        f"sensitivities: no convergence in {MOST_REFINEMENTS} refinements at {hz:.6g} Hz and {here.state.F:g} N; "
        "at a fold the solution has no derivative at held frequency and force; step away from it"
    )
