"""Diagnosis of decays whose answer is known: simulated on another discretisation by another rig, with noise."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from continuation import ConvergenceError
from hbm.cli import app
from hbm.diagnosis.backbonecampaign import backbone_campaign
from hbm.diagnosis.backbones import diagnose_backbone
from hbm.diagnosis.diagnose import diagnose
from hbm.errors import InputError
from hbm.files.diagnosissummary import first_screen
from hbm.files.outputs import columns_text
from hbm.fourier import Array, FourierBasis
from hbm.measurement.decay import Decay
from hbm.measurement.decayfile import is_decay, load_decay
from hbm.modes.decaying import over_channel, predicted
from hbm.outputerror.evaluation import Evaluation, start_from
from hbm.outputerror.fit import fit_model
from hbm.outputerror.model import Model
from hbm.outputerror.simulated import Solutions
from hbm.response.budget import Budget
from hbm.rigfiles.load import load_rig
from models.causes.addedjoint import AddedJoint
from models.causes.joints import CubicStiffness, JointMicroslip, JointSlip, LocalFriction, QuadraticDamping
from models.jointed import JointedRig

RIG = """
name = "one mode"
[modal]
frequencies_hz = [80.0]
ports = {{ tip = [0.8] }}
[damping]
modal_ratios = [{ratio}]
[excitation]
at = "tip"
amplitude = 1.0
[[channels]]
name = "acc"
quantity = "acceleration"
at = "tip"
"""
THREE = """
name = "three masses"
[modal]
frequencies_hz = [16.459, 39.632, 55.278]
ports = { m1 = [0.2655, -0.5474, -0.3604], m2 = [0.5249, -0.1458, 0.6082], m3 = [0.6677, 0.6073, -0.4306] }
[damping]
modal_ratios = [0.00305, 0.00137, 0.00107]
[excitation]
at = "m1"
amplitude = 1.0
[[channels]]
name = "acc"
quantity = "acceleration"
at = "m3"
"""
SPRING = """
[[joints]]
name = "bolt"
law = "polynomial-spring"
linear = 8e3
at = "tip"
"""
AMPLITUDES = np.geomspace(14.0, 0.4, 12)
LARGEST = 14.0 / (2 * np.pi * 80.0) ** 2
"""Motion [m]."""

TRIED = [CubicStiffness, QuadraticDamping, JointSlip, JointMicroslip]
HELD = (2, 5, 8, 11)


@pytest.fixture
def rig(tmp_path: Path) -> JointedRig:
    return made(tmp_path, 0.0012)


def made(folder: Path, ratio: float) -> JointedRig:
    (folder / "rig.toml").write_text(RIG.format(ratio=ratio))
    found = load_rig(folder / "rig.toml")
    assert isinstance(found, JointedRig)
    return found


def decayed(rig: JointedRig, seed: int) -> Decay:
    """Its backbone with 0.02 % of noise on the frequency and 3 % on the damping, on a grid of its own."""
    branch = over_channel(rig, 1, "acc", (float(AMPLITUDES[-1]), float(AMPLITUDES[0])), FourierBasis(11, 256))
    hz, ratio = predicted(branch, "acc", AMPLITUDES)
    draw = np.random.default_rng(seed).normal(size=(2, len(AMPLITUDES)))
    noisy = hz * (1 + 2e-4 * draw[0]), 2e-4 * hz, ratio * (1 + 0.03 * draw[1]), 0.03 * ratio
    return Decay("decay.csv", "acc", "m/s^2", AMPLITUDES, *noisy)


@pytest.mark.parametrize(
    ("cause", "values"),
    [
        (JointMicroslip("tip"), {"stiffness": 4e3, "limit": 0.9 * 4e3 * LARGEST}),
        (JointSlip("tip"), {"limit": 0.3 * 4e3 * LARGEST, "critical_slip": 0.3 * LARGEST}),
        (CubicStiffness("tip"), {"cubic": 3e3 / LARGEST**2}),
    ],
    ids=lambda value: getattr(value, "name", ""),
)
def test_the_joint_that_bends_a_backbone_is_named(
    cause: AddedJoint, values: dict[str, float], rig: JointedRig, tmp_path: Path
) -> None:
    """The linear mode of the rig is off by half a tolerance; the numbers of the joint come back."""
    truth = cause.extend(made(tmp_path, 0.0013), values)
    found = diagnose_backbone(rig, decayed(truth, 1), causes=TRIED)
    assert (found.verdict, found.cause) == ("cause-found", cause.name)
    assert found.held_out_records == HELD
    assert found.errors["extended"]["held_out"].chi2_reduced < 3.0 < found.errors["calibrated"]["held_out"].chi2_reduced
    for name, value in values.items():
        estimate = found.parameters[name]
        assert isinstance(estimate.value, float)
        assert abs(estimate.value - value) < 4.0 * estimate.std
        assert estimate.std < 0.5 * value


def test_a_fit_to_a_backbone_goes_on_along_its_valley(rig: JointedRig, tmp_path: Path) -> None:
    """At the largest motion all parts of the joint slide, which tells its limit and its stiffness apart."""
    stiffness, limit = 4e3, 0.4 * 4e3 * LARGEST
    truth = JointMicroslip("tip").extend(made(tmp_path, 0.0013), {"stiffness": stiffness, "limit": limit})
    found = diagnose_backbone(rig, decayed(truth, 1), causes=[JointMicroslip])
    for name, value in (("stiffness", stiffness), ("limit", limit)):
        estimate = found.parameters[name]
        assert isinstance(estimate.value, float)
        assert abs(estimate.value - value) < 2.0 * estimate.std < 0.4 * value


def test_a_joint_that_calibration_leaves_whole_is_named_with_every_place_it_may_be_at(tmp_path: Path) -> None:
    """Where the rig file misses all of a response, any model would do beside what calibration leaves."""
    (tmp_path / "three.toml").write_text(THREE)
    rig = load_rig(tmp_path / "three.toml")
    assert isinstance(rig, JointedRig)
    values = {"limit": 0.4, "critical_slip": 2e-4}
    found = diagnose_backbone(
        rig,
        decayed(LocalFriction("m3").extend(rig, values), 1),
        causes=[LocalFriction, CubicStiffness, JointMicroslip],
    )
    assert found.errors["calibrated"]["held_out"].nrmse > 1.0
    assert (found.verdict, found.cause) == ("cause-found", "local-friction")
    assert found.confidence > 0.9
    places = {found.ranking[0].label, *found.not_separable}
    assert len(places) == 6  # three to the ground, three between two
    assert all(name.startswith("local-friction ") for name in places)
    assert "another mode" in found.separate_by
    floor = next(float(m[1]) for line in found.evidence if (m := re.search(r"noise of ([0-9.e-]+) %", line)))
    assert floor < 5.0


def test_what_softens_and_what_hardens_are_named_together(rig: JointedRig) -> None:
    """Each hides the other: the frequency falls and rises again."""
    softer = JointMicroslip("tip").extend(rig, {"stiffness": 6e3, "limit": 1.2 * 6e3 * LARGEST})
    found = diagnose_backbone(
        rig,
        decayed(CubicStiffness("tip").extend(softer, {"cubic": 3e3 / LARGEST**2}), 1),
        causes=[JointMicroslip, CubicStiffness],
    )
    assert found.verdict == "cause-found"
    assert found.extended_fit is not None
    assert {c.name for c in found.extended_fit.model.causes} == {"joint-microslip", "cubic-stiffness"}
    assert any("alone explains" in line and "both together" in line for line in found.evidence)


def test_a_linear_decay_is_consistent(rig: JointedRig, tmp_path: Path) -> None:
    """Counted over five draws of noise."""
    verdicts = [diagnose_backbone(rig, decayed(made(tmp_path, 0.0013), seed)).verdict for seed in range(5)]
    assert verdicts == 5 * ["consistent"]


def test_a_rig_file_that_leaves_noise_is_nothing_wrong_and_amplitudes_held_out_alone_are_told(rig: JointedRig) -> None:
    """The rig file is the truth; then every third amplitude is read 0.2 Hz too high."""
    right = decayed(rig, 1)
    told = first_screen(diagnose_backbone(rig, right), None, "", 0.0)
    assert told["What is wrong"].startswith("Nothing. The rig file misses the records fitted by ")
    off = right.hz + 0.2 * np.isin(right.records, HELD)
    found = diagnose_backbone(rig, replace(right, hz=off))
    assert found.verdict == "unexplained"
    assert found.remainder.missed == pytest.approx(found.errors["calibrated"]["held_out"].nrmse)
    told = first_screen(found, None, "", 0.0)
    assert told["Why"] == "The records fitted ask for no cause."
    assert told["What remains"].startswith("What remains is noise on the records fitted; those held out are missed by ")
    assert told["What to measure next"].startswith("What is wrong shows in the records held out alone")


def test_a_damped_decay_is_slower_than_the_mode_by_the_closed_form(tmp_path: Path) -> None:
    """exp(-zeta omega t) cos(omega sqrt(1 - zeta^2) t) at zeta = 5 %, and what it changes by with both numbers."""
    rig, f, keys = made(tmp_path, 0.05), 80.0, ("modal.frequencies_hz[1]", "damping.modal_ratios[1]")
    numbers = np.array([rig.number(key) for key in keys])
    assert numbers == pytest.approx([f, 0.05])

    def closed(f: float, ratio: float) -> Array:
        return np.array([f * np.sqrt(1.0 - ratio**2) - 80.0, f * ratio])

    ones = np.ones(3)
    decay = Decay("x.csv", "acc", "m/s^2", 5.0 * ones, f * np.sqrt(1 - 0.05**2) * ones, ones, 0.05 * ones, ones)
    campaign = backbone_campaign(rig, decay, (1, 2, 3), f)
    for record in campaign.data.records:
        np.testing.assert_allclose(record.measured.ravel(), closed(*numbers), rtol=1e-9)
    for found in campaign.simulate(rig, keys, {}).values():
        np.testing.assert_allclose(found.amplitudes.ravel(), closed(*numbers), rtol=1e-6)
        for i, step in enumerate(1e-5 * np.diag(numbers)):
            slope = (closed(*(numbers + step)) - closed(*(numbers - step))) / (2.0 * step[i])
            np.testing.assert_allclose(found.by_keys[..., i].ravel(), slope, rtol=1e-5, atol=1e-9)


def test_a_number_at_its_bound_is_told_and_tried_where_calibration_leaves_noise_alone(tmp_path: Path) -> None:
    """A frequency 1.82 % higher: 3.5 tolerances of it, and the spring takes what they leave."""
    (tmp_path / "sprung.toml").write_text(RIG.format(ratio=0.0012) + SPRING)
    rig = load_rig(tmp_path / "sprung.toml")
    assert isinstance(rig, JointedRig)
    keys = "modal.frequencies_hz[1]", "joints.bolt.linear"
    truth = rig.with_numbers({keys[0]: 1.0182 * 80.0})
    found = diagnose_backbone(rig, decayed(truth, 1), causes=[f"parameter:{key}" for key in keys])
    assert found.verdict == "unexplained"
    assert found.errors["calibrated"]["train"].chi2_reduced < 1.0
    assert {r.label for r in found.ranking} == {f"parameter:{key}" for key in keys}
    assert (
        "Calibration moves modal.frequencies_hz[1] (+3.5) as many tolerances as it may: a number of the rig file is "
        "wrong, or physics is missing."
    ) in found.evidence


def test_what_a_tolerance_costs_is_what_a_fit_without_it_takes(tmp_path: Path) -> None:
    """Of a frequency, a spring that does nearly the same, and a damping ratio; all are nearly linear."""
    (tmp_path / "sprung.toml").write_text(RIG.format(ratio=0.0012) + SPRING.replace("8e3", "8e4"))
    rig = load_rig(tmp_path / "sprung.toml")
    assert isinstance(rig, JointedRig)
    known = {"modal.frequencies_hz[1]": 2e-3, "joints.bolt.linear": 0.02, "damping.modal_ratios[1]": 0.2}
    truth = rig.with_numbers({"modal.frequencies_hz[1]": 80.4, "damping.modal_ratios[1]": 0.0015})
    decay = decayed(truth, 1)
    campaign = backbone_campaign(rig, decay, range(1, 13), float(decay.hz.mean()))

    def fitted(known: dict[str, float]) -> Evaluation:
        model = Model(rig, known)
        return fit_model(model, campaign, model.start, {}, settled=1e-6)

    e = fitted(known)
    for f, cost in zip(e.model.free, e.costs, strict=True):
        without = fitted({**known, f.name: np.inf})
        assert cost == pytest.approx(e.chi2 - without.chi2, rel=0.03), f.name
        assert cost > 0.1
    assert np.all(e.costs[:2] > 1.5 * e.pulls[:2] ** 2)  # the one is pulled in the place of the other


def test_a_law_that_is_not_tried_is_not_explained(rig: JointedRig, tmp_path: Path) -> None:
    truth = CubicStiffness("tip").extend(rig, {"cubic": 3e3 / LARGEST**2})
    found = diagnose_backbone(rig, decayed(truth, 1), causes=[QuadraticDamping])
    assert (found.verdict, found.cause, found.extended) == ("unexplained", None, None)


def test_a_candidate_that_cannot_be_solved_is_told(rig: JointedRig, monkeypatch: pytest.MonkeyPatch) -> None:
    def start(model: Model, *args: object) -> tuple[float, Solutions]:
        if any(isinstance(cause, CubicStiffness) for cause in model.causes):
            raise ConvergenceError("lost")
        return start_from(model, *args)  # type: ignore[arg-type]

    monkeypatch.setattr("hbm.diagnosis.flooredsearch.start_from", start)
    truth = CubicStiffness("tip").extend(rig, {"cubic": 3e3 / LARGEST**2})
    found = diagnose_backbone(rig, decayed(truth, 1), causes=[CubicStiffness, QuadraticDamping])
    assert (found.verdict, found.ranking) == ("unexplained", ())
    assert found.evidence[-4:] == (
        "Joints that promise to take some of the misfit, to first order: 1. Models fitted with those that promise "
        "most: 1.",
        "Not solved on the 8 amplitudes of acc from any of their starts, 1 of 1, which are in no ranking for that: "
        "cubic-stiffness tip.",
        "cubic-stiffness is in no ranking: not solved from any of its starts.",
        "quadratic-damping is in no ranking: it promises nothing, to first order.",
    )


def test_a_candidate_that_is_not_accepted_is_ranked(rig: JointedRig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hbm.diagnosis.flooredsearch.accepted", lambda *_: False)
    truth = CubicStiffness("tip").extend(rig, {"cubic": 3e3 / LARGEST**2})
    found = diagnose_backbone(rig, decayed(truth, 1), causes=[CubicStiffness])
    assert (found.verdict, found.cause) == ("unexplained", None)
    assert [r.label for r in found.ranking] == ["cubic-stiffness tip"]
    assert not any("Not solved" in line for line in found.evidence)


def test_where_the_nonlinear_mode_is_not_found_the_amplitudes_are_said(
    rig: JointedRig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hbm.diagnosis.backbonecampaign.ALONE", Budget(points=8))
    file = written(tmp_path / "decay.csv", decayed(rig, 1))
    args = ["diagnose", str(tmp_path / "rig.toml"), str(file), "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(app, args)
    assert result.exit_code == 1
    assert re.fullmatch(
        rf"hbm: diagnose: {re.escape(str(file))}: the nonlinear mode of the rig was not found at all amplitudes, "
        r"acc = 0.4 to 14: one mode: acc of mode 1 reaches \S+ to \S+; must be .*: 8 points are its budget; .*; "
        r"see hbm backbone .*",
        result.stderr.strip(),
    )


def test_spectra_are_for_one_function_and_decays_for_another(rig: JointedRig) -> None:
    said = r"= Decay; must be MeasuredSpectra, as load_spectra\(file, rig\) returns; a decay is for diagnose_backbone"
    with pytest.raises(InputError, match=said):
        diagnose(rig, decayed(rig, 1))  # type: ignore[arg-type]


def written(path: Path, decay: Decay) -> Path:
    path.write_text(columns_text(decay.columns))
    return path


def test_the_command_writes_what_of_other_records_it_writes(rig: JointedRig, tmp_path: Path) -> None:
    truth = CubicStiffness("tip").extend(rig, {"cubic": 3e3 / LARGEST**2})
    file, out = written(tmp_path / "decay.csv", decayed(truth, 1)), tmp_path / "out"
    args = ["diagnose", str(tmp_path / "rig.toml"), str(file), "--out", str(out), "--cause", "cubic-stiffness"]
    result = CliRunner().invoke(app, [*args, "--hold-out", "1", "--hold-out", "12"])
    assert result.exit_code == 0, result.output
    table = json.loads((out / "diagnosis.json").read_text())
    assert (table["verdict"], table["cause"]) == ("cause-found", "cubic-stiffness")
    assert table["held_out_records"] == [1, 12]
    assert {p.name for p in out.iterdir()} == {
        "diagnosis.json", "errors.csv", "ranking.csv", "extended.toml", "report.html", "figures",
    }  # fmt: skip
    extended = load_rig(out / "extended.toml")
    hz, ratio = predicted(over_channel(extended, 1, "acc", (0.4, 14.0)), "acc", AMPLITUDES)
    drawn = np.genfromtxt(out / "figures" / "backbone.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    own = drawn[drawn["model"] == "extended"]
    assert own["simulated_hz"] == pytest.approx(hz[::-1], rel=1e-6)
    assert own["simulated_damping_ratio"] == pytest.approx(ratio[::-1], rel=1e-4)


def test_what_is_no_question_of_a_decay_is_refused(rig: JointedRig, tmp_path: Path) -> None:
    decay = decayed(rig, 1)
    file = written(tmp_path / "decay.csv", decay)
    args = ["diagnose", str(tmp_path / "rig.toml"), str(file), "--out", str(tmp_path / "out")]
    for more, line in (
        (["--repeatability", "1"], f"diagnose: --repeatability: {file} is a decay; must be of spectra\n"),
        (["--hold-out", "13"], f"{file}: no amplitude 13 to hold out; must be from 1 to 12\n"),
    ):
        result = CliRunner().invoke(app, [*args, *more])
        assert (result.exit_code, result.stderr) == (2, line)
    with pytest.raises(InputError, match="channel tip; must be one of the rig: acc"):
        diagnose_backbone(rig, Decay("d.csv", "tip", "", *[getattr(decay, n) for n in FIELDS]))
    with pytest.raises(InputError, match="5 amplitudes; must be 6 at least"):
        diagnose_backbone(rig, Decay("d.csv", "acc", "", *[getattr(decay, n)[:5] for n in FIELDS]))


FIELDS = ("amplitude", "hz", "hz_std", "damping_ratio", "damping_ratio_std")


def test_a_decay_file_is_read_back(rig: JointedRig, tmp_path: Path) -> None:
    decay = decayed(rig, 2)
    file = written(tmp_path / "decay.csv", decay)
    back = load_decay(file)
    assert is_decay(file)
    assert back.channel == "acc"
    for name in FIELDS:
        assert getattr(back, name) == pytest.approx(getattr(decay, name), rel=1e-9)
    file.write_text(file.read_text().replace(",", ";").replace(".", ","))
    assert is_decay(file)
    assert np.array_equal(load_decay(file).amplitude, back.amplitude)


def test_a_table_that_is_meant_as_a_decay_is_refused_as_one(tmp_path: Path) -> None:
    """By what it lacks of a decay, not of a spectra file."""
    (tmp_path / "f.csv").write_text("record,time_s,velocity_ms,frequency_hz,damping_ratio\nD01,0.1,0.55,122.2,1e-3\n")
    assert is_decay(tmp_path / "f.csv")
    with pytest.raises(InputError, match=r"f\.csv line 1: no column channel, amplitude, frequency_hz_std, damping_r"):
        load_decay(tmp_path / "f.csv")


HEADING = "channel,amplitude,frequency_hz,frequency_hz_std,damping_ratio,damping_ratio_std\n"


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (
            HEADING.replace("channel,", ""),
            "line 1: no column channel; must have " + HEADING[:-1],
        ),
        (HEADING, "no rows; must have one per amplitude"),
        (HEADING + "v,1,80,0,0.1,0.1\n", "line 2: frequency_hz_std = 0; must be > 0"),
        *(
            (
                HEADING + f"v,1,80,1,{ratio},0.1\n",
                f"line 2: damping_ratio = {ratio}; must be above -1 and below 1, 0.01 w",
            )
            for ratio in ("1.2", "-1", "nan", "inf")
        ),
        (HEADING + "v,inf,80,1,0.1,0.1\n", "line 2: amplitude = inf; must be > 0"),
        (HEADING + "v,1,80,x,0.1,0.1\n", "line 2: 1, 80, x, 0.1, 0.1; must be numbers"),
        (HEADING + "v,1,80,1\n", "line 2: 4 entries; must have 6"),
        (
            HEADING + "v,1,80,1,0.1,0.1\nv,2,80,1,0.1,0.1\nv,1.0,81,1,0.1,0.1\n",
            "line 4: amplitude 1 of v a second time; must be once in a file",
        ),
        (HEADING + "v,1,80,1,0.1,0.1\nw,1,80,1,0.1,0.1\n", "channels v, w; must be one"),
    ],
)
def test_what_is_no_decay_file_is_refused(text: str, line: str, tmp_path: Path) -> None:
    (tmp_path / "decay.csv").write_text(text)
    with pytest.raises(InputError, match=line):
        load_decay(tmp_path / "decay.csv")
