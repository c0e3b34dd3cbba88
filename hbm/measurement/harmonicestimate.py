"""Result for one record: harmonics with standard deviations, quality of the record, and sentences about it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hbm.fourier import Array
from hbm.measurement.clipping import flat_topped
from hbm.measurement.clock import UNEVEN
from hbm.measurement.heard import unheard_of
from hbm.measurement.jump import Jump
from hbm.measurement.spectra import MeasuredSpectra
from hbm.measurement.spikes import Spike
from hbm.measurement.steadiness import Leftover, Steadiness
from hbm.measurement.waves import MOST_FITTED
from models.display import Displayed

LEAST_SHARE = 0.001
"""Trends, transients and lines below this part of the amplitude are not warned of, however significant; nor such turns
[rad]."""
ELSEWHERE, MOSTLY = 0.99, 0.9
"""Share of the rms that lies elsewhere in a channel where the rate or the fundamental is wrong, and at least in those
beside it: harmonics of what is given may be some of what is there."""
REFINED = 3.0
"""Turn of all phases [rad] up to which a frequency can be refined: half a period over the record are 3.14."""
CERTAIN = 5.0
"""Standard deviations from which a turn of all phases is there beyond doubt, or a change beside it."""


@dataclass(frozen=True)
class ChannelQuality:
    """Estimates for one channel of a record.

    Attributes
    ----------
    name : str
    harmonic : int
        The one that stands for the channel: the fundamental, or the strongest of a multisine.
    amplitude, std : float
        Amplitude |c_k| of that harmonic, and standard deviation of each of cos and sin, in the channel's unit.
    correlation : float
        rho of neighbouring blocks that the standard deviation of that harmonic was raised for, 0 where not.
    steadiness : Steadiness
    leftover : Leftover
    clipped : bool
        Whether it is flat-topped.
    jump : Jump or None
        Of its phase.
    spike : Spike or None
        The largest.
    """

    name: str
    harmonic: int
    amplitude: float
    std: float
    correlation: float
    steadiness: Steadiness
    leftover: Leftover
    clipped: bool
    jump: Jump | None
    spike: Spike | None


@dataclass(frozen=True, eq=False)
class HarmonicEstimate(Displayed):
    """Harmonics of one record.

    Attributes
    ----------
    source : str
    hz : float
        Fundamental [Hz].
    hz_std : float
        Its standard deviation where it was refined, nan where it was given.
    periods, blocks : int
        Whole periods used, and blocks they were divided into; 0 blocks: std from what is left between the harmonics.
    uneven : float
        How far its times lie beside an even clock, in steps.
    channels : tuple of str, (c,)
        Those that are not constant.
    coefficients : (c, 2H+1) array
        a_0, a_1..a_H, b_1..b_H; phases refer to the zero of the recording's time.
    own_std : (c, H+1) array
        Standard deviation of each of cos and sin, phases of all channels counted from one another.
    turn_std : float
        Standard deviation of the phase of the fundamental at the zero of time by that of a refined frequency, or by
        what a given one is off [rad]. It turns all channels together, harmonic k by k times as much.
    units : dict of str to str
        As in the recording.
    quality : tuple of ChannelQuality, (c,)
    dead, silent : tuple of str
        Channels left out: constant ones, and those of noise alone where others move.
    beyond : dict of int to (c,) array
        Amplitudes of harmonics above H that stand out, by number.
    """

    source: str
    hz: float
    hz_std: float
    periods: int
    blocks: int
    uneven: float
    channels: tuple[str, ...]
    coefficients: Array
    own_std: Array
    turn_std: float
    units: Mapping[str, str]
    quality: tuple[ChannelQuality, ...]
    dead: tuple[str, ...]
    silent: tuple[str, ...]
    beyond: Mapping[int, Array]

    @property
    def H(self) -> int:
        """Highest harmonic."""
        return int(self.own_std.shape[1]) - 1

    @property
    def off_hz(self) -> float:
        """What a frequency that was given is off [Hz], by a turn of all phases alike; 0 where there is none."""
        off = _frequency_error(self)
        return off[1] if off else 0.0

    @property
    def std(self) -> Array:
        """Standard deviation of each of cos and sin at the zero of time, (c, H+1).

        What turns them is at right angles to each coefficient: cos and sin share it.
        """
        k = np.arange(self.H + 1)
        sines = np.pad(self.coefficients[:, self.H + 1 :], ((0, 0), (1, 0)))
        size = np.hypot(self.coefficients[:, : self.H + 1], sines)
        return np.asarray(np.hypot(self.own_std, np.sqrt(0.5) * k * self.turn_std * size))

    def amplitude(self, channel: str) -> float:
        """Amplitude of the fundamental of a channel; of a multisine its rms."""
        i = self.channels.index(channel)
        if self.quality[i].harmonic == 1:
            return self.quality[i].amplitude
        return float(np.sqrt(0.5 * np.sum(self.coefficients[i, 1:] ** 2)))

    def __repr__(self) -> str:
        """Sentences about the analysis, followed by warnings."""
        blocks = (
            f"standard deviations from the scatter of {self.blocks} blocks"
            if self.blocks
            else "too few for blocks: standard deviations from what is left between the harmonics"
        )
        refined = f" +/- {self.hz_std:.2g}" if np.isfinite(self.hz_std) else ""
        first = f"fundamental {self.hz:.8g}{refined} Hz, {self.periods} periods; {blocks}"
        return "\n".join([first, *(f"warning: {w}" for w in self.warnings)])

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the record, one sentence each."""
        return tuple(_warnings(self))


