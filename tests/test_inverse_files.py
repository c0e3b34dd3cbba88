"""Files of a reconstruction: every number comes back, the whole folder appears or none of it."""

import csv
import io
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from hbm.errors import InputError
from hbm.files import inversefiles
from hbm.files.inversefiles import COLUMNS, read_reconstruction, write_reconstruction
from hbm.files.outputs import check_folder, write_folder
from hbm.inverse.reconstruction import SIGNALS
from tests.contactdata import reconstruction

HEADING = (
    "record,level,frequency_hz,phase,slip,slip_std,slip_velocity,slip_velocity_std,"
    "friction,friction_std,normal,normal_std"
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("files") / "contact"
    write_reconstruction(path, reconstruction())
    return path


def table(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(path.read_text())))


# ----------------------------------------------------------------------------------------------------------- round trip


def test_signals_come_back_to_the_last_digit(folder: Path) -> None:
    found, r = read_reconstruction(folder / "reconstruction.csv"), reconstruction()
    assert (folder / "reconstruction.csv").read_text().splitlines()[0] == HEADING
    assert len(found) == len(r) == 6
    for here, there in ((found.records, r.spectra.records), (found.level, r.spectra.level), (found.hz, r.spectra.hz)):
        assert np.array_equal(here, there)
    assert np.array_equal(found.phase, r.phase)
    for name in SIGNALS:
        assert np.array_equal(found.samples[name], r[name].samples)
        assert np.array_equal(found.std[name], r[name].std)


def test_energy_file_has_a_row_per_record(folder: Path) -> None:
    r, rows = reconstruction(), table(folder / "energy.csv")
    assert ",".join(rows[0]) == (
        "record,level,frequency_hz,work_rate,work_rate_std,energy_per_cycle,energy_per_cycle_std,slips,chi2_reduced"
    )
    shown = {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
    assert np.array_equal(shown["record"], r.spectra.records)
    assert np.array_equal(shown["work_rate"], r.work_rate.value)
    assert np.array_equal(shown["work_rate_std"], r.work_rate.std)
    assert np.array_equal(shown["energy_per_cycle"], r.energy_per_cycle.value)
    assert np.array_equal(shown["energy_per_cycle_std"], r.energy_per_cycle.std)
    assert np.array_equal(shown["slips"].astype(bool), r.slips)
    assert np.array_equal(shown["chi2_reduced"], r.misfit.reduced)


def test_harmonics_file_gives_the_samples_back(folder: Path) -> None:
    """s(t) = sum of cos and sin of the file, with the signs of docs/theory/equations.md section 4."""
    r, rows = reconstruction(), table(folder / "harmonics.csv")
    assert len(rows) == len(r) * (r.H + 1)
    phase = 2 * np.pi * r.phase
    for name in ("friction", "slip"):
        s = np.zeros((len(r), len(phase)))
        for row in rows:
            k, i = int(row["harmonic"]), r.index(int(row["record"]))
            s[i] += float(row[f"{name}_cos"]) * np.cos(k * phase) + float(row[f"{name}_sin"]) * np.sin(k * phase)
        assert np.allclose(s, r[name].samples, rtol=0, atol=1e-9 * np.abs(s).max())
    third = next(row for row in rows if row["record"] == "2" and row["harmonic"] == "3")
    assert float(third["normal_amplitude"]) == r["normal"].amplitude[1, 3]
    assert float(third["normal_std"]) == r["normal"].coefficient_std[1, 3]
    assert float(third["resolution"]) == r.resolution[1, 3]
    assert float(third["condition"]) == r.condition[1, 3]
    assert next(row for row in rows if row["harmonic"] == "0")["resolution"] == ""  # inf: no accelerometer sees it


def test_mat_file_holds_the_arrays_with_units(folder: Path) -> None:
    r, found = reconstruction(), loadmat(folder / "reconstruction.mat", simplify_cells=True)
    assert np.array_equal(found["friction"], r["friction"].samples)
    assert np.array_equal(found["slip_std"], r["slip"].std)
    assert np.array_equal(found["frequency_hz"], r.spectra.hz)
    assert (found["units"]["slip"], found["units"]["energy_per_cycle"]) == ("m", "J")


def test_netcdf_file_has_dimensions_and_units(folder: Path) -> None:
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    r = reconstruction()
    with xarray.open_dataset(folder / "reconstruction.nc", engine="h5netcdf") as found:
        assert found["friction"].dims == ("record", "phase")
        assert found["friction"].attrs["units"] == "N"
        assert np.array_equal(found["friction"], r["friction"].samples)
        assert np.array_equal(found["friction_harmonic_std"], r["friction"].coefficient_std)
        assert np.array_equal(found["slips"], r.slips)
        assert list(found.coords["record"]) == r.spectra.records.tolist()


def test_without_h5netcdf_netcdf_is_left_out_unless_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inversefiles, "has_netcdf", lambda: False)
    written = write_reconstruction(tmp_path / "a", reconstruction())
    names = ["energy.csv", "harmonics.csv", "reconstruction.csv", "reconstruction.mat"]
    assert sorted(path.name for path in written) == names
    pytest.importorskip("h5netcdf")
    assert (tmp_path / "a" / "reconstruction.nc") in write_reconstruction(tmp_path / "a", reconstruction(), netcdf=True)
    write_reconstruction(tmp_path / "a", reconstruction())  # the older .nc would contradict the new tables
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == names


