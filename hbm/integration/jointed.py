"""Time integration of a body with joints, from rest or from a state, and its periodic steady states by shooting.

The second, independent way to a steady state: the same mechanics and laws as the harmonic balance, without Fourier
series.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hbm.balance.jointed import JointBalance
from hbm.balance.scaled import State
from hbm.balance.solution import PeriodicSolution
from hbm.channels import DERIVATIVES, Rates, late
from hbm.errors import InputError, expect_frequency, expect_joints, expect_whole
from hbm.integration.history import History, Signal, differences, expect_divisor, expect_motion_of
from hbm.integration.jointmarch import FEWEST_STEPS, LEAST_STEPS, JointMarcher, resolving_steps
from hbm.integration.jointstep import Layout
from models.jointed import JointedRig
from models.parts import UNITS, Channel
from models.structure import Array


@dataclass(frozen=True, eq=False, repr=False)
class JointHistory(History):
    """A computed motion of a rig with joints.

    Attributes
    ----------
    rig : JointedRig
    hz, level : float
        Frequency [Hz] and amplitude [N] of the cosine force.
    time : (N,) array
        Equally spaced [s].
    states : (N, size) array
        Modes, their velocities, forces at the ports, memory of the laws.
    force_rates : (2, N, m) array
        First and second derivatives to time of the forces at the ports [N/s, N/s2], from every step of the march.
    samples_per_period : int
    largest_residual : float
        Largest residual of the implicit relation at the joints, in units of the excitation.
    """

    rig: JointedRig
    hz: float
    level: float
    time: Array
    states: Array
    force_rates: Array
    samples_per_period: int
    largest_residual: float

    @property
    def q(self) -> Array:
        """Modal coordinates, (N, n)."""
        return self.states[:, : self.rig.structure.n]

    @property
    def qdot(self) -> Array:
        """Modal velocities, (N, n)."""
        n = self.rig.structure.n
        return self.states[:, n : 2 * n]

    @property
    def f(self) -> Array:
        """Forces at the ports, (N, m) [N]."""
        n = self.rig.structure.n
        return self.states[:, 2 * n : 2 * n + self.rig.ports]

    @cached_property
    def qddot(self) -> Array:
        """Modal accelerations, (N, n)."""
        s = self.rig.structure
        driven = self.f @ s.joints + np.outer(self._force(), s.excitation)
        return np.asarray(driven - self.qdot @ s.damping.T - self.q * s.omega_n**2)

    def _seen(self, row: Array, by_joints: Array, by_force: float, derivative: int) -> Array:
        """A displacement of the body, or its derivative, (N,): of the modes and of what they leave out."""
        modes = (self.q, self.qdot, self.qddot)[derivative]
        forces = (self.f, *self.force_rates)[derivative]
        return np.asarray(modes @ row + forces @ by_joints + by_force * self._force(derivative))

    def _there(self, name: str) -> Array:
        """Quantity at a channel of the rig, (N,)."""
        s, seen = self.rig.structure, [c.name for c in self.rig.response_channels]
        if name not in seen:
            return self._force()
        i = seen.index(name)
        derivative = DERIVATIVES[self.rig.response_channels[i].quantity]
        return self._seen(s.channels[i], s.channels_by_joints[i], float(s.channels_by_force[i]), derivative)

    @cached_property
    def channels(self) -> dict[str, Signal]:
        """The rig's channels, then `drive`, and motion and force at every port of every joint."""
        s, rig = self.rig.structure, self.rig
        signals = {c.name: Signal(late(c, self._there(c.name), self.dt), UNITS[c.quantity]) for c in rig.channels}
        signals["drive"] = Signal(self._seen(s.excitation, s.flexibility_to_force, s.drive_by_force, 0), "m")
        motion = self.q @ s.joints.T + self.f @ s.flexibility + np.outer(self._force(), s.flexibility_to_force)
        for i, (name, force, units) in enumerate(zip(rig.motions, rig.forces, rig.units, strict=True)):
            signals[name], signals[force] = Signal(motion[:, i], units[0]), Signal(self.f[:, i], units[1])
        return signals

    def _read(self, sensor: Channel, spectrum: Callable[[Array], Rates], rates: Rates) -> Rates:
        """Spectrum of the modes; kinks of forces are differentiated in the harmonics, where samples would stand out."""
        s, i = self.rig.structure, self.rig.response_channels.index(sensor)
        derivative = DERIVATIVES[sensor.quantity]
        beyond = self.f @ s.channels_by_joints[i] + s.channels_by_force[i] * self._force()
        modes = (self.q, self.qdot, self.qddot)[derivative] @ s.channels[i]
        return spectrum(modes) + rates**derivative * spectrum(beyond)


