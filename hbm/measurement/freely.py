"""What speaks against a decay: a force that still acts, modes that beat, other modes that joints feel as well."""

import numpy as np

from hbm.fourier import Array
from hbm.measurement.recording import Recording

GROWN = 1.2
"""A motion is not free that grows by this factor from one window to another."""

RISE, SURE = 3.0, 3.0
"""Nor is one of which the damping force rises by this factor as it falls, by so many standard deviations: that of
Coulomb friction stays, others fall."""

COUNTS = 0.025
"""Other modes count that move by this share of what the one in the band does. In a frame with an Iwan
joint and a cubic spring friction took 6 to 9 % more of a mode than of that alone beside 0.034, and 2 % beside 0.018."""

CLEAR = 20.0
"""Lines count of so many times the median power of those above the band: of noise one in a million has as much."""

LOBE = 2
"""Lines of a Hann window on either side of its middle."""

POWERS = {"m": 0, "m/s": 1, "m/s2": 2}
"""By which power of the frequency the unit is larger than a displacement."""


def not_free(source: str, channel: str, until: Array, amplitude: Array, ratio: Array, std: Array) -> tuple[str, ...]:
    """Warning of windows (m,) that no free decay has: a motion that grows, or is damped by more as it falls."""
    grown = np.flatnonzero(amplitude[1:] > GROWN * np.minimum.accumulate(amplitude)[:-1])
    lost, of_lost = amplitude * ratio, amplitude * std
    more = lost - RISE * np.maximum(lost, 0.0)[:, None]
    rises = np.flatnonzero(np.triu(more > SURE * np.hypot(of_lost, RISE * of_lost[:, None]), 1).any(axis=1))
    if len(grown):
        i, said = int(grown[-1]), "grows"
    elif len(rises):
        i, said = int(rises[-1]), "is damped by more as it falls"
    else:
        return ()
    return (
        f"{source}: {channel} {said}: a force acts until {until[i + 1]:.4g} s, or two modes beat. Leave out what is "
        "before (--settle), or take another band",
    )


def other_modes(
    recorded: Recording, channel: str, high: float, hz: Array, length: int, begin: Array
) -> tuple[str, ...]:
    """Warning of modes above the band that move the channel by a share that counts, as displacements compare.

    Lines beside multiples of its frequency there are those of the mode itself. A unit that is not stated is taken for
    that of an acceleration, of which high frequencies count least.

    Parameters
    ----------
    recorded : Recording
    channel : str
    high : float
        Upper end of the band [Hz].
    hz : (m,) array
        Frequency of the mode in each piece [Hz].
    length : int
        Samples of a piece.
    begin : (m,) array
        Times at which pieces begin [s].
    """
    step, y = recorded.step, recorded.channels[channel]
    f = np.fft.rfftfreq(length, step)
    width = LOBE / (length * step)
    shares = []
    for first, mode in zip(np.round((begin - recorded.time[0]) / step).astype(int), hz, strict=True):
        above = (f > high + width) & (np.abs(f - mode * np.round(f / mode)) > width)
        own = np.abs(f - mode) <= width
        weight = (mode / np.maximum(f, f[1])) ** POWERS.get(recorded.units.get(channel, ""), 2)
        piece = y[first : first + length]
        power = np.abs(np.fft.rfft((piece - piece.mean()) * np.hanning(len(piece)), length)) ** 2
        others = above & (power > CLEAR * np.median(power[above]))
        moved = power * weight**2
        shares.append(float(np.sqrt(np.sum(moved[others]) / np.sum(moved[own]))))
    counting = np.flatnonzero(np.array(shares) > COUNTS)
    if not len(counting):
        return ()
    until = begin[counting[-1]] + length * step
    return (
        f"{recorded.source}: until {until:.3g} s modes above {high:g} Hz move {channel} by up to {max(shares):.1%} of "
        "what this one does: a joint that is not linear feels all of them. Leave that out (--settle) beside a rig",
    )
