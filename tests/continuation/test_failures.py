"""What goes wrong ends with a reason, a message and the partial branch."""

import warnings
from typing import Any

import numpy as np
import pytest
from curves import Counted, s_curve, scalar

from continuation import (
    ConvergenceError,
    DenseProblem,
    End,
    NewtonSettings,
    Reason,
    Settings,
    continue_branch,
    solve_at,
)


def root_end() -> DenseProblem:
    """x = sqrt(1 - lam): the curve ends at lam = 1, nan behind."""
    return scalar(
        lambda x, lam: x - np.sqrt(1.0 - lam), lambda x, lam: 1.0, lambda x, lam: 0.5 / np.sqrt(np.float64(1.0) - lam)
    )


def test_end_of_the_domain_keeps_the_partial_branch() -> None:
    branch = continue_branch(root_end(), np.ones(1), 0.0, Settings(lam_end=2.0))
    assert branch.end is End.STEP_BELOW_MINIMUM and not branch.complete
    assert 0.99 < branch.lam[-1] <= 1.0
    assert branch.x[:, 0] == pytest.approx(np.sqrt(1.0 - branch.lam), abs=1e-8)
    assert branch.message == (
        f"continuation: stopped at lam = {branch.lam[-1]:.10g} (point {len(branch.points)}), step below 1e-06, "
        "last residual nan, residual is not finite at the first guess; tried smaller steps, a corner, fixed lam and "
        "longer steps; check that F is defined and continuous there, or try a larger tolerance or another step"
    )


def test_require_complete_raises_with_the_branch() -> None:
    branch = continue_branch(root_end(), np.ones(1), 0.0, Settings(lam_end=2.0))
    with pytest.raises(ConvergenceError, match="step below 1e-06") as caught:
        branch.require_complete()
    assert caught.value.branch is branch


def test_gap_in_the_curve_is_not_bridged_silently() -> None:
    gap = scalar(lambda x, lam: x - 10.0 * (lam > 0.5), lambda x, lam: 1.0, lambda x, lam: 0.0)
    branch = continue_branch(gap, np.zeros(1), 0.0, Settings(lam_end=1.0))
    assert branch.end is End.STEP_BELOW_MINIMUM and np.all(branch.x == 0.0)
    assert branch.lam[-1] == pytest.approx(0.5, abs=1e-5)
    assert "far from its guess" in branch.message


