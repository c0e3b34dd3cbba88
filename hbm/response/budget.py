"""What a trace may cost, and how a curve that leads nowhere is known: it ends there, says why, and is kept."""

import math
import re
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from continuation import Branch, End, Point, Problem, Settings, continue_branch
from hbm.fourier import Array

FOLDS = 200
"""Folds within :data:`TURNING` of the sweep make a curve one that turns in place; ordinary ones have a few in all."""

TURNING = 0.1

CRAWL = 800
"""Points that together advance less than :data:`CREEPING` of the sweep, at about the same size of motion."""

CREEPING = 1e-3

ALIKE = 1.5
"""Ratio of the largest motion to the smallest; on a sharp resonance it is larger, however narrow that is."""

ADVICE = "try another range, fewer harmonics, a smoother law (a larger stribeck_velocity or critical_slip)"

OnPoint = Callable[[float, int], None]
"""Called with the value that a curve is traced along and the number of every point found."""

Until = Callable[[Point], bool]
"""Whether a curve has come to where it is of use, short of the end of its sweep."""


@dataclass(frozen=True)
class Budget:
    """Most that the trace of one curve may take.

    Attributes
    ----------
    points : int
        Points of the curve.
    seconds : float
        Time, by the clock; the curve then depends on the machine, which the points and the folds do not.
    spent : float
        Seconds of these that went before the trace.
    """

    points: int = 5000
    seconds: float = 300.0
    spent: float = 0.0

    @property
    def left(self) -> float:
        """Seconds for the trace."""
        return self.seconds - self.spent

    def after(self, seconds: float) -> "Budget":
        """What is left after more seconds; half of all are kept for the trace."""
        return replace(self, spent=min(self.spent + seconds, 0.5 * self.seconds))


@dataclass(frozen=True)
class Along:
    """What a curve is traced along.

    Attributes
    ----------
    value : callable
        From the continuation parameter to what a user knows it by.
    unit : str
        Unit of that.
    folds : int
        So many folds within :data:`TURNING` of the sweep are too many.
    advice : str
        What to try where a trace was ended.
    """

    value: Callable[[float], float]
    unit: str
    folds: int = FOLDS
    advice: str = ADVICE

    def told(self, message: str) -> str:
        """What a branch says of where it ended, in words that a user knows."""
        return in_units(message, "lam", self.value, self.unit)


@dataclass(eq=False)
class Watch:
    """What a trace has spent of its budget.

    Parameters
    ----------
    budget : Budget
    sweep : float
        Length of the sweep in the parameter, > 0.
    most_folds : int
        As of :class:`Along`.

    Attributes
    ----------
    count : int
        Points so far.
    ended : str
        Why the trace was ended, or nothing.
    """

    budget: Budget
    sweep: float
    most_folds: int = FOLDS
    count: int = 0
    ended: str = ""
    began: float = field(default_factory=time.monotonic)
    folds: deque[float] = field(default_factory=deque)
    last: deque[float] = field(default_factory=lambda: deque(maxlen=CRAWL))
    sizes: deque[float] = field(default_factory=lambda: deque(maxlen=CRAWL))

    def spent(self, point: Point) -> str:
        """Why the trace ends with this point, or nothing."""
        self.ended = self._reason(point)
        return self.ended

    def _reason(self, point: Point) -> str:
        self.count += 1
        self.last.append(point.lam)
        self.sizes.append(float(np.linalg.norm(point.x)))
        if point.fold:
            self.folds.append(point.lam)
        if len(self.folds) > self.most_folds:
            self.folds.popleft()
        if len(self.folds) == self.most_folds and _width(self.folds) < TURNING * self.sweep:
            within = _share(self.folds, self.sweep)
            return f"the curve turns in place: {self.most_folds} folds within {within} of the sweep"
        if len(self.last) == CRAWL and _width(self.last) < CREEPING * self.sweep and self._alike:
            return f"the curve creeps: the last {CRAWL} points cover {_share(self.last, self.sweep)} of the sweep"
        if self.count >= self.budget.points:
            return f"{self.budget.points} {'point is' if self.budget.points == 1 else 'points are'} its budget"
        seconds = time.monotonic() - self.began
        are = "is" if self.budget.seconds == 1.0 else "are"
        return f"{self.budget.seconds:g} s {are} its budget" if seconds > self.budget.left else ""

    @property
    def _alike(self) -> bool:
        return max(self.sizes) <= ALIKE * min(self.sizes)


def continue_within(
    budget: Budget | None,
    along: Along,
    problem: Problem,
    x: Array,
    lam: float,
    settings: Settings,
    on_point: OnPoint | None = None,
    until: Until | None = None,
) -> Branch:
    """Trace a branch to the end of its sweep within a budget; where it ends elsewhere, it says in words where and why.

    Parameters
    ----------
    budget : Budget or None
        :class:`Budget` with its defaults where None.
    along : Along
    problem, x, lam, settings
        As of :func:`continuation.continue_branch`.
    on_point : callable, optional
        Progress.
    until : callable, optional
        The branch ends, complete, with the first point of which this is true.
    """
    watch = Watch(budget or Budget(), abs(settings.lam_end - lam), along.folds)

    def report(point: Point) -> bool:
        ended = watch.spent(point)
        if on_point is not None:
            on_point(along.value(point.lam), watch.count)
        there.extend([point] if until is not None and until(point) else [])
        return bool(ended or there)

    there: list[Point] = []
    branch = continue_branch(problem, x, lam, settings, report)
    if there:
        where = f"{along.value(there[0].lam):.6g} {along.unit}".rstrip()
        return replace(branch, end=End.REACHED_END, message=f"reached what was asked for at {where}")
    if branch.closed:
        return replace(branch, end=End.MISSED_END, message=_short_of_the_end(branch, along))
    if not watch.ended:
        return replace(branch, message=along.told(branch.message))
    where = f"stopped at {along.value(branch.points[-1].lam):.6g} {along.unit}".rstrip()
    counts = f"point {len(branch.points)}, {len(branch.folds)} folds, {len(branch.corners)} corners"
    return replace(branch, message=f"{where} ({counts}): {watch.ended}; {along.advice}")


def in_units(message: str, parameter: str, value: Callable[[float], float], unit: str) -> str:
    """A line of :mod:`continuation` with values of its parameter as a user knows them."""

    def told(found: re.Match[str]) -> str:
        return f"at {value(float(found[1])):.6g}" + ("" if unit in ("", "1") else f" {unit}")

    inside = message.replace(f"reached {parameter}_end", "reached its end").replace(f" of {parameter} ", " ")
    return re.sub(rf"\bat {parameter} = ([-+.\deE]+)", told, inside)


def _short_of_the_end(branch: Branch, along: Along) -> str:
    """What a closed curve spans, and what it does not come to."""
    low, high, end = (
        f"{along.value(lam):.6g}" for lam in (branch.lam.min(), branch.lam.max(), branch.settings.lam_end)
    )
    return (
        f"the curve is closed, back at its start: {f'{low} to {high} {along.unit}'.rstrip()}, and does not come to "
        f"{f'{end} {along.unit}'.rstrip()}, where another answers; start there or elsewhere, or with more harmonics"
    )


def _width(values: deque[float]) -> float:
    return max(values) - min(values) if values else math.inf


def _share(values: deque[float], sweep: float) -> str:
    return f"{_width(values) / sweep:.2g}"
