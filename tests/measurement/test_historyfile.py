"""Time histories of other programs: written by their own library, read here, and refused in one line."""

import sys
from pathlib import Path
from typing import Any

import h5py
import nptdms
import numpy as np
import pytest
import pyuff
from scipy.io import savemat

from hbm.errors import InputError
from hbm.measurement.historyfile import load_history
from hbm.measurement.recording import Recording

RATE = 2048.0
N = 300
TIME = np.arange(N) / RATE
FORCE, A1 = np.cos(40.0 * TIME), 3.0 * np.sin(70.0 * TIME)
HEADED = (
    "must be time_s, or as Time (ms), and one per channel, between commas, semicolons or tabs; without times: NPZ or "
    "MAT with fs"
)
HEADER_7_3 = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"


def assert_read(found: Recording, scale: float = 1.0, *, rel: float = 1e-12) -> None:
    """The two channels, the second in a unit of `scale` m/s2."""
    assert list(found.channels) == ["force", "a1"]
    np.testing.assert_allclose(found.time, TIME, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(found.channels["force"], FORCE, rtol=rel, atol=rel)
    np.testing.assert_allclose(found.channels["a1"], scale * A1, rtol=rel, atol=rel)


def refusal(path: Any, **options: Any) -> str:
    with pytest.raises(InputError) as refused:
        load_history(path, **options)
    return str(refused.value)


# ------------------------------------------------------------------------------------------------------------------ CSV


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_csv(tmp_path: Path) -> None:
    rows = "\n".join(f"{t!r},{f!r},{a!r}" for t, f, a in zip(TIME.tolist(), FORCE.tolist(), A1.tolist(), strict=True))
    found = load_history(written(tmp_path / "h.csv", f"time_s,force,a1\n{rows}\n"))
    assert_read(found, rel=0.0)
    assert dict(found.units) == {"force": "", "a1": ""}


def test_channels_may_be_chosen_and_renamed(tmp_path: Path) -> None:
    path = written(tmp_path / "h.csv", "time_s,x,y\n0,1,2\n1,3,4\n2,5,6\n")
    found = load_history(path, {"force": "y"})
    assert {name: values.tolist() for name, values in found.channels.items()} == {"force": [2.0, 4.0, 6.0]}
    assert refusal(path, channels={"force": "z"}) == f'{path}: no channel "z"; channels are x, y'


@pytest.mark.parametrize(
    "text",
    [
        'time_s,"a1 [g]"\n"0","1.5"\n"1","-2"\n"2","3"\n',
        "Recorder: 5\n\nt [s],a1 [g],\n0,1.5,\n1,-2,\n2,3,\n",
    ],
    ids=["quoted", "ended by commas"],
)
def test_numbers_in_quotes_and_commas_at_the_end_of_lines_are_read(text: str, tmp_path: Path) -> None:
    found = load_history(written(tmp_path / "h.csv", text))
    assert {name: values.tolist() for name, values in found.channels.items()} == {
        "a1": pytest.approx([9.80665 * v for v in (1.5, -2.0, 3.0)])
    }


def test_the_line_above_the_numbers_is_named_where_no_heading_is_one(tmp_path: Path) -> None:
    path = written(tmp_path / "h.csv", "Recorder: 5\n\nsample,a1\n1,2\n2,3\n3,4\n")
    assert refusal(path) == f'{path} line 3: columns "sample,a1"; {HEADED}'


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", ' line 1: columns ""; ' + HEADED),
        ("t,a1\n0,1\n", ' line 1: columns "t,a1"; ' + HEADED),
        ("time_s\n0\n", ' line 1: columns "time_s"; ' + HEADED),
        ("time_s,a1,a1\n0,1,2\n", ' line 1: column "a1" a second time; must be once'),
        ("time_s,a1\n", ": no samples; must have one row per sample"),
        ("time_s,a1\n0,1\n1,x\n", ' line 3: a1 = "x"; must be a finite number'),
        ("time_s,a1\n0,1\n1,nan\n", ' line 3: a1 = "nan"; must be a finite number'),
        ("time_s,a1\n0,1\n1,\n", ' line 3: a1 = ""; must be a finite number'),
        ("time_s,a1\n0,1\n1,2,3\n", " line 3: 3 entries; must have 2"),
        ("time_s,a1\n0,1\n1\n", " line 3: 1 entries; must have 2"),
        ("time_s,a1\n0,1\n1,2\n", ": 2 samples; must have at least 3"),
        (
            "time_s,a1\n0,1\n1,2\n1,3\n",
            ": time is 1 s at sample 3 after 1 s; must increase, with more digits than it has",
        ),
    ],
)
def test_a_bad_csv_is_refused_in_one_line(text: str, line: str, tmp_path: Path) -> None:
    path = written(tmp_path / "h.csv", text)
    assert refusal(path) == f"{path}{line}"


