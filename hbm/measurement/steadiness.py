"""Is a record a steady state? What its blocks, and what its harmonics leave over, say of one channel.

The fundamental's complex amplitude is followed from block to block. In a steady state it is constant but for noise.
A linear transient adds ``d exp((-lambda + i delta) t)``: it dies out at the rate lambda, and turns because the
structure rings at its own frequency, delta / 2 pi beside the fundamental.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy import special
from scipy.optimize import least_squares
from scipy.signal.windows import blackmanharris

from hbm.fourier import Array

Complex = npt.NDArray[np.complex128]

SIGNIFICANT = 1e-4
"""Probability below which steadiness is given up: a false alarm in ten thousand channels."""
RESOLVED = 1e-12
"""Part of the amplitude that arithmetic resolves: what varies by less is steady, by whatever pattern of rounding."""
FEWEST_FOR_LINES = 12
"""Periods below which a line cannot be told from the harmonics beside it."""
UNPROMISING = 0.1
"""Probability, at the best of a coarse search, from which a transient is not looked for further."""
FEWEST_BLOCKS = 8
"""Fewest blocks to whose amplitudes a transient is fitted: it has too many parameters for fewer."""
FAR, COHERENT = 1.0, 0.95
"""Turn over the record [rad] from which it is no linear trend of the amplitude, and the part of the power that has to
turn evenly for that."""


@dataclass(frozen=True)
class Steadiness:
    """Steadiness of the amplitude of the fundamental over a record.

    Attributes
    ----------
    change, change_std : float
        Size of the linear trend from beginning to end, relative to the mean amplitude, and its standard deviation with
        that of the frequency; nan of too few blocks.
    turning : float
        Part of the trend that turns the phase [rad].
    p_steady : float
        Probability of a variation as large as this in a steady state with independent noise.
    decay_rate, decay_rate_std : float
        lambda [1/s] of a transient, nan where none is significant.
    beat_hz : float
        delta / 2 pi [Hz] of the transient.
    size, left : float
        The transient at the beginning, and what is left of it at the end, relative to the mean amplitude.
    """

    change: float
    change_std: float
    turning: float
    p_steady: float
    decay_rate: float = float("nan")
    decay_rate_std: float = float("nan")
    beat_hz: float = float("nan")
    size: float = float("nan")
    left: float = float("nan")

    @property
    def growing(self) -> float:
        """Size of the rest of the trend, which grows or falls."""
        return float(np.sqrt(max(self.change**2 - self.turning**2, 0.0)))

    @property
    def steady(self) -> bool:
        """Whether nothing significant speaks against it."""
        return not self.p_steady < SIGNIFICANT


def steadiness(t: Array, c: Complex, omega_std: float = 0.0) -> Steadiness:
    """Judge complex amplitudes of blocks.

    Parameters
    ----------
    t : (B,) array
        Middle of each block [s], equally spaced.
    c : (B,) complex array
        Amplitude of the fundamental.
    omega_std : float
        Standard deviation of the frequency they were taken at [rad/s]: steady amplitudes turn by that much.
    """
    B = len(t)
    if B < 3 or not c.any():
        nan = float("nan")
        return Steadiness(nan, nan, nan, nan)
    duration = B * (t[1] - t[0])
    unwound = _unwound(t, c)
    trend, trend_std, p = _trend(t, c if unwound is None else unwound[0])
    if unwound is not None:
        trend, p = trend + 1j * unwound[1], 0.0
    if np.max(np.abs(c - c.mean())) <= RESOLVED * abs(c.mean()):
        return Steadiness(abs(trend), trend_std, float(trend.imag), p_steady=1.0)
    std = float(np.hypot(trend_std, omega_std * duration))
    if std > trend_std:  # turned back until the turn has the standard deviation of the rest
        c = c * np.exp(-1j * (1.0 - trend_std / std) * trend.imag * (t - t.mean()) / duration)
        p = _trend(t, c)[2]
    known = Steadiness(abs(trend), std, float(trend.imag), p)
    return _transient(t, c, known) if B >= FEWEST_BLOCKS else known


def _unwound(t: Array, c: Complex) -> tuple[Complex, float] | None:
    """Amplitudes turned back by the turn of their phase over the record, and that [rad]; None of no large, even one."""
    if len(t) < FEWEST_BLOCKS:
        return None
    x = (t - t.mean()) / (len(t) * (t[1] - t[0]))
    turn = float(x @ np.unwrap(np.angle(c)) / (x @ x))
    back = c * np.exp(-1j * turn * x)
    even = abs(back.mean()) ** 2 > COHERENT * float(np.mean(np.abs(c) ** 2))
    return (back, turn) if even and abs(turn) > FAR else None


def _trend(t: Array, c: Complex) -> tuple[complex, float, float]:
    """Relative trend over the record, the standard deviation of each of its parts, and the probability of noise."""
    mean, x = c.mean(), t - t.mean()
    slope = (x @ (c - mean)) / (x @ x)
    left = float(np.sum(np.abs(c - mean - slope * x) ** 2))
    freedom = 2 * (len(t) - 2)
    duration = len(t) * (t[1] - t[0])
    std = float(np.sqrt(left / freedom / (x @ x)) * duration / abs(mean))
    return complex(slope * duration / mean), std, _probability(abs(slope) ** 2 * (x @ x), 2, left, freedom)


def _probability(explained: float, parameters: int, left: float, freedom: int) -> float:
    """F test: probability that noise alone is explained so well."""
    if left <= 0.0:
        return 1.0 if explained <= 0.0 else 0.0
    return float(special.fdtrc(parameters, freedom, explained / parameters / (left / freedom)))


def _transient(t: Array, c: Complex, known: Steadiness) -> Steadiness:
    """Add a transient, where the amplitudes are explained by one; p is corrected for the search over the beat."""
    B, x = len(t), (t - t[0]) / (t[1] - t[0])  # time in blocks
    whole, start = float(np.sum(np.abs(c - c.mean()) ** 2)), _start(c)

    def probability(left: float) -> float:
        return min(1.0, B * _probability(whole - left, 4, left, 2 * B - 6))

    p = probability(float(np.sum(np.abs(_deviation(x, c, start)) ** 2)))
    if p > UNPROMISING:
        return replace(known, p_steady=min(1.0, 2.0 * min(p, known.p_steady)))
    fit = least_squares(lambda s: _parts(_deviation(x, c, s)), start, x_scale=(1.0 / B, 1.0 / B))
    left = 2.0 * float(fit.cost)
    known = replace(known, p_steady=min(1.0, 2.0 * min(probability(left), known.p_steady)))
    covariance = np.linalg.pinv(fit.jac.T @ fit.jac) * left / (2 * B - 6)
    rate, rate_std = fit.x[0] / (t[1] - t[0]), float(np.sqrt(covariance[0, 0])) / (t[1] - t[0])
    if probability(left) >= SIGNIFICANT or rate < 2.0 * rate_std:  # noise, or it varies and does not die out
        return known
    size = abs(_transient_amplitude(x, c, fit.x) / c.mean())
    return replace(
        known,
        decay_rate=float(rate),
        decay_rate_std=rate_std,
        beat_hz=float(fit.x[1] / (2.0 * np.pi * (t[1] - t[0]))),
        size=float(size),
        left=float(size * np.exp(-fit.x[0] * (B - 0.5))),
    )


def _start(c: Complex) -> Array:
    """Best decay rate and beat of a grid, per block."""
    grid, shapes = _grid(len(c))
    return np.asarray(grid[np.argmax(np.abs(shapes @ (c - c.mean())))])


@lru_cache(maxsize=8)
def _grid(B: int) -> tuple[Array, Complex]:
    """Decay rates and beats per block, (g, 2); conjugates of transients in B blocks, of mean 0, size 1, (g, B)."""
    rates, beats = np.meshgrid(np.geomspace(0.2, 0.5 * B, 6) / B, np.linspace(-np.pi, np.pi, 2 * B, endpoint=False))
    shapes = _shape(np.arange(1.0 * B), rates.reshape(-1, 1), beats.reshape(-1, 1)).conj()
    shapes = shapes - shapes.mean(axis=1, keepdims=True)
    return np.column_stack([rates.ravel(), beats.ravel()]), shapes / np.linalg.norm(shapes, axis=1, keepdims=True)


def _shape(x: Array, rate: npt.ArrayLike, beat: npt.ArrayLike) -> Complex:
    shape: Complex = np.exp((-np.asarray(rate) + 1j * np.asarray(beat)) * x)
    return shape


def _transient_amplitude(x: Array, c: Complex, s: Array) -> complex:
    """Amplitude of the transient that fits best beside a constant, at a rate and beat."""
    shape = _shape(x, *s)
    shape = shape - shape.mean()
    return complex(np.vdot(shape, c) / max(np.vdot(shape, shape).real, np.finfo(float).tiny))


def _deviation(x: Array, c: Complex, s: Array) -> Complex:
    shape = _shape(x, *s)
    return np.asarray(c - c.mean() - _transient_amplitude(x, c, s) * (shape - shape.mean()))


def _parts(z: Complex) -> Array:
    return np.concatenate([z.real, z.imag])


# ------------------------------------------------------------------------------------------ what harmonics leave over


@dataclass(frozen=True)
class Leftover:
    """Content of a channel between the harmonics.

    Attributes
    ----------
    share : float
        Its rms relative to the rms of the channel about its mean.
    line_hz, line_share : float
        Frequency [Hz] of a line that stands out of the noise, and its rms relative to the rms of the channel; nan if
        none does.
    """

    share: float
    line_hz: float
    line_share: float


def leftover(residual: Array, rms: float, periods: int, hz: float) -> Leftover:
    """Look between the harmonics of what a fit has left.

    Parameters
    ----------
    residual : (N,) array
        Equally spaced over whole periods.
    rms : float
        Root mean square of the channel about its mean.
    periods : int
        Periods in it.
    hz : float
        Fundamental [Hz].
    """
    windowed = periods >= FEWEST_FOR_LINES
    reach = 4 if windowed else 0  # bins: half the main lobe
    window = blackmanharris(len(residual), sym=False) if windowed else 1.0
    power = np.abs(np.fft.rfft(residual * window)) ** 2
    bins = np.arange(len(power))
    between = np.abs((bins + periods / 2) % periods - periods / 2) > reach
    between[-5:] = False  # half the sampling rate has another distribution
    total = float(power.sum())
    if total == 0.0 or not between.any():
        return Leftover(0.0, float("nan"), float("nan"))

    def share(chosen: "npt.NDArray[np.bool_] | slice") -> float:
        return float(np.sqrt(np.mean(residual**2) * power[chosen].sum() / total)) / rms

    top = int(np.argmax(np.where(between, power, 0.0)))
    floor = float(np.median(power[between & (np.abs(bins - top) <= 4 * periods)])) / np.log(2.0)
    if not windowed or power[top] < floor * (np.log(len(power)) + 9.2):  # noise comes so high once in 10 000 records
        return Leftover(share(between), float("nan"), float("nan"))
    line = slice(max(top - reach, 0), top + reach + 1)
    centre = float(power[line] @ bins[line] / power[line].sum())
    return Leftover(share(between), centre * hz / periods, share(line))
