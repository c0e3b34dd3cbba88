"""Exact derivatives of steady states that were solved together, to the numbers of their rig.

As :mod:`hbm.sensitivity.derivatives`, with records on a leading axis. Numbers of sensors change what is read alone: no
balance is solved for them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hbm.balance.batch import Slopes, Together, Which, some
from hbm.balance.batchednewton import Matrices, Solved
from hbm.channels import DERIVATIVES
from hbm.fourier import Array
from hbm.sensitivity.held import mixing_of, still_of
from hbm.sensitivity.heldplaces import HeldPlaces, places_change
from hbm.sensitivity.moving import MOST_REFINEMENTS, REFINED, SLOW
from models.change import structure_change
from models.parts import Channel
from models.reduction import StructureChange
from models.scalars import FORCE, HZ, LOAD, SENSORS, law_keys


@dataclass(frozen=True, eq=False)
class Changes:
    """Derivatives of R steady states to p numbers.

    Attributes
    ----------
    reads, channels : (R, c, 2H+1) and (R, c, 2H+1, p) array
        What each sensor reads, and its derivatives.
    own_Q : (R, 2H+1, n, p) array
        Of the motion, in the modes that the changed rig has.
    T : (R, 2H+1, p) array
        Of the friction force.
    by_mean : dict of str to (R, 2H+1) array
        What a constant force beside friction does to the sensors and to `friction`, per N.
    solved : (R,) array of bool
        Whether there are derivatives: not at a fold.
    """

    reads: Array
    channels: Array
    own_Q: Array
    T: Array
    by_mean: Mapping[str, Array]
    solved: Array


class _Held:
    """Derivatives to q numbers, unknowns held: of modal forces (R, 2H+1, n, q), and of u, rho, eta (R, 2H+1, q)."""

    def __init__(self, found: Solved[Matrices], keys: tuple[str, ...], change: StructureChange) -> None:
        self.batch = batch = found.matrices.batch
        self.Q, self.T, self.d = found.motions.Q, found.motions.T, change
        self.load, self.hz = (np.array([float(key == name) for key in keys]) for name in (LOAD, HZ))
        rig = batch.first.rig
        own = np.array([[key == name for key in keys] for name in law_keys(rig)], dtype=float).reshape(-1, len(keys))
        self.law = np.vstack([own, self.load])
        self.force = np.multiply.outer(batch.first.force_shape, [float(key == FORCE) for key in keys])
        fine = batch.basis.exact_products
        self._q = fine.synthesis @ self.Q
        self._drawn = fine.analysis @ ((fine.synthesis @ self.T[..., None]) * self._q)  # T q
        self.places = HeldPlaces.of(found, keys, self.force)
        self.u, self.rho, self.eta = self._signals()
        self.modal = self._modal()

    def _signals(self) -> tuple[Array, Array, Array]:
        batch, d, Q = self.batch, self.d, self.Q
        s, basis, force = batch.structure, batch.basis, batch.force[..., None]
        u = Q @ d.rows[:, 0].T + force * d.flexibility[:, 0, 1] + s.residual.slip_by_force * self.force
        if batch.first.coupled:
            for j in np.flatnonzero(d.shortening.any(axis=(1, 2))):
                shorter = np.einsum("rti,rti->rt", self._q @ d.shortening[j], self._q)[..., None]
                u[..., j] -= 0.5 * (basis.exact_products.analysis @ shorter)[..., 0]
        rows = np.stack([Q @ row.T for row in (d.inertia, d.reaction_damping, d.reaction_stiffness)], axis=2)
        rho = batch.reaction_of(rows)
        faster = batch.turning(Q @ s.reaction.damping) - 2 * batch.Omega * basis.k**2 * (Q @ s.reaction.inertia)
        rho += faster[..., None] * (2 * np.pi * self.hz)
        rho[:, 0] += self.load
        rho -= s.reaction.force_share * self.force + force * d.force_share
        eta = Q @ d.stretch.T
        eta[:, 0] -= d.friction_lever
        if batch.places:
            u += self.places.onto(0)
            rho += self.places.onto(-1)
        return u, rho, eta

    def _modal(self) -> Array:
        batch, d, Q = self.batch, self.d, self.Q
        s, basis = batch.structure, batch.basis
        turning, rate = batch.turning(Q), batch.Omega[..., None]
        squared = (rate * basis.k[:, None]) ** 2 * Q
        modal = -self.T[:, :, None, None] * d.rows[:, 0].T - batch.force[:, :, None, None] * d.rows[:, 1].T
        modal -= s.excitation[:, None] * self.force[:, None]
        modal += (s.damping * turning - 2 * rate * basis.k[:, None] ** 2 * Q)[..., None] * (2 * np.pi * self.hz)
        for matrices, motion in (
            (d.stiffness, Q),
            (d.damping, rate * turning),
            (d.mass, -squared),
            (d.shortening if batch.first.coupled else np.zeros_like(d.shortening), self._drawn),
        ):
            for j in np.flatnonzero(matrices.any(axis=(1, 2))):
                modal[..., j] += motion @ matrices[j].T
        return np.asarray(modal - self.places.onto_modes() if batch.places else modal)

    def friction(self, slopes: Slopes, by_Omega: Array) -> Array:
        """Derivatives of the law's force coefficients, (R, 2H+1, q), by their slopes (R, 2H+1, ...) to its signals."""
        still, numbers = still_of(np.vstack([self.law, self.d.flexibility[:, 0, 0]]), self.batch.basis.size)
        change = slopes.of(self.u, self.rho, self.eta) + by_Omega[..., None] * (2 * np.pi * self.hz)
        for i in range(len(change) if len(numbers) else 0):
            change[i] += self.batch.basis.analysis @ self.batch.along(i, still) @ numbers
        return np.asarray(change)


