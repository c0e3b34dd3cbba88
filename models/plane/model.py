"""A beam as a plane finite element model: the body that comes out, and the joints at its point of contact."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from models.bodies.matrix import MatrixBody, Method
from models.bounds import bounded
from models.friction.law import FrictionLaw
from models.joints.joint import Joint
from models.joints.rubbing import Friction
from models.parts import Damping
from models.plane.elements import ELEMENTS, Assembled, Material, State
from models.plane.mesh import HalfCylinder, beam_mesh
from models.structure import Array

MOST_ROUNDS = 100
"""Rounds in which the contact at rest must settle."""


@dataclass(frozen=True)
class PlaneBeam:
    """A beam clamped at x = 0, as a plane model; with a half cylinder under it, ready to rest on a support.

    Attributes
    ----------
    length, thickness, width : float
        [m]; the width lies out of the plane.
    youngs_modulus, poissons_ratio, density : float
        [Pa], [-], [kg/m3]
    cylinder : HalfCylinder or None
    element : str
        One of :data:`models.plane.ELEMENTS`.
    state : str
        ``plane-stress`` or ``plane-strain``.
    columns, rows : int
        Elements along the beam (up to the half cylinder) and over its thickness, an even number.
    stations : tuple of float
        Where along the beam nodes must lie, to be shaken or observed there [m].
    """

    length: float
    thickness: float
    width: float
    youngs_modulus: float
    density: float
    cylinder: HalfCylinder | None = None
    poissons_ratio: float = 0.3
    element: str = "CPS4I"
    state: State = "plane-stress"
    columns: int = 120
    rows: int = 4
    stations: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        """Refuse what is no beam."""
        for name in ("length", "thickness"):
            bounded(f"PlaneBeam: {name}", getattr(self, name), 0.0, strict=True)
        bounded("PlaneBeam: columns", self.columns, 1)
        if self.rows < 2 or self.rows % 2:
            raise ValueError(f"PlaneBeam: rows = {self.rows}; must be even, so that nodes lie on the neutral axis")
        if self.element not in ELEMENTS:
            raise ValueError(f'PlaneBeam: element = "{self.element}"; must be one of {", ".join(ELEMENTS)}')
        self.material  # noqa: B018  # refused at birth

    @property
    def material(self) -> Material:
        """What it is made of."""
        return Material(self.youngs_modulus, self.poissons_ratio, self.density, self.width, self.state)

    def model(self, modes: int = 20, reduction: Method = "modes") -> "PlaneModel":
        """Mesh and assemble it; `modes` and `reduction` are those of :class:`models.bodies.MatrixBody`."""
        mesh = beam_mesh(self.length, self.thickness, self.columns, self.rows, self.cylinder, self.stations)
        return PlaneModel(self, mesh, ELEMENTS[self.element].assemble(mesh, self.material), modes, reduction)


@dataclass(frozen=True, eq=False)
class PlaneModel:
    """Matrices of a plane beam, with names for its degrees of freedom.

    Attributes
    ----------
    beam : PlaneBeam
    mesh : skfem.MeshQuad
        Before quadrilaterals are cut in two for triangles.
    matrices : Assembled
    modes : int
    reduction : str
        As of :class:`models.bodies.MatrixBody`.
    """

    beam: PlaneBeam
    mesh: Any
    matrices: Assembled
    modes: int
    reduction: Method

    def __str__(self) -> str:
        """Its size in a few words."""
        b = self.beam
        return f"plane beam, {b.state}, {self.mesh.t.shape[1]} quadrilaterals, {b.element}: {self.body}"

    @cached_property
    def _nodes(self) -> tuple[Array, npt.NDArray[np.intp]]:
        """Points (2, p), and the point of each degree of freedom, (d,)."""
        scaled = np.round(self.matrices.places / self.beam.length, 10)
        _, first, number = np.unique(scaled, axis=1, return_index=True, return_inverse=True)
        return self.matrices.places[:, first], number.ravel()

    @cached_property
    def _surface(self) -> npt.NDArray[np.intp]:
        """Points on the arc of the half cylinder in its middle half, from left to right."""
        points, cylinder = self._nodes[0], self._cylinder
        x, y = points[0] - cylinder.position, points[1] + self.beam.thickness / 2
        on_arc = np.abs(np.hypot(x, y) - cylinder.radius) < 1e-6 * cylinder.radius
        found = np.flatnonzero(on_arc & (-y > cylinder.radius / 2))
        return found[np.argsort(points[0, found])]

    @property
    def _cylinder(self) -> HalfCylinder:
        if self.beam.cylinder is None:
            raise ValueError("PlaneBeam: has no half cylinder to rest on")
        return self.beam.cylinder

    @cached_property
    def body(self) -> MatrixBody:
        """The body, clamped at x = 0; degrees of freedom are named by node and direction, such as ``117.y``."""
        numbers = self._nodes[1]
        names = tuple(f"{n}.{'xy'[d]}" for n, d in zip(numbers, self.matrices.along, strict=True))
        held = np.flatnonzero(self.matrices.places[0] < 1e-9 * self.beam.length)
        m = self.matrices
        return MatrixBody(
            m.mass, m.stiffness, names, self.modes, fixed=tuple(names[i] for i in held), reduction=self.reduction
        )

    def at(self, x: float, y: float = 0.0) -> str:
        """Name of the node nearest to a point [m]; y counts from the neutral axis."""
        points = self._nodes[0]
        return str(int(np.hypot(points[0] - x, points[1] - y).argmin()))

    def contacts(self, count: int) -> list[str]:
        """Names of the nodes nearest to the point of contact, from left to right."""
        return [str(int(n)) for n in self._nearest(count)]

    def _nearest(self, count: int) -> npt.NDArray[np.intp]:
        points, surface = self._nodes[0], self._surface
        if count > len(surface):
            raise ValueError(f"PlaneModel: {count} nodes of contact; must be <= {len(surface)}, as the mesh has")
        distance = np.abs(points[0, surface] - self._cylinder.position)
        return surface[np.sort(np.argsort(distance, kind="stable")[:count])]

    def gaps(self, count: int) -> Array:
        """Height of these nodes above the lowest one of the half cylinder, (count,) [m]."""
        height = self._nodes[0][1, self._nearest(count)]
        return np.asarray(height - height.min())

    def resting(self, count: int, load: float, stiffness: float) -> Array:
        """Forces of the support on the nodes of contact at rest without friction; where open, stiffness times overlap.

        Parameters
        ----------
        count : int
            Nodes of contact.
        load : float
            Presses the beam down on its neutral axis above the point of contact [N].
        stiffness : float
            Of the support under each node [N/m].

        Returns
        -------
        (count,) array
            [N], negative where a node stays above the support.

        Raises
        ------
        RuntimeError
            If which nodes touch does not settle.
        """
        nodes = self.contacts(count)
        places = [f"{n}.y" for n in nodes] + [f"{self.at(self._cylinder.position)}.y"]
        still = self.body.ported(places, Damping()).receptance(0.0).real
        yields, sinks = still[:count, :count], load * still[:count, count] - self.gaps(count)
        touching = np.ones(count, dtype=bool)
        for _ in range(MOST_ROUNDS):
            at = np.flatnonzero(touching)
            force = np.zeros(count)
            force[at] = np.linalg.solve(np.eye(len(at)) + stiffness * yields[np.ix_(at, at)], stiffness * sinks[at])
            overlap = sinks - yields @ force
            if np.array_equal(touching, overlap > 0.0):
                return np.asarray(stiffness * overlap)
            touching = overlap > 0.0
        raise RuntimeError(f"contact at rest does not settle in {MOST_ROUNDS} rounds; try more nodes or less stiffness")

    def joints(self, law: FrictionLaw, count: int, load: float, stiffness: float) -> tuple[Joint, ...]:
        """Unilateral contact with friction at nodes around the point of contact, as the load leaves it at rest.

        Stiffnesses of the law refer to an equal share of the load for every node that touches at rest.

        Parameters
        ----------
        law : FrictionLaw
        count, load, stiffness
            As of :meth:`resting`.
        """
        forces = self.resting(count, load, stiffness)
        share = load / int((forces > 0.0).sum())
        return tuple(
            Joint(f"node {n}", Friction(law, float(force), stiffness, reference_load=share), (f"{n}.x", f"-1*{n}.y"))
            for n, force in zip(self.contacts(count), forces, strict=True)
        )
