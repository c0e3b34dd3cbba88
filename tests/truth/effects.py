"""Hidden effects: what the true rig has and the nominal one lacks, as changes of the elements or forces on them.

A new one is a class here: it names the places where it wants a node, changes the matrices (`build`), and, if it is
nonlinear, gives its rows over the degrees of freedom (`rows`) and the force it exerts through them (`forces`).
Effects in the friction law are laws (`laws.py`); those in the force and the sensors are fields of the rig.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tests.truth.beam import FiniteElements, hermite

Array = np.ndarray


@dataclass(frozen=True)
class Motion:
    """Where a nonlinear effect finds itself in a trial of the end of a step.

    `y`, `y_rate` (records, copies, rows): what its rows read; `q`, `Gq` (records, copies, n) the coordinates and the
    geometric matrix times them; `phase` (records, 1) of the excitation in periods; `flexibility` (records, 1, rows)
    response of each row to its own force within the step; `dt` (records, 1) of the step, 0 where it only begins.
    """

    y: Array
    y_rate: Array
    q: Array
    Gq: Array
    phase: Array
    flexibility: Array
    dt: Array


class Effect:
    """No effect: what the others inherit. `states` counts what a nonlinear one remembers."""

    states = 0
    nonlinear = False
    supports = False  # its force is part of the reaction

    def places(self) -> list[float]:
        """Positions where a node of the mesh is wanted."""
        return []

    def build(self, fe: FiniteElements) -> None:
        """Change the matrices."""

    def rows(self, fe: FiniteElements) -> Array:
        """Displacements that the effect reads, and along which it pushes, (rows, degrees of freedom)."""
        return np.zeros((0, fe.size))

    def static_rows(self, fe: FiniteElements) -> Array:
        """Loads whose static deflection the reduced structure must hold exactly."""
        return self.rows(fe)

    def forces(self, at: Motion, start: Array, tried: Array) -> tuple[Array, Array]:
        """Forces along the rows (records, copies, rows), and what is remembered at the end of the step.

        `start` is what was remembered at its beginning, `tried` at its end in the trial before this one.
        """
        return np.zeros_like(at.y), start

    def tension(self, at: Motion) -> Array | float:
        """Axial force besides friction (records, copies)."""
        return 0.0


@dataclass(frozen=True)
class AddedMass(Effect):
    mass: float
    position: float

    def places(self) -> list[float]:
        return [self.position]

    def build(self, fe: FiniteElements) -> None:
        fe.M += self.mass * np.outer(fe.row(self.position), fe.row(self.position))


@dataclass(frozen=True)
class AddedSpring(Effect):
    stiffness: float
    position: float

    def places(self) -> list[float]:
        return [self.position]

    def build(self, fe: FiniteElements) -> None:
        fe.K += self.stiffness * np.outer(fe.row(self.position), fe.row(self.position))


@dataclass(frozen=True)
class Stinger(Effect):
    """What the shaker adds to the beam at the drive point: a mass, and a spring to ground."""

    mass: float
    stiffness: float
    position: float

    def places(self) -> list[float]:
        return [self.position]

    def build(self, fe: FiniteElements) -> None:
        here = np.outer(fe.row(self.position), fe.row(self.position))
        fe.M += self.mass * here
        fe.K += self.stiffness * here


@dataclass(frozen=True)
class AttachedResonator(Effect):
    mass: float
    frequency_hz: float
    position: float

    def places(self) -> list[float]:
        return [self.position]

    def build(self, fe: FiniteElements) -> None:
        dof = fe.extra()
        stretch = fe.unit(dof) - fe.row(self.position)
        fe.M[dof, dof] += self.mass
        fe.K += self.mass * (2 * np.pi * self.frequency_hz) ** 2 * np.outer(stretch, stretch)


@dataclass(frozen=True)
class ClampRotation(Effect):
    stiffness: float

    def build(self, fe: FiniteElements) -> None:
        fe.fixed.discard(1)
        fe.K[1, 1] += self.stiffness


@dataclass(frozen=True)
class SupportRotationSpring(Effect):
    stiffness: float

    def build(self, fe: FiniteElements) -> None:
        fe.K[fe.tip + 1, fe.tip + 1] += self.stiffness


@dataclass(frozen=True)
class SupportFlexibility(Effect):
    """The support is a vertical spring: the tip moves."""

    stiffness: float

    def build(self, fe: FiniteElements) -> None:
        fe.fixed.discard(fe.tip)
        fe.K[fe.tip, fe.tip] += self.stiffness
        fe.support = self.stiffness


@dataclass(frozen=True)
class ContactLoss(Effect):
    """The tip leaves the support: a stiff spring under it, less the tension that it cannot bear.

    What is remembered is the force, from which the tip's motion without it follows. For lifts that are short beside the
    period: what the modes leave of the tip's motion has no inertia, and modes close to the steps grow in long ones.
    """

    load: float
    stiffness: float = 1e10
    nonlinear = True
    supports = True
    states = 1

    def build(self, fe: FiniteElements) -> None:
        SupportFlexibility(self.stiffness).build(fe)

    def rows(self, fe: FiniteElements) -> Array:
        return fe.unit(fe.tip)[None]

    def forces(self, at: Motion, start: Array, tried: Array) -> tuple[Array, Array]:
        if not at.dt.any():
            return start, start
        k, soft = self.stiffness, at.flexibility
        held = k * (at.y - soft * tried) - self.load
        force = np.maximum(held, 0.0) / (1 - k * soft)
        return force, force


@dataclass(frozen=True)
class MidplaneStretching(Effect):
    """Axial restraint: -(k/2) (y'Gy) G y."""

    axial_stiffness: float
    nonlinear = True

    def tension(self, at: Motion) -> Array:
        return self.axial_stiffness / 2 * np.einsum("rci,rci->rc", at.q, at.Gq)


@dataclass(frozen=True)
class QuadraticDrag(Effect):
    """-c y_t |y_t| per length, by two Gauss points an element."""

    coefficient: float
    nonlinear = True

    def rows(self, fe: FiniteElements) -> Array:
        rows = []
        for i, h in enumerate(np.diff(fe.nodes)):
            for xi in (0.5 - 0.5 / np.sqrt(3), 0.5 + 0.5 / np.sqrt(3)):
                row = np.zeros(fe.size)
                row[2 * i : 2 * i + 4] = hermite(xi, h) * (h / 2) ** (1 / 3)  # its cube is the weight
                rows.append(row)
        return np.array(rows)

    def static_rows(self, fe: FiniteElements) -> Array:
        return np.zeros((0, fe.size))

    def forces(self, at: Motion, start: Array, tried: Array) -> tuple[Array, Array]:
        return -self.coefficient * at.y_rate * np.abs(at.y_rate), start


@dataclass(frozen=True)
class ImpactStop(Effect):
    """One-sided spring where y > gap."""

    gap: float
    stiffness: float
    position: float
    nonlinear = True

    def places(self) -> list[float]:
        return [self.position]

    def rows(self, fe: FiniteElements) -> Array:
        return fe.row(self.position)[None]

    def forces(self, at: Motion, start: Array, tried: Array) -> tuple[Array, Array]:
        return -self.stiffness * np.maximum(at.y - self.gap, 0.0), start


@dataclass(frozen=True)
class PointForce(Effect):
    """Any force at a point: `law(y, y_rate, phase)`; for causes that no catalogue knows."""

    position: float
    law: Callable[[Array, Array, float], Array]
    nonlinear = True

    def places(self) -> list[float]:
        return [self.position]

    def rows(self, fe: FiniteElements) -> Array:
        return fe.row(self.position)[None]

    def forces(self, at: Motion, start: Array, tried: Array) -> tuple[Array, Array]:
        return self.law(at.y, at.y_rate, at.phase), start


@dataclass(frozen=True)
class AxialPumping(Effect):
    """An axial force of amplitude [N] at a multiple of the excitation, in step with it; outside the catalogue."""

    amplitude: float
    multiple: int = 2
    nonlinear = True

    def tension(self, at: Motion) -> Array:
        return self.amplitude * np.cos(2 * np.pi * self.multiple * at.phase)


@dataclass(frozen=True)
class ClampFriction(Effect):
    """A Jenkins element is all that holds the clamp's rotation: a spring, less what slides of it."""

    limit: float
    stiffness: float
    nonlinear = True
    states = 1

    def build(self, fe: FiniteElements) -> None:
        fe.fixed.discard(1)
        fe.K[1, 1] += self.stiffness

    def rows(self, fe: FiniteElements) -> Array:
        return fe.unit(1)[None]

    def forces(self, at: Motion, start: Array, tried: Array) -> tuple[Array, Array]:
        k, soft = self.stiffness, at.flexibility
        trial = k * (at.y - soft * k * (tried - start) - start)
        excess = trial - np.clip(trial, -self.limit, self.limit)
        slid = start + excess / (k * (1 - soft * k))
        return k * slid, slid


@dataclass(frozen=True)
class BreathingCrack(Effect):
    """Bending stiffness that is less by `loss` over a short stretch where it opens; outside the catalogue."""

    loss: float
    position: float
    half_length: float
    bending: float
    opens: float = 1.0
    nonlinear = True

    def places(self) -> list[float]:
        return [self.position - self.half_length, self.position + self.half_length]

    def rows(self, fe: FiniteElements) -> Array:
        first, last = (2 * int(np.abs(fe.nodes - place).argmin()) + 1 for place in self.places())
        return (fe.unit(last) - fe.unit(first))[None]

    def forces(self, at: Motion, start: Array, tried: Array) -> tuple[Array, Array]:
        missing = self.loss * self.bending / (2 * self.half_length)
        return missing * self.opens * np.maximum(self.opens * at.y, 0.0), start


@dataclass(frozen=True)
class SpringPot(Effect):
    """Maxwell elements in parallel to ground, whose loss grows as a root of the frequency; outside the catalogue."""

    stiffness: float
    position: float
    slowest: float
    elements: int = 6
    nonlinear = True
    states = 6

    def places(self) -> list[float]:
        return [self.position]

    def rows(self, fe: FiniteElements) -> Array:
        return fe.row(self.position)[None]

    def forces(self, at: Motion, start: Array, tried: Array) -> tuple[Array, Array]:
        ratio = 4.0 ** np.arange(self.elements)  # from slow to fast
        grown = at.dt[..., None] * ratio / self.slowest
        crept = (start + grown * at.y) / (1 + grown)
        return -(self.stiffness * np.sqrt(ratio) * (at.y - crept)).sum(axis=-1, keepdims=True), crept
