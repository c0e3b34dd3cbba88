"""Figures of responses over what they are traced along: the frequency, the force or another number."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from hbm.errors import one_or_several
from hbm.figures.joints import draw_joints
from hbm.figures.scales import phases
from hbm.figures.stretches import DASHES, draw_line
from hbm.figures.style import (
    FAINT,
    INK,
    SMALL,
    AxesArray,
    Color,
    align_labels,
    dressed,
    expect_contact,
    headed,
    level_colors,
    new_axes,
    panels,
)
from hbm.figures.units import prefixed
from hbm.fourier import Array
from hbm.response.curve import ResponseCurve, expect_alike
from models.jointed import JointedRig
from models.rig import Rig
from models.scalars import FORCE, HZ

Curves = ResponseCurve | Sequence[ResponseCurve]

MARKERS = {
    "corner": ("|", 4.0),
    "fold": ("o", 3.2),
    "branch point": ("D", 3.4),
    "Neimark-Sacker": ("s", 3.4),
    "period doubling": ("^", 4.0),
    "ends here": ("x", 6.0),
}

NAMES = {HZ: "Excitation frequency", FORCE: "Force amplitude"}

IN_A_COLUMN = 6
"""Largest number of entries of a legend that stand below each other."""


def plot_curves(curves: Curves, axes: AxesArray | None = None) -> AxesArray:
    """Page with everything about some responses: amplitude, phase, slip, friction, reaction.

    Parameters
    ----------
    curves : ResponseCurve or sequence of them
        Curves to overlay, all along the same: the frequency, the force or another number.
    axes : array of five Axes, or of four for a rig with joints, optional
        Where to draw; a new figure where omitted.

    Returns
    -------
    (5,) array of Axes; (4,) of a rig with joints: amplitude, phase, joint forces, joint motions
    """
    curves = listed(curves, "plot_curves")
    rig = curves[0].rig
    jointed = isinstance(rig, JointedRig)
    height, ratios = (7.6, (2.4, 1, 1.6, 1.6)) if jointed else (8.6, (2.4, 1, 1.2, 1.2, 1.4))
    rows = panels(axes, len(ratios), 1, height, sharex=True, height_ratios=ratios).ravel()
    plot_frequency_response(curves, rows[0])
    plot_phase(curves, rows[1])
    if jointed:
        draw_joints(curves, rows[2], rows[3])
        rows[3].set_xlabel(over(curves), color=INK)
    else:
        plot_contact(curves, rows[2:])
    for ax in rows[:-1]:
        ax.set_xlabel("")
    ends = [value for c in curves for value in (float(c.values.min()), float(c.values.max()))]
    rows[0].set_xlim(min(ends), max(ends))
    headed(rows[0], rig.name if jointed else rig.headline)
    return align_labels(rows)


def plot_frequency_response(curves: Curves, ax: Axes | None = None, *, label: bool = True) -> Axes:
    """Peak drive displacement over the excitation frequency, or what else the curves are traced along.

    Parameters
    ----------
    curves : ResponseCurve or sequence of them
        Levels to overlay.
    ax : Axes, optional
        Where to draw; new axes where omitted.
    label : bool
        Add a legend of the levels, of unstable stretches (dashed) and of the markers: folds and other bifurcations,
        corners, the end of a partial curve.
    """
    curves, ax = listed(curves, "plot_frequency_response"), new_axes(ax)
    scale = draw_peaks(ax, curves, "drive", "Drive displacement,\npeak")
    for curve, color in zip(curves, level_colors(curves), strict=True):
        mark(ax, curve, scale, color)
    ax.set_ylim(bottom=0.0)
    if label:
        explain(ax)
    ax.set_xlabel(over(curves), color=INK)
    return ax


def plot_phase(curves: Curves, ax: Axes | None = None) -> Axes:
    """Phase of the drive displacement's fundamental against the force, from -270 to 90 degrees.

    Parameters
    ----------
    curves : ResponseCurve or sequence of them
    ax : Axes, optional
    """
    curves, ax = listed(curves, "plot_phase"), new_axes(ax)
    for curve, color in zip(curves, level_colors(curves), strict=True):
        draw_line(ax, curve, phase_degrees(curve), color)
    phases(ax.yaxis)
    return dressed(ax, over(curves), "Phase to\nthe force [°]")


def phase_degrees(curve: ResponseCurve) -> Array:
    """Phase of the drive displacement's fundamental [°], in -270..90, negative for a lag."""
    return np.asarray(np.mod(np.degrees(curve["drive"].phase[:, 1]) + 270.0, 360.0) - 270.0)


def plot_contact(curves: Curves, axes: AxesArray | None = None) -> AxesArray:
    """Slip, friction force and normal reaction over the excitation frequency, or what the curves are traced along.

    Slip and friction are peaks over the period; the largest and the least reaction are drawn, with the
    static load and, where the reaction comes near it, the zero at which the tip lifts off.

    Parameters
    ----------
    curves : ResponseCurve or sequence of them
    axes : array of three Axes, optional

    Returns
    -------
    (3,) array of Axes
        Slip, friction, reaction.

    Raises
    ------
    InputError
        Of a rig with joints.
    """
    curves = listed(curves, "plot_contact")
    expect_contact(curves[0].channels, "plot_contact")
    rows = panels(axes, 3, 1, 5.0, sharex=True).ravel()
    slip, friction, normal = rows
    draw_peaks(slip, curves, "slip", "Slip,\npeak")
    draw_peaks(friction, curves, "friction", "Friction force,\npeak")
    scale = draw_peaks(normal, curves, "normal", "Normal reaction,\nmax and min")
    for curve, color in zip(curves, level_colors(curves), strict=True):
        draw_line(normal, curve, scale * least_reaction(curve), color, linewidth=0.9)
    slip.set_ylim(bottom=0.0)
    friction.set_ylim(bottom=0.0)
    _mark_static_load(normal, curves, scale)
    normal.set_xlabel(over(curves), color=INK)
    return rows