# -------------------------------------------------------------------------------------------------------------- refusal

FINE = "1,2.0,50.0,0.0,1e-6,1e-8,1e-3,1e-5,4.0,0.1,83.0,0.2"


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["record,level"], f"line 1: 'record,level'; must be {HEADING}"),
        ([HEADING], ": no rows; must have at least one record"),
        ([HEADING, "1,2"], "line 2: 2 entries; must have 12"),
        ([HEADING, FINE.replace("4.0", "x")], 'line 2: friction = "x"; must be a finite number'),
        ([HEADING, FINE, FINE.replace("83.0", "nan")], 'line 3: normal = "nan"; must be a finite number'),
        ([HEADING, FINE.replace("1,2.0", "1.5,2.0", 1)], 'line 2: record = "1.5"; must be a whole number'),
        ([HEADING, FINE.replace(",0.1,", ",-0.1,")], "line 2: friction_std = -0.1; must be >= 0"),
        (
            [HEADING, FINE, FINE.replace("1,2.0", "2,2.0", 1), FINE.replace("1,2.0", "2,2.0", 1)],
            ": record 2 has other phases than record 1; must have the same",
        ),
        (
            [HEADING, FINE, FINE.replace("50.0,0.0", "51.0,0.5")],
            ": record 1 has several levels or frequencies; must have one of each",
        ),
    ],
)
def test_a_file_that_is_no_reconstruction_is_refused(lines: list[str], message: str, tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError) as refused:
        read_reconstruction(path)
    assert str(refused.value) == f"{path}{'' if message.startswith(':') else ' '}{message}"
    assert ",".join(COLUMNS) == HEADING


# --------------------------------------------------------------------------------------------------------------- folder


def test_folder_is_made_with_its_subfolders_and_keeps_what_is_not_ours(tmp_path: Path) -> None:
    mine = tmp_path / "out" / "mine.txt"
    write_folder(tmp_path / "out", {"a.txt": "1", "figures/b.txt": b"2", "old.txt": "0"})
    mine.write_text("mine")
    write_folder(tmp_path / "out", {"a.txt": "3", "figures/b.txt": b"4"}, owned=("a.txt", "old.txt", "never.txt"))
    found = {str(p.relative_to(tmp_path / "out")): p.read_text() for p in (tmp_path / "out").rglob("*.txt")}
    assert found == {"a.txt": "3", "figures/b.txt": "4", "mine.txt": "mine"}


def test_nothing_is_left_of_a_folder_that_could_not_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device", "a.txt")

    monkeypatch.setattr("hbm.textfiles.os.replace", full)
    with pytest.raises(InputError, match="no space left on device"):
        write_folder(tmp_path / "out", {"a.txt": "1", "figures/b.txt": b"2"})
    assert list(tmp_path.iterdir()) == []


def test_folders_that_could_not_be_written_are_refused_before_anything_else(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "in_the_way" / "a.txt").mkdir(parents=True)
    (tmp_path / "blocked").mkdir()
    (tmp_path / "blocked" / "figures").write_text("")
    for path, names, message in (
        ("file", ["a.txt"], "is a file, must be a directory"),
        ("no/out", ["a.txt"], f"there is no directory '{tmp_path / 'no'}', create it first"),
        ("in_the_way", ["a.txt"], f"'{tmp_path / 'in_the_way' / 'a.txt'}' is a directory, must be a file"),
        ("blocked", ["figures/a.txt"], f"'{tmp_path / 'blocked' / 'figures'}' is a file, must be a directory"),
    ):
        with pytest.raises(InputError) as refused:
            check_folder(tmp_path / path, names, "--out")
        assert str(refused.value) == f'--out = "{tmp_path / path}"; {message}'
    check_folder(tmp_path / "new", ["a.txt"], "--out")
    assert not (tmp_path / "new").exists()
