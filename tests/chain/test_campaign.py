"""From a folder of recordings to spectra: manifests, exports of data loggers, units, warnings that stay."""

import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from hbm import InputError, load_history, load_rig, load_spectra, write_spectra
from hbm.cli import app
from hbm.measurement.manifest import entries_of
from hbm.measurement.spectra import MOST_WARNINGS, MeasuredSpectra
from models.plausible import PlausibilityWarning

RIG = str(Path(__file__).parents[2] / "examples" / "one_mode.toml")  # channels force and a1
TIME = np.arange(1000) / 1000.0
HEADED = (
    "must be time_s, or as Time (ms), and one per channel, between commas, semicolons or tabs; without times: NPZ or "
    "MAT with fs"
)


def run(*args: str) -> Result:
    return CliRunner().invoke(app, ["spectra", *args], prog_name="hbm")


def export(
    path: Path,
    heading: str,
    *,
    hz: float = 50.0,
    scale: float = 1.0,
    mark: str = ";",
    decimal: str = ",",
    **more: float,
) -> Path:
    """A force of 2 N and an acceleration of 3 m/s2 with noise, as a data logger might write them."""
    rng, theta = np.random.default_rng(3), 2.0 * np.pi * hz * TIME
    a1 = 3.0 * np.sin(theta) + more.get("ringing", 0.0) * np.exp(-5.0 * TIME) * np.cos(1.06 * theta)
    rows = np.column_stack([TIME, 2.0 * np.cos(theta), a1 / scale]) + [0.0, 1.0, 1.0] * rng.normal(0, 1e-3, (1000, 3))
    lines = [mark.join(f"{v:.9g}" for v in row).replace(".", decimal) for row in rows]
    path.write_text("\n".join([heading, *lines]) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("heading", "how"),
    [
        ("Time (s);force (N);a1 (g)", {}),
        ("Time [s];force [N];a1 [g]", {}),
        ("Time;force;a1\ns;N;g", {}),
        ("t\tforce\ta1\n[s]\t[N]\t[g]", {"mark": "\t"}),
        ("# logger 3\nTime (s),force,a1 (g)", {"mark": ",", "decimal": "."}),
        ("zeit [s];force [N];a1 [g_n]", {}),
        ('Recorder "7", serial 12\nDate;24.11.2026\n\nChannels;2\nRate;500;Hz\nTime;force;a1\ns;N;g', {}),
        ("Time of the start: 12:30\nt (s),force (N),a1 (g)", {"mark": ",", "decimal": "."}),
    ],
)
def test_exports_of_data_loggers_are_read_in_si(heading: str, how: dict[str, str], tmp_path: Path) -> None:
    found = load_history(export(tmp_path / "h.csv", heading, scale=9.80665, **how))  # type: ignore[arg-type]
    np.testing.assert_allclose(found.time, TIME)
    assert list(found.channels) == ["force", "a1"]
    assert found.units["a1"] == "m/s2"
    amplitude = 2.0 * np.abs(np.fft.rfft(found.channels["a1"])[50]) / 1000
    assert amplitude == pytest.approx(3.0, rel=1e-2)


def test_milliseconds_are_read_and_line_ends_with_a_delimiter(tmp_path: Path) -> None:
    path = tmp_path / "h.csv"
    path.write_text("Time (ms);a1 (mm/s²);\n0;1000,5;\n1;2000;\n2;-3e3;\n")
    found = load_history(path)
    assert found.time.tolist() == [0.0, 0.001, 0.002]
    assert found.channels["a1"].tolist() == pytest.approx([1.0005, 2.0, -3.0])


@pytest.mark.parametrize("encoding", ["cp1252", "utf-16", "utf-8-sig"])
def test_the_encodings_of_windows_are_read(encoding: str, tmp_path: Path) -> None:
    path = tmp_path / "h.csv"
    path.write_bytes("Zeit [s];a1 [m/s²]\n0;1\n1;2\n2;3\n".encode(encoding))
    assert load_history(path).units == {"a1": "m/s2"}


