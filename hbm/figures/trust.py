"""Figures of how far a reconstruction is to be trusted: harmonics, energy, misfit of the sensors, resolution."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.ticker import MaxNLocator
from scipy import special

from hbm.figures.inverse import (
    BAND,
    FREQUENCY,
    HARMONIC,
    MOST_LEVELS,
    grey_legend,
    level_color,
    representative,
    titled,
    unit_of,
)
from hbm.figures.scales import few_numbers, logarithmic
from hbm.figures.style import (
    FAINT,
    INK,
    SMALL,
    AxesArray,
    align_labels,
    as_written,
    dressed,
    graded,
    label_all,
    legend_above,
    panels,
    tint,
    wrapped_panels,
)
from hbm.figures.units import prefixed
from hbm.fourier import Array
from hbm.measurement.groups import frequency_bands

if TYPE_CHECKING:
    from hbm.inverse.reconstruction import Estimates, Reconstruction


def plot_friction_harmonics(
    reconstruction: "Reconstruction", records: Sequence[int] | None = None, axes: AxesArray | None = None
) -> AxesArray:
    """Amplitudes of the friction force's harmonics above the noise of the sensors, a panel per record.

    Filled markers stand out of the noise. Hollow ones do not: there a prior, by the other harmonics, rules.

    Parameters
    ----------
    reconstruction : Reconstruction
    records : sequence of int, optional
        Numbers of records; of each level the one that slips most where omitted.
    axes : array of Axes, optional
        One per record.

    Returns
    -------
    (records,) array of Axes

    Raises
    ------
    InputError
        If there is no such record.
    """
    chosen = representative(reconstruction, 1) if records is None else list(records)
    found = wrapped_panels(axes, len(chosen), 0.75, 1.75, sharex=True, sharey=True)
    for record, ax in zip(chosen, found, strict=True):
        _draw_harmonics(ax, reconstruction, record)
        dressed(ax, "", "")
        titled(ax, reconstruction, record)
    label_all(found, HARMONIC, f"Friction, amplitude [{unit_of(reconstruction, 'friction')[1]}]")
    grey_legend(found)
    return found


def _draw_harmonics(ax: Axes, reconstruction: "Reconstruction", record: int) -> None:
    i, friction = reconstruction.index(record), reconstruction["friction"]
    color = level_color(reconstruction, reconstruction.spectra.level[i])
    k = np.arange(1, reconstruction.H + 1)
    scale, _ = unit_of(reconstruction, "friction")
    amplitude, std = scale * friction.amplitude[i, 1:], scale * friction.coefficient_std[i, 1:]
    floor = scale * noise_floor(reconstruction)[i, 1:]
    logarithmic(ax.yaxis)
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


def plot_energy(reconstruction: "Reconstruction", axes: AxesArray | None = None) -> AxesArray:
    """Energy lost to friction per cycle and wear work rate over the frequency, with 95 % bars, by level.

    Parameters
    ----------
    reconstruction : Reconstruction
    axes : array of two Axes, optional

    Returns
    -------
    (2,) array of Axes
    """
    rows = panels(axes, 2, 1, 4.2, sharex=True).ravel()
    top, bottom = rows
    energy = _draw_estimates(top, reconstruction, reconstruction.energy_per_cycle)
    power = _draw_estimates(bottom, reconstruction, reconstruction.work_rate)
    dressed(top, "", f"Energy lost\nper cycle [{energy}]")
    dressed(bottom, FREQUENCY, f"Wear work rate,\nmean of R|v| [{power}]")
    top.legend(frameon=False, fontsize=SMALL, labelcolor=INK, title="hollow: sticks", loc="best")
    top.get_legend().get_title().set(fontsize=SMALL, color=INK)
    return align_labels(rows)


def _draw_estimates(ax: Axes, reconstruction: "Reconstruction", estimates: "Estimates") -> str:
    """Draw estimates of all records in a unit of their size; return that."""
    spectra, (scale, unit) = reconstruction.spectra, prefixed(estimates.unit, estimates.value)
    ax.axhline(0.0, color=FAINT, linewidth=0.6, zorder=0)
    for n, level in enumerate(np.unique(spectra.level)):
        own = np.flatnonzero(spectra.level == level)
        own = own[np.argsort(spectra.hz[own], kind="stable")]
        color, marker = level_color(reconstruction, level), "osD^v"[n % 5]
        hz, value, bar = spectra.hz[own], estimates.value[own] * scale, BAND * estimates.std[own] * scale
        for low, high in frequency_bands(hz):
            band = (hz >= low) & (hz <= high)
            ax.plot(hz[band], value[band], color=color, linewidth=0.7, zorder=1, label="_line")
        ax.vlines(hz, value - bar, value + bar, color=color, linewidth=1.2, zorder=2)
        ax.plot(hz, value, marker, color=color, markersize=4, markerfacecolor="white", zorder=3, label="_all")
        slipping = np.where(reconstruction.slips[own], value, np.nan)
        ax.plot(hz, slipping, marker, color=color, markersize=4, zorder=4, label=f"{level:g} N")
    return unit


def plot_misfit(reconstruction: "Reconstruction", axes: AxesArray | None = None) -> AxesArray:
    """Plot the misfit of the sensors: by record, and by channel and record.

    Above: misfit per degree of freedom, about 1 where noise alone is left, with the limit that noise passes in one of a
    thousand records. Below: the same of each channel. Records are in the order of level and frequency.

    Parameters
    ----------
    reconstruction : Reconstruction
    axes : array of two Axes, optional
        A colour bar takes a part of the second.

    Returns
    -------
    (2,) array of Axes
    """
    misfit, spectra = reconstruction.misfit, reconstruction.spectra
    order = misfit_order(reconstruction)
    x = np.arange(1, len(order) + 1)
    listed = max(len(misfit.channels), 3)
    rows = panels(axes, 2, 1, 2.5 + 0.22 * listed, sharex=True, height_ratios=(1.2, 0.3 + 0.2 * listed)).ravel()
    top, bottom = rows
    for level in np.unique(spectra.level):
        own = spectra.level[order] == level
        color = level_color(reconstruction, level)
        top.plot(x[own], misfit.reduced[order][own], "o", color=color, markersize=3.5, label=f"{level:g} N", zorder=3)
    limit = misfit_limit(reconstruction)[order]
    top.plot(x, limit, color="0.4", linewidth=0.8, drawstyle="steps-mid", label="noise alone passes it 1 in 1000 times")
    top.axhline(1.0, color=FAINT, linewidth=0.8, zorder=0)
    logarithmic(top.yaxis)
    known = np.concatenate([misfit.reduced, limit, [0.6, 1.5]])
    known = known[np.isfinite(known)]
    top.set_ylim(0.9 * max(float(known.min()), 0.01), 1.2 * float(known.max()))
    shares = channel_misfit(reconstruction)[order].T
    edges = np.arange(len(order) + 1) + 0.5, np.arange(len(misfit.channels) + 1)
    most = max(10.0, float(shares[np.isfinite(shares)].max(initial=0.0)))
    cells = bottom.pcolormesh(*edges, shares, cmap="cividis_r", norm=LogNorm(0.1, most), rasterized=True)
    bottom.set_yticks(edges[1][:-1] + 0.5, list(map(as_written, misfit.channels)))
    bottom.invert_yaxis()
    bottom.xaxis.set_major_locator(MaxNLocator(integer=True))
    bar = bottom.figure.colorbar(cells, ax=bottom, pad=0.01, aspect=12)
    bar.outline.set_visible(False)
    bar.ax.tick_params(width=0.6, color="0.4", labelcolor=INK, labelsize=SMALL)
    few_numbers(bar.ax.yaxis)
    _separate_levels(bottom, spectra.level[order])
    dressed(top, "", "Misfit per\ndegree of freedom")
    dressed(bottom, "Records by level and frequency", "Channel")
    top.legend(
        frameon=False,
        fontsize=SMALL,
        labelcolor=INK,
        ncols=MOST_LEVELS + 1,
        loc="lower right",
        bbox_to_anchor=(1.0, 0.98),
        columnspacing=1.2,
    )
    return align_labels(rows)


def misfit_order(reconstruction: "Reconstruction") -> npt.NDArray[np.intp]:
    """Places of records by level, then by frequency."""
    return np.asarray(np.lexsort((reconstruction.spectra.hz, reconstruction.spectra.level)))


def misfit_limit(reconstruction: "Reconstruction") -> Array:
    """Misfit per degree of freedom that noise alone exceeds in one of a thousand records, (r,)."""
    from hbm.inverse.reconstruction import CONSISTENT

    freedom = reconstruction.misfit.expected.sum(axis=1)
    freedom = np.where(freedom > 1e-6, freedom, np.nan)
    return np.asarray(special.chdtri(freedom, CONSISTENT) / freedom)


def channel_misfit(reconstruction: "Reconstruction") -> Array:
    """Misfit per degree of freedom of each channel, (r, c), nan where there is no freedom."""
    misfit = reconstruction.misfit
    free = misfit.expected > 1e-6
    return np.asarray(np.divide(misfit.chi2, misfit.expected, out=np.full(misfit.chi2.shape, np.nan), where=free))


def _separate_levels(ax: Axes, levels: Array) -> None:
    for i in np.flatnonzero(np.diff(levels)):
        ax.axvline(i + 1.5, color="white", linewidth=1.6)


def plot_resolution(reconstruction: "Reconstruction", axes: AxesArray | None = None) -> AxesArray:
    """Draw how well the sensors resolve the friction force, harmonic by harmonic.

    Left: standard deviation by the sensors alone, beside the friction there is. Right: condition number of telling
    friction from the excitation. Lines are medians over the records, bands the range.

    Parameters
    ----------
    reconstruction : Reconstruction
    axes : array of two Axes, optional

    Returns
    -------
    (2,) array of Axes
    """
    pair = panels(axes, 1, 2, 2.5).ravel()
    left, right = pair
    k = np.arange(1, reconstruction.H + 1)
    color = graded([0.0])[0]
    scale, unit = unit_of(reconstruction, "friction")
    sharpest = scale * reconstruction.resolution[:, 1:]
    _draw_range(left, k, scale * reconstruction["friction"].amplitude[:, 1:], "0.45", "friction, amplitude")
    _draw_range(left, k, sharpest, color, "resolution of the sensors, std")
    _draw_range(right, k, reconstruction.condition[:, 1:], color, "condition")
    for ax in pair:
        logarithmic(ax.yaxis)
        ax.set_xticks(k[:: 1 + len(k) // 12])
    left.set_ylim(bottom=0.1 * float(sharpest[np.isfinite(sharpest) & (sharpest > 0)].min(initial=1.0)))
    legend_above(pair, left.get_legend_handles_labels()[0], ncols=2)
    dressed(left, HARMONIC, f"Friction [{unit}]")
    dressed(right, HARMONIC, "Condition number")
    return pair


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
