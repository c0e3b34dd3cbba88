"""Slow sine sweeps as quasi-steady harmonics, each with what it may be off because the sweep does not stand still.

In windows of a few cycles every channel is s(t) = Re sum (c_k + t d_k) exp(i k phi(t)), phi the phase of a reference
channel. What linear modes lag by behind their steady states is common to all windows of a sweep and of a sign of its
own. It is found from the sweep (:mod:`hbm.measurement.lag`) and taken off; what the modes do not describe is added to
the standard deviations.

A response that is not that of linear modes keeps its lag. In the frame of the reference the amplitude of one mode obeys
dX/dt = (sigma - i omega) X + b F, with sigma = -zeta omega_n + i omega_d. The measured X, dX/dt and F on the flanks of
the highest peak say what sigma is, however fast the sweep was; |dX/dt / (sigma - i omega)| is how far X is from the
steady state at this frequency. So does in every window how X/F changes with the frequency, which is as 1/(i omega -
sigma): where friction begins to slip that is slower than the flanks say. Half of the square of the larger of both is
added to the variance of each of cos and sin.

The frequency of harmonic k moves k times as fast, and may cross a mode above the sweep, of which nothing else is known.
Its lag obeys the same equation and is at most |dX_k/dt| over the decay rate of that mode. The slowest decay of the
highest peaks of the fundamental stands for it: modes above mostly decay faster.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.signal import hilbert

from hbm.errors import InputError
from hbm.fourier import Array, coefficients_of
from hbm.measurement.heard import unheard, unheard_of
from hbm.measurement.lag import drive_of, not_described, off_steady, shares, smooth
from hbm.measurement.recording import Recording, constant
from hbm.measurement.spectra import AT, MeasuredSpectra

Complex = npt.NDArray[np.complex128]

CYCLES = 4
"""Cycles of a window."""

ENDS = 4 * np.pi
"""Phase left out at both ends, where the analytic signal of the reference is not known."""

FLANKS = 0.4
"""Windows belong to a peak down to this part of its height."""

FEWEST = 6
"""Windows on a peak, at least, to tell how fast a sweep may be; fewer are too fast to tell."""

DESCRIBED = 0.1
"""Modes describe a response of which they leave at most this part of its lag. Where friction slips they may leave less
than the lag by poles that no mode has, and the lag by those is not that of the response."""

SLOW = 0.9
"""A linear sweep is slow that passes less than this times the square of the half-power bandwidth in a second:
54 (f/Q)^2 a minute, ISO 7626-2; reviewed by G. Gloth, M. Sinapius, MSSP 18 (2004) 1421-1441."""


@dataclass(frozen=True, eq=False)
class Sweep:
    """Harmonics of c channels in w windows of one sweep.

    Attributes
    ----------
    source : str
    channels : tuple of str
    time, half, phase : (w,) array
        Middle of each window [s], half its length [s] and the phase of the reference there [rad].
    hz, hz_std, rate : (w,) array
        Frequency there, its standard deviation [Hz] and how fast it changes [Hz/s], by the phases of windows around it.
    amplitudes, slopes : (w, c, H+1) complex array
        c_k, s = Re sum c_k exp(i k phi), phases by the reference, and their rates of change [1/s].
    std : (w, c, H+1) array
        Standard deviation of each of cos and sin by what is left in the window.
    seen : (w, 2, i) complex array
        What a window sees of instants, of :func:`hbm.measurement.lag.shares`, at the fundamental.
    dead, silent : tuple of str
        Constant channels, and those of noise alone while others move, left out.
    """

    source: str
    channels: tuple[str, ...]
    time: Array
    half: Array
    phase: Array
    hz: Array
    hz_std: Array
    rate: Array
    amplitudes: Complex
    slopes: Complex
    std: Array
    seen: Complex
    dead: tuple[str, ...] = ()
    silent: tuple[str, ...] = ()


@dataclass(frozen=True)
class Passage:
    """How a response passed its highest peak.

    Attributes
    ----------
    channel : str
    hz, bandwidth : float
        Resonance and its half-power bandwidth [Hz], by the motion of the amplitude.
    rate : float
        How fast the sweep was there [Hz/s].
    sigma, residual : complex
        Exponent of the mode [1/s]; what the other modes respond per force.
    """

    channel: str
    hz: float
    bandwidth: float
    rate: float
    sigma: complex
    residual: complex

    @property
    def slow(self) -> float:
        """How fast the sweep may be [Hz/s]."""
        return SLOW * self.bandwidth**2

    @property
    def warning(self) -> str | None:
        """What speaks against the sweep."""
        if self.rate <= self.slow:
            return None
        return (
            f"swept too fast for {self.channel}: {self.rate:.3g} Hz/s at {self.hz:.5g} Hz, where the half-power "
            f"bandwidth is {self.bandwidth:.3g} Hz; at most {self.slow:.2g} Hz/s (ISO 7626-2)"
        )


def swept(recorded: Recording, reference: str, harmonics: int = 5, cycles: int = CYCLES) -> Sweep:
    """Harmonics of a sweep along the phase of a reference channel.

    Parameters
    ----------
    recorded : Recording
        Evenly sampled.
    reference : str
        Channel of one frequency at a time, the force or the voltage of the shaker.
    harmonics : int
        Highest harmonic H.
    cycles : int
        Of a window; windows do not overlap.

    Raises
    ------
    InputError
        If there is no such channel, it is constant, steps of time differ, there are not two windows, a harmonic is
        above half the sampling rate, or the frequency stays or is none.
    """
    recorded.expect_channel(reference)
    recorded.expect_even("to follow a sweep")
    names, Y = list(recorded.channels), np.column_stack(list(recorded.channels.values()))
    dead = tuple(name for name, still in zip(names, constant(Y), strict=True) if still)
    if reference in dead:
        raise InputError(f"{recorded.source}: {reference} is constant; must move, it gives the phase")
    recorded = replace(recorded, channels={n: y for n, y in recorded.channels.items() if n not in dead})
    y = recorded.channels[reference]
    phase = np.unwrap(np.angle(hilbert(y - y.mean())))
    edges = np.arange(phase[0] + ENDS, phase[-1] - ENDS, 2 * np.pi * cycles)
    places = np.searchsorted(np.maximum.accumulate(phase), edges)
    rows = list(_windows(recorded, phase, places.tolist(), harmonics))
    if len(rows) < 2:
        raise InputError(
            f"{recorded.source}: fewer than {2 * cycles} cycles of {reference}; must have two windows of {cycles}"
        )
    time, half, along, amplitudes, slopes, std, seen = (np.array(column) for column in zip(*rows, strict=True))
    size, own = (np.abs(part[:, :, 1:]) for part in (amplitudes, std))
    clear = np.divide(size, own, out=np.full(size.shape, np.inf), where=own > 0.0)
    if (quiet := unheard(clear.swapaxes(0, 1).reshape(len(recorded.channels), -1))).any():
        silent = tuple(name for name, no in zip(recorded.channels, quiet, strict=True) if no)
        heard = {name: y for name, y in recorded.channels.items() if name not in silent}
        return replace(swept(replace(recorded, channels=heard), reference, harmonics, cycles), dead=dead, silent=silent)
    motion = smooth(time, along)
    hz, hz_std, rate = (values.real / (2 * np.pi) for values in (motion.first, motion.std, motion.second))
    _expect_sweep(recorded, reference, time, hz)
    channels = tuple(recorded.channels)
    return Sweep(recorded.source, channels, time, half, along, hz, hz_std, rate, amplitudes, slopes, std, seen, dead)


def _expect_sweep(recorded: Recording, reference: str, time: Array, hz: Array) -> None:
    """Refuse a recording that has no frequency, or one that changes by less than it could tell apart."""
    if hz.min() <= 0.0:
        raise InputError(
            f"{recorded.source}: the phase of {reference} does not go on at {time[hz.argmin()]:.4g} s; must be of one "
            "frequency at a time, without a pause; try --settle, a manifest with begin_s and end_s, or --reference"
        )
    least = 1.0 / float(recorded.time[-1] - recorded.time[0])
    change = float(np.ptp(np.polynomial.Polynomial.fit(time, hz, min(2, len(hz) - 1))(time)))
    if change < least:
        raise InputError(
            f"{recorded.source}: {reference} stays at {float(hz.mean()):.4g} Hz; must be a sweep, of {least:.2g} Hz at "
            "least over this time; spectra of a steady state are made without --sweep"
        )


def _windows(
    recorded: Recording, phase: Array, places: list[int], H: int
) -> Iterator[tuple[float, float, float, Complex, Complex, Array, Complex]]:
    t, Y = recorded.time, np.column_stack(list(recorded.channels.values()))
    least = np.finfo(float).eps * np.std(Y, axis=0)[:, None]  # what the arithmetic can resolve
    for first, last in pairwise(places):
        half = 0.5 * (t[last] - t[first])
        x = (t[first:last] - t[first] - half) / half
        along = np.polynomial.Polynomial.fit(x, phase[first:last], 2, domain=(-1.0, 1.0))
        hz = float(along.deriv()(0.0)) / (2 * np.pi * half)
        if 2 * H * hz * recorded.step >= 1.0:
            raise InputError(
                f"{recorded.source}: harmonic {H} of {hz:.4g} Hz; must be below {0.5 / recorded.step:.6g} Hz, half the "
                "sampling rate"
            )
        waves = np.exp(1j * np.outer(along(x), np.arange(1, H + 1)))
        A = np.column_stack([np.ones(len(x)), waves.real, -waves.imag])  # Re c exp(i k phi), by real and imaginary part
        A = np.concatenate([A, x[:, None] * A], axis=1)
        inverse = np.linalg.pinv(A)
        found = inverse @ Y[first:last]
        left = Y[first:last] - A @ found
        noise = np.sum(left**2, axis=0) / max(len(x) - A.shape[1] - 2, 1)  # of Student's distribution
        variance = np.outer(noise, np.sum(inverse**2, axis=1)[: 2 * H + 1])
        both = 0.5 * (variance[:, 1 : H + 1] + variance[:, H + 1 :])
        amplitudes, slopes = (_complex(part.T, H) for part in (found[: 2 * H + 1], found[2 * H + 1 :] / half))
        std = np.maximum(np.sqrt(np.column_stack([variance[:, 0], both])), least)
        seen = shares(x, waves[:, 0], inverse[1] + 1j * inverse[H + 1])
        yield t[first] + half, half, float(along(0.0)), amplitudes, slopes, std, seen


def _complex(parts: Array, H: int) -> Complex:
    """Complex amplitudes (c, H+1) of a mean, real and imaginary parts (c, 2H+1)."""
    return np.asarray(np.column_stack([parts[:, 0], parts[:, 1 : H + 1] + 1j * parts[:, H + 1 :]]))


# -------------------------------------------------------------------------------------------------------------- passing


def passage(sweep: Sweep, channel: str, force: str) -> Passage | None:
    """How a response passed its highest peak per force; None where too few windows, or no damped mode, tell."""
    X, F = (sweep.amplitudes[:, sweep.channels.index(name), 1] for name in (channel, force))
    dX, dF = (sweep.slopes[:, sweep.channels.index(name), 1] for name in (channel, force))
    size = np.abs(X / F)
    top = int(size.argmax())
    low = np.flatnonzero(size < FLANKS * size[top])
    first = int(low[low < top].max(initial=-1)) + 1
    own = slice(first, int(low[low > top].min(initial=len(size))))
    omega = 2 * np.pi * sweep.hz[own]
    if len(omega) < FEWEST or not size[top] > 0.0:
        return None
    columns = np.column_stack([X[own], F[own], dF[own] + 1j * omega * F[own]])
    weight = 1.0 / np.linalg.norm(columns, axis=0)
    sigma, _, residual = weight * np.linalg.lstsq(columns * weight, dX[own] + 1j * omega * X[own], rcond=None)[0]
    if sigma.real >= 0.0:
        return None
    bandwidth = -sigma.real / np.pi
    rate = abs(float(np.polyfit(sweep.time[own], sweep.hz[own], 1)[0]))
    return Passage(channel, float(sigma.imag) / (2 * np.pi), float(bandwidth), rate, sigma, residual)


def sweep_spectra(sweeps: list[Sweep], force: str, source: str = "sweeps") -> MeasuredSpectra:
    """Sweeps as records of quasi-steady harmonics, named after the sweep and the frequency.

    Parameters
    ----------
    sweeps : list of Sweep
        Of the same H.
    force : str
        The channel of the force; its median amplitude is the level.
    source : str

    Returns
    -------
    MeasuredSpectra
        With what speaks against the sweep in the notes of the record at the peak.

    Raises
    ------
    InputError
        If a sweep has no force that moves.
    """
    names: list[str] = []
    notes: list[tuple[int, str]] = []
    coefficients, std, level = [], [], []
    stems = [Path(sweep.source).stem for sweep in sweeps]
    if len(set(stems)) < len(stems):
        stems = [f"{stem}-{i}" for i, stem in enumerate(stems, start=1)]
    channels = tuple(dict.fromkeys(name for sweep in sweeps for name in sweep.channels))
    for stem, sweep in zip(stems, sweeps, strict=True):
        if force not in sweep.channels:
            raise InputError(f"{sweep.source}: no channel {force} that moves; must have it, by it responses are judged")
        passages = {name: passage(sweep, name, force) for name in sweep.channels if name != force}
        steady, own = _among(channels, sweep, *_steady(sweep, force, passages))
        notes += [(len(names) + 1 + at, text) for at, text in _notes(sweep, passages)]
        coefficients.append(steady)
        std.append(own)
        level.append(np.full(len(sweep.hz), np.median(np.abs(sweep.amplitudes[:, sweep.channels.index(force), 1]))))
        names += [f"{stem}{AT}{hz:.6g}Hz" for hz in sweep.hz]
    return MeasuredSpectra(
        source=source,
        records=np.arange(1, len(names) + 1),
        level=np.concatenate(level),
        hz=np.concatenate([s.hz for s in sweeps]),
        channels=channels,
        coefficients=np.concatenate(coefficients),
        std=np.concatenate(std),
        notes=tuple(notes),
        names=tuple(names),
    )


def _among(channels: tuple[str, ...], sweep: Sweep, amplitudes: Complex, std: Array) -> tuple[Array, Array]:
    """Coefficients (w, c, 2H+1) and deviations (w, c, H+1) of a sweep among channels of all, nan where it has none."""
    own, H = [channels.index(name) for name in sweep.channels], std.shape[2] - 1
    shape = len(std), len(channels)
    coefficients, deviations = np.full((*shape, 2 * H + 1), np.nan), np.full((*shape, H + 1), np.nan)
    coefficients[:, own], deviations[:, own] = coefficients_of(amplitudes), std
    return coefficients, deviations


def _notes(sweep: Sweep, passages: Mapping[str, Passage | None]) -> Iterator[tuple[int, str]]:
    """What speaks against a sweep, each with the window it is seen in."""
    yield from ((0, f"{name} is constant: left out") for name in sweep.dead)
    yield from ((0, unheard_of(name)) for name in sweep.silent)
    for channel, passed in passages.items():
        untold = f"{channel} passes no peak of {FEWEST} windows or more, which would say how fast is slow"
        warning = untold if passed is None else passed.warning
        if warning:
            j = sweep.channels.index(channel)
            at = sweep.hz[np.abs(sweep.amplitudes[:, j, 1]).argmax()] if passed is None else passed.hz
            yield int(np.argmin(np.abs(sweep.hz - at))), warning


def _steady(sweep: Sweep, force: str, passages: Mapping[str, Passage | None]) -> tuple[Complex, Array]:
    """Steady amplitudes (w, c, H+1), with the standard deviation of each of cos and sin."""
    amplitudes, std = sweep.amplitudes.copy(), _of_windows(sweep)
    i = sweep.channels.index(force)
    others = [j for j in range(len(sweep.channels)) if j != i]
    X, F = amplitudes[:, others, 1], amplitudes[:, i, 1]
    own = np.hypot(std[:, others, 1], np.abs(X / F[:, None]) * std[:, [i], 1])
    drive = drive_of(sweep.time, sweep.half, sweep.phase, F, sweep.seen)
    off, left = off_steady(drive, X, own)
    fundamental = np.arange(amplitudes.shape[2]) == 1
    for j, by, rest, noise in zip(others, off.T, left.T, own.T, strict=True):
        share, here = not_described(by, rest, noise)
        size = np.abs(amplitudes[:, j])
        relative = np.divide(np.abs(by), size[:, 1], out=np.zeros_like(here), where=size[:, 1] > 0.0)
        if share < DESCRIBED:
            amplitudes[:, j, 1] -= by
        else:
            here, passed = np.ones_like(here), passages[sweep.channels[j]]
            relative = np.maximum(_off_here(sweep, j, i), relative if passed is None else _lag(sweep, passed, force))
        may = np.where(fundamental, np.minimum(here, 1.0)[:, None], 1.0)  # it alone was mended
        std[:, j] = np.hypot(std[:, j], relative[:, None] * may * size / np.sqrt(2.0))
    decay = min((-p.sigma.real for p in passages.values() if p is not None), default=np.inf)
    for j, k in product(others, range(2, amplitudes.shape[2])):
        std[:, j, k] = np.hypot(std[:, j, k], _change(sweep.time, amplitudes[:, j, k]) / decay / np.sqrt(2.0))
    return amplitudes, std


def _change(time: Array, X: Complex) -> Array:
    """How fast amplitudes (w,) change beyond their noise [1/s], (w,)."""
    motion = smooth(time, X)
    return np.asarray(np.sqrt(np.maximum(np.abs(motion.first) ** 2 - motion.std**2, 0.0)))


def _of_windows(sweep: Sweep) -> Array:
    """Standard deviation of each of cos and sin by the noise of a window and of its frequency, (w, c, H+1)."""
    speed = np.maximum(np.abs(sweep.rate), np.median(np.abs(sweep.rate)))
    late = np.divide(sweep.hz_std, speed, out=np.zeros_like(speed), where=speed > 0.0)
    return np.asarray(np.hypot(sweep.std, late[:, None, None] * np.abs(sweep.slopes) / np.sqrt(2.0)))


def _off_here(sweep: Sweep, channel: int, force: int) -> Array:
    """How far the fundamental is from the steady state, relative, if it is that of one mode here and now, (w,).

    Its steady state b F/(i omega - sigma) changes by d log(X/F) = -i d omega/(i omega - sigma) with the frequency: by
    how much says how fast the response settles, also where friction slips and no exponent holds on both flanks.
    """
    X, F = sweep.amplitudes[:, channel, 1], sweep.amplitudes[:, force, 1]
    whole = (X != 0.0) & (F != 0.0)
    H = np.divide(X, F, out=np.zeros_like(X), where=whole)
    own, of = (_change(sweep.time, Y) / np.where(whole, np.abs(Y), np.inf) for Y in (X, H))
    speed = 2 * np.pi * np.abs(sweep.rate)
    return np.divide(own * of, speed, out=np.zeros_like(speed), where=speed > 0.0)


def _lag(sweep: Sweep, passed: Passage, force: str) -> Array:
    """How far the fundamental of a response is from the steady state, relative, (w,)."""
    i, j = sweep.channels.index(force), sweep.channels.index(passed.channel)
    moving = sweep.slopes[:, j, 1] - passed.residual * sweep.slopes[:, i, 1]
    return np.asarray(np.abs(moving / (passed.sigma - 2j * np.pi * sweep.hz)) / np.abs(sweep.amplitudes[:, j, 1]))
