"""A body given by its modes at named ports, measured or computed elsewhere."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import ClassVar, NamedTuple

import numpy as np

from models.bodies.ported import PlaceError, PortedModes, meant, same_point
from models.bounds import bounded
from models.friction.law import Parameter
from models.parts import Damping
from models.plausible import plausible
from models.structure import Array

Rows = tuple[tuple[float, ...], ...]

SYMMETRIC = 1e-9
"""Share of the largest entry by which a matrix may differ from its transpose, or damp less than not at all."""


@dataclass(frozen=True, eq=False)
class ModalModel:
    """Mass-normalised modes with their shapes at named ports.

    Attributes
    ----------
    frequencies_hz : tuple of float, (n,)
        Natural frequencies without joints, ascending; 0 where the body moves as a rigid one [Hz].
    ports : mapping of str to (n,) tuple of float
        Shapes at each port, displacement per unit of a mass-normalised mode.
    flexibility : (p, p) tuple of tuples or None
        Residual flexibility between the ports, in their order: static response of the modes left out [m/N]; none of it
        where omitted.
    damping_matrix : (n, n) tuple of tuples or None
        Viscous damping between the modes [1/s], in place of ratios.
    reactions : mapping of str to (n,) tuple of float
        For each support, its reaction per modal acceleration [kg per unit of a mass-normalised mode].
    shares : mapping of str to (p,) tuple of float
        Displacement of each port per unit displacement of the support, at rest; 0 where omitted.
    """

    frequencies_hz: tuple[float, ...]
    ports: Mapping[str, tuple[float, ...]]
    flexibility: Rows | None = None
    damping_matrix: Rows | None = None
    reactions: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    shares: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    MODES: ClassVar[str] = ""

    def __post_init__(self) -> None:
        """Refuse frequencies that are none, and rows or matrices of another size."""
        for i, hz in enumerate(self.frequencies_hz, 1):
            bounded(f"modal.frequencies_hz[{i}]", hz, 0.0)
            plausible(f"modal.frequencies_hz[{i}]", hz, "frequencies_hz")
        for i, (lower, upper) in enumerate(pairwise(self.frequencies_hz), start=2):
            if upper < lower:
                after = f"frequencies_hz[{i}] = {upper:g} after {lower:g}"
                raise ValueError(f"modal.{after}; must ascend, sort them and the shapes with them")
        n, p = len(self.frequencies_hz), len(self.ports)
        sizes = [(f"ports.{name}", row, n) for name, row in self.ports.items()]
        sizes += [(f"reactions.{name}", row, n) for name, row in self.reactions.items()]
        sizes += [(f"shares.{name}", row, p) for name, row in self.shares.items()]
        for what, row, size in sizes:
            if len(row) != size:
                raise ValueError(f"modal.{what} has {len(row)} entries; must have {size}")
            for i, entry in enumerate(row, 1):
                bounded(f"modal.{what}[{i}]", entry)
                plausible(f"modal.{what}[{i}]", entry, "shape")
        for what, matrix, size in (("flexibility", self.flexibility, p), ("damping_matrix", self.damping_matrix, n)):
            if matrix is None:
                continue
            if len(matrix) != size or any(len(row) != size for row in matrix):
                raise ValueError(f"modal.{what} has rows of other lengths; must be {size} x {size}")
            values = np.array(matrix, dtype=float)
            for entry in values.ravel():
                bounded(f"modal.{what}", entry)
                plausible(f"modal.{what}", entry, "entry")
            skew = np.abs(values - values.T)
            if skew.max() > SYMMETRIC * np.abs(values).max():
                i, j = (int(at) for at in np.unravel_index(skew.argmax(), skew.shape))
                mirrored = f"[{i + 1}][{j + 1}] = {values[i, j]:g} and [{j + 1}][{i + 1}] = {values[j, i]:g}"
                raise ValueError(f"modal.{what}{mirrored}; must be the same, the matrix is symmetric")
        if self.damping_matrix is not None:
            lowest, largest = np.linalg.eigvalsh(np.array(self.damping_matrix, dtype=float))[[0, -1]]
            if lowest < -SYMMETRIC * abs(largest):
                raise ValueError(f"modal.damping_matrix has the eigenvalue {lowest:.3g}; must have none below 0")

    def __str__(self) -> str:
        """Modes in a few words."""
        hz = self.frequencies_hz
        return f"{len(hz)} modes given, {hz[0]:.6g} to {hz[-1]:.6g} Hz, at {len(self.ports)} ports"

    @property
    def modes(self) -> int:
        """How many there are."""
        return len(self.frequencies_hz)

    @property
    def damped_by_modes(self) -> bool:
        """Whether it brings no damping matrix."""
        return self.damping_matrix is None

    @cached_property
    def numbers(self) -> dict[str, tuple[float, Parameter]]:
        """Frequencies of modes that are not rigid, shapes at the ports, entries of a damping matrix and of flexibility.

        ``modal.ports.tip[2]`` is of mode 2, ``modal.damping_matrix[1][2]`` of modes 1 and 2,
        ``modal.flexibility[1][2]`` of ports 1 and 2.
        """
        found = {
            _frequency(i): (hz, Parameter("Hz", "natural frequency", "")) for i, hz in enumerate(self.frequencies_hz)
        }
        found = {key: number for key, number in found.items() if number[0] > 0.0}
        shape = Parameter("kg^-1/2", "mass-normalised shape", "", lower=-np.inf)
        between = Parameter("1/s", "viscous damping between two modes", "", lower=-np.inf)
        own = Parameter("1/s", "viscous damping of a mode", "", strict=False)
        found |= {key: (value, own if i == j else between) for (i, j), key, value in self._dampers}
        residual = Parameter("m/N", "residual flexibility between two ports", "", lower=-np.inf)
        found |= {key: (value, residual) for _, key, value in self._residuals}
        return found | {
            _shape(name, i): (entry, shape) for name, row in self.ports.items() for i, entry in enumerate(row)
        }

    def with_numbers(self, values: Mapping[str, float]) -> "ModalModel":
        """Return the same modes with other values of some of these.

        Of entries of a damping matrix that would give energy, it has the nearest ones that do not.
        """
        hz = [values.get(_frequency(i), value) for i, value in enumerate(self.frequencies_hz)]
        ports = {
            name: tuple(values.get(_shape(name, i), entry) for i, entry in enumerate(row))
            for name, row in self.ports.items()
        }
        changed = replace(self, frequencies_hz=tuple(hz), ports=ports) if values else self
        if _among(self._residuals, values):
            changed = replace(changed, flexibility=_rows(_with_entries(self.flexibility, self._residuals, values)))
        return replace(changed, damping_matrix=self._damped(values)) if _among(self._dampers, values) else changed

    def change(self, key: str, here: PortedModes, damping: Damping) -> PortedModes:
        """Return the derivatives of its modes and rows `here` to one of its numbers."""
        none, modes = here.nothing, range(self.modes)
        if between := _among(self._dampers, [key]):
            D = _mirrored(np.zeros_like(here.damping), between[0], 1.0)
            return replace(none, damping=D, reaction_damping=here.reaction_inertia @ D)
        if between := _among(self._residuals, [key]):
            known = list(self.ports)
            at = [known.index(name) for name in here.places]
            return replace(none, flexibility=_mirrored(np.zeros((len(known),) * 2), between[0], 1.0)[np.ix_(at, at)])
        if key not in map(_frequency, modes):
            entries = [[key == _shape(name, i) for i in modes] for name in here.places]
            return replace(none, rows=np.array(entries, dtype=float).reshape(none.rows.shape))
        faster = 2 * np.pi * np.array([key == _frequency(i) for i in modes])
        if not self.damped_by_modes:
            return replace(none, omega_n=faster)
        dampers = damping.dampers(here.omega_n, np.arange(1, self.modes + 1))
        D = np.diag((dampers.slope + dampers.strain_rate) * 2 * here.omega_n * faster)
        return replace(none, omega_n=faster, damping=D, reaction_damping=here.reaction_inertia @ D)

    def translations(self, place: str) -> tuple[str, ...]:
        """Return the ports that are translations of the point of one of them."""
        return same_point(place, self.ports)

    def with_modes(self, modes: int, places: Sequence[str]) -> "ModalModel":
        """Return it without the modes beyond so many; it has no others to add.

        What the modes given up answer at rest goes into the flexibility.
        """
        if modes >= self.modes:
            return self
        kept = slice(0, modes)
        rows = np.array(list(self.ports.values()))[:, modes:]
        omega_n = 2 * np.pi * np.array(self.frequencies_hz[modes:])
        left = (rows / omega_n**2) @ rows.T
        old = np.zeros_like(left) if self.flexibility is None else np.array(self.flexibility)
        damping = self.damping_matrix
        return replace(
            self,
            frequencies_hz=self.frequencies_hz[kept],
            ports={name: row[kept] for name, row in self.ports.items()},
            flexibility=_rows(old + left),
            damping_matrix=None if damping is None else tuple(row[kept] for row in damping[kept]),
            reactions={name: row[kept] for name, row in self.reactions.items()},
        )

    def ported(self, places: Sequence[str], damping: Damping, supports: Sequence[str] = ()) -> PortedModes:
        """Return the modes with the rows of ports.

        Raises
        ------
        ValueError
            If there is no such port or support.
        """
        known = list(self.ports)
        for what, asked, there in (("port", places, known), ("support", supports, list(self.reactions))):
            missing = next((name for name in asked if name not in there), None)
            if missing is not None:
                named = (", ".join(there) or "none") + meant(missing, there)
                raise PlaceError(f'no {what} "{missing}"; there are {named}', missing, f"{what}s are {named}")
        at = [known.index(name) for name in places]
        n, p = self.modes, len(known)
        flexibility = np.zeros((p, p)) if self.flexibility is None else np.array(self.flexibility)
        D = self._damping(damping)
        inertia = np.array([self.reactions[name] for name in supports]).reshape(-1, n)
        shares = np.array([self.shares.get(name, (0.0,) * p) for name in supports]).reshape(-1, p)
        return PortedModes(
            omega_n=2 * np.pi * np.array(self.frequencies_hz),
            damping=D,
            places=tuple(places),
            rows=np.array([self.ports[name] for name in places]).reshape(-1, n),
            flexibility=flexibility[np.ix_(at, at)],
            supports=tuple(supports),
            reaction_inertia=inertia,
            reaction_damping=inertia @ D,
            reaction_share=shares[:, at],
        )

    def _damping(self, damping: Damping) -> Array:
        if self.damping_matrix is not None:
            return np.array(self.damping_matrix, dtype=float)
        omega_n = 2 * np.pi * np.array(self.frequencies_hz)
        dampers = damping.dampers(omega_n, np.arange(1, self.modes + 1))
        return np.diag(dampers.viscous + dampers.strain_rate * omega_n**2)

    # ---- entries of its symmetric matrices

    @property
    def _dampers(self) -> list["_Entry"]:
        return _entries("damping_matrix", self.damping_matrix)

    @property
    def _residuals(self) -> list["_Entry"]:
        return _entries("flexibility", self.flexibility)

    def _damped(self, values: Mapping[str, float]) -> Rows:
        """Damping matrix with other values, or the nearest one that takes energy only."""
        D = _with_entries(self.damping_matrix, self._dampers, values)
        size, axes = np.linalg.eigh(D)
        nearest = (axes * np.maximum(size, 0.0)) @ axes.T if size[0] < 0.0 else D
        return _rows(0.5 * (nearest + nearest.T))


class _Entry(NamedTuple):
    """An entry on or above the diagonal of a symmetric matrix."""

    at: tuple[int, int]
    key: str
    value: float


def _entries(name: str, matrix: Rows | None) -> list[_Entry]:
    """Entries on and above the diagonal."""
    rows = matrix or ()
    return [
        _Entry((i, j), f"modal.{name}[{i + 1}][{j + 1}]", row[j])
        for i, row in enumerate(rows)
        for j in range(i, len(rows))
    ]


def _among(entries: Sequence[_Entry], keys: Collection[str]) -> list[tuple[int, int]]:
    """Which entries keys are of."""
    return [entry.at for entry in entries if entry.key in keys]


def _with_entries(matrix: Rows | None, entries: Sequence[_Entry], values: Mapping[str, float]) -> Array:
    """The matrix with other values of some entries."""
    changed = np.array(matrix, dtype=float)
    for at, key, value in entries:
        _mirrored(changed, at, values.get(key, value))
    return changed


def _mirrored(matrix: Array, at: tuple[int, int], value: float) -> Array:
    """The matrix, in which an entry on either side of the diagonal has become a value."""
    matrix[at] = matrix[at[::-1]] = value
    return matrix


def _rows(matrix: Array) -> Rows:
    return tuple(map(tuple, matrix.tolist()))


def _frequency(i: int) -> str:
    return f"modal.frequencies_hz[{i + 1}]"


def _shape(port: str, i: int) -> str:
    return f"modal.ports.{port}[{i + 1}]"
