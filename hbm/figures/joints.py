"""Figures of rigs with joints: the drive, and at every port force and motion, one colour a port."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes

from hbm.figures.style import FAINT, INK, SMALL, AxesArray, align_labels, as_written, dressed, headed, panels

if TYPE_CHECKING:
    from hbm.integration.jointed import JointHistory
    from hbm.response.curve import ResponseCurve
    from models.jointed import JointedRig

SHOWN = 1e-4
"""Share of the largest value below which a value is left off the panel."""

LEGEND = 12
"""Largest number of ports that are named in a legend."""


def colors_of(rig: "JointedRig") -> list[Any]:
    """A colour for each port, of one joint in neighbouring ones."""
    return list(colormaps["viridis"](np.linspace(0.0, 0.9, rig.ports)))


def _units(rig: "JointedRig") -> tuple[str, str]:
    """Units of forces, and of motions in millionths."""
    motions, forces = (list(dict.fromkeys(units)) for units in zip(*(rig.units or [("m", "N")]), strict=True))
    return ", ".join(forces), ", ".join(f"µ{unit}" for unit in motions)


def draw_joints(curves: Sequence["ResponseCurve"], force: Axes, motion: Axes) -> None:
    """Peaks of force and motion at every port over what is varied; every level in the port's colour."""
    rig: Any = curves[0].rig
    if not rig.joints:
        force.set_axis_off()
        motion.set_axis_off()
        return
    for i, curve in enumerate(curves):
        for color, f, u in zip(colors_of(rig), rig.forces, rig.motions, strict=True):
            label = as_written(f.replace(".force", "")) if i == 0 else "_"
            force.plot(curve.values, curve[f].peak, color=color, linewidth=1.2, label=label)
            motion.plot(curve.values, curve[u].peak * 1e6, color=color, linewidth=1.2)
    for ax in (force, motion):
        ax.set_yscale("log")
        highest = max(float(np.max(np.asarray(line.get_ydata(), dtype=float))) for line in ax.get_lines())
        lowest = min(float(np.min(np.asarray(line.get_ydata(), dtype=float))) for line in ax.get_lines())
        ax.set_ylim(bottom=max(lowest, SHOWN * highest) / 2)
    if rig.ports <= LEGEND:
        columns = 1 + (rig.ports - 1) // 6
        force.legend(frameon=False, fontsize=SMALL, labelcolor=INK, loc="best", ncols=columns)
    dressed(force, "", f"Joint force,\npeak [{_units(rig)[0]}]")
    dressed(motion, "", f"Joint motion,\npeak [{_units(rig)[1]}]")


def plot_joint_history(history: "JointHistory", axes: AxesArray | None = None, *, periods: int = 3) -> AxesArray:
    """Drive displacement, joint forces and joint motions over time, and their last periods enlarged.

    Parameters
    ----------
    history : JointHistory
    axes : array of six Axes, optional
    periods : int
        How many of the last periods are enlarged.

    Returns
    -------
    (3, 2) array of Axes
    """
    rig = history.rig
    grid = panels(axes, 3, 2, 5.2, sharex="col", sharey="row", width_ratios=(2, 1)).reshape(3, 2)
    last = slice(-min(periods * history.samples_per_period + 1, len(history.time)), None)
    rows = (
        (["drive"], 1e3, "Drive\n[mm]", [INK]),
        (rig.forces, 1.0, f"Joint force\n[{_units(rig)[0]}]", colors_of(rig)),
        (rig.motions, 1e6, f"Joint motion\n[{_units(rig)[1]}]", colors_of(rig)),
    )
    for (whole, enlarged), (names, scale, label, colors) in zip(grid, rows, strict=True):
        for name, color in zip(names, colors, strict=True):
            y = history.channels[name].values * scale
            whole.plot(history.time, y, color=color, linewidth=0.5)
            enlarged.plot(
                history.time[last] * 1e3,
                y[last],
                color=color,
                linewidth=1.2,
                label=as_written(name.replace(".force", "")),
            )
        for ax, text in ((whole, label), (enlarged, "")):
            ax.axhline(0.0, color=FAINT, linewidth=0.6, zorder=0)
            ax.margins(x=0)
            dressed(ax, "", text)
    if rig.ports <= LEGEND:
        grid[1][0].legend(
            *grid[1][1].get_legend_handles_labels(), fontsize=SMALL, labelcolor=INK, loc="upper right", ncols=3
        )
    grid[-1][0].set_xlabel("Time [s]", color=INK)
    grid[-1][1].set_xlabel(f"Time [ms], last {periods} periods", color=INK)
    headed(grid[0][0], f"{rig.name}, {history.level:g} N at {history.hz:g} Hz")
    return align_labels(grid)
