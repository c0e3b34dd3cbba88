"""Figures of friction loops: of a steady state, and of laws alone under a prescribed slip."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes

from hbm.balance.solution import PeriodicSolution
from hbm.figures.style import (
    INK,
    SMALL,
    AxesArray,
    closed,
    dressed,
    label_all,
    legend_above,
    level_colors,
    new_axes,
    panels,
)
from hbm.fourier import Array

if TYPE_CHECKING:
    from hbm.response.loop import FrictionLoop

LOOP_LABELS = ("Slip [µm]", "Velocity [mm/s]")
STYLES = ("-", (0, (5, 1.5)), (0, (2, 1)), (0, (5, 1, 1, 1)))
OVERLAID = len(STYLES)


def plot_loop(
    solution: PeriodicSolution, ax: Axes | None = None, *, mu: float | None = None, color: Any = None
) -> Axes:
    """Friction force over slip, one period.

    Parameters
    ----------
    solution : PeriodicSolution
    ax : Axes, optional
    mu : float, optional
        Friction coefficient: the limits +mu R(t) and -mu R(t) are drawn too.
    color : optional
        Any Matplotlib colour.
    """
    ax = new_axes(ax)
    slip, T = closed(solution.channels["slip"].samples) * 1e6, closed(solution.channels["friction"].samples)
    if mu is not None:
        limit = mu * closed(solution.channels["normal"].samples)
        for sign, text in ((1.0, r"$\mu R$"), (-1.0, r"$-\mu R$")):
            ax.plot(slip, sign * limit, color="0.55", linewidth=0.8, linestyle=(0, (4, 2)), label=text)
            right = int(np.argmax(slip))
            ax.annotate(
                text,
                (slip[right], sign * limit[right]),
                (3, 0),
                textcoords="offset points",
                color="0.4",
                fontsize=SMALL,
            )
    ax.plot(slip, T, color=level_colors([solution])[0] if color is None else color, linewidth=1.4)
    return dressed(ax, "Slip [µm]", "Friction force [N]")


def plot_loops(loops: Sequence["FrictionLoop"], axes: AxesArray | None = None) -> AxesArray:
    """Friction force against slip and against slip velocity, side by side.

    Up to OVERLAID laws share two panels. More have a pair of panels each, with the other loops in grey behind.

    Parameters
    ----------
    loops : sequence of FrictionLoop
    axes : array of Axes, optional
        Two, or four for each two laws.

    Returns
    -------
    (2,) or (rows, 4) array of Axes
    """
    return _overlaid(loops, axes) if len(loops) <= OVERLAID else _one_by_one(loops, axes)


def _overlaid(loops: Sequence["FrictionLoop"], axes: AxesArray | None) -> AxesArray:
    pair = panels(axes, 1, 2, 2.9, sharey=True).ravel()
    for i, (loop, style) in enumerate(zip(loops, STYLES, strict=False)):
        color = colormaps["viridis"](0.05 + 0.73 * i / max(len(loops) - 1, 1))
        for ax, x in zip(pair, _scaled(loop), strict=True):
            ax.plot(x, closed(loop.T), color=color, linestyle=style, linewidth=1.4, label=loop.law.name)
    for ax, x_label, y_label in zip(pair, LOOP_LABELS, ("Friction force [N]", ""), strict=True):
        dressed(ax, x_label, y_label)
    legend_above(pair, pair[0].get_legend_handles_labels()[0], where="upper center", ncols=OVERLAID)
    return pair


def _one_by_one(loops: Sequence["FrictionLoop"], axes: AxesArray | None) -> AxesArray:
    rows = -(-len(loops) // 2)
    grid = panels(axes, rows, 4, 1.2 * rows + 0.4, sharex="col", sharey=True)
    free = [(0, 2)] if len(loops) % 2 else []
    places = [(row, column) for column in (0, 2) for row in range(rows) if (row, column) not in free]
    for loop, (row, column) in zip(loops, places, strict=True):
        _small_multiple(grid[row, column : column + 2], loop, loops)
    for row, column in free:
        _say_what_is_drawn(grid[row, column : column + 2], loops[0])
    for ax, label in zip(grid[-1], LOOP_LABELS * 2, strict=True):
        ax.set_xlabel(label, color=INK)
    label_all(grid, "", "Friction force [N]")
    return grid


def _small_multiple(pair: AxesArray, loop: "FrictionLoop", loops: Sequence["FrictionLoop"]) -> None:
    for k, ax in enumerate(pair):
        for other in loops:
            ax.plot(_scaled(other)[k], closed(other.T), color="0.87", linewidth=0.5, label=f"_{other.law.name}")
        ax.plot(_scaled(loop)[k], closed(loop.T), color=level_colors([loop])[0], linewidth=1.3, label=loop.law.name)
        dressed(ax, "", "")
    pair[0].set_title(loop.law.name, fontsize=SMALL + 1, loc="left", color=INK)


def _say_what_is_drawn(pair: AxesArray, loop: "FrictionLoop") -> None:
    """Fill a place that no law takes."""
    text = f"slip ±{np.ptp(loop.u) * 5e5:.3g} µm at {loop.hz:g} Hz,\nload {loop.load:g} N; grey: the other laws"
    note = pair[0].text(0.0, 0.5, text, transform=pair[0].transAxes, va="center", fontsize=SMALL, color=INK)
    note.set_in_layout(False)
    for ax in pair:
        ax.set_axis_off()


def _scaled(loop: "FrictionLoop") -> tuple[Array, Array]:
    """Slip [µm] and slip velocity [mm/s], closed."""
    return closed(loop.u) * 1e6, closed(loop.v) * 1e3
