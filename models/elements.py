"""Nonlinear elements beside the contact: forces along the beam, each one symbolic definition.

An element reads the beam through rows, y = rows q and y_t = rows q_t, and pushes along the same rows with a force that
is one CasADi expression of them: what it does to the modes is ``rows' force``, and power is conserved exactly. Its
forces act on the modes kept; what the modes left out would answer converges with their number.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple, Protocol

import casadi as ca
import numpy as np

from models.friction.law import Value, parameter
from models.structure import Array, SpringPort


class Reading(Enum):
    """Kind of motion that the rows of an element read."""

    POINT = "the deflection at its position"
    SPAN = "the deflection at Gauss points along the beam"
    STRETCH = "a root of the shortening, so that y'y = q'Gq"
    SUPPORT = "what pulls the tip off its support, in units of the load that holds it there"


class Element(Protocol):
    """A nonlinear element: a frozen dataclass whose fields are its parameters (numbers or CasADi symbols).

    One that reads a point has a field `position` [m].
    """

    name: ClassVar[str]
    reads: ClassVar[Reading]

    def force(self, y: Value, y_t: Value, weight: Value) -> Value:
        """Force along each row from all (r,) deflections and velocities; weight is the length of beam of a row [m]."""
        ...


@dataclass(frozen=True, eq=False)
class MidplaneStretching:
    """Axial restraint: generalised force -(k/2) (q'Gq) G q."""

    name: ClassVar[str] = "midplane-stretching"
    reads: ClassVar[Reading] = Reading.STRETCH

    axial_stiffness: Value = field(
        metadata=parameter("N/m", "stiffness against the shortening of the beam", "catalogue of causes", strict=False)
    )

    def force(self, y: Value, y_t: Value, weight: Value) -> Value:
        """Tension times the slopes."""
        return -self.axial_stiffness / 2 * ca.sumsqr(y) * y


@dataclass(frozen=True, eq=False)
class QuadraticDrag:
    """Distributed force -c y_t |y_t|."""

    name: ClassVar[str] = "quadratic-drag"
    reads: ClassVar[Reading] = Reading.SPAN

    coefficient: Value = field(
        metadata=parameter("N s2/m2 per m", "drag per length of beam", "catalogue of causes", strict=False)
    )

    def force(self, y: Value, y_t: Value, weight: Value) -> Value:
        """Drag on the length of beam at each point."""
        return -self.coefficient * weight * y_t * ca.fabs(y_t)


@dataclass(frozen=True, eq=False)
class ImpactStop:
    """One-sided spring, in touch where y > gap."""

    name: ClassVar[str] = "impact-stop"
    reads: ClassVar[Reading] = Reading.POINT

    gap: Value = field(metadata=parameter("m", "clearance", "catalogue of causes", lower=-float("inf")))
    stiffness: Value = field(metadata=parameter("N/m", "stiffness of the stop", "catalogue of causes", strict=False))
    position: Value = field(metadata=parameter("m", "place on the beam", "catalogue of causes"))

    def force(self, y: Value, y_t: Value, weight: Value) -> Value:
        """Push back what is beyond the gap."""
        return -self.stiffness * ca.fmax(y - self.gap, 0.0)


@dataclass(frozen=True, eq=False)
class LiftOff:
    """A tip that leaves its support where nothing holds it there, and bears no tension then.

    What the modes of the supported beam leave of the tip's motion has no inertia: off its support the tip is where the
    beam's elasticity puts it, a distance in proportion to the tension that is not borne (Monjaraz-Tec, Gross and Krack,
    Nonlinear Dynamics 2022, on contacts without mass). The load and the stiffness of the tip are in row and weight.
    Friction needs not be looked at: bounded by the reaction it has vanished before the tip leaves.
    """

    name: ClassVar[str] = "contact-loss"
    reads: ClassVar[Reading] = Reading.SUPPORT

    def force(self, y: Value, y_t: Value, weight: Value) -> Value:
        """Give back the tension beyond the load."""
        return weight * ca.fmax(y - 1.0, 0.0)


ELEMENTS: dict[str, type] = {e.name: e for e in (MidplaneStretching, QuadraticDrag, ImpactStop)}
"""Every element by its name."""

GAUSS_POINTS_PER_MODE = 4
LEAST_GAUSS_POINTS = 32


@lru_cache(maxsize=16)
def gauss_points(modes: int) -> tuple[Array, Array]:
    """Places and weights of a quadrature over 0..1 that resolves products of modes and of their magnitudes."""
    nodes, weights = np.polynomial.legendre.leggauss(max(LEAST_GAUSS_POINTS, GAUSS_POINTS_PER_MODE * modes))
    return (nodes + 1) / 2, weights / 2


class ElementRows(NamedTuple):
    """Shapes at the places where elements touch the beam, row by row; or their derivatives to p parameters, p first.

    Attributes
    ----------
    rows : (r, n) array
        Rows of deflections on the modes.
    share : (r,) array
        Share of a unit force along each row that goes into the support.
    weight : (r,) array
        Length of beam of each row [m]; of a tip that lifts off, the work of its load on what it yields to it [J]; else
        1.
    static : (r, 1 + c) array
        What a unit force along each row does to drive and channels beyond the modes; by reciprocity, the first is what
        the row reads of the excitation.
    """

    rows: Array
    share: Array
    weight: Array
    static: Array

    def under(self, load: float) -> "ElementRows":
        """Rows of a tip held on its support by a multiple of the load."""
        return ElementRows(self.rows / load, self.share / load, self.weight * load**2, self.static / load)


class Ports(NamedTuple):
    """Motions of a structure that elements can read; or the derivatives to p parameters, p first.

    Attributes
    ----------
    rows : (e, n) array
        Deflections: at the positions of the elements that read a point, then at Gauss points if one reads the span.
    share : (e,) array
        Share of a unit force at each that goes into the support.
    shortening : (n, n) array
        G.
    stretch : (n,) array
        Integral of phi_i' s'.
    length : float or (p,) array
        Length of the beam [m].
    channels : int
        Number of response channels.
    support : SpringPort or None
        Port of the support, where the tip can lift off.
    load : float or (p,) array
        That holds the tip on the support [N].
    """

    rows: Array
    share: Array
    shortening: Array
    stretch: Array
    length: Any
    channels: int
    support: SpringPort | None = None
    load: Any = 0.0


def ports_of(elements: Sequence[Element]) -> list[int]:
    """Port that each element reads if it reads a point; else where the Gauss points begin."""
    reads = [e.reads is Reading.POINT for e in elements]
    total = sum(reads)
    return [sum(reads[:i]) if point else total for i, point in enumerate(reads)]


def element_rows(elements: Sequence[Element], ports: Ports, modes: int) -> list[ElementRows]:
    """Rows of each element.

    Parameters
    ----------
    elements : sequence of Element
    ports : Ports
    modes : int
        Number of modes of the beam, as for :func:`gauss_points`.
    """
    return [_rows(e, first, ports, modes) for e, first in zip(elements, ports_of(elements), strict=True)]


def _rows(element: Element, first: int, ports: Ports, modes: int) -> ElementRows:
    if element.reads is Reading.SUPPORT:
        return _lifting_rows(_support(ports), ports.load)
    if element.reads is Reading.STRETCH:
        root, inverse = _root(ports.shortening)
        found = root, inverse.T @ ports.stretch, np.ones(len(root))
    elif element.reads is Reading.SPAN:
        found = ports.rows[first:], ports.share[first:], gauss_points(modes)[1] * ports.length
    else:
        found = ports.rows[first : first + 1], ports.share[first : first + 1], np.ones(1)
    return ElementRows(*found, np.zeros((len(found[0]), 1 + ports.channels)))


def _support(ports: Ports) -> SpringPort:
    """Port of the support.

    Raises
    ------
    ValueError
        If the tip cannot lift off.
    """
    if ports.support is None:
        raise ValueError("contact-loss: where the tip would lift off is not known; must have lift_off = true")
    return ports.support


def _lifting_rows(support: SpringPort, load: float) -> ElementRows:
    by_force = support.residual / load
    weight = np.array([load**2 / support.stiffness])
    return ElementRows(support.row[None] / load, -by_force[-1:], weight, by_force[None, 1:-1])


def element_rows_change(elements: Sequence[Element], ports: Ports, change: Ports, modes: int) -> list[ElementRows]:
    """Derivatives of :func:`element_rows` with those of the ports, p parameters first."""
    firsts = ports_of(elements)
    return [_rows_change(e, first, ports, change, modes) for e, first in zip(elements, firsts, strict=True)]


def _rows_change(element: Element, first: int, ports: Ports, d: Ports, modes: int) -> ElementRows:
    if element.reads is Reading.SUPPORT:
        return _lifting_change(_support(ports), ports.load, _support(d), d.load)
    if element.reads is Reading.STRETCH:
        root, inverse = _root(ports.shortening)
        # one of the roots of the changed shortening: the element does not mind which
        rows = inverse.T @ d.shortening @ (np.eye(len(ports.shortening)) - inverse @ root / 2)
        share = inverse.T @ ports.stretch
        d_share = (d.stretch - np.einsum("prn,r->pn", rows, share)) @ inverse
        found = rows, d_share, np.zeros((len(rows), len(root)))
    elif element.reads is Reading.SPAN:
        found = d.rows[:, first:], d.share[:, first:], np.multiply.outer(d.length, gauss_points(modes)[1])
    else:
        here = slice(first, first + 1)
        found = d.rows[:, here], d.share[:, here], np.zeros((len(d.rows), 1))
    return ElementRows(*found, np.zeros((*found[0].shape[:2], 1 + d.channels)))


def _lifting_change(support: SpringPort, load: float, d: SpringPort, d_load: Array) -> ElementRows:
    """Derivatives of :func:`_lifting_rows`."""
    row = d.row / load - np.outer(d_load / load**2, support.row)
    by_force = d.residual / load - np.outer(d_load / load**2, support.residual)
    weight = 2.0 * load * d_load / support.stiffness - (load / support.stiffness) ** 2 * d.stiffness
    return ElementRows(row[:, None], -by_force[:, -1:], weight[:, None], by_force[:, None, 1:-1])


LEAST_STRETCH = 1e-12
"""Share of the largest stretch below which a combination of modes, such as a resonator, counts as not stretched."""


def _root(shortening: Array) -> tuple[Array, Array]:
    """A root (r, n) of the shortening, G = root' root, and its right inverse (n, r)."""
    squares, shapes = np.linalg.eigh(shortening)
    kept = squares > LEAST_STRETCH * squares[-1]
    size = np.sqrt(squares[kept])
    return size[:, None] * shapes[:, kept].T, shapes[:, kept] / size
