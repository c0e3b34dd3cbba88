"""Figures of results. Functions take axes and return them, or return a whole figure; none shows or saves anything.

Colour carries the level, line style the stability (dashed where unstable). Nothing global is changed: a user's own
style stays in force for everything that is not said here.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from hbm.curve import ResponseCurve
from hbm.fourier import Array
from hbm.solution import PeriodicSolution

if TYPE_CHECKING:
    from hbm.history import TimeHistory
    from hbm.loop import FrictionLoop

Curves = ResponseCurve | Sequence[ResponseCurve]
Color = tuple[float, ...]

WIDTH = 6.3  # inches: the text width of a page
SMALL = 8
INK, FAINT = "0.2", "0.75"
MARKERS = {"corner": ("|", 4.0), "fold": ("o", 3.2), "ends here": ("x", 6.0)}
LOOP_LABELS = ("Slip [µm]", "Velocity [mm/s]")
STYLES = ("-", (0, (5, 1.5)), (0, (2, 1)), (0, (5, 1, 1, 1)))
OVERLAID = len(STYLES)
PHASE_TICKS = np.arange(-270, 91, 90)
HISTORY_ROWS = (
    ("drive", 1e3, "Drive\n[mm]"),
    ("slip", 1e6, "Slip\n[µm]"),
    ("friction", 1.0, "Friction\n[N]"),
    ("normal", 1.0, "Reaction\n[N]"),
)


# ------------------------------------------------------------------------------------------------------- one panel


def plot_frequency_response(curves: Curves, ax: Axes | None = None, *, label: bool = True) -> Axes:
    """Peak drive displacement over the excitation frequency.

    Parameters
    ----------
    curves : ResponseCurve or sequence of them
        Levels to overlay.
    ax : Axes, optional
        Where to draw; new axes where omitted.
    label : bool
        Add a legend of the levels and of the markers: folds, corners, the end of a partial curve.

    Returns
    -------
    Axes
    """
    curves, ax = _listed(curves), _axes(ax)
    for curve, color in zip(curves, _colors(curves), strict=True):
        y = curve["drive"].peak * 1e3
        _draw(ax, curve, y, color)
        _mark(ax, curve, y, color)
    ax.set_ylim(bottom=0.0)
    if label:
        _explain(ax)
    return _dressed(ax, "Excitation frequency [Hz]", "Drive displacement,\npeak [mm]")


def plot_phase(curves: Curves, ax: Axes | None = None) -> Axes:
    """Phase of the drive displacement's fundamental against the force, from -270 to 90 degrees.

    Parameters
    ----------
    curves : ResponseCurve or sequence of them
    ax : Axes, optional

    Returns
    -------
    Axes
    """
    curves, ax = _listed(curves), _axes(ax)
    for curve, color in zip(curves, _colors(curves), strict=True):
        _draw(ax, curve, phase_degrees(curve), color)
    low, high = ax.get_ylim()
    ax.set_yticks([t for t in PHASE_TICKS if low - 45 < t < high + 45])
    return _dressed(ax, "Excitation frequency [Hz]", "Phase to\nthe force [°]")


def phase_degrees(curve: ResponseCurve) -> Array:
    """Phase of the drive displacement's fundamental [°], in -270..90, negative for a lag."""
    return np.asarray(np.mod(np.degrees(curve["drive"].phase[:, 1]) + 270.0, 360.0) - 270.0)


def plot_contact(curves: Curves, axes: Sequence[Axes] | None = None) -> tuple[Axes, Axes, Axes]:
    """Slip, friction force and normal reaction over the excitation frequency.

    Slip and friction are peaks over the period; of the reaction the largest and the least are drawn, with the
    static load and, where the reaction comes near it, the zero at which the tip lifts off.

    Parameters
    ----------
    curves : ResponseCurve or sequence of them
    axes : sequence of three Axes, optional

    Returns
    -------
    tuple of Axes
        Slip, friction, reaction.
    """
    curves = _listed(curves)
    slip, friction, normal = _stack(3) if axes is None else axes
    for curve, color in zip(curves, _colors(curves), strict=True):
        _draw(slip, curve, curve["slip"].peak * 1e6, color)
        _draw(friction, curve, curve["friction"].peak, color)
        _draw(normal, curve, curve["normal"].peak, color)
        _draw(normal, curve, least_reaction(curve), color, linewidth=0.9)
    slip.set_ylim(bottom=0.0)
    friction.set_ylim(bottom=0.0)
    _mark_static_load(normal, curves)
    _dressed(slip, "", "Slip,\npeak [µm]")
    _dressed(friction, "", "Friction force,\npeak [N]")
    _dressed(normal, "Excitation frequency [Hz]", "Normal reaction,\nmax and min [N]")
    return slip, friction, normal


