"""Figures of rigs with joints: the drive, and at every port force and motion, one colour a port."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes

from hbm.figures.style import INK, SMALL, as_written, dressed

if TYPE_CHECKING:
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


def history_rows(rig: "JointedRig") -> list[tuple[Sequence[str], float, str, list[Any]]]:
    """Signals of a history of a rig with joints, panel by panel: their names, scale, label and colours."""
    return [
        (["drive"], 1e3, "Drive\n[mm]", [INK]),
        (rig.forces, 1.0, f"Joint force\n[{_units(rig)[0]}]", colors_of(rig)),
        (rig.motions, 1e6, f"Joint motion\n[{_units(rig)[1]}]", colors_of(rig)),
    ]
