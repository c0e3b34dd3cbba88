"""The command ``hbm backbone``: what it writes, and what it refuses."""

import csv
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from hbm.cli import app
from hbm.modes.accuracy import NumericalChange
from hbm.modes.linear import linear_modes
from hbm.response.curve import ResponseCurve
from hbm.response.trace import trace_frequency
from models.jointed import AnyRig
from models.published import paper_rig

PAPER = str(Path(__file__).parents[1] / "examples" / "paper_beam.toml")
QUICK = ["--from", "1e-6", "--to", "1e-5", "--harmonics", "3"]


def run(*args: str) -> Result:
    return CliRunner().invoke(app, ["backbone", *args], prog_name="hbm")


def test_table_and_companion(tmp_path: Path) -> None:
    out = tmp_path / "modes.csv"
    result = run(PAPER, *QUICK, "--out", str(out))
    assert result.exit_code == 0, result.output
    with out.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["backbone"] for row in rows} == {"nonlinear-mode", "phase-resonance"}
    assert [float(rows[0]["amplitude_m"]), float(rows[-1]["amplitude_m"])] == pytest.approx([1e-6, 1e-5])
    stuck = float(linear_modes(paper_rig()).stuck_hz[0])
    np.testing.assert_allclose([float(row["frequency_hz"]) for row in rows], stuck, rtol=1e-5)  # drawn in a little
    # stuck all along: force per amplitude and damping do not change, and only a free motion decays
    ratios = {round(float(row["force_n"]) / float(row["amplitude_m"]), 1) for row in rows}
    assert len(ratios) == 1
    assert all((row["decay_rate_1_s"] != "") == (row["backbone"] == "nonlinear-mode") for row in rows)
    known = json.loads(out.with_suffix(".json").read_text(encoding="utf-8"))
    assert known["stuck_hz"] == pytest.approx(stuck)
    assert [b["complete"] for b in known["backbones"]] == [True, True]
    assert all(
        abs(hz) < 1e-6 for b in known["backbones"] for hz, _ in [b["change_of_frequency_and_damping"]["samples"]]
    )


def test_what_is_not_found_with_a_finer_discretisation_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    lost = (math.nan, math.nan)
    change = NumericalChange(1e-6, (0.001, -0.002), lost, lost)
    monkeypatch.setattr("hbm.modes.accuracy.numerical_change", lambda _: change)
    said = "frequency and damping change with more harmonics by +0.10% and -0.20%; the same motion was not found with "
    assert f"{said}more samples, more modes" in run(PAPER, *QUICK).stdout
    change = NumericalChange(1e-6, (0.001, -0.002), lost, None)
    assert f"{said}more samples; modes not estimated, all are kept" in run(PAPER, *QUICK).stdout


def test_the_range_of_a_backbone_that_turns_back_is_printed(tmp_path: Path) -> None:
    """Where its modes meet it folds, and all points are spent on the way back to small amplitudes."""
    (tmp_path / "rig.toml").write_text(MEETING)
    out = tmp_path / "modes.csv"
    asked = ["--from", "1e-5", "--to", "1e-3", "--harmonics", "7", "--max-points", "60", "--out", str(out)]
    result = run(str(tmp_path / "rig.toml"), *asked)
    with out.open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["backbone"] == "nonlinear-mode"]
    mm, hz = (np.array([float(row[name]) for row in rows]) for name in ("amplitude_m", "frequency_hz"))
    assert mm[-1] < 0.9 * mm.max()
    printed = next(line for line in result.stdout.splitlines() if line.strip().startswith("nonlinear-mode"))
    assert f"0.01 to {1e3 * mm.max():.3g}" in printed
    assert f"{hz.min():.3f} to {hz.max():.3f}" in printed
    assert f"backbone: nonlinear mode: partial, up to {mm.max():.3g} m; stopped at" in result.stderr


