"""Cycles of a steady displacement: how many a recording holds, and the acceleration by their harmonics.

A recording of 501 samples may hold 5 cycles of 100 and the first sample of a sixth. Lines of its whole length are then
none of the displacement's, and the acceleration by them is wrong most where the recording ends. So the length of a
cycle is fitted, with the harmonics.
"""

import numpy as np
from scipy.optimize import minimize_scalar

from hbm.fourier import Array
from hbm.measurement.waves import design

COUNTED = 5
"""Harmonics by which the length of a cycle is found."""

HARMONICS = 40
"""Harmonics that an acceleration has at most, as far as they are clear."""

UNSTEADY = 0.05
"""Part of the mean square beyond which a displacement that harmonics leave it has no cycle."""

CLEAR = 1e-3
"""Harmonics below this part of the largest are noise: they do not count in the acceleration."""

SURE = 5.0
"""Nor do those below so many standard deviations of the noise that all harmonics leave."""

REACH = 1.0
"""Cycles by which the number in a recording may differ from that of its largest line."""

STEP = 0.05
"""Steps of that number in which it is looked for."""


def span(time: Array) -> float:
    """Length of a recording with the step from its last sample to the next [s]."""
    return float(time[-1] - time[0]) * len(time) / (len(time) - 1)


def cycles_in(time: Array, displacement: Array) -> float:
    """How many cycles a recording holds; nan where its displacement has no steady cycle.

    Parameters
    ----------
    time, displacement : (n,) array
        [s], [m]
    """
    even = np.interp(np.linspace(time[0], time[-1], len(time)), time, displacement)
    largest = int(np.argmax(np.abs(np.fft.rfft(even - even.mean()))[1:])) + 1
    around = np.arange(max(largest - REACH, 0.4), largest + REACH, STEP)
    cycles = float(around[int(np.argmin([_left(c, time, displacement, 1) for c in around]))])
    for harmonics in (1, _resolved(len(time), cycles, COUNTED)):
        found = minimize_scalar(
            _left,
            bounds=(cycles - 3 * STEP, cycles + 3 * STEP),
            args=(time, displacement, harmonics),
            method="bounded",
            options={"xatol": 1e-6},
        )
        cycles = float(found.x)
    return cycles if found.fun < UNSTEADY else float("nan")


def acceleration(time: Array, displacement: Array, cycles: float) -> Array:
    """Acceleration by the harmonics of a displacement that are clear [m/s2].

    Parameters
    ----------
    time, displacement : (n,) array
        [s], [m]
    cycles : float
        How many the recording holds.
    """
    harmonics = _resolved(len(time), cycles, HARMONICS)
    basis = _basis(cycles, time, harmonics)
    series = np.linalg.lstsq(basis, displacement, rcond=None)[0]
    left = displacement - basis @ series
    noise = np.sqrt(left @ left / max(len(time) - len(series), 1) * 2.0 / len(time))
    size = np.hypot(series[1 : harmonics + 1], series[harmonics + 1 :])
    rate = 2.0 * np.pi * cycles / span(time) * np.arange(1, harmonics + 1)
    factors = np.where(size > max(CLEAR * size.max(), SURE * noise), -(rate**2), 0.0)
    return np.asarray(basis[:, 1:] @ (np.tile(factors, 2) * series[1:]))


def _resolved(samples: int, cycles: float, most: int) -> int:
    """Harmonics that samples tell apart, at least one."""
    return int(max(min(most, (samples / cycles - 1.0) // 2, (samples - 2) // 2), 1))


def _basis(cycles: float, time: Array, harmonics: int) -> Array:
    return design(time - time[0], cycles / span(time), harmonics)


def _left(cycles: float, time: Array, displacement: Array, harmonics: int) -> float:
    """Part of the mean square that harmonics of so many cycles leave."""
    basis = _basis(cycles, time, harmonics)
    left = displacement - basis @ np.linalg.lstsq(basis, displacement, rcond=None)[0]
    return float(left @ left / np.sum((displacement - displacement.mean()) ** 2))
