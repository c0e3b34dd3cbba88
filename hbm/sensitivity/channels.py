"""Derivatives of the channels of a solution, each worked out when it is asked for."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from hbm.balance.problem import Linearization
from hbm.balance.solution import PeriodicSolution, Signal
from hbm.channels import DERIVATIVES, DISPLACEMENT, VELOCITY, read
from hbm.errors import channel_named
from hbm.fourier import Array, FourierBasis
from hbm.labelled import coefficient_columns, frame, repeated
from hbm.sensitivity.held import HeldBalance, friction_change
from models.display import Displayed
from models.jointed import AnyRig
from models.parts import Channel
from models.scalars import solution_numbers

Peak = Callable[[Array, Array], Array]
"""Derivatives (p,) of the peak of a sampled signal, from its samples and theirs."""


@dataclass(frozen=True, eq=False)
class ChannelSensitivity:
    """Derivatives of one channel, a column per parameter, in the channel's unit per unit of the parameter.

    Attributes
    ----------
    coefficients : (2H+1, p) array
        Derivatives of its Fourier coefficients a_0, a_1..a_H, b_1..b_H.
    samples : (N_t, p) array
        Derivatives of its values at the phases of the basis.
    peak : (p,) array
        Derivative of its peak, see :class:`hbm.balance.solution.Signal`, at the instant of the peak (envelope
        theorem).
    """

    coefficients: Array
    samples: Array
    peak: Array

    def __repr__(self) -> str:
        """How many numbers and harmonics."""
        H, p = len(self.coefficients) // 2, self.coefficients.shape[1]
        return f"derivatives of {H} harmonics, samples and peak to {p} number{'s' * (p != 1)}"


class SeriesSensitivity(ChannelSensitivity):
    """Derivatives of a series, told whole by those of its coefficients; the others follow when they are asked for."""

    _basis: FourierBasis
    _signal: Signal
    _peak: Peak

    def __init__(self, coefficients: Array, basis: FourierBasis, signal: Signal, peak: Peak) -> None:
        self.__dict__.update(coefficients=coefficients, _basis=basis, _signal=signal, _peak=peak)

    @cached_property
    def samples(self) -> Array:
        """Derivatives of its values at the phases of the basis, (N_t, p)."""
        return np.asarray(self._basis.samples(self.coefficients))

    @cached_property
    def peak(self) -> Array:
        """Derivative of its peak, (p,)."""
        return self._peak(self._signal.samples, self.samples)


@dataclass(frozen=True, eq=False)
class Derivatives(Displayed):
    """How a periodic solution changes with numbers of its rig; attributes as of those that inherit."""

    solution: PeriodicSolution
    parameters: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    Q: Array
    T: Array
    channels: Mapping[str, ChannelSensitivity]

    def __repr__(self) -> str:
        """Name the numbers and the steady state, and how much the drive's peak changes with each."""
        s = self.solution
        changes = self.logarithmic("drive")
        lines = [
            f"  {name:32s} {value:12.6g} {'' if unit == '1' else unit:8s} {changes[name]:+.4g}"
            for name, value, unit in zip(self.parameters, self.values, self.units, strict=True)
        ]
        head = (
            f"sensitivities at {s.hz:.6g} Hz, {s.level:g} N; of the drive's peak, relative, to each number, relative:"
        )
        return "\n".join([head, *lines])

    def __getitem__(self, name: str) -> ChannelSensitivity:
        """Channel by name."""
        return channel_named(self.channels, name)

    def to_dataframe(self) -> Any:
        """One row a number and channel, as a pandas.DataFrame: derivatives of its peak and of every coefficient.

        They are in the channel's unit per unit of the number; relative_peak is d ln(peak) / d ln(number).

        Raises
        ------
        InputError
            If pandas is not installed.
        """
        signals, p = self.solution.channels, len(self.parameters)
        known = [self[name] for name in signals]
        return frame(
            "to_dataframe",
            {
                "parameter": np.tile(self.parameters, len(signals)),
                "parameter_unit": np.tile(self.units, len(signals)),
                "value": np.tile(self.values, len(signals)),
                "channel": repeated(list(signals), p),
                "unit": repeated([s.unit for s in signals.values()], p),
                "peak": np.concatenate([c.peak for c in known]),
                "relative_peak": np.concatenate([list(self.logarithmic(name).values()) for name in signals]),
                **coefficient_columns(np.stack([c.coefficients.T for c in known])),
            },
        )

    def logarithmic(self, channel: str) -> dict[str, float]:
        """Derivative d ln(peak) / d ln(p) of a channel's peak to each parameter: per cent per per cent.

        At the top of a resonance the derivative at the held frequency is also that of the resonance's height
        (envelope theorem): the shift of the resonance does not count, since the curve is level there. How level is
        told by the entry of ``frequency_hz``.
        """
        relative = self.values * self[channel].peak / self.solution[channel].peak
        return dict(zip(self.parameters, relative.tolist(), strict=True))