def test_brackets_that_hold_no_unit_belong_to_the_name(tmp_path: Path) -> None:
    path = tmp_path / "h.csv"
    path.write_text("time_s,beam (top),a (a1)\n0,1,1\n1,2,2\n2,3,3\n")
    assert list(load_history(path).channels) == ["beam (top)", "a (a1)"]


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("Time;a1\n0;1\n1;2\n2;3\n", ' line 1: columns "Time;a1"; ' + HEADED),
        ("Time (N);a1\n0;1\n", ' line 1: columns "Time (N);a1"; ' + HEADED),
        ("Time (s);a1\n0;1.000,5\n1;2\n", ' line 2: a1 = "1.000.5"; must be a finite number'),
        (
            "Time (s);a1 (kg)\n0;1\n1;2\n2;3\n",
            ': unit of a1 is "kg"; must be one of '
            "N, kN, mN, lbf, m/s2, mm/s2, g, mg, m/s, mm/s, in/s, m, mm, um, nm, in",
        ),
    ],
)
def test_what_cannot_be_meant_is_refused(text: str, line: str, tmp_path: Path) -> None:
    path = tmp_path / "h.csv"
    path.write_text(text)
    with pytest.raises(InputError) as refused:
        load_history(path)
    assert str(refused.value) == f"{path}{line}"


def test_a_unit_that_is_given_must_not_contradict_the_file(tmp_path: Path) -> None:
    path = tmp_path / "h.csv"
    path.write_text("time_s,force [N],a1\n0,1,1\n1,2,2\n2,3,3\n")
    assert load_history(path, units={"a1": "g"}).channels["a1"][0] == 9.80665
    with pytest.raises(InputError, match="force is in N in the file; must not be given as lbf"):
        load_history(path, units={"force": "lbf"})


# ------------------------------------------------------------------------------------------------------------ manifests


MANIFESTS = {
    "manifest.csv": "file,frequency_hz,level,channels,units\n"
    "a.csv,50,2,force=load cell|a1=top,a1=g\nb.csv,60,2.5,force=load cell|a1=top,a1=g\n",
    "manifest.toml": '[channels]\nforce = "load cell"\na1 = "top"\n[units]\na1 = "g"\n'
    '[[records]]\nfile = "a.csv"\nfrequency_hz = 50\nlevel = 2\n'
    '[[records]]\nfile = "b.csv"\nfrequency_hz = 60.0\nlevel = 2.5\n',
}


@pytest.mark.parametrize("name", MANIFESTS)
def test_a_manifest_says_it_all(name: str, tmp_path: Path) -> None:
    for file, hz in (("a.csv", 50.0), ("b.csv", 60.0)):
        export(tmp_path / file, "Time (s);load cell;top", hz=hz, scale=9.80665)
    (tmp_path / name).write_text(MANIFESTS[name])
    for given in (tmp_path, tmp_path / name):
        out = tmp_path / "s.nc"
        result = run(str(given), "--rig", RIG, "--harmonics", "3", "--out", str(out))
        assert (result.exit_code, result.stderr) == (0, "")
        spectra = load_spectra(out, load_rig(RIG))
        assert (spectra.hz.tolist(), spectra.level.tolist()) == ([50.0, 60.0], [2.0, 2.5])
        assert np.abs(spectra.complex("a1")[:, 1]) == pytest.approx([3.0, 3.0], rel=0.02)


def test_steps_of_one_file_are_records_of_their_own(tmp_path: Path) -> None:
    """Two steps of a stepped sine: without begin and end each would be a mixture."""
    t = np.arange(4000) / 1000.0
    first = t < 2.0
    force = np.where(first, 2.0 * np.cos(2 * np.pi * 50.0 * t), 3.0 * np.cos(2 * np.pi * 60.0 * t))
    np.savez(tmp_path / "steps.npz", time_s=t, force=force, a1=0.5 * force)
    (tmp_path / "manifest.csv").write_text("file,frequency_hz,begin_s,end_s\nsteps.npz,50,,1.9995\nsteps.npz,60,2.0,\n")
    out = tmp_path / "s.csv"
    result = CliRunner().invoke(app, ["spectra", str(tmp_path / "manifest.csv"), "--harmonics", "5", "--out", str(out)])
    assert result.exit_code == 0, result.output
    rows = [line.split(",") for line in out.read_text().splitlines() if ",force,1," in line]
    assert [(row[0], row[2]) for row in rows] == [("1", "50.0"), ("2", "60.0")]
    assert [float(row[5]) for row in rows] == [pytest.approx(2.0, abs=1e-9), pytest.approx(3.0, abs=1e-9)]


