"""Linearisations against differences of their residuals."""

import numpy as np
import pytest

from hbm.fourier import Array
from hbm.modes.epmc import DriveAmplitude
from hbm.tracking.folds import PlaneBalance


def check_motion(problem: DriveAmplitude, lam: float) -> None:
    """The derivative of a motion at a given amplitude, at a state that is no solution."""
    rng = np.random.default_rng(2)
    x = 0.2 * rng.standard_normal(problem.size)
    x[-2:] = 1.3, 0.02
    here, way = problem.linearize(x, lam), 1e-5 * rng.standard_normal(problem.size + 1)
    # the derivative along a way, from the bordered system: no other change solves it with that right-hand side
    ahead, behind = (problem.residual(x + sign * way[:-1], lam + sign * way[-1]) for sign in (1, -1))
    dx, dlam = here.solve_bordered(np.zeros(problem.size), 1.0, (ahead - behind) / 2, float(way[-1]))
    assert dlam == pytest.approx(way[-1])
    assert np.abs(dx - way[:-1]).max() < 1e-4 * np.abs(way).max()  # a kink in between would show as 1e-2


def check_plane(plane: PlaneBalance, x: Array, lam: float, mu: float, step: float) -> None:
    """The whole Jacobian in the plane of frequency and a second number, differenced by so much of that."""
    rng = np.random.default_rng(0)
    column, row, rhs = rng.standard_normal((3, x.size))
    here = plane.linearize(x, lam, mu)
    (dx,), (last,) = (part.T for part in here.solve(column, row, 0.3, rhs[:, None], np.array([0.7])))
    h = 1e-6 / np.abs(dx).max()
    secant = (plane.residual(x + h * dx, lam, mu) - plane.residual(x - h * dx, lam, mu)) / (2 * h)
    np.testing.assert_allclose(secant + column * last, rhs, atol=1e-6 * np.abs(rhs).max())
    by_lam = (plane.residual(x, lam + 1e-6, mu) - plane.residual(x, lam - 1e-6, mu)) / 2e-6
    by_mu = (plane.residual(x, lam, mu + step) - plane.residual(x, lam, mu - step)) / (2 * step)
    np.testing.assert_allclose(here.J_lam, by_lam, atol=1e-6 * np.abs(by_lam).max())
    np.testing.assert_allclose(here.J_mu, by_mu, atol=1e-6 * np.abs(by_mu).max())
