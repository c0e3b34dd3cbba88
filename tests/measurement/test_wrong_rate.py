"""Records whose sampling rate or fundamental is stated wrong, or whose samples are lost: what is said of them."""

import numpy as np
import pytest

from hbm.measurement.harmonics import harmonic_spectra
from hbm.measurement.recording import recording


def clock(ppm: float, *, growth: float = 0.0, hum: float = 0.0) -> tuple[str, ...]:
    """Warnings of 120 steady periods at a rate that is stated wrong; a1 may grow, or have a line at 131.7 Hz."""
    t, rng = np.arange(16000) / 6400.0, np.random.default_rng(0)
    theta = 2.0 * np.pi * 48.0 * (1.0 + 1e-6 * ppm) * t
    a1 = 10.0 * np.cos(theta + 0.5) * (1.0 + growth * t / t[-1]) + hum * np.cos(2.0 * np.pi * 131.7 * t)
    signals = {"force": 2.0 * np.cos(theta), "a1": a1}
    noisy = {name: s + 0.003 * rng.standard_normal(len(t)) for name, s in signals.items()}
    return harmonic_spectra(recording("run.csv", t, noisy), 48.0, 5).warnings


def test_a_clock_that_is_off_by_5_ppm_turns_all_phases_of_a_steady_record() -> None:
    """2 pi 120 periods 5e-6 = 0.00377 rad, 5e-6 48 Hz = 0.00024 Hz."""
    assert clock(0.0) == ()
    (warning,) = clock(5.0)
    assert warning.startswith("all phases turn by 0.00376 rad over the record: the fundamental lies +0.00024 Hz from")


def test_what_phases_that_turn_do_not_make_is_told_beside_them() -> None:
    turn, change, line = clock(5.0, growth=0.01, hum=0.1)
    assert turn.startswith("all phases turn")
    assert change.startswith("a1 is not steady: its fundamental changes by 1.00% +/- 0.018%")
    assert line.startswith("a1 has a line at 131.7 Hz")


@pytest.mark.parametrize("share", [0.5, 2.0])
def test_a_rate_that_is_wrong_by_two_is_told_with_the_frequency_of_the_signal(share: float) -> None:
    """The signal is not at the fundamental given but at half of it, or twice."""
    t = np.arange(4000) / 1600.0
    force = np.cos(2.0 * np.pi * 48.0 * t)
    signals = {"force": force, "a1": force + 0.1 * np.cos(2.0 * np.pi * 144.0 * t)}
    e = harmonic_spectra(recording("run.csv", t / share, signals), 48.0, 7)
    assert e.warnings == (
        f"next to all of every channel lies at {48.0 * share:g} Hz and its multiples, not at 48 Hz: "
        "the sampling rate or the fundamental is wrong",
    )


HZ, RATE = 57.0, 5000.0


def rich(t: np.ndarray, seed: int = 0) -> dict[str, np.ndarray]:
    """A force, and responses of twenty harmonics, one of which has most of its power at the eleventh."""
    k, rng = np.arange(1, 21), np.random.default_rng(seed)
    sizes = {"force": 4.0 * (k == 1), "a1": 5.0 / k + 20.0 * (k == 11), "a2": 40.0 / k**1.5}
    theta = 2.0 * np.pi * HZ * np.outer(t, k) + 0.3 * k**2
    return {name: np.cos(theta) @ size + 0.01 * rng.standard_normal(len(t)) for name, size in sizes.items()}


@pytest.mark.parametrize("given", [50.0, 28.5, 19.0, 5.7, 114.0, 171.0])
def test_a_fundamental_that_is_wrong_is_told_with_that_of_the_signal(given: float) -> None:
    """Also where it is a part of the true one, where lines of channels differ, and harmonics of both are the same."""
    t = np.arange(7500) / RATE
    (warning,) = harmonic_spectra(recording("run.csv", t, rich(t)), given).warnings
    begins, ends = "next to all of every channel lies at ", "the sampling rate or the fundamental is wrong"
    assert warning.startswith(begins)
    assert warning.endswith(f" Hz and its multiples, not at {given:g} Hz: {ends}")
    assert float(warning.removeprefix(begins).split()[0]) == pytest.approx(HZ, rel=1e-4)


