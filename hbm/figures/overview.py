"""First figure of a diagnosis: what is missed most clearly, and the error of each record."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from hbm.figures.compared import Compared, View, record_errors
from hbm.figures.diagnosis import (
    COLORS,
    FREQUENCY,
    MARKERS,
    STYLES,
    draw_response,
    measured_points,
    of_model,
    points,
    record_handles,
)
from hbm.figures.scales import logarithmic
from hbm.figures.style import INK, SMALL, AxesArray, as_written, dressed, legend_above, panels
from hbm.figures.units import prefixed
from hbm.fourier import Array
from hbm.measurement.groups import frequency_bands

if TYPE_CHECKING:
    from hbm.diagnosis.curves import TracedResponse


CHARACTER, BETWEEN = 0.032, 0.02
"""Width of a character of a tick label and least gap between labels, as shares of the panel of errors."""


def plot_overview(
    models: Mapping[str, Compared],
    view: View,
    quantity: str,
    unit: str,
    axes: AxesArray | None = None,
    *,
    traced: Sequence["TracedResponse"] = (),
) -> AxesArray:
    """Draw the signal that shows the misfit best, before and after, and the error of each record.

    Parameters
    ----------
    models : mapping of str to Compared
    view : View
    quantity, unit : str
        Name of the channel, and its unit.
    axes : array of two Axes, optional
    traced : sequence of TracedResponse
        Curves of the models. A model without one is drawn by straight lines between its records.

    Returns
    -------
    (2,) array of Axes
    """
    pair = panels(axes, 1, 2, 2.6, width_ratios=[1.15, 1.0]).ravel()
    left, right = pair
    any_model = next(iter(models.values()))
    scale, unit = prefixed(unit, any_model.measured[view.of(any_model)])
    for name, c in models.items():
        curve = of_model(traced, name, view.level, view.band)
        line = {"color": COLORS[name], "linestyle": STYLES[name], "linewidth": 1.2}
        draw_response(left, c, view.of(c), curve, (quantity, view.harmonic), scale, **line)
    own = np.zeros(len(any_model.hz), dtype=bool)
    own[view.of(any_model)] = True
    measured_points(left, any_model.times(scale), own, INK)
    left.set_ylim(bottom=0.0)
    left.xaxis.set_major_locator(MaxNLocator(5))
    dressed(left, FREQUENCY, f"Harmonic {view.harmonic} of {as_written(quantity)} [{unit}]")
    left.set_title(f"at {view.level:.3g} N", fontsize=SMALL + 1, loc="left", color=INK)
    _draw_record_errors(right, models)
    handles = record_handles(any_model)
    for name in models:
        shown: dict[str, Any] = {"linestyle": STYLES[name], "marker": MARKERS[name], "markersize": 4, "linewidth": 1.2}
        handles.append(Line2D([], [], color=COLORS[name], label=name, **shown))
    handles.append(Line2D([], [], linestyle="", marker="_", color="0.35", label="noise"))
    # handles as long as shows dashes, and no wider together than the figure
    legend_above(pair, handles, ncols=6, columnspacing=0.8, handlelength=2.5, handletextpad=0.5)
    return pair


def _draw_record_errors(ax: Axes, models: Mapping[str, Compared]) -> None:
    """Error of each record over its frequency; where there are several bands over its place among the frequencies."""
    any_model = next(iter(models.values()))
    frequencies, bands = np.unique(any_model.hz), frequency_bands(any_model.hz)
    several = len(bands) > 1
    place = _in_order(frequencies, bands) if several else frequencies
    for name, c in models.items():
        first, error, noise = record_errors(c)
        x = np.interp(c.hz[first], frequencies, place)
        for held in (False, True):
            i = c.held_out[first] == held
            points(ax, x[i], 100.0 * error[i], name, hollow=held)
    ax.plot(x, 100.0 * noise, "_", color="0.35", markersize=5, markeredgewidth=0.9, zorder=1)
    logarithmic(ax.yaxis)
    if several:
        ends = np.searchsorted(frequencies, [hz for band in bands for hz in band])
        names = [f"{hz:.4g}" for hz in frequencies]
        shown = _apart(place, names, [*ends.tolist(), *range(len(names))])
        ax.set_xticks(place[shown], [names[i] for i in shown])
        ax.set_xticks(place, minor=True)
    dressed(ax, f"{FREQUENCY}{', not to scale' if several else ''}", "Error [%]")
    ax.set_title("all channels and harmonics", fontsize=SMALL + 1, loc="left", color=INK)


def _in_order(frequencies: Array, bands: Sequence[tuple[float, float]]) -> Array:
    """Places of frequencies side by side, with a gap between bands."""
    band = np.array([next(i for i, (low, high) in enumerate(bands) if low <= hz <= high) for hz in frequencies])
    return np.asarray(np.arange(len(frequencies)) + 1.5 * band)


def _apart(place: Array, names: Sequence[str], order: Sequence[int]) -> list[int]:
    """Which of some names have room beside each other along an axis, those that come first in an order first."""
    shown: list[int] = []
    for i in order:
        needed = (CHARACTER * (len(names[i]) + len(names[j])) / 2 + BETWEEN for j in shown)
        if all(abs(place[i] - place[j]) >= room * np.ptp(place) for j, room in zip(shown, needed, strict=True)):
            shown.append(i)
    return sorted(shown)
