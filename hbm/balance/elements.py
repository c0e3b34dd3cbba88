"""Nonlinear elements over one period: coefficients of the motion in, of the forces on the modes out.

Each sample is differentiated by CasADi in what the rows of the elements read; between the modes the derivative is a
product with the Fourier coefficients of these slopes, so that no sum over samples meets a pair of modes.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np
import numpy.typing as npt

from hbm.aft.steady import buffered
from hbm.fourier import Array, FourierBasis
from models.elements import ElementRows, Reading
from models.friction import chosen, describe, parameters, with_symbols
from models.rig import Rig


class Entries(NamedTuple):
    """Slopes (N_t, entries) of the forces along rows to what columns read, (entries,) each."""

    k: Array
    row: npt.NDArray[np.intp]
    column: npt.NDArray[np.intp]

    def along(self, rows: npt.NDArray[np.bool_]) -> "Entries | None":
        """Those along some rows; None where there are none."""
        return self._kept(rows[self.row])

    @property
    def acting(self) -> "Entries | None":
        """Those that are not zero all along; None where there are none."""
        return self._kept(np.asarray(self.k.any(axis=0)))

    def _kept(self, kept: npt.NDArray[np.bool_]) -> "Entries | None":
        return Entries(self.k[:, kept], self.row[kept], self.column[kept]) if kept.any() else None


class ElementSlope:
    """Derivatives of the forces on modes and support, of :class:`ElementsOverPeriod`, worked out when asked for.

    Parameters
    ----------
    elements : ElementsOverPeriod
    entries : list of Entries or None
        Derivatives (N_t, entries) of the force along the rows to y and to y_t, with their rows and columns; None where
        there are none.
    y_t : (N_t, r) array
        Velocities along the rows.
    Omega : float
        Fundamental frequency [rad/s].
    """

    def __init__(self, elements: "ElementsOverPeriod", entries: list[Entries | None], y_t: Array, Omega: float) -> None:
        self._elements, self._entries, self._y_t, self._Omega = elements, entries, y_t, Omega

    @cached_property
    def at_points(self) -> "ElementSlope":
        """Those along the rows of elements that read a point or the support."""
        return self._along(self._elements.at_points)

    @cached_property
    def spread(self) -> "ElementSlope":
        """Those along all other rows, about as many as there are modes."""
        return self._along(~self._elements.at_points)

    def _along(self, rows: npt.NDArray[np.bool_]) -> "ElementSlope":
        """Those along some rows: no row of one element depends on what another one reads."""
        picked = [None if entry is None else entry.along(rows) for entry in self._entries]
        return ElementSlope(self._elements, picked, self._y_t, self._Omega)

    @property
    def acts(self) -> bool:
        """Whether any of the forces changes with the motion: none does while every stop stays open."""
        return any(entry is not None for entry in self._entries)

    @property
    def rows(self) -> npt.NDArray[np.intp]:
        """Rows whose forces change, or whose readings change forces."""
        there = [entry for entry in self._entries if entry is not None]
        return np.unique(np.concatenate([*(e.row for e in there), *(e.column for e in there)]))

    def strength(self) -> Array:
        """Dynamic stiffness that the elements add to each harmonic and mode, at most, (H+1, n)."""
        e = self._elements
        k_Omega = np.arange(e.basis.H + 1)[:, None] * self._Omega
        found = np.zeros((e.basis.H + 1, e.rows.shape[1]))
        for entry, factor in zip(self._entries, (np.ones_like(k_Omega), k_Omega), strict=True):
            if entry is not None:
                k, row, column = entry
                found += factor * (np.abs(k).max(axis=0) @ np.abs(e.rows[row] * e.rows[column]))
        return found

    @cached_property
    def by_Q(self) -> Array:
        """Derivatives to the coefficients of the modes, (2H+1, n+1, 2H+1, n)."""
        e, size, n = self._elements, self._elements.basis.size, self._elements.rows.shape[1]

        def between_modes(entry: Entries) -> Array:
            return (e.onto[entry.row][:, :, None] * e.rows[entry.column][:, None]).reshape(len(entry.row), -1)

        return self._between(between_modes, (n + 1) * n).reshape(size, size, n + 1, n).swapaxes(1, 2)

    def by_readings(self, rows: npt.NDArray[np.intp]) -> Array:
        """Derivatives of the forces along some rows to the coefficients of what these read, (j, 2H+1, j, 2H+1)."""
        size, j, picked = self._elements.basis.size, len(rows), np.eye(len(self._elements.rows))[:, rows]

        def between_rows(entry: Entries) -> Array:
            return (picked[entry.row][:, :, None] * picked[entry.column][:, None]).reshape(len(entry.row), -1)

        return self._between(between_rows, j * j).reshape(size, size, j, j).transpose(2, 0, 3, 1)

    def _between(self, shares: Callable[[Entries], Array], m: int) -> Array:
        """Matrices (2H+1, 2H+1, m) that the slopes make, of the shares (entries, m) that each has in them."""
        e, basis = self._elements, self._elements.basis
        found = np.zeros((basis.size, basis.size, m))
        for i, entry in enumerate(self._entries):
            if entry is not None:
                matrices = basis.multiplication((e.wide.analysis @ entry.k) @ shares(entry))
                found += self._Omega * basis.derivative_on_right(matrices) if i else matrices
        return found

    @cached_property
    def by_Omega(self) -> Array:
        """Derivatives to the fundamental frequency at fixed coefficients, (2H+1, n+1)."""
        e, damping = self._elements, self._entries[1]
        if damping is None:
            return np.zeros((e.basis.size, e.onto.shape[1]))
        k, row, column = damping
        return np.asarray(e.basis.analysis @ (k * self._y_t[:, column]) @ e.onto[row] / self._Omega)

    def by_excitation(self, shape: Array) -> Array:
        """Change (2H+1, r) of the forces along the rows with an excitation (2H+1,)."""
        if not self._elements.static.any():
            return np.zeros((len(shape), len(self._elements.rows)))
        return self.along(np.outer(shape, self._elements.static[:, 0])[:, :, None])[:, :, 0]

    def pushed(self, Q: Array) -> Array:
        """Change (2H+1, n+1, p) of the forces on modes and support with coefficients of the modes (2H+1, n, p)."""
        e = self._elements
        y = np.matmul(e.rows, Q)
        faster = self._Omega * e.basis.derivative(y.reshape(e.basis.size, -1)).reshape(y.shape)
        return np.asarray(np.matmul(e.onto.T, self.along(y, faster)))

    def by_modes(self) -> Array:
        """Derivative (2H+1, r, (2H+1) n) of the forces along the rows to coefficients of the modes, velocities held."""
        size, (_, n) = self._elements.basis.size, self._elements.rows.shape
        return self.along(np.einsum("kl,ri->krli", np.eye(size), self._elements.rows).reshape(size, -1, size * n))

    def along(self, y: Array, y_t: Array | None = None) -> Array:
        """Change (2H+1, r, p) of the forces along the rows with deflections and velocities, held where omitted."""
        basis, gathered, out = self._elements.basis, np.eye(y.shape[1]), np.zeros(y.shape)
        for entry, read in zip(self._entries, (y, y_t), strict=True):
            if entry is not None and read is not None:
                seen = entry.k[:, :, None] * basis.samples(np.ascontiguousarray(read[:, entry.column]))
                out += np.matmul(gathered[:, entry.row], basis.coefficients(seen))
        return out


@dataclass(frozen=True, eq=False)
class ElementChange:
    """Derivatives of all elements to p parameters.

    Attributes
    ----------
    rows : ElementRows
        With p first, all elements in turn.
    parameters : (parameters, p) array
    Omega : (p,) array
    force : (2H+1, p) array
        Coefficients of the excitation.
    """

    rows: ElementRows
    parameters: Array
    Omega: Array
    force: Array


def stacked(parts: list[ElementRows], axis: int = 0) -> ElementRows:
    """Rows of all elements in turn, along the given axis."""
    return ElementRows(*(np.concatenate(arrays, axis=axis) for arrays in zip(*parts, strict=True)))


Described = tuple[tuple[type, tuple[tuple[str, object], ...], int], ...]
"""Class, settings and number of rows of each element: what decides the instructions."""


def described_elements(rig: Rig) -> Described:
    """Choices that decide the instructions of the elements of a rig; their numbers are run-time inputs."""
    sizes = [len(part.weight) for part in rig.element_rows]
    return tuple((type(e), tuple(chosen(e).items()), size) for e, size in zip(rig.acting, sizes, strict=True))


def element_numbers(rig: Rig) -> Array:
    """Parameters of all elements in turn."""
    return np.array([float(v) for e in rig.acting for v in parameters(e).values()])


def symbolic_forces(described: Described) -> tuple[ca.SX, list[ca.SX]]:
    """Force along each row (r,), and what it depends on: deflections, velocities and weights (r,), parameters."""
    y, y_t, weight = (ca.SX.sym(name, sum(size for *_, size in described)) for name in ("y", "y_t", "weight"))
    forces, symbols, first = [], [], 0
    for kind, settings, size in described:
        element, p = with_symbols(kind(**dict.fromkeys(describe(kind), 0.0), **dict(settings)))
        rows = slice(first, first + size)
        forces.append(element.force(y[rows], y_t[rows], weight[rows]))
        symbols.append(p)
        first += size
    return ca.densify(ca.vertcat(*forces)), [y, y_t, weight, ca.vertcat(*symbols)]


class ForcesInTime(NamedTuple):
    """Forces of the elements of a rig at N instants.

    Attributes
    ----------
    on_modes : (N, n) array
    on_support : (N,) array
    moved : (N, 1 + c) array
        Motion that they add to drive and channels, beyond the modes.
    """

    on_modes: Array
    on_support: Array
    moved: Array


def forces_in_time(rig: Rig, q: Array, qdot: Array, F: Array) -> ForcesInTime:
    """Forces of the elements of a rig at N instants.

    Parameters
    ----------
    rig : Rig
    q, qdot : (N, n) array
        Modal coordinates and velocities.
    F : (N,) array
        Excitation [N]; its rate moves no element.
    """
    if not rig.acting:
        return ForcesInTime(np.zeros_like(q), np.zeros(len(q)), np.zeros((len(q), 1 + len(rig.response_channels))))
    rows, share, weight, static = stacked(rig.element_rows)
    y = rows @ q.T + np.outer(static[:, 0], F)
    force = _forces(described_elements(rig))(y, rows @ qdot.T, weight, element_numbers(rig)).full().T
    return ForcesInTime(force @ rows, force @ share, force @ static)


@lru_cache(maxsize=16)
def _forces(described: Described) -> ca.Function:
    force, inputs = symbolic_forces(described)
    return ca.Function("forces", inputs, [force])


class ElementsOverPeriod:
    """The elements of a rig on a Fourier basis; the last is the lift of the tip where that may lift off.

    One object serves one thread: it owns the buffers that CasADi reads and fills.

    Parameters
    ----------
    rig : Rig
    basis : FourierBasis
    load : float
        Load that holds a tip that lifts off on its support, in units of the rig's load.

    Raises
    ------
    ValueError
        If the samples do not resolve products of the harmonics with a stiffness that varies.
    """

    def __init__(self, rig: Rig, basis: FourierBasis, load: float = 1.0) -> None:
        if basis.N_t <= 4 * basis.H:
            raise ValueError(f"elements: {basis.N_t} samples for {basis.H} harmonics; must be more than 4 per harmonic")
        self.basis, self.wide = basis, FourierBasis(2 * basis.H, basis.N_t)
        parts = rig.element_rows
        if rig.contact.lift_off:
            parts = [*parts[:-1], parts[-1].under(load)]
        rows, share, self.weight, self.static = stacked(parts)
        reads = [element.reads in (Reading.POINT, Reading.SUPPORT) for element in rig.acting]
        self.at_points = np.repeat(reads, [len(part.weight) for part in parts])
        self.rows, self.onto = rows, np.column_stack([rows, share])  # reads (r, n), pushes modes and support (r, n+1)
        self._parameters = element_numbers(rig)
        self._functions = _functions(described_elements(rig), basis.N_t)
        self._y: Array = np.zeros((basis.N_t, len(rows)))
        self._y_t = np.zeros_like(self._y)
        self._inputs = [self._y, self._y_t, self.weight, self._parameters]
        self._evaluate, (self._force,) = buffered(self._functions.force, self._inputs)

    def read(self, Q: Array, F: Array) -> Array:
        """Coefficients of the deflections along the rows, (2H+1, r), of modes (2H+1, n) and excitation (2H+1,)."""
        return np.asarray(Q @ self.rows.T + np.outer(F, self.static[:, 0]))

    def _read(self, Q: Array, Omega: float, F: Array) -> None:
        np.matmul(self.basis.synthesis, self.read(Q, F), out=self._y)
        # what reads a velocity sees nothing of the excitation
        np.matmul(Omega * self.basis.synthesis, self.basis.derivative(Q @ self.rows.T), out=self._y_t)

    def in_time(self, Q: Array, Omega: float, F: Array) -> Array:
        """Force along each row at the samples, (N_t, r); a buffer, until the next call. See :meth:`along_rows`."""
        self._read(Q, Omega, F)
        self._evaluate()
        return self._force.reshape(self._y.shape)

    def along_rows(self, Q: Array, Omega: float, F: Array) -> Array:
        """Coefficients of the force along each row, (2H+1, r).

        Parameters
        ----------
        Q : (2H+1, n) array
            Coefficients of the modes.
        Omega : float
            Fundamental frequency [rad/s].
        F : (2H+1,) array
            Coefficients of the excitation [N].
        """
        return np.asarray(self.basis.analysis @ self.in_time(Q, Omega, F))

    def pull(self, Q: Array, F: Array) -> float:
        """Largest reading of a tip that lifts off, in units of the load that holds it."""
        return float((self.basis.synthesis @ self.read(Q, F)[:, -1]).max())

    def _slopes(self, Q: Array, Omega: float, F: Array) -> list[Entries]:
        """Derivatives of the force along the rows to y and to y_t."""
        self._read(Q, Omega, F)
        evaluate, slopes = buffered(self._functions.slopes, self._inputs)
        evaluate()
        places = self._functions.places[:2]
        return [Entries(k.reshape(len(self._y), -1), *place) for k, place in zip(slopes, places, strict=True)]

    def linearize(self, Q: Array, Omega: float, F: Array) -> ElementSlope:
        """Derivatives of what the forces of :meth:`along_rows` do to modes and support."""
        return ElementSlope(self, [e.acting for e in self._slopes(Q, Omega, F)], self._y_t.copy(), Omega)

    def slopes_in_time(self, Q: Array, Omega: float, F: Array) -> tuple[Array, Array]:
        """Derivatives of the forces on modes and support to q and to q' at the samples, two of (N_t, n+1, n)."""
        by_q, by_v = (
            np.einsum("te,ei,ej->tij", k, self.onto[row], self.rows[column], optimize=True)
            for k, row, column in self._slopes(Q, Omega, F)
        )
        return by_q, by_v

    def along(self, Q: Array, Omega: float, F: Array, change: ElementChange) -> Array:
        """Derivatives of :meth:`along_rows` with the motion held, (2H+1, r, p)."""
        basis, rows = self.basis, change.rows.rows
        self._read(Q, Omega, F)
        evaluate, found = buffered(self._functions.change, self._inputs)
        evaluate()
        slopes, places = [k.reshape(basis.N_t, -1) for k in found], self._functions.places
        out = np.zeros((len(self.rows), basis.size, len(change.Omega)))
        numbers = change.rows.weight.T, change.parameters
        for k, (row, column), moved in zip(slopes[2:], places[2:], numbers, strict=True):
            np.add.at(out, row, (basis.analysis @ k).T[:, :, None] * moved[column][:, None])
        faster = basis.derivative(Q @ self.rows.T)
        reads = change.rows.static[:, :, 0]
        touched = rows.any(axis=2) | (change.Omega != 0.0)[:, None] | (reads != 0.0)
        touched |= np.outer(change.force.any(axis=0), self.static[:, 0] != 0.0)
        for p in np.flatnonzero(touched.any(axis=1)):
            at = np.flatnonzero(touched[p])  # what is read along a row moves the force along few others
            seen = Q @ rows[p, at].T
            y = seen + np.outer(F, reads[p, at]) + np.outer(change.force[:, p], self.static[at, 0])
            y_t = Omega * basis.derivative(seen) + change.Omega[p] * faster[:, at]
            for k, (row, column), d in zip(slopes[:2], places[:2], (y, y_t), strict=True):
                here = touched[p, column]
                moved = k[:, here] * (basis.synthesis @ d)[:, np.searchsorted(at, column[here])]
                np.add.at(out[:, :, p], row[here], (basis.analysis @ moved).T)
        return np.ascontiguousarray(out.transpose(1, 0, 2))


@dataclass(frozen=True)
class _Functions:
    """Functions of all samples.

    `change` gives the entries of d force / d y, y_t, weight and parameters that may differ from zero, `slopes` those of
    the first two; `places` (2, entries) are their rows and columns.
    """

    force: ca.Function
    slopes: ca.Function
    change: ca.Function
    places: list[npt.NDArray[np.intp]]


@lru_cache(maxsize=16)
def _functions(described: Described, N_t: int) -> _Functions:
    force, inputs = symbolic_forces(described)
    jacobians = [ca.jacobian(force, of) for of in inputs]
    places = [np.array(j.sparsity().get_triplet(), dtype=int).reshape(2, -1) for j in jacobians]
    entries = [ca.SX(ca.vertcat(*j.nonzeros())) if j.nnz() else ca.SX(0, 1) for j in jacobians]

    def over_period(name: str, outputs: list[ca.SX]) -> ca.Function:
        return ca.Function(name, inputs, outputs).map(name, "serial", N_t, [2, 3], [])

    return _Functions(
        over_period("force", [force]), over_period("slopes", entries[:2]), over_period("change", entries), places
    )
