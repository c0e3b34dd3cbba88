"""Meshes of a beam, with or without a half cylinder under it, in columns and rows of quadrilaterals.

The half cylinder is two quarter cylinders, as in Figure 4b of the paper: each is one patch whose fourth corner lies in
the middle of its arc, where two sides of a quadrilateral meet in a straight line.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from models.bounds import bounded
from models.plane.library import skfem
from models.structure import Array

CORNER = np.pi / 4
"""Where the fourth corner of a quarter cylinder lies on its arc [rad], from the point of contact."""


Patch = tuple[Array, npt.NDArray[np.intp]]
"""Points (2, p), and the four corners of each quadrilateral, (4, e)."""


@dataclass(frozen=True)
class HalfCylinder:
    """A half cylinder glued under a beam, and how finely it is meshed.

    Attributes
    ----------
    position : float
        Of its centre along the beam [m].
    radius : float
        [m]
    spacing : float
        Of the nodes next to the point of contact [m].
    even : int
        How many nodes on either side of it keep that spacing.
    growth : float
        Ratio of the lengths of neighbouring elements beyond; the paper keeps it below 2.
    """

    position: float
    radius: float
    spacing: float = 8e-6
    even: int = 5
    growth: float = 1.5

    def __post_init__(self) -> None:
        """Refuse numbers that no half cylinder has."""
        for name in ("position", "radius", "spacing"):
            bounded(f"HalfCylinder: {name}", getattr(self, name), 0.0, strict=True)
        bounded("HalfCylinder: even", self.even, 1)
        bounded("HalfCylinder: growth", self.growth, 1.0, 2.0, strict=True)
        if self.even * self.spacing >= self.radius / 4:
            most = self.radius / 4 / self.even
            raise ValueError(f"HalfCylinder: spacing = {self.spacing:g}; must be < {most:g} m for {self.even} nodes")

    @property
    def across(self) -> Array:
        """Lengths of the elements along a quarter of it, from the point of contact, in units of all together."""
        arc = CORNER * self.radius
        lengths = [self.spacing] * self.even
        while sum(lengths) < arc:
            lengths.append(lengths[-1] * self.growth)
        # the growing ones are stretched alike, so that they end where the arc does
        grown = np.array(lengths)
        grown[self.even :] *= (arc - grown[: self.even].sum()) / grown[self.even :].sum()
        return np.asarray(grown / arc)

    @property
    def steps(self) -> Array:
        """Where its nodes lie along a quarter of it, from 0 at the point of contact to 1."""
        return np.concatenate([[0.0], np.cumsum(self.across)[:-1], [1.0]])


def beam_mesh(
    length: float,
    thickness: float,
    columns: int,
    rows: int,
    cylinder: HalfCylinder | None = None,
    stations: Sequence[float] = (),
) -> Any:
    """Mesh of a beam along x from 0 to `length`, its neutral axis at y = 0, with a half cylinder under it.

    Parameters
    ----------
    length, thickness : float
        [m]
    columns, rows : int
        Elements along the beam (up to the half cylinder, if there is one) and over its thickness.
    cylinder : HalfCylinder, optional
    stations : sequence of float
        Where along the beam nodes must lie [m]; the others are spread evenly between them.

    Returns
    -------
    skfem.MeshQuad

    Raises
    ------
    ValueError
        If the half cylinder does not fit under the beam, or a station lies elsewhere than before it.
    """
    levels = np.linspace(-thickness / 2, thickness / 2, rows + 1)
    if cylinder is None:
        return merged([_grid(*np.meshgrid(_spread(length, columns, stations), levels, indexing="ij"))])
    start, end = cylinder.position - cylinder.radius, cylinder.position + cylinder.radius
    if start <= 0.0 or end > length * (1 + 1e-12):
        raise ValueError(
            f"HalfCylinder: reaches from {start:g} to {end:g} m; must lie under the beam, 0 to {length:g} m"
        )
    s = cylinder.steps
    chord = cylinder.position + cylinder.radius * np.concatenate([-s[:0:-1], s])
    x = [_spread(start, columns, stations)[:-1], chord]
    beyond = round((length - end) / (start / columns))
    if length - end > 1e-12 * length:
        x.append(np.linspace(end, length, max(beyond, 1) + 1)[1:])
    patches = [_grid(*np.meshgrid(np.concatenate(x), levels, indexing="ij"))]
    for side in (-1, 1):
        across, down = _quarter(s, cylinder.radius)
        patches.append(_grid(cylinder.position + side * across, -thickness / 2 - down))
    return merged(patches)


def _spread(length: float, columns: int, stations: Sequence[float]) -> Array:
    """Nodes from 0 to a length: at the stations, and evenly between them."""
    for x in stations:
        if not 0.0 < x < length:
            raise ValueError(f"PlaneBeam: station = {x:g}; must be > 0 and < {length:g} m")
    ends = sorted({0.0, *stations, length})
    pieces = [np.linspace(a, b, max(1, round(columns * (b - a) / length)) + 1)[:-1] for a, b in pairwise(ends)]
    return np.concatenate([*pieces, [length]])


def _quarter(s: Array, radius: float) -> tuple[Array, Array]:
    """Nodes of a quarter cylinder, distances from its centre across and down, by columns and rows (Coons patch)."""
    t = s  # as fine downwards to the point of contact as across
    on_arc = CORNER * s  # from the point of contact
    up_arc = CORNER + (np.pi / 2 - CORNER) * t
    top = np.stack([radius * s, np.zeros(len(s))])
    bottom = radius * np.stack([np.sin(on_arc), np.cos(on_arc)])
    inner = np.stack([np.zeros(len(t)), radius * (1 - t)])
    outer = radius * np.stack([np.sin(up_arc), np.cos(up_arc)])
    S, T = s[None, :, None], t[None, None, :]
    sides = (1 - T) * bottom[:, :, None] + T * top[:, :, None] + (1 - S) * inner[:, None] + S * outer[:, None]
    corners = (1 - S) * ((1 - T) * bottom[:, :1, None] + T * top[:, :1, None])
    corners = corners + S * ((1 - T) * bottom[:, -1:, None] + T * top[:, -1:, None])
    across, down = sides - corners
    return across, down


def _grid(x: Array, y: Array) -> Patch:
    """Points (2, p) and quadrilaterals (4, e) of a patch given by its nodes (columns, rows)."""
    at = np.arange(x.size).reshape(x.shape)
    quads = np.stack([at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]]).reshape(4, -1)
    return np.stack([x.ravel(), y.ravel()]), quads


def merged(patches: list[Patch]) -> Any:
    """One mesh of patches that share the nodes of their common sides; corners counted counterclockwise."""
    first = np.cumsum([0, *(points.shape[1] for points, _ in patches)])
    points = np.hstack([points for points, _ in patches])
    quads = np.hstack([quads + start for (_, quads), start in zip(patches, first[:-1], strict=True)])
    size = np.ptp(points, axis=1).max()
    _, kept, number = np.unique(np.round(points / size, 10), axis=1, return_index=True, return_inverse=True)
    points, quads = points[:, kept], number.ravel()[quads]
    x, y = points[:, quads]
    area = sum(x[i] * y[(i + 1) % 4] - x[(i + 1) % 4] * y[i] for i in range(4))
    quads[:, area < 0.0] = quads[::-1, area < 0.0]
    return skfem.MeshQuad(np.ascontiguousarray(points), np.ascontiguousarray(quads))
