"""Figure of a response along a number of the rig."""

from hbm.figures.curves import draw_line, explain, least_reaction, mark
from hbm.figures.joints import draw_joints
from hbm.figures.style import FAINT, INK, AxesArray, align_labels, dressed, graded, headed, panels
from hbm.tracking.parameterresponse import ParameterCurve
from models.jointed import JointedRig
from models.rig import Rig

LOGARITHMIC = 30.0
"""A range whose ends are further apart than this factor is drawn on a logarithmic axis."""


def plot_parameter_curve(curve: ParameterCurve, axes: AxesArray | None = None) -> AxesArray:
    """Drive displacement, slip, friction and reaction over the number.

    Parameters
    ----------
    curve : ParameterCurve
    axes : array of four Axes, optional

    Returns
    -------
    (4,) array of Axes
    """
    if isinstance(curve.rig, JointedRig):
        return _plot_jointed(curve, axes)
    rows = panels(axes, 4, 1, 6.6, sharex=True, height_ratios=(2.2, 1.2, 1.2, 1.4)).ravel()
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
    if isinstance(curve.rig, Rig) and curve.parameter != "contact.normal_load":
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
    headed(drive, _title(curve))
    explain(drive)
    return align_labels(rows)


def _plot_jointed(curve: ParameterCurve, axes: AxesArray | None) -> AxesArray:
    rows = panels(axes, 3, 1, 5.6, sharex=True, height_ratios=(1.6, 1.2, 1.2)).ravel()
    y, color = curve["drive"].peak * 1e3, graded([0.0])[0]
    draw_line(rows[0], curve, y, color, label="_along")
    mark(rows[0], curve, y, color)
    rows[0].set_ylim(bottom=0.0)
    draw_joints([curve], rows[1], rows[2])
    unit = "" if curve.unit == "1" else f" [{curve.unit}]"
    dressed(rows[0], "", "Drive displacement,\npeak [mm]")
    rows[2].set_xlabel(curve.parameter + unit, color=INK)
    headed(rows[0], _title(curve))
    explain(rows[0])
    return align_labels(rows)


def _title(curve: ParameterCurve) -> str:
    first = curve.points[0]
    held = {"frequency_hz": f"{first.hz:g} Hz", "excitation.amplitude": f"{first.level:g} N"}
    said = [text for key, text in held.items() if key != curve.parameter]
    law = [curve.rig.law_name] if isinstance(curve.rig, Rig) else []
    return ", ".join([curve.rig.name, *law, *said])
