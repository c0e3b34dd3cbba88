"""Time integration of a rig, from rest or from a state, and its periodic steady states by shooting.

The second, independent way to a steady state: the same mechanics and the same friction laws as the
harmonic balance, without its Fourier series. :func:`simulate` marches, :func:`steady_state` solves
for the state that a period maps on itself; both return a :class:`hbm.integration.history.TimeHistory`.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import overload

import numpy as np

from hbm.aft.recurrence import monodromy
from hbm.balance.solution import PeriodicSolution
from hbm.errors import InputError, expect_frequency, expect_positive, expect_rig, expect_whole
from hbm.integration.handover import state_at_phase_zero
from hbm.integration.history import State, TimeHistory, differences, expect_divisor, expect_motion_of
from hbm.integration.jointed import JointHistory, simulate_joints
from hbm.integration.jointmarch import FEWEST_STEPS, LEAST_STEPS
from hbm.integration.march import Recorder, march
from hbm.integration.timestep import Stepper
from hbm.parallel import one_thread
from models import Rig
from models.jointed import AnyRig, JointedRig
from models.structure import Array

DEFAULT_PERIODS = 50
STEPS = (LEAST_STEPS, 2 * LEAST_STEPS, 4 * LEAST_STEPS, 8 * LEAST_STEPS)
"""Steps per period tried in turn unless they are given."""

MOST_MODES = 120
"""Modes of a foreshortened beam: 1 GB; what a step takes grows with their square."""
ANCHOR_MOBILITY = 1e-3  # cost of moving q and q' relative to the states of the friction law


@overload
def simulate(
    rig: Rig,
    hz: float,
    *,
    duration: float | None = None,
    level: float | None = None,
    steps_per_period: int | None = None,
    start: State | PeriodicSolution | None = None,
    last_periods: int | None = None,
    every: int = 1,
    progress: Callable[[float], None] | None = None,
) -> TimeHistory: ...


@overload
def simulate(
    rig: JointedRig,
    hz: float,
    *,
    duration: float | None = None,
    level: float | None = None,
    steps_per_period: int | None = None,
    start: Array | PeriodicSolution | None = None,
    last_periods: int | None = None,
    every: int = 1,
    progress: Callable[[float], None] | None = None,
) -> JointHistory: ...


@one_thread
def simulate(
    rig: AnyRig,
    hz: float,
    *,
    duration: float | None = None,
    level: float | None = None,
    steps_per_period: int | None = None,
    start: State | Array | PeriodicSolution | None = None,
    last_periods: int | None = None,
    every: int = 1,
    progress: Callable[[float], None] | None = None,
) -> TimeHistory | JointHistory:
    """Motion of a rig under the force level cos(2 pi hz t).

    Parameters
    ----------
    rig : Rig
    hz : float
        Frequency [Hz], > 0.
    duration : float, optional
        Duration [s], rounded to whole steps, or of a rig with joints to whole periods, one at least; 50 periods unless
        given.
    level : float, optional
        Force amplitude [N]; the rig's unless given.
    steps_per_period : int, optional
        The error falls with its square, or in proportion where friction jumps (set-valued laws without compliance). 512
        unless given, and more where they cannot be solved; with joints as many as resolve the highest mode.
    start : State or PeriodicSolution, optional
        Initial state, at rest unless given; or a motion, such as a point of a curve or of a nonlinear mode, whose state
        at the crest of the force it is. The motion may be of another rig that has as many modes, and joints of the same
        names, numbers of places and order; of a contact, a law with as many states. Nothing else is compared. A rig
        with joints takes (size,) numbers in place of a State, see :func:`hbm.integration.jointed.simulate_joints`.
    last_periods : int, optional
        Number of periods at the end to keep; everything unless given.
    every : int
        Keep one of so many steps; a divisor of `steps_per_period`. Nothing is filtered: what is above half the rate
        that is left folds back into the harmonics.
    progress : callable, optional
        Called with the time reached [s] after each period.

    Returns
    -------
    TimeHistory, or JointHistory
        JointHistory for a rig with joints, over whole periods. The first instant is included.

    Raises
    ------
    ValueError
        If an argument is out of range, or `start` is of other modes or joints.
    ArithmeticError
        If a step cannot be solved, or no stable scheme exists at this step.
    """
    expect_rig(rig, "simulate", joints=True)
    expect_frequency(hz, "simulate")
    duration = DEFAULT_PERIODS / hz if duration is None else duration
    expect_positive(duration, "duration", "simulate", "s")
    if steps_per_period is not None:
        expect_whole(steps_per_period, "steps_per_period", "simulate", FEWEST_STEPS)
    periods = max(1, round(duration * hz))
    if last_periods is not None:
        expect_whole(last_periods, "last_periods", "simulate", most=periods)
    if isinstance(rig, JointedRig):
        if isinstance(start, State):
            accepted = "must be (size,) numbers, or a PeriodicSolution"
            raise ValueError(f"simulate: start is a state of a rig with [contact]; {accepted}")
        over = partial(simulate_joints, periods=periods, steps_per_period=steps_per_period, progress=progress)
        return over(rig, hz, level=level, start=start, last_periods=last_periods, every=every)
    if isinstance(start, PeriodicSolution):
        expect_motion_of(rig, start, "simulate")
        start = state_at_phase_zero(start)
    if start is not None and not isinstance(start, State):
        raise InputError(
            f"simulate: start = {start!r:.80}; must be a State of a rig with [contact], or a PeriodicSolution"
        )
    state = State.at_rest(rig) if start is None else start
    level = rig.excitation.amplitude if level is None else level
    _check(rig, STEPS[0] if steps_per_period is None else steps_per_period, state, every)

    def marched(steps_per_period: int) -> TimeHistory:
        stepper = Stepper.stable(rig, hz, level, steps_per_period, _phase(hz, state.time))
        from_here = _pressed(stepper, state) if start is None else state
        steps = round(duration * hz * steps_per_period)
        first = 0 if last_periods is None else max(0, steps - last_periods * steps_per_period)
        return march(stepper, from_here, steps, first=first, every=every, progress=progress)

    if steps_per_period is not None:
        return marched(steps_per_period)
    for steps in STEPS[:-1]:
        with suppress(ArithmeticError):  # a step that was not solved asks for a shorter one
            return marched(steps)
    return marched(STEPS[-1])


def _check(rig: Rig, steps_per_period: int, start: State, every: int) -> None:
    size = State.at_rest(rig).flat.size
    expect_divisor(every, steps_per_period)
    if rig.contact.foreshortening and rig.structure.n > MOST_MODES:
        raise InputError(
            f"simulate: modes = {rig.structure.n}; must be <= {MOST_MODES}: a beam drawn in as it bends couples "
            "each with all others at every step; those left out answer statically"
        )
    if start.flat.size != size:
        raise ValueError(f"simulate: start has {start.flat.size} values; this rig and its friction law need {size}")


def _pressed(stepper: Stepper, rest: State) -> State:
    """State just after the force has come on: the modes left out follow it at once and load the contact."""
    if stepper.rig.structure.residual.slip_by_force == 0.0:
        return rest
    n = stepper.rig.structure.n
    instant = replace(stepper, steps_per_period=stepper.steps_per_period * 1_000_000)
    X, _, _ = instant.march(rest.flat, 1)
    return replace(State.from_flat(X[0], n, rest.time), q=rest.q, qdot=rest.qdot)


def _phase(hz: float, time: float) -> float:
    """Phase of the force at `time` [s], in 0..2 pi."""
    return float(2 * np.pi * np.mod(hz * time, 1.0))


@dataclass(frozen=True, eq=False)
class PeriodicMotion:
    """A steady state found by shooting.

    Attributes
    ----------
    history : TimeHistory
        One period; `history.state` is the state the period maps on itself.
    monodromy : (size, size) array
        Derivative of the period map with respect to (q, q', friction, z).
    converged : bool
    closure : float
        Change of the state over the period, each of q, q', friction and z relative to its largest value.
    iterations : int
        Newton iterations.
    """

    history: TimeHistory
    monodromy: Array
    converged: bool
    closure: float
    iterations: int

    @property
    def multipliers(self) -> Array:
        """Floquet multipliers, (size,) complex, largest first.

        The motion is stable where all lie inside the unit circle. A contact that never slips has one at 1: its
        mean friction is what its history left.
        """
        values = np.linalg.eigvals(self.monodromy).astype(complex)
        return np.asarray(values[np.argsort(-np.abs(values))])


@one_thread
def steady_state(
    rig: Rig,
    hz: float,
    *,
    level: float | None = None,
    steps_per_period: int = 1024,
    start: State | None = None,
    tolerance: float = 1e-9,
    max_iterations: int = 30,
) -> PeriodicMotion:
    """Periodic motion of a rig under the force level cos(2 pi hz t), by Newton on the period map.

    The map is piecewise smooth; its derivative is that of the steps, exact. Where a contact never slips, the
    solution nearest to the start is taken.

    Parameters
    ----------
    rig, hz, level, steps_per_period
        As in :func:`simulate`.
    start : State, optional
        A guess at phase 0 of the force, such as a harmonic balance solution; 50 periods from rest unless given.
    tolerance : float
        On :attr:`PeriodicMotion.closure`.
    max_iterations : int

    Returns
    -------
    PeriodicMotion
        Its best, with `converged` false, where the iterations end without closing.

    Raises
    ------
    ValueError, ArithmeticError
        As :func:`simulate`.
    """
    expect_rig(rig, "steady_state")
    expect_frequency(hz, "steady_state")
    expect_whole(steps_per_period, "steps_per_period", "steady_state", FEWEST_STEPS)
    if start is None:
        start = simulate(rig, hz, level=level, steps_per_period=steps_per_period, last_periods=1).state
    start = replace(start, time=start.time - np.floor(start.time * hz + 0.5 / steps_per_period) / hz)
    level = rig.excitation.amplitude if level is None else level
    _check(rig, steps_per_period, start, 1)
    stepper = Stepper.stable(rig, hz, level, steps_per_period, _phase(hz, start.time))
    period = _Period(stepper, start.flat)
    iterations = 0
    while period.closure > tolerance and iterations < max_iterations:
        period = _improved(period)
        iterations += 1
    return PeriodicMotion(
        history=_periodic_history(period, start.time),
        monodromy=period.monodromy,
        converged=period.closure <= tolerance,
        closure=period.closure,
        iterations=iterations,
    )


class _Period:
    """One period marched from a state, with its closure error in units of `scale` (size,)."""

    def __init__(self, stepper: Stepper, x: Array, scale: Array | None = None) -> None:
        self.stepper, self.x = stepper, x
        self.X, self.T, self.residual = stepper.march(x, stepper.steps_per_period)
        self.scale = _scale(self) if scale is None else scale

    def from_state(self, x: Array) -> "_Period":
        """The period from another state."""
        return _Period(self.stepper, x, self.scale)

    @cached_property
    def steps(self) -> Array:
        """Jacobian of each step, (steps, size, size)."""
        return self.stepper.linearised(self.x, self.X, self.T)

    @property
    def gap(self) -> Array:
        """Change of the state over the period."""
        return np.asarray(self.X[-1] - self.x)

    @property
    def closure(self) -> float:
        """Largest scaled change."""
        return float(np.max(np.abs(self.gap / self.scale)))

    @property
    def monodromy(self) -> Array:
        """Derivative of the period map, the product of those of its steps."""
        return monodromy(self.steps)


def _scale(period: _Period) -> Array:
    """Unit of each entry of the state: what q, q', T reach in the period; for z also what it takes to change T by that.

    An anchor that never moves has no size of its own.
    """
    n = period.stepper.rig.structure.n
    largest = np.max(np.abs(np.vstack([period.x, period.X])), axis=0)
    largest[:n], largest[n : 2 * n] = np.max(largest[:n]), np.max(largest[n : 2 * n])
    pull = np.max(np.abs(period.steps[:, 2 * n, 2 * n + 1 :]), axis=0)
    needed = np.divide(largest[2 * n], pull, out=np.zeros_like(pull), where=pull > 0.0)
    largest[2 * n + 1 :] = np.maximum(largest[2 * n + 1 :], needed)
    return np.where(largest > 0.0, largest, 1.0)


def _improved(period: _Period) -> _Period:
    """A Newton step, halved while it does not help; the state the period leads to if no fraction does."""
    scale, unknowns = period.scale, period.scale.copy()
    # a stuck contact leaves the map without opinion on its mean friction: least squares, and let z stay where it is
    unknowns[2 * period.stepper.rig.structure.n + 1 :] *= ANCHOR_MOBILITY
    matrix = (period.monodromy - np.eye(len(scale))) * unknowns / scale[:, None]
    step = np.linalg.lstsq(matrix, -period.gap / scale, rcond=1e-10)[0] * unknowns
    for fraction in (1.0, 0.5, 0.25, 0.125):
        try:
            trial = period.from_state(period.x + fraction * step)
        except ArithmeticError:  # too far out for its steps to be solved
            continue
        if trial.closure < period.closure:
            return trial
    return period.from_state(period.X[-1])


def _periodic_history(period: _Period, time: float) -> TimeHistory:
    """One period, its first sample the state that the last step leads to."""
    s, n = period.stepper, period.stepper.rig.structure.n
    recorder = Recorder(s, State.from_flat(period.x, n, time), 0, 1)
    recorder.add(period.X, period.T, period.residual)
    T = np.roll(period.T, 1)
    rate, curvature = differences(np.concatenate([T[-1:], T, T[:1]]), s.dt)
    return replace(
        recorder.history(),
        time=np.asarray(time + s.dt * np.arange(s.steps_per_period), dtype=float),
        q=np.roll(period.X[:, :n], 1, axis=0),
        qdot=np.roll(period.X[:, n : 2 * n], 1, axis=0),
        friction=T,
        friction_rate=rate[1:-1],
        friction_curvature=curvature[1:-1],
        state=State.from_flat(period.X[-1], n, time),
    )
