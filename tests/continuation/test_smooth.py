"""Smooth curves whose folds, ends and lengths are known in closed form."""

import numpy as np
import pytest
from curves import Counted, circle, duffing, s_curve, scalar, spiral
from scipy.optimize import brentq

from continuation import DenseProblem, End, Point, Predictor, Settings, continue_branch, trace

predictors = pytest.mark.parametrize("predictor", list(Predictor))


@predictors
def test_s_curve_folds_at_their_closed_form(predictor: Predictor) -> None:
    branch = continue_branch(s_curve(), np.array([-1.5]), -2.0, Settings(lam_end=2.0, predictor=predictor))
    fold = 2.0 / (3.0 * np.sqrt(3.0))
    # cubic Hermite over steps that turn by at most 0.5 rad: error of order (0.5 / 2)^4 of the rise over one step
    assert [point.fold_lam for point in branch.folds] == pytest.approx([fold, -fold], abs=1e-3)
    assert branch.end is End.REACHED_END
    assert not branch.corners and not branch.branch_points and not branch.jumps
    assert np.max(np.abs(branch.x[:, 0] ** 3 - branch.x[:, 0] - branch.lam)) <= 1e-9


def test_fold_estimate_converges_at_least_with_third_order() -> None:
    fold, starts = 2.0 / (3.0 * np.sqrt(3.0)), np.linspace(-2.0, -1.9, 6)  # the fold's place within its step varies
    errors = []
    for step in (0.08, 0.02):
        settings = Settings(lam_end=2.0, step=step, step_max=step, tolerance=1e-12)
        branches = [continue_branch(s_curve(), np.array([-1.5]), lam0, settings) for lam0 in starts]
        errors.append(max(abs(abs(point.fold_lam or 0.0) - fold) for branch in branches for point in branch.folds))
    assert errors[1] < errors[0] / 4.0**3


@predictors
def test_helix_folds_twice_per_turn(predictor: Predictor) -> None:
    pitch = 0.3
    settings = Settings(lam_end=6.0, lam_min=-2.0, predictor=predictor)
    branch = continue_branch(spiral(pitch), np.zeros(2), 1.0, settings)
    inner = np.arcsin(pitch)
    turns = np.sort([k * np.pi + (-1) ** k * inner for k in range(1 + int(np.max(branch.x[:, 1]) / np.pi))])
    expected = np.cos(turns) + pitch * turns
    assert branch.complete and len(expected) >= 4
    assert [point.fold_lam for point in branch.folds] == pytest.approx(list(expected[: len(branch.folds)]), abs=1e-3)
    assert len(branch.folds) == np.count_nonzero(turns < branch.x[-1, 1])


def test_circle_leaves_through_the_start_after_one_fold() -> None:
    branch = continue_branch(circle(1.0), np.array([1.0]), 0.0, Settings(lam_end=2.0))
    assert branch.end is End.LEFT_INTERVAL and not branch.complete
    assert branch.lam[-1] == 0.0 and branch.x[-1, 0] == pytest.approx(-1.0, abs=1e-9)
    assert [point.fold_lam for point in branch.folds] == pytest.approx([1.0], abs=1e-4)
    # half a circle; arcs over chords are exact on a circle
    assert branch.points[-1].arclength == pytest.approx(np.pi, abs=1e-7)


def test_weights_measure_an_ellipse_as_a_circle() -> None:
    ellipse = scalar(lambda x, lam: x**2 / 4.0 + lam**2 - 1.0, lambda x, lam: x / 2.0, lambda x, lam: 2.0 * lam)
    settings = Settings(lam_end=2.0, weights=np.array([0.25]))
    branch = continue_branch(ellipse, np.array([2.0]), 0.0, settings)
    assert branch.points[-1].arclength == pytest.approx(np.pi, abs=1e-7)
    assert [0.25 * p.tangent_x[0] ** 2 + p.tangent_lam**2 for p in branch.points] == pytest.approx(
        np.ones(len(branch.points)), abs=1e-12
    )


def duffing_folds(zeta: float, gamma: float, force: float) -> list[float]:
    """Double roots in A^2 of F^2 = A^2 ((1 - O^2 + 3/4 g A^2)^2 + (2 zeta O)^2): zeros of the cubic's discriminant."""

    def discriminant(lam: float) -> float:
        a, b = 9.0 / 16.0 * gamma**2, 1.5 * gamma * (1.0 - lam**2)
        c, d = (1.0 - lam**2) ** 2 + (2.0 * zeta * lam) ** 2, -(force**2)
        return 18.0 * a * b * c * d - 4.0 * b**3 * d + (b * c) ** 2 - 4.0 * a * c**3 - 27.0 * (a * d) ** 2

    scan = np.linspace(1.0, 3.0, 2001)
    signs = np.sign([discriminant(lam) for lam in scan])
    lower, upper = (brentq(discriminant, scan[i], scan[i + 1]) for i in np.flatnonzero(signs[1:] != signs[:-1]))
    return [upper, lower]


@predictors
@pytest.mark.parametrize("force", [0.2, 0.3])
def test_duffing_folds_at_the_polynomial_response(predictor: Predictor, force: float) -> None:
    zeta, gamma = 0.02, 0.05
    settings = Settings(lam_end=3.0, predictor=predictor)
    branch = continue_branch(duffing(zeta, gamma, force), np.array([force, 0.0]), 0.3, settings)
    assert branch.complete
    # cubic Hermite over one step of at most 0.5 rad
    assert [p.fold_lam for p in branch.folds] == pytest.approx(duffing_folds(zeta, gamma, force), abs=1e-3)
    assert not branch.corners and not branch.branch_points


