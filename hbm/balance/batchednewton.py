"""Newton's method on the balances of a batch, all records at once, each with its own matrix and its own end.

The elimination is that of :class:`hbm.balance.elimination.Elimination`, for a frequency that is held.
"""

from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt
from scipy.linalg import lapack

from continuation.newton import FAST, FORGIVEN_GROWTH
from hbm.balance.batch import Batch, Motions, Seen, Slopes, Which, amplitudes, put, real, some
from hbm.balance.elimination import factored
from hbm.balance.jointbatch import JointMatrices
from hbm.balance.problem import TOLERANCE
from hbm.fourier import Array


class Matrices:
    """Newton's matrices of the records of a batch, each of the state where it was worked out last.

    The lowest modes, which friction along the structure couples, are eliminated with a dense factorisation, the others
    harmonic by harmonic; what is left has the size of the friction force.

    Attributes
    ----------
    known : (R,) array of bool
        Whose were worked out.
    """

    def __init__(self, batch: Batch) -> None:
        self.batch = batch
        R, c, s = len(batch.problems), batch.basis.size, batch.structure
        self.m = m = batch.first.coupled
        self.slip_row = s.slip_row
        direct, crossed = batch.direct[..., m:], batch.crossed[..., m:]
        squares = direct**2 + crossed**2
        self._direct, self._crossed = direct / squares, -crossed / squares  # receptance of the others
        H = batch.basis.H
        stiffness = batch.direct[:, : H + 1, :m] + 1j * batch.crossed[:, : H + 1, :m]
        self._stiffness, self._receptance = stiffness, 1.0 / stiffness
        self._law_by_coupled, self._coupled_of = np.empty((R, c, c * m)), np.empty((R, c * m, c))
        self._core = np.empty((R, c, c))
        self._factored: list[tuple[Which, Array, npt.NDArray[Any]]] = [(np.empty(0, dtype=int),) * 3] * R
        self._slopes = Slopes(None, None, None)
        j = len(batch.places)
        self.yielding = np.zeros((R, c, j, c, j))
        self._by_given = np.zeros((R, c, s.n, c * j)), np.zeros((R, c, c * j))
        self._given = np.zeros((R, c * j, c * j))
        self.known = np.zeros(R, dtype=bool)

    def of(self, which: Which) -> "Matrices":
        """Those of some records."""
        others = Matrices(self.batch.of(which))
        others._law_by_coupled, others._coupled_of = self._law_by_coupled[which], self._coupled_of[which]
        others._core, others._factored = self._core[which], [self._factored[i] for i in which]
        others.known = self.known[which]
        others._slopes = self._slopes.at(which)
        others.yielding, others._given = self.yielding[which], self._given[which]
        others._by_given = self._by_given[0][which], self._by_given[1][which]
        return others

    def work_out(self, which: Which, seen: Seen, motions: Motions) -> None:
        """Those of some records, at their states."""
        batch, m, first = self.batch, self.m, self.batch.first
        basis, size, k = batch.basis, batch.basis.size, len(which)
        slopes, _ = batch.slopes(seen.signals, which)
        if not self.known.any():
            self._slopes = Slopes(*(None if slope is None else np.empty_like(self._core) for slope in slopes))
        put(self._slopes, which, slopes)
        core = np.eye(size) - self._law_of_others(which, slopes)
        if first.dynamic_lagrangian and slopes.by_u is not None:
            core += first.dynamic_lagrangian * slopes.by_u
        if m:
            p = -seen.Gq[..., :m]
            p[:, 0] += self.slip_row[:m]
            slip = basis.multiplication(p.transpose(1, 0, 2).reshape(size, k * m)).reshape(size, size, k, m)
            slip = np.ascontiguousarray(slip.transpose(2, 0, 1, 3))
            law = np.zeros((k, size, size * m)) if slopes.by_u is None else slopes.by_u @ slip.reshape(k, size, -1)
            if first.varies:
                law += self._law_by_rows(which, slopes)
            self._law_by_coupled[which] = law
            by_T = basis.multiplication(np.ascontiguousarray(motions.T.T))
            for at, i in enumerate(which):
                self._factored[i] = factored(first, self._stiffness[i], by_T[..., at])
            of = self._solve_coupled(which, slip.transpose(0, 1, 3, 2)).reshape(k, size * m, size)
            self._coupled_of[which] = of
            core -= law @ of
        self._core[which], self.known[which] = core, True
        self._work_out_places(which, seen, motions)

    def _work_out_places(self, which: Which, seen: Seen, motions: Motions) -> None:
        """What places that give way add to them: solutions with what these give held, and how it feeds itself."""
        places = self.batch.places
        if not places:
            return
        yielding = self.batch.yielding(which, motions, seen)
        c, j = yielding.shape[1:3]
        self.yielding[which] = yielding
        self._given[which] = np.eye(c * j)
        acting = which[yielding.any(axis=(1, 2, 3, 4))]
        if not len(acting):
            return
        unit = np.eye(c * j).reshape(c, j, c * j)
        given = np.broadcast_to(unit, (len(acting), *unit.shape))
        u, rho = places.onto(0, given), places.onto(-1, given)
        contact = self._slopes.at(acting).of(u, rho, np.zeros_like(u))
        Q, T = self._held(acting, places.onto_modes(given), contact)
        self._by_given[0][acting], self._by_given[1][acting] = Q, T
        self._given[acting] -= self._gives(acting, Q, T)

    def _gives(self, which: Which, Q: Array, T: Array) -> Array:
        """Change ((2H+1) j, p) of what the places of some records give with their motions and friction."""
        read = self.batch.places.read(Q, T)
        slope = self.yielding[which].reshape(len(which), *self._given.shape[1:])
        return np.asarray(slope @ read.reshape(len(which), slope.shape[2], -1))

    def _law_by_rows(self, which: Which, slopes: Slopes) -> Array:
        """Change of the law's force coefficients with the coupled modes through the reaction, (R, 2H+1, (2H+1) m)."""
        batch, basis = self.batch, self.batch.basis
        size, Omega = basis.size, some(batch.Omega, which)
        by_rows = np.zeros((len(which), size, size, 4))
        if slopes.by_rho is not None:
            by_rows[..., 0] = -slopes.by_rho * ((basis.k * Omega) ** 2)[:, None]
            by_rows[..., 1] = -(Omega * basis.signed_k)[:, None] * slopes.by_rho[:, :, basis.swapped]
            by_rows[..., 2] = slopes.by_rho
        if slopes.by_eta is not None:
            by_rows[..., 3] = slopes.by_eta
        return np.asarray((by_rows @ batch.first.rows[: self.m, 1:].T).reshape(len(which), size, -1))

    def _solve_coupled(self, which: Which, forces: Array) -> Array:
        """Motion (R, 2H+1, m, p) of the coupled modes under modal forces."""
        motion, p = real(amplitudes(forces) * some(self._receptance, which)[..., None]), forces.shape[3]
        for at, i in enumerate(which):
            dense, lu, pivots = self._factored[i]
            flat = forces[at].reshape(-1, p)
            motion[at].reshape(-1, p)[dense] = lapack.dgetrs(lu, pivots, flat[dense], trans=1)[0]
        return motion

    def _others(self, which: Which, forces: Array) -> Array:
        """Motion (R, 2H+1, n - m, p) of the other modes under modal forces."""
        swapped = forces[:, self.batch.basis.swapped]
        return np.asarray(
            some(self._direct, which)[..., None] * forces + some(self._crossed, which)[..., None] * swapped
        )

    def _law_of_others(self, which: Which, slopes: Slopes) -> Array:
        """Change (R, 2H+1, 2H+1) of the law's force coefficients with those of T, through the other modes."""
        batch, basis, first = self.batch, self.batch.basis, self.batch.first
        weights = first.rows[self.m :] * self.slip_row[self.m :, None]
        direct, crossed = some(self._direct, which) @ weights, some(self._crossed, which) @ weights  # (R, 2H+1, 5)
        rate = some(batch.Omega, which) * basis.signed_k
        squared = (some(batch.Omega, which) * basis.k) ** 2
        rho = (
            direct[..., 3] - squared * direct[..., 1] - rate * crossed[..., 2],
            crossed[..., 3] - squared * crossed[..., 1] + rate * direct[..., 2],
        )
        signals = (direct[..., 0], crossed[..., 0]), rho, (direct[..., 4], crossed[..., 4])
        out = np.zeros((len(which), basis.size, basis.size))
        for slope, (straight, across) in zip(slopes, signals, strict=True):
            if slope is not None:
                out += slope * straight[:, None]
                out += slope[:, :, basis.swapped] * across[:, None, basis.swapped]
        return out

    def solve(self, which: Which, modal: Array, contact: Array) -> tuple[Array, Array]:
        """Motion (R, 2H+1, n, p) and friction (R, 2H+1, p) whose balances are these, of the same shapes."""
        motion, dT = self._held(which, modal, contact)
        yields = np.flatnonzero(self.yielding[which].any(axis=(1, 2, 3, 4)))
        if len(yields):
            those = which[yields]
            given = np.linalg.solve(self._given[those], self._gives(those, motion[yields], dT[yields]))
            by_Q, by_T = (part[those] for part in self._by_given)
            motion[yields] += (by_Q.reshape(len(those), -1, by_Q.shape[3]) @ given).reshape(motion[yields].shape)
            dT[yields] += by_T @ given
        return motion, dT

    def _held(self, which: Which, modal: Array, contact: Array) -> tuple[Array, Array]:
        """The same with what places give held."""
        m, batch, k = self.m, self.batch, len(which)
        motion, core = np.empty(modal.shape), contact.copy()
        if m:
            motion[:, :, :m] = self._solve_coupled(which, modal[:, :, :m])
            core += some(self._law_by_coupled, which) @ motion[:, :, :m].reshape(k, -1, modal.shape[3])
        if batch.structure.n > m:
            motion[:, :, m:] = others = self._others(which, modal[:, :, m:])
            seen = batch.first.rows[m:].T @ others
            rho = batch.reaction_of(seen[:, :, 1:4], which) if batch.first.varies else seen[:, :, 1]
            core += self._slopes.at(which).of(seen[:, :, 0], rho, seen[:, :, 4])
        dT = np.linalg.solve(self._core[which], core)
        if m:
            motion[:, :, :m] += (some(self._coupled_of, which) @ dT).reshape(k, batch.basis.size, m, -1)
        if batch.structure.n > m:
            motion[:, :, m:] += self._others(which, self.slip_row[m:, None] * dT[:, :, None])
        return motion, np.asarray(dT)


