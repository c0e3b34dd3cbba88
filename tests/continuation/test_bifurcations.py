"""Special points, crossing curves, fold curves and isolas whose places are known in closed form."""

from enum import Enum
from typing import Any

import numpy as np
import pytest
from curves import circle, duffing, s_curve, scalar, scalar_of_two
from scipy.optimize import brentq, root

from continuation import (
    AtMu,
    Branch,
    ConvergenceError,
    DenseProblem,
    DenseTwoParameterProblem,
    End,
    Kind,
    Point,
    Predictor,
    Settings,
    continue_along,
    continue_branch,
    fold_curve,
    isolas,
    locate,
    refine,
    refine_branch_point,
    refine_fold,
    switch_branch,
)
from continuation.foldsystem import FoldSystem

Array = Any
predictors = pytest.mark.parametrize("predictor", list(Predictor))
derivatives = pytest.mark.parametrize("exact", [True, False], ids=["second derivatives", "secants"])


# special points ------------------------------------------------------------------------------------------------------
def test_folds_are_located_where_points_lie_on_them() -> None:
    """A step gets a point at its fold, where the tangent of the iterate before may have the sign of the other side."""
    lost = []
    for force in np.linspace(0.2, 0.4, 11):
        problem = duffing(0.05, 1.0, force)
        settings = Settings(
            lam_end=3.0, step=0.07, step_max=0.36, relative_step=0.5, max_angle=2.0, curve_tolerance=1.5e-3,
            tangent_slack=0.01, tolerance=1e-10,
        )  # fmt: skip
        branch = continue_branch(problem, np.zeros(2), 0.2, settings)
        found = refine(problem, branch)
        assert len(found) == len(branch.folds) == 2
        lost += [s for s in found if not s.located or abs(s.test) > 1e-8]
        assert [s.lam for s in found] == pytest.approx([p.fold_lam for p in branch.folds], rel=1e-5)
    assert not lost


@predictors
def test_folds_of_the_s_curve_to_rounding(predictor: Predictor) -> None:
    branch = continue_branch(s_curve(), np.array([-1.5]), -2.0, Settings(lam_end=2.0, predictor=predictor))
    folds = refine(s_curve(), branch)
    assert [p.lam for p in folds] == pytest.approx([2.0 / 27.0**0.5, -2.0 / 27.0**0.5], abs=1e-12)
    assert [p.x[0] for p in folds] == pytest.approx([-(3.0**-0.5), 3.0**-0.5], abs=1e-10)
    for fold, behind in zip(folds, branch.folds, strict=True):
        assert fold.kind is Kind.FOLD and fold.located
        assert fold.null_space == pytest.approx(np.array([[1.0, 0.0]]), abs=1e-10)
        before = branch.points[branch.points.index(behind) - 1]
        assert before.arclength < fold.arclength < behind.arclength


@pytest.mark.parametrize("force", [0.2, 0.3])
def test_folds_of_a_duffing_oscillator_at_the_discriminant(force: float) -> None:
    zeta, gamma = 0.02, 0.05
    problem = duffing(zeta, gamma, force)
    branch = continue_branch(problem, np.array([force, 0.0]), 0.3, Settings(lam_end=3.0))

    def discriminant(lam: float) -> float:
        """Of F^2 = A^2 ((1 - O^2 + 3/4 g A^2)^2 + (2 zeta O)^2), a cubic in A^2."""
        a, b = 9.0 / 16.0 * gamma**2, 1.5 * gamma * (1.0 - lam**2)
        c, d = (1.0 - lam**2) ** 2 + (2.0 * zeta * lam) ** 2, -(force**2)
        return 18.0 * a * b * c * d - 4.0 * b**3 * d + (b * c) ** 2 - 4.0 * a * c**3 - 27.0 * (a * d) ** 2

    for fold in refine(problem, branch):
        expected = brentq(discriminant, fold.lam - 1e-3, fold.lam + 1e-3, xtol=1e-14)
        assert fold.lam == pytest.approx(expected, abs=1e-9)
        J_x = np.array(
            [problem.linearize(fold.x, fold.lam).solve_bordered(np.zeros(2), 1.0, e, 0.0)[0] for e in np.eye(2)]
        )
        assert np.linalg.norm(np.linalg.inv(J_x.T) @ fold.null_space[0, :2]) < 1e-7


