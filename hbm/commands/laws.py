"""The command ``hbm laws``: laws of friction and of joints, and the loops of those of friction."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hbm.commands.deliver import deliver_loops
from hbm.commands.options import check_outputs, console, named, positive, quoted
from hbm.errors import InputError

if TYPE_CHECKING:
    from hbm.rigfiles.lawchoice import KnownLaw


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
    """Laws of friction and of joints: parameters, units, bounds, sources.

    And loops of those of friction, force against slip and slip velocity.

    Example:  hbm laws dahl iwan --plot loops.png
    """
    check_outputs("laws", None, plot)
    for option, given in {"--slip": slip, "--frequency": frequency, "--load": load}.items():
        if given is not None and plot is None:
            raise InputError(f"laws: {option} without --plot; must have both")
    amplitude = positive("laws", "--slip", slip or "1e-5", "m")
    hz = positive("laws", "--frequency", frequency or "50", "Hz")
    force = positive("laws", "--load", load or "83", "N")
    chosen = _laws(names, drawn=plot is not None)
    if plot is not None:
        deliver_loops(_with_values(chosen, refuse=bool(names)), amplitude, hz, force, plot)
        return
    from hbm.commands.tables import print_laws

    print_laws(console(), chosen, detailed=bool(names))


def _laws(names: Sequence[str] | None, *, drawn: bool) -> list[Any]:
    """Laws by name, or all; those of joints have no loops to be drawn."""
    from hbm.rigfiles.laws import find_law
    from models import LAWS
    from models.joints import JOINT_LAWS

    known, laws = LAWS if drawn else LAWS | JOINT_LAWS, []
    for name in names or known:
        with named(f"laws: {'--plot of ' if drawn else ''}{quoted(name)}", ";"):
            laws.append(find_law(name, Path(), known=known))
    return laws


def _way(law: Any) -> str:
    """How to make parameters of a law of one's own known."""
    from models import LAWS

    ready = f"; write a ready-made one into its file, NAME = {law.__name__}(...), or give all its fields defaults"
    return "" if law in LAWS.values() else ready


def _with_values(laws: Sequence[Any], *, refuse: bool) -> list["KnownLaw"]:
    """Laws with the parameters that are known of them; those without any are refused or left out."""
    from hbm.rigfiles.lawchoice import known_law
    from models import describe

    known = {law: known_law(law) for law in laws}
    for law, values in known.items():
        if values is None and refuse:
            drawn = "no parameters are known of it to draw its loops with"
            raise InputError(f"laws: --plot of {law.name}; {drawn}{_way(law)}")
    return [values for law, values in known.items() if values is not None and (refuse or describe(law))]
