"""The background: the small difference between any model and a structure, as part of the covariance.

No model of a structure leaves pure noise. What the best ones leave is physics, so that it is alike at neighbouring
frequencies and levels and moves the whole structure: a Gaussian process beside the noise (Kennedy and O'Hagan, J. R.
Statist. Soc. B 63 (2001), 425). Its prior is small and structured, or it would swallow the effects that are looked for
(Brynjarsdottir and O'Hagan, Inverse Problems 30 (2014), 114007): each coefficient errs by a share of its own size, a
share that changes slowly with frequency and level, in part alike in all channels.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from hbm.fourier import Array
from hbm.measurement.repeatability import typical_size
from hbm.outputerror.groups import near_each_other
from hbm.outputerror.records import Record

Reach = tuple[float, float]
"""Over which share of a band of frequencies, and change of the logarithm of the level, the correlation falls to 1/e."""

ALIKE_OVER: Reach = (3.0, 3.0)
"""As the backgrounds of structures were likeliest to."""

CHANGING: Reach = (0.1, 1.0)
"""Of a background that may be another at each level: what numbers must beat that are said to change between levels."""

BAND = 1.5
"""Frequencies belong to one band if none follows by more than this factor."""

NARROW = 1e-3
"""Least width of a band, of its frequency."""

ALIKE = 0.9
"""Share of the variance that all channels have in common."""

Complex = npt.NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Harmonic:
    """The background of one harmonic: coefficients in standard deviations, turned by their own phase, are correlated.

    Attributes
    ----------
    where : (2, n) int array
        Places of cosines and sines among all coefficients listed.
    turn : (n,) complex array
        Numbers of modulus 1, with the phase of what was measured.
    V : (n, n) array
    size : (n,) array
        Eigenvectors and eigenvalues of the covariance of a background of size 1, in noise variances.
    """

    where: npt.NDArray[np.int64]
    turn: Complex
    V: Array
    size: Array

    def apart(self, rows: Array) -> Complex:
        """Rows (m, ...) in independent combinations, (n, ...)."""
        turned = self.turn.conj().reshape(-1, *[1] * (rows.ndim - 1)) * (rows[self.where[0]] + 1j * rows[self.where[1]])
        return np.asarray(np.tensordot(self.V.T, turned, axes=1))

    def together(self, combined: Complex) -> Complex:
        """Back from :meth:`apart`, still complex."""
        return np.asarray(self.turn.reshape(-1, *[1] * (combined.ndim - 1)) * np.tensordot(self.V, combined, axes=1))


@dataclass(frozen=True, eq=False)
class Basis:
    """Independent combinations of the coefficients of some records, by harmonic."""

    harmonics: Mapping[int, Harmonic]
    points: int

    def whiten(self, sizes: Mapping[int, float], rows: Array) -> Array:
        """Rows (m, ...) in standard deviations of the noise, in those of noise and background."""
        out = rows.copy()
        for k, h in self.harmonics.items():
            root = 1.0 / np.sqrt(1.0 + sizes.get(k, 0.0) ** 2 * h.size)
            there = h.together(root.reshape(-1, *[1] * (rows.ndim - 1)) * h.apart(rows))
            out[h.where[0]], out[h.where[1]] = there.real, there.imag
        return out

    def spread(self, sizes: Mapping[int, float]) -> float:
        """Logarithm of the determinant of the covariance of noise and background, in noise variances."""
        return float(sum(2.0 * np.log1p(sizes.get(k, 0.0) ** 2 * h.size).sum() for k, h in self.harmonics.items()))


def basis_of(records: list[Record], stds: list[Array], reach: Reach = ALIKE_OVER) -> Basis:
    """Combinations of the coefficients listed of records, one record after the other.

    Parameters
    ----------
    records : list of Record
    stds : list of (c, H) array
        Standard deviations of their amplitudes.
    reach : (float, float)
        Of the correlation.
    """
    measured = np.stack([r.measured[0] + 1j * r.measured[1] for r in records])  # (r, c, H)
    pair = np.stack([r.listed.all(axis=0) for r in records])
    place = _places(records)
    std = np.stack(stds)
    correlation = _between(np.array([r.hz for r in records]), np.array([r.force for r in records]), reach)
    harmonics = {}
    for k in range(pair.shape[2]):
        i, c = np.nonzero(pair[:, :, k])
        if len(i) == 0:
            continue
        y = measured[:, :, k]
        scale = typical_size(np.where(pair[:, :, k], np.abs(y), np.nan))[i, c] / std[i, c, k]
        K = correlation[np.ix_(i, i)] * (ALIKE + (1.0 - ALIKE) * (c[:, None] == c))
        size, V = np.linalg.eigh(scale[:, None] * K * scale)
        turn = np.exp(1j * np.angle(y[i, c]))
        harmonics[k + 1] = Harmonic(place[:, i, c, k], turn, V, np.maximum(size, 0.0))
    return Basis(harmonics, int(sum(r.listed.sum() for r in records)))


def _places(records: list[Record]) -> npt.NDArray[np.int64]:
    """Place of each coefficient among those listed, (2, r, c, H)."""
    out, start = [], 0
    for r in records:
        place = np.full(r.listed.shape, -1)
        place[r.listed] = start + np.arange(int(r.listed.sum()))
        start += int(r.listed.sum())
        out.append(place)
    return np.stack(out, axis=1)


def _between(hz: Array, force: Array, reach: Reach) -> Array:
    """Correlation between records, (r, r)."""
    log_hz, log_force = np.log(hz), np.log(force)
    band, width = np.empty(len(hz), dtype=int), np.empty(len(hz))
    for b, own in enumerate(near_each_other(range(len(hz)), hz.__getitem__, BAND)):
        band[own], width[own] = b, max(float(np.ptp(log_hz[own])), NARROW)
    apart = np.abs(log_hz[:, None] - log_hz) / (reach[0] * width)
    levels = np.abs(log_force[:, None] - log_force) / reach[1]
    return np.where(band[:, None] == band, np.exp(-apart - levels), 0.0)


@dataclass(frozen=True, eq=False)
class Linear:
    """A model near where it is: residual (m,) and columns (m, n) of numbers and disturbances, in noise's deviations.

    `precision` (n,) is the inverse variance of each before anything is measured and `pull` (n,) how far from expected
    it is now, in its unit.
    """

    basis: Basis
    residual: Array
    columns: Array
    precision: Array
    pull: Array

    @cached_property
    def _apart(self) -> dict[int, Array]:
        """Residual and columns in independent combinations, by harmonic: real and imaginary part apart."""
        rows = np.column_stack([self.residual, self.columns])
        found = {k: h.apart(rows) for k, h in self.basis.harmonics.items()}
        return {k: np.concatenate([z.real, z.imag]) for k, z in found.items()}

    def deviance(self, sizes: Mapping[int, float]) -> float:
        """Twice the negative logarithm of the likelihood, numbers and disturbances integrated out."""
        n = 1 + self.columns.shape[1]
        parts = [self._part(k, sizes.get(k, 0.0)) for k in self._apart]
        gram, spread = sum((p for p, _ in parts), np.zeros((n, n))), sum(s for _, s in parts)
        A, b = gram[1:, 1:] + np.diag(self.precision), gram[1:, 0] - self.precision * self.pull
        chi2 = gram[0, 0] + float(self.precision @ self.pull**2) - float(b @ np.linalg.solve(A, b))
        return float(chi2 + spread + np.linalg.slogdet(A)[1])

    @cached_property
    def _known(self) -> dict[tuple[int, float], tuple[Array, float]]:
        return {}

    def _part(self, k: int, size: float) -> tuple[Array, float]:
        """What a harmonic adds to the squares of residual and columns, and to the logarithm of the determinant."""
        if (k, size) not in self._known:  # sizes are tried harmonic by harmonic, the others stay
            rows = self._apart[k]
            variance = 1.0 + size**2 * np.tile(self.basis.harmonics[k].size, 2)
            self._known[k, size] = (rows / variance[:, None]).T @ rows, float(np.log(variance).sum())
        return self._known[k, size]


SIZES = (0.0, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2)
"""Sizes of a background that are compared: standard deviation of each of cosine and sine, relative to the amplitude."""

LARGEST, OF_HARMONICS = 0.01, 0.05
"""No background is larger than this share of the fundamental, and of each other harmonic; more is something missing."""


def likeliest_sizes(model: Linear) -> dict[int, float]:
    """Size of the background by harmonic that makes what a model leaves likeliest, none larger than it may be."""
    found: dict[int, float] = {}
    for k in model.basis.harmonics:
        found[k] = min(_allowed(k), key=lambda s: model.deviance({**found, k: s}))
    return found


def expected_sizes(model: Linear) -> dict[int, float]:
    """Root mean square of the size by harmonic, each of :data:`SIZES` as likely before as any other.

    A background too small to be seen is likeliest to be none, but may be there.
    """
    likeliest = likeliest_sizes(model)
    return {k: _expected(_allowed(k), [model.deviance({**likeliest, k: s}) for s in _allowed(k)]) for k in likeliest}


def _expected(sizes: Sequence[float], deviances: Sequence[float]) -> float:
    return float(np.sqrt(weights(deviances) @ np.square(sizes)))


def weights(deviances: Sequence[float]) -> Array:
    """Probabilities of models by their deviance, or their BIC, alone."""
    d = np.asarray(deviances)
    w = np.exp(-0.5 * (d - d.min()))
    return np.asarray(w / w.sum())


def _allowed(k: int) -> list[float]:
    """Sizes that a background of a harmonic may have."""
    return [s for s in SIZES if s <= (LARGEST if k == 1 else OF_HARMONICS)]
