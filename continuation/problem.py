"""The interface of a system F(x, lam) = 0 to the tracer, and a dense one made from plain functions."""

from collections.abc import Callable
from typing import Protocol, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy.linalg.lapack import dgetrf, dgetrs

Array: TypeAlias = npt.NDArray[np.float64]


class Linearization(Protocol):
    """Residual and Jacobian at one (x, lam), ready for several bordered solves.

    A structured problem eliminates most of its unknowns inside. Where the bordered matrix is singular, either return
    numbers that are not finite or raise `numpy.linalg.LinAlgError`; the tracer answers both with another step.
    """

    @property
    def residual(self) -> Array:
        """Residual F(x, lam), (N,)."""
        ...

    def solve_bordered(self, row: Array, row_lam: float, rhs: Array, rhs_row: float) -> tuple[Array, float]:
        """Solution (dx, dlam) of [[J_x, J_lam], [row, row_lam]] [dx, dlam] = [rhs, rhs_row].

        Parameters
        ----------
        row, rhs : (N,) array
            Border row and right-hand side; neither is modified.
        row_lam, rhs_row : float
            Their entries belonging to lam and to the border.
        """
        ...

    def determinant_sign(self, row: Array, row_lam: float) -> int:
        """Sign (+1, -1, 0) of the determinant of that bordered matrix."""
        ...


class Problem(Protocol):
    """A system of N equations in N unknowns x and one parameter lam.

    Residuals may be merely piecewise smooth. Values that are not finite mark places where F is not defined.
    """

    def residual(self, x: Array, lam: float) -> Array:
        """Residual F(x, lam), (N,)."""
        ...

    def linearize(self, x: Array, lam: float) -> Linearization:
        """Residual and Jacobian at (x, lam)."""
        ...


class DenseProblem:
    """A problem from two plain functions, solved by dense LU factorization.

    Parameters
    ----------
    residual : callable
        `residual(x, lam) -> (N,) array`.
    jacobian : callable
        `jacobian(x, lam) -> (J_x, J_lam)`, (N, N) and (N,) arrays.

    Examples
    --------
    >>> line = DenseProblem(lambda x, lam: x - 2.0 * lam, lambda x, lam: (np.eye(1), np.array([-2.0])))
    >>> line.linearize(np.array([0.0]), 0.0).solve_bordered(np.array([0.0]), 1.0, np.array([0.0]), 1.0)
    (array([2.]), 1.0)
    """

    def __init__(
        self, residual: Callable[[Array, float], Array], jacobian: Callable[[Array, float], tuple[Array, Array]]
    ) -> None:
        self._residual = residual
        self._jacobian = jacobian

    def residual(self, x: Array, lam: float) -> Array:
        """Residual F(x, lam), (N,)."""
        return self._residual(x, lam)

    def linearize(self, x: Array, lam: float) -> "DenseLinearization":
        """Residual and Jacobian at (x, lam)."""
        return DenseLinearization(self._residual(x, lam), *self._jacobian(x, lam))


class DenseLinearization:
    """Residual and full Jacobian, factored together with the border row in use.

    Parameters
    ----------
    residual, J_lam : (N,) array
        Residual and its derivative with respect to lam.
    J_x : (N, N) array
        Derivative of the residual with respect to x.
    """

    def __init__(self, residual: Array, J_x: Array, J_lam: Array) -> None:
        self.residual = residual
        size = residual.size
        self._bordered = np.empty((size + 1, size + 1), order="F")
        self._bordered[:size, :size] = J_x
        self._bordered[:size, size] = J_lam
        self._row: Array | None = None

    def solve_bordered(self, row: Array, row_lam: float, rhs: Array, rhs_row: float) -> tuple[Array, float]:
        """Solution of the bordered system (see `Linearization`); nan where it is singular."""
        x, lam = self.solve_columns(row, row_lam, rhs[:, None], rhs_row)
        return x[:, 0], float(lam[0])

    def solve_columns(self, row: Array, row_lam: float, rhs: Array, rhs_row: float | Array) -> tuple[Array, Array]:
        """Solutions (N, r) and (r,) for right sides (N, r) with last entries (r,), or the same one for all."""
        self._factor(row, row_lam)
        if self._singular:
            return np.full_like(rhs, np.nan), np.full(rhs.shape[1], np.nan)
        solution, _ = dgetrs(self._lu, self._pivots, np.vstack([rhs, np.full(rhs.shape[1], rhs_row)]))
        return solution[:-1], solution[-1]

    def determinant_sign(self, row: Array, row_lam: float) -> int:
        """Sign of the determinant of the bordered matrix."""
        self._factor(row, row_lam)
        if self._singular:
            return 0
        swaps = np.count_nonzero(self._pivots != np.arange(self._pivots.size))
        negative = np.count_nonzero(self._lu.diagonal() < 0.0)
        return 1 - 2 * int((swaps + negative) % 2)

    def _factor(self, row: Array, row_lam: float) -> None:
        border = np.append(row, row_lam)
        if self._row is not None and np.array_equal(border, self._row):
            return
        self._row = border
        self._bordered[-1] = border
        self._lu, self._pivots, info = dgetrf(self._bordered)
        self._singular = info != 0
