"""Balances of a rig under a force of its own and with some of its damping taken away.

A :class:`SustainedContact` is that of a rig with one contact, a :class:`SustainedJoints` that of one with joints. Both
linearise to a :class:`Motion`, which is all that :mod:`hbm.modes.epmc` knows of either.
"""

from copy import copy
from dataclasses import replace
from typing import Protocol, Self, TypeAlias

import numpy as np

from hbm.balance.jointed import JointBalance
from hbm.balance.jointednewton import JointLinearization
from hbm.balance.problem import HarmonicBalance, Linearization
from hbm.balance.scaled import State
from hbm.fourier import Array, FourierBasis
from models.jointed import AnyRig, JointedRig
from models.jointedstructure import JointedStructure


class Motion(Protocol):
    """A state of a balance, with the derivatives of the scaled balances and of the drive displacement."""

    @property
    def residual(self) -> Array:
        """Scaled balances, (size,)."""
        ...

    @property
    def by_unknowns(self) -> Array:
        """Their derivative to the scaled unknowns, (size, size), with nothing left out."""
        ...

    @property
    def by_frequency(self) -> Array:
        """To the scaled frequency, (size,)."""
        ...

    @property
    def by_relief(self) -> Array:
        """To the damping taken away in units of the frequency's, (size,)."""
        ...

    @property
    def by_force(self) -> Array:
        """To the scaled force, (size,)."""
        ...

    @property
    def drive(self) -> Array:
        """Coefficients of the drive displacement, (2H+1,) [m]."""
        ...

    @property
    def drive_by_unknowns(self) -> Array:
        """Their derivative to the scaled unknowns, (2H+1, size)."""
        ...

    @property
    def drive_by_force(self) -> Array:
        """To the scaled force, (2H+1,)."""
        ...


class UnderForce:
    """A balance at a frequency, under a force and with some of its damping taken away.

    Attributes
    ----------
    force : float
        Excitation amplitude [N].
    relief : float
        Mass-proportional damping taken away, xi [1/s].
    """

    force = relief = 0.0
    Omega_ref: float

    def sustained(self, *, force: float = 0.0, relief: float = 0.0) -> Self:
        """The same rig with another force and relief; it shares the buffers of its laws."""
        other = copy(self)
        other.force, other.relief = force, relief
        other._relieve()
        return other

    def _relieve(self) -> None:
        """Take the damping away."""
        raise NotImplementedError

    def at(self, lam: float) -> tuple[float, float]:
        """Frequency [rad/s] and force amplitude [N] at a scaled frequency."""
        return lam * self.Omega_ref, self.force


class SustainedContact(UnderForce, HarmonicBalance):
    """A rig with one contact."""

    def _relieve(self) -> None:
        s, relief = self.rig.structure, self.relief
        reaction = replace(s.reaction, damping=s.reaction.damping - relief * s.reaction.inertia)
        self.take(replace(s, damping=s.damping - relief, reaction=reaction))

    def motion(self, y: Array, Omega: float) -> "ContactMotion":
        """The state of scaled unknowns at a scaled frequency."""
        return ContactMotion(self.linearize(y, Omega))


class SustainedJoints(UnderForce, JointBalance):
    """A rig with joints."""

    def _relieve(self) -> None:
        s, relief = self.rig.structure, self.relief
        loads = s.loads_damping - relief * s.loads_inertia
        self.structure = replace(s, damping=s.damping - relief * np.eye(s.n), loads_damping=loads)

    def moved_signals(self, state: State, changes: JointedStructure) -> list[Array]:
        """As of a rig under force; the damping taken away counts in changes of what loads a joint too."""
        damping = changes.loads_damping - self.relief * changes.loads_inertia
        return super().moved_signals(state, replace(changes, loads_damping=damping))

    def motion(self, y: Array, Omega: float) -> "JointMotion":
        """The state of scaled unknowns at a scaled frequency."""
        return JointMotion(self.linearize(y, Omega))


Sustained: TypeAlias = SustainedContact | SustainedJoints


def sustained_balance(rig: AnyRig, basis: FourierBasis) -> Sustained:
    """The balance of a rig in units of its own: unknowns are per amplitude, the unit of force does not matter."""
    if isinstance(rig, JointedRig):
        return SustainedJoints(rig, basis, level=1.0)
    return SustainedContact(rig, basis, level=1.0)


