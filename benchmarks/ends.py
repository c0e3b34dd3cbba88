"""How runs end: every law on every rig at every level, with what each takes.

    python benchmarks/ends.py [--rigs paper_beam one_mode jointed_beam] [--levels 0.5 6.5 20]

Each run is a command in a process of its own. A curve must end by itself within a minute, and within 1 GB.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from rich.console import Console
from rich.table import Table

from hbm.rigfiles.lawchoice import known_law
from models.friction import LAWS

EXAMPLES = Path(__file__).parents[1] / "examples"
COMMAND = [sys.executable, "-m", "hbm.cli"]
SWEEP = ["--from", "30", "--to", "80", "--no-stability"]
CONSOLE = Console(width=130)


def curve(arguments: list[str]) -> tuple[float, float, str]:
    """Seconds of one core, largest memory [MB], and how a command ended."""
    with tempfile.TemporaryDirectory() as folder:
        run = subprocess.Popen([*COMMAND, *arguments], cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        said = run.stderr.read().decode() if run.stderr else ""
        _, status, used = os.wait4(run.pid, 0)
    ended = os.waitstatus_to_exitcode(status)
    last = said.strip().splitlines()[-1] if said.strip() else ""
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1024, "complete" if ended == 0 else f"{ended}: {last[:300]}"


def curves(rigs: list[str], levels: list[str]) -> None:
    """Print every law's longest and largest run on every rig."""
    table = Table("rig", "law", "level N", "CPU s", "MB", "end")
    for rig in rigs:
        path = str(EXAMPLES / f"{rig}.toml")
        for law in ["its own"] if rig == "jointed_beam" else LAWS:
            if law in LAWS and known_law(LAWS[law]) is None:
                continue  # a law of rig files alone, no parameters of it are published
            for level in levels:
                chosen = [] if law == "its own" else ["--law", law]
                seconds, size, end = curve(["frf", path, *SWEEP, *chosen, "--level", level])
                table.add_row(rig, law, level, f"{seconds:.1f}", f"{size:.0f}", end)
                print(rig, law, level, f"{seconds:.1f} s {size:.0f} MB {end}", file=sys.stderr, flush=True)
    CONSOLE.print(table)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", nargs="+", default=["paper_beam", "one_mode", "jointed_beam"])
    parser.add_argument("--levels", nargs="+", default=["0.5", "6.5", "20"])
    given = parser.parse_args()
    curves(given.rigs, given.levels)
    CONSOLE.print(f"{resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime:.0f} s of CPU in all")
