"""Exact derivatives of steady states of a rig with joints that were solved together, to its numbers.

As :mod:`hbm.sensitivity.jointed`, with records on a leading axis.
"""

from collections.abc import Sequence

import numpy as np

from hbm.balance.batchednewton import Solved
from hbm.balance.jointbatch import JointMatrices, followed
from hbm.fourier import Array
from hbm.sensitivity.batch import Changes, reading_changed
from hbm.sensitivity.jointed import law_changes, tone_changes
from models.parts import Channel
from models.scalars import FORCE, HZ


@np.errstate(all="ignore")  # where a curve folds there are none, which `solved` tells
def joint_changes_together(
    found: Solved[JointMatrices], keys: Sequence[str], sensors: Sequence[str], beside: Sequence[int] = ()
) -> tuple[Changes, Array]:
    """Derivatives of steady states that were found together.

    Parameters
    ----------
    found : hbm.balance.batchednewton.Solved
    keys : sequence of str, (p,)
        As for :func:`hbm.sensitivity.derivatives.sensitivities`.
    sensors : sequence of str, (c,)
        Response channels.
    beside : sequence of int, (b,)
        Ports at which constant forces act beside those of the laws.

    Returns
    -------
    Changes
    (R, c + b, 2H+1, b) array
        What each of these forces does to the sensors, and to the forces at these ports, per N.
    """
    batch, every, p = found.matrices.batch, np.arange(len(found.converged)), len(keys)
    found.matrices.work_out(every, found.seen, found.motions)
    held = _Held(found, tuple(keys))
    constant = np.zeros((*found.motions.T.shape, len(beside)))
    constant[:, 0, beside, range(len(beside))] = 1.0
    modal = np.concatenate([-held.modal, np.zeros((*found.motions.Q.shape, len(beside)))], axis=3)
    Q, T = found.matrices.solve(every, modal, np.concatenate([held.contact, constant], axis=3))
    solved = np.logical_and(np.isfinite(Q).all(axis=(1, 2, 3)), np.isfinite(T).all(axis=(1, 2, 3)))
    channels = {c.name: (i, c) for i, c in enumerate(batch.first.rig.response_channels)}
    reads = [held.reads(*channels[name]) for name in sensors]
    moved = [held.changed(*channels[n], r, Q[..., :p], T[..., :p]) for n, r in zip(sensors, reads, strict=True)]
    pushed = [held.pushed(*channels[name], Q[..., p:], T[..., p:]) for name in sensors]
    ports = T[:, :, list(beside), p:].transpose(2, 0, 1, 3)
    by_beside = np.stack([*pushed, *ports], axis=1) if beside else np.zeros((len(Q), len(sensors), Q.shape[1], 0))
    changes = Changes(np.stack(reads, axis=1), np.stack(moved, axis=1), Q[..., :p], T[..., :p], {}, solved)
    return changes, by_beside


