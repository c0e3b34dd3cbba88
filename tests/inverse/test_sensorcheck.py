from dataclasses import replace

import numpy as np
import pytest

from hbm.inverse.reconstruct import reconstruct
from hbm.inverse.sensorcheck import _by_position, _readings, check_sensors
from hbm.measurement.repeatability import unrepeatable
from hbm.measurement.spectra import MeasuredSpectra
from hbm.response.synthesis import synthesize
from models.causes.cause import Cause
from models.causes.structure import AddedMass, AttachedResonator
from models.published import paper_rig
from models.rig import Rig
from tests.inverse.measurement import RIG, SAMPLES, measured, respond, with_noise

STD = {"force": 1e-4, **{f"a{i}": 0.02 for i in range(1, 7)}}
STEADY = {"mass": 0.05, "frequency_hz": 60.0}
THETA = 2 * np.pi * np.arange(SAMPLES) / SAMPLES


def friction(size: float, seed: int) -> np.ndarray:
    """Harmonics up to 9 that fall like k^-2, even ones smaller."""
    rng = np.random.default_rng(seed)
    k = np.arange(1, 10)
    amplitude = size * k**-2.0 * np.where(k % 2, 1.0, 0.3)
    return (amplitude * np.cos(np.outer(THETA, k) + rng.uniform(0, 2 * np.pi, 9))).sum(axis=1)


TRUTHS = [
    (hz, respond(RIG, hz, 6.5 * np.exp(1j * i), friction(size, i)))
    for i, (hz, size) in enumerate([(45.0, 15.0), (47.0, 30.0), (50.0, 40.0), (52.0, 35.0), (54.0, 30.0), (57.5, 10.0)])
]
CLEAN = measured(RIG, TRUTHS, STD, 9)


@pytest.fixture(scope="module")
def noisy() -> MeasuredSpectra:
    return with_noise(CLEAN, np.random.default_rng(5))


def times(spectra: MeasuredSpectra, channel: str, factor: np.ndarray | complex) -> MeasuredSpectra:
    i = spectra.index(channel)
    c = factor * spectra.complex(channel)
    coefficients = spectra.coefficients.copy()
    coefficients[:, i] = np.concatenate([c.real, -c.imag[:, 1:]], axis=1)
    return replace(spectra, coefficients=coefficients)


def late(spectra: MeasuredSpectra, channel: str, tau: float) -> MeasuredSpectra:
    """measured(t) = true(t - tau), by phases."""
    return times(spectra, channel, np.exp(-2j * np.pi * spectra.hz[:, None] * np.arange(10) * tau))


def dead(spectra: MeasuredSpectra, channel: str, std: float = 0.02) -> MeasuredSpectra:
    i = spectra.index(channel)
    coefficients = spectra.coefficients.copy()
    coefficients[:, i] = std * np.random.default_rng(7).normal(size=coefficients[:, i].shape)
    return replace(spectra, coefficients=coefficients)


def exchanged(spectra: MeasuredSpectra, a: str, b: str) -> MeasuredSpectra:
    order = list(range(len(spectra.channels)))
    i, j = spectra.index(a), spectra.index(b)
    order[i], order[j] = j, i
    return replace(spectra, coefficients=spectra.coefficients[:, order], std=spectra.std[:, order])


@pytest.mark.parametrize(
    "attached", [(AddedMass, {"mass": 0.2, "position": 0.4}), (AttachedResonator, {**STEADY, "position": 0.2})]
)
def test_shifts_are_looked_for_on_a_beam_with_attachments(attached: tuple[type[Cause], dict[str, float]]) -> None:
    """Its modes are not those of the bare beam, and there may be more of them."""
    kind, values = attached
    rig = kind().extend(RIG, values)
    spectra = synthesize(rig, (3.0,), (36.0, 42.0, 150.0), snr=80.0, seed=1, harmonics=5).spectra
    base = _readings(rig, spectra)
    name = base.channels[2]
    there, step = next(c.position for c in RIG.channels if c.name == name), 1e-5
    up, down = (
        _readings(replace(rig, channels=elsewhere(name, there + x).channels), spectra).rows[:, :, 2]
        for x in (step, -step)
    )
    moved = np.einsum("rks,rks->rk", (up - down) / (2 * step), base.everyone.state)
    by_shift = _by_position(base, 2, base.everyone.state[..., :2])
    assert np.abs(by_shift - moved).max() < 0.01 * np.abs(moved).max()


