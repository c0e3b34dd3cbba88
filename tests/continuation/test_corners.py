"""Corners of any angle are passed with any step and reported once; smooth sharp bends are not corners."""

from typing import Any

import numpy as np
import pytest
from curves import bent_line, duffing, scalar

from continuation import Branch, DenseProblem, End, Predictor, Settings, continue_branch

STEPS = [0.3 * factor for factor in (1.0, 0.3, 0.2, 0.1, 0.01)]
ANGLES = [15, 40, 60, 85, 90, 95, 120, 150, 172]


def through_corner(size: int, degrees: float, step: float, turned: bool, seed: int) -> tuple[Branch, float]:
    """Branch over one corner, and the parameter there; `turned`: the parameter turns back at the corner."""
    rng = np.random.default_rng(seed)
    angle = np.radians(degrees)
    across = rng.standard_normal(size)
    across /= np.linalg.norm(across)
    first = np.pi / 2 - 0.6 * angle if turned else -0.5 * angle  # angle to the lam axis before the corner
    before, behind = (np.append(np.sin(a) * across, np.cos(a)) for a in (first, first + angle))
    corner = np.append(0.1 * rng.standard_normal(size), 0.05)
    problem = bent_line(before, behind, corner, rng)
    start = corner - 0.7 * before
    lam_end = 2.0 if turned else corner[-1] + 0.6 * behind[-1]
    settings = Settings(lam_end=lam_end, lam_min=start[-1], step=step, step_max=step, max_points=3000)
    return continue_branch(problem, start[:-1], start[-1], settings), corner[-1]


@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("size", [1, 20])
def test_corner_is_passed_and_reported_once(size: int, degrees: float, step: float) -> None:
    branch, lam = through_corner(size, degrees, step, turned=False, seed=size)
    assert branch.end is End.REACHED_END, branch.message
    assert [point.corner_lam for point in branch.corners] == pytest.approx([lam], abs=1e-7)
    assert not branch.folds and not branch.branch_points and not branch.jumps


@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("size", [1, 20])
def test_corner_where_the_parameter_turns_back(size: int, degrees: float, step: float) -> None:
    branch, lam = through_corner(size, degrees, step, turned=True, seed=size)
    assert branch.end is End.LEFT_INTERVAL, branch.message
    assert [point.corner_lam for point in branch.corners] == pytest.approx([lam], abs=1e-7)
    assert [point.fold_lam for point in branch.folds] == pytest.approx([lam], abs=1e-7)
    assert not branch.branch_points and not branch.jumps


def polygon(t: float, knots: Any, values: Any) -> tuple[Any, Any]:
    """Point and slope of a polygon t -> (x, lam)."""
    i = int(np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(knots) - 2))
    slope = (values[i + 1] - values[i]) / (knots[i + 1] - knots[i])
    return values[i] + (t - knots[i]) * slope, slope


@pytest.mark.parametrize("step", [0.3, 0.1, 0.03, 0.01])
def test_chain_of_corners_is_counted(step: float) -> None:
    """Unknowns (x, t) on a zigzag with five corners, each of more than 90 degrees, 0.5 or more apart."""
    knots = np.arange(7.0)
    values = np.array([[0.0, 0.0], [1.0, 0.5], [0.1, 0.7], [1.2, 1.0], [0.2, 1.4], [1.0, 1.5], [0.3, 2.0]])

    def residual(x: Any, lam: float) -> Any:
        return polygon(x[1], knots, values)[0] - np.array([x[0], lam])

    def jacobian(x: Any, lam: float) -> tuple[Any, Any]:
        slope = polygon(x[1], knots, values)[1]
        return np.array([[-1.0, slope[0]], [0.0, slope[1]]]), np.array([0.0, -1.0])

    settings = Settings(lam_end=1.95, step=step, step_max=step, max_points=3000, weights=np.array([1.0, 1e-6]))
    branch = continue_branch(DenseProblem(residual, jacobian), np.array([0.1, 0.1]), 0.05, settings)
    assert branch.end is End.REACHED_END, branch.message
    assert [point.corner_lam for point in branch.corners] == pytest.approx(list(values[1:6, 1]), abs=1e-6)


@pytest.mark.parametrize("predictor", list(Predictor))
@pytest.mark.parametrize("step", [0.5, 0.2, 0.05])
def test_curved_pieces_meet_in_one_corner(predictor: Predictor, step: float) -> None:
    """x = sin(lam) before lam = 1, and a parabola with slope -2 behind it."""

    def f(x: float, lam: float) -> float:
        s = lam - 1.0
        return x - np.sin(lam) if s < 0.0 else x - np.sin(1.0) + 2.0 * s - s**2

    def f_lam(x: float, lam: float) -> float:
        return -np.cos(lam) if lam < 1.0 else 2.0 - 2.0 * (lam - 1.0)

    problem = scalar(f, lambda x, lam: 1.0, f_lam)
    settings = Settings(lam_end=2.5, step=step, step_max=step, predictor=predictor)
    branch = continue_branch(problem, np.zeros(1), 0.0, settings)
    assert branch.complete
    assert [point.corner_lam for point in branch.corners] == pytest.approx([1.0], abs=1e-5)


@pytest.mark.parametrize("predictor", list(Predictor))
@pytest.mark.parametrize("rounding", [0.3, 0.1, 0.03, 0.01])
def test_sharp_smooth_bend_is_not_a_corner(predictor: Predictor, rounding: float) -> None:
    """x = 3 sqrt(lam^2 + rounding^2) turns by 143 degrees over a length of about `rounding` / 3."""

    def height(lam: float) -> float:
        return 3.0 * np.sqrt(lam**2 + rounding**2)

    bend = scalar(lambda x, lam: x - height(lam), lambda x, lam: 1.0, lambda x, lam: -9.0 * lam / height(lam))
    settings = Settings(lam_end=1.0, step=0.5, predictor=predictor)
    branch = continue_branch(bend, np.array([3.0]), -1.0, settings)
    assert branch.complete and not branch.corners and not branch.jumps
    assert np.min(branch.x) < 3.0 * rounding * 1.1  # the bend is resolved, not jumped over


@pytest.mark.parametrize("zeta", [0.02, 0.005, 0.002])
def test_duffing_peak_with_coarse_steps_is_not_a_corner(zeta: float) -> None:
    settings = Settings(lam_end=2.5, step=0.5, step_max=5.0)
    branch = continue_branch(duffing(zeta, 0.01, 10.0 * zeta), np.array([10.0 * zeta, 0.0]), 0.3, settings)
    assert branch.complete and not branch.corners and not branch.jumps
    amplitude = np.max(np.hypot(*branch.x.T))
    # the peak 5 / Omega lies between two points that turn by at most 0.5 rad: cos(0.25) of it is met at least
    assert 0.96 * 5.0 / 1.2 < amplitude <= 5.0


@pytest.mark.parametrize("predictor", list(Predictor))
def test_narrow_resonance_is_not_short_cut_at_its_foot(predictor: Predictor) -> None:
    """Linear resonance, a circle of diameter 10 in x over 0.002 in lam, with steps of a tenth of it: once around."""
    settings = Settings(lam_end=2.5, step=1.0, step_max=5.0, predictor=predictor)
    branch = continue_branch(duffing(0.001, 0.0, 0.02), np.array([0.02, 0.0]), 0.3, settings)
    assert branch.complete and not branch.folds and not branch.corners
    assert np.all(np.diff(branch.lam) > 0.0)
    assert 10.0 * np.pi < branch.points[-1].arclength < 10.0 * np.pi + 2.2
