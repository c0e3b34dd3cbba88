"""Harmonics of recordings whose harmonics are known: right coefficients, honest deviations, faults found."""

from dataclasses import replace

import numpy as np
import pytest

from hbm.errors import InputError
from hbm.fourier import Array
from hbm.measurement.clipping import clipped
from hbm.measurement.harmonicestimate import HarmonicEstimate, spectra_of_records
from hbm.measurement.harmonics import harmonic_spectra
from hbm.measurement.recording import Recording, recording

HZ, RATE, H = 50.3, 1600.0, 5  # 31.8 samples per period
TRUE = np.array([0.1, 1.0, 0.2, 0.3, 0.05, 0.02, -0.5, 0.1, 0.0, 0.03, 0.01])
LEVEL, PHASE = 2.0, 0.3


def times(periods: float) -> Array:
    return np.arange(round(periods * RATE / HZ) + 7) / RATE


def harmonics(t: Array) -> Array:
    theta = 2.0 * np.pi * HZ * t[:, None] * np.arange(1, H + 1)
    return np.asarray(TRUE[0] + np.cos(theta) @ TRUE[1 : H + 1] + np.sin(theta) @ TRUE[H + 1 :])


def force(t: Array) -> Array:
    return np.asarray(LEVEL * np.cos(2.0 * np.pi * HZ * t + PHASE))


def record(periods: float, seed: int = 0, *, noise: float = 0.01, added: Array | float = 0.0) -> Recording:
    t, rng = times(periods), np.random.default_rng(seed)
    signals = {"force": force(t), "a1": harmonics(t) + added}
    return recording("run.csv", t, {name: s + noise * rng.standard_normal(len(t)) for name, s in signals.items()})


def at(e: HarmonicEstimate, name: str) -> int:
    return e.channels.index(name)


# ---------------------------------------------------------------------------------------------------------- the numbers


@pytest.mark.parametrize("periods", [1.3, 3.0, 40.0, 100.7])
def test_noiseless_harmonics_are_exact(periods: float) -> None:
    """Samples fall on no equal phases of the period; least squares does not mind."""
    e = harmonic_spectra(record(periods, noise=0.0), HZ, H)
    assert e.coefficients[at(e, "a1")] == pytest.approx(TRUE, abs=1e-12)
    c = LEVEL * np.exp(1j * PHASE)
    assert e.coefficients[at(e, "force")][[1, H + 1]] == pytest.approx([c.real, -c.imag], abs=1e-12)
    assert e.amplitude("force") == pytest.approx(LEVEL)
    assert e.periods == int(periods)


@pytest.mark.parametrize(("hz", "highest"), [(HZ, 5), (50.0, 201)], ids=["least squares", "FFT"])
def test_a_fundamental_that_turns_or_grows_leaks_into_no_harmonic(hz: float, highest: int) -> None:
    """A clock that is off by 30 ppm, and 2 % of growth: up to 3e-5 and 8e-5 of them would be in other harmonics."""
    t = np.arange(50 * 512) / (512 * hz)
    turned, grown = np.cos(2 * np.pi * hz * (1 + 3e-5) * t + 0.7), (1 + 0.02 * t / t[-1]) * np.cos(2 * np.pi * hz * t)
    e = harmonic_spectra(recording("run.csv", t, {"turned": turned, "grown": grown}), hz, highest)
    others = np.delete(e.coefficients, [1, highest + 1], axis=1)
    assert np.abs(others).max() < 1e-7


def test_harmonics_of_a_frequency_that_is_off_are_as_uncertain_as_stated() -> None:
    """Pulls of 20 records of 100 periods; the fundamental leaks up to three standard deviations of harmonics."""
    t, pulls = times(100.0), []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        y = np.cos(2 * np.pi * HZ * (1 + 6e-5) * t + 0.3 * seed) + 0.0007 * rng.standard_normal(len(t))
        e = harmonic_spectra(recording("run.csv", t, {"a1": y}), HZ, H)
        pulls.append(e.coefficients[0, [2, 3, 4, 5, 7, 8, 9, 10]] / np.tile(e.std[0, 2:], 2))
        assert any("refine it" in line for line in e.warnings)
        error = abs(e.coefficients[0, 1] - 1j * e.coefficients[0, H + 1] - np.exp(0.3j * seed))
        assert error < 2.0 * np.sqrt(2.0) * e.std[0, 1]  # the phase in the middle stands for that at the zero of time
    assert np.sqrt(np.mean(np.square(pulls))) == pytest.approx(1.0, abs=0.25)


