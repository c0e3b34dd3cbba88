"""The command ``hbm simulate``: time integration from rest."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hbm.commands.budgets import RunSeconds, seconds_of, within
from hbm.commands.deliver import deliver_history
from hbm.commands.options import AllowCode, Plot, RigFile, check_outputs, positive
from hbm.errors import InputError

if TYPE_CHECKING:
    from hbm.integration.history import TimeHistory
    from hbm.integration.jointed import JointHistory
    from models.jointed import AnyRig

LARGEST_HISTORY = 20_000_000  # samples


def simulate(
    rig: RigFile,
    frequency: Annotated[str, typer.Option(metavar="HZ", help="Excitation frequency.", show_default=False)],
    level: Annotated[str | None, typer.Option(metavar="N", help="Force amplitude; the rig's where omitted.")] = None,
    duration: Annotated[
        str | None,
        typer.Option(
            metavar="S",
            help="How long, in seconds, rounded to whole steps, or to whole periods of a rig with joints; 50 periods "
            "where omitted.",
        ),
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
    if contact and out is None:
        raise InputError("simulate: --contact without --out; must have both")
    check_outputs("simulate", out, plot)
    hz = positive("simulate", "--frequency", frequency, "Hz")
    seconds = 50.0 / hz if duration is None else positive("simulate", "--duration", duration, "s")
    force = None if level is None else positive("simulate", "--level", level, "N")
    limit = seconds_of("simulate", max_seconds)
    _check_duration(hz, seconds)
    from hbm.rigfiles.load import load_rig

    history = _march(load_rig(rig, allow_code=allow_code or None), hz, force, seconds, limit)
    deliver_history(history, out, plot, contact=contact)


def _check_duration(hz: float, seconds: float) -> None:
    periods = hz * seconds
    if periods * 512 < 1:
        raise InputError(f"simulate: --duration = {seconds:g}; must be at least a step, {1 / (512 * hz):.3g} s here")
    if periods * 512 > LARGEST_HISTORY:
        most = LARGEST_HISTORY / 512 / hz
        raise InputError(f"simulate: --duration = {seconds:g}; must be <= {most:.6g} s at {hz:g} Hz, for memory's sake")


def _march(rig: "AnyRig", hz: float, level: float | None, seconds: float, limit: float) -> "TimeHistory | JointHistory":
    from hbm.commands.progress import Sweep
    from hbm.integration.integrate import simulate as march

    advice = "try a shorter --duration, or a larger --max-seconds"
    with Sweep("time", 0.0, seconds, unit="s") as progress, within("simulate", limit, progress.doing, advice):
        return march(rig, hz, level=level, duration=seconds, progress=progress.time)
