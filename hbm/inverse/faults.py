"""Faults that one channel may have, each a parameter that is fitted to what all others say it must read."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from hbm.fourier import Array, coefficients_of
from hbm.inverse.readings import Others, Readings
from hbm.inverse.sensing import Complex
from hbm.measurement.spectra import MeasuredSpectra
from models.rig import Rig

LARGEST_GAIN = 20.0

GAINS = np.geomspace(1.0 / LARGEST_GAIN, LARGEST_GAIN, 49)
"""Sizes of a gain from which the best is refined, of either sign."""

GRID = 121
"""Positions along the beam, and delays within a period, from which the best is refined."""


@dataclass(frozen=True)
class Fault:
    """An explanation of what one channel reads.

    Attributes
    ----------
    cause : str
        Name of the cause in docs/reference/causes.md, or `sensor-dead`, `sensor-noise`, `sensor-unknown`.
    channel : str
    value, std : float
        Gain, delay [s], position [m], or how many times the stated standard deviation it scatters.
    chi2 : float
        Misfit that the channel adds to that of the others, so explained.
    score : float
        Bayesian information criterion, less what all explanations of all channels share.
    other : str
        Channel it is exchanged with.
    alternatives : tuple of Fault
        Other faults of the channel that explain it as well.
    """

    cause: str
    channel: str
    value: float = 0.0
    std: float = 0.0
    chi2: float = 0.0
    score: float = 0.0
    other: str = ""
    alternatives: tuple["Fault", ...] = ()

    def corrected(self, rig: Rig, spectra: MeasuredSpectra) -> tuple[Rig, MeasuredSpectra]:
        """Rig and spectra as they would be without the fault; unchanged where no correction is known."""
        if self.cause == "sensor-position":
            moved = (replace(c, position=self.value) if c.name == self.channel else c for c in rig.channels)
            return replace(rig, channels=tuple(moved)), spectra
        if self.cause == "sensor-gain":
            return rig, times(spectra, self.channel, np.full((len(spectra), spectra.H + 1), 1.0 / self.value + 0j))
        if self.cause == "sensor-delay":
            i_omega = 2j * np.pi * spectra.hz[:, None] * np.arange(spectra.H + 1)
            return rig, times(spectra, self.channel, np.exp(i_omega * self.value))
        if self.cause == "swapped-channels":
            order = np.arange(len(spectra.channels))
            i, j = spectra.index(self.channel), spectra.index(self.other)
            order[[i, j]] = j, i
            return rig, replace(spectra, coefficients=spectra.coefficients[:, order], std=spectra.std[:, order])
        return rig, spectra


def times(spectra: MeasuredSpectra, channel: str, factor: Complex) -> MeasuredSpectra:
    """Spectra with one channel times a complex factor (r, H+1)."""
    i = spectra.index(channel)
    coefficients, std = spectra.coefficients.copy(), spectra.std.copy()
    coefficients[:, i] = coefficients_of(factor * spectra.complex(channel))
    std[:, i] = std[:, i] * np.abs(factor)
    return replace(spectra, coefficients=coefficients, std=std)


def explanations(readings: Readings, channel: str, others: Others) -> Iterator[Fault]:
    """Possible faults of a channel, fitted; the first is that it has none.

    Parameters
    ----------
    readings : Readings
    channel : str
    others : Others
        Predictions of the other channels.

    Yields
    ------
    Fault
        `cause` is empty for no fault; then dead, then a gain.
    """
    rows = readings.rows[:, :, readings.channels.index(channel)]
    price = float(np.log(readings.total))

    def misfit(times: Array | Complex) -> Array:
        return readings.innovation(channel, times * rows, others)

    right = float(misfit(np.ones((1, 1, 1, 1)))[0])
    yield Fault("", channel, chi2=right, score=right)
    silent = float(misfit(np.zeros((1, 1, 1, 1)))[0])
    yield Fault("sensor-dead", channel, chi2=silent, score=silent)
    for cause, objective, start in _parameters(readings, channel, others, misfit, rows):
        value, chi2 = _least(objective, start)
        yield Fault(cause, channel, value, chi2=chi2, score=chi2 + price)
    yield _scatter(readings, channel, others, right, price)


def _scatter(readings: Readings, channel: str, others: Others, right: float, price: float) -> Fault:
    """A standard deviation that is larger than stated, by maximum likelihood."""
    from scipy.optimize import minimize_scalar

    error, variance = readings.against(channel, others)
    measured = readings.weight[:, :, readings.channels.index(channel)] > 0.0
    square, unsure = np.abs(error[measured]) ** 2, variance[measured] - 1.0

    def unlikely(log_times: float) -> float:
        total = np.exp(2.0 * log_times) + unsure
        return float(np.sum(square / total + 2.0 * np.log(total)))

    most = float(np.log(1.0 + np.sqrt(square.max(initial=1.0))))
    found = minimize_scalar(unlikely, bounds=(0.0, most), method="bounded")
    times = float(np.exp(found.x))
    information = float(np.sum(4.0 * times**2 / (times**2 + unsure) ** 2))
    score = right + min(found.fun - unlikely(0.0), 0.0) + price
    count = readings.count(channel)
    return Fault("sensor-noise", channel, times, information**-0.5 if information else np.inf, count, score)


Objective = Callable[[Array], Array]


def _parameters(
    readings: Readings, channel: str, others: Others, misfit: Callable[[Complex], Array], rows: Complex
) -> Iterator[tuple[str, Objective, Array]]:
    """Cause, misfit over values (m,) of its parameter, and the grid on which its least is near the least of all."""
    gain = _regression(readings, channel, others, rows)
    near = np.clip(gain + (0.05 + 0.2 * abs(gain)) * np.linspace(-1.0, 1.0, 5), -LARGEST_GAIN, LARGEST_GAIN)
    gains = np.unique(np.concatenate([near, -GAINS, GAINS]))  # regression falls short where predictions are noisy
    yield "sensor-gain", lambda g: misfit(np.asarray(g[:, None, None, None], dtype=np.complex128)), gains
    period = 1.0 / float(readings.seen.spectra.hz.max())
    late = period * np.linspace(-0.5, 0.5, GRID)
    k_Omega = readings.k_Omega[..., None]
    yield "sensor-delay", lambda tau: misfit(_turned(k_Omega * tau[:, None, None, None])), late
    beam = readings.seen.rig.beam
    if beam is not None and channel in readings.seen.channels:
        along = np.linspace(0.0, beam.length, GRID)
        yield "sensor-position", lambda x: readings.innovation(channel, readings.rows_at(channel, x), others), along


def _turned(angle: Array) -> Complex:
    """exp(-i angle)."""
    return np.asarray(np.exp(-1j * angle), dtype=np.complex128)


def _regression(readings: Readings, channel: str, others: Others, rows: Complex) -> float:
    """Gain by linear regression of what a channel read on what the others predict."""
    error, variance = readings.against(channel, others)
    predicted = np.einsum("rks,rks->rk", rows, others.state)
    power = float(np.sum(np.abs(predicted) ** 2 / variance))
    return 1.0 + float(np.sum((predicted.conj() * error).real / variance)) / power if power > 0.0 else 1.0


def _least(objective: Objective, grid: Array) -> tuple[float, float]:
    """Place and value of the least misfit: a grid tells minima apart, and Brent's method refines the lowest."""
    from scipy.optimize import minimize_scalar

    values = objective(grid)
    best = int(values.argmin())
    low, high = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, len(grid) - 1)])
    found = minimize_scalar(
        lambda x: float(objective(np.array([x]))[0]),
        bounds=(low, high),
        method="bounded",
        options={"xatol": 1e-7 * (high - low)},
    )
    return (float(found.x), float(found.fun)) if found.fun < values[best] else (float(grid[best]), float(values[best]))


