"""A beam with whatever is attached to it: mass, stiffness and rows on fixed shapes, numbers or symbols.

The shapes are the modes of the bare clamped-pinned beam, one static shape more for each end that yields, and the
displacements of attached resonators. What the modes left out answer statically is exact: the difference of the beam's
influence function and the modal sum (residual flexibility: Craig & Kurdila, Fundamentals of Structural Dynamics, 2006,
chapter 17), also under the forces of attached springs. Everything is a closed form of lengths, moduli and positions:
one definition serves the simulation and, differentiated by CasADi, its derivatives.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import numpy.typing as npt

from models.attachments import LISTS, Attachments, Value
from models.beam import Beam, lift_shape, rotation_shape, shapes_of_waves, unit_shapes, wavenumbers
from models.structure import Array

Matrix = Any
Entries = tuple[tuple[int, int], npt.NDArray[np.intp], npt.NDArray[np.intp]]
"""Shape of a matrix, and of the entries of its derivatives that are not zero: which of its own, and to which scalar."""

MORE_MODES = 20
"""Modes of the bare beam beyond those kept, to build the modes of a beam with attachments from."""

LEAST_MASS = 1e-15
"""Share of the beam's mass that is lent to a resonator: one without mass has no definite shape."""


@dataclass(frozen=True)
class Layout:
    """A beam, where forces act on it, what is attached, and where its motion is seen; numbers or symbols.

    Attributes
    ----------
    beam : Beam
    radius : Value
        Radius of the half cylinder [m].
    excitation : Value
        X_f [m].
    channels : tuple of Value
        Positions of the response channels [m].
    points : tuple of Value
        Further places that are seen [m], of nonlinear elements.
    fractions : tuple of float
        And some at fixed fractions of the length.
    attachments : Attachments
    """

    beam: Beam
    radius: Value
    excitation: Value
    channels: tuple[Value, ...] = ()
    points: tuple[Value, ...] = ()
    fractions: tuple[float, ...] = ()
    attachments: Attachments = field(default=Attachments())

    def scalars(self) -> dict[str, Value]:
        """Everything that is a number; keys of the rig file, channels by their place: ``channels[0].position``."""
        return {
            **{f"beam.{name}": getattr(self.beam, name) for name in BEAM},
            "contact.radius": self.radius,
            "excitation.position": self.excitation,
            **{f"channels[{i}].position": x for i, x in enumerate(self.channels)},
            **{f"points[{i}]": x for i, x in enumerate(self.points)},
            **{f"attachments.{name}": value for name, value in self.attachments.scalars().items()},
        }

    def with_scalars(self, values: Sequence[Value]) -> "Layout":
        """The same layout with other values, in the order of :meth:`scalars`."""
        each = iter(values)
        beam = replace(self.beam, **{name: next(each) for name in BEAM})
        radius, excitation = next(each), next(each)
        channels, points = (tuple(next(each) for _ in places) for places in (self.channels, self.points))
        attachments = self.attachments.with_scalars(each)
        return Layout(beam, radius, excitation, channels, points, self.fractions, attachments)

    @property
    def at_clamp(self) -> int:
        """Coordinate that is the rotation of a clamp that turns."""
        return int(self.beam.modes)

    @property
    def at_support(self) -> int:
        """Coordinate that is the lift of the tip on a support that yields."""
        return self.at_clamp + (self.attachments.clamp_stiffness is not None)

    @property
    def form(self) -> "Layout":
        """The layout with every value one: what decides the instructions that assemble it."""
        return self.with_scalars([1.0] * len(self.scalars()))


BEAM = ("length", "width", "thickness", "youngs_modulus", "density")


class Assembly(NamedTuple):
    """Mass, stiffness and rows of d coordinates; CasADi matrices, or arrays.

    Rows are in the order slip, drive, channels, points, reaction: what is seen is ``rows d + flexibility (T, F)``, with
    the friction T and the excitation F. The reaction's are its elastic part; it adds
    ``P + inertia d'' + T stretch d`` (:class:`models.structure.Reaction`), the balance of a lift of the tip whether or
    not the support yields.

    Attributes
    ----------
    mass, stiffness, shortening : (d, d) matrices
    rows : (3 + c + e, d) matrix
    flexibility : (3 + c + e, 2) matrix
    inertia, stretch : (1, d) matrices
    share : (e, 1) matrix
        Share of a unit force at each of the e points that goes into the support.
    """

    mass: Matrix
    stiffness: Matrix
    shortening: Matrix
    rows: Matrix
    flexibility: Matrix
    inertia: Matrix
    stretch: Matrix
    share: Matrix