def test_unequal_steps_are_exact_too() -> None:
    rng = np.random.default_rng(2)
    t = np.sort(rng.uniform(0.0, 1.0, 5000))
    e = harmonic_spectra(recording("run.csv", t, {"a1": harmonics(t)}), HZ, H)
    assert e.coefficients[0] == pytest.approx(TRUE, abs=1e-11)


def test_phases_refer_to_the_zero_of_time_whatever_settles() -> None:
    t = times(40.0) + 12.3
    for settle in (0.0, 0.2071):
        e = harmonic_spectra(recording("run.csv", t, {"a1": harmonics(t)}), HZ, H, settle=settle)
        assert e.coefficients[0] == pytest.approx(TRUE, abs=1e-10)


@pytest.mark.parametrize("periods", [2, 4, 8, 33])
def test_standard_deviations_are_honest(periods: int) -> None:
    """95 % intervals of 1.96 std hold the truth in 95 % of 400 records, and (estimate - truth)/std has variance 1.

    Student's distribution: a std from few degrees of freedom is raised by the root of nu/(nu - 2).
    4000 numbers with cos and sin sharing a std: coverage is known to 0.5 %, so 93.5 to 96.5 % is three deviations.
    From two or four periods the variance of the ratio has hardly a variance itself: judged from 8 on.
    """
    z = []
    for seed in range(400):
        e = harmonic_spectra(record(periods, seed), HZ, H)
        i = at(e, "a1")
        z.append((e.coefficients[i] - TRUE)[1:] / np.tile(e.std[i, 1:], 2))
    assert e.periods == periods
    assert 0.935 < np.mean(np.abs(z) < 1.96) < 0.965
    if periods >= 8:
        assert np.mean(np.square(z)) == pytest.approx(1.0, abs=0.08)


def test_deviation_of_white_noise_is_its_closed_form() -> None:
    """Sigma sqrt(2/N) for cos and sin, sigma/sqrt(N) for the mean: 62 and 31 degrees of freedom, so to 40 %."""
    e = harmonic_spectra(record(320.0), HZ, H)
    N = round(320 * RATE / HZ)
    expected = np.r_[1.0, np.full(H, np.sqrt(2.0))] * 0.01 / np.sqrt(N)
    assert np.max(np.abs(np.log(e.std / expected))) < np.log(1.4)


def test_one_period_takes_noise_for_white() -> None:
    z = []
    for seed in range(300):
        e = harmonic_spectra(record(1.0, seed), HZ, H)
        i = at(e, "a1")
        z.append((e.coefficients[i] - TRUE) / np.r_[e.std[i], e.std[i, 1:]])
    assert np.mean(np.abs(z) < 1.96) == pytest.approx(0.95, abs=0.02)


def test_correlated_noise_raises_the_deviation() -> None:
    """A random walk of the amplitude: blocks are not independent, and taken so the intervals would hold far less."""
    t = times(96.0)
    z, naive = [], []
    for seed in range(100):
        rng = np.random.default_rng([7, seed])
        walk = 1e-4 * np.cumsum(rng.standard_normal(len(t)))
        walk -= walk.mean()
        e = harmonic_spectra(record(96.0, seed, noise=1e-3, added=walk * np.cos(2.0 * np.pi * HZ * t)), HZ, H)
        i = at(e, "a1")
        error, rho = (e.coefficients[i] - TRUE)[1], e.quality[i].correlation
        z.append(error / e.std[i, 1])
        naive.append(z[-1] * np.sqrt((1.0 + rho) / (1.0 - rho)))
    assert np.mean(np.abs(z) < 1.96) > 0.93
    assert np.std(naive) > 2.0 * np.std(z)


# -------------------------------------------------------------------------------------------------------- the frequency


def test_refined_frequency_is_right_to_its_deviation() -> None:
    z = []
    for seed in range(40):
        e = harmonic_spectra(record(60.0, seed), HZ + 0.02, H, refine="force")
        z.append((e.hz - HZ) / e.hz_std)
    assert np.std(z) == pytest.approx(1.0, abs=0.3)
    assert abs(np.mean(z)) < 0.5