def with_std(fault: Fault, readings: Readings, others: Others) -> Fault:
    """A fitted fault with the standard deviation of its parameter, where the misfit has risen by 1."""
    rows = readings.rows[:, :, readings.channels.index(fault.channel)]

    def misfit(times: Array | Complex) -> Array:
        return readings.innovation(fault.channel, times * rows, others)

    for cause, objective, grid in _parameters(readings, fault.channel, others, misfit, rows):
        if cause == ("sensor-gain" if fault.cause == "sensor-dead" else fault.cause):
            scale = max(fault.chi2 / readings.count(fault.channel), 1.0)  # an imperfect explanation is less sure
            return replace(fault, std=_rise(objective, fault, scale, float(np.ptp(grid))))
    return fault


def _rise(objective: Objective, fault: Fault, rise: float, most: float) -> float:
    """Distance at which the misfit exceeds its least by `rise`, the mean of both sides."""
    from scipy.optimize import brentq

    sides = []
    for sign in (-1.0, 1.0):

        def excess(step: float, sign: float = sign) -> float:
            return float(objective(np.array([fault.value + sign * step]))[0]) - fault.chi2 - rise

        far = 1e-9 * most
        while far < most and excess(far) < 0.0:
            far *= 4.0
        if far < most:
            sides.append(float(brentq(excess, 0.0, far, rtol=1e-3)))
    return float(np.mean(sides)) if sides else float("inf")
