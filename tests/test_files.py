"""Result files: every field of the contract, complete or not at all, and back again."""

import csv
import json
import os
import stat
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import hbm
from hbm.commands.deliver import write_result
from hbm.errors import InputError
from hbm.files.curves import companion, curve_contents, read_curves, write_curves, write_history
from hbm.integration.history import TimeHistory
from hbm.integration.integrate import simulate
from hbm.response.accuracy import frequency_response
from hbm.response.curve import ResponseCurve
from hbm.response.trace import force_response
from hbm.rigfiles.load import load_rig
from hbm.stability.multipliers import Stability
from hbm.textfiles import check_output, write_together
from hbm.tracking.parameterresponse import parameter_response

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.fixture(scope="module")
def curves() -> list[ResponseCurve]:
    """Two levels of the paper's beam, of different H, where it sticks."""
    rig = load_rig(EXAMPLES / "paper_beam.toml")
    return [
        frequency_response(rig, (40.0, 40.5), level=2.0, harmonics=3),
        frequency_response(rig, (40.0, 40.5), level=4.0, harmonics=5),
    ]


@pytest.fixture(scope="module")
def history() -> TimeHistory:
    return simulate(load_rig(EXAMPLES / "paper_beam.toml"), 50.0, duration=0.04, steps_per_period=64)


@pytest.fixture
def written(curves: list[ResponseCurve], tmp_path: Path) -> Path:
    write_curves(tmp_path / "curves.csv", curves)
    return tmp_path / "curves.csv"


def test_heading_is_the_contract(written: Path) -> None:
    heading = written.read_text().splitlines()[0]
    harmonics = ",".join(f"h{k}_cos,h{k}_sin" for k in range(1, 6))
    assert heading == f"point,level,frequency_hz,stable,channel,peak,rms,h0,{harmonics}"


def test_every_field_is_the_curves_to_the_last_bit(written: Path, curves: list[ResponseCurve]) -> None:
    with written.open(newline="") as file:
        rows = list(csv.DictReader(file))
    at = 0
    for c in curves:
        for i, point in enumerate(c.points):
            for name in (*(f.name for f in c.rig.channels), *c.rig.computed):
                row = rows[at]
                at += 1
                assert (int(row["point"]), row["channel"], row["stable"]) == (i + 1, name, "")
                assert float(row["level"]) == c.level
                assert float(row["frequency_hz"]) == point.hz
                assert float(row["peak"]) == c[name].peak[i]
                assert float(row["rms"]) == c[name].rms[i]
                a = point.channels[name].coefficients
                H = len(a) // 2
                assert float(row["h0"]) == a[0]
                for k in range(1, 6):
                    pair = (row[f"h{k}_cos"], row[f"h{k}_sin"])
                    assert pair == ("", "") if k > H else tuple(map(float, pair)) == (a[k], a[H + k])
    assert at == len(rows)


def test_peak_of_slip_has_no_mean_and_peak_of_normal_is_the_maximum(written: Path, curves: list[ResponseCurve]) -> None:
    saved = read_curves(written)[1]
    last = curves[1].points[-1].channels
    slip, normal = last["slip"].samples, last["normal"].samples
    assert saved["slip"].peak[-1] == np.abs(slip - slip.mean()).max()
    assert saved["normal"].peak[-1] == normal.max()


def test_curves_come_back_bit_by_bit(written: Path, curves: list[ResponseCurve]) -> None:
    saved = read_curves(written)
    assert [s.level for s in saved] == [2.0, 4.0]
    for s, c in zip(saved, curves, strict=True):
        assert np.array_equal(s.hz, c.hz)
        assert np.isnan(s.stable).all()
        assert list(s.channels) == list(c.channels)
        for name, channel in c.channels.items():
            assert s[name].unit == channel.unit
            for part in ("coefficients", "peak", "rms"):
                assert np.array_equal(getattr(s[name], part), getattr(channel, part))


def test_stability_is_written_where_a_curve_knows_it(curves: list[ResponseCurve], tmp_path: Path) -> None:
    known = np.arange(len(curves[0].points)) % 2
    stability = tuple(Stability(np.array([0.5 if s else 2.0], dtype=complex), 0.02) for s in known)
    doubtful = np.arange(len(known)) < 2
    write_curves(tmp_path / "c.csv", [replace(curves[0], stability=stability, doubtful=doubtful)])
    found = read_curves(tmp_path / "c.csv")[0].stable
    assert np.isnan(found[:2]).all()
    assert np.array_equal(found[2:], known[2:])


