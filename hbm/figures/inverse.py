"""Figures of what the inverse harmonic balance found: loops, signals, harmonics, energy, and how far to trust them.

Bands and bars are 95 % intervals: dark by noise, and light by what the rig file may be off by too. Hollow markers are
records whose contact does not slip; the mean of their friction and slip cannot be known and counts as zero.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.ticker import MaxNLocator

from hbm.figures.style import (
    FAINT,
    INK,
    SMALL,
    AxesArray,
    Color,
    align_labels,
    closed,
    dressed,
    graded,
    label_all,
    legend_above,
    new_axes,
    panels,
    tint,
)
from hbm.figures.units import prefixed
from hbm.fourier import Array

if TYPE_CHECKING:
    from hbm.inverse.reconstruction import EstimatedSignal, Reconstruction

Truth = Mapping[str, Array]
"""Known signals by name, (records, samples) each, in the units of the reconstruction: slip [m], friction [N]..."""

BAND = 1.96
"""Standard deviations on either side of a band: 95 %."""

BANDS = (0.13, 0.3)
"""Shares of the colour of the bands, the outer one first."""

PANELS = 4
MOST_LEVELS = 5
SIGNAL_ROWS = (
    ("friction", "Friction"),
    ("normal", "Reaction"),
    ("slip", "Slip"),
    ("slip_velocity", "Slip velocity"),
)
TRUTH_LINE: dict[str, Any] = {"color": "#D55E00", "linewidth": 1.1, "linestyle": (0, (1, 1.6)), "zorder": 4}
FREQUENCY, HARMONIC = "Frequency [Hz]", "Harmonic"


# -------------------------------------------------------------------------------------------------- choice of records


def representative(reconstruction: "Reconstruction", per_level: int = PANELS) -> list[int]:
    """Numbers of records that show the range of each level, from little slip to the most, in the order to draw them.

    Parameters
    ----------
    reconstruction : Reconstruction
    per_level : int
        How many of each level; with 1, the record of the most slip.

    Returns
    -------
    list of int
        By level, then by frequency. Of more than `MOST_LEVELS` levels some are left out.
    """
    spectra = reconstruction.spectra
    amplitude = np.ptp(reconstruction["slip"].samples, axis=1)
    levels = np.unique(spectra.level)
    chosen: list[int] = []
    for level in levels[_spread(len(levels), MOST_LEVELS)]:
        own = np.flatnonzero(spectra.level == level)
        ranked = own[np.argsort(amplitude[own])]
        kept = ranked[_spread(len(ranked), per_level)]
        chosen += spectra.records[kept[np.argsort(spectra.hz[kept])]].tolist()
    return chosen


def _spread(count: int, most: int) -> npt.NDArray[np.intp]:
    """At most so many of 0..count-1, evenly spaced and including the last."""
    steps = count - 1 - np.round(np.arange(min(most, count)) * count / min(most, count))
    return np.asarray(np.sort(steps), dtype=np.intp)


def unit_of(reconstruction: "Reconstruction", name: str) -> tuple[float, str]:
    """Factor and unit of a signal, the same in all figures of one reconstruction."""
    return prefixed(reconstruction[name].unit, reconstruction[name].samples)


def loop_labels(reconstruction: "Reconstruction") -> tuple[str, str]:
    """Labels of slip and friction force."""
    return f"Slip [{unit_of(reconstruction, 'slip')[1]}]", f"Friction force [{unit_of(reconstruction, 'friction')[1]}]"


def level_color(reconstruction: "Reconstruction", level: float) -> Color:
    """Colour of a level in all figures of one reconstruction."""
    levels = np.unique(reconstruction.spectra.level)
    return graded(levels.tolist())[int(np.searchsorted(levels, level))]


# ------------------------------------------------------------------------------------------------------------- loops


def plot_reconstructed_loop(
    reconstruction: "Reconstruction", record: int, ax: Axes | None = None, *, truth: Truth | None = None
) -> Axes:
    """Friction force over slip in one record, with its 95 % band.

    Parameters
    ----------
    reconstruction : Reconstruction
    record : int
        Number of the record.
    ax : Axes, optional
    truth : mapping of str to (records, samples) arrays, optional
        Known `slip` [m] and `friction` [N], drawn dotted.

    Raises
    ------
    InputError
        If there is no such record.
    """
    ax, i = new_axes(ax), reconstruction.index(record)
    slip, friction = reconstruction["slip"], reconstruction["friction"]
    color = level_color(reconstruction, reconstruction.spectra.level[i])
    (by, _), (by_force, _) = unit_of(reconstruction, "slip"), unit_of(reconstruction, "friction")
    u, T = slip.samples[i] * by, friction.samples[i] * by_force
    for share, u_std, T_std in zip(BANDS, stds(slip), stds(friction), strict=True):
        band = loop_band(u, T, u_std[i] * by, T_std[i] * by_force)
        ax.add_artist(PathPatch(band, facecolor=tint(color, share), linewidth=0, zorder=1))
        ax.update_datalim(band.vertices)  # add_patch would look for the ends of each curve, of which there are none
    ax.plot(closed(u), closed(T), color=color, linewidth=1.2, zorder=3, label="reconstructed")
    if truth is not None:
        known = [closed(_comparable(reconstruction, truth, name, i)) for name in ("slip", "friction")]
        ax.plot(known[0] * by, known[1] * by_force, **TRUTH_LINE, label="true")
    ax.autoscale_view()
    return dressed(ax, *loop_labels(reconstruction))


def stds(signal: "EstimatedSignal") -> tuple[Array, Array]:
    """Standard deviations of a signal for its `BANDS`: by all that was worked out, by noise."""
    return signal.whole_std, signal.std


def loop_band(u: Array, T: Array, u_std: Array, T_std: Array) -> Path:
    """95 % band of a closed loop: what ellipses of both deviations sweep, as quadrilaterals that all turn left."""
    u, T, su, sT = (closed(values) for values in (u, T, u_std, T_std))
    du, dT = (closed(_slope(values[:-1])) for values in (u, T))
    width = np.hypot(dT * su, du * sT)
    scale = BAND * np.divide(1.0, width, out=np.zeros_like(width), where=width > 0.0)
    reach = np.stack([su**2 * dT, -(sT**2) * du], axis=1) * scale[:, None]
    outer, inner = (np.stack([u, T], axis=1) + sign * reach for sign in (1.0, -1.0))
    corners = np.stack([outer[:-1], outer[1:], inner[1:], inner[:-1]], axis=1)
    (ax, ay), (bx, by) = ((corners[:, k + 2] - corners[:, k]).T for k in (0, 1))
    turns_right = ax * by - ay * bx < 0.0
    corners[turns_right] = corners[turns_right, ::-1]
    codes = np.tile([Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY], len(corners))
    return Path(np.concatenate([corners, corners[:, :1]], axis=1).reshape(-1, 2), codes)


def _slope(samples: Array) -> Array:
    """Central differences around a period."""
    return np.asarray(np.roll(samples, -1) - np.roll(samples, 1))


def _comparable(reconstruction: "Reconstruction", truth: Truth, name: str, i: int) -> Array:
    """A known signal, without the mean where the contact sticks: measurements cannot tell it."""
    known = np.asarray(truth[name][i])
    unknown_mean = not reconstruction.slips[i] and name in ("friction", "slip")
    return known - known.mean() if unknown_mean else known


def plot_reconstructed_loops(
    reconstruction: "Reconstruction",
    records: Sequence[int] | None = None,
    axes: AxesArray | None = None,
    *,
    truth: Truth | None = None,
) -> AxesArray:
    """Friction loops of several records with 95 % bands, a row of panels per level.

    Parameters
    ----------
    reconstruction : Reconstruction
    records : sequence of int, optional
        Numbers of records; `representative` ones where omitted.
    axes : array of Axes, optional
        One per place in the rows.
    truth : mapping of str to (records, samples) arrays, optional
        Known `slip` [m] and `friction` [N].

    Returns
    -------
    (rows, columns) array of Axes

    Raises
    ------
    InputError
        If there is no such record.
    """
    chosen = representative(reconstruction) if records is None else list(records)
    rows = [row for level in _rows_by_level(reconstruction, chosen) for row in _wrapped(level)]
    columns = max(map(len, rows))
    grid = panels(axes, len(rows), columns, 0.45 + 1.5 * len(rows), sharey="row")
    for row, beside in zip(rows, grid, strict=True):
        for ax in beside[len(row) :]:
            ax.set_axis_off()
        for record, ax in zip(row, beside, strict=False):
            plot_reconstructed_loop(reconstruction, record, ax, truth=truth)
            dressed(ax, "", "")
            ax.xaxis.set_major_locator(MaxNLocator(3))
            if not reconstruction.slips[reconstruction.index(record)]:
                ax.text(0.97, 0.95, "sticks", transform=ax.transAxes, ha="right", va="top", fontsize=SMALL, color="0.4")
            titled(ax, reconstruction, record)
    label_all(grid, *loop_labels(reconstruction))
    if truth is not None:
        grey_legend(grid)
    return grid


def _rows_by_level(reconstruction: "Reconstruction", records: Sequence[int]) -> list[list[int]]:
    rows: dict[float, list[int]] = {}
    for record in records:
        rows.setdefault(float(reconstruction.spectra.level[reconstruction.index(record)]), []).append(record)
    return list(rows.values())


def _wrapped(row: list[int]) -> list[list[int]]:
    return [row[i : i + PANELS] for i in range(0, len(row), PANELS)]


def titled(ax: Axes, reconstruction: "Reconstruction", record: int) -> None:
    """Level and frequency of a record as the title of its axes."""
    i = reconstruction.index(record)
    text = f"{reconstruction.spectra.level[i]:g} N, {reconstruction.spectra.hz[i]:.4g} Hz"
    ax.set_title(text, fontsize=SMALL, loc="left", color=INK)


def grey_legend(axes: AxesArray) -> None:
    """Legend of what the first panel shows, in grey: colours are the levels'."""
    handles = axes.flat[0].get_legend_handles_labels()[0]
    legend = legend_above(axes, handles, where="upper right", ncols=len(handles))
    for drawn, shown in zip(handles, legend.legend_handles, strict=True):
        if isinstance(drawn, Line2D) and isinstance(shown, Line2D) and drawn.get_color() != TRUTH_LINE["color"]:
            hollow = shown.get_markerfacecolor() == "white"
            shown.set(color="0.4", markerfacecolor="white" if hollow else "0.4")


