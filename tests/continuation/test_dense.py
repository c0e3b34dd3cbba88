"""The curve between its points: as close to the true one as was asked for, with as few points as that takes."""

import numpy as np
import pytest
from curves import Array, scalar

from continuation import Branch, DenseProblem, Settings, continue_branch
from continuation.segment import Segment

WIDTH = 0.05


def resonance(lam: Array) -> Array:
    """x = 1 / (1 + (lam / WIDTH)^2), a peak of height 1."""
    return np.asarray(1.0 / (1.0 + (lam / WIDTH) ** 2))


def traced(problem: DenseProblem, x0: float, **settings: float) -> Branch:
    branch = continue_branch(problem, np.array([x0]), -1.0, Settings(lam_end=1.0, max_angle=2.0, **settings))
    assert branch.complete
    return branch


def peak(**settings: float) -> Branch:
    problem = scalar(
        lambda x, lam: x * (1.0 + (lam / WIDTH) ** 2) - 1.0,
        lambda x, lam: 1.0 + (lam / WIDTH) ** 2,
        lambda x, lam: 2.0 * x * lam / WIDTH**2,
    )
    return traced(problem, float(resonance(np.array(-1.0))), relative_step=1.0, **settings)


def off(branch: Branch) -> float:
    """Largest distance of what is drawn to the resonance, as a fraction of x there."""
    drawn = branch.dense(1e-5)
    true = resonance(drawn.lam)
    slope = -2.0 * drawn.lam / WIDTH**2 * true**2
    return float(np.max(np.abs(drawn.x[:, 0] - true) / np.hypot(1.0, slope) / true))


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4])
def test_the_curve_between_points_is_as_close_as_asked_for(tolerance: float) -> None:
    """The error of a cubic is largest about its middle, where it is judged; a quarter more is left to the rest."""
    assert off(peak(curve_tolerance=tolerance)) < 1.25 * tolerance


def test_without_a_tolerance_it_is_not() -> None:
    assert off(peak()) > 1e-2


def test_a_hundredth_of_the_error_takes_about_three_times_the_points() -> None:
    """The cubic errs by the fourth power of the step: 100^(1/4) = 3.2."""
    few, many = (len(peak(curve_tolerance=tolerance).points) for tolerance in (1e-3, 1e-5))
    assert 2.5 * few < many < 4.0 * few


def test_points_stand_next_to_a_corner() -> None:
    """x = |lam| + lam^2: on both sides of the corner the cubic is exact to the tolerance."""
    kinked = scalar(
        lambda x, lam: x - np.abs(lam) - lam**2, lambda x, lam: 1.0 + 0.0 * x, lambda x, lam: -np.sign(lam) - 2.0 * lam
    )
    branch = traced(kinked, 2.0, curve_tolerance=1e-3)
    (behind,) = branch.corners
    before = branch.points[branch.points.index(behind) - 1]
    assert before.lam <= 0.0 <= behind.lam
    assert behind.lam - before.lam < 1e-2
    drawn = branch.dense()
    assert np.abs(drawn.x[:, 0] - np.abs(drawn.lam) - drawn.lam**2).max() < 3e-3  # of x = 2 at the ends


def test_added_points_lie_on_the_cubics_and_own_ones_stay() -> None:
    branch = peak(curve_tolerance=1e-3)
    drawn = branch.dense()
    assert [p for p in drawn.points if np.isfinite(p.residual_norm)] == list(branch.points)
    assert np.all(np.diff([p.arclength for p in drawn.points]) > 0.0)
    assert drawn.dense(1e-2).points == drawn.points  # nothing to add


def test_a_fold_is_flagged_in_the_half_it_lies_in() -> None:
    """lam = x^2 - 1/4 turns at x = 0."""
    turning = scalar(lambda x, lam: lam - x**2 + 0.25, lambda x, lam: -2.0 * x, lambda x, lam: 1.0 + 0.0 * x)
    settings = Settings(lam_end=1.0, lam_min=-1.0, lam_max=2.0, step=0.5, step_max=0.5)
    branch = continue_branch(turning, np.array([-0.8]), 0.39, Settings(lam_end=-0.3, lam_min=-1.0, lam_max=2.0))
    (behind,) = branch.folds
    before = branch.points[branch.points.index(behind) - 1]
    segment = Segment(turning, before, behind, settings)
    share = -before.x[0] / (behind.x[0] - before.x[0])
    for u, first in ((0.5 * share, False), (0.5 * (1.0 + share), True)):
        point, end = segment.parted(u)
        assert (point.fold, end.fold) == (first, not first)
