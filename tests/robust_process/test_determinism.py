"""The same commands twice, with one thread on one core and with two on two: the same files, byte for byte."""

import json
import os
import subprocess
import sys
from pathlib import Path

EXAMPLES = Path(__file__).parents[2] / "examples"
MEASURED = ["rig.toml", "spectra.csv"]
RECORDS = 4
"""Of the measurement, so many are read: what depends on threads does so in the first ones too."""

FREQUENCIES = ["--from", "44", "--to", "46", "--harmonics", "3"]
COMMANDS = {
    "frf of joints": ["frf", str(EXAMPLES / "jointed_beam.toml"), *FREQUENCIES, "--no-stability", "--out", "a.csv"],
    "frf": ["frf", str(EXAMPLES / "paper_beam.toml"), *FREQUENCIES, "--out", "a.csv", "--plot", "a.png"],
    "inverse": ["inverse", *MEASURED, "--out", "out"],
    "identify": ["identify", *MEASURED, "--law", "coulomb-penalty", "--out", "out"],
    "diagnose": ["diagnose", *MEASURED, "--cause", "added-mass", "--out", "out"],
}
RUN = """
import json, os, sys
from hbm.cli import main
for folder, arguments in json.loads(sys.argv[1]).items():
    os.chdir(folder)
    sys.argv = ["hbm", *arguments]
    try:
        main()
    except SystemExit as ended:
        if ended.code:
            sys.exit(f"{folder}: exit status {ended.code}")
"""
"""One process for all commands, each in a folder of its own: most of what each takes is to start."""


def bound_to(cores: int) -> None:
    """Let this process run on so many cores, where there are as many: workers follow their number."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:cores])


def results(threads: int, folder: Path) -> dict[str, bytes]:
    """Files that the commands write, by their names, which begin with the command's."""
    measured = EXAMPLES / "measured_beam"
    head, *rows = (measured / "spectra.csv").read_text().splitlines()
    few = [row for row in rows if int(row.partition(",")[0]) <= RECORDS]
    for command in COMMANDS:
        (folder / command).mkdir(parents=True)
        (folder / command / "spectra.csv").write_text("\n".join([head, *few]) + "\n")
        (folder / command / "rig.toml").write_text((measured / "rig.toml").read_text())
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": str(threads), "OMP_NUM_THREADS": str(threads)}
    ran = subprocess.run(
        [sys.executable, "-c", RUN, json.dumps({str(folder / name): COMMANDS[name] for name in COMMANDS})],
        env=environment,
        capture_output=True,
        text=True,
        preexec_fn=lambda: bound_to(threads),
    )
    assert ran.returncode == 0, ran.stderr
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_the_same_files_whatever_the_threads(tmp_path: Path) -> None:
    one, two = (results(threads, tmp_path / str(threads)) for threads in (1, 2))
    assert one.keys() == two.keys()
    for command in COMMANDS:
        assert {f"{command}/{name}" for name in MEASURED} < {name for name in one if name.startswith(f"{command}/")}
    dated = {name for name in one if name.endswith(".mat")}  # MATLAB's header has the time
    assert {name for name in one if one[name] != two[name]} <= dated