def _warnings(e: HarmonicEstimate) -> Iterator[str]:
    for name in e.dead:
        yield f"{name} is constant: left out"
    for name in e.silent:
        yield unheard_of(name)
    if e.uneven > UNEVEN:
        yield (
            f"its times lie up to {e.uneven:.1%} of a step beside an even clock: harmonics are taken at these times, "
            "and are wrong if the clock was even"
        )
    if not e.blocks:
        yield f"{e.periods} whole {'period' if e.periods == 1 else 'periods'}: nothing can be said of steadiness"
    elsewhere = _elsewhere(e)
    if elsewhere is not None:
        yield (
            f"next to all of every channel lies at {elsewhere:.5g} Hz and its multiples, not at {e.hz:.5g} Hz: "
            "the sampling rate or the fundamental is wrong"
        )
        return
    jump, off = _jump(e), _frequency_error(e)
    if jump is not None:
        lost = jump.angle % (2.0 * np.pi) / (2.0 * np.pi * e.hz)
        yield (
            f"all phases jump by {jump.angle:.3g} +/- {jump.std:.1g} rad at {jump.time:.4g} s: {1e3 * lost:.3g} ms are "
            "lost there, or so much and whole periods; use what comes before or after, or record again"
        )
    highest = max(q.harmonic for q in e.quality)
    # the highest harmonic is a line of its own, or lines of a multisine are
    turned = off is not None and (highest > 1 or abs(off[0]) * e.H > 2.0 * np.pi)
    smeared = jump is not None or turned
    if off and highest > 1:
        yield (
            f"all phases turn, that of harmonic {highest} by {highest * off[0]:.3g} rad over the record: the "
            f"fundamental is {e.hz + off[1]:.8g} Hz; give that for up to {MOST_FITTED} harmonics, or take generator "
            "and recorder on one clock"
        )
    elif off:
        yield (
            f"all phases turn by {off[0]:.3g} rad over the record: "
            f"the fundamental lies {off[1]:+.2g} Hz from the one given; "
            + ("refine it" if abs(off[0]) < REFINED else f"it is about {e.hz + off[1]:.5g} Hz")
        )
    for q in e.quality:
        s = q.steadiness
        if jump is None and not off and not s.steady and s.size > LEAST_SHARE:
            yield (
                f"{q.name} is not steady: a transient dies out at {s.decay_rate:.3g} +/- {s.decay_rate_std:.1g} 1/s, "
                f"{s.beat_hz:+.2g} Hz beside the {_harmonic(q.harmonic)}; "
                f"{s.left:.2%} of the amplitude is left of it at the end"
            )
        elif not smeared and not s.steady and _changes(s, turned=off is not None):
            change = s.growing if off else s.change
            yield (
                f"{q.name} is not steady: "
                f"its {_harmonic(q.harmonic)} changes by {change:.2%} +/- {100 * s.change_std:.2g}% over the record"
            )
        if not smeared and np.isfinite(q.leftover.line_hz) and q.leftover.line_share > LEAST_SHARE:
            yield (
                f"{q.name} has a line at {q.leftover.line_hz:.4g} Hz, between the harmonics, "
                f"of {q.leftover.line_share:.2%} of its rms"
            )
        if q.clipped:
            yield flat_topped(q.name)
        if q.spike is not None and s.steady and not smeared:
            yield (
                f"{q.name} has a spike at {q.spike.time:.4g} s, {q.spike.size:.3g} times the noise: "
                "use what comes before or after, or record again"
            )


def _changes(s: Steadiness, *, turned: bool) -> bool:
    """Whether the change of a channel that is not steady is worth a word, where all phases turn beside that turn."""
    return s.growing > max(LEAST_SHARE, CERTAIN * s.change_std) if turned else s.change > LEAST_SHARE


