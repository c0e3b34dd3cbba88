"""The command ``hbm backbone``: damped nonlinear normal modes and phase resonance."""

from collections.abc import Sequence
from math import isfinite, isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hbm.commands.budgets import MaxPoints, TraceSeconds, budget_of
from hbm.commands.deliver import write_result
from hbm.commands.options import (
    LARGEST_H,
    AllowCode,
    Plot,
    RigFile,
    both_ends,
    check_outputs,
    console,
    positive,
    print_written,
    say,
    whole,
)
from hbm.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from hbm.figures.style import AxesArray
    from hbm.modes.accuracy import NumericalChange
    from hbm.modes.backbone import Backbone
    from hbm.response.budget import Budget
    from hbm.response.curve import ResponseCurve
    from models.jointed import AnyRig

BANDWIDTHS, BESIDE = 5.0, (0.05, 0.3)
"""Responses go so many bandwidths beyond the frequencies of a backbone; least and most of that, relative to these."""


def backbone(
    rig: RigFile,
    mode: Annotated[str, typer.Option(metavar="N", help="Number of the mode, counted from 1.")] = "1",
    begin: Annotated[
        str | None,
        typer.Option("--from", metavar="M", help="First fundamental amplitude of the drive displacement in m."),
    ] = None,
    end: Annotated[str | None, typer.Option("--to", metavar="M", help="Last amplitude in m; with --from.")] = None,
    harmonics: Annotated[
        str | None,
        typer.Option(metavar="H", help="Harmonics; where omitted 15, or more where those of the force need them."),
    ] = None,
    level: Annotated[
        list[str] | None,
        typer.Option("--level", metavar="N ...", help="With --plot: also draw frequency responses at these forces."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="F.csv", help="Write the backbones here, and what is known of them to F.json."),
    ] = None,
    plot: Plot = None,
    max_points: MaxPoints = "2000",
    max_seconds: TraceSeconds = "300",
    allow_code: AllowCode = False,
) -> None:
    """Frequency, damping ratio and shape of a mode over its amplitude, and phase resonance with its force.

    Two backbones: the damped nonlinear normal mode (extended periodic motion), and the motion whose drive displacement
    lags the force by 90 degrees. Without --from and --to: from a contact that sticks to one that slides.

    Example:  hbm backbone examples/paper_beam.toml --out modes.csv --plot modes.png --level 2 6.5
    """
    check_outputs("backbone", out, plot)
    number = whole("backbone", "--mode", mode, 1000)
    H = None if harmonics is None else whole("backbone", "--harmonics", harmonics, LARGEST_H)
    amplitudes, budget = _range(begin, end), budget_of("backbone", max_points, max_seconds)
    levels = [positive("backbone", "--level", text, "N") for text in level or ()]
    if levels and plot is None:
        raise InputError("backbone: --level without --plot; must have both")
    from hbm.rigfiles.load import load_rig

    loaded = load_rig(rig, allow_code=allow_code or None)
    _check_mode(loaded, number)
    backbones, failures = _traced(loaded, number, amplitudes, H, budget)
    if backbones:
        curves = _responses(loaded, levels, _band(backbones), failures, budget)
        _deliver(backbones, number, curves, out, plot)
    for failure in failures:
        say(failure, 1)
    if failures:
        raise typer.Exit(1)


# ---------------------------------------------------------------------------------------------------------- options


def _range(begin: str | None, end: str | None) -> tuple[float, float] | None:
    amplitudes = both_ends("backbone", begin, end, "m")
    if amplitudes is not None and amplitudes[0] >= amplitudes[1]:
        raise InputError(f"backbone: --to = {end}; must be more than --from = {begin}")
    return amplitudes


def _check_mode(rig: "AnyRig", mode: int) -> None:
    from hbm.modes.amplitudes import StuckMode

    try:
        StuckMode.of(rig, mode)
    except ValueError as wrong:
        raise InputError(str(wrong).replace("mode =", "--mode =", 1)) from None


# -------------------------------------------------------------------------------------------------------- computing


def _traced(
    rig: "AnyRig", mode: int, amplitudes: tuple[float, float] | None, H: int | None, budget: "Budget"
) -> tuple[list["Backbone"], list[str]]:
    """Nonlinear mode and phase resonance, and a line for each that failed."""
    from continuation import ConvergenceError
    from hbm.commands.progress import Sweep
    from hbm.modes.amplitudes import default_amplitudes
    from hbm.modes.backbone import nonlinear_mode, phase_resonance

    ends = amplitudes or default_amplitudes(rig, mode)
    found: list[Backbone] = []
    failures: list[str] = []
    kinds: dict[str, Any] = {"nonlinear mode": nonlinear_mode, "phase resonance": phase_resonance}
    for name, trace in kinds.items():
        try:
            with Sweep(name, *ends, unit="m") as progress:
                traced = trace(rig, mode, amplitudes=ends, harmonics=H, on_point=progress.point, budget=budget)
        except (ConvergenceError, ArithmeticError) as failed:
            failures.append(f"backbone: {name}: {failed}")
            continue
        found.append(traced)
        if not traced.complete:
            most = f"{traced.amplitude.max():.3g} m"  # past a fold the last one may be far less
            failures.append(f"backbone: {name}: partial, up to {most}; {traced.branch.message}")
    return found, failures


