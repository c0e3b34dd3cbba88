"""Figures of what sensors read: simulated curves over frequency or force, with measured points on them."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from hbm.errors import InputError
from hbm.figures.curves import Curves, listed, over
from hbm.figures.scales import logarithmic
from hbm.figures.stretches import DASHES, draw_line
from hbm.figures.style import (
    INK,
    SMALL,
    AxesArray,
    Color,
    align_labels,
    dressed,
    in_lines,
    label_all,
    legend_above,
    level_colors,
    new_axes,
    panels,
    say_nothing,
)
from hbm.figures.units import prefixed
from hbm.fourier import Array
from hbm.measurement.spectra import MeasuredSpectra
from hbm.response.curve import ResponseCurve

BAND = 1.96
"""Half the width of a 95 % interval, in standard deviations."""

SAME_LEVEL = 0.05
"""A record belongs to a curve whose force differs from its own by less than this share."""

MOST = 12
"""Largest number of channels that are drawn where none are named."""

ONE_COLUMN = 3
"""Largest number of panels that stand in one column."""


def plot_channel(
    curves: Curves,
    channel: str = "drive",
    ax: Axes | None = None,
    *,
    measured: MeasuredSpectra | None = None,
    harmonic: int = 1,
    log: bool = False,
    per_force: bool = False,
    label: bool = True,
) -> Axes:
    """Amplitude of a harmonic of one channel over the frequency, or over the force of a force response.

    Parameters
    ----------
    curves : ResponseCurve or sequence of them
        Levels to overlay.
    channel : str
        One of the curves: of the rig's, or ``drive``, ``slip``, ``friction``...
    ax : Axes, optional
        Where to draw; new axes where omitted.
    measured : MeasuredSpectra, optional
        Drawn as points with 95 % intervals, each in the colour of the curve of its level, where it has one.
    harmonic : int
        Its number.
    log : bool
        Draw amplitudes on a logarithmic axis.
    per_force : bool
        Divide by the amplitude of the force, so that levels fall on one line where the structure is linear.
    label : bool
        Add a legend.

    Raises
    ------
    InputError
        If the curves have no such channel or harmonic.
    """
    curves, ax = listed(curves, "plot_channel"), new_axes(ax)
    _check(curves, [channel], harmonic)
    unit = _draw(ax, curves, channel, measured, harmonic, per_force)
    _scaled(ax, log)
    if label:
        ax.legend(handles=_handles(curves, measured), frameon=False, fontsize=SMALL, labelcolor=INK, loc="best")
    return dressed(ax, over(curves), f"{_named(channel, harmonic)} [{unit}]")


def plot_sensors(
    curves: Curves,
    channels: Sequence[str] | None = None,
    axes: AxesArray | None = None,
    *,
    measured: MeasuredSpectra | None = None,
    harmonic: int = 1,
    log: bool = True,
    per_force: bool = False,
) -> AxesArray:
    """Amplitude of a harmonic of the drive and of every sensor, a panel for each.

    Parameters
    ----------
    curves : ResponseCurve or sequence of them
        Levels to overlay.
    channels : sequence of str, optional
        Where omitted the drive and the rig's channels of motion; with measurements those that were measured.
    axes : array of Axes, optional
        One for each channel; a new figure where omitted.
    measured, harmonic, log, per_force
        As for :func:`plot_channel`.

    Returns
    -------
    array of Axes
        As many as there are channels.

    Raises
    ------
    InputError
        If the curves have no such channel or harmonic.
    """
    curves = listed(curves, "plot_sensors")
    names = list(channels) if channels is not None else _sensors(curves[0], measured)
    _check(curves, names, harmonic)
    columns = 1 if len(names) <= ONE_COLUMN else 2
    rows = -(-len(names) // columns)
    grid = panels(axes, rows, columns, 0.9 + 1.6 * rows, sharex=True) if axes is None else np.asarray(axes)
    for ax, above in zip(grid.ravel()[len(names) :], grid.ravel()[len(names) - columns :], strict=False):
        ax.set_visible(False)
        above.tick_params(labelbottom=True)
    for name, ax in zip(names, grid.ravel(), strict=False):
        unit = _draw(ax, curves, name, measured, harmonic, per_force)
        _scaled(ax, log)
        dressed(ax, "", f"{name} [{unit}]")
    label_all(
        grid, over(curves), "Amplitude of the fundamental" if harmonic == 1 else f"Amplitude of harmonic {harmonic}"
    )
    handles = _handles(curves, measured)
    heading: dict[str, Any] = {"title": in_lines(curves[0].rig.name), "title_fontsize": 10, "alignment": "left"}
    legend_above(grid, handles, ncols=min(len(handles), 5), **heading).get_title().set_color(INK)
    return align_labels(grid).ravel()[: len(names)]


def _sensors(curve: ResponseCurve, measured: MeasuredSpectra | None) -> list[str]:
    motion = [c.name for c in curve.rig.channels if c.quantity != "force"]
    if measured is not None:
        return [name for name in motion if name in measured.channels][:MOST]
    return ["drive", *motion][:MOST]


def _check(curves: Sequence[ResponseCurve], channels: Sequence[str], harmonic: int) -> None:
    if not channels:
        raise InputError(f"figure: {curves[0].rig.name} has no channel of motion that was measured; must have one")
    for name in channels:
        if name not in curves[0].channels:
            raise InputError(f'figure: no channel "{name}"; must be one of {", ".join(curves[0].channels)}')
    least = min(c.basis.H for c in curves)
    if not 0 <= harmonic <= least:
        raise InputError(f"figure: harmonic = {harmonic}; must be from 0 to {least}, the harmonics of the curves")


def _draw(
    ax: Axes,
    curves: Sequence[ResponseCurve],
    channel: str,
    measured: MeasuredSpectra | None,
    harmonic: int,
    per_force: bool,
) -> str:
    """Draw the curves of a channel and what was measured of it, in a unit of their size; return that."""
    unit = curves[0][channel].unit.replace("s2", "s²") + (" / N" if per_force else "")
    drawn = [curve[channel].amplitude[:, harmonic] / (curve.force if per_force else 1.0) for curve in curves]
    scale, unit = prefixed(unit, *drawn)
    for curve, color, amplitude in zip(curves, level_colors(curves), drawn, strict=True):
        draw_line(ax, curve, scale * amplitude, color)
        if measured is not None and channel in measured.channels and harmonic <= measured.H:
            _draw_points(ax, curve, measured, channel, harmonic, scale, per_force, color)
    ax.set_xlim(min(c.values.min() for c in curves), max(c.values.max() for c in curves))
    return unit


def _draw_points(
    ax: Axes,
    curve: ResponseCurve,
    measured: MeasuredSpectra,
    channel: str,
    harmonic: int,
    scale: float,
    per_force: bool,
    color: Color,
) -> None:
    """The records of a curve's level, or of its frequency where it is a force response."""
    over_force = curve.problem.parameter == "force"
    if over_force:
        own = np.abs(measured.hz / curve.points[0].hz - 1.0) < 1e-4
    else:
        own = np.abs(measured.level / curve.level - 1.0) < SAME_LEVEL
    x: Array = measured.level if over_force else measured.hz
    inside = own & (x >= curve.values.min()) & (x <= curve.values.max())
    divided = measured.level[inside] if per_force else 1.0
    ax.errorbar(
        x[inside],
        scale * np.abs(measured.complex(channel)[inside, harmonic]) / divided,
        yerr=BAND * scale * measured.std[inside, measured.index(channel), harmonic] / divided,
        fmt="o",
        markersize=3.6,
        color=color,
        elinewidth=0.8,
        markerfacecolor="white",
        markeredgewidth=0.9,
        zorder=3,
    )


