"""The command ``hbm diagnose``: what it prints and writes, and the one line with which it refuses or fails."""

import csv
import json
import math
import re
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import hbm.diagnosis.diagnose
import hbm.diagnosis.discrepancy
import hbm.figures.diagnosis
import hbm.outputerror.numerics
from hbm.cli import app
from hbm.diagnosis.diagnose import diagnose as search
from hbm.diagnosis.remainder import Remainder, percent
from hbm.diagnosis.verdict import Diagnosis
from hbm.files.diagnosisfiles import FILES
from hbm.files.diagnosispage import ranking_table
from hbm.files.diagnosissummary import NEXT, _said, first_screen, verdict_line
from hbm.outputerror.nominal import nominal_scalars
from hbm.response.trace import steady_state
from hbm.rigfiles.causes import causes_in_file
from hbm.rigfiles.load import load_rig
from models import Attachments, PointMass, Rig
from models.causes import CAUSES
from models.causes.parameter import WrongParameter
from models.causes.records import ForceDistortion

PAPER = Path(__file__).parents[1] / "examples" / "paper_beam.toml"
STATES = (*((level, hz) for hz in (46.0, 57.0, 64.0) for level in (3.0, 6.5)), (6.5, 150.0))
H, MEASURED, SAMPLES, NOISE = 13, 7, 128, 0.03
MASS = PointMass(mass=0.004, position=0.33)
QUESTIONS = ("What is wrong", "Why", "Added to the model", "Gain", "What remains", "What to measure next")
Row = list[Any]
HEADING = ["record", "level", "frequency_hz", "channel", "harmonic", "cos", "sin", "std"]


def run(*args: str) -> Result:
    return CliRunner().invoke(app, list(args), prog_name="hbm")


@pytest.fixture(autouse=True)
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """The discretisation that made the data."""
    monkeypatch.setattr(hbm.outputerror.numerics, "LADDER", ((H, SAMPLES, 0), (H, SAMPLES, 0)))


