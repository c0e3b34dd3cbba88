"""The same command twice, with one thread on one core and with two on two: the same files, byte for byte."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
MEASURED = ["rig.toml", "spectra.csv"]
RECORDS = 4
"""Of the measurement, so many are read: what depends on threads does so in the first ones too."""

FREQUENCIES = ["--from", "44", "--to", "46", "--harmonics", "3"]


def bound_to(cores: int) -> None:
    """Let this process run on so many cores, where there are as many: workers follow their number."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:cores])


def results(arguments: list[str], threads: int, folder: Path) -> dict[str, bytes]:
    """Files that a command writes, by their names."""
    folder.mkdir()
    measured = EXAMPLES / "measured_beam"
    head, *rows = (measured / "spectra.csv").read_text().splitlines()
    few = [row for row in rows if int(row.partition(",")[0]) <= RECORDS]
    (folder / "spectra.csv").write_text("\n".join([head, *few]) + "\n")
    (folder / "rig.toml").write_text((measured / "rig.toml").read_text())
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": str(threads), "OMP_NUM_THREADS": str(threads)}
    subprocess.run(
        [sys.executable, "-m", "hbm.cli", *arguments],
        cwd=folder,
        env=environment,
        check=True,
        capture_output=True,
        preexec_fn=lambda: bound_to(threads),
    )
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.mark.parametrize(
    "arguments",
    [
        ["frf", str(EXAMPLES / "jointed_beam.toml"), *FREQUENCIES, "--no-stability", "--out", "a.csv"],
        ["frf", str(EXAMPLES / "paper_beam.toml"), *FREQUENCIES, "--out", "a.csv", "--plot", "a.png"],
        ["inverse", *MEASURED, "--out", "out"],
        ["identify", *MEASURED, "--law", "coulomb-penalty", "--out", "out"],
        ["diagnose", *MEASURED, "--cause", "added-mass", "--out", "out"],
    ],
    ids=["frf of joints", "frf", "inverse", "identify", "diagnose"],
)
def test_the_same_files_whatever_the_threads(arguments: list[str], tmp_path: Path) -> None:
    one, two = (results(arguments, threads, tmp_path / str(threads)) for threads in (1, 2))
    assert one.keys() == two.keys()
    assert one
    dated = {name for name in one if name.endswith(".mat")}  # MATLAB's header has the time
    assert {name for name in one if one[name] != two[name]} <= dated
