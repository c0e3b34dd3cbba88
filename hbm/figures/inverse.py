"""Figures of what the inverse harmonic balance found: loops, signals, harmonics, energy, and how far to trust them.

Bands and bars are 95 % intervals. Hollow markers are records whose contact does not slip; the mean of their friction
and slip cannot be known and counts as zero.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter
from scipy import stats

from hbm.figures.style import FAINT, INK, SMALL, WIDTH, Color, closed, dressed, graded, new_axes, panels, tint
from hbm.fourier import Array

if TYPE_CHECKING:
    from hbm.inverse.reconstruction import Estimates, Reconstruction

Truth = Mapping[str, Array]
"""Known signals by name, (records, samples) each, in the units of the reconstruction: slip [m], friction [N]..."""

BAND = 1.96
"""Standard deviations on either side of a band: 95 %."""

PANELS = 4
MOST_LEVELS = 5
SIGNAL_ROWS = (
    ("friction", 1.0, "Friction\n[N]"),
    ("normal", 1.0, "Reaction\n[N]"),
    ("slip", 1e6, "Slip\n[µm]"),
    ("slip_velocity", 1e3, "Slip velocity\n[mm/s]"),
)
TRUTH_LINE: dict[str, Any] = {"color": "#D55E00", "linewidth": 1.1, "linestyle": (0, (1, 1.6)), "zorder": 4}
SLIP, FRICTION, FREQUENCY, HARMONIC = "Slip [µm]", "Friction force [N]", "Frequency [Hz]", "Harmonic"


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
    """At most so many of 0..count-1, evenly, the last always."""
    steps = count - 1 - np.round(np.arange(min(most, count)) * count / min(most, count))
    return np.asarray(np.sort(steps), dtype=np.intp)


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

    Returns
    -------
    Axes

    Raises
    ------
    InputError
        If there is no such record.
    """
    ax, i = new_axes(ax), reconstruction.index(record)
    slip, friction = reconstruction["slip"], reconstruction["friction"]
    color = level_color(reconstruction, reconstruction.spectra.level[i])
    u, T = slip.samples[i] * 1e6, friction.samples[i]
    band = loop_band(u, T, slip.std[i] * 1e6, friction.std[i])
    ax.add_patch(PathPatch(band, facecolor=tint(color), linewidth=0, zorder=1))
    ax.plot(closed(u), closed(T), color=color, linewidth=1.2, zorder=3, label="reconstructed")
    if truth is not None:
        known = [closed(_comparable(reconstruction, truth, name, i)) for name in ("slip", "friction")]
        ax.plot(known[0] * 1e6, known[1], **TRUTH_LINE, label="true")
    ax.autoscale_view()
    return dressed(ax, SLIP, FRICTION)


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
    reconstruction: "Reconstruction", records: Sequence[int] | None = None, *, truth: Truth | None = None
) -> Figure:
    """Friction loops of several records with 95 % bands, a row of panels per level.

    Parameters
    ----------
    reconstruction : Reconstruction
    records : sequence of int, optional
        Numbers of records; `representative` ones where omitted.
    truth : mapping of str to (records, samples) arrays, optional
        Known `slip` [m] and `friction` [N].

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        If there is no such record.
    """
    chosen = representative(reconstruction) if records is None else list(records)
    rows = [row for level in _rows_by_level(reconstruction, chosen) for row in _wrapped(level)]
    columns = max(map(len, rows))
    figure = Figure(figsize=(WIDTH, 0.45 + 1.5 * len(rows)), layout="constrained")
    grid = figure.subplots(len(rows), columns, squeeze=False, sharey="row")
    for row, axes in zip(rows, grid, strict=True):
        for ax in axes[len(row) :]:
            ax.set_axis_off()
        for record, ax in zip(row, axes, strict=False):
            plot_reconstructed_loop(reconstruction, record, ax, truth=truth)
            dressed(ax, "", "")
            ax.xaxis.set_major_locator(MaxNLocator(3))
            if not reconstruction.slips[reconstruction.index(record)]:
                ax.text(0.97, 0.95, "sticks", transform=ax.transAxes, ha="right", va="top", fontsize=SMALL, color="0.4")
            _titled(ax, reconstruction, record)
    figure.supxlabel(SLIP, color=INK, fontsize=10)
    figure.supylabel(FRICTION, color=INK, fontsize=10)
    if truth is not None:
        _legend_above(figure, grid[0, 0])
    return figure


