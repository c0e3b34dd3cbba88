"""Harmonic balance of a body with joints: its unknowns, their units and equations.

Unknowns are the modal coefficients Q (2H+1, n) and those of the forces at the ports of all joints f (2H+1, m). The
modes are linear: they are eliminated, harmonic by harmonic, and the dense core is as large as the joint signals.

Scaling is that of :mod:`hbm.balance.equations`: a residual of 1e-10 means that every balance closes to 1e-10 of the
excitation.
"""

from copy import copy
from itertools import pairwise
from typing import Self

import numpy as np
import numpy.typing as npt

from hbm.aft.joint import JointOverPeriod
from hbm.balance.scaled import Scaled, State
from hbm.fourier import Array
from models.jointed import JointedRig
from models.jointedstructure import JointedStructure

Complex = npt.NDArray[np.complex128]


CENTRING = 1e-5
"""Stiffness that keeps the mean of what slides at rest, in units of that of the first elastic mode."""


SEEN = 1e-9
"""A motion moves a port by more than this share of what its places move, which may all move alike; else by rounding."""


def _unseen(sees: Array, places: Array) -> Array:
    """Projector on the rigid motions (rigid, rigid) that do not move ports (m, rigid), whose places move so much."""
    _, sizes, directions = np.linalg.svd(sees)
    seen = directions[: np.count_nonzero(sizes > SEEN * places.max(initial=0.0))]
    return np.asarray(np.eye(sees.shape[1]) - seen.T @ seen)


