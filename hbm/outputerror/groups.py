"""Records that belong together because their forces, or their frequencies, are near each other."""

from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from typing import TypeVar

Item = TypeVar("Item")


def near_each_other(items: Iterable[Item], value: Callable[[Item], float], factor: float) -> Iterator[list[Item]]:
    """Items in the order of a value, apart where it grows by more than a factor.

    >>> list(near_each_other([50.0, 3.0, 49.0, 160.0], float, 1.5))
    [[3.0], [49.0, 50.0], [160.0]]
    """
    ordered = sorted(items, key=value)
    cuts = [i for i, (a, b) in enumerate(pairwise(ordered), 1) if value(b) > factor * value(a)]
    for start, end in pairwise([0, *cuts, len(ordered)]):
        yield ordered[start:end]
