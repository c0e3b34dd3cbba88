"""Frequency responses from a time history that begins and ends at rest: hits with a hammer, a burst, a chirp.

The spectrum of all that a structure did is its response times that of all that it was given, at every line of the
recording and without a window: nothing leaks, no damping is added, and hits may follow each other before all is still.
"""

from collections.abc import Iterator, Mapping

import numpy as np
from scipy import fft

from hbm.errors import InputError
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

SENT = 6.0
"""Standard deviations at rest from which a force acts."""

LEAST = 1e-9
"""Least noise of a channel, of its largest value."""


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
    said = [flat_topped(name) for name, (*_, flat) in lines.items() if flat]
    return FrequencyResponses(
        kept / (recorded.step * len(recorded.time)),
        dict(channels),
        np.column_stack([Y[kept] / X[kept] for Y, *_ in moved]),
        np.column_stack([noise / size[kept] for _, noise, _ in moved]),
        force_noise / size[kept],
        warnings=(*said, *_spiky(recorded, force, channels, few)),
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


def _from_rest(recorded: Recording, name: str, few: int) -> tuple[Complex, float, bool]:
    """Lines of a channel, the standard deviation of each of their parts, and whether it is flat-topped."""
    values = recorded.channels[name]
    signal = values - values[:few].mean()
    first, last = (float(np.std(part)) for part in (signal[:few], signal[-few:]))
    largest = float(np.abs(signal).max())
    if not largest:
        raise InputError(f"{recorded.source}: {name} is constant; must move, or be left out of the file")
    for moves, when, than in ((first, "first", 0.0), (last, "last", 2.0 * first)):
        if moves > max(STILL * largest, than):
            raise InputError(
                f"{recorded.source}: {name} moves by {moves / largest:.1%} of its largest in the {when} "
                f"{few * recorded.step:.3g} s; must be at rest there, to {STILL:.0%}: record from before the first hit "
                "until all has died out"
            )
    noise = max(first, LEAST * largest) * np.sqrt(len(values) / 2.0)
    return fft.rfft(signal), float(noise), clipped_from_rest(signal, first)
