"""The Newton system of a balance reduced to the friction force, by eliminating the modes.

Mechanics outside the contact is linear, or nearly: the dense core is as large as the contact signal, and what couples
modes and harmonics beside it, foreshortening and nonlinear elements, matters in few of them.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.linalg import lapack

from hbm.aft.force import ContactForce
from hbm.balance.elements import ElementSlope
from hbm.balance.equations import Balance, Kinematics
from hbm.balance.factors import BorderedCore, determinant_sign, holds_parameter
from hbm.balance.jacobian import law_by_modes
from hbm.balance.scaled import State
from hbm.fourier import Array

LOW_HARMONICS = 5
RESONANT = 2e-3
"""What couples modes stays in the matrix up to this harmonic, and above this fraction of the dynamic stiffness."""


class Elimination(BorderedCore):
    """Linearised balance [K, -P; -E, S] of modes and contact, reduced to the contact.

    K is the structure with the friction force held (its foreshortening is a parametric stiffness, the slopes of
    elements all along it are another), P takes T to the modes, E takes the modes to T through the law. Elements at
    points come after it, see :class:`hbm.balance.slipping.PointForces`. The lowest `coupled` modes, all where an
    element all along it acts, are eliminated with a dense factorisation, the others harmonic by harmonic in closed
    form. What couples the others, weak beside their damping, is left out here, not in the residual: it costs Newton a
    little of its quadratic rate, never the answer.

    The border column is the derivative of the scaled balances to the scaled continuation parameter, which `column`
    works out, (size,), where it is needed.
    """

    def __init__(
        self,
        problem: Balance,
        state: State,
        kin: Kinematics,
        contact: ContactForce,
        by_T: Array | None,
        slope: ElementSlope | None,
        column: Callable[[], Array],
    ) -> None:
        self.problem, self.state, self.contact, self.slope = problem, state, contact, slope
        s, basis, m = problem.structure, problem.basis, problem.coupled if slope is None else problem.structure.n
        size = basis.size
        self._m = m
        if s.n > m:
            self._receptance = problem.dynamic_turn(state.Omega).back(m)
        slopes = [contact.by_u, contact.by_rho, contact.by_eta]
        self._seen = [i for i in range(3 if problem.varies else 1) if slopes[i] is not None]
        self._law_slopes = [b for i, b in enumerate(slopes) if b is not None and i in self._seen]
        self._core = np.eye(size)
        if s.n > m:
            self._core -= self._law_of_others()
        if problem.dynamic_lagrangian and contact.by_u is not None:
            self._core += problem.dynamic_lagrangian * contact.by_u
        if m:
            p = -kin.Gq[:, :m]
            p[0] += s.slip_row[:m]
            slip = basis.multiplication(p)  # (2H+1, 2H+1, m)
            self._law_by_coupled = law_by_modes(problem, state.Omega, contact, slope, slip)
            real, imaginary = problem.dynamic_stiffness(state.Omega)
            stiffness = real[:, :m] + 1j * imaginary[:, :m]
            self._coupled_receptance = 1.0 / stiffness
            self._dense, self._lu, self._pivots = factored(problem, stiffness, by_T, slope)
            # what maps the modes to the slip takes T to the modes
            self._coupled_of = self._solve_coupled(np.ascontiguousarray(slip.transpose(0, 2, 1)))
            self._core -= self._law_of_coupled(self._coupled_of)
        self._column = column
        self._by_column: tuple[Array, Array] | None = None  # worked out with the first right side

    def _reduced(self, forces: Array) -> tuple[Array, Array]:
        """Motion (2H+1, n, r) under scaled forces (size, r) with T held, and what they ask of T, (2H+1, r)."""
        problem, m, r = self.problem, self._m, forces.shape[1]
        size, n = problem.basis.size, problem.structure.n
        modal = forces[: size * n].reshape(size, n, r) * problem.modal_force_ref
        motion, core = np.empty((size, n, r)), forces[size * n :] * problem.F_ref
        if m:
            motion[:, :m] = self._solve_coupled(modal[:, :m])
            core += self._law_of_coupled(motion[:, :m])
        if n > m:
            motion[:, m:] = self._receptance.of(modal[:, m:])
            core += self._law_of_field(motion[:, m:])
        return motion, core

    # ---- coupled modes

    def _solve_coupled(self, forces: Array) -> Array:
        """Motion (2H+1, m, r) of the coupled modes under modal forces."""
        basis = self.problem.basis
        flat = forces.reshape(-1, forces.shape[2])
        if len(self._dense) == len(flat):
            motion = np.empty(forces.shape)
        else:
            motion = basis.real(basis.complex(forces) * self._coupled_receptance[:, :, None])
        motion.reshape(flat.shape)[self._dense] = lapack.dgetrs(self._lu, self._pivots, flat[self._dense], trans=1)[0]
        return motion

    def _law_of_coupled(self, modes: Array) -> Array:
        """Change (2H+1, r) of the law's force coefficients with the coupled modes (2H+1, m, r)."""
        return np.asarray(self._law_by_coupled @ modes.reshape(-1, modes.shape[2]))

    def _law_of_signals(self, seen: Sequence[Array]) -> Array:
        """Change of the law's force coefficients with those of u, rho, eta."""
        out = np.zeros_like(seen[0])
        for i, slope in zip(self._seen, self._law_slopes, strict=True):
            out += slope @ seen[i]
        return out

    # ---- other modes: their receptance is diagonal in modes and harmonics

    def _law_of_field(self, others: Array) -> Array:
        """Change (2H+1, r) of the law's force coefficients with the other modes (2H+1, n - m, r)."""
        problem, m = self.problem, self._m
        if not problem.varies:
            return self._law_of_signals([np.matmul(problem.structure.slip_row[m:], others)])
        seen = np.matmul(problem.rows.T[:, m:], others)
        return self._law_of_signals([seen[:, 0], problem.reaction_of(seen[:, 1:4], self.state.Omega), seen[:, 4]])

    def _law_of_others(self) -> Array:
        """Change (2H+1, 2H+1) of the law's force coefficients with those of T, through the other modes."""
        swapped = self.problem.basis.swapped
        signals = self._signals_of_others()
        out = np.zeros_like(self._core)
        for i, slope in zip(self._seen, self._law_slopes, strict=True):
            direct, crossed = signals[i]
            out += slope * direct
            out += slope[:, swapped] * crossed[swapped]
        return out

    def _signals_of_others(self) -> list[tuple[Array, Array]]:
        """How u, rho and eta follow T through the other modes, factors as of :class:`hbm.fourier.Turn`."""
        problem, m, moved = self.problem, self._m, self._receptance
        slip = problem.structure.slip_row[m:]
        if not problem.varies:
            return [(moved.direct @ slip**2, moved.crossed @ slip**2)]
        weights = problem.rows[m:] * slip[:, None]
        direct, crossed = moved.direct @ weights, moved.crossed @ weights
        rate, squared = self.state.Omega * problem.basis.signed_k, (self.state.Omega * problem.basis.k) ** 2
        rho = (
            direct[:, 3] - squared * direct[:, 1] - rate * crossed[:, 2],
            crossed[:, 3] - squared * crossed[:, 1] + rate * direct[:, 2],
        )
        return [(direct[:, 0], crossed[:, 0]), rho, (direct[:, 4], crossed[:, 4])]

    # ---- the interface of continuation.Linearization

    def _bordered(self, row: Array, row_lam: float) -> tuple[Array, Array]:
        """Core matrix with the border row; and that row's part on the modes, (2H+1, n)."""
        problem, m, (motion, core) = self.problem, self._m, self._border()
        size, n = problem.basis.size, problem.structure.n
        modes = row[: size * n].reshape(size, n) / problem.q_ref
        matrix = np.empty((size + 1, size + 1), order="F")
        matrix[:size, :size] = self._core
        matrix[:size, size] = core
        last = row[size * n :] / problem.F_ref
        if m:
            last += modes[:, :m].ravel() @ self._coupled_of.reshape(size * m, size)
        if n > m:
            last += self._receptance.adjoint_of(modes[:, m:]) @ problem.structure.slip_row[m:]
        matrix[size, :size] = last
        matrix[size, size] = row_lam - np.vdot(modes, motion)
        return matrix, modes

    def _border(self) -> tuple[Array, Array]:
        """What the border column reduces to."""
        if self._by_column is None:
            motion, core = self._reduced(self._column()[:, None])
            self._by_column = motion[:, :, 0], core[:, 0]
        return self._by_column

    def _reduced_beside(self, rhs: Array) -> tuple[Array, Array]:
        """What right sides (size, r) reduce to, with the border column where that is not known yet."""
        if self._by_column is not None:
            return self._reduced(rhs)
        motion, core = self._reduced(np.hstack([self._column()[:, None], rhs]))
        self._by_column = np.ascontiguousarray(motion[:, :, 0]), core[:, 0]
        return motion[:, :, 1:], core[:, 1:]

    def solve_columns(self, row: Array, row_lam: float, rhs: Array, rhs_row: float) -> tuple[Array, Array]:
        """Solve the bordered Newton system for right sides (size, r) with the same last entry, (size, r) and (r,)."""
        if holds_parameter(row, row_lam, rhs_row):
            d_Q, core = self._reduced(rhs)
            return self._moved(d_Q, self._alone.solve(core)), np.zeros(rhs.shape[1])
        size, r = self.problem.basis.size, rhs.shape[1]
        d_Q, core = self._reduced_beside(rhs)
        factored = self._factor_with(row, row_lam)
        right = np.empty((size + 1, r))
        right[:size] = core
        right[size] = rhs_row - factored.modes @ d_Q.reshape(-1, r)
        solution = factored.factors.solve(right)
        d_T, d_lam = solution[:size], solution[size]
        d_Q -= self._border()[0][:, :, None] * d_lam
        return self._moved(d_Q, d_T), d_lam

    def _moved(self, d_Q: Array, d_T: Array) -> Array:
        """Scaled unknowns (size, r) of the motion (2H+1, n, r) with T held, which T (2H+1, r) moves further."""
        problem, m, (size, n, r) = self.problem, self._m, d_Q.shape
        if m:
            d_Q[:, :m] += self._coupled_of @ d_T
        if n > m:
            d_Q[:, m:] += self._receptance.of(problem.structure.slip_row[m:, None] * d_T[:, None])
        return np.concatenate([d_Q.reshape(size * n, r) / problem.q_ref, d_T / problem.F_ref])

    def determinant_sign(self, row: Array, row_lam: float) -> int:
        """Sign of the determinant of the bordered matrix; uncoupled modes contribute positive blocks."""
        sign = self._factor_with(row, row_lam).factors.sign
        return sign * determinant_sign(self._lu, self._pivots) if self._m else sign


