"""Steady records with harmonics beyond those asked for: they scatter nothing, and are no noise of the others."""

import numpy as np
import pytest

from hbm.measurement.harmonicestimate import HarmonicEstimate
from hbm.measurement.harmonics import harmonic_spectra
from hbm.measurement.recording import recording
from hbm.measurement.waves import overtones

HZ, RATE, HIGHEST, ASKED, NOISE = 57.0, 5000.0, 20, 9, 0.02  # 87.7 samples per period
AMPLITUDES = {"force": 1.0 / np.arange(1, HIGHEST + 1) ** 3, "a1": np.linspace(1.0, 1.5, HIGHEST)}


def signals(t: np.ndarray) -> dict[str, np.ndarray]:
    k = np.arange(1, HIGHEST + 1)
    return {name: np.cos(2 * np.pi * HZ * np.outer(t, k) + k**2) @ size for name, size in AMPLITUDES.items()}


def estimate(seed: int, asked: int, seconds: float = 1.5) -> HarmonicEstimate:
    t, rng = np.arange(int(seconds * RATE)) / RATE, np.random.default_rng(seed)
    noisy = {name: values + NOISE * rng.standard_normal(len(t)) for name, values in signals(t).items()}
    return harmonic_spectra(recording("run.csv", t, noisy), HZ, asked)


@pytest.mark.parametrize("seconds", [0.1, 0.5, 1.5])
def test_what_is_asked_for_is_as_right_and_as_sure_as_where_all_is_asked_for(seconds: float) -> None:
    """Of five, 28 and 85 periods; without the others in the fit deviations were five times too large."""
    k, pulls, ratios = np.arange(1, ASKED + 1), [], []
    for seed in range(20):
        few, all_ = estimate(seed, ASKED, seconds), estimate(seed, HIGHEST, seconds)
        assert few.warnings == ()
        assert all(q.steadiness.steady for q in few.quality)
        ratios.append(few.own_std[:, 1:] / all_.own_std[:, 1 : ASKED + 1])
        for own, (name, size) in zip(few.coefficients, AMPLITUDES.items(), strict=True):
            std = few.own_std[few.channels.index(name), 1:]
            true = np.concatenate([np.cos(k**2), -np.sin(k**2)]) * np.tile(size[:ASKED], 2)
            pulls.append((own[1:] - true) / np.tile(std, 2))
    assert np.sqrt(np.mean(np.square(pulls))) == pytest.approx(1.0, abs=0.12)
    assert np.exp(np.mean(np.log(ratios))) == pytest.approx(1.0, abs=0.05)


def test_those_that_stand_out_are_found_and_no_noise() -> None:
    e = estimate(0, ASKED)
    assert list(e.beyond) == list(range(ASKED + 1, HIGHEST + 1))
    assert [e.beyond[k][1] for k in e.beyond] == pytest.approx(AMPLITUDES["a1"][ASKED:], abs=4 * NOISE / np.sqrt(3750))
    quiet = np.random.default_rng(1).standard_normal((7500, 2))
    found = overtones(np.arange(7500) / RATE, quiet, HZ, ASKED, quiet, 85)
    assert len(found.numbers) == 0
    assert not found.values.any()


def test_without_noise_all_is_exact() -> None:
    t = np.arange(4000) / RATE
    e = harmonic_spectra(recording("run.csv", t, signals(t)), HZ, ASKED)
    k = np.arange(1, ASKED + 1)
    assert e.coefficients[1, 1:] == pytest.approx(
        np.concatenate([np.cos(k**2), -np.sin(k**2)]) * np.tile(AMPLITUDES["a1"][:ASKED], 2), abs=1e-9
    )
    assert e.warnings == ()
