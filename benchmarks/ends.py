"""How runs end: every law on every rig at every level, with what each takes; and commands that are interrupted.

    python benchmarks/ends.py curves [--rigs paper_beam one_mode jointed_beam] [--levels 0.5 6.5 20]
    python benchmarks/ends.py interruptions [--commands frf diagnose] --number 15 --seed 1

Each run is a command in a process of its own. A curve must end by itself within a minute. A command that gets SIGINT,
SIGTERM or SIGKILL at a random moment of the time it takes must end within three seconds, with status 130, 143 or none,
no process left, and no file or the same files as an undisturbed run.
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
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)
LONG = {
    "frf": ["frf", PAPER, "--from", "40", "--to", "65", "--out", "out.csv", "--plot", "out.png"],
    "simulate": ["simulate", PAPER, "--frequency", "50", "--duration", "20", "--out", "out.csv"],
    "continue": ["continue", PAPER, "--parameter", "contact.friction.mu", "--from", "0.1", "--to", "0.9",
                 "--frequency", "50", "--out", "out.csv"],
    "backbone": ["backbone", PAPER, "--out", "out.csv", "--plot", "out.png"],
    "inverse": ["inverse", *MEASURED, "--out", "out"],
    "identify": ["identify", *MEASURED, "--law", "coulomb-penalty", "--law", "dahl", "--out", "out"],
    "diagnose": ["diagnose", *DIAGNOSED, "--cause", "added-mass", "--cause", "clamp-rotation", "--out", "out"],
    "synthesize": ["synthesize", PAPER, "--levels", "6.5", "--frequencies", "48", "50", "52", "54",
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


def started(arguments: list[str], folder: str) -> "subprocess.Popen[bytes]":
    """A command in a folder, the leader of a group of its own."""
    return subprocess.Popen(
        [*COMMAND, *arguments], cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )


def results(folder: str) -> dict[str, bytes]:
    """Files under their final names; MATLAB's have the time in their heading."""
    found = {str(p.relative_to(folder)): p for p in Path(folder).rglob("*") if p.is_file() and p.name[0] != "."}
    return {name: b"" if p.suffix == ".mat" else p.read_bytes() for name, p in found.items()}


def undisturbed(arguments: list[str]) -> tuple[float, dict[str, bytes]]:
    """Seconds that a command takes, and the files that it writes."""
    with tempfile.TemporaryDirectory() as folder:
        begin = time.monotonic()
        started(arguments, folder).wait()
        return time.monotonic() - begin, results(folder)


def interrupted(arguments: list[str], whole: dict[str, bytes], after: float, number: int) -> str:
    """How a command ends that gets a signal after some seconds; `whole` is what it would have written."""
    with tempfile.TemporaryDirectory() as folder:
        run = started(arguments, folder)
        try:
            run.wait(after)
            return "done before"
        except subprocess.TimeoutExpired:
            run.send_signal(number)
        begin = time.monotonic()
        try:
            run.wait(30)
        except subprocess.TimeoutExpired:
            os.killpg(run.pid, signal.SIGKILL)
            return "does not end"
        took = time.monotonic() - begin
        while (left := _of_group(run.pid)) and time.monotonic() - begin < GRACE:
            time.sleep(0.05)
        written = results(folder)
    # one whose interpreter still starts is ended by the signal itself, which a shell reports by the same status
    if run.returncode not in (-number, 128 + number, 0):
        return f"status {run.returncode}"
    if took > GRACE:
        return f"after {took:.1f} s"
    return "a process is left" if left else _compared(written, whole)


def _compared(written: dict[str, bytes], whole: dict[str, bytes]) -> str:
    if written in ({}, whole):
        return "as promised"
    missing = sorted(whole.keys() - written.keys())
    return f"without {', '.join(missing)}" if missing else "other files"


def _of_group(group: int) -> str:
    """Processes of a group, their numbers."""
    return subprocess.run(["pgrep", "-g", str(group)], capture_output=True, text=True, check=False).stdout


def interruptions(commands: list[str], number: int, seed: int) -> None:
    """Print how commands end that get a signal at random moments of the time they take."""
    draw, found = random.Random(seed), {}
    for name in commands:
        seconds, whole = undisturbed(LONG[name])
        moments = [(draw.uniform(0.0, seconds), draw.choice(SIGNALS)) for _ in range(number)]
        found[name] = Counter(interrupted(LONG[name], whole, *moment) for moment in moments)
        print(name, f"{seconds:.1f} s, {len(whole)} files", dict(found[name]), file=sys.stderr, flush=True)
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
    of_signals.add_argument("--commands", nargs="+", default=list(LONG), choices=list(LONG))
    of_signals.add_argument("--number", type=int, default=15, help="for each command")
    of_signals.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    if given.part == "curves":
        curves(given.rigs, given.levels)
    else:
        interruptions(given.commands, given.number, given.seed)
    CONSOLE.print(f"{resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime:.0f} s of CPU in all")
