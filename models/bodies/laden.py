"""Lumped masses on a body: its modes with them, and exact derivatives of these.

The body's equations stay as they are; a lump adds its displacement x as a coordinate. With the modes q and the rows R
and the flexibility Phi of the places of lumps, forces on (q, x) displace them at rest by

    [[Omega^-2, Omega^-2 R'], [R Omega^-2, R Omega^-2 R' + Phi]],

scaled by the roots of the inertia the matrix whose largest eigenvalues are 1/omega^2 of the lowest modes. It is regular
where a lump has no mass or the body there no flexibility: what has neither has the eigenvalue 0, and no inverse is
asked for. Modes that are left out answer at rest, which lumps do not change. Rigid motion is held by springs in
proportion to the inertia, which raise every omega^2 alike.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from models.bodies.ported import Body, PortedModes
from models.bounds import bounded
from models.parts import Damping
from models.plausible import plausible
from models.structure import Array

LENT = 1e-12
"""Of the inertia that a mode has where a lump is, lent to the lump: one without any has a root of no slope."""

ALIKE = 1e-10
"""Eigenvalues that differ by less, of the largest, are one: turning such modes into each other changes nothing."""


@dataclass(frozen=True)
class LumpedMass:
    """A mass without extension, which every translation of its point moves.

    Attributes
    ----------
    at : str
        Place of the body: one of the translations of the point.
    mass : float
        [kg]
    """

    at: str
    mass: float

    def __post_init__(self) -> None:
        """Refuse a mass that is none."""
        bounded("LumpedMass: mass", self.mass, 0.0)
        plausible("LumpedMass: mass", self.mass, "kg")

    def __str__(self) -> str:
        """In words."""
        return f"lumped mass: {self.mass:.6g} kg at {self.at}"


@dataclass(frozen=True, eq=False)
class Laden:
    """A body in modes with lumps on it.

    Attributes
    ----------
    bare : PortedModes
        The body without them; each place that a lump moves along is there once more, after all others.
    inertia : (k,) array
        Along these places [kg].
    lumps : (k,) array
        Which lump each is of.
    alpha : float
        Damping of the lumps in proportion to their mass [1/s].
    """

    bare: PortedModes
    inertia: Array
    lumps: npt.NDArray[np.intp]
    alpha: float

    @cached_property
    def modes(self) -> PortedModes:
        """As many modes as the body has, with the rows of all places but those of lumps."""
        return self._ported(self._function(*self._given)) if self.inertia.size else self.bare

    def change(self, bare: PortedModes, inertia: Array, alpha: float) -> PortedModes:
        """Exact derivatives of the modes and rows.

        Parameters
        ----------
        bare : PortedModes
            Derivatives of those of the body without lumps.
        inertia : (k,) array
        alpha : float
            The same of the others.
        """
        if not self.inertia.size:
            return bare
        moved = [*_numbers(bare), inertia, alpha]
        still = [np.zeros(np.shape(value)) for value in self._given[len(moved) :]]
        found = self._function.forward(1)(*self._given, *self._function(*self._given), *moved, *still)
        return self._ported(found)

    @property
    def _sizes(self) -> "Sizes":
        return self.bare.n, len(self.bare.places), len(self.bare.supports), len(self.inertia)

    @cached_property
    def _function(self) -> ca.Function:
        return _laden(int(np.sum(self.bare.omega_n == 0.0)), *self._sizes)

    @cached_property
    def _given(self) -> list[Any]:
        """Numbers that modes are made of; those from the fourth last on are held while the others change."""
        bare, k = self.bare, len(self.inertia)
        own = [*_numbers(bare), self.inertia, self.alpha]
        flexible = bare.omega_n[bare.omega_n > 0.0]
        shift = 0.0 if len(flexible) == bare.n else float(flexible[0] ** 2) if len(flexible) else 1.0
        response = 1.0 / (bare.omega_n**2 + shift)
        rows = bare.rows[-k:]
        at_rest = np.einsum("ij,j,ij->i", rows, response, rows) + bare.flexibility.diagonal()[-k:]
        lent = LENT * response.max() / largest if (largest := at_rest.max()) > 0.0 else 0.0
        size, shapes = np.linalg.eigh(_compliance(*self._sizes)(*own, shift, lent).full())
        size, shapes = size[::-1], shapes[:, ::-1]
        shapes = shapes * np.sign(shapes[np.abs(shapes).argmax(axis=0), range(len(size))])
        apart = size[None, :] - size[:, None]
        alike = np.abs(apart) <= ALIKE * size[0]
        return [*own, shift, lent, shapes, np.where(alike, 0.0, 1.0 / np.where(alike, 1.0, apart))]

    def _ported(self, found: Sequence[ca.DM]) -> PortedModes:
        omega_n, damping, rows, flexibility, inertia, by_velocity, share = (part.full() for part in found)
        return replace(
            self.bare,
            omega_n=omega_n[:, 0],
            damping=(damping + damping.T) / 2,
            places=self.bare.places[: -len(self.inertia)],
            rows=rows,
            flexibility=(flexibility + flexibility.T) / 2,
            reaction_inertia=inertia,
            reaction_damping=by_velocity,
            reaction_share=share,
        )


def laden(
    body: Body, lumps: Sequence[LumpedMass], places: Sequence[str], damping: Damping, supports: Sequence[str] = ()
) -> Laden:
    """A body in modes with lumps, as :meth:`models.bodies.ported.Body.ported`.

    Raises
    ------
    ValueError
        If there is no such place or support.
    """
    along = [(place, i) for i, lump in enumerate(lumps) for place in body.translations(lump.at)]
    bare = body.ported([*places, *(place for place, _ in along)], damping, supports)
    of = np.array([i for _, i in along], dtype=np.intp)
    return Laden(bare, np.array([lumps[i].mass for i in of]), of, damping.mass_proportional)


def _numbers(p: PortedModes) -> list[Array]:
    """What modes with lumps are made of, in turn."""
    return [p.omega_n, p.damping, p.rows, p.flexibility, p.reaction_inertia, p.reaction_damping, p.reaction_share]


Sizes = tuple[int, int, int, int]
"""Modes, places, supports, places of lumps."""


class _AtRest:
    """Displacements at rest by forces, in symbols, rigid motion held."""

    def __init__(self, n: int, p: int, r: int, k: int) -> None:
        sizes = ((n, 1), (n, n), (p, n), (p, p), (r, n), (r, n), (r, p), (k, 1), (1, 1), (1, 1), (1, 1))
        self.given = [ca.MX.sym(f"given{i}", *size) for i, size in enumerate(sizes)]
        omega_n, self.damping, rows, flexibility, *reactions, inertia, self.alpha, self.shift, lent = self.given
        self.reaction_inertia, self.reaction_damping, self.share = reactions
        self.root = ca.sqrt(inertia + lent)
        every = ca.vertcat(ca.DM.eye(n), rows)
        held = every / ca.repmat((omega_n**2 + self.shift).T, n + p, 1) @ every.T
        held += ca.diagcat(ca.DM.zeros(n, n), flexibility)
        at, roots = slice(n + p - k, n + p), ca.diag(self.root)
        across = roots @ held[at, :]
        springs = ca.DM.eye(k) + self.shift * across[:, at] @ roots
        held -= self.shift * across.T @ ca.solve(springs, across)
        coordinates, seen = [*range(n), *range(n + p - k, n + p)], slice(n, n + p - k)
        scale = ca.diag(ca.vertcat(ca.DM.ones(n), self.root))
        self.scaled = scale @ held[coordinates, coordinates] @ scale
        self.of_places = held[seen, coordinates] @ scale
        self.between = held[seen, seen]


@lru_cache(maxsize=64)
def _compliance(n: int, p: int, r: int, k: int) -> ca.Function:
    """The scaled matrix whose eigenvalues are 1 / (omega^2 + shift)."""
    s = _AtRest(n, p, r, k)
    return ca.Function("compliance", s.given, [s.scaled])


@lru_cache(maxsize=64)
def _laden(rigid: int, n: int, p: int, r: int, k: int) -> ca.Function:
    """Modes of a body with lumps, from the eigenvectors of its compliance and the reciprocal gaps of the eigenvalues.

    To the first order about these, which makes the derivatives exact: Fox & Kapoor, AIAA Journal 6(12), 1968.
    """
    s = _AtRest(n, p, r, k)
    near, per_gap = ca.MX.sym("near", n + k, n + k), ca.MX.sym("per_gap", n + k, n + k)
    turned = near.T @ s.scaled @ near
    size, shapes = ca.diag(turned), near + near @ (turned * per_gap)
    kept, left = shapes[:, :n], shapes[:, n:]
    moved, others = s.of_places @ kept, s.of_places @ left
    per_size = ca.repmat(1 / size[:n].T, moved.shape[0], 1)
    soft = ca.repmat((s.shift / (1 - s.shift * size[n:])).T, others.shape[0], 1)
    flexibility = s.between - (moved * per_size) @ moved.T + (others * soft) @ others.T
    omega_n = ca.vertcat(ca.DM.zeros(rigid), ca.sqrt(1 / size[rigid:n] - s.shift))
    of_lumps = s.share[:, p - k :] @ ca.diag(s.root)
    return ca.Function(
        "laden",
        [*s.given, near, per_gap],
        [
            omega_n,
            kept.T @ ca.diagcat(s.damping, s.alpha * ca.DM.eye(k)) @ kept,
            moved * per_size,
            flexibility,
            ca.horzcat(s.reaction_inertia, of_lumps) @ kept,
            ca.horzcat(s.reaction_damping, s.alpha * of_lumps) @ kept,
            s.share[:, : p - k],
        ],
    )