def assembled(layout: Layout, *, residual: bool = True) -> Assembly:
    """Assemble numbers.

    Parameters
    ----------
    layout : Layout
        A layout of numbers.
    residual : bool
        Whether the static response of the modes left out is kept.

    Returns
    -------
    Assembly
        An assembly of arrays.
    """
    function = _function(layout.form, residual)
    return Assembly(*(part.full() for part in function(list(layout.scalars().values()))))


@lru_cache(maxsize=8)  # the ends of a beam ask for the same
def assembled_changes(layout: Layout, *, residual: bool = True) -> dict[str, Assembly]:
    """Exact derivatives of :func:`assembled` to each of the layout's scalars, by their names in `Layout.scalars`."""
    function, entries = _jacobian(layout.form, residual)
    scalars = layout.scalars()
    parts = []
    for slopes, ((rows, columns), at, of) in zip(function(list(scalars.values())), entries, strict=True):
        part = np.zeros((len(scalars), columns, rows))
        part.reshape(len(scalars), columns * rows)[of, at] = slopes.nonzeros()
        parts.append(part.transpose(0, 2, 1))
    return {key: Assembly(*changes) for key, changes in zip(scalars, zip(*parts, strict=True), strict=True)}


@lru_cache(maxsize=64)
def _function(form: Layout, residual: bool) -> ca.Function:
    """(scalars) -> assembly, for layouts of a form."""
    p = ca.MX.sym("p", len(form.scalars()))
    parts = _Assembler(form.with_scalars(ca.vertsplit(p)), residual).assembly()
    return ca.Function("assembly", [p], [ca.densify(part) for part in parts])


@lru_cache(maxsize=64)
def _jacobian(form: Layout, residual: bool) -> tuple[ca.Function, list[Entries]]:
    """(scalars) -> derivatives of the parts of the assembly that are not zero; and where these are."""
    p = ca.MX.sym("p", len(form.scalars()))
    parts = _function(form, residual).call([p], True, False)
    slopes = [ca.jacobian(ca.vec(part), p) for part in parts]
    entries = [
        (part.shape, np.array(slope.sparsity().row(), dtype=int), np.array(slope.sparsity().get_col(), dtype=int))
        for part, slope in zip(parts, slopes, strict=True)
    ]
    return ca.Function("changes", [p], slopes), entries


STATIC = (rotation_shape, lift_shape)
STATIC_BENDING = np.array([[3.0, -3.0], [-3.0, 3.0]])
"""Integrals of products of their curvatures over xi; those with the curvatures of the modes vanish."""


@lru_cache(maxsize=16)
def _integrals(modes: int) -> tuple[Array, Array]:
    """Integrals over xi of products of all shapes (modes, rotation, lift), and of products of their slopes."""
    # the fastest oscillation of a product is 2 b_n: 4 points per mode and a margin are exact to rounding
    nodes, weights = np.polynomial.legendre.leggauss(4 * modes + 40)
    xi, weights = (nodes + 1) / 2, weights / 2
    b = wavenumbers(modes)

    def gram(order: int) -> Array:
        static = np.stack([shape(xi, order) for shape in STATIC], axis=1)
        shapes = np.hstack([unit_shapes(b, xi, order), static])
        return np.asarray((shapes.T * weights) @ shapes)

    products = gram(0)
    products[:modes, :modes] = np.eye(modes)
    return products, gram(1)


