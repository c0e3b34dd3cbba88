"""Identities of the Fourier basis."""

import numpy as np
import pytest

from hbm.fourier import FourierBasis


@pytest.fixture
def basis() -> FourierBasis:
    return FourierBasis(7, 64)


def random_series(basis: FourierBasis, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=basis.size)


def test_analysis_inverts_synthesis(basis):
    assert basis.analysis @ basis.synthesis == pytest.approx(np.eye(basis.size), abs=1e-14)


def test_order_of_coefficients_is_the_contract():
    basis = FourierBasis(3, 32)
    samples = 2.0 + 3.0 * np.cos(2 * basis.theta) + 5.0 * np.sin(3 * basis.theta)
    assert basis.analysis @ samples == pytest.approx([2, 0, 3, 0, 0, 0, 5], abs=1e-14)


def test_derivative_of_samples(basis):
    a = random_series(basis, 0)
    by_hand = sum(-k * a[k] * np.sin(k * basis.theta) + k * a[7 + k] * np.cos(k * basis.theta) for k in range(1, 8))
    assert basis.synthesis @ basis.derivative(a) == pytest.approx(by_hand, abs=1e-12)


def test_derivative_on_right_is_a_matrix_product(basis):
    M = np.random.default_rng(1).normal(size=(4, basis.size))
    assert basis.derivative_on_right(M) == pytest.approx(M @ basis.derivative(np.eye(basis.size)), abs=1e-13)


def test_multiplication_is_the_truncated_product(basis):
    a, b = random_series(basis, 2), random_series(basis, 3)
    product = basis.analysis @ ((basis.synthesis @ a) * (basis.synthesis @ b))  # 64 samples: no aliasing below 8
    assert basis.multiplication(a) @ b == pytest.approx(product, abs=1e-13)


def test_multiplication_of_several_series(basis):
    a = np.random.default_rng(4).normal(size=(basis.size, 3))
    several = basis.multiplication(a)
    assert all(np.array_equal(several[..., j], basis.multiplication(a[:, j])) for j in range(3))


def test_exact_products_do_not_alias(basis):
    fine = basis.exact_products
    a, b = random_series(basis, 5), random_series(basis, 6)
    sampled = fine.analysis @ ((fine.synthesis @ a) * (fine.synthesis @ b))
    assert sampled == pytest.approx(basis.multiplication(a) @ b, abs=1e-13)


def test_complex_amplitudes_round_trip(basis):
    a = random_series(basis, 7)
    assert basis.real(basis.complex(a)) == pytest.approx(a, abs=1e-15)
    amplitude = basis.complex(a)
    samples = np.real(sum(amplitude[k] * np.exp(1j * k * basis.theta) for k in range(8)))
    assert samples == pytest.approx(basis.synthesis @ a, abs=1e-13)


@pytest.mark.parametrize(("H", "N_t"), [(0, 8), (4, 8), (-1, 3)])
def test_too_few_samples_are_refused(H, N_t):
    with pytest.raises(ValueError, match=f"H = {H}, N_t = {N_t}; must have"):
        FourierBasis(H, N_t)


def test_one_object_for_one_basis_whatever_is_asked_for_next():
    basis = FourierBasis(3, 16)
    assert FourierBasis(3, 16) is basis
    assert FourierBasis(np.int64(3), 16) is not basis
    assert type(basis.H) is int
    with pytest.raises(ValueError, match="N_t > 2 H"):
        FourierBasis(3, 6)