def _band(backbones: Sequence["Backbone"]) -> tuple[float, float]:
    """Frequencies of responses that show the resonance all along some backbones [Hz]."""
    import numpy as np

    hz = np.concatenate([b.hz for b in backbones])
    width = 2.0 * np.concatenate([b.damping_ratio for b in backbones])
    beside = np.clip(BANDWIDTHS * width, *BESIDE)
    return float(np.min(hz * (1.0 - beside))), float(np.max(hz * (1.0 + beside)))


def _responses(
    rig: "AnyRig", levels: Sequence[float], hz: tuple[float, float], failures: list[str], budget: "Budget"
) -> list["ResponseCurve"]:
    from continuation import ConvergenceError
    from hbm.response.trace import trace_frequency

    curves = []
    for level in levels:
        try:
            curves.append(trace_frequency(rig, hz, level=level, budget=budget))
        except (ConvergenceError, ArithmeticError) as failed:
            failures.append(f"backbone: {level:g} N: {failed}")
            continue
        if not curves[-1].complete:
            failures.append(f"backbone: {level:g} N: partial curve; {curves[-1].branch.message}")
    return curves


# --------------------------------------------------------------------------------------------------------- delivery


def _deliver(
    backbones: Sequence["Backbone"], mode: int, curves: Sequence["ResponseCurve"], out: Path | None, plot: Path | None
) -> None:
    from hbm.files.backbonefiles import backbone_contents
    from hbm.modes.accuracy import numerical_change

    def drawn() -> "AxesArray":
        from hbm.figures.backbone import plot_backbones

        return plot_backbones(backbones, curves, number=mode)

    changes = [numerical_change(b) for b in backbones]
    table = {} if out is None else backbone_contents(out, backbones, changes, mode)
    written = write_result(table, plot, drawn)
    _print(backbones, changes, mode)
    print_written(written)


def _print(backbones: Sequence["Backbone"], changes: Sequence["NumericalChange"], mode: int) -> None:
    from hbm.commands.tables import print_lines, print_rows
    from hbm.files.backbonefiles import backbone_name
    from hbm.modes.backbone import NonlinearMode

    screen, rig = console(), backbones[0].rig
    rows, lines = [], []
    for b, change in zip(backbones, changes, strict=True):
        top = int(b.damping_ratio.argmax())
        rows.append(
            {
                "kind": backbone_name(b),
                "points": str(len(b.points)),
                "drive\nmm": _over(1e3 * b.amplitude, ".3g"),
                "frequency\nHz": _over(b.hz, ".3f"),
                "damping\n%": _over(100 * b.damping_ratio, ".3g"),
                "most damped\n%": f"{100 * b.damping_ratio[top]:.3g}",
                "at\nmm": f"{1e3 * b.amplitude[top]:.3g}",
                "force\nN": f"{b.force[top]:.3g}",
                "folds": str(len(b.folds)),
            }
        )
        lines.append(f"{backbone_name(b)}, where most damped: {_accuracy(change)}")
        if isinstance(b, NonlinearMode) and (silent := sum(map(isnan, b.decay_rate))):
            why = "beside an internal resonance the drive does not stand for the motion"
            lines.append(f"{backbone_name(b)}: no decay rate at {silent} of {len(b.points)} motions: {why}")
        if b.lift_off is not None:
            lines.append(f"warning: {backbone_name(b)}: the tip would lift off from {1e3 * b.lift_off:.3g} mm on")
    print_rows(screen, f"{rig.headline}, mode {mode}", rows)
    print_lines(screen, lines)


def _over(values: "npt.NDArray[np.float64]", form: str) -> str:
    """From the first to the last of some values where they change one way; else from the least to the largest."""
    first, last, least, most = values[0], values[-1], values.min(), values.max()
    ends = (first, last) if {first, last} == {least, most} else (least, most)
    return f"{ends[0]:{form}} to {ends[1]:{form}}"


def _accuracy(change: "NumericalChange") -> str:
    """By how much frequency and damping change with finer discretisations, in words."""
    changed = [f"more {how} by {hz:+.2%} and {d:+.2%}" for how, (hz, d) in change.by_source.items() if isfinite(hz)]
    lost = [f"more {how}" for how, (hz, _) in change.by_source.items() if not isfinite(hz)]
    said = [f"frequency and damping change with {', '.join(changed)}"] if changed else []
    said += [f"the same motion was not found with {', '.join(lost)}"] if lost else []
    said += ["modes not estimated, all are kept"] if change.modes is None else []
    return "; ".join(said)