class _Assembler:
    """Entries of an :class:`Assembly` in symbols; shapes in the order (modes, rotation of the clamp, lift of the tip).

    A port is where a force acts or a displacement is seen: the rotation of the tip first, then points on the beam in
    the order excitation, channels, points, fractions, masses, springs, resonators. What is attached changes, in turn:
    the matrices; the `rows` of the ports on the coordinates and their `flexibility`; the `share` of a unit force at
    each port that goes into the support; and the rows `elastic` and `inertia` of the reaction.
    """

    def __init__(self, layout: Layout, residual: bool) -> None:
        ends = layout.attachments
        self.beam, self.ends, self.residual = layout.beam, ends, residual
        self.points = 2 + len(layout.channels)  # the first of them
        self.seen = self.points + len(layout.points) + len(layout.fractions)
        self.N, self.L, self.EI = self.beam.modes, self.beam.length, self.beam.bending_stiffness
        self.mass = self.beam.mass_per_length * self.L
        self.resonators = [r._replace(mass=r.mass + LEAST_MASS * self.mass) for r in ends.resonators]
        self.arm = layout.radius + self.beam.thickness / 2
        attached = [entry.position for kind in LISTS for entry in getattr(ends, kind)]
        fractions = [fraction * self.L for fraction in layout.fractions]
        self.x = ca.vertcat(layout.excitation, *layout.channels, *layout.points, *fractions, *attached)
        self.lift = self.N + 1
        yields = {self.N: ends.clamp_stiffness, self.lift: ends.support_stiffness}
        self.kept = [*range(self.N), *(shape for shape, stiffness in yields.items() if stiffness is not None)]
        self.d = len(self.kept) + len(ends.resonators)
        # a mode's deflection is its unit shape over the root of the mass, the rotation's is L times its shape
        self.scale = ca.vertcat(ca.repmat(1 / ca.sqrt(self.mass), self.N), self.L, 1.0)
        self.omega_squared = ca.DM(wavenumbers(self.N) ** 4) * self.EI / (self.mass * self.L**3)

    def assembly(self) -> Assembly:
        """Everything, attachments included."""
        self.bare()
        self.attach_springs()
        self.attach_masses()
        seen = self.seen
        arms = ca.diag(ca.vertcat(self.arm, ca.DM.ones(seen - 1)))
        by_forces = arms @ self.flexibility[:seen, :2] @ arms[:2, :2]
        by_forces[0, 0] += self.residual * self.L / (self.beam.youngs_modulus * self.beam.area)
        shares = (arms[:2, :2] @ self.share[:2]).T
        return Assembly(
            mass=self.M,
            stiffness=self.K,
            shortening=self.G,
            rows=ca.vertcat(arms @ self.rows[:seen, :], self.elastic),
            flexibility=ca.vertcat(by_forces, -shares),
            inertia=self.inertia,
            stretch=self.stretch,
            share=self.share[self.points : seen],
        )

    # ---- step by step

    def bare(self) -> None:
        """The beam with its clamp."""
        shapes, (products, slopes) = self.shapes(), _integrals(self.N)
        inertia, drawn = self.of_shapes(products, self.mass), self.of_shapes(slopes, 1 / self.L)
        self.rows, self.share = self.on_coordinates(shapes[self.kept, :].T), shapes[self.lift, :].T
        self.flexibility = self.omitted_flexibility()
        self.M, self.G = (_padded(matrix[self.kept, self.kept], self.d) for matrix in (inertia, drawn))
        self.M[: self.N, : self.N] = ca.DM.eye(self.N)  # exactly
        self.inertia, self.stretch = (self.on_coordinates(matrix[self.lift, self.kept]) for matrix in (inertia, drawn))
        self.K, self.elastic = self.bending()

    def attach_springs(self) -> None:
        """Springs of the tip, to the ground and of resonators, whose forces are held @ (W d + what forces add)."""
        at, stiffness, W = self.springs()
        if not at:
            return
        compliant = self.flexibility[at, :]
        held = ca.solve(ca.DM.eye(len(at)) + stiffness @ compliant[:, at], stiffness)
        self.K += W.T @ held @ W
        self.elastic += self.share[at].T @ held @ W
        self.rows -= compliant.T @ held @ W
        self.share -= compliant.T @ held @ self.share[at]
        self.flexibility -= compliant.T @ held @ compliant

    def attach_masses(self) -> None:
        """Point masses, and those of resonators."""
        for port, body in enumerate(self.ends.masses, start=self.seen):
            self.M += body.mass * self.rows[port, :].T @ self.rows[port, :]
            self.inertia += body.mass * self.share[port] * self.rows[port, :]
        for place, swinging in enumerate(self.resonators, start=len(self.kept)):
            self.M[place, place] += swinging.mass

    # ---- on all shapes

    def shapes(self) -> Matrix:
        """Rotation of the tip and deflections at the ports, per shape, (N + 2, ports)."""
        b, xi = ca.DM(wavenumbers(self.N)), (self.x / self.L).T
        waves = ca.repmat(b, 1, xi.shape[1])
        unit = shapes_of_waves(waves, b @ (1.0 - xi), 0, ca)
        points = ca.vertcat(unit, *(shape(xi) for shape in STATIC))
        turned = ca.vertcat(shapes_of_waves(b, 0 * b, 1, ca), *(shape(1.0, 1) for shape in STATIC)) / self.L
        return ca.horzcat(self.scale * turned, ca.repmat(self.scale, 1, xi.shape[1]) * points)

    def omitted_flexibility(self) -> Matrix:
        """Motion of each port by a unit load at each other, of the clamped-pinned beam less its modes, symmetric."""
        ports = self.x.shape[0] + 1
        if not self.residual:
            return ca.DM.zeros(ports, ports)
        # Beam: a cantilever's, less what the reaction of the support takes back
        near = ca.fmin(ca.repmat(self.x, 1, ports - 1), ca.repmat(self.x.T, ports - 1, 1))
        far = ca.repmat(self.x, 1, ports - 1) + ca.repmat(self.x.T, ports - 1, 1) - near
        share = lift_shape(self.x / self.L)
        points = near**2 * (3 * far - near) / (6 * self.EI) - self.L**3 / (3 * self.EI) * share @ share.T
        by_moment = (self.x**3 - self.L * self.x**2) / (4 * self.EI * self.L)
        exact = ca.blockcat([[self.L / (4 * self.EI), by_moment.T], [by_moment, points]])
        modes = self.shapes()[: self.N, :]
        return exact - modes.T @ (modes / ca.repmat(self.omega_squared, 1, ports))

    def of_shapes(self, integrals: Array, factor: Value) -> Matrix:
        """A factor times integrals of products of shapes, (N + 2, N + 2)."""
        return factor * (self.scale @ self.scale.T) * ca.DM(integrals)

    # ---- on the coordinates

    def on_coordinates(self, on_kept: Matrix) -> Matrix:
        """Rows on the kept shapes, with zeros for the resonators."""
        return ca.horzcat(on_kept, ca.DM.zeros(on_kept.shape[0], self.d - len(self.kept)))

    def bending(self) -> tuple[Matrix, Matrix]:
        """Bending stiffness with the springs of clamp and support, and the row of the lift of the tip without them."""
        static = self.EI / self.L**3 * (self.scale[self.N :] @ self.scale[self.N :].T) * ca.DM(STATIC_BENDING)
        moving = [i - self.N for i in self.kept[self.N :]]
        elastic = ca.horzcat(ca.DM.zeros(1, self.N), static[1, moving])
        ends = [k for k in (self.ends.clamp_stiffness, self.ends.support_stiffness) if k is not None]
        K = ca.diagcat(ca.diag(self.omega_squared), static[moving, moving] + ca.diag(ca.vertcat(*ends)))
        return _padded(ca.densify(K), self.d), self.on_coordinates(elastic)

    def springs(self) -> tuple[list[int], Matrix, Matrix]:
        """Ports of the attached springs, their stiffnesses (s, s), and the rows of their stretching (s, d)."""
        ends, first = self.ends, self.seen + len(self.ends.masses)
        at = list(range(first, self.rows.shape[0]))
        stiff = [*(spring.stiffness for spring in ends.springs), *(spring.stiffness for spring in self.resonators)]
        W = self.rows[at, :]
        for i in range(len(ends.resonators)):
            W[len(ends.springs) + i, len(self.kept) + i] -= 1.0
        if ends.tip_stiffness is not None:
            at, stiff, W = [0, *at], [ends.tip_stiffness, *stiff], ca.vertcat(self.rows[0, :], W)
        return at, ca.diag(ca.vertcat(*stiff)), W


def _padded(block: Matrix, size: int) -> Matrix:
    """A matrix with `block` in its upper corner and zeros elsewhere."""
    more = size - block.size1()
    return ca.densify(ca.diagcat(block, ca.DM.zeros(more, more))) if more else block
