"""The stretch of a smooth curve between two of its points, solved anywhere between."""

from collections.abc import Callable
from dataclasses import replace

from .branch import ConvergenceError, Point, stretch_between
from .geometry import Frame, Metric, frame_along
from .newton import Border, Correction, correct, correct_sharply
from .problem import Problem
from .settings import Settings

CLOSE = 1e-9
"""Roots are found to this fraction of the stretch."""

_ITERATIONS = 100


class Segment:
    """Solutions between two neighbouring points.

    Parameters
    ----------
    problem : Problem
        The system.
    before, behind : Point
        Both ends, in the order of travel.
    settings : Settings
        How lengths and residuals are judged.
    sharply : bool
        Whether solutions are good to rounding, as a root needs them, or to the tolerance of the settings.
    """

    def __init__(
        self, problem: Problem, before: Point, behind: Point, settings: Settings, *, sharply: bool = True
    ) -> None:
        self.problem, self.settings, self.sharply = problem, settings, sharply
        self.metric = Metric.of(settings, before.x.size)
        self.before, self.behind = before, behind
        self.cubic = stretch_between(before, behind)
        self.ends, self.chord, self.length = self.cubic.ends, self.cubic.chord, self.cubic.length

    def solve(self, u: float) -> tuple[Correction, Frame]:
        """Solution in the hyperplane across the chord at a fraction u, with its tangent.

        Raises
        ------
        ConvergenceError
            If there is none close by.
        """
        guess, row = self.cubic.at(u), self.metric.weights * self.metric.unit(self.chord)
        solve = correct_sharply if self.sharply else correct
        correction = solve(self.problem, guess, Border(row[:-1], float(row[-1])), self.settings)
        close = self.metric.norm(correction.state - guess) < self.metric.norm(self.chord)
        exact = self.sharply or not correction.near(self.metric.norm, self.settings.tangent_slack * self.length)
        slope = correction.linearization if exact else correction.solved_with
        frame = frame_along(self.metric, correction.state, slope, row)
        if frame is None or not (close and correction.residual_norm <= self.settings.tolerance):
            raise ConvergenceError(
                f"refine: no solution close to lam = {guess[-1]:.10g}, last residual {correction.residual_norm:.2g}, "
                f"{correction.reason.value}; try smaller steps of the branch"
            )
        return correction, frame

    def point(self, u: float) -> Point:
        """Solution at a fraction u as a point of the branch."""
        correction, frame = self.solve(u)
        return Point(
            x=correction.x,
            lam=correction.lam,
            tangent_x=frame.tangent[:-1],
            tangent_lam=float(frame.tangent[-1]),
            arclength=self.arclength(u),
            step=0.0,
            iterations=correction.iterations,
            residual_norm=correction.residual_norm,
        )

    def parted(self, u: float) -> tuple[Point, Point]:
        """Solution at a fraction u, and the point behind; each with the flags of its part of a smooth stretch."""
        point, behind = self.point(u), self.behind
        folds = [a.tangent_lam * b.tangent_lam < 0.0 for a, b in ((self.before, point), (point, behind))]
        if folds[0]:
            point = replace(point, fold=True, fold_lam=behind.fold_lam, fold_x=behind.fold_x)
        return point, behind if folds[1] else replace(behind, fold=False, fold_lam=None, fold_x=None)

    def arclength(self, u: float) -> float:
        """Length of the branch up to a fraction u, about."""
        return self.before.arclength + u * self.length

    def root(self, test: Callable[[float], float], close: float = CLOSE) -> float:
        """Fraction at which a function of it, of opposite signs at 0 and 1, vanishes, to within `close`.

        Raises
        ------
        ValueError
            If it has the same sign at both ends.
        """
        return root_between(test, f"lam = {self.ends[0][-1]:.10g} and {self.ends[1][-1]:.10g}", close)


def root_between(test: Callable[[float], float], where: str, close: float = CLOSE) -> float:
    """Root of a function between 0 and 1 by secants that keep it bracketed (Illinois: Dowell & Jarratt 1971).

    Raises
    ------
    ValueError
        If it has the same sign at both ends; `where` is told.
    """
    a, b, f, g = 0.0, 1.0, test(0.0), test(1.0)
    if not f * g <= 0.0:
        raise ValueError(
            f"refine: the test function is {f:.3g} and {g:.3g} between {where}; it must change its sign in between"
        )
    u = a if f == 0.0 else b
    for _ in range(_ITERATIONS):
        if f == 0.0 or g == 0.0 or abs(b - a) <= close:
            break
        last, u = u, b - g * (b - a) / (g - f)
        value = test(u)
        if value == 0.0 or abs(u - last) <= close:
            break
        if value * g < 0.0:
            a, f = b, g
        else:
            f *= 0.5
        b, g = u, value
    return u
