"""The interface of a system with two parameters, F(x, lam, mu) = 0, and a dense one from plain functions."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .problem import Array, DenseLinearization, Linearization


class TwoParameterLinearization(Protocol):
    """Residual and Jacobian at one (x, lam, mu), ready for bordered solves with any column.

    A structured problem needs one elimination of its own for J_x, with one more column and one more row.
    """

    @property
    def residual(self) -> Array:
        """Residual F(x, lam, mu), (N,)."""
        ...

    @property
    def J_lam(self) -> Array:
        """Derivative of the residual with respect to lam, (N,)."""
        ...

    @property
    def J_mu(self) -> Array:
        """Derivative of the residual with respect to mu, (N,)."""
        ...

    def solve(self, column: Array, row: Array, corner: float, rhs: Array, rhs_row: Array) -> tuple[Array, Array]:
        """Solutions (dx, d) of [[J_x, column], [row, corner]] [dx, d] = [rhs, rhs_row].

        Not finite, or `numpy.linalg.LinAlgError`, where that matrix is singular.

        Parameters
        ----------
        column, row : (N,) array
            Borders.
        corner : float
            Entry between them.
        rhs, rhs_row : (N, r), (r,) array
            Right-hand sides.

        Returns
        -------
        (N, r), (r,) array
        """
        ...

    def determinant_sign(self, column: Array, row: Array, corner: float) -> int:
        """Sign (+1, -1, 0) of the determinant of that matrix."""
        ...


class TwoParameterProblem(Protocol):
    """A system of N equations in N unknowns x and two parameters lam and mu."""

    def residual(self, x: Array, lam: float, mu: float) -> Array:
        """Residual F(x, lam, mu), (N,)."""
        ...

    def linearize(self, x: Array, lam: float, mu: float) -> TwoParameterLinearization:
        """Residual and Jacobian at (x, lam, mu)."""
        ...


class DenseTwoParameterProblem:
    """A problem from two plain functions, solved by dense LU factorization.

    Parameters
    ----------
    residual : callable
        `residual(x, lam, mu) -> (N,) array`.
    jacobian : callable
        `jacobian(x, lam, mu) -> (J_x, J_lam, J_mu)`, (N, N), (N,) and (N,) arrays.
    """

    def __init__(
        self,
        residual: Callable[[Array, float, float], Array],
        jacobian: Callable[[Array, float, float], tuple[Array, Array, Array]],
    ) -> None:
        self._residual, self._jacobian = residual, jacobian

    def residual(self, x: Array, lam: float, mu: float) -> Array:
        """Residual F(x, lam, mu), (N,)."""
        return self._residual(x, lam, mu)

    def linearize(self, x: Array, lam: float, mu: float) -> "DenseTwoParameterLinearization":
        """Residual and Jacobian at (x, lam, mu)."""
        return DenseTwoParameterLinearization(self._residual(x, lam, mu), *self._jacobian(x, lam, mu))


@dataclass(slots=True, eq=False)
class DenseTwoParameterLinearization:
    """Residual and full Jacobian, factored together with the borders in use."""

    residual: Array
    J_x: Array
    J_lam: Array
    J_mu: Array
    _column: Array | None = None
    _bordered: DenseLinearization | None = None

    def solve(self, column: Array, row: Array, corner: float, rhs: Array, rhs_row: Array) -> tuple[Array, Array]:
        """Solutions of the bordered system (see `TwoParameterLinearization`); nan where it is singular."""
        return self._with(column).solve_columns(row, corner, rhs, rhs_row)

    def determinant_sign(self, column: Array, row: Array, corner: float) -> int:
        """Sign of the determinant of the bordered matrix."""
        return self._with(column).determinant_sign(row, corner)

    def _with(self, column: Array) -> DenseLinearization:
        if self._bordered is None or self._column is None or not np.array_equal(column, self._column):
            self._column, self._bordered = column, DenseLinearization(self.residual, self.J_x, column)
        return self._bordered


@dataclass(frozen=True, slots=True)
class AtMu:
    """A system of two parameters at a fixed mu, as a `Problem` in lam."""

    problem: TwoParameterProblem
    mu: float

    def residual(self, x: Array, lam: float) -> Array:
        """Residual F(x, lam, mu), (N,)."""
        return self.problem.residual(x, lam, self.mu)

    def linearize(self, x: Array, lam: float) -> Linearization:
        """Residual and Jacobian at (x, lam)."""
        return _AtMuLinearization(self.problem.linearize(x, lam, self.mu))


@dataclass(frozen=True, slots=True, eq=False)
class _AtMuLinearization:
    inner: TwoParameterLinearization

    @property
    def residual(self) -> Array:
        return self.inner.residual

    def solve_bordered(self, row: Array, row_lam: float, rhs: Array, rhs_row: float) -> tuple[Array, float]:
        x, lam = self.inner.solve(self.inner.J_lam, row, row_lam, rhs[:, None], np.array([rhs_row]))
        return x[:, 0], float(lam[0])

    def determinant_sign(self, row: Array, row_lam: float) -> int:
        return self.inner.determinant_sign(self.inner.J_lam, row, row_lam)