def least_reaction(curve: ResponseCurve) -> Array:
    """Least normal reaction over the period at every point, (points,) [N]."""
    return np.array([p.channels["normal"].samples.min() for p in curve.points])


def plot_loop(
    solution: PeriodicSolution, ax: Axes | None = None, *, mu: float | None = None, color: Any = None
) -> Axes:
    """Friction force over slip, one period.

    Parameters
    ----------
    solution : PeriodicSolution
    ax : Axes, optional
    mu : float, optional
        Friction coefficient: the limits +mu R(t) and -mu R(t) are drawn too.
    color : optional
        Any Matplotlib colour.

    Returns
    -------
    Axes
    """
    ax = _axes(ax)
    slip, T = _closed(solution.channels["slip"].samples) * 1e6, _closed(solution.channels["friction"].samples)
    if mu is not None:
        limit = mu * _closed(solution.channels["normal"].samples)
        for sign, text in ((1.0, r"$\mu R$"), (-1.0, r"$-\mu R$")):
            ax.plot(slip, sign * limit, color="0.55", linewidth=0.8, linestyle=(0, (4, 2)), label=text)
            right = int(np.argmax(slip))
            ax.annotate(
                text,
                (slip[right], sign * limit[right]),
                (3, 0),
                textcoords="offset points",
                color="0.4",
                fontsize=SMALL,
            )
    ax.plot(slip, T, color=_colors([solution])[0] if color is None else color, linewidth=1.4)
    return _dressed(ax, "Slip [µm]", "Friction force [N]")


# --------------------------------------------------------------------------------------------------------- whole page


def plot_loops(loops: Sequence["FrictionLoop"]) -> Figure:
    """Friction force against slip and against slip velocity, side by side.

    Up to OVERLAID laws share two panels. More have a pair of panels each, with the other loops in grey behind.

    Parameters
    ----------
    loops : sequence of FrictionLoop

    Returns
    -------
    Figure
    """
    return _overlaid(loops) if len(loops) <= OVERLAID else _one_by_one(loops)


def _overlaid(loops: Sequence["FrictionLoop"]) -> Figure:
    figure = Figure(figsize=(WIDTH, 2.9), layout="constrained")
    pair = figure.subplots(1, 2, sharey=True)
    for i, (loop, style) in enumerate(zip(loops, STYLES, strict=False)):
        color = colormaps["viridis"](0.05 + 0.73 * i / max(len(loops) - 1, 1))
        for ax, x in zip(pair, _scaled(loop), strict=True):
            ax.plot(x, _closed(loop.T), color=color, linestyle=style, linewidth=1.4, label=loop.law.name)
    for ax, x_label, y_label in zip(pair, LOOP_LABELS, ("Friction force [N]", ""), strict=True):
        _dressed(ax, x_label, y_label)
    named = pair[0].get_legend_handles_labels()
    figure.legend(*named, loc="outside upper center", ncols=OVERLAID, frameon=False, fontsize=SMALL, labelcolor=INK)
    return figure


