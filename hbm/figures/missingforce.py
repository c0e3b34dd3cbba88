"""Figure of the force that a model lacks: where it may act, its harmonics, and how it grows."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from hbm.figures.diagnosis import BAND, COLORS, MOST_PLACES
from hbm.figures.scales import logarithmic
from hbm.figures.style import FAINT, INK, SMALL, WIDTH, AxesArray, as_written, dressed, graded, legend_on_top, panels
from hbm.figures.units import prefixed
from hbm.measurement.groups import levels

if TYPE_CHECKING:
    from hbm.diagnosis.discrepancy import Discrepancy, Known
    from hbm.diagnosis.missingforce import MissingForce


CLOSE: dict[str, Any] = {"columnspacing": 0.9, "handlelength": 1.0, "handletextpad": 0.5, "borderaxespad": 0.0}
"""Of a legend above a panel that is half as wide as the page."""


def plot_missing_force(d: "Discrepancy", axes: AxesArray | None = None) -> AxesArray:
    """Draw the misfit left with an unknown force at each place; of the best place harmonics, phase and growth.

    Parameters
    ----------
    d : Discrepancy
    axes : array of three Axes, optional

    Returns
    -------
    (3,) array of Axes
    """
    shown = d.ranked[:MOST_PLACES]
    found = panels(_wide_above_two(len(shown) + d.own) if axes is None else axes, 3, 1, 0.0).ravel()
    joints = [(d.known.at, d.known)] if d.own and d.known is not None else []
    _draw_places(found[0], [*joints, *((p.place.name, p) for p in shown)], len(joints), d.chi2 / d.points)
    _draw_harmonics(found[1], d.best)
    _draw_growth(found[2], d)
    return found


def _wide_above_two(places: int) -> AxesArray:
    """Panels of a new figure: one for so many places, and two below it."""
    import matplotlib.pyplot as plt

    height = 0.3 + 0.21 * places  # of the panel without its labels; below, with them
    figure = plt.figure(figsize=(WIDTH, height + 3.0), layout="constrained")
    grid = figure.add_gridspec(2, 1, height_ratios=[height, 2.45])
    below = grid[1].subgridspec(1, 2)
    return np.array([figure.add_subplot(place) for place in (grid[0], below[0], below[1])])


def _draw_places(ax: Axes, rows: Sequence[tuple[str, "MissingForce | Known"]], best: int, before: float) -> None:
    """Bars of what forces leave, by name; of the best place harmonics and growth are drawn beside."""
    names, places = zip(*rows, strict=True)
    y, left = np.arange(len(places)), np.array([p.left for p in places])
    low = 0.7 * min(1.0, float(left.min()))
    bars = ax.barh(y, left - low, left=low, height=0.62, color="0.78")
    bars[best].set_color(COLORS["extended"])
    plain = {"facecolor": "white", "edgecolor": "none", "pad": 0.8}  # grey lines end beside the numbers
    ax.bar_label(bars, _numbers(places), padding=3, fontsize=SMALL, color=INK, bbox=plain)
    logarithmic(ax.xaxis)
    top = max(before, float(left.max()))
    ax.set_xlim(low, top * (top / low) ** 0.4)  # room for the numbers
    for value in (1.0, before):
        ax.axvline(value, color=FAINT, linewidth=0.9, zorder=0)
    ax.set_yticks(y, [as_written(name) for name in names])
    ax.invert_yaxis()
    dressed(ax, "Misfit left [noise variances]; grey lines: noise alone, no force at all", "")
    ax.tick_params(axis="y", length=0)


def _numbers(places: Sequence["MissingForce | Known"]) -> list[str]:
    """What each leaves and, unless that is the same of all, the share that it explains."""
    left, explained = [f"{p.left:.3g}" for p in places], [f"{100 * p.share:.3g}" for p in places]
    if len(set(explained)) == 1:
        return left
    return [f"{rest}  (explains {share} %)" for rest, share in zip(left, explained, strict=True)]


def _draw_harmonics(ax: Axes, f: "MissingForce") -> None:
    k = np.arange(1, len(f.elastic) + 1)
    seen = _seen(f)
    floor = np.sqrt(np.nanmean(f.std[:, seen - 1] ** 2, axis=0))
    scale, unit = prefixed(f.place.unit, f.elastic, f.dissipative, floor)
    elastic, dissipative, floor = scale * f.elastic, scale * f.dissipative, scale * floor
    ax.bar(k - 0.19, elastic, width=0.36, color=COLORS["extended"], label="in phase")
    ax.bar(k + 0.19, dissipative, width=0.36, color=COLORS["calibrated"], label="in quadrature")
    ax.plot(seen, floor, "_", color="0.3", markersize=11, label="noise")
    logarithmic(ax.yaxis)
    top = max(float(np.nanmax([elastic, dissipative])), float(np.nanmax(floor)))
    ax.set_ylim(bottom=max(0.3 * float(np.nanmin(floor)), 1e-4 * top), top=2 * top)
    ax.set_xticks(k)
    ax.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.02), ncols=3, frameon=False, fontsize=SMALL, labelcolor=INK, **CLOSE
    )
    dressed(ax, "Harmonic", f"Missing {f.place.kind}, rms [{unit}]")


def _seen(f: "MissingForce") -> npt.NDArray[np.int64]:
    """Harmonics of which a sensor sees something in some record."""
    return np.flatnonzero(np.isfinite(f.std).any(axis=0)) + 1


def _draw_growth(ax: Axes, d: "Discrepancy") -> None:
    f = d.best
    k = int((f.harmonics or _seen(f))[0])
    size, std = np.abs(f.force[:, k - 1]), f.std[:, k - 1]
    amplitude = np.linalg.norm(f.seen, axis=1)
    (scale, unit), (scale_of_other, unit_of_other) = prefixed(f.place.unit, size), prefixed(f.place.against, amplitude)
    size, std, amplitude = scale * size, scale * std, scale_of_other * amplitude
    level_of = levels(d.level)
    clear = size > 3 * np.sqrt(2) * std
    found = np.unique(level_of).tolist()
    colors = dict(zip(found, graded(found), strict=True))
    for level, color in colors.items():
        for shown, face in ((clear, color), (~clear, "white")):
            i = (level_of == level) & shown
            ax.errorbar(
                amplitude[i],
                size[i],
                yerr=BAND * std[i],
                fmt="o",
                color=color,
                markersize=3.2,
                elinewidth=0.8,
                markerfacecolor=face,
            )
    power, _ = f.growth
    if power is not None and clear.any():
        x = np.array([amplitude[clear].min(), amplitude[clear].max()])
        middle = np.exp(np.mean(np.log(size[clear]))), np.exp(np.mean(np.log(amplitude[clear])))
        ax.plot(x, middle[0] * (x / middle[1]) ** power.value, color=INK, linewidth=0.9)
        ax.text(
            0.03, 0.97, f"power {power}".replace("+-", "±"), transform=ax.transAxes, va="top", fontsize=SMALL, color=INK
        )
    for axis in (ax.xaxis, ax.yaxis):
        logarithmic(axis)
    ax.set_ylim(0.3 * float(np.nanmin(size[clear])) if clear.any() else None, 4.0 * float(np.nanmax(size)))
    against = {"force": "Motion there", "motion": "Load there", "reading": "Reading"}[f.place.kind]
    dressed(ax, f"{against} [{unit_of_other}]", f"Harmonic {k} [{unit}]")
    dot: dict[str, Any] = {"linestyle": "", "marker": "o", "markersize": 3.5}
    legend_on_top(ax, [Line2D([], [], color=c, label=f"{level:.3g} N", **dot) for level, c in colors.items()])