def test_where_lam_does_not_turn_there_is_no_fold() -> None:
    branch = continue_branch(s_curve(), np.array([-1.5]), -2.0, Settings(lam_end=2.0))
    with pytest.raises(ValueError, match="must change its sign in between"):
        refine_fold(s_curve(), branch.points[0], branch.points[1], branch.settings)


class Height(Enum):
    """Kinds of a caller's own."""

    ONE_OR_MINUS_ONE = "x = 1 or x = -1"


def test_any_test_function_is_located_by_its_entries() -> None:
    branch = continue_branch(s_curve(), np.array([-1.5]), -2.0, Settings(lam_end=2.0))
    found = locate(s_curve(), branch, lambda p: np.array([p.x[0] - 1.0, np.nan, p.x[0] + 1.0]), Height.ONE_OR_MINUS_ONE)
    assert [p.x[0] for p in found] == pytest.approx([-1.0, 1.0], abs=1e-9)
    assert [p.lam for p in found] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert all(p.kind is Height.ONE_OR_MINUS_ONE and abs(p.test) < 1e-9 for p in found)


def test_what_cannot_be_solved_in_between_is_kept_and_said() -> None:
    branch = continue_branch(s_curve(), np.array([-1.5]), -2.0, Settings(lam_end=2.0))
    hole = scalar(lambda x, lam: np.nan, lambda x, lam: 1.0, lambda x, lam: 1.0)
    folds = refine(hole, branch)
    assert [(p.kind, p.located, p.lam) for p in folds] == [(Kind.FOLD, False, p.lam) for p in branch.folds]
    (one,) = locate(hole, branch, lambda p: p.x - 1.0, Height.ONE_OR_MINUS_ONE)
    assert not one.located and np.isnan(one.test)


# branch points -------------------------------------------------------------------------------------------------------
def pitchfork() -> DenseProblem:
    """x (x^2 - lam) = 0."""
    return scalar(lambda x, lam: x**3 - lam * x, lambda x, lam: 3.0 * x**2 - lam, lambda x, lam: -x)


def transcritical() -> DenseProblem:
    """x (x - lam) = 0."""
    return scalar(lambda x, lam: x * (x - lam), lambda x, lam: 2.0 * x - lam, lambda x, lam: -x)


def tilted() -> DenseProblem:
    """(x - sin lam) (x + lam^2 - 0.3) (1 + z/10) = 0 and z = cos x - lam / 5: curved everywhere."""

    def residual(y: Array, lam: float) -> Array:
        x, z = y
        return np.array([(x - np.sin(lam)) * (x + lam**2 - 0.3) * (1.0 + 0.1 * z), z - np.cos(x) + 0.2 * lam])

    def jacobian(y: Array, lam: float) -> tuple[Array, Array]:
        x, z = y
        u, w, k = x - np.sin(lam), x + lam**2 - 0.3, 1.0 + 0.1 * z
        J_x = np.array([[(u + w) * k, 0.1 * u * w], [np.sin(x), 1.0]])
        return J_x, np.array([(2.0 * lam * u - np.cos(lam) * w) * k, 0.2])

    return DenseProblem(residual, jacobian)


@predictors
@pytest.mark.parametrize("lam0", [-1.0, -1.03, -0.77])
@pytest.mark.parametrize(("problem", "other"), [(pitchfork(), [1.0, 0.0]), (transcritical(), [0.5**0.5, 0.5**0.5])])
def test_branch_point_with_both_tangents(problem: Any, other: Any, lam0: float, predictor: Predictor) -> None:
    settings = Settings(lam_end=1.0, step=0.1, predictor=predictor)  # from -1 one step ends on the branch point
    (crossing,) = refine(problem, continue_branch(problem, np.zeros(1), lam0, settings))
    assert crossing.kind is Kind.BRANCH_POINT and crossing.located
    assert np.append(crossing.x, crossing.lam) == pytest.approx(np.zeros(2), abs=1e-9)
    assert crossing.tangent == pytest.approx(np.array([0.0, 1.0]), abs=1e-6)
    assert abs(crossing.null_space[1] @ other) == pytest.approx(1.0, abs=1e-6)
    assert crossing.arclength == pytest.approx(-lam0, abs=1e-9)


