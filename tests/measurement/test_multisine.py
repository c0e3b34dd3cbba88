"""Multisines through functions whose even and odd parts are known apart."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from hbm.cli import app
from hbm.errors import InputError
from hbm.measurement.harmonicestimate import spectra_of_records
from hbm.measurement.harmonics import harmonic_spectra
from hbm.measurement.multisine import contents, excited_lines
from hbm.measurement.recording import recording
from hbm.measurement.spectra import MeasuredSpectra
from hbm.measurement.spectrafile import write_spectra

N, H, PERIODS = 4096, 400, 10
LINES = np.array([k for k in range(21, 301, 2) if k % 8 != 7])  # odd ones, a quarter left out


def force(seed: int = 1) -> np.ndarray:
    c = np.zeros(N // 2 + 1, dtype=complex)
    c[LINES] = 0.1 * np.exp(2j * np.pi * np.random.default_rng(seed).random(len(LINES)))
    return np.fft.irfft(c, N) * N / 2


def filtered(u: np.ndarray) -> np.ndarray:
    """A resonance at line 100, so that lines are not alike."""
    x = np.arange(N // 2 + 1) / 100.0
    return np.fft.irfft(np.fft.rfft(u) / (1.0 - x**2 + 0.2j * x), N)


def measured(u: np.ndarray, y: np.ndarray, noise: float = 0.0):
    rng = np.random.default_rng(7)
    both = {"force": np.tile(u, PERIODS), "a1": np.tile(y, PERIODS) + noise * rng.standard_normal(N * PERIODS)}
    e = harmonic_spectra(recording("run.csv", np.arange(N * PERIODS) / N, both), 1.0, H)
    return spectra_of_records([e], [1.0], ["force", "a1"])


def rms_of_a_line(signal: np.ndarray, lines: np.ndarray) -> float:
    c = 2.0 * np.abs(np.fft.rfft(signal))[lines] / N
    return float(np.sqrt(np.mean(c**2 / 2.0)))


EVEN = np.arange(22, 300, 2)
ODD = np.array([k for k in range(21, 300, 2) if k not in LINES])


def test_even_and_odd_content_are_those_of_the_even_and_odd_part() -> None:
    u = force()
    x = filtered(u)
    even, odd = 0.02 * x**2, 0.01 * x**3
    _, found = contents(measured(u, x + even + odd), "force")
    assert found.lines == (len(LINES), len(EVEN), len(ODD))
    assert found.even == pytest.approx(rms_of_a_line(even, EVEN), rel=1e-6)
    assert found.odd == pytest.approx(rms_of_a_line(odd, ODD), rel=1e-6)
    assert found.excited == pytest.approx(rms_of_a_line(x + odd, LINES), rel=1e-6)
    assert found.db("even") == pytest.approx(20 * np.log10(found.even / found.excited))


def test_noise_is_what_is_left_of_it_in_the_mean() -> None:
    u = force()
    _, found = contents(measured(u, filtered(u), noise=0.5), "force")
    expected = 0.5 * np.sqrt(2.0 / (N * PERIODS))  # of each of cosine and sine
    assert found.noise == pytest.approx(expected, rel=0.1)
    assert found.even == pytest.approx(expected, rel=0.25)  # there is nothing else
    assert found.odd == pytest.approx(expected, rel=0.3)


def test_what_the_force_has_where_it_should_have_nothing_is_taken_off() -> None:
    """A shaker that makes even harmonics of its own, before a structure that is linear."""
    u = force()
    disturbed = u + 0.02 * u**2
    the_force, found = contents(measured(disturbed, filtered(disturbed)), "force")
    assert the_force.even == pytest.approx(rms_of_a_line(0.02 * u**2, EVEN), rel=1e-6)
    assert found.even < 0.05 * rms_of_a_line(filtered(0.02 * u**2), EVEN)  # the response is interpolated


def test_excited_lines_are_found_where_the_force_drops() -> None:
    U = np.zeros(H + 1, dtype=complex)
    U[LINES] = 1.0 / (1.0 + 15.0 * np.exp(-(((LINES - 100) / 20.0) ** 2)))
    U += 0.003
    assert np.flatnonzero(excited_lines(U)).tolist() == LINES.tolist()


def test_a_sine_and_a_full_multisine_are_refused() -> None:
    t = np.arange(N) / N
    with pytest.raises(InputError, match="record 1: 1 harmonics of force are excited; must be 3 or more"):
        contents(measured(np.cos(2 * np.pi * t), np.sin(2 * np.pi * t)), "force")
    full = sum(np.cos(2 * np.pi * k * t + k**2) for k in range(20, 60))
    with pytest.raises(InputError, match="force excites every harmonic; must leave some out"):
        contents(measured(full, full), "force")


def test_the_command_prints_the_levels(tmp_path: Path) -> None:
    u = force()
    x = filtered(u)
    spectra = measured(u, x + 0.02 * x**2, noise=0.01)
    write_spectra(tmp_path / "s.csv", spectra)
    result = CliRunner().invoke(app, ["multisine", str(tmp_path / "s.csv")])
    assert result.exit_code == 0, result.output
    _, found = contents(spectra, "force")
    row = next(line.split() for line in result.stdout.splitlines() if " a1 " in line)
    assert row[:3] == ["1", "a1", str(len(LINES))]
    assert float(row[4]) == pytest.approx(found.db("even"), abs=0.05)


def noisy_force(y: np.ndarray, noise: float) -> tuple[MeasuredSpectra, np.ndarray]:
    """A force with noise on every line, its response as exact as can be; and the frequency response in between."""
    spectra = measured(force(), y, noise=1e-6)
    coefficients, std = spectra.coefficients.copy(), spectra.std.copy()
    i = spectra.index("force")
    std[0, i] = noise
    coefficients[0, i] += noise * np.random.default_rng(3).standard_normal(2 * H + 1)
    x = np.arange(H + 1) / 100.0
    return replace(spectra, coefficients=coefficients, std=std), np.abs(1.0 / (1.0 - x**2 + 0.2j * x))


def test_noise_of_the_force_that_is_taken_off_is_noise_of_the_response() -> None:
    """A linear structure: what is left where nothing was excited is that noise, not even or odd content."""
    spectra, G = noisy_force(filtered(force()), 1e-3)
    _, found = contents(spectra, "force")
    assert found.noise == pytest.approx(1e-3 * np.sqrt(np.mean(G[np.r_[EVEN, ODD]] ** 2)), rel=0.05)
    assert found.even == pytest.approx(1e-3 * np.sqrt(np.mean(G[EVEN] ** 2)), rel=0.2)
    assert found.odd == pytest.approx(1e-3 * np.sqrt(np.mean(G[ODD] ** 2)), rel=0.35)


def test_content_shows_above_the_noise_of_the_force() -> None:
    x = filtered(force())
    even, odd = 0.02 * x**2, 0.01 * x**3
    _, found = contents(noisy_force(x + even + odd, 1e-4)[0], "force")
    assert found.even == pytest.approx(np.hypot(rms_of_a_line(even, EVEN), found.noise), rel=0.1)
    assert found.odd == pytest.approx(np.hypot(rms_of_a_line(odd, ODD), found.noise), rel=0.1)
    assert found.even > 10.0 * found.noise
