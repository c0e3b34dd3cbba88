"""Figures of a score: who is taken for whom, and the right name first over the length of the residual."""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.score.ceiling import RHO, Allowed, Ceiling, at
from benchmarks.score.rates import RHO_BINS, confusion, in_bin, said_of, truth_of, wilson
from benchmarks.score.rules import GROUPS, Outcome, is_parameter
from hbm.figures.style import INK, SMALL, dressed

VERDICTS = ("consistent", "unexplained", "failed")
SHADE, EDGE, CEILING, EXACT = "#2a5783", "0.45", "#c4622d", "0.55"
TINY = 6.0
CELL, MARGIN = 0.185, 1.75  # inches


def short(name: str) -> str:
    """Of a wrong parameter the last part of its key."""
    return name.rpartition(".")[2].replace("_", " ") if is_parameter(name) else name.replace("-", " ")


def group_of(name: str) -> str:
    if is_parameter(name):
        return "parameters"
    return next((group for group, names in GROUPS.items() if name.partition(",")[0] in names), "none")


def in_order(names: Sequence[str]) -> list[str]:
    """Causes of the catalogue in the order of its groups, then wrong parameters."""
    order = [name for names_of in GROUPS.values() for name in names_of]
    known = sorted(
        (n for n in names if group_of(n) in GROUPS), key=lambda n: (order.index(n.partition(",")[0]), len(n))
    )
    return known + sorted(n for n in names if is_parameter(n))


def confusion_figure(outcomes: Sequence[Outcome], title: str) -> Figure:
    """Truth by rows, what was said by columns, counts in the cells, shaded by their share of the row."""
    counts = confusion(outcomes)
    kinds = {truth_of(o): o.kind for o in outcomes}
    truths = in_order([t for t, kind in kinds.items() if kind == "cause-found"])
    outside = sorted(t for t, kind in kinds.items() if kind == "unexplained")
    nulls = [t for t, kind in kinds.items() if kind == "consistent"]
    rows = [*truths, *outside, *nulls]
    said = {said_of(o) for o in outcomes}
    columns = [*in_order(sorted((said | set(truths)) - set(VERDICTS))), *VERDICTS]
    columns = [c for c in columns if c != "failed" or "failed" in said]
    n = np.array([[counts[row, column] for column in columns] for row in rows])
    right = {row: row if kinds[row] == "cause-found" else kinds[row] for row in rows}
    size = (MARGIN + CELL * len(columns) + 0.35, MARGIN + CELL * len(rows) + 0.25)
    figure = Figure(figsize=size)
    ax = figure.add_axes((
        MARGIN / size[0], 0.3 / size[1], CELL * len(columns) / size[0], CELL * len(rows) / size[1],
    ))  # fmt: skip
    _cells(ax, n, [columns.index(right[row]) for row in rows])
    ax.set_xticks(range(len(columns)), [short(c) for c in columns], rotation=90, fontsize=TINY)
    ax.set_yticks(range(len(rows)), [f"{short(r)}  ({int(k)})" for r, k in zip(rows, n.sum(axis=1), strict=True)])
    ax.tick_params(length=0, labelsize=TINY, labelcolor=INK, pad=2)
    ax.xaxis.tick_top()
    _groups(ax, [_row_group(row, kinds[row]) for row in rows], [_column_group(c) for c in columns])
    figure.text(0.02, 0.995, title, fontsize=SMALL, color=INK, va="top", linespacing=1.4)
    return figure


def _row_group(name: str, kind: str) -> str:
    return {"unexplained": "outside", "consistent": "null"}.get(kind) or group_of(name)


def _column_group(name: str) -> str:
    return "verdict" if name in VERDICTS else group_of(name)


def _cells(ax: Axes, n: np.ndarray, right: Sequence[int]) -> None:
    share = n / np.maximum(n.sum(axis=1, keepdims=True), 1)
    shades = mpl.colors.LinearSegmentedColormap.from_list("shades", ["white", SHADE])
    ax.imshow(share, cmap=shades, vmin=0.0, vmax=1.0, aspect="auto")
    for i, j in zip(*np.nonzero(n), strict=True):
        ax.text(
            j, i, str(n[i, j]), ha="center", va="center", fontsize=TINY, color="white" if share[i, j] > 0.5 else INK
        )
    for i, j in enumerate(right):
        ax.add_patch(mpl.patches.Rectangle((j - 0.5, i - 0.5), 1, 1, fill=False, edgecolor=CEILING, linewidth=0.7))
    ax.set_xticks(np.arange(n.shape[1] + 1) - 0.5, minor=True)
    ax.set_yticks(np.arange(n.shape[0] + 1) - 0.5, minor=True)
    ax.grid(which="minor", color="0.92", linewidth=0.4)
    ax.tick_params(which="minor", length=0)
    ax.spines[:].set(linewidth=0.5, color=EDGE)


