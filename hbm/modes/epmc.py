"""Periodic motions at a given amplitude of the drive, kept up by a force or by damping taken away.

Both are the balance of :mod:`hbm.balance.problem` with two more unknowns and two more equations. Unknown are the
frequency and what keeps the motion up; given are the two fundamental coefficients of the drive displacement, 0 and A:
its cosine vanishes, so that it lags a cosine by 90 degrees.

- :class:`FreeMotion`: no force acts, and so much mass-proportional damping xi is taken away that the motion is periodic
  (extended periodic motion). In the balance and in the reaction q'' becomes q'' - xi q', which is what a motion whose
  amplitude falls as exp(-xi t / 2) has, to first order in xi / Omega.
- :class:`ForcedMotion`: the rig as it is, under the force that keeps it at phase resonance.

The continuation parameter is log10 A. Motion about rest, friction and force are unknowns per amplitude, so that a point
where the contact sticks and one where it slides differ by numbers of one size.

References
----------
M. Krack, Nonlinear modal analysis of nonconservative systems: extension of the periodic motion concept, Computers and
Structures 154 (2015); M. Krack and J. Gross, Harmonic Balance for Nonlinear Vibration Problems, Springer 2019, ch. 4.2.
"""

from abc import ABC, abstractmethod
from functools import cached_property

import numpy as np

from continuation import DenseLinearization
from hbm.balance.rest import at_rest
from hbm.balance.scaled import State
from hbm.fourier import Array, FourierBasis
from hbm.modes.sustained import Motion, Sustained, sustained_balance
from models.jointed import AnyRig


class DriveAmplitude(ABC):
    """Motions of a rig at given amplitudes of its drive; a :class:`continuation.Problem`.

    Unknowns are the scaled coefficients of modes and friction, less those at rest, per amplitude, the scaled frequency,
    and what sustains the motion; the parameter is log10 of the amplitude in metres.

    Parameters
    ----------
    rig : Rig or JointedRig
    basis : FourierBasis
    """

    def __init__(self, rig: AnyRig, basis: FourierBasis) -> None:
        self.balance = sustained_balance(rig, basis)
        self.fundamental = [basis.fundamental, basis.H + basis.fundamental]
        rest, resting = at_rest(rig), np.zeros((basis.size, 1))
        resting[0] = 1.0
        T = (resting @ rest.T).reshape(basis.size, *self.balance.touching[1:])
        self.rest = self.balance.pack(State(resting @ rest.Q, T, 0.0, 0.0))[0]

    @property
    def rig(self) -> AnyRig:
        """Rig that vibrates."""
        return self.balance.rig

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.balance.size + 2

    @property
    @abstractmethod
    def grows(self) -> bool:
        """Whether what sustains the motion is an unknown per amplitude."""

    @abstractmethod
    def sustained(self, sustain: float, scale: float) -> Sustained:
        """The balance at a value of the last unknown and an amplitude in units of that of the balance."""

    @abstractmethod
    def pack_sustain(self, sustain: float, scale: float) -> float:
        """Last unknown, of a relief [1/s] or force [N]."""

    @property
    def drive_ref(self) -> float:
        """Unit of the drive displacement [m]."""
        return self.balance.q_ref * float(np.abs(self.balance.structure.excitation).max())

    def scale(self, lam: float) -> float:
        """Amplitude in units of that of the balance."""
        return float(10.0**lam) / self.drive_ref

    def pack(self, state: State, sustain: float, lam: float) -> Array:
        """Unknowns of a state, and of a relief [1/s] or force [N]."""
        scale = self.scale(lam)
        y, Omega = self.balance.pack(state)
        return np.concatenate([(y - self.rest) / scale, [Omega, self.pack_sustain(sustain, scale)]])

    def unpack(self, x: Array, lam: float) -> tuple[Sustained, Array, float]:
        """The balance of a motion, with its scaled unknowns and frequency there."""
        scale = self.scale(lam)
        return self.sustained(float(x[-1]), scale), self.rest + scale * x[:-2], float(x[-2])

    def residual(self, x: Array, lam: float) -> Array:
        """Scaled balances per amplitude, then the two conditions on the drive, (size,)."""
        return self.linearize(x, lam).residual

    def linearize(self, x: Array, lam: float) -> "DriveLinearization":
        """Residual with its linearisation, which is worked out when first solved with."""
        balance, y, Omega = self.unpack(x, lam)
        return DriveLinearization(self, x, self.scale(lam), balance.motion(y, Omega))

    def drive(self, motion: Motion) -> Array:
        """Fundamental coefficients of the drive displacement [m], (2,)."""
        return np.asarray(motion.drive[self.fundamental])

    def jacobian(self, motion: Motion, scale: float) -> Array:
        """Derivative of the residual to the unknowns, (size, size)."""
        N = self.balance.size
        J = np.zeros((N + 2, N + 2))
        J[:N, :N] = motion.by_unknowns
        J[:N, N] = motion.by_frequency / scale
        J[:N, N + 1] = motion.by_force if self.grows else motion.by_relief / scale
        J[N:, :N] = motion.drive_by_unknowns[self.fundamental]
        J[N:, N + 1] = motion.drive_by_force[self.fundamental] if self.grows else 0.0
        J[N:] /= self.drive_ref
        return J


class DriveLinearization:
    """Residual of a motion, and its derivative when asked for; a :class:`continuation.Linearization`."""

    def __init__(self, problem: DriveAmplitude, x: Array, scale: float, motion: Motion) -> None:
        self.problem, self.x, self.scale, self.motion = problem, x, scale, motion
        self._drive = problem.drive(motion) / (scale * problem.drive_ref)
        self.residual = np.concatenate([motion.residual / scale, self._drive - [0.0, 1.0]])

    @cached_property
    def _dense(self) -> DenseLinearization:
        J = self.problem.jacobian(self.motion, self.scale)
        grown = self.x.copy()
        grown[-2] = 0.0
        grown[-1] *= self.problem.grows
        by_lam = np.log(10.0) * (J @ grown - np.concatenate([self.motion.residual / self.scale, self._drive]))
        return DenseLinearization(self.residual, J, by_lam)

    def solve_bordered(self, row: Array, row_lam: float, rhs: Array, rhs_row: float) -> tuple[Array, float]:
        """Solve the bordered Newton system, see :class:`continuation.Linearization`."""
        return self._dense.solve_bordered(row, row_lam, rhs, rhs_row)

    def determinant_sign(self, row: Array, row_lam: float) -> int:
        """Sign of the determinant of the bordered matrix."""
        return self._dense.determinant_sign(row, row_lam)


class FreeMotion(DriveAmplitude):
    """Motions without force, kept up by the mass-proportional damping xi taken away."""

    grows = False

    def sustained(self, sustain: float, scale: float) -> Sustained:
        """The balance at a scaled relief."""
        return self.balance.sustained(relief=sustain * self.balance.Omega_ref)

    def pack_sustain(self, sustain: float, scale: float) -> float:
        """Scaled relief."""
        return sustain / self.balance.Omega_ref


class ForcedMotion(DriveAmplitude):
    """Motions under the force that the drive displacement lags by 90 degrees."""

    grows = True

    def sustained(self, sustain: float, scale: float) -> Sustained:
        """The balance at a scaled force per amplitude."""
        return self.balance.sustained(force=sustain * scale * self.balance.F_ref)

    def pack_sustain(self, sustain: float, scale: float) -> float:
        """Scaled force per amplitude."""
        return sustain / (scale * self.balance.F_ref)
