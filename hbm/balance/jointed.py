"""Harmonic balance of a body with joints, as a problem for continuation.

The equations are those of :class:`hbm.balance.jointequations.JointEquations`; Newton's system is reduced to the joint
forces (:class:`hbm.balance.jointednewton.JointNewton`).
"""

import numpy as np

from hbm.balance.jointednewton import JointLinearization, Modes
from hbm.balance.jointequations import JointEquations
from hbm.balance.scaled import State
from hbm.fourier import Array


class JointBalance(JointEquations):
    """The balance of a rig with joints as a :class:`continuation.Problem`."""

    def padded(self, state: State) -> Array:
        """Scaled unknowns of a state on other harmonics, modes and joints.

        New modes start from their linear response, new joints (which come last) from the motion there.
        """
        n, m = self.structure.n, min(self.structure.n, state.Q.shape[1])
        Q, f, known = np.zeros((self.basis.size, n)), np.zeros(self.touching), min(state.T.shape[1], len(self.own))
        f[:, :known] = self.on_these_harmonics(state.T[:, :known])
        Q[:, :m] = self.on_these_harmonics(state.Q[:, :m])
        if n > m:
            Q[:, m:] = Modes(self, state.Omega).moved(self.modal_forces(f, state.F))[:, m:]
        padded = State(Q, f, state.Omega, state.F)
        if known < len(self.own):
            f[:, known:] = (self.basis.analysis @ self.forces(padded)[0])[:, known:]
        return self.pack(padded)[0]

    def residual(self, x: Array, lam: float) -> Array:
        """Scaled balance of every mode and harmonic, then of the joints, (size,)."""
        return self.linearize(x, lam).residual

    def linearize(self, x: Array, lam: float) -> JointLinearization:
        """Residual with its linearisation, which is worked out when first solved with."""
        state = self.unpack(x, lam)
        signals = self.signals(state)
        none = np.zeros((self.basis.N_t, 0))
        f = np.hstack([none, *(j.forces(s, state.Omega)[0] for j, s in zip(self.joints, signals, strict=True))])
        joints = state.T - self.basis.analysis @ f
        residual = np.concatenate(
            [(self.modal_balance(state) / self.modal_force_ref).ravel(), (joints / self.f_ref).ravel()]
        )
        return JointLinearization(self, state, signals, residual)
