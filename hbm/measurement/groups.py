"""Records that belong together: those of one level, those of neighbouring frequencies."""

import numpy as np

from hbm.fourier import Array

ALIKE = 1.05
"""Forces less than this apart are of one level."""

GAP = 1.4
"""Neighbouring frequencies this far apart are in bands of their own."""


def levels(force: Array) -> Array:
    """The mean of forces that are alike, for each of them."""
    order = np.argsort(force)
    group = np.empty(len(force), dtype=int)
    group[order] = np.cumsum(np.append(0.0, force[order][1:] / force[order][:-1] > ALIKE))
    return np.asarray((np.bincount(group, force) / np.bincount(group))[group])


def frequency_bands(hz: Array) -> list[tuple[float, float]]:
    """Ends of groups of neighbouring frequencies."""
    f = np.unique(hz)
    starts = np.flatnonzero(np.append(True, f[1:] / f[:-1] > GAP))
    ends = np.append(starts[1:], len(f)) - 1
    return [(float(f[i]), float(f[j])) for i, j in zip(starts, ends, strict=True)]