MEETING = """
name = "two modes that meet"
[modal]
frequencies_hz = [80.0, 262.0]
ports = { tip = [0.8, 0.6] }
[damping]
modal_ratios = [0.002]
[excitation]
at = "tip"
amplitude = 1.0
[[joints]]
name = "spring"
law = "cubic-spring"
cubic = 1e12
at = "tip"
[[channels]]
name = "acc"
quantity = "acceleration"
at = "tip"
"""


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--mode", "6"], "backbone: --mode = 6; must be from 1 to 5"),
        (["--mode", "first"], 'backbone: --mode = "first"; must be a whole number from 1 to 1000'),
        (["--harmonics", "0"], "backbone: --harmonics = 0; must be a whole number from 1 to 200"),
        (["--from", "1e-5"], "backbone: --from without --to; must have both or neither"),
        (["--from", "1e-4", "--to", "1e-5"], "backbone: --to = 1e-5; must be more than --from = 1e-4"),
        (["--from", "-1", "--to", "1"], "backbone: --from = -1; must be a number > 0 [m]"),
        (["--level", "2"], "backbone: --level without --plot; must have both"),
        (["--out", "modes.txt"], 'backbone: --out = "modes.txt"; must end in .csv'),
    ],
)
def test_refusals(options: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    refused = run(PAPER, *options)
    assert (refused.exit_code, refused.stderr.strip()) == (2, message)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("first_hz", "mode", "message"),
    [
        (0.0, "1", "backbone: --mode = 1 is a rigid motion; must be from 2 to 2"),
        (10.0, "2", "backbone: --mode = 2 (14 Hz) does not move the drive, by whose amplitude it is followed"),
    ],
)
def test_a_mode_that_cannot_be_followed_is_refused(first_hz: float, mode: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(f"""
name = "symmetric"
modal = {{ frequencies_hz = [{first_hz}, 14.0], ports = {{ middle = [1.0, 1e-12], end = [0.5, 1.0] }} }}
damping = {{ modal_ratios = [0.01] }}
excitation = {{ amplitude = 1.0, at = "middle" }}
joints = [{{ name = "spring", law = "cubic-spring", cubic = 1e8, at = "end" }}]
channels = [{{ name = "force", quantity = "force" }}]
""")
    refused = run(str(tmp_path / "rig.toml"), "--mode", mode)
    assert (refused.exit_code, refused.stderr.startswith(message)) == (2, True)


JOINTS = """
name = "two sliders"
modal = { frequencies_hz = [40.0, 90.0], ports = { drive = [0.7, 0.5], one = [0.4, -0.6], two = [0.3, 0.8] } }
damping = { modal_ratios = [0.01] }
excitation = { amplitude = 1.0, at = "drive" }
[[joints]]
name = "one"
law = "coulomb-penalty"
mu = 0.4
critical_slip = 1e-5
normal_load = 2.0
at = "one"
[[joints]]
name = "turn"
law = "cubic-spring"
cubic = 1e9
at = "two"
"""


def test_rig_with_joints(tmp_path: Path) -> None:
    rig, out = tmp_path / "joints.toml", tmp_path / "modes.csv"
    rig.write_text(JOINTS)
    result = run(str(rig), "--from", "1e-6", "--to", "1e-4", "--harmonics", "3", "--out", str(out))
    assert result.exit_code == 0, result.output
    with out.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {"one.motion_m", "one.force_n", "turn.motion_m", "turn.force_n"} < set(rows[0])
    assert max(float(row["one.force_n"]) for row in rows) == pytest.approx(0.8, rel=1e-6)  # mu P
    known = json.loads(out.with_suffix(".json").read_text(encoding="utf-8"))
    assert known["law"] == "coulomb-penalty, cubic-spring"
    assert float(rows[0]["frequency_hz"]) == pytest.approx(known["stuck_hz"], rel=1e-5)


def test_responses_span_the_frequencies_of_the_mode(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of the second mode, not of the first resonance."""
    spans = []

    def traced(rig: AnyRig, hz: tuple[float, float], **options: Any) -> ResponseCurve:
        spans.append(hz)
        return trace_frequency(rig, hz, **options)

    monkeypatch.setattr("hbm.response.trace.trace_frequency", traced)
    rig, out = tmp_path / "joints.toml", tmp_path / "modes.csv"
    rig.write_text(JOINTS)
    options = ["--mode", "2", "--from", "1e-6", "--to", "1e-4", "--harmonics", "3", "--level", "1", "--out", str(out)]
    result = run(str(rig), *options, "--plot", str(tmp_path / "modes.png"))
    assert result.exit_code == 0, result.output
    with out.open(encoding="utf-8") as file:
        hz = [float(row["frequency_hz"]) for row in csv.DictReader(file)]
    ((low, high),) = spans
    assert 0.7 * min(hz) <= low <= 0.95 * min(hz) and 1.05 * max(hz) <= high <= 1.3 * max(hz)
