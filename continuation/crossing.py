"""Simple branch points: where two curves of solutions cross.

There J = [J_x, J_lam] has a null space of two dimensions, and no system of N + 1 equations is regular. With one more
unknown, F(y) + e b = 0, the solutions form a surface that is smooth also there. On it e is a function of two
coordinates a = (rows . y), and its exact gradient g comes from one bordered solve,

    [[J, b], [rows, 0]] [V, g] = [0, I]

(Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria, SIAM 2000, ch. 7). Solutions are e = 0; their
curves cross at the saddle g = 0 with e = 0. Newton's method on g needs second derivatives, which a `Problem` does not
have: secants of g serve (the 2 x 2 matrix H, Broyden). The tangents of both curves are the directions a'Ha = 0.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from .branch import ConvergenceError, Point
from .geometry import Metric
from .newton import max_norm
from .problem import Array, Linearization, Problem
from .segment import Segment
from .settings import Settings
from .special import Kind, SpecialPoint

_FIRST_SECANT = 1e-3
_LAST_STEP, _ROUNDING = 1e-10, 1e-13
_ITERATIONS = 30


@dataclass(slots=True, eq=False)
class _Reduced:
    """The function e(a) on the surface of F + e b = 0 around a point.

    Attributes
    ----------
    rows : (2, N + 1) array
        Coordinates of the surface, two orthonormal directions times the weights.
    column : (N,) array
        The vector b.
    shortest : float
        Length of a last step.
    excess, slope, frame : float, (2,) array, (2, N + 1) array
        e, its gradient g, and the directions V along the surface, where `solve` ended.
    """

    problem: Problem
    metric: Metric
    rows: Array
    column: Array
    shortest: float
    frame: Array = field(init=False)
    slope: Array = field(init=False)
    excess: float = field(init=False, default=0.0)

    def solve(self, state: Array, coordinates: Array) -> Array | None:
        """Point of the surface at given coordinates from a guess; `excess`, `slope` and `frame` are those there.

        None where J has lost its rank, which is the branch point itself.
        """
        for _ in range(_ITERATIONS):
            linearization = self.problem.linearize(state[:-1], float(state[-1]))
            missing = linearization.residual + self.excess * self.column
            step = self._step(linearization, -missing, coordinates - self.rows @ state)
            if step is None:
                return None
            state = state + step
            if self.metric.norm(step) <= self.shortest:
                return state
        raise ConvergenceError(f"refine: no solution close to the branch point near lam = {state[-1]:.10g}")

    def _step(self, linearization: Linearization, rhs: Array, ahead: Array) -> Array | None:
        """Newton's step in (y, e), with the columns (V, g); None where there is none."""
        eliminated = [self._eliminate(linearization, rhs, ahead, k) for k in (0, 1)]
        usable = [found for found in eliminated if found is not None]
        if not usable:
            return None
        _, step, change, self.frame, self.slope = min(usable, key=lambda found: found[0])
        self.excess += change
        return step

    def _eliminate(
        self, linearization: Linearization, rhs: Array, ahead: Array, first: int
    ) -> tuple[float, Array, float, Array, Array] | None:
        """Block elimination of e on [J; rows[first]], its condition in front, or None where that is singular."""
        row, other = self.rows[first], self.rows[1 - first]

        def solve(right: Array, right_row: float) -> Array:
            x, lam = linearization.solve_bordered(row[:-1], float(row[-1]), right, right_row)
            return np.append(x, lam)

        try:
            by_column = solve(self.column, 0.0)
            along, particular = solve(np.zeros(rhs.size), 1.0), solve(rhs, float(ahead[first]))
        except np.linalg.LinAlgError:
            return None
        across = float(other @ by_column)
        if not (math.isfinite(across) and across != 0.0):
            return None
        change = float(other @ particular - ahead[1 - first]) / across
        slope = np.array([other @ along, -1.0]) / across
        frame = np.array([along, np.zeros_like(along)]) - np.outer(slope, by_column)
        if first == 1:
            slope, frame = slope[::-1], frame[::-1]
        return float(np.linalg.norm(by_column)), particular - change * by_column, change, frame, slope