@predictors
@pytest.mark.parametrize("step", [0.05, 0.2])
def test_curved_branches_cross_and_are_switched(predictor: Predictor, step: float) -> None:
    problem, lam = tilted(), brentq(lambda lam: np.sin(lam) + lam**2 - 0.3, 0.0, 1.0)
    settings = Settings(lam_end=1.5, step=step, predictor=predictor)
    start = np.array([np.sin(-0.8), np.cos(np.sin(-0.8)) + 0.16])
    (crossing,) = refine(problem, continue_branch(problem, start, -0.8, settings))
    assert crossing.lam == pytest.approx(lam, abs=1e-10)
    assert crossing.x == pytest.approx([np.sin(lam), np.cos(np.sin(lam)) - 0.2 * lam], abs=1e-10)
    for tangent, slope in zip(crossing.null_space, (np.cos(lam), -2.0 * lam), strict=True):
        expected = np.array([slope, -np.sin(np.sin(lam)) * slope - 0.2, 1.0])
        assert abs(tangent @ expected) == pytest.approx(np.linalg.norm(expected), rel=1e-9)
    for branch in switch_branch(problem, crossing, Settings(lam_end=1.5, lam_min=-0.8, step=step)):
        assert branch.end in (End.REACHED_END, End.LEFT_INTERVAL) and abs(branch.lam[-1] - lam) > 0.5
        assert np.max(np.abs(branch.x[:, 0] + branch.lam**2 - 0.3)) < 1e-8


@pytest.mark.parametrize("step", [0.1, 3.0])
def test_both_arms_of_a_pitchfork(step: float) -> None:
    problem = pitchfork()
    (crossing,) = refine(problem, continue_branch(problem, np.zeros(1), -1.03, Settings(lam_end=1.0, step=0.1)))
    arms = switch_branch(problem, crossing, Settings(lam_end=2.0, lam_min=-1.0, step=step, step_max=3.0))
    for branch in arms:  # starts near, where the curve still follows its tangent
        assert branch.lam[0] < 0.5 * abs(branch.x[0, 0])
    assert [branch.end for branch in arms] == [End.REACHED_END, End.REACHED_END]
    assert [branch.x[-1, 0] for branch in arms] == pytest.approx([2.0**0.5, -(2.0**0.5)], abs=1e-8)


def test_symmetry_breaking_of_a_duffing_oscillator_by_many_harmonics() -> None:
    """x'' + 0.2 x' + x + x^3 = 25 cos: where even harmonics appear, a closed curve leaves the symmetric response."""
    H, samples = 5, 64
    size, k, even = 2 * H + 1, np.arange(1, H + 1), [0, 2, 4, 7, 9]
    phase = 2.0 * np.pi * np.arange(samples) / samples
    waves = np.hstack([np.ones((samples, 1)), np.cos(np.outer(phase, k)), np.sin(np.outer(phase, k))])
    analysis = waves.T / np.sum(waves**2, axis=0)[:, None]
    D, force = np.zeros((size, size)), 25.0 * np.eye(size)[1]
    D[k, H + k], D[H + k, k] = k, -k

    def jacobian(x: Array, lam: float) -> tuple[Array, Array]:
        J_x = lam**2 * D @ D + 0.2 * lam * D + np.eye(size) + analysis @ (3.0 * (waves @ x)[:, None] ** 2 * waves)
        return J_x, 2.0 * lam * D @ D @ x + 0.2 * D @ x

    problem = DenseProblem(
        lambda x, lam: (lam**2 * D @ D + 0.2 * lam * D) @ x + x + analysis @ (waves @ x) ** 3 - force, jacobian
    )
    settings = Settings(lam_end=1.1, lam_max=9.0, step=0.02, step_max=0.2)
    branch = continue_branch(problem, 5.0 * np.eye(size)[1], 4.0, settings)
    assert branch.complete and np.max(np.abs(branch.x[:, even])) < 1e-9
    high, low = (p for p in refine(problem, branch) if p.kind is Kind.BRANCH_POINT)
    for crossing in (high, low):
        sigma = np.linalg.svd(jacobian(crossing.x, crossing.lam)[0][np.ix_(even, even)], compute_uv=False)
        assert sigma[-1] < 1e-9 * sigma[0]
        assert np.delete(crossing.null_space[1], even) == pytest.approx(np.zeros(size + 1 - len(even)), abs=1e-6)
    for loop in switch_branch(problem, high, Settings(lam_end=9.0, lam_min=0.5, step=0.02, step_max=0.2)):
        assert loop.closed and np.max(np.abs(loop.x[:, even])) > 0.5
        assert sorted(p.lam for p in refine(problem, loop) if p.kind is Kind.BRANCH_POINT) == pytest.approx(
            [low.lam, high.lam], abs=1e-8
        )


