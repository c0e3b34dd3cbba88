"""Spikes: a few samples far beyond what else lies between the harmonics, as of a loose plug or a knock."""

from typing import NamedTuple

import numpy as np

from hbm.fourier import Array

FAR = 12.0
"""A spike is so many times what usually lies between the harmonics, by its median; noise does not get to 7."""

SELDOM = 0.25
"""Share of the periods that have one at most: impacts that belong to the motion come in most periods."""

FEWEST = 8
"""Periods of which that can be told."""

SEEN = 0.1
"""Smallest spike as a share of the largest motion."""


class Spike(NamedTuple):
    """The largest one: its time [s], and its size in standard deviations of what else is left."""

    time: float
    size: float


def spike(t: Array, values: Array, left: Array, periods: int) -> Spike | None:
    """The largest spike of a channel, None where there is none.

    Parameters
    ----------
    t, values : (N,) array
        The channel over so many periods.
    left : (N,) array
        What its harmonics leave of it.
    periods : int
    """
    size = np.abs(left - np.median(left))
    usual = 1.4826 * float(np.median(size))  # the standard deviation, of normal noise
    far = size > max(FAR * usual, SEEN * float(np.ptp(values)) / 2.0)
    hit = np.unique(np.floor((t[far] - t[0]) / (t[-1] - t[0]) * periods))
    if periods < FEWEST or not 0 < len(hit) <= SELDOM * periods:
        return None
    at = int(size.argmax())
    return Spike(float(t[at]), float(size[at]) / usual if usual > 0.0 else np.inf)
