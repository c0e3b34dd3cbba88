"""Time histories: the motion of a rig sampled in time, and every channel that follows from it.

:class:`State` is where a march starts and stops; :class:`TimeHistory` is what it leaves behind.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hbm.aft.step import law_step
from hbm.balance.balanced import expect_joints_of
from hbm.balance.elements import ForcesInTime, forces_in_time
from hbm.balance.solution import PeriodicSolution
from hbm.channels import DERIVATIVES, Rates, late, turn
from hbm.errors import InputError, expect_whole
from models import Channel, Rig
from models.jointed import AnyRig
from models.parts import UNITS
from models.structure import Array


@dataclass(frozen=True, eq=False)
class State:
    """State of a rig at one instant.

    Attributes
    ----------
    q, qdot : (n,) array
        Modal coordinates and velocities.
    friction : float
        T [N].
    z : (memory,) array
        Memory of the friction law, :meth:`hbm.aft.step.LawStep.memory`.
    time : float
        [s]; the fundamental of the force is level cos(2 pi hz time).
    """

    q: Array
    qdot: Array
    friction: float
    z: Array
    time: float = 0.0

    @staticmethod
    def at_rest(rig: Rig) -> "State":
        """State at rest, with the contact in its virgin state."""
        n = rig.structure.n
        return State(np.zeros(n), np.zeros(n), 0.0, np.zeros(law_step(rig.contact.law).memory_size))

    @property
    def flat(self) -> Array:
        """(q, q', T, z), (2n + 1 + states,)."""
        return np.concatenate([self.q, self.qdot, [self.friction], self.z])

    @staticmethod
    def from_flat(x: Array, modes: int, time: float) -> "State":
        """Inverse of :attr:`flat`."""
        return State(x[:modes], x[modes : 2 * modes], float(x[2 * modes]), x[2 * modes + 1 :], time)


class Signal(NamedTuple):
    """Values of one channel, (N,), and their unit."""

    values: Array
    unit: str


def expect_divisor(every: int, steps_per_period: int) -> None:
    """Refuse to keep one of so many steps where that is not the same in every period.

    Raises
    ------
    InputError
        With both numbers.
    """
    expect_whole(every, "every", "simulate")
    if steps_per_period % every:
        raise InputError(f"simulate: every = {every}; must divide {steps_per_period} steps per period")


def expect_motion_of(rig: AnyRig, motion: PeriodicSolution, where: str) -> None:
    """Refuse to begin with a motion of other joints, or of another number of modes.

    Raises
    ------
    InputError
        With the first joint that differs, or both numbers of modes.
    """
    expect_joints_of(rig, motion, where)
    modes = motion.state.Q.shape[1]
    if modes != rig.structure.n:
        accepted = f"must have {rig.structure.n} as {rig.name}; simulate the rig of its curve, curve.rig"
        raise InputError(f"{where}: start has {modes} modes; {accepted}")


def differences(T: Array, dt: float) -> tuple[Array, Array]:
    """First and second derivative of a signal, central inside, those of the neighbours or one-sided at the ends."""
    if len(T) < 3:
        return np.zeros_like(T), np.zeros_like(T)
    curvature = np.diff(T, 2) / dt**2
    return np.gradient(T, dt), np.concatenate([curvature[:1], curvature, curvature[-1:]])


def acceleration(rig: Rig, q: Array, qdot: Array, T: Array, F: Array) -> Array:
    """Modal accelerations from the equation of motion (4), (N, n).

    Parameters
    ----------
    rig : Rig
    q, qdot : (N, n) array
        Modal coordinates and velocities.
    T, F : (N,) array
        Friction and excitation [N].
    """
    return _acceleration(rig, q, qdot, T, F, forces_in_time(rig, q, qdot, F))


def _acceleration(rig: Rig, q: Array, qdot: Array, T: Array, F: Array, elements: ForcesInTime) -> Array:
    """Modal acceleration where the forces of the elements are known."""
    s = rig.structure
    pushed = s.slip_row - q @ s.shortening
    driven = F[:, None] * s.excitation + T[:, None] * pushed + elements.on_modes
    return np.asarray(driven - s.damping * qdot - s.omega_n**2 * q)


def normal_reaction(rig: Rig, q: Array, qdot: Array, T: Array, F: Array) -> Array:
    """Normal reaction of the support, (N,) [N]; arguments as in :func:`acceleration`."""
    r, elements = rig.structure.reaction, forces_in_time(rig, q, qdot, F)
    moved = _acceleration(rig, q, qdot, T, F, elements) @ r.inertia + qdot @ r.damping + q @ r.stiffness
    pushed = T * (q @ r.stretch - r.friction_lever) - r.force_share * F - elements.on_support
    return np.asarray(rig.contact.normal_load + moved + pushed)


class History:
    """A computed motion under the force level cos(2 pi hz t), equally spaced in time."""

    rig: AnyRig
    hz: float
    level: float
    time: Array
    samples_per_period: int

    def __repr__(self) -> str:
        """Summary in words."""
        return (
            f"motion at {self.hz:.6g} Hz, {self.level:g} N, {self.time[0]:.6g} to {self.time[-1]:.6g} s, "
            f"{len(self.time)} samples, {self.samples_per_period} a period"
        )

    @property
    def channels(self) -> dict[str, Signal]:
        """What is measured, then what else is computed."""
        raise NotImplementedError

    @property
    def dt(self) -> float:
        """Time from sample to sample [s]."""
        return 1.0 / (self.hz * self.samples_per_period)

    def _force(self, derivative: int = 0) -> Array:
        """Excitation or its derivative to time, (N,) [N]."""
        Omega = 2 * np.pi * self.hz
        excitation = replace(self.rig.excitation, amplitude=self.level)
        return np.asarray(Omega**derivative * excitation.force(Omega * self.time, derivative))

    def coefficients(self, channel: str, H: int, periods: int = 1) -> Array:
        """Fourier coefficients of a channel over the last whole periods, phase reference the cosine force.

        Parameters
        ----------
        channel : str
            A key of :attr:`channels`.
        H : int
            Highest harmonic, below half the samples per period.
        periods : int
            How many periods are averaged.

        Returns
        -------
        (2H+1,) array
            [a_0, a_1..a_H, b_1..b_H] in the channel's unit.

        Raises
        ------
        ValueError
            If the history is shorter than that, or H too high for its sampling.
        """
        N_t = self.samples_per_period
        if not 0 <= H < N_t / 2 or not 0 < periods * N_t <= len(self.time):
            raise ValueError(
                f"coefficients: {H} harmonics over {periods} periods of {len(self.time)} samples, {N_t} per period; "
                "must be fewer than half the samples of a period, and no more periods than there are"
            )

        def spectrum(values: Array) -> Rates:
            return np.asarray(np.fft.rfft(values[-periods * N_t :].reshape(periods, N_t).mean(axis=0))[: H + 1] / N_t)

        rates = 2j * np.pi * self.hz * np.arange(H + 1)
        sensor = next((c for c in self.rig.response_channels if c.name == channel), None)
        if sensor is None:
            found = spectrum(self.channels[channel].values)
        else:  # a delay turns harmonics exactly, where samples are read between
            found = self._read(sensor, spectrum, rates) * turn(sensor, rates)
        found = found * np.exp(-rates * self.time[-periods * N_t])
        return np.concatenate([[found[0].real], 2 * found[1:].real, -2 * found[1:].imag])

    def _read(self, sensor: Channel, spectrum: Callable[[Array], Rates], rates: Rates) -> Rates:
        """Spectrum (H+1,) of the quantity of a response channel."""
        raise NotImplementedError

    @cached_property
    def steadiness(self) -> float:
        """Change of the drive displacement over the last two periods, relative to its largest value.

        nan where the history holds fewer than two, as with ``last_periods=1``.
        """
        return steadiness(self.channels["drive"].values, self.samples_per_period)


@dataclass(frozen=True, eq=False)
class TimeHistory(History):
    """A computed motion.

    Attributes
    ----------
    rig : Rig
    hz, level : float
        Frequency [Hz] and amplitude [N] of the cosine force.
    time : (N,) array
        Equally spaced [s].
    q, qdot : (N, n) array
        Modal coordinates and velocities.
    friction : (N,) array
        T [N].
    friction_rate, friction_curvature : (N,) array
        dT/dt [N/s] and its rate [N/s2], by central differences of the steps.
    samples_per_period : int
    state : State
        At the end of the march, to go on from.
    lift_off : float or None
        First time at which the reaction was negative [s], among all steps marched: from there on the tip
        would have left the support and the motion is not to be trusted.
    largest_residual : float
        Largest residual of the implicit relation at the contact [N].
    """

    rig: Rig
    hz: float
    level: float
    time: Array
    q: Array
    qdot: Array
    friction: Array
    friction_rate: Array
    friction_curvature: Array
    samples_per_period: int
    state: State
    lift_off: float | None
    largest_residual: float

    def __repr__(self) -> str:
        """Summary in words."""
        lifts = "" if self.lift_off is None else f"; the tip lifts off at {self.lift_off:.6g} s"
        return super().__repr__() + lifts

    @cached_property
    def force(self) -> Array:
        """Excitation, (N,) [N]."""
        return self._force(0)

    @cached_property
    def qddot(self) -> Array:
        """Modal accelerations, (N, n)."""
        return acceleration(self.rig, self.q, self.qdot, self.friction, self.force)

    @cached_property
    def force_rate(self) -> Array:
        """Rate of the excitation, (N,) [N/s]."""
        return self._force(1)

    def _beyond(self, place: int, derivative: int = 0) -> Array:
        """Motion that elements add to drive (0) or a response channel (from 1) beyond the modes, or its rate, (N,)."""
        moved = self._moved[:, place]
        return (moved, *differences(moved, self.dt))[derivative]

    @cached_property
    def _moved(self) -> Array:
        return forces_in_time(self.rig, self.q, self.qdot, self.force).moved

    def _there(self, channel: Channel) -> Array:
        """Quantity at a channel, (N,), by the modes and the static response of those left out."""
        if channel.quantity == "force":
            return self.force
        modes, force, friction = {
            "displacement": (self.q, self.force, self.friction),
            "velocity": (self.qdot, self.force_rate, self.friction_rate),
            "acceleration": (self.qddot, self._force(2), self.friction_curvature),
        }[channel.quantity]
        by_force, by_friction = self.rig.structure.residual.channels.get(channel.name, (0.0, 0.0))
        row = self.rig.structure.channel_rows[channel.name]
        place = 1 + [c.name for c in self.rig.response_channels].index(channel.name)
        beyond = self._beyond(place, DERIVATIVES[channel.quantity])
        return np.asarray(modes @ row + by_force * force + by_friction * friction + beyond)

    @cached_property
    def channels(self) -> dict[str, Signal]:
        """The rig's channels, then `drive`, `slip`, `slip_velocity`, `friction` and `normal`.

        Slip is the displacement of the contact point, u + C_res T; slip velocity is its rate. Displacements include the
        static response of the modes left out. Accelerations contain the curvature of T in this way, so that one sample
        stands out where T has a kink; their harmonics converge.
        """
        s = self.rig.structure
        signals = {c.name: Signal(late(c, self._there(c), self.dt), UNITS[c.quantity]) for c in self.rig.channels}
        turned = self.q @ s.shortening
        slip = self.q @ s.slip_row - np.sum(self.q * turned, axis=1) / 2 + s.compliance * self.friction
        speed = np.sum((s.slip_row - turned) * self.qdot, axis=1) + s.compliance * self.friction_rate
        slip += s.residual.slip_by_force * self.force
        speed += s.residual.slip_by_force * self.force_rate
        drive = (
            self.q @ s.excitation + s.residual.drive_by_force * self.force + s.residual.slip_by_force * self.friction
        )
        drive += self._beyond(0)
        normal = normal_reaction(self.rig, self.q, self.qdot, self.friction, self.force)
        return signals | {
            "drive": Signal(drive, "m"),
            "slip": Signal(slip, "m"),
            "slip_velocity": Signal(speed, "m/s"),
            "friction": Signal(self.friction, "N"),
            "normal": Signal(normal, "N"),
        }

    def _read(self, sensor: Channel, spectrum: Callable[[Array], Rates], rates: Rates) -> Rates:
        """Spectrum of samples of its quantity."""
        return spectrum(self._there(sensor))


def steadiness(values: Array, N_t: int) -> float:
    """Change over the last two periods of N_t samples, relative to the largest value there; NaN if shorter."""
    if len(values) < 2 * N_t:
        return float("nan")
    before, last = values[-2 * N_t :].reshape(2, N_t)
    return float(np.max(np.abs(last - before)) / max(np.max(np.abs(last)), np.finfo(float).tiny))
