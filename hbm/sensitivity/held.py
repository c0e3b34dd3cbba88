"""Changes of a balance with a number of its rig, the unknowns held."""

import numpy as np

from hbm.aft.force import InputChange
from hbm.balance.problem import Linearization
from hbm.fourier import Array
from hbm.sensitivity.elementchange import HeldElements, element_change
from models.change import clamp_change, structure_change, tone_scalars
from models.reduction import StructureChange
from models.scalars import FORCE, HZ, LIMIT, LOAD, law_keys


class HeldBalance:
    """Derivatives to p parameters with the unknowns Q and T held.

    Attributes
    ----------
    structure : StructureChange
    hz : (p,) array
        1 where the parameter is the frequency, else 0.
    force : (2H+1, p) array
        Change of the excitation.
    gain, delay : dict of str to (p,) array
        The same, of each response channel.
    modal : (2H+1, n, p) array
        Change of the modal balance.
    inputs : InputChange
        Change of what the law is shown.
    slid : (2H+1, p) array
        Change of the rotation slid in the clamp.
    """

    def __init__(self, here: Linearization, keys: tuple[str, ...]) -> None:
        self.problem, self.state = here.problem, here.state
        self.keys, self.structure = keys, structure_change(here.problem.rig, keys)
        self.load, self.hz = (np.array([float(key == name) for key in keys]) for name in (LOAD, HZ))
        self.force = self._force()
        sensors = here.problem.rig.response_channels
        self.gain, self.delay = (
            {c.name: np.array([float(key == f"channels.{c.name}.{what}") for key in keys]) for c in sensors}
            for what in ("gain", "delay")
        )
        law = np.array([[key == name for key in keys] for name in law_keys(here.problem.rig)], dtype=float)
        self.elements = self._elements(here.kin.elements)
        self.motion, self.clamp = here.kin.clamp, clamp_change(here.problem.rig, keys)
        self.slid = self._slid()
        compliance = self.structure.flexibility[:, 0, 0]
        law = np.vstack([law.reshape(-1, len(keys)), self.load])
        self.inputs = InputChange(self._signals(), 2 * np.pi * self.hz, law, compliance)
        self.modal = self._modal(here.by_T)

    def _force(self) -> Array:
        """Change of the excitation, (2H+1, p)."""
        problem, tones = self.problem, list(tone_scalars(self.problem.rig.excitation))
        force = np.outer(problem.force_shape, [float(key == FORCE) for key in self.keys])
        for j, key in enumerate(self.keys):
            if key in tones:
                i, sine = divmod(tones.index(key), 2)
                k = problem.rig.excitation.harmonics[i][0]
                if k <= problem.basis.H:
                    force[k + sine * problem.basis.H, j] = self.state.F
        return force

    def _elements(self, forces: Array | None) -> HeldElements | None:
        """Change of the forces of the elements, given along their rows (2H+1, r)."""
        problem, state = self.problem, self.state
        if problem.elements is None or forces is None:
            return None
        moved = element_change(problem.rig, self.keys, self.force)
        change = problem.elements.along(state.Q, state.Omega, state.F * problem.force_shape, moved)
        return HeldElements(problem.elements, forces, change, moved.rows)

    def _slid(self) -> Array:
        """Change of the rotation slid in the clamp, (2H+1, p)."""
        problem, state, d = self.problem, self.state, self.clamp
        if problem.clamp is None or self.motion is None or d is None:
            return np.zeros((problem.basis.size, len(self.keys)))
        limit = np.array([float(key == LIMIT) for key in self.keys])
        change = problem.clamp.change(d, limit, self.force, state.Q, state.T, state.F * problem.force_shape)
        return problem.clamp.along(self.motion, state.Omega, change)

    def by_slid(self, place: int, slid: Array) -> Array:
        """Change of slip, drive, a channel or the reaction by what is slid beyond the modes, `slid` (2H+1, p)."""
        problem, d = self.problem, self.clamp
        if problem.clamp is None or self.motion is None or d is None:
            return np.zeros_like(slid)
        return np.asarray(problem.clamp.port.residual[place] * slid + np.outer(self.motion.slid, d.residual[:, place]))

    def through(self, rows: Array) -> Array:
        """Coefficients (2H+1, p) of the modes seen through rows (p, n)."""
        return np.asarray(self.state.Q @ rows.T)

    def static(self, flexibility: Array, friction: Array) -> Array:
        """Motion by flexibilities (p, 2) under friction (2H+1,) and excitation, (2H+1, p)."""
        moved = np.outer(friction, flexibility[:, 0])
        moved += np.outer(self.state.F * self.problem.force_shape, flexibility[:, 1])
        return moved

    def _signals(self) -> Array:
        """Change of u, rho, eta, (2H+1, 3, p)."""
        problem, d, Q = self.problem, self.structure, self.state.Q
        s, basis, Omega = problem.structure, problem.basis, self.state.Omega
        u = self.through(d.rows[:, 0]) + self.static(d.flexibility[:, 0] * [0.0, 1.0], self.state.T)
        u += s.residual.slip_by_force * self.force + self.by_slid(0, self.slid)
        if problem.coupled:
            fine = basis.exact_products
            q = fine.synthesis @ Q
            u -= 0.5 * fine.analysis @ np.einsum("pti,ti->tp", q @ d.shortening, q)
        rows = np.stack([self.through(row) for row in (d.inertia, d.reaction_damping, d.reaction_stiffness)], axis=1)
        rho = problem.reaction_of(rows, Omega)
        faster = basis.derivative(Q @ s.reaction.damping) - 2 * Omega * basis.k**2 * (Q @ s.reaction.inertia)
        rho += np.outer(faster, 2 * np.pi * self.hz)
        rho[0] += self.load
        rho -= s.reaction.force_share * self.force + np.outer(problem.force_shape, d.force_share * self.state.F)
        rho += self.by_slid(-1, self.slid)
        if self.elements is not None:
            rho -= self.elements.onto_support()
        eta = self.through(d.stretch)
        eta[0] -= d.friction_lever
        return np.stack([u, rho, eta], axis=1)

    def _modal(self, by_T: Array | None) -> Array:
        problem, state, d = self.problem, self.state, self.structure
        s, basis, Q, Omega = problem.structure, problem.basis, state.Q, state.Omega
        velocity, squared = Omega * basis.derivative(Q), (basis.k * Omega)[:, None] ** 2
        forces = d.stiffness @ Q.T + d.damping @ velocity.T - d.mass @ (squared * Q).T  # (p, n, 2H+1)
        modal = np.ascontiguousarray(forces.transpose(2, 1, 0))
        modal -= np.einsum("k,pi->kip", state.T, d.rows[:, 0])
        if by_T is not None:
            modal += (d.shortening @ (by_T @ Q).T).transpose(2, 1, 0)
        modal -= s.excitation[:, None] * self.force[:, None]
        modal -= np.multiply.outer(problem.force_shape, state.F * d.rows[:, 1].T)
        if self.elements is not None:
            modal -= self.elements.onto_modes()
        if problem.clamp is not None and self.motion is not None and self.clamp is not None:
            modal -= np.einsum("k,pi->kip", self.motion.slid, self.clamp.row)
            modal -= np.einsum("kp,i->kip", self.slid, problem.clamp.port.row)
        faster = s.damping * basis.derivative(Q) - 2 * Omega * basis.k[:, None] ** 2 * Q
        return np.asarray(modal + np.multiply.outer(faster, 2 * np.pi * self.hz))