def test_curves_that_come_close_do_not_cross() -> None:
    gap = scalar(lambda x, lam: x * (x - lam) - 1e-4, lambda x, lam: 2.0 * x - lam, lambda x, lam: -x)
    branch = continue_branch(gap, np.array([-1e-4]), -1.0, Settings(lam_end=1.0, step_max=0.05))
    assert not branch.branch_points
    i = int(np.argmin(np.abs(branch.lam)))
    with pytest.raises(ConvergenceError, match="come close, but do not cross"):
        refine_branch_point(gap, branch.points[i - 1], branch.points[i + 1], branch.settings)


def test_a_fold_has_no_other_curve() -> None:
    branch = continue_branch(s_curve(), np.array([-1.5]), -2.0, Settings(lam_end=2.0))
    fold, _ = refine(s_curve(), branch)
    with pytest.raises(ValueError, match=r"switch_branch: fold at lam = 0\.3849 has one tangent; needs two"):
        switch_branch(s_curve(), fold, Settings(lam_end=2.0))


# closed curves -------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize("radius", [1.0, 1e-3])
def test_a_circle_closes_after_one_turn(radius: float, sense: float) -> None:
    settings = Settings(lam_end=3.0, lam_min=-3.0, step=0.1 * radius, step_max=0.5)
    branch = continue_along(
        circle(radius), np.array([0.6 * radius]), 0.8 * radius, sense * np.array([-0.8, 0.6]), settings
    )
    assert branch.end is End.CLOSED and branch.closed and not branch.complete
    assert branch.message.startswith("continuation: closed, back at the start at lam = ")
    # arcs over chords are exact on a circle; the residual's tolerance leaves 5e-10 / radius in x
    assert branch.points[-1].arclength == pytest.approx(2.0 * np.pi * radius, rel=1e-9 / radius**2 + 1e-8)
    assert len(branch.folds) == 2 and branch.x[-1] == pytest.approx(branch.x[0], abs=1e-9 / radius)


def test_a_helix_that_passes_close_to_its_start_is_not_closed() -> None:
    """One turn shifts it by 2e-3, steps are up to 0.5."""
    shift = 2e-3 / (2.0 * np.pi)

    def residual(x: Array, lam: float) -> Array:
        return np.array([x[0] - np.sin(x[1]), np.cos(x[1]) - lam, x[2] - shift * x[1]])

    def jacobian(x: Array, lam: float) -> tuple[Array, Array]:
        J_x = np.array([[1.0, -np.cos(x[1]), 0.0], [0.0, -np.sin(x[1]), 0.0], [0.0, -shift, 1.0]])
        return J_x, np.array([0.0, -1.0, 0.0])

    settings = Settings(lam_end=2.0, lam_min=-2.0, weights=np.array([1.0, 1e-8, 1.0]), max_points=100)
    start, direction = np.array([1.0, np.pi / 2, shift * np.pi / 2]), np.array([0.0, 1.0, shift, -1.0])
    branch = continue_along(DenseProblem(residual, jacobian), start, 0.0, direction, settings)
    assert branch.end is End.TOO_MANY_POINTS and branch.x[-1, 1] > 4.0 * np.pi


# fold curves ---------------------------------------------------------------------------------------------------------
def cusp() -> tuple[DenseTwoParameterProblem, Any]:
    """x^3 - mu x = lam; folds at 27 lam^2 = 4 mu^3, cusp at the origin."""
    return scalar_of_two(
        lambda x, lam, mu: x**3 - mu * x - lam,
        lambda x, lam, mu: (3.0 * x**2 - mu, -1.0, -x),
        lambda x, lam, mu: (6.0 * x, 0.0, -1.0),
    )


