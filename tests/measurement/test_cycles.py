"""Cycles of displacements that are known, and their accelerations."""

import numpy as np
import pytest

from hbm.measurement.cycles import acceleration, cycles_in


@pytest.mark.parametrize("cycles", [1.0, 1.4, 3.0, 5.01, 7.37])
@pytest.mark.parametrize("per_cycle", [40, 137.3])
def test_cycles_and_acceleration_of_a_steady_displacement(cycles: float, per_cycle: float) -> None:
    theta = 2 * np.pi * np.arange(round(cycles * per_cycle)) / per_cycle + 0.7
    time, rate = (theta - 0.7) / 20.0 + 3.0, 20.0
    x = 0.2 + np.sin(theta) + 0.03 * np.cos(3 * theta)
    found = cycles_in(time, x)
    assert found * per_cycle == pytest.approx(len(theta), abs=0.01)
    a = -(rate**2) * (np.sin(theta) + 0.27 * np.cos(3 * theta))
    assert np.abs(acceleration(time, x, found) - a).max() < 2e-3 * np.abs(a).max()


def test_noise_is_no_acceleration() -> None:
    theta = 2 * np.pi * np.arange(501) / 100
    x = np.sin(theta) + 0.02 * np.random.default_rng(0).standard_normal(len(theta))
    found = acceleration(theta, x, cycles_in(theta, x))
    assert np.sqrt(np.mean((found + np.sin(theta)) ** 2)) < 0.01


def test_what_does_not_repeat_has_no_cycle() -> None:
    theta = 2 * np.pi * np.arange(600) / 100
    assert np.isnan(cycles_in(theta, np.sin(theta) * np.where(theta < 6 * np.pi, 1.0, 3.0)))
