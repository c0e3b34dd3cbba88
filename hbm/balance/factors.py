"""Factors of a dense core with a border row, kept for the chords and the sign that come with the same row."""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import lapack

from hbm.fourier import Array


class Factored(NamedTuple):
    """Factors of a core with a border row.

    Attributes
    ----------
    row, row_lam : (size,) array, float
        The border row.
    modes : array
        Its part on the modes, flat.
    lu, pivots : (c + 1, c + 1) array, (c + 1,) array of int
        As LAPACK has them.
    singular : bool
        Whether there is no solution.
    """

    row: Array
    row_lam: float
    modes: Array
    lu: Array
    pivots: npt.NDArray[Any]
    singular: bool

    @classmethod
    def of(cls, matrix: Array, row: Array, row_lam: float, modes: Array) -> "Factored":
        """Factor a matrix, which is overwritten where it is stored by columns."""
        lu, pivots, info = lapack.dgetrf(matrix, overwrite_a=1)
        return cls(row.copy(), row_lam, modes, lu, pivots, info != 0)

    def serves(self, row: Array, row_lam: float) -> bool:
        """Whether the border row is this one."""
        return self.row_lam == row_lam and bool((self.row == row).all())

    def solve(self, right: Array) -> Array:
        """Solutions (c + 1, r); nan where there is none."""
        return (
            np.full_like(right, np.nan) if self.singular else np.asarray(lapack.dgetrs(self.lu, self.pivots, right)[0])
        )

    @property
    def sign(self) -> int:
        """Sign of the determinant."""
        return determinant_sign(self.lu, self.pivots)


def determinant_sign(lu: Array, pivots: npt.NDArray[Any]) -> int:
    """Sign of the determinant of a matrix from its LU factors."""
    diagonal = lu.diagonal()
    if not diagonal.all():
        return 0
    swaps = np.count_nonzero(pivots != np.arange(len(pivots)))
    return -1 if (np.count_nonzero(diagonal < 0.0) + swaps) % 2 else 1
