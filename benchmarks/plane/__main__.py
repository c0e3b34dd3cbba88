"""Print the mesh study, the second paths, the budget in Hz and Table 4, and draw the figures of the docs.

Run: python -m benchmarks.plane mesh|paths|budget|rest|named [--figure FILE.png]
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
from rich.console import Console
from rich.table import Table

from hbm.integration.integrate import simulate
from hbm.integration.jointed import joint_steady_state
from hbm.response.trace import steady_state, trace_frequency
from models.published import PAPER_PENALTY

from . import budget, march, mesh, named
from .rigs import plane_model, plane_rig

CONSOLE = Console()
RUN_HZ, RUN_SECONDS, RUN_STEP = 50.0, 0.2, 1e-5
SHOOTING_STEPS = 4096


def table(title: str, *columns: str) -> Table:
    """An empty table."""
    made = Table(title=title, title_justify="left")
    for i, column in enumerate(columns):
        made.add_column(column, justify="left" if i == 0 else "right")
    return made


def print_mesh(figure: str | None) -> None:
    """Figures 5 and 6."""
    found = mesh.study()
    rows = table(
        f"Cantilever, {mesh.ROWS} elements over the thickness, over beam theory",
        "element", "along", "unknowns", "deflection", "rotation", "1st", "2nd", "3rd frequency",
    )  # fmt: skip
    for name, cases in found.items():
        for columns, c in zip(mesh.COLUMNS, cases, strict=True):
            numbers = (c.deflection, c.rotation, *c.hz)
            rows.add_row(name, str(columns), str(c.unknowns), *(f"{x:.4f}" for x in numbers))
    CONSOLE.print(rows)
    if figure:
        mesh.draw(found).savefig(figure, dpi=150)


def print_paths(_: str | None) -> None:
    """Reduced against full, harmonic balance against time integration, and what a curve costs."""
    mu, slip = PAPER_PENALTY.mu, PAPER_PENALTY.critical_slip
    rows = table(
        f"Full and reduced model, {RUN_SECONDS} s from rest at {RUN_HZ:g} Hz", "nodes", "modes", "largest difference"
    )
    for variant in (budget.BASE, budget.BOTH.but(nodes=9)):
        full = march.march(variant, mu, slip, RUN_HZ, RUN_SECONDS, RUN_STEP, march.ABAQUS_ALPHA)
        for modes in (15, 25):
            rig = budget.replace(plane_rig(variant, modes=modes), damping=march.DAMPING)
            steps = 2 * round(1 / RUN_HZ / RUN_STEP)
            drive = simulate(rig, RUN_HZ, duration=RUN_SECONDS, steps_per_period=steps).channels["drive"].values[::2]
            n = min(len(drive), len(full))
            error = np.abs(drive[:n] - full[:n]).max() / np.abs(full).max()
            rows.add_row(str(variant.nodes), str(modes), f"{error:.1e}")
    CONSOLE.print(rows)
    rig = plane_rig(budget.BOTH.but(nodes=9), modes=8)
    a0, *rest = steady_state(rig, 52.75, harmonics=31)["drive"].coefficients
    marched = joint_steady_state(rig, 52.75, steps_per_period=SHOOTING_STEPS).history.channels["drive"].values
    angles = np.outer(2 * np.pi * np.arange(len(marched)) / len(marched), np.arange(1, 32))
    balance = a0 + np.hstack([np.cos(angles), np.sin(angles)]) @ rest
    error = np.abs(balance - marched).max() / np.abs(marched).max()
    CONSOLE.print(f"harmonic balance, H 31, and shooting at 52.75 Hz, 9 nodes: {error:.1e} of the peak")
    plane_model.cache_clear()
    begin = time.perf_counter()
    rig = plane_rig(budget.BOTH.but(nodes=9))
    reduced = time.perf_counter()
    curve = trace_frequency(rig, (40.0, 65.0), harmonics=9)
    end = time.perf_counter()
    cost = f"{len(curve.points)} points, {end - reduced:.1f} s"
    CONSOLE.print(f"mesh and reduction {reduced - begin:.1f} s, curve 40 to 65 Hz, H 9: {cost}")


def print_budget(_: str | None) -> None:
    """From the beam of Table 1 to Table 4, under the penalty law."""
    rows = table("Peak of the steady state, penalty law, 6.5 N", "change", "Hz", "by")
    for term in budget.terms():
        rows.add_row(term.change, f"{term.hz:.2f}", f"{term.shift:+.2f}")
    CONSOLE.print(rows)
    hz, ratio = budget.damping_of_steps(march.ABAQUS_ALPHA, 52.0, 1e-4)
    CONSOLE.print(f"steps of 1e-4 s, alpha {march.ABAQUS_ALPHA}: {hz - 52.0:+.3f} Hz, damping ratio {ratio:.1e}")


def print_rest(_: str | None) -> None:
    """Table 4: 1.2 s from rest, one node of contact."""
    rows = table(f"Peak within {budget.DURATION} s from rest [Hz], every {budget.RESOLUTION} Hz", "model", *budget.LAWS)
    for words, variant in budget.VARIANTS.items():
        rigs = [plane_rig(variant, law, budget.RUN_MODES) for law in budget.LAWS.values()]
        rows.add_row(words, *(f"{budget.peak_from_rest(rig):.2f}" for rig in rigs))
    rows.add_row("Abaqus, Table 4", *(f"{hz}" for hz in budget.ABAQUS.values()))
    CONSOLE.print(rows)


def print_named(_: str | None) -> None:
    """What a diagnosis of the plane model's spectra says of the beam of Table 1."""
    for words, variant in budget.VARIANTS.items():
        CONSOLE.rule(words)
        CONSOLE.print(named.asked(variant), highlight=False, markup=False)


PARTS: dict[str, Callable[[str | None], None]] = {
    "mesh": print_mesh,
    "paths": print_paths,
    "budget": print_budget,
    "rest": print_rest,
    "named": print_named,
}

if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("part", choices=PARTS)
    arguments.add_argument("--figure")
    given = arguments.parse_args()
    PARTS[given.part](given.figure)