@np.errstate(all="ignore")
def refine_branch_point(problem: Problem, before: Point, behind: Point, settings: Settings) -> SpecialPoint:
    """Simple branch point between two neighbouring points, with the tangents of both curves.

    Parameters
    ----------
    problem : Problem
        The system.
    before, behind : Point
        Neighbours on a branch, on either side of the branch point.
    settings : Settings
        Those of the branch.

    Raises
    ------
    ConvergenceError
        If there is none: the search fails, leaves the neighbourhood, or two curves come close without a crossing.
    """
    segment = Segment(problem, before, behind, settings)
    length, middle = segment.metric.norm(segment.chord), segment.cubic.at(0.5)
    reduced = _reduced(problem, segment)
    state = _saddle(reduced, middle, length)
    where = f"refine: near lam = {middle[-1]:.10g} "
    if segment.metric.norm(state - middle) > length:
        raise ConvergenceError(where + "is no branch point; try smaller steps of the branch")
    if abs(reduced.excess) * max_norm(reduced.column) > settings.tolerance:
        raise ConvergenceError(where + f"two curves come close, but do not cross: residual {abs(reduced.excess):.2g}")
    u = segment.metric.inner(state - segment.ends[0], segment.chord) / length**2
    return SpecialPoint(
        kind=Kind.BRANCH_POINT,
        x=state[:-1],
        lam=float(state[-1]),
        test=max_norm(reduced.slope),
        null_space=_tangents(reduced, state, segment),
        arclength=segment.arclength(min(max(u, 0.0), 1.0)),
    )


def _reduced(problem: Problem, segment: Segment) -> _Reduced:
    """Coordinates along the chord and across it, in the direction in which J becomes singular."""
    metric = segment.metric
    along = metric.unit(segment.chord)
    row = metric.weights * along
    column = np.random.default_rng(0).standard_normal(row.size - 1)
    column /= max_norm(column)
    for u in (0.5, 0.4):  # one of them may be the branch point itself
        state = segment.cubic.at(u)
        linearization = problem.linearize(state[:-1], float(state[-1]))
        try:
            across = np.append(*linearization.solve_bordered(row[:-1], float(row[-1]), column, 0.0))
        except np.linalg.LinAlgError:
            continue
        if np.all(np.isfinite(across)):
            rows = metric.weights * np.array([along, metric.unit(across)])
            shortest = _LAST_STEP * metric.norm(segment.chord) + _ROUNDING * metric.norm(state)
            return _Reduced(problem, metric, rows, column, shortest)
    raise ConvergenceError(f"refine: no unique tangent around lam = {segment.cubic.at(0.5)[-1]:.10g}")


def _saddle(reduced: _Reduced, guess: Array, length: float) -> Array:
    """Point of the surface where the gradient of e vanishes."""
    hessian, _ = _hessian(reduced, guess, _FIRST_SECANT * length)
    a = reduced.rows @ guess
    state = reduced.solve(guess, a)
    for _ in range(_ITERATIONS):
        if state is None or max_norm(reduced.slope) == 0.0:
            break  # on the branch point to the last bit
        guess, slope = state, reduced.slope
        step = -np.linalg.lstsq(hessian, slope)[0]
        step *= min(1.0, 0.5 * length / float(np.linalg.norm(step)))
        guess, a = guess + step @ reduced.frame, a + step
        state = reduced.solve(guess, a)
        if state is not None and np.linalg.norm(step) <= reduced.shortest:
            return state
        hessian += np.outer(reduced.slope - slope - hessian @ step, step) / (step @ step)
    else:
        raise ConvergenceError(f"refine: the search for a branch point near lam = {guess[-1]:.10g} does not converge")
    reduced.slope = np.zeros(2)
    return guess


def _hessian(reduced: _Reduced, state: Array, distance: float) -> tuple[Array, Array]:
    """Slope of the gradient of e by secants of a given length on either side, (2, 2), and the mean frame there."""
    a = reduced.rows @ state
    directions = np.linalg.pinv(reduced.rows).T
    columns, frames = [], []
    for k, direction in enumerate(directions):
        slopes = []
        for reach in (-distance, distance):
            reduced.excess = 0.0
            if reduced.solve(state + reach * direction, a + reach * np.eye(2)[k]) is None:
                raise ConvergenceError(f"refine: J loses its rank around lam = {state[-1]:.10g}, not at a point only")
            slopes.append(reduced.slope)
            frames.append(reduced.frame)
        columns.append((slopes[1] - slopes[0]) / (2.0 * distance))
    reduced.excess = 0.0
    return np.column_stack(columns), np.mean(frames, axis=0)


def _tangents(reduced: _Reduced, state: Array, segment: Segment) -> Array:
    """Unit tangents of the traced curve and of the other one, (2, N + 1).

    Directions a'Ha = 0; where the secants do not tell them, the chord and the direction across it (Keller 1977).
    """
    metric, chord = segment.metric, segment.chord
    hessian, frame = _hessian(reduced, state, _FIRST_SECANT * metric.norm(chord))
    values, vectors = np.linalg.eigh(0.5 * (hessian + hessian.T))
    if values[0] < 0.0 < values[1]:
        a, b = math.sqrt(values[1]) * vectors[:, 0], math.sqrt(-values[0]) * vectors[:, 1]
        coordinates = np.array([a + b, a - b])
    else:
        coordinates = np.eye(2)
    first, second = (metric.unit(direction) for direction in coordinates @ frame)
    if abs(metric.inner(first, chord)) < abs(metric.inner(second, chord)):
        first, second = second, first
    return np.array([math.copysign(1.0, metric.inner(first, chord)) * first, second])
