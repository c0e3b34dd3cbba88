"""Figures of friction loops: of a steady state, and of laws alone under a prescribed slip."""

from collections.abc import Sequence
from dataclasses import dataclass
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
    expect_contact,
    label_all,
    legend_above,
    level_colors,
    new_axes,
    panels,
)
from hbm.figures.units import prefixed
from hbm.fourier import Array

if TYPE_CHECKING:
    from hbm.response.loop import FrictionLoop

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

    Raises
    ------
    InputError
        Of a rig with joints.
    """
    expect_contact(solution.channels, "plot_loop")
    ax = new_axes(ax)
    slip, T, limit = (closed(solution.channels[name].samples) for name in ("slip", "friction", "normal"))
    (scale, unit), (by_force, of_force) = prefixed("m", slip), prefixed("N", T)
    slip, T = scale * slip, by_force * T
    if mu is not None:
        limit = by_force * mu * limit
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
    return dressed(ax, f"Slip [{unit}]", f"Friction force [{of_force}]")


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
    pair, scales = panels(axes, 1, 2, 2.9, sharey=True).ravel(), _scales(loops)
    for i, (loop, style) in enumerate(zip(loops, STYLES, strict=False)):
        color = colormaps["viridis"](0.05 + 0.73 * i / max(len(loops) - 1, 1))
        for ax, x in zip(pair, scales.over(loop), strict=True):
            ax.plot(x, scales.force(loop), color=color, linestyle=style, linewidth=1.4, label=loop.law.name)
    for ax, x_label, y_label in zip(pair, scales.labels, (scales.label, ""), strict=True):
        dressed(ax, x_label, y_label)
    legend_above(pair, pair[0].get_legend_handles_labels()[0], where="upper center", ncols=OVERLAID)
    return pair


def _one_by_one(loops: Sequence["FrictionLoop"], axes: AxesArray | None) -> AxesArray:
    rows = -(-len(loops) // 2)
    grid = panels(axes, rows, 4, 1.2 * rows + 0.4, sharex="col", sharey=True)
    free = [(0, 2)] if len(loops) % 2 else []
    scales = _scales(loops)
    places = [(row, column) for column in (0, 2) for row in range(rows) if (row, column) not in free]
    for loop, (row, column) in zip(loops, places, strict=True):
        _small_multiple(grid[row, column : column + 2], loop, loops, scales)
    for row, column in free:
        _say_what_is_drawn(grid[row, column : column + 2], loops[0])
    for ax, label in zip(grid[-1], scales.labels * 2, strict=True):
        ax.set_xlabel(label, color=INK)
    label_all(grid, "", scales.label)
    return grid


def _small_multiple(pair: AxesArray, loop: "FrictionLoop", loops: Sequence["FrictionLoop"], scales: "_Scales") -> None:
    for k, ax in enumerate(pair):
        for other in loops:
            behind = scales.over(other)[k], scales.force(other)
            ax.plot(*behind, color="0.87", linewidth=0.5, label=f"_{other.law.name}")
        own = scales.over(loop)[k], scales.force(loop)
        ax.plot(*own, color=level_colors([loop])[0], linewidth=1.3, label=loop.law.name)
        dressed(ax, "", "")
    pair[0].set_title(loop.law.name, fontsize=SMALL + 1, loc="left", color=INK)


def _say_what_is_drawn(pair: AxesArray, loop: "FrictionLoop") -> None:
    """Fill a place that no law takes."""
    reach = np.ptp(loop.u) / 2
    scale, unit = prefixed("m", reach)
    text = f"slip ±{reach * scale:.3g} {unit} at {loop.hz:g} Hz,\nload {loop.load:g} N; grey: the other laws"
    note = pair[0].text(0.0, 0.5, text, transform=pair[0].transAxes, va="center", fontsize=SMALL, color=INK)
    note.set_in_layout(False)
    for ax in pair:
        ax.set_axis_off()


@dataclass(frozen=True)
class _Scales:
    """Factors of slip, slip velocity and force, and the labels of their axes."""

    factors: tuple[float, float, float]
    labels: tuple[str, str]
    label: str

    def over(self, loop: "FrictionLoop") -> tuple[Array, Array]:
        """Slip and slip velocity, closed."""
        return closed(loop.u) * self.factors[0], closed(loop.v) * self.factors[1]

    def force(self, loop: "FrictionLoop") -> Array:
        """Force, closed."""
        return closed(loop.T) * self.factors[2]


def _scales(loops: Sequence["FrictionLoop"]) -> _Scales:
    (slip, m), (velocity, speed), (force, N) = (
        prefixed(unit, *(getattr(loop, name) for loop in loops))
        for unit, name in (("m", "u"), ("m/s", "v"), ("N", "T"))
    )
    return _Scales((slip, velocity, force), (f"Slip [{m}]", f"Velocity [{speed}]"), f"Friction force [{N}]")
