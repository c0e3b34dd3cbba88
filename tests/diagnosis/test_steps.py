"""Steps of least squares beside bounds."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from hbm.outputerror.fit import bounded_step

STEP = 0.7
"""Longest step of a coordinate where steps are bounded."""


def _problem(seed: int, n: int = 6) -> tuple[SimpleNamespace, np.ndarray]:
    """A linear model that is evaluated somewhere, and its step of least squares without bounds."""
    rng = np.random.default_rng(seed)
    J, x = rng.normal(size=(30, n)), 26.0 + rng.normal(size=n)
    J[:, 1:] += 0.7 * J[:, :1]
    residual = J @ rng.normal(size=n) + 0.1 * rng.normal(size=30)
    free = [SimpleNamespace(std=np.inf, form="log")] * n
    low, high = np.full(n, -np.inf), np.full(n, np.inf)
    here = SimpleNamespace(
        model=SimpleNamespace(free=free, bounds=lambda: (low, high)),
        white=SimpleNamespace(jacobian=J, residual=residual),
        pulls=np.zeros(n),
        information=J.T @ J,
        expected=np.zeros((n, n)),
        x=x,
    )
    return here, np.linalg.lstsq(J, residual, rcond=None)[0]


def _promise(here: SimpleNamespace, step: np.ndarray) -> float:
    missed = here.white.residual - here.white.jacobian @ step
    return float(here.white.residual @ here.white.residual - missed @ missed)


@pytest.mark.parametrize("seed", range(8))
def test_coordinates_that_reach_no_bound_make_the_best_of_one_that_does(seed: int) -> None:
    """None is taken for one at its bound because x + step - x is not step, to rounding."""
    here, whole = _problem(seed)
    low, high = here.model.bounds()
    bound = int(np.argmax(np.abs(whole)))
    ends = low if whole[bound] < 0.0 else high
    ends[bound] = here.x[bound] + 0.4 * whole[bound]
    step, promised = bounded_step(here)
    best = lsq_linear(here.white.jacobian, here.white.residual, bounds=(low - here.x, high - here.x), tol=1e-14)
    np.testing.assert_allclose(step, best.x, rtol=0.0, atol=1e-6)
    assert promised == pytest.approx(_promise(here, step))


@pytest.mark.parametrize("seed", range(8))
def test_a_long_step_is_the_best_of_all_that_are_not(seed: int) -> None:
    """Where several coordinates would go farther, no step within the box does better, and many do worse."""
    here, whole = _problem(seed)
    here.white.residual = 3.0 * here.white.residual
    assert np.sum(np.abs(3.0 * whole) > STEP) > 1
    step, promised = bounded_step(here, most=STEP)
    assert np.abs(step).max() <= STEP * (1.0 + 1e-12)
    assert promised == pytest.approx(_promise(here, step))
    others = np.random.default_rng(seed).uniform(-STEP, STEP, (2000, len(step)))
    corner = np.clip(3.0 * whole, -STEP, STEP)
    assert promised >= max(_promise(here, other) for other in [*others, corner])
