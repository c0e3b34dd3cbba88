"""What is wrong with a measurement: a sensor, the force, or an order of time.

The records of modes are those of an independent simulator; the structure differs a little from its rig file in all
that is identified of it.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import tests.truth.modal as truth
from hbm.diagnosis.diagnose import diagnose
from hbm.diagnosis.fullfits import measurable
from hbm.diagnosis.screen import Screening
from hbm.diagnosis.signatures import Score
from hbm.diagnosis.turns import in_order
from hbm.diagnosis.verdict import Diagnosis
from hbm.files.extendedrig import write_extended_rig
from hbm.measurement.spectra import MeasuredSpectra
from hbm.outputerror.measured import campaign_of
from hbm.outputerror.simulated import Simulated
from hbm.response.synthesis import synthesize
from hbm.rigfiles.extensions import Extension
from hbm.rigfiles.load import load_rig
from models.causes import all_candidates
from models.causes.cause import Cause
from models.causes.records import ParameterDrift
from models.causes.sensors import SensorGain
from models.jointed import JointedRig
from models.parts import Excitation
from models.published import paper_rig
from models.rig import Rig
from tests.far_off import far_off
from tests.three_modes import HZ as ONCE
from tests.three_modes import NOMINAL, OFF, ROWS, SENSORS, rig_file, rig_of, spectra_with_noise

FREQUENCIES = "modal.frequencies_hz"
H = 3
SHAPES = 0.04
"""A gain is known hardly better than shapes, of which each entry may be off by 3 % of the largest."""

HZ = np.tile(ONCE, 3)
FORCE = np.repeat([0.2, 0.6, 1.0], len(HZ) // 3)


@cache
def records(drift: float = 0.0) -> MeasuredSpectra:
    """Records of a linear structure, whose frequencies grow by a share of themselves from record to record."""
    rng = np.random.default_rng(1)
    modes = NOMINAL.disturbed(rng, **OFF)
    modes = replace(modes, hz=modes.hz * (1.0 + drift * np.arange(len(HZ))[:, None]))
    q = truth.steady(modes, truth.nothing, ROWS["a"], "drive", HZ, FORCE, periods=200, steps=256, H=H)
    return spectra_with_noise(
        rig_of(), {name: truth.accelerations(modes, q, name, HZ) for name in SENSORS}, HZ, FORCE, rng
    )


SUCH = "Such a gain is found where "


def times(spectra: MeasuredSpectra, factor: float, *channels: str) -> MeasuredSpectra:
    coefficients, std = spectra.coefficients.copy(), spectra.std.copy()
    for i in map(spectra.index, channels):
        coefficients[:, i] *= factor
        std[:, i] *= abs(factor)
    return replace(spectra, coefficients=coefficients, std=std)


def value(d: Diagnosis, name: str) -> tuple[float, float]:
    found = d.parameters[name]
    assert isinstance(found.value, float) and found.std is not None
    return found.value, found.std


@pytest.mark.parametrize(
    ("gain", "channel", "unit"),
    [(0.102, "a", "its values are in g instead of m/s2"), (0.5, "b", ""), (-1.0, "c", "")],
)
def test_a_sensor_that_reads_a_multiple_is_named(gain: float, channel: str, unit: str) -> None:
    """Numbers of modes that go to their bounds for it, and joints that these would need, explain it no better."""
    d = diagnose(rig_of(), times(records(), gain, channel))
    assert (d.verdict, d.cause) == ("cause-found", "sensor-gain")
    assert d.parameters["channel"].value == channel
    found, std = value(d, "gain")
    assert abs(found - gain) < 3.0 * std and std < SHAPES * abs(gain)
    assert [line for line in d.evidence if line.startswith(SUCH)] == [f"{SUCH}{unit}."] * bool(unit)


@pytest.mark.parametrize(
    ("factor", "channels", "gain", "unit"),
    [
        (1.3, ("force",), 1.3, ""),
        (-1.0, ("force",), -1.0, ""),
        (0.102, SENSORS, 1.0 / 0.102, "all accelerations are in g instead of m/s2"),
    ],
)
def test_one_factor_on_the_force_or_on_everything_else_is_a_gain_of_the_force(
    factor: float, channels: tuple[str, ...], gain: float, unit: str
) -> None:
    d = diagnose(rig_of(), times(records(), factor, *channels))
    assert (d.verdict, d.cause) == ("cause-found", "sensor-gain")
    assert d.parameters["channel"].value == "force"
    found, std = value(d, "gain")
    assert abs(found - gain) < 3.0 * std and std < SHAPES * abs(gain)
    assert [line for line in d.evidence if line.startswith(SUCH)] == [f"{SUCH}{unit}."] * bool(unit)


def test_frequencies_that_drift_are_named() -> None:
    rate = -6e-4
    d = diagnose(rig_of(), records(rate))
    assert (d.verdict, d.cause) == ("cause-found", "drift")
    assert d.parameters["parameter"].value == FREQUENCIES
    found, std = value(d, "rate")
    assert abs(found - rate) < 3.0 * std < 0.05 * abs(rate)


def test_nothing_is_blamed_where_nothing_is_wrong() -> None:
    d = diagnose(rig_of(), records())
    assert (d.verdict, d.cause) == ("consistent", None)


def test_they_are_candidates_once() -> None:
    bare = rig_of()
    offered = [c.label for c in all_candidates(bare)]
    assert "sensor-gain force" in offered and f"drift {FREQUENCIES}" in offered
    assert "drift damping.modal_ratios" in offered
    known = replace(bare, excitation=replace(bare.excitation, force_gain=((0.2, 1.0),)))
    assert "sensor-gain force" not in [c.label for c in all_candidates(known)]  # it is a number of the rig file there


@pytest.mark.parametrize(
    ("cause", "name", "size"), [(SensorGain("force"), "gain", 1.2), (ParameterDrift(FREQUENCIES), "rate", 2e-4)]
)
def test_derivatives_are_those_of_records_simulated_again(cause: Cause, name: str, size: float) -> None:
    campaign, _ = campaign_of(rig_of(), records())
    key = cause.unknowns(rig_of())[0].key

    def simulated(value: float) -> dict[int, Simulated]:
        return campaign.simulate(cause.extend(rig_of(), {name: value}), [key], {})

    step = 1e-4 * size
    here, above, below = (simulated(size + s) for s in (0.0, step, -step))
    assert [*here] == campaign.numbers
    for number, found in here.items():
        again = (above[number].amplitudes - below[number].amplitudes) / (2.0 * step)
        np.testing.assert_allclose(found.by_keys[..., 0], again, rtol=0.0, atol=1e-5 * max(np.abs(again).max(), 1e-9))


@pytest.mark.parametrize(
    ("cause", "name", "size"), [(SensorGain("force"), "gain", 1.2), (ParameterDrift(FREQUENCIES), "rate", 2e-4)]
)
def test_they_are_read_back_as_they_were_written(cause: Cause, name: str, size: float, tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    file.write_text(rig_file())
    written = write_extended_rig(tmp_path / "extended.toml", file, [Extension.of(cause, {name: size})])
    back = load_rig(written)
    assert back.numbers == cause.extend(load_rig(file), {name: size}).numbers
    assert size in [value for value, _ in back.numbers.values()]


def test_all_frequencies_of_a_record_have_drifted_by_its_number() -> None:
    drifting = ParameterDrift(FREQUENCIES).extend(rig_of(), {"rate": 0.01})
    assert isinstance(drifting, JointedRig)
    for i, hz in enumerate(NOMINAL.hz, 1):
        assert drifting.at_record(4).number(f"{FREQUENCIES}[{i}]") == pytest.approx(1.03 * hz, rel=1e-12)


def test_a_force_channel_that_reads_nothing_of_the_force_is_refused() -> None:
    with pytest.raises(ValueError, match="channel_gain"):
        Excitation(1.0, channel_gain=0.0)


# ---- a beam with a contact

BEAM = paper_rig()


@cache
def of_beam() -> MeasuredSpectra:
    """About two modes."""
    hz = (*np.linspace(46.0, 53.0, 6).tolist(), *np.linspace(150.0, 175.0, 4).tolist())
    return synthesize(BEAM, (3.0, 6.5), hz, snr=60.0, seed=3, harmonics=5).spectra


@pytest.mark.parametrize("rig", [BEAM, rig_of()], ids=["contact", "joints"])
def test_what_the_force_reads_runs_first_where_it_is_asked(rig: Rig | JointedRig) -> None:
    """A wrong polarity promises nothing by its first small effect: the responses are not a little smaller."""

    drops = {SensorGain(rig.response_channels[0].name): 1e9, SensorGain("force"): 0.0}
    scores = tuple(Score(cause, drop, drop, np.zeros(1), {}, 1.0) for cause, drop in drops.items())
    assert [s.cause for s in in_order(Screening(scores, 1, len(scores)), far_off(rig))] == [*drops][::-1]


@pytest.mark.parametrize(("gain", "below"), [(0.92, 60.0), (1.3, np.inf), (-1.0, np.inf)])
def test_a_force_of_a_beam_that_reads_a_multiple_is_named(gain: float, below: float) -> None:
    """Of the wrong polarity too: records that the right one has start with their motion turned over.

    About one mode alone the force does not contradict the responses, and a position of the excitation is close.
    """
    near = [c for c in all_candidates(BEAM) if c.label in ("added-mass", "parameter:excitation.position")]
    d = diagnose(BEAM, times(of_beam().select(hz=(0.0, below)), gain, "force"), causes=[*near, SensorGain("force")])
    assert len(near) == 2
    assert (d.verdict, d.cause) == ("cause-found", "sensor-gain")
    assert d.parameters["channel"].value == "force"
    found, std = value(d, "gain")
    assert abs(found - gain) < 3.0 * std < 0.02
    assert d.extended is not None and d.extended.number("excitation.channel_gain") == found


def test_where_the_unit_is_wrong_nothing_but_the_force_is_asked() -> None:
    """With responses that are told to be in another unit, whatever a cause explains is wrong."""
    wrong = times(of_beam(), 1.0 / 9.80665, *(c.name for c in BEAM.response_channels))
    campaign, sensors = campaign_of(BEAM, wrong)
    assert any("all accelerations are in g instead of m/s2" in line for line in sensors)
    assert [c.label for c in all_candidates(BEAM) if measurable(c, BEAM, campaign)] == ["sensor-gain force"]
