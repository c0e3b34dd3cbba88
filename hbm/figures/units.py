"""Units of axes: the prefix is chosen by the size of what is drawn."""

import re
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

SMALL_PREFIXES = {"": 0, "m": -3, "µ": -6, "n": -9, "p": -12}
LARGE_PREFIXES = {"M": 6, "k": 3}
"""Prefixes and their powers of ten."""

LEAST = 0.2
"""What is larger than so many of a small unit has that: 0.3 mm, not 300 µm."""

PREFIXED = ("m", "rad", "N", "J", "W")
"""Units that take prefixes; the first two no large ones."""


def prefixed(unit: str, *values: npt.ArrayLike) -> tuple[float, str]:
    """Factor of some values, and the unit that they then have: the largest of them is from 0.2 to 1000.

    Parameters
    ----------
    unit : str
        Unit of the values.
    *values : array-like
        All that is drawn on one axis; nan does not count.

    Returns
    -------
    (float, str)
        1 and the unit where the unit takes no prefix, or nothing but zeros is drawn.

    >>> prefixed("m", [3e-7, -2e-9]), prefixed("N", [2500.0]), prefixed("m/s²", [5000.0]), prefixed("V", [1e-6])
    ((1000000.0, 'µm'), (0.001, 'kN'), (1.0, 'm/s²'), (1.0, 'V'))
    """
    largest = max((float(np.max(np.abs(v), initial=0.0, where=np.isfinite(v))) for v in values), default=0.0)
    base = re.split(r"[\s/]", unit)[0]
    if base not in PREFIXED or largest == 0.0:
        return 1.0, unit
    fitting = {p: power for p, power in SMALL_PREFIXES.items() if largest >= LEAST * 10.0**power}
    if base not in PREFIXED[:2]:
        fitting = {p: power for p, power in LARGE_PREFIXES.items() if largest >= 10.0**power} | fitting
    prefix, power = next(iter(fitting.items()), ("p", SMALL_PREFIXES["p"]))
    return 10.0**-power, prefix + unit


def prefixed_together(units: Sequence[str], *values: npt.ArrayLike) -> tuple[float, str]:
    """One factor of values of several units on one axis, and what these units then are; as :func:`prefixed`.

    >>> prefixed_together(["m", "rad", "m"], [3e-7], [1e-8])
    (1000000.0, 'µm, µrad')
    """
    found = [prefixed(unit, *values) for unit in dict.fromkeys(units)]
    return found[0][0], ", ".join(name for _, name in found)