def conic(sign: float) -> tuple[DenseTwoParameterProblem, Any]:
    """x^2 + sign (lam - 1)^2 = mu - 0.3: a circle born at mu = 0.3, or two curves that meet there."""
    return scalar_of_two(
        lambda x, lam, mu: x**2 + sign * (lam - 1.0) ** 2 - mu + 0.3,
        lambda x, lam, mu: (2.0 * x, 2.0 * sign * (lam - 1.0), -1.0),
        lambda x, lam, mu: (2.0, 0.0, 0.0),
    )


def first_fold(problem: DenseTwoParameterProblem, mu: float, branch: Branch) -> Any:
    return next(p for p in refine(AtMu(problem, mu), branch) if p.kind is Kind.FOLD)


@derivatives
def test_fold_curve_over_its_cusp(exact: bool) -> None:
    problem, second = cusp()
    fold = first_fold(problem, 1.0, continue_branch(AtMu(problem, 1.0), np.array([-1.5]), -2.0, Settings(lam_end=2.0)))
    curve = fold_curve(problem, fold, 1.0, Settings(lam_end=-1.0, lam_max=2.0), second=second if exact else None)
    assert curve.end is End.LEFT_INTERVAL and curve.mu[-1] == 2.0 and curve.lam[0] * curve.lam[-1] < 0.0
    assert curve.message.startswith("fold curve: left the interval of mu at mu = 2 (point ")
    assert 27.0 * curve.lam**2 == pytest.approx(4.0 * curve.mu**3, abs=1e-7)
    (point,) = curve.special
    assert point.kind is Kind.CUSP and point.located
    assert [*point.x, point.lam] == pytest.approx([0.0, 0.0, 0.0], abs=1e-8)
    for mu in (0.7, 1.0):  # 1 is the start
        fold_lam = (4.0 * mu**3 / 27.0) ** 0.5
        assert sorted(p.lam for p in curve.at(mu)) == pytest.approx([-fold_lam, fold_lam], abs=1e-8)
    assert curve.at(-0.1) == ()


def oscillator(damping: Any, gamma: float) -> DenseTwoParameterProblem:
    """One-harmonic oscillator, x = (a, b): k = 1 - O^2 + 3/4 gamma A^2 and c(O A) O, by lam = O and mu = force.

    `damping(v)` are the equivalent damping at a velocity amplitude v, and its derivative.
    """

    def residual(x: Array, lam: float, mu: float) -> Array:
        A2 = x @ x
        k, c = 1.0 - lam**2 + 0.75 * gamma * A2, damping(lam * A2**0.5)[0] * lam
        return np.array([k * x[0] + c * x[1] - mu, k * x[1] - c * x[0]])

    def jacobian(x: Array, lam: float, mu: float) -> tuple[Array, Array, Array]:
        A = (x @ x) ** 0.5
        k, (d, slope) = 1.0 - lam**2 + 0.75 * gamma * A**2, damping(lam * A)
        turned = np.array([x[1], -x[0]])
        J_x = k * np.eye(2) + 1.5 * gamma * np.outer(x, x) + d * lam * np.array([[0.0, 1.0], [-1.0, 0.0]])
        J_x += np.outer(turned, x) * lam**2 * slope / A
        return J_x, -2.0 * lam * x + (d + lam * A * slope) * turned, np.array([-1.0, 0.0])

    return DenseTwoParameterProblem(residual, jacobian)


@pytest.mark.parametrize("zeta", [0.01, 0.1])
def test_cusp_of_a_duffing_oscillator(zeta: float) -> None:
    """The cubic in A^2 has a triple root: O = sqrt(3) zeta + sqrt(1 + 3 zeta^2), F^2 = 32 d^3 / (9 sqrt(3) gamma)."""
    gamma = 0.5
    lam = 3.0**0.5 * zeta + (1.0 + 3.0 * zeta**2) ** 0.5
    force = (32.0 * (2.0 * zeta * lam) ** 3 / (9.0 * 3.0**0.5 * gamma)) ** 0.5
    problem, start = oscillator(lambda v: (2.0 * zeta, 0.0), gamma), 3.0 * force
    branch = continue_branch(AtMu(problem, start), np.array([start, 0.0]), 0.3, Settings(lam_end=3.0, step_max=0.1))
    *_, fold = refine(AtMu(problem, start), branch)
    settings = Settings(lam_end=0.1 * force, lam_max=1.1 * start, step=0.05 * force, lam_weight=10.0)
    curve = fold_curve(problem, fold, start, settings)
    (point,) = curve.special
    assert point.kind is Kind.CUSP
    assert [point.x[-1], point.lam] == pytest.approx([lam, force], rel=1e-7)


