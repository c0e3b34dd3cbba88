"""Curves of folds of systems that are only piecewise smooth, by chords.

Where the Jacobian jumps, along a curve with many small kinks, a fold is where lam turns and not where J_x is singular:
it may never be. Two solutions a short chord apart at the same lam have a fold between them,

    F(a, lam, mu) = 0,   F(b, lam, mu) = 0,   |a - b|^2 = (width/2)^2 |a + b|^2,

a system as regular as F itself; as the width vanishes it becomes that of Moore & Spence, F = 0 and J_x v = 0 (SIAM
Journal on Numerical Analysis 17, 1980). The fold itself is taken from the curve through a and b, half way between them,
and is off by the fourth power of the width. Over a cusp and over the birth of a closed curve the chord passes smoothly,
a square of the width aside.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from .branch import Branch, ConvergenceError, End, Point
from .newton import Border, correct
from .problem import Array
from .segment import Segment
from .settings import Settings
from .special import Kind, SpecialPoint
from .trace import continue_branch
from .twoparameter import AtMu, TwoParameterProblem

_PROMINENT = 0.01


class ChordSystem:
    """Both ends of a chord over a fold, a `Problem` in X = (a, b, lam) with parameter mu.

    Parameters
    ----------
    problem : TwoParameterProblem
        The system with folds.
    width : float
        Length of the chord as a fraction of the middle of its ends.
    weights : (N,) array
        Metric of that length.
    """

    def __init__(self, problem: TwoParameterProblem, width: float, weights: Array) -> None:
        self.problem, self.width, self.weights = problem, width, weights
        self.column = np.random.default_rng(0).standard_normal(weights.size)

    def residual(self, X: Array, mu: float) -> Array:
        """Residual, (2 N + 1,)."""
        return self.linearize(X, mu).residual

    def linearize(self, X: Array, mu: float) -> "ChordLinearization":
        """Residual and Jacobian."""
        return ChordLinearization(self, X, mu)


class ChordLinearization:
    """Residual of a `ChordSystem`, and its Jacobian by block elimination of that of F at both ends."""

    def __init__(self, system: ChordSystem, X: Array, mu: float) -> None:
        self.system, N, lam = system, system.weights.size, float(X[-1])
        a, b = X[:N], X[N:-1]
        self.ends = tuple(system.problem.linearize(x, lam, mu) for x in (a, b))
        apart, total = system.weights * (a - b), system.weights * (a + b)
        long, wide = float(apart @ (a - b)), system.width**2 / 4.0 * float(total @ (a + b))
        self.residual = np.concatenate([self.ends[0].residual, self.ends[1].residual, [long / wide - 1.0]])
        by_apart, by_total = 2.0 * apart / wide, system.width**2 / 2.0 * long / wide**2 * total
        self.slopes = by_apart - by_total, -by_apart - by_total
        self.row = apart / np.abs(apart).max()

    def solve_bordered(self, row: Array, row_mu: float, rhs: Array, rhs_row: float) -> tuple[Array, float]:
        """Solve the bordered system of 2 N + 2 unknowns, see `Linearization`."""
        parts = self._parts(rhs)
        matrix, right = self._small(parts, row, row_mu, rhs, rhs_row)
        small = np.linalg.solve(matrix, right)  # both ends along the chord, lam, mu
        ends = [part[0] @ [1.0, small[i], small[2], small[3]] for i, part in enumerate(parts)]
        return np.concatenate([*ends, small[2:3]]), float(small[3])

    def determinant_sign(self, row: Array, row_mu: float) -> int:
        """Sign of the determinant of the bordered matrix."""
        matrix, _ = self._small(self._parts(np.zeros(self.residual.size)), row, row_mu, self.residual, 0.0)
        signs = [end.determinant_sign(self.system.column, self.row, 0.0) for end in self.ends]
        return int(signs[0] * signs[1] * np.sign(np.linalg.det(matrix)))

    def _parts(self, rhs: Array) -> list[tuple[Array, Array]]:
        """Motion (N, 4) and defect (4,) of each end: by its right side, along the chord, by lam and by mu."""
        N = self.system.weights.size
        parts = []
        for end, right in zip(self.ends, (rhs[:N], rhs[N:-1]), strict=True):
            columns = np.column_stack([right, np.zeros(N), -end.J_lam, -end.J_mu])
            parts.append(end.solve(self.system.column, self.row, 0.0, columns, np.array([0.0, 1.0, 0.0, 0.0])))
        return parts

    def _small(
        self, parts: list[tuple[Array, Array]], row: Array, row_mu: float, rhs: Array, rhs_row: float
    ) -> tuple[Array, Array]:
        """Equations of (motion of both ends along the chord, lam, mu): no defects, length of the chord, border."""
        N = self.system.weights.size
        (a, defect_a), (b, defect_b) = parts
        matrix, right = np.zeros((4, 4)), np.zeros(4)
        for i, defect in enumerate((defect_a, defect_b)):
            matrix[i, [i, 2, 3]], right[i] = defect[1:], -defect[0]
        for i, (along, given) in enumerate(((self.slopes, rhs[-1]), ((row[:N], row[N:-1]), rhs_row)), start=2):
            by_a, by_b = along[0] @ a, along[1] @ b
            matrix[i], right[i] = [by_a[1], by_b[1], *(by_a[2:] + by_b[2:])], given - by_a[0] - by_b[0]
        matrix[3, 2:] += row[-1], row_mu
        return matrix, right


@dataclass(frozen=True, slots=True, eq=False)
class ChordCurve:
    """Folds in order along a curve in (x, lam, mu), found by chords.

    Attributes
    ----------
    problem : TwoParameterProblem
        The system.
    system : ChordSystem
        Whose solutions are the chords.
    branch : Branch
        The chords; unknowns (a, b, lam), parameter mu.
    folds : tuple of SpecialPoint
        The fold of every chord.
    """

    problem: TwoParameterProblem
    system: ChordSystem
    branch: Branch
    folds: tuple[SpecialPoint, ...]

    @property
    def end(self) -> End:
        """Why the curve ended."""
        return self.branch.end

    @property
    def message(self) -> str:
        """One line about it."""
        return self.branch.message.replace("continuation:", "fold curve:", 1).replace("lam", "mu")

    @property
    def x(self) -> Array:
        """Unknowns of all folds, (n, N)."""
        return np.array([fold.x for fold in self.folds])

    @property
    def lam(self) -> Array:
        """First parameter of all folds, (n,)."""
        return np.array([fold.lam for fold in self.folds])

    @property
    def mu(self) -> Array:
        """Second parameter of all folds, (n,)."""
        return self.branch.lam

    @property
    def special(self) -> tuple[SpecialPoint, ...]:
        """Turning points of mu: cusps, births of closed curves and crossings, a square of the width aside.

        Where mu goes on again after less than a hundredth of its range, small kinks made it turn; that is left out.
        """
        return tuple(self._turning(*turn) for turn in _turns(self.mu, _PROMINENT * float(np.ptp(self.mu))))

    def _turning(self, before: int, i: int, behind: int) -> SpecialPoint:
        """Kind of event where mu turns at point i, as told by folds well before and behind it."""
        fold, aside, lam = self.folds[i], self.folds[before], self.folds[i].lam
        if (aside.lam - lam) * (self.folds[behind].lam - lam) > 0.0:
            kind = Kind.CUSP
        else:  # of a closed curve the folds on both sides open towards each other
            kind = Kind.ISOLA_CENTRE if (aside.lam - lam) * aside.test < 0.0 else Kind.CROSSING
        tangent, point = np.append(fold.tangent, 0.0), self.branch.points[i]
        return SpecialPoint(kind, np.append(fold.x, lam), point.lam, tangent[None], fold.test, point.arclength)

    def at(self, mu: float) -> tuple[SpecialPoint, ...]:
        """Folds at a given mu, in the order of travel.

        Raises
        ------
        ConvergenceError
            If one that lies on the curve cannot be solved.
        """
        points = self.branch.points
        begins = (self.folds[0],) if points[0].lam == mu else ()
        between = [(p, q) for p, q in pairwise(points) if (p.lam - mu) * (q.lam - mu) < 0.0 or q.lam == mu]
        return begins + tuple(self._between(p, q, mu) for p, q in between)

    def _between(self, before: Point, behind: Point, mu: float) -> SpecialPoint:
        settings = self.branch.settings
        segment = Segment(self.system, before, behind, settings)
        u = segment.root(lambda u: segment.solve(u)[0].lam - mu)
        found = segment.solve(u)[0]
        return _fold(self.system, found.x, mu, segment.arclength(u), settings)


def _turns(values: Array, prominent: float) -> list[tuple[int, int, int]]:
    """Where values turn by more than `prominent`: index of the turn, and of the nearest that far before and behind."""
    found, top = [], {1.0: 0, -1.0: 0}
    heading = 0.0
    for i, value in enumerate(values):
        for sense in (1.0, -1.0):
            if sense * (value - values[top[sense]]) > 0.0:
                top[sense] = i
            if heading != -sense and sense * (values[top[sense]] - value) > prominent:
                if heading == sense:
                    away = np.flatnonzero(sense * (values[top[sense]] - values[: top[sense]]) > prominent)
                    found.append((int(away[-1]), top[sense], i))
                heading = -sense
                top[-sense] = i
    return found


def chord_curve(
    problem: TwoParameterProblem,
    fold: SpecialPoint,
    mu: float,
    settings: Settings,
    *,
    width: float,
    on_point: Callable[[Point], bool | None] | None = None,
) -> ChordCurve:
    """Folds of a piecewise smooth system in the plane of two parameters, from one of them on.

    Parameters
    ----------
    problem : TwoParameterProblem
        The system F(x, lam, mu) = 0.
    fold : SpecialPoint
        A fold at `mu`, see `refine`.
    mu : float
        The second parameter there.
    settings : Settings
        As for `fold_curve`, with `weights` for (x, lam), (N + 1,).
    width : float
        Length of the chord as a fraction of |x|: over many of the kinks, and short beside the distance of two folds.
    on_point : callable, optional
        Called with every point; a true result stops the trace there.

    Returns
    -------
    ChordCurve

    Raises
    ------
    ConvergenceError
        If there is no chord over the fold.
    """
    weights = np.ones(fold.x.size + 1) if settings.weights is None else np.asarray(settings.weights)
    system = ChordSystem(problem, width, weights[:-1])
    along = fold.null_space[0, :-1]
    length = np.sqrt(float(weights[:-1] @ fold.x**2) / float(weights[:-1] @ along**2))
    half = 0.5 * width * length * along
    start = np.concatenate([fold.x + half, fold.x - half, [fold.lam]])
    both = 0.5 * np.concatenate([weights[:-1], weights[:-1], 2.0 * weights[-1:]])
    branch = continue_branch(system, start, mu, replace(settings, weights=both), on_point)
    if not branch.points:
        raise ConvergenceError(branch.message.replace("continuation:", "fold curve:", 1), branch)
    folds = tuple(_fold(system, p.x, p.lam, p.arclength, branch.settings) for p in branch.points)
    return ChordCurve(problem, system, branch, folds)


def _fold(system: ChordSystem, X: Array, mu: float, arclength: float, settings: Settings) -> SpecialPoint:
    """Solution half way along a chord, the fold; that between the ends itself where there is none close by."""
    N, lam = system.weights.size, float(X[-1])
    middle, chord = 0.5 * (X[:N] + X[N:-1]), X[:N] - X[N:-1]
    row = system.weights * chord
    length = np.sqrt(float(row @ chord))
    problem = AtMu(system.problem, mu)
    found = correct(problem, np.append(middle, lam), Border(row / length, 0.0), settings)
    tangent = np.append(chord, 0.0) / length
    state = found.state if found.converged else np.append(middle, lam)
    return SpecialPoint(
        Kind.FOLD, state[:-1], float(state[-1]), tangent[None], lam - float(state[-1]), arclength, found.converged
    )
