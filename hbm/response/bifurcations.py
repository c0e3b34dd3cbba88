"""Stability of a solution, and along a curve with its bifurcations.

:func:`stability_of` judges a solution, :func:`with_stability` returns a curve that knows its stability.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from enum import Enum
from itertools import pairwise
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from continuation import Branch, ConvergenceError, Kind, Point, Problem, SpecialPoint, locate, refine
from hbm.balance.problem import HarmonicBalance, State
from hbm.balance.solution import PeriodicSolution
from hbm.fourier import Array, FourierBasis
from hbm.parallel import one_thread
from hbm.response.accuracy import finer
from hbm.response.curve import Bifurcation, ResponseCurve
from hbm.response.trace import solve_near
from hbm.stability.multipliers import ROUNDING, Stability, floquet
from models.rig import Rig

Curve = TypeVar("Curve", bound=ResponseCurve)
Judge = Callable[[HarmonicBalance, State], Stability]
Judged = Callable[[Point | SpecialPoint], Stability]

LEAST = 1e-12
"""Magnitude that a multiplier of zero counts as, for its logarithm."""

CLOSE = 1e-4
"""A crossing of the unit circle is found to this fraction of the way between two points; multipliers of a contact jump
a little wherever a sample starts to slip."""

MOST = 60
"""Up to so many bifurcations of a curve are located; more are a sign of too few samples or harmonics."""

CLEAR = 0.02
"""A stretch of a curve is judged once more where its multipliers come no further from the unit circle than this."""

REAL = 1e-6
"""A multiplier with an imaginary part below this is real."""


def stability_of(rig: Rig, solution: PeriodicSolution, judge: Judge = floquet) -> Stability:
    """Stability of one periodic solution.

    Parameters
    ----------
    rig : Rig
    solution : PeriodicSolution
        Of this rig.
    judge : callable
        As for :func:`with_stability`.

    Raises
    ------
    ValueError
        Where the judge cannot tell.
    """
    periods = round(2 * np.pi * solution.hz / solution.state.Omega)
    problem = HarmonicBalance(rig, solution.basis, level=solution.level, periods=periods)
    return judge(problem, solution.state)


@one_thread
def with_stability(curve: Curve, judge: Judge = floquet) -> Curve:
    """The curve with the stability of its points, and its bifurcations located by the solver.

    Folds and branch points are those of the equations. Between two points where a multiplier leaves or enters the unit
    circle elsewhere the curve is solved again until it lies on it: at -1 the period doubles, a pair is a Neimark-Sacker
    bifurcation, beyond which the motion has a second frequency. Where a curve has too many of them to be resolved, the
    points behind them stand for them, `special.located` says so. A stretch of points alike whose multipliers stay close
    to the unit circle is judged once more, at the point furthest from it, with twice the harmonics and samples: where
    that differs it is doubtful, and so are the crossings at its ends, which are left out.

    Parameters
    ----------
    curve : ResponseCurve
    judge : callable
        Stability of a solution of the balance, :func:`hbm.stability.multipliers.floquet` or
        :func:`hbm.stability.hill.hill`.

    Returns
    -------
    ResponseCurve
        Of the same kind.

    Raises
    ------
    ValueError
        Where the judge cannot tell.
    """
    problem, branch = curve.traced, curve.branch

    def judged(point: Point | SpecialPoint) -> Stability:
        return judge(*curve.balance_at(point.x, point.lam))

    stability = tuple(map(judged, branch.points))
    doubtful = _doubtful(curve, stability, judge)
    turns = sum(p.fold or p.branch_point for p in branch.points)
    sought = turns + sum(a.unstable != b.unstable for a, b in pairwise(stability)) <= MOST
    found = [*refine(problem, branch), *_folded_corners(branch)] if sought else list(_flagged(branch))
    found += _crossings(problem, branch, stability, ~doubtful[:-1] & ~doubtful[1:], judged, sought=sought)
    arclengths = [p.arclength for p in branch.points]
    bifurcations = []
    for special in sorted(found, key=lambda s: s.arclength):
        behind = int(np.searchsorted(arclengths, special.arclength))
        if special.located:
            bifurcations.append(
                Bifurcation(curve.solution_at(special.x, special.lam), judged(special), special, behind)
            )
        else:
            bifurcations.append(Bifurcation(curve.points[behind], stability[behind], special, behind))
    return replace(curve, stability=stability, doubtful=doubtful, bifurcations=tuple(bifurcations))


def _doubtful(curve: ResponseCurve, stability: tuple[Stability, ...], judge: Judge) -> npt.NDArray[np.bool_]:
    """Points of stretches whose clearest point is judged otherwise with more harmonics and samples, or not at all."""
    doubtful = np.zeros(len(stability), dtype=bool)
    growth = np.array([abs(np.log(max(s.largest, LEAST))) for s in stability])
    edges = np.flatnonzero(np.diff([s.unstable for s in stability])) + 1
    for stretch in np.split(np.arange(len(stability)), edges):
        clearest = int(stretch[growth[stretch].argmax()])
        if growth[clearest] < CLEAR:
            again = _again(curve, clearest, judge)
            doubtful[stretch] = again is None or again.unstable != stability[clearest].unstable
    return doubtful


def _again(curve: ResponseCurve, i: int, judge: Judge) -> Stability | None:
    """Stability of a point with more harmonics and samples; None where it is not found."""
    point = curve.branch.points[i]
    coarse, _ = curve.balance_at(point.x, point.lam)
    fine = coarse.on(FourierBasis(finer(coarse.basis.H), 2 * coarse.basis.N_t))
    solution = curve.points[i]
    lam = fine.lam_at(solution.hz) if fine.parameter == "frequency" else solution.level / fine.F_ref
    try:
        x = solve_near(fine, lam, solution)
    except ConvergenceError:
        return None
    return judge(fine, fine.unpack(x, lam))


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
    problem: Problem,
    branch: Branch,
    stability: tuple[Stability, ...],
    clear: npt.NDArray[np.bool_],
    judged: Judged,
    *,
    sought: bool,
) -> Iterator[SpecialPoint]:
    """Points at which a multiplier, or a pair, crosses the unit circle away from 1, between points not in doubt."""
    for i in np.flatnonzero(clear) + 1:
        behind = branch.points[i]
        ends = stability[i - 1], stability[i]
        rank, last = sorted(s.unstable for s in ends)
        while rank < last and not behind.jumped:
            special = _behind(behind, Kind.FOLD)
            here = max(ends, key=lambda s: s.unstable)
            if sought:
                stretch = replace(branch, points=branch.points[i - 1 : i + 1])
                special = _crossing(problem, stretch, ends, rank, judged)
                here = judged(special) if special.located else here
            kind = _kind(complex(here.multipliers[rank]))
            if kind is not None:
                yield replace(special, kind=kind)
            rank += 2 if kind is Kind.NEIMARK_SACKER else 1


def _crossing(
    problem: Problem, stretch: Branch, ends: tuple[Stability, Stability], rank: int, judged: Judged
) -> SpecialPoint:
    """Where the multiplier of a rank in magnitude crosses the unit circle between two points."""
    known = {id(point): end for point, end in zip(stretch.points, ends, strict=True)}

    def growth(point: Point) -> Array:
        here = known.get(id(point)) or judged(point)
        return np.array([np.log(max(float(np.abs(here.multipliers[rank])), LEAST) / (1.0 + ROUNDING))])

    found = locate(problem, stretch, growth, _Unknown.CROSSING, CLOSE)
    return found[0] if found else _behind(stretch.points[1], Kind.FOLD)


class _Unknown(Enum):
    """A point at which some multiplier crosses."""

    CROSSING = "crossing"


def _kind(multiplier: complex) -> Kind | None:
    """What a multiplier on the unit circle means; None at 1, where the equations tell folds and branch points."""
    if abs(multiplier.imag) > REAL:
        return Kind.NEIMARK_SACKER
    return Kind.PERIOD_DOUBLING if multiplier.real < 0.0 else None
