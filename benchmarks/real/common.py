"""What the sets have in common: where they are, how they are read, what each of them yields."""

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import RenderableType
from rich.table import Table

from hbm.figures.style import INK, SMALL

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
"""Beside the repository; nothing of it is copied into it."""


@dataclass(frozen=True, eq=False)
class Finding:
    """What one set shows."""

    name: str
    table: RenderableType
    figure: Figure
    conclusion: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Sweep:
    """Fundamentals of one record over frequency, amplitudes c of Re c exp(i Omega t), std of each of cos and sin."""

    name: str
    level: float
    hz: np.ndarray
    drive: np.ndarray
    drive_std: np.ndarray
    response: np.ndarray
    response_std: np.ndarray


def read_rows(path: Path) -> list[dict[str, str]]:
    """Rows of a table, by column."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def read_sweeps(path: Path, drive: str, response: str) -> list[Sweep]:
    """Records of a file whose rows are fundamentals at many frequencies; an empty std counts as exact."""
    rows = read_rows(path)
    names = list(dict.fromkeys(row["record"] for row in rows))
    return [_sweep(name, [row for row in rows if row["record"] == name], drive, response) for name in names]


def _sweep(name: str, rows: list[dict[str, str]], drive: str, response: str) -> Sweep:
    def of(channel: str) -> tuple[np.ndarray, np.ndarray]:
        mine = sorted((row for row in rows if row["channel"] == channel), key=lambda row: float(row["frequency_hz"]))
        amplitude = np.array([complex(float(row["cos"]), -float(row["sin"])) for row in mine])
        return amplitude, np.array([float(row["std"] or 0.0) for row in mine])

    hz = np.array(sorted({float(row["frequency_hz"]) for row in rows}))
    return Sweep(name, float(rows[0]["level"]), hz, *of(drive), *of(response))


def write_history(path: Path, time: np.ndarray, channels: dict[str, np.ndarray]) -> Path:
    """Write a time history as `hbm spectra` reads it."""
    table = np.column_stack([time, *channels.values()])
    np.savetxt(path, table, delimiter=",", header=",".join(["time_s", *channels]), comments="", fmt="%.12g")
    return path


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    """Make a table of words in the first column and numbers in the others."""
    made = Table(title=title, title_justify="left", title_style="bold")
    for i, column in enumerate(columns):
        made.add_column(column, justify="right" if i else "left")
    for row in rows:
        made.add_row(*row)
    return made


def with_std(value: float, std: float, scale: float = 1.0) -> str:
    """Value +/- standard deviation, to two digits of the latter."""
    if not np.isfinite(std) or std == 0.0:
        return f"{value * scale:.5g}"
    digits = max(0, 1 - int(np.floor(np.log10(abs(std * scale)))))
    return f"{value * scale:.{digits}f} ± {std * scale:.{digits}f}"


def legend_above(figure: Figure, ax: Axes, columns: int = 5) -> None:
    """One legend for all panels, in the order of drawing."""
    handles, labels = ax.get_legend_handles_labels()
    figure.legend(
        handles,
        labels,
        loc="outside upper center",
        ncols=columns,
        frameon=False,
        fontsize=SMALL,
        labelcolor=INK,
        columnspacing=1.2,
        handletextpad=0.5,
    )
