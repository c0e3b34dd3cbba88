"""Records whose sampling rate is stated wrong, by millionths or by two: what is said of them."""

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