class JointEquations(Scaled[JointedRig]):
    """A rig with joints on a Fourier basis: its unknowns and their equations."""

    structure: JointedStructure

    def _set_up(self, like: Self | None) -> None:
        rig, s = self.rig, self.structure
        first = np.cumsum([0, *(j.law.ports for j in rig.joints)])
        self.slices = [slice(int(a), int(b)) for a, b in pairwise(first)]
        self.lent: Array = self._lendable() if like is None else like.lent
        self.own = self._own_compliances()
        self.joints = self._over_period()
        self.flexibility = s.flexibility - np.diag(self.own)
        # velocities in limits of friction are those of the modes, docs/theory/equations.md section 3
        self.folds = np.array([j.law.folds for j in rig.joints for _ in range(j.law.ports)], dtype=bool)
        self.flexibility_of_rate = np.where(self.folds[:, None], 0.0, s.flexibility)
        self.diagonal = bool(np.count_nonzero(s.damping - np.diag(s.damping.diagonal())) == 0)
        self.rigid = np.flatnonzero(s.omega_n == 0.0)
        self.adrift = self._adrift()

    def at_level(self, level: float) -> Self:
        """Return the same balance with another force amplitude [N], in its units, and laws of its own."""
        other = copy(self)
        other.level = level
        other._in_units(other._units())
        other.joints = self._over_period()
        return other

    def _over_period(self) -> list[JointOverPeriod]:
        pairs = zip(self.rig.joints, self.slices, strict=True)
        own, basis = self.own, self.basis
        return [JointOverPeriod(j.law, basis, float(own[at.start]), loaded=bool(j.loaded_by)) for j, at in pairs]

    def _mobile(self) -> Array:
        """How much each port yields at rest, (m,) [m/N]; a rigid body as if it were on a soft spring."""
        s = self.structure
        return np.asarray(s.joints**2 @ (1.0 / np.maximum(s.omega_n, self.omega_1) ** 2) + s.flexibility.diagonal())

    def _levers(self) -> Array:
        """Force (or moment) at each port that moves the body as much as a unit excitation does, (m,)."""
        s, mobile = self.structure, self._mobile()
        drive = float(s.excitation**2 @ (1.0 / np.maximum(s.omega_n, self.omega_1) ** 2) + s.drive_by_force)
        return np.sqrt(drive / np.where(mobile > 0.0, mobile, drive))

    def _lendable(self) -> Array:
        """Compliance (m,) that a set-valued law needs, or is all but rigid to solve for: more is blunter.

        A tenth of what the body yields at the first harmonic left out.
        """
        s = self.structure
        return np.asarray(0.1 * s.joints**2 @ (1.0 / (s.omega_n**2 + (self.basis.H * self.omega_1) ** 2)))

    def _own_compliances(self) -> Array:
        """Compliance (m,) that a law takes into account at its port, in place of the harmonics.

        A set-valued law of a port that yields less than it needs is lent it, which the balance takes back harmonic by
        harmonic (dynamic Lagrangian frequency-time).
        """
        own = np.zeros(len(self.lent))
        for j, at in zip(self.rig.joints, self.slices, strict=True):
            if j.law.folds:
                least = self.lent[at.start] if j.law.set_valued else 0.0
                own[at.start] = max(self.structure.flexibility[at.start, at.start], least)
        return own

    def _adrift(self) -> Array:
        """Stiffness against the mean of rigid motions that no joint brings back, so that they have one, (rigid, rigid).

        What slides both ways does not know where it is. Where it sticks it does: there the stiffness is weak beside it.
        """
        if not self.rigid.size:
            return np.zeros((0, 0))
        sees, places = self.structure.joints[:, self.rigid], self.rig.moved_places[:, self.rigid]
        laws = [j.law for j in self.rig.joints]
        returns = np.array([port >= law.drifting for law in laws for port in range(law.ports)], dtype=bool)
        unseen, sliding = _unseen(sees, places), _unseen(sees[returns], places[returns])
        return np.asarray(self.omega_1**2 * (unseen + CENTRING * sliding))

    @property
    def touching(self) -> tuple[int, ...]:
        """Shape of the coefficients of the forces at the ports, (2H+1, m)."""
        return self.basis.size, len(self.own)

    @property
    def remembers(self) -> bool:
        """Whether a joint depends on what was before."""
        return any(j.functions.memory for j in self.joints)

    # ---- mechanics

    def held_adrift(self, state: State) -> Array:
        """Mean force against which rigid motions are kept at rest that nothing else keeps there, (rigid,)."""
        return np.asarray(self.adrift @ state.Q[0, self.rigid])

    def modal_forces(self, f: Array, F: float) -> Array:
        """On the modes, (2H+1, n)."""
        return np.asarray(f @ self.structure.joints + np.outer(F * self.force_shape, self.structure.excitation))

    def signals(self, state: State) -> list[Array]:
        """Signals of each joint: coefficients (2H+1, 2 ports + 1), as in :class:`hbm.aft.joint.JointOverPeriod`."""
        s, basis, F = self.structure, self.basis, state.F * self.force_shape
        moved = state.Q @ s.joints.T + np.outer(F, s.flexibility_to_force)
        u, w = moved + state.T @ self.flexibility, moved + state.T @ self.flexibility_of_rate.T
        k2 = (basis.k * state.Omega)[:, None] ** 2
        loads = -k2 * (state.Q @ s.loads_inertia.T) + state.Omega * basis.derivative(state.Q @ s.loads_damping.T)
        loads += state.T @ s.loads_by_joints.T + np.outer(F, s.loads_by_force)
        return [np.column_stack([u[:, at], w[:, at], loads[:, j]]) for j, at in enumerate(self.slices)]

    def moved_signals(self, state: State, changes: JointedStructure) -> list[Array]:
        """Derivatives (2H+1, 2 ports + 1, p) of the signals of each joint along changes of the modes, a last axis."""
        s, basis, F = changes, self.basis, state.F * self.force_shape
        moved = np.tensordot(state.Q, s.joints, (1, 1)) + np.multiply.outer(F, s.flexibility_to_force)
        ports, rated = range(len(self.own)), np.where(self.folds[:, None, None], 0.0, s.flexibility)
        within = s.flexibility.copy()
        within[ports, ports] -= self.moved_own(s)
        u, w = (moved + np.tensordot(state.T, by_forces, (1, 1)) for by_forces in (within, rated))
        squared, rate = (basis.k * state.Omega)[:, None, None] ** 2, state.Omega * basis.derivative(state.Q)
        loads = np.tensordot(rate, s.loads_damping, (1, 1)) - squared * np.tensordot(state.Q, s.loads_inertia, (1, 1))
        loads += np.tensordot(state.T, s.loads_by_joints, (1, 1)) + np.multiply.outer(F, s.loads_by_force)
        return [np.concatenate([u[:, at], w[:, at], loads[:, j : j + 1]], axis=1) for j, at in enumerate(self.slices)]

    def signals_along(self, state: State, Q: Array, T: Array, force: Array, faster: Array) -> list[Array]:
        """Derivatives (2H+1, 2 ports + 1, p) of the signals of each joint along changes of what moves it, a last axis.

        Parameters
        ----------
        state : State
        Q, T, force : (2H+1, n, p), (2H+1, m, p) and (2H+1, p) arrays
            Changes of modes, joint forces and excitation.
        faster : (p,) array
            Of the frequency [rad/s].
        """
        s, basis, squares = self.structure, self.basis, (self.basis.k**2)[:, None, None]

        def rated(a: Array) -> Array:
            return basis.derivative(a.reshape(len(a), -1)).reshape(a.shape)

        moved = np.einsum("mn,knp->kmp", s.joints, Q) + np.einsum("m,kp->kmp", s.flexibility_to_force, force)
        u, w = (moved + np.einsum("ml,klp->kmp", by, T) for by in (self.flexibility, self.flexibility_of_rate))
        loads = state.Omega * rated(np.einsum("jn,knp->kjp", s.loads_damping, Q))
        loads -= state.Omega**2 * squares * np.einsum("jn,knp->kjp", s.loads_inertia, Q)
        loads += np.einsum("jm,kmp->kjp", s.loads_by_joints, T) + np.einsum("j,kp->kjp", s.loads_by_force, force)
        by_rate = rated(state.Q @ s.loads_damping.T) - 2 * state.Omega * squares[:, 0] * (state.Q @ s.loads_inertia.T)
        loads += np.multiply.outer(by_rate, faster)
        return [np.concatenate([u[:, at], w[:, at], loads[:, j : j + 1]], axis=1) for j, at in enumerate(self.slices)]

    def moved_own(self, changes: JointedStructure) -> Array:
        """Derivatives (m, p) of the compliances that laws take into account, where these are the body's own."""
        diagonal = np.diagonal(changes.flexibility).T  # ports on the first axis
        of_body = (self.own > 0.0) & (self.own == self.structure.flexibility.diagonal())
        return np.where(of_body[:, None], diagonal, 0.0)

    def moved_balance(self, state: State, changes: JointedStructure) -> Array:
        """Derivatives (2H+1, n, p) of the balance of the modes along changes of them, a last axis."""
        s, basis, F = changes, self.basis, state.F * self.force_shape
        moved = state.Q[:, :, None] * (2.0 * self.structure.omega_n[:, None] * s.omega_n)
        moved += np.tensordot(state.Omega * basis.derivative(state.Q), s.damping, (1, 1))
        return np.asarray(moved - np.tensordot(state.T, s.joints, (1, 0)) - np.multiply.outer(F, s.excitation))

    def forces(self, state: State, signals: list[Array] | None = None) -> tuple[Array, Array, float]:
        """Forces at the ports at the samples (N_t, m) [N], memory before the first, closure of the loops.

        Those of the state that was looked at last are known, and so may be the signals.
        """
        signals = self.signals(state) if signals is None else signals
        found = [j.shown(s, state.Omega) for j, s in zip(self.joints, signals, strict=True)]
        memory = np.concatenate([[], *(j.memory for j in self.joints)])
        none = np.zeros((self.basis.N_t, 0))
        return np.hstack([none, *(f for f, _ in found)]), memory, max((closure for _, closure in found), default=0.0)

    def dynamic_stiffness(self, Omega: float) -> Complex:
        """Dynamic stiffness of the modes [1/s2]: (H+1, n) where the damping does not couple them, else (H+1, n, n)."""
        s, k = self.structure, np.arange(self.basis.H + 1) * Omega
        if self.diagonal:
            return np.asarray(s.omega_n**2 - k[:, None] ** 2 + 1j * k[:, None] * s.damping.diagonal())
        stiffness = 1j * k[:, None, None] * s.damping
        at = np.arange(s.n)
        stiffness[:, at, at] += s.omega_n**2 - k[:, None] ** 2
        return np.asarray(stiffness)

    def stiffness_matrix(self, Omega: float) -> Array:
        """Derivative of the modal balance to the coefficients of the modes, (2H+1 n, 2H+1 n) [1/s2]."""
        n, k, stiffness = self.structure.n, np.arange(self.basis.H + 1), self.dynamic_stiffness(Omega)
        full = stiffness[:, :, None] * np.eye(n) if self.diagonal else stiffness
        K = np.zeros((self.basis.size, n, self.basis.size, n))
        sine = k[1:] + self.basis.H
        K[k, :, k], K[sine, :, sine] = full.real, full.real[1:]
        K[k[1:], :, sine], K[sine, :, k[1:]] = full.imag[1:], -full.imag[1:]
        K[0, self.rigid[:, None], 0, self.rigid] += self.adrift
        return K.reshape(self.basis.size * n, -1)

    def modal_balance(self, state: State) -> Array:
        """Inertia, damping and stiffness minus all forces, per mode, (2H+1, n)."""
        s, basis = self.structure, self.basis
        balance = (s.omega_n**2 - (basis.k * state.Omega)[:, None] ** 2) * state.Q
        balance += state.Omega * basis.derivative(state.Q) @ s.damping.T
        balance[0, self.rigid] += self.held_adrift(state)
        return np.asarray(balance - self.modal_forces(state.T, state.F))