def elsewhere(channel: str, position: float) -> Rig:
    moved = tuple(replace(c, position=position) if c.name == channel else c for c in RIG.channels)
    return replace(RIG, channels=moved)


def test_sensors_that_agree_are_not_blamed_in_60_draws() -> None:
    rng = np.random.default_rng(11)
    findings = [check_sensors(RIG, with_noise(CLEAN, rng)) for _ in range(60)]
    assert not any(found.faults for found in findings)
    # of the misfit as a whole 0.2 % are too large or too small by chance
    assert sum(bool(found.findings) for found in findings) <= 2
    assert np.mean([found.after for found in findings]) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(("channel", "gain"), [("a1", 0.9), ("a3", -1.0), ("a6", 1.05)])
def test_a_gain_is_found_within_its_uncertainty(noisy: MeasuredSpectra, channel: str, gain: float) -> None:
    found = check_sensors(RIG, times(noisy, channel, gain))
    (blamed,) = found.faults
    # near the pinned tip deflection falls in proportion to the distance: a place may explain a gain as well
    (fault,) = [f for f in (blamed, *blamed.alternatives) if f.cause == "sensor-gain"]
    assert fault.channel == channel
    assert abs(fault.value - gain) < 4 * fault.std < 0.02
    assert found.spectra.channels == noisy.without(channel).channels
    assert found.findings[0].startswith(f"{channel}: ")


@pytest.mark.parametrize("gain", [0.102, -1.0])
def test_a_gain_is_named_beside_a_structure_that_is_not_quite_this_one(gain: float) -> None:
    """The residue of a shape that is a little wrong has order: no gain takes it, but next to all else."""
    off = replace(paper_rig().body, youngs_modulus=1.01 * paper_rig().body.youngs_modulus)
    truths = [
        (hz, respond(replace(RIG, body=off), hz, 6.5 * np.exp(1j * i), friction(size, i)))
        for i, (hz, size) in enumerate([(50.0, 40.0), (52.0, 35.0)])
    ]
    spectra = with_noise(measured(RIG, truths, STD, 9), np.random.default_rng(5))
    found = check_sensors(RIG, times(spectra, "a2", gain))
    assert found.after > 5.0
    (fault,) = found.faults
    assert (fault.cause, fault.channel) == ("sensor-gain", "a2")
    assert fault.value == pytest.approx(gain, rel=0.02)


@pytest.mark.parametrize(("channel", "tau"), [("a1", 50e-6), ("a4", -50e-6)])
def test_a_delay_is_found_within_its_uncertainty(noisy: MeasuredSpectra, channel: str, tau: float) -> None:
    (fault,) = check_sensors(RIG, late(noisy, channel, tau)).faults
    assert (fault.cause, fault.channel) == ("sensor-delay", channel)
    assert abs(fault.value - tau) < 4 * fault.std < 20e-6


@pytest.mark.parametrize(("channel", "nominal"), [("a1", 0.098), ("a4", 0.35)])
def test_a_sensor_that_sits_elsewhere_is_found(noisy: MeasuredSpectra, channel: str, nominal: float) -> None:
    (fault,) = check_sensors(elsewhere(channel, nominal), noisy).faults
    true = next(c.position for c in RIG.channels if c.name == channel)
    assert (fault.cause, fault.channel) == ("sensor-position", channel)
    assert abs(fault.value - true) < 4 * fault.std < 2e-3


def test_a_dead_sensor_is_found_and_friction_is_as_good_as_without_it(noisy: MeasuredSpectra) -> None:
    contact = reconstruct(RIG, dead(noisy, "a3"))
    without = reconstruct(RIG, noisy.without("a3"))
    assert contact.warnings[0].startswith("a3: dead, reads 0.0")
    np.testing.assert_array_equal(contact["friction"].samples, without["friction"].samples)


@pytest.mark.parametrize("pair", [("a3", "a4"), ("a1", "a6")])
def test_exchanged_channels_are_exchanged_back(noisy: MeasuredSpectra, pair: tuple[str, str]) -> None:
    found = check_sensors(RIG, exchanged(noisy, *pair))
    assert [(f.cause, f.channel, f.other) for f in found.faults] == [("swapped-channels", *pair)]
    np.testing.assert_array_equal(found.spectra.coefficients, noisy.coefficients)


def test_two_sensors_at_fault_are_both_found(noisy: MeasuredSpectra) -> None:
    found = check_sensors(RIG, times(dead(noisy, "a2"), "a5", 1.1))
    assert {f.channel for f in found.faults} == {"a2", "a5"}
    assert found.before > 100 * found.after