def test_companion_says_what_the_table_cannot(written: Path, curves: list[ResponseCurve]) -> None:
    said = json.loads(companion(written).read_text(), parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
    assert (said["schema"], said["version"]) == (1, hbm.__version__)
    assert (said["rig"], said["law"]) == ("clamped-supported beam, Table 1", "coulomb-penalty")
    assert said["units"]["drive"] == "m"
    for level, c in zip(said["levels"], curves, strict=True):
        assert level["level"] == c.level
        assert (level["points"], level["harmonics"]) == (len(c.points), c.basis.H)
        assert (level["samples"], level["modes"]) == (256, 5)
        assert (level["complete"], level["message"]) == (True, c.branch.message)
        assert (level["reason"], level["warnings"]) == (c.assessment.reason, list(c.assessment.warnings))
        assert level["numerical_error"]["at_peak"]["total"] == c.assessment.error.at_peak.total
        assert [p["hz"] for p in level["numerical_error"]["probes"]] == [p.hz for p in c.assessment.error.probes]
        assert level["numerical_error"]["closure"] == c.assessment.error.closure
        assert level["energy_error"] == max(abs(p.energy_error) for p in c.points)
        assert (level["folds_hz"], level["corners_hz"]) == (c.folds, c.corners)
        assert level["lift_off_hz"] == []
    assert read_curves(written)[0].summary == said["levels"][0]


def test_an_unknown_number_is_null(curves: list[ResponseCurve], tmp_path: Path) -> None:
    known = curves[0].assessment
    error = replace(known.error, at_peak=replace(known.error.at_peak, modes=float("nan")))
    write_curves(tmp_path / "c.csv", [replace(curves[0], assessment=replace(known, error=error))])
    said = json.loads((tmp_path / "c.json").read_text())
    assert said["levels"][0]["numerical_error"]["at_peak"]["modes"] is None


def test_a_curve_file_is_read_without_its_companion(written: Path) -> None:
    companion(written).unlink()
    saved = read_curves(written)
    assert (saved[0]["drive"].unit, saved[0].summary) == ("", {})


def test_curves_along_the_force_or_a_number_have_it_at_every_point(curves: list[ResponseCurve], tmp_path: Path) -> None:
    rig, path = curves[0].rig, tmp_path / "c.csv"
    swept = [force_response(rig, hz, (3.0, 1.0), harmonics=H) for hz, H in ((40.0, 3), (41.0, 5))]
    write_curves(path, swept)
    for found, c in zip(read_curves(path), swept, strict=True):
        assert (found.parameter, found.unit, found.level) == ("excitation.amplitude", "N", 3.0)
        np.testing.assert_array_equal(found.values, [p.level for p in c.points])
        np.testing.assert_array_equal(found["drive"].coefficients, c["drive"].coefficients)
        assert found.summary["folds"] == c.folds and "folds_hz" not in found.summary
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["level"] for row in rows} == {str(p.level) for c in swept for p in c.points}
    along = parameter_response(rig, "contact.friction.mu", (0.5, 0.55), hz=40.0, harmonics=3)
    write_curves(path, along)
    (found,) = read_curves(path)
    assert (found.parameter, found.unit, found.level) == ("contact.friction.mu", "1", along.level)
    np.testing.assert_array_equal(found.values, along.values)
    with pytest.raises(
        InputError, match=r"curves along excitation\.amplitude, frequency_hz; must all be along the same"
    ):
        write_curves(path, [curves[0], swept[0]])


def test_curves_of_one_level_stay_apart(curves: list[ResponseCurve], tmp_path: Path) -> None:
    """As a sweep and a detached curve are."""
    path, first = tmp_path / "c.csv", curves[0]
    begun = replace(first, points=first.points[:3], branch=replace(first.branch, points=first.branch.points[:3]))
    write_curves(path, [begun, first])
    assert [len(c.hz) for c in read_curves(path)] == [3, len(first.points)]
    assert [c.summary["points"] for c in read_curves(path)] == [3, len(first.points)]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "time_s,force\n0.0,1.0\n",
            "line 1: 'time_s,force'; must be point,level,frequency_hz,stable,channel,peak,rms,h0,h1_cos,h1_sin,...",
        ),
        ("{head}\n1,2.0,50.0,,drive,1.0,1.0,0.0,1.0\n", "line 2: 9 entries; must have 10"),
        (
            "{head}\n1,2.0,x,,drive,1.0,1.0,0.0,1.0,0.0\n",
            "line 2: could not convert string to float: 'x'; must be a number",
        ),
    ],
)
def test_what_is_not_a_curve_file_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "c.csv"
    path.write_text(text.format(head="point,level,frequency_hz,stable,channel,peak,rms,h0,h1_cos,h1_sin"))
    with pytest.raises(InputError) as refused:
        read_curves(path)
    assert str(refused.value) == f"{path} {message}"


def test_a_missing_curve_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"c\.csv: cannot be read \(no such file or directory\); must be a curve file"):
        read_curves(tmp_path / "c.csv")


