"""Corners: places where the tangent of a piecewise smooth curve jumps.

Where a corner turns by more than 90 degrees, no hyperplane across the old tangent meets the curve behind it: the
corrector fails for every step that is long enough to pass, and halving only creeps up to the corner. `turn_corner`
looks at the tangent on the far side instead. Across one switching surface n the Jacobian changes by a multiple of n,
so det [J; n] is the same on both sides and the sign of det [J; tangent] is the same for every path that
crosses; that orients the far tangent without doubt, and the hyperplane across the sum of both tangents meets the
curve on the far side, whatever the angle.

A turn of the tangent is called a corner if it does not shrink with the distance over which it is measured: the two
tangents meet near the corner; two new points are solved for close to that meeting point, and so on until the stretch
is shorter by `_RESOLUTION`. If the tangents there still differ by half the first angle it is a corner. On a smooth
curve whose radius exceeds that stretch the angle shrinks in proportion and the search ends after one or two pairs.
"""

from dataclasses import dataclass

import numpy as np

from .geometry import Frame, Metric, frame_along, meeting
from .newton import Border, Correction, correct
from .problem import Array, Problem
from .settings import Settings

_RESOLUTION = 1e-3
_ZOOM = (0.15, 0.03, 0.02, 0.02, 0.05, 0.1, 0.2, 0.2, 0.2, 0.2)
_KEPT_ANGLE = 0.5
_BACKWARDS = -0.25
_DOUBLED_BACK = np.pi - 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Corner:
    """A confirmed corner between two frames.

    Attributes
    ----------
    lam : float
        Parameter at the corner.
    length : float
        Length of the path from the first frame over the corner to the second.
    before, behind : Frame
        Solutions next to it.
    """

    lam: float
    length: float
    before: Frame
    behind: Frame


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """A step around a corner: the solution on the far side and the corner between."""

    correction: Correction
    frame: Frame
    corner: Corner


def locate_corner(problem: Problem, metric: Metric, first: Frame, second: Frame, settings: Settings) -> Corner | None:
    """Corner between two oriented frames, or None if the curve between them is smooth.

    Parameters
    ----------
    problem, metric, settings
        The system, and how lengths and residuals are judged.
    first, second : Frame
        Before and behind the suspected corner, both in the direction of travel.
    """
    opening = metric.angle(first.tangent, second.tangent)
    if opening > _DOUBLED_BACK:
        return None  # two points of one line, oriented against each other
    length = 0.0
    for zoom in _ZOOM:
        a, b = meeting(metric, first, second)
        stretch = abs(a) + abs(b)
        if min(a, b) < _BACKWARDS * stretch or metric.angle(first.tangent, second.tangent) < _KEPT_ANGLE * opening:
            return None
        length = length or stretch
        if stretch < max(_RESOLUTION * length, 1e-9 * (1.0 + metric.norm(second.state))):
            lam = float(first.state[-1] + max(a, 0.0) * first.tangent[-1])
            return Corner(lam, length, first, second)
        closer = _close_in(problem, metric, (first, second), (a - zoom * stretch, b - zoom * stretch), settings)
        if closer is None:
            return None
        first, second = closer
    return None


def _close_in(
    problem: Problem, metric: Metric, pair: tuple[Frame, Frame], lengths: tuple[float, float], settings: Settings
) -> tuple[Frame, Frame] | None:
    """Pair of frames closer to the corner: forwards from the first, backwards from the second."""
    first, second = pair
    for origin, length, direction in zip(pair, lengths, (1.0, -1.0), strict=True):
        if length <= 0.0:
            continue  # already closer to the corner than the new point would be
        frame = _frame_near(problem, metric, origin, direction * length, settings)
        if frame is None:
            return None
        along_first, along_second = float(first.row @ frame.tangent), float(second.row @ frame.tangent)
        if abs(along_first) >= abs(along_second):
            first = frame if along_first > 0.0 else frame.reversed()
        else:
            second = frame if along_second > 0.0 else frame.reversed()
    return first, second


def _frame_near(problem: Problem, metric: Metric, origin: Frame, length: float, settings: Settings) -> Frame | None:
    """Frame of the solution at a distance along the tangent of another."""
    guess = origin.state + length * origin.tangent
    solution = correct(problem, guess, Border(origin.row[:-1], float(origin.row[-1])), settings)
    if not solution.converged:
        return None
    return frame_along(metric, solution.state, solution.linearization, origin.row)


@np.errstate(all="ignore")
def turn_corner(
    problem: Problem, metric: Metric, frame: Frame, step: float, settings: Settings, *, both_ways: bool = False
) -> Turn | None:
    """Step of a given length around a corner that lies within it, or None if there is none.

    Parameters
    ----------
    problem, metric, settings
        The system, and how lengths and residuals are judged.
    frame : Frame
        Before the corner, in the direction of travel.
    step : float
        Length of the path from `frame` over the corner to the new solution.
    both_ways : bool
        Also try the far tangent against the determinant's sign: a corner that is a branch point too,
        as where several surfaces are crossed at once.
    """
    guess = frame.state + step * frame.tangent
    linearization = problem.linearize(guess[:-1], float(guess[-1]))
    if not np.all(np.isfinite(linearization.residual)):
        return None
    far = frame_along(metric, guess, linearization, frame.row)
    if far is None:
        return None
    oriented = far.reversed() if far.sign * frame.sign < 0 else far
    for candidate in (oriented, oriented.reversed()) if both_ways else (oriented,):
        turn = _turn_towards(problem, metric, frame, candidate, settings)
        if turn is not None:
            return turn
    return None


def _turn_towards(problem: Problem, metric: Metric, frame: Frame, far: Frame, settings: Settings) -> Turn | None:
    """Solution in the hyperplane through far.state across both tangents, if a corner lies between."""
    if metric.angle(frame.tangent, far.tangent) < settings.corner_angle:
        return None
    both: Array = frame.row + far.row
    if metric.norm(both / metric.weights) < 1e-6:
        return None  # turned by 180 degrees: no hyperplane meets both
    correction = correct(problem, far.state, Border(both[:-1], float(both[-1])), settings)
    if not correction.converged:
        return None
    arrived = frame_along(metric, correction.state, correction.linearization, far.row)
    if arrived is None:
        return None
    corner = locate_corner(problem, metric, frame, arrived, settings)
    return None if corner is None else Turn(correction, arrived, corner)
