"""Curves of folds in the plane of two parameters, and what happens on them."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from .branch import Branch, ConvergenceError, End, Point
from .foldsystem import FoldLinearization, FoldSystem, SecondDerivative
from .newton import solve_at
from .problem import Array
from .refine import located
from .segment import Segment, root_between
from .settings import Settings
from .special import Kind, SpecialPoint, special
from .trace import continue_branch
from .twoparameter import TwoParameterProblem


@dataclass(frozen=True, slots=True, eq=False)
class FoldCurve:
    """Folds in order along a curve in (x, lam, mu).

    Attributes
    ----------
    problem : TwoParameterProblem
        The system.
    branch : Branch
        The curve; its unknowns are (x, lam), (N + 1,), its parameter, called lam there, is mu.
    special : tuple of SpecialPoint
        Cusps, and turning points of mu: isola centres and crossings of two curves; x is (x, lam) there, and lam is mu.
    second : SecondDerivative, optional
        Second derivatives that were given.
    """

    problem: TwoParameterProblem
    branch: Branch
    special: tuple[SpecialPoint, ...]
    second: SecondDerivative | None = None

    @property
    def end(self) -> End:
        """Why the curve ended."""
        return self.branch.end

    @property
    def message(self) -> str:
        """One line about it."""
        words = self.branch.message.replace("continuation:", "fold curve:", 1)
        return words.replace("of lam", "of mu").replace(" lam = ", " mu = ")

    @property
    def x(self) -> Array:
        """Unknowns of all folds, (n, N)."""
        return self.branch.x[:, :-1]

    @property
    def lam(self) -> Array:
        """First parameter of all folds, (n,)."""
        return np.asarray(self.branch.x[:, -1])

    @property
    def mu(self) -> Array:
        """Second parameter of all folds, (n,)."""
        return self.branch.lam

    def at(self, mu: float) -> tuple[SpecialPoint, ...]:
        """Folds at a given mu, in the order of travel; as special points of the system at that mu.

        Raises
        ------
        ConvergenceError
            If one that lies on the curve cannot be solved.
        """
        nodes = sorted([*self.branch.points, *map(_as_point, self.special)], key=lambda point: point.arclength)
        between = [(a, b) for a, b in pairwise(nodes) if (a.lam - mu) * (b.lam - mu) < 0.0 or b.lam == mu]
        if len(nodes) > 1 and nodes[0].lam == mu:
            between = [(nodes[0], nodes[1]), *between]
        return tuple(self._between(a, b, mu) for a, b in between)

    def _between(self, before: Point, behind: Point, mu: float) -> SpecialPoint:
        settings = self.branch.settings
        system = FoldSystem(self.problem, np.append(before.x, before.lam), self.second)
        segment = Segment(system, before, behind, settings)
        u = root_between(lambda u: float(segment.cubic.at(u)[-1]) - mu, f"mu = {before.lam:.10g} and {behind.lam:.10g}")
        found = solve_at(system, segment.cubic.at(u)[:-1], mu, settings)
        if not found.converged:
            raise ConvergenceError(
                f"fold curve: no fold at mu = {mu:.10g} although there is one at {before.lam:.10g} and one at "
                f"{behind.lam:.10g}, last residual {found.residual_norm:.2g}, {found.reason.value}; try smaller steps"
            )
        here = system.linearize(found.x, mu)
        tangent = np.append(here.v, 0.0)
        weights = None if settings.weights is None else settings.weights[:-1]
        scale = np.linalg.norm(here.v) if weights is None else math.sqrt(float(weights @ here.v**2))
        return SpecialPoint(
            Kind.FOLD, found.x[:-1], float(found.x[-1]), tangent[None] / scale, here.g, segment.arclength(u)
        )


def fold_curve(
    problem: TwoParameterProblem,
    fold: SpecialPoint,
    mu: float,
    settings: Settings,
    *,
    second: SecondDerivative | None = None,
    on_point: Callable[[Point], bool | None] | None = None,
) -> FoldCurve:
    """Folds in the plane of two parameters, from one of them on.

    Parameters
    ----------
    problem : TwoParameterProblem
        The system F(x, lam, mu) = 0.
    fold : SpecialPoint
        A fold at `mu`, see `refine`.
    mu : float
        The second parameter there.
    settings : Settings
        Steps, tolerances and target, with mu as the parameter: `lam_end`, `lam_min`, `lam_max` and `lam_weight` are
        those of mu, `weights` those of (x, lam), (N + 1,). The trace sets out towards `lam_end`.
    second : SecondDerivative, optional
        Second derivatives of F. Without them secants of its first derivatives take their place.
    on_point : callable, optional
        Called with every point; a true result stops the trace there.

    Returns
    -------
    FoldCurve
        Points found, and why it ended.

    Raises
    ------
    ValueError
        If `mu` or the weights do not fit the settings.
    """
    start = np.append(fold.x, fold.lam)
    system = FoldSystem(problem, np.append(start, mu), second)
    watch = _Watch(system, settings)

    def follow(point: Point) -> bool | None:
        watch.follow(point)
        return None if on_point is None else on_point(point)

    branch = continue_branch(system, start, mu, settings, follow)
    return FoldCurve(problem, branch, tuple(watch.found), second)


class _Watch:
    """Looks between every two points of a fold curve for what is special, and keeps the system's borders near."""

    def __init__(self, system: FoldSystem, settings: Settings) -> None:
        self.system, self.settings = system, settings
        self.found: list[SpecialPoint] = []
        self.last: tuple[Point, FoldLinearization] | None = None

    def follow(self, point: Point) -> None:
        """Take a new point."""
        here = self.system.linearize(point.x, point.lam)
        if self.last is not None and not point.jumped:
            before, there = self.last
            found = []
            for test in (_level, _along):
                value = test(here, point.tangent)
                if test(there, before.tangent) * value < 0.0 or value == 0.0:
                    found.append(self._locate(before, point, test))
            self.found += sorted(found, key=lambda found: found.arclength)
        self.last = point, self.system.recentre(point.x, point.lam)

    def _locate(self, before: Point, behind: Point, test: Callable[[FoldLinearization, Array], float]) -> SpecialPoint:
        """Root of a test function between two points."""
        segment = Segment(self.system, before, behind, self.settings)

        def value(u: float) -> float:
            correction, frame = segment.solve(u)
            return test(self.system.linearize(correction.x, correction.lam), frame.tangent)

        def search() -> SpecialPoint:
            u = segment.root(value)
            return special(Kind.CUSP, segment.solve(u)[1], value(u), segment.arclength(u))

        found = located(Kind.CUSP, behind, search)
        return found if test is _along else replace(found, kind=self._kind(before, behind, found.x))

    def _kind(self, before: Point, behind: Point, centre: Array) -> Kind:
        """Kind of a turning point of mu: a closed curve is born where the folds on both sides open towards it."""
        here = [self.system.linearize(point.x, point.lam) for point in (before, behind)]
        aside = max(here, key=lambda fold: abs(fold.normal[0]))
        opens = aside.turn * aside.normal[0]  # towards larger lam if > 0
        return Kind.ISOLA_CENTRE if (aside.y[-2] - centre[-1]) * opens < 0.0 else Kind.CROSSING


def _level(fold: FoldLinearization, tangent: Array) -> float:
    """Zero where the fold curve runs along lam in the plane of the parameters: psi J_lam."""
    return float(fold.normal[0] / np.linalg.norm(fold.normal))


def _along(fold: FoldLinearization, tangent: Array) -> float:
    """Travel in the plane of the parameters, which stops and turns back at a cusp."""
    return float(fold.normal[1] * tangent[-2] - fold.normal[0] * tangent[-1]) / float(np.linalg.norm(fold.normal))


def _as_point(found: SpecialPoint) -> Point:
    return Point(
        x=found.x,
        lam=found.lam,
        tangent_x=found.tangent[:-1],
        tangent_lam=float(found.tangent[-1]),
        arclength=found.arclength,
        step=0.0,
        iterations=0,
        residual_norm=0.0,
    )
