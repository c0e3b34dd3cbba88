"""The command ``hbm inverse``: what it prints and writes, and the one line with which it refuses or fails."""

import csv
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import hbm.inverse.reconstruct
from continuation import ConvergenceError
from hbm import load_rig
from hbm.cli import app
from hbm.commands.options import UNSOLVABLE
from hbm.files import inversefiles
from hbm.files.identifyreport import FILES as IDENTIFY_FILES
from hbm.files.inversefiles import read_reconstruction
from hbm.files.inversereport import DRAWINGS, FILES
from hbm.inverse.reconstruct import FORMULATIONS
from models import LAWS
from tests.contactdata import RIG_FILE, reconstruction, write_spectra_file

RIG = str(RIG_FILE)


def run(*args: str) -> Result:
    return CliRunner().invoke(app, list(args), prog_name="hbm")


@pytest.fixture(scope="module")
def spectra(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(write_spectra_file(tmp_path_factory.mktemp("spectra") / "spectra.csv"))


def read_csv(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as lines:
        return list(csv.DictReader(lines))


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drawing takes seconds: left out where the test is about something else."""
    monkeypatch.setattr("hbm.files.inversereport.DRAWINGS", ())


def test_everything_is_written_named_and_printed(spectra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hbm.files.inversereport.DRAWINGS", DRAWINGS[-1:])  # the others are drawn in test_page.py
    out = tmp_path / "contact"
    result = run("inverse", RIG, spectra, "--out", str(out))
    assert (result.exit_code, result.stderr) == (0, "")
    lines = result.stdout.splitlines()
    files = [name for name in FILES if (out / name).exists()]
    assert {f"wrote {out / name}" for name in files} == {line for line in lines if line.startswith("wrote ")}
    left_out = {name for name in FILES if "figures" in name and "resolution" not in name} | {"calibrated.toml"}
    assert set(files) == set(FILES) - left_out - ({"reconstruction.nc"} if not inversefiles.has_netcdf() else set())
    assert [path.name for path in tmp_path.iterdir()] == ["contact"]
    assert "clamped-supported beam, Table 1, regularised" in lines[0]
    rows = [line.split() for line in lines if line.strip().startswith(("2.5 ", "6.5 "))]
    r = reconstruction()
    for row, level in zip(rows, (2.5, 6.5), strict=True):
        own = r.spectra.level == level
        assert row[:3] == [f"{level:g}", "3", str(int(r.slips[own].sum()))]
        assert float(row[3]) == pytest.approx(np.abs(r["friction"].samples[own]).max(), rel=0.02)
    for warning in r.warnings:
        assert f"warning: {warning}" in lines


def test_written_signals_are_those_of_the_reconstruction(spectra: str, tmp_path: Path, quick: None) -> None:
    """Through the files, to 12 digits: the spectra file has every digit, linear algebra may differ in the last."""
    assert run("inverse", RIG, spectra, "--out", str(tmp_path / "out")).exit_code == 0
    found = read_reconstruction(tmp_path / "out" / "reconstruction.csv")
    assert np.allclose(found.samples["friction"], reconstruction()["friction"].samples, rtol=1e-9, atol=1e-9)


def test_records_and_formulation_can_be_chosen(spectra: str, tmp_path: Path, quick: None) -> None:
    result = run(
        "inverse", RIG, spectra, "--out", str(tmp_path / "out"), "--record", "2", "5", "--formulation", "modal"
    )
    assert result.exit_code == 0
    assert "Table 1, modal" in result.stdout
    assert read_reconstruction(tmp_path / "out" / "reconstruction.csv").records.tolist() == [2, 5]


def asked_for(spectra: str, folder: Path, right: str, wrong: str) -> tuple[Path, Path, str]:
    """Results, rig file with a wrong number, and the line about what the sensors ask for."""
    out, rig = folder / "contact", folder / "rig.toml"
    rig.write_text(Path(RIG).read_text().replace(right, wrong))
    result = run("inverse", str(rig), spectra, "--out", str(out))
    assert (result.exit_code, result.stderr) == (0, "")
    return out, rig, next(line for line in result.stdout.splitlines() if line.startswith("sensors agree better with"))


def test_numbers_that_sensors_ask_for_are_told_and_make_a_rig_file(spectra: str, tmp_path: Path, quick: None) -> None:
    """Of a rig file whose Young's modulus is 1 % too small; with what it makes of it they agree, and it is gone."""
    out, rig, told = asked_for(spectra, tmp_path, "210e9", "207.9e9")
    assert "beam.youngs_modulus = 2." in told and told.endswith(f"see {out / 'calibrated.toml'}")
    calibrated = load_rig(out / "calibrated.toml")
    assert calibrated.number("beam.youngs_modulus") == pytest.approx(210e9, rel=3e-3)
    assert "Sensors agree better with beam.youngs_modulus" in (out / "report.html").read_text()
    shutil.copy(out / "calibrated.toml", rig)
    again = run("inverse", str(rig), spectra, "--out", str(out))
    assert "sensors agree" not in again.stdout
    assert not (out / "calibrated.toml").exists()
    rows = read_csv(out / "rig_numbers.csv")
    assert {row["number"]: float(row["left"]) for row in rows}["contact.normal_load"] > 0.99


def test_a_length_that_is_wrong_is_told_and_no_place_of_a_sensor(spectra: str, tmp_path: Path, quick: None) -> None:
    """Of a rig file whose beam is 0.5 % too long; it is exact where --tolerance says so."""
    out, rig, told = asked_for(spectra, tmp_path, "length = 0.606", "length = 0.609")
    assert told.startswith("sensors agree better with beam.length = 0.60") and "position" not in told
    assert load_rig(out / "calibrated.toml").number("beam.length") == pytest.approx(0.606, rel=1.5e-3)
    run("inverse", str(rig), spectra, "--out", str(out), "--tolerance", "beam.length=0")
    assert "beam.length" not in {row["number"] for row in read_csv(out / "rig_numbers.csv")}


def test_beside_a_wrong_unit_no_other_number_of_the_rig_is_asked_for(spectra: str, tmp_path: Path, quick: None) -> None:
    """Responses in mm: the unit is what is said, not a modulus that is off, nor where energy goes."""
    out, in_mm = tmp_path / "contact", tmp_path / "mm.csv"
    rows = read_csv(Path(spectra))
    for row in rows:
        if row["channel"] != "force":
            row |= {column: repr(1e3 * float(row[column])) for column in ("cos", "sin", "std")}
    with in_mm.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    result = run("inverse", RIG, str(in_mm), "--out", str(out))
    assert (result.exit_code, result.stderr) == (0, "")
    (warning,) = (line for line in result.stdout.splitlines() if line.startswith("warning: "))
    assert warning.startswith("warning: units: the sensors read as if all responses are in mm instead of m, ")
    assert "agree better" not in result.stdout and "tolerances" not in result.stdout
    assert not (out / "calibrated.toml").exists() and not (out / "rig_numbers.csv").exists()


def test_tolerances_decide_what_the_rig_file_is_uncertain_by(spectra: str, tmp_path: Path, quick: None) -> None:
    """A load that is known ten times better: the reaction is, too, as far as it is by the load."""
    deviations = []
    for given in ("0.02", "0.002"):
        out = tmp_path / given
        tolerance = ("--tolerance", f"contact.normal_load={given}")
        assert run("inverse", RIG, spectra, "--out", str(out), *tolerance).exit_code == 0
        rows = [row for row in read_csv(out / "rig_errors.csv") if row["quantity"] == "normal"]
        deviations.append(np.array([float(row["rig_std"]) for row in rows]))
    assert np.allclose(deviations[0], 0.02 * reconstruction().rig.contact.normal_load, rtol=0.05)
    assert (deviations[1] < 0.5 * deviations[0]).all()


def test_a_second_run_replaces_the_first_and_nothing_else(spectra: str, tmp_path: Path, quick: None) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    for record in ("1", "2"):
        assert run("inverse", RIG, spectra, "--out", str(tmp_path), "--record", record).exit_code == 0
    assert read_reconstruction(tmp_path / "reconstruction.csv").records.tolist() == [2]
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_without_h5netcdf_the_missing_file_is_said(
    spectra: str, tmp_path: Path, quick: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(inversefiles, "has_netcdf", lambda: False)
    result = run("inverse", RIG, spectra, "--out", str(tmp_path), "--record", "1")
    assert result.exit_code == 0
    assert result.stdout.splitlines()[-1] == ("no reconstruction.nc: needs h5netcdf; pip install 'casadi-hbm[io]'")
    assert not (tmp_path / "reconstruction.nc").exists()


def test_design_prints_where_sensors_belong_and_writes_nothing(
    spectra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = run("inverse", RIG, spectra, "--design", "--sensors", "3")
    assert (result.exit_code, result.stderr, list(tmp_path.iterdir())) == (0, "", [])
    first = result.stdout.splitlines()[0]
    assert first.startswith("sensors at ")
    assert first.endswith("for 0.02 m/s2 per sensor, 48 to 56 Hz")
    assert len(first.removeprefix("sensors at ").split(" mm")[0].split(", ")) == 3
    assert "present sensors at 100, 200, 300, 400, 500, 580 mm" in result.stdout


# ----------------------------------------------------------------------------------------------------------- bad input


@pytest.mark.parametrize("factor", [1e-3, 1e-5])
def test_frequencies_far_below_the_first_mode_are_warned_of_with_the_unit_that_they_look_like(
    spectra: str, tmp_path: Path, quick: None, factor: float
) -> None:
    """48 to 56 Hz in kHz; in no unit, a hundred times less."""
    heading, *rows = (line.split(",") for line in Path(spectra).read_text().splitlines())
    slower = [[*row[:2], str(float(row[2]) * factor), *row[3:]] for row in rows]
    slow = tmp_path / "slow.csv"
    slow.write_text("\n".join(",".join(row) for row in [heading, *slower]))
    result = run("inverse", RIG, str(slow), "--out", str(tmp_path / "out"), "--record", "1")
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"warning: {slow}: frequency_hz = 0.0") and " times below the first mode of the rig" in line
    advice = "are they meant in kHz (48 to 56 Hz)?" if factor == 1e-3 else "check their unit"
    assert line.endswith(advice)


@pytest.mark.parametrize(
    ("args", "line"),
    [
        (["inverse", RIG], "hbm inverse: missing argument 'SPECTRA'; see hbm inverse --help"),
        (["inverse", RIG, "S"], "inverse: --out is missing; must name a folder, or --design be asked for"),
        (["inverse", RIG, "S", "--record", "9"], "S: no record 9; records are 1, 2, 3, 4, 5, 6"),
        (["inverse", RIG, "no.csv"], "no.csv: no such file; must be a spectra file"),
        (["inverse", "s.csv", "rig.toml"], 'inverse: RIG = "s.csv", SPECTRA = "rig.toml"; must be exchanged'),
        (["inverse", "no.toml", "S", "--out", "o"], "no.toml: no such file; must be a rig file (TOML)"),
        (["inverse", RIG, "no.csv", "--out", "o"], "no.csv: no such file; must be a spectra file"),
        (
            ["inverse", RIG, "S", "--out", "no/o"],
            "inverse: --out = \"no/o\"; there is no directory 'no', create it first",
        ),
        (["inverse", RIG, "S", "--out", "file"], 'inverse: --out = "file"; is a file, must be a directory'),
        (
            ["inverse", RIG, "S", "--out", "o", "--formulation", "magic"],
            f'inverse: --formulation = "magic"; must be one of {", ".join(FORMULATIONS)}',
        ),
        (
            ["inverse", RIG, "S", "--out", "o", "--record", "one"],
            "S: no record one; records are 1, 2, 3, 4, 5, 6",
        ),
        (
            ["inverse", RIG, "S", "--out", "o", "--record", "1.5"],
            "S: no record 1.5; records are 1, 2, 3, 4, 5, 6",
        ),
        (
            ["inverse", RIG, "S", "--out", "o", "--record", "2", "2"],
            "inverse: --record = 2 twice; must be different records",
        ),
        (["inverse", RIG, "S", "--out", "o", "--record", "9"], "S: no record 9; records are 1, 2, 3, 4, 5, 6"),
        (["inverse", RIG, "S", "--out", "o", "--sensors", "3"], "inverse: --sensors without --design; must have both"),
        (
            ["inverse", RIG, "S", "--design", "--sensors", "0"],
            "inverse: --sensors = 0; must be a whole number from 1 to 1000",
        ),
        (
            ["inverse", RIG, "S", "--design", "--sensors", "500"],
            "inverse: place_sensors: count = 500; must be 1 to 29: 606 mm of beam, "
            "20 mm left free at each end, 20 mm apart",
        ),
    ],
)
def test_bad_input_is_one_line_and_status_2(
    args: list[str], line: str, spectra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("")
    result = run(*(spectra if arg == "S" else arg for arg in args))
    line = line.replace("S: ", f"{spectra}: ") if line.startswith("S: ") else line
    assert (result.stderr, result.stdout, result.exit_code) == (f"{line}\n", "", 2)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_spectra_without_a_response_are_refused(spectra: str, tmp_path: Path) -> None:
    only = tmp_path / "force.csv"
    lines = Path(spectra).read_text().splitlines(keepends=True)
    only.write_text("".join(line for line in lines if ",a" not in line))
    result = run("inverse", RIG, str(only), "--out", str(tmp_path / "out"))
    expected = f"{only}: holds no response channel; must hold at least one of a1, a2, a3, a4, a5, a6\n"
    assert (result.stderr, result.exit_code) == (expected, 2)
    assert not (tmp_path / "out").exists()


def test_what_cannot_be_computed_is_one_line_and_status_1(
    spectra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def singular(*_: object, **__: object) -> None:
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr(hbm.inverse.reconstruct, "reconstruct", singular)
    result = run("inverse", RIG, spectra, "--out", str(tmp_path / "out"))
    assert (result.stderr, result.exit_code) == (f"hbm: inverse: {spectra}: {UNSOLVABLE}\n", 1)
    assert list(tmp_path.iterdir()) == []


# ------------------------------------------------------------------------------------------------------------ identify


def test_a_law_is_identified_written_and_printed(spectra: str, tmp_path: Path) -> None:
    """The rig's own law, one record held out. Within 2 %: the data end at harmonic 7, corners of friction do not."""
    out = tmp_path / "laws"
    result = run(
        "identify", RIG, spectra, "--law", "coulomb-penalty", "--held-out", "5", "--output-error", "--out", str(out)
    )
    assert (result.exit_code, result.stderr) == (0, "")
    lines = result.stdout.splitlines()
    names = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    assert names == {name for name in IDENTIFY_FILES if "figures/parameters" not in name}
    assert {f"wrote {out / name}" for name in names} == {line for line in lines if line.startswith("wrote ")}
    first = (out / "parameters.csv").read_text().splitlines()[1].split(",")
    assert first[:2] == ["coulomb-penalty", "mu"]
    assert float(first[4]) == pytest.approx(0.52, abs=0.01)
    assert any(line.startswith("coulomb-penalty: mu 0.5") for line in lines)
    refined = (out / "output_error.csv").read_text().splitlines()
    assert refined[0] == "law,parameter,unit,value,std"
    assert float(refined[1].split(",")[3]) == pytest.approx(0.52, abs=0.002)
    assert "[[Law]] coulomb-penalty, 5 records, fitted to spectra" in lines
    assert "5" not in {row.split(",")[0] for row in (out / "figures" / "law_loops.csv").read_text().splitlines()}


@pytest.mark.parametrize(
    ("args", "line"),
    [
        (["identify", RIG, "S"], "hbm identify: missing option '--out'; see hbm identify --help"),
        (
            ["identify", "s.csv", "rig.toml", "--out", "o"],
            'identify: RIG = "s.csv", SPECTRA = "rig.toml"; must be exchanged',
        ),
        (["identify", RIG, "S", "--out", "file"], 'identify: --out = "file"; is a file, must be a directory'),
        (
            ["identify", RIG, "S", "--out", "o", "--law", "dahll"],
            f'identify: --law = "dahll"; must be one of {", ".join(LAWS)}, or file.py:Class; did you mean dahl?',
        ),
        (
            ["identify", RIG, "S", "--out", "o", "--held-out", "x"],
            "six: no record x; records are 1, 2, 3, 4, 5, 6",
        ),
        (["identify", RIG, "S", "--out", "o", "--held-out", "9"], "six: no record 9; records are 1, 2, 3, 4, 5, 6"),
        (
            ["identify", RIG, "S", "--out", "o", "--hold-out", "2", "9"],
            "six: no record 9; records are 1, 2, 3, 4, 5, 6",
        ),
        (
            ["identify", RIG, "S", "--out", "o", "--law", "dahl", "--law", "dahl"],
            "identify: law dahl is named twice; must be once",
        ),
        (
            ["identify", RIG, "S", "--out", "o", "--formulation", "x"],
            f'identify: --formulation = "x"; must be one of {", ".join(FORMULATIONS)}',
        ),
    ],
)
def test_bad_input_to_identify_is_one_line_and_status_2(
    args: list[str], line: str, spectra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("")
    result = run(*(spectra if arg == "S" else arg for arg in args))
    assert (result.stderr, result.stdout, result.exit_code) == (f"{line.replace('six:', f'{spectra}:')}\n", "", 2)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_where_the_forward_model_fails_the_rest_is_kept_and_the_status_is_1(
    spectra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def lost(*_: object, **__: object) -> None:
        raise ConvergenceError("no steady state")

    monkeypatch.setattr("hbm.identification.spectra.fit_spectra", lost)
    monkeypatch.setattr("hbm.files.identifyreport.identify_plates", lambda *_: [])
    result = run("identify", RIG, spectra, "--law", "coulomb-penalty", "--output-error", "--out", str(tmp_path))
    assert (result.stderr, result.exit_code) == ("identify: --output-error: no steady state\n", 1)
    assert {path.name for path in tmp_path.iterdir()} == {"laws.csv", "parameters.csv", "report.html", "rig_errors.csv"}
