"""Figure of a response along a number of the rig."""

import numpy as np

from hbm.figures.curves import draw_peaks, explain, least_reaction, mark, over
from hbm.figures.joints import draw_joints
from hbm.figures.scales import logarithmic, phases
from hbm.figures.stretches import draw_line
from hbm.figures.style import FAINT, INK, AxesArray, Color, align_labels, as_written, dressed, graded, headed, panels
from hbm.tracking.parameterresponse import ParameterCurve
from models.jointed import JointedRig
from models.rig import Rig

LOGARITHMIC = 30.0
"""A range whose ends are further apart than this factor is drawn on a logarithmic axis."""


def plot_parameter_curve(curve: ParameterCurve, axes: AxesArray | None = None) -> AxesArray:
    """Drive displacement, slip, friction and reaction over the number; of a channel's gain or delay its own reading.

    Parameters
    ----------
    curve : ParameterCurve
    axes : array of so many Axes, optional
        Where to draw; a new figure where omitted.

    Returns
    -------
    (4,) array of Axes; (3,) of a rig with joints: drive displacement, joint forces, joint motions; (2,) along a number
    of a channel, which nothing else depends on: its peak and phase
    """
    curve = curve.dense
    table, _, rest = curve.parameter.partition(".")
    rows = _draw_channel(curve, rest.rpartition(".")[0], axes) if table == "channels" else _draw_motion(curve, axes)
    rows[-1].set_xlabel(over([curve]), color=INK)
    headed(rows[0], _title(curve))
    explain(rows[0])
    return align_labels(rows)


def _draw_motion(curve: ParameterCurve, axes: AxesArray | None) -> AxesArray:
    jointed = isinstance(curve.rig, JointedRig)
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
    return rows


def _draw_channel(curve: ParameterCurve, name: str, axes: AxesArray | None) -> AxesArray:
    """Peak of a channel, and the phase of its fundamental, which a delay turns as often as it likes."""
    rows = panels(axes, 2, 1, 4.0, sharex=True).ravel()
    peak, phase = rows
    scale = draw_peaks(peak, [curve], name, f"{as_written(name)},\npeak", "_along")
    peak.set_ylim(0.0, 1.1 * scale * float(curve[name].peak.max()) or 1.0)  # a delay leaves a line without a height
    turned = np.degrees(np.unwrap(curve[name].phase[:, 1]))
    draw_line(phase, curve, turned, graded([0.0])[0], label="_along")
    phases(phase.yaxis)
    dressed(phase, "", "Phase to\nthe force [°]")
    return rows


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
    law = [curve.rig.law_name] if isinstance(curve.rig, Rig) else []
    return ", ".join([curve.rig.name, *law, *curve.held])
