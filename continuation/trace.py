"""Pseudo-arclength continuation as a generator of points.

References
----------
E. L. Allgower and K. Georg, Numerical Continuation Methods, Springer 1990: orientation by the determinant
(ch. 2), branch points (ch. 8), piecewise smooth curves (ch. 9 and 15).
"""

from collections.abc import Callable, Generator
from typing import NamedTuple

import numpy as np

from .branch import Branch, End, Point
from .geometry import Frame, Metric, Stretch, frame_along
from .loop import closing_step
from .newton import Border, Correction, correct, solve_at
from .problem import Array, Problem
from .settings import Settings
from .step import Step
from .stepper import Stepper


class Ending(NamedTuple):
    """Return value of `trace`: why it ended, and one line about it."""

    end: End
    message: str


def trace(problem: Problem, x0: Array, lam0: float, settings: Settings) -> Generator[Point, None, Ending]:
    """Points of the solution curve through (x0, lam0), one by one, towards `settings.lam_end`.

    Parameters
    ----------
    problem : Problem
        The system F(x, lam) = 0.
    x0 : (N,) array
        Guess of the solution at `lam0`; corrected there first.
    lam0 : float
        Start of the parameter.
    settings : Settings
        Target, steps, tolerances.

    Yields
    ------
    Point
        In the order of travel, each as soon as it is known.

    Returns
    -------
    Ending
        Why the trace ended (the value of `StopIteration`; `continue_branch` collects it).

    Raises
    ------
    ValueError
        At the first point, if `lam0` or the weights do not fit.
    """
    x0 = np.atleast_1d(np.asarray(x0, dtype=np.float64))
    metric = Metric.of(settings, x0.size)
    interval = settings.interval(lam0)
    start = solve_at(problem, x0, lam0, settings)
    frame = _start_frame(metric, start, settings) if start.converged else None
    return (yield from _walk(problem, metric, frame, start, settings, interval))


def trace_along(
    problem: Problem, x0: Array, lam0: float, direction: Array, settings: Settings
) -> Generator[Point, None, Ending]:
    """Points of the solution curve near (x0, lam0), one by one, in a given direction.

    It also starts where `trace` cannot, at a fold, and where it would not know which way: on a closed curve.

    Parameters
    ----------
    problem : Problem
        The system F(x, lam) = 0.
    x0, lam0 : (N,) array, float
        Guess of the first solution; corrected in the hyperplane across `direction`.
    direction : (N + 1,) array
        Where to go, (dx, dlam).
    settings : Settings
        Steps and tolerances. `lam_end` ends the trace where it is met, `lam_min` and `lam_max` where they are;
        without these two the interval is that from the start to `lam_end`.

    Yields
    ------
    Point
        In the order of travel.

    Returns
    -------
    Ending
        Why the trace ended.

    Raises
    ------
    ValueError
        At the first point, if the first solution lies outside the interval or the weights do not fit.
    """
    state = np.append(np.asarray(x0, dtype=np.float64), lam0)
    metric = Metric.of(settings, state.size - 1)
    row = metric.weights * metric.unit(np.asarray(direction, dtype=np.float64))
    start = correct(problem, state, Border(row[:-1], float(row[-1])), settings)
    frame = frame_along(metric, start.state, start.linearization, row) if start.converged else None
    interval = settings.interval(start.lam)
    return (yield from _walk(problem, metric, frame, start, settings, interval))


def _walk(
    problem: Problem,
    metric: Metric,
    first: Frame | None,
    start: Correction,
    settings: Settings,
    interval: tuple[float, float],
) -> Generator[Point, None, Ending]:
    """Points from a corrected start on."""
    if first is None:
        return Ending(End.START_NOT_CONVERGED, _start_message(start))
    point = _start_point(first, start)
    yield point
    stepper, number = Stepper(problem, metric, first, settings, interval), 1
    while number < settings.max_points:
        before, steps = stepper.frame, stepper.advance()
        if not steps:
            return Ending(End.STEP_BELOW_MINIMUM, _stuck_message(point, number, stepper.refusal, settings))
        for step in steps[: settings.max_points - number]:
            closing = closing_step(problem, metric, first, before, step, settings)
            point, number = _point(before, closing or step, point.arclength, settings), number + 1
            yield point
            if closing is not None:
                return Ending(End.CLOSED, _message(End.CLOSED, point.lam, number))
            before = step.frame
        if point.lam == settings.lam_end:
            return Ending(End.REACHED_END, _message(End.REACHED_END, point.lam, number))
        if point.lam in interval:
            return Ending(End.LEFT_INTERVAL, _message(End.LEFT_INTERVAL, point.lam, number))
    advice = f"; lam_end = {settings.lam_end:g}; try a larger max_points or step_max"
    return Ending(End.TOO_MANY_POINTS, _message(End.TOO_MANY_POINTS, point.lam, settings.max_points) + advice)