def _scaled(ax: Axes, log: bool) -> None:
    if not any(np.any(line.get_ydata()) for line in ax.lines):
        say_nothing(ax, "no motion")
    elif log:
        logarithmic(ax.yaxis)
    else:
        ax.set_ylim(bottom=0.0)


def _handles(curves: Sequence[ResponseCurve], measured: MeasuredSpectra | None) -> list[Any]:
    """Legend: a line for each level, for what is unstable and what is in doubt, and a point for what was measured."""
    colors = level_colors(curves)
    force = curves[0].problem.parameter == "force"
    names = [f"{c.points[0].hz:g} Hz" if force else f"{c.level:g} N" for c in curves]
    handles = [Line2D([], [], linewidth=1.4, label=name) for name in names]
    for handle, color in zip(handles, colors, strict=True):
        handle.set_color((color[0], color[1], color[2]))
    judged = [(c.stable, c.doubtful) for c in curves if c.stable is not None and c.doubtful is not None]
    shown = {
        "unstable": any((~stable & ~doubtful).any() for stable, doubtful in judged),
        "in doubt": any(doubtful.any() for _, doubtful in judged),
    }
    drawn = [kind for kind, there in shown.items() if there]
    handles += [Line2D([], [], color=INK, linewidth=1.2, linestyle=DASHES[kind], label=kind) for kind in drawn]
    if measured is not None:
        hollow = Line2D([], [], color=INK, linestyle="none", marker="o", markersize=3.6, markerfacecolor="white")
        hollow.set_label("measured")
        handles.append(hollow)
    return handles


def _named(channel: str, harmonic: int) -> str:
    return channel if harmonic == 1 else f"{channel}, harmonic {harmonic}"