def test_a_steady_record_is_steady_at_a_refined_frequency() -> None:
    """A response with less noise than the force turns by what the refined frequency is off."""
    turns = []
    for seed in range(40):
        t, rng = times(40.0), np.random.default_rng(seed)
        signals = {"force": force(t), "a1": 15.0 * harmonics(t)}
        noisy = {name: s + 2e-3 * rng.standard_normal(len(t)) for name, s in signals.items()}
        e = harmonic_spectra(recording("run.csv", t, noisy), HZ, H, refine="force")
        assert all(q.steadiness.steady for q in e.quality)
        a1 = e.quality[at(e, "a1")].steadiness
        turns.append(a1.turning / a1.change_std)
    assert np.sqrt(np.mean(np.square(turns))) == pytest.approx(1.0, abs=0.25)  # of 40 draws: 0.11


def test_a_phase_that_drifts_is_not_steady_at_a_refined_frequency() -> None:
    t, rng = times(40.0), np.random.default_rng(1)
    drifting = np.cos(2.0 * np.pi * HZ * t + 0.02 * t)
    noisy = {name: s + 2e-3 * rng.standard_normal(len(t)) for name, s in {"force": force(t), "a1": drifting}.items()}
    e = harmonic_spectra(recording("run.csv", t, noisy), HZ, H, refine="force")
    a1 = e.quality[at(e, "a1")].steadiness
    assert not a1.steady
    assert a1.turning == pytest.approx(0.02 * 40.0 / HZ, abs=4.0 * a1.change_std)
    assert any("a1 is not steady" in warning for warning in e.warnings)


def test_deviations_of_a_refined_record_hold_where_its_phases_count_from() -> None:
    """At the zero of time and, in a spectra file, beside the force: harmonic k of a response turned k times as far.

    Rms of some 200 numbers, so to 12 % with 95 % probability; without the frequency it is sqrt((1 + 4)/2) at time zero.
    """
    k, at_zero, beside_force = np.arange(1, H + 1), [], []
    c, true_force = TRUE[1 : H + 1] - 1j * TRUE[H + 1 :], LEVEL * np.exp(1j * PHASE)
    for seed in range(100):
        e = harmonic_spectra(record(20.0, seed), HZ, H, refine="force")
        i, j = at(e, "a1"), at(e, "force")
        found = e.coefficients[:, 1 : H + 1] - 1j * e.coefficients[:, H + 1 :]
        z = (found[j, 0] - true_force) / e.std[j, 1]
        at_zero.append([z.real, z.imag])
        turned = found[i] * np.exp(-1j * k * np.angle(found[j, 0])) - c * np.exp(-1j * k * PHASE)
        std = spectra_of_records([e], [LEVEL], ["force", "a1"]).std[0]
        both = np.sqrt(std[1, 1:] ** 2 + 0.5 * (k * np.abs(c) * std[0, 1] / LEVEL) ** 2)
        beside_force.append(np.concatenate([turned.real, turned.imag]) / np.tile(both, 2))
    assert np.sqrt(np.mean(np.square(at_zero))) == pytest.approx(1.0, abs=0.15)
    assert np.sqrt(np.mean(np.square(beside_force))) == pytest.approx(1.0, abs=0.1)


def test_a_wrong_fundamental_is_told_with_its_error() -> None:
    e = harmonic_spectra(record(100.0), HZ + 0.02, H)
    assert e.warnings == (
        "all phases turn by -0.248 rad over the record: the fundamental lies -0.02 Hz from the one given; refine it",
    )
    refined = harmonic_spectra(record(100.0), HZ + 0.02, H, refine="force")
    assert refined.warnings == ()
    assert refined.hz == pytest.approx(HZ, abs=3.0 * refined.hz_std)
    assert str(refined) == (
        "fundamental 50.299969 +/- 3.5e-05 Hz, 100 periods; standard deviations from the scatter of 33 blocks"
    )


# --------------------------------------------------------------------------------------------------------------- faults


