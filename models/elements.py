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
from models.structure import Array


class Reading(Enum):
    """What the rows of an element are."""

    POINT = "the deflection at its position"
    SPAN = "the deflection at Gauss points along the beam"
    STRETCH = "a root of the shortening, so that y'y = q'Gq"


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
        metadata=parameter("N/m", "stiffness against the shortening of the beam", "formats.md section 6", strict=False)
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
        metadata=parameter("N s2/m2 per m", "drag per length of beam", "formats.md section 6", strict=False)
    )

    def force(self, y: Value, y_t: Value, weight: Value) -> Value:
        """Drag on the length of beam at each point."""
        return -self.coefficient * weight * y_t * ca.fabs(y_t)


@dataclass(frozen=True, eq=False)
class ImpactStop:
    """One-sided spring, in touch where y > gap."""

    name: ClassVar[str] = "impact-stop"
    reads: ClassVar[Reading] = Reading.POINT

    gap: Value = field(metadata=parameter("m", "clearance", "formats.md section 6", lower=-float("inf")))
    stiffness: Value = field(metadata=parameter("N/m", "stiffness of the stop", "formats.md section 6", strict=False))
    position: Value = field(metadata=parameter("m", "place on the beam", "formats.md section 6"))

    def force(self, y: Value, y_t: Value, weight: Value) -> Value:
        """Push back what is beyond the gap."""
        return -self.stiffness * ca.fmax(y - self.gap, 0.0)


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
    """Where elements touch the beam, the rows of all elements in turn; or the derivatives to p parameters, p first.

    Attributes
    ----------
    rows : (r, n) array
        Of deflections on the modes.
    share : (r,) array
        Of a unit force along each row that goes into the support.
    weight : (r,) array
        Length of beam of each row [m]; 1 where it stands for none.
    """

    rows: Array
    share: Array
    weight: Array


class Ports(NamedTuple):
    """What elements can read of a structure; or the derivatives to p parameters, p first.

    Attributes
    ----------
    rows : (e, n) array
        Deflections: at the positions of the elements that read a point, then at Gauss points if one reads the span.
    share : (e,) array
        Of a unit force at each that goes into the support.
    shortening : (n, n) array
        G.
    stretch : (n,) array
        Integral of phi_i' s'.
    length : float or (p,) array
        Of the beam [m].
    """

    rows: Array
    share: Array
    shortening: Array
    stretch: Array
    length: Any


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
        Of the beam, as for :func:`gauss_points`.
    """
    return [_rows(e, first, ports, modes) for e, first in zip(elements, ports_of(elements), strict=True)]


def _rows(element: Element, first: int, ports: Ports, modes: int) -> ElementRows:
    if element.reads is Reading.STRETCH:
        root, inverse = _root(ports.shortening)
        return ElementRows(root, inverse.T @ ports.stretch, np.ones(len(root)))
    if element.reads is Reading.SPAN:
        return ElementRows(ports.rows[first:], ports.share[first:], gauss_points(modes)[1] * ports.length)
    return ElementRows(ports.rows[first : first + 1], ports.share[first : first + 1], np.ones(1))


def element_rows_change(elements: Sequence[Element], ports: Ports, change: Ports, modes: int) -> list[ElementRows]:
    """Derivatives of :func:`element_rows` with those of the ports, p parameters first."""
    firsts = ports_of(elements)
    return [_rows_change(e, first, ports, change, modes) for e, first in zip(elements, firsts, strict=True)]


def _rows_change(element: Element, first: int, ports: Ports, d: Ports, modes: int) -> ElementRows:
    if element.reads is Reading.STRETCH:
        root, inverse = _root(ports.shortening)
        # one of the roots of the changed shortening: the element does not mind which
        rows = inverse.T @ d.shortening @ (np.eye(len(ports.shortening)) - inverse @ root / 2)
        share = inverse.T @ ports.stretch
        d_share = (d.stretch - np.einsum("prn,r->pn", rows, share)) @ inverse
        return ElementRows(rows, d_share, np.zeros((len(rows), len(root))))
    if element.reads is Reading.SPAN:
        weight = np.multiply.outer(d.length, gauss_points(modes)[1])
        return ElementRows(d.rows[:, first:], d.share[:, first:], weight)
    here = slice(first, first + 1)
    return ElementRows(d.rows[:, here], d.share[:, here], np.zeros((len(d.rows), 1)))


LEAST_STRETCH = 1e-12
"""Of the largest: combinations of modes that are stretched less, as a swinging resonator, are not."""


def _root(shortening: Array) -> tuple[Array, Array]:
    """A root (r, n) of the shortening, G = root' root, and its right inverse (n, r)."""
    squares, shapes = np.linalg.eigh(shortening)
    kept = squares > LEAST_STRETCH * squares[-1]
    size = np.sqrt(squares[kept])
    return size[:, None] * shapes[:, kept].T, shapes[:, kept] / size
