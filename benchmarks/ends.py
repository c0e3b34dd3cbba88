"""How runs end: every law on every rig at every level, with what each takes; and commands that are interrupted.

    python benchmarks/ends.py curves [--rigs paper_beam one_mode jointed_beam] [--levels 0.5 6.5 20]
    python benchmarks/ends.py interruptions --number 100 --seed 1

Each run is a command in a process of its own. A curve must end by itself within a minute; an interrupted command within
three seconds, with status 130 or 143, nothing half written and no process left.
"""

import argparse
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from rich.console import Console
from rich.table import Table

from models.friction import LAWS

EXAMPLES = Path(__file__).parents[1] / "examples"
MEASURED = [str(EXAMPLES / "measured_beam" / name) for name in ("rig.toml", "spectra.csv")]
DIAGNOSED = [str(EXAMPLES / "diagnosed_beam" / name) for name in ("rig.toml", "spectra.csv")]
PAPER = str(EXAMPLES / "paper_beam.toml")
COMMAND = [sys.executable, "-m", "hbm.cli"]
SWEEP = ["--from", "30", "--to", "80", "--no-stability"]
GRACE = 3.0  # s after an interrupt
LONG = {
    "frf": ["frf", PAPER, "--from", "40", "--to", "65", "--level", "2", "4", "6.5", "--out", "out.csv"],
    "simulate": ["simulate", PAPER, "--frequency", "50", "--duration", "60", "--out", "out.csv"],
    "continue": ["continue", PAPER, "--parameter", "contact.friction.mu", "--from", "0.1", "--to", "0.9",
                 "--frequency", "50", "--out", "out.csv"],
    "backbone": ["backbone", PAPER, "--out", "out.csv"],
    "identify": ["identify", *MEASURED, "--out", "out"],
    "diagnose": ["diagnose", *DIAGNOSED, "--out", "out"],
    "synthesize": ["synthesize", PAPER, "--levels", "4", "6.5", "--frequencies", "48", "50", "52", "54",
                   "--out", "out.csv", "--histories", "out"],
}  # fmt: skip
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
            for level in levels:
                chosen = [] if law == "its own" else ["--law", law]
                seconds, size, end = curve(["frf", path, *SWEEP, *chosen, "--level", level])
                table.add_row(rig, law, level, f"{seconds:.1f}", f"{size:.0f}", end)
                print(rig, law, level, f"{seconds:.1f} s {size:.0f} MB {end}", file=sys.stderr, flush=True)
    CONSOLE.print(table)


def interrupted(arguments: list[str], after: float, number: int) -> str:
    """How a command ends that gets a signal after some seconds."""
    with tempfile.TemporaryDirectory() as folder:
        run = subprocess.Popen(
            [*COMMAND, *arguments], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
        )
        try:
            run.wait(after)
            return "done before"
        except subprocess.TimeoutExpired:
            run.send_signal(number)
        begin = time.monotonic()
        try:
            run.communicate(timeout=30)
        except subprocess.TimeoutExpired:
            os.killpg(run.pid, signal.SIGKILL)
            return "does not end"
        took = time.monotonic() - begin
        half = [p.name for p in Path(folder).rglob(".*") if p.is_file()]
        while left := _of_group(run.pid):
            if time.monotonic() - begin > GRACE:
                break
            time.sleep(0.05)
    if run.returncode not in (128 + number, 0):
        return f"status {run.returncode}"
    if took > GRACE:
        return f"after {took:.1f} s"
    return "half a file" if half else "a process is left" if left else "as promised"


def _of_group(group: int) -> str:
    """Processes of a group, their numbers."""
    return subprocess.run(["pgrep", "-g", str(group)], capture_output=True, text=True, check=False).stdout


def interruptions(number: int, seed: int) -> None:
    """Print how commands end that are interrupted at random moments."""
    draw, found = random.Random(seed), {name: Counter[str]() for name in LONG}
    for i in range(number):
        name = list(LONG)[i % len(LONG)]
        found[name][interrupted(LONG[name], draw.uniform(0.5, 8.0), draw.choice([signal.SIGINT, signal.SIGTERM]))] += 1
    ends = sorted(set().union(*found.values()))
    table = Table("command", *ends)
    for name, counts in found.items():
        table.add_row(name, *(str(counts[end]) for end in ends))
    CONSOLE.print(table)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parts = parser.add_subparsers(dest="part", required=True)
    of_curves, of_signals = parts.add_parser("curves"), parts.add_parser("interruptions")
    of_curves.add_argument("--rigs", nargs="+", default=["paper_beam", "one_mode", "jointed_beam"])
    of_curves.add_argument("--levels", nargs="+", default=["0.5", "6.5", "20"])
    of_signals.add_argument("--number", type=int, default=100)
    of_signals.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    if given.part == "curves":
        curves(given.rigs, given.levels)
    else:
        interruptions(given.number, given.seed)
    CONSOLE.print(f"{resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime:.0f} s of CPU in all")
