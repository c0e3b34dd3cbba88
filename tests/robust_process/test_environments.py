"""Commands where there is no home, no Unicode, no colour, little width, and no terminal."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

PAPER = str(Path(__file__).parents[2] / "examples" / "paper_beam.toml")
PLAIN = {"LANG": "C", "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
ESCAPE = b"\x1b"


@pytest.mark.parametrize("arguments", [["modes", PAPER], ["laws", "stribeck"], ["frf", "--help"]], ids=lambda a: a[0])
@pytest.mark.parametrize(
    ("without", "given"),
    [
        (["HOME"], {}),
        ([], PLAIN),
        ([], {"NO_COLOR": "1"}),
        ([], {"COLUMNS": "40"}),
        (["HOME"], PLAIN | {"COLUMNS": "40"}),
    ],
    ids=["no home", "LANG=C", "NO_COLOR", "40 columns", "all"],
)
def test_a_command_says_all_and_fails_nowhere(
    without: list[str], given: dict[str, str], arguments: list[str], tmp_path: Path
) -> None:
    environment = {name: value for name, value in os.environ.items() if name not in without} | given
    done = subprocess.run(
        [sys.executable, "-m", "hbm.cli", *arguments], cwd=tmp_path, env=environment, capture_output=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert len(done.stdout) > 300
    assert ESCAPE not in done.stdout
    if "COLUMNS" in given and arguments[0] != "laws":  # its table has to be read whole, at any width
        lines = done.stdout.decode(errors="replace").splitlines()
        assert max(len(line) for line in lines if line.startswith((" ", "|", "+", "─", "╭", "│"))) <= 40


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="a folder of its own for fonts and settings is made elsewhere")
def test_figures_are_drawn_where_no_settings_can_be_kept(tmp_path: Path) -> None:
    environment = {name: value for name, value in os.environ.items() if name != "HOME"}
    run = ["laws", "stribeck", "--plot", "loops.png"]
    done = subprocess.run(
        [sys.executable, "-m", "hbm.cli", *run], cwd=tmp_path, env=environment, capture_output=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert (tmp_path / "loops.png").stat().st_size > 5000