def factored(
    problem: Balance, stiffness: npt.NDArray[np.complex128], by_T: Array | None, slope: ElementSlope | None = None
) -> tuple[npt.NDArray[np.intp], Array, npt.NDArray[Any]]:
    """Those coefficients of the lowest m modes for which it matters what couples them, and its LU factors, transposed.

    It matters in the low harmonics, which T couples most, and wherever a mode resonates or an element is stiff;
    elsewhere the coupled modes are diagonal to the accuracy that Newton needs.

    Parameters
    ----------
    problem : Balance
    stiffness : (H+1, m) array of complex
        Dynamic stiffness of these modes.
    by_T : (2H+1, 2H+1) array or None
        Matrix that multiplies a series by T; None where the structure is not drawn in.
    slope : ElementSlope or None
        That of the elements, None where none acts.
    """
    m = stiffness.shape[1]
    coupling = problem.coupling[:m] * (by_T is not None) + (0.0 if slope is None else slope.strength())
    strong = coupling > RESONANT * np.abs(stiffness)
    strong[: LOW_HARMONICS + 1] = True
    block = problem.dense_block(strong)
    K = np.zeros(block.G.shape) if by_T is None else by_T.ravel()[block.products] * block.G
    if slope is not None:
        harmonic, mode = np.divmod(block.coefficients, m)
        K -= slope.by_Q[harmonic[:, None], mode[:, None], harmonic, mode]
    values, c = stiffness.ravel()[block.cosines], np.arange(len(block.cosines))
    K[c, c] += values.real
    values, turning = values[m:], c[m:]  # harmonic 0 does not turn
    turned = turning - m + len(c)
    K[turned, turned] += values.real
    K[turning, turned] += values.imag
    K[turned, turning] -= values.imag
    lu, pivots, _ = lapack.dgetrf(K.T, overwrite_a=1)  # transposed, as LAPACK stores it: no copy
    return block.coefficients, lu, pivots
