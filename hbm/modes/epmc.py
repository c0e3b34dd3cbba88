"""Periodic motions at a given amplitude of the drive, kept up by a force or by damping taken away.

Both are the balance of :mod:`hbm.balance.problem` with two more unknowns and two more equations. Unknown are the
frequency and what keeps the motion up; given are the two fundamental coefficients of the drive displacement, 0 and A:
its cosine vanishes, so that it lags a cosine by 90 degrees.

- :class:`FreeMotion`: no force acts, and so much mass-proportional damping xi is taken away that the motion is periodic
  (extended periodic motion). In the balance and in the reaction q'' becomes q'' - xi q', which is what a motion whose
  amplitude falls as exp(-xi t / 2) has, to first order in xi / Omega.
- :class:`ForcedMotion`: the rig as it is, under the force that keeps it at phase resonance.

The continuation parameter is log10 A. Motion, friction and force are unknowns per amplitude, so that a point where the
contact sticks and one where it slides differ by numbers of one size.

References
----------
M. Krack, Nonlinear modal analysis of nonconservative systems: extension of the periodic motion concept, Computers and
Structures 154 (2015); M. Krack and J. Gross, Harmonic Balance for Nonlinear Vibration Problems, Springer 2019, ch. 4.2.
"""

from abc import ABC, abstractmethod
from copy import copy
from dataclasses import replace
from functools import cached_property

import numpy as np

from continuation import DenseLinearization
from hbm.balance.problem import HarmonicBalance, Linearization, State
from hbm.fourier import Array, FourierBasis
from models.rig import Rig


class SustainedBalance(HarmonicBalance):
    """A rig at a frequency, under a force and with some of its damping taken away.

    Attributes
    ----------
    force : float
        Excitation amplitude [N].
    relief : float
        Mass-proportional damping taken away, xi [1/s].
    """

    def __init__(self, rig: Rig, basis: FourierBasis) -> None:
        super().__init__(rig, basis, level=1.0)  # unknowns are per amplitude: the unit of force does not matter
        self.force = self.relief = 0.0

    def sustained(self, *, force: float = 0.0, relief: float = 0.0) -> "SustainedBalance":
        """The same rig with another force and relief; it shares the buffers of its law."""
        other, s = copy(self), self.rig.structure
        reaction = replace(s.reaction, damping=s.reaction.damping - relief * s.reaction.inertia)
        other.structure = replace(s, damping=s.damping - relief, reaction=reaction)
        other.rows = self.rows.copy()
        other.rows[:, 2] = reaction.damping
        other.force, other.relief = force, relief
        return other

    def at(self, lam: float) -> tuple[float, float]:
        """Frequency [rad/s] and force amplitude [N] at a scaled frequency."""
        return lam * self.Omega_ref, self.force

    @property
    def drive_ref(self) -> float:
        """Unit of the drive displacement [m]."""
        return self.q_ref * float(np.abs(self.structure.excitation).max())


class DriveAmplitude(ABC):
    """Motions of a rig at given amplitudes of its drive; a :class:`continuation.Problem`.

    Unknowns are the scaled coefficients of modes and friction per amplitude, the scaled frequency, and what sustains
    the motion; the parameter is log10 of the amplitude in metres.

    Parameters
    ----------
    rig : Rig
    basis : FourierBasis
    """

    def __init__(self, rig: Rig, basis: FourierBasis) -> None:
        self.balance = SustainedBalance(rig, basis)
        self.fundamental = [basis.fundamental, basis.H + basis.fundamental]
        self._rows = self._drive_by_unknowns()

    @property
    def rig(self) -> Rig:
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
    def sustained(self, sustain: float, scale: float) -> SustainedBalance:
        """The balance at a value of the last unknown and an amplitude in units of that of the balance."""

    @abstractmethod
    def by_sustain(self, here: Linearization, scale: float) -> Array:
        """Derivative of the scaled balances to the last unknown, (size - 2,), clamp excluded."""

    @abstractmethod
    def pack_sustain(self, sustain: float, scale: float) -> float:
        """Last unknown, of a relief [1/s] or force [N]."""

    def scale(self, lam: float) -> float:
        """Amplitude in units of that of the balance."""
        return float(10.0**lam) / self.balance.drive_ref

    def pack(self, state: State, sustain: float, lam: float) -> Array:
        """Unknowns of a state, and of a relief [1/s] or force [N]."""
        scale = self.scale(lam)
        y, Omega = self.balance.pack(state)
        return np.concatenate([y / scale, [Omega, self.pack_sustain(sustain, scale)]])

    def unpack(self, x: Array, lam: float) -> tuple[SustainedBalance, Array, float]:
        """The balance of a motion, with its scaled unknowns and frequency there."""
        scale = self.scale(lam)
        return self.sustained(float(x[-1]), scale), scale * x[:-2], float(x[-2])

    def residual(self, x: Array, lam: float) -> Array:
        """Scaled balances per amplitude, then the two conditions on the drive, (size,)."""
        return self.linearize(x, lam).residual

    def linearize(self, x: Array, lam: float) -> "DriveLinearization":
        """Residual with its linearisation, which is worked out when first solved with."""
        balance, y, Omega = self.unpack(x, lam)
        return DriveLinearization(self, x, self.scale(lam), balance.linearize(y, Omega))

    def drive(self, here: Linearization) -> Array:
        """Fundamental coefficients of the drive displacement [m], (2,)."""
        balance, state, s = self.balance, here.state, self.balance.structure
        series = state.Q @ s.excitation + s.residual.slip_by_force * state.T
        series += s.residual.drive_by_force * state.F * balance.force_shape
        if balance.clamp is not None and here.kin.clamp is not None:
            series += balance.clamp.port.residual[1] * here.kin.clamp.slid
        if balance.elements is not None and here.kin.elements is not None:
            series += here.kin.elements @ balance.elements.static[:, 0]
        return np.asarray(series[self.fundamental])

    def _drive_by_unknowns(self) -> Array:
        """Derivative of the drive to the scaled unknowns with the clamp held, (2, size - 2)."""
        balance, s = self.balance, self.balance.structure
        rows = np.zeros((2, balance.size))
        split = balance.basis.size * s.n
        for row, i in zip(rows, self.fundamental, strict=True):
            row[i * s.n : (i + 1) * s.n] = s.excitation * balance.q_ref
            row[split + i] = s.residual.slip_by_force * balance.F_ref
        return rows

    def jacobian(self, here: Linearization, scale: float) -> Array:
        """Derivative of the residual to the unknowns, (size, size)."""
        balance, N = self.balance, self.balance.size
        J = np.zeros((N + 2, N + 2))
        J[:N, :N] = here.complete
        J[:N, N] = here.problem.by_parameter(here.state, here.contact, here.slope) / scale
        J[:N, N + 1] = self.by_sustain(here, scale)
        J[N:, :N] = self._rows
        force = balance.F_ref * balance.force_shape if self.grows else np.zeros(balance.basis.size)
        J[N:, N + 1] = balance.structure.residual.drive_by_force * force[self.fundamental]
        if balance.elements is not None and here.slope is not None:
            lifting, unknowns = balance.elements.static[:, 0], balance.basis.size * balance.structure.n
            by_modes = np.einsum("krx,r->kx", here.slope.by_modes(), lifting) * balance.q_ref
            J[N:, :unknowns] += by_modes[self.fundamental]
            J[N:, N + 1] += (here.slope.by_excitation(force) @ lifting)[self.fundamental]
        slipping = here.rotation
        if slipping is not None and balance.clamp is not None:
            port = balance.clamp.port
            by_force = slipping.slid @ (port.residual[1] * force)
            J[:N, N + 1] -= slipping.by_slid @ by_force
            J[N:, :N] += port.residual[1] * slipping.slid_by_unknowns[self.fundamental]
            J[N:, N + 1] += port.residual[1] * by_force[self.fundamental]
        J[N:] /= balance.drive_ref
        return J