def state_at_phase_zero(problem: JointBalance, state: State) -> Array:
    """State of a time integration (size,) at phase 0 of the force, on a solution of a balance."""
    basis = problem.basis
    f, _, _ = problem.forces(state)
    start = basis.synthesis[0]
    velocity = state.Omega * (start @ basis.derivative(state.Q))
    found = [j.at_first() for j in problem.joints]
    places = Layout.of(problem.structure.n, [j.law for j in problem.rig.joints]).joints
    seen = [signals[list(at.used)] for at, (_, signals) in zip(places, found, strict=True)]
    return np.concatenate([start @ state.Q, velocity, f[0], *(z for z, _ in found), *seen])


def simulate_joints(
    rig: JointedRig,
    hz: float,
    *,
    periods: int,
    level: float | None = None,
    steps_per_period: int | None = None,
    start: Array | PeriodicSolution | None = None,
    last_periods: int | None = None,
    every: int = 1,
    progress: Callable[[float], None] | None = None,
) -> JointHistory:
    """Motion of a rig with joints under the force level cos(2 pi hz t).

    Parameters
    ----------
    rig : JointedRig
    hz : float
        Frequency [Hz], > 0.
    periods : int
        How many are marched.
    level : float, optional
        Force amplitude [N]; the rig's unless given.
    steps_per_period : int, optional
        The error falls with its square; 512, or as many more as resolve the highest mode, unless given.
    start : (size,) array or PeriodicSolution, optional
        A state at phase 0 of the force, such as a row of :attr:`JointHistory.states`, or a motion of as many modes
        and of the same joints, whose state there it is; from rest unless given.
    last_periods : int, optional
        Keep these only; everything unless given.
    every : int
        Keep one of so many steps; a divisor of `steps_per_period`.
    progress : callable, optional
        Told the time reached [s] after each period.

    Raises
    ------
    InputError
        If `every` does not divide the steps of a period.
    ArithmeticError
        If a step cannot be solved, or is too long for the joints.
    """
    steps = resolving_steps(rig, hz, LEAST_STEPS) if steps_per_period is None else steps_per_period
    expect_divisor(every, steps)
    marcher = JointMarcher(rig, hz, rig.excitation.amplitude if level is None else level, steps)
    marcher.refuse_growth()
    x = _begun(marcher, start, "simulate")
    first = 0 if last_periods is None else max(0, periods - last_periods)
    at, largest = marcher.step.layout.f, 0.0
    for i in range(periods):
        if i <= first:
            kept, forces = [x[None]], [x[None, at]]
        X, residual = marcher.period(x)
        x, largest = X[-1], max(largest, residual)
        if i >= first:
            kept.append(X[every - 1 :: every])
            forces.append(X[:, at])
        if progress is not None:
            progress((i + 1) / hz)
    states, rates = np.concatenate(kept), _rates(np.concatenate(forces), marcher.dt)
    time = np.asarray(first / hz + every * marcher.dt * np.arange(len(states)), dtype=float)
    return JointHistory(rig, hz, marcher.level, time, states, rates[:, ::every], steps // every, largest)


def _rates(forces: Array, dt: float) -> Array:
    """First and second derivatives to time of forces (N, m), (2, N, m)."""
    rates = np.zeros((2, *forces.shape))
    for i, force in enumerate(forces.T):
        rates[:, :, i] = differences(force, dt)
    return rates


def _begun(marcher: JointMarcher, start: Array | PeriodicSolution | None, where: str) -> Array:
    """State that a march begins with: at rest unless given."""
    if start is None:
        return np.zeros(marcher.size)
    if isinstance(start, PeriodicSolution):
        expect_motion_of(marcher.rig, start, where)
        return state_at_phase_zero(JointBalance(marcher.rig, start.basis), start.state)
    if np.shape(start) != (marcher.size,):
        raise InputError(f"{where}: start has {np.size(start)} values; this rig and its joints need {marcher.size}")
    return start


@dataclass(frozen=True, eq=False)
class JointPeriod:
    """A steady state found by shooting.

    Attributes
    ----------
    history : JointHistory
        One period.
    monodromy : (size, size) array
        Derivative of the period map.
    closure : float
        Change of the state over the period, each part relative to its largest value.
    iterations : int
    """

    history: JointHistory
    monodromy: Array
    closure: float
    iterations: int


class _Period:
    """A period marched from a state, and its closure error."""

    def __init__(self, marcher: JointMarcher, x: Array, scale: Array | None = None) -> None:
        self.marcher, self.x = marcher, x
        self.X, self.residual = marcher.period(x)
        self.scale: Array = self._reached() if scale is None else scale

    def _reached(self) -> Array:
        """Unit of each entry of the state: what modes, velocities and forces reach; for the rest what changes a force.

        An anchor that never moves has no size of its own.
        """
        n, forces = self.marcher.rig.structure.n, self.marcher.step.layout.f
        scale = np.maximum(np.abs(self.X).max(axis=0), np.abs(self.x))
        for group in (slice(0, n), slice(n, 2 * n), forces):
            scale[group] = scale[group].max()
        pull = np.abs(self._steps()[:, forces, forces.stop :]).max(axis=(0, 1))
        largest = scale[forces].max()
        needed = np.divide(largest, pull, out=np.zeros_like(pull), where=pull > 0.0)
        scale[forces.stop :] = np.maximum(scale[forces.stop :], needed)
        return np.where(scale > 0.0, scale, 1.0)

    def _steps(self) -> Array:
        marcher = self.marcher
        return marcher.step.jacobians(np.vstack([self.x, self.X[:-1]]), self.X, marcher.told)

    @property
    def closure(self) -> float:
        """Largest change of the state over the period, in units of what each entry reaches."""
        return float(np.abs((self.X[-1] - self.x) / self.scale).max())

    def improved(self) -> "_Period":
        """A Newton step, shortened while it does not help; where the period leads to if no fraction does."""
        scale = self.scale
        matrix = (self.marcher.monodromy(self.x, self.X) - np.eye(len(scale))) * scale / scale[:, None]
        step = scale * np.linalg.lstsq(matrix, (self.x - self.X[-1]) / scale, rcond=1e-10)[0]
        for fraction in (1.0, 0.5, 0.25, 0.125):
            try:
                trial = _Period(self.marcher, self.x + fraction * step, scale)
            except ArithmeticError:  # too far out for its steps to be solved
                continue
            if trial.closure < self.closure:
                return trial
        return _Period(self.marcher, self.X[-1], scale)


def joint_steady_state(
    rig: JointedRig,
    hz: float,
    *,
    level: float | None = None,
    steps_per_period: int | None = None,
    start: Array | PeriodicSolution | None = None,
    tolerance: float = 1e-9,
    max_iterations: int = 30,
) -> JointPeriod:
    """Periodic motion of a rig with joints by Newton on the period map; from 30 periods after rest unless given.

    Arguments as of :func:`simulate_joints`, but 1024 steps per period or more unless given; where a joint never slips
    the solution nearest to the start is taken.

    Raises
    ------
    ArithmeticError
        If a step cannot be solved, or the motion does not close to 1e-6.
    """
    expect_joints(rig, "joint_steady_state")
    expect_frequency(hz, "joint_steady_state")
    if steps_per_period is not None:
        expect_whole(steps_per_period, "steps_per_period", "joint_steady_state", FEWEST_STEPS)
    steps = resolving_steps(rig, hz, 2 * LEAST_STEPS) if steps_per_period is None else steps_per_period
    marcher = JointMarcher(rig, hz, rig.excitation.amplitude if level is None else level, steps)
    marcher.refuse_growth()
    x = _begun(marcher, start, "joint_steady_state")
    for _ in range(30 if start is None else 0):
        x = marcher.period(x)[0][-1]
    period = _Period(marcher, x)
    for iterations in range(max_iterations + 1):
        if period.closure < tolerance or iterations == max_iterations:
            break
        period = period.improved()
    x, X, closure = period.x, period.X, period.closure
    if closure > 1e-6:
        raise ArithmeticError(
            f"{rig.name} at {hz:g} Hz: no periodic motion after {iterations} Newton steps, closure {closure:.1e}; "
            "start from a harmonic balance solution, or march longer"
        )
    states = np.vstack([x, X[:-1]])
    time = np.asarray(marcher.dt * np.arange(len(states)), dtype=float)
    rates = _rates(states[:, marcher.step.layout.f], marcher.dt)
    history = JointHistory(rig, hz, marcher.level, time, states, rates, steps, period.residual)
    return JointPeriod(history, marcher.monodromy(x, X), closure, iterations)
