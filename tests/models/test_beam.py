"""Clamped-pinned beam modes against closed forms and an independent formula."""

import numpy as np
import pytest

from models import Beam
from models.beam import unit_shapes, wavenumbers
from models.published import PAPER_BEAM


def gauss(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights on 0..1."""
    nodes, weights = np.polynomial.legendre.leggauss(n)
    return (nodes + 1) / 2, weights / 2


def naive_shape(b: float, xi: np.ndarray, order: int) -> np.ndarray:
    """Textbook form cosh - cos - sigma (sinh - sin) and derivatives, good for low modes only."""
    z = b * xi
    sigma = (np.cosh(b) - np.cos(b)) / (np.sinh(b) - np.sin(b))
    hyperbolic = (np.cosh(z), np.sinh(z))
    circular = (np.cos(z), -np.sin(z), -np.cos(z), np.sin(z))
    even = hyperbolic[order % 2] - circular[order]
    # d^k sin = (sin, cos, -sin, -cos), d^k sinh alternates with cosh
    odd = hyperbolic[(order + 1) % 2] - (np.sin(z), np.cos(z), -np.sin(z), -np.cos(z))[order]
    return b**order * (even - sigma * odd)


def test_paper_frequencies_to_five_digits() -> None:
    hz = PAPER_BEAM.natural_frequencies() / (2 * np.pi)
    printed = [47.842, 155.04, 323.48, 553.16, 844.10]  # docs/theory/equations.md section 2, Table 1
    assert [float(f"{f:.5g}") for f in hz] == printed


def test_wavenumbers_are_the_roots_of_tan_equals_tanh() -> None:
    b = wavenumbers(80)
    # residual of the bounded form; an error of one ulp of b = 250 is 3e-14
    assert np.abs(np.sin(b) - np.cos(b) * np.tanh(b)).max() < 1e-13
    assert b[0] == pytest.approx(3.9266023120479, rel=1e-13)  # Blevins, clamped-pinned
    np.testing.assert_allclose(b[10:], (np.arange(11, 81) + 0.25) * np.pi, rtol=1e-15)


@pytest.mark.parametrize("modes", [5, 50, 80])
def test_shapes_are_finite_and_orthonormal_however_many(modes: int) -> None:
    xi, weights = gauss(4 * modes + 40)
    phi = unit_shapes(wavenumbers(modes), xi)
    assert np.isfinite(phi).all()
    np.testing.assert_allclose((phi.T * weights) @ phi, np.eye(modes), atol=1e-8)


@pytest.mark.parametrize("modes", [5, 50, 80])
def test_curvatures_are_orthogonal_too(modes: int) -> None:
    xi, weights = gauss(4 * modes + 40)
    b = wavenumbers(modes)
    curvature = unit_shapes(b, xi, 2) / b**2
    np.testing.assert_allclose((curvature.T * weights) @ curvature, np.eye(modes), atol=1e-8)


def test_mass_normalised() -> None:
    beam = Beam(length=0.7, width=0.03, thickness=0.006, youngs_modulus=70e9, density=2700.0, modes=12)
    xi, weights = gauss(100)
    phi = beam.shapes(beam.length * xi)
    mass = 2700.0 * 0.03 * 0.006 * 0.7 * (phi.T * weights) @ phi
    np.testing.assert_allclose(mass, np.eye(12), atol=1e-11)


@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_low_modes_agree_with_the_textbook_formula(order: int) -> None:
    b = wavenumbers(5)
    xi = np.linspace(0.0, 1.0, 41)
    ours = unit_shapes(b, xi, order)
    for i, b_i in enumerate(b):
        textbook = naive_shape(b_i, xi, order)
        # same sign at the pin, where the slope never vanishes; cosh b = 3e7 at mode 5 costs the naive form 8 digits
        sign = np.sign(naive_shape(b_i, np.ones(1), 1)[0] * unit_shapes(b[i : i + 1], np.ones(1), 1)[0, 0])
        np.testing.assert_allclose(ours[:, i], sign * textbook, atol=1e-8 * b_i**order)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_derivatives_are_derivatives(order: int) -> None:
    b, step = wavenumbers(8), 1e-5
    xi = np.linspace(0.01, 0.99, 30)
    slope = (unit_shapes(b, xi + step, order) - unit_shapes(b, xi - step, order)) / (2 * step)
    # truncation (b step)^2 / 6 = 1e-8 at mode 8, rounding 1e-11
    np.testing.assert_allclose(slope, unit_shapes(b, xi, order + 1), atol=1e-7 * b[-1] ** (order + 1))


@pytest.mark.parametrize("modes", [1, 5, 80])
def test_boundary_conditions_clamped_and_pinned(modes: int) -> None:
    b = wavenumbers(modes)
    clamp, pin = np.zeros(1), np.ones(1)
    assert np.abs(unit_shapes(b, clamp)).max() < 1e-12
    assert np.abs(unit_shapes(b, clamp, 1) / b).max() < 1e-12
    assert np.abs(unit_shapes(b, pin)).max() < 1e-12
    assert np.abs(unit_shapes(b, pin, 2) / b**2).max() < 1e-12


def test_tip_load_shape_is_a_cantilever_under_a_tip_force() -> None:
    L = PAPER_BEAM.length
    x = np.linspace(0.0, L, 11)
    s = PAPER_BEAM.tip_load_shape(x)
    assert (s[0], s[-1]) == pytest.approx((0.0, 1.0), abs=1e-15)
    np.testing.assert_allclose(PAPER_BEAM.tip_load_shape(x, 1), 1.5 / L * (2 * x / L - (x / L) ** 2), rtol=1e-13)
    step = 1e-6
    numeric = (PAPER_BEAM.tip_load_shape(x + step) - PAPER_BEAM.tip_load_shape(x - step)) / (2 * step)
    np.testing.assert_allclose(numeric, PAPER_BEAM.tip_load_shape(x, 1), atol=1e-8)