def draw_peaks(ax: Axes, curves: Sequence[ResponseCurve], channel: str, label: str, legend: str | None = None) -> float:
    """Peaks of a channel over what is varied, in a unit of their size; return the factor of that unit."""
    scale, unit = prefixed(curves[0][channel].unit, *(curve[channel].peak for curve in curves))
    for curve, color in zip(curves, level_colors(curves), strict=True):
        draw_line(ax, curve, scale * curve[channel].peak, color, label=legend)
    dressed(ax, "", f"{label} [{unit}]")
    return scale


def least_reaction(curve: ResponseCurve) -> Array:
    """Least normal reaction over the period at every point, (points,) [N]."""
    return np.array([p.channels["normal"].samples.min() for p in curve.points])


def listed(curves: Curves, where: str) -> list[ResponseCurve]:
    """One curve or several as a list, to be drawn: with what lies between their points.

    Raises
    ------
    InputError
        If there is none, or they are not all along the same.
    """
    found = one_or_several(curves, ResponseCurve, where, "curves")
    expect_alike(found, where)
    return [c.dense for c in found]


def over(curves: Sequence[ResponseCurve]) -> str:
    """Label of what is varied along curves: frequency, force, or the key of another number, with its unit."""
    key, unit = curves[0].parameter, curves[0].unit
    return NAMES.get(key, key) + ("" if unit == "1" else f" [{unit}]")


def mark(ax: Axes, curve: ResponseCurve, scale: float, color: Color) -> None:
    """Discreet markers where the drive's peak turns back, has corners, bifurcates, or ends too early."""
    for kind, (values, heights) in _places(curve).items():
        marker, size = MARKERS[kind]
        ax.plot(
            values,
            scale * heights,
            linestyle="none",
            marker=marker,
            markersize=size,
            color=color,
            markerfacecolor="white",
            markeredgewidth=0.8,
            label=f"_{kind}",
        )


def _places(curve: ResponseCurve) -> dict[str, tuple[Array, Array]]:
    """Parameter and peak of the drive [m] of the markers of each kind; a bifurcation is marked where it was located."""
    points, y = curve.branch.points, curve["drive"].peak
    at = {
        "corner": [i for i, p in enumerate(points) if p.corner],
        "fold": [i for i, p in enumerate(points) if p in curve.folded],
        "ends here": [] if curve.complete else [len(points) - 1],
    }
    places = {kind: (curve.values[i], y[i]) for kind, i in at.items()}
    if curve.stability is None:
        return places
    found = [b for b in curve.bifurcations if b.special.located or b.kind.value == "fold"]
    located = {
        kind: [b for b in found if b.kind.value == kind] for kind in MARKERS if kind not in ("corner", "ends here")
    }
    for kind, found in located.items():
        drive = [b.solution.channels["drive"].peak for b in found]
        places[kind] = (np.array([curve.value_at(b.special.lam) for b in found]), np.array(drive))
    return places


def explain(ax: Axes) -> None:
    """Legend: one entry per level, one for what is unstable or in doubt, one per kind of marker that is there."""
    last = [*DASHES, *MARKERS]
    drawn = {str(line.get_label()): line for line in ax.lines if np.size(line.get_xdata())}
    shown = {label: line for label, line in drawn.items() if not label.startswith("_")}
    shown |= {label: drawn[f"_{label}"] for label in last if f"_{label}" in drawn}
    if shown:
        columns = -(-len(shown) // IN_A_COLUMN)
        ax.legend(
            list(shown.values()), list(shown), frameon=False, fontsize=SMALL, labelcolor=INK, loc="best", ncols=columns
        )


def _mark_static_load(ax: Axes, curves: Sequence[ResponseCurve], scale: float) -> None:
    """Line at the static load, and at zero where the reaction comes near it."""
    rig = curves[0].rig
    if not isinstance(rig, Rig):
        return
    P = scale * rig.contact.normal_load
    ax.axhline(P, color=FAINT, linewidth=0.8, zorder=0)
    end, beside = ax.get_yaxis_transform(), "offset points"
    # as in a formula, whose own machinery takes long to set up
    ax.annotate("P", (1.0, P), (3, 0), end, beside, va="center", fontsize=SMALL, style="italic")
    if min(scale * float(least_reaction(c).min()) for c in curves) < 0.25 * P:
        ax.axhline(0.0, color="0.35", linewidth=0.8, linestyle=(0, (1, 1.5)), zorder=0)
        ax.text(
            0.005,
            0.0,
            "lift-off below",
            transform=ax.get_yaxis_transform(),
            ha="left",
            va="top",
            fontsize=SMALL,
            color="0.35",
        )
