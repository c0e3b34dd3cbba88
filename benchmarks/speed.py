"""How fast: the parts of this package, and whole curves beside pyHarm and harmonicbalance on the same equations.

Every curve is traced in a process of its own. The first run, with compilation and caches, is not counted; the times are
medians of up to five more, fewer where a tool is slow. Comparisons are with a finely traced curve of ours. The peers'
steps are hand-picked, so a time per curve depends on that choice; a time per point less so.

pyHarm runs twice: in the environment as it is, and with one BLAS thread, as this package solves. The second is the
comparison of codes. The first measures threads that wait for one another, and varies tenfold with the load.

Run: pip install '.[peers]'; python benchmarks/speed.py
"""

import argparse
import importlib
import importlib.util
import os
import platform
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median
from time import perf_counter

import numpy as np
from cases import CASES, Row, damped, load, seconds
from peers.ours import traced
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_info

from hbm.balance.problem import HarmonicBalance
from hbm.balance.solution import describe
from hbm.fourier import FourierBasis
from hbm.parallel import one_thread
from hbm.response.curve import ResponseCurve
from hbm.response.trace import solve_near, steady_state, trace_frequency
from models import Rig
from models.published import paper_rig

ROOT = Path(__file__).parent.parent
ONE_THREAD = {name: "1" for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")}
PEERS = {
    "beam": (("peers.ours", {}), ("peers.pyharm_beam", {}), ("peers.pyharm_beam", ONE_THREAD)),
    "oscillator": (("peers.ours", {}), ("peers.harmonicbalance_oscillator", {})),
}
PACKAGES = {"peers.pyharm_beam": "pyHarm", "peers.harmonicbalance_oscillator": "harmonicbalance"}
DIGITS = 4
"""Digits to which the peaks must agree."""

console = Console(width=150)


def machine() -> None:
    """Print what the times depend on."""
    cpus = os.cpu_count()
    console.print(f"Python {platform.python_version()}, NumPy {np.__version__}, {cpus} cores, load {load():.2f}")
    for name in ONE_THREAD:
        console.print(f"  {name} = {os.environ.get(name, 'not set')}")
    for library in threadpool_info():
        console.print(f"  {library['internal_api']} {library['version']}: {library['num_threads']} threads by default")
    console.print("  this package limits BLAS to one thread while it solves\n")


# ---- parts of this package


@one_thread
def pieces(rig: Rig, H: int, N_t: int) -> dict[str, float]:
    """Seconds of each piece of a Newton iteration at a solution near resonance."""
    solution = steady_state(rig, 49.0, harmonics=H, samples=N_t)
    problem = HarmonicBalance(rig, FourierBasis(H, N_t))
    x, lam = problem.pack(solution.state)
    state = problem.unpack(x, lam)
    kinematics = problem.kinematics(state)
    linear = problem.linearize(x, lam)
    row = np.ones(problem.size)

    def by_law() -> None:
        problem.law.linearize(kinematics.signals.copy(), state.Omega, problem.environment)

    def iteration() -> None:
        newton = problem.linearize(x, lam)
        newton.solve_bordered(row, 1.0, -newton.residual, 0.0)

    return {
        "residual": seconds(lambda: problem.residual(x, lam)),
        "friction law over a period, with derivatives": seconds(by_law),
        "Newton iteration: residual, Jacobian, elimination, solve": seconds(iteration),
        "another solve with the same Jacobian": seconds(lambda: linear.solve_bordered(row, 1.0, -linear.residual, 0.0)),
        "sign of the determinant": seconds(lambda: linear.determinant_sign(row, 1.0)),
        "describe a point: channels, energy balance": seconds(lambda: describe(problem, x, lam)),
    }


def whole_curve(rig: Rig) -> tuple[float, ResponseCurve]:
    """Median seconds of a curve 40-65 Hz with H = 9, and the curve; the first run is not counted."""
    spent = []
    for _ in range(4):
        t = perf_counter()
        curve = trace_frequency(rig, (40.0, 65.0), harmonics=9, samples=256)
        spent.append(perf_counter() - t)
    return median(spent[1:]), curve


def cold_start() -> float:
    """Median seconds of `hbm frf` from the shell to the files, of three."""
    spent = []
    with tempfile.TemporaryDirectory() as folder:
        out = ["--out", f"{folder}/curve.csv", "--plot", f"{folder}/curve.png"]
        command = [sys.executable, "-m", "hbm.cli", "frf", "examples/paper_beam.toml", "--from", "40", "--to", "65"]
        for _ in range(3):
            t = perf_counter()
            subprocess.run([*command, *out], cwd=ROOT, check=True, capture_output=True)
            spent.append(perf_counter() - t)
    return median(spent)


def ours() -> None:
    """Print the times of this package."""
    rigs = {n: damped(paper_rig()).with_modes(n) for n in (5, 50)}
    measured = {
        f"{n} modes, H = {H}": pieces(rig, H, 256)
        for n, rig, H in ((5, rigs[5], 15), (5, rigs[5], 9), (50, rigs[50], 9))
    }
    table = Table("ms, N_t = 256", *measured, title="The paper's beam with all couplings: one call")
    for piece in next(iter(measured.values())):
        table.add_row(piece, *(f"{1e3 * times[piece]:.3f}" for times in measured.values()))
    console.print(table)

    table = Table("modes", "s per curve", "points", "Newton solves", "ms per point", "load", title="40-65 Hz, H = 9")
    per_point = {}
    for n, rig in rigs.items():
        spent, curve = whole_curve(rig)
        per_point[n] = spent / len(curve.points)
        solves = sum(p.iterations for p in curve.branch.points)
        values = (f"{spent:.3f}", len(curve.points), solves, f"{1e3 * per_point[n]:.2f}", f"{load():.2f}")
        table.add_row(str(n), *map(str, values))
    console.print(table)
    console.print(f"50 modes cost {per_point[50] / per_point[5]:.2f} times what 5 modes do, per point")
    spent = cold_start()
    console.print(f"hbm frf examples/paper_beam.toml, 40-65 Hz, cold start to CSV and PNG: {spent:.2f} s\n")


# ---- beside other tools


def measured_apart(module: str, case: str, environment: dict[str, str]) -> Row | None:
    """Row of a tool from a process of its own, or None where the tool failed; its noise is shown only then."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "row.json"
        command = [sys.executable, __file__, "--row", module, case, str(file)]
        done = subprocess.run(command, env=os.environ | environment, capture_output=True, text=True)
        if done.returncode:
            console.print(f"{module} failed: {done.stderr.strip().splitlines()[-1]}")
            return None
        return Row.load_from(file)


def distances(row: Row, reference: ResponseCurve, hz: tuple[float, float]) -> np.ndarray:
    """Distance of every point within the sweep to the reference polyline, in units of the axis ranges."""
    height = reference["drive"].amplitude[:, 1].max()
    width = hz[1] - hz[0]
    corners = np.column_stack([reference.hz / width, reference["drive"].amplitude[:, 1] / height])
    start, along = corners[:-1], np.diff(corners, axis=0)
    out = []
    for f, a in zip(row.hz, row.first_harmonic, strict=True):
        if hz[0] <= f <= hz[1]:
            there = np.array([f / width, a / height]) - start
            share = np.clip((there * along).sum(axis=1) / (along**2).sum(axis=1), 0.0, 1.0)
            out.append(np.linalg.norm(there - share[:, None] * along, axis=1).min())
    return np.array(out)


def peak(hz: np.ndarray, amplitude: np.ndarray) -> tuple[float, float]:
    """Top of the parabola through the largest amplitude and its neighbours: frequency, amplitude."""
    i = int(np.argmax(amplitude))
    if not 0 < i < len(hz) - 1:
        return float(hz[i]), float(amplitude[i])
    x, y = hz[i - 1 : i + 2] - hz[i], amplitude[i - 1 : i + 2] / amplitude[i]
    a, b, c = np.polyfit(x, y, 2)
    if not a < 0.0:
        return float(hz[i]), float(amplitude[i])
    return float(hz[i] - b / (2 * a)), float((c - b**2 / (4 * a)) * amplitude[i])


def digits(value: float, true: float) -> float:
    """How many digits of a number are right."""
    return float(-np.log10(max(abs(value / true - 1.0), 1e-16)))


def digits_at_its_top(row: Row, reference: ResponseCurve) -> float:
    """Digits of a tool's largest amplitude, beside our solution at the same frequency."""
    top = int(np.argmax(row.first_harmonic))
    lam = reference.problem.lam_at(row.hz[top])
    near = reference.points[int(np.argmin(np.abs(reference.hz - row.hz[top])))]
    ours_there = describe(reference.problem, solve_near(reference.problem, lam, near), lam)
    return digits(row.first_harmonic[top], ours_there.channels["drive"].amplitude[1])


def compared(case_name: str) -> None:
    """Print the table of a case."""
    case = CASES[case_name]()
    unit, scale = ("mm", 1e3) if case_name == "beam" else ("m", 1.0)
    reference = traced(case, finer=20)
    true_peak = float(reference["drive"].amplitude[:, 1].max())
    first, lines = None, []
    table = Table(
        "tool",
        "s per curve\nwall (CPU)",
        "points\n(rejected)",
        "ms per\npoint",
        "ms per\nresidual\n+ Jacobian*",
        f"peak, first\nharmonic [{unit}]",
        "at [Hz]",
        "digits of\nthe peak",
        "digits at\nsame Hz",
        "distance\nmedian",
        "distance\nmax",
        "load",
        title=f"{case_name}: H = {case.H}, {case.N_t} samples, {case.rig.structure.n} modes, "
        f"{case.hz[0]:.4g}-{case.hz[1]:.4g} Hz",
    )
    for module, environment in PEERS[case_name]:
        threads = ", 1 thread" if environment else ""
        if module in PACKAGES and importlib.util.find_spec(PACKAGES[module]) is None:
            table.add_row(f"{PACKAGES[module]}: not installed; pip install '.[peers]'")
            continue
        row = measured_apart(module, case_name, environment)
        if row is None:
            table.add_row(f"{module}{threads}: failed")
            continue
        wall, cpu, n = median(row.wall), median(row.cpu), len(row.hz)
        first = first or row
        at, top = peak(np.array(row.hz), row.first_harmonic)
        apart = distances(row, reference, case.hz)
        table.add_row(
            f"{row.tool}{threads}",
            f"{wall:.3f} ({cpu:.3f})",
            f"{n} ({row.rejected})",
            f"{1e3 * wall / n:.2f}",
            f"{1e3 * row.linearize:.3f}",
            f"{scale * top:.6g}",
            f"{at:.6g}",
            f"{digits(top, true_peak):.1f}",
            f"{digits_at_its_top(row, reference):.1f}",
            f"{np.median(apart):.1e}",
            f"{apart.max():.1e}",
            f"{row.load:.2f}",
        )
        if row is not first:
            ours_wall, ours_n = median(first.wall), len(first.hz)
            lines.append(
                f"  {row.tool}{threads}: {wall / ours_wall:.1f} times our time per curve, "
                f"{wall / n / (ours_wall / ours_n):.1f} times per point"
            )
            agreed = digits(top, true_peak)
            if agreed < DIGITS:
                lines[-1] += (
                    f"; its peak has {agreed:.1f} digits, {DIGITS} are asked for: "
                    f"at its own highest point the two codes agree to {digits_at_its_top(row, reference):.1f}"
                )
    console.print(table)
    for line in lines:
        console.print(line)
    console.print(
        f"  reference: {len(reference.points)} points of ours, peak {scale * true_peak:.6g} {unit}; distances in units "
        "of the sweep and of the peak\n"
        "  * ours includes the elimination of the modes and one solution of the linear system, the peers' do not\n"
    )


def main() -> None:
    """Measure and print everything; or, with --row, measure one tool for the parent process."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--row", nargs=3, metavar=("MODULE", "CASE", "FILE"), help=argparse.SUPPRESS)
    row = parser.parse_args().row
    if row:
        module, case, file = row
        importlib.import_module(module).row(CASES[case]()).save(Path(file).resolve())
        return
    machine()
    ours()
    for case in PEERS:
        compared(case)


if __name__ == "__main__":
    main()
