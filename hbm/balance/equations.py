"""The force balance of a rig with one contact on a Fourier basis.

Unknowns are the modal coefficients Q (2H+1, n) and the coefficients of the friction force T (2H+1,).
"""

from copy import copy
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import numpy.typing as npt

from hbm.aft.force import ContactForce, Environment, LawOverPeriod
from hbm.balance.clamp import ClampMotion, ClampOverPeriod
from hbm.balance.denseblock import DenseBlock
from hbm.balance.elements import ElementSlope, ElementsOverPeriod
from hbm.balance.scaled import Scaled, State
from hbm.fourier import Array, Turn
from models.friction import parameters
from models.rig import Rig
from models.structure import ModalStructure

COUPLING = 0.02
"""Foreshortening of a mode stays out of the Newton matrix below this fraction of its least dynamic stiffness."""

MOST_BLOCKS = 8
"""Blocks that are remembered: where an element acts they change with the motion."""


@dataclass(frozen=True)
class Kinematics:
    """Motion and load of the contact in a state.

    Attributes
    ----------
    Gq : (2H+1, n) array
        Coefficients of G q; du/dq = c - G q. Zeros where the structure is not drawn in.
    pull : (2H+1, n) array or None
        Coefficients of T G q, the part of friction that follows the motion; None where the structure is not drawn in.
    signals : (2H+1, 4) array
        Coefficients of u, v, rho, eta (:data:`hbm.aft.force.SIGNALS`).
    elements : (2H+1, r) array or None
        Forces of the nonlinear elements along their rows.
    clamp : ClampMotion or None
        Motion of a clamp that slips.
    """

    Gq: Array
    pull: Array | None
    signals: Array
    elements: Array | None = None
    clamp: ClampMotion | None = None


