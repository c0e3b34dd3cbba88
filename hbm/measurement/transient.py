"""Frequency responses from a time history that begins and ends at rest: hits with a hammer, a burst, a chirp.

The spectrum of all that a structure did is its response times that of all that it was given, at every line of the
recording and without a window: nothing leaks, no damping is added, and hits may follow each other before all is still.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from scipy import fft
from scipy.ndimage import median_filter

from hbm.errors import InputError
from hbm.fourier import Array
from hbm.measurement.clipping import clipped_from_rest, flat_topped
from hbm.measurement.recording import Recording
from hbm.measurement.responses import SHARP, Complex, FrequencyResponses
from hbm.measurement.spikes import spike_from_rest

REST, FEW = 0.02, 20
"""At rest is the first and last part of a recording, of so many samples at least."""

STILL = 0.01
"""At rest a channel moves by less than this part of its largest, or no more than before the force."""

DRIVEN = 0.1
"""Lines are used at which the force is at least this part of its largest line."""

DEAD = 1.5
"""A channel that moves by less than so many times what it does at rest answers nothing."""

SENT = 6.0
"""Standard deviations at rest from which a force acts."""

LEAST = 1e-9
"""Least noise of a channel, of its largest value."""

CLEAR, LOBE, BESIDE = 50.0, 2, 20
"""At rest a line counts of so many times the median power beside it, of which few may have half; lines of a Hann window
on either side of its middle, and lines on either side that are beside it."""


class _Lines(NamedTuple):
    """Spectrum of a channel, standard deviations of both of its parts, and what speaks against it."""

    values: Complex
    noise: Array
    said: list[str]


def responses_from_rest(recorded: Recording, force: str, channels: Mapping[str, str]) -> FrequencyResponses:
    """Frequency responses at the lines that a force drives, with the noise at rest as their standard deviation.

    Parameters
    ----------
    recorded : Recording
        At rest for its first and last 2 %.
    force : str
        Channel of the force.
    channels : mapping of str to str
        Quantity of each response.

    Raises
    ------
    InputError
        If a channel is not there, is constant, its steps of time differ, or it does not begin and end at rest.
    """
    _expect_complete(recorded, (force, *channels))
    few = max(int(REST * len(recorded.time)), FEW)
    lines = {name: _from_rest(recorded, name, few) for name in (force, *channels)}
    X, force_noise, _ = lines[force]
    size = np.abs(X)
    there = (size >= DRIVEN * size[1:].max()) & (force_noise < SHARP * size)
    there[0] = False
    kept = np.flatnonzero(there)
    moved = [lines[name] for name in channels]
    return FrequencyResponses(
        kept / (recorded.step * len(recorded.time)),
        dict(channels),
        np.column_stack([m.values[kept] / X[kept] for m in moved]),
        np.column_stack([m.noise[kept] / size[kept] for m in moved]),
        force_noise[kept] / size[kept],
        warnings=(*(line for own in lines.values() for line in own.said), *_spiky(recorded, force, channels, few)),
    )


def _spiky(recorded: Recording, force: str, channels: Mapping[str, str], few: int) -> Iterator[str]:
    """Channels with spikes while no force acts."""
    read = recorded.channels[force] - recorded.channels[force][:few].mean()
    acts = np.abs(read) > max(SENT * float(np.std(read[:few])), STILL * float(np.abs(read).max()))
    for name in channels:
        found = spike_from_rest(recorded.time, recorded.channels[name], acts)
        if found is not None:
            yield (
                f"{name} has a spike at {found.time:.5g} s, {found.size:.3g} times what is beside it, and no force acts"
                " then: look for a loose plug or a knock, and record again"
            )


def _expect_complete(recorded: Recording, names: tuple[str, ...]) -> None:
    for name in names:
        recorded.expect_channel(name)
    recorded.expect_even("to find frequency responses")
    if len(recorded.time) < 4 * FEW:
        raise InputError(f"{recorded.source}: {len(recorded.time)} samples; must be at least {4 * FEW}")


def _from_rest(recorded: Recording, name: str, few: int) -> _Lines:
    """Lines of a channel and their noise: that at rest, and what a line such as of mains leaks into those beside it."""
    values = recorded.channels[name]
    signal = values - values[:few].mean()
    first, last = (float(np.std(part)) for part in (signal[:few], signal[-few:]))
    largest = float(np.abs(signal).max())
    if not largest:
        raise InputError(f"{recorded.source}: {name} is constant; must move, or be left out of the file")
    if STILL * largest < first < DEAD * last and float(np.std(signal)) < DEAD * first:
        raise InputError(
            f"{recorded.source}: {name} moves no more than before the first hit: is it dead? Must move, or be left out "
            "of the file"
        )
    for moves, when, than in ((first, "first", 0.0), (last, "last", 2.0 * first)):
        if moves > max(STILL * largest, than):
            raise InputError(
                f"{recorded.source}: {name} moves by {moves / largest:.1%} of its largest in the {when} "
                f"{few * recorded.step:.3g} s; must be at rest there, to {STILL:.0%}: record from before the first hit "
                "until all has died out"
            )
    said, N = [flat_topped(name)] if clipped_from_rest(signal, first) else [], len(values)
    steady, leaked = _line_at_rest(signal[:few], recorded.step), np.zeros(N // 2 + 1)
    if steady is not None:
        hz, amplitude = steady
        first = float(np.sqrt(max(first**2 - amplitude**2 / 2.0, 0.0)))
        apart = np.pi * np.abs(np.arange(N // 2 + 1) / N - hz * recorded.step)
        leaked = amplitude / np.sqrt(8.0) / np.maximum(apart, 1.0 / N)
        said.append(
            f"{name} has a line at {hz:.4g} Hz at rest, of {amplitude / largest:.2%} of its largest: what it leaks "
            "counts as noise, and modes beside it are less certain. Look for its source, such as mains"
        )
    return _Lines(fft.rfft(signal), np.hypot(max(first, LEAST * largest) * np.sqrt(N / 2.0), leaked), said)


def _line_at_rest(signal: Array, step: float) -> tuple[float, float] | None:
    """Frequency [Hz] and amplitude of the highest line that stands out of those beside it, None where none does."""
    window, fine = np.hanning(len(signal)), 64
    power = np.abs(fft.rfft(np.diff(signal) * window[1:])) ** 2  # of differences, of which drifts are no lines
    clear = power / np.maximum(median_filter(power, 2 * BESIDE + 1, mode="mirror"), np.finfo(float).tiny)
    top = int(np.argmax(clear[:-LOBE]))
    if top <= LOBE or clear[top] <= CLEAR:
        return None
    padded = np.abs(fft.rfft(signal * window, fine * len(signal)))
    first = fine * (top - 1)
    at = first + int(np.argmax(padded[first : fine * (top + 1) + 1]))
    return at / (fine * len(signal) * step), 2.0 * float(padded[at]) / float(window.sum())
