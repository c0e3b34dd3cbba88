"""Misfits that all channels share: an effect moves the whole structure, noise each channel by itself.

The largest eigenvalue of what they miss beside each other tells that from noise better than a sum of squares. Of 24
records, six channels and nine harmonics it finds 100 noise variances in one of these 19 times of 20, which the sums by
record, channel and harmonic do once in three.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import gammaincc

from hbm.fourier import Array
from hbm.outputerror.groups import near_each_other
from hbm.outputerror.whitened import Whitened

BAND = 1.5
"""Frequencies belong to one band, where a harmonic moves the structure alike, if none follows by more than this."""

ROWS, CHANNELS = 10, 2
"""Fewer coefficients of fewer channels say nothing."""

SHAPE, SCALE, SHIFT = 46.446, 0.186054, 9.84801
"""Gamma distribution like that of Tracy and Widom for real matrices: Chiani, J. Multivariate Anal. 129 (2014), 69."""


@dataclass(frozen=True)
class Alike:
    """The misfit that the channels share in a harmonic of a band about a frequency [Hz].

    `size` is the largest eigenvalue over what noise makes it on the average, of `points` coefficients.
    """

    harmonic: int
    hz: float
    size: float
    points: int
    probability: float


def alike(white: Whitened, hz: Mapping[int, float], variance: float = 1.0) -> Iterator[Alike]:
    """Find the misfit that the channels share, harmonic by harmonic and band by band.

    Parameters
    ----------
    white : Whitened
        Records in standard deviations.
    hz : mapping of int to float
        Frequencies of the records [Hz].
    variance : float
        Variance of the noise in these standard deviations.

    Yields
    ------
    Alike
        Where enough was measured.
    """
    for band in near_each_other(map(int, np.unique(white.record)), hz.__getitem__, BAND):
        about = float(np.mean([hz[n] for n in band]))
        for k in np.unique(white.harmonic):
            R = _rows(white, (white.harmonic == k) & np.isin(white.record, band))
            if R.shape[0] >= ROWS and R.shape[1] >= CHANNELS:
                largest = float(np.linalg.eigvalsh(R.T @ R)[-1]) / variance
                mean, probability = _of_noise(largest, *R.shape)
                yield Alike(int(k), about, largest / mean, R.size, probability)


def _rows(white: Whitened, here: npt.NDArray[np.bool_]) -> Array:
    """Cosines and sines (n, c) of the channels, where all of them were measured."""
    row, i = np.unique(2 * white.record[here] + white.part[here], return_inverse=True)
    channel, j = np.unique(white.channel[here], return_inverse=True)
    R = np.full((len(row), len(channel)), np.nan)
    R[i, j] = white.residual[here]
    return np.asarray(R[~np.isnan(R).any(axis=1)])


def _of_noise(largest: float, n: int, c: int) -> tuple[float, float]:
    """Mean of the largest eigenvalue of a matrix of noise (n, c), and the probability of so large a one.

    Johnstone, Ann. Statist. 29 (2001), 295.
    """
    root = np.sqrt(n - 1.0) + np.sqrt(c)
    spread = root * (1.0 / np.sqrt(n - 1.0) + 1.0 / np.sqrt(c)) ** (1.0 / 3.0)
    above = max((largest - root**2) / spread + SHIFT, 0.0)
    return float(root**2 + spread * (SHAPE * SCALE - SHIFT)), float(gammaincc(SHAPE, above / SCALE))
