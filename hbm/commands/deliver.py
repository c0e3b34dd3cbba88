"""Files and figures that commands write of curves, loops and histories."""

from collections.abc import Sequence
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
    from hbm.files.curves import write_curves, write_figure

    written = [] if out is None else write_curves(out, curves)
    if plot is not None:
        written += write_figure(plot, drawing.of(curves))
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
