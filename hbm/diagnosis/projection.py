"""Least squares by projection: what some columns explain of misfits, and what they leave."""

import numpy as np

from hbm.fourier import Array

RESOLVED = 1e-7
"""Combinations of columns that are seen by less than this, beside the one seen best, are not looked for."""


class Span:
    """The space that the columns (m, n) span.

    Parameters
    ----------
    columns : (m, n) array
        Each counts by its direction alone.

    Attributes
    ----------
    rank : int
        Combinations that are resolved.
    std : (n,) array
        Standard deviation of each amplitude, for rows in standard deviations; nan for a column of zeros.
    """

    def __init__(self, columns: Array) -> None:
        size = np.linalg.norm(columns, axis=0)
        scale = np.where(size > 0.0, size, 1.0)
        U, s, Vt = np.linalg.svd(columns / scale, full_matrices=False)
        self.rank = int(np.sum(s > RESOLVED * max(s.max(initial=0.0), 1e-300)))
        self.U, self.s = U[:, : self.rank], s[: self.rank]
        self.back = (Vt[: self.rank].T / self.s) / scale[:, None]
        self.std = np.where(size > 0.0, np.linalg.norm(self.back, axis=1), np.nan)

    def across(self, rows: Array) -> Array:
        """The part of rows (m, ...) that the columns do not span."""
        return np.asarray(rows - self.U @ (self.U.T @ rows))

    def amplitudes(self, rows: Array) -> Array:
        """Least amplitudes (n, ...) of the columns that bring rows (m, ...) nearest."""
        return np.asarray(self.back @ (self.U.T @ rows))

    def damped(self, rows: Array) -> Array:
        """The same for rows (m,), those seen little kept small: one that would be seen as all rows are costs 1."""
        cost = 1.0 / max(float(rows @ rows), 1.0)
        return np.asarray(self.back @ (self.s**2 / (self.s**2 + cost) * (self.U.T @ rows)))
