"""Waves of a period that are fitted to samples, and those beyond the harmonics that are asked for.

Harmonics beyond the highest that is asked for are there, whether anybody wants them or not. Where a period is no whole
number of samples they leak into the others, into those of each block of periods in another way: what is steady would
scatter. So those that stand out of the noise are found, and fitted together with the others over the whole record.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hbm.fourier import Array

CHANCE = 9.2
"""Noise comes as high as its mean times this and the logarithm of the number of lines once in 10 000 records."""

MOST_FITTED = 200
"""Harmonics from which on least squares would take too long and too much memory."""

AROUND = 4
"""Harmonics on either side between which the noise about one is that of the lines."""

CHUNK = 4096
"""Samples that are fitted at a time."""


class Overtones(NamedTuple):
    """Harmonics beyond those asked for.

    Attributes
    ----------
    numbers : (m,) int array
        Which.
    amplitude : (c, m) array
        Of each channel.
    values : (N, c) array
        What they are together.
    """

    numbers: npt.NDArray[np.int_]
    amplitude: Array
    values: Array


def design(t: Array, hz: float, H: int) -> Array:
    """Columns 1, cos k Omega t, sin k Omega t, (N, 2H+1)."""
    powers = np.empty((H, len(t)), dtype=complex)
    powers[0] = np.exp(2j * np.pi * hz * t)
    for k in range(1, H):
        powers[k] = powers[k - 1] * powers[0]
    return np.column_stack([np.ones(len(t)), powers.real.T, powers.imag.T])


def overtones(t: Array, Y: Array, hz: float, H: int, residual: Array, periods: int) -> Overtones:
    """Harmonics above H that stand out of what those up to H leave.

    Parameters
    ----------
    t : (N,) array
        Over whole periods [s].
    Y : (N, c) array
    hz : float
        Fundamental [Hz].
    H : int
    residual : (N, c) array
        What the harmonics up to H leave, at equally spaced times.
    periods : int
    """
    numbers = _standing_out(residual, H, periods)[: MOST_FITTED - min(H, MOST_FITTED)]
    if not len(numbers):
        return Overtones(numbers, np.empty((Y.shape[1], 0)), np.zeros_like(Y))
    size = 2 * H + 1 + 2 * len(numbers)
    whole, right = np.zeros((size, size)), np.zeros((size, Y.shape[1]))
    for part in _parts(len(t)):
        A = np.hstack([design(t[part], hz, H), _waves(t[part], hz, numbers)])
        whole, right = whole + A.T @ A, right + A.T @ Y[part]
    found = np.linalg.solve(whole, right)[2 * H + 1 :]
    values = np.concatenate([_waves(t[part], hz, numbers) @ found for part in _parts(len(t))])
    return Overtones(numbers, np.hypot(*np.split(found, 2)).T, values)


def _standing_out(residual: Array, H: int, periods: int) -> npt.NDArray[np.int_]:
    """Numbers of harmonics above H that stand out in a channel, by lines of whole periods, ascending."""
    power = np.abs(np.fft.rfft(residual, axis=0)) ** 2
    numbers = np.arange(H + 1, (len(residual) - 1) // 2 // periods + 1)
    out = power[numbers * periods] > _floor(power, numbers, periods) * (np.log(len(power)) + CHANCE)
    return np.asarray(numbers[out.any(axis=1)])


def _floor(power: Array, numbers: npt.NDArray[np.int_], periods: int) -> Array:
    """Mean power (m, c) of the noise around harmonics, by the median of the lines between those around each."""
    floor = np.empty((len(numbers), power.shape[1]))
    inside = (numbers >= AROUND) & ((numbers + AROUND) * periods <= len(power))
    whole = power[: len(power) // periods * periods].reshape(-1, periods, power.shape[1])[:, 1:]
    each = max(CHUNK // periods, 1)
    at = np.flatnonzero(inside)
    for some in (at[first : first + each] for first in range(0, len(at), each)):
        around = whole[numbers[some, None] + np.arange(-AROUND, AROUND)]  # (some, 2 AROUND, periods - 1, c)
        floor[some] = np.median(around.reshape(len(some), -1, power.shape[1]), axis=1)
    between = np.arange(len(power)) % periods != 0
    for i in np.flatnonzero(~inside).tolist():
        near = slice(max((numbers[i] - AROUND) * periods, 0), (numbers[i] + AROUND) * periods)
        floor[i] = np.median(power[near][between[near]], axis=0)
    return np.asarray(floor / np.log(2.0))


def _parts(samples: int) -> Iterator[slice]:
    return (slice(first, first + CHUNK) for first in range(0, samples, CHUNK))


def _waves(t: Array, hz: float, numbers: npt.NDArray[np.int_]) -> Array:
    """Columns of cosines and sines of harmonics, (N, 2m)."""
    turning = np.exp(2j * np.pi * hz * np.outer(t, numbers))
    return np.hstack([turning.real, turning.imag])
