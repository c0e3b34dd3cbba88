"""Resonance peaks followed: where and how high the peak of a channel is, against force or any number of the rig.

A peak is a point of the frequency response at which the channel's peak is level along the curve. The derivative along
the curve is that of the implicit function theorem (:mod:`hbm.sensitivity.derivatives`); its root is bracketed along
the curve, so that peaks beside a fold are found too.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from continuation import Border, ConvergenceError, NewtonSettings, correct
from hbm.balance.padding import pad
from hbm.balance.problem import balance_of
from hbm.balance.scaled import State
from hbm.balance.solution import PeriodicSolution, describe
from hbm.balance.tones import basis_for
from hbm.errors import InputError, expect_rig
from hbm.fourier import Array, FourierBasis
from hbm.parallel import one_thread
from hbm.response.trace import trace_frequency
from hbm.sensitivity.derivatives import sensitivities
from models.jointed import AnyRig
from models.scalars import FORCE, HZ

FIRST_STRIDE = 1e-3
"""First step along a curve in search of its peak: of the frequency, or of the motion."""

LOCATED = 1e-6
"""A peak is located to this fraction of the motion, its height to the square of it."""

MOST_STRIDES = 30
MOST_HALVINGS = 12
"""How often a step of the parameter is halved before it is given up."""

NEWTON = NewtonSettings(tolerance=1e-10, max_iterations=15)


@dataclass(frozen=True, eq=False)
class Peaks:
    """A resonance peak against a number of the rig.

    Attributes
    ----------
    key, channel : str
        Key of the number that is varied, as in the rig file; and the channel whose peak it is.
    values : (p,) array
        Values of the number.
    points : tuple of PeriodicSolution
        The peaks.
    slope : (p,) array
        Derivative of the height to the number, exact: the shift of the peak does not count (envelope theorem).
    """

    key: str
    channel: str
    values: Array
    points: tuple[PeriodicSolution, ...]
    slope: Array

    def __repr__(self) -> str:
        """Ranges of the number, the frequency and the height."""
        unit = self.points[0][self.channel].unit
        return (
            f"one peak of {self.channel} over {self.key} from {self.values[0]:.6g} to {self.values[-1]:.6g}: "
            f"{self.hz[0]:.6g} to {self.hz[-1]:.6g} Hz, {self.height[0]:.4g} to {self.height[-1]:.4g} {unit}, "
            f"{len(self.points)} points"
        )

    @property
    def hz(self) -> Array:
        """Frequency of the peak, (p,) [Hz]."""
        return np.array([p.hz for p in self.points])

    @property
    def height(self) -> Array:
        """Peak of the channel there, (p,), in its unit."""
        return np.array([p[self.channel].peak for p in self.points])


class PeakLost(ConvergenceError):
    """A peak could not be followed further.

    Parameters
    ----------
    message : str
        One line: where, what was found, and the value of the number that was reached.
    peaks : Peaks
        Peaks of the values that were reached, and of the last one on the way.
    """

    def __init__(self, message: str, peaks: Peaks) -> None:
        super().__init__(message)
        self.peaks = peaks


@one_thread
def follow_peak(
    rig: AnyRig,
    values: Sequence[float],
    key: str = FORCE,
    *,
    channel: str = "drive",
    start: PeriodicSolution | None = None,
    harmonics: int | None = None,
    samples: int | None = None,
) -> Peaks:
    """Peak of a channel's frequency response, followed from value to value of the force or any number of the rig.

    Parameters
    ----------
    rig : Rig or JointedRig
    values : sequence of float
        Values of the number, in the order of travel; where a step is too long, it is halved.
    key : str
        Key of the number to vary, such as ``excitation.amplitude``, ``contact.friction.mu`` or ``joints.tip.mu``.
    channel : str
        Whose peak.
    start : PeriodicSolution, optional
        Near the peak at the first value; the largest point of the frequency response there where omitted.
    harmonics, samples : int, optional
        Highest harmonic H, and samples per period N_t; as of :func:`hbm.steady_state` where omitted.

    Returns
    -------
    Peaks

    Raises
    ------
    KeyError
        If the rig has no such number.
    InputError
        If it has no such channel, or there are no values.
    PeakLost
        If the peak is lost; it carries those found, up to the value that was reached. One that merges with another, on
        a detached curve, ends: the force along :func:`hbm.modes.backbone.phase_resonance` has a maximum there.
    continuation.ConvergenceError
        If the first peak cannot be found.

    Notes
    -----
    One peak is followed. Another one of the same curve may become larger on the way, and is not noticed; the largest at
    a value is found by :func:`hbm.frequency_response` there.
    """
    expect_rig(rig, "follow_peak", joints=True)
    if not len(values):
        raise InputError("follow_peak: no values; must be at least one")
    known = (*(c.name for c in rig.channels), *rig.computed)
    if channel not in known:
        raise InputError(f'follow_peak: channel = "{channel}"; must be one of {", ".join(known)}')
    basis, held = basis_for(rig, harmonics, samples, "follow_peak"), (key, channel)
    curve = _Curve(rig.with_number(key, values[0]), basis, *held)
    if start is None:
        points = trace_frequency(curve.rig, harmonics=basis.H, samples=basis.N_t).points
        start = max(points, key=lambda p: p[channel].peak)
    found = [(values[0], curve.peak(curve.near(start.state)))]
    for value in values[1:]:
        steps = [found[-1]]
        try:
            _follow(rig, steps, value, basis, held)
        except (ConvergenceError, ArithmeticError) as lost:
            said = f"{lost}; {key} reached {steps[-1][0]:.6g} on the way to {value:.6g}"
            raise PeakLost(said, _peaks(held, found + steps[1:][-1:])) from lost
        found.append(steps[-1])
    return _peaks(held, found)


def _peaks(held: tuple[str, str], found: Sequence[tuple[float, "_Place"]]) -> Peaks:
    points, slope = tuple(p.solution for _, p in found), np.array([p.slope for _, p in found])
    return Peaks(*held, np.array([value for value, _ in found], dtype=float), points, slope)


@dataclass(frozen=True, eq=False)
class _Place:
    """A point of a frequency response.

    Attributes
    ----------
    solution : PeriodicSolution
    y, tangent : (N + 1,) array
        Scaled unknowns and frequency, and the unit tangent.
    rise, slope : float
        Derivative of the channel's peak along the tangent, and to the number that is varied.
    by_key : State
        Derivative of the state to that number, across the curve: at a fixed frequency it has no bound beside a fold.
    """

    solution: PeriodicSolution
    y: Array
    tangent: Array
    rise: float
    slope: float
    by_key: State

    def ahead(self, step: float) -> State:
        """State predicted where the number has changed."""
        now, d = self.solution.state, self.by_key
        return State(now.Q + step * d.Q, now.T + step * d.T, now.Omega + step * d.Omega, now.F + step * d.F)


class _Curve:
    """A frequency response near its peak."""

    def __init__(self, rig: AnyRig, basis: FourierBasis, key: str, channel: str) -> None:
        self.rig, self.key, self.channel = rig, key, channel
        self.problem = balance_of(rig, basis)

    def near(self, state: State, tangent: Array | None = None) -> _Place:
        """The point of the curve across a tangent at a state, or at its frequency."""
        y = np.append(pad(self.problem, state), state.Omega / self.problem.Omega_ref)
        return self.at(y, np.append(np.zeros(len(y) - 1), 1.0) if tangent is None else tangent)

    def at(self, y: Array, row: Array) -> _Place:
        """The point of the curve in the hyperplane through `y` across `row`; its tangent points along `row`."""
        result = correct(self.problem, y, Border(row[:-1], float(row[-1])), NEWTON)
        if not result.converged:
            raise ConvergenceError(
                f"peak: no convergence near {self.problem.hz_at(float(y[-1])):.6g} Hz, last residual "
                f"{result.residual_norm:.2g}; {result.reason.value}"
            )
        solution = describe(self.problem, result.x, result.lam)
        change = sensitivities(self.rig, solution, (HZ, self.key))
        by_hz = np.append(*self.problem.pack(State(change.Q[..., 0], change.T[..., 0], 2 * np.pi, 0.0)))
        by_key = np.append(self.problem.pack(State(change.Q[..., 1], change.T[..., 1], 0.0, 0.0))[0], 0.0)
        length = np.copysign(np.linalg.norm(by_hz), by_hz @ row)
        tangent, by_hz_and_key = by_hz / length, change[self.channel].peak
        rise, along = float(by_hz_and_key[0] / length), float(by_key @ tangent)
        across = by_key - along * tangent
        moved = replace(self.problem.unpack(across[:-1], float(across[-1])), F=float(self.key == FORCE))
        return _Place(solution, result.state, tangent, rise, float(by_hz_and_key[1] - along * rise), moved)

    def peak(self, start: _Place) -> _Place:
        """The peak uphill of a point."""
        below, stride = start, FIRST_STRIDE * float(np.linalg.norm(start.y))
        for _ in range(MOST_STRIDES):
            uphill = below.tangent * np.copysign(1.0, below.rise)
            try:
                above = self.at(below.y + stride * uphill, uphill)
            except ConvergenceError:
                stride /= 4
                continue
            if above.rise <= 0.0:
                return self._top(below, above, uphill, stride)
            below, stride = above, 1.5 * stride
        raise ConvergenceError(
            f"peak: the {self.channel} still rises at {below.solution.hz:.6g} Hz, or cannot be solved"
        )

    def _top(self, below: _Place, above: _Place, uphill: Array, stride: float) -> _Place:
        """The peak between two points."""
        places = {0.0: below, stride: above}

        def rise(s: float) -> float:
            if s not in places:
                places[s] = self.at(below.y + s * uphill, uphill)
            return places[s].rise if s > 0.0 else abs(below.rise)

        top = brentq(rise, 0.0, stride, xtol=LOCATED * float(np.linalg.norm(below.y)))
        return places[top]


def _follow(
    rig: AnyRig, steps: list[tuple[float, _Place]], goal: float, basis: FourierBasis, held: tuple[str, str]
) -> None:
    """Append values of the number and their peaks, up to the goal; a step that is too long is halved."""
    step = goal - steps[-1][0]
    least = abs(step) / 2**MOST_HALVINGS
    while (value := steps[-1][0]) != goal:
        there = goal if abs(step) >= abs(goal - value) else value + step
        try:
            curve = _Curve(rig.with_number(held[0], there), basis, *held)
            peak = steps[-1][1]
            steps.append((there, curve.peak(curve.near(peak.ahead(there - value), peak.tangent))))
        except (ConvergenceError, ArithmeticError):
            step = (there - value) / 2
            if abs(step) < least:
                raise
        else:
            step *= 2
