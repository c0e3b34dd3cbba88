"""Factors of a dense core with a border row, kept for the chords and the sign that come with the same row."""

from abc import ABC, abstractmethod
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import lapack

from hbm.fourier import Array


class Factors(NamedTuple):
    """Factors of a matrix.

    Attributes
    ----------
    lu, pivots : (c, c) array, (c,) array of int
        As LAPACK has them.
    singular : bool
        Whether there is no solution.
    """

    lu: Array
    pivots: npt.NDArray[Any]
    singular: bool

    @classmethod
    def of(cls, matrix: Array) -> "Factors":
        """Factor a matrix, which is overwritten where it is stored by columns."""
        if not matrix.size:
            return cls(matrix, np.empty(0, dtype=int), singular=False)
        lu, pivots, info = lapack.dgetrf(matrix, overwrite_a=1)
        return cls(lu, pivots, info != 0)

    def solve(self, right: Array) -> Array:
        """Solutions (c, r); nan where there is none."""
        if self.singular:
            return np.full_like(right, np.nan)
        return np.asarray(lapack.dgetrs(self.lu, self.pivots, right)[0]) if self.lu.size else right

    @property
    def sign(self) -> int:
        """Sign of the determinant."""
        return determinant_sign(self.lu, self.pivots)


class Border(NamedTuple):
    """The row (size,) that closes a Newton system, and its entry for the parameter."""

    row: Array
    row_lam: float

    def is_again(self, row: Array, row_lam: float) -> bool:
        """Whether the border row is this one."""
        return self.row_lam == row_lam and bool((self.row == row).all())


class Bordered(NamedTuple):
    """Factors of a core with a border row.

    Attributes
    ----------
    border : Border
    modes : array
        Its part on the modes, flat.
    factors : Factors
        Of the core with this row, (c + 1, c + 1).
    """

    border: Border
    modes: Array
    factors: Factors


class BorderedCore(ABC):
    """What reduces a Newton system to a dense core with a border row, which it factors once for each row."""

    _core: Array
    _factored: Bordered | None = None

    @abstractmethod
    def solve_columns(self, row: Array, row_lam: float, rhs: Array, rhs_row: float) -> tuple[Array, Array]:
        """Solve the bordered Newton system for right sides (size, r) with the same last entry, (size, r) and (r,)."""

    def solve_bordered(self, row: Array, row_lam: float, rhs: Array, rhs_row: float) -> tuple[Array, float]:
        """Solve the bordered Newton system, see :class:`continuation.Linearization`."""
        x, lam = self.solve_columns(row, row_lam, rhs[:, None], rhs_row)
        return x[:, 0], float(lam[0])

    @cached_property
    def _alone(self) -> Factors:
        """Factors of the core without a border, which is not needed where the parameter is held."""
        return Factors.of(self._core.copy(order="F"))

    @abstractmethod
    def _bordered(self, row: Array, row_lam: float) -> tuple[Array, Array]:
        """Core matrix with the border row; and that row's part on the modes, (2H+1, n)."""

    def _factor_with(self, row: Array, row_lam: float) -> Bordered:
        """Factors of the core with a border row; those of the row before where it is that again."""
        known = self._factored
        if known is None or not known.border.is_again(row, row_lam):
            matrix, modes = self._bordered(row, row_lam)
            known = self._factored = Bordered(Border(row.copy(), row_lam), modes.ravel(), Factors.of(matrix))
        return known


def holds_parameter(row: Array, row_lam: float, rhs_row: float) -> bool:
    """Whether a border row keeps the parameter where it is, and does nothing else."""
    return bool(row_lam) and rhs_row == 0.0 and not row.any()


def determinant_sign(lu: Array, pivots: npt.NDArray[Any]) -> int:
    """Sign of the determinant of a matrix from its LU factors."""
    diagonal = lu.diagonal()
    if not diagonal.all():
        return 0
    swaps = np.count_nonzero(pivots != np.arange(len(pivots)))
    return -1 if (np.count_nonzero(diagonal < 0.0) + swaps) % 2 else 1