def _one_by_one(loops: Sequence["FrictionLoop"]) -> Figure:
    rows = -(-len(loops) // 2)
    figure = Figure(figsize=(WIDTH, 1.2 * rows + 0.4), layout="constrained")
    grid = figure.subplots(rows, 4, sharex="col", sharey=True)
    free = [(0, 2)] if len(loops) % 2 else []
    places = [(row, column) for column in (0, 2) for row in range(rows) if (row, column) not in free]
    for loop, (row, column) in zip(loops, places, strict=True):
        _small_multiple(grid[row, column : column + 2], loop, loops)
    for row, column in free:
        _say_what_is_drawn(grid[row, column : column + 2], loops[0])
    for ax, label in zip(grid[-1], LOOP_LABELS * 2, strict=True):
        ax.set_xlabel(label, color=INK)
    figure.supylabel("Friction force [N]", color=INK, fontsize=10)
    return figure


def _small_multiple(pair: Sequence[Axes], loop: "FrictionLoop", loops: Sequence["FrictionLoop"]) -> None:
    for k, ax in enumerate(pair):
        for other in loops:
            ax.plot(_scaled(other)[k], _closed(other.T), color="0.87", linewidth=0.5, label=f"_{other.law.name}")
        ax.plot(_scaled(loop)[k], _closed(loop.T), color=_colors([loop])[0], linewidth=1.3, label=loop.law.name)
        _dressed(ax, "", "")
    pair[0].set_title(loop.law.name, fontsize=SMALL + 1, loc="left", color=INK)


def _say_what_is_drawn(pair: Sequence[Axes], loop: "FrictionLoop") -> None:
    """Fill a place that no law takes."""
    text = f"slip ±{np.ptp(loop.u) * 5e5:.3g} µm at {loop.hz:g} Hz,\nload {loop.load:g} N; grey: the other laws"
    note = pair[0].text(0.0, 0.5, text, transform=pair[0].transAxes, va="center", fontsize=SMALL, color=INK)
    note.set_in_layout(False)
    for ax in pair:
        ax.set_axis_off()


def _scaled(loop: "FrictionLoop") -> tuple[Array, Array]:
    """Slip [µm] and slip velocity [mm/s], closed."""
    return _closed(loop.u) * 1e6, _closed(loop.v) * 1e3


def plot_curves(curves: Curves) -> Figure:
    """Page with everything about some frequency responses: amplitude, phase, slip, friction, reaction.

    Parameters
    ----------
    curves : ResponseCurve or sequence of them
        Levels to overlay.

    Returns
    -------
    Figure
    """
    curves = _listed(curves)
    figure = Figure(figsize=(WIDTH, 8.6), layout="constrained")
    rows = figure.subplots(5, 1, sharex=True, height_ratios=(2.4, 1, 1.2, 1.2, 1.4)).tolist()
    plot_frequency_response(curves, rows[0])
    plot_phase(curves, rows[1])
    plot_contact(curves, rows[2:])
    for ax in rows[:-1]:
        ax.set_xlabel("")
    ends = [hz for c in curves for hz in (float(c.hz.min()), float(c.hz.max()))]
    rows[0].set_xlim(min(ends), max(ends))
    rig = curves[0].rig
    rows[0].set_title(f"{rig.name}, {rig.contact.law.name}", fontsize=10, loc="left", color=INK)
    figure.align_ylabels()
    return figure


def plot_history(history: "TimeHistory", periods: int = 3) -> Figure:
    """Drive displacement, slip, friction force and reaction over time, and their last periods enlarged.

    Parameters
    ----------
    history : TimeHistory
    periods : int
        How many of the last periods are enlarged.

    Returns
    -------
    Figure
    """
    figure = Figure(figsize=(WIDTH, 5.6), layout=ConstrainedLayoutEngine(wspace=0.06))
    grid = figure.subplots(4, 2, sharex="col", sharey="row", width_ratios=(2, 1))
    last = slice(-min(periods * history.samples_per_period + 1, len(history.time)), None)
    color = _colors([history])[0]
    for row, (name, scale, label) in zip(grid, HISTORY_ROWS, strict=True):
        y = history.channels[name].values * scale
        row[0].plot(history.time, y, color=color, linewidth=0.5)
        row[1].plot(history.time[last] * 1e3, y[last], color=color, linewidth=1.2)
        for ax, text in zip(row, (label, ""), strict=True):
            ax.axhline(0.0, color=FAINT, linewidth=0.6, zorder=0)
            ax.margins(x=0)
            _dressed(ax, "", text)
    grid[-1][0].set_xlabel("Time [s]", color=INK)
    grid[-1][1].set_xlabel(f"Time [ms], last {periods} periods", color=INK)
    grid[0][0].set_title(
        f"{history.rig.name}, {history.level:g} N at {history.hz:g} Hz", fontsize=10, loc="left", color=INK
    )
    figure.align_ylabels()
    return figure


# -------------------------------------------------------------------------------------------------------------- parts


def _listed(curves: Curves) -> list[ResponseCurve]:
    return [curves] if isinstance(curves, ResponseCurve) else list(curves)


def _axes(ax: Axes | None) -> Axes:
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return plt.figure(layout="constrained").add_subplot()


def _stack(rows: int) -> Sequence[Axes]:
    import matplotlib.pyplot as plt

    axes: Sequence[Axes] = (
        plt.figure(figsize=(WIDTH, 5.0), layout="constrained").subplots(rows, 1, sharex=True).tolist()
    )
    return axes


def _colors(items: Sequence[Any]) -> list[Color]:
    """One colour per level, darker for more force; distinct without colour vision and in grey."""
    if len(items) == 1:
        return [colormaps["viridis"](0.15)]
    order = np.argsort(np.argsort([c.level for c in items]))
    return [colormaps["viridis"](0.74 - 0.7 * i / (len(items) - 1)) for i in order.tolist()]


def _draw(ax: Axes, curve: ResponseCurve, y: Array, color: Color, linewidth: float = 1.4) -> None:
    """Draw a line over the frequency, dashed where the curve says it is unstable."""
    label = f"{curve.level:g} N"
    stable = getattr(curve, "stable", None)
    if stable is None or np.all(stable):
        ax.plot(curve.hz, y, color=color, linewidth=linewidth, label=label)
        return
    ok = np.asarray(stable, dtype=bool)
    ax.plot(curve.hz, np.where(ok, y, np.nan), color=color, linewidth=linewidth, label=label)
    ax.plot(
        curve.hz, np.where(_with_neighbours(~ok), y, np.nan), color=color, linewidth=linewidth, linestyle=(0, (3, 1.5))
    )


def _with_neighbours(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Mask that also covers the entries beside it: the segments that lead there."""
    wide = mask.copy()
    wide[1:] |= mask[:-1]
    wide[:-1] |= mask[1:]
    return wide


def _mark(ax: Axes, curve: ResponseCurve, y: Array, color: Color) -> None:
    """Discreet markers where the curve turns back, has corners, or ends too early."""
    points = curve.branch.points
    at = {
        "corner": [i for i, p in enumerate(points) if p.corner],
        "fold": [i for i, p in enumerate(points) if p.fold],
        "ends here": [] if curve.complete else [len(points) - 1],
    }
    for kind, (marker, size) in MARKERS.items():
        ax.plot(
            curve.hz[at[kind]],
            y[at[kind]],
            linestyle="none",
            marker=marker,
            markersize=size,
            color=color,
            markerfacecolor="white",
            markeredgewidth=0.8,
            label=f"_{kind}",
        )


def _explain(ax: Axes) -> None:
    """Legend: one entry per level, one per kind of marker that is there."""
    shown = {str(line.get_label()).removeprefix("_"): line for line in ax.lines if np.size(line.get_xdata())}
    order = sorted(shown, key=lambda text: text in MARKERS)
    ax.legend([shown[t] for t in order], order, frameon=False, fontsize=SMALL, labelcolor=INK, loc="best")


def _mark_static_load(ax: Axes, curves: Sequence[ResponseCurve]) -> None:
    """Line at the static load, and at zero where the reaction comes near it."""
    P = curves[0].rig.contact.normal_load
    ax.axhline(P, color=FAINT, linewidth=0.8, zorder=0)
    ax.annotate("$P$", (1.0, P), (3, 0), ax.get_yaxis_transform(), "offset points", va="center", fontsize=SMALL)
    if min(float(least_reaction(c).min()) for c in curves) < 0.25 * P:
        ax.axhline(0.0, color="0.35", linewidth=0.8, linestyle=(0, (1, 1.5)), zorder=0)
        ax.text(
            0.995,
            0.0,
            "lift-off below",
            transform=ax.get_yaxis_transform(),
            ha="right",
            va="bottom",
            fontsize=SMALL,
            color="0.35",
        )


def _closed(samples: Array) -> Array:
    return np.append(samples, samples[0])


def _dressed(ax: Axes, x: str, y: str) -> Axes:
    """Labels, and as little frame as possible."""
    ax.set_xlabel(x, color=INK)
    ax.set_ylabel(y, color=INK)
    ax.spines[["top", "right"]].set_visible(False)
    ax.spines[["left", "bottom"]].set(linewidth=0.6, color="0.4")
    ax.tick_params(width=0.6, color="0.4", labelcolor=INK, labelsize=SMALL + 1)
    return ax
