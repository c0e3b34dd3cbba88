"""The command ``hbm loops``: laws of a friction device from measured loops of force over displacement."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hbm.commands.budgets import RunSeconds, seconds_of, within
from hbm.commands.options import console, named, print_written
from hbm.errors import InputError

if TYPE_CHECKING:
    from hbm.identification.loops import LoopFit
    from hbm.measurement.loopsfile import MeasuredLoop

COMMAND = "loops"


def loops(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="LOOPS",
            help="CSV with loop,time_s,displacement_m,force_n: whole cycles of each.",
            show_default=False,
        ),
    ],
    loop: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Only this loop; repeated for each.", show_default=False)
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="F.csv", help="Write all laws of all loops here.")] = None,
    max_seconds: RunSeconds = "600",
) -> None:
    """Laws of a friction device under an imposed displacement, compared.

    Coulomb, asymmetric limits, backlash, breakaway, and the mass of what moves. The best law of each loop is printed,
    with what it leaves of the force and how far its energy is off.

    Example:  hbm loops hysteresis_loops.csv --out laws.csv
    """
    from hbm.textfiles import check_output

    with named(COMMAND):
        if out is not None:
            check_output(out, (".csv",), "--out")
    limit = seconds_of(COMMAND, max_seconds)
    from hbm.commands.progress import Work
    from hbm.identification.loops import fit_loop
    from hbm.measurement.loopsfile import load_loops

    measured = load_loops(file)
    names = [each.name for each in measured]
    for name in loop or ():
        if name not in names:
            raise InputError(f"{file}: no loop {name}; loops are {', '.join(names)}")
    chosen = [each for each in measured if not loop or each.name in loop]
    found = []
    with (
        Work() as work,
        within(COMMAND, limit, work.doing, "try fewer samples a cycle, --loop, or a larger --max-seconds"),
    ):
        for i, each in enumerate(chosen):
            work.show(each.name, i / len(chosen))
            found.append(fit_loop(each))
    _deliver(chosen, found, out)


def _deliver(chosen: Sequence["MeasuredLoop"], found: Sequence[Sequence["LoopFit"]], out: Path | None) -> None:
    import numpy as np

    from hbm.commands.tables import print_lines, print_rows
    from hbm.files.outputs import columns_of, columns_text
    from hbm.identification.loops import NAMES
    from hbm.textfiles import write_together

    if out is not None:
        entries = [(each.name, fit) for each, fits in zip(chosen, found, strict=True) for fit in fits]
        headings = ["loop", "law", "bic", "left", "work_j", "work_measured_j"]
        headings += [part for name in NAMES for part in (name, f"{name}_std")]
        rows: list[list[Any]] = [
            [loop, fit.law, fit.bic, fit.left, fit.work, fit.work_measured]
            + [part.get(name, np.nan) for name in NAMES for part in (fit.values, fit.stds)]
            for loop, fit in entries
        ]
        write_together({out: columns_text(columns_of(headings, rows))})
    print_rows(
        console(), "best law of each loop", [_row(e.name, fits[0]) for e, fits in zip(chosen, found, strict=True)]
    )
    errors = np.abs([fits[0].work_error for fits in found])
    print_lines(
        console(),
        [
            f"energy off by {np.median(errors):.1%} in the median, {errors.max():.1%} at most; "
            f"within 5 % in {int(np.sum(errors < 0.05))} of {len(errors)} loops"
        ],
    )
    print_written([] if out is None else [out])


def _row(name: str, fit: "LoopFit") -> dict[str, str]:
    def said(key: str, unit: float) -> str:
        return f"{fit.values[key] / unit:.4g} ± {fit.stds[key] / unit:.1g}" if key in fit.values else "-"

    return {
        "record": name,
        "law": fit.law,
        "forward\nkN": said("forward", 1e3),
        "backward\nkN": said("backward", 1e3),
        "backlash\nmm": said("backlash", 1e-3),
        "left\n%": f"{100 * fit.left:.3g}",
        "energy\n%": f"{100 * fit.work_error:+.2g}",
    }