class _Held:
    """Derivatives to p numbers, unknowns held, of modal balances (R, 2H+1, n, p) and forces of laws (R, 2H+1, m, p).

    And of what sensors read, by these and by the unknowns.
    """

    def __init__(self, found: Solved[JointMatrices], keys: tuple[str, ...]) -> None:
        self.found, self.keys, self.batch, (self.Q, self.T) = found, keys, found.matrices.batch, found.motions
        batch = self.batch
        self.moving, self.d = batch.first.rig.structure_changes(keys)
        self.hz = self._is(HZ)
        shape = np.multiply.outer(batch.first.force_shape, self._is(FORCE))
        levels = np.array([problem.level for problem in batch.problems])
        self.force = shape + levels[:, None, None] * tone_changes(batch.first, keys)  # (R, 2H+1, p)
        self.modal, self.contact = self._modal(), self._contact()

    def _is(self, name: str) -> Array:
        return np.array([float(key == name) for key in self.keys])

    def _modal(self) -> Array:
        batch, d, Q = self.batch, self.d, self.Q
        s, Omega, squares = batch.structure, batch.Omega[..., None], (batch.basis.k**2)[:, None]
        faster = batch.turning(Q) @ s.damping.T - 2.0 * Omega * squares * Q
        modal = faster[..., None] * (2.0 * np.pi * self.hz) - s.excitation[:, None] * self.force[:, :, None]
        moved = Q[..., None] * (2.0 * s.omega_n[:, None] * d.omega_n)
        moved += np.tensordot(Omega * batch.turning(Q), d.damping, (2, 1))
        moved -= np.tensordot(self.T, d.joints, (2, 0)) + np.multiply.outer(batch.force, d.excitation)
        modal[..., self.moving] += moved
        return np.asarray(modal)

    def _contact(self) -> Array:
        """Of the forces of the laws, through their signals and by their own numbers."""
        batch, matrices = self.batch, self.found.matrices
        signals, every = self._signals(), np.arange(len(self.Q))
        out = np.zeros((*self.T.shape, len(self.keys)))
        for j, (at, of_joint) in enumerate(zip(batch.first.slices, batch.signals, strict=True)):
            used = np.arange(of_joint.start, of_joint.stop)[list(matrices.forces[0][j].used)]
            out[:, :, at] = followed(matrices.by_used(every, j), signals[:, :, used].transpose(0, 2, 1, 3))
        for i, (problem, forces) in enumerate(zip(batch.problems, matrices.forces, strict=True)):
            for at, force in zip(batch.first.slices, forces, strict=True):
                out[i, :, at] += force.by_Omega[..., None] * (2.0 * np.pi * self.hz)
            seen = batch.of_joints(self.found.seen.signals[i])
            for at, columns, by in law_changes(problem, seen, batch.Omega[i, 0], self.keys):
                out[i, :, at, columns] += by.transpose(2, 0, 1)
        return out

    def _signals(self) -> Array:
        """Of the signals of the joints, (R, 2H+1, s, p)."""
        batch, d, Q, T = self.batch, self.d, self.Q, self.T
        s, first, Omega, squares = batch.structure, batch.first, batch.Omega[..., None], (batch.basis.k**2)[:, None]
        u = s.flexibility_to_force[:, None] * self.force[:, :, None]
        w, loads = u.copy(), s.loads_by_force[:, None] * self.force[:, :, None]
        faster = batch.turning(Q) @ s.loads_damping.T - 2.0 * Omega * squares * (Q @ s.loads_inertia.T)
        loads += faster[..., None] * (2.0 * np.pi * self.hz)
        if self.moving:
            moved = np.tensordot(Q, d.joints, (2, 1)) + np.multiply.outer(batch.force, d.flexibility_to_force)
            ports, within = range(len(first.own)), d.flexibility.copy()
            within[ports, ports] -= first.moved_own(d)
            rated = np.where(first.folds[:, None, None], 0.0, d.flexibility)
            u[..., self.moving] += moved + np.tensordot(T, within, (2, 1))
            w[..., self.moving] += moved + np.tensordot(T, rated, (2, 1))
            loads[..., self.moving] += (
                np.tensordot(Omega * batch.turning(Q), d.loads_damping, (2, 1))
                - np.tensordot(Omega**2 * squares * Q, d.loads_inertia, (2, 1))
                + np.tensordot(T, d.loads_by_joints, (2, 1))
                + np.multiply.outer(batch.force, d.loads_by_force)
            )
        return batch.in_turn(u, w, loads)

    def reads(self, i: int, sensor: Channel) -> Array:
        """Coefficients (R, 2H+1)."""
        s = self.batch.structure
        moved = self.Q @ s.channels[i] + self.T @ s.channels_by_joints[i] + s.channels_by_force[i] * self.batch.force
        return self.batch.read(sensor, moved)

    def pushed(self, i: int, sensor: Channel, Q: Array, T: Array) -> Array:
        """Change (R, 2H+1, b) with that of the unknowns (R, 2H+1, ..., b)."""
        s = self.batch.structure
        return self.batch.read(sensor, s.channels[i] @ Q + s.channels_by_joints[i] @ T)

    def changed(self, i: int, sensor: Channel, reads: Array, Q: Array, T: Array) -> Array:
        """Change (R, 2H+1, p) of `reads` with the numbers, which move the unknowns (R, 2H+1, ..., p)."""
        batch, s, d = self.batch, self.batch.structure, self.d
        displacement = s.channels[i] @ Q + s.channels_by_joints[i] @ T + s.channels_by_force[i] * self.force
        own = self.Q @ d.channels[i] + self.T @ d.channels_by_joints[i]
        displacement[..., self.moving] += own + np.multiply.outer(batch.force, d.channels_by_force[i])
        return reading_changed(batch, sensor, self.keys, reads, displacement)