class _Balance:
    """Complete linearised balances, for changes (R, 2H+1, n, q) and (R, 2H+1, q) of their unknowns."""

    def __init__(self, found: Solved[Matrices], slopes: Slopes) -> None:
        self.batch = batch = found.matrices.batch
        self.slopes = slopes
        self._yielding = batch.yielding(np.arange(len(batch.problems)), found.motions, found.seen)
        synthesis = batch.basis.exact_products.synthesis
        self._T = (synthesis @ found.motions.T[..., None])[..., None]
        self._Gq = (synthesis @ found.seen.Gq)[..., None]

    def of(self, which: Which, dQ: Array, dT: Array) -> tuple[Array, Array]:
        """Change of those of some records."""
        batch = self.batch
        s, fine, (R, c, n, q) = batch.structure, batch.basis.exact_products, dQ.shape
        modal = batch.turned(dQ, which) - s.slip_row[:, None] * dT[:, :, None]
        rows = batch.first.rows.T @ dQ  # (R, 2H+1, 5, q)
        u = rows[:, :, 0] - batch.first.dynamic_lagrangian * dT
        if batch.first.coupled:
            moved = (fine.synthesis @ dQ.reshape(R, c, n * q)).reshape(R, -1, n, q)
            Gq = self._Gq[which]
            pulled = self._T[which] * (s.shortening @ moved) + Gq * (fine.synthesis @ dT)[:, :, None]
            modal += (fine.analysis @ pulled.reshape(R, -1, n * q)).reshape(dQ.shape)
            u -= fine.analysis @ (Gq * moved).sum(axis=2)
        rho = batch.reaction_of(rows[:, :, 1:4], which)
        if batch.places:
            given = self.given(which, dQ, dT)
            modal -= batch.places.onto_modes(given)
            u, rho = u + batch.places.onto(0, given), rho + batch.places.onto(-1, given)
        return modal, dT - self.slopes.at(which).of(u, rho, rows[:, :, 4])

    def given(self, which: Which, dQ: Array, dT: Array) -> Array:
        """Change (R, 2H+1, j, q) of what places give with the unknowns of some records."""
        read, slope = self.batch.places.read(dQ, dT), some(self._yielding, which)
        R, c, j, q = read.shape
        return np.asarray(slope.reshape(R, c * j, c * j) @ read.reshape(R, c * j, q)).reshape(read.shape)