def _rows_by_level(reconstruction: "Reconstruction", records: Sequence[int]) -> list[list[int]]:
    rows: dict[float, list[int]] = {}
    for record in records:
        rows.setdefault(float(reconstruction.spectra.level[reconstruction.index(record)]), []).append(record)
    return list(rows.values())


def _wrapped(row: list[int]) -> list[list[int]]:
    return [row[i : i + PANELS] for i in range(0, len(row), PANELS)]


def _titled(ax: Axes, reconstruction: "Reconstruction", record: int) -> None:
    i = reconstruction.index(record)
    text = f"{reconstruction.spectra.level[i]:g} N, {reconstruction.spectra.hz[i]:.4g} Hz"
    ax.set_title(text, fontsize=SMALL, loc="left", color=INK)


def _legend_above(figure: Figure, ax: Axes) -> None:
    """Legend of what one panel shows, in grey: colours are the levels'."""
    handles, labels = ax.get_legend_handles_labels()
    legend = figure.legend(
        handles, labels, loc="outside upper right", ncols=len(labels), frameon=False, fontsize=SMALL, labelcolor=INK
    )
    for drawn, shown in zip(handles, legend.legend_handles, strict=True):
        if isinstance(drawn, Line2D) and isinstance(shown, Line2D) and drawn.get_color() != TRUTH_LINE["color"]:
            hollow = shown.get_markerfacecolor() == "white"
            shown.set(color="0.4", markerfacecolor="white" if hollow else "0.4")


# ------------------------------------------------------------------------------------------------------------ signals


def plot_signals(
    reconstruction: "Reconstruction", records: Sequence[int] | None = None, *, truth: Truth | None = None
) -> Figure:
    """Friction, reaction, slip and slip velocity over a period with 95 % bands, a column of panels per record.

    Parameters
    ----------
    reconstruction : Reconstruction
    records : sequence of int, optional
        Numbers of records; of each level the one that slips most where omitted.
    truth : mapping of str to (records, samples) arrays, optional
        Known signals of any of the four names.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        If there is no such record.
    """
    chosen = representative(reconstruction, 1) if records is None else list(records)
    figure = Figure(figsize=(WIDTH, 5.6), layout="constrained")
    grid = figure.subplots(len(SIGNAL_ROWS), len(chosen), squeeze=False, sharex=True, sharey="row")
    for column, record in enumerate(chosen):
        for (name, scale, label), ax in zip(SIGNAL_ROWS, grid[:, column], strict=True):
            _draw_signal(ax, reconstruction, name, record, scale, truth)
            dressed(ax, "", "" if column else label)
        _titled(grid[0, column], reconstruction, record)
    _mark_load(grid[1], reconstruction)
    grid[0, 0].set_xlim(0.0, 1.0)
    grid[0, 0].set_xticks([0.0, 0.5, 1.0], ["0", "0.5", "1"])
    figure.supxlabel("Phase of the period", color=INK, fontsize=10)
    figure.align_ylabels()
    if truth is not None:
        _legend_above(figure, grid[0, 0])
    return figure


def _draw_signal(
    ax: Axes, reconstruction: "Reconstruction", name: str, record: int, scale: float, truth: Truth | None
) -> None:
    i, signal = reconstruction.index(record), reconstruction[name]
    color = level_color(reconstruction, reconstruction.spectra.level[i])
    phase = np.append(reconstruction.phase, 1.0)
    s, reach = closed(signal.samples[i]) * scale, BAND * closed(signal.std[i]) * scale
    if name != "normal":
        ax.axhline(0.0, color=FAINT, linewidth=0.6, zorder=0)
    ax.fill_between(phase, s - reach, s + reach, color=tint(color), linewidth=0, zorder=1)
    ax.plot(phase, s, color=color, linewidth=1.2, zorder=3, label="reconstructed")
    if truth is not None and name in truth:
        known = closed(_comparable(reconstruction, truth, name, i)) * scale
        ax.plot(np.linspace(0.0, 1.0, len(known)), known, **TRUTH_LINE, label="true")


