"""Cycles of a free decay."""

from itertools import pairwise

import numpy as np

from hbm.fourier import Array


def cycles_of(time: Array, x: Array) -> Array:
    """Middle, frequency and fundamental amplitude of every cycle between upward zero crossings, (cycles, 3)."""
    i = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    at = time[i] - x[i] * (time[1] - time[0]) / (x[i + 1] - x[i])
    rows = []
    for a, b in pairwise(at):
        inside = (time >= a) & (time < b)
        fundamental = 2 * abs(np.mean(x[inside] * np.exp(-2j * np.pi * (time[inside] - a) / (b - a))))
        rows.append(((a + b) / 2, 1 / (b - a), fundamental))
    return np.array(rows)
