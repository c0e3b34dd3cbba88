"""Figures of rigs with joints: the drive, and at every port force and motion, a colour and a marker for each port."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from hbm.balance.problem import TOLERANCE
from hbm.figures.scales import logarithmic
from hbm.figures.stretches import draw_line
from hbm.figures.style import INK, as_written, dressed, legend_on_top, level_colors, say_nothing
from hbm.figures.units import prefixed_together
from hbm.fourier import Array

if TYPE_CHECKING:
    from hbm.response.curve import ResponseCurve
    from models.jointed import JointedRig

SHOWN = 1e-4
"""Share of the largest value that a port reaches somewhere, whose least values the panel then spans."""

WIDTHS = (0.7, 1.7)
"""Of the lines of the lowest and of the highest level."""

LEGEND = 12
"""Largest number of ports that are named in a legend."""


COLORS = ("#000000", "#E69F00", "#0072B2", "#56B4E9", "#009E73", "#CC79A7", "#D55E00")
"""Colours of neighbouring ports; distinct without colour vision, and unlike the next in grey (Okabe, Ito)."""

MARKERS = "os^DvX*Pp<>h"
"""One for each port that is named: they tell ports apart where colours cannot, as in grey print."""

APART = 0.2
"""Distance between the markers on a line, as a share of the panel's diagonal; those of different ports stand apart."""


def styles_of(rig: "JointedRig") -> list[dict[str, Any]]:
    """Style of the lines of each port; ports that are too many to be named have neighbouring colours alone."""
    if rig.ports == 1:
        return [{"color": level_colors([rig])[0]}]
    if rig.ports > LEGEND:
        return [{"color": color} for color in colormaps["viridis"](np.linspace(0.0, 0.9, rig.ports))]
    return [
        {"color": COLORS[i % len(COLORS)], "marker": MARKERS[i], "markersize": 3.6, "markevery": (start, APART)}
        for i, start in enumerate(APART * np.arange(rig.ports) / rig.ports)
    ]


def draw_joints(curves: Sequence["ResponseCurve"], force: Axes, motion: Axes) -> None:
    """Peaks of force and motion at every port over what is varied; the higher the level the wider the line."""
    rig: Any = curves[0].rig
    if not rig.joints:
        force.set_axis_off()
        motion.set_axis_off()
        return
    curves = sorted(curves, key=lambda c: c.level)
    widths = np.linspace(*WIDTHS, len(curves)).tolist() if len(curves) > 1 else [float(np.mean(WIDTHS))]
    for ax, names, what in ((force, rig.forces, "force"), (motion, rig.motions, "motion")):
        peaks = [[curve[name].peak for name in names] for curve in curves]
        highest, lowest = _span(peaks)
        scale, unit = prefixed_together([curves[0][name].unit for name in names], highest)
        dressed(ax, "", f"Joint {what},\npeak [{unit}]")
        if highest == 0.0:
            say_nothing(ax, f"no {what} at the joints")
            continue
        for curve, width, own in zip(curves, widths, peaks, strict=True):
            for style, peak in zip(styles_of(rig), own, strict=True):
                draw_line(ax, curve, scale * peak, linewidth=width, **style)
        logarithmic(ax.yaxis)
        ax.set_ylim(bottom=scale * lowest / 2)
    legend_on_top(force, _handles(rig) + _level_handles(curves, widths))


def _span(peaks: Sequence[Sequence[Array]]) -> tuple[float, float]:
    """Largest of the peaks of each level and port, and the least of the ports that count; what is not solved is none.

    A spring that hardens falls with a power of its motion: all of that is shown, and no port that rests beside it.
    """
    by_port = [np.concatenate(own) for own in zip(*peaks, strict=True)]
    highest = max(float(own.max()) for own in by_port)
    counted = np.concatenate([own for own in by_port if own.max() >= SHOWN * highest])
    return highest, float(counted[counted > TOLERANCE * highest].min(initial=highest))


def _handles(rig: "JointedRig") -> list[Line2D]:
    """Entries of a legend for the ports, if they are few enough."""
    if rig.ports > LEGEND:
        return []
    return [
        Line2D([], [], **style | {"markevery": None}, label=as_written(name.replace(".force", "")))
        for style, name in zip(styles_of(rig), rig.forces, strict=True)
    ]


def _level_handles(curves: Sequence["ResponseCurve"], widths: Sequence[float]) -> list[Line2D]:
    """Entries of a legend for levels, if there are several."""
    if len(curves) == 1:
        return []
    return [
        Line2D([], [], color=INK, linewidth=w, label=", ".join(c.held)) for w, c in zip(widths, curves, strict=True)
    ]


HistoryRow = tuple[Sequence[str], str, Sequence[Mapping[str, Any]]]
"""Signals of a panel of a history: their names, what they are, and the styles of their lines."""


def history_rows(rig: "JointedRig") -> list[HistoryRow]:
    """Signals of a history of a rig with joints, panel by panel; without any, the drive alone."""
    of_joints: list[HistoryRow] = [
        (rig.forces, "Joint force", styles_of(rig)),
        (rig.motions, "Joint motion", styles_of(rig)),
    ]
    return [(["drive"], "Drive", [{"color": INK}]), *(of_joints if rig.ports else [])]
