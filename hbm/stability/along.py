"""Stability along a curve: what its multipliers tell for certain, and where more points must be asked.

A multiplier is known to an error only, :attr:`Stability.error`. On which side of the unit circle it is is certain only
further from it than that. So a bubble, in which it crosses the circle and returns, is certain only if it is higher than
the error; :func:`hiding` says which steps are too long to rule such a bubble out, :func:`crossings` which crossings are
certain and which points belong to lower bubbles.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from hbm.fourier import Array
from hbm.stability.multipliers import ROUNDING, Stability

Flags = npt.NDArray[np.bool_]
Sides = npt.NDArray[np.intp]

FAR = 0.1
"""Logarithm of a magnitude that counts as far from the unit circle; beyond, it is not followed."""

STEEPER = 2.0
"""Between two points multipliers may change so many times faster than they do there and next to there."""

NARROW = 2e-3
"""A crossing is at one place if within this fraction of what is varied the multiplier is known for certain again."""

SUDDEN = 4.0
"""Within a NARROW step that is so many times steeper than those beside it multipliers jump, as where a sample starts to
slip: that says nothing of the motion on either side."""

FINE = 5e-4
"""Steps of this fraction of what is varied tell how high a bubble is that was no higher than the error where met."""

TOP = 5e-5
"""The same of the steps beside its highest point, where that is more than half of the error."""

CLOSE = 2.0
"""Beside a point whose multiplier is no further inside the unit circle than so many errors, steps are NARROW."""

GRAZING = 0.25
"""Beside a point whose multiplier is closer to the unit circle than this part of its error, steps are NARROW too."""

MEETING, NEAR = 3.0, 0.5
"""A pair may meet on the real axis within a step if its angles to it are no more than so many times what it turns by in
the step, and below this [rad]."""


def growth(stability: Stability, rank: int) -> float:
    """Logarithm of the magnitude of the multiplier of a rank, the largest first; at most FAR in magnitude."""
    return float(_growths([stability], rank + 1)[0, -1])


def hiding(found: Sequence[Stability], arclength: Array, values: Array) -> Flags:
    """Steps between neighbouring points that may hide a bubble higher than the error, (points - 1,).

    There a multiplier, as steep as next to there and STEEPER, could reach beyond the unit circle and return; or a pair
    may meet on the real axis; or one grazes the circle, or moves CLOSE to it, and the step is not NARROW; or is outside
    by less than its error and the step is not FINE, beside its highest point as short as TOP.

    Parameters
    ----------
    found : sequence of Stability
        Stability of the points, in the order of travel.
    arclength, values : (points,) array
        Arclength of the points, and the number that is varied along the curve.
    """
    count, error = np.array([s.unstable for s in found]), np.array([s.error for s in found])
    ranks = np.arange(-1, count.max() + 1)
    grown = _growths(found, ranks.size - 1)
    error = np.maximum(error[1:], error[:-1])[:, None]
    length = np.maximum(np.diff(arclength), np.finfo(float).tiny)[:, None]
    moves = np.abs(np.diff(grown, axis=0))
    slope = np.maximum(moves - 2.0 * error, 0.0) / length
    wide = (np.abs(np.diff(values)) / np.maximum(np.abs(values[1:]), np.finfo(float).tiny))[:, None]
    slope = np.where((wide <= NARROW) & (moves / length > SUDDEN * _next_to(moves / length)), 0.0, slope)
    steepest = np.maximum(slope, _next_to(slope))
    crossed = grown[1:] * grown[:-1] < 0.0
    ends = np.abs(grown[1:]), np.abs(grown[:-1])
    least = ends[0] + ends[1] + np.where(crossed, 4.0, 2.0) * error
    low, high = np.minimum(count[1:], count[:-1])[:, None], np.maximum(count[1:], count[:-1])[:, None]
    concerned = (ranks >= low - 1) & (ranks <= high)
    outside = np.maximum(grown[1:], grown[:-1]) > ROUNDING
    grazing = (wide > NARROW) & (np.minimum(*ends) < GRAZING * error)
    shallow = (wide > FINE) & outside & (np.minimum(*ends) < error)
    moved = moves > error
    shallow |= (wide > NARROW) & moved & (np.maximum(grown[1:], grown[:-1]) > -CLOSE * error)
    shallow |= (wide > TOP) & _beside_tops(grown, error)
    out = np.asarray(np.any(concerned & (grazing | shallow | (least < STEEPER * steepest * length)), axis=1))
    out |= _meeting(found, count)
    for rank in range(count.max()):
        side = sides(found, rank)
        for i, j in pairwise(np.flatnonzero(side).tolist()):
            if side[i] != side[j] and not at_one_place(found, values, rank, i, j):
                out[[i, j - 1]] |= wide[[i, j - 1], 0] > FINE
    return out


def _growths(found: Sequence[Stability], ranks: int) -> Array:
    """Growth of rank -1 and of so many more, (points, 1 + ranks)."""
    grown = np.full((len(found), 1 + ranks), -FAR)
    grown[:, 0] = FAR
    for row, stability in zip(grown, found, strict=True):
        largest = stability.growths[:ranks]
        row[1 : 1 + len(largest)] = largest
    return np.asarray(np.clip(grown, -FAR, FAR))


def _next_to(slope: Array) -> Array:
    """The steeper of the steps on either side of each, (steps, ranks)."""
    padded = np.pad(slope, ((1, 1), (0, 0)))
    return np.asarray(np.maximum(padded[:-2], padded[2:]))


def _beside_tops(grown: Array, error: Array) -> Flags:
    """Steps beside a highest point of a multiplier that is outside by half of its error to all of it."""
    padded = np.pad(grown, ((1, 1), (0, 0)), constant_values=-np.inf)
    top = (grown >= padded[:-2]) & (grown >= padded[2:])
    higher = np.maximum(grown[1:], grown[:-1])
    return np.asarray((top[1:] | top[:-1]) & (higher > 0.5 * error) & (higher < error))


def _meeting(found: Sequence[Stability], count: Sides) -> Flags:
    """Steps within which the first pair inside the unit circle may meet on the real axis, and one of it get out."""
    first = [s.multipliers[min(n, len(s.multipliers) - 1)] for s, n in zip(found, count, strict=True)]
    depth = np.array([s.error - growth(s, n) for s, n in zip(found, count, strict=True)])
    angle = np.abs(np.angle(first))
    off = np.minimum(angle, np.pi - angle)
    wider = np.maximum(off[1:], off[:-1])  # on the axis they part by about as much
    meeting = (off[1:] + off[:-1] < MEETING * np.abs(np.diff(angle))) & (wider < NEAR)
    return np.asarray(meeting & (np.minimum(depth[1:], depth[:-1]) < wider))


def sides(found: Sequence[Stability], rank: int) -> Sides:
    """Side of the unit circle on which the multiplier of a rank is, (points,).

    1 outside, -1 inside, 0 where it is closer than its error.
    """
    grown, error = _grown(found, rank)
    return np.where(np.abs(grown) > error, np.sign(grown), 0.0).astype(int)


def crossings(
    found: Sequence[Stability], values: Array, rank: int, *, slow: bool
) -> tuple[list[tuple[int, int]], Flags]:
    """Where the multiplier of a rank is on the other side for certain, and the points for which that is in doubt.

    In doubt are points of bubbles no higher than the error, and of crossings so slow that they have no one place.
    These are among the crossings only if `slow`.

    Parameters
    ----------
    found : sequence of Stability
        Stability of the points, in the order of travel.
    values : (points,) array
        Parameter of the curve.
    rank : int

    Returns
    -------
    list of (int, int)
        Points known for certain on either side of each crossing, none so between them.
    (points,) bool array
    """
    grown, _ = _grown(found, rank)
    outside, side = grown > ROUNDING, sides(found, rank)
    doubtful = np.zeros(len(found), dtype=bool)
    across: list[tuple[int, int]] = []
    known = np.flatnonzero(side)
    if not known.size:
        doubtful[:] = np.any(outside != outside[0])
        return across, doubtful
    first, last = known[[0, -1]]
    doubtful[:first] = outside[:first] != outside[first]
    doubtful[last:] = outside[last:] != outside[last]
    for i, j in pairwise(known.tolist()):
        between = slice(i + 1, j)
        if side[i] == side[j]:
            doubtful[between] = outside[between] != outside[i]
            continue
        narrow = at_one_place(found, values, rank, i, j)
        if narrow or slow:
            across.append((i, j))
        if not narrow:
            doubtful[between] = True
    return across, doubtful


def at_one_place(found: Sequence[Stability], values: Array, rank: int, i: int, j: int) -> bool:
    """Whether a crossing between two points known for certain is within NARROW."""
    low, high = bounds(found, values, rank, i, j)
    return bool(high - low <= NARROW * abs(values[i]))


def bounds(found: Sequence[Stability], values: Array, rank: int, i: int, j: int) -> tuple[float, float]:
    """What is varied, between which values a multiplier crosses between two points known for certain."""

    def edge(known: int, beside: int) -> float:
        """Where, from a point known for certain to the one beside it, the multiplier is as close as its error."""
        grown = growth(found[known], rank), growth(found[beside], rank)
        share = (abs(grown[0]) - found[known].error) / max(abs(grown[0] - grown[1]), ROUNDING)
        return float(values[known] + share * (values[beside] - values[known]))

    one, other = edge(i, i + 1), edge(j, j - 1)
    return min(one, other), max(one, other)


def _grown(found: Sequence[Stability], rank: int) -> tuple[Array, Array]:
    """Growth of a rank, and its error, (points,) each."""
    return _growths(found, rank + 1)[:, -1], np.array([s.error for s in found])
