"""Units of all responses, or of the force, by what sensors say of each other; what no fundamental alone tells."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from hbm.inverse.reconstruct import reconstruct
from hbm.inverse.sensorcheck import check_sensors
from hbm.inverse.units import with_gain
from hbm.measurement.spectra import MeasuredSpectra
from tests.inverse.measurement import with_noise
from tests.inverse.test_sensorcheck import CLEAN, RIG, STD, dead

RESPONSES = tuple(name for name in CLEAN.channels if name != "force")


@pytest.fixture(scope="module")
def noisy() -> MeasuredSpectra:
    return with_noise(CLEAN, np.random.default_rng(6))


def scaled(spectra: MeasuredSpectra, channels: tuple[str, ...], factor: float) -> MeasuredSpectra:
    """Numbers of channels as another unit has them, standard deviations too."""
    factors = np.array([factor if name in channels else 1.0 for name in spectra.channels])[:, None]
    return replace(spectra, coefficients=factors * spectra.coefficients, std=factors * spectra.std)


@pytest.mark.parametrize(
    ("channels", "factor", "said"),
    [
        (RESPONSES, 1 / 9.80665, "all accelerations are in g instead of m/s2"),
        (RESPONSES, 1e3, "all responses are in mm instead of m"),
        (RESPONSES, 0.5**0.5, "all responses are rms values instead of amplitudes"),
        (("force",), 1 / 9.80665, "the force is in kgf instead of N"),
        (("force",), 1e-3, "the force is in kN instead of N"),
        (("force",), 0.5**0.5, "the force is an rms value instead of an amplitude"),
    ],
)
def test_a_unit_is_named_and_no_channel_is_left_out(
    noisy: MeasuredSpectra, channels: tuple[str, ...], factor: float, said: str
) -> None:
    found = check_sensors(RIG, scaled(noisy, channels, factor))
    assert found.faults == ()
    assert found.spectra.channels == noisy.channels
    (line,) = found.findings
    assert line.startswith(f"units: the sensors read as if {said}, ")


@pytest.mark.parametrize(
    ("channel", "gain", "said"),
    [
        ("force", 1.02e-3, ["the force is in kN instead of N", "all responses are in mm instead of m"]),
        ("force", 9.7, ["all accelerations are in g instead of m/s2"]),
        (RESPONSES[0], 0.7, ["its values are rms values instead of amplitudes"]),
        (RESPONSES[0], 1e-3, []),  # no unit of accelerations alone
        ("force", -9.8, []),
        ("force", 1.06, []),
    ],
)
def test_a_gain_between_two_units_is_said_to_be_one(channel: str, gain: float, said: list[str]) -> None:
    assert with_gain(RIG, channel, gain) == said


def with_decibel(decibel: float, seed: int) -> MeasuredSpectra:
    """Noise of each channel so far below what it reads in its records."""
    size = np.sqrt(np.sum(CLEAN.coefficients**2, axis=2, keepdims=True) / 2)
    std = np.broadcast_to(10 ** (-decibel / 20) * size, CLEAN.std.shape)
    return with_noise(replace(CLEAN, std=std), np.random.default_rng(seed))


@pytest.mark.parametrize("decibel", [40.0, 30.0])
def test_accelerations_in_g_are_named_however_noisy_they_are(decibel: float) -> None:
    """Where responses hardly know the force, regression on what they say of it falls short of its gain."""
    for seed in range(6):
        found = check_sensors(RIG, scaled(with_decibel(decibel, seed), RESPONSES, 1 / 9.80665))
        assert found.faults == ()
        assert found.unit.startswith("units: the sensors read as if all accelerations are in g instead of m/s2, ")
        assert check_sensors(RIG, with_decibel(decibel, seed)).findings == ()


def test_sensors_that_agree_with_a_force_in_another_unit_by_their_noise_are_told() -> None:
    """Two sensors explain nearly anything: the misfit is not large, but falls beyond doubt in the other unit."""
    spectra = scaled(with_decibel(45.0, 3).select(channels=["force", "a2", "a5"]), RESPONSES, 1 / 9.80665)
    assert check_sensors(RIG, spectra).unit.startswith("units: the sensors read as if all accelerations are in g ")


def test_a_gain_of_a_force_that_sensors_hardly_know_is_within_its_deviation() -> None:
    """Pulls of ten draws; the misfit is not symmetric, and its deviation the mean of both sides."""
    pulls = []
    for seed in range(10):
        (fault,) = check_sensors(RIG, scaled(with_decibel(38.0, seed), ("force",), 6.0)).faults
        assert (fault.cause, fault.channel) == ("sensor-gain", "force")
        pulls.append((fault.value - 6.0) / fault.std)
    assert np.sqrt(np.mean(np.square(pulls))) < np.sqrt(chi2.ppf(0.995, len(pulls)) / len(pulls))  # of normal numbers
    assert np.abs(pulls).max() < 3.0


def test_nothing_is_said_of_friction_where_a_unit_is_wrong(noisy: MeasuredSpectra) -> None:
    found = reconstruct(RIG, scaled(noisy, RESPONSES, 1e3))
    assert found.warnings == (found.unit,)
    assert found.unit.startswith("units: ")
    assert reconstruct(RIG, noisy).unit == ""


@pytest.mark.parametrize("gain", [0.8, 1.3, 3.0, 5.0])
def test_a_gain_of_the_force_that_is_no_unit_is_not_called_one(noisy: MeasuredSpectra, gain: float) -> None:
    found = check_sensors(RIG, scaled(noisy, ("force",), gain))
    assert not any(line.startswith("units: ") for line in found.findings)
    assert {fault.channel for fault in found.faults} == ({"force"} if gain > 2.0 else set())


def test_a_force_that_reads_noise_alone_is_dead_and_in_no_coarser_unit(noisy: MeasuredSpectra) -> None:
    (fault,) = check_sensors(RIG, dead(noisy, "force", STD["force"])).faults
    assert (fault.cause, fault.channel) == ("sensor-dead", "force")


def test_a_fundamental_alone_leaves_the_peak_of_friction_unknown_and_says_so(noisy: MeasuredSpectra) -> None:
    coefficients = np.concatenate([noisy.coefficients[..., :2], noisy.coefficients[..., 10:11]], axis=2)
    fundamental = replace(noisy, coefficients=coefficients, std=noisy.std[..., :2])
    told = [line for line in reconstruct(RIG, fundamental).warnings if "alone" in line]
    assert len(told) == 1 and told[0].startswith("harmonic 1 alone was measured; friction above may be up to ")
    assert not any("alone" in line for line in reconstruct(RIG, noisy).warnings)
