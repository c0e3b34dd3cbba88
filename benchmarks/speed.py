"""How fast: one table of this package beside every peer that pip installs, on the same equations, in one run.

    python -m benchmarks.speed              # B1, B2, B3 beside pyHarm and harmonicbalance, the paper's rig, the command
    python -m benchmarks.speed --ours B3    # a case without peers, in some seconds

All times are CPU times with one BLAS thread. Every tool has a process of its own; they trace in turn, five times, after
a first time that is not counted, with compilation and caches. Ratios are of neighbours in time: their median, least and
largest. The peers' steps are hand-picked, so a time per curve depends on that choice; a time per point less so.
"""

import argparse
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from importlib import import_module
from importlib.util import find_spec
from statistics import median
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.cases import CASES, PAPER_RIG, Case, Traced, cpu_seconds, top
from benchmarks.peers import ours
from benchmarks.workers import process
from hbm import ConvergenceError, steady_state
from hbm.parallel import one_thread
from models.plausible import PlausibilityWarning

REPEATS = 5
FINER = 10
"""Steps of the reference, in those of the curve."""

PACKAGES = {"pyharm": "pyHarm", "harmonicbalance_oscillator": "harmonicbalance"}
COMMAND = ["frf", str(PAPER_RIG), "--from", "40", "--to", "65"]

COLUMNS = (
    "case", "tool", "iteration\nms", "point\nms", "stability\nms a point", "curve\ns", "points\n(rejected)", "peak\nm",
    "at\nHz", "digits of\nthe peak", "digits at\nsame Hz", "chord\nerror", "times our\ncurve", "times our\npoint",
)  # fmt: skip

NOTES = f"""iteration: residual and derivative, ours with its solution
digits: of the largest displacement, by a parabola through three points, beside ours with {FINER} times as many
chord error: of that curve beside what is drawn (ours by cubics, others by lines), in units of sweep and peak
ratios: median (least-largest) of {REPEATS}"""


@dataclass(frozen=True)
class Timed:
    """What a tool took for a case.

    Attributes
    ----------
    curve : Traced
    cpu : (REPEATS,) array
        Of the curve [s].
    iteration : float
        Of a residual with its derivative at the peak [s]; ours with a solution of the bordered system.
    """

    curve: Traced
    cpu: np.ndarray
    iteration: float

    @property
    def point(self) -> np.ndarray:
        """CPU seconds for each point, (REPEATS,)."""
        return self.cpu / len(self.curve.hz)


# ---- in the processes of the tools


def _once(module: str, name: str, iteration: bool) -> tuple[Traced, float, float]:
    """Trace once: the curve, its CPU seconds, those of an iteration if asked for."""
    run = import_module(f"benchmarks.peers.{module}").prepared(CASES[name]())
    used = time.process_time()
    curve, newton = run()
    used = time.process_time() - used
    return curve, used, cpu_seconds(newton) if iteration else np.nan


def run_of(tools: dict[str, ProcessPoolExecutor], name: str) -> dict[str, Timed]:
    """A case by the tools in turn; a tool that fails is left out, and said."""
    found: dict[str, list[tuple[Traced, float, float]]] = {tool: [] for tool in tools}
    for repeat in range(1 + REPEATS):
        for tool in list(found):
            try:
                once = tools[tool].submit(_once, tool, name, repeat == REPEATS).result()
            except Exception as failed:  # whatever a peer raises
                print(f"{name}: {tool} failed: {failed}", file=sys.stderr)
                del found[tool]
            else:
                found[tool] += [once] if repeat else []
    return {
        tool: Timed(runs[-1][0], np.array([cpu for _, cpu, _ in runs]), runs[-1][2]) for tool, runs in found.items()
    }


# ---- how good


def chord_error(found: Traced, true: Traced, hz: tuple[float, float]) -> float:
    """Largest distance of a fine curve to what a tool draws, in units of the sweep and of the peak."""
    scale = np.array([hz[1] - hz[0], true.height.max()])
    corners, fine = (np.column_stack([c.hz, c.height]) / scale for c in (found, true))
    fine = fine[(true.hz >= hz[0]) & (true.hz <= hz[1])]
    start, along = corners[:-1], np.diff(corners, axis=0)
    squares = np.maximum((along**2).sum(axis=1), 1e-300)
    there = fine[:, None] - start
    share = np.clip((there * along).sum(axis=2) / squares, 0.0, 1.0)
    return float(np.linalg.norm(there - share[..., None] * along, axis=2).min(axis=1).max())


def digits(value: float, true: float) -> float:
    """How many digits of a number are right."""
    return float(-np.log10(max(abs(value / true - 1.0), 1e-16)))


