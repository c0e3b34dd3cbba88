"""The commands of docs/validation/measurements.md, word for word, where the data are and as far as they are cheap.

`python -m benchmarks.measurements` runs them all.
"""

import json
import re
import subprocess
from pathlib import Path

import pytest

from benchmarks.measurements import DATA, DIAGNOSIS, commands, run, sections

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
    "F-16": "twenty minutes on two cores",
}
"""Sections whose diagnosis is not run, and why."""


def printed_by(lines: list[str], folder: Path) -> str:
    if not DATA.is_dir():
        pytest.skip(f"the measurements of others are not at {DATA}")
    done = run(lines, folder)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_command_is_run_or_left_out_for_a_reason() -> None:
    assert set(sections()) == {RUN, *LEFT_OUT}


@pytest.mark.slow
def test_the_command_says_what_the_page_says(tmp_path: Path) -> None:
    printed, page = printed_by(commands(RUN), tmp_path), " ".join(sections()[RUN].split())
    (cause,), (stiffness,), (held_out,) = (
        re.findall(r"Main cause: `([a-z-]+)`", page),
        re.findall(r"an Iwan element of (\d+ ± \d+ N/m)", page),
        re.findall(r"([\d.]+) % with micro-slip", page),
    )
    assert f"\nMain cause: {cause}, " in f"\n{printed}"
    assert f"stiffness {stiffness}" in " ".join(printed.split())
    told = json.loads((tmp_path / "diagnosis" / "diagnosis.json").read_text())
    assert (told["verdict"], told["cause"]) == ("main-cause", cause)
    assert f"{100.0 * told['errors']['extended']['held_out']['nrmse']:.1f}" == held_out


@pytest.mark.parametrize("section", sections())
def test_each_line_is_a_command_of_its_own(section: str) -> None:
    for line in commands(section):  # the benchmark runs them in parts
        subprocess.run(["sh", "-n", "-c", line], check=True)


@pytest.mark.slow
@pytest.mark.parametrize("section", PREPARED)
def test_what_comes_before_a_dear_diagnosis_writes_what_that_reads(section: str, tmp_path: Path) -> None:
    lines = commands(section)
    printed_by([line for line in lines if not line.startswith(DIAGNOSIS)], tmp_path)
    read = {name for line in lines if line.startswith(DIAGNOSIS) for name in re.findall(r"\S+\.(?:csv|toml)", line)}
    assert read
    assert all((tmp_path / name).is_file() for name in read)
