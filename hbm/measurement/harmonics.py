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

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from hbm.errors import InputError, expect_frequency, expect_whole
from hbm.fourier import Array
from hbm.measurement.blockscatter import of_blocks, of_residual, trends
from hbm.measurement.clipping import between_tops, clipped
from hbm.measurement.clock import UNEVEN, unevenness
from hbm.measurement.harmonicestimate import ChannelQuality, HarmonicEstimate
from hbm.measurement.heard import unheard
from hbm.measurement.jump import jump
from hbm.measurement.periods import Periods, fitted, transformed
from hbm.measurement.recording import Recording, constant
from hbm.measurement.spikes import spike
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
    if silent := _silent(found):
        heard = {name: values for name, values in measured.channels.items() if name not in silent}
        found = _estimate(replace(measured, channels=heard), hz, hz_std, harmonics, periods, samples)
    off = found.off_hz if refine is None else hz_std
    return replace(
        found,
        turn_std=2.0 * np.pi * abs(off * float(t.mean())),
        dead=tuple(name for name, constant in zip(names, dead, strict=True) if constant),
        silent=silent,
    )


def _silent(e: HarmonicEstimate) -> tuple[str, ...]:
    """Channels of noise without a line, of which no harmonic stands out, where another channel moves plainly."""
    clear = np.hypot(e.coefficients[:, 1 : e.H + 1], e.coefficients[:, e.H + 1 :]) / e.own_std[:, 1:]
    quiet = (q for q, silent in zip(e.quality, unheard(clear), strict=True) if silent)
    return tuple(q.name for q in quiet if not np.isfinite(q.leftover.line_hz) and not q.clipped)


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
        found = transformed(Y, hz * t[0], H, samples, starts)
    else:
        edges = t[0] + starts / hz - 0.5 * measured.step
        found = fitted(t, Y, hz, H, edges)
        if blocks:
            beyond = overtones(t, Y, hz, H, _even(t, found.residual), periods)
        if len(beyond.numbers):
            found = fitted(t, Y - beyond.values, hz, H, edges)
    coefficients = found.coefficients
    if blocks:
        std, rho = of_blocks(found.by_block, periods / length)
        coefficients = coefficients - found.leak(trends(found.by_block))
        std = std * np.sqrt(1.0 + 1.0 / (periods**2 * (1.0 - 1.0 / blocks**2)))  # white noise in trends leaks so much
    else:
        std, rho = of_residual(found.residual, periods, H), np.zeros((Y.shape[1], H + 1))
    std = np.maximum(std, np.finfo(float).eps * np.std(Y, axis=0)[:, None])  # what the arithmetic can resolve
    flat = [clipped(own) for own in Y.T]
    if not samples:
        std = np.hypot(std, _by_tops(t, Y, hz, coefficients, flat))
    estimate = HarmonicEstimate(
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
        quality=(),
        dead=(),
        silent=(),
        beyond=dict(zip(beyond.numbers.tolist(), beyond.amplitude.T, strict=True)),
    )
    middles = t[0] + (np.arange(blocks) + 0.5) * length / hz
    return replace(estimate, quality=_quality(estimate, measured, found, rho, middles, flat))


def _by_tops(t: Array, Y: Array, hz: float, coefficients: Array, flat: Sequence[bool]) -> Array:
    """By how much coefficients (c, 2H+1) of flat-topped channels differ from those without the tops, (c, H+1).

    One that was clipped is off by so much; one that rests there, as where friction sticks, is not.
    """
    H = coefficients.shape[1] // 2
    off = np.zeros((Y.shape[1], H + 1))
    for j in np.flatnonzero(flat):
        kept = between_tops(Y[:, j])
        A = design(t[kept], hz, H)
        change = np.linalg.lstsq(A, Y[kept, j], rcond=None)[0] - coefficients[j]
        off[j, 0], off[j, 1:] = abs(change[0]), np.hypot(change[1 : H + 1], change[H + 1 :]) / np.sqrt(2.0)
    return off


def _quality(
    e: HarmonicEstimate, measured: Recording, found: Periods, rho: Array, middles: Array, flat: Sequence[bool]
) -> tuple[ChannelQuality, ...]:
    """What is to be said of each channel; `middles` are the times (B,) of the blocks, `flat` which are flat-topped."""
    H = e.coefficients.shape[1] // 2
    size = np.hypot(e.coefficients[:, 1 : H + 1], e.coefficients[:, H + 1 :])
    lead = np.where(size[:, 0] < LEADS * size.max(axis=1), 1 + size.argmax(axis=1), 1).tolist()
    by_block = found.by_block[: e.blocks]
    followed = [by_block[:, j, k] - 1j * by_block[:, j, H + k] for j, k in enumerate(lead)]
    even, turning = _even(measured.time, found.residual), 2.0 * np.pi * float(np.nan_to_num(e.hz_std))
    return tuple(
        ChannelQuality(
            name=name,
            harmonic=lead[j],
            amplitude=float(size[j, lead[j] - 1]),
            std=float(e.own_std[j, lead[j]]),
            correlation=float(rho[j, lead[j]]),
            steadiness=steadiness(middles, followed[j], turning * lead[j]),
            leftover=leftover(even[:, j], float(np.std(own)), e.periods, e.hz),
            clipped=flat[j],
            jump=jump(middles, followed[j]),
            spike=spike(measured.time, own, found.residual[:, j], e.periods),
        )
        for j, (name, own) in enumerate(measured.channels.items())
    )


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