def continue_branch(
    problem: Problem,
    x0: Array,
    lam0: float,
    settings: Settings,
    on_point: Callable[[Point], bool | None] | None = None,
) -> Branch:
    """Trace a whole branch; what was found before a failure is kept.

    Parameters
    ----------
    problem, x0, lam0, settings
        As for `trace`.
    on_point : callable, optional
        Called with every point; a true result stops the trace there.

    Returns
    -------
    Branch
        Points, why it ended, and the settings; `require_complete` raises if `lam_end` was not reached.

    Raises
    ------
    ValueError
        If `lam0` or the weights do not fit the settings.
    """
    return _collected(trace(problem, x0, lam0, settings), settings, on_point)


def continue_along(
    problem: Problem,
    x0: Array,
    lam0: float,
    direction: Array,
    settings: Settings,
    on_point: Callable[[Point], bool | None] | None = None,
) -> Branch:
    """Trace a whole branch from a start in a given direction.

    Parameters
    ----------
    problem, x0, lam0, direction, settings
        As for `trace_along`.
    on_point : callable, optional
        Called with every point; a true result stops the trace there.

    Returns
    -------
    Branch
        It ends with `End.CLOSED` where it came back to its start.

    Raises
    ------
    ValueError
        As `trace_along`.
    """
    return _collected(trace_along(problem, x0, lam0, direction, settings), settings, on_point)


def _collected(
    steps: Generator[Point, None, Ending], settings: Settings, on_point: Callable[[Point], bool | None] | None
) -> Branch:
    points: list[Point] = []
    while True:
        try:
            point = next(steps)
        except StopIteration as stop:
            ending: Ending = stop.value
            return Branch(tuple(points), ending.end, ending.message, settings)
        points.append(point)
        if on_point is not None and on_point(point):
            message = _message(End.STOPPED_BY_CALLER, point.lam, len(points))
            return Branch(tuple(points), End.STOPPED_BY_CALLER, message, settings)


def _start_frame(metric: Metric, start: Correction, settings: Settings) -> Frame | None:
    """Tangent at the start with lam moving towards the target."""
    row = np.zeros(start.state.size)
    row[-1] = 1.0
    frame = frame_along(metric, start.state, start.linearization, row)
    if frame is None:
        return None
    return frame if settings.lam_end > start.lam else frame.reversed()


def _start_point(frame: Frame, start: Correction) -> Point:
    return Point(
        x=start.x,
        lam=start.lam,
        tangent_x=frame.tangent[:-1],
        tangent_lam=float(frame.tangent[-1]),
        arclength=0.0,
        step=0.0,
        iterations=start.iterations,
        residual_norm=start.residual_norm,
    )


def _point(before: Frame, step: Step, arclength: float, settings: Settings) -> Point:
    frame, corner = step.frame, step.corner
    fold = float(before.tangent[-1]) * float(frame.tangent[-1]) < 0.0
    turned_x, turned_at = None, None
    if fold and not step.jumped:
        turned_x, turned_at = _fold(before, frame, step.length) if corner is None else (None, corner.lam)
    return Point(
        x=frame.state[:-1],
        lam=float(frame.state[-1]),
        tangent_x=frame.tangent[:-1],
        tangent_lam=float(frame.tangent[-1]),
        arclength=arclength + step.length,
        step=step.size,
        iterations=step.iterations,
        residual_norm=step.residual_norm,
        fold=fold,
        corner=corner is not None or (step.jumped and step.angle > settings.corner_angle),
        branch_point=step.branch_point,
        jumped=step.jumped,
        fold_lam=turned_at,
        corner_lam=None if corner is None else corner.lam,
        fold_x=turned_x,
    )


def _fold(before: Frame, behind: Frame, length: float) -> tuple[Array, float]:
    """Unknowns and parameter where that turns between two frames, on the cubic."""
    cubic = Stretch.between(before, behind, length)
    state = cubic.at(cubic.fold)
    return state[:-1], float(state[-1])


def _message(end: End, lam: float, number: int) -> str:
    return f"continuation: {end.value} at lam = {lam:.10g} (point {number})"


def _start_message(start: Correction) -> str:
    reason = start.reason.value if not start.converged else "no unique tangent there"
    return (
        f"continuation: {End.START_NOT_CONVERGED.value} at lam = {start.lam:.10g} (point 1), {reason}, "
        f"last residual {start.residual_norm:.2g} after {start.iterations} iterations; "
        "try a better x0, another lam0 or a larger tolerance"
    )


def _stuck_message(point: Point, number: int, refusal: str, settings: Settings) -> str:
    return (
        f"continuation: stopped at lam = {point.lam:.10g} (point {number}), step below {settings.step_min:g}, "
        f"last {refusal}; tried smaller steps, a corner, fixed lam and longer steps; "
        "check that F is defined and continuous there, or try a larger tolerance or another step"
    )