class DriveLinearization:
    """Residual of a motion, and its derivative when asked for; a :class:`continuation.Linearization`."""

    def __init__(self, problem: DriveAmplitude, x: Array, scale: float, here: Linearization) -> None:
        self.problem, self.x, self.scale, self.here = problem, x, scale, here
        self._drive = problem.drive(here) / (scale * problem.balance.drive_ref)
        self.residual = np.concatenate([here.residual / scale, self._drive - [0.0, 1.0]])

    @cached_property
    def _dense(self) -> DenseLinearization:
        J = self.problem.jacobian(self.here, self.scale)
        grown = self.x.copy()
        grown[-2] = 0.0
        grown[-1] *= self.problem.grows
        by_lam = np.log(10.0) * (J @ grown - np.concatenate([self.here.residual / self.scale, self._drive]))
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

    def sustained(self, sustain: float, scale: float) -> SustainedBalance:
        """The balance at a scaled relief."""
        return self.balance.sustained(relief=sustain * self.balance.Omega_ref)

    def pack_sustain(self, sustain: float, scale: float) -> float:
        """Scaled relief."""
        return sustain / self.balance.Omega_ref

    def by_sustain(self, here: Linearization, scale: float) -> Array:
        """Derivative of the scaled balances to the scaled relief."""
        balance, state, by_rho = self.balance, here.state, here.contact.by_rho
        velocity = state.Omega * balance.basis.derivative(state.Q)
        contact = np.zeros(balance.basis.size)
        if by_rho is not None:
            contact += by_rho @ (velocity @ balance.structure.reaction.inertia)
        scaled = [-velocity.ravel() / balance.modal_force_ref, contact / balance.F_ref]
        return np.concatenate(scaled) * balance.Omega_ref / scale


class ForcedMotion(DriveAmplitude):
    """Motions under the force that the drive displacement lags by 90 degrees."""

    grows = True

    def sustained(self, sustain: float, scale: float) -> SustainedBalance:
        """The balance at a scaled force per amplitude."""
        return self.balance.sustained(force=sustain * scale * self.balance.F_ref)

    def pack_sustain(self, sustain: float, scale: float) -> float:
        """Scaled force per amplitude."""
        return sustain / (scale * self.balance.F_ref)

    def by_sustain(self, here: Linearization, scale: float) -> Array:
        """Derivative of the scaled balances to the scaled force per amplitude."""
        balance, s, contact = self.balance, self.balance.structure, here.contact
        shape, law = balance.force_shape, np.zeros(balance.basis.size)
        if contact.by_u is not None:
            law -= s.residual.slip_by_force * contact.by_u @ shape
        if contact.by_rho is not None:
            law += s.reaction.force_share * contact.by_rho @ shape
        modal = -np.outer(shape, s.excitation)
        if balance.elements is not None and here.slope is not None:
            pushed = here.slope.by_excitation(shape)
            modal -= pushed @ balance.elements.rows
            if contact.by_rho is not None:
                law += contact.by_rho @ (pushed @ balance.elements.onto[:, -1])
        return np.concatenate([modal.ravel() / balance.modal_force_ref, law / balance.F_ref]) * balance.F_ref
