"""The true rig: every number of the experiment, hidden effects included."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tests.truth.beam import FiniteElements, Reduced, flexibility, modes_of, nodes, static_shapes
from tests.truth.effects import Effect
from tests.truth.laws import Law

Array = np.ndarray


@dataclass(frozen=True)
class Sensor:
    """An accelerometer: where it really sits, and what it makes of what it feels.

    Two channels are exchanged by exchanging two names.
    """

    name: str
    position: float
    gain: float = 1.0
    delay: float = 0.0


@dataclass(frozen=True)
class Tone:
    """Harmonic that the shaker adds to the force: its ratio to the fundamental and its phase [rad]."""

    harmonic: int
    ratio: float
    phase: float = 0.0


@dataclass(frozen=True)
class TrueRig:
    """SI units, docs/theory/equations.md. `variable_normal_load` scales R(t) - P in the law: 1 true, 0 constant P.

    What no rig file holds: `damping_factors` multiply the damping of the modes of the bare beam but beta's part,
    `thickness_terms` are the relative amplitudes of cos(n pi x / L) in the thickness, n = 1, 2, ..., which mass follows
    and the cube of which bending follows; `newmark` marches the modes by Newmark's rule instead of exactly.
    """

    length: float
    width: float
    thickness: float
    youngs_modulus: float
    density: float
    alpha: float
    radius: float
    normal_load: float
    law: Law
    drive: float
    sensors: tuple[Sensor, ...]
    effects: tuple[Effect, ...] = ()
    distortion: tuple[Tone, ...] = ()
    variable_normal_load: float = 1.0
    beta: float = 0.0
    high_mode_ratio: float = 0.02
    high_mode_from: int = 6
    elements: int = 48
    modes: int = 16
    damping_factors: tuple[float, ...] = ()
    thickness_terms: tuple[float, ...] = ()
    newmark: bool = False

    @property
    def arm(self) -> float:
        return self.radius + self.thickness / 2

    @property
    def area(self) -> float:
        return self.width * self.thickness

    @property
    def bending(self) -> float:
        return self.youngs_modulus * self.width * self.thickness**3 / 12

    def bare(self) -> FiniteElements:
        """Elements of the beam alone, clamped and supported rigidly."""
        places = [self.drive, *(place for effect in self.effects for place in effect.places())]
        mesh = nodes(self.length, self.elements, places)
        if not self.thickness_terms:
            return FiniteElements(mesh, self.density * self.area, self.bending)
        order = np.arange(1, len(self.thickness_terms) + 1)
        middle = (mesh[1:] + mesh[:-1]) / 2
        thick = 1 + np.cos(np.pi * order * middle[:, None] / self.length) @ np.array(self.thickness_terms)
        return FiniteElements(mesh, self.density * self.area * thick, self.bending * thick**3)

    def complete(self) -> FiniteElements:
        """Elements with the hidden effects in them."""
        fe = self.bare()
        for effect in self.effects:
            effect.build(fe)
        return fe

    def damping(self, omega2: Array) -> Array:
        """Modal damping 2 zeta omega: alpha and beta; a fixed ratio above the fifth mode's neighbourhood.

        The border is drawn by frequency, half way to the first high mode of the bare beam, so that a hidden
        resonator does not renumber the modes.
        """
        bare, _ = modes_of(self.bare(), max(self.high_mode_from, len(self.damping_factors)))
        border = (
            np.sqrt(bare[self.high_mode_from - 1] * bare[self.high_mode_from - 2]) if self.high_mode_from > 1 else 0.0
        )
        high = (omega2 > border) & (self.high_mode_ratio > 0)
        damping = np.where(high, 2 * self.high_mode_ratio * np.sqrt(omega2), self.alpha)
        if self.damping_factors:
            known = np.log(bare[: len(self.damping_factors)])
            nearest = np.abs(np.log(omega2)[:, None] - known).argmin(axis=1)
            damping = damping * np.array(self.damping_factors)[nearest]
        return damping + self.beta * omega2

    def reduced(self) -> Reduced:
        """Modes, and the static shapes that make the contact, the drive and the effects exact statically."""
        fe = self.complete()
        omega2, V = modes_of(fe, self.modes)
        contact, drive = self.arm * fe.unit(fe.tip + 1), fe.row(self.drive)
        rows = np.vstack([effect.rows(fe) for effect in self.effects] or [np.zeros((0, fe.size))])
        supports = np.array([e.supports for e in self.effects for _ in e.rows(fe)], dtype=bool)
        loads = [contact, drive, fe.G @ V[:, 0], fe.G @ V[:, 1]]
        loads += [row for effect in self.effects for row in effect.static_rows(fe)]
        stiffness, shapes = static_shapes(fe, omega2, V, np.array(loads).T)
        damping = np.append(self.damping(omega2), np.zeros(len(stiffness)))
        inertia = np.append(np.ones(len(omega2)), np.zeros(len(stiffness)))
        V = np.hstack([V, shapes])
        tip, held = fe.tip, float(fe.support == 0.0)
        return Reduced(
            V=V,
            omega2=np.append(omega2, stiffness),
            damping=damping,
            inertia=inertia,
            contact=contact @ V,
            drive=drive @ V,
            G=V.T @ fe.G @ V,
            sensors=np.array([fe.row(s.position) for s in self.sensors]) @ V,
            axial=self.length / (self.youngs_modulus * self.area),
            tip_mass_row=held * fe.M[tip] @ V * inertia,
            tip_damping_row=held * fe.M[tip] @ V * damping,
            tip_stiffness_row=fe.K[tip] @ V if held else -fe.support * V[tip],
            tip_geometric_row=held * fe.G[tip] @ V,
            tip_loads=np.where(supports, -1.0, held) * rows[:, tip],
            rows=rows @ V,
        )

    def natural_frequencies(self, count: int = 5, contact_stiffness: float = 0.0, axial: bool = True) -> Array:
        """Sliding, or with the contact stuck on a spring (in series with the axial strain) [Hz]."""
        fe = self.complete()
        if contact_stiffness:
            compliance = 1 / contact_stiffness + axial * self.length / (self.youngs_modulus * self.area)
            row = self.arm * fe.unit(fe.tip + 1)
            fe.K += np.outer(row, row) / compliance
        return np.sqrt(modes_of(fe, count)[0]) / (2 * np.pi)

    def static_rotation(self) -> float:
        """Rotation of the tip per end moment [rad/(N m)]."""
        fe = self.complete()
        moment = fe.unit(fe.tip + 1)
        return float(moment @ flexibility(fe, moment[:, None])[:, 0])


def table_1(law: Law, sensors: Sequence[float] = (0.1, 0.2, 0.3, 0.4, 0.5, 0.58), alpha: float = 0.6) -> TrueRig:
    """The rig of the source paper, with the accelerometers of the example data."""
    return TrueRig(
        length=0.606,
        width=0.03888,
        thickness=0.00478,
        youngs_modulus=210e9,
        density=7800.0,
        alpha=alpha,
        radius=0.005,
        normal_load=83.0,
        law=law,
        drive=0.555,
        sensors=tuple(Sensor(f"a{i}", x) for i, x in enumerate(sensors, start=1)),
    )
