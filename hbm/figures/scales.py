"""Scales of axes: logarithmic ones with few numbers beside them, all of one style, windows, phases."""

from collections.abc import Iterator, Sequence
from typing import cast

import numpy as np
from matplotlib.axis import Axis
from matplotlib.ticker import Formatter, LogLocator, MaxNLocator

from hbm.figures.style import SMALL

FEWEST, MOST = 2, 6
"""Numbers beside an axis."""

ROOM = {"x": 4.0, "y": 1.4}
"""Distance between numbers beside an axis, in their size: numbers are wider than high."""

PLAIN = 1e-3, 1e4
"""Numbers that are written out, if all beside an axis are within."""

FINE = 5
"""Powers of ten between which there is room for small marks."""

NARROWEST = 1e-3
"""Share of a frequency or damping ratio that a window about it spans at least."""

PHASE_STEPS = 90, 45, 30, 15, 5
"""Degrees between the numbers of a phase."""


def wide_enough(axis: Axis) -> None:
    """Widen a window that is narrow beside the numbers in it, so that equal ones do not look apart."""
    _widen(axis, NARROWEST * float(np.mean(axis.get_view_interval())))


def _widen(axis: Axis, least: float) -> None:
    low, high = axis.get_view_interval()
    more = max(least - (high - low), 0.0) / 2
    axis.axes.set(**{f"{_direction(axis)}lim": (low - more, high + more)})


def phases(axis: Axis) -> None:
    """Two numbers or more beside an axis of phases, at multiples of 90 degrees, or of less where it spans less."""
    _widen(axis, 2 * PHASE_STEPS[-1])
    low, high = axis.get_view_interval()
    multiples = (step * np.arange(np.ceil(low / step), np.floor(high / step) + 1) for step in PHASE_STEPS)
    axis.set_ticks(next(found for found in multiples if len(found) >= FEWEST))


def logarithmic(axis: Axis) -> None:
    """Make an axis logarithmic, with few numbers beside it."""
    axis.axes.set(**{f"{_direction(axis)}scale": "log"})
    few_numbers(axis)


def _direction(axis: Axis) -> str:
    return "x" if axis is axis.axes.xaxis else "y"


def few_numbers(axis: Axis) -> None:
    """Two to six numbers of one style beside an axis that is logarithmic, and marks between them."""
    axis.set_major_locator(FewNumbers())
    axis.set_major_formatter(OneStyle())
    axis.set_minor_locator(SmallMarks())
    axis.set_minor_formatter("")


def log_numbers(low: float, high: float, apart: float) -> list[float]:
    """Numbers for a logarithmic axis: steps 1, 2, 5 where they have room, powers of ten, or less than a power.

    Parameters
    ----------
    low, high : float
        Ends of the axis.
    apart : float
        Least distance between numbers, as a share of the axis.

    Returns
    -------
    list of float

    >>> log_numbers(2.0, 90.0, 0.1), log_numbers(2e-6, 0.5, 0.1), log_numbers(1.2, 4.1, 0.1)
    ([2.0, 5.0, 10.0, 20.0, 50.0], [1e-05, 0.0001, 0.001, 0.01, 0.1], [2.0, 3.0, 4.0])
    """
    for found in _choices(low, high):
        if FEWEST <= len(found) <= MOST and np.diff(np.log(found)).min() >= apart * (np.log(high) - np.log(low)):
            return found
    densest = max(_choices(low, high), key=len)
    return [densest[0], densest[-1]]


def _choices(low: float, high: float) -> Iterator[list[float]]:
    """Numbers between two, those that are tried first first."""
    yield _powers(low, high, (1, 2, 5))
    for every in range(1, int(np.log10(high) - np.log10(low)) + 1):
        yield _powers(low, high, (1,), every)
    for count in range(MOST - 1, 0, -1):
        even = MaxNLocator(count, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high)
        yield [float(v) for v in even if low <= v <= high]


def _powers(low: float, high: float, leading: Sequence[int], every: int = 1) -> list[float]:
    """Powers of ten between two numbers, every so many, times leading digits."""
    first, last = (int(np.floor(np.log10(v) / every)) for v in (low, high))
    found = [float(f"{digit}e{every * k}") for k in range(first, last + 1) for digit in leading]
    return [v for v in found if low <= v <= high]


class FewNumbers(LogLocator):
    """Where the numbers beside a logarithmic axis stand, for as much room as it has when it is drawn."""

    def tick_values(self, vmin: float, vmax: float) -> list[float]:
        """Numbers between two ends."""
        low, high = sorted((vmin, vmax))
        return log_numbers(low, high, _room(cast("Axis", self.axis)))


def _room(axis: Axis) -> float:
    """Distance that numbers beside an axis need, as a share of it."""
    direction, panel = _direction(axis), axis.axes.get_window_extent()
    pixels = panel.width if direction == "x" else panel.height
    return ROOM[direction] * (SMALL + 1) / 72 * axis.axes.figure.dpi / pixels


class SmallMarks(LogLocator):
    """Marks without a number on a logarithmic axis: at all digits, or at powers of ten where it has many."""

    def tick_values(self, vmin: float, vmax: float) -> list[float]:
        """Marks between two ends."""
        low, high = sorted((vmin, vmax))
        return _powers(low, high, range(1, 10) if high / low < 10.0**FINE else (1,))


class OneStyle(Formatter):
    """Numbers beside an axis, all written out or all in powers of ten."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Write one number."""
        return self.format_ticks([x])[0]

    def format_ticks(self, values: Sequence[float]) -> list[str]:
        """Write all numbers of an axis."""
        plain = all(PLAIN[0] <= v <= PLAIN[1] for v in values if v != 0.0)
        return [f"{v:g}" if plain or v == 0.0 else _in_powers(v) for v in values]


def _in_powers(value: float) -> str:
    r"""A number as a formula.

    >>> print(_in_powers(1e-6), _in_powers(2.5e7))
    $\mathdefault{10^{-6}}$ $\mathdefault{2.5\times10^{7}}$
    """
    digits, exponent = f"{value:e}".split("e")
    leading = "" if float(digits) == 1.0 else rf"{float(digits):g}\times"
    return rf"$\mathdefault{{{leading}10^{{{int(exponent)}}}}}$"