def described(rig: AnyRig, solution: PeriodicSolution, keys: Sequence[str]) -> tuple[tuple[str, ...], Array]:
    """Units and values (p,) of numbers that a solution depends on.

    Raises
    ------
    ValueError
        If one is not a number of the rig, or there are none.
    """
    known = solution_numbers(rig, solution.hz, solution.level)
    unknown = [key for key in keys if key not in known]
    if unknown or not keys:
        found = f"{unknown[0]} is not a number of the rig" if unknown else "no keys"
        raise ValueError(f"sensitivities: {found}; must be some of {', '.join(known)}")
    return tuple(known[key][1].unit for key in keys), np.array([known[key][0] for key in keys])


@dataclass(frozen=True)
class Change:
    """Derivatives of Q (2H+1, n, p), T (2H+1, p), u, rho, eta (2H+1, 3, p), what is slid (2H+1, p).

    And of the forces of the elements that the change of the deflections brings, (2H+1, r, p).
    """

    Q: Array
    T: Array
    signals: Array
    slid: Array
    elements: Array


class Channels(Mapping[str, ChannelSensitivity]):
    """Derivatives of the channels, linear in motion, signals and friction: see :mod:`hbm.balance.solution`."""

    def __init__(self, here: Linearization, solution: PeriodicSolution, held: HeldBalance, change: Change) -> None:
        self.here, self.problem, self.solution, self.held, self.change = here, here.problem, solution, held, change
        self._sensors = {c.name: c for c in self.problem.rig.channels}
        self._places = {c.name: i for i, c in enumerate(self.problem.rig.response_channels, start=2)}
        self._known: dict[str, ChannelSensitivity] = {}

    def __iter__(self) -> Iterator[str]:
        return iter(self.solution.channels)

    def __len__(self) -> int:
        return len(self.solution.channels)

    def __getitem__(self, name: str) -> ChannelSensitivity:
        if name not in self._known:
            self._known[name] = self._worked_out(name)
        return self._known[name]

    def __reduce__(self) -> tuple[type, tuple[dict[str, ChannelSensitivity]]]:
        return dict, (dict(self),)  # what is sent to another process is worked out

    def _worked_out(self, name: str) -> ChannelSensitivity:
        s = self.problem.structure
        match name:
            case "drive":
                moved = self._moved(1, s.excitation, s.residual.drive_by_force, s.residual.slip_by_force)
                return self._motion(name, moved, DISPLACEMENT)
            case "slip":
                zero_mean, u = self._slip_samples - self._slip_samples.mean(axis=0), self.solution[name].samples
                return ChannelSensitivity(self._slip, self._slip_samples, largest(u - u.mean(), zero_mean))
            case "slip_velocity":
                return self._motion(name, self._slip, VELOCITY)
            case "friction":
                T, analysis = self.solution[name].samples, self.problem.basis.analysis
                return ChannelSensitivity(analysis @ self._friction, self._friction, largest(T, self._friction))
            case "normal":
                normal, R = self._normal(), self.solution[name].samples
                return ChannelSensitivity(self.problem.basis.analysis @ normal, normal, normal[R.argmax()])
        sensor = self._sensors[name]
        if sensor.quantity == "force":
            return self._motion(name, self.held.force, DISPLACEMENT)
        moved = self._moved(self._places[name], s.channel_rows[name], *s.residual.channels[name])
        return self._motion(name, moved, sensor)

    @cached_property
    def _friction(self) -> Array:
        """Derivative of the friction force at the samples, (N_t, p)."""
        return friction_change(self.here, replace(self.held.inputs, signals=self.change.signals))

    @cached_property
    def _modal_slip(self) -> Array:
        """Derivative of the slip less its elastic part, (2H+1, p)."""
        return np.asarray(self.change.signals[:, 0] + self.problem.dynamic_lagrangian * self.change.T)

    @cached_property
    def _slip(self) -> Array:
        """Derivative of the slip, (2H+1, p)."""
        yielding = np.outer(self.solution["friction"].coefficients, self.held.structure.flexibility[:, 0, 0])
        return np.asarray(self._modal_slip + self.problem.structure.compliance * self.change.T + yielding)

    @cached_property
    def _slip_samples(self) -> Array:
        """Derivative of the slip at the samples, (N_t, p)."""
        yielding = np.outer(self.solution["friction"].samples, self.held.structure.flexibility[:, 0, 0])
        elastic = self.problem.structure.compliance * self._friction + yielding
        return np.asarray(self.problem.basis.synthesis @ self._modal_slip + elastic)

    def _motion(self, name: str, displacement: Array, sensor: Channel) -> ChannelSensitivity:
        """Derivative of a channel's reading of a displacement; its own numbers and the frequency change too."""
        basis, held, Omega = self.problem.basis, self.held, self.here.state.Omega
        coefficients, seen = read(sensor, basis, displacement, Omega), self.solution[name].coefficients
        times = DERIVATIVES[sensor.quantity]
        if times:  # of Omega to that power
            coefficients += np.outer(seen, times / self.solution.hz * held.hz)
        if name in held.gain:
            later = held.delay[name] * Omega + sensor.delay * 2 * np.pi * held.hz
            coefficients += np.outer(seen / sensor.gain, held.gain[name]) - np.outer(basis.derivative(seen), later)
        return SeriesSensitivity(coefficients, basis, self.solution[name], smooth_peak)

    def _moved(self, place: int, row: Array, by_force: float, by_friction: float) -> Array:
        held, d = self.held, self.held.structure
        still = held.through(d.rows[:, place])
        still += held.static(d.flexibility[:, place], self.solution["friction"].coefficients)
        still += held.by_slid(place, self.change.slid)
        if held.elements is not None:
            still += held.elements.beyond(place - 1, self.change.elements)
        return np.asarray(row @ self.change.Q + by_force * held.force + by_friction * self.change.T + still)

    def _normal(self) -> Array:
        """Derivative of rho + eta T at the samples, (N_t, p)."""
        synthesis, signals = self.problem.basis.synthesis, self.change.signals
        eta, T = synthesis @ self.here.kin.signals[:, 3], self.solution["friction"].samples
        normal = synthesis @ signals[:, 1] + T[:, None] * (synthesis @ signals[:, 2]) + eta[:, None] * self._friction
        rig, elements = self.problem.rig, self.held.elements
        if elements is None or not rig.contact.lift_off:
            return np.asarray(normal)
        tension = elements.tension(self.change.elements, rig.contact.normal_load, self.held.load)
        on_support = self.solution["normal"].samples[:, None] > 0.0
        return np.where(on_support, normal - synthesis @ tension, 0.0)


def largest(samples: Array, change: Array) -> Array:
    """Derivatives of the largest magnitude of a sampled signal."""
    i = int(np.abs(samples).argmax())
    return np.asarray(np.sign(samples[i]) * change[i])


def smooth_peak(samples: Array, change: Array) -> Array:
    """Derivatives of the top of the parabola through the three samples around the largest magnitude."""
    i = int(np.abs(samples).argmax())
    around = [i - 1, i, (i + 1) % len(samples)]
    before, top, after = np.abs(samples[around])
    bend = before + after - 2 * top
    x = (before - after) / (2 * bend) if bend < 0.0 else 0.0  # of the top, in samples; it moves along a level parabola
    weights = np.array([x * (x - 1) / 2, 1 - x**2, x * (x + 1) / 2])
    return np.asarray((weights * np.sign(samples[around])) @ change[around])
