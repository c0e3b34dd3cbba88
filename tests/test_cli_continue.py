"""``hbm continue``: files, table, refusals."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from hbm.cli import app
from hbm.errors import InputError
from hbm.files.parameterfiles import read_parameter_curve
from hbm.rigfiles.load import load_rig
from hbm.tracking.parameterresponse import parameter_response

RIG = str(Path(__file__).parents[1] / "examples" / "paper_beam.toml")
MU = ("--parameter", "contact.friction.mu", "--from", "0.5", "--to", "0.55", "--frequency", "51", "--harmonics", "3")


def run(*args: str) -> Result:
    return CliRunner().invoke(app, ["continue", *args], prog_name="hbm")


def test_the_file_holds_the_curve_and_what_it_is_along(tmp_path: Path) -> None:
    out, plot = tmp_path / "mu.csv", tmp_path / "mu.png"
    said = run(RIG, *MU, "--out", str(out), "--plot", str(plot))
    assert said.exit_code == 0, said.stderr
    assert plot.read_bytes().startswith(b"\x89PNG")
    found = read_parameter_curve(out)
    curve = parameter_response(load_rig(RIG), "contact.friction.mu", (0.5, 0.55), hz=51.0, harmonics=3)
    assert (found.parameter, found.unit) == ("contact.friction.mu", "1")
    np.testing.assert_array_equal(found.values, curve.values)
    np.testing.assert_array_equal(found.curve.hz, 51.0)
    for name, channel in curve.channels.items():
        np.testing.assert_array_equal(found.curve[name].coefficients, channel.coefficients)
        np.testing.assert_array_equal(found.curve[name].peak, channel.peak)
        assert found.curve[name].unit == channel.unit
    assert found.curve.summary["folds"] == curve.folds
    assert "51 Hz and 6.5 N" in said.stdout


def test_force_as_the_parameter_fills_its_column(tmp_path: Path) -> None:
    out = tmp_path / "force.csv"
    options = ("--parameter", "excitation.amplitude", "--from", "2", "--to", "1", "--frequency", "51")
    assert run(RIG, *options, "--harmonics", "3", "--out", str(out)).exit_code == 0
    rows = [line.split(",") for line in out.read_text(encoding="utf-8").splitlines()]
    assert rows[0][:9] == ["point", "level", "frequency_hz", "stable", "channel", "peak", "rms", "parameter", "h0"]
    assert [(row[1], row[7]) for row in (rows[1], rows[-1])] == [("2.0", "2.0"), ("1.0", "1.0")]


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("--parameter", "contact.friction.nu", *MU[2:]), "continue: contact.friction.nu is not a number of the rig"),
        ((*MU[:3], "x", *MU[4:]), 'continue: --from = "x"; must be a number'),
        ((*MU[:3], "0", *MU[4:]), "continue: contact.friction.mu = 0; must be > 0"),
        ((*MU[:6], *MU[8:]), "continue: contact.friction.mu: no frequency; must be given unless"),
        ((*MU[:7], "-1", *MU[8:]), "continue: --frequency = -1; must be a number > 0 [Hz]"),
        ((*MU[:9], "0"), "continue: --harmonics = 0; must be auto or a whole number from 1 to 200"),
        ((*MU, "--out", "mu.txt"), 'continue: --out = "mu.txt"; must end in .csv'),
    ],
)
def test_bad_input_is_one_line_and_status_2(args: tuple[str, ...], message: str) -> None:
    said = run(RIG, *args)
    assert said.exit_code == 2
    assert message in said.stderr
    assert len(said.stderr.splitlines()) == 1


def test_another_file_is_refused(tmp_path: Path) -> None:
    other = tmp_path / "other.csv"
    other.write_text("point,level\n1,2\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"line 1: 'point,level'; must be point,level,.*,rms,h0"):
        read_parameter_curve(other)