def _groups(ax: Axes, rows: Sequence[str], columns: Sequence[str]) -> None:
    """Lines between groups of rows and columns; the names of the rows' groups at the right."""
    for start in _starts(rows)[1:]:
        ax.axhline(start - 0.5, color=EDGE, linewidth=0.7)
    for start in _starts(columns)[1:]:
        ax.axvline(start - 0.5, color=EDGE, linewidth=0.7)
    starts = [*_starts(rows), len(rows)]
    for first, last in pairwise(starts):
        middle = (first + last - 1) / 2
        long = last - first > 3
        ax.text(
            len(columns) - 0.2, middle, rows[first], fontsize=TINY, color=INK, va="center", ha="left",
            rotation=90 if long else 0,
        )  # fmt: skip


def _starts(groups: Sequence[str]) -> list[int]:
    return [i for i, group in enumerate(groups) if i == 0 or groups[i - 1] != group]


def top1_figure(outcomes: Sequence[Outcome], best: Allowed, title: str) -> Figure:
    """Share of causes rightly named first, by rho, with what Fisher information allows the same causes."""
    causes = [o for o in outcomes if o.kind == "cause-found"]
    figure = Figure(figsize=(4.6, 3.2), layout="constrained")
    ax = dressed(
        figure.add_subplot(), "length $\\rho$ of the residual [standard deviations]", "right cause named first"
    )
    for ceilings, said, color, style in (
        (best.tolerances, "ceiling, tolerances of the rig file known", CEILING, "-"),
        (best.exact, "ceiling, rig file exact", EXACT, "--"),
    ):
        mixed = _mixed(causes, ceilings)
        if mixed is not None:
            ax.plot(RHO, mixed, style, color=color, linewidth=1.2, label=said, zorder=1)
    for low, high in RHO_BINS:
        _point(ax, in_bin(causes, low, high))
    ax.set(xscale="log", ylim=(-0.02, 1.04))
    ax.set_xlim(*_limits(causes))
    ax.set_title(title, fontsize=SMALL, color=INK, loc="left")
    for label in (ax.xaxis.label, ax.yaxis.label):
        label.set_fontsize(SMALL + 1)
    ax.legend(fontsize=SMALL - 1, frameon=False, loc="lower right", labelcolor=INK)
    return figure


def _limits(causes: Sequence[Outcome]) -> tuple[float, float]:
    rho = [o.rho for o in causes if o.rho > 0] or [20.0, 1000.0]
    return min(10.0, min(rho) / 1.5), max(5000.0, max(rho) * 1.5)


def _mixed(causes: Sequence[Outcome], ceilings: Mapping[str, Ceiling]) -> list[float] | None:
    known = [c for o in causes for c in [ceilings.get(o.answer["cause"])] if c is not None]
    return [float(np.mean([at(c, rho)[0] for c in known])) for rho in RHO] if known else None


def _point(ax: Axes, chosen: Sequence[Outcome]) -> None:
    if not chosen:
        return
    k, n = sum(o.right for o in chosen), len(chosen)
    low, high = wilson(k, n)
    rho = float(np.exp(np.mean(np.log([max(o.rho, 1e-9) for o in chosen]))))
    bars = [[k / n - low], [high - k / n]]
    first = not ax.containers
    ax.errorbar(
        rho, k / n, yerr=bars, fmt="o", color=SHADE, markersize=5, capsize=2.5, linewidth=1.1,
        label="measured, 95 % interval" if first else None, zorder=2,
    )  # fmt: skip
    ax.annotate(
        f"{k}/{n}", (rho, k / n), xytext=(5, -3), textcoords="offset points", fontsize=SMALL - 1, color=INK,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.8},
    )  # fmt: skip
