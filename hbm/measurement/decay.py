"""Free decays: frequency and damping ratio of one mode over its amplitude.

A band of frequencies is cut out and turned to rest (complex demodulation); what is left, A exp(i phi), changes slowly.
In short windows its logarithm is a straight line over time: the slope is -zeta omega + i (omega - omega_0). Samples are
taken so far apart that the band's noise is independent from one to the next, so that what they scatter about the line
says what the slope is known to. So does a tone that goes on beneath (:mod:`hbm.measurement.tone`).

Decays of the same structure are put together by amplitude (:func:`over_amplitude`): what they differ by is the
uncertainty then, and what may change within a window. That is a bias common to all blows, so that five alike are known
no better than one where it is the larger part.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import numpy as np
import numpy.typing as npt

from hbm.errors import InputError
from hbm.fourier import Array
from hbm.labelled import frame
from hbm.measurement.clipping import clipped, flat_topped
from hbm.measurement.freely import not_free, other_modes
from hbm.measurement.recording import Recording
from hbm.measurement.tone import Tone, steady_tone
from models.display import Displayed

CYCLES, FALL = 16, 1.5
"""Periods of a window; it ends before where the amplitude has fallen by this factor, for damping changes with that."""

FEWEST = 5
"""Independent samples in a window, at least."""

NEIGHBOURS = 2
"""Windows beside one that tell whether its slope changes."""

LEAST = 0.003
"""Amplitudes below this part of the largest, or below `CLEAR` times the noise, are left out."""

CLEAR = 10.0

BINS = 12
"""Amplitudes of a table, evenly spaced in their logarithm."""


@dataclass(frozen=True, eq=False)
class Decay(Displayed):
    """Frequency and damping ratio over amplitude, (m,) arrays.

    Attributes
    ----------
    source : str
    channel, unit : str
        What the amplitude is of; a unit that was not stated is empty.
    amplitude : (m,) array
        Of the mode's motion, falling.
    hz, hz_std : (m,) array
        Frequency and its standard deviation [Hz].
    damping_ratio, damping_ratio_std : (m,) array
        Rate of decay over angular frequency.
    decays : int
        Recordings it is made of.
    warnings : tuple of str
        What speaks against the recordings, one sentence each.
    """

    source: str
    channel: str
    unit: str
    amplitude: Array
    hz: Array
    hz_std: Array
    damping_ratio: Array
    damping_ratio_std: Array
    decays: int = 1
    warnings: tuple[str, ...] = ()

    def __len__(self) -> int:
        """Number of amplitudes."""
        return len(self.amplitude)

    def __repr__(self) -> str:
        """Say what was found."""
        unit = self.unit or "(unit not stated)"
        return (
            f"{self.source}: {self.channel} from {self.amplitude[0]:.4g} to {self.amplitude[-1]:.4g} {unit}: "
            f"{self.hz[0]:.7g} +/- {self.hz_std[0]:.1g} to {self.hz[-1]:.7g} +/- {self.hz_std[-1]:.1g} Hz, "
            f"damping ratio {self.damping_ratio[0]:.4g} +/- {self.damping_ratio_std[0]:.1g} to "
            f"{self.damping_ratio[-1]:.4g} +/- {self.damping_ratio_std[-1]:.1g}"
        )

    @property
    def channels(self) -> tuple[str, ...]:
        """The channel, as the channels of other measurements."""
        return (self.channel,)

    @property
    def records(self) -> npt.NDArray[np.int64]:
        """Numbers of its rows."""
        return np.arange(1, len(self) + 1)

    @property
    def level(self) -> Array:
        """Amplitude of each row."""
        return self.amplitude

    @property
    def notes(self) -> tuple[tuple[int, str], ...]:
        """What speaks against a row: nothing is known."""
        return ()

    def labels_of(self, records: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        """What rows are called: their numbers."""
        return records

    @property
    def columns(self) -> dict[str, npt.NDArray[Any]]:
        """Columns of a table, by name."""
        return {
            "channel": np.full(len(self), self.channel),
            "amplitude": self.amplitude,
            "frequency_hz": self.hz,
            "frequency_hz_std": self.hz_std,
            "damping_ratio": self.damping_ratio,
            "damping_ratio_std": self.damping_ratio_std,
        }

    def to_dataframe(self) -> Any:
        """Same table, as a pandas.DataFrame.

        Raises
        ------
        InputError
            If pandas is not installed.
        """
        return frame("to_dataframe", self.columns)


def free_decay(recorded: Recording, channel: str, band: tuple[float, float]) -> Decay:
    """Frequency and damping ratio of a mode in one free decay.

    Parameters
    ----------
    recorded : Recording
        Evenly sampled; nothing excites the structure.
    channel : str
    band : (float, float)
        Frequencies between which the mode is alone [Hz].

    Returns
    -------
    Decay
        One amplitude a window, the windows side by side. What comes before the last sample of a flat top is left out.

    Raises
    ------
    InputError
        If the channel is not there, steps of time differ, the band is not within half the sampling rate, or the
        recording is too short, or what flat tops leave of it, or begins at rest.

    References
    ----------
    M. Feldman, Hilbert transform in vibration analysis, MSSP 25 (2011) 735-802, for free vibration.
    """
    kept, warnings = _below_flat_tops(recorded, channel)
    t, z, hz, apart = _demodulated(kept, channel, band)
    size = max(FEWEST, round(CYCLES / hz / apart))
    falls = _smooth(np.abs(z), size)
    tone = steady_tone(t, z)
    if tone is not None:
        warnings += (f"{kept.source}: {channel} {tone.said(hz)}",)
    below = float(np.hypot(_noise(z), tone.amplitude if tone else 0.0))
    clear = falls > max(CLEAR * below, LEAST * falls.max())
    if clear.any() and not clear[0]:
        raise InputError(
            f"{kept.source}: {channel} is at rest for {t[int(np.argmax(clear))] - kept.time[0]:.3g} s between "
            f"{band[0]:g} and {band[1]:g} Hz; must begin in motion: leave out what is before (--settle)"
        )
    end = len(z) if clear.all() else int(np.argmin(clear))
    windows = list(_windows(falls[:end], size))
    if not windows:
        hint = f"{channel} {tone.said(hz)}" if tone else "try a wider band"
        raise InputError(
            f"{kept.source}: {channel} stands out of the noise for {end * apart:.3g} s between {band[0]:g} and "
            f"{band[1]:g} Hz; must be {size * apart:.3g} s at least; {hint}"
        )
    rows = [_window(t[i:j], z[i:j], falls[i:j], tone) for i, j in windows]
    amplitude, slope, noise = (np.array(column) for column in zip(*rows, strict=True))
    omega = 2 * np.pi * hz + slope.imag
    hz_std, rate_std = (_deviations(part, noise) for part in (slope.imag, slope.real))
    until = t[[j - 1 for _, j in windows]]
    length, begin = round(CYCLES / (hz * kept.step)), t[[i for i, _ in windows]]
    warnings += not_free(kept.source, channel, until, amplitude, -slope.real / omega, rate_std / omega) or other_modes(
        kept, channel, band[1], omega / (2 * np.pi), length, begin
    )
    return Decay(
        source=recorded.source,
        channel=channel,
        unit=recorded.units.get(channel, ""),
        amplitude=amplitude,
        hz=omega / (2 * np.pi),
        hz_std=hz_std / (2 * np.pi),
        damping_ratio=damping_ratio(omega, -slope.real),
        damping_ratio_std=rate_std / omega,
        warnings=warnings,
    )


def damping_ratio(frequency: Array | float, rate: Array | float) -> Array:
    """Damping ratio of a motion exp(-rate t) cos(frequency t), which is slower than without damping.

    Parameters
    ----------
    frequency, rate : (m,) array or float
        In the same unit, 1/s or Hz.

    Examples
    --------
    >>> round(float(damping_ratio(np.sqrt(1.0 - 0.2**2), 0.2)), 12)
    0.2
    """
    return np.asarray(rate / np.hypot(frequency, rate))


def decay_rate(frequency: Array | float, ratio: Array | float) -> Array:
    """Rate of a decay by its frequency and damping ratio, in the unit of the frequency: see :func:`damping_ratio`."""
    return np.asarray(frequency * ratio / np.sqrt(1.0 - ratio**2))


def over_amplitude(decays: Sequence[Decay], bins: int = BINS, source: str = "decays") -> Decay:
    """Put decays of one structure together: means in classes of amplitude, uncertainty by their scatter.

    What windows are known worse to than they scatter by is common to all of a class: few may agree by chance, and means
    over windows are off alike where frequency or damping bend.

    Parameters
    ----------
    decays : sequence of Decay
        Of the same channel and mode.
    bins : int
        Classes, evenly spaced in the logarithm of the amplitude; those with fewer than two windows are left out.
    source : str

    Raises
    ------
    InputError
        If their units differ, or no class has two windows.
    """
    other = next((d for d in decays if d.unit != decays[0].unit), decays[0])
    if other.unit != decays[0].unit:
        named = " and ".join(f"{d.channel} in {d.unit or 'no unit'}" for d in (decays[0], other))
        raise InputError(f"{source}: {named}; must be of one unit, for they are put together by amplitude")
    columns = "amplitude", "hz", "hz_std", "damping_ratio", "damping_ratio_std"
    A, hz, hz_std, zeta, zeta_std = (np.concatenate([getattr(d, name) for d in decays]) for name in columns)
    edges = np.geomspace(A.min() * (1 - 1e-9), A.max() * (1 + 1e-9), bins + 1)
    place = np.digitize(A, edges)
    rows = []
    for own in (np.flatnonzero(place == i) for i in range(bins, 0, -1)):
        if len(own) > 1:
            of_both = (_mean(values[own], std[own]) for values, std in ((hz, hz_std), (zeta, zeta_std)))
            rows.append((float(np.exp(np.mean(np.log(A[own])))), *chain.from_iterable(of_both)))
    if not rows:
        raise InputError(
            f"{source}: {len(A)} amplitudes in all, each in a class of its own; must be two in one at least: take "
            "longer decays, or one of them"
        )
    amplitude, f, f_std, z, z_std = np.array(rows).T
    first, warnings = decays[0], tuple(dict.fromkeys(line for d in decays for line in d.warnings))
    return Decay(source, first.channel, first.unit, amplitude, f, f_std, z, z_std, len(decays), warnings)


def _mean(values: Array, std: Array) -> tuple[float, float]:
    """Mean of the values (n,) of a class, and its standard deviation."""
    scatter = float(values.var(ddof=1))
    return float(values.mean()), float(np.sqrt(scatter / len(values) + max(float(np.mean(std**2)) - scatter, 0.0)))


# ----------------------------------------------------------------------------------------------------------- the motion


def _below_flat_tops(recorded: Recording, channel: str) -> tuple[Recording, tuple[str, ...]]:
    """What comes after the last flat top of a channel that is clipped where it is largest, and a warning if it is.

    A decay is clipped at its beginning alone: of all of it flat tops are a part as small as it is long.
    """
    recorded.expect_channel(channel)
    y = recorded.channels[channel]
    last = int(np.flatnonzero((y == y.max()) | (y == y.min()))[-1])
    if not clipped(y[: last + 1]):
        return recorded, ()
    said = f"{recorded.source}: {flat_topped(channel, f' up to {recorded.time[last]:.4g} s')}"
    after = replace(recorded, source=f"{recorded.source} after its flat tops")
    begin, end = recorded.time[last : last + 2][-1], recorded.time[-1]
    return after.between(float(begin), float(end)), (f"{said} All before is left out",)


def _demodulated(
    recorded: Recording, channel: str, band: tuple[float, float]
) -> tuple[Array, npt.NDArray[np.complex128], float, float]:
    """Times, complex amplitudes, the frequency they are turned to rest by [Hz], and how far apart they are [s]."""
    recorded.expect_even("to follow a decay")
    y, step = recorded.channels[channel], recorded.step
    low, high = band
    if not 0.0 < low < high < 0.5 / step:
        raise InputError(
            f"{recorded.source}: a band from {low:g} to {high:g} Hz; must increase, within 0 and "
            f"{0.5 / step:.6g} Hz, half the sampling rate"
        )
    half = 0.5 * (high - low)
    taps = 2 * round(1.65 / (half * step)) + 1  # of a Hann window: its transition is about 3.3/taps of the rate
    if taps >= len(y):
        raise InputError(
            f"{recorded.source}: {len(y) * step:.3g} s; must be more than {taps * step:.3g} s for a band of "
            f"{high - low:g} Hz"
        )
    from scipy.signal import firwin, oaconvolve  # it takes long, and a decay that is read needs none

    t = recorded.time[0] + step * np.arange(len(y))
    hz = _strongest(y, step, band)
    turned = 2.0 * y * np.exp(-2j * np.pi * hz * t)
    # The mirror image, turned to -2 hz, decays like the motion: what is left of it bends the slopes of all blows alike.
    # Side lobes of a Hann window fall by 18 dB an octave, those of a Hamming window stay at -53 dB.
    filtered = oaconvolve(turned, firwin(taps, half, window="hann", fs=1.0 / step), mode="valid")
    every = max(1, int(0.5 / (half * step)))
    middle = t[taps // 2 : taps // 2 + len(filtered)]
    return middle[::every], filtered[::every], hz, every * step


def _strongest(y: Array, step: float, band: tuple[float, float]) -> float:
    """Frequency of the highest line within a band [Hz]."""
    hz = np.fft.rfftfreq(len(y), step)
    inside = (hz >= band[0]) & (hz <= band[1])
    return float(hz[inside][np.argmax(np.abs(np.fft.rfft(y - y.mean()))[inside])])


def _noise(z: npt.NDArray[np.complex128]) -> float:
    """Rms of noise: what the second difference of neighbours leaves at the end, where little else changes."""
    last = z[-max(len(z) // 5, 8) :]
    return float(np.sqrt(np.mean(np.abs(np.diff(last, 2)) ** 2) / 6.0))


def _smooth(size: Array, most: int) -> Array:
    """Amplitudes as they fall, without their noise.

    A window that ended where noise happens to lie low, and began there, would say too little damping.
    """
    from scipy.signal import savgol_filter

    length = min(most, len(size)) // 2 * 2 - 1
    return np.asarray(np.exp(savgol_filter(np.log(size), length, 1)))


def _windows(size: Array, most: int) -> Iterator[tuple[int, int]]:
    """Begin and end of windows side by side, over amplitudes that fall."""
    begin = 0
    while begin + FEWEST <= len(size):
        fallen = np.flatnonzero(size[begin : begin + most] < size[begin] / FALL)
        end = begin + max(FEWEST, int(fallen[0]) if len(fallen) else most)
        if end > len(size):
            return
        yield begin, end
        begin = end


def _deviations(slope: Array, noise: Array) -> Array:
    """Standard deviations of slopes (m,): their noise, and what may change within a window.

    Where the slope begins to change, as where friction ceases to slip, the mean over a window differs from the slope at
    the amplitude in its middle by an eighth at most of how far it is off the line through its neighbours.
    """
    if len(slope) <= NEIGHBOURS:
        return noise
    bend = np.diff(slope, 2) ** 2 - noise[:-2] ** 2 - 4.0 * noise[1:-1] ** 2 - noise[2:] ** 2
    within = np.pad(np.sqrt(np.maximum(bend, 0.0)) / 8.0, 1, mode="edge")
    return np.hypot(noise, within)


def _window(t: Array, z: npt.NDArray[np.complex128], falls: Array, tone: Tone | None) -> tuple[float, complex, float]:
    """Amplitude in the middle, slope of the logarithm [1/s], and the standard deviation of each of its parts."""
    x = t - t.mean()
    log = np.log(np.abs(z)) + 1j * np.unwrap(np.angle(z))
    weight = falls**2 / np.mean(falls**2)  # noise of the logarithm goes with 1/A
    mean, centre = np.average(log, weights=weight), np.average(x, weights=weight)
    spread = np.sum(weight * (x - centre) ** 2)
    slope = complex(np.sum(weight * (x - centre) * (log - mean)) / spread)
    left = log - mean - slope * (x - centre)
    variance = float(np.sum(weight * np.abs(left) ** 2)) / (2 * (len(x) - 2) - 2)  # of Student's distribution
    at_middle = float(np.exp((mean - slope * centre).real))
    by_tone = 0.0 if tone is None else abs(np.sum(weight * (x - centre) * tone.beside(t, log)) / spread) ** 2 / 2.0
    return at_middle, slope, float(np.sqrt(variance / spread + by_tone))
