"""GMRES with many right sides at once beside a direct solution."""

import numpy as np
import pytest

from hbm.balance.krylov import solved
from hbm.fourier import Array

N, RIGHT = 40, 5


@pytest.fixture
def equations() -> tuple[Array, Array]:
    """A matrix near the identity, and right sides of different size."""
    rng = np.random.default_rng(3)
    return np.eye(N) + 0.6 * rng.standard_normal((N, N)) / np.sqrt(N), rng.standard_normal((RIGHT, N)) * 10.0 ** (
        np.arange(RIGHT)[:, None] - 2.0
    )


@pytest.mark.parametrize("most", [N, 12])
def test_every_right_side_is_solved_to_its_own_accuracy(equations: tuple[Array, Array], most: int) -> None:
    A, right = equations
    x, reached = solved(lambda v: v @ A.T, lambda v: v, right, 1e-9, most, 40)
    assert reached
    assert np.all(np.linalg.norm(x @ A.T - right, axis=1) <= 1.1e-9 * np.linalg.norm(right, axis=1))


def test_a_preconditioner_that_is_the_inverse_leaves_one_step(equations: tuple[Array, Array]) -> None:
    A, right = equations
    inverse = np.linalg.inv(A)
    x, reached = solved(lambda v: v @ A.T, lambda v: v @ inverse.T, right, 1e-9, 1, 1)
    assert reached
    np.testing.assert_allclose(x, right @ inverse.T, atol=1e-8 * np.abs(right).max())


def test_too_few_directions_are_said_not_to_suffice(equations: tuple[Array, Array]) -> None:
    A, right = equations
    assert not solved(lambda v: v @ A.T, lambda v: v, right, 1e-9, 4, 1)[1]


def test_a_right_side_of_nothing_has_the_solution_of_nothing(equations: tuple[Array, Array]) -> None:
    A, right = equations
    right[2] = 0.0
    x, reached = solved(lambda v: v @ A.T, lambda v: v, right, 1e-9, N, 2)
    assert reached and not x[2].any()
    assert np.isfinite(x).all()
