"""Clamped-pinned Euler-Bernoulli beam: natural modes in closed form."""

from collections.abc import Iterator
from dataclasses import dataclass
from types import ModuleType
from typing import Any, ClassVar

import numpy as np

from models.bounds import bounded
from models.plausible import Proportion, plain, plausible
from models.structure import Array

MEASURES = ("length", "width", "thickness", "youngs_modulus", "density")


def wavenumbers(modes: int) -> Array:
    """Roots b_i = beta_i L of tan b = tanh b, the clamped-pinned wavenumbers.

    Parameters
    ----------
    modes : int
        How many, >= 1.

    Returns
    -------
    (modes,) array
        Ascending roots, accurate to rounding for any number of modes [-].
    """
    cell = np.pi * np.arange(1, modes + 1)
    b = cell + np.pi / 4
    for _ in range(8):  # contraction by 1e-3 for the first root, 1e-6 for the second...
        b = cell + np.arctan(np.tanh(b))
    return np.asarray(b)


def unit_shapes(b: Array, xi: Array, order: int = 0) -> Array:
    """Clamped-pinned shapes of unit mean square and their derivatives.

    Written with sinh(b - z)/sinh b and sin(b - z)/sin b, z = b xi, which vanish at the pin term by
    term: nothing large is subtracted from anything large, whatever the mode.

    Parameters
    ----------
    b : (n,) array
        Wavenumbers from :func:`wavenumbers`.
    xi : (m,) array
        Positions x / L, 0..1.
    order : int
        Derivative with respect to xi, 0..3.

    Returns
    -------
    (m, n) array
        d^order phi_i / d xi^order; the integral of phi_i^2 over 0..1 is 1.
    """
    return np.asarray(shapes_of_waves(b, b * (1.0 - np.asarray(xi, dtype=float)[:, None]), order, np))


def shapes_of_waves(b: Any, s: Any, order: int, functions: ModuleType) -> Any:
    """:func:`unit_shapes` in the variable s = b (1 - xi), elementwise.

    Parameters
    ----------
    b, s : arrays, or CasADi matrices of one shape
    order : int
    functions : module
        Where exp and its kin for such arguments come from, `numpy` or `casadi`.
    """
    f = functions
    growth = f.exp(s - b) / -f.expm1(-2.0 * b)  # e^s / (2 sinh b)
    decay = growth * f.exp(-2.0 * s)
    hyperbolic = growth - decay if order % 2 == 0 else growth + decay
    circular = (f.sin, f.cos, f.sin, f.cos)[order](s) / f.sin(b)
    return (-b) ** order * (hyperbolic - circular if order < 2 else hyperbolic + circular)


def lift_shape(xi: Any, order: int = 0) -> Any:
    """Static shape of a clamped beam whose tip is lifted by one, or its derivative to xi = x / L."""
    return (1.5 * xi**2 - 0.5 * xi**3, 3.0 * xi - 1.5 * xi**2)[order]


def rotation_shape(xi: Any, order: int = 0) -> Any:
    """Static shape, over its length, of a beam whose clamp turns by one and whose tip rests, or its derivative."""
    return (xi - 1.5 * xi**2 + 0.5 * xi**3, 1.0 - 3.0 * xi + 1.5 * xi**2)[order]


@dataclass(frozen=True)
class Beam:
    """A slender beam, clamped at x = 0, resting through its tip on a rigid support at x = L.

    Attributes
    ----------
    length, width, thickness : float
        Geometry [m].
    youngs_modulus : float
        E [Pa].
    density : float
        rho [kg/m3].
    modes : int
        Bending modes kept.
    """

    length: float
    width: float
    thickness: float
    youngs_modulus: float
    density: float
    modes: int = 5

    MODES: ClassVar[str] = "beam.modes"

    def __post_init__(self) -> None:
        """Refuse numbers that no beam has."""
        for name in MEASURES:
            bounded(f"Beam: {name}", getattr(self, name), 0.0, strict=True)
            plausible(f"Beam: {name}", getattr(self, name), name)
        bounded("Beam: modes", self.modes, 1)

    def __str__(self) -> str:
        """Dimensions in a few words."""
        measures = " x ".join(f"{1e3 * size:g}" for size in (self.length, self.width, self.thickness))
        return (
            f"beam {measures} mm, E {1e-9 * self.youngs_modulus:g} GPa, density {self.density:g} kg/m3, "
            f"{self.modes} modes from {self.natural_frequencies()[0] / (2 * np.pi):.6g} Hz"
        )

    @property
    def quantities(self) -> Iterator[tuple[str, str, Any]]:
        """Key of the rig file, quantity of :mod:`models.plausible`, value."""
        return ((f"beam.{name}", name, getattr(self, name)) for name in MEASURES)

    @property
    def proportions(self) -> Iterator[Proportion]:
        """Numbers that are usually less than others of it: a beam is longer than it is thick."""
        yield Proportion("beam.thickness", self.thickness, "m", self.length, "beam.length")

    @property
    def area(self) -> float:
        """Cross section A [m2]."""
        return self.width * self.thickness

    @property
    def bending_stiffness(self) -> float:
        """E I [N m2]."""
        return self.youngs_modulus * self.width * self.thickness**3 / 12.0

    @property
    def mass_per_length(self) -> float:
        """Rho A [kg/m]."""
        return self.density * self.area

    def shapes(self, x: Array, order: int = 0) -> Array:
        """Mass-normalised mode shapes d^order phi_i / dx^order at positions `x` [m], (m, modes)."""
        b = wavenumbers(self.modes)
        scale = np.sqrt(self.mass_per_length * self.length) * self.length**order
        return np.asarray(unit_shapes(b, np.asarray(x, dtype=float) / self.length, order) / scale)

    def natural_frequencies(self) -> Array:
        """Natural frequencies with the tip sliding freely, (modes,) [rad/s]."""
        wave = wavenumbers(self.modes) / self.length
        return np.asarray(wave**2 * np.sqrt(self.bending_stiffness / self.mass_per_length))

    @property
    def fundamental(self) -> float | None:
        """Lowest natural frequency [rad/s]; None where a number is a symbol."""
        return float(self.natural_frequencies()[0]) if all(plain(getattr(self, name)) for name in MEASURES) else None

    def tip_load_shape(self, x: Array, order: int = 0) -> Array:
        """Static shape s(x) of a cantilever under a tip load, s(L) = 1, or its first derivative."""
        return np.asarray(lift_shape(np.asarray(x, dtype=float) / self.length, order) / self.length**order)
