"""Figure of a record of many lines: what was measured, and what each model misses, line by line."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.lines import Line2D

from hbm.figures.compared import Compared
from hbm.figures.diagnosis import COLORS, FIVE_COLUMNS, FREQUENCY
from hbm.figures.scales import logarithmic
from hbm.figures.style import INK, AxesArray, as_written, dressed, legend_above, panels
from hbm.figures.units import prefixed

ROOM = 10.0
"""What is drawn reaches this factor below the noise of the quietest line."""


def most_missed(models: Mapping[str, Compared]) -> tuple[int, int]:
    """Number of the first record held out, of the first where none is, and place of the channel missed most there."""
    first = next(iter(models.values()))
    record = int(first.record[first.held_out][0] if first.held_out.any() else first.record[0])
    own = first.where(first.record == record)
    missed, whole = (
        np.bincount(own.channel, np.abs(part) ** 2) for part in (own.measured - own.simulated, own.measured)
    )
    return record, int(np.argmax(missed / np.where(whole > 0.0, whole, 1.0)))


def plot_lines(
    models: Mapping[str, Compared], record: int, channel: int, quantity: str, unit: str, axes: AxesArray | None = None
) -> AxesArray:
    """Amplitudes of the lines of one channel in a record, beside those of what each model misses.

    Parameters
    ----------
    models : mapping of str to Compared
    record, channel : int
        Number of the record, place of the channel.
    quantity, unit : str
        Name of the channel, and its unit.
    axes : array of one Axes, optional

    Returns
    -------
    (1,) array of Axes
    """
    found = panels(axes, 1, 1, 3.2).ravel()
    (ax,), handles, bottom = found, list[Line2D](), 0.0
    first = next(iter(models.values()))
    scale, unit = prefixed(unit, first.measured[(first.record == record) & (first.channel == channel)])
    dots: dict[str, Any] = {"linestyle": "", "marker": ".", "markersize": 2.5}
    for name, c in models.items():
        own = c.where((c.record == record) & (c.channel == channel)).times(scale)
        hz = own.harmonic * own.hz
        if not handles:
            ax.plot(hz, np.abs(own.measured), color=INK, **dots)
            ax.plot(hz, np.sqrt(2.0) * own.std, color=INK, linewidth=0.8)
            bottom = np.sqrt(2.0) * float(own.std.min()) / ROOM
            handles = [
                Line2D([], [], color=INK, label="measured", **dots | {"markersize": 6}),
                Line2D([], [], color=INK, linewidth=0.8, label="noise"),
            ]
        ax.plot(hz, np.abs(own.measured - own.simulated), color=COLORS[name], **dots)
        handles.append(Line2D([], [], color=COLORS[name], label=f"missed, {name}", **dots | {"markersize": 6}))
    logarithmic(ax.yaxis)
    ax.set_ylim(bottom=bottom)
    dressed(ax, FREQUENCY, f"{as_written(quantity)} [{unit}]")
    legend_above(found, handles, **FIVE_COLUMNS)
    return found
