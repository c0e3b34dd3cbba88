"""Figure of a response along a number of the rig."""

from hbm.figures.curves import draw_peaks, explain, least_reaction, mark
from hbm.figures.joints import draw_joints
from hbm.figures.scales import logarithmic
from hbm.figures.stretches import draw_line
from hbm.figures.style import FAINT, INK, AxesArray, Color, align_labels, graded, headed, panels
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
    curve, jointed = curve.dense, isinstance(curve.rig, JointedRig)
    height, ratios = (5.6, (1.6, 1.2, 1.2)) if jointed else (6.6, (2.2, 1.2, 1.2, 1.4))
    rows = panels(axes, len(ratios), 1, height, sharex=True, height_ratios=ratios).ravel()
    drive, color = rows[0], graded([0.0])[0]
    scale = draw_peaks(drive, [curve], "drive", "Drive displacement,\npeak", "_along")
    mark(drive, curve, scale, color)
    drive.set_ylim(bottom=0.0)
    if jointed:
        draw_joints([curve], rows[1], rows[2])
    else:
        _draw_contact(curve, rows[1:], color)
    unit = "" if curve.unit == "1" else f" [{curve.unit}]"
    rows[-1].set_xlabel(curve.parameter + unit, color=INK)
    headed(drive, _title(curve))
    explain(drive)
    return align_labels(rows)


def _draw_contact(curve: ParameterCurve, rows: AxesArray, color: Color) -> None:
    slip, friction, normal = rows
    draw_peaks(slip, [curve], "slip", "Slip,\npeak", "_along")
    draw_peaks(friction, [curve], "friction", "Friction force,\npeak", "_along")
    scale = draw_peaks(normal, [curve], "normal", "Normal reaction,\nmax, min", "_along")
    draw_line(normal, curve, scale * least_reaction(curve), color, label="_along")
    if isinstance(curve.rig, Rig) and curve.parameter != "contact.normal_load":
        normal.axhline(scale * curve.rig.contact.normal_load, color=FAINT, linewidth=0.8, zorder=0)
    for ax in (slip, friction):
        ax.set_ylim(bottom=0.0)
    low, high = float(curve.values.min()), float(curve.values.max())
    if low > 0.0 and high > LOGARITHMIC * low:
        logarithmic(normal.xaxis)
    normal.set_xlim(low, high)


def _title(curve: ParameterCurve) -> str:
    first = curve.points[0]
    held = {"frequency_hz": f"{first.hz:g} Hz", "excitation.amplitude": f"{first.level:g} N"}
    said = [text for key, text in held.items() if key != curve.parameter]
    law = [curve.rig.law_name] if isinstance(curve.rig, Rig) else []
    return ", ".join([curve.rig.name, *law, *said])
