"""Multi-harmonic residual of a rig, as a problem for continuation.

Unknowns are the modal coefficients Q (2H+1, n) and the coefficients of the friction force T (2H+1,).
Mechanics outside the contact is linear, so the Newton system is eliminated down to the 2H+1 unknowns of T
and the continuation parameter: its dense core is as large as the contact signal, not as the structure.

Scaling. Modal rows are divided by the largest generalised excitation, the contact row by the excitation
amplitude: a residual of 1e-10 means that every force balance, harmonic by harmonic, closes to 1e-10 of the
excitation.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.linalg import lapack

from hbm.aft import ContactForce, Environment, LawOverPeriod
from hbm.fourier import Array, FourierBasis
from models.friction import parameters
from models.rig import Rig

Parameter = Literal["frequency", "force"]

COUPLING = 0.02
"""Foreshortening of a mode stays out of the Newton matrix below this fraction of its least dynamic stiffness."""


LOW_HARMONICS = 5
RESONANT = 2e-3
"""Among the coupled modes it stays in the matrix up to this harmonic, and above this fraction of the stiffness."""


@dataclass(frozen=True)
class State:
    """Unknowns in physical units: Q (2H+1, n), T (2H+1,) [N], Omega [rad/s] and force F [N]."""

    Q: Array
    T: Array
    Omega: float
    F: float


@dataclass(frozen=True)
class Kinematics:
    """What the contact sees of a state.

    Attributes
    ----------
    Gq : (2H+1, n) array
        Coefficients of G q; du/dq = c - G q. Zeros where the structure is not drawn in.
    by_T : (2H+1, 2H+1) array or None
        Matrix that multiplies a series by T; None where the structure is not drawn in.
    signals : (2H+1, 4) array
        Coefficients of u, v, rho, eta (:data:`hbm.aft.SIGNALS`).
    """

    Gq: Array
    by_T: Array | None
    signals: Array


@dataclass(frozen=True)
class DenseBlock:
    """The coefficients whose parametric stiffness is kept in the Newton matrix.

    Attributes
    ----------
    cosines : (c,) array of int
        The pairs, in the order harmonic by harmonic, mode by mode.
    coefficients : (d,) array of int
        Their cosine, then their sine coefficients in the flat (2H+1, m) unknowns.
    products : (d, d) array of int
        Where each pair of coefficients finds its entry in the flat multiplication matrix of T.
    G : (d, d) array
        Shortening of the modes of each pair.
    """

    cosines: npt.NDArray[np.intp]
    coefficients: npt.NDArray[np.intp]
    products: npt.NDArray[np.intp]
    G: Array

    @staticmethod
    def of(strong: npt.NDArray[np.bool_], shortening: Array, size: int) -> "DenseBlock":
        """Block of the pairs `strong` (H+1, m); harmonic 0 whole."""
        cosines = np.flatnonzero(strong)
        sines = np.flatnonzero(strong[1:]) + strong.size  # behind the (H+1) m cosines
        coefficients = np.concatenate([cosines, sines])
        harmonic, mode = np.divmod(coefficients, strong.shape[1])
        products = harmonic[:, None] * size + harmonic
        return DenseBlock(cosines, coefficients, products, shortening[mode[:, None], mode])


class HarmonicBalance:
    """A rig on a Fourier basis with one free parameter, a :class:`continuation.Problem`.

    Parameters
    ----------
    rig : Rig
        Structure, contact and excitation.
    basis : FourierBasis
        Harmonics and samples.
    parameter : {"frequency", "force"}
        What the continuation parameter is: the frequency in units of `hz_ref`, or F / amplitude.
    hz : float
        Excitation frequency where the parameter is the force [Hz].
    level : float, optional
        Force amplitude where the parameter is the frequency [N]; the rig's where omitted.
    """

    def __init__(
        self,
        rig: Rig,
        basis: FourierBasis,
        *,
        parameter: Parameter = "frequency",
        hz: float = 0.0,
        level: float | None = None,
    ) -> None:
        s = rig.structure
        self.rig, self.structure, self.basis, self.parameter = rig, s, basis, parameter
        self.level = rig.excitation.amplitude if level is None else level
        self.fixed_hz = hz
        omega_1 = float(s.omega_n[0])
        self.hz_ref = 2.0 ** round(float(np.log2(omega_1 / (2 * np.pi))))  # a power of two: scaling back loses no digit
        self.Omega_ref = 2 * np.pi * self.hz_ref
        self.F_ref = self.level
        self.modal_force_ref = self.F_ref * float(np.abs(s.excitation).max())
        # a tenfold dynamic amplification of the static response of the first mode
        self.q_ref = 10.0 * self.modal_force_ref / omega_1**2
        self.lam_ref = self.Omega_ref if parameter == "frequency" else self.F_ref
        self.law = LawOverPeriod(rig.contact.law, basis)
        self.environment, self.dynamic_lagrangian = self._environment(rig)
        r = s.reaction
        self.rows = np.stack([s.slip_row, r.inertia, r.damping, r.stiffness, r.stretch], axis=1)
        self._blocks: dict[bytes, DenseBlock] = {}
        self.coupling = rig.contact.normal_load * np.diag(s.shortening)
        self.coupled = self._coupled_modes()

    # ---- set-up

    def _environment(self, rig: Rig) -> tuple[Environment, float]:
        """Law inputs; and the compliance lent to a set-valued law of a structure that has none.

        The loan is taken back harmonic by harmonic (dynamic Lagrangian frequency-time): the law is shown
        u - loan T, with T the unknown coefficients, so that at convergence the contact point sticks and slips
        exactly and its motion has the coefficients of u. The answer does not depend on the loan.
        """
        s = self.structure
        values = np.array([float(v) for v in parameters(rig.contact.law).values()])
        lend = rig.contact.law.set_valued and s.compliance == 0.0
        # a tenth of what the structure yields at the first harmonic left out: less is stiffer to solve, more is blunter
        loan = 0.1 * float(np.sum(s.slip_row**2 / (s.omega_n**2 + (self.basis.H * s.omega_n[0]) ** 2))) if lend else 0.0
        return Environment(s.compliance + loan, rig.contact.normal_load, values), loan

    def _coupled_modes(self) -> int:
        """How many of the lowest modes need their foreshortening in the Newton matrix."""
        s = self.structure
        least_stiffness = np.minimum(s.damping * s.omega_n, s.omega_n**2)
        strong = np.flatnonzero(self.coupling > COUPLING * least_stiffness)
        return int(strong[-1]) + 1 if strong.size else 0

    def dense_block(self, strong: npt.NDArray[np.bool_]) -> "DenseBlock":
        """Where the (harmonic, mode) pairs `strong` (H+1, m) stand in the balance; remembered from point to point."""
        key = strong.tobytes()
        if key not in self._blocks:
            self._blocks[key] = DenseBlock.of(strong, self.structure.shortening, self.basis.size)
        return self._blocks[key]

    def with_harmonics(self, H: int) -> "HarmonicBalance":
        """Return the same problem with another number of harmonics on the same samples."""
        basis = FourierBasis(H, self.basis.N_t)
        return HarmonicBalance(self.rig, basis, parameter=self.parameter, hz=self.fixed_hz, level=self.level)

    # ---- vectors

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.basis.size * (self.structure.n + 1)

    def pack(self, state: State) -> tuple[Array, float]:
        """Scaled unknowns and continuation parameter of a state."""
        x = np.concatenate([(state.Q / self.q_ref).ravel(), state.T / self.F_ref])
        return x, state.Omega / self.Omega_ref if self.parameter == "frequency" else state.F / self.F_ref

    def unpack(self, x: Array, lam: float) -> State:
        """State in physical units of scaled unknowns."""
        split = self.basis.size * self.structure.n
        Q = x[:split].reshape(self.basis.size, -1) * self.q_ref
        Omega, F = self.at(lam)
        return State(Q, x[split:] * self.F_ref, Omega, F)

    def at(self, lam: float) -> tuple[float, float]:
        """Frequency [rad/s] and force amplitude [N] at a value of the continuation parameter."""
        if self.parameter == "frequency":
            return lam * self.Omega_ref, self.level
        return 2 * np.pi * self.fixed_hz, lam * self.F_ref

    def hz_at(self, lam: float) -> float:
        """Frequency [Hz] at a value of the continuation parameter."""
        return lam * self.hz_ref if self.parameter == "frequency" else self.fixed_hz

    def lam_at(self, hz: float) -> float:
        """Value of the continuation parameter at a frequency [Hz], where the frequency is the parameter."""
        return hz / self.hz_ref

    # ---- mechanics

    def kinematics(self, state: State) -> Kinematics:
        """Slip, its velocity, and the two parts of the reaction, from the modes."""
        s, basis, Q, Omega = self.structure, self.basis, state.Q, state.Omega
        rows = Q @ self.rows  # slip, three of the reaction, stretch
        signals = np.empty((basis.size, 4))
        u = signals[:, 0]
        u[:] = rows[:, 0]
        if self.coupled:
            Gq, by_T = Q @ s.shortening, basis.multiplication(state.T)
            fine = basis.exact_products
            u -= 0.5 * (fine.analysis @ np.einsum("ti,ti->t", fine.synthesis @ Gq, fine.synthesis @ Q))
        else:
            Gq, by_T = np.zeros_like(Q), None
        if self.dynamic_lagrangian:
            u -= self.dynamic_lagrangian * state.T
        u[basis.fundamental] += s.residual.slip_by_force * state.F
        signals[:, 1] = Omega * basis.derivative(u)
        signals[:, 2] = self.reaction_of(rows[:, 1:4], Omega)
        signals[0, 2] += self.rig.contact.normal_load
        signals[basis.fundamental, 2] -= s.reaction.force_share * state.F
        signals[:, 3] = rows[:, 4]
        signals[0, 3] -= s.reaction.friction_lever
        return Kinematics(Gq, by_T, signals)

    def reaction_of(self, rows: Array, Omega: float) -> Array:
        """Coefficients (2H+1, ...) of the reaction's part from the modes.

        Parameters
        ----------
        rows : (2H+1, 3, ...) array
            Coefficients of the inertia, damping and stiffness rows times the modes.
        Omega : float
            [rad/s].
        """
        inertia, damping, stiffness = rows[:, 0], rows[:, 1], rows[:, 2]
        squared = (self.basis.k * Omega) ** 2
        return Omega * self.basis.derivative(damping) - (squared * inertia.T).T + stiffness

    def dynamic_stiffness(self, Omega: float) -> tuple[Array, Array]:
        """Dynamic stiffness per mass-normalised mode, real and imaginary part, (H+1, n) [1/s2]."""
        k = np.arange(self.basis.H + 1)[:, None] * Omega
        return self.structure.omega_n**2 - k**2, k * self.structure.damping

    def _modal_balance(self, state: State, kin: Kinematics) -> Array:
        """Inertia, damping and stiffness minus friction and excitation, per mode, (2H+1, n)."""
        s, basis = self.structure, self.basis
        Q, Omega = state.Q, state.Omega
        force = np.outer(state.T, s.slip_row)
        if kin.by_T is not None:
            force -= kin.by_T @ kin.Gq
        balance = (s.omega_n**2 - (basis.k * Omega)[:, None] ** 2) * Q
        balance += Omega * s.damping * basis.derivative(Q) - force
        balance[basis.fundamental] -= s.excitation * state.F
        return balance

    def residual(self, x: Array, lam: float) -> Array:
        """Scaled force balance of every mode and harmonic, then of the contact, (size,)."""
        return self.linearize(x, lam).residual

    def linearize(self, x: Array, lam: float) -> "Linearization":
        """Residual with its linearisation, which is worked out when first solved with."""
        state = self.unpack(x, lam)
        kin = self.kinematics(state)
        T, _ = self.law.force(kin.signals, state.Omega, self.environment)
        modal, contact = self._modal_balance(state, kin), state.T - self.basis.analysis @ T
        residual = np.concatenate([(modal / self.modal_force_ref).ravel(), contact / self.F_ref])
        return Linearization(self, state, kin, residual)

    def contact_state(self, state: State) -> tuple[Kinematics, Array, Array, float]:
        """Kinematics, friction force at the samples [N], internal state before the first, and closure of the loop."""
        kin = self.kinematics(state)
        T, closure = self.law.force(kin.signals, state.Omega, self.environment)
        return kin, T.copy(), self.law.memory, closure


class Linearization:
    """Residual at a state, and its derivative when asked for; a :class:`continuation.Linearization`."""

    def __init__(self, problem: HarmonicBalance, state: State, kin: Kinematics, residual: Array) -> None:
        self.problem, self.state, self.kin, self.residual = problem, state, kin, residual

    @cached_property
    def elimination(self) -> "Elimination":
        """The derivative, with the modes eliminated."""
        problem, state = self.problem, self.state
        contact = problem.law.linearize(self.kin.signals, state.Omega, problem.environment)
        return Elimination(problem, state, self.kin, contact)

    def solve_bordered(self, row: Array, row_lam: float, rhs: Array, rhs_row: float) -> tuple[Array, float]:
        """Solve the bordered Newton system, see :class:`continuation.Linearization`."""
        return self.elimination.solve_bordered(row, row_lam, rhs, rhs_row)

    def determinant_sign(self, row: Array, row_lam: float) -> int:
        """Sign of the determinant of the bordered matrix."""
        return self.elimination.determinant_sign(row, row_lam)


class Elimination:
    """Linearised balance [K, -P; -E, S] of modes and contact, reduced to the contact.

    K is the structure with the friction force held (its foreshortening is a parametric stiffness), P takes
    T to the modes, E takes the modes to T through the law. The lowest `coupled` modes are
    eliminated with a dense factorisation, the others harmonic by harmonic in closed form. The foreshortening of
    those others, weak beside their damping, is left out here, not in the residual: it costs Newton a little of its
    quadratic rate, never the answer.
    """

    def __init__(self, problem: HarmonicBalance, state: State, kin: Kinematics, contact: ContactForce) -> None:
        self.problem, self.state, self.contact = problem, state, contact
        s, basis, m = problem.structure, problem.basis, problem.coupled
        size = basis.size
        self._m = m
        real, imaginary = problem.dynamic_stiffness(state.Omega)
        self._receptance = 1.0 / (real[:, m:] + 1j * imaginary[:, m:])
        self._rows = problem.rows.T
        slopes = [contact.by_u, contact.by_rho, contact.by_eta]
        self._seen = [i for i in range(3 if s.reaction.varies else 1) if slopes[i] is not None]
        self._law_slopes = [b for i, b in enumerate(slopes) if b is not None and i in self._seen]
        self._core = np.eye(size)
        if s.n > m:
            self._core -= self._law_of_others()
        if problem.dynamic_lagrangian and contact.by_u is not None:
            self._core += problem.dynamic_lagrangian * contact.by_u
        modal_slope, contact_slope = self._slope()
        self._modal_slope = modal_slope
        self._core_lam = contact_slope
        if s.n > m:
            self._core_lam = contact_slope + self._law_of_field(self._receptance_of(modal_slope[:, m:, None]))[:, 0]
        if kin.by_T is not None:
            p = -kin.Gq[:, :m]
            p[0] += s.slip_row[:m]
            self._p = basis.multiplication(p)  # (2H+1, 2H+1, m)
            self._factor(real[:, :m] + 1j * imaginary[:, :m], kin.by_T)
            forces = np.empty((size, m, size + 1))
            forces[:, :, :size] = self._p.transpose(0, 2, 1)
            forces[:, :, size] = modal_slope[:, :m]
            self._coupled_of = self._solve_coupled(forces)
            law = self._law_of_coupled(self._coupled_of)
            self._core -= law[:, :size]
            self._core_lam += law[:, size]

    # ---- coupled modes

    def _factor(self, stiffness: npt.NDArray[np.complex128], by_T: Array) -> None:
        """Receptance of the coupled modes, and LU with the parametric stiffness T G where that matters.

        It matters in the low harmonics, which T couples most, and wherever a mode resonates; elsewhere the
        coupled modes are diagonal to the accuracy that Newton needs.
        """
        problem, m = self.problem, self._m
        self._coupled_receptance = 1.0 / stiffness
        strong = problem.coupling[:m] > RESONANT * np.abs(stiffness)
        strong[: LOW_HARMONICS + 1] = True
        block = problem.dense_block(strong)
        self._dense = block.coefficients
        K = by_T.ravel()[block.products] * block.G
        values, c = stiffness.ravel()[block.cosines], np.arange(len(block.cosines))
        K[c, c] += values.real
        values, turning = values[m:], c[m:]  # harmonic 0 does not turn
        turned = turning - m + len(c)
        K[turned, turned] += values.real
        K[turning, turned] += values.imag
        K[turned, turning] -= values.imag
        self._lu, self._pivots, _ = lapack.dgetrf(K, overwrite_a=1)

    def _solve_coupled(self, forces: Array) -> Array:
        """Motion (2H+1, m, r) of the coupled modes under modal forces."""
        basis = self.problem.basis
        flat = forces.reshape(-1, forces.shape[2])
        if len(self._dense) == len(flat):
            motion = np.empty(forces.shape)
        else:
            motion = basis.real(basis.complex(forces) * self._coupled_receptance[:, :, None])
        motion.reshape(flat.shape)[self._dense] = lapack.dgetrs(self._lu, self._pivots, flat[self._dense])[0]
        return motion

    def _law_of_coupled(self, modes: Array) -> Array:
        """Change (2H+1, r) of the law's force coefficients with the coupled modes (2H+1, m, r)."""
        basis, m = self.problem.basis, self._m
        size, r = basis.size, modes.shape[2]
        seen = [self._p.reshape(size, size * m) @ modes.reshape(size * m, r)]
        if len(self._seen) > 1:
            reaction = np.matmul(self._rows[1:, :m], modes)  # (2H+1, 4, r)
            seen += [self.problem.reaction_of(reaction, self.state.Omega), reaction[:, 3]]
        return self._law_of_signals(seen)

    def _law_of_signals(self, seen: Sequence[Array]) -> Array:
        """Change of the law's force coefficients with those of u, rho, eta."""
        out = np.zeros_like(seen[0])
        for i, slope in zip(self._seen, self._law_slopes, strict=True):
            out += slope @ seen[i]
        return out

    # ---- other modes: their receptance is diagonal in modes and harmonics

    def _receptance_of(self, forces: Array) -> Array:
        """Motion (2H+1, n - m, r) of the other modes under modal forces."""
        basis = self.problem.basis
        return basis.real(basis.complex(forces) * self._receptance[:, :, None])

    def _law_of_field(self, others: Array) -> Array:
        """Change (2H+1, r) of the law's force coefficients with the other modes (2H+1, n - m, r)."""
        seen = np.matmul(self._rows[:, self._m :], others)
        rho = self.problem.reaction_of(seen[:, 1:4], self.state.Omega)
        return self._law_of_signals([seen[:, 0], rho, seen[:, 4]])

    def _law_of_others(self) -> Array:
        """Change (2H+1, 2H+1) of the law's force coefficients with those of T, through the other modes."""
        problem, basis = self.problem, self.problem.basis
        size, H = basis.size, basis.H
        rows = self._rows[:, self._m :] * problem.structure.slip_row[self._m :]
        transfer = self._receptance @ rows.T  # (H+1, 5)
        k_Omega = np.arange(H + 1) * self.state.Omega
        rho = -(k_Omega**2) * transfer[:, 1] + 1j * k_Omega * transfer[:, 2] + transfer[:, 3]
        out = np.zeros((size, size))
        of_signals = (transfer[:, 0], rho, transfer[:, 4])
        for i, slope in zip(self._seen, self._law_slopes, strict=True):
            t = of_signals[i]
            out += slope * np.concatenate([t.real, t.real[1:]])
            # a - i b is turned by t: the sine column feeds the cosine with +imag, the cosine the sine with -imag
            out[:, 1 : H + 1] -= slope[:, H + 1 :] * t.imag[1:]
            out[:, H + 1 :] += slope[:, 1 : H + 1] * t.imag[1:]
        return out

    # ---- derivative to the continuation parameter

    def _slope(self) -> tuple[Array, Array]:
        """Derivative of the unscaled balances to the unscaled continuation parameter."""
        problem, state, contact = self.problem, self.state, self.contact
        s, basis, Q, Omega = problem.structure, problem.basis, state.Q, state.Omega
        if problem.parameter == "frequency":
            modal = s.damping * basis.derivative(Q) - (2 * Omega * basis.k**2)[:, None] * Q
            d_rho = basis.derivative(Q @ s.reaction.damping) - 2 * Omega * basis.k**2 * (Q @ s.reaction.inertia)
            slope = -contact.by_Omega
        else:
            modal, d_rho, slope = np.zeros_like(Q), np.zeros(basis.size), np.zeros(basis.size)
            modal[basis.fundamental] = -s.excitation
            d_rho[basis.fundamental] = -s.reaction.force_share
            if contact.by_u is not None:
                slope = -s.residual.slip_by_force * contact.by_u[:, basis.fundamental]
        return modal, slope if contact.by_rho is None else slope - contact.by_rho @ d_rho

    # ---- the interface of continuation.Linearization

    def _bordered(self, row: Array, row_lam: float) -> tuple[Array, Array]:
        """Core matrix with the border row; and that row's part on the modes, (2H+1, n)."""
        problem, m = self.problem, self._m
        size, n = problem.basis.size, problem.structure.n
        modes = row[: size * n].reshape(size, n) / problem.q_ref
        matrix = np.empty((size + 1, size + 1))
        matrix[:size, :size] = self._core
        matrix[:size, size] = self._core_lam
        matrix[size, :size] = row[size * n :] / problem.F_ref
        matrix[size, size] = row_lam / problem.lam_ref
        if m:
            through = modes[:, :m].ravel() @ self._coupled_of.reshape(size * m, size + 1)
            matrix[size, :size] += through[:size]
            matrix[size, size] -= through[size]
        if n > m:
            basis = problem.basis
            adjoint = basis.real(basis.complex(modes[:, m:]) * self._receptance.conj())
            matrix[size, :size] += adjoint @ problem.structure.slip_row[m:]
            matrix[size, size] -= np.vdot(adjoint, self._modal_slope[:, m:])
        return matrix, modes

    def solve_bordered(self, row: Array, row_lam: float, rhs: Array, rhs_row: float) -> tuple[Array, float]:
        """Solve the bordered Newton system, see :class:`continuation.Linearization`."""
        x, lam = self.solve_columns(row, row_lam, rhs[:, None], rhs_row)
        return x[:, 0], float(lam[0])

    def solve_columns(self, row: Array, row_lam: float, rhs: Array, rhs_row: float) -> tuple[Array, Array]:
        """Solve the bordered Newton system for right sides (size, r) with the same last entry, (size, r) and (r,)."""
        problem, m, r = self.problem, self._m, rhs.shape[1]
        size, n = problem.basis.size, problem.structure.n
        matrix, modes = self._bordered(row, row_lam)
        modal = rhs[: size * n].reshape(size, n, r) * problem.modal_force_ref
        right = np.empty((size + 1, r))
        right[:size] = rhs[size * n :] * problem.F_ref
        right[size] = rhs_row
        d_Q = np.empty((size, n, r))
        if m:
            d_Q[:, :m] = self._solve_coupled(modal[:, :m])
            right[:size] += self._law_of_coupled(np.ascontiguousarray(d_Q[:, :m]))
        if n > m:
            d_Q[:, m:] = self._receptance_of(modal[:, m:])
            right[:size] += self._law_of_field(d_Q[:, m:])
        right[size] -= modes.ravel() @ d_Q.reshape(size * n, r)
        _, _, solution, info = lapack.dgesv(matrix, right)
        if info:
            solution = np.full((size + 1, r), np.nan)
        d_T, d_lam = solution[:size], solution[size]
        if m:
            d_Q[:, :m] += self._coupled_of @ np.vstack([d_T, -d_lam])
        if n > m:
            slopes = problem.structure.slip_row[m:, None] * d_T[:, None] - d_lam * self._modal_slope[:, m:, None]
            d_Q[:, m:] += self._receptance_of(slopes)
        return np.concatenate([d_Q.reshape(size * n, r) / problem.q_ref, d_T / problem.F_ref]), d_lam / problem.lam_ref

    def determinant_sign(self, row: Array, row_lam: float) -> int:
        """Sign of the determinant of the bordered matrix; uncoupled modes contribute positive blocks."""
        matrix, _ = self._bordered(row, row_lam)
        lu, pivots, _ = lapack.dgetrf(matrix)
        sign = _determinant_sign(lu, pivots)
        return sign * _determinant_sign(self._lu, self._pivots) if self._m else sign


def _determinant_sign(lu: Array, pivots: Array) -> int:
    """Sign of the determinant of a matrix from its LU factors."""
    negative = np.count_nonzero(lu.diagonal() < 0.0) + np.count_nonzero(pivots != np.arange(len(pivots)))
    return 0 if not lu.diagonal().all() else -1 if negative % 2 else 1