# ------------------------------------------------------------------------------------------------------------ signals


def plot_signals(
    reconstruction: "Reconstruction",
    records: Sequence[int] | None = None,
    axes: AxesArray | None = None,
    *,
    truth: Truth | None = None,
) -> AxesArray:
    """Friction, reaction, slip and slip velocity over a period with 95 % bands, a column of panels per record.

    Parameters
    ----------
    reconstruction : Reconstruction
    records : sequence of int, optional
        Numbers of records; of each level the one that slips most where omitted.
    axes : array of Axes, optional
        One per signal and record.
    truth : mapping of str to (records, samples) arrays, optional
        Known signals of any of the four names.

    Returns
    -------
    (4, records) array of Axes

    Raises
    ------
    InputError
        If there is no such record.
    """
    chosen = representative(reconstruction, 1) if records is None else list(records)
    grid = panels(axes, len(SIGNAL_ROWS), len(chosen), 5.6, sharex=True, sharey="row")
    for column, record in enumerate(chosen):
        for (name, label), ax in zip(SIGNAL_ROWS, grid[:, column], strict=True):
            scale, unit = unit_of(reconstruction, name)
            _draw_signal(ax, reconstruction, name, record, scale, truth)
            dressed(ax, "", "" if column else f"{label}\n[{unit}]")
        titled(grid[0, column], reconstruction, record)
    _mark_load(grid[1], reconstruction)
    for ax in grid.flat:
        ax.set_xlim(0.0, 1.0, emit=False)  # each has its turn
        ax.set_xticks([0.0, 0.5, 1.0], ["0", "0.5", "1"])
    label_all(grid, "Phase of the period")
    if truth is not None:
        grey_legend(grid)
    return align_labels(grid)


