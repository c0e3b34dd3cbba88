"""Figures of time histories."""

from typing import TYPE_CHECKING

from matplotlib.layout_engine import ConstrainedLayoutEngine

from hbm.figures.joints import plot_joint_history
from hbm.figures.style import FAINT, INK, AxesArray, align_labels, dressed, headed, level_colors, panels
from models.jointed import JointedRig

if TYPE_CHECKING:
    from hbm.integration.history import TimeHistory
    from hbm.integration.jointed import JointHistory

HISTORY_ROWS = (
    ("drive", 1e3, "Drive\n[mm]"),
    ("slip", 1e6, "Slip\n[µm]"),
    ("friction", 1.0, "Friction\n[N]"),
    ("normal", 1.0, "Reaction\n[N]"),
)


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
    if isinstance(history.rig, JointedRig):
        return plot_joint_history(history, axes, periods=periods)
    layout = ConstrainedLayoutEngine(wspace=0.06)
    grid = panels(axes, 4, 2, 5.6, layout=layout, sharex="col", sharey="row", width_ratios=(2, 1))
    last = slice(-min(periods * history.samples_per_period + 1, len(history.time)), None)
    color = level_colors([history])[0]
    for row, (name, scale, label) in zip(grid, HISTORY_ROWS, strict=True):
        y = history.channels[name].values * scale
        row[0].plot(history.time, y, color=color, linewidth=0.5)
        row[1].plot(history.time[last] * 1e3, y[last], color=color, linewidth=1.2)
        for ax, text in zip(row, (label, ""), strict=True):
            ax.axhline(0.0, color=FAINT, linewidth=0.6, zorder=0)
            ax.margins(x=0)
            dressed(ax, "", text)
    grid[-1][0].set_xlabel("Time [s]", color=INK)
    grid[-1][1].set_xlabel(f"Time [ms], last {periods} periods", color=INK)
    headed(grid[0][0], f"{history.rig.name}, {history.level:g} N at {history.hz:g} Hz")
    return align_labels(grid)
