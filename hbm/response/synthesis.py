"""What a test of a rig would have recorded: its steady states, sampled, with noise, as recordings and as spectra.

The curves of :func:`hbm.response.accuracy.frequency_response` say which steady states there are. Each is solved again
on a finer discretisation: the error of a curve may be above the noise of a good measurement. Noise is added to the
samples, and the spectra are estimated from these recordings as measured ones are, with their standard deviations.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from numbers import Real

import numpy as np

from continuation import ConvergenceError
from hbm.balance.solution import PeriodicSolution
from hbm.balance.tones import holding
from hbm.errors import InputError, expect_frequency, expect_rig, expect_whole
from hbm.fourier import Array, default_samples
from hbm.measurement.harmonicestimate import HarmonicEstimate, spectra_of_records
from hbm.measurement.harmonics import harmonic_spectra
from hbm.measurement.recording import Recording
from hbm.measurement.spectra import MeasuredSpectra
from hbm.response.accuracy import frequency_response
from hbm.response.bifurcations import stability_of
from hbm.response.curve import ResponseCurve
from hbm.response.trace import steady_state
from models.jointed import AnyRig
from models.parts import UNITS

HARMONICS, SAMPLES, MORE_MODES = 60, 1024, 15
"""Of the records: harmonics and samples per period, at least, and modes of a beam beyond those of its rig file."""

PASSED = 2
"""Harmonics up to so many times the highest of the spectra pass the filter before sampling."""

PERIODS = 64
"""Periods of the lowest frequency in each recording."""

BEYOND = 0.005
"""The curves go beyond the first and the last frequency by this share."""

LEAST_SNR, MOST_SNR = -20.0, 200.0
"""Of signal to noise ratios [dB]: all noise, and none."""

OVERSAMPLING = 2.56
"""Samples per period of the highest harmonic, the usual number of spectrum analysers."""

Told = Callable[[str, float], None]
"""Called with what is done, in words, and the fraction done."""


@dataclass(frozen=True, eq=False)
class Synthesis:
    """What was recorded of a simulated test.

    Attributes
    ----------
    recordings : tuple of Recording
        Samples with noise [SI], one recording per record; the force has phase 0 at time 0.
    estimates : tuple of HarmonicEstimate
        Harmonics of each recording.
    spectra : MeasuredSpectra
        All records; numbered from 1, the first level first.
    curves : tuple of ResponseCurve
        The curve of each level that the records were taken from, with its numerical error.
    remarks : tuple of str
        What to beware of, one sentence each.
    """

    recordings: tuple[Recording, ...]
    estimates: tuple[HarmonicEstimate, ...]
    spectra: MeasuredSpectra
    curves: tuple[ResponseCurve, ...]
    remarks: tuple[str, ...]


def synthesize(
    rig: AnyRig,
    levels: Sequence[float],
    frequencies: Sequence[float],
    *,
    snr: float = 60.0,
    seed: int = 1,
    harmonics: int = 9,
    on_progress: Told | None = None,
) -> Synthesis:
    """Simulate a test with stepped frequencies, every frequency at every level; what drifts does so in this order.

    Parameters
    ----------
    rig : Rig or JointedRig
        Its channels are recorded.
    levels, frequencies : sequence of float
        Force amplitudes [N] and excitation frequencies [Hz].
    snr : float
        Signal to noise ratio [dB] of each channel: its largest fundamental of all records over the standard deviation
        of a harmonic coefficient. All records of a channel have the same noise.
    seed : int
        Of the noise.
    harmonics : int
        Highest harmonic of the spectra.
    on_progress : callable, optional
        Called with what is done and the fraction done.

    Returns
    -------
    Synthesis

    Raises
    ------
    InputError
        If the rig has no channels, or a number cannot be accepted.
    ConvergenceError
        If a curve cannot be traced, or no stable steady state is found at a frequency.
    """
    _check(rig, levels, frequencies)
    expect_whole(seed, "seed", "synthesize", least=0)
    expect_whole(harmonics, "harmonics", "synthesize")
    if not LEAST_SNR <= snr <= MOST_SNR:
        raise InputError(f"synthesize: snr = {snr:g}; must be {LEAST_SNR:g} to {MOST_SNR:g} [dB]")
    tell = on_progress or (lambda doing, done: None)
    curves, states = list[ResponseCurve](), list[PeriodicSolution]()
    for i, level in enumerate(levels):
        tell(f"{level:g} N", i / len(levels))
        curve = frequency_response(rig, ((1 - BEYOND) * min(frequencies), (1 + BEYOND) * max(frequencies)), level=level)
        states += _settled(curve, frequencies, 1 + len(states))
        curves.append(curve)
    recordings = _recorded(rig, states, snr, np.random.default_rng(seed), harmonics)
    estimates = tuple(harmonic_spectra(r, s.hz, harmonics) for r, s in zip(recordings, states, strict=True))
    names = [c.name for c in rig.channels]
    spectra = spectra_of_records(estimates, [s.level for s in states], names, "synthesized")
    warnings = *_untold(_in_record(rig, 1), states[0]), *_of_states(states)
    return Synthesis(recordings, estimates, spectra, tuple(curves), warnings)


def _check(rig: AnyRig, levels: Sequence[float], frequencies: Sequence[float]) -> None:
    expect_rig(rig, "synthesize", joints=True)
    if not rig.channels:
        raise InputError(f"synthesize: {rig.name} has no channels; must have at least one [[channels]]")
    for what, values in (("levels", levels), ("frequencies", frequencies)):
        if isinstance(values, Real | str):
            raise InputError(f"synthesize: {what} = {values!r}; must be a sequence of numbers, such as [{values}]")
        if not len(values):
            raise InputError(f"synthesize: no {what}; must be at least one")
    for level in levels:
        if not 0.0 < level < float("inf"):
            raise InputError(f"synthesize: levels has {level:g}; must be > 0 and finite [N]")
    for hz in frequencies:
        expect_frequency(hz, "synthesize")


def _settled(curve: ResponseCurve, frequencies: Sequence[float], first: int) -> list[PeriodicSolution]:
    """The steady states to which a slow sweep along the curve comes, records from number `first` on.

    Raises
    ------
    ConvergenceError
        If the curve has none at a frequency; all such frequencies are named.
    """
    found = [_first_stable(curve, hz, number) for number, hz in enumerate(frequencies, start=first)]
    missing = ", ".join(f"{hz:g}" for hz, state in zip(frequencies, found, strict=True) if state is None)
    if missing:
        raise ConvergenceError(
            f"synthesize: no stable steady state at {missing} Hz and {curve.level:g} N; a test would show another "
            "motion there; choose other frequencies or levels"
        )
    return [state for state in found if state is not None]


def _first_stable(curve: ResponseCurve, hz: float, record: int) -> PeriodicSolution | None:
    """The first stable steady state at a frequency along the curve, of the rig as it is in the record."""
    past = curve.hz >= hz
    rig = _in_record(curve.rig, record)
    H = holding(rig, HARMONICS)
    N_t = max(SAMPLES, default_samples(H))
    for i in np.flatnonzero(past[1:] != past[:-1]):
        near = min(curve.points[i : i + 2], key=lambda p: abs(p.hz - hz))
        try:
            found = steady_state(rig, hz, level=curve.level, harmonics=H, samples=N_t, start=near)
            if _may_last(rig, found):
                return found
        except ConvergenceError:
            continue
    return None


def _may_last(rig: AnyRig, found: PeriodicSolution) -> bool:
    """Whether a steady state is stable, or that cannot be told."""
    try:
        return stability_of(rig, found).stable
    except ValueError:
        return True


def _untold(rig: AnyRig, found: PeriodicSolution) -> Iterator[str]:
    """Say so where it cannot be told whether steady states are stable."""
    try:
        stability_of(rig, found)
    except ValueError as refused:
        yield f"{refused}; records are of the steady states that a sweep comes to first, stable or not"


def _in_record(rig: AnyRig, record: int) -> AnyRig:
    """The rig as it is in a record, a beam with more modes."""
    try:
        rig = rig.at_record(record)
    except ValueError as why:
        raise InputError(f"synthesize: {why}") from None
    return rig if rig.beam is None else rig.with_modes(rig.beam.modes + MORE_MODES)


def _of_states(states: Sequence[PeriodicSolution]) -> Iterator[str]:
    for number, state in enumerate(states, start=1):
        if state.lift_off:
            yield (
                f"record {number}: the tip would lift off, and the rig keeps it on its support; "
                "set lift_off = true in [contact]"
            )


# -------------------------------------------------------------------------------------------------------- recordings


def _recorded(
    rig: AnyRig, states: Sequence[PeriodicSolution], snr: float, rng: np.random.Generator, harmonics: int
) -> tuple[Recording, ...]:
    """Sample every channel at one rate and for one time, with white noise."""
    hz = [s.hz for s in states]
    passed = PASSED * harmonics
    highest = passed * max(hz)
    time = np.arange(round(OVERSAMPLING * highest * PERIODS / min(hz))) / (OVERSAMPLING * highest)
    largest = {c.name: max(float(s[c.name].amplitude[1]) for s in states) for c in rig.channels}
    # noise of samples sigma makes sigma sqrt(2 / N) of a coefficient
    noise = {name: a * 10 ** (-snr / 20) * np.sqrt(len(time) / 2) for name, a in largest.items()}
    return tuple(
        Recording(
            source=f"record_{number:03d}.csv",
            time=time,
            channels={
                c.name: sampled(state[c.name].coefficients, passed, state.hz, time)
                + noise[c.name] * rng.standard_normal(len(time))
                for c in rig.channels
            },
            units={c.name: UNITS[c.quantity] for c in rig.channels},
        )
        for number, state in enumerate(states, start=1)
    )


def sampled(coefficients: Array, passed: int, hz: float, time: Array) -> Array:
    """Values of the first harmonics of a Fourier series a_0, a_1..a_H, b_1..b_H at times [s]."""
    H, phase = len(coefficients) // 2, 2 * np.pi * hz * time
    values = np.full(len(time), coefficients[0])
    for k in range(1, min(passed, H) + 1):
        values += coefficients[k] * np.cos(k * phase) + coefficients[H + k] * np.sin(k * phase)
    return values