def _draw_signal(
    ax: Axes, reconstruction: "Reconstruction", name: str, record: int, scale: float, truth: Truth | None
) -> None:
    i, signal = reconstruction.index(record), reconstruction[name]
    color = level_color(reconstruction, reconstruction.spectra.level[i])
    phase = np.append(reconstruction.phase, 1.0)
    s = closed(signal.samples[i]) * scale
    if name != "normal":
        ax.axhline(0.0, color=FAINT, linewidth=0.6, zorder=0)
    for share, std in zip(BANDS, stds(signal), strict=True):
        reach = BAND * closed(std[i]) * scale
        ax.fill_between(phase, s - reach, s + reach, color=tint(color, share), linewidth=0, zorder=1)
    ax.plot(phase, s, color=color, linewidth=1.2, zorder=3, label="reconstructed")
    if truth is not None and name in truth:
        known = closed(_comparable(reconstruction, truth, name, i)) * scale
        ax.plot(np.linspace(0.0, 1.0, len(known)), known, **TRUTH_LINE, label="true")


def _mark_load(axes: AxesArray, reconstruction: "Reconstruction") -> None:
    P = reconstruction.rig.contact.normal_load * unit_of(reconstruction, "normal")[0]
    for ax in axes:
        ax.axhline(P, color="0.55", linewidth=0.7, linestyle=(0, (4, 2)), zorder=0)
    axes[-1].annotate(
        "$P$", (1.0, P), (3, 0), axes[-1].get_yaxis_transform(), "offset points", va="center", fontsize=SMALL
    )
