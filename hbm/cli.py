"""The command ``hbm``: arguments, progress, printing, exit status; docs/reference/commands.md.

Exit status 0: done. 1: a computation failed; what was found is written, and marked. 2: bad input, nothing was
written. 130, 143: ended by SIGINT or SIGTERM; what is complete is kept, or nothing. Every failure is one line on
stderr. Heavy modules are imported by the command that needs them.
"""

import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer._click.exceptions import NoArgsIsHelpError, UsageError
from typer.core import TyperGroup

from hbm import interrupts
from hbm.commands.backbone import backbone
from hbm.commands.budgets import MaxPoints, RunSeconds, TraceSeconds, budget_of, seconds_of, within
from hbm.commands.decay import decay
from hbm.commands.deliver import Drawing, deliver_curves, deliver_history, deliver_loops
from hbm.commands.diagnose import diagnose
from hbm.commands.drawing import Log, Measured, PerForce, Sensors, check_drawing, levels_of, load_points
from hbm.commands.examples import examples
from hbm.commands.follow import follow
from hbm.commands.identify import identify
from hbm.commands.inverse import inverse
from hbm.commands.loops import loops
from hbm.commands.modal import modal
from hbm.commands.multisine import multisine
from hbm.commands.options import (
    AllowCode,
    Harmonics,
    Plot,
    RigFile,
    both_ends,
    check_outputs,
    console,
    harmonics_or_auto,
    named,
    positive,
    quoted,
    say,
    spreading,
    warnings_in_one_line,
)
from hbm.commands.spectra import spectra
from hbm.commands.stability import Stability, judged
from hbm.commands.synthesize import synthesize
from hbm.errors import InputError

if TYPE_CHECKING:
    from hbm.integration.history import TimeHistory
    from hbm.integration.jointed import JointHistory
    from hbm.response.budget import Budget
    from hbm.response.curve import ResponseCurve
    from hbm.rigfiles.lawchoice import KnownLaw
    from models.jointed import AnyRig

INTERRUPTED = 130
"""Status that Typer gives to a keyboard interrupt."""

THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
"""More than one costs time on matrices this small, and the last digits then depend on the machine."""

LARGEST_HISTORY = 20_000_000  # samples


class OneLine(TyperGroup):
    """Commands whose failures are one line on stderr and an exit status."""

    def main(self, *args: Any, **options: Any) -> Any:
        """Run, say a failure in one line, and exit."""
        options["standalone_mode"] = False
        sys.exit(_status(lambda: super(OneLine, self).main(*args, **options)))


app = typer.Typer(cls=OneLine, no_args_is_help=True, add_completion=True, pretty_exceptions_enable=False)


def main() -> None:
    """Entry point of the console script."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")  # a terminal without µ is no reason to fail
    os.environ.update(dict.fromkeys(THREADS, "1"))
    os.environ.setdefault("PYTHONSAFEPATH", "1")  # else workers import what lies in the working folder by accident
    os.environ.setdefault("MPLBACKEND", "agg")  # figures go to files; no window is opened for them
    interrupts.listen()
    try:
        app(prog_name="hbm")
    except KeyboardInterrupt:  # before or after Typer answers it
        say(interrupts.said(), 0)
    finally:
        interrupts.conclude()


def _status(run: Callable[[], Any]) -> int:
    """Exit status of a run; what went wrong goes to stderr."""
    try:
        with warnings_in_one_line():
            status = int(run() or 0)
    except InputError as refused:
        return say(str(refused), 2)
    except (ArithmeticError, MemoryError) as failed:
        return say(f"hbm: {str(failed) or 'out of memory'}", 1)
    except UsageError as misused:
        return say(_usage(misused), misused.exit_code)
    return say(interrupts.said(), interrupts.status()) if status == INTERRUPTED else status


def _usage(error: UsageError) -> str:
    if isinstance(error, NoArgsIsHelpError):
        return error.format_message()
    path = error.ctx.command_path if error.ctx else "hbm"
    text = error.format_message().rstrip(".")
    return f"{path}: {text[:1].lower()}{text[1:]}; see {path} --help"


# --------------------------------------------------------------------------------------------------------- commands


def _version(wanted: bool) -> None:
    if wanted:
        from hbm import __version__

        print(f"hbm {__version__}")
        raise typer.Exit


@app.callback()
def hbm(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Harmonic balance for beams and structures that rub on a support.

    Start with:  hbm frf examples/paper_beam.toml --plot beam.png
    """


@app.command()
def modes(rig: RigFile, allow_code: AllowCode = False) -> None:
    """Natural frequencies, sliding and stuck, damping, and the residual compliance.

    Example:  hbm modes examples/paper_beam.toml
    """
    from hbm.commands.tables import print_modes
    from hbm.modes.linear import linear_modes
    from hbm.rigfiles.load import load_rig

    loaded = load_rig(rig, allow_code=allow_code or None)
    print_modes(console(), loaded, linear_modes(loaded))


