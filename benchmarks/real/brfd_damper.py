"""A band-brake friction device under imposed displacement: laws from measured loops, as `hbm loops` finds them."""

import numpy as np
from matplotlib.figure import Figure

from hbm.figures.style import INK, SMALL, WIDTH, dressed
from hbm.identification.loops import LAWS, LoopFit, fit_loop
from hbm.measurement.loopsfile import MeasuredLoop, load_loops

from .common import DATA, Finding, legend_above, read_rows, table, with_std

FOLDER = DATA / "brfd_friction_damper"
CYCLES = 3
SHOWN = ("BRFD1_0.5Hz_35lb_1in", "BRFD3_0.5Hz_30lb_1.5in", "BRFD2_0.25Hz_36lb_1in")


def run() -> Finding:
    """Table, figure and conclusion."""
    loops = load_loops(FOLDER / "hysteresis_loops.csv")
    of_table = {row["loop"]: float(row["energy_per_cycle_j"]) for row in read_rows(FOLDER / "loop_table.csv")}
    fits = {loop.name: fit_loop(loop) for loop in loops}
    rows = []
    for loop in loops:
        best, coulomb = fits[loop.name][0], _law(fits[loop.name], "coulomb")
        rows.append(
            (
                loop.name,
                best.law,
                *(_said(best, key, unit) for key, unit in (("forward", 1e-3), ("backward", 1e-3), ("backlash", 1e3))),
                f"{coulomb.left:.1%}",
                f"{best.left:.1%}",
                f"{best.work_error:+.1%}",
            )
        )
    errors = np.abs([fits[loop.name][0].work_error for loop in loops])
    apart = np.abs([loop.work / CYCLES / of_table[loop.name] - 1.0 for loop in loops])
    named = sum("backlash" in fits[loop.name][0].values for loop in loops)
    head = ("loop", "law", "F+, kN", "F-, kN", "backlash, mm", "Coulomb leaves", "best leaves", "energy")
    return Finding(
        "brfd_friction_damper",
        table("Friction damper: the best of laws of each loop, what it leaves, error of its energy", head, rows),
        _figure([loop for loop in loops if loop.name in SHOWN], fits),
        (
            f"Backlash is in the best law of {named} of {len(loops)} loops. Energy is off by {np.median(errors):.1%} "
            f"in the median and {errors.max():.1%} at most, within 5 % in {int(np.sum(errors < 0.05))}.",
            f"Energy of the samples differs from the set's table by {apart.max():.1e} at most.",
        ),
    )


def _law(fits: list[LoopFit], name: str) -> LoopFit:
    return next(fit for fit in fits if fit.law == name)


def _said(fit: LoopFit, key: str, scale: float) -> str:
    return with_std(fit.values[key], fit.stds[key], scale) if key in fit.values else "-"


def _figure(shown: list[MeasuredLoop], fits: dict[str, list[LoopFit]]) -> Figure:
    figure = Figure(figsize=(WIDTH, 2.7), layout="constrained")
    axes = figure.subplots(1, len(shown))
    for ax, loop in zip(axes, shown, strict=True):
        ax.plot(loop.displacement * 1e3, loop.force * 1e-3, color="0.7", linewidth=0.9, label="measured, three cycles")
        for name, color in zip(list(LAWS)[:3:2], ("C0", "C3"), strict=True):
            force = _law(fits[loop.name], name).force
            ax.plot(loop.displacement * 1e3, force * 1e-3, color=color, linewidth=1.1, label=name)
        ax.set_title(loop.name.replace("_", ", "), fontsize=SMALL, color=INK)
        dressed(ax, "Displacement [mm]", "")
    axes[0].set_ylabel("Force [kN]", color=INK)
    legend_above(figure, axes[0])
    return figure
