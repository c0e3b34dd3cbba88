"""Figure of where models miss: by channel and harmonic, and by record."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.ticker import MaxNLocator

from hbm.figures.compared import Compared
from hbm.figures.diagnosis import FREQUENCY
from hbm.figures.scales import few_numbers
from hbm.figures.style import INK, SMALL, AxesArray, as_written, dressed, label_all, panels
from hbm.fourier import Array

LABELLED = 10
"""Most frequencies that have room beside each other, turned, in one of three panels."""


def plot_misfit_map(
    models: Mapping[str, Compared], channels: Sequence[str], axes: AxesArray | None = None
) -> AxesArray:
    """Rms deviation in standard deviations, by channel and harmonic and by record, a column per model.

    Parameters
    ----------
    models : mapping of str to Compared
    channels : sequence of str
    axes : array of Axes, optional
        Two per model; a colour bar takes a part of them.

    Returns
    -------
    (2, models) array of Axes
    """
    grid = panels(axes, 2, len(models), 4.2, sharex="row", sharey="row")
    largest = max(float(np.nanmax(by_cell(c, len(channels)))) for c in models.values())
    norm, shade = LogNorm(0.5, max(largest, 4.0)), "magma_r"
    for column, (name, c) in enumerate(models.items()):
        top, bottom = grid[0][column], grid[1][column]
        H = int(c.harmonic.max())
        cells = np.ma.masked_invalid(by_cell(c, len(channels)))
        image = top.imshow(
            cells, norm=norm, cmap=shade, aspect="auto", extent=(0.5, H + 0.5, len(channels) - 0.5, -0.5)
        )
        top.set_title(name, fontsize=SMALL + 1, loc="left", color=INK)
        top.set_yticks(range(len(channels)), list(map(as_written, channels)))
        top.xaxis.set_major_locator(MaxNLocator(6, integer=True))
        dressed(top, "Harmonic", "")
        _record_map(bottom, c, norm, shade)
    dressed(grid[1][0], "", "Level [N]")
    label_all(grid, FREQUENCY + ", record by record; diamonds: held out")
    bar = grid[0, 0].figure.colorbar(image, ax=grid, aspect=40, pad=0.02)
    bar.set_label("Rms deviation [standard deviations]", color=INK)
    few_numbers(bar.ax.yaxis)
    return grid


def by_cell(c: Compared, channels: int) -> Array:
    """Rms deviation by channel and harmonic, (c, H), nan where nothing was measured."""
    H = int(c.harmonic.max())
    sums, counts = np.zeros((channels, H)), np.zeros((channels, H))
    np.add.at(sums, (c.channel, c.harmonic - 1), c.deviation**2)
    np.add.at(counts, (c.channel, c.harmonic - 1), 1.0)
    return np.asarray(np.sqrt(np.divide(sums, counts, out=np.full_like(sums, np.nan), where=counts > 0.0)))


def by_record(c: Compared) -> tuple[npt.NDArray[np.int64], Array]:
    """Rms deviation of each record: places of its first entry, and values."""
    _, first, inverse = np.unique(c.record, return_index=True, return_inverse=True)
    return first, np.asarray(np.sqrt(np.bincount(inverse, c.deviation**2) / np.bincount(inverse)))


def _record_map(ax: Axes, c: Compared, norm: LogNorm, shade: str) -> None:
    """Records by their level and frequency, in order, not to scale."""
    first, rms = by_record(c)
    frequencies, across = np.unique(c.hz[first], return_inverse=True)
    levels, up = np.unique(c.level[first], return_inverse=True)
    for held, marker in ((False, "s"), (True, "D")):
        i = c.held_out[first] == held
        size: dict[str, Any] = {"s": 24 if held else 30, "edgecolors": "0.3", "linewidths": 0.5}
        ax.scatter(across[i], up[i], c=rms[i], norm=norm, cmap=shade, marker=marker, **size)
    shown = range(0, len(frequencies), -(-len(frequencies) // LABELLED))
    ax.set_xticks(shown, [f"{frequencies[i]:.4g}" for i in shown], rotation=45)
    ax.set_xticks(range(len(frequencies)), minor=True)
    ax.set_yticks(range(len(levels)), [f"{level:g}" for level in levels])
    ax.margins(x=0.08, y=0.15)
    dressed(ax, "", "")