def _mark_load(axes: Sequence[Axes], reconstruction: "Reconstruction") -> None:
    P = reconstruction.rig.contact.normal_load
    for ax in axes:
        ax.axhline(P, color="0.55", linewidth=0.7, linestyle=(0, (4, 2)), zorder=0)
    axes[-1].annotate(
        "$P$", (1.0, P), (3, 0), axes[-1].get_yaxis_transform(), "offset points", va="center", fontsize=SMALL
    )


# ---------------------------------------------------------------------------------------------------------- harmonics


def plot_friction_harmonics(reconstruction: "Reconstruction", records: Sequence[int] | None = None) -> Figure:
    """Amplitudes of the friction force's harmonics above the noise of the sensors, a panel per record.

    Filled markers stand out of the noise. Hollow ones do not: there a prior, by the other harmonics, rules.

    Parameters
    ----------
    reconstruction : Reconstruction
    records : sequence of int, optional
        Numbers of records; of each level the one that slips most where omitted.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        If there is no such record.
    """
    chosen = representative(reconstruction, 1) if records is None else list(records)
    figure, axes = panels(len(chosen), 0.75, 1.75, sharex=True, sharey=True)
    for record, ax in zip(chosen, axes, strict=True):
        _draw_harmonics(ax, reconstruction, record)
        dressed(ax, "", "")
        _titled(ax, reconstruction, record)
    figure.supxlabel(HARMONIC, color=INK, fontsize=10)
    figure.supylabel("Friction, amplitude [N]", color=INK, fontsize=10)
    _legend_above(figure, axes[0])
    return figure


