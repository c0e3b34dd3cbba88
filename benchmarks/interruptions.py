"""Commands that get a signal at a random moment: do they end in time, and what do they leave?

    python -m benchmarks.interruptions [--commands frf diagnose] --number 100 --seed 1

SIGINT, SIGTERM or SIGKILL is sent at a moment of the time that the command takes when nothing disturbs it, until
`number` signals have met a running command. It must end within three seconds, with the status of the signal and no
process left. It leaves no file and no folder, or all those of an undisturbed run, byte by byte; `frf` may keep a curve
whose stability it was still computing. What a killed command had not yet renamed may stay, under a name with a dot.
"""

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

EXAMPLES = Path(__file__).parents[1] / "examples"
PAPER, ONE_MODE = str(EXAMPLES / "paper_beam.toml"), str(EXAMPLES / "one_mode.toml")
MEASURED = [str(EXAMPLES / "undecided_beam" / name) for name in ("rig.toml", "spectra.csv")]
COMMAND = [sys.executable, "-m", "hbm.cli"]
GRACE = 3.0  # s after an interrupt
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)
BOTH = ["--out", "out.csv", "--plot", "out.png"]
LONG = {
    "frf": ["frf", ONE_MODE, "--from", "40", "--to", "60", "--harmonics", "9", *BOTH],
    "continue": ["continue", PAPER, "--parameter", "contact.friction.mu", "--from", "0.4", "--to", "0.6",
                 "--frequency", "50", "--harmonics", "9", *BOTH],
    "backbone": ["backbone", ONE_MODE, "--harmonics", "5", *BOTH],
    "simulate": ["simulate", PAPER, "--frequency", "50", "--duration", "10", *BOTH],
    "synthesize": ["synthesize", ONE_MODE, "--levels", "6.5", "--frequencies", "48", "50", "52", "54",
                   "--out", "out.csv", "--histories", "out"],
    "spectra": ["spectra", "{inputs}/recordings", "--out", "out.csv"],
    "sweep": ["spectra", "{inputs}/sweep.csv", "--sweep", "--out", "out.csv"],
    "decay": ["decay", "{inputs}/decay.csv", "--channel", "a1", "--band", "30", "70", "--rig", ONE_MODE,
              "--out", "out.csv"],
    "modal": ["modal", str(EXAMPLES / "measured_beam" / "spectra.csv"), "--drive", "a1", "--out", "out.toml"],
    "loops": ["loops", "{inputs}/loops.csv", "--out", "out.csv"],
    "inverse": ["inverse", *MEASURED, "--out", "out"],
    "identify": ["identify", *MEASURED, "--law", "coulomb-penalty", "--out", "out"],
    "diagnose": ["diagnose", *MEASURED, "--cause", "added-mass", "--out", "out"],
    "laws": ["laws", "--plot", "out.png"],
}  # fmt: skip
KEEPS_A_CURVE = ("frf",)
"""Commands that keep what they have: a curve whose stability was interrupted."""
CONSOLE = Console(width=130)


# ------------------------------------------------------------------------------------------------------------- inputs


