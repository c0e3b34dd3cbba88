"""Kinks of friction that turn a curve back and on again, told from its folds.

Where samples one after the other start to slip, a curve may be scalloped: it turns back by less than it is exact, and
on again. Whether the steps of a curve meet such turns is chance; with more samples there are more of them, each less.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import TypeVar

import numpy as np

from hbm.fourier import Array

MOTION, VALUE = 0.05, 1e-4
"""Two folds one after the other are a kink if the unknowns, and the parameter of the curve, change by less than these
shares between them."""

Passed = TypeVar("Passed")


def kinks(
    passed: Sequence[Passed], place_of: Callable[[Passed], tuple[Array, float]], is_fold: Callable[[Passed], bool]
) -> list[tuple[Passed, Passed]]:
    """Pairs of folds that are a kink each, the narrowest first; what lies between two of a pair is none of the list.

    Parameters
    ----------
    passed : sequence
        What a curve passes, in the order of travel.
    place_of : callable
        Unknowns (N,) and parameter of the curve there; of a fold at the fold itself.
    is_fold : callable
        Whether it is a fold.
    """
    left, found = list(passed), list[tuple[Passed, Passed]]()

    def width(first: Passed, second: Passed) -> float:
        if not (is_fold(first) and is_fold(second)):
            return np.inf
        (x, value), (moved_x, other) = place_of(first), place_of(second)
        moved = float(np.linalg.norm(moved_x - x) / np.linalg.norm(x))
        return max(moved / MOTION, abs(other - value) / (VALUE * abs(value)) if value else np.inf)

    while pairs := [(width(*pair), i) for i, pair in enumerate(pairwise(left))]:
        least, i = min(pairs)
        if least >= 1.0:
            break
        found.append((left[i], left[i + 1]))
        del left[i : i + 2]
    return found