def test_a_sensor_that_only_scatters_more_is_named_so(noisy: MeasuredSpectra) -> None:
    std = noisy.std.copy()
    std[:, noisy.index("a4")] /= 5
    (fault,) = check_sensors(RIG, replace(noisy, std=std)).faults
    assert (fault.cause, fault.channel) == ("sensor-noise", "a4")
    assert abs(fault.value - 5.0) < 4 * fault.std < 3.0


@pytest.mark.parametrize("off", [0.003, 0.03])
@pytest.mark.parametrize("what", ["youngs_modulus", "length", "thickness", "excitation", "damping"])
def test_no_sensor_is_blamed_for_a_wrong_structure(noisy: MeasuredSpectra, what: str, off: float) -> None:
    if what == "excitation":
        wrong = replace(RIG, excitation=replace(RIG.excitation, position=RIG.excitation.position * (1 - off)))
    elif what == "damping":
        wrong = replace(RIG, damping=replace(RIG.damping, mass_proportional=RIG.damping.mass_proportional * (1 + off)))
    else:
        wrong = replace(RIG, body=replace(RIG.body, **{what: getattr(RIG.body, what) * (1 + off)}))  # type: ignore
    found = check_sensors(wrong, noisy)
    assert found.faults == ()
    if found.after > 1.5:
        assert found.findings[0].startswith("the sensors contradict the structure: misfit ")


@pytest.mark.parametrize(("times_std", "word"), [(1 / 3, "small"), (3.0, "large")])
def test_wrong_standard_deviations_are_told_with_their_factor(
    noisy: MeasuredSpectra, times_std: float, word: str
) -> None:
    found = check_sensors(RIG, replace(noisy, std=times_std * noisy.std))
    assert found.faults == ()
    (line,) = found.findings
    factor = float(line.split("scatter ")[1].split()[0])
    assert factor == pytest.approx(1 / times_std, rel=0.1)
    assert line.endswith(f"stated too {word}")


def test_what_does_not_repeat_is_named_where_it_is_stated_too_large(noisy: MeasuredSpectra) -> None:
    responses = [name for name in noisy.channels if name != "force"]
    (line,) = check_sensors(RIG, unrepeatable(noisy, dict.fromkeys(responses, 0.3))).findings
    assert line.startswith("standard deviations of noise and what does not repeat: ")
    assert line.endswith("stated too large")


def test_what_was_not_measured_is_said_once(noisy: MeasuredSpectra) -> None:
    assert check_sensors(RIG, noisy.without("force")).findings == (
        "force: not measured; its fundamental is free within 10 times the level, its phase unknown, "
        "its higher harmonics count as zero",
    )
    std = noisy.std.copy()
    std[:, [noisy.index("a2"), noisy.index("a5")], 6:] = np.nan
    std[:, noisy.index("force"), 2:] = np.nan
    assert check_sensors(RIG, replace(noisy, std=std)).findings == (
        "force: harmonics 2..9 not measured; taken for zero",
        "a2, a5: harmonics 6..9 not measured; left to the other channels",
    )


def test_too_few_sensors_to_tell_who_is_wrong(noisy: MeasuredSpectra) -> None:
    pair = check_sensors(RIG, times(noisy, "a3", 0.9).select(channels=["force", "a1", "a3"]))
    assert pair.faults == ()
    assert pair.findings[0].startswith("the sensors contradict the structure")
    alone = check_sensors(RIG, noisy.select(channels=["force", "a3"]))
    assert alone.findings == (
        "1 response channel and a measured force: nothing is left to check the sensors and the structure by",
    )


@pytest.mark.parametrize(("off", "sign"), [(1.0, 1.0), (1.02, 1.0), (1.02, -1.0)])
def test_a_force_of_the_opposite_sign_is_told_though_the_structure_is_wrong_too(
    off: float, sign: float, noisy: MeasuredSpectra
) -> None:
    """No channel is blamed beside a Young's modulus that is 2 % off; but one sign contradicts it far less."""
    rig = RIG.with_number("beam.youngs_modulus", off * RIG.number("beam.youngs_modulus"))
    check = check_sensors(rig, times(noisy, "force", sign))
    assert not check.faults
    assert check.opposite is (sign < 0.0)
    assert any(line.startswith("force: has it the opposite sign? ") for line in check.findings) is check.opposite
    turned = check.with_force(rig, times(noisy, "force", sign))
    np.testing.assert_allclose(turned.complex("force"), noisy.complex("force"))
