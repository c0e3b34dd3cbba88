"""The command ``hbm frf``: frequency response curves."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hbm import interrupts
from hbm.commands.budgets import MaxPoints, TraceSeconds, budget_of
from hbm.commands.deliver import Drawing, deliver_curves
from hbm.commands.drawing import Log, Measured, PerForce, Sensors, check_drawing, levels_of, load_points
from hbm.commands.options import (
    AllowCode,
    Harmonics,
    Plot,
    RigFile,
    both_ends,
    check_outputs,
    harmonics_or_auto,
    named,
    positive,
    say,
)
from hbm.commands.stability import Stability, judged
from hbm.errors import InputError

if TYPE_CHECKING:
    from hbm.response.budget import Budget
    from hbm.response.curve import ResponseCurve
    from models.jointed import AnyRig


def frf(
    rig: RigFile,
    begin: Annotated[
        str | None, typer.Option("--from", metavar="HZ", help="First frequency; with --to. May be the higher one.")
    ] = None,
    end: Annotated[str | None, typer.Option("--to", metavar="HZ", help="Last frequency; with --from.")] = None,
    level: Annotated[
        list[str] | None,
        typer.Option(
            "--level",
            metavar="N ...",
            help="Force amplitudes, several after one flag (--level 2 4 6.5) or the flag repeated; "
            "the rig's where omitted.",
        ),
    ] = None,
    law: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Another friction law on the same rig, with its published or assumed parameters (see hbm laws); "
            "or one's own, file.py:Class.",
        ),
    ] = None,
    harmonics: Harmonics = "auto",
    out: Annotated[
        Path | None, typer.Option(metavar="F.csv", help="Write the curves here, and what is known of them to F.json.")
    ] = None,
    plot: Plot = None,
    stability: Stability = True,
    allow_code: AllowCode = False,
    measured: Measured = None,
    sensors: Sensors = False,
    log: Log = False,
    per_force: PerForce = False,
    max_points: MaxPoints = "5000",
    max_seconds: TraceSeconds = "300",
) -> None:
    """Frequency response curves, each with its numerical error, its stability and its bifurcations.

    Without --from and --to: 0.85 to 1.35 of the first sliding resonance, further where the stuck one lies beyond.

    Example:  hbm frf examples/paper_beam.toml --from 45 --to 60 --level 2 4 6.5 --out beam.csv --plot beam.png

    Example:  hbm frf rig.toml --measured spectra.csv --log --plot over_the_points.png
    """
    from hbm.rigfiles.lawchoice import choose_law
    from hbm.rigfiles.load import load_contact_rig, load_rig
    from models.rig import Rig

    check_outputs("frf", out, plot)
    check_drawing("frf", plot, measured, sensors=sensors, flags={"--log": log, "--per-force": per_force})
    hz, levels, H = _range(begin, end), _levels(level), harmonics_or_auto("frf", harmonics)
    budget = budget_of("frf", max_points, max_seconds)
    loaded: AnyRig = (
        load_rig(rig, allow_code=allow_code or None)
        if law is None
        else load_contact_rig(rig, "frf --law", allow_code=allow_code or None)
    )
    if isinstance(loaded, Rig) and law is not None:
        with named("frf"):
            choice = choose_law(loaded, law)
        loaded = choice.rig
        print(choice)
    points = load_points(measured, loaded)
    levels = levels or (levels_of(points) if points else [loaded.excitation.amplitude])
    curves, failures, status = _responses(loaded, hz, levels, H, budget, stability=stability)
    failures += [_partial(c) for c in curves if not c.complete]
    if curves:
        deliver_curves(curves, out, plot, Drawing(points, sensors, log, per_force))
    for failure in failures:
        say(failure, status)
    if failures:
        sys.exit(status)


def _range(begin: str | None, end: str | None) -> tuple[float, float] | None:
    hz = both_ends("frf", begin, end, "Hz")
    if hz is not None and hz[0] == hz[1]:
        raise InputError(f"frf: --to = {end}; must differ from --from = {begin}")
    return hz


def _levels(texts: list[str] | None) -> list[float]:
    levels = [positive("frf", "--level", text, "N") for text in texts or ()]
    for i, level in enumerate(levels):
        if level in levels[:i]:
            raise InputError(f"frf: --level = {level:g} twice; must be different forces")
    return levels


def _responses(
    rig: "AnyRig",
    hz: tuple[float, float] | None,
    levels: Sequence[float],
    harmonics: int | None,
    budget: "Budget",
    *,
    stability: bool,
) -> tuple[list["ResponseCurve"], list[str], int]:
    """Curves of the levels, a line for each that failed, the exit status then; an interrupt keeps what was found."""
    from continuation import ConvergenceError, End
    from hbm.commands.progress import Sweep
    from hbm.modes.linear import sliding_to_stuck
    from hbm.response.accuracy import frequency_response
    from hbm.response.trace import sweep_of

    curves: list[ResponseCurve] = []
    failures: list[str] = []
    status = 1
    sweep = sweep_of(rig, hz or sliding_to_stuck(rig), "frf")
    for level in levels:
        try:
            with Sweep(f"{level:g} N", *sweep) as progress:
                curve = frequency_response(
                    rig, sweep, level=level, harmonics=harmonics, on_point=progress.point, budget=budget
                )
                curves.append(curve)
                if stability and curves[-1].branch.end is not End.STOPPED_BY_CALLER:  # it has cost enough
                    curves[-1] = judged(curve)
        except (ConvergenceError, ArithmeticError) as failed:
            failures.append(f"frf: {level:g} N: {failed}")
        except KeyboardInterrupt:
            status = interrupts.status()
            left = len(levels) - len(curves) - len(failures)
            alone = "kept without its stability, " if curves and curves[-1].level == level else ""
            failures.append(f"frf: interrupted at {level:g} N; {alone}{left} of {len(levels)} levels not computed")
            break
    return curves, failures, status


def _partial(curve: "ResponseCurve") -> str:
    return f"frf: {curve.level:g} N: partial curve, {curve.hz[0]:.5g} to {curve.hz[-1]:.5g} Hz; {curve.branch.message}"
