"""Balances of one rig with joints at several frequencies and forces, solved together.

Records stand on a leading axis, as in :mod:`hbm.balance.batch`; the equations are those of
:class:`hbm.balance.jointequations.JointEquations`. Bodies that move freely, and what has many harmonics at many ports
are solved one by one.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple, TypeGuard

import numpy as np

from hbm.aft.joint import JointForces
from hbm.balance.batch import Motions, Together, Which, amplitudes, real
from hbm.balance.jointed import JointBalance
from hbm.balance.jointednewton import felt, inverted
from hbm.balance.jointequations import Complex
from hbm.fourier import Array, FourierBasis
from models.jointed import AnyRig, JointedRig
from models.jointedstructure import JointedStructure

MOST_UNKNOWNS = 160
"""Cores with more unknowns are factored one by one: that takes longer than all there is to share."""


def is_batched(rig: AnyRig, basis: FourierBasis) -> TypeGuard[JointedRig]:
    """Whether records of a rig with joints can be solved together."""
    if not isinstance(rig, JointedRig) or rig.excitation.measured_harmonics or rig.drift:
        return False
    return bool((rig.structure.omega_n > 0.0).all() and rig.ports * basis.size <= MOST_UNKNOWNS)


class Seen(NamedTuple):
    """What states do at the joints, and what they leave of their balances.

    Attributes
    ----------
    signals : (R, 2H+1, s) array
        Those of each joint in turn, as :meth:`hbm.balance.jointequations.JointEquations.signals`.
    modal, contact : (R, 2H+1, n) and (R, 2H+1, m) array
        Balance of forces on each mode, and at each port [N].
    norm : (R,) array
        The largest of these in the units of the residual.
    """

    signals: Array
    modal: Array
    contact: Array
    norm: Array

    def of(self, which: Any) -> "Seen":
        """What some of them do."""
        return Seen(*(part[which] for part in self))


class JointBatch(Together[JointBalance]):
    """Balances of one rig with joints, as many as there are records.

    Parameters
    ----------
    problems : sequence of JointBalance
        Of one rig; they differ in their level.
    hz : (R,) array
        Frequency of each.
    """

    def __init__(self, problems: Sequence[JointBalance], hz: Array) -> None:
        super().__init__(problems, hz)
        first = self.first
        self.contact_unit = np.array([p.f_ref for p in problems])
        ends = np.cumsum([0, *(2 * j.ports + 1 for j in first.joints)]).tolist()
        self.signals = [slice(*pair) for pair in pairwise(ends)]
        self.stiffness: Complex = np.stack([first.dynamic_stiffness(Omega) for Omega in self.Omega[:, 0]])

    def of(self, which: Which) -> "JointBatch":
        """Those of some records."""
        return JointBatch([self.problems[i] for i in which], self.hz[which])

    # ---- the equations

    def turned(self, Q: Array, which: Which) -> Array:
        """Dynamic stiffness times motions (R, 2H+1, n)."""
        return real(times(self.stiffness[which], amplitudes(Q)[..., None])[..., 0])

    def seen(self, motions: Motions, which: Which) -> Seen:
        """What motions of some of the records do, and leave."""
        s, basis, force, (Q, T) = self.structure, self.basis, self.force[which], motions
        signals = self.signals_of(s, Q, T, force, which)
        modal = self.turned(Q, which) - T @ s.joints - force[..., None] * s.excitation
        contact = T - np.stack([basis.analysis @ self._forces(i, signals[at]) for at, i in enumerate(which)])
        norm = np.maximum(
            np.abs(modal).max(axis=(1, 2)) / self.modal_unit[which],
            (np.abs(contact) / self.contact_unit[which, None]).max(axis=(1, 2), initial=0.0),
        )
        return Seen(signals, modal, contact, norm)

    def signals_of(self, s: JointedStructure, Q: Array, T: Array, force: Array, which: Which) -> Array:
        """Signals (R, 2H+1, s) of motions, forces at the ports, and the excitation (R, 2H+1)."""
        moved = Q @ s.joints.T + force[..., None] * s.flexibility_to_force
        u, w = moved + T @ self.first.flexibility, moved + T @ self.first.flexibility_of_rate.T
        Omega = self.Omega[which][..., None]
        loads = Omega * self.turning(Q @ s.loads_damping.T)
        loads -= (self.basis.k[:, None] * Omega) ** 2 * (Q @ s.loads_inertia.T)
        loads += T @ s.loads_by_joints.T + force[..., None] * s.loads_by_force
        return self.in_turn(u, w, loads)

    def in_turn(self, u: Array, w: Array, loads: Array) -> Array:
        """Signals of the ports and loads of all joints, on the third axis, joint by joint."""
        parts = [
            part for j, at in enumerate(self.first.slices) for part in (u[:, :, at], w[:, :, at], loads[:, :, [j]])
        ]
        return np.concatenate(parts, axis=2) if parts else u

    def of_joints(self, signals: Array) -> list[Array]:
        """Signals (2H+1, s) of a record by joint, arrays of their own."""
        return [np.ascontiguousarray(signals[:, at]) for at in self.signals]

    def _forces(self, i: int, signals: Array) -> Array:
        """Forces at the ports of record `i` at the samples (N_t, m); nan where it has left the numbers."""
        N_t, m = self.basis.N_t, len(self.first.own)
        if not np.isfinite(signals).all():
            return np.full((N_t, m), np.nan)
        laws = zip(self.problems[i].joints, self.of_joints(signals), strict=True)
        found = [law.shown(shown, self.Omega[i, 0])[0] for law, shown in laws]
        return np.hstack([np.zeros((N_t, 0)), *found])

    def linearized(self, i: int, signals: Array) -> list[JointForces]:
        """Forces of the joints of record `i` with their derivatives."""
        laws = zip(self.problems[i].joints, self.of_joints(signals), strict=True)
        return [law.linearize(shown, self.Omega[i, 0]) for law, shown in laws]


class JointMatrices:
    """Newton's matrices of the records of a batch, each of the state where it was worked out last.

    The modes are eliminated, harmonic by harmonic; the dense core is as large as the joint signals.

    Attributes
    ----------
    known : (R,) array of bool
        Whose were worked out.
    forces : list of list of JointForces
        Of each record.
    """

    def __init__(self, batch: JointBatch) -> None:
        self.batch = batch
        R, size = len(batch.problems), batch.basis.size * len(batch.first.own)
        self._receptance = inverted(batch.stiffness, batch.structure.omega_n, diagonal=batch.first.diagonal)
        self._core = np.empty((R, size, size))
        self.forces: list[list[JointForces]] = [[]] * R
        self.known = np.zeros(R, dtype=bool)

    def of(self, which: Which) -> "JointMatrices":
        """Those of some records."""
        others = JointMatrices(self.batch.of(which))
        others._core, others.known = self._core[which], self.known[which]
        others.forces = [self.forces[i] for i in which]
        return others

    def work_out(self, which: Which, seen: Seen, motions: Motions) -> None:
        """Those of some records, at their states."""
        del motions
        batch = self.batch
        for at, i in enumerate(which):
            self.forces[i] = batch.linearized(i, seen.signals[at])
        size, m, k = batch.basis.size, len(batch.first.own), len(which)
        core = np.zeros((k, size, m, size, m))
        core[:] = np.eye(size * m).reshape(size, m, size, m)
        s = batch.structure
        between = self._between(s.joints, which)
        for j, (ports, used) in enumerate(self._used(which)):
            core[:, :, ports] -= felt(self.by_used(which, j), self._by_ports(j, used, between, which))
        self._core[which] = core.reshape(k, size * m, size * m)
        self.known[which] = True

    def by_used(self, which: Which, j: int) -> Array:
        """Derivatives of the forces of a joint, (R, u, ports, 2H+1, 2H+1)."""
        return np.stack([self.forces[i][j].by_used for i in which])

    def _used(self, which: Which) -> list[tuple[slice, tuple[int, ...]]]:
        """Ports of each joint, and which of its signals its forces depend on."""
        return [(at, self.forces[which[0]][j].used) for j, at in enumerate(self.batch.first.slices)]

    def _by_ports(self, j: int, used: tuple[int, ...], between: Complex, which: Which) -> Complex:
        """Signals used of joint j per force at every port, modes following, (R, H+1, u, m)."""
        first, s, at = self.batch.first, self.batch.structure, self.batch.first.slices[j]
        m = at.stop - at.start
        parts = []
        for i in used:
            if i < m:
                parts.append(between[:, :, at.start + i] + first.flexibility[at.start + i])
            elif i < 2 * m:
                parts.append(between[:, :, at.start + i - m] + first.flexibility_of_rate[at.start + i - m])
            else:
                by_force = self._between(self._loads(j, which)[:, :, None], which)
                parts.append(by_force[:, :, 0] + s.loads_by_joints[j])
        return np.stack(parts, axis=2)

    def _between(self, rows: Array | Complex, which: Which) -> Complex:
        """What rows of the modes (r, n) or (R, H+1, r, n) see per force at every port, (R, H+1, r, m)."""
        receptance = self._receptance[which]
        seen = rows @ receptance if receptance.ndim == 4 else rows * receptance[:, :, None]
        return np.asarray(seen @ self.batch.structure.joints.T)

    def _loads(self, j: int, which: Which) -> Complex:
        """What loads joint j per mode, (R, H+1, n)."""
        s, batch = self.batch.structure, self.batch
        rate = batch.Omega[which][..., None] * np.arange(batch.basis.H + 1)[:, None]
        return np.asarray(1j * rate * s.loads_damping[j] - rate**2 * s.loads_inertia[j])

    def _law_of(self, which: Which, Q: Array) -> Array:
        """Change (R, 2H+1, m, p) of the joints' forces with modes (R, 2H+1, n, p), forces that load them held."""
        batch, s = self.batch, self.batch.structure
        k, size, _, p = Q.shape
        out, moved = np.zeros((k, size, len(batch.first.own), p)), s.joints @ Q
        for j, (at, used) in enumerate(self._used(which)):
            m = at.stop - at.start
            seen = [moved[:, :, at.start + i % m] for i in used if i < 2 * m]
            if 2 * m in used:
                seen.append(real((self._loads(j, which)[:, :, None] @ amplitudes(Q))[:, :, 0]))
            out[:, :, at] = followed(self.by_used(which, j), np.stack(seen, axis=1))
        return out

    def solve(self, which: Which, modal: Array, contact: Array) -> tuple[Array, Array]:
        """Motion (R, 2H+1, n, p) and forces (R, 2H+1, m, p) whose balances are these, of the same shapes."""
        receptance, (k, size, m, p) = self._receptance[which], contact.shape
        Q = real(times(receptance, amplitudes(modal)))
        core = (contact + self._law_of(which, Q)).reshape(k, size * m, p)
        T: Array = np.asarray(np.linalg.solve(self._core[which], core)).reshape(contact.shape)
        Q += real(times(receptance, amplitudes(self.batch.structure.joints.T @ T)))
        return Q, T


def times(matrices: Complex, columns: Complex) -> Complex:
    """Products (R, H+1, n, p) of matrices (R, H+1, n, n), or diagonals (R, H+1, n), with columns (R, H+1, n, p)."""
    return np.asarray(matrices @ columns if matrices.ndim == 4 else matrices[..., None] * columns)


def followed(by_used: Array, seen: Array) -> Array:
    """Change (R, 2H+1, ports, p) of the forces of a joint whose derivatives are (R, u, ports, 2H+1, 2H+1).

    Its signals used change by `seen` (R, u, 2H+1, p).
    """
    return np.asarray((by_used @ seen[:, :, None]).sum(axis=1).transpose(0, 2, 1, 3))
