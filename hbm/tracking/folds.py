"""Folds of a response in the plane of the frequency and a second number, and the detached curves that they betray.

:func:`fold_path` follows a fold of a frequency response while the force, or any other number of the rig, changes: a
:class:`FoldPath`, the edge of the region where the response jumps. Where it meets a force again at other frequencies
there are folds that no sweep at that force has passed: :func:`isolas` traces the closed curves they belong to.

A law that sticks and slips is only piecewise smooth: its Jacobian jumps whenever a sample changes between the two, and
is singular nowhere. Such folds are followed by chords (:mod:`continuation.chord`), smooth ones exactly
(:mod:`continuation.foldcurve`); which they are the first fold tells.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from continuation import (
    Branch,
    ChordCurve,
    ConvergenceError,
    DenseTwoParameterLinearization,
    FoldCurve,
    Point,
    Settings,
    SpecialPoint,
    chord_curve,
    continue_along,
    fold_curve,
    refine_fold,
)
from hbm.balance.problem import AnyBalance, AnyLinearization
from hbm.balance.solution import PeriodicSolution, describe
from hbm.errors import expect_rig
from hbm.fourier import Array
from hbm.parallel import one_thread
from hbm.response.budget import in_units
from hbm.response.curve import ResponseCurve
from hbm.response.kinks import VALUE
from hbm.response.steps import trace_settings
from hbm.sensitivity.derivatives import balance_change
from hbm.tracking.parameter import Key, ParameterBalance, check_value, parameter_key
from models.scalars import FORCE, HZ

WIDTHS = (0.06, 0.02, 0.006)
"""Lengths of a chord over a fold, relative to the motion; the first that the first fold has room for is taken."""

SMOOTH = 1e-6
"""Where the tangent of a fold is level to this, its Jacobian is singular as that of a smooth system is."""

STEP = 0.1
"""Largest step along a path, relative to the motion."""

FRICTION_WEIGHT = 1e-3
"""Of friction or joint forces in lengths; they follow from the motion."""

FREQUENCY_WEIGHT = 100.0
"""Of the frequency in its unit."""

TOLERANCE = 1e-9

APART = 2e-3
"""A fold further than this from a branch, relative to the motion, is none of it."""

MOST_POINTS = 600


class PlaneBalance:
    """The balance of a rig as a :class:`continuation.TwoParameterProblem`.

    The first parameter is the frequency in units of `along.first.hz_ref`, the second that of `along`.

    Parameters
    ----------
    along : ParameterBalance
        The second number.
    """

    def __init__(self, along: ParameterBalance) -> None:
        self.along = along

    def residual(self, x: Array, lam: float, mu: float) -> Array:
        """Scaled force balance, (size,)."""
        problem = self.along.at(mu)
        signs = self.along.signs(problem, mu)
        return np.asarray(signs * problem.residual(signs * x, lam))

    def linearize(self, x: Array, lam: float, mu: float) -> "PlaneLinearization":
        """Residual with its whole Jacobian, nothing left out, which is worked out when first asked for."""
        problem = self.along.at(mu)
        signs = self.along.signs(problem, mu)
        width = self.along.values[1] - self.along.values[0]
        units = np.array([problem.hz_ref, width])
        return PlaneLinearization(problem.linearize(signs * x, lam), signs, (HZ, self.along.key.name), units)


class PlaneLinearization:
    """Residual at a state, and its derivative when asked for; a :class:`continuation.TwoParameterLinearization`."""

    def __init__(self, here: AnyLinearization, signs: Array, keys: tuple[str, str], units: Array) -> None:
        self.here, self.signs, self.keys, self.units = here, signs, keys, units
        self.residual = signs * here.residual

    @cached_property
    def _dense(self) -> DenseTwoParameterLinearization:
        by_lam, by_mu = (self.signs[:, None] * balance_change(self.here, self.keys) * self.units).T
        J_x = self.signs[:, None] * self.here.complete * self.signs
        return DenseTwoParameterLinearization(self.residual, J_x, by_lam, by_mu)

    @property
    def J_lam(self) -> Array:
        """Derivative of the residual to the frequency in its unit, (size,)."""
        return self._dense.J_lam

    @property
    def J_mu(self) -> Array:
        """Derivative of the residual to the second parameter, (size,)."""
        return self._dense.J_mu

    def solve(self, column: Array, row: Array, corner: float, rhs: Array, rhs_row: Array) -> tuple[Array, Array]:
        """Solve the bordered system, see :class:`continuation.TwoParameterLinearization`."""
        return self._dense.solve(column, row, corner, rhs, rhs_row)

    def determinant_sign(self, column: Array, row: Array, corner: float) -> int:
        """Sign of the determinant of the bordered matrix."""
        return self._dense.determinant_sign(column, row, corner)


@dataclass(frozen=True, eq=False)
class FoldPath:
    """Folds in order along a path in the plane of the frequency and a second number.

    Attributes
    ----------
    plane : PlaneBalance
    parts : tuple of FoldCurve or ChordCurve
        From the first fold towards the second bound, and from there towards the first where it is not closed.
    """

    plane: PlaneBalance
    parts: tuple[FoldCurve | ChordCurve, ...]

    def __repr__(self) -> str:
        """Ranges of the frequency and the second number, special points, and why each part ended."""
        return (
            f"folds over {self.key.name}: {len(self.hz)} points, {self.hz.min():.6g} to {self.hz.max():.6g} Hz, "
            f"{self.values.min():.6g} to {self.values.max():.6g} {self.key.accepted.unit}, "
            f"{len(self.special)} special points; " + "; ".join(self.messages)
        )

    @property
    def key(self) -> Key:
        """The second number: name, value in the rig, unit and bounds."""
        return self.plane.along.key

    def _joined(self, values: Sequence[Array]) -> Array:
        forth, *back = values
        return np.concatenate([*(part[:0:-1] for part in back), forth])

    @cached_property
    def hz(self) -> Array:
        """Frequency of every fold, (points,) [Hz]."""
        return self._joined([part.lam for part in self.parts]) * self.plane.along.first.hz_ref

    @cached_property
    def values(self) -> Array:
        """Second number of every fold, (points,)."""
        begin, end = self.plane.along.values
        return begin + self._joined([part.mu for part in self.parts]) * (end - begin)

    @cached_property
    def points(self) -> tuple[PeriodicSolution, ...]:
        """The solution at every fold."""
        states = self._joined([np.column_stack([part.x, part.lam, part.mu]) for part in self.parts])
        return tuple(self._described(state[:-2], state[-2], state[-1]) for state in states)

    def _described(self, x: Array, lam: float, mu: float) -> PeriodicSolution:
        problem = self.plane.along.at(float(mu))
        return describe(problem, self.plane.along.signs(problem, float(mu)) * x, float(lam))

    @property
    def special(self) -> tuple[SpecialPoint, ...]:
        """Cusps, births of closed curves and crossings; see :class:`continuation.FoldCurve`."""
        return tuple(point for part in self.parts for point in part.special)

    def place(self, point: SpecialPoint) -> tuple[float, float]:
        """Frequency [Hz] and second number of a special point."""
        return float(point.x[-1]) * self.plane.along.first.hz_ref, self.plane.along.value_at(point.lam)

    @property
    def messages(self) -> tuple[str, ...]:
        """Why each part ended."""
        unit = self.key.accepted.unit
        return tuple(in_units(part.message, "mu", self.plane.along.value_at, unit) for part in self.parts)

    def at(self, value: float) -> tuple[PeriodicSolution, ...]:
        """The solution at every fold where the second number has a value; its `hz` is the frequency [Hz].

        Raises
        ------
        continuation.ConvergenceError
            If one cannot be solved.
        """
        return tuple(self._described(fold.x, fold.lam, self.plane.along.lam_at(value)) for fold in self.located(value))

    def located(self, value: float) -> tuple[SpecialPoint, ...]:
        """The folds of :meth:`at` in the unknowns of the plane, with their tangents; `lam` is the frequency there."""
        mu, start = self.plane.along.lam_at(value), self.parts[0].mu[0]
        return tuple(
            fold
            for i, part in enumerate(self.parts)
            for j, fold in enumerate(part.at(mu))
            if not (i and not j and mu == start)  # both parts begin with the first fold
        )


@one_thread
def fold_path(
    curve: ResponseCurve, within: tuple[float, float], *, key: str = FORCE, fold: int = 0, max_points: int = MOST_POINTS
) -> FoldPath:
    """Follow a fold of a frequency response in the frequency and a second number, both ways.

    Parameters
    ----------
    curve : ResponseCurve
        A frequency response.
    within : (float, float)
        Bounds of the second number, where the path ends.
    key : str
        The second number, as for :func:`hbm.tracking.parameterresponse.parameter_response`; the force where omitted.
    fold : int
        Which of the curve's folds, in the order of travel.
    max_points : int
        Most points each way.

    Returns
    -------
    FoldPath

    Raises
    ------
    ValueError
        If the curve has no such fold, or the number or a bound is not accepted.
    continuation.ConvergenceError
        If the first fold cannot be solved.
    """
    expect_rig(curve.rig, "fold_path", joints=True)
    number, present = _second(curve, within, key)
    segments = _segments(curve)
    if not -len(segments) <= fold < len(segments):
        raise ValueError(f"fold_path: fold {fold}; the curve has {len(segments)}")
    first = refine_fold(curve.problem, *segments[fold], curve.branch.settings)
    along = ParameterBalance(
        curve.rig, number, (present, within[1]), curve.basis, hz=curve.points[0].hz, level=curve.level
    )
    plane, low = PlaneBalance(along), along.lam_at(within[0])
    try:
        parts = [_part(plane, first, 1.0, (low, 1.0), max_points)]
        if not parts[0].branch.closed:
            parts.append(_part(plane, first, low, (low, 1.0), max_points))
    except ConvergenceError:
        raise ConvergenceError(
            f"fold_path: fold {fold} at {curve.value_at(first.lam):.6g} Hz cannot be followed, kinks of friction hide "
            f"it; try another fold, or a curve with more than {curve.basis.N_t} samples"
        ) from None
    return FoldPath(plane, tuple(parts))


def _segments(curve: ResponseCurve) -> list[tuple[Point, Point]]:
    """Ends of a smooth stretch over each fold of a curve; of one on a kink over the nearest turn of that."""
    smooth = [(a, b) for a, b in pairwise(curve.branch.points) if b.fold and not (b.corner or b.jumped)]
    values = np.array([curve.turn_at(b) for _, b in smooth])
    found = []
    for fold in curve.folds:
        away = np.abs(values - fold) / abs(fold)
        if away.min(initial=np.inf) <= VALUE:
            found.append(smooth[int(away.argmin())])
    return found


def _second(curve: ResponseCurve, within: tuple[float, float], key: str) -> tuple[Key, float]:
    """The second number and its present value.

    Raises
    ------
    ValueError
        If it is none, or not within accepted bounds.
    """
    if key == HZ:
        raise ValueError(f"fold_path: {HZ} is the first number; must be another one")
    number = parameter_key(curve.rig, key, curve.points[0].hz, curve.level)
    for value in within:
        check_value(curve.rig, number, value)
    if not min(within) < number.value < max(within):
        raise ValueError(f"fold_path: within {within[0]:g} to {within[1]:g}; must hold {key} = {number.value:g}")
    return number, number.value


def _part(
    plane: PlaneBalance, first: SpecialPoint, end: float, bounds: tuple[float, float], max_points: int
) -> FoldCurve | ChordCurve:
    weights = np.ones(first.x.size + 1)
    weights[_modes(plane.along.first) : -1] = FRICTION_WEIGHT
    weights[-1] = FREQUENCY_WEIGHT
    settings = Settings(
        lam_end=end,
        lam_min=bounds[0],
        lam_max=bounds[1],
        lam_weight=(bounds[1] - bounds[0]) ** -2.0,
        step=STEP / 5,
        step_max=STEP,
        relative_step=STEP,
        tolerance=TOLERANCE,
        max_iterations=15,
        weights=weights,
        max_points=max_points,
        max_angle=2.0,  # the small kinks of friction are no corners to be looked at
        corner_angle=np.pi,
        tangent_slack=0.01,
    )
    if abs(first.test) < SMOOTH:
        with suppress(ConvergenceError):  # a fold on a kink is level too
            return fold_curve(plane, first, 0.0, replace(settings, max_angle=0.5))
    for width in WIDTHS[:-1]:
        with suppress(ConvergenceError):
            return chord_curve(plane, first, 0.0, settings, width=width)
    return chord_curve(plane, first, 0.0, settings, width=WIDTHS[-1])


@one_thread
def isolas(
    path: FoldPath, value: float, met: Sequence[ResponseCurve], hz: tuple[float, float]
) -> tuple[ResponseCurve, ...]:
    """Detached frequency responses at one value of the second number: those that own folds and are not met yet.

    Parameters
    ----------
    path : FoldPath
    value : float
        Value of the second number.
    met : sequence of ResponseCurve
        Traced already at this value, on the basis of the path.
    hz : (float, float)
        Where a curve ends that is not closed [Hz].

    Returns
    -------
    tuple of ResponseCurve
        Each once; `branch.closed` says which came back to their start.

    Raises
    ------
    continuation.ConvergenceError
        If a fold cannot be solved.
    """
    along = path.plane.along
    mu = along.lam_at(value)
    problem = along.at(mu)
    signs = along.signs(problem, mu)
    low, high = sorted(map(problem.lam_at, hz))
    settings = replace(trace_settings(problem, low, high, (high - low) / 50), lam_min=low, lam_max=high)
    branches = [_states(problem, curve.points) for curve in met]
    found: list[ResponseCurve] = []
    for fold in path.located(value):
        x = signs * fold.x
        if any(_apart(np.append(x, fold.lam), states, problem) < APART for states in branches):
            continue
        branch = _around(problem, x, fold.lam, signs * fold.tangent[:-1], settings)
        points = tuple(describe(problem, p.x, p.lam) for p in branch.points)
        found.append(ResponseCurve(problem.rig, points, branch, problem))
        branches.append(_states(problem, points))
    return tuple(found)


def _around(problem: AnyBalance, x: Array, lam: float, across: Array, settings: Settings) -> Branch:
    """Branch from close to a fold, which is passed at the end, on."""
    weights = np.ones(x.size) if settings.weights is None else settings.weights
    ahead = x + 0.5 * settings.step / np.sqrt(float(weights @ across**2)) * across
    return continue_along(problem, ahead, lam, np.append(across, 0.0), settings)


def _states(problem: AnyBalance, points: Sequence[PeriodicSolution]) -> Array:
    """Scaled unknowns and frequency of points, (points, size + 1)."""
    return np.array([np.append(*problem.pack(p.state)) for p in points])


def _modes(problem: AnyBalance) -> int:
    """Number of unknowns that are of the motion; friction or joint forces follow."""
    return problem.basis.size * problem.structure.n


def _apart(state: Array, states: Array, problem: AnyBalance) -> float:
    """Distance of a state from the chords between points, in the motion and relative to it."""
    motion = np.r_[: _modes(problem), problem.size]
    point, corners = state[motion], states[:, motion]
    chords, there = np.diff(corners, axis=0), point - corners[:-1]
    share = np.clip(np.einsum("ij,ij->i", there, chords) / np.einsum("ij,ij->i", chords, chords), 0.0, 1.0)
    return float(np.linalg.norm(there - share[:, None] * chords, axis=1).min() / np.linalg.norm(point[:-1]))
