"""What a trace may cost, and how a curve that leads nowhere is known: it ends there, says why, and is kept."""

import math
import time
from collections import deque
from dataclasses import dataclass, field, replace

import numpy as np

from continuation import Branch, Point

FOLDS = 200
"""Folds within :data:`TURNING` of the sweep make a curve one that turns in place; ordinary ones have a few in all."""

TURNING = 0.1

CRAWL = 800
"""Points that together advance less than :data:`CREEPING` of the sweep, at about the same size of motion."""

CREEPING = 1e-3

ALIKE = 1.5
"""Ratio of the largest motion to the smallest; on a sharp resonance it is larger, however narrow that is."""

ADVICE = "try another range, fewer harmonics, a smoother law (a larger stribeck_velocity or critical_slip)"


@dataclass(frozen=True)
class Budget:
    """Most that the trace of one curve may take.

    Attributes
    ----------
    points : int
        Points of the curve.
    seconds : float
        Time, by the clock; the curve then depends on the machine, which the points and the folds do not.
    """

    points: int = 5000
    seconds: float = 300.0


@dataclass(eq=False)
class Watch:
    """What a trace has spent of its budget.

    Parameters
    ----------
    budget : Budget
    sweep : float
        Length of the sweep in the parameter, > 0.

    Attributes
    ----------
    count : int
        Points so far.
    ended : str
        Why the trace was ended, or nothing.
    """

    budget: Budget
    sweep: float
    count: int = 0
    ended: str = ""
    began: float = field(default_factory=time.monotonic)
    folds: deque[float] = field(default_factory=lambda: deque(maxlen=FOLDS))
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
        if len(self.folds) == FOLDS and _width(self.folds) < TURNING * self.sweep:
            return f"the curve turns in place: {FOLDS} folds within {_share(self.folds, self.sweep)} of the sweep"
        if len(self.last) == CRAWL and _width(self.last) < CREEPING * self.sweep and self._alike:
            return f"the curve creeps: the last {CRAWL} points cover {_share(self.last, self.sweep)} of the sweep"
        if self.count >= self.budget.points:
            return f"{self.budget.points} points are its budget"
        seconds = time.monotonic() - self.began
        return f"{self.budget.seconds:g} s are its budget" if seconds > self.budget.seconds else ""

    @property
    def _alike(self) -> bool:
        return max(self.sizes) <= ALIKE * min(self.sizes)


def worded(branch: Branch, value: float, parameter: str, ended: str) -> Branch:
    """A branch that its budget ended, with where and why in words."""
    unit = "Hz" if parameter == "frequency" else "N"
    counts = f"point {len(branch.points)}, {len(branch.folds)} folds, {len(branch.corners)} corners"
    return replace(branch, message=f"stopped at {value:.6g} {unit} ({counts}): {ended}; {ADVICE}")


def _width(values: deque[float]) -> float:
    return max(values) - min(values) if values else math.inf


def _share(values: deque[float], sweep: float) -> str:
    return f"{_width(values) / sweep:.2g}"