AnyMatrices = TypeVar("AnyMatrices", bound=Matrices | JointMatrices)


class Solved(NamedTuple, Generic[AnyMatrices]):
    """Where Newton's method took the records of a batch: `converged` (R,) tells which got there."""

    motions: Motions
    seen: Any
    converged: npt.NDArray[np.bool_]
    matrices: AnyMatrices

    def of(self, which: Which) -> "Solved[AnyMatrices]":
        """Some of the records."""
        matrices: Any = self.matrices.of(which)
        return Solved(self.motions.of(which), self.seen.of(which), self.converged[which], matrices)


@np.errstate(all="ignore")  # a record that diverges is left to others
def solve(matrices: AnyMatrices, start: Motions, steps: int) -> Solved[AnyMatrices]:
    """Steady states from nearby; those that no full step of Newton's method brings nearer are given up.

    Parameters
    ----------
    matrices : Matrices or JointMatrices
        Of a batch, none of them worked out.
    start : Motions
    steps : int
        Matrices of each record, at most.
    """
    batch: Any = matrices.batch
    motions = Motions(start.Q.copy(), start.T.copy())
    every = np.arange(len(batch.problems))
    seen: Any = batch.seen(motions, every)
    best, left = seen.norm.copy(), np.full(len(every), steps)
    stale, forgiven = np.ones(len(every), dtype=bool), np.zeros(len(every), dtype=bool)
    going = seen.norm > TOLERANCE
    while going.any():
        which = np.flatnonzero(going)
        new = stale[which]
        if new.any():
            matrices.work_out(which[new], seen.of(which[new]), motions.of(which[new]))
            left[which[new]] -= 1
        dQ, dT = matrices.solve(which, -seen.modal[which, ..., None], -seen.contact[which, ..., None])
        trial = Motions(motions.Q[which] + dQ[..., 0], motions.T[which] + dT[..., 0])
        there: Any = batch.seen(trial, which)
        better = there.norm < best[which]
        raised = ~better & new & ~forgiven[which] & (there.norm < FORGIVEN_GROWTH * best[which])
        stale[which] = ~(better & (there.norm <= FAST * seen.norm[which]))
        taken = better | raised
        put(motions, which[taken], trial.of(taken))
        put(seen, which[taken], there.of(taken))
        best[which], forgiven[which] = np.fmin(best[which], there.norm), forgiven[which] | raised
        going[which] = (taken | ~new) & (left[which] > 0) & (seen.norm[which] > TOLERANCE)
    return Solved(motions, seen, seen.norm <= TOLERANCE, matrices)
