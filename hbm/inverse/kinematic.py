"""Formulations that fit the deflection first: shapes through the sensors, then the balance of forces for friction.

In :func:`~hbm.inverse.contactforce.regularised` the motion is what the forces make of it. Here it is read off the
sensors, harmonic by harmonic, as free shapes and the static deflections under the end moment h T and under the force
(:mod:`hbm.inverse.shapes`). Inserted in the balance of forces, tested with several functions, the fit gives several
equations for the same T, weighed by their covariance: that of the fit, by noise and by what the sensors leave open of
the shapes. Fit and balance share one T, so that E I y''(L) = h T is exact.

- :func:`modal`: free shapes and test functions are linear modes, (3) and (4).
- :func:`nnm` and :func:`nnm_spline`: test functions are the fitted forms of the harmonics (nonlinear normal modes),
  (6) to (13); free shapes are the series (14), or a spline.

The static deflection under the measured force is not in (14). It has the step of y''' at the shaker that smooth shapes
have not: without it five modes miss the slip by twice as much or more.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hbm.errors import InputError
from hbm.fourier import Array
from hbm.inverse.contactforce import (
    COUPLED,
    MOST_ITERATIONS,
    ForceEstimate,
    Solution,
    most_likely,
    nonlinear_forces,
    product,
)
from hbm.inverse.sensing import Complex, Sensing
from hbm.inverse.shapefit import Fit, fit_of, hermitian, likely_sizes, times
from hbm.inverse.shapes import Functions, Shapes, fitted_shapes, modal_shapes, series, spline
from models.beam import Beam

DISTINCT = 1e-8
"""Test functions are kept down to this share of the strongest."""

ROUNDING = 1e-11
"""Relative variance that keeps equations apart that differ by less."""


def modal(sensing: Sensing, mean: Array) -> ForceEstimate:
    """Friction force by linear modes through the sensors, inserted in (4).

    Modes are one less than the sensors, at most; how much of the upper ones there is, the noise decides.

    Parameters
    ----------
    sensing : Sensing
    mean : (r,) array
        Mean friction [N].
    """
    most = max(1, min(sensing.structure.n, len(sensing.channels) - 1))
    shapes = modal_shapes(sensing, most)
    fit = fit_of(sensing, shapes, likely_sizes(sensing, shapes))
    tests = np.eye(most, most + 2)[None, None]
    return most_likely(sensing, lambda expected, _: _solve(sensing, fit, tests, expected, mean))


def nnm(sensing: Sensing, mean: Array) -> ForceEstimate:
    """Friction force by nonlinear normal modes, forms of the series (14).

    Parameters
    ----------
    sensing : Sensing
    mean : (r,) array
        Mean friction [N].

    Raises
    ------
    InputError
        If the rig is not a beam.
    """
    return _by_forms(sensing, mean, "nnm", series)


def nnm_spline(sensing: Sensing, mean: Array) -> ForceEstimate:
    """Friction force by nonlinear normal modes, forms of a smoothing spline; as :func:`nnm`."""
    return _by_forms(sensing, mean, "nnm-spline", spline)


def _by_forms(sensing: Sensing, mean: Array, name: str, family: Callable[[Beam], Functions]) -> ForceEstimate:
    beam = sensing.rig.beam
    if beam is None:
        raise InputError(
            f'reconstruct: formulation = "{name}", but the rig is given by [modal]; must be regularised or modal there'
        )
    shapes = fitted_shapes(sensing, beam, family(beam))
    fit = fit_of(sensing, shapes, likely_sizes(sensing, shapes))
    first = fit.coefficients(np.stack([np.zeros_like(sensing.force), sensing.force], axis=2))

    def solve(expected: Array, before: "_Solution | None") -> _Solution:
        forms = _forms(shapes, first if before is None else before.coefficients)
        return _solve(sensing, fit, forms, expected, mean)

    return most_likely(sensing, solve)


def _forms(shapes: Shapes, coefficients: Complex) -> Array:
    """Test functions that span the cosine and the sine forms of the harmonics, (r, 1, t, p+2).

    Weighed by their covariance, the equations of two sets of test functions that span the same say the same: they are
    made orthonormal in mass, (11) and (13). c sensors tell c + 2 forms apart, the static ones among them. More test
    functions than free shapes would fix the shapes and leave the error of the series, which no covariance knows, to T.
    """
    forms = np.concatenate([coefficients[:, 1:].real, coefficients[:, 1:].imag], axis=1)
    mass = np.sqrt(np.einsum("rti,ij,rtj->rt", forms, shapes.mass, forms))
    forms = forms / np.where(mass > 0.0, mass, 1.0)[..., None]
    values, vectors = np.linalg.eigh(forms @ shapes.mass @ forms.swapaxes(1, 2))
    most = min(len(shapes.at_channels) + 2, shapes.free)
    values, vectors = values[:, -most:], vectors[..., -most:]
    kept = values > DISTINCT * values[:, -1:]
    scaled = np.where(kept, 1.0 / np.sqrt(np.where(kept, values, 1.0)), 0.0)[:, None] * vectors
    return np.asarray(scaled.swapaxes(1, 2) @ forms)[:, None]


# ---- the balance


@dataclass(frozen=True, eq=False)
class _Equations:
    """Balance of forces of a fit, tested: ``by_z z + by_error xi + known + tests coupling = 0``.

    xi are the errors of the fit, of unit variance.

    Attributes
    ----------
    by_z : (r, H+1, t, 2) complex array
    by_error : (r, H+1, t, p) complex array
    known : (r, H+1, t) complex array
        Coefficients that were measured.
    whiten : (r, H+1, t, t) complex array
        Makes the errors independent, of unit variance.
    """

    by_z: Complex
    by_error: Complex
    known: Complex
    whiten: Complex


@dataclass(frozen=True, eq=False)
class _Solution(Solution):
    """A solution with the coefficients of all shapes, (r, H+1, p+2); the last two are friction and force."""

    coefficients: Complex


def _equations(sensing: Sensing, fit: Fit, tests: Array) -> _Equations:
    s, shapes = sensing.i_omega[..., None, None], fit.shapes
    seen = np.asarray(sensing.weight.any(axis=2))[..., None, None]
    rows = np.where(seen, tests @ (s**2 * shapes.mass + s * shapes.damping + shapes.stiffness), 0.0)
    by_free = rows[..., : shapes.free] * fit.size[:, :, None]
    by_error = by_free @ fit.root
    deviation = np.linalg.norm(by_error, axis=3)
    usable = deviation > 0.0
    scale = 1.0 / np.where(usable, deviation, 1.0)[..., None]
    correlation = (scale * by_error) @ hermitian(scale * by_error)
    correlation += np.where(usable, ROUNDING, 1.0)[..., None] * np.eye(correlation.shape[2])
    return _Equations(
        by_z=rows[..., shapes.free :] - by_free @ fit.gain @ fit.static,
        by_error=by_error,
        known=times(by_free @ fit.gain, fit.y),
        whiten=np.asarray(np.linalg.inv(np.linalg.cholesky(correlation)) * scale.swapaxes(2, 3), dtype=np.complex128),
    )


def _solve(sensing: Sensing, fit: Fit, tests: Array, expected: Array, mean: Array) -> _Solution:
    """Friction and force by generalised least squares, each of an expected size, and the shapes that go with them."""
    balance = _equations(sensing, fit, tests)
    size = np.stack([expected, sensing.force_std], axis=2)
    A = balance.whiten @ (balance.by_z * size[:, :, None])
    inverse = np.linalg.inv(np.eye(2) + hermitian(A) @ A)
    gain = inverse @ hermitian(A) @ balance.whiten
    given = np.stack([np.zeros_like(sensing.force), sensing.force], axis=2)
    right = -balance.known - times(balance.by_z, given)
    seen = np.asarray(sensing.weight.any(axis=2))[..., None]
    coupling = np.zeros((*sensing.i_omega.shape, fit.shapes.free + 2), dtype=complex)
    for _ in range(MOST_ITERATIONS):
        z = given + size * times(gain, right - np.where(seen, times(tests, coupling), 0.0))
        z[:, 0, 0] = mean
        coefficients = fit.coefficients(z)
        before, coupling = coupling, product(z[..., :1], coefficients) @ fit.shapes.geometric
        if np.abs(coupling - before).max() <= COUPLED * np.abs(coupling).max():
            break
    by_z = size[..., None] * np.concatenate([-gain @ balance.by_error, inverse], axis=3)
    return _with_uncertainty(sensing, fit, coefficients, by_z)


def _with_uncertainty(sensing: Sensing, fit: Fit, coefficients: Complex, by_z: Complex) -> _Solution:
    """Deviations of the shapes from those of friction and force, `by_z` (r, H+1, 2, p+2)."""
    shapes, seen = fit.shapes, sensing.weight > 0.0
    fitted = np.concatenate([fit.root, np.zeros_like(by_z).swapaxes(2, 3)[..., : shapes.free, :]], axis=3)
    moved = fit.static @ by_z
    by_all = np.concatenate([fit.size[..., None] * (fitted - fit.gain @ moved), by_z], axis=2)
    hat = fit.free @ fit.gain
    followed = np.einsum("rkcc->rkc", hat).real - np.sum(np.abs(moved - hat @ moved) ** 2, axis=3)
    left = fit.y - times(fit.static, coefficients[..., shapes.free :])
    friction, force = coefficients[..., -2], coefficients[..., -1]
    q = coefficients @ shapes.projection.T
    structure = sensing.structure  # no sensor sees the static deflection
    constant = friction[:, :1] * structure.slip_row + nonlinear_forces(sensing, friction, q)[:, 0]
    q[:, 0] = constant / structure.omega_n**2
    return _Solution(
        coefficients=coefficients,
        friction=friction,
        force=force,
        q=q,
        factor=np.concatenate([by_z, shapes.projection @ by_all], axis=2),
        residual=np.where(seen, left - times(hat, left), 0.0),
        leverage=np.where(seen, followed, 0.0),
        resolution=np.where(seen.any(axis=2), np.linalg.norm(by_z[:, :, 0], axis=2), np.inf),
    )
