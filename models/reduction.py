"""Reduction of an assembly to its lowest modes, with exact derivatives of everything that is kept.

:class:`Reduction` solves the eigenproblem, leaves the higher modes to their static response, and differentiates the
result in the modes found, without derivatives of normalised modes.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh

from models.assembly import Assembly
from models.elements import Ports
from models.structure import Array, ModalStructure, Reaction, ResidualFlexibility, SpringPort


class Dampers(NamedTuple):
    """Damping of modes with natural frequencies omega_n.

    Attributes
    ----------
    viscous : (n,) array
        Coefficients without the strain-rate part [1/s].
    slope : (n,) array
        Their derivatives to omega_n^2 [s].
    strain_rate : float
        beta [s], adds beta omega_n^2.
    """

    viscous: Array
    slope: Array
    strain_rate: float


Rule = Callable[[Array], Dampers]


class StructureChange(NamedTuple):
    """Derivatives of a :class:`ModalStructure` in its present modes; p parameters first where there are several.

    The equation of motion (4) changes by
    ``mass q'' + damping q' + stiffness q = F rows[1] + T (rows[0] - shortening q)``: matrices of a structure that keeps
    its coordinates, so that modes that coincide or cross need no care.

    Attributes
    ----------
    mass, damping, stiffness, shortening : (p, n, n) array
    rows : (p, 2 + c + e, n) array
        Rows of slip, drive, channels and points.
    flexibility : (p, 2 + c + e, 2) array
        Motion that friction and excitation add beyond the modes: compliance and residual flexibility.
    inertia, reaction_damping, reaction_stiffness, stretch : (p, n) array
        Rows of :class:`Reaction`.
    friction_lever, force_share : (p,) array
    share : (p, e) array
        Share of a force at each point that goes into the support.
    drawn_in, drawn_stretch : (p, n, n) and (p, n) array
        Shortening and stretch, whether or not the contact sees them.
    """

    mass: Array
    damping: Array
    stiffness: Array
    shortening: Array
    rows: Array
    flexibility: Array
    inertia: Array
    reaction_damping: Array
    reaction_stiffness: Array
    stretch: Array
    friction_lever: Array
    force_share: Array
    share: Array
    drawn_in: Array
    drawn_stretch: Array

    @staticmethod
    def stacked(changes: Sequence["StructureChange"]) -> "StructureChange":
        """Changes with one parameter each as one."""
        return StructureChange(*(np.stack(parts) for parts in zip(*changes, strict=True)))


class Switches(NamedTuple):
    """Parts of the contact that are kept, :class:`models.parts.Contact`."""

    load_variation: float = 1.0
    residual_compliance: bool = True
    foreshortening: bool = True


class Reduction:
    """Modes of an assembly of numbers, the lowest n kept.

    Attributes
    ----------
    assembly : Assembly
        An assembly of arrays.
    squares : (n,) array
        omega_n^2 [1/s2].
    kept : (d, n) array
        Mass-normalised modes.
    rest : (d, d - n) array
        The others, normalised to unit stiffness: the static response of all that is left out is ``rest rest'``, and a
        coordinate without mass is one of them.
    rest_flexibility : (d - n,) array
        1 / omega^2 of the others, 0 without mass.
    """

    def __init__(self, assembly: Assembly, n: int, dampers: Rule, switches: Switches) -> None:
        self.assembly, self.switches = assembly, switches
        M, K = assembly.mass, assembly.stiffness
        # the shapes of a bare beam are its modes, to the last digit
        if np.array_equal(M, np.eye(len(M))) and np.array_equal(K, np.diag(K.diagonal())):
            flexibility, shapes = 1.0 / K.diagonal(), np.eye(len(M)) / np.sqrt(K.diagonal())
            self.squares, self.kept = K.diagonal()[:n], np.eye(len(M))[:, :n]
        else:
            flexibility, shapes = eigh(M, K)  # the lowest modes are then the most accurate
            flexibility, shapes = flexibility[::-1], shapes[:, ::-1]
            self.squares = 1.0 / flexibility[:n]
            self.kept = shapes[:, :n] * np.sqrt(self.squares)
            largest = self.kept[np.abs(self.kept).argmax(axis=0), range(n)]
            self.kept *= np.sign(largest)
        self.rest, self.rest_flexibility = shapes[:, n:], np.maximum(flexibility[n:], 0.0)
        self.dampers = dampers(np.sqrt(self.squares))

    @property
    def rows(self) -> Array:
        """Rows of slip, drive, channels, points and reaction, (3 + c + e, n)."""
        return np.asarray(self.assembly.rows @ self.kept)

    @property
    def flexibility(self) -> Array:
        """Motion that friction and excitation add beyond the modes kept, (3 + c + e, 2)."""
        by_rest = self.assembly.rows @ self.rest
        return np.asarray(self.assembly.flexibility + self.switches.residual_compliance * by_rest @ by_rest[:2].T)

    def structure(self, channels: Sequence[str]) -> ModalStructure:
        """The modal structure, with the names of the channels."""
        switches, n, rows, flexibility = self.switches, len(self.squares), self.rows, self.flexibility
        damping, _, beta = self.dampers
        varies = switches.load_variation
        return ModalStructure(
            omega_n=np.sqrt(self.squares),
            damping=damping + beta * self.squares,
            slip_row=rows[0],
            shortening=self.kept.T @ self.assembly.shortening @ self.kept * switches.foreshortening,
            excitation=rows[1],
            compliance=float(flexibility[0, 0]),
            reaction=self.reaction().times(varies) if varies else Reaction.constant(n),
            channel_rows=dict(zip(channels, rows[2:], strict=False)),
            residual=ResidualFlexibility(
                slip_by_force=float(flexibility[0, 1]),
                drive_by_force=float(flexibility[1, 1]),
                channels={
                    name: (float(by_force), float(by_friction))
                    for name, (by_friction, by_force) in zip(channels, flexibility[2:], strict=False)
                },
            ),
        )

    def reaction(self) -> Reaction:
        """Normal reaction as it is, whatever the friction sees of it."""
        rows, flexibility = self.rows, self.flexibility
        damping, _, beta = self.dampers
        inertia, stretch = (row @ self.kept for row in (self.assembly.inertia[0], self.assembly.stretch[0]))
        return Reaction(
            inertia=inertia,
            damping=inertia * damping + beta * rows[-1],
            stiffness=rows[-1],
            stretch=stretch * self.switches.foreshortening,
            force_share=-float(flexibility[-1, 1]),
            friction_lever=-float(flexibility[-1, 0]),
        )

    def ports(self, length: float) -> Ports:
        """Motions other than the support's that nonlinear elements can read, on a beam of that length."""
        assembly, kept, varies = self.assembly, self.kept, self.switches.load_variation
        points = slice(len(assembly.rows) - 1 - len(assembly.share), -1)
        return Ports(
            rows=self.rows[points],
            share=assembly.share[:, 0] * varies,
            shortening=kept.T @ assembly.shortening @ kept,
            stretch=(assembly.stretch @ kept)[0] * varies,
            length=length,
            channels=len(assembly.rows) - 3 - len(assembly.share),
        )

    def port(self, at: int, stiffness: float) -> SpringPort:
        """Port at which a displacement is imposed within a spring to the ground.

        Parameters
        ----------
        at : int
            Coordinate that stretches it: the rotation of the clamp, or the lift of the tip.
        stiffness : float
            Stiffness of the spring [N/m or N m/rad].
        """
        row, on = stiffness * self.kept[at], self.switches
        if not on.residual_compliance:
            return SpringPort(row, stiffness, np.zeros(len(self._seen(self.rows))))
        moved, taken = self._displaced(at, stiffness)
        residual = self._seen(self.assembly.rows @ moved - self.rows @ (row / self.squares))
        residual[-1] *= on.load_variation
        return SpringPort(row, float(taken + row @ (row / self.squares)), residual)

    def _displaced(self, at: int, stiffness: float) -> tuple[Array, float]:
        """Coordinates, and load taken back, of a structure at rest per displacement slid within a spring."""
        own = np.eye(len(self.kept))[at]
        free = np.linalg.solve(self.assembly.stiffness - stiffness * np.outer(own, own), own)
        taken = stiffness / (1.0 + stiffness * free[at])
        return taken * free, float(taken)

    def _seen(self, rows: Array) -> Array:
        """Rows of slip, drive, channels and reaction, without those of points."""
        return np.delete(rows, slice(len(rows) - 1 - len(self.assembly.share), len(rows) - 1), axis=0)

    # ---- derivatives

    def port_change(self, d: Assembly, at: int, stiffness: float, d_stiffness: float) -> SpringPort:
        """Derivatives of :meth:`port` with those `d` of the assembly, its own spring's `d_stiffness` included.

        What the own spring does is small where it is stiff: worked out as such, not as a difference of what is not.
        """
        own = np.zeros_like(d.stiffness)
        own[at, at] = d_stiffness
        others = d._replace(stiffness=d.stiffness - own)
        moved, taken = self._displaced(at, stiffness)
        row, rows = stiffness * self.kept[at], self.rows
        modes = row / self.squares  # at rest per displacement slid
        ratio = np.multiply.outer(self.rest_flexibility, self.squares)
        following = (stiffness * self.rest[at]) ** 2 @ (ratio / (1.0 - ratio))
        d_row = stiffness * self._moved(others)[at]
        d_row += d_stiffness * row / stiffness**2 * (taken + row @ modes - following)
        if not self.switches.residual_compliance:
            return SpringPort(d_row, d_stiffness, np.zeros(len(self._seen(rows))))
        d_rows = d.rows @ self.kept + self.assembly.rows @ self._moved(d)
        d_modes = (d_row - self.kept.T @ d.stiffness @ self.kept @ modes) / self.squares
        d_taken = moved @ others.stiffness @ moved + d_stiffness * (taken / stiffness) ** 2
        response = np.linalg.solve(self.assembly.stiffness, self.assembly.rows.T)
        seen = d.rows @ moved - response.T @ others.stiffness @ moved
        seen += d_stiffness * taken / stiffness**2 * self.assembly.rows @ moved
        residual = self._seen(seen - d_rows @ modes - rows @ d_modes)
        residual[-1] *= self.switches.load_variation
        return SpringPort(d_row, float(d_taken + d_row @ modes + row @ d_modes), residual)

    def change(self, d: Assembly, own: Dampers | None = None) -> "StructureChange":
        """Derivatives with those `d` of the assembly, and with the `own` change of the damping at held frequencies.

        The modes kept take in what they need of the others, and nothing of each other.
        """
        assembly, kept, on = self.assembly, self.kept, self.switches
        moved = self._moved(d)
        mass, stiffness = kept.T @ d.mass @ kept, kept.T @ d.stiffness @ kept
        rows = d.rows @ kept + assembly.rows @ moved
        flexibility = d.flexibility
        if on.residual_compliance and self.rest.size:  # of all coordinates, less those of the modes kept
            response = np.linalg.solve(assembly.stiffness, assembly.rows.T)
            flexibility = flexibility + _flexibility_change(response, d.rows, d.stiffness)
            flexibility -= _flexibility_change((self.rows / self.squares).T, rows, stiffness)
        drawn = kept.T @ assembly.shortening @ moved
        drawn_in = kept.T @ d.shortening @ kept + drawn + drawn.T
        inertia = (d.inertia @ kept + assembly.inertia @ moved)[0]
        viscous, slope, beta = self.dampers
        none = np.zeros_like(viscous)
        by_rule, _, by_strain = (none, none, 0.0) if own is None else own
        damping = _spectral_change(self.squares, viscous, slope, mass, stiffness) + np.diag(by_rule)
        forces = inertia * viscous + (assembly.inertia @ kept)[0] @ (damping - mass * viscous)
        varies = on.load_variation
        stretch = varies * (d.stretch @ kept + assembly.stretch @ moved)[0]
        return StructureChange(
            mass=mass,
            damping=damping + beta * stiffness + by_strain * np.diag(self.squares),
            stiffness=stiffness,
            shortening=drawn_in * on.foreshortening,
            rows=rows[:-1],
            flexibility=flexibility[:-1],
            inertia=varies * inertia,
            reaction_damping=varies * (forces + beta * rows[-1] + by_strain * self.rows[-1]),
            reaction_stiffness=varies * rows[-1],
            stretch=on.foreshortening * stretch,
            friction_lever=-varies * flexibility[-1, 0],
            force_share=-varies * flexibility[-1, 1],
            share=varies * d.share[:, 0],
            drawn_in=drawn_in,
            drawn_stretch=stretch,
        )

    def change_of_load_variation(self, still: Assembly) -> StructureChange:
        """Derivatives to the scale of the reaction's variation; `still` is a change of nothing."""
        r = self.reaction()
        return self.change(still)._replace(
            inertia=r.inertia,
            reaction_damping=r.damping,
            reaction_stiffness=r.stiffness,
            stretch=r.stretch,
            friction_lever=np.asarray(r.friction_lever),
            force_share=np.asarray(r.force_share),
            share=self.assembly.share[:, 0],
            drawn_stretch=(self.assembly.stretch @ self.kept)[0],
        )

    def _moved(self, d: Assembly) -> Array:
        """Derivative of the modes kept, (d, n), within the others."""
        coupling = self.rest.T @ d.stiffness @ self.kept - self.rest.T @ d.mass @ self.kept * self.squares
        return np.asarray(self.rest @ (coupling / (np.multiply.outer(self.rest_flexibility, self.squares) - 1.0)))


def _flexibility_change(response: Array, d_rows: Array, d_stiffness: Array) -> Array:
    """Derivative of rows K^-1 rows', with the response K^-1 rows', to the two forces."""
    by_rows = d_rows @ response
    return np.asarray((by_rows + by_rows.T - response.T @ d_stiffness @ response)[:, :2])


def _spectral_change(squares: Array, c: Array, slope: Array, mass: Array, stiffness: Array) -> Array:
    """Derivative of the damping matrix of coefficients c that follow omega_n^2, with those of mass and stiffness.

    `slope` is the derivative of c to omega_n^2. By divided differences: modes may coincide.
    """
    apart = squares[None, :] - squares[:, None]
    alike = np.abs(apart) <= 1e-9 * (squares[None, :] + squares[:, None])
    divided = np.where(alike, slope[None, :], (c[None, :] - c[:, None]) / np.where(alike, 1.0, apart))
    return np.asarray(divided * stiffness + (c[:, None] - squares[:, None] * divided) * mass)
