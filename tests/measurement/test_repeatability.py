"""What a structure does not repeat, from the rig file, from repeated records, and as part of the noise."""

from dataclasses import replace

import numpy as np
import pytest

from hbm.measurement.repeatability import repeatability_of, typical_size, unrepeatable
from hbm.measurement.spectra import spectra_of
from models import Beam, Channel, Contact, Coulomb, Damping, Excitation, Rig

CHANNELS = (Channel("force", "force", 0.5), Channel("a1", "acceleration", 0.2), Channel("a2", "acceleration", 0.4))


@pytest.fixture
def rig():
    beam = Beam(length=0.6, width=0.04, thickness=0.005, youngs_modulus=210e9, density=7800.0)
    return Rig("beam", beam, Damping(0.5), Contact(80.0, Coulomb(0.5), 0.005), Excitation(1.0, 0.5), CHANNELS)


def measured(rig, scatter, noise=1e-4, times=40):
    """Two frequencies, each measured many times; the response of each mounting differs by a share."""
    rng = np.random.default_rng(5)
    hz = np.repeat([50.0, 52.0], times)
    level = np.full(len(hz), 2.0)
    force = level * (1.0 + 0.02 * rng.standard_normal(len(hz)))
    response = np.where(hz > 51.0, 3.0, 8.0) * force
    coefficients = {"force": np.column_stack([0 * force, force, 0 * force])}
    for name, share in scatter.items():
        own = share * response[:, None] * rng.standard_normal((len(hz), 2))
        pair = np.column_stack([response, 0 * response]) + own + noise * rng.standard_normal((len(hz), 2))
        coefficients[name] = np.column_stack([0 * force, pair])
    std = {name: np.full((len(hz), 2), noise) for name in coefficients}
    return spectra_of(rig, hz, level, coefficients, std)


def test_repeated_records_show_how_far_they_repeat(rig):
    """Scatter in each of cosine and sine is sqrt(2) times as much in the amplitude; forces that differ do not count."""
    found = repeatability_of(rig, measured(rig, {"a1": 0.01, "a2": 0.0}))
    assert found["a1"] == pytest.approx(0.01 * np.sqrt(2.0), rel=0.15)
    assert found["a2"] < 1e-4


def test_the_largest_of_what_is_known_counts(rig):
    stated = replace(rig, channels=(*CHANNELS[:2], replace(CHANNELS[2], repeatability=0.03)))
    spectra = measured(rig, {"a1": 0.01, "a2": 0.0})
    assert repeatability_of(stated, spectra)["a2"] == 0.03
    assert set(repeatability_of(stated, spectra, 0.05).values()) == {0.05}
    once = spectra.select(records=[1, 41])
    assert repeatability_of(rig, once) == {"a1": 0.0, "a2": 0.0}


def test_it_counts_as_noise_of_the_channel_alone(rig):
    spectra = measured(rig, {"a1": 0.0, "a2": 0.0})
    wider = unrepeatable(spectra, {"a1": 0.02, "a2": 0.0})
    assert np.array_equal(wider.std[:, [0, 2]], spectra.std[:, [0, 2]])
    size = np.abs(spectra.complex("a1")[:, 1])
    expected = np.hypot(1e-4, 0.02 * size / np.sqrt(2.0))
    assert wider.std[:, 1, 1] == pytest.approx(expected, rel=0.1)
    assert unrepeatable(spectra, {"a1": 0.0}) is spectra


def test_a_channel_near_a_node_has_the_size_of_its_harmonic():
    """One record reads next to nothing in one channel: what does not repeat there is as large as elsewhere."""
    size = np.array([[1.0, 2.0], [1.0, 1e-6], [1.0, 2.0]])
    assert typical_size(size)[1, 1] == pytest.approx(np.sqrt(8.0 / 3.0) * np.sqrt(0.5), rel=1e-3)