def test_parts_that_overlap_or_are_not_in_the_file_are_told(tmp_path: Path) -> None:
    """Times that are an even clock's but for their digits begin at 0 s, not at 8e-12 s."""
    t = np.round(np.arange(4096) / 1024, 7)
    rows = np.column_stack([t, np.cos(100.0 * np.pi * t), np.sin(100.0 * np.pi * t)])
    np.savetxt(tmp_path / "steps.csv", rows, delimiter=",", header="time_s,force,a1", comments="", fmt="%.9g")

    def told(*parts: str) -> str:
        (tmp_path / "manifest.csv").write_text(
            "file,frequency_hz,begin_s,end_s\n" + "".join(f"steps.csv,50,{part}\n" for part in parts)
        )
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always", PlausibilityWarning)
            printed = run(str(tmp_path), "--out", str(tmp_path / "s.csv")).stderr
        return " ".join(printed.split() + [str(line.message) for line in said])

    assert told("0,2", "2,4") == ""
    assert "steps.csv: records 1 and 3 overlap; what they have in common counts twice" in told("0,1", "1,2", "0.5,1")
    assert "steps.csv: end_s = 5 s is not in it; it has 0 to 3.9990234 s" in told("0,2", "2,5")
    assert "steps.csv: begin_s = -1 s is not in it; it has 0 to 3.9990234 s" in told("-1,2")
    assert "0 samples from 2048 to 4096 s; must be at least 3, of 0 to 3.9990234 s" in told("2048,4096")


def test_file_names_say_frequency_and_level_in_a_folder(tmp_path: Path) -> None:
    for name in ("run10_60Hz_4N.csv", "run2_48,5Hz_2.5N.csv"):
        export(tmp_path / name, "Time (s);force;a1")
    found = [(e.file.name, e.hz, e.level) for e in entries_of([tmp_path])]
    assert found == [("run2_48,5Hz_2.5N.csv", 48.5, 2.5), ("run10_60Hz_4N.csv", 60.0, 4.0)]