class Balance(Scaled[Rig]):
    """A rig with one contact on a Fourier basis: its unknowns and their equations."""

    structure: ModalStructure

    def _levers(self) -> float:
        return 1.0

    def _set_up(self, like: Self | None) -> None:
        rig, basis, s = self.rig, self.basis, self.structure
        self.take(s)
        self.elements = ElementsOverPeriod(rig, basis) if rig.acting else None
        self.clamp = self._slipping()
        self.law = LawOverPeriod(rig.contact.law, basis)
        self.environment, self.dynamic_lagrangian = self._environment(rig, like)
        self._blocks: dict[bytes, DenseBlock] = {}
        self.coupling = rig.contact.normal_load * np.diag(s.shortening)
        self.coupled = self._coupled_modes()

    def _slipping(self) -> ClampOverPeriod | None:
        """The clamp; None where it does not slip."""
        port, limit = self.rig.clamp, self.rig.attachments.clamp_limit
        return None if port is None or limit is None else ClampOverPeriod(port, float(limit), self.basis)

    def take(self, structure: ModalStructure) -> None:
        """Set the structure, with what is the same of it in all states."""
        r = structure.reaction
        self.structure, self.varies = structure, r.varies
        self.rows = np.stack([structure.slip_row, r.inertia, r.damping, r.stiffness, r.stretch], axis=1)
        self._stiffness, self._k_squared = structure.omega_n**2, (self.basis.k**2)[:, None]
        self._crossed = self.basis.signed_k[:, None] * structure.damping
        self._turn: tuple[float, Turn | None] = (0.0, None)

    def with_contact_of(self, rig: Rig) -> Self:
        """Return the same balance with the law's parameters and the load of a rig that differs in nothing else."""
        values = np.array([float(v) for v in parameters(rig.contact.law).values()])
        other = copy(self)
        other.rig = rig
        other.environment = replace(self.environment, parameters=values, load=rig.contact.normal_load)
        return other

    def at_level(self, level: float) -> Self:
        """Return the same balance with another force amplitude [N], in its units."""
        other = copy(self)
        other.level, other.law = level, LawOverPeriod(self.rig.contact.law, self.basis)
        other.clamp = self._slipping()
        other._in_units(other._units())
        return other

    def with_load_on_lift(self, load: float) -> Self:
        """Return the same balance with a multiple of the load that holds a tip that lifts off on its support."""
        other = copy(self)
        other.elements = ElementsOverPeriod(self.rig, self.basis, load)
        return other

    def _environment(self, rig: Rig, like: Self | None) -> tuple[Environment, float]:
        """Law inputs; and the compliance lent to a set-valued law of a structure that has none.

        The loan is taken back harmonic by harmonic (dynamic Lagrangian frequency-time): the law is shown
        u - loan T, with T the unknown coefficients, so that at convergence the contact point sticks and slips
        exactly and its motion has the coefficients of u. The answer does not depend on the loan.
        """
        s = self.structure
        values = np.array([float(v) for v in parameters(rig.contact.law).values()])
        lend = rig.contact.law.set_valued and s.compliance == 0.0
        # a tenth of what the structure yields at the first harmonic left out: less is stiffer to solve, more is blunter
        loan = 0.1 * float(np.sum(s.slip_row**2 / (s.omega_n**2 + (self.basis.H * s.omega_n[0]) ** 2))) if lend else 0.0
        loan = like.dynamic_lagrangian if lend and like is not None else loan
        return Environment(s.compliance + loan, rig.contact.normal_load, values), loan

    def _coupled_modes(self) -> int:
        """How many of the lowest modes need their foreshortening in the Newton matrix."""
        s = self.structure
        least_stiffness = np.minimum(s.damping * s.omega_n, s.omega_n**2)
        strong = np.flatnonzero(self.coupling > COUPLING * least_stiffness)
        return int(strong[-1]) + 1 if strong.size else 0

    def dense_block(self, strong: npt.NDArray[np.bool_]) -> DenseBlock:
        """Where the (harmonic, mode) pairs `strong` (H+1, m) stand in the balance; remembered from point to point."""
        key = strong.tobytes()
        if key not in self._blocks:
            if len(self._blocks) == MOST_BLOCKS:
                self._blocks.clear()
            self._blocks[key] = DenseBlock.of(strong, self.structure.shortening, self.basis.size)
        return self._blocks[key]

    @property
    def touching(self) -> tuple[int, ...]:
        """Shape of the coefficients of friction, (2H+1,)."""
        return (self.basis.size,)

    # ---- mechanics

    def kinematics(self, state: State) -> Kinematics:
        """Slip, its velocity, and the two parts of the reaction, from the modes."""
        s, basis, Q, Omega = self.structure, self.basis, state.Q, state.Omega
        rows = Q @ self.rows  # slip, three of the reaction, stretch
        signals = np.empty((basis.size, 4))
        u = signals[:, 0]
        u[:] = rows[:, 0]
        pull: Array | None = None
        if self.coupled:
            Gq = Q @ s.shortening
            shorter, pull = self._drawn_in(Q, Gq, state.T)
            u -= shorter
        else:
            Gq = np.zeros_like(Q)
        if self.dynamic_lagrangian:
            u -= self.dynamic_lagrangian * state.T
        if s.residual.slip_by_force:
            u += s.residual.slip_by_force * state.F * self.force_shape
        clamp = None
        if self.clamp is not None:
            clamp = self.clamp.motion(self.clamp.held(Q, state.T, state.F * self.force_shape), Omega)
            u += self.clamp.port.residual[0] * clamp.slid
        signals[:, 1] = Omega * basis.derivative(u)
        signals[:, 2:] = 0.0
        if self.varies:
            signals[:, 2] = self.reaction_of(rows[:, 1:4], Omega)
            signals[:, 2] -= s.reaction.force_share * state.F * self.force_shape
            signals[:, 3] = rows[:, 4]
            signals[0, 3] -= s.reaction.friction_lever
        signals[0, 2] += self.rig.contact.normal_load
        if self.clamp is not None and clamp is not None:
            signals[:, 2] += self.clamp.port.residual[-1] * clamp.slid
        if self.elements is None:
            return Kinematics(Gq, pull, signals, clamp=clamp)
        forces = self.elements.along_rows(Q, Omega, state.F * self.force_shape)
        signals[:, 2] -= forces @ self.elements.onto[:, -1]
        return Kinematics(Gq, pull, signals, forces, clamp)

    def _drawn_in(self, Q: Array, Gq: Array, T: Array) -> tuple[Array, Array]:
        """By how much the motion shortens the structure, q' G q / 2 (2H+1,), and T G q (2H+1, n)."""
        fine, n = self.basis.exact_products, self.structure.n
        series = np.empty((len(Q), 1 + 2 * n))
        series[:, 0], series[:, 1 : 1 + n], series[:, 1 + n :] = T, Q, Gq
        samples = fine.synthesis @ series
        products, drawn = np.empty((len(samples), 1 + n)), samples[:, 1 + n :]
        np.einsum("ti,ti->t", drawn, samples[:, 1 : 1 + n], out=products[:, 0])
        np.multiply(samples[:, :1], drawn, out=products[:, 1:])
        of_products = fine.analysis @ products
        return 0.5 * of_products[:, 0], of_products[:, 1:]

    def reaction_of(self, rows: Array, Omega: float) -> Array:
        """Coefficients (2H+1, ...) of the reaction's part from the modes.

        Parameters
        ----------
        rows : (2H+1, 3, ...) array
            Coefficients of the inertia, damping and stiffness rows times the modes.
        Omega : float
            [rad/s].
        """
        inertia, damping, stiffness = rows[:, 0], rows[:, 1], rows[:, 2]
        squared = (self.basis.k * Omega) ** 2
        return Omega * self.basis.derivative(damping) - (squared * inertia.T).T + stiffness

    def dynamic_stiffness(self, Omega: float) -> tuple[Array, Array]:
        """Dynamic stiffness per mass-normalised mode, real and imaginary part, (H+1, n) [1/s2]."""
        k = np.arange(self.basis.H + 1)[:, None] * Omega
        return self.structure.omega_n**2 - k**2, k * self.structure.damping

    def dynamic_turn(self, Omega: float) -> Turn:
        """The dynamic stiffness as it acts on the coefficients of the modes [1/s2]."""
        known, turn = self._turn
        if turn is None or known != Omega:
            direct = self._stiffness - Omega**2 * self._k_squared
            turn = Turn(direct, Omega * self._crossed, self.basis.swapped)
            self._turn = Omega, turn
        return turn

    def _modal_balance(self, state: State, kin: Kinematics) -> Array:
        """Inertia, damping and stiffness minus friction, excitation and elements, per mode, (2H+1, n)."""
        s = self.structure
        balance = self.dynamic_turn(state.Omega).of(state.Q)
        balance -= state.T[:, None] * s.slip_row
        if kin.pull is not None:
            balance += kin.pull
        balance -= (state.F * self.force_shape)[:, None] * s.excitation
        if self.elements is not None and kin.elements is not None:
            balance -= kin.elements @ self.elements.rows
        if self.clamp is not None and kin.clamp is not None:
            balance -= np.outer(kin.clamp.slid, self.clamp.port.row)
        return balance

    def slip_by_modes(self, kin: Kinematics) -> Array:
        """Matrices of du/dq = c - G q times a series, (2H+1, 2H+1, n)."""
        slope = -kin.Gq
        slope[0] += self.structure.slip_row
        return self.basis.multiplication(slope)

    def by_parameter(self, state: State, contact: ContactForce, slope: ElementSlope | None) -> Array:
        """Derivative of the scaled balances, clamp excluded, to the scaled continuation parameter, (size,)."""
        s, basis, Q, Omega, shape = self.structure, self.basis, state.Q, state.Omega, self.force_shape
        if self.parameter == "frequency":
            modal = self._crossed * Q[basis.swapped] - (2 * Omega * self._k_squared) * Q
            d_rho = np.zeros(basis.size)
            if self.varies:
                d_rho = basis.derivative(Q @ s.reaction.damping) - 2 * Omega * basis.k**2 * (Q @ s.reaction.inertia)
            law = -contact.by_Omega
            if slope is not None:
                modal -= slope.by_Omega[:, :-1]
                d_rho -= slope.by_Omega[:, -1]
        else:
            modal, d_rho, law = -np.outer(shape, s.excitation), -s.reaction.force_share * shape, np.zeros(basis.size)
            if contact.by_u is not None:
                law = -s.residual.slip_by_force * contact.by_u @ shape
            if self.elements is not None and slope is not None:
                pushed = slope.by_excitation(shape)
                modal -= pushed @ self.elements.rows
                d_rho = d_rho - pushed @ self.elements.onto[:, -1]
        law = law if contact.by_rho is None else law - contact.by_rho @ d_rho
        return np.concatenate([modal.ravel() / self.modal_force_ref, law / self.F_ref]) * self.lam_ref

    def contact_state(self, state: State, kin: Kinematics | None = None) -> tuple[Kinematics, Array, Array, float]:
        """Kinematics, friction force at the samples [N], internal state before the first, and closure of the loops.

        Kinematics that are known and were marched last are not worked out again.
        """
        kin = self.kinematics(state) if kin is None else kin
        T, closure = self.law.shown(kin.signals, state.Omega, self.environment)
        if kin.clamp is not None:
            closure = max(closure, kin.clamp.closure)
        return kin, T.copy(), self.law.memory, closure