def test_history_has_time_and_the_rigs_channels(history: TimeHistory, tmp_path: Path) -> None:
    write_history(tmp_path / "h.csv", history)
    names = [c.name for c in history.rig.channels]
    assert (tmp_path / "h.csv").read_text().splitlines()[0] == ",".join(["time_s", *names])
    table = np.loadtxt(tmp_path / "h.csv", delimiter=",", skiprows=1)
    assert np.array_equal(table[:, 0], history.time)
    for column, name in zip(table[:, 1:].T, names, strict=True):
        assert np.array_equal(column, history.channels[name].values)


def test_history_adds_the_contact_where_asked(history: TimeHistory, tmp_path: Path) -> None:
    write_history(tmp_path / "h.csv", history, contact=True)
    heading = (tmp_path / "h.csv").read_text().splitlines()[0].split(",")
    assert heading == ["time_s", *(c.name for c in history.rig.channels), *history.rig.computed]


def drawn() -> Any:
    return Figure().subplots(1, 1, squeeze=False)


@pytest.mark.parametrize(("ending", "magic"), [("png", b"\x89PNG"), ("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_a_figure_is_what_its_ending_says(tmp_path: Path, ending: str, magic: bytes) -> None:
    assert write_result({}, tmp_path / f"f.{ending}", drawn) == [tmp_path / f"f.{ending}"]
    assert (tmp_path / f"f.{ending}").read_bytes().startswith(magic)


# ---------------------------------------------------------------------------------------------- complete or not at all


def test_nothing_is_left_when_the_second_file_cannot_be_placed(
    curves: list[ResponseCurve], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = os.replace

    def full(source: Path, target: Path) -> None:
        if Path(target).suffix == ".json":
            raise OSError(28, "No space left on device", str(source), None, str(target))
        place(source, target)

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(InputError) as refused:
        write_curves(tmp_path / "c.csv", curves)
    assert str(refused.value) == (
        f"{tmp_path / 'c.json'}: cannot be written (no space left on device); must be a file in a writable directory"
    )
    assert list(tmp_path.iterdir()) == []


def test_no_table_is_left_without_its_figure(curves: list[ResponseCurve], tmp_path: Path) -> None:
    def interrupted() -> Any:
        assert list(tmp_path.iterdir()) == []
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_result(curve_contents(tmp_path / "c.csv", curves), tmp_path / "c.png", interrupted)
    assert list(tmp_path.iterdir()) == []
    written = write_result(curve_contents(tmp_path / "c.csv", curves), tmp_path / "c.png", drawn)
    assert [file.name for file in written] == ["c.csv", "c.json", "c.png"]
    assert sorted(tmp_path.iterdir()) == sorted(written)


def test_nothing_is_left_when_interrupted(
    curves: list[ResponseCurve], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_curves(tmp_path / "c.csv", curves)
    assert list(tmp_path.iterdir()) == []


def test_the_old_file_survives_a_failure_before_it_is_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a").write_text("old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "chmod", full)
    with pytest.raises(InputError):
        write_together({tmp_path / "a": "new"})
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("a", "old")]


def test_no_curves_and_other_files_than_tables_are_refused(curves: list[ResponseCurve], tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^write_curves: curves is empty; must have one at least$"):
        write_curves(tmp_path / "c.csv", [])
    with pytest.raises(InputError, match=r"^write_curves: path = .*c\.txt\"; must end in \.csv$"):
        write_curves(tmp_path / "c.txt", curves)


def test_a_missing_directory_is_one_line(curves: list[ResponseCurve], tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        write_curves(tmp_path / "no" / "c.csv", curves)
    assert str(refused.value) == (
        f"{tmp_path / 'no' / 'c.csv'}: cannot be written (no such file or directory); "
        "must be a file in a writable directory"
    )


def test_files_have_the_rights_of_any_new_file(tmp_path: Path) -> None:
    (tmp_path / "plain").write_text("")
    write_together({tmp_path / "ours": ""})
    ours, plain = (stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("ours", "plain"))
    assert ours == plain


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("c.txt", 'c.txt"; must end in .csv'),
        ("c", 'c"; must end in .csv'),
        ("no/c.csv", "no/c.csv\"; there is no directory '{tmp}/no', create it first"),
        ("d.csv", 'd.csv"; is a directory, must be a file'),
    ],
)
def test_an_output_that_could_not_be_written_is_refused_beforehand(tmp_path: Path, name: str, found: str) -> None:
    (tmp_path / "d.csv").mkdir()
    with pytest.raises(InputError) as refused:
        check_output(tmp_path / name, (".csv",), "--out")
    assert str(refused.value) == f'--out = "{tmp_path}/{found.format(tmp=tmp_path)}'