def write_inputs(folder: Path) -> None:
    """Files that the commands read and no example is: recordings, a sweep, a decay, loops."""
    asked = ["--levels", "6.5", "--frequencies", "48", "50", "52", "54", "--histories", "recordings", "--out", "s.csv"]
    subprocess.run([*COMMAND, "synthesize", ONE_MODE, *asked], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    t = np.arange(60_000) / 2000.0
    phase = 2 * np.pi * (40.0 * t + 0.3 * t**2)
    rows = np.column_stack([t, np.cos(phase), np.cos(phase - 0.3) + 0.1 * np.cos(3 * phase)])
    _table(folder / "sweep.csv", "time_s,force,a1", rows)
    rows = np.column_stack([t, np.exp(-0.2 * t) * np.cos(2 * np.pi * 47.8 * t)])[:40_000]
    _table(folder / "decay.csv", "time_s,a1", rows)
    x = 0.02 * np.sin(2 * np.pi * np.arange(300) / 100)
    force, slider = [], 0.0
    for at in x:  # a spring of 5 MN/m on a slider of 10 kN
        slider += max(at - slider - 2e-3, 0.0) + min(at - slider + 2e-3, 0.0)
        force.append(5e6 * (at - slider))
    rows = np.column_stack([np.ones(300), np.arange(300) / 50, x, force])
    _table(folder / "loops.csv", "loop,time_s,displacement_m,force_n", rows)


def _table(path: Path, heading: str, rows: np.ndarray) -> None:
    np.savetxt(path, rows, delimiter=",", header=heading, comments="")


# ------------------------------------------------------------------------------------------------------- interruptions


def started(arguments: list[str], folder: str) -> "subprocess.Popen[bytes]":
    """A command in a folder, the leader of a session of its own."""
    return subprocess.Popen(
        [*COMMAND, *arguments], cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )


def results(folder: str, *, hidden: bool = True) -> dict[str, bytes]:
    """Files and folders that are there."""
    found = [path for path in Path(folder).rglob("*") if hidden or path.name[0] != "."]
    # MATLAB's files have the time in their heading
    bare = {path for path in found if path.is_dir() or path.suffix == ".mat"}
    return {str(p.relative_to(folder)): b"" if p in bare else p.read_bytes() for p in found}


def undisturbed(arguments: list[str]) -> tuple[float, dict[str, bytes]]:
    """Seconds that a command takes, and what it leaves."""
    with tempfile.TemporaryDirectory() as folder:
        begin = time.monotonic()
        if started(arguments, folder).wait() not in (0, 1):
            raise SystemExit(f"hbm {' '.join(arguments)} is refused")
        return time.monotonic() - begin, results(folder)


def interrupted(
    arguments: list[str], results_of: dict[str, dict[str, bytes]], after: float, number: signal.Signals
) -> str:
    """How a command ends that gets a signal after some seconds; `results_of` has what it may leave, by name."""
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
        while (left := _session(run.pid)) and time.monotonic() - begin < GRACE:
            time.sleep(0.05)
        written = results(folder, hidden=number != signal.SIGKILL)
    # one whose interpreter still starts is ended by the signal itself, which a shell reports by the same status
    if run.returncode not in (-number, 128 + number, 0 if written == results_of["all"] else 128 + number):
        return f"status {run.returncode}"
    if took > GRACE:
        return f"after {took:.1f} s"
    return "a process is left" if left else _compared(written, results_of)


def _compared(written: dict[str, bytes], results_of: dict[str, dict[str, bytes]]) -> str:
    for name, whole in results_of.items():
        if written == whole:
            return name
    missing = sorted(results_of["all"].keys() - written.keys())
    return f"without {', '.join(missing)}" if missing else "other files"


def _session(leader: int) -> str:
    """Processes of a session, their numbers; not those that have ended and whose status nobody has asked for yet."""
    listed = subprocess.run(["ps", "-s", str(leader), "-o", "pid=,stat="], capture_output=True, text=True, check=False)
    return "\n".join(line for line in listed.stdout.splitlines() if " Z" not in line)


def of_command(name: str, inputs: str, number: int, draw: random.Random) -> Counter[str]:
    """How a command ends when `number` signals meet it while it runs."""
    arguments = [part.format(inputs=inputs) for part in LONG[name]]
    seconds, whole = undisturbed(arguments)
    results_of = {"nothing": {}, "all": whole}
    if name in KEEPS_A_CURVE:
        results_of["curve without stability"] = undisturbed([*arguments, "--no-stability"])[1]
    found: Counter[str] = Counter()
    while found.total() - found["done before"] < number:
        found[interrupted(arguments, results_of, draw.uniform(0.0, seconds), draw.choice(SIGNALS))] += 1
    print(name, f"{seconds:.1f} s, {len(whole)} files and folders", dict(found), file=sys.stderr, flush=True)
    del found["done before"]
    return found


def main() -> int:
    """Print one table; status 1 if anything ended as it should not."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--commands", nargs="+", default=list(LONG), choices=list(LONG))
    parser.add_argument("--number", type=int, default=15, help="for each command")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell has it ignored behind &, until a command listens
    with tempfile.TemporaryDirectory() as inputs:
        write_inputs(Path(inputs))
        draw = random.Random(given.seed)
        found = {name: of_command(name, inputs, given.number, draw) for name in given.commands}
    ends = sorted(set().union(*found.values()))
    table = Table("command", *ends)
    for name, counts in found.items():
        table.add_row(name, *(str(counts[end]) for end in ends))
    CONSOLE.print(table)
    return int(any(set(ends) - {"nothing", "all", "curve without stability"}))


if __name__ == "__main__":
    raise SystemExit(main())