def test_lines_of_a_multisine_on_another_clock_turn_each_by_its_number() -> None:
    """20 ppm beside 0.5 Hz: harmonic 59 turns by 0.15 rad in 40 s. Channels have other strongest lines."""
    t, rng = np.arange(40 * 512) / 512.0, np.random.default_rng(1)
    lines, hz = np.arange(21, 62, 2), 0.5 * (1.0 + 20e-6)
    waves = np.cos(2.0 * np.pi * hz * np.outer(t, lines) + rng.uniform(0.0, 6.0, len(lines)))
    sizes = {"force": np.ones(len(lines)), "a1": 1.0 + 3.0 * (lines == 59), "a2": 1.0 + 3.0 * (lines == 31)}
    values = {name: waves @ size + 1e-3 * rng.normal(size=len(t)) for name, size in sizes.items()}
    (told,) = harmonic_spectra(recording("run.csv", t, values), 0.5, 70).warnings
    assert told.startswith("all phases turn, that of harmonic 59 by 0.14")
    assert float(told.split("fundamental is ")[1].split(" Hz")[0]) == pytest.approx(hz, rel=1e-6)
    assert harmonic_spectra(recording("run.csv", t, values), hz, 70).warnings == ()


def test_a_good_record_is_not_warned_of() -> None:
    """A channel in ten thousand is to be: of 100 records of two channels none or one."""
    warned = [harmonic_spectra(record(48.0, seed), HZ, H).warnings for seed in range(100)]
    assert sum(map(bool, warned)) <= 1


@pytest.mark.parametrize(("rate", "beat"), [(1.5, 2.2), (3.0, -5.0), (0.8, 0.0)])
def test_a_transient_is_found_with_its_decay_rate(rate: float, beat: float) -> None:
    """The structure rings at its own frequency, beat beside the excitation, and dies out."""
    t = times(100.0)
    ringing = 0.05 * np.exp(-rate * t) * np.cos(2.0 * np.pi * (HZ + beat) * t + 1.0)
    z = []
    for seed in range(20):
        e = harmonic_spectra(record(100.0, seed, added=ringing), HZ, H)
        s = e.quality[at(e, "a1")].steadiness
        assert e.quality[at(e, "force")].steadiness.steady and not s.steady
        assert s.beat_hz == pytest.approx(beat, abs=0.05)
        assert any(w.startswith("a1 is not steady: a transient dies out at ") for w in e.warnings)
        z.append((s.decay_rate - rate) / s.decay_rate_std)
    assert np.std(z) < 1.6
    assert abs(np.mean(z)) < 0.8
    left = 0.05 * np.exp(-rate * t[-1]) / np.hypot(TRUE[1], TRUE[H + 1])
    assert s.left == pytest.approx(left, rel=0.5, abs=1e-3)


@pytest.mark.parametrize("digits", [5, 9, 12, 17])
def test_a_cosine_without_noise_is_steady(digits: int) -> None:
    """Whole periods of whole samples are rounded alike: blocks differ by arithmetic alone, in a pattern of its own."""
    t = np.arange(4000) / 4000.0
    written = [float(f"{value:.{digits}g}") for value in np.cos(2.0 * np.pi * 40.0 * t)]
    e = harmonic_spectra(recording("h.csv", t, {"force": written}), 40.0, 9)
    assert e.quality[0].steadiness.steady
    assert e.warnings == ()


@pytest.mark.parametrize(("size", "warned"), [(3e-4, False), (5e-3, True)])
def test_a_transient_below_any_relevance_is_not_warned_of(size: float, *, warned: bool) -> None:
    """Significant both times, the noise being so small; trends of less than a thousandth are not warned of either."""
    t = np.arange(4000) / 4000.0
    y = np.cos(2.0 * np.pi * 40.0 * t) + size * np.exp(-5.0 * t) * np.cos(2.0 * np.pi * 42.0 * t)
    y += 1e-5 * np.random.default_rng(2).standard_normal(len(t))
    e = harmonic_spectra(recording("h.csv", t, {"force": y}), 40.0, 9)
    s = e.quality[0].steadiness
    assert not s.steady
    assert s.decay_rate == pytest.approx(5.0, rel=0.2)
    assert s.size == pytest.approx(size, rel=0.2)
    assert any("a transient dies out" in w for w in e.warnings) == warned


def test_a_growing_amplitude_is_a_trend_not_a_decay() -> None:
    t = times(100.0)
    e = harmonic_spectra(record(100.0, added=0.03 * t / t[-1] * np.cos(2.0 * np.pi * HZ * t)), HZ, H)
    s = e.quality[at(e, "a1")].steadiness
    assert s.change == pytest.approx(0.03 / np.hypot(TRUE[1] + 0.015, TRUE[H + 1]), rel=0.05)
    assert np.isnan(s.decay_rate)
    assert e.warnings == (
        f"a1 is not steady: its fundamental changes by {s.change:.2%} +/- {100 * s.change_std:.2g}% over the record",
    )


