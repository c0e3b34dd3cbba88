"""Clocks that are even but for the digits they were printed with, and clocks that are not."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hbm.errors import InputError
from hbm.fourier import Array
from hbm.measurement.clock import even_clock, unevenness
from hbm.measurement.decay import free_decay
from hbm.measurement.harmonics import harmonic_spectra
from hbm.measurement.historyfile import load_history
from hbm.measurement.recording import Recording, recording
from hbm.measurement.sweep import swept
from hbm.measurement.transient import responses_from_rest

RATE = 1024.0  # a step of 0.9765625 ms: no number of microseconds
N = 8192
TIME = np.arange(N) / RATE


def printed(pattern: str, t: Array) -> Array:
    return np.array([float(pattern % each) for each in t])


@pytest.mark.filterwarnings("error")
def test_times_of_all_sizes_are_judged_without_a_warning() -> None:
    """Numbers that leave no digits, or next to none, among them."""
    for stamps in ([0.0, 5e-324, 1e-3, 2e-3], [1e-310, 1e-3, 2e-3], [-1e-300, 0.0, 1.0], [1e9, 1e9 + 2e-7, 1e9 + 4e-7]):
        assert even_clock(np.array(stamps)) == pytest.approx(stamps, abs=1.0)
        assert unevenness(np.array(stamps)) >= 0.0


@pytest.mark.parametrize("pattern", ["%.6f", "%.5f", "%.6g", "%.8g"])
@pytest.mark.parametrize("start", [0.0, -0.25, 1234.5])
def test_a_clock_is_even_to_the_digits_it_was_printed_with(pattern: str, start: float) -> None:
    """A stamp is rounded by half a unit at most. The line through all of them is known better, by the root of N."""
    stamps = printed(pattern, start + TIME)
    if np.ptp(np.diff(stamps)) > 0.5 / RATE:  # 1234.5 has two decimals of six digits, and no clock
        assert np.array_equal(even_clock(stamps), stamps)
        return
    largest = np.abs(stamps - start - TIME).max()
    assert largest > 1e-9
    assert np.abs(even_clock(stamps) - start - TIME).max() < 0.2 * largest


def test_a_clock_is_even_to_the_arithmetic_that_kept_it() -> None:
    """Single precision resolves 0.5 us at 8 s; seconds since 1970 leave a double 0.2 us, 1 % of a step of 51.2 kHz."""
    clock = np.arange(N) / 1000.0
    stamps = clock.astype(np.float32).astype(float)
    largest = np.abs(stamps - clock).max()
    assert largest > 2e-7
    assert np.abs(even_clock(stamps) - clock).max() < 0.2 * largest
    assert unevenness(1.7e9 + np.arange(N) / 51200.0) < 1e-3
    assert unevenness(1.7e9 + np.arange(N) / 51200.0 + 2e-6 * (np.arange(N) % 7 == 5)) > 0.05


def test_clocks_that_are_not_even_stay_as_they_are() -> None:
    """A sample that is missing is told from rounding, in whole milliseconds too, and so is a clock that drifts."""
    milliseconds = np.arange(1000) / 1000.0
    drifting = np.round(TIME + 1e-4 * np.sin(TIME), 6)
    missing = np.delete(milliseconds, 500), np.delete(np.round(TIME, 6), 4000)
    for stamps in (*missing, drifting, np.array([0.1, 0.2, 0.4])):
        assert np.array_equal(even_clock(stamps), stamps)
        assert unevenness(stamps) > 0.04


def test_a_multisine_printed_to_a_microsecond_has_its_lines(tmp_path: Path) -> None:
    """Beyond 200 harmonics a period must be whole samples; phases are those of the clock, not of the stamps."""
    rng = np.random.default_rng(3)
    H, hz = 250, RATE / 1024
    phases = rng.uniform(0.0, 2.0 * np.pi, H)
    y = np.cos(2.0 * np.pi * hz * TIME[:, None] * np.arange(1, H + 1) + phases).sum(axis=1)
    file = tmp_path / "multisine.csv"
    formats = ["%.6f", "%.17g"]
    np.savetxt(file, np.column_stack([TIME, y]), formats, delimiter=",", header="time_s,force", comments="")
    e = harmonic_spectra(load_history(file), hz, H)
    c = e.coefficients[0, 1 : H + 1] - 1j * e.coefficients[0, H + 1 :]
    assert np.abs(c - np.exp(1j * phases)).max() < 1e-5  # half a microsecond alone turns line 250 by 8e-4
    assert e.warnings == ()


def signal(t: Array) -> Array:
    return np.asarray(np.cos(2.0 * np.pi * 16.0 * t) + 0.3 * np.sin(2.0 * np.pi * 48.0 * t))


def test_harmonics_of_times_that_jitter_are_those_at_these_times() -> None:
    """Right to rounding where the stamps are true. Where the clock was even nothing can know: it is warned of."""
    stamps = TIME + np.where(np.arange(N) % 7 == 5, 0.4 / RATE, 0.0)
    true = harmonic_spectra(recording("jitter.csv", stamps, {"force": signal(stamps)}), 16.0, 5)
    assert true.coefficients[0, [1, 8]] == pytest.approx([1.0, 0.3], abs=1e-12)
    assert [w for w in true.warnings if "even clock" in w] == [
        "its times lie up to 34.3% of a step beside an even clock: harmonics are taken at these times, and are wrong "
        "if the clock was even"
    ]
    even = harmonic_spectra(recording("even.csv", TIME, {"force": signal(TIME)}), 16.0, 5)
    assert not any("even clock" in w for w in even.warnings)


@pytest.mark.parametrize(
    ("find", "purpose"),
    [
        (lambda r: swept(r, "force", 3), "to follow a sweep"),
        (lambda r: free_decay(r, "force", (10.0, 20.0)), "to follow a decay"),
        (lambda r: responses_from_rest(r, "force", {}), "to find frequency responses"),
    ],
)
def test_what_needs_an_even_clock_says_so(find: Callable[[Recording], object], purpose: str) -> None:
    stamps = TIME + np.where(np.arange(N) % 7 == 5, 0.4 / RATE, 0.0)
    line = rf"jitter.csv: time steps from 0.0005\d* to 0.0013\d* s; must be equal {purpose}"
    with pytest.raises(InputError, match=line):
        find(recording("jitter.csv", stamps, {"force": signal(TIME)}))
