"""Progress of long work on a terminal; silent anywhere else."""

import sys
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Column

BAR = 24
"""Width of the bar; words beside it are cut where there is no room."""


class _Shown:
    """A bar that is there while the work lasts."""

    def __init__(self) -> None:
        cut = Column(ratio=1, no_wrap=True, overflow="ellipsis")
        self.bar = Progress(
            SpinnerColumn(),
            BarColumn(BAR, table_column=Column(width=BAR)),
            TimeElapsedColumn(table_column=Column(width=8)),
            TextColumn("{task.description} {task.fields[now]}", markup=False, table_column=cut),
            expand=True,
            console=Console(stderr=True),
            transient=True,
            disable=not sys.stderr.isatty(),
        )

    def __enter__(self) -> Self:
        self.bar.start()
        return self

    def __exit__(self, *failure: object) -> None:
        self.bar.stop()

    def doing(self) -> str:
        """What is being done, in words."""
        task = self.bar.tasks[0]
        return f"at {task.description} {task.fields['now']}".rstrip()


class Sweep(_Shown):
    """A bar from a first to a last value, with the present value and the points found.

    Parameters
    ----------
    title : str
    begin, end : float
        First and last value.
    unit : str
    """

    def __init__(self, title: str, begin: float, end: float, unit: str = "Hz") -> None:
        self.title, self.begin, self.end, self.unit = title, begin, end, unit
        super().__init__()
        self.task = self.bar.add_task(f"{title}: preparing", total=None, now="")

    def point(self, value: float, number: int) -> None:
        """Show a point found at a value."""
        done = (value - self.begin) / (self.end - self.begin)
        doing = "tracing" if done < 1.0 - 1e-9 else "measuring the error"
        self._show(doing, done, f"{value:.3f} {self.unit}, {number} points")

    def time(self, value: float) -> None:
        """Show the time reached."""
        self._show("marching", (value - self.begin) / (self.end - self.begin), f"{value:.3f} {self.unit}")

    def _show(self, doing: str, done: float, now: str) -> None:
        self.bar.update(self.task, description=f"{self.title}: {doing}", total=1.0, completed=done, now=now)


class Work(_Shown):
    """A bar of work of known extent, with what is being done in words."""

    def __init__(self) -> None:
        super().__init__()
        self.task = self.bar.add_task("preparing", total=1.0, now="")

    def show(self, doing: str, done: float) -> None:
        """Show what is being done, and the fraction of the work done; a search that begins anew does not go back."""
        furthest = max(done, self.bar.tasks[self.task].completed)
        self.bar.update(self.task, description=doing, completed=furthest)
