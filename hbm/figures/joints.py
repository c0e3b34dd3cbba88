"""Figures of rigs with joints: the drive, and at every port force and motion, one colour a port."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from hbm.figures.scales import logarithmic
from hbm.figures.stretches import draw_line
from hbm.figures.style import INK, as_written, dressed, legend_on_top

if TYPE_CHECKING:
    from hbm.response.curve import ResponseCurve
    from models.jointed import JointedRig

SHOWN = 1e-4
"""Share of the largest value below which a value is left off the panel."""

WIDTHS = (0.7, 1.7)
"""Of the lines of the lowest and of the highest level."""

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
    """Peaks of force and motion at every port over what is varied, a colour a port; the higher the level the wider."""
    rig: Any = curves[0].rig
    if not rig.joints:
        force.set_axis_off()
        motion.set_axis_off()
        return
    curves = sorted(curves, key=lambda c: c.level)
    widths = np.linspace(*WIDTHS, len(curves)) if len(curves) > 1 else [float(np.mean(WIDTHS))]
    for ax, names, scale in ((force, rig.forces, 1.0), (motion, rig.motions, 1e6)):
        peaks = [[scale * curve[name].peak for name in names] for curve in curves]
        for curve, width, own in zip(curves, widths, peaks, strict=True):
            for color, peak in zip(colors_of(rig), own, strict=True):
                draw_line(ax, curve, peak, color, width)
        logarithmic(ax.yaxis)
        highest, lowest = (float(find([find(p) for own in peaks for p in own])) for find in (np.max, np.min))
        ax.set_ylim(bottom=max(lowest, SHOWN * highest) / 2)
    handles = []
    if rig.ports <= LEGEND:
        named = zip(colors_of(rig), rig.forces, strict=True)
        handles = [Line2D([], [], color=c, label=as_written(f.replace(".force", ""))) for c, f in named]
    if len(curves) > 1:
        levels = zip(widths, curves, strict=True)
        handles += [Line2D([], [], color=INK, linewidth=w, label=f"{c.level:g} N") for w, c in levels]
    if handles:
        legend_on_top(force, handles)
    dressed(force, "", f"Joint force,\npeak [{_units(rig)[0]}]")
    dressed(motion, "", f"Joint motion,\npeak [{_units(rig)[1]}]")


def history_rows(rig: "JointedRig") -> list[tuple[Sequence[str], float, str, list[Any]]]:
    """Signals of a history of a rig with joints, panel by panel: their names, scale, label and colours."""
    return [
        (["drive"], 1e3, "Drive\n[mm]", [INK]),
        (rig.forces, 1.0, f"Joint force\n[{_units(rig)[0]}]", colors_of(rig)),
        (rig.motions, 1e6, f"Joint motion\n[{_units(rig)[1]}]", colors_of(rig)),
    ]
