"""Common style of the figures: sizes, inks, axes, one colour per level."""

from collections.abc import Container, Sequence
from textwrap import wrap
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.legend import Legend
from matplotlib.ticker import ScalarFormatter

from hbm.errors import InputError, shortened
from hbm.fourier import Array

Color = tuple[float, ...]

AxesArray = npt.NDArray[Any]
"""Panels of a figure, each an `Axes`."""

WIDTH = 6.3  # inches: the text width of a page
CHARACTERS = 64
"""Of a title, in a line of that width."""
NAME = 36  # characters of a name beside panels
SMALL = 8
ENTRY, LETTER = 4.2, 0.6
"""Widths of an entry of a legend beside its name, and of a letter of it, in the size of its letters."""
INK, FAINT = "0.2", "0.75"


def new_axes(ax: Axes | None) -> Axes:
    """The axes given, or new ones where none are."""
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return plt.figure(layout="constrained").add_subplot()


def expect_contact(channels: Container[str], figure: str) -> None:
    """Refuse what has no contact of its own, but joints.

    Raises
    ------
    InputError
    """
    if "slip" not in channels:
        raise InputError(
            f"{figure}: a rig with joints has no slip of its own; must have [contact]; plot_channel draws NAME.motion, "
            "NAME.force of a joint"
        )


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
    axes: AxesArray | None, rows: int, columns: int, height: float, *, layout: Any = "constrained", **grid: Any
) -> AxesArray:
    """The axes given, or those of a new figure, (rows, columns).

    Parameters
    ----------
    axes : array of Axes, optional
        So many, in any shape.
    rows, columns : int
    height : float
        Height of a new figure [inches].
    layout : str or layout engine
        Layout of a new figure.
    **grid
        Arguments for the panels of a new figure, as in `Figure.subplots`.

    Returns
    -------
    array of Axes

    Raises
    ------
    InputError
        If more or fewer axes are given.
    """
    if axes is None:
        import matplotlib.pyplot as plt

        axes = plt.figure(figsize=(WIDTH, height), layout=layout).subplots(rows, columns, squeeze=False, **grid)
    found = np.asarray(axes, dtype=object)
    if found.size != rows * columns:
        raise InputError(f"axes: {found.size} panels; must be {rows * columns}, {rows} x {columns}")
    return found.reshape(rows, columns)


def wrapped_panels(axes: AxesArray | None, count: int, heading: float, height: float, **grid: Any) -> AxesArray:
    """The axes given, or those of a new figure with at most three panels in a row, (count,).

    Parameters
    ----------
    axes : array of Axes, optional
    count : int
    heading, height : float
        Heights of what stands above the panels of a new figure, and of a row of panels [inches].
    **grid
        Arguments for the panels of a new figure, as in `Figure.subplots`.

    Returns
    -------
    array of Axes
        Row by row.
    """
    if axes is not None:
        return panels(axes, count, 1, height).ravel()
    columns = 2 if count == 4 else min(count, 3)
    rows = -(-count // columns)
    found = panels(None, rows, columns, heading + height * rows, **grid).ravel()
    for ax in found[count:]:
        ax.set_axis_off()
    return found[:count]


def whole_figure(axes: AxesArray) -> Figure | SubFigure | None:
    """The figure, or part of a figure, that shows these panels and no others; None where it shows more."""
    figure: Figure | SubFigure = axes.flat[0].figure
    return figure if {ax for ax in figure.axes if ax.axison} <= set(axes.flat) else None


def label_all(axes: AxesArray, x: str, y: str = "") -> None:
    """Label what all panels share: on the figure where it shows no others, else on the lowest and the first panels."""
    figure = whole_figure(axes)
    if figure is not None:
        figure.supxlabel(x, color=INK, fontsize=10)
        figure.supylabel(y, color=INK, fontsize=10)
        return
    for ax in np.atleast_2d(axes)[-1]:
        ax.set_xlabel(x, color=INK)
    for ax in np.atleast_2d(axes)[:, 0]:
        ax.set_ylabel("\n".join(filter(None, (y, ax.get_ylabel()))), color=INK)


def legend_above(axes: AxesArray, handles: Sequence[Any], *, where: str = "upper left", **style: Any) -> Legend:
    """A legend above all panels, or in the first of them where the figure shows others or has no room for it."""
    style = {"handles": handles, "frameon": False, "fontsize": SMALL, "labelcolor": INK} | style
    figure: Any = whole_figure(axes)
    roomy = figure is not None and isinstance(figure.get_layout_engine(), ConstrainedLayoutEngine)
    place = {"loc": f"outside {where}"} if roomy else {"loc": "best", "ncols": 1}
    legend: Legend = (figure if roomy else axes.flat[0]).legend(**style | place)
    return legend


def legend_on_top(ax: Axes, handles: Sequence[Artist]) -> None:
    """A legend on top of a panel, where no curve is, in as many columns as have room; none of nothing."""
    if not handles:
        return
    ems = ax.get_window_extent().width / ax.figure.dpi * 72 / SMALL
    entry = ENTRY + LETTER * max(len(str(handle.get_label())) for handle in handles)
    ax.legend(
        handles=handles,
        frameon=False,
        fontsize=SMALL,
        labelcolor=INK,
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        borderaxespad=0.0,
        columnspacing=1.4,
        ncols=max(1, int(ems / entry)),
    )


def align_labels(axes: AxesArray) -> AxesArray:
    """Align the labels of panels that stand above each other; return the panels."""
    axes.flat[0].figure.align_ylabels(list(axes.flat))
    return axes


def as_written(name: str) -> str:
    r"""A name for a figure, which has no room for a long one and would take what is between two $ for a formula.

    >>> as_written("a $ b $")
    'a \\$ b \\$'
    """
    return _plain(shortened(name, NAME))


def _plain(text: str) -> str:
    return text.replace("$", r"\$")


def in_lines(title: str) -> str:
    """A title, in as many lines as the width of a figure asks for."""
    lines = wrap(title, CHARACTERS, break_on_hyphens=False) or [""]
    return "\n".join(map(_plain, lines))


def headed(ax: Axes, title: str) -> None:
    """Title the first panel of a figure."""
    ax.set_title(in_lines(title), fontsize=10, loc="left", color=INK)


def tint(color: Color, share: float = 0.28) -> Color:
    """A colour diluted with white; opaque, so that overlaps do not darken it."""
    return tuple(1.0 - share * (1.0 - part) for part in color[:3])


def say_nothing(ax: Axes, text: str) -> None:
    """Say in a panel that all it would show is zero, and number nothing beside it."""
    ax.text(0.5, 0.5, text, transform=ax.transAxes, ha="center", va="center", fontsize=SMALL + 1, color="0.4")
    ax.set_yticks([])


def closed(samples: Array) -> Array:
    """Samples of a period with the first one repeated at the end."""
    return np.append(samples, samples[0])


def dressed(ax: Axes, x: str, y: str) -> Axes:
    """Labels, numbers that are written in full, and as little frame as possible."""
    ax.set_xlabel(x, color=INK)
    ax.set_ylabel(y, color=INK)
    ax.spines[["top", "right"]].set_visible(False)
    ax.spines[["left", "bottom"]].set(linewidth=0.6, color="0.4")
    ax.tick_params(which="both", width=0.6, color="0.4", labelcolor=INK, labelsize=SMALL + 1)
    for axis in (ax.xaxis, ax.yaxis):
        formatter = axis.get_major_formatter()
        if isinstance(formatter, ScalarFormatter):
            formatter.set_useOffset(False)
    return ax