def test_what_is_no_history_is_refused(tmp_path: Path) -> None:
    (tmp_path / "b.csv").write_bytes(b"time_s,\xff")
    folder = tmp_path / "d.csv"
    folder.mkdir()
    assert refusal(tmp_path / "no.csv") == f"{tmp_path / 'no.csv'}: no such file; must be a time history"
    assert refusal(folder) == f"{folder}: is a directory; must be a time history"
    assert refusal(tmp_path / "h.wav") == (
        f"{tmp_path / 'h.wav'}: not a time history; must end in .csv or .mat or .npz or .uff or .unv or .tdms"
    )
    assert refusal(tmp_path / "b.csv") == (
        f"{tmp_path / 'b.csv'}: cannot be read "
        "('utf-8' codec can't decode byte 0xff in position 7: invalid start byte); must be a time history (CSV)"
    )


def test_garbage_is_refused_by_every_reader(tmp_path: Path) -> None:
    for ending in ("mat", "uff", "tdms"):
        path = tmp_path / f"g.{ending}"
        path.write_bytes(bytes(range(256)) * 3)
        message = refusal(path)
        assert message.startswith(f"{path}: ")
        assert "; must " in message and "\n" not in message


@pytest.mark.parametrize(
    ("ending", "package"), [("mat", "pymatreader"), ("uff", "pyuff"), ("tdms", "nptdms"), ("", "sdypy_sep005")]
)
def test_a_missing_package_is_named(ending: str, package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    path = tmp_path / f"h.{ending}"
    path.write_bytes(HEADER_7_3 if ending == "mat" else b"")
    source: Any = path if ending else [{"name": "a1"}]
    where = path if ending else "SEP005"
    assert refusal(source) == f"{where}: needs {package}; install it with: pip install 'casadi-hbm[io]'"


# ------------------------------------------------------------------------------------------------------------------ MAT


@pytest.mark.parametrize("time", [{"time_s": TIME}, {"t": TIME[:, None]}, {"fs": RATE}])
def test_mat_of_scipy(time: dict[str, Any], tmp_path: Path) -> None:
    savemat(tmp_path / "h.mat", {**time, "force": FORCE, "a1": A1[:, None], "units": {"a1": "g"}, "note": "run 3"})
    found = load_history(tmp_path / "h.mat")
    assert_read(found, 9.80665)
    assert found.units["a1"] == "m/s2"


@pytest.mark.parametrize("version", ["4", "5"])
def test_mat_of_scipy_needs_no_other_package(version: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pymatreader", None)
    said: dict[str, Any] = {"units": {"a1": "g", "force": ""}} if version == "5" else {}
    content = {"t": TIME[:, None], "force": FORCE, "a1": A1[:, None], "note": "run 3", **said}
    savemat(tmp_path / "h.mat", content, format=version)
    assert_read(load_history(tmp_path / "h.mat"), 9.80665 if said else 1.0)


def test_mat_of_version_7_3(tmp_path: Path) -> None:
    """As MATLAB writes it: HDF5 behind a header of 512 bytes, columns first."""
    path = tmp_path / "h.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in {"time": TIME, "force": FORCE, "a1": A1}.items():
            file.create_dataset(name, data=values[None, :]).attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as file:
        file.write(HEADER_7_3)
    found = load_history(path, {"force": "force", "a1": "a1"})
    assert_read(found)


@pytest.mark.parametrize(
    ("content", "line"),
    [
        ({"fs": RATE}, "no vectors; must have time_s, time, t or a scalar fs, and one vector per channel"),
        ({"a1": A1}, "no time; must have a vector time_s, time, t, or a scalar fs or sampling_hz > 0 [Hz]"),
        ({"a1": A1, "fs": -1.0}, "no time; must have a vector time_s, time, t, or a scalar fs or sampling_hz > 0 [Hz]"),
        ({"time": TIME}, "no channel; must have time and at least one channel"),
        ({"time": TIME, "a1": A1[:-1]}, "a1 has 299 samples, time has 300; must have as many"),
        ({"time": TIME, "a1": np.ones((300, 2))}, "a1 is 300 x 2; must be one number per sample"),
        ({"fs": RATE, "a1": A1 + 1j}, "a1 is complex; must be one real number per sample"),
        (
            {"fs": RATE * 1j, "a1": A1},
            "no time; must have a vector time_s, time, t, or a scalar fs or sampling_hz > 0 [Hz]",
        ),
        ({"time": TIME, "a1": np.where(TIME == 0.0, np.inf, A1)}, "a1 is inf at sample 1; must be a finite number"),
        (
            {"time": TIME, "a1": A1, "units": {"a1": "V"}},
            'unit of a1 is "V"; must be one of N, kN, mN, lbf, m/s2, mm/s2, g, mg, m/s, mm/s, in/s, m, mm, um, nm, in; '
            'volts of a sensor with its sensitivity, as "mV at 100 mV/g"',
        ),
    ],
)
def test_a_bad_mat_is_refused(content: dict[str, Any], line: str, tmp_path: Path) -> None:
    path = tmp_path / "h.mat"
    savemat(path, content)
    assert refusal(path) == f"{path}: {line}"


# ---------------------------------------------------------------------------------------------------------------- UFF58


def response(name: str, node: int, data: Any, **fields: Any) -> dict[str, Any]:
    return {
        **{"type": 58, "func_type": 1, "rsp_ent_name": name, "rsp_node": node, "rsp_dir": -2, "ref_ent_name": "NONE"},
        **{"ref_node": 0, "ref_dir": 0, "x": TIME, "data": data, "abscissa_spacing": 1},
        **{"orddenom_spec_data_type": 0, "abscissa_spec_data_type": 17, **fields},
    }


def uff(path: Path, *sets: dict[str, Any]) -> Path:
    path.unlink(missing_ok=True)
    pyuff.UFF(str(path)).write_sets(list(sets), "add")  # pyuff 2.5 loses the header of a binary set it overwrites with
    return path


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # pyuff leaves files open as it writes
@pytest.mark.parametrize("binary", [0, 1])
def test_uff_of_pyuff(binary: int, tmp_path: Path) -> None:
    """Units by label; 12 digits of the values in text, all in binary. 1/2048 s has more digits than the format."""
    path = uff(
        tmp_path / "h.uff",
        response("force", 1, FORCE, ordinate_axis_units_lab="N", binary=binary),
        response("a1", 2, 1e3 * A1, ordinate_axis_units_lab="mm/s^2", binary=binary),
    )
    assert_read(load_history(path), rel=1e-10)


def test_uff_without_names_is_named_by_node_and_direction(tmp_path: Path) -> None:
    """Data set 164: millimetres and newtons; 1000 of its units are a metre."""
    system = {
        **{"type": 164, "units_code": 5, "units_description": "mm", "temp_mode": 1},
        **{"length": 1000.0, "force": 1.0, "temp": 1.0, "temp_offset": 273.15},
    }
    path = uff(
        tmp_path / "h.unv",
        system,
        response("NONE", 7, FORCE, ordinate_spec_data_type=13),
        response("NONE", 9, 1e3 * A1, ordinate_spec_data_type=12, rsp_dir=3),
        {**response("NONE", 9, np.ones(4, dtype=complex)), "func_type": 4, "x": np.arange(4.0)},
    )
    found = load_history(path)
    assert dict(found.units) == {"7-Y": "N", "9+Z": "m/s2"}
    assert_read(load_history(path, {"force": "7-Y", "a1": "9+Z"}), rel=1e-10)


def test_a_bad_uff_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "h.uff"
    uff(path, response("a", 1, FORCE, func_type=4))
    assert refusal(path) == f"{path}: no time response; must have data sets 58 of function type 1"
    uff(path, response("a", 1, FORCE), response("b", 2, A1[:-1]))
    assert refusal(path) == f"{path}: b has 299 samples, the first channel 300; must have as many"
    uff(path, response("a", 1, FORCE), response("b", 2, A1, x=2.0 * TIME))
    assert refusal(path) == f"{path}: b is sampled at other times than the first channel; must be at the same"
    uff(path, response("a", 1, FORCE), response("a", 1, A1))
    assert refusal(path) == f'{path}: channel "1-Y" a second time; must be once'


# ----------------------------------------------------------------------------------------------------------------- TDMS


def tdms(path: Path, **channels: tuple[Any, dict[str, Any]]) -> Path:
    objects = [nptdms.ChannelObject("run", name, data, properties) for name, (data, properties) in channels.items()]
    with nptdms.TdmsWriter(str(path)) as writer:
        writer.write_segment(objects)
    return path


def test_tdms_of_nptdms(tmp_path: Path) -> None:
    step = {"wf_increment": 1.0 / RATE, "wf_start_offset": 0.0}
    path = tdms(
        tmp_path / "h.tdms",
        force=(FORCE / 4.4482216152605, {**step, "unit_string": "lbf"}),
        a1=(A1, {**step, "unit_string": "m/s^2"}),
    )
    found = load_history(path)
    assert_read(found)
    assert dict(found.units) == {"force": "N", "a1": "m/s2"}


def test_tdms_with_a_channel_of_time(tmp_path: Path) -> None:
    assert_read(load_history(tdms(tmp_path / "h.tdms", time_s=(TIME, {}), force=(FORCE, {}), a1=(A1, {}))))


def test_a_bad_tdms_is_refused(tmp_path: Path) -> None:
    path, step = tmp_path / "h.tdms", {"wf_increment": 1.0 / RATE}
    tdms(path, force=(FORCE, {}))
    assert refusal(path) == f"{path}: force has no wf_increment; must have it, or a channel time_s or time or t"
    tdms(path, force=(FORCE, step), a1=(A1[::2], {"wf_increment": 2.0 / RATE}))
    assert refusal(path) == f"{path}: a1 has 150 samples, the first channel 300; must have as many"


# --------------------------------------------------------------------------------------------------------------- SEP005


@pytest.mark.parametrize("time", [{"fs": RATE}, {"time": TIME}])
def test_sep005(time: dict[str, Any]) -> None:
    found = load_history(
        [
            {"name": "force", "data": FORCE, "unit_str": "N", **time},
            {"name": "a1", "data": A1 / 9.80665, "unit_str": "g", **time},
        ]
    )
    assert_read(found)
    assert (found.source, found.units["a1"]) == ("SEP005", "m/s2")


MILLIVOLTS = A1 / 9.80665 * 100.0
"""Of an accelerometer of 100 mV/g, which is 10.1972 mV/(m/s2)."""


@pytest.mark.parametrize(
    ("said", "given", "volts"),
    [
        ("mV at 100 mV/g", {}, MILLIVOLTS),
        ("mV", {"a1": "100 mV/g"}, MILLIVOLTS),
        ("mV", {"a1": "0.1 V/g"}, MILLIVOLTS),
        ("", {"a1": "10.197162129779283 mV/(m/s2)"}, 1e-3 * MILLIVOLTS),
        ("", {"a1": "mV at 1e2 mV/g"}, MILLIVOLTS),
    ],
)
def test_volts_are_read_by_the_sensitivity_of_their_sensor(
    said: str, given: dict[str, str], volts: np.ndarray, tmp_path: Path
) -> None:
    """In the file, or in a manifest beside it; a file that says nothing has volts."""
    heading = f"a1 ({said})" if said else "a1"
    rows = "\n".join(
        f"{t!r},{f!r},{a!r}" for t, f, a in zip(TIME.tolist(), FORCE.tolist(), volts.tolist(), strict=True)
    )
    found = load_history(written(tmp_path / "h.csv", f"time_s,force,{heading}\n{rows}\n"), units=given)
    assert_read(found)
    assert found.units["a1"] == "m/s2"


@pytest.mark.parametrize(
    ("said", "given", "line"),
    [
        ("mV", "0 mV/g", 'unit of a1 is "mV at 0 mV/g"; its sensitivity must be > 0'),
        ("g", "100 mV/g", "a1 is in g in the file; must not be given as 100 mV/g"),
        ("mV", "100 mV/bar", 'unit of a1 is "bar"; must be one of N, kN'),
        ("mV", "100 pC/g", "a1 is in mV in the file; must not be given as 100 pC/g"),
    ],
)
def test_a_sensitivity_that_does_not_fit_is_refused(said: str, given: str, line: str) -> None:
    entry = {"name": "a1", "data": A1, "unit_str": said, "fs": RATE}
    assert refusal([entry], units={"a1": given}).startswith(f"SEP005: {line}")


@pytest.mark.parametrize("unit", ["µm", "μm", "um"])
def test_micrometres_are_written_in_three_ways(unit: str) -> None:
    found = load_history([{"name": "y", "data": A1, "unit_str": unit, "fs": RATE}])
    np.testing.assert_allclose(found.channels["y"], 1e-6 * A1)


@pytest.mark.parametrize(
    ("entry", "line"),
    [
        (
            {"data": A1, "unit_str": "g", "fs": RATE},
            "SEP005 channel 2: name: Field required; must be a channel of SEP005",
        ),
        (
            {"name": "a1", "data": A1, "unit_str": "g"},
            "SEP005 channel 2: Value error, Must provide either 'time' or 'fs' to replicate time information "
            "(SEP-005 requirement); must be a channel of SEP005",
        ),
        (
            {"name": "a1", "data": A1[1:], "unit_str": "g", "fs": RATE},
            "SEP005: a1 has 299 samples, the first channel 300; must have as many",
        ),
        (
            {"name": "force", "data": A1, "unit_str": "g", "fs": RATE},
            'SEP005: channel "force" a second time; must be once',
        ),
        (
            {"name": "a1", "data": A1, "unit_str": "bar", "fs": RATE},
            'SEP005: unit of a1 is "bar"; must be one of '
            "N, kN, mN, lbf, m/s2, mm/s2, g, mg, m/s, mm/s, in/s, m, mm, um, nm, in",
        ),
    ],
)
def test_a_bad_sep005_is_refused(entry: dict[str, Any], line: str) -> None:
    assert refusal([{"name": "force", "data": FORCE, "unit_str": "N", "fs": RATE}, entry]) == line


def test_a_numpy_archive_with_several_clocks(tmp_path: Path) -> None:
    """``time_s`` among the channels names the one of the channels asked for."""
    t, later = np.linspace(0.0, 1.0, 11), np.linspace(2.0, 4.0, 7)
    np.savez(tmp_path / "h.npz", up_time_s=t, up_force=np.sin(t), down_time_s=later, down_force=np.cos(later))
    found = load_history(tmp_path / "h.npz", {"time_s": "down_time_s", "force": "down_force"})
    assert (found.time.tolist(), found.channels["force"].tolist()) == (later.tolist(), np.cos(later).tolist())
    with pytest.raises(InputError, match="no time; must have a vector time_s, time, t, or a scalar fs or sampling_hz"):
        load_history(tmp_path / "h.npz", {"force": "down_force"})
    with pytest.raises(InputError, match='no vector "when" of times; vectors are up_time_s, up_force, '):
        load_history(tmp_path / "h.npz", {"time_s": "when", "force": "down_force"})


def test_a_numpy_archive_with_a_rate(tmp_path: Path) -> None:
    np.savez(tmp_path / "h.npz", v1=np.arange(4.0), sampling_hz=np.array(8.0))
    assert load_history(tmp_path / "h.npz").time.tolist() == [0.0, 0.125, 0.25, 0.375]
    np.savez(tmp_path / "h.npz", v1=np.arange(4.0) * 1j, sampling_hz=np.array(8.0))
    assert refusal(tmp_path / "h.npz") == f"{tmp_path / 'h.npz'}: v1 is complex; must be one real number per sample"