@derivatives
def test_a_closed_curve_is_born(exact: bool) -> None:
    problem, second = conic(1.0)
    settings = Settings(lam_end=9.0, lam_min=-9.0)
    at_one = continue_along(AtMu(problem, 1.3), np.array([1.0]), 1.0, np.array([0.0, 1.0]), settings)
    curve = fold_curve(
        problem,
        first_fold(problem, 1.3, at_one),
        1.3,
        Settings(lam_end=0.0, lam_max=2.0),
        second=second if exact else None,
    )
    (born,) = curve.special
    assert born.kind is Kind.ISOLA_CENTRE
    assert [*born.x, born.lam] == pytest.approx([0.0, 1.0, 0.3], abs=1e-8)
    for mu in (0.3001, 0.31, 0.5, 1.3):
        (isola,) = isolas(curve, mu, [], Settings(lam_end=9.0, step=0.002))
        assert isola.closed and len(isola.folds) == 2
        assert isola.points[-1].arclength == pytest.approx(2.0 * np.pi * (mu - 0.3) ** 0.5, rel=1e-5)
    assert isolas(curve, 1.3, [at_one], settings) == ()
    assert isolas(curve, 0.2, [], settings) == ()


@derivatives
def test_two_curves_meet(exact: bool) -> None:
    problem, second = conic(-1.0)
    branch = continue_branch(AtMu(problem, 0.0), np.array([1.0]), 2.2, Settings(lam_end=-1.0, lam_max=2.5))
    settings = Settings(lam_end=1.0, lam_min=-0.5)
    fold = first_fold(problem, 0.0, branch)
    curve = fold_curve(problem, fold, 0.0, settings, second=second if exact else None)
    (met,) = curve.special
    assert met.kind is Kind.CROSSING
    assert [*met.x, met.lam] == pytest.approx([0.0, 1.0, 0.3], abs=1e-8)


def test_isola_of_an_oscillator_with_damping_that_falls_and_rises() -> None:
    """Damping force c1 v + c3 v^3 + c5 v^5 (Habib, Cirillo, Kerschen 2018): where F(A, O) is stationary."""
    c1, c3, c5, gamma = 0.1, -0.25, 0.15, 0.2

    def damping(v: Any) -> Any:
        return c1 + 0.75 * c3 * v**2 + 0.625 * c5 * v**4, 1.5 * c3 * v + 2.5 * c5 * v**3

    def squared_force(A: Any, lam: Any) -> Any:
        return A**2 * ((1.0 - lam**2 + 0.75 * gamma * A**2) ** 2 + (damping(lam * A)[0] * lam) ** 2)

    def gradient(y: Array) -> Array:
        return [squared_force(y[0] + 1e-30j, y[1]).imag * 1e30, squared_force(y[0], y[1] + 1e-30j).imag * 1e30]

    stationary = {
        kind: root(gradient, [A, (1.0 + 0.75 * gamma * A**2) ** 0.5], tol=1e-14).x
        for kind, A in ((Kind.CROSSING, 0.45), (Kind.ISOLA_CENTRE, 0.9))
    }
    problem, start = oscillator(damping, gamma), 0.04
    settings = Settings(lam_end=1.6, lam_min=0.5, step=0.01, step_max=0.05)
    branch = continue_branch(AtMu(problem, start), np.array([start, 0.0]), 0.6, settings)
    *_, fold = refine(AtMu(problem, start), branch)
    towards = Settings(lam_end=0.001, lam_max=0.05, step=0.005, step_max=0.05)
    curve = fold_curve(problem, fold, start, towards)
    found = {p.kind: p for p in curve.special}
    for kind, (A, lam) in stationary.items():
        assert np.linalg.norm(found[kind].x[:2]) == pytest.approx(A, rel=1e-7)
        assert found[kind].x[-1] == pytest.approx(lam, rel=1e-7)
        assert found[kind].lam == pytest.approx(squared_force(A, lam) ** 0.5, rel=1e-7)
    between = 0.5 * (found[Kind.CROSSING].lam + found[Kind.ISOLA_CENTRE].lam)
    main = continue_branch(AtMu(problem, between), np.array([between, 0.0]), 0.6, settings)
    (isola,) = isolas(curve, between, [main], settings)
    assert isola.closed and np.min(np.linalg.norm(isola.x, axis=1)) > np.max(np.linalg.norm(main.x, axis=1))


