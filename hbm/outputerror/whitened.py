"""Records in standard deviations: residuals and derivatives, what disturbs a whole record taken out."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from hbm.fourier import Array

TINY = 1e-12
"""Variance of a disturbance that is none."""


@dataclass(frozen=True, eq=False)
class Whitened:
    """Records in standard deviations, one after the other.

    Attributes
    ----------
    residual : (m,) array
        Measured less simulated.
    jacobian : (m, p) array
        Jacobian of the simulated amplitudes.
    raw : (m,) array
        Measured less simulated in units of the channel, less the likeliest transients where there are any.
    measured : (m,) array
        In units of the channel.
    record, channel, harmonic, part : (m,) int array
        Where each entry belongs: number of the record, place of the channel, harmonic, 0 of a cosine and 1 of a sine.
    spreads : dict of int to float
        Logarithm of the determinant of the covariance beside that of the noise of the responses alone, by record.
    shared : float
        Part that a background adds to it, which records share.
    free : float
        Part that transients add to it, free in each record: so much chi2 their freedom costs.
    lasting : (m,) array
        Those transients, in units of the channel.
    """

    residual: Array
    jacobian: Array
    raw: Array
    measured: Array
    record: npt.NDArray[np.int64]
    channel: npt.NDArray[np.int64]
    harmonic: npt.NDArray[np.int64]
    part: npt.NDArray[np.int64]
    spreads: Mapping[int, float]
    shared: float = 0.0
    free: float = 0.0
    lasting: Array | None = None

    @property
    def predicted(self) -> "Whitened":
        """The same as predicted: transients that are free in each record foretell nothing of another."""
        return self if self.lasting is None else replace(self, raw=self.raw + self.lasting, lasting=None)

    @property
    def charged(self) -> float:
        """Sum of squares and what transients cost: they explain whatever they are fitted to, records held out too."""
        return self.chi2 + self.free

    @property
    def spread(self) -> float:
        """Spread of all records together."""
        return float(sum(self.spreads.values())) + self.shared

    def deviance(self, record: int) -> float:
        """Twice the negative logarithm of a record's likelihood, but for a constant."""
        return float(np.sum(self.residual[self.record == record] ** 2)) + self.spreads[record]

    @property
    def chi2(self) -> float:
        """Sum of squares."""
        return float(self.residual @ self.residual)

    def __len__(self) -> int:
        """Number of coefficients."""
        return len(self.residual)


def log_determinant(columns: Array) -> float:
    """Logarithm of the determinant of 1 + A A'."""
    return float(np.linalg.slogdet(np.eye(columns.shape[1]) + columns.T @ columns)[1])


def uncorrelated_many(columns: Array, rows: Array) -> tuple[Array, float]:
    """As :func:`uncorrelated`, for hundreds of columns; and the logarithm of the determinant of 1 + A A'."""
    size, V = np.linalg.eigh(columns.T @ columns)
    size = np.maximum(size, 0.0)
    share = np.where(size > TINY, (1.0 - 1.0 / np.sqrt(1.0 + size)) / np.where(size > TINY, size, 1.0), 0.5)
    along = columns @ V
    return np.asarray(rows - along @ (share[:, None] * (along.T @ rows))), float(np.log1p(size).sum())


def uncorrelated(columns: Array, rows: Array) -> Array:
    """(1 + A A')^-1/2 B for a few columns A (m, k) and B (m, n)."""
    U, s, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(rows - U @ ((1.0 - 1.0 / np.sqrt(1.0 + s**2))[:, None] * (U.T @ rows)))
