"""Files and figures that commands write of curves, loops and histories."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from hbm.commands.options import console, print_written

if TYPE_CHECKING:
    from hbm.figures.style import AxesArray
    from hbm.integration.history import TimeHistory
    from hbm.integration.jointed import JointHistory
    from hbm.measurement.spectra import MeasuredSpectra
    from hbm.response.curve import ResponseCurve
    from hbm.rigfiles.lawchoice import KnownLaw
    from hbm.textfiles import Contents


def write_result(table: "Contents", plot: Path | None, draw: Callable[[], "AxesArray"]) -> list[Path]:
    """Write a table, its companion and its figure: all appear, or none.

    Parameters
    ----------
    table : mapping of Path to str or bytes
        Contents of the table and of its companion; empty where only a figure is asked for.
    plot : Path or None
        File of the figure; its ending names the format.
    draw : callable
        Gives the panels of the figure.

    Returns
    -------
    list of Path
        Files written, in order.

    Raises
    ------
    InputError
        If one cannot be written.
    """
    from hbm.textfiles import write_together

    if plot is None:
        return write_together(table)
    from hbm.figures.page import figure_bytes, settle

    drawn = figure_bytes(settle(draw().flat[0].figure), plot.suffix[1:].lower())
    return write_together({**table, plot: drawn})


def deliver_loops(known: Sequence["KnownLaw"], slip: float, hz: float, load: float, plot: Path) -> None:
    """Loops of laws: printed, and drawn to a file."""
    from hbm.commands.tables import print_loops
    from hbm.figures import plot_loops
    from hbm.response.loop import friction_loop

    loops = [friction_loop(k.law, slip, hz, load=load) for k in known]
    written = write_result({}, plot, lambda: plot_loops(loops))
    print_loops(console(), loops, [k.name for k in known])
    print_written(written)


@dataclass(frozen=True)
class Drawing:
    """How curves are drawn: the page of the contact, or a panel for each sensor.

    Attributes
    ----------
    measured : MeasuredSpectra or None
        Points to draw over the curves of sensors.
    sensors, log, per_force : bool
    """

    measured: "MeasuredSpectra | None" = None
    sensors: bool = False
    log: bool = False
    per_force: bool = False

    def of(self, curves: Sequence["ResponseCurve"]) -> "AxesArray":
        """Panels with the curves."""
        from hbm.figures import plot_curves, plot_sensors

        if not self.sensors and self.measured is None:
            return plot_curves(curves)
        return plot_sensors(curves, measured=self.measured, log=self.log, per_force=self.per_force)


def deliver_curves(curves: Sequence["ResponseCurve"], out: Path | None, plot: Path | None, drawing: Drawing) -> None:
    """Curves: written to a table, drawn to a file."""
    from hbm.commands.tables import print_curves
    from hbm.files.curves import curve_contents

    written = write_result({} if out is None else curve_contents(out, curves), plot, lambda: drawing.of(curves))
    print_curves(console(), curves)
    print_written(written)


def deliver_history(
    history: "TimeHistory | JointHistory", out: Path | None, plot: Path | None, *, contact: bool
) -> None:
    """A history: written to a table, drawn to a file."""
    from hbm.commands.tables import print_history
    from hbm.files.curves import history_contents

    def drawn() -> "AxesArray":
        from hbm.figures import plot_history

        return plot_history(history)

    table = {} if out is None else history_contents(out, history, contact=contact)
    written = write_result(table, plot, drawn)
    print_history(console(), history)
    print_written(written)