@np.errstate(all="ignore")  # what diverges is told by `solved`
def _refined(found: Solved[Matrices], balance: _Balance, modal: Array, contact: Array) -> tuple[Array, Array, Array]:
    """Solve the complete balances with matrices from nearby, refined until nothing changes; and tell which were."""
    if not found.matrices.known.all():  # of those that were solved where they started
        new = np.flatnonzero(~found.matrices.known)
        found.matrices.work_out(new, found.seen.of(new), found.motions.of(new))
    Q, T = np.zeros_like(modal), np.zeros_like(contact)
    units = found.matrices.batch.q_unit, found.matrices.batch.contact_unit
    which, sizes = np.arange(len(modal)), np.full((len(modal), modal.shape[3]), np.finfo(float).tiny)
    left, renewed = (modal, contact), np.zeros(len(modal), dtype=bool)
    for count in range(MOST_REFINEMENTS + 1):
        dQ, dT = found.matrices.solve(which, *left)
        Q[which] += dQ
        T[which] += dT
        size, whole = (
            np.maximum(
                np.abs(a).max(axis=(1, 2)) / units[0][which, None], np.abs(b).max(axis=1) / units[1][which, None]
            )
            for a, b in ((dQ, dT), (Q[which], T[which]))
        )
        before, sizes[which] = sizes[which], np.maximum(size, np.finfo(float).tiny)
        done = (size * np.minimum(size / before, 1.0) <= REFINED * whole).all(axis=1)
        slow = which[~done & ~renewed[which] & ~(size <= SLOW * before).all(axis=1)]
        if count and len(slow):
            found.matrices.work_out(slow, found.seen.of(slow), found.motions.of(slow))
            renewed[slow] = True
        which = which[~done]
        if not len(which):
            break
        there = balance.of(which, Q[which], T[which])
        left = modal[which] - there[0], contact[which] - there[1]
    solved = np.ones(len(modal), dtype=bool)
    solved[which] = False
    return Q, T, solved


def changes_together(found: Solved[Matrices], keys: Sequence[str], sensors: Sequence[str]) -> Changes:
    """Derivatives of steady states that were found together.

    Parameters
    ----------
    found : hbm.balance.batchednewton.Solved
    keys : sequence of str
        As for :func:`hbm.sensitivity.derivatives.sensitivities`.
    sensors : sequence of str
        Response channels.
    """
    batch = found.matrices.batch
    change = structure_change(batch.first.rig, tuple(keys))
    acting = [j for j, key in enumerate(keys) if not key.startswith(SENSORS)]
    own = StructureChange(*(part[acting] for part in change))
    held = _Held(found, tuple(keys[j] for j in acting), own)
    constant = np.zeros((*found.motions.T.shape, 1))
    constant[:, 0] = 1.0
    modal = np.concatenate([-held.modal, np.zeros((*found.motions.Q.shape, 1))], axis=3)
    slopes, by_Omega = batch.slopes(found.seen.signals, np.arange(len(modal)))
    contact = np.concatenate([held.friction(slopes, by_Omega), constant], axis=2)
    balance = _Balance(found, slopes)
    Q, T, solved = _refined(found, balance, modal, contact)
    given = balance.given(np.arange(len(Q)), Q, T)
    by_mean, (Q, T) = (Q[..., -1], T[..., -1]), (Q[..., :-1], T[..., :-1])
    own_Q, own_T = (np.zeros((*a.shape, len(keys))) for a in found.motions)
    mixing = mixing_of(held.d, batch.structure.omega_n**2)
    for at, j in enumerate(acting):
        own_Q[..., j] = Q[..., at] - found.motions.Q @ mixing[at].T if mixing[at].any() else Q[..., at]
    own_T[..., acting] = T
    read = _Read(found, tuple(keys), change)
    reads = [read.reads(name) for name in sensors]
    moved = [
        read.changed(name, r, acting, held.force, Q, T, held.places.change + given[..., :-1])
        for name, r in zip(sensors, reads, strict=True)
    ]
    pushed = {name: read.pushed(name, *by_mean, given[..., -1]) for name in sensors}
    return Changes(
        np.stack(reads, axis=1),
        np.stack(moved, axis=1),
        own_Q,
        own_T,
        {"friction": by_mean[1], **pushed},
        solved,
    )


