"""Steps of least squares beside bounds."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from hbm.outputerror.fit import bounded_step


@pytest.mark.parametrize("seed", range(8))
def test_coordinates_that_reach_no_bound_make_the_best_of_one_that_does(seed: int) -> None:
    """None is taken for one at its bound because x + step - x is not step, to rounding."""
    rng = np.random.default_rng(seed)
    n = 6
    J, x = rng.normal(size=(30, n)), 26.0 + rng.normal(size=n)
    J[:, 1:] += 0.7 * J[:, :1]
    residual = J @ rng.normal(size=n) + 0.1 * rng.normal(size=30)
    free = [SimpleNamespace(std=np.inf)] * n
    whole = np.linalg.lstsq(J, residual, rcond=None)[0]
    low, high = np.full(n, -np.inf), np.full(n, np.inf)
    bound = int(np.argmax(np.abs(whole)))
    ends = low if whole[bound] < 0.0 else high
    ends[bound] = x[bound] + 0.4 * whole[bound]
    here = SimpleNamespace(
        model=SimpleNamespace(free=free, bounds=lambda: (low, high)),
        white=SimpleNamespace(jacobian=J, residual=residual),
        pulls=np.zeros(n),
        information=J.T @ J,
        expected=np.zeros((n, n)),
        x=x,
    )
    step, promised = bounded_step(here)
    best = lsq_linear(J, residual, bounds=(low - x, high - x), tol=1e-14)
    np.testing.assert_allclose(step, best.x, rtol=0.0, atol=1e-6)
    assert promised == pytest.approx(float(residual @ residual - np.sum((residual - J @ step) ** 2)))