def friction_change(here: Linearization, inputs: InputChange) -> Array:
    """Derivatives of the friction force at the samples, (N_t, p)."""
    problem = here.problem
    return problem.law.along(here.kin.signals, here.state.Omega, problem.environment, inputs)


def law_change(here: Linearization, inputs: InputChange) -> Array:
    """Derivatives of the law's force coefficients, (2H+1, p): through its signals by the slopes of Newton's matrix.

    What is left are its own numbers, the load and the compliance, which are few.
    """
    contact, compliance = here.contact, np.zeros_like(inputs.Omega) if inputs.compliance is None else inputs.compliance
    change = np.outer(contact.by_Omega, inputs.Omega)
    for i, slope in enumerate((contact.by_u, contact.by_rho, contact.by_eta)):
        if slope is not None:
            change += slope @ inputs.signals[:, i]
    still, numbers = still_of(np.vstack([inputs.law, compliance]), here.problem.basis.size)
    if len(numbers):
        change += here.problem.basis.analysis @ friction_change(here, still) @ numbers
    return np.asarray(change)


def still_of(numbers: Array, size: int) -> tuple[InputChange, Array]:
    """Unit changes of what is shown to a law whose contact does not move, and how much (q, p) of each there is.

    Parameters
    ----------
    numbers : (parameters + 2, p) array
        Changes of its parameters, of the static load and of the compliance; those that are none are left out.
    size : int
        Of its coefficients.
    """
    acting = np.flatnonzero(numbers.any(axis=1))
    unit, none = np.eye(len(numbers))[:, acting], np.zeros(len(acting))
    return InputChange(np.zeros((size, 3, len(acting))), none, unit[:-1], unit[-1]), numbers[acting]


def mixed(Q: Array, mixing: Array) -> Array:
    """Coefficients (2H+1, n) of the changed modes, as (2H+1, n, p) of those there are now, per unit of each change."""
    return np.asarray(np.einsum("kj,pij->kip", Q, mixing))


def mixing_of(change: StructureChange, squares: Array) -> Array:
    """Derivatives of the modes kept within each other, (p, n, n): columns are the changed modes in the present ones."""
    apart = squares[:, None] - squares
    np.fill_diagonal(apart, np.inf)
    mixing = (change.mass * squares - change.stiffness) / apart
    own = np.arange(len(squares))
    mixing[:, own, own] = -0.5 * change.mass[:, own, own]
    return np.asarray(mixing)
