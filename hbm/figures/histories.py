"""Figures of time histories."""

from typing import TYPE_CHECKING

from matplotlib.layout_engine import ConstrainedLayoutEngine

from hbm.figures.joints import LEGEND, HistoryRow, history_rows
from hbm.figures.style import (
    FAINT,
    INK,
    AxesArray,
    align_labels,
    as_written,
    dressed,
    headed,
    legend_above,
    level_colors,
    panels,
)
from hbm.figures.units import prefixed_together
from models.jointed import JointedRig

if TYPE_CHECKING:
    from hbm.integration.history import TimeHistory
    from hbm.integration.jointed import JointHistory

IN_A_ROW = 6
"""Names of joints in a row of a legend."""

HISTORY_ROWS = (("drive", "Drive"), ("slip", "Slip"), ("friction", "Friction"), ("normal", "Reaction"))


def plot_history(
    history: "TimeHistory | JointHistory", axes: AxesArray | None = None, *, periods: int = 3
) -> AxesArray:
    """Drive displacement, slip, friction force and reaction over time, and their last periods enlarged.

    Parameters
    ----------
    history : TimeHistory
    axes : array of eight Axes, optional
    periods : int
        How many of the last periods are enlarged.

    Returns
    -------
    (4, 2) array of Axes
    """
    rig, style = history.rig, {"color": level_colors([history])[0]}
    rows: list[HistoryRow] = [([name], label, [style]) for name, label in HISTORY_ROWS]
    height, layout, legend = 5.6, ConstrainedLayoutEngine(wspace=0.06), False
    if isinstance(rig, JointedRig):
        rows, layout, legend = history_rows(rig), ConstrainedLayoutEngine(), 0 < rig.ports <= LEGEND
        height = 1.4 + 1.25 * len(rows)
    grid = panels(axes, len(rows), 2, height, layout=layout, sharex="col", sharey="row", width_ratios=(2, 1))
    shown = min(periods, (len(history.time) - 1) // history.samples_per_period)
    last = slice(-(shown * history.samples_per_period + 1) if shown else 0, None)
    for (whole, enlarged), (names, label, styles) in zip(grid, rows, strict=True):
        signals = [history.channels[name] for name in names]
        scale, unit = prefixed_together([s.unit for s in signals], *(s.values for s in signals))
        for name, signal, own in zip(names, signals, styles, strict=True):
            y, said = scale * signal.values, as_written(name.replace(".force", ""))
            whole.plot(history.time, y, color=own["color"], linewidth=0.5)
            enlarged.plot(history.time[last] * 1e3, y[last], linewidth=1.2, label=said, **own)
        for ax, text in ((whole, f"{label}\n[{unit}]"), (enlarged, "")):
            ax.axhline(0.0, color=FAINT, linewidth=0.6, zorder=0)
            ax.margins(x=0)
            dressed(ax, "", text)
    if legend:
        legend_above(grid, grid[1][1].get_legend_handles_labels()[0], ncols=IN_A_ROW)
    grid[-1][0].set_xlabel("Time [s]", color=INK)
    grid[-1][1].set_xlabel(f"Time [ms]{_last(shown)}", color=INK)
    headed(grid[0][0], f"{rig.name}, {history.level:g} N at {history.hz:g} Hz")
    return align_labels(grid)


def _last(periods: int) -> str:
    """What is enlarged, in words; nothing of a history that is shorter than a period."""
    return "" if periods == 0 else ", last period" if periods == 1 else f", last {periods} periods"
