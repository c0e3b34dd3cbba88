"""Shapes through the sensors, harmonic by harmonic, for any friction and force: a regularised linear fit.

How large the free shapes may be is for the measurement to say: it is what makes the measurement likely. So more shapes
than sensors do no harm, and weak harmonics are not fitted with shapes that only noise would need.
"""

from dataclasses import dataclass

import numpy as np

from hbm.fourier import Array
from hbm.inverse.contactforce import AS_LIKELY
from hbm.inverse.sensing import Complex, Sensing
from hbm.inverse.shapes import Shapes

FREE = 100.0
"""Friction that is unknown may explain up to this many times what the sensors saw."""

SIZES = np.logspace(-4, 2, 31)
"""Sizes of the free shapes that are tried, relative to one that explains all that the sensors saw."""

POWER = 2
"""At a harmonic of frequency Omega a free shape of frequency omega is expected as large as (omega^2 + Omega^2)^(-p/2):
p = 2 is the same load for all shapes, p = 1 the same energy of bending and motion."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Shapes through the sensors for any friction and force z.

    Free coefficients, in units of `size`, are ``gain (y - static z)``, with covariance ``root root^H``.

    Attributes
    ----------
    shapes : Shapes
    size : (r, H+1, p) array
        Expected size of the free coefficients.
    free, static : (r, H+1, c, p) and (r, H+1, c, 2) complex arrays
        Weighted responses to the free coefficients and to z.
    y : (r, H+1, c) complex array
        Weighted measurements.
    gain, root : (r, H+1, p, c) and (r, H+1, p, p) complex arrays
    """

    shapes: Shapes
    size: Array
    free: Complex
    static: Complex
    y: Complex
    gain: Complex
    root: Complex

    def coefficients(self, z: Complex) -> Complex:
        """Coefficients of all shapes, (r, H+1, p+2)."""
        return np.concatenate([self.size * times(self.gain, self.y - times(self.static, z)), z], axis=2)


def fit_of(sensing: Sensing, shapes: Shapes, size: Array) -> Fit:
    """Fit shapes whose free coefficients are expected of a size (r, H+1, p)."""
    columns = _columns(sensing, shapes)
    free, static = columns[..., : shapes.free] * size[:, :, None], columns[..., shapes.free :]
    left, values, right = np.linalg.svd(free, full_matrices=True)
    m, vectors = values.shape[2], hermitian(right)
    seen = np.zeros(size.shape)
    seen[..., :m] = values
    root = vectors / np.sqrt(1.0 + seen**2)[:, :, None]
    gain = (vectors[..., :m] * (values / (1.0 + values**2))[:, :, None]) @ hermitian(left[..., :m])
    return Fit(shapes, size, free, static, sensing.weight * sensing.measured, gain, root)


def _columns(sensing: Sensing, shapes: Shapes) -> Complex:
    """Weighted response of each channel per shape, (r, H+1, c, p+2)."""
    return np.asarray((sensing.weight * sensing.factor)[..., None] * shapes.at_channels)


def _explaining(columns: Complex, y: Complex) -> Array:
    """Size of coefficients that explains all that the sensors saw, (r, H+1)."""
    response, seen = np.linalg.norm(columns, axis=(2, 3)), np.linalg.norm(y, axis=2)
    some = (response > 0.0) & (seen > 0.0)
    return np.asarray(np.where(some, seen / np.where(some, response, 1.0), 1.0))


def likely_sizes(sensing: Sensing, shapes: Shapes) -> Array:
    """Largest sizes of free coefficients that are as likely as the most likely ones, friction unknown, (r, H+1, p)."""
    decay = (shapes.omega**2 + np.abs(sensing.i_omega[..., None]) ** 2) ** (-POWER / 2) * shapes.omega[0] ** POWER
    columns = _columns(sensing, shapes)
    free, static = columns[..., : shapes.free] * decay[:, :, None], columns[..., shapes.free :]
    y = sensing.weight * sensing.measured - times(static[..., 1:], sensing.force[..., None])
    length = np.linalg.norm(static, axis=2)
    most = FREE * (1.0 + np.linalg.norm(y, axis=2))
    spread = np.stack([most, np.minimum(most, length[..., 1] * sensing.force_std)], axis=2)
    unknown = static * (spread / np.where(length > 0.0, length, 1.0))[:, :, None]
    left, values, _ = np.linalg.svd(unknown, full_matrices=False)
    shrink = (left * (1.0 - 1.0 / np.sqrt(1.0 + values**2))[:, :, None]) @ hermitian(left)
    left, values, _ = np.linalg.svd(free - shrink @ free, full_matrices=False)
    part = np.abs(times(hermitian(left), y - times(shrink, y))) ** 2
    tried = SIZES[:, None, None] * _explaining(free, y)
    variance = 1.0 + (tried[..., None] * values) ** 2
    likelihood = np.sum(-np.log(variance) - part / (2.0 * variance), axis=3)  # cos and sin
    likely = likelihood >= likelihood.max(axis=0) - AS_LIKELY
    last = len(tried) - 1 - likely[::-1].argmax(axis=0)
    return np.asarray(np.take_along_axis(tried, last[None], axis=0)[0][..., None] * decay)


def times(matrix: Complex | Array, vector: Complex) -> Complex:
    """Matrices times vectors."""
    return np.asarray((matrix @ vector[..., None])[..., 0])


def hermitian(matrix: Complex) -> Complex:
    """Conjugate transposes."""
    return np.asarray(matrix.conj().swapaxes(2, 3))
