"""Special points of a branch, located between two of its points."""

from collections.abc import Callable
from enum import Enum
from functools import partial
from itertools import pairwise

import numpy as np

from .branch import Branch, ConvergenceError, Point
from .crossing import refine_branch_point
from .problem import Array, Problem
from .segment import CLOSE, Segment
from .settings import Settings
from .special import Kind, SpecialPoint, special


def refine_fold(problem: Problem, before: Point, behind: Point, settings: Settings) -> SpecialPoint:
    """Fold between two neighbouring points, where the tangent has no part along lam.

    Parameters
    ----------
    problem : Problem
        The system.
    before, behind : Point
        Neighbours on a branch.
    settings : Settings
        Those of the branch.

    Raises
    ------
    ValueError
        If lam does not turn in between.
    ConvergenceError
        If the curve cannot be solved in between.
    """
    segment = Segment(problem, before, behind, settings)
    ends = before.tangent_lam, behind.tangent_lam  # not solved again: rounding may change the sign of one at the fold
    u = segment.root(lambda u: ends[int(u)] if u in (0.0, 1.0) else float(segment.solve(u)[1].tangent[-1]))
    frame = segment.solve(u)[1]
    return special(Kind.FOLD, frame, float(frame.tangent[-1]), segment.arclength(u))


def refine(problem: Problem, branch: Branch) -> tuple[SpecialPoint, ...]:
    """Folds and branch points that a branch flags, to the accuracy of its residual, in the order of travel.

    Folds on corners are left out, `Point.corner_lam` is exact; so is what lies in a jump.

    Parameters
    ----------
    problem : Problem
        The system of the branch.
    branch : Branch
        Traced already, completely or not.

    Returns
    -------
    tuple of SpecialPoint
        Also those that could not be located; they say so.
    """
    found = []
    for before, behind in pairwise(branch.points):
        if behind.corner or behind.jumped:
            continue
        ends = problem, before, behind, branch.settings
        if behind.fold:
            found.append(located(Kind.FOLD, behind, partial(refine_fold, *ends)))
        if behind.branch_point:
            found.append(located(Kind.BRANCH_POINT, behind, partial(refine_branch_point, *ends)))
    return tuple(sorted(found, key=lambda point: point.arclength))


def locate(
    problem: Problem, branch: Branch, test: Callable[[Point], Array], kind: Enum, close: float = CLOSE
) -> tuple[SpecialPoint, ...]:
    """Points of a branch at which any entry of a test function changes its sign.

    Parameters
    ----------
    problem : Problem
        The system of the branch.
    branch : Branch
        Traced already.
    test : callable
        `test(point) -> (k,) array`, continuous along the branch; entries that are not finite count as no sign.
    kind : Enum
        Name for the points.
    close : float
        To which fraction of the stretch between two points.

    Returns
    -------
    tuple of SpecialPoint
        In the order of travel, also those that could not be located; they say so. `test` is the entry's value there.
    """
    values = [np.atleast_1d(test(point)) for point in branch.points]
    found = []
    for i, (before, behind) in enumerate(pairwise(branch.points)):
        segment = Segment(problem, before, behind, branch.settings, sharply=close <= CLOSE)
        for entry in np.flatnonzero((values[i] * values[i + 1] < 0.0) | (values[i + 1] == 0.0)):
            if not behind.jumped:
                found.append(
                    located(
                        kind, behind, partial(_root, segment, test, int(entry), kind, close, (values[i], values[i + 1]))
                    )
                )
    return tuple(sorted(found, key=lambda point: point.arclength))


def _root(
    segment: Segment,
    test: Callable[[Point], Array],
    entry: int,
    kind: Enum,
    close: float,
    ends: tuple[Array, Array],
) -> SpecialPoint:
    """Root of one entry of a test function with known values at both ends."""

    def value(u: float) -> float:
        if u in (0.0, 1.0):
            return float(ends[int(u)][entry])
        return float(np.atleast_1d(test(segment.point(u)))[entry])

    u = segment.root(value, close)
    return special(kind, segment.solve(u)[1], value(u), segment.arclength(u))


def located(kind: Enum, behind: Point, search: Callable[[], SpecialPoint]) -> SpecialPoint:
    """Result of a search, or the point behind where it fails."""
    try:
        return search()
    except (ConvergenceError, ValueError):
        return SpecialPoint(kind, behind.x, behind.lam, behind.tangent[None], np.nan, behind.arclength, located=False)
