"""From a branch point onto the curve that crosses there."""

import math

import numpy as np

from .branch import Branch, ConvergenceError
from .geometry import Metric
from .newton import Border, correct
from .problem import Array, Problem
from .settings import Settings
from .special import SpecialPoint
from .trace import continue_along

_WIDEST = 0.5


def switch_branch(problem: Problem, point: SpecialPoint, settings: Settings) -> tuple[Branch, Branch]:
    """Trace the other curve through a branch point, both ways.

    Parameters
    ----------
    problem : Problem
        The system.
    point : SpecialPoint
        A located branch point, see `refine`.
    settings : Settings
        Steps, tolerances, and bounds of lam. Each of the two traces goes away from the branch point, whichever way
        lam changes on it.

    Returns
    -------
    pair of Branch
        Along `point.null_space[1]` and against it. Their first points lie about `settings.step` from the branch point.

    Raises
    ------
    ValueError
        If the point has no second tangent.
    ConvergenceError
        If no point of the other curve is found.
    """
    if len(point.null_space) < 2:
        raise ValueError(f"switch_branch: {point.kind.value} at lam = {point.lam:g} has one tangent; needs two")
    one, other = (leave_along(problem, point, sense * point.null_space[1], settings) for sense in (1.0, -1.0))
    return one, other


def leave_along(problem: Problem, point: SpecialPoint, direction: Array, settings: Settings) -> Branch:
    """Trace the other curve through a branch point in one direction, such as `point.null_space[1]`.

    Raises
    ------
    ConvergenceError
        If no point of the other curve is found.
    """
    start = _first(problem, point, direction, settings)
    return continue_along(problem, start[:-1], float(start[-1]), direction, settings)


def _first(problem: Problem, point: SpecialPoint, direction: Array, settings: Settings) -> Array:
    """Solution across a direction, close enough to it to lie on the other curve; nearer and nearer by halves."""
    metric = Metric.of(settings, point.x.size)
    origin, row = np.append(point.x, point.lam), metric.weights * direction
    aside = _WIDEST * math.tan(min(_angle(metric, point.tangent, direction), math.pi / 4))
    size = settings.step
    while size >= settings.step_min:
        guess = origin + size * direction
        with np.errstate(all="ignore"):
            found = correct(problem, guess, Border(row[:-1], float(row[-1])), settings)
        if found.converged and metric.norm(found.state - guess) < aside * size:
            return found.state
        size *= 0.5
    raise ConvergenceError(
        f"switch_branch: no other curve found at lam = {point.lam:.10g}, tried distances from {settings.step:g} "
        f"down to {settings.step_min:g}; try another step"
    )


def _angle(metric: Metric, first: Array, second: Array) -> float:
    """Angle between two lines [rad], at most pi/2."""
    return math.acos(min(1.0, abs(metric.inner(first, second))))
