"""Spikes: a few samples far beyond what else lies between the harmonics, as of a loose plug or a knock.

Of a motion from rest to rest they are far from what the samples beside them say, which no mode that rings is.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.ndimage import median_filter

from hbm.fourier import Array

FAR = 12.0
"""A spike is so many times what usually lies between the harmonics, by its median; noise does not get to 7."""

SELDOM = 0.25
"""Share of the periods that have one at most: impacts that belong to the motion come in most periods."""

FEWEST = 8
"""Periods of which that can be told."""

SEEN = 0.1
"""Smallest spike as a share of the largest motion."""


BESIDE, APART = 17, 3
"""Samples on either side of one that say what is usual, and how far from it they begin: a spike reaches no further."""

SLIGHT = 0.02
"""Smallest spike of a motion from rest to rest as a share of its largest: smaller ones are in no line."""


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


def spike_from_rest(t: Array, values: Array, force: npt.NDArray[np.bool_]) -> Spike | None:
    """The largest spike of a channel that moves from rest to rest, None where there is none.

    Parameters
    ----------
    t, values : (N,) array
    force : (N,) array of bool
        Where the force acts: what begins there is no spike.
    """
    off = np.zeros(len(values))  # from the cubic through four samples beside each
    off[2:-2] = values[2:-2] - (4.0 * (values[1:-3] + values[3:-1]) - values[:-4] - values[4:]) / 6.0
    size, shift, reach = np.abs(off), APART + BESIDE // 2, APART + BESIDE
    beside = 1.4826 * median_filter(size, BESIDE)  # the standard deviation, of normal noise
    usual = np.maximum(np.roll(beside, shift), np.roll(beside, -shift))
    silent = np.convolve(force, np.ones(2 * reach + 1), mode="same") < 0.5
    silent[:reach] = silent[-reach:] = False
    far = silent & (size > np.maximum(FAR * usual, SLIGHT * float(np.ptp(values)) / 2.0))
    if not far.any():
        return None
    at = int(np.where(far, size, 0.0).argmax())
    return Spike(float(t[at]), float(size[at] / usual[at]) if usual[at] > 0.0 else np.inf)
