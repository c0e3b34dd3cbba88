"""Shapes that a deflection is fitted with, all clamped at x = 0 and pinned at x = L.

A deflection is ``shapes @ c + T h s_m + F s_F``: p free shapes without an end moment, and the static deflections under
the friction's moment at the tip and under the shaker's force. E I y''(L) = h T then holds whatever the coefficients c,
and the free shapes need not bend sharply where the two forces act: what is left to them is smooth.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import perm

import numpy as np
from scipy.linalg import null_space

from hbm.fourier import Array
from hbm.inverse.sensing import Sensing
from models.beam import Beam, wavenumbers

Functions = Callable[[Array, int], Array]
"""Functions of position: derivative `order` at positions (m,), (m, p)."""

TERMS = 3
"""Wavenumbers of the series (14)."""

INTERVALS = 12
DEGREE = 5
"""Pieces of the spline and their degree."""

GAUSS_POINTS = 8
"""Per piece; exact for products of two pieces of the spline."""


@dataclass(frozen=True, eq=False)
class Shapes:
    """Free shapes 0..p-1, then the static deflections per friction force and per excitation force.

    Attributes
    ----------
    omega : (p,) array
        Natural frequencies of the free shapes [rad/s].
    at_channels : (c, p+2) array
        Deflection at each channel.
    projection : (n, p+2) array
        Coordinates of the structure's modes.
    mass, damping, geometric : (p+2, p+2) arrays
        Int rho A y_i y_j, the damping of the modes, and Int y_i' y_j' dx.
    stiffness : (p+2, p+2) array
        Int E I y_i'' y_j'' dx less the work of the load that shape j stands for: nothing for the static ones.
    """

    omega: Array
    at_channels: Array
    projection: Array
    mass: Array
    damping: Array
    geometric: Array
    stiffness: Array

    @property
    def free(self) -> int:
        """Number p of free shapes."""
        return len(self.omega)


def modal_shapes(sensing: Sensing, modes: int) -> Shapes:
    """The first linear modes.

    Parameters
    ----------
    sensing : Sensing
    modes : int
        How many, at most those of the structure.

    Returns
    -------
    Shapes
        Integrals with a mode are exact; those of two static deflections are of as many modes as the structure has.
    """
    s = sensing.structure
    static = np.stack([s.slip_row, s.excitation], axis=1) / s.omega_n[:, None] ** 2
    beyond = np.array([s.residual.channels.get(name, (0.0, 0.0))[::-1] for name in sensing.channels])
    projection = np.hstack([np.eye(s.n)[:, :modes], static])
    elastic = projection.T * s.omega_n**2
    elastic = elastic @ projection
    elastic[:, modes:] = 0.0
    return Shapes(
        omega=s.omega_n[:modes],
        at_channels=np.hstack([sensing.rows[:, :modes], sensing.rows @ static + beyond]),
        projection=projection,
        mass=projection.T @ projection,
        damping=(projection.T * s.damping) @ projection,
        geometric=projection.T @ s.shortening @ projection,
        stiffness=elastic,
    )


def fitted_shapes(sensing: Sensing, beam: Beam, functions: Functions) -> Shapes:
    """Free shapes made of functions: the natural modes of the beam among them.

    Parameters
    ----------
    sensing : Sensing
        Sensing of a rig whose body is `beam`.
    beam : Beam
    functions : callable
        See :func:`series` and :func:`spline`.
    """
    rig, s = sensing.rig, sensing.structure
    drive, arm = rig.excitation.position, rig.contact.radius + beam.thickness / 2
    position = {c.name: c.position for c in rig.channels}
    channels = np.array([position[name] for name in sensing.channels])
    x, dx = _quadrature(beam.length, drive)
    omega, free = _natural(beam, functions, x, dx)

    def shapes(at: Array, order: int = 0) -> Array:
        return np.hstack(
            [functions(at, order) @ free, arm * by_moment(beam, at, order), by_force(beam, drive, at, order)]
        )

    y, slope = shapes(x), shapes(x, 1)
    weighted = beam.mass_per_length * dx[:, None] * y
    projection = beam.shapes(x).T @ weighted
    stiffness = np.zeros((y.shape[1], y.shape[1]))
    stiffness[:-2, :-2] = np.diag(omega**2)
    stiffness[-2, :-2] = arm * (functions(np.array([beam.length]), 1) @ free)[0]  # work of the end moment
    stiffness[-1, :-2] = (functions(np.array([drive]), 0) @ free)[0]
    return Shapes(
        omega=omega,
        at_channels=shapes(channels),
        projection=projection,
        mass=y.T @ weighted,
        damping=(projection.T * s.damping) @ projection,
        geometric=(slope.T * dx) @ slope if rig.contact.foreshortening else np.zeros_like(stiffness),
        stiffness=stiffness,
    )


def series(beam: Beam) -> Functions:
    """Trigonometric and hyperbolic functions (14) of the first clamped-pinned wavenumbers, held at the ends."""
    b = wavenumbers(TERMS) / beam.length

    def raw(x: Array, order: int) -> Array:
        z = b * x[:, None]
        grown, fallen = np.exp(z - b * beam.length), np.exp(-z)  # sinh and cosh, but scaled
        circular = (np.sin, np.cos, lambda a: -np.sin(a), lambda a: -np.cos(a))
        terms = [circular[order % 4](z), circular[(order + 1) % 4](z), grown, (-1) ** order * fallen]
        return np.asarray(np.hstack([b**order * term for term in terms]))

    return _held(beam, raw)


def spline(beam: Beam) -> Functions:
    """B-splines on equal pieces, held at the ends."""
    from scipy.interpolate import BSpline

    inner = np.linspace(0.0, beam.length, INTERVALS + 1)
    knots = np.concatenate([np.zeros(DEGREE), inner, np.full(DEGREE, beam.length)])
    basis = BSpline(knots, np.eye(INTERVALS + DEGREE), DEGREE)

    def raw(x: Array, order: int) -> Array:
        return np.asarray(basis(x, nu=order))

    return _held(beam, raw)


def by_moment(beam: Beam, x: Array, order: int = 0) -> Array:
    """Static deflection s_m per moment at the tip, or a derivative, (m, 1) [1/N at order 0]."""
    cubic = _power(x, 3, order) - beam.length * _power(x, 2, order)
    return np.asarray(cubic / (4 * beam.bending_stiffness * beam.length))[:, None]


def by_force(beam: Beam, at: float, x: Array, order: int = 0) -> Array:
    """Static deflection per force at `at`, or a derivative, (m, 1) [m/N at order 0]."""
    carried = float(beam.tip_load_shape(np.array(at)))
    cubic = (carried - 1.0) * _power(x, 3, order) + 3 * (at - beam.length * carried) * _power(x, 2, order)
    beyond = np.where(x > at, _power(x - at, 3, order), 0.0)
    return np.asarray((cubic + beyond) / (6 * beam.bending_stiffness))[:, None]


def _power(x: Array, n: int, order: int) -> Array:
    return np.asarray(perm(n, order) * x ** max(n - order, 0))


def _held(beam: Beam, raw: Functions) -> Functions:
    """Combinations of functions with y(0) = y'(0) = y(L) = y''(L) = 0."""
    L = beam.length
    start, end = np.array([0.0]), np.array([L])
    conditions = np.vstack([raw(start, 0), L * raw(start, 1), raw(end, 0), L**2 * raw(end, 2)])
    allowed = null_space(conditions)

    def held(x: Array, order: int) -> Array:
        return np.asarray(raw(x, order) @ allowed)

    return held


def _natural(beam: Beam, functions: Functions, x: Array, dx: Array) -> tuple[Array, Array]:
    """Frequencies and coefficients of the mass-normalised natural modes among functions."""
    curvature = np.sqrt(beam.bending_stiffness * dx)[:, None] * functions(x, 2)
    _, values, vectors = np.linalg.svd(curvature, full_matrices=False)
    unit_energy = vectors.T / values
    y = np.sqrt(beam.mass_per_length * dx)[:, None] * (functions(x, 0) @ unit_energy)
    _, periods, vectors = np.linalg.svd(y, full_matrices=False)
    return 1.0 / periods, np.asarray(unit_energy @ vectors.T / periods)


def _quadrature(length: float, drive: float) -> tuple[Array, Array]:
    """Gauss points and weights of the pieces of the spline, divided at the drive."""
    ends = np.unique(np.concatenate([np.linspace(0.0, length, INTERVALS + 1), [drive]]))
    nodes, weights = np.polynomial.legendre.leggauss(GAUSS_POINTS)
    half = np.diff(ends) / 2
    x = (ends[:-1] + half)[:, None] + half[:, None] * nodes
    return x.ravel(), (half[:, None] * weights).ravel()
