"""The beam of a rig file as finite elements, with any supports at its ends: places anywhere, axial motion too."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, ClassVar, Literal, get_args

import numpy as np
from scipy import sparse

from models.beam import Beam
from models.bodies.matrix import MatrixBody
from models.bodies.ported import Elastic, PlaceError, PortedModes
from models.friction.law import Parameter
from models.parts import Damping
from models.plausible import Proportion
from models.structure import Array

End = Literal["clamped", "supported", "free"]

ELEMENTS = 60
PER_MODE = 8
"""Fewest Hermite elements, and per mode: they make the frequencies to 1e-5."""

SAME, NEAREST = 1e-9, 2e-4
"""Shares of the length: places nearer than the first are one, further apart than the second they are two."""

ALONG, BESIDE = 48, 0.1
"""Places along it where no one touches it, and shares of the way between two within which one is that of another."""

REFERENCE = 1e11
"""Young's modulus with which matrices are made, whatever that of the beam [Pa]."""

PLACE = re.compile(r"(y|slope|axial)\(([0-9.eE+-]+)\)")

MOTIONS = ("axial", "y", "slope")
"""Displacements of a node, in their order: along the beam, across it, rotation."""

TRANSLATIONS = ("axial", "y")


@dataclass(frozen=True)
class FiniteBeam(Elastic):
    """A beam of Hermite elements with bars along them.

    Its places are ``y(x)`` (deflection), ``slope(x)`` (rotation) and ``axial(x)`` at x [m]; its supports the ends'
    ``y(0)``, ``slope(0)``... that are held.

    Attributes
    ----------
    beam : Beam
        Geometry, material and number of modes.
    root, tip : {"clamped", "supported", "free"}
        How x = 0 and x = L are held; a supported end keeps its height, and the root its place along the beam.
    """

    STIFFNESS: ClassVar[str] = "beam.youngs_modulus"
    MODES: ClassVar[str] = "beam.modes"

    beam: Beam
    root: End = "clamped"
    tip: End = "supported"

    def __post_init__(self) -> None:
        """Refuse ends that are none."""
        for name in ("root", "tip"):
            if getattr(self, name) not in get_args(End):
                raise ValueError(
                    f'FiniteBeam: {name} = "{getattr(self, name)}"; must be one of {", ".join(get_args(End))}'
                )

    @property
    def quantities(self) -> Iterator[tuple[str, str, Any]]:
        """Key of the rig file, quantity of :mod:`models.plausible`, value."""
        return self.beam.quantities

    @property
    def proportions(self) -> Iterator[Proportion]:
        """Numbers that are usually less than others of it."""
        return self.beam.proportions

    def __str__(self) -> str:
        """Dimensions and supports in words."""
        b = self.beam
        measures = " x ".join(f"{1e3 * size:g}" for size in (b.length, b.width, b.thickness))
        return (
            f"beam {measures} mm, E {1e-9 * b.youngs_modulus:g} GPa, density {b.density:g} kg/m3, "
            f"{b.modes} modes, root {self.root}, tip {self.tip}"
        )

    @property
    def modes(self) -> int:
        """How many are kept."""
        return self.beam.modes

    @property
    def damped_by_modes(self) -> bool:
        """It brings no damping matrix."""
        return True

    @property
    def _stiffness(self) -> tuple[float, Parameter]:
        return self.beam.youngs_modulus, Parameter("Pa", "Young's modulus", "")

    def _stiffened(self, value: float) -> "FiniteBeam":
        return replace(self, beam=replace(self.beam, youngs_modulus=value))

    def translations(self, place: str) -> tuple[str, ...]:
        """Return deflection and axial motion where a place is, as far as it is not held."""
        match = PLACE.fullmatch(place)
        if match is None or match[1] not in TRANSLATIONS:
            return (place,)
        at, length = self._place(place)[1], self.beam.length
        ends = ((0.0, self.root), (length, self.tip))
        fixed = [dof for x, end in ends if abs(at - x) <= SAME * length for dof in self._fixed(x, end, root=x == 0.0)]
        held = {dof.split("@")[0] for dof in fixed}
        free = [motion for motion in TRANSLATIONS if motion not in held]
        return tuple(f"{motion}({match[2]})" for motion in free) or (place,)

    def elsewhere(self, places: Sequence[str]) -> tuple[str, ...]:
        """Return deflections evenly along it, not beside places that are known."""
        step, known = self.spacing, [self._place(place)[1] for place in places]
        even = (step * i for i in range(1, ALONG + (self.tip == "free")))
        return tuple(f"y({x:.6g})" for x in even if all(abs(x - other) > BESIDE * step for other in known))

    @property
    def spacing(self) -> float:
        """Between these [m]."""
        return self.beam.length / ALONG

    def along(self, place: str, aside: float) -> str:
        """Return the place so far on from one [m], or where the beam ends."""
        motion, x = self._place(place)
        return f"{motion}({min(max(x + aside, 0.0), self.beam.length):.7g})"

    def everywhere(self, names: Sequence[str], places: Sequence[str]) -> tuple[Array, Array]:
        """Rows (f, n) of names in the modes with places, and their flexibility (f, p) to these."""
        here, there, f = self.ported(places, Damping()), self.ported([*names, *places], Damping()), len(names)
        alike = np.sum(here.rows * there.rows[f:], axis=0)
        turned = np.where(alike < 0.0, -1.0, 1.0)  # modes have no sign of their own
        return there.rows[:f] * turned, there.flexibility[:f, f:]

    def with_modes(self, modes: int, places: Sequence[str]) -> "FiniteBeam":
        """Return the same beam with another number of modes."""
        return replace(self, beam=replace(self.beam, modes=modes))

    def ported(self, places: Sequence[str], damping: Damping, supports: Sequence[str] = ()) -> PortedModes:
        """Return its modes with the rows of places.

        Raises
        ------
        ValueError
            If a place is not on the beam, or a support is none.
        """
        asked = [self._place(place) for place in places]
        nodes = self._nodes([x for _, x in asked])
        at = [(motion, nodes[int(np.argmin(np.abs(nodes - x)))]) for motion, x in asked]
        # modes are worked out once for all moduli
        matrices = _matrices(self._stiffened(REFERENCE), tuple(nodes.tolist()))
        matrices = matrices.with_numbers({MatrixBody.STIFFNESS: self.beam.youngs_modulus / REFERENCE})
        known = {_support(name): name for name in matrices.fixed}
        missing = next((name for name in supports if name not in known), None)
        if missing is not None:
            named = ", ".join(known) or "none"
            raise PlaceError(f'no support "{missing}"; there are {named}', missing, f"supports are {named}")
        found = matrices.ported(
            [f"{motion}@{float(x)!r}" for motion, x in at], damping, [known[name] for name in supports]
        )
        return replace(found, places=tuple(places), supports=tuple(supports))

    def _nodes(self, positions: Sequence[float]) -> Array:
        """Places where something touches, and both ends, ascending; places that only rounding sets apart are one.

        Raises
        ------
        ValueError
            If places are so near that an element between them would spoil the others.
        """
        length = self.beam.length
        inner = np.sort([x for x in positions if SAME * length < x < (1.0 - SAME) * length])
        inner = inner[np.diff(inner, prepend=-length) > SAME * length]
        nodes = np.concatenate([[0.0], inner, [length]])
        i = int(np.argmin(np.diff(nodes)))
        if nodes[i + 1] - nodes[i] < NEAREST * length:
            least = f"{NEAREST * length:.2g} m"
            raise ValueError(
                f"places at {nodes[i]:.9g} and {nodes[i + 1]:.9g} m; must be the same or further apart than {least}"
            )
        return nodes

    def _place(self, place: str) -> tuple[str, float]:
        match, length = PLACE.fullmatch(place), self.beam.length
        try:
            x = float(match[2]) if match else -1.0
        except ValueError:
            x = -1.0
        if match is None or not 0.0 <= x <= length:
            accepted = f"must be y(x), slope(x) or axial(x) with x 0 to {length:g}"
            raise PlaceError(f'no place "{place}" on the beam; {accepted}', place, accepted)
        return match[1], x

    def matrices(self, positions: Sequence[float] = ()) -> MatrixBody:
        """Matrices with a node at every position [m]; degrees of freedom are named ``y@x`` and so on."""
        b = self.beam
        elements = max(ELEMENTS, PER_MODE * b.modes)
        even = np.linspace(0.0, b.length, elements + 1)
        # a node where something touches takes the place of the nearest one, unless that is an end
        wanted = sorted({0.0, b.length, *map(float, positions)})
        apart = np.min(np.abs(even[:, None] - np.array(wanted)), axis=1) > 0.3 * b.length / elements
        x = np.array(sorted([*wanted, *even[apart].tolist()]))
        M, K = _assembled(b, np.diff(x))
        names = tuple(f"{motion}@{float(at)!r}" for at in x for motion in MOTIONS)
        fixed = [*self._fixed(0.0, self.root, root=True), *self._fixed(float(b.length), self.tip, root=False)]
        return MatrixBody(M, K, dofs=names, fixed=tuple(fixed), modes=b.modes)

    def _fixed(self, x: float, end: End, root: bool) -> list[str]:
        held = {"clamped": ("y", "slope"), "supported": ("y",), "free": ()}[end]
        along = ("axial",) if root and end != "free" else ()
        return [f"{motion}@{x!r}" for motion in (*along, *held)]


