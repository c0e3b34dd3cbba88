"""What a structure does not repeat, from the rig file, from repeated records, and as part of the noise."""

from dataclasses import replace

import numpy as np
import pytest

from hbm.errors import InputError
from hbm.fourier import MANY
from hbm.measurement.repeatability import repeatability_of, typical_size, unrepeatable, with_floor, with_std
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


def test_steps_through_a_sharp_resonance_are_no_repetitions(rig):
    """Steps of a beam in vacuum: 3.3 mHz at 42.7 Hz, 8e-5 of the frequency."""
    spectra = measured(rig, {"a1": 0.01, "a2": 0.0})
    stepped = replace(spectra, hz=spectra.hz * (1.0 + 8e-5 * np.arange(len(spectra))))
    assert repeatability_of(rig, stepped) == {"a1": 0.0, "a2": 0.0}


def test_lines_of_a_multisine_are_no_repetitions(rig):
    """Realisations of it have one base frequency and one level, and other phases."""
    spectra = measured(rig, {"a1": 0.5, "a2": 0.0})
    many = MANY + 1
    coefficients = np.full((len(spectra), 3, 2 * many + 1), np.nan)
    coefficients[:, :, 1], coefficients[:, :, many + 1] = spectra.coefficients[:, :, 1], spectra.coefficients[:, :, 2]
    std = np.full((len(spectra), 3, many + 1), np.nan)
    std[:, :, 1] = spectra.std[:, :, 1]
    lines = replace(spectra, coefficients=coefficients, std=std)
    assert repeatability_of(rig, lines) == {"a1": 0.0, "a2": 0.0}


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


def without_std(spectra):
    return replace(spectra, std=np.full_like(spectra.std, np.nan))


def test_records_measured_more_than_once_say_what_a_standard_deviation_is(rig):
    """Phases turn with the force from record to record, and responses grow with it: neither is noise."""
    rng = np.random.default_rng(8)
    spectra = measured(rig, {"a1": 0.01, "a2": 0.03})
    turn = np.exp(1j * rng.uniform(0.0, 2 * np.pi, len(spectra)))[:, None] * np.ones(len(spectra.channels))
    c = turn * (spectra.coefficients[..., 1] - 1j * spectra.coefficients[..., 2])
    turned = np.stack([spectra.coefficients[..., 0], c.real, -c.imag], axis=2)
    found = with_std(rig, without_std(replace(spectra, coefficients=turned)))
    size = {name: np.abs(spectra.complex(name)[:, 1]) for name in spectra.channels}
    for name, share in {"a1": 0.01, "a2": 0.03, "force": 0.02}.items():  # each of cosine and sine; 80 records
        assert found.std[:, found.index(name), 1] / size[name] == pytest.approx(share, rel=0.2)
    assert found.assumed == ()
    assert repeatability_of(rig, found)["a2"] < 0.015  # it is noise already


def test_a_stated_repeatability_stands_in_for_standard_deviations_once(rig):
    spectra = without_std(measured(rig, {"a1": 0.0, "a2": 0.0}).select(records=[1, 41]))
    with pytest.raises(
        InputError, match="measure records of its level and frequency more than once, or state --repeat"
    ):
        with_std(rig, spectra)
    found = with_std(rig, spectra, 0.02)
    size = np.abs(found.complex("a1")[:, 1])
    assert found.std[:, 1, 1] == pytest.approx(0.02 * size / np.sqrt(2.0), rel=1e-4)
    again = unrepeatable(found, repeatability_of(rig, found, 0.02))
    assert np.array_equal(again.std, found.std)


def test_a_stated_repeatability_counts_where_another_channel_has_no_standard_deviation(rig):
    """A force known by its setting alone, beside a response with its noise."""
    spectra = measured(rig, {"a1": 0.0, "a2": 0.0}).select(records=[1, 41])
    std = spectra.std.copy()
    std[:, spectra.index("force")] = np.nan
    found = with_std(rig, replace(spectra, std=std), 0.02)
    assert found.assumed == ("force",)
    assert repeatability_of(rig, found, 0.02) == {"a1": 0.02, "a2": 0.02}
    assert np.array_equal(found.std[:, 1:], spectra.std[:, 1:])
    floored = with_floor(found, ("a1", "force"), 0.02)
    size = np.abs(found.complex("a1")[:, 1])
    assert floored.std[:, 1, 1] == pytest.approx(np.hypot(spectra.std[:, 1, 1], 0.02 * size / np.sqrt(2.0)), rel=1e-4)
    assert np.array_equal(floored.std[:, 0], found.std[:, 0])


def test_standard_deviations_that_are_given_stay(rig):
    spectra = measured(rig, {"a1": 0.01, "a2": 0.0})
    assert with_std(rig, spectra, 0.1) is spectra
    some = spectra.std.copy()
    some[:, 1] = np.nan
    found = with_std(rig, replace(spectra, std=some))
    assert np.array_equal(found.std[:, [0, 2]], spectra.std[:, [0, 2]])
    assert np.isfinite(found.std).all()
