"""Figures of a diagnosis: measured against simulated, where a model misses, what force it lacks, causes, gain.

Nominal, calibrated and extended models have the same colour and marker in all of them. Records held out are hollow.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, MaxNLocator

from hbm.figures.compared import MODELS, Compared
from hbm.figures.scales import logarithmic
from hbm.figures.style import INK, SMALL, AxesArray, as_written, dressed, graded, label_all, legend_above, panels
from hbm.figures.units import prefixed
from hbm.fourier import Array
from hbm.measurement.groups import frequency_bands, levels

if TYPE_CHECKING:
    from hbm.diagnosis.curves import TracedResponse

COLORS = dict(zip(MODELS, ("0.55", "#D55E00", "#0072B2"), strict=True))
MARKERS = dict(zip(MODELS, ("x", "o", "s"), strict=True))
STYLES: dict[str, Any] = dict(zip(MODELS, ((0, (1, 1.5)), (0, (4, 1.5)), "-"), strict=True))

WIDTHS = dict(zip(MODELS, (0.8, 0.9, 1.2), strict=True))

BAND = 1.96
"""Standard deviations on either side of a bar: 95 %."""

MOST_CHANNELS, MOST_PLACES = 6, 12

LEAST_HEIGHT = 3.2  # inches, for the label beside the rows

LOST = 0.2
"""Deviations below this part of the noise are not drawn."""

ASIDE = 0.006
"""Share of a band of frequencies by which models stand beside each other, for their points would hide each other."""

FREQUENCY = "Frequency [Hz]"

FIVE_COLUMNS: dict[str, Any] = {"ncols": 5, "columnspacing": 1.4}


# ---------------------------------------------------------------------------------------------------------- responses


def plot_responses(
    models: Mapping[str, Compared],
    channels: Sequence[str],
    units: Sequence[str],
    axes: AxesArray | None = None,
    *,
    traced: Sequence["TracedResponse"] = (),
) -> AxesArray:
    """Amplitude of the fundamental over the frequency, a row per channel, a column per band of frequencies.

    Parameters
    ----------
    models : mapping of str to Compared
    channels, units : sequence of str
        Names and units of the channels measured; the first six are drawn.
    traced : sequence of TracedResponse
        Curves of the models. A model without one is drawn by straight lines between its records.
    axes : array of Axes, optional
        One per channel and band.

    Returns
    -------
    (channels, bands) array of Axes
    """
    any_model = next(iter(models.values()))
    level_of = levels(any_model.level)
    found = np.unique(level_of).tolist()
    colors = dict(zip(found, graded(found), strict=True))
    bands = frequency_bands(any_model.hz)
    grid = _grid(any_model, channels, bands, axes)
    for row, beside in enumerate(grid):
        scale, unit = prefixed(units[row], any_model.measured[(any_model.channel == row) & (any_model.harmonic == 1)])
        for band, ax in zip(bands, beside, strict=True):
            for level in found:
                for name, c in models.items():
                    own = np.flatnonzero(_chosen(c, row, band) & np.isclose(levels(c.level), level))
                    line = {"color": colors[level], "linestyle": STYLES[name], "linewidth": WIDTHS[name]}
                    curve = of_model(traced, name, level, band)
                    draw_response(ax, c, own, curve, (channels[row], 1), scale, **line)
                shown = _chosen(any_model, row, band) & (level_of == level)
                measured_points(ax, any_model.times(scale), shown, colors[level])
            logarithmic(ax.yaxis)
            _readable(ax, len(bands))
            dressed(ax, "", "")
        beside[0].set_ylabel(f"{as_written(channels[row])}\n[{unit}]", color=INK, fontsize=SMALL + 1)
    label_all(grid, FREQUENCY, "Amplitude of the fundamental")
    handles = [Line2D([], [], color=colors[v], linewidth=3, label=f"{v:.3g} N") for v in found]
    handles += [Line2D([], [], color=INK, linestyle=STYLES[name], linewidth=1, label=name) for name in models]
    legend_above(grid, [*handles, *record_handles(any_model)], **FIVE_COLUMNS)
    return grid


def of_model(
    traced: Sequence["TracedResponse"], model: str, level: float, band: tuple[float, float]
) -> "TracedResponse | None":
    """The curve of a model at a level about a band of frequencies, if it was traced."""
    middle = (band[0] + band[1]) / 2.0
    own = [t for t in traced if t.model == model and np.isclose(t.level, level) and _within(t, band)]
    return min(own, key=lambda t: abs(float(np.mean(t.hz)) - middle), default=None)


def _within(t: "TracedResponse", band: tuple[float, float]) -> bool:
    return bool(((t.hz >= band[0]) & (t.hz <= band[1])).any())


def draw_response(
    ax: Axes,
    c: Compared,
    own: npt.NDArray[np.int64],
    traced: "TracedResponse | None",
    signal: tuple[str, int],
    scale: float,
    **line: Any,
) -> None:
    """Draw a model at one level: its curve, or where it was not traced its records, joined.

    Parameters
    ----------
    ax : Axes
    c : Compared
    own : int array
        Places of its records.
    traced : TracedResponse or None
    signal : (str, int)
        Channel and harmonic.
    scale : float
        Factor of the unit of the axis.
    **line
        Style.
    """
    channel, harmonic = signal
    if traced is not None and harmonic < traced.amplitudes[channel].shape[1]:
        ax.plot(traced.hz, scale * traced.amplitudes[channel][:, harmonic], **line)
        return
    order = own[np.argsort(c.hz[own])]
    y = scale * np.abs(c.simulated[order])
    ax.plot(c.hz[order], y, marker="_" if len(order) == 1 else "", markersize=9, **line)


def measured_points(ax: Axes, c: Compared, own: npt.NDArray[np.bool_], color: Any) -> None:
    """Draw measured points of one level; hollow where held out."""
    for held in (False, True):
        i = own & (c.held_out == held)
        if not i.any():
            continue
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
            logarithmic(ax.yaxis)
            least = noise[(any_model.channel == row) & (any_model.harmonic == 1)].min(initial=np.inf)
            if np.isfinite(least):  # the fundamental of the channel was measured
                ax.set_ylim(bottom=LOST * float(least))
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
    ax.xaxis.set_major_locator(MaxNLocator(6 if bands == 1 else 3, min_n_ticks=2))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))


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
