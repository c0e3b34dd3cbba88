"""The cause that docs/howto/own_cause.md shows: as printed, and found in what another program simulated."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from hbm import diagnose, synthesize
from hbm.cli import app
from hbm.files.diagnosissummary import _checks
from hbm.rigfiles.causes import causes_in_file
from hbm.rigfiles.load import load_rig
from models import Iwan
from models.bodies import MatrixBody
from models.causes import CAUSES
from models.friction import parameters
from models.jointed import JointedRig
from models.joints import Friction, Joint, PolynomialSpring
from models.parts import Channel, Damping, Excitation
from tests.truth import (
    Coulomb,
    PointForce,
    Settings,
    measure,
    scattered,
    simulate_records,
    table_1,
    write_rig,
    write_spectra,
)

ROOT = Path(__file__).parents[1]
PAGE, CATALOGUE = ROOT / "docs" / "howto" / "own_cause.md", ROOT / "docs" / "reference" / "causes.md"
FILE = ROOT / "examples" / "own_cause.py"
STIFFNESS, POSITION = 2e10, 0.2
RECORDS = ((3.0, 46.0), (6.5, 46.0), (6.5, 50.0), (6.5, 58.0))
QUICK = Settings(ramp=6, hold=2, coarse=64, tolerance=1e-6, iterations=8, retries=1, again=8)


def test_the_page_shows_the_file_verbatim() -> None:
    shown = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert FILE.read_text(encoding="utf-8") in shown


def test_the_page_lists_the_catalogue_in_its_own_words() -> None:
    rows = re.findall(r"^\| `(\S+?)` \| [^|]* \| (.*) \| (.*) \| (.*) \|$", CATALOGUE.read_text(encoding="utf-8"), re.M)
    words = [(c.name, c.meaning, c.looks_like, c.confused_with) for c in CAUSES.values()]
    assert [(name.removesuffix(":<key>"), *row) for name, *row in rows] == words


def test_the_file_holds_one_cause() -> None:
    assert [cause.name for cause in causes_in_file(FILE)] == ["magnet"]


def test_a_cause_that_names_no_check_gets_one() -> None:
    (kind,) = causes_in_file(FILE)
    silent = type("Silent", (kind,), {"name": "silent", "check": ""})
    told = list(_checks([kind(), silent()]))
    assert told[0] == "To confirm magnet: take the magnet away and repeat the records missed most."
    assert told[1].startswith("To confirm silent: change it on the structure by a known amount, or take it away")


def frame(*joints: Joint) -> JointedRig:
    """Three masses in a row that a force drives at the end."""
    stiffness = 1e5 * np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    channels = tuple(Channel(f"a{i}", "acceleration", at=str(i)) for i in (1, 2, 3))
    body = MatrixBody(np.eye(3), stiffness, dofs=("1", "2", "3"), modes=3)
    return JointedRig("frame", body, Damping(modal_ratios=(0.01,)), joints, Excitation(4.0, at="3"), channels)


@pytest.fixture
def cable(tmp_path: Path) -> str:
    """The cause of the page for rigs with joints."""
    (shown,) = re.findall(r"```python\n(from dataclasses.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    (tmp_path / "cable.py").write_text(shown, encoding="utf-8")
    return f"{tmp_path / 'cable.py'}:Cable"


def test_the_cause_of_the_page_for_rigs_with_joints_is_found(cable: str) -> None:
    assert [cause.name for cause in causes_in_file(Path(cable.removesuffix(":Cable")))] == ["cable"]
    true = 2e12
    built = frame(Joint("cable", PolynomialSpring(quintic=true), at=("2",)))
    spectra = synthesize(built, [4.0, 12.0], [21.0, 21.8, 22.4, 23.2], harmonics=5, seed=1).spectra
    found = diagnose(frame(), spectra, causes=[cable], held_out=[2])
    assert (found.verdict, found.cause) == ("cause-found", "cable")
    value = found.parameters["quintic"]
    assert abs(value.value - true) < 3 * value.std < 0.1 * true


def test_a_joint_of_ones_own_is_fitted_where_its_small_effect_promises_nothing(cable: str) -> None:
    bolt = Joint("bolt", Friction(Iwan(mu=0.4, stiffness=5e3), normal_load=10.0), at=("3",))
    rigs = [frame(bolt), frame(bolt, Joint("cable", PolynomialSpring(quintic=1e13), at=("2",)))]
    light = Damping(modal_ratios=(0.002,))
    nominal, built = (replace(rig, channels=rig.channels[2:], damping=light) for rig in rigs)
    spectra = synthesize(built, [1.0, 8.0], [22.0, 23.0, 24.0, 25.0], harmonics=9, seed=1).spectra
    found = diagnose(nominal, spectra, causes=[cable])
    assert (found.verdict, found.cause) == ("cause-found", "cable")


def test_a_cause_that_was_asked_for_and_not_fitted_is_told_why(cable: str) -> None:
    spectra = synthesize(frame(), [4.0], [21.0, 22.0, 23.0, 24.0], harmonics=3, seed=1).spectra
    found = diagnose(frame(), spectra, causes=[cable], held_out=[2])
    assert (found.verdict, found.ranking) == ("consistent", ())
    assert found.evidence[-1] == f"{cable} is in no ranking: the rig file explains the records without it."


def magnet(y: Any, _rate: Any, _phase: float) -> Any:
    return -STIFFNESS * y**3


@pytest.mark.slow
def test_a_magnet_beside_finite_elements_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hbm.files.diagnosisfiles.diagnosis_plates", lambda found: [])
    monkeypatch.setattr("hbm.diagnosis.curves.traced_responses", lambda *_: ())
    rig, rng = table_1(Coulomb(mu=0.52, critical_slip=4.15e-6), sensors=(0.15, 0.3, 0.5)), np.random.default_rng(4)
    built = replace(rig, effects=(PointForce(POSITION, magnet),))
    spectra = measure(simulate_records(built, scattered(RECORDS, rng), 512, QUICK), snr_db=50, rng=rng, harmonics=3)
    write_rig(tmp_path / "rig.toml", rig, amplitude=6.5)
    write_spectra(tmp_path / "spectra.csv", spectra, mean=False)
    args = [str(tmp_path / "rig.toml"), str(tmp_path / "spectra.csv"), "--cause", f"{FILE}:Magnet", "--hold-out", "2"]
    result = CliRunner().invoke(app, ["diagnose", *args, "--out", str(tmp_path / "out")], prog_name="hbm")
    assert (result.exit_code, result.stderr) == (0, "")
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    assert (found["verdict"], found["cause"]) == ("cause-found", "magnet")
    assert found["gain"]["held_out_chi2_ratio"] < 0.5
    for name, true in (("stiffness", STIFFNESS), ("position", POSITION)):
        p = found["parameters"][name]
        assert abs(p["value"] - true) < 3 * p["std"] < 0.2 * true
    (element,) = load_rig(tmp_path / "out" / "extended.toml", allow_code=True).elements
    assert parameters(element) == {name: found["parameters"][name]["value"] for name in ("stiffness", "position")}
