"""A curve that costs too much, or leads nowhere, ends with the reason, and what was found of it is kept."""

import math
from pathlib import Path

import numpy as np
import pytest

from continuation import End, Point
from hbm import load_rig
from hbm.response.budget import CRAWL, FOLDS, Budget, Watch
from hbm.response.trace import trace_frequency

PAPER = Path(__file__).parents[2] / "examples" / "paper_beam.toml"


def point(lam: float, *, fold: bool = False, size: float = 1.0) -> Point:
    return Point(np.array([size]), lam, np.zeros(1), 1.0, 0.0, 0.1, 3, 0.0, fold=fold)


def first_end(points: list[Point], budget: Budget) -> tuple[int, str]:
    """Number of the point that ends a trace over a sweep of length 1, and why; 0 where none does."""
    watch = Watch(budget, 1.0)
    for number, p in enumerate(points, start=1):
        if said := watch.spent(p):
            return number, said
    return 0, ""


def test_the_budget_of_points_ends_a_curve_and_keeps_it() -> None:
    curve = trace_frequency(load_rig(PAPER), (45.0, 55.0), harmonics=1, samples=32, budget=Budget(points=7))
    assert (len(curve.branch.points), curve.complete, curve.branch.end) == (7, False, End.STOPPED_BY_CALLER)
    assert curve.branch.message.startswith(
        f"stopped at {curve.branch.lam[-1] / curve.branch.lam[0] * 45:.6g} Hz (point 7"
    )
    assert "7 points are its budget; try" in curve.branch.message


def test_the_budget_of_seconds_ends_a_curve() -> None:
    curve = trace_frequency(load_rig(PAPER), (45.0, 55.0), harmonics=1, samples=32, budget=Budget(seconds=1e-9))
    assert "1e-09 s are its budget" in curve.branch.message
    assert not curve.complete


def test_hundreds_of_folds_in_a_tenth_of_the_sweep_turn_in_place() -> None:
    winding = [point(0.5 + 0.04 * math.sin(i), fold=True) for i in range(3 * FOLDS)]
    number, said = first_end(winding, Budget(points=10**6))
    assert number == FOLDS
    assert said.startswith(f"the curve turns in place: {FOLDS} folds within 0.08 of the sweep")


def test_as_many_folds_over_the_whole_sweep_do_not() -> None:
    spread = [point(i / (3 * FOLDS), fold=i % 3 == 0) for i in range(3 * FOLDS)]
    assert first_end(spread, Budget(points=10**6)) == (0, "")


@pytest.mark.parametrize(("advance", "ended_at"), [(1e-6, CRAWL), (1e-5, 0)])
def test_a_curve_that_hardly_advances_creeps(advance: float, ended_at: int) -> None:
    number, said = first_end([point(advance * i) for i in range(2 * CRAWL)], Budget(points=10**6))
    assert number == ended_at
    assert said.startswith("the curve creeps") is bool(ended_at)


def test_a_resonance_however_sharp_does_not_creep() -> None:
    sharp = [point(1e-7 * i, size=1.0 / (1e-4 + abs(i - CRAWL) / CRAWL)) for i in range(2 * CRAWL)]
    assert first_end(sharp, Budget(points=10**6)) == (0, "")
