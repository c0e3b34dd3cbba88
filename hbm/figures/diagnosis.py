"""Figures of a diagnosis: measured against simulated, where a model misses, what force it lacks, causes, gain.

Nominal, calibrated and extended models have the same colour and marker in all of them. Records held out are hollow.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from hbm.figures.style import INK, SMALL, AxesArray, as_written, dressed, graded, label_all, legend_above, panels
from hbm.fourier import Array

if TYPE_CHECKING:
    from hbm.diagnosis.verdict import Diagnosis
    from hbm.outputerror.campaign import Campaign
    from hbm.outputerror.fit import Evaluation

MODELS = ("nominal", "calibrated", "extended")
COLORS = dict(zip(MODELS, ("0.55", "#D55E00", "#0072B2"), strict=True))
MARKERS = dict(zip(MODELS, ("x", "o", "s"), strict=True))
STYLES: dict[str, Any] = dict(zip(MODELS, ((0, (1, 1.5)), (0, (4, 1.5)), "-"), strict=True))

BAND = 1.96
"""Standard deviations on either side of a bar: 95 %."""

GAP = 1.4
"""Neighbouring frequencies this far apart are in bands of their own."""

MOST_CHANNELS, MOST_PLACES = 6, 12

LEAST_HEIGHT = 3.2  # inches, for the label beside the rows

LOST = 0.2
"""Deviations below this part of the noise are not drawn."""

ALIKE = 1.05
"""Forces less than this apart are of one level."""

ASIDE = 0.006
"""Share of a band of frequencies by which models stand beside each other, for their points would hide each other."""

CLEAR, CURVE = 3.0, 4
"""Deviations of so many standard deviations show a misfit; records from which on a level is drawn as a curve."""

FREQUENCY = "Frequency [Hz]"

FIVE_COLUMNS: dict[str, Any] = {"ncols": 5, "columnspacing": 1.4}


@dataclass(frozen=True, eq=False)
class Compared:
    """Coefficients measured beside those of a model, one entry per record, channel and harmonic.

    Attributes
    ----------
    record, channel, harmonic : (m,) int array
        Number of the record, place of the channel.
    level, hz : (m,) array
        [N], [Hz].
    measured, simulated : (m,) complex array
        Amplitudes, the force a cosine.
    std : (m,) array
        Standard deviation of each part.
    held_out : (m,) bool array
    """

    record: npt.NDArray[np.int64]
    channel: npt.NDArray[np.int64]
    harmonic: npt.NDArray[np.int64]
    level: Array
    hz: Array
    measured: npt.NDArray[np.complex128]
    simulated: npt.NDArray[np.complex128]
    std: Array
    held_out: npt.NDArray[np.bool_]

    @property
    def deviation(self) -> Array:
        """Rms of both parts of measured less simulated, in standard deviations."""
        return np.asarray(np.abs(self.measured - self.simulated) / self.std / np.sqrt(2.0))


@dataclass(frozen=True)
class View:
    """One harmonic of one channel, at one level and in one band of frequencies.

    Attributes
    ----------
    channel, harmonic : int
        Place of the channel.
    level : float
        Mean of the nominal forces [N].
    band : (float, float)
        Its ends [Hz].
    """

    channel: int
    harmonic: int
    level: float
    band: tuple[float, float]

    def of(self, c: Compared) -> npt.NDArray[np.int64]:
        """Places of its entries, in the order of their frequencies."""
        own = (c.channel == self.channel) & (c.harmonic == self.harmonic) & np.isclose(levels(c.level), self.level)
        i = np.flatnonzero(own & (c.hz >= self.band[0]) & (c.hz <= self.band[1]))
        return np.asarray(i[np.argsort(c.hz[i])])


def clearest(models: Sequence[Compared], *, missed: bool) -> View:
    """Harmonic of a channel that models miss most, relative to its response; or the one that moves most.

    Deviations that noise may make do not count. Curves of a few records are passed over where there are longer ones.
    """
    c = Compared(*(np.concatenate([getattr(m, f.name) for m in models]) for f in fields(Compared)))
    bands = frequency_bands(c.hz)
    band = np.array([next(i for i, (low, high) in enumerate(bands) if low <= hz <= high) for hz in c.hz])
    label = np.stack([c.channel, c.harmonic, levels(c.level), band], axis=1)
    found, place, count = np.unique(label, axis=0, return_inverse=True, return_counts=True)
    shown = np.where(c.deviation > CLEAR, np.abs(c.measured - c.simulated), 0.0) if missed else np.abs(c.measured)
    size = np.bincount(place.ravel(), shown / _typical(c))
    size[count < min(CURVE * len(models), int(count.max()))] = -np.inf
    channel, harmonic, level, i = found[int(size.argmax())]
    return View(int(channel), int(harmonic), float(level), bands[int(i)])


def _typical(c: Compared) -> Array:
    """Rms of all that its channel reads, for each entry."""
    rms = np.sqrt(np.bincount(c.channel, np.abs(c.measured) ** 2) / np.maximum(np.bincount(c.channel), 1))
    return np.asarray(np.where(rms > 0.0, rms, 1.0)[c.channel])


def noise_error(c: Compared, *, held: bool) -> float:
    """Relative error that noise alone makes, on the records fitted or on those held out; 0 where there are none."""
    own = c.held_out == held
    size = _typical(c)[own]
    whole = np.linalg.norm(c.measured[own] / size)
    return float(np.linalg.norm(np.sqrt(2.0) * c.std[own] / size) / whole) if whole > 0.0 else 0.0


def record_errors(c: Compared) -> tuple[npt.NDArray[np.int64], Array, Array]:
    """For each record: place of its first entry, relative error over all channels and harmonics, and that by noise."""
    _, first, inverse = np.unique(c.record, return_index=True, return_inverse=True)
    size = _typical(c)
    off, noise, whole = (
        np.sqrt(np.bincount(inverse.ravel(), (part / size) ** 2))
        for part in (np.abs(c.measured - c.simulated), np.sqrt(2.0) * c.std, np.abs(c.measured))
    )
    return first, off / whole, noise / whole


def compared(diagnosis: "Diagnosis", level: Mapping[int, float]) -> dict[str, Compared]:
    """Models of a diagnosis beside all records, those held out too.

    Parameters
    ----------
    diagnosis : Diagnosis
    level : mapping of int to float
        Nominal force of each record [N].
    """
    fitted = dict(zip(MODELS, (diagnosis.nominal, diagnosis.calibrated, diagnosis.extended_fit), strict=True))
    out = {}
    for name, e in fitted.items():
        parts = [_entries(e, diagnosis.campaign, level, held=False)]
        parts.append(_entries(diagnosis.held.get(name), diagnosis.held_campaign, level, held=True))
        known = [part for part in parts if part]
        if e is not None and known:
            out[name] = Compared(*(np.concatenate(column) for column in zip(*known, strict=True)))
    return out


def _entries(
    e: "Evaluation | None", campaign: "Campaign | None", level: Mapping[int, float], *, held: bool
) -> tuple[npt.NDArray[Any], ...]:
    if e is None or campaign is None:
        return ()
    campaign, rows = replace(campaign, corrections=e.corrections), []
    for r in campaign.data.records:
        if r.number not in e.found:
            continue
        simulated = campaign.amplitudes(r.number, e.solutions[r.number]) + campaign.lasting(r, e.found[r.number])
        channel, k = np.nonzero(r.listed.all(axis=0))
        size = np.ones(len(k))
        complex_of = [a[0, channel, k] + 1j * a[1, channel, k] for a in (r.measured, simulated)]
        numbers = np.full(len(k), r.number), channel, k + 1
        rows.append((*numbers, level[r.number] * size, r.hz * size, *complex_of, r.std[channel, k], size == held))
    return tuple(np.concatenate(column) for column in zip(*rows, strict=True)) if rows else ()


# ---------------------------------------------------------------------------------------------------------- responses


def plot_responses(
    models: Mapping[str, Compared], channels: Sequence[str], units: Sequence[str], axes: AxesArray | None = None
) -> AxesArray:
    """Amplitude of the fundamental over the frequency, a row per channel, a column per band of frequencies.

    Parameters
    ----------
    models : mapping of str to Compared
    channels, units : sequence of str
        Names and units of the channels measured; the first six are drawn.
    axes : array of Axes, optional
        One per channel and band.

    Returns
    -------
    (channels, bands) array of Axes
    """
    any_model = next(iter(models.values()))
    levels = np.unique(any_model.level)
    colors = dict(zip(levels.tolist(), graded(levels.tolist()), strict=True))
    bands = frequency_bands(any_model.hz)
    grid = _grid(any_model, channels, bands, axes)
    for row, beside in enumerate(grid):
        for band, ax in zip(bands, beside, strict=True):
            for level in levels:
                for name, c in models.items():
                    own = _chosen(c, row, band) & (c.level == level)
                    order = np.flatnonzero(own)[np.argsort(c.hz[own])]
                    wide = {"nominal": 0.8, "calibrated": 0.9, "extended": 1.2}[name]
                    ax.plot(
                        c.hz[order],
                        np.abs(c.simulated[order]),
                        color=colors[float(level)],
                        linestyle=STYLES[name],
                        linewidth=wide,
                        marker="_" if len(order) == 1 else "",
                        markersize=9,
                    )
                measured_points(ax, any_model, _chosen(any_model, row, band) & (any_model.level == level), colors)
            ax.set_yscale("log")
            _readable(ax, len(bands))
            dressed(ax, "", "")
        beside[0].set_ylabel(f"{as_written(channels[row])}\n[{units[row]}]", color=INK, fontsize=SMALL + 1)
    label_all(grid, FREQUENCY, "Amplitude of the fundamental")
    handles = [Line2D([], [], color=colors[float(v)], linewidth=3, label=f"{v:g} N") for v in levels]
    handles += [Line2D([], [], color=INK, linestyle=STYLES[name], linewidth=1, label=name) for name in models]
    legend_above(grid, [*handles, *record_handles(any_model)], **FIVE_COLUMNS)
    return grid


def measured_points(ax: Axes, c: Compared, own: npt.NDArray[np.bool_], colors: Mapping[float, Any]) -> None:
    """Draw the measured points, by level; hollow where held out."""
    for held in (False, True):
        i = own & (c.held_out == held)
        if not i.any():
            continue
        color = colors[float(c.level[i][0])]
        ax.errorbar(
            c.hz[i],
            np.abs(c.measured[i]),
            yerr=BAND * c.std[i],
            fmt="o",
            markersize=3.2,
            color=color,
            elinewidth=0.8,
            markerfacecolor="white" if held else color,
            markeredgewidth=0.8,
        )


def plot_deviations(
    models: Mapping[str, Compared], channels: Sequence[str], axes: AxesArray | None = None
) -> AxesArray:
    """Measured less simulated fundamental, relative to the measured one, beside what noise makes of it.

    Parameters
    ----------
    models : mapping of str to Compared
    channels : sequence of str
    axes : array of Axes, optional
        One per channel and band.

    Returns
    -------
    (channels, bands) array of Axes
    """
    any_model = next(iter(models.values()))
    noise = 100 * np.sqrt(2.0) * any_model.std / np.abs(any_model.measured)
    bands = frequency_bands(any_model.hz)
    grid = _grid(any_model, channels, bands, axes)
    for row, beside in enumerate(grid):
        for band, ax in zip(bands, beside, strict=True):
            own = _chosen(any_model, row, band)
            ax.plot(any_model.hz[own], noise[own], "_", color="0.35", markersize=5, markeredgewidth=0.9, zorder=1)
            for name, c in models.items():
                off = 100 * np.abs(c.measured - c.simulated) / np.abs(c.measured)
                shift = ASIDE * (MODELS.index(name) - 1) * (band[1] - band[0])
                for held in (False, True):
                    i = _chosen(c, row, band) & (c.held_out == held)
                    points(ax, c.hz[i] + shift, off[i], name, hollow=held)
            ax.set_yscale("log")
            ax.set_ylim(bottom=LOST * float(noise[(any_model.channel == row) & (any_model.harmonic == 1)].min()))
            _readable(ax, len(bands))
            dressed(ax, "", "")
        beside[0].set_ylabel(as_written(channels[row]), color=INK, fontsize=SMALL + 1)
    label_all(grid, FREQUENCY, "Deviation of the fundamental [%]")
    handles = [_handle(name) for name in models]
    handles.append(Line2D([], [], linestyle="", marker="_", color="0.35", label="noise, rms"))
    if any_model.held_out.any():
        handles.append(Line2D([], [], linestyle="", marker="o", color=INK, markerfacecolor="white", label="held out"))
    legend_above(grid, handles, **FIVE_COLUMNS)
    return grid


def _chosen(c: Compared, channel: int, band: tuple[float, float]) -> npt.NDArray[np.bool_]:
    return np.asarray((c.channel == channel) & (c.harmonic == 1) & (c.hz >= band[0]) & (c.hz <= band[1]))


def frequency_bands(hz: Array) -> list[tuple[float, float]]:
    """Ends of groups of neighbouring frequencies."""
    f = np.unique(hz)
    starts = np.flatnonzero(np.append(True, f[1:] / f[:-1] > GAP))
    ends = np.append(starts[1:], len(f)) - 1
    return [(float(f[i]), float(f[j])) for i, j in zip(starts, ends, strict=True)]


def _grid(
    c: Compared, channels: Sequence[str], bands: Sequence[tuple[float, float]], axes: AxesArray | None
) -> AxesArray:
    """A row per channel, a column per band as wide as its share of the records."""
    rows = min(len(channels), MOST_CHANNELS)
    counts = [max(len(np.unique(c.hz[(c.hz >= low) & (c.hz <= high)])), 1) for low, high in bands]
    widths = [max(n, 0.4 * max(counts)) for n in counts]
    height = max(0.9 + 1.15 * rows, LEAST_HEIGHT)
    return panels(axes, rows, len(bands), height, sharex="col", sharey="row", width_ratios=widths)


def _readable(ax: Axes, bands: int) -> None:
    """Numbers at the ticks of a panel, fewer where several stand side by side."""
    low, high = ax.get_ylim()
    few_powers(ax.yaxis, high / low)
    ax.xaxis.set_major_locator(MaxNLocator(6 if bands == 1 else 3, min_n_ticks=2))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))


def few_powers(axis: Axis, span: float) -> None:
    """Powers of ten on a logarithmic axis, or more of it where it spans few."""
    axis.set_major_locator(LogLocator(subs=(1.0,) if span > 50.0 else (1.0, 2.0, 5.0), numticks=6))
    axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axis.set_minor_formatter(NullFormatter())


def points(ax: Axes, x: Array, y: Array, name: str, *, hollow: bool) -> None:
    """Points of a model, in its marker and colour."""
    filled: dict[str, Any] = {} if MARKERS[name] == "x" else {"markerfacecolor": "white" if hollow else COLORS[name]}
    ax.plot(x, y, MARKERS[name], color=COLORS[name], markersize=3.2, markeredgewidth=0.8, **filled)


def _handle(name: str) -> Line2D:
    return Line2D([], [], linestyle="", marker=MARKERS[name], color=COLORS[name], markersize=4.5, label=name)


def record_handles(c: Compared) -> list[Line2D]:
    """Entries of a legend for records, fitted and held out."""
    shown = [Line2D([], [], linestyle="", marker="o", color=INK, markersize=4, label="measured")]
    if c.held_out.any():
        hollow: dict[str, Any] = {"markerfacecolor": "white", "markersize": 4}
        shown.append(Line2D([], [], linestyle="", marker="o", color=INK, label="measured, held out", **hollow))
    return shown


def levels(force: Array) -> Array:
    """The mean of forces that are alike, for each of them."""
    order = np.argsort(force)
    group = np.empty(len(force), dtype=int)
    group[order] = np.cumsum(np.append(0.0, force[order][1:] / force[order][:-1] > ALIKE))
    return np.asarray((np.bincount(group, force) / np.bincount(group))[group])