@pytest.mark.parametrize("lam_end", [2.0, 1.7, np.pi / 2, 0.1 + 0.2 + 0.7])
def test_last_point_lies_at_lam_end_to_the_last_bit(lam_end: float) -> None:
    branch = continue_branch(s_curve(), np.array([-1.5]), -2.0, Settings(lam_end=lam_end))
    assert branch.lam[-1] == lam_end and branch.complete
    assert branch.points[-1].residual_norm <= 1e-9


def test_the_direction_may_be_downwards() -> None:
    branch = continue_branch(s_curve(), np.array([1.5]), 2.0, Settings(lam_end=-2.0))
    assert branch.complete and branch.lam[-1] == -2.0 and len(branch.folds) == 2


def test_leaving_by_an_explicit_bound() -> None:
    branch = continue_branch(circle(1.0), np.array([1.0]), 0.0, Settings(lam_end=2.0, lam_min=-0.5))
    assert branch.end is End.LEFT_INTERVAL and branch.lam[-1] == -0.5
    assert branch.message.startswith("continuation: left the interval of lam at lam = -0.5 (point ")


@predictors
@pytest.mark.parametrize("lam0", [-1.0, -1.03, -0.77])
def test_pitchfork_is_passed_straight_and_flagged_once(predictor: Predictor, lam0: float) -> None:
    pitchfork = scalar(lambda x, lam: x**3 - lam * x, lambda x, lam: 3.0 * x**2 - lam, lambda x, lam: -x)
    settings = Settings(lam_end=1.0, step=0.1, predictor=predictor)  # from -1 one step ends on the branch point
    branch = continue_branch(pitchfork, np.zeros(1), lam0, settings)
    assert branch.complete and np.all(branch.x == 0.0)
    assert len(branch.branch_points) == 1 and not branch.corners and not branch.folds


def test_smooth_points_cost_few_linearizations() -> None:
    problem = Counted(s_curve())
    branch = continue_branch(problem, np.array([-4.0]), -60.0, Settings(lam_end=60.0))
    assert branch.complete
    assert problem.linearizations + problem.residuals <= 3.5 * len(branch.points)


def test_generator_yields_the_points_of_the_branch_and_says_why_it_ended() -> None:
    settings = Settings(lam_end=2.0)
    steps, points = trace(s_curve(), np.array([-1.5]), -2.0, settings), []
    while True:
        try:
            points.append(next(steps))
        except StopIteration as stop:
            end, message = stop.value
            break
    branch = continue_branch(s_curve(), np.array([-1.5]), -2.0, settings)
    assert (end, message) == (branch.end, branch.message)
    assert [point.lam for point in points] == list(branch.lam)


def test_on_point_stops_the_trace() -> None:
    def beyond_first_fold(point: Point) -> bool:
        return point.fold

    branch = continue_branch(s_curve(), np.array([-1.5]), -2.0, Settings(lam_end=2.0), beyond_first_fold)
    assert branch.end is End.STOPPED_BY_CALLER and branch.points[-1].fold and len(branch.folds) == 1


def test_bordered_solve_matches_differences_of_the_residual() -> None:
    problem, rng = duffing(0.02, 0.05, 0.3), np.random.default_rng(1)
    y, direction = rng.standard_normal(3), rng.standard_normal(3)
    linearization = problem.linearize(y[:2], y[2])
    errors = []
    for h in (1e-2, 1e-3, 1e-4):
        ahead = y + h * direction
        change = (problem.residual(ahead[:2], ahead[2]) - linearization.residual) / h
        dx, dlam = linearization.solve_bordered(direction[:2], direction[2], change, float(direction @ direction))
        errors.append(np.linalg.norm(np.append(dx, dlam) - direction))
    # one-sided differences: the error falls in proportion to h
    assert errors[1] / errors[0] == pytest.approx(0.1, rel=0.1) and errors[2] / errors[1] == pytest.approx(0.1, rel=0.1)


def test_determinant_sign_agrees_with_numpy_for_several_rows() -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        J, rows = rng.standard_normal((4, 5)), rng.standard_normal((2, 5))
        problem = DenseProblem(lambda x, lam: np.zeros(4), lambda x, lam, J=J: (J[:, :4], J[:, 4]))  # type: ignore[misc]
        linearization = problem.linearize(np.zeros(4), 0.0)
        for row in (*rows, rows[0]):
            bordered = np.vstack([J, row])
            assert linearization.determinant_sign(row[:4], row[4]) == np.sign(np.linalg.det(bordered))
            dx, dlam = linearization.solve_bordered(row[:4], row[4], np.ones(4), 2.0)
            assert bordered @ np.append(dx, dlam) == pytest.approx([1.0, 1.0, 1.0, 1.0, 2.0], abs=1e-10)


def test_a_tall_resonance_takes_fewer_points_with_relative_steps() -> None:
    """A Lorentzian of height 1000 and width 0.02."""
    spike = scalar(
        lambda x, lam: x * (1.0 + (100.0 * (lam - 1.0)) ** 2) / 1000.0 - 1.0,
        lambda x, lam: (1.0 + (100.0 * (lam - 1.0)) ** 2) / 1000.0,
        lambda x, lam: x * 20.0 * (lam - 1.0),
    )
    points = {}
    for relative in (0.0, 0.05):
        settings = Settings(lam_end=1.25, step=0.5, step_max=2.0, relative_step=relative, max_points=5000)
        branch = continue_branch(spike, np.array([1000.0 / 626.0]), 0.75, settings)
        assert branch.end is End.REACHED_END
        assert np.max(branch.x) == pytest.approx(1000.0, rel=2e-2)
        points[relative] = len(branch.points)
    assert points[0.05] < points[0.0] / 4
