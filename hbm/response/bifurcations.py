"""Stability of a solution, and along a curve with its bifurcations.

:func:`stability_of` judges a solution, :func:`with_stability` returns a curve that knows its stability.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import lru_cache
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from continuation import Branch, ConvergenceError, Kind, Point, Problem, SpecialPoint, locate, refine
from continuation.segment import Segment
from hbm.balance.balanced import balanced
from hbm.balance.problem import AnyBalance, State, balance_of
from hbm.balance.solution import PeriodicSolution
from hbm.errors import InputError
from hbm.fourier import Array, FourierBasis
from hbm.parallel import one_thread
from hbm.response.accuracy import finer
from hbm.response.bifurcation import Bifurcation
from hbm.response.curve import ResponseCurve
from hbm.response.kinks import kinks
from hbm.response.trace import solve_near
from hbm.stability.along import bounds, crossings, growth, hiding, sides
from hbm.stability.jointed import by_monodromy, momentary
from hbm.stability.multipliers import ROUNDING, Stability
from models.jointed import AnyRig
from models.scalars import HZ

Curve = TypeVar("Curve", bound=ResponseCurve)
Judge = Callable[[Any, State], Stability]
"""Of a state of a balance; some judge those of one contact only."""
Judged = Callable[[Point | SpecialPoint], Stability]

SAMPLES = 1024
"""Friction that remembers, and joints, are judged on at least so many samples per period of the same motion: on few,
multipliers jump wherever a sample starts to slip or to touch."""

CLOSE = 1e-3
"""A crossing of the unit circle is found to this fraction of the way between two points."""

MOST = 60
"""Up to so many bifurcations of a curve are located; more are a sign of too few samples or harmonics."""

HALVED = 7
"""A step of the curve is halved so many times at most to see whether multipliers cross and return within it."""

ROOM = 400
"""So many points are added in halves at most, or as many as the curve has where that is more."""

CLEAR = 0.02
"""A stretch of a curve is judged once more where its multipliers come no further from the unit circle than this."""

REAL = 1e-6
"""A multiplier with an imaginary part below this is real."""


def stability_of(rig: AnyRig, solution: PeriodicSolution, judge: Judge = by_monodromy) -> Stability:
    """Stability of one periodic solution.

    Parameters
    ----------
    rig : Rig
    solution : PeriodicSolution
        A solution of this rig.
    judge : callable
        As for :func:`with_stability`.

    Raises
    ------
    ValueError
        If the solution is not one of this rig, or where the judge cannot tell.
    """
    problem = balance_of(rig, solution.basis, level=solution.level, periods=solution.periods)
    balanced(problem, solution, "stability_of")
    return judge(_finely(problem), solution.state)


def _finely(problem: AnyBalance) -> AnyBalance:
    """The balance on the samples on which it is judged: more where friction remembers, or a stop may be met."""
    samples = SAMPLES * problem.periods
    few = (problem.remembers or momentary(problem)) and problem.basis.N_t < samples
    return problem.on(FourierBasis(problem.basis.H, samples)) if few else problem


@one_thread
def with_stability(curve: Curve, judge: Judge = by_monodromy) -> Curve:
    """The curve with the stability of its points, and its bifurcations located by the solver.

    Folds and branch points are those of the equations. Between two points where a multiplier leaves or enters the unit
    circle elsewhere the curve is solved again until it lies on it: at -1 the period doubles, a pair is a Neimark-Sacker
    bifurcation, beyond which the motion has a second frequency. Where a curve has too many of them to be resolved, the
    points behind them stand for them, `special.located` says so.

    So that the list does not depend on the steps, they are halved where multipliers could cross and return within one;
    a stretch so found gets a point. Stretches that are unstable by less than the error of their multipliers are
    doubtful. Clearer ones that stay close to the unit circle are judged once more, at the point furthest from it, with
    twice the harmonics and samples: where that differs they are doubtful too. Crossings at the ends of what is doubtful
    are left out. Along the force, or another number, a multiplier may take long from one side of its error to the
    other: what is between is doubtful, and the crossing is told with its bounds.

    Parameters
    ----------
    curve : ResponseCurve
    judge : callable
        Stability of a solution of the balance, :func:`hbm.stability.jointed.by_monodromy` or
        :func:`hbm.stability.hill.hill`.

    Returns
    -------
    ResponseCurve
        A curve of the same kind.

    Raises
    ------
    ValueError
        Where the judge cannot tell.
    """
    if not isinstance(curve, ResponseCurve):
        accepted = "must be a curve, such as trace_frequency returns; stability_of judges one point"
        raise InputError(f"with_stability: curve is a {type(curve).__name__}; {accepted}")
    finely = lru_cache(maxsize=1)(_finely)  # of the balance of the curve, or along a parameter of that of each point

    known: dict[tuple[float, bytes], Stability] = {}

    def judged(point: Point | SpecialPoint) -> Stability:
        at = point.lam, point.x.tobytes()
        if at not in known:  # a crossing is asked for as it is found, and where it is told
            problem, state = curve.balance_at(point.x, point.lam)
            known[at] = judge(finely(problem), state)
        return known[at]

    branch, followed = curve.branch, _Followed.of(curve, judged)
    turns = sum(p.fold or p.branch_point for p in branch.points)
    sought = turns + sum(a.unstable != b.unstable for a, b in pairwise(followed.stability)) <= MOST
    unsettled = followed.halve(judged) if sought else []
    doubtful = np.zeros(len(followed.points), dtype=bool)
    found = [*refine(curve.traced, branch), *_folded_corners(branch)] if sought else list(_flagged(branch))
    spans: dict[float, tuple[float, float]] = {}
    for rank in range(max(int(followed.count.max()), 1)):
        across, unknown = _certain(followed, unsettled, rank, judge) if sought else _plain(followed, rank)
        for special, span in _crossings(followed, rank, across, judged, sought=sought):
            found.append(special)
            if sought and not followed.along_frequency:
                spans[special.arclength] = span
        doubtful |= unknown if rank == 0 else False
    found = sorted(found, key=lambda s: s.arclength)
    for start, end in kinks(found, lambda s: (s.x, curve.value_at(s.lam)), lambda s: s.kind is Kind.FOLD):
        found = [s for s in found if s is not start and s is not end]
        doubtful |= [start.arclength <= p.arclength <= end.arclength for p in followed.points]
    kept = followed.kept(doubtful)
    curve = _with_points(curve, [followed.points[i] for i in kept])
    stability = tuple(followed.stability[i] for i in kept)
    arclengths = [p.arclength for p in curve.branch.points]
    bifurcations = []
    for special in found:
        behind = int(np.searchsorted(arclengths, special.arclength))
        there = curve.points[behind], stability[behind]
        if special.located:
            there = curve.solution_at(special.x, special.lam), judged(special)
        number = curve.number_at(special.lam)
        bifurcations.append(Bifurcation(*there, special, behind, number, spans.get(special.arclength)))
    return replace(curve, stability=stability, doubtful=doubtful[kept], bifurcations=tuple(bifurcations))


@dataclass(frozen=True, eq=False)
class _Followed:
    """Points of a curve and others between them, with their stability, in the order of travel.

    Attributes
    ----------
    curve : ResponseCurve
    points : list of Point
    stability : list of Stability
    own : list of int
        Index of each in the curve; of others -1, or -2 where a fold, a corner or a branch point is as near.
    halved : list of int
        How many times the step before each was halved.
    finer : dict
        Stability of some with more harmonics and samples, by index.
    """

    curve: ResponseCurve
    points: list[Point]
    stability: list[Stability]
    own: list[int]
    halved: list[int]
    finer: dict[int, Stability | None] = field(default_factory=dict)

    @classmethod
    def of(cls, curve: ResponseCurve, judged: Judged) -> "_Followed":
        """The points of a curve."""
        points = list(curve.branch.points)
        return cls(curve, points, list(map(judged, points)), list(range(len(points))), [0] * len(points))

    @property
    def values(self) -> Array:
        """Parameter of the curve, (points,)."""
        return np.array([self.curve.value_at(p.lam) for p in self.points])

    @property
    def along_frequency(self) -> bool:
        """Whether the frequency is what varies."""
        return self.curve.parameter == HZ

    @property
    def count(self) -> npt.NDArray[np.intp]:
        """How many multipliers lie outside of the unit circle, (points,)."""
        return np.array([s.unstable for s in self.stability])

    def long(self) -> list[int]:
        """Points before which the step may hide a bubble, and can be halved."""
        steps = np.flatnonzero(hiding(self.stability, np.array([p.arclength for p in self.points]), self.values)) + 1
        return [int(i) for i in steps if self.halved[i] < HALVED and not self.points[i].jumped]

    def halve(self, judged: Judged) -> list[int]:
        """Halve long steps until there are none or no room for more points; the steps still long."""
        room = max(len(self.points), ROOM)
        while room > 0 and (steps := self.long()[:room]):
            room -= len(steps)
            for i in reversed(steps):
                before, behind = self.points[i - 1 : i + 1]
                step = Segment(self.curve.traced, before, behind, self.curve.branch.settings, sharply=False)
                try:
                    point = step.point(0.5)
                except ConvergenceError:
                    self.halved[i] = HALVED
                    continue
                self.halved[i] += 1
                flagged = self.own[i] == -2 or behind.fold or behind.corner or behind.branch_point
                self.points.insert(i, point)
                self.stability.insert(i, judged(point))
                self.own.insert(i, -2 if flagged else -1)
                self.halved.insert(i, self.halved[i])
        return [] if room else self.long()

    def again(self, i: int, judge: Judge) -> Stability | None:
        """Stability of a point with more harmonics and samples; None where it is not found."""
        if i not in self.finer:
            point = self.points[i]
            coarse, _ = self.curve.balance_at(point.x, point.lam)
            fine = coarse.on(FourierBasis(finer(coarse.basis.H), 2 * coarse.basis.N_t))
            solution = self.curve.solution_at(point.x, point.lam)
            lam = fine.lam_at(solution.hz) if fine.parameter == "frequency" else solution.level / fine.F_ref
            try:
                self.finer[i] = judge(_finely(fine), fine.unpack(solve_near(fine, lam, solution), lam))
            except ConvergenceError:
                self.finer[i] = None
        return self.finer[i]

    def kept(self, doubtful: npt.NDArray[np.bool_]) -> list[int]:
        """Points of the curve, and one of each stretch judged alike that has none."""
        count, own = self.count, np.array(self.own)
        kept = np.flatnonzero(own >= 0).tolist()
        edges = np.flatnonzero((np.diff(count) != 0) | (np.diff(doubtful.astype(int)) != 0)) + 1
        for stretch in np.split(np.arange(len(own)), edges):
            if own[stretch].max() == -1:
                free = stretch[own[stretch] == -1]
                kept.append(int(max(free, key=lambda i: abs(growth(self.stability[i], 0)))))
        return sorted(kept)


def _with_points(curve: Curve, points: Sequence[Point]) -> Curve:
    """The curve with more points."""
    known = {id(point): solution for point, solution in zip(curve.branch.points, curve.points, strict=True)}
    solutions = tuple(known.get(id(p)) or curve.solution_at(p.x, p.lam) for p in points)
    return replace(curve, points=solutions, branch=replace(curve.branch, points=tuple(points)))


def _plain(followed: _Followed, rank: int) -> tuple[list[tuple[int, int]], npt.NDArray[np.bool_]]:
    """Neighbouring points between which the multiplier of a rank crosses, of a curve with too many to be looked at."""
    changes = np.flatnonzero(np.diff(followed.count > rank))
    return [(int(i), int(i) + 1) for i in changes], np.zeros(len(followed.points), dtype=bool)


def _certain(
    followed: _Followed, unsettled: list[int], rank: int, judge: Judge
) -> tuple[list[tuple[int, int]], npt.NDArray[np.bool_]]:
    """Crossings of a rank, between points, and points in doubt.

    They are in doubt for the error, beside steps that are still too long, and where finer numerics judge otherwise.
    """
    found = followed.stability
    across, doubtful = crossings(found, followed.values, rank, slow=not followed.along_frequency)
    unsure = np.zeros(len(found), dtype=bool)
    for i in unsettled:
        unsure[i - 1 : i + 1] = True
    grown, side = np.array([growth(s, rank) for s in found]), sides(found, rank)
    known = np.flatnonzero(side if side.any() else ~(doubtful | unsure))
    for stretch in np.split(known, np.flatnonzero(np.diff(side[known])) + 1):
        clearest = int(stretch[np.abs(grown[stretch]).argmax()]) if stretch.size else 0
        if stretch.size and abs(grown[clearest]) < CLEAR:
            again = followed.again(clearest, judge)
            if again is None or (again.unstable > rank) != (found[clearest].unstable > rank):
                unsure[stretch[0] : stretch[-1] + 1] = True
    return [(i, j) for i, j in across if not unsure[i : j + 1].any()], doubtful | unsure


def _folded_corners(branch: Branch) -> Iterator[SpecialPoint]:
    """Folds on corners, where friction starts or ceases to slip."""
    return (_behind(p, Kind.FOLD) for p in branch.points if p.fold and p.corner)


def _flagged(branch: Branch) -> Iterator[SpecialPoint]:
    """Folds and branch points, not located."""
    for p in branch.points:
        if p.fold or p.branch_point:
            yield _behind(p, Kind.FOLD if p.fold else Kind.BRANCH_POINT)


def _behind(point: Point, kind: Kind) -> SpecialPoint:
    """The point behind a bifurcation in its place."""
    tangent = np.append(point.tangent_x, point.tangent_lam)[None]
    return SpecialPoint(kind, point.x, point.lam, tangent, np.nan, point.arclength, located=False)


def _crossings(
    followed: _Followed, rank: int, across: list[tuple[int, int]], judged: Judged, *, sought: bool
) -> Iterator[tuple[SpecialPoint, tuple[float, float]]]:
    """Points between two each at which the multiplier of a rank, of a pair the upper one, crosses away from 1.

    With the values of the curve's parameter between which it does for certain.
    """
    for i, j in across:
        changes = np.flatnonzero(np.diff(followed.count[i : j + 1] > rank)) + i + 1
        at = int(changes[len(changes) // 2])
        before, behind = followed.points[at - 1 : at + 1]
        ends = followed.stability[at - 1], followed.stability[at]
        if behind.jumped or not any(_kind(end, rank) for end in ends):
            continue
        special, here = _behind(behind, Kind.FOLD), max(ends, key=lambda s: s.unstable)
        if sought:
            stretch = replace(followed.curve.branch, points=(before, behind))
            special = _crossing(followed.curve.traced, stretch, ends, rank, judged)
            here = judged(special) if special.located else here
        kind = _kind(here, rank)
        if kind is not None:
            yield replace(special, kind=kind), bounds(followed.stability, followed.values, rank, i, j)


def _crossing(
    problem: Problem, stretch: Branch, ends: tuple[Stability, Stability], rank: int, judged: Judged
) -> SpecialPoint:
    """Where the multiplier of a rank in magnitude crosses the unit circle between two points."""
    known = {id(point): end for point, end in zip(stretch.points, ends, strict=True)}

    def beyond(point: Point) -> Array:
        return np.array([growth(known.get(id(point)) or judged(point), rank) - ROUNDING])

    found = locate(problem, stretch, beyond, _Unknown.CROSSING, CLOSE)
    return found[0] if found else _behind(stretch.points[1], Kind.FOLD)


class _Unknown(Enum):
    """A point at which some multiplier crosses."""

    CROSSING = "crossing"


def _kind(here: Stability, rank: int) -> Kind | None:
    """Kind by a multiplier on the unit circle; None at 1, where the equations tell, and for the second of a pair."""
    multiplier = complex(here.multipliers[rank])
    if abs(multiplier.imag) > REAL:
        pair = [np.abs(m - multiplier.conjugate()) < REAL for m in here.multipliers[:rank]]
        return None if any(pair) else Kind.NEIMARK_SACKER
    return Kind.PERIOD_DOUBLING if multiplier.real < 0.0 else None
