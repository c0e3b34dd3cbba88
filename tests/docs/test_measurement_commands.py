"""The commands of docs/validation/measurements.md, word for word, where the data are and as far as they are cheap."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import prose
import pytest

PAGE = (prose.ROOT / "docs" / "validation" / "measurements.md").read_text(encoding="utf-8")
DATA = prose.ROOT.parent / "shared" / "data"
RUN = "Double beam"
"""Run whole: about 40 s of CPU time."""

PREPARED = ("Brake-Reuss beam", "Forced")
"""Run up to the diagnosis."""

LEFT_OUT = {
    "Silverbox": "55 s of CPU time; a part of its records is in tests/diagnosis/test_measurements.py",
    "Beam in vacuum": "five minutes of CPU time",
    "Friction damper": "two minutes of CPU time",
    "Brake-Reuss beam": "its diagnosis takes a minute of CPU time",
    "Forced": "its two diagnoses take four minutes of CPU time",
    "F-16": "fifteen minutes on two cores",
}
"""Sections whose diagnosis is not run, and why."""


def sections() -> dict[str, str]:
    """Text of each section that has commands, by its heading."""
    parts = re.split(r"^##+ (.+)\n", PAGE, flags=re.M)
    return {name: text for name, text in zip(parts[1::2], parts[2::2], strict=True) if "```sh\n" in text}


def commands(section: str) -> list[str]:
    """Commands of a section as the page has them, one a line."""
    blocks = re.findall(r"^```sh\n(.*?)^```$", sections()[section], re.M | re.S)
    return re.sub(r"\\\n\s*", " ", "".join(blocks)).splitlines()


def run(lines: list[str], folder: Path) -> str:
    """What commands print, in a folder beside which the examples and DATA are."""
    if not DATA.is_dir():
        pytest.skip(f"the measurements of others are not at {DATA}")
    (folder / "examples").symlink_to(prose.ROOT / "examples")
    (folder / "DATA").symlink_to(DATA)
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = os.environ | {"PATH": path, "PYTHONPATH": str(prose.ROOT), "COLUMNS": "200"}
    environment.pop("PYTHONWARNINGS", None)
    done = subprocess.run(
        ["sh", "-e", "-c", "\n".join(lines)], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_command_is_run_or_left_out_for_a_reason() -> None:
    assert set(sections()) == {RUN, *LEFT_OUT}


@pytest.mark.slow
def test_the_command_says_what_the_page_says(tmp_path: Path) -> None:
    printed, page = run(commands(RUN), tmp_path), " ".join(sections()[RUN].split())
    (cause, beside), (held_out,) = (
        re.findall(r"Main cause: `([a-z-]+)`.*?; beside it `([a-z-]+)`", page)[0],
        re.findall(r"([\d.]+) % with both", page),
    )
    assert f"\nMain cause: {cause}, " in f"\n{printed}"
    assert f"beside it {beside} " in " ".join(printed.split())
    told = json.loads((tmp_path / "diagnosis" / "diagnosis.json").read_text())
    assert (told["verdict"], told["cause"]) == ("main-cause", cause)
    assert f"{100.0 * told['errors']['extended']['held_out']['nrmse']:.1f}" == held_out


@pytest.mark.slow
@pytest.mark.parametrize("section", PREPARED)
def test_what_comes_before_a_dear_diagnosis_writes_what_that_reads(section: str, tmp_path: Path) -> None:
    lines = commands(section)
    run([line for line in lines if not line.startswith("hbm diagnose")], tmp_path)
    read = {
        name for line in lines if line.startswith("hbm diagnose") for name in re.findall(r"\S+\.(?:csv|toml)", line)
    }
    assert read
    assert all((tmp_path / name).is_file() for name in read)