@lru_cache(maxsize=16)
def _matrices(beam: FiniteBeam, nodes: tuple[float, ...]) -> MatrixBody:
    """Its matrices, whose modes are worked out once where only damping and joints change."""
    return beam.matrices(nodes)


def _support(dof: str) -> str:
    """Name of a place of a degree of freedom, ``y@0.6`` as ``y(0.6)``."""
    motion, x = dof.split("@")
    return f"{motion}({float(x):g})"


def _assembled(
    b: Beam, lengths: np.ndarray[tuple[int], np.dtype[np.float64]]
) -> tuple[sparse.csr_array, sparse.csr_array]:
    """Mass and stiffness of Hermite elements with bars of given lengths."""
    EI, EA, m = b.bending_stiffness, b.youngs_modulus * b.area, b.mass_per_length
    rows, columns, masses, stiffnesses = [], [], [], []
    for e, h in enumerate(lengths):
        bending = [3 * e + 1, 3 * e + 2, 3 * e + 4, 3 * e + 5]
        along = [3 * e, 3 * e + 3]
        k = (
            EI
            / h**3
            * np.array(
                [
                    [12, 6 * h, -12, 6 * h],
                    [6 * h, 4 * h**2, -6 * h, 2 * h**2],
                    [-12, -6 * h, 12, -6 * h],
                    [6 * h, 2 * h**2, -6 * h, 4 * h**2],
                ]
            )
        )
        mass = (
            m
            * h
            / 420
            * np.array(
                [
                    [156, 22 * h, 54, -13 * h],
                    [22 * h, 4 * h**2, 13 * h, -3 * h**2],
                    [54, 13 * h, 156, -22 * h],
                    [-13 * h, -3 * h**2, -22 * h, 4 * h**2],
                ]
            )
        )
        pairs = [
            (bending, k, mass),
            (along, EA / h * np.array([[1, -1], [-1, 1]]), m * h / 6 * np.array([[2, 1], [1, 2]])),
        ]
        for at, k_e, m_e in pairs:
            i, j = np.meshgrid(at, at, indexing="ij")
            rows.append(i.ravel())
            columns.append(j.ravel())
            stiffnesses.append(k_e.ravel())
            masses.append(m_e.ravel())
    size = 3 * (len(lengths) + 1)
    index = np.concatenate(rows), np.concatenate(columns)
    M, K = (sparse.csr_array((np.concatenate(v), index), shape=(size, size)) for v in (masses, stiffnesses))
    return M, K
