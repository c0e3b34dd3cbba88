"""The command ``hbm loops``: laws of a friction device from measured loops of force over displacement."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hbm.commands.budgets import RunSeconds, seconds_of, within
from hbm.commands.options import console, named, print_written

if TYPE_CHECKING:
    from hbm.identification.loops import LoopFit
    from hbm.measurement.loopsfile import MeasuredLoop

COMMAND = "loops"
REVERSED = "reversed sign"
"""In place of a law: a loop that gives out energy and is left out."""


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

    Coulomb, asymmetric limits, backlash, breakaway, the mass of what moves, and a zero of the load cell where backlash
    shows it. The best law of each loop is printed, with what it leaves of the force and how far its energy is off.

    Example:  hbm loops hysteresis_loops.csv --out laws.csv
    """
    from hbm.textfiles import check_output

    with named(COMMAND):
        if out is not None:
            check_output(out, (".csv",), "--out")
    limit = seconds_of(COMMAND, max_seconds)
    from hbm.commands.progress import Work
    from hbm.identification.loops import fit_loop
    from hbm.measurement.loopsfile import read_loops

    (chosen, giving), found = read_loops(file, loop or ()), []
    with (
        Work() as work,
        within(COMMAND, limit, work.doing, "try fewer samples a cycle, --loop, or a larger --max-seconds"),
    ):
        for i, each in enumerate(chosen):
            work.show(each.name, i / len(chosen))
            found.append(fit_loop(each))
    _deliver(chosen, found, giving, out)


def _deliver(
    chosen: Sequence["MeasuredLoop"],
    found: Sequence[Sequence["LoopFit"]],
    giving: Sequence["MeasuredLoop"],
    out: Path | None,
) -> None:
    import numpy as np

    from hbm.commands.tables import print_lines
    from hbm.files.outputs import columns_of, columns_text
    from hbm.identification.loops import NAMES
    from hbm.measurement.loopsfile import reversed_sign
    from hbm.textfiles import write_together

    if out is not None:
        entries = [(each.name, fit) for each, fits in zip(chosen, found, strict=True) for fit in fits]
        headings = ["loop", "law", "bic", "at_bounds", "left", "work_j", "work_measured_j"]
        headings += [part for name in NAMES for part in (name, f"{name}_std")]
        rows: list[list[Any]] = [
            [loop, fit.law, fit.bic, " ".join(fit.at_bounds), fit.left, fit.work, fit.work_measured]
            + [part.get(name, np.nan) for name in NAMES for part in (fit.values, fit.stds)]
            for loop, fit in entries
        ]
        none = [np.nan] * 2 * len(NAMES)
        rows += [[each.name, REVERSED, np.nan, "", np.nan, np.nan, each.work, *none] for each in giving]
        write_together({out: columns_text(columns_of(headings, rows))})
    best = [fits[0] for fits in found]
    _tables([each.name for each in chosen], best)
    errors = np.abs([fit.work_error for fit in best])
    print_lines(
        console(),
        [
            f"energy off by {np.median(errors):.1%} in the median, {errors.max():.1%} at most; "
            f"within 5 % in {int(np.sum(errors < 0.05))} of {len(errors)} loops",
            *(f"warning: {each.name}: {reversed_sign(each)}; left out" for each in giving),
            *(
                f"warning: {each.name}: {note}"
                for each, fit in zip(chosen, best, strict=True)
                for note in (*each.notes, *fit.warnings)
            ),
        ],
    )
    print_written([] if out is None else [out])


def _tables(names: Sequence[str], best: Sequence["LoopFit"]) -> None:
    """Print limits and backlash of all loops, and the other numbers of those that have any."""
    from hbm.commands.tables import print_rows

    first, others = ("forward", "backward", "backlash"), ("breakaway", "distance", "mass", "offset")
    ends = [{"left\n%": f"{100 * fit.left:.3g}", "energy\n%": f"{100 * fit.work_error:+.2g}"} for fit in best]
    heads = [{"record": name, "law": fit.law} for name, fit in zip(names, best, strict=True)]
    rows = zip(heads, _columns(best, first), ends, strict=True)
    print_rows(console(), "best law of each loop", [head | said | end for head, said, end in rows])
    more = [i for i, fit in enumerate(best) if any(key in fit.values for key in others)]
    said = _columns([best[i] for i in more], others)
    named = [{"record": names[i]} | row for i, row in zip(more, said, strict=True)]
    print_rows(console(), "other numbers of these laws", named)


def _columns(fits: Sequence["LoopFit"], keys: Sequence[str]) -> list[dict[str, str]]:
    """Numbers of laws, of the keys that any of them has, in units that suit them."""
    from hbm.figures.units import prefixed
    from hbm.identification.loops import NAMES, UNITS

    units, columns = dict(zip(NAMES, UNITS, strict=True)), {}
    for key in keys:
        alike = [name for name in keys if units[name] == units[key]]
        values = [fit.values[name] for fit in fits for name in alike if name in fit.values]
        if any(key in fit.values for fit in fits):
            columns[key] = prefixed(units[key], values)
    return [{f"{key}\n{unit}": _said(fit, key, scale) for key, (scale, unit) in columns.items()} for fit in fits]


def _said(fit: "LoopFit", key: str, scale: float) -> str:
    """A number with its deviation, to the digit where this begins."""
    from math import floor, log10

    if key not in fit.values:
        return "-"
    value, std = fit.values[key] * scale, fit.stds[key] * scale
    first = floor(log10(std)) if std > 0.0 else 0
    if not -6 < first < 6:
        return f"{value:.4g} ± {std:.1g}"
    return f"{round(value, -first):.{max(0, -first)}f} ± {round(std, -first):.{max(0, -first)}f}"