def digits_at_its_top(case: Case, found: Traced) -> float:
    """Digits of a tool's largest amplitude, beside our solution at the same frequency."""
    i = int(np.argmax(found.height))
    hz, height = float(found.hz[i]), float(found.height[i])
    curve = ours.curve_of(case)
    away = np.abs(curve.hz / hz - 1.0) + np.abs(curve["drive"].peak / height - 1.0)
    near = curve.points[int(np.argmin(away))]
    try:
        there = steady_state(case.rig, hz, harmonics=case.H, samples=case.N_t, start=near)
    except ConvergenceError:
        return np.nan
    return digits(height, float(there["drive"].peak))


# ---- the table


def spread(ratios: np.ndarray) -> str:
    """Median, least and largest."""
    return f"{median(ratios):.1f} ({ratios.min():.1f}-{ratios.max():.1f})"


def rows(name: str, timed: dict[str, Timed]) -> Iterator[list[str]]:
    """Lines of a case, ours first."""
    case, mine = CASES[name](), timed["ours"]
    references: dict[int, Traced] = {}
    for found in timed.values():
        samples = found.curve.samples
        same = replace(case, N_t=samples)
        if samples not in references:
            references[samples] = ours.reference(same, FINER)
        true = references[samples]
        (at, height), (_, true_height) = (top(c.hz, c.height) for c in (found.curve, true))
        ratios = [spread(a / b) for a, b in ((found.cpu, mine.cpu), (found.point, mine.point))]
        yield [
            f"{name}: H {case.H}, {case.N_t} samples, {case.hz[0]:.4g}-{case.hz[1]:.4g} Hz" if found is mine else "",
            found.curve.tool + (f", {samples} samples" if samples != case.N_t else ""),
            f"{1e3 * found.iteration:.3f}",
            f"{1e3 * median(found.point):.2f}",
            f"{1e3 * ours.stability(name):.2f}" if found is mine else "",
            f"{median(found.cpu):.3f}",
            f"{len(found.curve.hz)} ({found.curve.rejected})",
            f"{height:.6g}",
            f"{at:.6g}",
            f"{digits(height, true_height):.1f}",
            f"{digits_at_its_top(same, found.curve):.1f}" if found is not mine else "",
            f"{chord_error(found.curve.drawn or found.curve, true, case.hz):.1e}",
            *(ratios if found is not mine else ["", ""]),
        ]


def command() -> str:
    """CPU and wall seconds of `hbm frf` from the shell to its files, medians of three."""
    spent: list[tuple[float, float]] = []
    with tempfile.TemporaryDirectory() as folder:
        out = ["--out", f"{folder}/curve.csv", "--plot", f"{folder}/curve.png"]
        for _ in range(3):
            before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
            subprocess.run([sys.executable, "-m", "hbm.cli", *COMMAND, *out], check=True, capture_output=True)
            after, wall = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter() - begin
            spent.append((after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall))
    cpu, wall = (median(values) for values in zip(*spent, strict=True))
    said = "hbm frf examples/paper_beam.toml --from 40 --to 65 --out curve.csv --plot curve.png"
    return f"{said}: {cpu:.2f} s cold ({wall:.2f} s by the clock)"


@one_thread
def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"of {', '.join(CASES)}; all where left out")
    parser.add_argument("--ours", action="store_true", help="without peers and without the command")
    asked = parser.parse_args()
    for name in asked.cases:
        if name not in CASES:
            parser.error(f'case "{name}"; must be one of {", ".join(CASES)}')
    warnings.simplefilter("ignore", PlausibilityWarning)  # oscillators without units
    console = Console(width=190)
    load = f"load {os.getloadavg()[0]:.2f} of {os.cpu_count()} cores"
    console.print(f"Python {platform.python_version()}, NumPy {np.__version__}, {load}, one BLAS thread, CPU times")
    missing = [p for p in PACKAGES.values() if find_spec(p) is None]
    if missing and not asked.ours:
        console.print(f"not installed: {', '.join(missing)}; pip install '.[peers]'")
    table = Table(*COLUMNS)
    with ExitStack() as stack:
        pools: dict[str, Any] = {
            tool: stack.enter_context(process())
            for tool in ("ours", *(() if asked.ours else PACKAGES))
            if PACKAGES.get(tool) not in missing
        }
        for name in asked.cases or CASES:
            case = CASES[name]()
            able = {
                "ours": True,
                "pyharm": case.pyharm is not None,
                "harmonicbalance_oscillator": case.march is not None,
            }
            for row in rows(name, run_of({tool: pool for tool, pool in pools.items() if able[tool]}, name)):
                table.add_row(*row)
            table.add_section()
    console.print(table)
    console.print(NOTES)
    if not asked.ours:
        console.print(command())


if __name__ == "__main__":
    main()