@pytest.mark.parametrize("given", [57.02, 57.3, 57.6, 58.0, 59.0, 60.0, 55.0])
def test_a_fundamental_that_is_near_is_told_with_its_error(given: float) -> None:
    """Up to four cycles over the record; what can be refined is told to be."""
    t = np.arange(7500) / RATE
    e = harmonic_spectra(recording("run.csv", t, rich(t)), given)
    (warning,) = e.warnings
    assert warning.startswith("all phases turn by")
    assert e.off_hz == pytest.approx(HZ - given, rel=0.015)
    assert ("refine it" in warning) == (abs(given - HZ) <= 0.3)
    if "refine it" in warning:
        assert harmonic_spectra(recording("run.csv", t, rich(t)), given, refine="force").warnings == ()


def test_noise_turns_nothing() -> None:
    """The phase of what is not there goes anywhere."""
    t, rng = np.arange(2000) / RATE, np.random.default_rng(4)
    told = []
    for _ in range(300):
        e = harmonic_spectra(recording("run.csv", t, {"a1": rng.standard_normal(len(t))}), HZ, 3)
        told += e.warnings
    assert len(told) <= 1


def test_subharmonics_and_the_right_fundamental_are_not_doubted() -> None:
    t = np.arange(7500) / RATE
    for asked in (3, 9, 20, 40):
        assert harmonic_spectra(recording("run.csv", t, rich(t)), HZ, asked).warnings == ()
    halved = {name: y + 0.3 * np.abs(y).max() * np.cos(np.pi * HZ * t) for name, y in rich(t).items()}
    assert harmonic_spectra(recording("run.csv", t, halved), HZ / 2).warnings == ()


@pytest.mark.parametrize("refine", [None, "force"])
@pytest.mark.parametrize("lost", [3, 13, 60])
def test_lost_samples_are_told_from_a_frequency_that_is_off(lost: int, refine: str | None) -> None:
    """Of 87.7 a period: phases jump by 2 pi 57 Hz lost / 5000 Hz, less a turn where that is nearer."""
    t = np.arange(7500) / RATE
    kept = np.delete(np.arange(len(t)), np.arange(2000, 2000 + lost))
    read = {name: values[kept] for name, values in rich(t).items()}
    (warning,) = harmonic_spectra(recording("run.csv", t[: len(kept)], read), HZ, refine=refine).warnings
    angle = (2.0 * np.pi * HZ * lost / RATE + np.pi) % (2.0 * np.pi) - np.pi
    said = warning.replace("all phases jump by ", "").split()
    assert float(said[0]) == pytest.approx(angle, abs=0.005 + 3.0 * float(said[2]))
    assert float(said[5]) == pytest.approx(0.4, abs=2.0 / HZ)
    assert f"s: {1e3 * lost / RATE:.3g} ms are lost there" in warning or refine


def test_a_frequency_that_is_off_or_drifts_or_a_channel_that_jumps_alone_is_no_loss() -> None:
    t = np.arange(7500) / RATE
    for shift in (2e-4 * t, 0.02 * t**2):
        said = harmonic_spectra(recording("run.csv", t, rich(t + shift / HZ)), HZ).warnings
        assert not any("jump" in line for line in said)
        assert said
    alone = rich(t)
    alone["a1"] = np.append(alone["a1"][:3000], rich(t + 2e-3)["a1"][3000:])
    said = harmonic_spectra(recording("run.csv", t, alone), HZ).warnings
    assert not any("jump" in line for line in said)
    assert any(line.startswith("a1 is not steady") for line in said)


def test_a_steady_record_has_no_jump() -> None:
    """Of 600 records of one channel, of 10 blocks and more."""
    jumps = []
    for seed in range(300):
        for length in (900, 2500):
            t = np.arange(length) / RATE
            e = harmonic_spectra(recording("run.csv", t, {"force": rich(t, seed)["force"]}), HZ, 3)
            jumps += [line for line in e.warnings if "jump" in line]
    assert len(jumps) <= 1
