"""Harmonic balance of a body with joints: its unknowns, their units and equations.

Unknowns are the modal coefficients Q (2H+1, n) and those of the forces at the ports of all joints f (2H+1, m). The
modes are linear: they are eliminated, harmonic by harmonic, and the dense core is as large as the joint signals.

Scaling is that of :mod:`hbm.balance.equations`: a residual of 1e-10 means that every balance closes to 1e-10 of the
excitation.
"""

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from hbm.aft.joint import JointOverPeriod
from hbm.balance.equations import Parameter, State, force_shape
from hbm.fourier import Array, FourierBasis
from models.jointed import JointedRig, JointedStructure

Complex = npt.NDArray[np.complex128]


class JointEquations:
    """A rig with joints on a Fourier basis with one free parameter: its unknowns and their equations.

    Parameters
    ----------
    rig : JointedRig
    basis : FourierBasis
        Harmonics and samples.
    parameter : {"frequency", "force"}
        Continuation parameter: the frequency in units of `hz_ref`, or F / amplitude.
    hz : float
        Excitation frequency where the parameter is the force [Hz].
    level : float, optional
        Force amplitude where the parameter is the frequency [N]; the rig's where omitted.
    like : JointEquations, optional
        Balance of a similar rig whose units the unknowns and equations take.
    periods : int
        Periods of the force in one of the motion; frequencies are those of the force, Omega that of the motion.
    """

    def __init__(
        self,
        rig: JointedRig,
        basis: FourierBasis,
        *,
        parameter: Parameter = "frequency",
        hz: float = 0.0,
        level: float | None = None,
        like: "JointEquations | None" = None,
        periods: int = 1,
    ) -> None:
        s = rig.structure
        self.rig, self.structure, self.basis, self.parameter = rig, s, basis, parameter
        self.level = rig.excitation.amplitude if level is None else level
        self.fixed_hz, self.periods = hz, periods
        elastic = s.omega_n[s.omega_n > 0.0]
        self._omega_1 = float(elastic[0]) if elastic.size else 2 * np.pi
        if like is None:
            self.hz_ref = 2.0 ** round(float(np.log2(self._omega_1 / (2 * np.pi))))
            self.F_ref = self.level
            self.modal_force_ref = self.level * float(np.abs(s.excitation).max())
            self.q_ref = 10.0 * self.modal_force_ref / self._omega_1**2
            self.f_ref = self.level * self._levers()
        else:
            self.hz_ref, self.F_ref, self.modal_force_ref = like.hz_ref, like.F_ref, like.modal_force_ref
            self.q_ref, self.f_ref = like.q_ref, like.f_ref
        self.Omega_ref = 2 * np.pi * self.hz_ref / periods
        self.lam_ref = self.Omega_ref if parameter == "frequency" else self.F_ref
        self.force_shape = force_shape(rig.excitation, basis, periods)
        self.own = self._own_compliances(like)
        first = np.cumsum([0, *(j.law.ports for j in rig.joints)])
        self.slices = [slice(int(a), int(b)) for a, b in pairwise(first)]
        self.joints = [
            JointOverPeriod(j.law, basis, float(self.own[at.start]), loaded=bool(j.loaded_by))
            for j, at in zip(rig.joints, self.slices, strict=True)
        ]
        self.flexibility = s.flexibility - np.diag(self.own)
        # velocities in limits of friction are those of the modes, docs/theory/equations.md section 3
        folds = np.array([j.law.folds for j in rig.joints for _ in range(j.law.ports)], dtype=bool)
        self.flexibility_of_rate = np.where(folds[:, None], 0.0, s.flexibility)
        self.diagonal = bool(np.count_nonzero(s.damping - np.diag(s.damping.diagonal())) == 0)
        self.rigid = np.flatnonzero(s.omega_n == 0.0)
        self.adrift = self._adrift()

    # ---- set-up

    def _mobile(self) -> Array:
        """How much each port yields at rest, (m,) [m/N]; a rigid body as if it were on a soft spring."""
        s = self.structure
        return np.asarray(s.joints**2 @ (1.0 / np.maximum(s.omega_n, self._omega_1) ** 2) + s.flexibility.diagonal())

    def _levers(self) -> Array:
        """Force (or moment) at each port that moves the body as much as a unit excitation does, (m,)."""
        s, mobile = self.structure, self._mobile()
        drive = float(s.excitation**2 @ (1.0 / np.maximum(s.omega_n, self._omega_1) ** 2) + s.drive_by_force)
        return np.sqrt(drive / np.where(mobile > 0.0, mobile, drive))

    def _own_compliances(self, like: "JointEquations | None") -> Array:
        """Compliance (m,) that a law takes into account at its port, in place of the harmonics.

        A set-valued law of a port that has none is lent one, which the balance takes back harmonic by harmonic (dynamic
        Lagrangian frequency-time): a tenth of what the body yields at the first harmonic left out.
        """
        s, own = self.structure, np.zeros(self.structure.flexibility.shape[0])
        at = 0
        for j in self.rig.joints:
            if j.law.folds:
                own[at] = s.flexibility[at, at]
                if j.law.set_valued and own[at] <= 0.0:
                    first_out = s.omega_n**2 + (self.basis.H * self._omega_1) ** 2
                    own[at] = 0.1 * float(np.sum(s.joints[at] ** 2 / first_out))
                    own[at] = like.own[at] if like is not None else own[at]
            at += j.law.ports
        return own

    def _adrift(self) -> Array:
        """Stiffness against the mean of rigid motions that no joint sees, so that they have one, (rigid, rigid)."""
        _, sizes, directions = np.linalg.svd(self.structure.joints[:, self.rigid])
        seen = directions[: np.count_nonzero(sizes > 1e-9 * sizes.max(initial=0.0))]
        return np.asarray(self._omega_1**2 * (np.eye(len(self.rigid)) - seen.T @ seen))

    # ---- vectors

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.basis.size * (self.structure.n + len(self.own))

    def pack(self, state: State) -> tuple[Array, float]:
        """Scaled unknowns and continuation parameter of a state."""
        x = np.concatenate([(state.Q / self.q_ref).ravel(), (state.T / self.f_ref).ravel()])
        return x, state.Omega / self.Omega_ref if self.parameter == "frequency" else state.F / self.F_ref

    def unpack(self, x: Array, lam: float) -> State:
        """State in physical units of scaled unknowns."""
        split = self.basis.size * self.structure.n
        Q = x[:split].reshape(self.basis.size, -1) * self.q_ref
        Omega, F = self.at(lam)
        return State(Q, x[split:].reshape(self.basis.size, -1) * self.f_ref, Omega, F)

    def at(self, lam: float) -> tuple[float, float]:
        """Frequency [rad/s] and force amplitude [N] at a value of the continuation parameter."""
        if self.parameter == "frequency":
            return lam * self.Omega_ref, self.level
        return 2 * np.pi * self.fixed_hz / self.periods, lam * self.F_ref

    def hz_at(self, lam: float) -> float:
        """Frequency [Hz] at a value of the continuation parameter."""
        return lam * self.hz_ref if self.parameter == "frequency" else self.fixed_hz

    def lam_at(self, hz: float) -> float:
        """Value of the continuation parameter at a frequency [Hz], where the frequency is the parameter."""
        return hz / self.hz_ref

    @property
    def remembers(self) -> bool:
        """Whether a joint depends on what was before."""
        return any(j.functions.memory for j in self.joints)

    # ---- mechanics

    def modal_forces(self, f: Array, F: float) -> Array:
        """On the modes, (2H+1, n)."""
        return np.asarray(f @ self.structure.joints + np.outer(F * self.force_shape, self.structure.excitation))

    def signals(self, state: State, change: JointedStructure | None = None) -> list[Array]:
        """Signals of each joint: coefficients (2H+1, 2 ports + 1), as in :class:`hbm.aft.joint.JointOverPeriod`.

        With a change of the structure's modes, what that changes of them: they are linear in it.
        """
        s, basis, F = self.structure if change is None else change, self.basis, state.F * self.force_shape
        u = w = state.Q @ s.joints.T + np.outer(F, s.flexibility_to_force)
        if change is None:
            u, w = u + state.T @ self.flexibility, w + state.T @ self.flexibility_of_rate.T
        k2 = (basis.k * state.Omega)[:, None] ** 2
        loads = -k2 * (state.Q @ s.loads_inertia.T) + state.Omega * basis.derivative(state.Q @ s.loads_damping.T)
        loads += state.T @ s.loads_by_joints.T + np.outer(F, s.loads_by_force)
        return [np.column_stack([u[:, at], w[:, at], loads[:, j]]) for j, at in enumerate(self.slices)]

    def forces(self, state: State) -> tuple[Array, Array, float]:
        """Forces at the ports at the samples (N_t, m) [N], memory before the first, closure of the loops."""
        found = [j.forces(s, state.Omega) for j, s in zip(self.joints, self.signals(state), strict=True)]
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
        balance[0, self.rigid] += self.adrift @ state.Q[0, self.rigid]
        return np.asarray(balance - self.modal_forces(state.T, state.F))
