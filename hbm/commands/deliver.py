"""Files and figures that commands write of curves, loops and histories."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from hbm.commands.options import console, print_written

if TYPE_CHECKING:
    from hbm.integration.history import TimeHistory
    from hbm.integration.jointed import JointHistory
    from hbm.response.curve import ResponseCurve
    from hbm.rigfiles.lawchoice import KnownLaw


def deliver_loops(known: Sequence["KnownLaw"], slip: float, hz: float, load: float, plot: Path) -> None:
    """Loops of laws: printed, and drawn to a file."""
    from hbm.commands.tables import print_loops
    from hbm.figures import plot_loops
    from hbm.files.curves import write_figure
    from hbm.response.loop import friction_loop

    loops = [friction_loop(k.law, slip, hz, load=load) for k in known]
    written = write_figure(plot, plot_loops(loops))
    print_loops(console(), loops, [k.name for k in known])
    print_written(written)


def deliver_curves(curves: Sequence["ResponseCurve"], out: Path | None, plot: Path | None) -> None:
    """Curves: written to a table, drawn to a file."""
    from hbm.commands.tables import print_curves
    from hbm.files.curves import write_curves, write_figure

    written = [] if out is None else write_curves(out, curves)
    if plot is not None:
        from hbm.figures import plot_curves

        written += write_figure(plot, plot_curves(curves))
    print_curves(console(), curves)
    print_written(written)


def deliver_history(
    history: "TimeHistory | JointHistory", out: Path | None, plot: Path | None, *, contact: bool
) -> None:
    """A history: written to a table, drawn to a file."""
    from hbm.commands.tables import print_history
    from hbm.files.curves import write_figure, write_history

    written = [] if out is None else write_history(out, history, contact=contact)
    if plot is not None:
        from hbm.figures import plot_history

        written += write_figure(plot, plot_history(history))
    print_history(console(), history)
    print_written(written)