@pytest.mark.parametrize(
    ("name", "text", "line"),
    [
        ("m.csv", "file,frequency_hz\na.csv,0\n", " line 2: frequency_hz = 0.0; must be a number > 0 [Hz]"),
        ("m.csv", "file,hz\na.csv,50\n", ' line 1: column "hz"; must be each once of file, frequency_hz, level, '),
        ("m.csv", "file,channels\na.csv,a1\n", ' line 2: channels = "a1"; must be NAME=VALUE|NAME=VALUE'),
        ("m.csv", "file,frequency_hz\n", ": no files; must have one row per recording"),
        ("m.toml", "[[records]]\nfrequency_hz = 50\n", " records[1]: no file; must have one"),
        ("m.toml", '[[records]]\nfile = "a"\nhz = 50\n', " records[1]: hz; must be one of file, frequency_hz, level, "),
        ("m.toml", "level = 2\n", ": level; must be one of records, channels, units"),
        ("m.toml", "", ": no records; must have a [[records]] table for each file"),
    ],
)
def test_a_bad_manifest_is_refused_in_one_line(name: str, text: str, line: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text(text)
    result = run(str(path), "--out", str(tmp_path / "s.csv"))
    assert result.exit_code == 2
    assert result.stderr.startswith(f"{path}{line}")
    assert result.stderr.count("\n") == 1


def test_an_empty_folder_and_a_file_without_frequency_are_refused(tmp_path: Path) -> None:
    assert run(str(tmp_path), "--out", str(tmp_path / "s.csv")).stderr.startswith(
        f"{tmp_path}: no recordings; must have"
    )
    for name in ("runs", "manifest.toml", "manifest.csv"):
        missing = run(str(tmp_path / name), "--out", str(tmp_path / "s.csv")).stderr
        assert missing == f"{tmp_path / name}: no such file or folder; must be a time history, a manifest or a folder\n"
    export(tmp_path / "a_50Hz.csv", "Time (s);force;a1")
    export(tmp_path / "b.csv", "Time (s);force;a1")
    result = run(str(tmp_path), "--out", str(tmp_path / "s.csv"))
    assert result.stderr.startswith(f"spectra: {tmp_path / 'b.csv'} has no frequency; must have it in the manifest, ")


# ------------------------------------------------------------------------------------------------------------- warnings


@pytest.mark.parametrize("ending", ["csv", "nc", "mat"])
def test_warnings_stay_with_the_record_they_are_about(ending: str, tmp_path: Path) -> None:
    export(tmp_path / "a_50Hz.csv", "Time (s);force;a1")
    export(tmp_path / "b_50Hz.csv", "Time (s);force;a1", ringing=1.0)
    out = tmp_path / f"s.{ending}"
    assert run(str(tmp_path), "--rig", RIG, "--out", str(out)).exit_code == 0
    spectra = load_spectra(out, load_rig(RIG))
    assert {record for record, _ in spectra.notes} == {2}
    assert spectra.warnings[0].startswith(f"Record 2 of {out}: a1 is not steady: a transient dies out at")
    assert spectra.select(records=[1]).notes == ()
    again = tmp_path / "again.csv"
    write_spectra(again, spectra)
    assert load_spectra(again, load_rig(RIG)).notes == spectra.notes


def test_many_warnings_are_cut_short() -> None:
    n = MOST_WARNINGS + 2
    empty, none = np.zeros(0), np.zeros((0, 0, 1))
    spectra = MeasuredSpectra(
        "s.csv", empty.astype(int), empty, empty, (), none, none, tuple((i, "x") for i in range(n))
    )
    assert len(spectra.warnings) == MOST_WARNINGS + 1
    assert spectra.warnings[-1] == "2 more warnings are in s.csv."


def test_comments_of_others_are_no_warnings_and_rows_of_simulations_no_channels(tmp_path: Path) -> None:
    path = tmp_path / "s.csv"
    heading, row = "record,level,frequency_hz,channel,harmonic,cos,sin,std", "1,2,50,{},1,1,0,0.1"
    lines = ["# made on Tuesday, by hand", row.format("a1"), row.format("drive"), "# record 1: a1 is odd, very"]
    path.write_text("\n".join([heading, *lines, ""]))
    spectra = load_spectra(path, load_rig(RIG))
    assert (spectra.channels, spectra.notes) == (("a1",), ((1, "a1 is odd, very"),))


def test_our_own_simulation_with_its_contact_goes_the_way_of_a_measurement(tmp_path: Path) -> None:
    files = {"out": str(tmp_path / "run.csv"), "spectra": str(tmp_path / "s.csv")}
    simulated = ["simulate", RIG, "--frequency", "45", "--duration", "0.5", "--contact", "--out", files["out"]]
    assert CliRunner().invoke(app, simulated).exit_code == 0
    for rig in (["--rig", RIG], []):
        assert run(files["out"], "--fundamental", "45", *rig, "--out", files["spectra"]).exit_code == 0
        assert load_spectra(files["spectra"], load_rig(RIG)).channels == ("force", "a1")


def test_a_diagnosis_repeats_what_speaks_against_a_record() -> None:
    from dataclasses import replace

    from hbm import diagnose, synthesize

    rig = load_rig(RIG)
    spectra = synthesize(rig, [2.0], [44.0, 46.0, 48.0, 50.0, 52.0, 54.0], harmonics=3).spectra
    noted = replace(spectra, source="s.csv", notes=((3, "a1 is flat-topped: was it clipped?"),))
    found = diagnose(rig, noted, causes=[], held_out=[2])
    assert "Record 3 of s.csv: a1 is flat-topped: was it clipped." in found.json()["evidence"]


def test_a_manifest_that_cannot_be_read_says_so(tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    path.write_bytes(b"# \xff")
    assert "m.toml: cannot be read ('utf-8' codec can't decode byte 0xff" in run(str(path), "--out", "s.csv").stderr


@pytest.mark.parametrize(
    ("file", "text", "said"),
    [
        ("m.csv", "file,frequency_hz\na\0.csv,50\n", r"a\\x00.csv: no such file"),
        (
            "m.csv",
            "file,frequency_hz\n/dev/zero,50\n",
            'line 2: file = "/dev/zero": is a pipe or a device; must be a file',
        ),
        ("m.csv", f"file,frequency_hz\n{'a' * 5000}.csv,50\n", "file name too long; must be a file that can be used"),
        ("m.toml", "records = " + "[" * 5000 + "]" * 5000, "is too deep, or a number too long; must be a manifest"),
    ],
)
def test_a_manifest_that_names_no_file_is_refused_in_one_line(file: str, text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / file).write_text(text)
    result = run(str(tmp_path / file), "--out", str(tmp_path / "s.csv"))
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
    assert re.search(said, result.stderr), result.stderr
    assert [p.name for p in tmp_path.iterdir()] == [file]