@app.command()
def laws(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="NAME", help="Laws, or one's own, file.py:Class; all if omitted."),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(
            metavar="F.png", help="Save a figure of the laws' loops under a prescribed slip (png, pdf or svg)."
        ),
    ] = None,
    slip: Annotated[
        str | None, typer.Option(metavar="M", help="With --plot: amplitude of the slip in m; 1e-5 where omitted.")
    ] = None,
    frequency: Annotated[
        str | None, typer.Option(metavar="HZ", help="With --plot: frequency of the slip; 50 where omitted.")
    ] = None,
    load: Annotated[str | None, typer.Option(metavar="N", help="With --plot: normal load; 83 where omitted.")] = None,
) -> None:
    """Friction laws: parameters, units, bounds, sources; and their loops, force against slip and slip velocity.

    Example:  hbm laws dahl iwan --plot loops.png
    """
    check_outputs("laws", None, plot)
    for option, given in {"--slip": slip, "--frequency": frequency, "--load": load}.items():
        if given is not None and plot is None:
            raise InputError(f"laws: {option} without --plot; must have both")
    amplitude = positive("laws", "--slip", slip or "1e-5", "m")
    hz = positive("laws", "--frequency", frequency or "50", "Hz")
    force = positive("laws", "--load", load or "83", "N")
    chosen = _laws(names)
    if plot is not None:
        deliver_loops(_with_values(chosen, refuse=bool(names)), amplitude, hz, force, plot)
        return
    from hbm.commands.tables import print_laws

    print_laws(console(), chosen, detailed=bool(names))


@app.command(cls=spreading("--level"))
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


@app.command()
def simulate(
    rig: RigFile,
    frequency: Annotated[str, typer.Option(metavar="HZ", help="Excitation frequency.", show_default=False)],
    duration: Annotated[
        str | None, typer.Option(metavar="S", help="How long, in seconds; 50 periods where omitted.")
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="F.csv", help="Write the rig's channels over time here.")] = None,
    plot: Plot = None,
    contact: Annotated[
        bool, typer.Option("--contact", help="Also write drive, slip, slip_velocity, friction and normal to --out.")
    ] = False,
    max_seconds: RunSeconds = "600",
    allow_code: AllowCode = False,
) -> None:
    """Time integration from rest.

    Example:  hbm simulate examples/paper_beam.toml --frequency 50 --duration 2 --out run.csv --plot run.png
    """
    check_outputs("simulate", out, plot)
    hz = positive("simulate", "--frequency", frequency, "Hz")
    seconds = 50.0 / hz if duration is None else positive("simulate", "--duration", duration, "s")
    limit = seconds_of("simulate", max_seconds)
    _check_duration(hz, seconds)
    from hbm.rigfiles.load import load_rig

    history = _march(load_rig(rig, allow_code=allow_code or None), hz, seconds, limit)
    deliver_history(history, out, plot, contact=contact)


app.command(cls=spreading("--level"))(backbone)
app.command(cls=spreading("--fundamental", "--level"))(spectra)
app.command()(decay)
app.command()(multisine)
app.command(cls=spreading("--record"))(modal)
app.command()(loops)
app.command(cls=spreading("--levels", "--frequencies"))(synthesize)
app.command(cls=spreading("--record"))(inverse)
app.command(cls=spreading("--held-out"))(identify)
app.command(cls=spreading("--hold-out"))(diagnose)
app.command("continue")(follow)
app.command()(examples)


# ---------------------------------------------------------------------------------------------------------- options


def _laws(names: Sequence[str] | None) -> list[Any]:
    from hbm.rigfiles.laws import find_law
    from models import LAWS

    laws = []
    for name in names or LAWS:
        with named(f"laws: {quoted(name)}", ";"):
            laws.append(find_law(name, Path()))
    return laws


def _with_values(laws: Sequence[Any], *, refuse: bool) -> list["KnownLaw"]:
    """Laws with the parameters that are known of them; those without any are refused or left out."""
    from hbm.rigfiles.lawchoice import known_law
    from models import describe

    known = {law: known_law(law) for law in laws}
    for law, values in known.items():
        if values is None and refuse:
            raise InputError(f"laws: --plot of {law.name}; no parameters are known of it to draw its loops with")
    return [values for law, values in known.items() if values is not None and (refuse or describe(law))]


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


def _check_duration(hz: float, seconds: float) -> None:
    periods = hz * seconds
    if periods * 512 < 1:
        raise InputError(f"simulate: --duration = {seconds:g}; must be at least a step, {1 / (512 * hz):.3g} s here")
    if periods * 512 > LARGEST_HISTORY:
        most = LARGEST_HISTORY / 512 / hz
        raise InputError(f"simulate: --duration = {seconds:g}; must be <= {most:.6g} s at {hz:g} Hz, for memory's sake")


# -------------------------------------------------------------------------------------------------------- computing


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


def _march(rig: "AnyRig", hz: float, seconds: float, limit: float) -> "TimeHistory | JointHistory":
    from hbm.commands.progress import Sweep
    from hbm.integration.integrate import simulate as march

    advice = "try a shorter --duration, or a larger --max-seconds"
    with Sweep("time", 0.0, seconds, unit="s") as progress, within("simulate", limit, progress.doing, advice):
        return march(rig, hz, duration=seconds, progress=progress.time)


# --------------------------------------------------------------------------------------------------------- delivery


if __name__ == "__main__":
    main()
