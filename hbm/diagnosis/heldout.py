"""Which records are held out, where the caller does not say: whole ones, a level and a band that no fit has seen."""

from collections.abc import Collection

import numpy as np

from hbm.measurement.spectra import MeasuredSpectra
from models.parts import alike

LEVELS = 3
"""From so many levels up one of them is held out, the middle one."""

PER_LEVEL = 2
BAND = 6
"""One in so many frequencies is held out, adjacent ones, above the middle of the range."""

FEWEST = 4
"""Records below which nothing can be held out."""

MOST = 0.5
"""Of the level every second record is held out, where the whole of it and the band are more than this share."""


def choose_held_out(spectra: MeasuredSpectra, numbered: Collection[float] = ()) -> tuple[int, ...]:
    """Numbers of records to hold out; none where there are too few.

    Parameters
    ----------
    spectra : MeasuredSpectra
    numbered : collection of float
        Levels that have a number of their own, which no other level tells: of one every second record is held out.
    """
    if len(spectra) < FEWEST:
        return ()
    levels, frequencies = np.unique(spectra.level), np.unique(spectra.hz)
    level, band = np.zeros(len(spectra), dtype=bool), np.zeros(len(spectra), dtype=bool)
    if len(levels) >= LEVELS and len(spectra) >= PER_LEVEL * len(levels):
        middle = levels[len(levels) // 2]
        level = spectra.level == middle
        if any(alike(middle, own) for own in numbered):
            level[np.flatnonzero(level)[1::2]] = False
    if len(frequencies) >= FEWEST:
        width = max(1, len(frequencies) // BAND)
        first = min((3 * len(frequencies)) // 5, len(frequencies) - width - 1)
        inside = frequencies[first : first + width]
        band = (inside[0] <= spectra.hz) & (spectra.hz <= inside[-1])
    held = level | band
    if held.mean() > MOST:
        level[np.flatnonzero(level)[1::2]] = False
        held = level | band
    if held.all() or not held.any() or (~held).sum() < 2:
        return ()
    return tuple(int(n) for n in spectra.records[held])