def reading_changed(
    batch: Together[Any], sensor: Channel, keys: tuple[str, ...], reads: Array, displacement: Array
) -> Array:
    """Change (R, 2H+1, p) of what a sensor reads with p numbers, its own among them, which move its place so much."""

    def equal(name: str) -> Array:
        return np.array([float(key == name) for key in keys])

    change, seen, hz = batch.read(sensor, displacement), reads[..., None], equal(HZ)
    change += seen * (DERIVATIVES[sensor.quantity] / batch.hz)[:, None, None] * hz
    gain, delay = (equal(f"{SENSORS}{sensor.name}.{what}") for what in ("gain", "delay"))
    later = delay * batch.Omega[..., None] + sensor.delay * 2 * np.pi * hz
    return np.asarray(change + seen / sensor.gain * gain - batch.turning(reads)[..., None] * later)


class _Read:
    """What sensors read of some states, and how it changes with p numbers."""

    def __init__(self, found: Solved[Matrices], keys: tuple[str, ...], change: StructureChange) -> None:
        self.batch, self.keys, self.d, (self.Q, self.T) = found.matrices.batch, keys, change, found.motions
        self.given, self.d_places = found.seen.given, places_change(self.batch.first.rig, keys)
        self.sensors = {c.name: c for c in self.batch.first.rig.response_channels}
        self.places = {name: place for place, name in enumerate(self.sensors, start=2)}

    def _rows(self, name: str) -> tuple[Array, float, float]:
        """Row of the modes; motion by the excitation and by friction beyond them."""
        s = self.batch.structure
        return s.channel_rows[name], *s.residual.channels.get(name, (0.0, 0.0))

    def _beyond(self, name: str) -> Array:
        """Motion by what places give, beyond the modes, (j,)."""
        return self.batch.places.residual[:, self.places[name]]

    def reads(self, name: str) -> Array:
        """Coefficients (R, 2H+1)."""
        row, by_force, by_friction = self._rows(name)
        displacement = (
            self.Q @ row + by_force * self.batch.force + by_friction * self.T + self.given @ self._beyond(name)
        )
        return self.batch.read(self.sensors[name], displacement)

    def pushed(self, name: str, Q: Array, T: Array, given: Array) -> Array:
        """Change (R, 2H+1) with that of the unknowns, and of what places give, (R, 2H+1, j)."""
        row, _, by_friction = self._rows(name)
        return self.batch.read(self.sensors[name], Q @ row + by_friction * T + given @ self._beyond(name))

    def changed(
        self, name: str, reads: Array, acting: list[int], force: Array, Q: Array, T: Array, given: Array
    ) -> Array:
        """Change (R, 2H+1, p) of `reads`; numbers `acting` move force, Q, T and what places give, (R, 2H+1, ..., q)."""
        batch, d, place, sensor = self.batch, self.d, self.places[name], self.sensors[name]
        row, by_force, by_friction = self._rows(name)
        displacement = self.Q @ d.rows[:, place].T
        displacement += self.T[..., None] * d.flexibility[:, place, 0]
        displacement += batch.force[..., None] * d.flexibility[:, place, 1]
        displacement += self.given @ self.d_places.residual[:, :, place].T
        displacement[..., acting] += row @ Q + by_force * force + by_friction * T + self._beyond(name) @ given
        return reading_changed(batch, sensor, self.keys, reads, displacement)