def _harmonic(k: int) -> str:
    return "fundamental" if k == 1 else f"harmonic {k}"


def _elsewhere(e: HarmonicEstimate) -> float | None:
    """Fundamental [Hz] of the signal, where all channels have multiples of one alone and it is not the one given."""
    found = np.array([_signal_hz(e, i) for i in range(len(e.channels))])
    most = max(q.leftover.share for q in e.quality)
    if not np.isfinite(found).all() or MOSTLY < most <= ELSEWHERE:
        return None
    least = float(found.min())
    alike = np.abs(found - np.round(found / least) * least) < e.hz / e.periods
    return least if alike.all() and least != e.hz else None


def _signal_hz(e: HarmonicEstimate, i: int) -> float:
    """Fundamental [Hz] that a channel has by its strongest line, or by the harmonics that it has; else nan."""
    if e.quality[i].leftover.share > MOSTLY:
        return e.quality[i].leftover.line_hz
    power = {k: e.coefficients[i, k] ** 2 + e.coefficients[i, e.H + k] ** 2 for k in range(1, e.H + 1)}
    power |= {k: amplitude[i] ** 2 for k, amplitude in e.beyond.items()}
    least, total = ELSEWHERE**2, sum(power.values())
    return e.hz * max(g for g in power if sum(p for k, p in power.items() if k % g == 0) >= least * total)


def _jump(e: HarmonicEstimate) -> Jump | None:
    """Jump of the surest channel, where all channels jump alike."""
    jumps = [q.jump for q in e.quality if q.harmonic == 1 and q.jump is not None]
    if len(jumps) < len(e.channels):
        return None
    surest, block = min(jumps, key=lambda j: j.std), 1.01 * e.periods / e.hz / e.blocks
    alike = all(
        abs(j.angle - surest.angle) < 0.1 * abs(surest.angle) + CERTAIN * np.hypot(j.std, surest.std)
        and abs(j.time - surest.time) < block
        for j in jumps
    )
    return surest if alike and abs(surest.angle) > LEAST_SHARE else None


def _frequency_error(e: HarmonicEstimate) -> tuple[float, float] | None:
    """Turn of the fundamental [rad] and what a frequency that was given is off [Hz], where all channels turn alike."""
    if np.isfinite(e.hz_std) or _jump(e) is not None:  # a refined one is as right as one frequency can be
        return None
    harmonic = np.array([q.harmonic for q in e.quality])
    turns = np.array([q.steadiness.turning for q in e.quality]) / harmonic
    stds = np.array([q.steadiness.change_std for q in e.quality]) / harmonic
    if not np.isfinite(stds).all():
        return None
    surest = int(np.argmin(stds))
    turn, std = float(turns[surest]), float(stds[surest])
    alike = np.abs(turns - turn) < 0.1 * abs(turn) + CERTAIN * np.hypot(stds, std)
    if abs(turn) < max(LEAST_SHARE / harmonic.max(), CERTAIN * std) or not alike.all():
        return None
    return turn, turn * e.hz / e.periods / (2.0 * np.pi)


def spectra_of_records(
    estimates: Sequence[HarmonicEstimate], levels: Sequence[float], channels: Sequence[str], source: str = "spectra"
) -> MeasuredSpectra:
    """Join records, numbered from 1 in their order.

    Where a record begins is nothing to its spectra: a common turn of all its phases is not in the deviations.

    Parameters
    ----------
    estimates : sequence of HarmonicEstimate
        Estimates of the same H.
    levels : sequence of float
        Nominal force amplitude of each record [N].
    channels : sequence of str
        Order of the channels; those in none of the records are left out.
    source : str
        For messages.
    """
    kept = tuple(name for name in channels if any(name in e.channels for e in estimates))
    shape = len(estimates), len(kept)
    coefficients = np.full((*shape, 2 * estimates[0].H + 1), np.nan)
    std = np.full((*shape, estimates[0].H + 1), np.nan)
    for i, e in enumerate(estimates):
        for j, name in enumerate(e.channels):
            coefficients[i, kept.index(name)], std[i, kept.index(name)] = e.coefficients[j], e.own_std[j]
    return MeasuredSpectra(
        source=source,
        records=np.arange(1, len(estimates) + 1),
        level=np.array(levels, dtype=float),
        hz=np.array([e.hz for e in estimates]),
        channels=kept,
        coefficients=coefficients,
        std=std,
        notes=tuple((i, text) for i, e in enumerate(estimates, start=1) for text in e.warnings),
    )