def test_a_line_between_the_harmonics_is_found() -> None:
    """Amplitude 0.02 at 131.7 Hz, 2.6 harmonics; rms of the channel by Parseval."""
    t = times(100.0)
    e = harmonic_spectra(record(100.0, added=0.02 * np.cos(2.0 * np.pi * 131.7 * t)), HZ, H)
    rms = np.sqrt(np.sum(TRUE[1:] ** 2) / 2.0 + 0.02**2 / 2.0 + 0.01**2)
    found = e.quality[at(e, "a1")].leftover
    assert found.line_hz == pytest.approx(131.7, abs=0.05)
    assert found.line_share == pytest.approx(0.02 / np.sqrt(2.0) / rms, rel=0.05)
    assert found.share == pytest.approx(np.sqrt(0.02**2 / 2.0 + 0.01**2) / rms, rel=0.05)
    assert e.warnings == (f"a1 has a line at 131.7 Hz, between the harmonics, of {found.line_share:.2%} of its rms",)


def test_harmonics_beyond_h_are_not_taken_for_something_between() -> None:
    e = harmonic_spectra(record(100.0, noise=1e-4), HZ, 2)
    assert e.warnings == ()
    assert e.quality[at(e, "a1")].leftover.share < 2e-3


def test_clipped_and_dead_channels_are_told() -> None:
    good = record(20.0)
    flat = np.clip(good.channels["a1"], -0.8, 0.9)
    e = harmonic_spectra(
        recording("run.csv", good.time, {"force": good.channels["force"], "a1": flat, "a2": 0.0 * flat + 0.7}), HZ, H
    )
    assert (e.channels, e.dead) == (("force", "a1"), ("a2",))
    assert e.warnings == ("a2 is constant: left out", "a1 is flat-topped: was it clipped?")


@pytest.mark.parametrize("top", [0.99, 0.9, 0.5])
def test_a_clipped_channel_is_as_uncertain_as_clipping_makes_it(top: float) -> None:
    """Samples beside the tops tell by how much; half of the motion cut off does not make the channel a dead one."""
    good = record(60.0, noise=1e-3)
    most = top * np.abs(good.channels["a1"]).max()
    cut = replace(good, channels={**good.channels, "a1": np.clip(good.channels["a1"], -most, most)})
    whole, found = harmonic_spectra(good, HZ, H), harmonic_spectra(cut, HZ, H)
    a1 = at(found, "a1")
    off = found.coefficients[a1] - whole.coefficients[a1]
    size = np.hypot(off[1 : H + 1], off[H + 1 :]) / np.sqrt(2.0)
    std, noise = found.own_std[a1, 1:], whole.own_std[a1, 1:]
    assert size.max() > 5.0 * noise.max()
    far = size > 5.0 * noise
    np.testing.assert_allclose(std[far], size[far], rtol=0.2)
    assert found.silent == () and found.quality[a1].clipped


def test_a_channel_of_noise_alone_is_left_out_where_others_move() -> None:
    """One of more noise than motion is kept, for over 40 periods it stands out; where none stands out all are."""
    good, rng = record(40.0), np.random.default_rng(3)
    noise = rng.normal(size=(2, len(good.time)))
    with_others = {**good.channels, "dead": noise[0], "weak": 2.0 * noise[1] + good.channels["a1"]}
    e = harmonic_spectra(recording("run.csv", good.time, with_others), HZ, H)
    assert (e.silent, "weak" in e.channels) == (("dead",), True)
    assert e.warnings == ("dead has no harmonic that stands out of its noise: left out. Is it dead?",)
    alone = harmonic_spectra(recording("run.csv", good.time, {"dead": noise[0], "weak": 2.0 * noise[1]}), HZ, H)
    assert (alone.silent, alone.channels) == ((), ("dead", "weak"))


@pytest.mark.parametrize("steps", [20, 1000, 30_000])
def test_a_coarse_converter_is_not_clipping(steps: int) -> None:
    """A sine in steps of the converter stays longest at its top, without being flat."""
    t = times(50.0)
    assert not clipped(np.round(steps * np.cos(2.0 * np.pi * HZ * t)))
    assert clipped(np.minimum(np.round(steps * np.cos(2.0 * np.pi * HZ * t)), 0.9 * steps))


