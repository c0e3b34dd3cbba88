"""Clamped-pinned Euler-Bernoulli beam: from geometry and material to a modal structure."""

from dataclasses import dataclass

import numpy as np

from models.structure import Array, ModalStructure, Reaction, ResidualFlexibility


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
    s = b * (1.0 - np.asarray(xi, dtype=float)[:, None])
    growth = np.exp(s - b) / -np.expm1(-2.0 * b)  # e^s / (2 sinh b)
    decay = growth * np.exp(-2.0 * s)
    hyperbolic = growth - decay if order % 2 == 0 else growth + decay
    circular = (np.sin(s), np.cos(s), -np.sin(s), -np.cos(s))[order] / np.sin(b)
    return np.asarray((-b) ** order * (hyperbolic - circular))


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

    def tip_load_shape(self, x: Array, order: int = 0) -> Array:
        """Static shape s(x) of a cantilever under a tip load, s(L) = 1, or its first derivative."""
        L = self.length
        x = np.asarray(x, dtype=float)
        return (3 * L * x**2 - x**3) / (2 * L**3) if order == 0 else (6 * L * x - 3 * x**2) / (2 * L**3)

    def static_by_moment(self, x: float) -> float:
        """Static deflection at `x` of the clamped-pinned beam per unit moment at its tip [1/N]."""
        return (x**3 - self.length * x**2) / (4 * self.bending_stiffness * self.length)

    def static_by_force(self, x: float, at: float) -> float:
        """Static deflection at `x` of the clamped-pinned beam per unit force at `at` [m/N].

        A cantilever's, less what the tip reaction takes back.
        """
        near, far = min(x, at), max(x, at)
        cantilever = near**2 * (3 * far - near) / (6 * self.bending_stiffness)
        tip = self.length**3 / (3 * self.bending_stiffness)
        return cantilever - tip * float(self.tip_load_shape(np.array(x)) * self.tip_load_shape(np.array(at)))


def beam_structure(
    beam: Beam,
    *,
    radius: float,
    excitation_position: float,
    viscous_damping: Array,
    stiffness_proportional: float = 0.0,
    variable_normal_load: bool = True,
    residual_compliance: bool = True,
    foreshortening: bool = True,
    positions: dict[str, float] | None = None,
) -> ModalStructure:
    """Project a beam and its tip contact on the beam's modes.

    Parameters
    ----------
    beam : Beam
        Geometry and material.
    radius : float
        Half-cylinder radius r [m]; the friction acts at the arm h = r + thickness / 2.
    excitation_position : float
        X_f [m].
    viscous_damping : (modes,) array
        From :func:`models.structure.modal_damping` [1/s].
    stiffness_proportional : float
        beta [s], adds beta omega_i^2; like the elastic moment its work with the tip-load shape
        vanishes, so it does not enter the reaction.
    variable_normal_load, residual_compliance, foreshortening : bool
        Keep R(t), C_res, and the T G q coupling of physics.md section 2.
    positions : dict of str to float, optional
        Position of each response channel [m].

    Returns
    -------
    ModalStructure

    References
    ----------
    physics.md section 2; (1)-(5).
    """
    L = beam.length
    arm = radius + beam.thickness / 2
    omega_n = beam.natural_frequencies()
    tip_slope = beam.shapes(np.array([L]), 1)[0]
    # the fastest oscillation of a product of slopes is 2 b_n: 4 points per mode and a margin are exact to rounding
    nodes, weights = np.polynomial.legendre.leggauss(4 * beam.modes + 40)
    x, weights = L * (nodes + 1) / 2, weights * L / 2
    slopes = beam.shapes(x, 1)
    missing_rotation = L / (4 * beam.bending_stiffness) - np.sum((tip_slope / omega_n) ** 2)
    inertia = beam.mass_per_length * (weights * beam.tip_load_shape(x)) @ beam.shapes(x)
    reaction = Reaction(
        inertia=inertia,
        damping=inertia * viscous_damping,
        # like the shortening it comes from the axial force in the deflected beam, -T y'' in (1)
        stretch=(weights * beam.tip_load_shape(x, 1)) @ slopes if foreshortening else np.zeros(beam.modes),
        force_share=float(beam.tip_load_shape(np.array(excitation_position))),
        friction_lever=float(arm * beam.tip_load_shape(np.array(L), 1)),
    )
    positions = positions or {}
    return ModalStructure(
        omega_n=omega_n,
        damping=viscous_damping + stiffness_proportional * omega_n**2,
        slip_row=arm * tip_slope,
        shortening=(slopes.T * weights) @ slopes if foreshortening else np.zeros((beam.modes, beam.modes)),
        excitation=beam.shapes(np.array([excitation_position]))[0],
        compliance=L / (beam.youngs_modulus * beam.area) + arm**2 * missing_rotation if residual_compliance else 0.0,
        reaction=reaction if variable_normal_load else Reaction.constant(beam.modes),
        channel_rows={name: beam.shapes(np.array([at]))[0] for name, at in positions.items()},
        residual=_residual_flexibility(beam, arm, excitation_position, positions)
        if residual_compliance
        else ResidualFlexibility(),
    )


def _residual_flexibility(beam: Beam, arm: float, drive: float, positions: dict[str, float]) -> ResidualFlexibility:
    """Exact static deflections less the share that the kept modes carry."""
    flexibility = 1.0 / beam.natural_frequencies() ** 2
    places = np.array([drive, *positions.values()])
    shapes = beam.shapes(places)
    modal_by_force = shapes @ (flexibility * shapes[0])
    modal_by_friction = shapes @ (flexibility * arm * beam.shapes(np.array([beam.length]), 1)[0])
    by_force = np.array([beam.static_by_force(x, drive) for x in places]) - modal_by_force
    by_friction = np.array([arm * beam.static_by_moment(x) for x in places]) - modal_by_friction
    rows = zip(by_force[1:].tolist(), by_friction[1:].tolist(), strict=True)
    return ResidualFlexibility(
        slip_by_force=float(by_friction[0]),
        drive_by_force=float(by_force[0]),
        channels=dict(zip(positions, rows, strict=True)),
    )
