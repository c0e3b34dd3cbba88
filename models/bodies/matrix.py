"""A body given by the matrices of a finite-element model, reduced to its lowest modes.

:class:`MatrixBody` is what one makes; a :class:`Pencil` is the stiffness and mass of what is free, factorised once for
the modes and for the static response of all the others.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, ClassVar, Literal, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from models.bodies.matrixchecks import (
    Exchanged,
    exchanged,
    refuse_asymmetry,
    refuse_indefinite,
    refuse_names,
    refuse_nothing,
    refuse_size,
    size,
    some,
    square,
)
from models.bodies.pencil import Matrix, Modes, Pencil, factors, part, ritz, unit_loads
from models.bodies.ported import Elastic, PlaceError, PortedModes, meant, same_point
from models.bounds import bounded, whole
from models.friction.law import Parameter
from models.parts import Damping
from models.plausible import plausible
from models.structure import Array

Method = Literal["modes", "craig-bampton"]
Complex = npt.NDArray[np.complex128]

METHODS: tuple[str, ...] = get_args(Method)
LOSS = 1e-6  # of a factorised dynamic stiffness, so that it is regular at a resonance


class Reduced(NamedTuple):
    """A body's modes (f, n) with the rows (p, n) and the flexibility (p, p) of places."""

    squares: Array
    shapes: Array
    rows: Array
    flexibility: Array