def test_few_periods_are_told() -> None:
    assert str(harmonic_spectra(record(3.0), HZ, H)).splitlines() == [
        "fundamental 50.3 Hz, 3 periods; "
        "too few for blocks: standard deviations from what is left between the harmonics",
        "warning: 3 whole periods: nothing can be said of steadiness",
    ]


# ------------------------------------------------------------------------------------------------------------- refusals


@pytest.mark.parametrize(
    ("changed", "line"),
    [
        ({"hz": 3.0}, "run.csv: 0.2044 s are 0.613 periods of 3 Hz; must be at least one period"),
        (
            {"H": 60},
            "run.csv: harmonic 60 of 50.3 Hz at 1600 samples/s; must be below 800 Hz, half the sampling rate; "
            "try at most 15 harmonics",
        ),
        ({"settle": 1.0}, "run.csv: settle = 1 s leaves nothing; must be < 0.20375 s, its length"),
        (
            {"refine": "a9"},
            'run.csv: no channel "a9" to refine the fundamental with; channels are force, a1',
        ),
        (
            {"hz": 55.0, "refine": "force"},
            "run.csv: no maximum of force within 2.45 Hz of 55 Hz; must be closer to the fundamental",
        ),
    ],
)
def test_what_cannot_be_estimated_is_refused(changed: dict[str, object], line: str) -> None:
    options = {"hz": HZ, "H": H, "settle": 0.0, "refine": None, **changed}
    with pytest.raises(InputError) as refused:
        harmonic_spectra(
            record(10.05),
            options["hz"],  # type: ignore[arg-type]
            options["H"],  # type: ignore[arg-type]
            settle=options["settle"],  # type: ignore[arg-type]
            refine=options["refine"],  # type: ignore[arg-type]
        )
    assert str(refused.value) == line


def test_a_gap_and_a_dead_record_are_refused() -> None:
    t = times(40.0)
    kept = (t < 0.3) | (t > 0.33)
    with pytest.raises(InputError) as refused:
        harmonic_spectra(recording("run.csv", t[kept], {"a1": harmonics(t[kept])}), HZ, H)
    assert str(refused.value) == (
        "run.csv: a gap of 0.03125 s between samples; must be < 0.001988 s, half a period of harmonic 5"
    )
    with pytest.raises(InputError) as refused:
        harmonic_spectra(recording("run.csv", t, {"a1": 0.0 * t}), HZ, H)
    assert str(refused.value) == "run.csv: every channel is constant; must have one that moves"


# ------------------------------------------------------------------------------------------------------------- together


def test_records_are_put_together_in_the_order_of_the_rig() -> None:
    first = harmonic_spectra(record(10.0), HZ, H)
    t = times(10.0)
    second = harmonic_spectra(recording("b.csv", t, {"force": force(t)}), HZ + 0.1, H)
    spectra = spectra_of_records([first, second], [2.0, 3.0], ["a0", "a1", "force"])
    assert spectra.channels == ("a1", "force")
    assert (spectra.records.tolist(), spectra.level.tolist(), spectra.hz.tolist()) == (
        [1, 2],
        [2.0, 3.0],
        [HZ, HZ + 0.1],
    )
    np.testing.assert_array_equal(spectra.coefficients[0], first.coefficients[::-1])
    assert not spectra.measured[1, 0].any() and spectra.measured[1, 1].all()


# ---------------------------------------------------------------------------------------------------- many harmonics


def multisine(H: int, samples: int, periods: int, noise: float, seed: int = 3) -> tuple[Recording, Array]:
    """Odd lines above the first, of random phase, not from time 0 on; and the amplitudes, (H+1,)."""
    rng = np.random.default_rng(seed)
    c = np.zeros(H + 1, dtype=complex)
    c[3::2] = rng.uniform(0.5, 1.0, len(c[3::2])) * np.exp(2j * np.pi * rng.random(len(c[3::2])))
    n = np.arange(samples * periods)
    one = samples / 2 * np.fft.irfft(c, samples)
    start = 0.37  # s; a phase reference that is no sample of a period
    signal = np.tile(one, periods) + noise * rng.standard_normal(len(n))
    turned = c * np.exp(-2j * np.pi * np.arange(H + 1) * start * 1000.0 / samples)
    return recording("run.csv", start + n / 1000.0, {"force": signal}), turned