def test_hole_in_the_domain_is_jumped_and_flagged() -> None:
    def f(x: float, lam: float) -> float:
        return float("nan") if 0.5 < lam < 0.52 else x - lam

    problem = scalar(f, lambda x, lam: 1.0, lambda x, lam: -1.0)
    branch = continue_branch(problem, np.zeros(1), 0.0, Settings(lam_end=1.0, step=0.01, step_max=0.01))
    assert branch.complete
    (jump,) = branch.jumps
    assert jump.lam >= 0.52 and not jump.corner


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_only_cost_a_trial(bad: float) -> None:
    """Off the curve by more than 0.02 the residual is not defined: the corrector must take smaller steps."""

    def f(x: float, lam: float) -> float:
        value = x**3 - x - lam
        return bad if abs(value) > 0.02 else value

    problem = scalar(f, lambda x, lam: 3.0 * x**2 - 1.0, lambda x, lam: -1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        branch = continue_branch(problem, np.array([-1.5213797]), -2.0, Settings(lam_end=2.0, step=0.3))
    assert branch.complete and len(branch.folds) == 2


def test_start_without_solution_has_no_points() -> None:
    problem = scalar(lambda x, lam: x**2 + 1.0 + lam, lambda x, lam: 2.0 * x, lambda x, lam: 1.0)
    branch = continue_branch(problem, np.array([0.3]), 0.0, Settings(lam_end=1.0))
    assert branch.end is End.START_NOT_CONVERGED and branch.points == ()
    assert branch.lam.shape == (0,) and branch.x.shape == (0, 0)
    assert branch.message.startswith("continuation: start did not converge at lam = 0 (point 1), ")
    assert branch.message.endswith("; try a better x0, another lam0 or a larger tolerance")


def test_too_many_points_says_where() -> None:
    branch = continue_branch(s_curve(), np.array([-1.5]), -2.0, Settings(lam_end=2.0, max_points=5))
    assert branch.end is End.TOO_MANY_POINTS and len(branch.points) == 5
    assert branch.message == (
        f"continuation: too many points at lam = {branch.lam[-1]:.10g} (point 5); "
        "lam_end = 2; try a larger max_points or step_max"
    )


class Raising:
    """Raises LinAlgError instead of returning nan, as the protocol allows."""

    def __init__(self, inner: Any) -> None:
        self.inner, self.residual = inner, inner.residual

    def solve_bordered(self, row: Any, row_lam: float, rhs: Any, rhs_row: float) -> tuple[Any, float]:
        """Solve, or raise."""
        dx, dlam = self.inner.solve_bordered(row, row_lam, rhs, rhs_row)
        if not np.isfinite(dlam):
            raise np.linalg.LinAlgError("singular")
        return dx, dlam

    def determinant_sign(self, row: Any, row_lam: float) -> int:
        """Pass on."""
        return int(self.inner.determinant_sign(row, row_lam))


class RaisingProblem(Counted):
    """Passes on, with `Raising` linearizations."""

    def linearize(self, x: Any, lam: float) -> Any:
        """Pass on."""
        return Raising(super().linearize(x, lam))


def test_singular_start_is_a_reason_whether_raised_or_nan() -> None:
    flat = scalar(lambda x, lam: x**2 - 1.0 - lam, lambda x, lam: 2.0 * x, lambda x, lam: -1.0)
    for problem in (flat, RaisingProblem(flat)):
        solution = solve_at(problem, np.zeros(1), 0.0, NewtonSettings())
        assert solution.reason is Reason.SINGULAR and not solution.converged


def test_line_search_solves_what_full_steps_cannot() -> None:
    """Newton's full steps on atan diverge from |x| > 1.39."""
    problem = Counted(scalar(lambda x, lam: np.arctan(x), lambda x, lam: 1.0 / (1.0 + x**2), lambda x, lam: 0.0))
    solution = solve_at(problem, np.array([3.0]), 0.0, NewtonSettings())
    assert solution.converged and solution.x[0] == pytest.approx(0.0, abs=1e-9)
    assert problem.residuals > 0


def test_fixed_parameter_is_kept_to_the_last_bit() -> None:
    lam = 0.1 + 0.2
    assert solve_at(s_curve(), np.array([1.3]), lam, NewtonSettings()).lam == lam


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"step": 1.0}, "Settings: step = 1; must lie between step_min = 1e-06 and step_max = 0.5"),
        ({"tolerance": 0.0}, "Settings: tolerance = 0; must be > 0 and finite"),
        ({"tolerance": float("nan")}, "Settings: tolerance = nan; must be > 0 and finite"),
        ({"max_iterations": 0}, "Settings: max_iterations = 0; must be a whole number >= 1"),
        ({"max_points": 2.5}, "Settings: max_points = 2.5; must be a whole number >= 1"),
        ({"lam_max": 0.5}, "Settings: lam_end = 1; must lie between lam_min = -inf and lam_max = 0.5"),
        ({"lam_end": float("inf")}, "Settings: lam_end = inf; must be finite"),
        ({"lam_weight": -1.0}, "Settings: lam_weight = -1; must be > 0 and finite"),
        ({"weights": np.array([1.0, 0.0])}, "Settings: weights = [1. 0.]; must be a vector of numbers > 0"),
        ({"predictor": "tangent"}, "Settings: predictor = 'tangent'; must be a Predictor"),
    ],
)
def test_wrong_settings_are_refused_with_their_numbers(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError) as caught:
        Settings(**({"lam_end": 1.0} | wrong))
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (Settings(lam_end=-2.0), "trace: lam0 = -2 equals lam_end; they must differ"),
        (Settings(lam_end=2.0, lam_min=0.0), "trace: lam0 = -2; must lie between lam_min = 0 and lam_max = 2"),
        (Settings(lam_end=2.0, weights=np.ones(3)), "trace: settings.weights has 3 entries; x0 has 1"),
    ],
)
def test_start_that_does_not_fit_is_refused(settings: Settings, message: str) -> None:
    with pytest.raises(ValueError) as caught:
        continue_branch(s_curve(), np.array([-1.5]), -2.0, settings)
    assert str(caught.value) == message
