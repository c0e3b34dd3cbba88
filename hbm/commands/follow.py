"""The command ``hbm continue``: responses along any number of the rig file."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hbm.commands.budgets import MaxPoints, TraceSeconds, budget_of
from hbm.commands.deliver import write_result
from hbm.commands.options import (
    AllowCode,
    Harmonics,
    Plot,
    RigFile,
    check_outputs,
    console,
    harmonics_or_auto,
    is_number,
    positive,
    print_written,
    quoted,
    say,
)
from hbm.commands.stability import Stability, judged
from hbm.errors import InputError

if TYPE_CHECKING:
    from hbm.figures.style import AxesArray
    from hbm.response.budget import Budget
    from hbm.tracking.parameterresponse import ParameterCurve
    from models.jointed import AnyRig

COMMAND = "continue"


def follow(
    rig: RigFile,
    parameter: Annotated[
        str, typer.Option(metavar="KEY", help="Number of the rig file, contact.friction.mu.", show_default=False)
    ],
    begin: Annotated[str, typer.Option("--from", metavar="A", help="Its first value.", show_default=False)],
    end: Annotated[str, typer.Option("--to", metavar="B", help="Its last; may be the smaller.", show_default=False)],
    frequency: Annotated[
        str | None,
        typer.Option(metavar="HZ", help="Excitation frequency; left out with --parameter frequency_hz."),
    ] = None,
    level: Annotated[str | None, typer.Option(metavar="N", help="Force amplitude; the rig's where omitted.")] = None,
    harmonics: Harmonics = "auto",
    out: Annotated[
        Path | None, typer.Option(metavar="F.csv", help="Write the curve here, and what is known of it to F.json.")
    ] = None,
    plot: Plot = None,
    stability: Stability = True,
    max_points: MaxPoints = "5000",
    max_seconds: TraceSeconds = "300",
    allow_code: AllowCode = False,
) -> None:
    """Response along any number of the rig file at a held frequency and force, through folds, with its stability.

    Numbers of the excitation are excitation.amplitude and frequency_hz. A KEY that is none lists them all.

    Example:  hbm continue examples/paper_beam.toml --parameter contact.friction.mu --from 0.3 --to 0.6 --frequency 50
    """
    check_outputs(COMMAND, out, plot)
    values = _number("--from", begin), _number("--to", end)
    hz = None if frequency is None else positive(COMMAND, "--frequency", frequency, "Hz")
    force = None if level is None else positive(COMMAND, "--level", level, "N")
    H, budget = harmonics_or_auto(COMMAND, harmonics), budget_of(COMMAND, max_points, max_seconds)
    from continuation import End
    from hbm.rigfiles.load import load_rig

    curve = _response(load_rig(rig, allow_code=allow_code or None), parameter, values, hz, force, H, budget)
    if stability and curve.branch.end is not End.STOPPED_BY_CALLER:  # it has cost enough
        curve = judged(curve)
    _deliver(curve, out, plot)
    if not curve.complete:
        reached = f"{curve.values[0]:.5g} to {curve.values[-1]:.5g}"
        raise typer.Exit(say(f"{COMMAND}: partial curve, {parameter} {reached}; {curve.branch.message}", 1))


def _number(option: str, text: str) -> float:
    if not is_number(text) or not math.isfinite(float(text)):
        raise InputError(f"{COMMAND}: {option} = {quoted(text)}; must be a number")
    return float(text)


def _response(
    rig: "AnyRig",
    key: str,
    values: tuple[float, float],
    hz: float | None,
    level: float | None,
    harmonics: int | None,
    budget: "Budget",
) -> "ParameterCurve":
    from continuation import ConvergenceError
    from hbm.commands.progress import Sweep
    from hbm.tracking.parameterresponse import checked, parameter_response

    try:
        checked(rig, key, values, hz=hz, level=level)
    except ValueError as refused:
        raise InputError(f"{COMMAND}: {refused}") from None
    with Sweep(key, *values, unit="") as progress:
        try:
            return parameter_response(
                rig, key, values, hz=hz, level=level, harmonics=harmonics, on_point=progress.point, budget=budget
            )
        except (ConvergenceError, ArithmeticError) as failed:
            raise ArithmeticError(f"{COMMAND}: {failed}") from None


def _deliver(curve: "ParameterCurve", out: Path | None, plot: Path | None) -> None:
    from hbm.commands.parametertables import print_parameter_curve
    from hbm.files.curves import curve_contents

    def drawn() -> "AxesArray":
        from hbm.figures.parameter import plot_parameter_curve

        return plot_parameter_curve(curve)

    written = write_result({} if out is None else curve_contents(out, [curve]), plot, drawn)
    print_parameter_curve(console(), curve)
    print_written(written)
