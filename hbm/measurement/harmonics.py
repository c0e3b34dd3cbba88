"""Harmonic coefficients of a recording, with standard deviations, and what is wrong with the record.

:func:`harmonic_spectra` fits the harmonics by least squares over whole periods; samples need not fall on equal phases
of the period. Of more than `MOST_FITTED` harmonics a period must be a whole number of evenly spaced samples: then the
same coefficients are those of an FFT of each period. The standard deviations come from the record itself:

- of four periods or more, from the scatter of the same coefficients between blocks of whole periods (at most 63
  blocks), cos and sin pooled. What is correlated from block to block, as drift and transients are, would make it too
  small: the variance is raised by (1 + rho)/(1 - rho) where the correlation rho of neighbours is significant.
- of fewer, from what is left between the harmonics around each (of one period, from all that the fit leaves over).

A scatter of nu degrees of freedom says little when nu is small. What is given is the standard deviation of Student's
distribution, larger by the root of nu/(nu - 2): then (measured - true)/std has the variance 1 that a chi square
assumes, and an interval of 1.96 std holds the truth in 95 % of all records, to 1 % from four blocks up.

Harmonics above those that are asked for are fitted too where they stand out, or they would leak into blocks whose
length is no whole number of samples: see :mod:`hbm.measurement.waves`.

Over whole periods harmonics that stay do not leak into each other; those that turn or grow do, alike in all blocks,
which none of them scatters by. What a linear trend of all harmonics leaks is known from the blocks, and taken off.

Noise that moves a refined frequency leaves the phases in the middle of the record as they are and turns those at the
zero of time, of all channels together. Seen there a coefficient is less certain than seen beside the others.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize_scalar

from hbm.errors import InputError, expect_frequency, expect_whole
from hbm.fourier import Array
from hbm.measurement.clipping import clipped
from hbm.measurement.clock import UNEVEN, unevenness
from hbm.measurement.harmonicestimate import ChannelQuality, HarmonicEstimate
from hbm.measurement.jump import jump
from hbm.measurement.recording import Recording, constant
from hbm.measurement.steadiness import leftover, steadiness
from hbm.measurement.waves import MOST_FITTED, Overtones, design, overtones

FEWEST_BLOCKS = 4
BLOCKS = 32

SLIP = 0.05
"""Samples by which whole periods may miss whole samples over a record: less than a given frequency is known to."""

LEADS = 0.1
"""A fundamental below this part of the strongest harmonic does not stand for the record: it is a multisine."""


# --------------------------------------------------------------------------------------------------------- estimation


def harmonic_spectra(
    recorded: Recording, hz: float, harmonics: int = 9, *, settle: float = 0.0, refine: str | None = None
) -> HarmonicEstimate:
    """Estimate the harmonics of a recording of one steady state.

    Parameters
    ----------
    recorded : Recording
    hz : float
        Fundamental frequency [Hz], > 0.
    harmonics : int
        Highest harmonic H, >= 1, below half the sampling rate.
    settle : float
        Time at the beginning that is left out [s].
    refine : str, optional
        Channel whose fundamental the frequency is refined with, within half a period over the record.

    Returns
    -------
    HarmonicEstimate

    Raises
    ------
    InputError
        If the frequency or the highest harmonic is none, or the record is shorter than a period, sampled too slowly, or
        holds no maximum to refine at.
    """
    expect_frequency(hz, "harmonic_spectra")
    expect_whole(harmonics, "harmonics", "harmonic_spectra")
    t, Y = _settled(recorded, settle)
    names = tuple(recorded.channels)
    hz_std = float("nan")
    _check(recorded, t, hz, harmonics)
    if refine is not None:
        hz, hz_std = _refined(recorded, t, hz, min(harmonics, 3), refine)
    samples = _samples_of_period(recorded, t, hz) if harmonics > MOST_FITTED else 0
    hz = 1.0 / (samples * recorded.step) if samples else hz
    periods = int((t[-1] - t[0] + recorded.step) * hz * (1.0 + 1e-9) + 1e-6)
    inside = t < t[0] + periods / hz - 0.5 * recorded.step
    t, Y = t[inside], Y[inside]
    dead = constant(Y)
    if dead.all():
        raise InputError(f"{recorded.source}: every channel is constant; must have one that moves")
    alive = np.flatnonzero(~dead).tolist()
    measured = replace(
        recorded,
        time=t,
        channels={names[i]: Y[:, i] for i in alive},
        units={names[i]: recorded.units.get(names[i], "") for i in alive},
    )
    found = _estimate(measured, hz, hz_std, harmonics, periods, samples)
    off = found.off_hz if refine is None else hz_std
    return replace(
        found,
        turn_std=2.0 * np.pi * abs(off * float(t.mean())),
        dead=tuple(name for name, constant in zip(names, dead, strict=True) if constant),
    )


def _settled(recorded: Recording, settle: float) -> tuple[Array, Array]:
    kept = recorded.time >= recorded.time[0] + settle - 1e-9 * recorded.step
    if kept.sum() < 3:
        length = recorded.time[-1] - recorded.time[0]
        raise InputError(
            f"{recorded.source}: settle = {settle:g} s leaves nothing; must be < {length:.6g} s, its length"
        )
    return recorded.time[kept], np.column_stack([values[kept] for values in recorded.channels.values()])


def _check(recorded: Recording, t: Array, hz: float, harmonics: int) -> None:
    length, rate = t[-1] - t[0] + recorded.step, 1.0 / recorded.step
    if length * hz * (1.0 + 1e-9) + 1e-6 < 1.0:
        raise InputError(
            f"{recorded.source}: {length:.4g} s are {length * hz:.3g} periods of {hz:g} Hz; must be at least one period"
        )
    if 2.0 * harmonics * hz >= rate * (1.0 - 1e-9):
        most = int(rate / 2 / hz * (1 - 1e-9))
        way = f"try at most {most} harmonic{'s' * (most > 1)}" if most else "are the times in seconds?"
        raise InputError(
            f"{recorded.source}: harmonic {harmonics} of {hz:g} Hz at {rate:.6g} samples/s; "
            f"must be below {rate / 2:.6g} Hz, half the sampling rate; {way}"
        )
    largest = float(np.diff(t).max())
    if largest > 0.5 / (harmonics * hz):
        raise InputError(
            f"{recorded.source}: a gap of {largest:.4g} s between samples; "
            f"must be < {0.5 / (harmonics * hz):.4g} s, half a period of harmonic {harmonics}"
        )


def _samples_of_period(recorded: Recording, t: Array, hz: float) -> int:
    """Samples of a period, a whole number of evenly spaced ones."""
    samples, periods = 1.0 / (hz * recorded.step), (t[-1] - t[0]) * hz
    even = unevenness(t) <= UNEVEN
    if not even or abs(samples - round(samples)) * periods > SLIP:
        uneven = "" if even else ", not evenly spaced"
        raise InputError(
            f"{recorded.source}: a period of {hz:.8g} Hz has {samples:.8g} samples{uneven}; "
            f"must be a whole number of evenly spaced ones for more than {MOST_FITTED} harmonics"
        )
    return round(samples)


def _estimate(measured: Recording, hz: float, hz_std: float, H: int, periods: int, samples: int) -> HarmonicEstimate:
    """Coefficients, standard deviations and quality of channels that are alive, over whole periods.

    By an FFT where a period is a whole number of `samples`; of 0 by least squares.
    """
    t, Y = measured.time, np.column_stack(list(measured.channels.values()))
    length = max(1, periods // BLOCKS)
    blocks = periods // length if periods >= FEWEST_BLOCKS else 0
    starts = np.arange(1, max(blocks, 1)) * length
    beyond = Overtones(np.arange(0), np.empty((Y.shape[1], 0)), np.zeros_like(Y))
    if samples:
        coefficients, by_block, residual, leak = _transformed(Y, hz * t[0], H, samples, starts)
    else:
        edges = t[0] + starts / hz - 0.5 * measured.step
        coefficients, by_block, residual, leak = _fitted(t, Y, hz, H, edges)
        if blocks:
            beyond = overtones(t, Y, hz, H, _even(t, residual), periods)
        if len(beyond.numbers):
            coefficients, by_block, residual, leak = _fitted(t, Y - beyond.values, hz, H, edges)
    if blocks:
        std, rho = _of_blocks(by_block, periods / length)
        coefficients = coefficients - leak(_trends(by_block))
        std = std * np.sqrt(1.0 + 1.0 / (periods**2 * (1.0 - 1.0 / blocks**2)))  # white noise in trends leaks so much
    else:
        std, rho = _of_residual(residual, periods, H), np.zeros((Y.shape[1], H + 1))
    std = np.maximum(std, np.finfo(float).eps * np.std(Y, axis=0)[:, None])  # what the arithmetic can resolve
    size = np.hypot(coefficients[:, 1 : H + 1], coefficients[:, H + 1 :])
    lead = np.where(size[:, 0] < LEADS * size.max(axis=1), 1 + size.argmax(axis=1), 1).tolist()
    followed = [by_block[:blocks, j, k] - 1j * by_block[:blocks, j, H + k] for j, k in enumerate(lead)]
    even = _even(t, residual)
    middles = t[0] + (np.arange(blocks) + 0.5) * length / hz
    quality = tuple(
        ChannelQuality(
            name=name,
            harmonic=lead[j],
            amplitude=float(size[j, lead[j] - 1]),
            std=float(std[j, lead[j]]),
            correlation=float(rho[j, lead[j]]),
            steadiness=steadiness(
                middles,
                followed[j],
                2.0 * np.pi * lead[j] * float(np.nan_to_num(hz_std)),
            ),
            leftover=leftover(even[:, j], float(np.std(Y[:, j])), periods, hz),
            clipped=clipped(Y[:, j]),
            jump=jump(middles, followed[j]),
        )
        for j, name in enumerate(measured.channels)
    )
    return HarmonicEstimate(
        source=measured.source,
        hz=hz,
        hz_std=hz_std,
        periods=periods,
        blocks=blocks,
        uneven=unevenness(t),
        channels=tuple(measured.channels),
        coefficients=np.asarray(coefficients, dtype=float),
        own_std=std,
        turn_std=0.0,
        units=measured.units,
        quality=quality,
        dead=(),
        beyond=dict(zip(beyond.numbers.tolist(), beyond.amplitude.T, strict=True)),
    )


Leak = Callable[[Array], Array]
"""What a trend of all coefficients (c, 2H+1), by their change over the record, adds to each of them."""


def _fitted(t: Array, Y: Array, hz: float, H: int, edges: Array) -> tuple[Array, Array, Array, Leak]:
    """Coefficients by least squares, (c, 2H+1), those of each block, (B, c, 2H+1), what is left, (N, c), and leaks."""
    sums = list(_normal_equations(t, Y, hz, H, edges))
    whole, middle, length = sum(G for G, _ in sums), 0.5 * (t[0] + t[-1]), t[-1] - t[0]
    coefficients = np.asarray(np.linalg.solve(whole, sum(r for _, r in sums)).T, dtype=float)
    residual = np.concatenate([y - design(x, hz, H) @ coefficients.T for x, y in _chunks(t, Y, edges)])

    def leak(trend: Array) -> Array:
        seen = np.zeros_like(trend.T)
        for x, _ in _chunks(t, Y, edges):
            A = design(x, hz, H)
            seen += A.T @ (((x - middle) / length)[:, None] * (A @ trend.T))
        return np.asarray(np.linalg.solve(whole, seen).T)

    return coefficients, np.stack([np.linalg.solve(G, r).T for G, r in sums]), residual, leak


def _transformed(
    Y: Array, turns: float, H: int, samples: int, starts: npt.NDArray[np.int_]
) -> tuple[Array, Array, Array, Leak]:
    """The same by an FFT of each period; `starts` are the first periods of all blocks but the first.

    `turns` is the time of the first sample in periods.
    """
    turn = np.exp(-2j * np.pi * turns * np.arange(H + 1))

    def of_periods(values: Array) -> Array:
        kept = np.fft.rfft(values, axis=-1)[..., : H + 1] / samples * turn
        return np.concatenate([kept[..., :1].real, 2.0 * kept[..., 1:].real, -2.0 * kept[..., 1:].imag], axis=-1)

    def periodic(coefficients: Array) -> Array:
        a, b = coefficients[:, : H + 1], np.pad(coefficients[:, H + 1 :], ((0, 0), (1, 0)))
        halved = (a - 1j * b) * np.where(np.arange(H + 1), 0.5, 1.0)
        return np.asarray(np.fft.irfft(halved / turn, samples, axis=1) * samples)

    periods = Y.reshape(-1, samples, Y.shape[1])
    each = of_periods(np.moveaxis(periods, 2, 1))
    coefficients = each.mean(axis=0)
    residual = periods - periodic(coefficients).T
    first = np.concatenate([[0], starts])
    count = np.diff(np.append(first, len(each)))
    within = (np.arange(samples) - 0.5 * (samples - 1)) / len(Y)  # from one period to the next it adds up to nothing

    def leak(trend: Array) -> Array:
        return np.asarray(of_periods(within * periodic(trend)))

    return coefficients, np.add.reduceat(each, first) / count[:, None, None], residual.reshape(Y.shape), leak


def _trends(by_block: Array) -> Array:
    """Change over the record of each coefficient of blocks (B, c, 2H+1), by a straight line through them."""
    x = (np.arange(len(by_block)) - 0.5 * (len(by_block) - 1)) / len(by_block)
    return np.asarray(np.tensordot(x, by_block, axes=1) / (x @ x))


def _chunks(t: Array, Y: Array, edges: Array) -> Iterator[tuple[Array, Array]]:
    at = [0, *np.searchsorted(t, edges).tolist(), len(t)]
    for first, last in pairwise(at):
        yield t[first:last], Y[first:last]


def _normal_equations(t: Array, Y: Array, hz: float, H: int, edges: Array) -> Iterator[tuple[Array, Array]]:
    """Normal matrix and right-hand side of each block; their sums are those of the whole record."""
    for x, y in _chunks(t, Y, edges):
        A = design(x, hz, H)
        yield A.T @ A, A.T @ y


# ------------------------------------------------------------------------------------------------ standard deviations


def _of_blocks(by_block: Array, blocks: float) -> tuple[Array, Array]:
    """Standard deviation of the mean from the scatter of blocks, (c, H+1), and the correlation it was raised for.

    Parameters
    ----------
    by_block : (B, c, 2H+1) array
    blocks : float
        Length of the record in blocks, B or up to one more.
    """
    B, H = len(by_block), by_block.shape[2] // 2
    deviation = by_block - by_block.mean(axis=0)
    square = _pooled(np.sum(deviation**2, axis=0), H)
    product = _pooled(np.sum(deviation[1:] * deviation[:-1], axis=0), H)
    pairs = np.where(np.arange(H + 1), 2, 1)
    rho = _significant_correlation(square, product, B, pairs)
    variance = square / (pairs * (B - 1) - 2) / blocks * (1.0 + rho) / (1.0 - rho)
    return np.sqrt(variance), rho


def _pooled(of_coefficients: Array, H: int) -> Array:
    """Sum over cos and sin, (c, 2H+1) to (c, H+1)."""
    out = of_coefficients[:, : H + 1].copy()
    out[:, 1:] += of_coefficients[:, H + 1 :]
    return out


def _significant_correlation(square: Array, product: Array, B: int, pairs: npt.NDArray[np.int_]) -> Array:
    """Correlation of neighbouring blocks, (c, H+1), 0 where it may be chance.

    Own correlation of a harmonic above three standard deviations of chance, or that of all harmonics of the channel
    together, which shows less, above two. A mean taken off biases a correlation by -1/B.
    """
    tiny = np.finfo(float).tiny
    own = product / np.maximum(square, tiny) + 1.0 / B
    shared = np.mean(own[:, 1:], axis=1, keepdims=True) if own.shape[1] > 1 else np.zeros((len(own), 1))
    values = B * int(pairs[1:].sum())
    shared = np.where(shared > 2.0 / np.sqrt(max(values, 1)), shared, 0.0)
    own = np.where(own > 3.0 / np.sqrt(B * pairs), own, 0.0)
    return np.minimum(np.maximum(own, shared), 0.98)


def _of_residual(residual: Array, periods: int, H: int) -> Array:
    """Standard deviation from the power that the fit leaves around each harmonic, (c, H+1)."""
    N = len(residual)
    if periods == 1:  # nothing lies between the harmonics: noise is taken for white
        freedom = max(N - 2 * H - 1, 3)
        white = np.sum(residual**2, axis=0) / (freedom - 2)
        return np.asarray(np.sqrt(white[:, None] * np.where(np.arange(H + 1), 2.0, 1.0) / N))
    power = np.abs(np.fft.rfft(residual, axis=0)) ** 2
    out = np.empty((residual.shape[1], H + 1))
    for k in range(H + 1):
        near = np.arange(max(k - 1, 0) * periods + 1, (k + 1) * periods)
        near = near[(near % periods != 0) & (near < len(power))]
        freedom = 2 * len(near)
        variance = power[near].mean(axis=0) / N**2 * (2.0 if k else 1.0)
        out[:, k] = np.sqrt(variance * (freedom / (freedom - 2) if freedom > 2 else 3.0))
    return out


def _even(t: Array, values: Array) -> Array:
    """Values (N, c) at equally spaced times."""
    if unevenness(t) <= UNEVEN:
        return values
    at = np.linspace(t[0], t[-1], len(t))
    return np.column_stack([np.interp(at, t, own) for own in values.T])


# -------------------------------------------------------------------------------------------- the frequency, refined


def _refined(recorded: Recording, t: Array, hz: float, H: int, channel: str) -> tuple[float, float]:
    """Frequency at which the harmonics of a channel hold most power, and its standard deviation [Hz]."""
    if channel not in recorded.channels:
        have = ", ".join(recorded.channels)
        raise InputError(
            f'{recorded.source}: no channel "{channel}" to refine the fundamental with; channels are {have}'
        )
    y = recorded.channels[channel][-len(t) :]
    centred, duration = t - t.mean(), float(t[-1] - t[0])

    def left(f: float) -> float:
        A = design(centred, f, H)
        return float(np.sum((y - A @ np.linalg.solve(A.T @ A, A.T @ y)) ** 2))

    reach = 0.5 / duration
    found = minimize_scalar(left, bounds=(hz - reach, hz + reach), method="bounded", options={"xatol": 1e-7 * reach})
    best = float(found.x)
    if abs(best - hz) > 0.98 * reach:
        raise InputError(
            f"{recorded.source}: no maximum of {channel} within {reach:.3g} Hz of {hz:g} Hz; "
            "must be closer to the fundamental"
        )
    A = design(centred, best, H)
    a = np.linalg.lstsq(A, y, rcond=None)[0]
    noise = np.sum((y - A @ a) ** 2) / max(len(y) - 2 * H - 1, 1)
    amplitude = max(float(np.hypot(a[1], a[H + 1])), np.finfo(float).tiny)
    return best, float(np.sqrt(24.0 * noise / len(y)) / (2.0 * np.pi * amplitude * duration))  # Rife and Boorstyn 1974
