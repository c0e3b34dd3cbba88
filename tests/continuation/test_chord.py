"""Folds by chords: exact where a kink turns the curve, and close to those of smooth systems."""

import numpy as np
import pytest
from curves import Array

from continuation import (
    AtMu,
    DenseTwoParameterProblem,
    Kind,
    Settings,
    SpecialPoint,
    chord_curve,
    continue_branch,
    refine,
)
from continuation.chord import ChordSystem


def test_a_kink_whose_jacobian_is_singular_nowhere() -> None:
    """lam = mu - |x - 1 - mu| turns at x = 1 + mu, J_x = 1 or -1."""

    def jacobian(x: Array, lam: float, mu: float) -> tuple[Array, Array, Array]:
        sign = np.sign(x - 1.0 - mu)
        return np.diag(sign), np.ones(1), -1.0 - sign

    kinked = DenseTwoParameterProblem(lambda x, lam, mu: lam - mu + np.abs(x - 1.0 - mu), jacobian)
    fold = SpecialPoint(Kind.FOLD, np.array([1.0]), 0.0, np.array([[1.0, 0.0]]), 1.0, 0.0)
    curve = chord_curve(kinked, fold, 0.0, Settings(lam_end=0.7), width=0.1)
    assert curve.branch.complete and curve.special == ()
    np.testing.assert_allclose(curve.x[:, 0], 1.0 + curve.mu, atol=1e-8)
    np.testing.assert_allclose(curve.lam, curve.mu, atol=1e-8)
    (half,) = curve.at(0.5)
    assert [half.x[0], half.lam] == pytest.approx([1.5, 0.5], abs=1e-8)


def duffing(zeta: float, gamma: float) -> DenseTwoParameterProblem:
    """One-term balance, by frequency and force."""

    def residual(x: Array, lam: float, mu: float) -> Array:
        k, c = 1.0 - lam**2 + 0.75 * gamma * (x @ x), 2.0 * zeta * lam
        return np.array([k * x[0] + c * x[1] - mu, k * x[1] - c * x[0]])

    def jacobian(x: Array, lam: float, mu: float) -> tuple[Array, Array, Array]:
        k, c = 1.0 - lam**2 + 0.75 * gamma * (x @ x), 2.0 * zeta * lam
        turned = np.array([x[1], -x[0]])
        J_x = k * np.eye(2) + 1.5 * gamma * np.outer(x, x) + c * np.array([[0.0, 1.0], [-1.0, 0.0]])
        return J_x, -2.0 * lam * x + 2.0 * zeta * turned, np.array([-1.0, 0.0])

    return DenseTwoParameterProblem(residual, jacobian)


def test_cusp_of_a_duffing_oscillator_to_the_square_of_the_width() -> None:
    zeta, gamma = 0.05, 0.5
    lam = 3.0**0.5 * zeta + (1.0 + 3.0 * zeta**2) ** 0.5
    force = (32.0 * (2.0 * zeta * lam) ** 3 / (9.0 * 3.0**0.5 * gamma)) ** 0.5
    problem, start = duffing(zeta, gamma), 3.0 * force
    branch = continue_branch(AtMu(problem, start), np.array([start, 0.0]), 0.3, Settings(lam_end=3.0, step_max=0.1))
    first, last = refine(AtMu(problem, start), branch)
    settings = Settings(lam_end=0.1 * force, lam_max=1.05 * start, step=0.02, step_max=0.05, max_angle=1.0)
    curve = chord_curve(problem, last, start, settings, width=0.05)
    (cusp,) = curve.special
    assert cusp.kind is Kind.CUSP
    assert [cusp.x[-1], cusp.lam] == pytest.approx([lam, force], rel=5e-3)
    assert sorted(fold.lam for fold in curve.at(start)) == pytest.approx(sorted([first.lam, last.lam]), rel=1e-5)


def test_newton_step_of_the_chord_system_is_its_derivative() -> None:
    system = ChordSystem(duffing(0.05, 0.5), 0.1, np.array([1.0, 2.0]))
    rng = np.random.default_rng(1)
    X, mu = np.array([0.9, 0.3, 0.8, 0.4, 1.1]), 0.2
    row, rhs = rng.standard_normal((2, 5))
    dX, dmu = system.linearize(X, mu).solve_bordered(row, 0.4, rhs, 0.6)
    h = 1e-6
    secant = (system.residual(X + h * dX, mu + h * dmu) - system.residual(X - h * dX, mu - h * dmu)) / (2.0 * h)
    np.testing.assert_allclose(secant, rhs, atol=1e-5)
    assert row @ dX + 0.4 * dmu == pytest.approx(0.6)