@pytest.mark.parametrize("H", [60, 250])  # by least squares, and by an FFT
def test_a_multisine_has_its_lines_and_their_deviations(H: int) -> None:
    recorded, c = multisine(H, samples=520, periods=12, noise=0.3)
    e = harmonic_spectra(recorded, 1000.0 / 520, H)
    found = e.coefficients[0, 1 : H + 1] - 1j * e.coefficients[0, H + 1 :]
    assert np.abs(found - c[1:]).max() < 6.0 * e.std[0].max()
    pulls = np.concatenate([(found - c[1:]).real, (found - c[1:]).imag]) / np.tile(e.std[0, 1:], 2)
    assert pulls.std() == pytest.approx(1.0, abs=4.0 / np.sqrt(4 * H))
    assert e.hz == pytest.approx(1000.0 / 520, rel=1e-9)
    assert e.amplitude("force") == pytest.approx(np.sqrt(0.5 * np.sum(np.abs(c) ** 2)), rel=0.02)
    assert not any("steady" in warning for warning in e.warnings)


def test_four_thousand_harmonics_are_those_of_the_signal() -> None:
    recorded, c = multisine(4096, samples=8200, periods=4, noise=0.0)
    e = harmonic_spectra(recorded, 0.12195122, 4096)  # 1000 / 8200 Hz by its first digits
    assert e.coefficients[0, 4097:] == pytest.approx(-c[1:].imag, abs=1e-10)
    assert e.coefficients[0, 1:4097] == pytest.approx(c[1:].real, abs=1e-10)


@pytest.mark.parametrize(
    ("hz", "harmonics", "said"),
    [
        ("x", 9, "hz = 'x'; must be > 0 and finite [Hz]"),
        (-50.0, 9, "hz = -50; must be > 0 and finite [Hz]"),
        (HZ, 2.5, "harmonics = 2.5; must be a whole number >= 1"),
        (HZ, "9", "harmonics = '9'; must be a whole number >= 1"),
    ],
)
def test_numbers_that_are_none_are_refused(hz, harmonics, said: str) -> None:
    with pytest.raises(InputError) as refused:
        harmonic_spectra(record(10.0), hz, harmonics)
    assert str(refused.value) == f"harmonic_spectra: {said}"


def test_many_harmonics_need_whole_numbers_of_samples() -> None:
    recorded, _ = multisine(250, samples=520, periods=4, noise=0.1)
    with pytest.raises(InputError, match=r"a period of 1.9 Hz has 526.3\d* samples; must be a whole number of evenly"):
        harmonic_spectra(recorded, 1.9, 250)


def test_a_multisine_that_settles_is_not_steady() -> None:
    """The strongest line is followed where there is no fundamental."""
    recorded, _ = multisine(250, samples=520, periods=20, noise=0.01)
    settling = 1.0 + 0.2 * np.exp(-(recorded.time - recorded.time[0]) / 3.0)
    e = harmonic_spectra(
        recording("run.csv", recorded.time, {"force": recorded.channels["force"] * settling}), 1000.0 / 520, 250
    )
    assert any("force is not steady" in warning and "harmonic" in warning for warning in e.warnings)


# ------------------------------------------------------------------------------------------------------------- spikes


def spiky(periods: float, at: tuple[float, ...], height: float, seed: int = 0) -> HarmonicEstimate:
    """A channel with spikes of two samples at some times."""
    t = times(periods)
    added = np.zeros(len(t))
    for moment in at:
        added[int(moment * RATE) : int(moment * RATE) + 2] = height
    return harmonic_spectra(record(periods, seed, added=added), HZ, H)


def test_a_spike_is_told_with_its_time() -> None:
    e = spiky(60.0, (0.7,), 1.0)
    (said,) = e.warnings
    assert said.startswith("a1 has a spike at 0.7 s, ")
    found = e.quality[at(e, "a1")].spike
    assert found is not None and found.size == pytest.approx(100.0, rel=0.1)  # of a noise of 0.01


def test_noise_and_impacts_that_belong_to_the_motion_are_no_spikes() -> None:
    every = tuple((i + 0.3) / HZ for i in range(60))
    assert spiky(61.0, every, 0.6).quality[1].spike is None
    for seed in range(20):
        assert all(q.spike is None for q in harmonic_spectra(record(60.0, seed), HZ, H).quality)
    assert all(q.spike is None for q in harmonic_spectra(record(60.0, noise=0.0), HZ, H).quality)