@dataclass(frozen=True, eq=False, repr=False)
class MatrixBody(Elastic):
    """Any structure given by the matrices of its finite elements.

    Attributes
    ----------
    mass, stiffness : (d, d) sparse matrix
        Symmetric [kg, N/m, or as goes with the rotations]; the mass may be zero at some degrees of freedom.
    dofs : tuple of str, (d,)
        Name of each degree of freedom, such as ``12.x``; ports are some of them.
    modes : int
        How many are kept; with ``craig-bampton``, of the body whose ports are held.
    damping_matrix : (d, d) sparse matrix or None
        Viscous [N s/m]; in place of the damping of modes.
    fixed : tuple of str
        Those of the degrees of freedom that are supported.
    reduction : str
        ``modes``, the lowest with free ports and the static response of the others at the ports; or ``craig-bampton``,
        the lowest with the ports held and the static shapes of a unit displacement of each.
    stiffness_factor : float
        Of the stiffness: 1.02 where the material is 2 % stiffer than that of the model.
    """

    STIFFNESS: ClassVar[str] = "matrix.stiffness_factor"
    MODES: ClassVar[str] = "matrix.modes"

    mass: Matrix
    stiffness: Matrix
    dofs: tuple[str, ...]
    modes: int
    damping_matrix: Matrix | None = None
    fixed: tuple[str, ...] = ()
    reduction: Method = "modes"
    stiffness_factor: float = 1.0

    def __post_init__(self) -> None:
        """Refuse matrices, names and numbers that no body has."""
        for name in ("mass", "stiffness", "damping_matrix"):
            if (given := getattr(self, name)) is not None:
                object.__setattr__(self, name, square(name, given))
        d = self.mass.shape[0]
        for name in ("stiffness", "damping_matrix"):
            if (given := getattr(self, name)) is not None and given.shape[0] != d:
                raise ValueError(f"MatrixBody: {name} is {size(given)}; must be {d} x {d}, as the mass is")
        if len(self.dofs) != d:
            raise ValueError(f"MatrixBody: dofs has {len(self.dofs)} names; must have {d}, one per row of the matrices")
        for key in ("dofs", "fixed"):
            refuse_names(key, getattr(self, key))
        for name in self.fixed:
            if name not in self._numbers:
                raise ValueError(f'MatrixBody: fixed has "{name}"; must be of dofs, {some(self.dofs)}')
        for name in ("mass", "stiffness", "damping_matrix"):
            if (given := getattr(self, name)) is not None:
                refuse_size(name, given, self.dofs, self._held)
                refuse_asymmetry(name, given, self.dofs)
        if not self.mass.count_nonzero():
            raise ValueError("MatrixBody: mass is zero; must be > 0 somewhere")
        for name in ("mass", "damping_matrix"):
            if (given := getattr(self, name)) is not None:
                refuse_indefinite(name, given, self.dofs)
        refuse_nothing(self.stiffness, self.mass, self.dofs, self._free)
        self._refuse_settings()

    def _refuse_settings(self) -> None:
        if self.reduction not in METHODS:
            raise ValueError(f'MatrixBody: reduction = "{self.reduction}"; must be one of {", ".join(METHODS)}')
        whole("MatrixBody: modes", self.modes, 1)
        bounded("MatrixBody: stiffness_factor", self.stiffness_factor, 0.0, strict=True)
        there = self._most_modes([])
        if not there:
            raise ValueError("MatrixBody: fixed has every degree of freedom with mass; must leave one free")
        if self.modes > there:
            most = f"must be <= {there}, the degrees of freedom with mass that are not fixed"
            raise ValueError(f"MatrixBody: modes = {self.modes}; {most}")

    def __str__(self) -> str:
        """Size, supports and modes in a few words."""
        if self.reduction == "craig-bampton":
            return f"{self._extent}; {self.modes} modes with the ports held, and the static shapes of the ports"
        hz = np.sqrt(self.stiffness_factor * self._lowest.squares[[0, -1]]) / (2 * np.pi)
        return f"{self._extent}; the lowest {self.modes} modes, {hz[0]:.6g} to {hz[1]:.6g} Hz, the others at rest"

    def __repr__(self) -> str:
        """Describe it, without working out its modes."""
        return f"MatrixBody({self._extent}, {self.modes} modes, {self.reduction})"

    def __getstate__(self) -> dict[str, Any]:
        """Leave out factors, which cannot be sent to other processes."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @property
    def proportions(self) -> Iterator[Exchanged]:
        """What looks wrong about its matrices."""
        yield exchanged(self.mass.diagonal()[self._free], self.stiffness.diagonal()[self._free])

    @property
    def damped_by_modes(self) -> bool:
        """Whether it brings no damping matrix."""
        return self.damping_matrix is None

    @property
    def _stiffness(self) -> tuple[float, Parameter]:
        return self.stiffness_factor, Parameter("1", "factor of the stiffness matrix", "")

    def _stiffened(self, value: float) -> "MatrixBody":
        """With another factor; what follows from the matrices alone is not worked out again."""
        bounded(f"MatrixBody: {self.STIFFNESS}", value, 0.0, strict=True)
        _ = self._known, self.reduction == "modes" and self._lowest  # all share these
        other = object.__new__(MatrixBody)
        other.__dict__.update(self.__dict__, stiffness_factor=value)  # checks of the matrices are not repeated, either
        return other

    def translations(self, place: str) -> tuple[str, ...]:
        """Return the degrees of freedom that are free translations of the point of one of them."""
        return same_point(place, self._numbers.keys() - set(self.fixed))

    def elsewhere(self, places: Sequence[str]) -> tuple[str, ...]:
        """Return its free degrees of freedom; none where the rows of those that are no ports are not known."""
        known = {*places, *self.fixed}
        return tuple(name for name in self.dofs if name not in known) if self.reduction == "modes" else ()

    def everywhere(self, names: Sequence[str], places: Sequence[str]) -> tuple[Array, Array]:
        """Rows (f, n) of any free degrees of freedom in the lowest modes, and their flexibility (f, p) to places."""
        modes, at = self._lowest, self._places(names)
        rest = self._pencil.rest(modes, unit_loads(len(self._free), self._places(places)))
        return modes.shapes[at], rest[at] / self.stiffness_factor

    def with_modes(self, modes: int, places: Sequence[str]) -> "MatrixBody":
        """Return the same body with another number of modes, or with as many as its mass has."""
        return replace(self, modes=min(modes, self._most_modes(self._places(places))))

    def ported(self, places: Sequence[str], damping: Damping, supports: Sequence[str] = ()) -> PortedModes:
        """Return its modes with the rows of places, and of supports whose reaction is asked for.

        Parameters
        ----------
        places : sequence of str, (p,)
            Names in `dofs` that are not fixed.
        damping : Damping
            Damping of the modes, counted from 1 with the rigid ones; unused where there is a `damping_matrix`.
        supports : sequence of str, (r,)
            Names in `fixed`.

        Raises
        ------
        ValueError
            If there is no such place or support, if the matrices are no body's, if rigid motion were left out, or if
            a reaction is asked of a body that its supports let move as a rigid one.
        """
        return self._damped(places, self._reduced(places), damping, supports)

    def receptance_error(self, places: Sequence[str], damping: Damping, hz: Sequence[float]) -> float:
        """Largest relative error of the reduction among frequencies [Hz].

        In the Frobenius norm of the receptance of the places (p, p), against all degrees of freedom; with the
        `damping_matrix`, or the same damping of the modes kept and of the others what is proportional to mass and
        stiffness, which the static response kept of them leaves out. A damping ratio says nothing of the others.
        """
        for i, frequency in enumerate(hz):
            bounded(f"MatrixBody: hz[{i}]", frequency, 0.0, strict=True)
        reduced = self._reduced(places)
        body = self._damped(places, reduced, damping, ())
        errors = []
        for omega in 2 * np.pi * np.asarray(hz, dtype=float):
            full = self._receptance(self._places(places), reduced, body.damping, damping.proportional, float(omega))
            errors.append(np.linalg.norm(body.receptance(float(omega)) - full) / np.linalg.norm(full))
        return float(max(errors, default=0.0))

    # ---- names

    @property
    def _extent(self) -> str:
        fixed = f", {len(self.fixed)} of them fixed" if self.fixed else ""
        return f"{len(self.dofs)} degrees of freedom{fixed}"

    @cached_property
    def _numbers(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.dofs)}

    @cached_property
    def _held(self) -> npt.NDArray[np.intp]:
        return np.array([self._numbers[name] for name in self.fixed], dtype=np.intp)

    @cached_property
    def _free(self) -> npt.NDArray[np.intp]:
        return np.setdiff1d(np.arange(len(self.dofs)), self._held)

    def _places(self, places: Sequence[str]) -> npt.NDArray[np.intp]:
        """Numbers of places among the free degrees of freedom."""
        for name in places:
            if name not in self._numbers:
                accepted = f"must be of dofs, {some(self.dofs)}{meant(name, self._numbers)}"
                raise PlaceError(f'MatrixBody: place "{name}"; {accepted}', name, accepted)
            if name in self.fixed:
                accepted = "must be free to move, it is fixed"
                raise PlaceError(f'MatrixBody: place "{name}"; {accepted}', name, accepted)
        return np.searchsorted(self._free, [self._numbers[name] for name in places]).astype(np.intp)

    def _supports(self, supports: Sequence[str]) -> npt.NDArray[np.intp]:
        """Numbers of supports among all degrees of freedom."""
        for name in supports:
            if name not in self.fixed:
                accepted = f"must be of fixed, {some(self.fixed) or 'which is empty'}"
                raise PlaceError(f'MatrixBody: support "{name}"; {accepted}', name, accepted)
        return np.array([self._numbers[name] for name in supports], dtype=np.intp)

    # ---- reduction

    def _most_modes(self, at: npt.ArrayLike) -> int:
        """How many modes there are; with ``craig-bampton``, of the body held at places, by their numbers."""
        moves = self.mass.diagonal()[self._free] > 0.0
        if self.reduction == "craig-bampton":
            moves[np.asarray(at, dtype=np.intp)] = False
        return int(moves.sum())

    @cached_property
    def _pencil(self) -> Pencil:
        return Pencil(part(self.stiffness, self._free, self._free), part(self.mass, self._free, self._free))

    @cached_property
    def _lowest(self) -> Modes:
        return self._pencil.lowest(self.modes)

    @cached_property
    def _known(self) -> dict[tuple[str, ...], Reduced]:
        """Reductions for places, with a factor of 1."""
        return {}

    def _reduced(self, places: Sequence[str]) -> Reduced:
        at, factor, known = self._places(places), self.stiffness_factor, self._known
        if tuple(places) not in known:
            known[tuple(places)] = self._craig_bampton(at) if self.reduction == "craig-bampton" else self._of_modes(at)
        found = known[tuple(places)]
        return found._replace(squares=factor * found.squares, flexibility=found.flexibility / factor)

    def _of_modes(self, at: npt.NDArray[np.intp]) -> Reduced:
        modes = self._lowest
        modes.refuse_rigid_rest("")
        if len(modes.squares) == len(self._free):  # nothing is left out but rounding
            return Reduced(modes.squares, modes.shapes, modes.shapes[at], np.zeros((len(at), len(at))))
        flexibility = self._pencil.rest(modes, unit_loads(len(self._free), at))[at]
        return Reduced(modes.squares, modes.shapes, modes.shapes[at], (flexibility + flexibility.T) / 2)

    def _craig_bampton(self, at: npt.NDArray[np.intp]) -> Reduced:
        stiffness = part(self.stiffness, self._free, self._free)
        mass = part(self.mass, self._free, self._free)
        ports = np.unique(at)
        inner = np.setdiff1d(np.arange(len(self._free)), ports)
        there = self._most_modes(at)
        if not there:
            accepted = 'must be "modes", or have fewer places: no degree of freedom with mass is left for modes'
            raise ValueError(f'MatrixBody: reduction = "{self.reduction}"; {accepted}')
        if self.modes > there:
            most = f"must be <= {there}, the degrees of freedom with mass that are neither fixed nor places"
            raise ValueError(f"MatrixBody: modes = {self.modes}; {most}")
        pencil = Pencil(part(stiffness, inner, inner), part(mass, inner, inner))
        modes = pencil.lowest(self.modes)
        modes.refuse_rigid_rest(" with its places held")
        n = self.modes
        basis = np.zeros((len(self._free), n + len(ports)))
        basis[inner, :n] = modes.shapes
        basis[ports, range(n, n + len(ports))] = 1.0
        # less what the modes kept could do themselves
        basis[inner, n:] = -pencil.rest(modes, part(stiffness, inner, ports).toarray())
        squares, shapes, still = ritz(stiffness, mass, basis, pencil.shift)
        return Reduced(squares, shapes, shapes[at], still[at] @ still[at].T)

    def _damped(
        self, places: Sequence[str], reduced: Reduced, damping: Damping, supports: Sequence[str]
    ) -> PortedModes:
        omega_n = np.sqrt(reduced.squares)
        for hz in (omega_n / (2 * np.pi)).tolist():
            plausible("MatrixBody: a natural frequency", hz, "frequencies_hz")
        if self.damping_matrix is None:
            dampers = damping.dampers(omega_n, np.arange(1, len(omega_n) + 1))
            viscous = np.diag(dampers.viscous)
            matrix = viscous + np.diag(dampers.strain_rate * reduced.squares)
        else:
            matrix = reduced.shapes.T @ (part(self.damping_matrix, self._free, self._free) @ reduced.shapes)
            viscous = matrix
        held, shapes = self._supports(supports), self._support_shapes(self._supports(supports))
        inertia = self._tested(self.mass, shapes, held, reduced.shapes)
        # strain-rate damping is like the stiffness, which does no work on the static shape
        by_velocity = inertia @ viscous
        if self.damping_matrix is not None:
            by_velocity = self._tested(self.damping_matrix, shapes, held, reduced.shapes)
        return PortedModes(
            omega_n=omega_n,
            damping=(matrix + matrix.T) / 2,
            places=tuple(places),
            rows=reduced.rows,
            flexibility=reduced.flexibility,
            supports=tuple(supports),
            reaction_inertia=inertia,
            reaction_damping=by_velocity,
            reaction_share=shapes[self._places(places)].T,
        )

    def _support_shapes(self, held: npt.NDArray[np.intp]) -> Array:
        """Displacement (f, r) at rest per unit displacement of each support, the others held."""
        if not held.size:
            return np.zeros((len(self._free), 0))
        if self._lowest.squares[0] == 0.0:
            why = "they let the body move as a rigid one, so that one displaced at rest says nothing of where it goes"
            raise ValueError(f"MatrixBody: supports {some(self.fixed)}: {why}; fix more, or ask for no reaction")
        return self._pencil.static(self._lowest, -part(self.stiffness, self._free, held).toarray())

    def _tested(self, matrix: Matrix, shapes: Array, held: npt.NDArray[np.intp], modes: Array) -> Array:
        """A matrix between the shapes of supports (f, r), 1 at their own, and modes (f, n)."""
        if not held.size:
            return np.zeros((0, modes.shape[1]))
        on_free = shapes.T @ (part(matrix, self._free, self._free) @ modes)
        return np.asarray(on_free + part(matrix, held, self._free) @ modes)

    # ---- the full model

    def _receptance(
        self,
        at: npt.NDArray[np.intp],
        reduced: Reduced,
        damping: Array,
        proportional: tuple[float, float],
        omega: float,
    ) -> Complex:
        """Receptance of all degrees of freedom (p, p), at `omega` [rad/s].

        Modes kept have `damping` (n, n); the others what is proportional to mass [1/s] and stiffness [s].
        """
        stiffness, mass = self.stiffness_factor * self._pencil.stiffness, self._pencil.mass
        load = unit_loads(len(self._free), at).astype(complex)
        if self.damping_matrix is not None:
            viscous = part(self.damping_matrix, self._free, self._free)
            dynamic = stiffness - omega**2 * mass + 1j * omega * viscous
            return np.asarray(factors(dynamic, pivoting=0.1).solve(load)[at])
        forces = mass @ reduced.shapes  # the damping matrix is the proportional one and forces damping forces'
        alpha, beta = proportional
        damping = damping - np.diag(alpha + beta * reduced.squares)
        dynamic = (1 + 1j * omega * beta) * stiffness - omega * (omega - 1j * alpha) * mass
        # a small loss of everything, so that it is regular at resonance; of the modes kept it is taken back at once
        lossy = factors(dynamic + 1j * omega**2 * LOSS * mass, pivoting=0.1)
        extra = 1j * omega * (damping - LOSS * omega * np.eye(len(damping)))
        by_forces = lossy.solve(forces.astype(complex))
        small = np.linalg.solve(np.eye(len(damping)) + extra @ (forces.T @ by_forces), extra)
        response = np.zeros_like(load)
        for _ in range(4):  # each takes a millionth of the error, what the loss does to the others
            left = load - dynamic @ response
            left -= 1j * omega * (forces @ (damping @ (forces.T @ response)))
            step = lossy.solve(left)
            response += step - by_forces @ (small @ (forces.T @ step))
        return np.asarray(response[at])