def _draw_harmonics(ax: Axes, reconstruction: "Reconstruction", record: int) -> None:
    i, friction = reconstruction.index(record), reconstruction["friction"]
    color = level_color(reconstruction, reconstruction.spectra.level[i])
    k = np.arange(1, reconstruction.H + 1)
    amplitude, std = np.abs(friction.amplitudes[i, 1:]), friction.amplitude_std[i, 1:]
    floor = noise_floor(reconstruction)[i, 1:]
    ax.set_yscale("log", nonpositive="clip")
    ax.fill_between(k, floor, 1e-12, step="mid", color="0.9", linewidth=0, zorder=0)
    ax.plot(k, floor, color="0.5", linewidth=0.9, drawstyle="steps-mid", zorder=1, label="noise of the sensors, 95 %")
    ax.vlines(
        k, np.maximum(amplitude - BAND * std, 1e-12), amplitude + BAND * std, color=color, linewidth=1.0, zorder=2
    )
    clear = amplitude > floor
    for seen, face, text in ((clear, color, "harmonics of friction"), (~clear, "white", "lost in the noise")):
        shown = np.where(seen, amplitude, np.nan)
        ax.plot(k, shown, "o", color=color, markerfacecolor=face, markersize=4, zorder=3, label=text)
    _reach(ax, np.concatenate([amplitude, floor]))
    ax.set_xticks(k[:: 1 + len(k) // 12])


def _reach(ax: Axes, values: Array) -> None:
    """Extend a logarithmic axis to the finite values that are not zero."""
    drawn = values[np.isfinite(values) & (values > 0.0)]
    if len(drawn):
        low, high = (np.inf, 0.0) if ax.get_autoscaley_on() else ax.get_ylim()
        ax.set_ylim(min(low, 0.3 * drawn.min()), max(high, 2.0 * drawn.max()))


def noise_floor(reconstruction: "Reconstruction") -> Array:
    """Amplitude that noise alone makes of a friction harmonic in 5 % of the cases, (r, H+1) [N]."""
    return np.asarray(np.sqrt(-2.0 * np.log(0.05)) * reconstruction.resolution)


# -------------------------------------------------------------------------------------------------- energy, trust


def plot_energy(reconstruction: "Reconstruction") -> Figure:
    """Energy lost to friction per cycle and wear work rate over the frequency, with 95 % bars, by level.

    Parameters
    ----------
    reconstruction : Reconstruction

    Returns
    -------
    Figure
    """
    figure = Figure(figsize=(WIDTH, 4.2), layout="constrained")
    top, bottom = figure.subplots(2, 1, sharex=True)
    _draw_estimates(top, reconstruction, reconstruction.energy_per_cycle, 1e3)
    _draw_estimates(bottom, reconstruction, reconstruction.work_rate, 1e3)
    dressed(top, "", "Energy lost\nper cycle [mJ]")
    dressed(bottom, FREQUENCY, "Wear work rate,\nmean of R|v| [mW]")
    figure.align_ylabels()
    top.legend(frameon=False, fontsize=SMALL, labelcolor=INK, title="hollow: sticks", loc="best")
    top.get_legend().get_title().set(fontsize=SMALL, color=INK)
    return figure


def _draw_estimates(ax: Axes, reconstruction: "Reconstruction", estimates: "Estimates", scale: float) -> None:
    spectra = reconstruction.spectra
    ax.axhline(0.0, color=FAINT, linewidth=0.6, zorder=0)
    for n, level in enumerate(np.unique(spectra.level)):
        own = np.flatnonzero(spectra.level == level)
        own = own[np.argsort(spectra.hz[own], kind="stable")]
        color, marker = level_color(reconstruction, level), "osD^v"[n % 5]
        hz, value, bar = spectra.hz[own], estimates.value[own] * scale, BAND * estimates.std[own] * scale
        ax.plot(hz, value, color=color, linewidth=0.7, zorder=1, label="_line")
        ax.vlines(hz, value - bar, value + bar, color=color, linewidth=1.2, zorder=2)
        ax.plot(hz, value, marker, color=color, markersize=4, markerfacecolor="white", zorder=3, label="_all")
        slipping = np.where(reconstruction.slips[own], value, np.nan)
        ax.plot(hz, slipping, marker, color=color, markersize=4, zorder=4, label=f"{level:g} N")


def plot_misfit(reconstruction: "Reconstruction") -> Figure:
    """How far the sensors are from the structure: by record, and by channel and record.

    Above: misfit per degree of freedom, about 1 where noise alone is left, with the limit that noise passes in one of a
    thousand records. Below: the same of each channel. Records are in the order of level and frequency.

    Parameters
    ----------
    reconstruction : Reconstruction

    Returns
    -------
    Figure
    """
    misfit, spectra = reconstruction.misfit, reconstruction.spectra
    order = misfit_order(reconstruction)
    x = np.arange(1, len(order) + 1)
    figure = Figure(figsize=(WIDTH, 2.5 + 0.22 * max(len(misfit.channels), 3)), layout="constrained")
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(1.2, 0.3 + 0.2 * max(len(misfit.channels), 3)))
    for level in np.unique(spectra.level):
        own = spectra.level[order] == level
        color = level_color(reconstruction, level)
        top.plot(x[own], misfit.reduced[order][own], "o", color=color, markersize=3.5, label=f"{level:g} N", zorder=3)
    limit = misfit_limit(reconstruction)[order]
    top.plot(x, limit, color="0.4", linewidth=0.8, drawstyle="steps-mid", label="noise alone passes it 1 in 1000 times")
    top.axhline(1.0, color=FAINT, linewidth=0.8, zorder=0)
    _plain_log(top.yaxis)
    known = np.concatenate([misfit.reduced, limit, [0.6, 1.5]])
    known = known[np.isfinite(known)]
    top.set_ylim(0.9 * max(float(known.min()), 0.01), 1.2 * float(known.max()))
    shares = channel_misfit(reconstruction)[order].T
    edges = np.arange(len(order) + 1) + 0.5, np.arange(len(misfit.channels) + 1)
    most = max(10.0, float(shares[np.isfinite(shares)].max(initial=0.0)))
    cells = bottom.pcolormesh(*edges, shares, cmap="cividis_r", norm=LogNorm(0.1, most), rasterized=True)
    bottom.set_yticks(edges[1][:-1] + 0.5, misfit.channels)
    bottom.invert_yaxis()
    bottom.xaxis.set_major_locator(MaxNLocator(integer=True))
    bar = figure.colorbar(cells, ax=bottom, pad=0.01, aspect=12)
    bar.outline.set_visible(False)
    bar.ax.tick_params(width=0.6, color="0.4", labelcolor=INK, labelsize=SMALL)
    _plain_log(bar.ax.yaxis, scale=False)
    _separate_levels(bottom, spectra.level[order])
    dressed(top, "", "Misfit per\ndegree of freedom")
    dressed(bottom, "Records by level and frequency", "Channel")
    figure.align_ylabels()
    top.legend(
        frameon=False,
        fontsize=SMALL,
        labelcolor=INK,
        ncols=MOST_LEVELS + 1,
        loc="lower right",
        bbox_to_anchor=(1.0, 0.98),
        columnspacing=1.2,
    )
    return figure


def _plain_log(axis: Axis, *, scale: bool = True) -> None:
    """Logarithmic, with the few numbers that are read written out."""
    if scale:
        axis.axes.set_yscale("log")
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def misfit_order(reconstruction: "Reconstruction") -> npt.NDArray[np.intp]:
    """Places of records by level, then by frequency."""
    return np.asarray(np.lexsort((reconstruction.spectra.hz, reconstruction.spectra.level)))


def misfit_limit(reconstruction: "Reconstruction") -> Array:
    """Misfit per degree of freedom that noise alone exceeds in one of a thousand records, (r,)."""
    from hbm.inverse.reconstruction import CONSISTENT

    freedom = reconstruction.misfit.expected.sum(axis=1)
    freedom = np.where(freedom > 1e-6, freedom, np.nan)
    return np.asarray(stats.chi2.isf(CONSISTENT, freedom) / freedom)


def channel_misfit(reconstruction: "Reconstruction") -> Array:
    """Misfit per degree of freedom of each channel, (r, c), nan where there is no freedom."""
    misfit = reconstruction.misfit
    free = misfit.expected > 1e-6
    return np.asarray(np.divide(misfit.chi2, misfit.expected, out=np.full(misfit.chi2.shape, np.nan), where=free))


def _separate_levels(ax: Axes, levels: Array) -> None:
    for i in np.flatnonzero(np.diff(levels)):
        ax.axvline(i + 1.5, color="white", linewidth=1.6)


def plot_resolution(reconstruction: "Reconstruction") -> Figure:
    """What the sensors can tell of the friction force, harmonic by harmonic.

    Left: standard deviation by the sensors alone, beside the friction there is. Right: condition number of telling
    friction from the excitation. Lines are medians over the records, bands the range.

    Parameters
    ----------
    reconstruction : Reconstruction

    Returns
    -------
    Figure
    """
    figure = Figure(figsize=(WIDTH, 2.5), layout="constrained")
    left, right = figure.subplots(1, 2)
    k = np.arange(1, reconstruction.H + 1)
    color = graded([0.0])[0]
    _draw_range(left, k, np.abs(reconstruction["friction"].amplitudes[:, 1:]), "0.45", "friction, amplitude")
    _draw_range(left, k, reconstruction.resolution[:, 1:], color, "resolution of the sensors, std")
    _draw_range(right, k, reconstruction.condition[:, 1:], color, "condition")
    for ax in (left, right):
        ax.set_yscale("log")
        ax.set_xticks(k[:: 1 + len(k) // 12])
    sharpest = reconstruction.resolution[:, 1:]
    left.set_ylim(bottom=0.1 * float(sharpest[np.isfinite(sharpest) & (sharpest > 0)].min(initial=1.0)))
    named = left.get_legend_handles_labels()
    figure.legend(*named, loc="outside upper left", ncols=2, frameon=False, fontsize=SMALL, labelcolor=INK)
    dressed(left, HARMONIC, "Friction [N]")
    dressed(right, HARMONIC, "Condition number")
    return figure


def _draw_range(ax: Axes, k: npt.NDArray[np.intp], values: Array, color: Any, label: str) -> None:
    """Median over records and the range around it, of finite values."""
    from matplotlib.colors import to_rgb

    low, middle, high = quantiles(values)
    style: dict[str, Any] = (
        {"linestyle": (0, (4, 1.5)), "marker": "s"} if label.startswith("friction") else {"marker": "o"}
    )
    ax.fill_between(k, low, high, color=tint(to_rgb(color)), linewidth=0, alpha=0.7)
    ax.plot(k, middle, color=color, linewidth=1.2, markersize=3.5, label=label, **style)


def quantiles(values: Array) -> tuple[Array, Array, Array]:
    """Least, median and largest finite value of each column, nan where there is none."""
    columns = [column[np.isfinite(column)] for column in values.T]
    rows = [[c.min(), np.median(c), c.max()] if len(c) else [np.nan] * 3 for c in columns]
    low, middle, high = np.array(rows).T
    return low, middle, high