@pytest.fixture
def plain(monkeypatch: pytest.MonkeyPatch) -> None:
    """No figures and curves, which are drawn and traced once, and no processes: they would take longer to start."""
    monkeypatch.setattr("hbm.files.diagnosisfiles.diagnosis_plates", lambda found: [])
    monkeypatch.setattr("hbm.diagnosis.curves.traced_responses", lambda *_: ())
    monkeypatch.setattr("hbm.parallel.all_cores", lambda prepare: nullcontext())


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Rig file, and spectra of the rig as it is and with a mass on it."""
    path = tmp_path_factory.mktemp("campaign")
    text = PAPER.read_text(encoding="utf-8").replace("mass_proportional = 0.06", "mass_proportional = 0.6")
    (path / "rig.toml").write_text(text.replace("modes = 5", "modes = 7"), encoding="utf-8")
    rig = load_rig(path / "rig.toml")
    write(path / "null.csv", rows_of(rig))
    write(path / "mass.csv", rows_of(replace(rig, attachments=Attachments(masses=(MASS,)))))
    return path


def rows_of(rig: Rig) -> list[Row]:
    rng = np.random.default_rng(3)
    rows: list[Row] = []
    for record, (level, hz) in enumerate(STATES, start=1):
        solution = steady_state(rig, hz, level=level, harmonics=H, samples=SAMPLES)
        for c in rig.channels:
            noise = 1e-3 if c.quantity == "force" else NOISE
            a = solution[c.name].coefficients
            for k in range(1, 2 if c.quantity == "force" else MEASURED + 1):
                pair = np.array([a[k], a[H + k]]) + noise * rng.standard_normal(2)
                rows.append([record, level, hz, c.name, k, *pair.tolist(), noise])
    return rows


def write(path: Path, rows: list[Row], heading: list[str] = HEADING) -> str:
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([heading, *rows])
    return str(path)


def read(path: Path) -> list[Row]:
    with path.open(newline="") as file:
        return list(csv.reader(file))[1:]


def changed(folder: Path, out: Path, change: Callable[[list[Row]], list[Row]], name: str = "null.csv") -> str:
    """A spectra file with rows changed."""
    return write(out / "spectra.csv", change(read(folder / name)))


def diagnosed(path: Path) -> dict[str, Any]:
    table: dict[str, Any] = json.loads((path / "diagnosis.json").read_text(encoding="utf-8"))
    return table


# ---- what it finds and writes


FOUND: list[Diagnosis] = []
"""What the search found of the mass."""


@pytest.fixture(scope="module")
def mass(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Result]:
    def remembered(*args: Any, **options: Any) -> Diagnosis:
        FOUND.append(search(*args, **options))
        return FOUND[-1]

    out = tmp_path_factory.mktemp("found") / "mass"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hbm.outputerror.numerics, "LADDER", ((H, SAMPLES, 0), (H, SAMPLES, 0)))
        patch.setattr(hbm.figures.diagnosis, "MOST_CHANNELS", 1)  # drawing all takes seconds
        patch.setattr(hbm.diagnosis.diagnose, "diagnose", remembered)
        args = ("--cause", "added-mass", "--hold-out", "3", "6", "--out", str(out))
        return out, run("diagnose", str(folder / "rig.toml"), str(folder / "mass.csv"), *args)


def test_cause_is_named_and_everything_is_written(mass: tuple[Path, Result]) -> None:
    out, result = mass
    assert (result.exit_code, result.stderr) == (0, "")
    lines = result.stdout.splitlines()
    assert re.fullmatch(r"Cause found: added-mass, .* \(confidence (0.9\d|1.00)\)\.", lines[0])
    there = {name for name in FILES if not name.startswith(("figures/lines.", "figures/backbone."))}  # of other records
    assert {str(out / name) for name in there} == {line.removeprefix("wrote ") for line in lines if "wrote " in line}
    assert all((out / name).exists() for name in there)
    rows = {line.split()[0]: line.split()[1:] for line in lines if line.split()[:1] in (["nominal"], ["extended"])}
    assert float(rows["nominal"][2]) > 30 * float(rows["extended"][2])


def test_six_answers_stand_before_all_tables_on_twelve_lines(mass: tuple[Path, Result]) -> None:
    lines = mass[1].stdout.splitlines()
    first = lines[1 : lines.index(next(line for line in lines if line.startswith("models")))]
    assert len(first) <= 12
    assert [line.split("  ")[0] for line in first if line[0] != " "] == list(QUESTIONS)
    said = " ".join(" ".join(line.split()) for line in first)
    table = diagnosed(mass[0])
    before, after = (percent(table["errors"][model]["held_out"]["nrmse"]) for model in ("nominal", "extended"))
    assert f"Error on the 2 records held out: {before} with the rig file as it is" in said
    assert re.search(rf"{after} with added-mass; [\d.]+ % by noise alone", said)
    assert "added-mass (mass 0.00" in said and "± 0.00" in said and "a lumped mass sits on the beam" in said
    assert "extended.toml is the rig file with added-mass; nothing else is changed." in said
    assert table["remainder"]["sentence"] in said
    assert "To confirm added-mass: weigh what is mounted there" in said


def test_diagnosis_file_is_the_contract(mass: tuple[Path, Result]) -> None:
    table = diagnosed(mass[0])
    assert list(table) == [
        *("schema", "verdict", "cause", "parameters", "confidence", "not_separable", "separate_by"),
        *("remainder", "errors", "gain", "held_out_records", "ranking", "evidence"),
    ]
    assert list(table["remainder"]) == [
        *("explained", "size", "noise_variances", "structured", "places", "harmonics", "sentence"),
    ]
    assert min(table["remainder"]["explained"].values()) > 0.99 and not table["remainder"]["structured"]
    assert (table["verdict"], table["cause"], table["held_out_records"]) == ("cause-found", "added-mass", [3, 6])
    found = table["parameters"]["mass"]
    assert set(found) == {"value", "std", "unit"} and found["unit"] == "kg"
    assert abs(found["value"] - MASS.mass) < 4 * found["std"]
    assert set(table["errors"]) == {"nominal", "calibrated", "extended"}
    for parts in table["errors"].values():
        assert set(parts) == {"train", "held_out"}
        assert set(parts["held_out"]) == {"nrmse", "chi2_reduced"}
    assert table["gain"]["held_out_chi2_ratio"] < 0.5
    assert any(line.startswith("The missing ") for line in table["evidence"])


def test_extended_rig_is_the_nominal_one_with_the_mass(mass: tuple[Path, Result], folder: Path) -> None:
    extended = load_rig(mass[0] / "extended.toml")
    (found,) = extended.attachments.masses
    assert found.position == pytest.approx(MASS.position, abs=0.01)
    assert found.mass == diagnosed(mass[0])["parameters"]["mass"]["value"]
    before, after = nominal_scalars(load_rig(folder / "rig.toml")), nominal_scalars(extended)
    moved = {key for key in before if after[key] != before[key]}
    assert not moved  # the rig file is right otherwise
    assert all(abs(np.log(after[key] / before[key])) < 0.2 for key in moved)


def test_page_needs_nothing_but_itself(mass: tuple[Path, Result]) -> None:
    text = (mass[0] / "report.html").read_text(encoding="utf-8")
    without_images = re.sub(r"data:image/[a-z+]+;base64,[A-Za-z0-9+/=]+", "", text)
    assert not re.search(r"(?:src|href)=\"(?!figures/|#|[a-z_]+\.csv|extended\.toml|\")", without_images)
    assert "http" not in without_images and "<script src" not in without_images
    for heading in (
        "What the extended model gains",
        "Measured and simulated",
        "What is missing, and where",
        "Evidence",
    ):
        assert heading in text
    assert text.count("data:image/") == 7


def test_first_screen_of_the_page_says_what_is_wrong_what_it_means_how_much_and_what_to_do(
    mass: tuple[Path, Result],
) -> None:
    text = (mass[0] / "report.html").read_text(encoding="utf-8")
    first, table = text[text.index("<h1>") : text.index("<nav")], diagnosed(mass[0])
    assert first.count("data:image/") == 1 and "figures/overview.csv" in first
    value, std = (table["parameters"]["mass"][key] for key in ("value", "std"))
    digits = 1 - math.floor(math.log10(std))  # two of what it is uncertain by
    errors = [
        f"{100 * table['errors'][model][part]['nrmse']:.{2 if table['errors'][model][part]['nrmse'] < 0.1 else 3}g}"
        for model in ("nominal", "calibrated", "extended")
        for part in ("train", "held_out")
    ]
    order = (
        "Cause found: added-mass",
        "This means: a lumped mass sits on the beam.",
        "The rig file misses",
        *(f">{value:.{digits}f} ± {std:.{digits}f} kg<", ">position<"),
        *(f">{error}<" for error in errors),
        "extended.toml is the rig file with added-mass",
        table["remainder"]["sentence"],
        "weigh what is mounted there",
        "data:image/",
    )
    place = 0
    for part in order:
        place = first.index(part, place)


def test_page_shows_a_record_and_has_all_others_to_choose(mass: tuple[Path, Result]) -> None:
    text = (mass[0] / "report.html").read_text(encoding="utf-8")
    assert re.findall(r"<h3>Record (\d): ", text) == [str(n) for n in range(1, 8)]
    shown = re.findall(r"<article>\s*<h3>Record (\d)", text)  # the only one that is not hidden, scripts or not
    missed = {n: 0.0 for n in map(str, range(1, 8))}
    with (mass[0] / "figures" / "misfit_map.csv").open() as file:
        for row in csv.DictReader(file):
            missed[row["record"]] += float(row["deviation"]) ** 2 * (row["model"] == "calibrated")
    assert shown == [max(missed, key=missed.__getitem__)]
    assert text.count("<article hidden>") == 6
    assert re.search(r'<p class="ask" hidden>', text)  # without scripts there is nothing to choose


def test_curves_go_through_what_was_simulated_of_the_records(mass: tuple[Path, Result]) -> None:
    """As far as chords of the curve, and the correction of the records, allow: some tenths of a per cent each."""
    with (mass[0] / "response_curves.csv").open() as file:
        curve = [row for row in csv.DictReader(file) if row["model"] == "extended" and row["channel"] == "a3"]
    with (mass[0] / "figures" / "responses.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["model"] == "extended" and row["channel"] == "a3"]
    compared = [row for row in rows if float(row["frequency_hz"]) < 100.0]
    assert len(compared) == 6  # of one frequency about the second mode there is no curve
    for row in compared:
        own = [point for point in curve if point["level"] == row["level"]]
        hz, h1 = (np.array([float(point[key]) for point in own]) for key in ("frequency_hz", "h1"))
        simulated = abs(complex(float(row["simulated_real"]), float(row["simulated_imag"])))
        order = np.argsort(hz)
        assert np.interp(float(row["frequency_hz"]), hz[order], h1[order]) == pytest.approx(simulated, rel=0.01)


def test_figures_say_what_their_files_say(mass: tuple[Path, Result]) -> None:
    with (mass[0] / "figures" / "responses.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["model"] == "extended"]
    assert {row["record"] for row in rows if row["held_out"] == "1"} == {"3", "6"}
    off = [
        abs(complex(float(r["measured_real"]), float(r["measured_imag"]))
            - complex(float(r["simulated_real"]), float(r["simulated_imag"]))) / float(r["std"])
        for r in rows
        if r["held_out"] == "0"
    ]  # fmt: skip
    assert len(off) == 5 * 6
    assert np.sqrt(np.mean(np.square(off)) / 2) < 1.5


def test_overview_shows_errors_before_and_after(mass: tuple[Path, Result]) -> None:
    with (mass[0] / "figures" / "overview.csv").open() as file:
        rows = list(csv.DictReader(file))
    error = {(row["model"], row["record"]): float(row["relative_error"]) for row in rows}
    noise = {row["record"]: float(row["relative_noise"]) for row in rows}
    assert all(error["extended", n] < 2.0 * noise[n] for n in noise)
    assert max(error["nominal", n] / noise[n] for n in noise) > 5.0
    assert {row["record"] for row in rows if row["held_out"] == "1"} == {"3", "6"}
    shown = [row for row in rows if row["model"] == "extended" and row["measured"]]
    assert shown and all(float(r["simulated"]) == pytest.approx(float(r["measured"]), abs=5 * NOISE) for r in shown)


def test_figures_show_the_simulations_that_the_errors_are_of(mass: tuple[Path, Result]) -> None:
    """Corrected for their discretisation, which here is by tens of standard deviations."""
    with (mass[0] / "figures" / "misfit_map.csv").open() as file:
        rows = list(csv.DictReader(file))
    for model, errors in diagnosed(mass[0])["errors"].items():
        for held, part in (("0", "train"), ("1", "held_out")):
            own = [row for row in rows if row["model"] == model and row["held_out"] == held]
            channel = np.array([row["channel"] for row in own])
            measured, simulated = (
                np.array([complex(float(row[f"{kind}_real"]), float(row[f"{kind}_imag"])) for row in own])
                for kind in ("measured", "simulated")
            )
            scale = np.array([np.sqrt(np.mean(np.abs(measured[channel == name]) ** 2)) for name in channel])
            nrmse = np.linalg.norm((measured - simulated) / scale) / np.linalg.norm(measured / scale)
            assert nrmse == pytest.approx(errors[part]["nrmse"], rel=1e-6)


def answers(**changes: Any) -> dict[str, str]:
    """The first screen of what the search found, had it found otherwise."""
    return first_screen(replace(FOUND[0], **changes), None, "harmonic 1 of a3 at 6.5 N", 0.012)


LEFT = Remainder({"train": 0.8, "held_out": 0.7}, 0.031, 12.0, True, ("most in records 46 to 64 Hz at 6.5 N (90%)",))
WITHOUT: dict[str, Any] = {"cause": None, "parameters": {}, "extended_fit": None}


@pytest.mark.usefixtures("mass")
def test_a_main_cause_says_what_it_leaves_and_how_to_go_on() -> None:
    changed = replace(FOUND[0], verdict="main-cause", remainder=LEFT)
    assert verdict_line(changed).startswith("Main cause: added-mass, ")
    assert verdict_line(changed).endswith("; the rest is unexplained.")
    for others, named in (
        (("drift",), "added-mass or drift,"),
        (("drift", "added-spring"), "added-mass or one of 2 others,"),
    ):
        tied = replace(changed, not_separable=others)
        assert named in verdict_line(tied)
        assert named.replace("added-mass", ")") in str(tied)
    said = answers(verdict="main-cause", remainder=LEFT)
    assert said["What remains"] == LEFT.sentence
    assert "run hbm diagnose on extended.toml" in said["What to measure next"]


@pytest.mark.usefixtures("mass")
def test_measured_harmonics_of_the_force_come_before_what_else_is_missing() -> None:
    """They are known, and no cause that is left to be found; a rig file that applies them says nothing."""
    found = FOUND[0]
    assert found.campaign is not None and found.nominal is not None
    records = [
        replace(r, distortion=np.ones_like(r.distortion), distortion_std=np.full_like(r.distortion_std, 0.1))
        for r in found.campaign.data.records
    ]
    distorted = replace(found.campaign, data=replace(found.campaign.data, records=tuple(records)))
    first = 'First put [[extensions]] with cause = "force-distortion" into the rig file and diagnose again'
    for changes in ({"verdict": "main-cause"}, {"verdict": "unexplained", "extended": None, **WITHOUT}):
        assert first not in answers(remainder=LEFT, **changes)[NEXT]
        said = answers(remainder=LEFT, campaign=distorted, **changes)[NEXT]
        assert first in said and "extended.toml" not in said
    applied = ForceDistortion().extend(found.nominal.model.nominal, {})
    assert first not in answers(verdict="main-cause", remainder=LEFT, campaign=distorted, extended=applied)[NEXT]
    assert first not in answers(verdict="cause-found", remainder=LEFT, campaign=distorted)[NEXT]


@pytest.mark.usefixtures("mass")
def test_records_that_were_warned_of_are_measured_again_first() -> None:
    left = replace(FOUND[0], verdict="unexplained", remainder=LEFT, **WITHOUT)
    said = first_screen(left, None, "harmonic 1 of a3", 0.012, ("5", "7", "8", "9", "16"))["What to measure next"]
    assert said.startswith("First measure again what is warned of below: records 5, 7, 8, 9 and 1 more. Add records")
    assert "again" not in first_screen(left, None, "harmonic 1 of a3", 0.012)["What to measure next"]


@pytest.mark.usefixtures("mass")
def test_ties_are_told_apart_before_anything_is_confirmed() -> None:
    said = answers(not_separable=("added-spring",), separate_by="three records at 9 N")
    assert said["Why"].endswith("These records cannot tell it from added-spring.")
    assert said["What to measure next"].startswith(
        "To tell added-mass from added-spring: three records at 9 N. To confirm added-mass: weigh"
    )


@pytest.mark.usefixtures("mass")
def test_what_does_the_same_as_the_second_of_two_causes_is_told_beside_it() -> None:
    found = replace(FOUND[0], seconds=("parameter:beam.length (value = 0.81)",))
    assert found.extended_fit is not None
    model = found.extended_fit.model.extended_by(WrongParameter("beam.density"))
    pair = replace(found.extended_fit, model=model, x=np.append(found.extended_fit.x, model.start[-1]))
    first, second = (_said(found, pair, i) for i in (0, 1))
    alike = ", which these records cannot tell from parameter:beam.length (value = 0.81): "
    assert second.startswith("parameter:beam.density (value ") and alike in second and alike not in first
    assert alike not in _said(FOUND[0], pair, 1)


@pytest.mark.usefixtures("mass")
def test_a_lead_in_bic_does_not_tell_apart_what_chi2_does_not() -> None:
    (best,) = FOUND[0].ranking
    near = replace(best, label="added-spring", name="added-spring", bic=best.bic + 1.086, chi2=best.chi2 + 1.086)
    far = replace(near, label="impact-stop", name="impact-stop", bic=best.bic + 40.0, chi2=best.chi2 + 40.0)
    tied = replace(FOUND[0], ranking=(best, near, far), not_separable=("added-spring",))
    headings, rows = ranking_table(tied)
    said = {row[0]: (row[1], row[headings.index("verdict")]) for row in rows}
    assert said["added-mass"] == ("0", "named")
    assert said["added-spring"] == ("1.086", "cannot be told apart")
    assert said["impact-stop"] == ("40", "less likely")
    assert {said[name][1] for name in ("rig file as it is", "rig file calibrated")} == {"no cause"}


@pytest.mark.usefixtures("mass")
def test_a_model_without_steady_states_on_records_held_out_has_no_error_there() -> None:
    nominal = {"nominal": {"train": FOUND[0].errors["nominal"]["train"]}}
    assert answers(errors={**FOUND[0].errors, **nominal})["Gain"].split(": ")[1].endswith("by noise alone.")
    assert "as it is" not in answers(errors={**FOUND[0].errors, **nominal})["Gain"]


@pytest.mark.usefixtures("mass")
def test_what_does_not_repeat_is_no_noise_alone_and_is_not_asked_for_again() -> None:
    counted, left = "noise and what does not repeat", replace(FOUND[0].remainder, structured=True)
    assert answers(noise=counted)["Gain"].endswith(f" by {counted} alone.")
    assert "What does not repeat is stated with" in answers(remainder=left)["What to measure next"]
    assert "beyond what counts already" in answers(remainder=left, noise=counted)["What to measure next"]


@pytest.mark.usefixtures("mass")
def test_unexplained_says_where_to_look() -> None:
    errors = {name: FOUND[0].errors[name] for name in ("nominal", "calibrated")}
    said = answers(verdict="unexplained", remainder=LEFT, errors=errors, **WITHOUT)
    assert said["Why"] == "No cause that was tried takes most of the misfit."
    assert said["Added to the model"] == (
        "Nothing. The candidates that came nearest are in candidates/; do not believe them."
    )
    assert said["Gain"].startswith("None. Error on the 2 records held out: ")
    assert said["What to measure next"].startswith("Add records where most remains: 46 to 64 Hz at 6.5 N (90%). More")


@pytest.mark.usefixtures("mass")
@pytest.mark.parametrize(("structured", "told"), [(True, "Mount the structure anew"), (False, "Nothing for these")])
def test_consistent_says_whether_it_may_be_the_structure(structured: bool, told: str) -> None:
    said = answers(verdict="consistent", remainder=replace(LEFT, structured=structured), **WITHOUT)
    assert said["What to measure next"].startswith(told)
    by_numbers = "Numbers of the rig file, within their tolerances. The rig file misses the records fitted by 5.9 %"
    assert said["What is wrong"].startswith("Little." if structured else by_numbers)


def test_every_cause_says_how_to_check_it_and_the_page_says_the_same() -> None:
    page = (Path(__file__).parents[1] / "docs" / "reference" / "causes.md").read_text(encoding="utf-8")
    told = dict(re.findall(r"^\| `([a-z-]+)(?::<key>)?` \| ([^|]*) \|$", page, re.M))
    assert told == {name: cause.check for name, cause in CAUSES.items()}
    assert all(told.values())


def test_nothing_wrong_is_consistent_and_has_no_extended_rig(folder: Path, tmp_path: Path, plain: None) -> None:
    (tmp_path / "extended.toml").write_text("of an earlier run")
    (tmp_path / "candidates").mkdir()
    (tmp_path / "candidates" / "1-added-spring.toml").write_text("of an earlier run")
    (tmp_path / "notes.txt").write_text("mine")
    rig, spectra = str(folder / "rig.toml"), str(folder / "null.csv")
    result = run("diagnose", rig, spectra, "--cause", "added-mass", "--out", str(tmp_path))
    assert result.exit_code == 0
    table = diagnosed(tmp_path)
    assert (table["verdict"], table["cause"], table["parameters"]) == ("consistent", None, {})
    assert table["errors"]["extended"] == {}
    assert not (tmp_path / "extended.toml").exists()
    assert not (tmp_path / "candidates").exists()
    assert (tmp_path / "notes.txt").read_text() == "mine"


@pytest.fixture(scope="module")
def unexplained(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Result]:
    """A mass, where only gains and drag are looked for; into a folder with candidates of an earlier run."""
    out = tmp_path_factory.mktemp("unexplained")
    (out / "candidates").mkdir()
    (out / "candidates" / "3-of-before.toml").write_text("old")
    (out / "candidates" / "notes.txt").write_text("mine")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hbm.outputerror.numerics, "LADDER", ((H, SAMPLES, 0), (H, SAMPLES, 0)))
        patch.setattr("hbm.files.diagnosisfiles.diagnosis_plates", lambda found: [])
        patch.setattr("hbm.parallel.all_cores", lambda prepare: nullcontext())
        causes = ("--cause", "sensor-gain", "--cause", "quadratic-drag", "--hold-out", "3", "6")
        return out, run("diagnose", str(folder / "rig.toml"), str(folder / "mass.csv"), *causes, "--out", str(out))


def test_unexplained_writes_the_nearest_candidates_and_says_not_to_believe_them(
    unexplained: tuple[Path, Result], folder: Path
) -> None:
    out, result = unexplained
    table = diagnosed(out)
    assert (result.exit_code, table["verdict"], table["cause"]) == (0, "unexplained", None)
    files = sorted(path.name for path in (out / "candidates").glob("*.toml"))
    best = table["ranking"][: len(files)]
    assert 0 < len(files) <= 3
    assert all(name.split("-", 1)[1].startswith(entry["cause"]) for name, entry in zip(files, best, strict=True))
    assert (out / "candidates" / "notes.txt").read_text() == "mine"
    assert not (out / "extended.toml").exists()
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "Candidates, none of them believed" in page
    nominal = (folder / "rig.toml").read_text(encoding="utf-8")
    for name, entry in zip(files, best, strict=True):
        text = (out / "candidates" / name).read_text(encoding="utf-8")
        assert text.startswith("# NOT BELIEVED. The verdict of hbm diagnose is unexplained; ")
        assert nominal.rstrip() in text
        rig = load_rig(out / "candidates" / name)
        stated = entry["parameters"]
        assert all(f"= {json.dumps(p['value'])}" in text for p in stated.values())
        if entry["cause"] == "sensor-gain":
            gains = {c.name: c.gain for c in rig.channels} | {"force": rig.excitation.channel_gain}
            assert gains[stated["channel"]["value"]] == stated["gain"]["value"]
        assert f'href="candidates/{name}"' in page and f"wrote {out / 'candidates' / name}" in result.stdout


def test_a_folder_that_could_not_hold_candidates_is_refused_at_once(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "candidates").write_text("mine")
    result = run("diagnose", str(folder / "rig.toml"), str(folder / "null.csv"), "--out", str(tmp_path))
    assert result.exit_code == 2
    assert result.stderr.endswith(f"{str(tmp_path / 'candidates')!r} is a file, must be a directory\n")


def test_cause_of_ones_own_is_tried_and_named_in_the_extended_rig(folder: Path, tmp_path: Path, plain: None) -> None:
    own = tmp_path / "own.py"
    own.write_text(
        "from dataclasses import dataclass\nfrom typing import ClassVar\n"
        "from models.causes import structure\n\n"
        "@dataclass(frozen=True)\nclass Magnet:  # no Cause of ours\n"
        "    name: ClassVar[str] = 'magnet'\n    meaning: ClassVar[str] = 'a magnet'\n"
        "    looks_like: ClassVar[str] = 'a mass'\n    confused_with: ClassVar[str] = 'added-mass'\n"
        "    label = property(lambda self: self.name)\n\n"
        "    @classmethod\n    def candidates(cls, rig):\n        yield cls()\n\n"
        "    def unknowns(self, rig):\n        return structure.AddedMass().unknowns(rig)\n\n"
        "    def extend(self, rig, values):\n        return structure.AddedMass().extend(rig, values)\n"
    )
    assert [cause.name for cause in causes_in_file(own)] == ["magnet"]  # for --causes-file
    spectra = changed(folder, tmp_path, lambda rows: [row for row in rows if row[1] == "6.5"], "mass.csv")
    args = ("--cause", f"{own}:Magnet", "--out", str(tmp_path / "out"))
    result = run("diagnose", str(folder / "rig.toml"), spectra, *args)
    assert result.exit_code == 0
    assert diagnosed(tmp_path / "out")["cause"] == "magnet"
    assert 'cause = "own.py:Magnet"' in (tmp_path / "out" / "extended.toml").read_text()
    assert (tmp_path / "out" / "own.py").read_bytes() == own.read_bytes()  # beside it, where it may be run with leave
    load_rig(tmp_path / "out" / "extended.toml", allow_code=True)


@pytest.mark.usefixtures("mass", "plain")
def test_what_is_left_of_a_failure_is_written_and_marked(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: Any) -> None:
        raise ArithmeticError("at a fold")

    monkeypatch.setattr(hbm.diagnosis.diagnose, "diagnose", lambda *_, **__: FOUND[0])
    monkeypatch.setattr(hbm.diagnosis.discrepancy, "discrepancy", fails)
    rig, spectra = str(folder / "rig.toml"), str(folder / "mass.csv")
    result = run("diagnose", rig, spectra, "--cause", "added-mass", "--out", str(tmp_path))
    assert result.exit_code == 1
    line = "diagnose: the missing force could not be worked out, the rest is written: at a fold"
    assert result.stderr == line + "\n"
    assert diagnosed(tmp_path)["evidence"][0] == f"Partial result. {line}."
    assert "Partial result" in (tmp_path / "report.html").read_text(encoding="utf-8")


# ---- what it says of its input


def test_too_small_standard_deviations_are_said(folder: Path, tmp_path: Path, plain: None) -> None:
    def smaller(rows: list[Row]) -> list[Row]:
        return [[*row[:-1], float(row[-1]) / 3.0] for row in rows if row[0] in "1246"]

    spectra, out = changed(folder, tmp_path, smaller), tmp_path / "out"
    result = run("diagnose", str(folder / "rig.toml"), spectra, "--cause", "viscous-contact", "--out", str(out))
    assert result.exit_code == 0
    (line,) = [line for line in result.stdout.splitlines() if line.startswith("warning: chi2 of every model")]
    k, factor = (float(part) for part in re.findall(r"\d+\.?\d*", line.replace("chi2", ""))[:2])
    assert k == pytest.approx(9.0, rel=0.15) and factor == pytest.approx(3.0, rel=0.08)
    assert line.removeprefix("warning: ") == diagnosed(out)["evidence"][0]


def test_what_a_structure_does_not_repeat_is_no_discrepancy(folder: Path, tmp_path: Path, plain: None) -> None:
    """A mass that moves the response by less than repeats differ by is not looked for, and why is said."""
    rig, spectra = str(folder / "rig.toml"), str(folder / "mass.csv")
    (tmp_path / "out").mkdir()
    result = run(
        "diagnose", rig, spectra, "--cause", "added-mass", "--repeatability", "60", "--out", str(tmp_path / "out")
    )
    assert result.exit_code == 0, result.output
    table = diagnosed(tmp_path / "out")
    assert (table["verdict"], table["cause"]) != ("cause-found", "added-mass")
    assert table["errors"]["nominal"]["train"]["chi2_reduced"] < 2.0
    assert "does not repeat" in table["evidence"][0] and "60 %" in table["evidence"][0]


def test_one_level_is_said(folder: Path, tmp_path: Path, plain: None) -> None:
    spectra = changed(folder, tmp_path, lambda rows: [row for row in rows if row[1] == "6.5"])
    args = ("--cause", "added-mass", "--out", str(tmp_path / "out"))
    result = run("diagnose", str(folder / "rig.toml"), spectra, *args)
    assert result.exit_code == 0
    assert "One level only" in result.stdout


def test_mislabelled_channels_are_said(folder: Path, tmp_path: Path, plain: None) -> None:
    def exchanged(rows: list[Row]) -> list[Row]:
        other = {"a2": "a5", "a5": "a2"}
        return [[*row[:3], other.get(row[3], row[3]), *row[4:]] for row in rows if row[0] in "24"]

    spectra = changed(folder, tmp_path, exchanged)
    args = ("--cause", "added-mass", "--out", str(tmp_path / "out"))
    result = run("diagnose", str(folder / "rig.toml"), spectra, *args)
    assert result.exit_code == 0, result.output
    said = [line for line in result.stdout.splitlines() if line.startswith("Sensors:")]
    assert any("a2" in line and "a5" in line and "exchanged" in line for line in said)


def few(rows: list[Row]) -> list[Row]:
    return [row for row in rows if row[0] == "1" and (row[3] in ("force", "a1", "a2")) and row[4] == "1"]


def blank(rows: list[Row]) -> list[Row]:
    return [[*row[:5], "nan", *row[6:]] if i == 3 else row for i, row in enumerate(rows)]


def nameless(rows: list[Row]) -> list[Row]:
    return [[*row[:3], "a9", *row[4:]] if row[3] == "a4" else row for row in rows]


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (few, "spectra.csv: 4 coefficients; must be more than the 7 numbers to fit"),
        (blank, "spectra.csv line 5: cos = nan; must be finite"),
        (nameless, 'channel "a9" is not in the rig; channels are force, a1, a2, a3, a4, a5, a6'),
        (
            lambda rows: [row for row in rows if row[3] == "force"],
            "holds no response channel; must hold at least one of a1, a2",
        ),
    ],
)
def test_spectra_that_will_not_do_are_refused(
    folder: Path, tmp_path: Path, plain: None, change: Callable[[list[Row]], list[Row]], line: str
) -> None:
    refused(run("diagnose", str(folder / "rig.toml"), changed(folder, tmp_path, change), *to(tmp_path)), line, tmp_path)


def test_spectra_without_standard_deviations_are_refused(folder: Path, tmp_path: Path) -> None:
    rows = [row[:-1] for row in read(folder / "null.csv")]
    spectra = write(tmp_path / "spectra.csv", rows, HEADING[:-1])
    refused(run("diagnose", str(folder / "rig.toml"), spectra, *to(tmp_path)), "std", tmp_path)


@pytest.mark.parametrize(
    ("args", "line"),
    [
        (("--cause", "added-mess"), 'diagnose: --cause = "added-mess"; must be one of'),
        (
            ("--cause", "parameter:beam.colour"),
            'diagnose: --cause = "parameter:beam.colour"; must be one of parameter:',
        ),
        (("--cause", "bristle-memory"), 'diagnose: --cause = "bristle-memory"; there is nothing in this rig'),
        (("--tolerance", "beam.length"), 'diagnose: --tolerance = "beam.length"; must be KEY=VALUE'),
        (
            ("--tolerance", "beam.colour=1"),
            "diagnose: tolerance of beam.colour; must be of a number of the rig file, not 0",
        ),
        (("--tolerance", "beam.length=-1"), "diagnose: --tolerance beam.length = -1; must be a number >= 0 [relative]"),
        (("--repeatability", "0"), "diagnose: --repeatability = 0; must be a number > 0 [%]"),
        (("--repeatability", "100"), "diagnose: --repeatability = 100; must be below 100 %"),
        (("--hold-out", "99"), "no record 99; records are 1, 2, 3"),
        (("--hold-out", "x"), "no record x; records are 1, 2, 3"),
        (("--causes-file", "no.py"), 'diagnose: --causes-file = "no.py"'),
    ],
)
def test_options_are_refused_in_one_line(folder: Path, tmp_path: Path, args: tuple[str, ...], line: str) -> None:
    result = run("diagnose", str(folder / "rig.toml"), str(folder / "null.csv"), *args, *to(tmp_path))
    refused(result, line, tmp_path)


def to(tmp_path: Path) -> tuple[str, str]:
    return "--out", str(tmp_path / "out")


def refused(result: Result, line: str, tmp_path: Path) -> None:
    assert result.exit_code == 2
    assert line in result.stderr
    assert result.stderr.count("\n") == 1
    assert result.stdout == ""
    assert not (tmp_path / "out").exists()