class ContactMotion:
    """A :class:`Motion` of a rig with one contact."""

    def __init__(self, here: Linearization) -> None:
        self.here, self.balance, self.residual = here, here.problem, here.residual

    @property
    def by_unknowns(self) -> Array:
        """Derivative of the scaled balances to the scaled unknowns, (size, size)."""
        return self.here.complete

    @property
    def by_frequency(self) -> Array:
        """To the scaled frequency, (size,)."""
        return self.balance.by_parameter(self.here.state, self.here.contact, self.here.slope)

    @property
    def by_relief(self) -> Array:
        """To the damping taken away in units of the frequency's, (size,)."""
        balance, state, by_rho = self.balance, self.here.state, self.here.contact.by_rho
        velocity = state.Omega * balance.basis.derivative(state.Q)
        contact = np.zeros(balance.basis.size)
        if by_rho is not None:
            contact += by_rho @ (velocity @ balance.structure.reaction.inertia)
        scaled = [-velocity.ravel() / balance.modal_force_ref, contact / balance.F_ref]
        return np.concatenate(scaled) * balance.Omega_ref

    @property
    def by_force(self) -> Array:
        """To the scaled force, (size,)."""
        balance, s, contact = self.balance, self.balance.structure, self.here.contact
        shape, law = balance.force_shape, np.zeros(balance.basis.size)
        if contact.by_u is not None:
            law -= s.residual.slip_by_force * contact.by_u @ shape
        if contact.by_rho is not None:
            law += s.reaction.force_share * contact.by_rho @ shape
        modal = -np.outer(shape, s.excitation)
        if balance.elements is not None and self.here.slope is not None:
            pushed = self.here.slope.by_excitation(shape)
            modal -= pushed @ balance.elements.rows
            if contact.by_rho is not None:
                law += contact.by_rho @ (pushed @ balance.elements.onto[:, -1])
        by_force = np.concatenate([modal.ravel() / balance.modal_force_ref, law / balance.F_ref]) * balance.F_ref
        slipping = self.here.rotation
        return by_force if slipping is None else by_force - slipping.by_slid @ self._slid_by_force

    @property
    def drive(self) -> Array:
        """Coefficients of the drive displacement, (2H+1,) [m]."""
        balance, state, kin, s = self.balance, self.here.state, self.here.kin, self.balance.structure
        series = state.Q @ s.excitation + s.residual.slip_by_force * state.T
        series += s.residual.drive_by_force * state.F * balance.force_shape
        if balance.clamp is not None and kin.clamp is not None:
            series += balance.clamp.port.residual[1] * kin.clamp.slid
        if balance.elements is not None and kin.elements is not None:
            series += kin.elements @ balance.elements.static[:, 0]
        return np.asarray(series)

    @property
    def drive_by_unknowns(self) -> Array:
        """Its derivative to the scaled unknowns, (2H+1, size)."""
        balance, s, slipping = self.balance, self.balance.structure, self.here.rotation
        unit, split = np.eye(balance.basis.size), balance.basis.size * s.n
        rows = np.hstack([np.kron(unit, s.excitation * balance.q_ref), unit * s.residual.slip_by_force * balance.F_ref])
        if balance.elements is not None and self.here.slope is not None:
            lifting = balance.elements.static[:, 0]
            rows[:, :split] += np.einsum("krx,r->kx", self.here.slope.by_modes(), lifting) * balance.q_ref
        if slipping is not None and balance.clamp is not None:
            rows += balance.clamp.port.residual[1] * slipping.slid_by_unknowns
        return rows

    @property
    def drive_by_force(self) -> Array:
        """Its derivative to the scaled force, (2H+1,)."""
        balance, force = self.balance, self.balance.F_ref * self.balance.force_shape
        series = balance.structure.residual.drive_by_force * force
        if balance.elements is not None and self.here.slope is not None:
            series = series + self.here.slope.by_excitation(force) @ balance.elements.static[:, 0]
        if balance.clamp is not None:
            series = series + balance.clamp.port.residual[1] * self._slid_by_force
        return np.asarray(series)

    @property
    def _slid_by_force(self) -> Array:
        """Derivative of what is slid in the clamp to the scaled force, the unknowns held, (2H+1,)."""
        balance, slipping = self.balance, self.here.rotation
        assert slipping is not None and balance.clamp is not None
        return np.asarray(slipping.slid @ (balance.clamp.port.residual[1] * balance.F_ref * balance.force_shape))


class JointMotion:
    """A :class:`Motion` of a rig with joints."""

    def __init__(self, here: JointLinearization) -> None:
        self.here, self.balance, self.residual = here, here.problem, here.residual

    @property
    def by_unknowns(self) -> Array:
        """Derivative of the scaled balances to the scaled unknowns, (size, size)."""
        return self.here.complete

    @property
    def by_frequency(self) -> Array:
        """To the scaled frequency, (size,)."""
        return self.here.along("frequency")

    @property
    def by_relief(self) -> Array:
        """To the damping taken away in units of the frequency's, (size,)."""
        balance, state, s = self.balance, self.here.state, self.balance.structure
        velocity = state.Omega * balance.basis.derivative(state.Q)
        law = np.zeros_like(state.T)
        for j, (at, force) in enumerate(zip(balance.slices, self.here.forces, strict=True)):
            law[:, at] = np.tensordot(force.by_signals[..., -1], velocity @ s.loads_inertia[j], axes=1)
        scaled = [-velocity.ravel() / balance.modal_force_ref, (law / balance.f_ref).ravel()]
        return np.concatenate(scaled) * balance.Omega_ref

    @property
    def by_force(self) -> Array:
        """To the scaled force, (size,)."""
        return self.here.along("force")

    @property
    def drive(self) -> Array:
        """Coefficients of the drive displacement, (2H+1,) [m]."""
        s, state = self.balance.structure, self.here.state
        series = state.Q @ s.excitation + state.T @ s.flexibility_to_force
        return np.asarray(series + s.drive_by_force * state.F * self.balance.force_shape)

    @property
    def drive_by_unknowns(self) -> Array:
        """Its derivative to the scaled unknowns, (2H+1, size)."""
        s, unit = self.balance.structure, np.eye(self.balance.basis.size)
        by_joints = s.flexibility_to_force * self.balance.f_ref
        return np.hstack([np.kron(unit, s.excitation * self.balance.q_ref), np.kron(unit, by_joints)])

    @property
    def drive_by_force(self) -> Array:
        """Its derivative to the scaled force, (2H+1,)."""
        return np.asarray(self.balance.structure.drive_by_force * self.balance.F_ref * self.balance.force_shape)
