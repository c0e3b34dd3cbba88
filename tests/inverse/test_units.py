"""Units of all responses, or of the force, by what sensors say of each other; what no fundamental alone tells."""

from dataclasses import replace

import numpy as np
import pytest

from hbm.inverse.reconstruct import reconstruct
from hbm.inverse.sensorcheck import check_sensors
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
