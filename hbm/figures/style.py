"""What the figures have in common: sizes, inks, axes, one colour per level."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hbm.fourier import Array

Color = tuple[float, ...]

WIDTH = 6.3  # inches: the text width of a page
SMALL = 8
INK, FAINT = "0.2", "0.75"


def new_axes(ax: Axes | None) -> Axes:
    """The axes given, or new ones where none are."""
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return plt.figure(layout="constrained").add_subplot()


def level_colors(items: Sequence[Any]) -> list[Color]:
    """One colour per item with a level, darker for more force."""
    return graded([0.0] if len(items) == 1 else [item.level for item in items])


def graded(levels: Sequence[float]) -> list[Color]:
    """One colour per level, darker for more; distinct without colour vision and in grey."""
    if len(levels) == 1:
        return [colormaps["viridis"](0.15)]
    order = np.argsort(np.argsort(levels))
    return [colormaps["viridis"](0.74 - 0.7 * i / (len(levels) - 1)) for i in order.tolist()]


def panels(
    count: int, heading: float, height: float, *, sharex: bool = False, sharey: bool = False
) -> tuple[Figure, list[Axes]]:
    """A figure with so many panels, at most three in a row.

    Parameters
    ----------
    count : int
    heading, height : float
        Of what stands above the panels and of a row of them [inches].
    sharex, sharey : bool
        Whether all panels have the same axes.

    Returns
    -------
    Figure
    list of Axes
        Of the panels, row by row.
    """
    columns = 2 if count == 4 else min(count, 3)
    rows = -(-count // columns)
    figure = Figure(figsize=(WIDTH, heading + height * rows), layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False, sharex=sharex, sharey=sharey).flat)
    for ax in axes[count:]:
        ax.set_axis_off()
    return figure, axes[:count]


def tint(color: Color, share: float = 0.28) -> Color:
    """A colour so thin on white paper; opaque, so that overlaps do not darken it."""
    return tuple(1.0 - share * (1.0 - part) for part in color[:3])


def closed(samples: Array) -> Array:
    """Samples of a period with the first once more at the end."""
    return np.append(samples, samples[0])


def dressed(ax: Axes, x: str, y: str) -> Axes:
    """Labels, and as little frame as possible."""
    ax.set_xlabel(x, color=INK)
    ax.set_ylabel(y, color=INK)
    ax.spines[["top", "right"]].set_visible(False)
    ax.spines[["left", "bottom"]].set(linewidth=0.6, color="0.4")
    ax.tick_params(width=0.6, color="0.4", labelcolor=INK, labelsize=SMALL + 1)
    return ax
