"""The clock of a recording: the even one that stamps of time are rounded from, and how far stamps lie beside it.

A clock of 1024 Hz printed to 1e-6 s has steps of 976 and 977 us. Nothing but the printing makes them differ: the line
through all stamps is known far better than any of them.
"""

import numpy as np

from hbm.fourier import Array

UNEVEN = 1e-3
"""Part of a step by which stamps of an even clock lie beside it at most."""

MOST_DIGITS = 13
"""More digits cannot be told from those of the arithmetic."""

COARSE = 0.2
"""Part of a step from which the last digit would hide a sample that is missing."""


def even_clock(t: Array) -> Array:
    """Times of the even clock that stamps are rounded from, or the stamps where there is none.

    Stamps may be half a unit of their last digit beside the clock, and the line that is fitted half of the coarsest.

    Parameters
    ----------
    t : (N,) array
        Stamps, N > 1, increasing [s].

    Returns
    -------
    (N,) array
        [s]

    Examples
    --------
    >>> rounded = np.round(np.arange(5000) / 1024, 6)
    >>> bool(np.abs(even_clock(rounded) - np.arange(5000) / 1024).max() < 1e-8)
    True
    """
    line, unit = _line(t), np.maximum(_last_digit(t), _single(t))
    rounded = unit.max() * (len(t) - 1) <= COARSE * (line[-1] - line[0]) and np.all(
        np.abs(t - line) <= 0.5 * (unit + unit.max())
    )
    return line if rounded else t


def unevenness(t: Array) -> float:
    """How far stamps (N,) lie beside an even clock at most, in steps, beyond what their size leaves of digits."""
    line = _line(t)
    beside = float(np.abs(t - line).max() - np.spacing(np.abs(t).max()))  # seconds since 1970 have 0.2 us in a double
    return max(beside, 0.0) / float(line[-1] - line[0]) * (len(t) - 1)


def _line(t: Array) -> Array:
    """Least-squares line through stamps."""
    n, mean = np.arange(len(t)) - 0.5 * (len(t) - 1), t.mean()
    return np.asarray(mean + n * (n @ (t - mean)) / (n @ n))


def _single(t: Array) -> Array:
    """Resolution (N,) of stamps that were kept in single precision, 0 of others."""
    single = t.astype(np.float32)
    return np.spacing(np.abs(single)).astype(float) if np.array_equal(single, t) else np.zeros(len(t))


def _last_digit(t: Array) -> Array:
    """Unit of the last digit of each stamp, (N,), by the fewest decimals or significant digits that all are told by.

    0 of more than `MOST_DIGITS`.
    """
    size = np.abs(t)
    decades = np.floor(np.log10(np.maximum(size, 1e-20 * size.max())))  # a stamp of 0 has none
    return np.maximum(_coarsest(t, decades), _coarsest(t, np.full(len(t), decades.max())))


def _coarsest(t: Array, decades: Array) -> Array:
    """Coarsest units, each as many digits below its decade, that all stamps are multiples of; 0 if there are none."""
    found = np.zeros(len(t))
    for digits in range(MOST_DIGITS, 0, -1):
        unit = 10.0 ** (decades + 1 - digits)
        multiples = t / unit
        if np.any(np.abs(multiples - np.round(multiples)) > 8.0 * np.finfo(float).eps * np.abs(multiples)):
            break
        found = unit
    return found
