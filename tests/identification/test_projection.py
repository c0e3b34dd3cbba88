"""Flexibilities eliminated beside poles and turns, by dense least squares and by differences."""

from collections.abc import Iterator
from itertools import product

import numpy as np
import pytest

from hbm.identification.projection import REST, Projection

POLES = np.array([[20.0, 0.01], [31.0, 0.004]])
TURNS = np.array([0.1, 0.0, 0.2])
"""A phase of the force, and the delay of each channel."""


@pytest.fixture(params=product((0.0, 3.0), (False, True)), ids=lambda p: f"force errs {p[0]:g}, free {p[1]}")
def weighted(request: pytest.FixtureRequest) -> Projection:
    """Two channels of two modes and noise; some of one were not measured."""
    rng = np.random.default_rng(1)
    omega = 2 * np.pi * np.linspace(15.0, 40.0, 60)
    motion = (1j * omega[:, None]) ** np.array([2, 1]) * np.array([1.0, 50.0])
    motion[:5, 1] = 0.0
    true = Projection(omega, motion, motion, 0.0 * motion).answer(POLES, TURNS, rng.standard_normal((2, 2 + REST)))
    real, imaginary = rng.standard_normal((2, *true.shape))
    measured = true + 0.003 * np.abs(true).max() * (real + 1j * imaginary) * (motion != 0.0)
    errs, free = request.param
    return Projection(omega, motion, measured, errs * measured / np.abs(measured).max(), free=free)


def unit(weighted: Projection, j: int, q: int) -> np.ndarray:
    out = np.zeros((2, weighted.size(2)))
    out[j, q] = 1.0
    return out


def columns(weighted: Projection) -> Iterator[np.ndarray]:
    """What each flexibility does, whitened, real parts and imaginary ones."""
    for j, q in product(range(2), range(weighted.size(2))):
        z = weighted.whitened(weighted.answer(POLES, TURNS, unit(weighted, j, q)))
        yield np.concatenate([z.real.ravel(), z.imag.ravel()])


def test_flexibilities_are_those_of_dense_least_squares(weighted: Projection) -> None:
    z = weighted.whitened(weighted.measured)
    A, b = np.column_stack(list(columns(weighted))), np.concatenate([z.real.ravel(), z.imag.ravel()])
    size = np.linalg.norm(A, axis=0)
    expected = np.linalg.lstsq(A / size, b, rcond=None)[0] / size
    assert weighted.flexibilities(POLES, TURNS).ravel() == pytest.approx(expected, rel=1e-6)


def test_what_is_whitened_has_the_noise_1() -> None:
    """Covariance 1 + b b^H of real and imaginary parts, by its inverse."""
    rng = np.random.default_rng(2)
    b = rng.standard_normal((1, 3)) + 1j * rng.standard_normal((1, 3))
    none = np.zeros((1, 3), dtype=complex)
    W = np.column_stack([Projection(np.ones(1), none, none, b).whitened(one[None]).ravel() for one in np.eye(3)])
    assert W.conj().T @ W == pytest.approx(np.linalg.inv(np.eye(3) + b.T @ b.conj()))


def test_slopes_are_differences(weighted: Projection) -> None:
    flexibility, step = weighted.flexibilities(POLES, TURNS), 1e-6

    def answer(moved: np.ndarray) -> np.ndarray:
        poles = POLES * np.exp(moved[:4].reshape(2, 2).T)
        return weighted.answer(poles, TURNS + moved[4:], flexibility)

    expected = [(answer(step * one) - answer(-step * one)) / (2 * step) for one in np.eye(7)]
    found = weighted.slopes(POLES, TURNS, flexibility)
    assert found == pytest.approx(np.stack(expected, axis=2), abs=1e-6 * np.abs(found).max())


@pytest.mark.parametrize("sought", [(True, False, False), (False, True, True)], ids=["a phase", "delays"])
def test_no_poles_or_turns_near_those_found_fit_better(sought: tuple[bool, ...], weighted: Projection) -> None:
    moving = np.append(np.ones(4, dtype=bool), np.array(sought) & (not weighted.free))  # else phases are their own

    def misfit(poles: np.ndarray, turns: np.ndarray) -> float:
        left = weighted.measured - weighted.answer(poles, turns, weighted.flexibilities(poles, turns))
        return float(np.sum(np.abs(weighted.whitened(left)) ** 2))

    poles, turns = weighted.fitted(POLES * 1.002, np.zeros(3), moving[4:])
    least = misfit(poles, turns)
    for i, by in product(np.flatnonzero(moving), (-1e-3, 1e-3)):
        moved = by * np.eye(7)[i]
        assert misfit(poles * np.exp(moved[:4].reshape(2, 2).T), turns + moved[4:]) > least


def test_the_misfit_over_delays_is_that_of_each(weighted: Projection) -> None:
    alone = Projection(weighted.omega, weighted.motion, weighted.measured, 0.0 * weighted.motion, free=weighted.free)
    delays = np.linspace(-3.0, 3.0, 5)
    for j in range(2):
        found = alone.misfits(POLES, j, delays - 0.3, np.array([0.1, 0.3]))[:, 1]
        for delay, misfit in zip(delays, found, strict=True):
            turns = np.append(0.0, np.full(2, delay))
            left = alone.measured - alone.answer(POLES, turns, alone.flexibilities(POLES, turns))
            assert misfit == pytest.approx(np.sum(np.abs(left[:, j]) ** 2), rel=1e-6)