def test_fold_curve_that_is_lost_keeps_what_was_found() -> None:
    """Not defined below mu = 0.5."""
    whole, second = cusp()
    half = DenseTwoParameterProblem(
        lambda x, lam, mu: whole.residual(x, lam, mu) if mu > 0.5 else np.array([np.nan]),
        lambda x, lam, mu: (np.array([[3.0 * x[0] ** 2 - mu]]), -np.ones(1), -x),
    )
    fold = first_fold(half, 1.0, continue_branch(AtMu(half, 1.0), np.array([-1.5]), -2.0, Settings(lam_end=2.0)))
    curve = fold_curve(half, fold, 1.0, Settings(lam_end=-1.0, lam_max=2.0), second=second)
    assert curve.end is End.STEP_BELOW_MINIMUM and curve.special == ()
    assert "fold curve: stopped at mu = 0.5" in curve.message and "residual is not finite" in curve.message
    assert np.min(curve.mu) == pytest.approx(0.5, abs=1e-3) and len(curve.mu) > 3


def test_a_caller_may_stop_a_fold_curve() -> None:
    problem, second = cusp()
    fold = first_fold(problem, 1.0, continue_branch(AtMu(problem, 1.0), np.array([-1.5]), -2.0, Settings(lam_end=2.0)))

    def below_a_half(point: Point) -> bool:
        return point.lam < 0.5

    curve = fold_curve(problem, fold, 1.0, Settings(lam_end=-1.0, lam_max=2.0), second=second, on_point=below_a_half)
    assert curve.end is End.STOPPED_BY_CALLER and curve.mu[-1] < 0.5 <= curve.mu[-2]


def random_system(size: int, seed: int) -> tuple[DenseTwoParameterProblem, Any]:
    """F = A y + B (y y) with y = (x, lam, mu), and its second derivatives."""
    rng = np.random.default_rng(seed)
    A, B = rng.standard_normal((size, size + 2)), rng.standard_normal((size, size + 2, size + 2))
    B += B.transpose(0, 2, 1)

    def residual(x: Array, lam: float, mu: float) -> Array:
        y = np.append(x, [lam, mu])
        return A @ y + 0.5 * B @ y @ y

    def jacobian(x: Array, lam: float, mu: float) -> tuple[Array, Array, Array]:
        J = A + B @ np.append(x, [lam, mu])
        return J[:, :-2], J[:, -2], J[:, -1]

    def second(x: Array, lam: float, mu: float, v: Array, directions: Array) -> Array:
        return np.einsum("ijk,j,kr->ir", B[:, :-2], v, directions)

    return DenseTwoParameterProblem(residual, jacobian), second


@pytest.mark.parametrize("seed", [4, 5, 6, 7])
def test_newton_step_of_the_fold_system_is_its_derivative(seed: int) -> None:
    """Away from any fold too; the matrix by central differences in the test, the sign from its determinant."""
    problem, second = random_system(4, seed)
    rng = np.random.default_rng(seed)
    y = 0.3 * rng.standard_normal(6)
    system = FoldSystem(problem, y, second)
    matrix = np.array(
        [
            (system.linearize(*split(y + h * e)).residual - system.linearize(*split(y - h * e)).residual) / (2.0 * h)
            for h, e in zip([1e-6] * 6, np.eye(6), strict=True)
        ]
    ).T
    for exact in (second, None):
        system.second = exact
        here = system.linearize(*split(y))
        for row in rng.standard_normal((4, 6)):
            rhs = rng.standard_normal(6)
            X, mu = here.solve_bordered(row[:5], row[5], rhs[:5], rhs[5])
            assert np.vstack([matrix, row]) @ np.append(X, mu) == pytest.approx(rhs, abs=1e-6)
            assert here.determinant_sign(row[:5], row[5]) == np.sign(np.linalg.det(np.vstack([matrix, row])))


def split(y: Array) -> tuple[Array, float]:
    return y[:-1], float(y[-1])
