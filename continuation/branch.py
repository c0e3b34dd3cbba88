"""The result of a trace: points in order, and a sentence that says why it ended."""

import math
from dataclasses import dataclass, replace
from enum import Enum
from itertools import pairwise

import numpy as np

from .geometry import Metric, Stretch
from .problem import Array
from .settings import Settings


class End(Enum):
    """Why a trace ended."""

    REACHED_END = "reached lam_end"
    LEFT_INTERVAL = "left the interval of lam"
    CLOSED = "closed, back at the start"
    MISSED_END = "closed, back at the start, where lam_end was to be reached"
    STEP_BELOW_MINIMUM = "step below the minimum"
    TOO_MANY_POINTS = "too many points"
    START_NOT_CONVERGED = "start did not converge"
    STOPPED_BY_CALLER = "stopped by the caller"


@dataclass(frozen=True, slots=True, eq=False)
class Point:
    """One solution on a branch; its flags speak of the stretch since the point before.

    Attributes
    ----------
    x : (N,) array
        Unknowns.
    lam : float
        Parameter.
    tangent_x : (N,) array
        Unit tangent in the direction of travel, part of x; unit in the metric of the settings.
    tangent_lam : float
        The part of lam.
    arclength : float
        Length of the branch up to here, in the same metric.
    step : float
        Arclength step that led here, 0 at the start.
    iterations : int
        Newton matrices that it took.
    residual_norm : float
        Max-norm of the residual.
    fold : bool
        The parameter turned back.
    corner : bool
        The tangent jumped.
    branch_point : bool
        Another branch was crossed (the orientation determinant changed sign).
    jumped : bool
        Smaller steps failed; the stretch since the point before was jumped over and is unknown.
    fold_lam, corner_lam : float, optional
        Where, if known: cubic Hermite estimate of the fold, meeting point of the two tangents at the corner.
    fold_x : (N,) array, optional
        Unknowns at the fold, by the same estimate; not of one at a corner.
    """

    x: Array
    lam: float
    tangent_x: Array
    tangent_lam: float
    arclength: float
    step: float
    iterations: int
    residual_norm: float
    fold: bool = False
    corner: bool = False
    branch_point: bool = False
    jumped: bool = False
    fold_lam: float | None = None
    corner_lam: float | None = None
    fold_x: Array | None = None

    def __repr__(self) -> str:
        """Parameter, in the problem's own units, and flags."""
        flags = [name for name in ("fold", "corner", "branch_point", "jumped") if getattr(self, name)]
        return ", ".join([f"point at lam = {self.lam:.10g}", f"{self.x.size} unknowns", *flags])

    @property
    def state(self) -> Array:
        """(x, lam), (N + 1,)."""
        return np.append(self.x, self.lam)

    @property
    def tangent(self) -> Array:
        """Unit tangent, (N + 1,)."""
        return np.append(self.tangent_x, self.tangent_lam)


@dataclass(frozen=True, slots=True, eq=False)
class Branch:
    """Points in order, why the trace ended, and the settings that produced it.

    Attributes
    ----------
    points : tuple of Point
        In the order of travel; kept also when the trace failed.
    end : End
        Why it ended.
    message : str
        One line with the numbers, and what to try next where it failed.
    settings : Settings
        Settings that produced it.
    """

    points: tuple[Point, ...]
    end: End
    message: str
    settings: Settings

    def __repr__(self) -> str:
        """How many points, from where to where, and why it ended."""
        if not self.points:
            return f"branch without points; {self.message}"
        first, last = self.points[0].lam, self.points[-1].lam
        return f"branch of {len(self.points)} points, lambda {first:.6g} to {last:.6g}; {self.message}"

    @property
    def complete(self) -> bool:
        """Whether `lam_end` was reached."""
        return self.end is End.REACHED_END

    @property
    def closed(self) -> bool:
        """Whether the last point is the first one again."""
        return self.end is End.CLOSED

    @property
    def lam(self) -> Array:
        """Parameters of all points, (n,)."""
        return np.array([point.lam for point in self.points])

    @property
    def x(self) -> Array:
        """Unknowns of all points, (n, N); (0, 0) without points."""
        return np.array([point.x for point in self.points]) if self.points else np.empty((0, 0))

    @property
    def folds(self) -> tuple[Point, ...]:
        """Points just behind a fold."""
        return tuple(point for point in self.points if point.fold)

    @property
    def corners(self) -> tuple[Point, ...]:
        """Points just behind a corner."""
        return tuple(point for point in self.points if point.corner)

    @property
    def branch_points(self) -> tuple[Point, ...]:
        """Points just behind a crossing with another branch."""
        return tuple(point for point in self.points if point.branch_point)

    @property
    def jumps(self) -> tuple[Point, ...]:
        """Points just behind a stretch that had to be jumped over."""
        return tuple(point for point in self.points if point.jumped)

    def dense(self, tolerance: float = 1e-3) -> "Branch":
        """The branch with so many points between its own that straight lines from one to the next draw it.

        Between two points it is the cubic that has their tangents (Hermite), over a corner or a jump a straight line.

        Parameters
        ----------
        tolerance : float
            Largest distance of the lines to the cubics, as a fraction of |x| in the metric of the settings.

        Returns
        -------
        Branch
            Added points are not solved: their residual is nan. They have no flags; those of its own points then speak
            of the stretch since the last one of these.
        """
        points = list(self.points[:1])
        for before, behind in pairwise(self.points):
            points += [*_between(before, behind, self.settings, tolerance), behind]
        return replace(self, points=tuple(points))

    def require_complete(self) -> "Branch":
        """Return the branch itself if it reached `lam_end`.

        Raises
        ------
        ConvergenceError
            Otherwise; it carries this partial branch.
        """
        if not self.complete:
            raise ConvergenceError(self.message, self)
        return self


def stretch_between(before: Point, behind: Point) -> Stretch:
    """The cubic between two neighbouring points."""
    length = behind.arclength - before.arclength
    return Stretch((before.state, behind.state), (before.tangent, behind.tangent), length)


def _between(before: Point, behind: Point, settings: Settings, tolerance: float) -> list[Point]:
    """Points on the cubic between two points; none over a corner or a jump."""
    if behind.corner or behind.jumped:
        return []
    cubic, metric = stretch_between(before, behind), Metric.of(settings, before.x.size)
    bulge = metric.norm(cubic.at(0.5) - 0.5 * (cubic.ends[0] + cubic.ends[1]))
    motion = max(metric.motion(cubic.at(0.5)), bulge, np.finfo(float).tiny)
    pieces = max(math.ceil(math.sqrt(bulge / (tolerance * motion))), 1)
    return [_on(cubic, u, before) for u in np.arange(1, pieces) / pieces]


def _on(cubic: Stretch, u: float, before: Point) -> Point:
    """Point of a cubic at a fraction u."""
    state, tangent = cubic.at(u), cubic.slope(u)
    return Point(
        x=state[:-1],
        lam=float(state[-1]),
        tangent_x=tangent[:-1],
        tangent_lam=float(tangent[-1]),
        arclength=before.arclength + u * cubic.length,
        step=0.0,
        iterations=0,
        residual_norm=math.nan,
    )


class ConvergenceError(RuntimeError):
    """A trace did not reach its end.

    Parameters
    ----------
    message : str
        One line: where, what was found, what to try.
    branch : Branch, optional
        Points found before, if any.
    """

    def __init__(self, message: str, branch: Branch | None = None) -> None:
        super().__init__(message)
        self.branch = branch
