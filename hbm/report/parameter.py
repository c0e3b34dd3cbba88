"""Figure of a response along a number of the rig."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hbm.fourier import Array
from hbm.parameterresponse import ParameterCurve
from hbm.report.curves import MARKERS, least_reaction
from hbm.report.style import FAINT, INK, SMALL, WIDTH, dressed, graded

LOGARITHMIC = 30.0
"""A range whose ends are further apart than this factor is drawn on a logarithmic axis."""


def plot_parameter_curve(curve: ParameterCurve) -> Figure:
    """Drive displacement, slip, friction and reaction over the number.

    Parameters
    ----------
    curve : ParameterCurve

    Returns
    -------
    Figure
    """
    figure = Figure(figsize=(WIDTH, 6.6), layout="constrained")
    rows: list[Axes] = figure.subplots(4, 1, sharex=True, height_ratios=(2.2, 1.2, 1.2, 1.4)).tolist()
    drive, slip, friction, normal = rows
    _draw(drive, curve, curve["drive"].peak * 1e3, marked=True)
    _draw(slip, curve, curve["slip"].peak * 1e6)
    _draw(friction, curve, curve["friction"].peak)
    _draw(normal, curve, curve["normal"].peak)
    _draw(normal, curve, least_reaction(curve))
    if curve.parameter != "contact.normal_load":
        normal.axhline(curve.rig.contact.normal_load, color=FAINT, linewidth=0.8, zorder=0)
    for ax in rows[:-1]:
        ax.set_ylim(bottom=0.0)
    labels = (
        "Drive displacement,\npeak [mm]",
        "Slip,\npeak [µm]",
        "Friction force,\npeak [N]",
        "Normal reaction,\nmax, min [N]",
    )
    unit = "" if curve.unit == "1" else f" [{curve.unit}]"
    for ax, label in zip(rows, labels, strict=True):
        dressed(ax, curve.parameter + unit if ax is normal else "", label)
    low, high = float(curve.values.min()), float(curve.values.max())
    if low > 0.0 and high > LOGARITHMIC * low:
        drive.set_xscale("log")
    drive.set_xlim(low, high)
    drive.set_title(_title(curve), fontsize=10, loc="left", color=INK)
    _explain(drive)
    figure.align_ylabels()
    return figure


def _title(curve: ParameterCurve) -> str:
    first = curve.points[0]
    held = {"frequency_hz": f"{first.hz:g} Hz", "excitation.amplitude": f"{first.level:g} N"}
    said = [text for key, text in held.items() if key != curve.parameter]
    return ", ".join([curve.rig.name, curve.rig.contact.law.name, *said])


def _draw(ax: Axes, curve: ParameterCurve, y: Array, *, marked: bool = False) -> None:
    color = graded([0.0])[0]
    ax.plot(curve.values, y, color=color, linewidth=1.4)
    points = curve.branch.points
    where: dict[str, Sequence[int]] = {
        "corner": [i for i, p in enumerate(points) if p.corner],
        "fold": [i for i, p in enumerate(points) if p.fold],
        "ends here": [] if curve.complete else [len(points) - 1],
    }
    for kind, (marker, size) in MARKERS.items() if marked else ():
        at = where[kind]
        ax.plot(
            curve.values[at], y[at], marker, markersize=size, color=color, markerfacecolor="white", label=f"_{kind}"
        )


def _explain(ax: Axes) -> None:
    """Legend of the markers that are there."""
    shown = {str(line.get_label()).removeprefix("_"): line for line in ax.lines if np.size(line.get_xdata())}
    named = {text: line for text, line in shown.items() if text in MARKERS}
    if named:
        ax.legend(list(named.values()), list(named), frameon=False, fontsize=SMALL, labelcolor=INK, loc="best")
