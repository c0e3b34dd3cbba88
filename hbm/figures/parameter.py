"""Figure of a response along a number of the rig."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hbm.figures.curves import draw_line, explain, least_reaction, mark
from hbm.figures.style import FAINT, INK, WIDTH, dressed, graded
from hbm.tracking.parameterresponse import ParameterCurve

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
    color = graded([0.0])[0]
    for ax, y in (
        (drive, curve["drive"].peak * 1e3),
        (slip, curve["slip"].peak * 1e6),
        (friction, curve["friction"].peak),
        (normal, curve["normal"].peak),
        (normal, least_reaction(curve)),
    ):
        draw_line(ax, curve, y, color, label="_along")
    mark(drive, curve, curve["drive"].peak * 1e3, color)
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
    explain(drive)
    figure.align_ylabels()
    return figure


def _title(curve: ParameterCurve) -> str:
    first = curve.points[0]
    held = {"frequency_hz": f"{first.hz:g} Hz", "excitation.amplitude": f"{first.level:g} N"}
    said = [text for key, text in held.items() if key != curve.parameter]
    return ", ".join([curve.rig.name, curve.rig.contact.law.name, *said])
