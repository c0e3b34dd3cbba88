"""Figure of a measured backbone: frequency and damping over the amplitude, beside models, and what these leave."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from hbm.figures.compared import Compared
from hbm.figures.diagnosis import BAND, COLORS, FIVE_COLUMNS, STYLES, WIDTHS, record_handles
from hbm.figures.scales import logarithmic
from hbm.figures.style import FAINT, INK, AxesArray, as_written, dressed, legend_above, panels
from hbm.figures.units import prefixed
from hbm.fourier import Array
from hbm.measurement.decay import Decay, damping_ratio, decay_rate


@dataclass(frozen=True, eq=False)
class DecayCompared:
    """Amplitudes of a decay beside those of a model, (m,) arrays in the order of the amplitude.

    Attributes
    ----------
    row : int array
        Numbers of the amplitudes in the decay.
    amplitude : array
    hz, damping_ratio : array
        Of the model.
    held_out : bool array
    """

    row: npt.NDArray[np.int64]
    amplitude: Array
    hz: Array
    damping_ratio: Array
    held_out: npt.NDArray[np.bool_]


def decay_compared(decay: Decay, model: Compared) -> DecayCompared:
    """What a model says at the amplitudes of a decay, from the complex frequencies that it misses."""
    order = np.argsort(model.level)
    row, missed = model.record[order], (model.measured - model.simulated)[order]
    hz, ratio = decay.hz[row - 1], decay.damping_ratio[row - 1]
    simulated, rate = hz - missed.real, decay_rate(hz, ratio) - missed.imag
    return DecayCompared(row, model.level[order], simulated, damping_ratio(simulated, rate), model.held_out[order])


def plot_decay(
    models: Mapping[str, Compared], decay: Decay, quantity: str, unit: str, axes: AxesArray | None = None
) -> AxesArray:
    """Frequency and damping ratio over the amplitude, measured and simulated; below what each model misses.

    Parameters
    ----------
    models : mapping of str to Compared
    decay : Decay
    quantity, unit : str
        Name of the channel, and its unit.
    axes : array of four Axes, optional

    Returns
    -------
    (2, 2) array of Axes
    """
    grid = panels(axes, 2, 2, 4.6, sharex=True)
    shown = {name: decay_compared(decay, c) for name, c in models.items()}
    scale_of_amplitude, unit = prefixed(unit, *(c.amplitude for c in shown.values()))
    shown = {name: replace(c, amplitude=scale_of_amplitude * c.amplitude) for name, c in shown.items()}
    first = next(iter(shown.values()))
    for column, (measured, std, key, scale) in enumerate(
        ((decay.hz, decay.hz_std, "hz", 1.0), (decay.damping_ratio, decay.damping_ratio_std, "damping_ratio", 100.0))
    ):
        at = first.row - 1
        bars = scale * BAND * std[at]
        _dots(grid[0, column], first, scale * measured[at], bars, INK)
        grid[1, column].axhline(0.0, color=FAINT, linewidth=0.8, zorder=0)
        for name, c in shown.items():
            simulated = scale * getattr(c, key)
            line: dict[str, Any] = {"color": COLORS[name], "linestyle": STYLES[name], "linewidth": WIDTHS[name]}
            grid[0, column].plot(c.amplitude, simulated, **line)
            if name != "nominal":
                _dots(grid[1, column], c, scale * measured[at] - simulated, bars, COLORS[name])
    for column, label in enumerate(("Frequency [Hz]", "Damping ratio [%]")):
        dressed(grid[0, column], "", label)
        dressed(grid[1, column], f"{as_written(quantity)} [{unit}]", f"Missed {label[0].lower()}{label[1:]}")
    logarithmic(grid[0, 0].xaxis)
    legend_above(grid, [*map(_line, shown), *record_handles(next(iter(models.values())))], **FIVE_COLUMNS)
    return grid


def _dots(ax: Axes, c: DecayCompared, y: Array, bars: Array, color: str) -> None:
    """Amplitudes with their bars, hollow where held out."""
    style: dict[str, Any] = {"linestyle": "", "marker": "o", "markersize": 3.5, "elinewidth": 0.7, "color": color}
    for own, face in ((~c.held_out, color), (c.held_out, "white")):
        ax.errorbar(c.amplitude[own], y[own], bars[own], markerfacecolor=face, **style)


def _line(name: str) -> Line2D:
    return Line2D([], [], color=COLORS[name], linestyle=STYLES[name], linewidth=WIDTHS[name], label=name)
