"""Exact derivatives of a periodic solution to the parameters of its rig.

The balance J [dQ; dT] = -dF/dp of the implicit function theorem is solved with the matrix that Newton's method uses.
An elimination leaves weak foreshortening out of it, so the solution is refined against the complete linearised balance
until nothing changes: the derivatives are those of the discretised equations, to rounding.

Where a sample changes between stick and slip, the discretised balance has a kink and its derivative is one-sided: that
of the side the solution lies on. Between such changes the derivative is exact for the samples given; its jumps fall
with their number (on the paper's beam near resonance, a few per cent with 256 samples).

Held, too, is the compliance lent to a set-valued law of a rigid structure (:class:`hbm.residual.HarmonicBalance`), on
which a solution depends only through the harmonics left out.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from hbm.aft import InputChange
from hbm.clamp import ClampChange
from hbm.elementchange import HeldElements
from hbm.elements import ElementChange, stacked
from hbm.fourier import Array
from hbm.residual import HarmonicBalance, Linearization
from hbm.solution import DERIVATIVES, TRUE, PeriodicSolution, as_read
from hbm.threads import one_thread
from models.change import (
    Scalar,
    clamp_change,
    drift_scalars,
    element_scalars,
    elements_change,
    structure_change,
    structure_scalars,
    tone_scalars,
)
from models.friction import describe, parameters
from models.reduction import StructureChange
from models.rig import Channel, Rig

REFINED = 1e-12
"""Refinement ends when one more would change the derivatives by less than this fraction."""

MOST_REFINEMENTS = 50

UNBALANCED = 1e-6
"""A state that misses the balance by more than this fraction of the excitation is not a solution of the rig."""

FRICTION = "contact.friction."
LIMIT = "attachments.clamp_limit"
LOAD, FORCE, HZ, ALPHA = "contact.normal_load", "excitation.amplitude", "frequency_hz", "damping.mass_proportional"


@dataclass(frozen=True, eq=False)
class ChannelSensitivity:
    """Derivatives of one channel, a column per parameter, in the channel's unit per unit of the parameter.

    Attributes
    ----------
    coefficients : (2H+1, p) array
        Of its Fourier coefficients a_0, a_1..a_H, b_1..b_H.
    samples : (N_t, p) array
        Of its values at the phases of the basis.
    peak : (p,) array
        Of its peak, see :class:`hbm.solution.Signal`: the derivative at the instant of the peak (envelope theorem).
    """

    coefficients: Array
    samples: Array
    peak: Array


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """How a periodic solution changes with the parameters of its rig, everything else held.

    Attributes
    ----------
    solution : PeriodicSolution
        What is differentiated.
    parameters, units : tuple of str, (p,)
        Keys of the rig file.
    values : (p,) array
        Their values; force and frequency are those of the solution.
    Q, T : (2H+1, n, p) and (2H+1, p) arrays
        Derivatives of the unknowns, :class:`hbm.residual.State`; where the structure changes, in the modes it has now.
    channels : dict of str to ChannelSensitivity
        The channels of the solution, each worked out when it is asked for.
    refinements : int
        Corrections of the first back-substitution.
    mixing : (p, n, n) array
        Derivatives of the modes within each other: columns are the changed modes in those there are now.
    disturbed : dict of str to (2H+1, d) array
        What the disturbances beside do, as of :func:`disturbed`.
    """

    solution: PeriodicSolution
    parameters: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    Q: Array
    T: Array
    channels: Mapping[str, ChannelSensitivity]
    refinements: int
    mixing: Array
    disturbed: Mapping[str, Array]

    def __getitem__(self, name: str) -> ChannelSensitivity:
        """Channel by name."""
        return self.channels[name]

    @property
    def own_Q(self) -> Array:
        """Derivatives of Q in the modes that the changed rig has, (2H+1, n, p)."""
        return self.Q - _mixed(self.solution.state.Q, self.mixing)

    def logarithmic(self, channel: str) -> dict[str, float]:
        """Derivative d ln(peak) / d ln(p) of a channel's peak to each parameter: per cent per per cent.

        At the top of a resonance the derivative at the held frequency is also that of the resonance's height
        (envelope theorem): the shift of the resonance does not count, since the curve is level there. How level is
        told by the entry of ``frequency_hz``.
        """
        relative = self.values * self[channel].peak / self.solution[channel].peak
        return dict(zip(self.parameters, relative.tolist(), strict=True))


@one_thread
def sensitivities(
    rig: Rig, solution: PeriodicSolution, keys: Sequence[str] | None = None, beside: "Disturbance | None" = None
) -> Sensitivities:
    """Exact derivatives of a periodic solution to the parameters of its rig.

    Parameters
    ----------
    rig : Rig
        The rig of the solution; its force amplitude may differ.
    solution : PeriodicSolution
        Steady state or point of a curve.
    keys : sequence of str, optional
        What to differentiate to, of :func:`rig_scalars`; where omitted the friction law's parameters, normal load,
        force, frequency and mass-proportional damping.
    beside : Disturbance, optional
        What to solve for along with it, at next to no cost.

    Returns
    -------
    Sensitivities

    Raises
    ------
    ValueError
        If the solution is not one of this rig, or a key not one of its numbers.
    ArithmeticError
        At a fold, where the solution has no derivative at held frequency and force.

    Examples
    --------
    >>> from hbm.response import steady_state
    >>> from models.published import paper_rig
    >>> rig = paper_rig()
    >>> s = sensitivities(rig, steady_state(rig, 51.0, harmonics=5))
    >>> s.parameters[:3]
    ('contact.friction.mu', 'contact.friction.critical_slip', 'contact.normal_load')
    >>> round(s.logarithmic("drive")["contact.friction.mu"], 2)
    -0.46
    """
    problem = HarmonicBalance(rig, solution.basis, level=solution.level)
    here = problem.linearize(*problem.pack(solution.state))
    missed = float(np.abs(here.residual).max())
    if not missed < UNBALANCED:
        raise ValueError(
            f"sensitivities: the state misses the rig's balance by {missed:.2g} of the excitation; "
            "must be a solution of this rig"
        )
    known = rig_scalars(rig, solution)
    keys = (*_law_keys(rig), LOAD, FORCE, HZ, ALPHA) if keys is None else tuple(keys)
    unknown = [key for key in keys if key not in known]
    if unknown or not keys:
        found = f"{unknown[0]} is not a number of the rig" if unknown else "no keys"
        raise ValueError(f"sensitivities: {found}; must be some of {', '.join(known)}")
    held, balance = _Held(here, keys), _LinearBalance(here)
    law = problem.basis.analysis @ _friction(here, held.inputs)
    right = balance.scaled(-held.modal, law)
    also = np.zeros((len(right), 0)) if beside is None else balance.disturbed(beside)
    x, refinements = _refined(here, balance, np.hstack([right, also]))
    d_Q, d_T = balance.unpack(x[:, : len(keys)])
    slid = held.slid + balance.slid(d_Q, d_T)
    signals = held.inputs.signals + balance.signals(d_Q, d_T)
    channels = _Channels(here, solution, held, _Change(d_Q, d_T, signals, slid, balance.by_elements(d_Q)))
    values, units = zip(*(known[key] for key in keys), strict=True)
    mixing = _mixing(held.structure, problem.structure.omega_n**2)
    moved = {} if beside is None else _seen_of(balance, beside, x[:, len(keys) :])
    return Sensitivities(solution, keys, units, np.array(values), d_Q, d_T, channels, refinements, mixing, moved)


def rig_scalars(rig: Rig, solution: PeriodicSolution) -> dict[str, Scalar]:
    """Numbers that a solution depends on, with the keys of the rig file; force and frequency are the solution's.

    Of what drifts from record to record a solution is that of record 1, on which rates have no effect.
    """
    return scalars_at(rig, solution.hz, solution.level)


def scalars_at(rig: Rig, hz: float, level: float) -> dict[str, Scalar]:
    """As :func:`rig_scalars`, at a frequency [Hz] and a force amplitude [N]."""
    law = rig.contact.law
    described = zip(_law_keys(rig), parameters(law).values(), describe(type(law)).values(), strict=True)
    return {key: Scalar(value, p.unit) for key, value, p in described} | {
        LOAD: Scalar(rig.contact.normal_load, "N"),
        FORCE: Scalar(level, "N"),
        HZ: Scalar(hz, "Hz"),
        **structure_scalars(rig),
        **sensor_scalars(rig),
        **element_scalars(rig),
        **tone_scalars(rig),
        **drift_scalars(rig),
    }


def sensor_scalars(rig: Rig) -> dict[str, Scalar]:
    """What channels make of what they measure, with the keys of the rig file."""
    gains = {f"channels.{c.name}.gain": Scalar(c.gain, "1") for c in rig.response_channels}
    return gains | {f"channels.{c.name}.delay": Scalar(c.delay, "s") for c in rig.response_channels}


def _law_keys(rig: Rig) -> list[str]:
    return [FRICTION + name for name in describe(type(rig.contact.law))]


@dataclass(frozen=True)
class _Change:
    """Derivatives of Q (2H+1, n, p), T (2H+1, p), u, rho, eta (2H+1, 3, p), what is slid (2H+1, p).

    And of the forces of the elements that the change of the deflections brings, (2H+1, r, p).
    """

    Q: Array
    T: Array
    signals: Array
    slid: Array
    elements: Array


@dataclass(frozen=True, eq=False)
class Disturbance:
    """What acts on a steady state beside its excitation, p columns of Fourier coefficients a_0, a_1..a_H, b_1..b_H.

    Attributes
    ----------
    modes : (2H+1, n, p) array
        Force on each mode.
    friction : (2H+1, p) array
        Force beside that of the friction law, along +x on the beam [N].
    slip, reaction : (2H+1, p) array
        Change of the modal slip [m] and of the normal reaction [N] with the modes held.
    channels : dict of str to (2H+1, p) array
        Displacement at response channels with the modes held [m]; none at those left out.
    """

    modes: Array
    friction: Array
    slip: Array
    reaction: Array
    channels: Mapping[str, Array]


@one_thread
def disturbed(rig: Rig, solution: PeriodicSolution, disturbance: Disturbance) -> dict[str, Array]:
    """Change of response channels and friction under small disturbances: receptances of the linearised steady state.

    Parameters
    ----------
    rig : Rig
        The rig of the solution.
    solution : PeriodicSolution
    disturbance : Disturbance

    Returns
    -------
    dict of str to (2H+1, p) array
        Coefficients, in each channel's unit per unit of the disturbance; `friction` [N] with what was beside the law.

    Raises
    ------
    ArithmeticError
        At a fold.
    """
    problem = HarmonicBalance(rig, solution.basis, level=solution.level)
    balance = _LinearBalance(problem.linearize(*problem.pack(solution.state)))
    x, _ = _refined(balance.here, balance, balance.disturbed(disturbance))
    return _seen_of(balance, disturbance, x)


def _seen_of(balance: "_LinearBalance", disturbance: Disturbance, x: Array) -> dict[str, Array]:
    """Change of response channels and friction by a disturbance, and by the scaled unknowns (size, p) it moves."""
    problem, (d_Q, d_T) = balance.problem, balance.unpack(x)
    s, basis, Omega = problem.structure, problem.basis, balance.state.Omega
    slid, pushed = balance.slid(d_Q, d_T), balance.by_elements(d_Q)
    out = {"friction": d_T}
    for place, c in enumerate(problem.rig.response_channels, start=2):
        _, by_friction = s.residual.channels.get(c.name, (0.0, 0.0))
        moved = np.einsum("kip,i->kp", d_Q, s.channel_rows[c.name]) + by_friction * d_T
        moved = moved + disturbance.channels.get(c.name, 0.0)
        if problem.clamp is not None:
            moved += problem.clamp.port.residual[place] * slid
        if problem.elements is not None:
            moved += np.einsum("krp,r->kp", pushed, problem.elements.static[:, place - 1])
        for _ in range(DERIVATIVES[c.quantity]):
            moved = Omega * basis.derivative(moved)
        out[c.name] = as_read(basis, moved, Omega, c)
    return out


def balance_change(here: Linearization, keys: Sequence[str]) -> Array:
    """Exact derivatives of the scaled balance to numbers of the rig, the scaled unknowns and their units held.

    The unknowns are those of the rig's own modes, which a change of its structure mixes among each other.

    Parameters
    ----------
    here : Linearization
        Any state, solution or not.
    keys : sequence of str, (p,)
        Of :func:`rig_scalars`.

    Returns
    -------
    (size, p) array
    """
    held, balance = _Held(here, tuple(keys)), _LinearBalance(here)
    change = balance.scaled(held.modal, -here.problem.basis.analysis @ _friction(here, held.inputs))
    mixing = _mixing(held.structure, here.problem.structure.omega_n**2)
    if mixing.any():
        split = here.problem.basis.size * here.problem.structure.n
        mixed = _mixed(here.state.Q, mixing).reshape(split, -1) / here.problem.q_ref
        change += balance @ np.concatenate([mixed, np.zeros((here.problem.basis.size, len(keys)))])
        residual = here.residual[:split].reshape(here.state.Q.shape)
        change[:split] += np.einsum("ki,pij->kjp", residual, mixing).reshape(split, -1)
    return np.asarray(change)


def _mixed(Q: Array, mixing: Array) -> Array:
    """Coefficients (2H+1, n) of the changed modes, as (2H+1, n, p) of those there are now, per unit of each change."""
    return np.asarray(np.einsum("kj,pij->kip", Q, mixing))


def _mixing(change: StructureChange, squares: Array) -> Array:
    """Derivatives of the modes kept within each other, (p, n, n): columns are the changed modes in the present ones."""
    apart = squares[:, None] - squares
    np.fill_diagonal(apart, np.inf)
    mixing = (change.mass * squares - change.stiffness) / apart
    own = np.arange(len(squares))
    mixing[:, own, own] = -0.5 * change.mass[:, own, own]
    return np.asarray(mixing)


# ---- with the unknowns held


class _Held:
    """Derivatives to p parameters with the unknowns Q and T held.

    Attributes
    ----------
    structure : StructureChange
    hz : (p,) array
        1 where the parameter is the frequency, else 0.
    force : (2H+1, p) array
        Of the excitation.
    gain, delay : dict of str to (p,) array
        The same, of each response channel.
    modal : (2H+1, n, p) array
        Of the modal balance.
    inputs : InputChange
        Of what the law is shown.
    slid : (2H+1, p) array
        Of the rotation slid in the clamp.
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
        law = np.array([[key == name for key in keys] for name in _law_keys(here.problem.rig)], dtype=float)
        self.elements = self._elements(here.kin.elements)
        self.motion, self.clamp = here.kin.clamp, clamp_change(here.problem.rig, keys)
        self.slid = self._slid()
        compliance = self.structure.flexibility[:, 0, 0]
        law = np.vstack([law.reshape(-1, len(keys)), self.load])
        self.inputs = InputChange(self._signals(), 2 * np.pi * self.hz, law, compliance)
        self.modal = self._modal(here.kin.by_T)

    def _force(self) -> Array:
        """Of the excitation, (2H+1, p)."""
        problem, tones = self.problem, list(tone_scalars(self.problem.rig))
        force = np.outer(problem.force_shape, [float(key == FORCE) for key in self.keys])
        for j, key in enumerate(self.keys):
            if key in tones:
                i, sine = divmod(tones.index(key), 2)
                k = problem.rig.excitation.harmonics[i][0]
                if k <= problem.basis.H:
                    force[k + sine * problem.basis.H, j] = self.state.F
        return force

    def _elements(self, forces: Array | None) -> HeldElements | None:
        """Of the forces of the elements, these along their rows (2H+1, r)."""
        problem, state, keys = self.problem, self.state, self.keys
        if problem.elements is None or forces is None:
            return None
        rows = stacked(elements_change(problem.rig, keys), axis=1)
        own = np.array([[key == name for key in keys] for name in element_scalars(problem.rig)], dtype=float)
        moved = ElementChange(rows, own.reshape(-1, len(keys)), 2 * np.pi * self.hz, self.force)
        change = problem.elements.along(state.Q, state.Omega, state.F * problem.force_shape, moved)
        return HeldElements(problem.elements, forces, change, rows)

    def _slid(self) -> Array:
        """Of the rotation slid in the clamp, (2H+1, p)."""
        problem, state, d = self.problem, self.state, self.clamp
        if problem.clamp is None or self.motion is None or d is None:
            return np.zeros((problem.basis.size, len(self.keys)))
        held = self.through(d.row) + np.outer(state.T, d.residual[:, 0])
        held += problem.clamp.port.residual[1] * self.force + np.outer(problem.force_shape, state.F * d.residual[:, 1])
        limit = np.array([float(key == LIMIT) for key in self.keys])
        return problem.clamp.along(self.motion, state.Omega, ClampChange(held, d.stiffness, limit))

    def by_slid(self, place: int, slid: Array) -> Array:
        """Of slip, drive, a channel or the reaction by what is slid beyond the modes, `slid` (2H+1, p) that changes."""
        problem, d = self.problem, self.clamp
        if problem.clamp is None or self.motion is None or d is None:
            return np.zeros_like(slid)
        return np.asarray(problem.clamp.port.residual[place] * slid + np.outer(self.motion.slid, d.residual[:, place]))

    def through(self, rows: Array) -> Array:
        """Coefficients (2H+1, p) of the modes seen through rows (p, n)."""
        return np.asarray(self.state.Q @ rows.T)

    def static(self, flexibility: Array, friction: Array) -> Array:
        """What friction (2H+1,) and excitation do by flexibilities (p, 2), (2H+1, p)."""
        moved = np.outer(friction, flexibility[:, 0])
        moved += np.outer(self.state.F * self.problem.force_shape, flexibility[:, 1])
        return moved

    def _signals(self) -> Array:
        """Of u, rho, eta, (2H+1, 3, p)."""
        problem, d, Q = self.problem, self.structure, self.state.Q
        s, basis, Omega = problem.structure, problem.basis, self.state.Omega
        u = self.through(d.rows[:, 0]) + self.static(d.flexibility[:, 0] * [0.0, 1.0], self.state.T)
        u += s.residual.slip_by_force * self.force + self.by_slid(0, self.slid)
        if problem.coupled:
            fine = basis.exact_products
            q = fine.synthesis @ Q
            u -= 0.5 * fine.analysis @ np.einsum("ti,pij,tj->tp", q, d.shortening, q, optimize=True)
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
        modal = np.einsum("pij,kj->kip", d.stiffness, Q) + np.einsum("pij,kj->kip", d.damping, velocity)
        modal -= np.einsum("pij,kj->kip", d.mass, squared * Q)
        modal -= np.einsum("k,pi->kip", state.T, d.rows[:, 0])
        if by_T is not None:
            modal += np.einsum("kl,pij,lj->kip", by_T, d.shortening, Q, optimize=True)
        modal -= s.excitation[:, None] * self.force[:, None]
        modal -= np.multiply.outer(problem.force_shape, state.F * d.rows[:, 1].T)
        if self.elements is not None:
            modal -= self.elements.onto_modes()
        if problem.clamp is not None and self.motion is not None and self.clamp is not None:
            modal -= np.einsum("k,pi->kip", self.motion.slid, self.clamp.row)
            modal -= np.einsum("kp,i->kip", self.slid, problem.clamp.port.row)
        faster = s.damping * basis.derivative(Q) - 2 * Omega * basis.k[:, None] ** 2 * Q
        return np.asarray(modal + np.multiply.outer(faster, 2 * np.pi * self.hz))


def _friction(here: Linearization, inputs: InputChange) -> Array:
    """Derivatives of the friction force at the samples, (N_t, p)."""
    problem = here.problem
    return problem.law.along(here.kin.signals, here.state.Omega, problem.environment, inputs)


# ---- with the unknowns moving


class _LinearBalance:
    """The complete linearised balance of a state, for changes of its unknowns in p columns."""

    def __init__(self, here: Linearization) -> None:
        problem, state, kin = here.problem, here.state, here.kin
        self.here = here
        self.problem, self.state, self.by_T, self.contact = problem, state, kin.by_T, here.contact
        self._slid = None if here.rotation is None else here.rotation.slid
        self._elements = None if here.slope is None else here.slope.by_Q
        real, imaginary = problem.dynamic_stiffness(state.Omega)
        self._stiffness = (real + 1j * imaginary)[:, :, None]
        size, n = problem.basis.size, problem.structure.n
        slip_by_modes = problem.slip_by_modes(kin)  # (2H+1, 2H+1, n)
        self._modes_to_slip = slip_by_modes.reshape(size, size * n)
        # what maps the modes to u takes T to the modes
        self._friction_to_modes = np.ascontiguousarray(slip_by_modes.transpose(0, 2, 1)).reshape(size * n, size)
        self._rows = np.ascontiguousarray(problem.rows[:, 1:].T)

    def by_elements(self, d_Q: Array) -> Array:
        """Change (2H+1, r, p) of the forces of the elements that deflections bring, velocities held."""
        elements, slope = self.problem.elements, self.here.slope
        if elements is None or slope is None or not elements.static.any():
            return np.zeros((len(d_Q), 0 if elements is None else len(elements.rows), d_Q.shape[2]))
        return slope.along(np.einsum("ri,kip->krp", elements.rows, d_Q))

    def slid(self, d_Q: Array, d_T: Array) -> Array:
        """Change (2H+1, p) of the rotation slid in the clamp."""
        clamp = self.problem.clamp
        if clamp is None or self._slid is None:
            return np.zeros_like(d_T)
        return np.asarray(self._slid @ clamp.held(d_Q, d_T, np.zeros_like(d_T)))

    def signals(self, d_Q: Array, d_T: Array) -> Array:
        """Change (2H+1, 3, p) of u, rho, eta with the unknowns (2H+1, n, p) and (2H+1, p)."""
        problem = self.problem
        u = self._modes_to_slip @ d_Q.reshape(-1, d_Q.shape[2]) - problem.dynamic_lagrangian * d_T
        rows = self._rows @ d_Q
        rho = problem.reaction_of(rows, self.state.Omega)
        if self._elements is not None:
            rho -= np.tensordot(self._elements[:, -1], d_Q, axes=2)
        if problem.clamp is not None:
            slid, residual = self.slid(d_Q, d_T), problem.clamp.port.residual
            u += residual[0] * slid
            rho += residual[-1] * slid
        return np.stack([u, rho, rows[:, 3]], axis=1)

    def __matmul__(self, x: Array) -> Array:
        """Scaled change (size, p) of the balance with the scaled unknowns (size, p)."""
        basis, (d_Q, d_T) = self.problem.basis, self.unpack(x)
        modal = basis.real(basis.complex(d_Q) * self._stiffness)
        modal -= (self._friction_to_modes @ d_T).reshape(modal.shape)
        if self.by_T is not None:
            drawn_in = self.problem.structure.shortening.T @ d_Q
            modal += (self.by_T @ drawn_in.reshape(len(drawn_in), -1)).reshape(modal.shape)
        if self._elements is not None:
            modal -= np.tensordot(self._elements[:, :-1], d_Q, axes=2)
        if self.problem.clamp is not None:
            modal -= np.einsum("kp,i->kip", self.slid(d_Q, d_T), self.problem.clamp.port.row)
        return self.scaled(modal, d_T - self.law(self.signals(d_Q, d_T)))

    def law(self, signals: Array) -> Array:
        """Change (2H+1, p) of the law's force coefficients with those of u, rho, eta."""
        change = np.zeros((len(signals), signals.shape[2]))
        for i, slope in enumerate((self.contact.by_u, self.contact.by_rho, self.contact.by_eta)):
            if slope is not None:
                change += slope @ signals[:, i]
        return change

    def disturbed(self, by: Disturbance) -> Array:
        """What acts beside the excitation in the units of the residual, (size, p)."""
        held = np.stack([by.slip, by.reaction, np.zeros_like(by.slip)], axis=1)
        return self.scaled(by.modes, by.friction + self.law(held))

    def scaled(self, modal: Array, contact: Array) -> Array:
        """Balances (size, p) in the units of the residual, of modal (2H+1, n, p) and contact (2H+1, p) forces."""
        problem = self.problem
        flat = modal.reshape(-1, modal.shape[2])
        return np.concatenate([flat / problem.modal_force_ref, contact / problem.F_ref])

    def unpack(self, x: Array) -> tuple[Array, Array]:
        """Q (2H+1, n, p) and T (2H+1, p) of scaled unknowns (size, p)."""
        problem = self.problem
        split = problem.basis.size * problem.structure.n
        Q = x[:split].reshape(problem.basis.size, problem.structure.n, -1) * problem.q_ref
        return Q, x[split:] * problem.F_ref


@np.errstate(all="ignore")  # what diverges ends in the message
def _refined(here: Linearization, balance: _LinearBalance, right: Array) -> tuple[Array, int]:
    """Solve the complete balance with the matrix of Newton's method; and count the refinements."""
    held, whole = np.zeros(len(right)), np.zeros_like(right)  # border that holds the frequency
    acting = np.flatnonzero(right.any(axis=0))
    if not acting.size:  # sensors alone change
        return whole, 0
    right = right[:, acting]
    x, left, before = np.zeros_like(right), right, np.full(right.shape[1], np.finfo(float).tiny)
    for count in range(MOST_REFINEMENTS + 1):
        step, _ = here.newton.solve_columns(held, 1.0, left, 0.0)
        x += step
        size = np.abs(step).max(axis=0)
        following = size * np.minimum(size / before, 1.0)  # steps shrink in proportion
        if np.all(following <= REFINED * np.abs(x).max(axis=0)):
            whole[:, acting] = x
            return whole, count
        left, before = right - balance @ x, np.maximum(size, np.finfo(float).tiny)
    hz = here.state.Omega / (2 * np.pi)
    raise ArithmeticError(
        f"sensitivities: no convergence in {MOST_REFINEMENTS} refinements at {hz:.6g} Hz and {here.state.F:g} N; "
        "at a fold the solution has no derivative at held frequency and force; step away from it"
    )


# ---- channels


class _Channels(Mapping[str, ChannelSensitivity]):
    """Derivatives of the channels, which are linear in motion, signals and friction, see :mod:`hbm.solution`."""

    def __init__(self, here: Linearization, solution: PeriodicSolution, held: _Held, change: _Change) -> None:
        self.here, self.problem, self.solution, self.held, self.change = here, here.problem, solution, held, change
        self._sensors = {c.name: c for c in self.problem.rig.channels}
        self._places = {c.name: i for i, c in enumerate(self.problem.rig.response_channels, start=2)}
        self._known: dict[str, ChannelSensitivity] = {}

    def __iter__(self) -> Iterator[str]:
        return iter(self.solution.channels)

    def __len__(self) -> int:
        return len(self.solution.channels)

    def __getitem__(self, name: str) -> ChannelSensitivity:
        if name not in self._known:
            self._known[name] = self._worked_out(name)
        return self._known[name]

    def __reduce__(self) -> tuple[type, tuple[dict[str, ChannelSensitivity]]]:
        return dict, (dict(self),)  # what is sent to another process is worked out

    def _worked_out(self, name: str) -> ChannelSensitivity:
        s = self.problem.structure
        match name:
            case "drive":
                moved = self._moved(1, s.excitation, s.residual.drive_by_force, s.residual.slip_by_force)
                return self._motion(name, moved, 0)
            case "slip":
                zero_mean, u = self._slip_samples - self._slip_samples.mean(axis=0), self.solution[name].samples
                return ChannelSensitivity(self._slip, self._slip_samples, _largest(u - u.mean(), zero_mean))
            case "slip_velocity":
                return self._motion(name, self._slip, 1)
            case "friction":
                T, analysis = self.solution[name].samples, self.problem.basis.analysis
                return ChannelSensitivity(analysis @ self._friction, self._friction, _largest(T, self._friction))
            case "normal":
                normal, R = self._normal(), self.solution[name].samples
                return ChannelSensitivity(self.problem.basis.analysis @ normal, normal, normal[R.argmax()])
        sensor = self._sensors[name]
        if sensor.quantity == "force":
            return self._motion(name, self.held.force, 0)
        moved = self._moved(self._places[name], s.channel_rows[name], *s.residual.channels[name])
        return self._motion(name, moved, DERIVATIVES[sensor.quantity], sensor)

    @cached_property
    def _friction(self) -> Array:
        """Of the friction force at the samples, (N_t, p)."""
        return _friction(self.here, replace(self.held.inputs, signals=self.change.signals))

    @cached_property
    def _modal_slip(self) -> Array:
        """Of the slip less its elastic part, (2H+1, p)."""
        return np.asarray(self.change.signals[:, 0] + self.problem.dynamic_lagrangian * self.change.T)

    @cached_property
    def _slip(self) -> Array:
        """Of the slip, (2H+1, p)."""
        yielding = np.outer(self.solution["friction"].coefficients, self.held.structure.flexibility[:, 0, 0])
        return np.asarray(self._modal_slip + self.problem.structure.compliance * self.change.T + yielding)

    @cached_property
    def _slip_samples(self) -> Array:
        """Of the slip at the samples, (N_t, p)."""
        yielding = np.outer(self.solution["friction"].samples, self.held.structure.flexibility[:, 0, 0])
        elastic = self.problem.structure.compliance * self._friction + yielding
        return np.asarray(self.problem.basis.synthesis @ self._modal_slip + elastic)

    def _motion(self, name: str, displacement: Array, times: int, sensor: Channel = TRUE) -> ChannelSensitivity:
        basis, held, Omega = self.problem.basis, self.held, self.here.state.Omega
        coefficients, read = displacement, self.solution[name].coefficients
        for _ in range(times):
            coefficients = Omega * basis.derivative(coefficients)
        coefficients = as_read(basis, coefficients, Omega, sensor)
        if times:  # of Omega to that power
            coefficients += np.outer(read, times / self.solution.hz * held.hz)
        if sensor is not TRUE:
            later = held.delay[name] * Omega + sensor.delay * 2 * np.pi * held.hz
            coefficients += np.outer(read / sensor.gain, held.gain[name]) - np.outer(basis.derivative(read), later)
        samples = basis.synthesis @ coefficients
        return ChannelSensitivity(coefficients, samples, _smooth_peak(self.solution[name].samples, samples))

    def _moved(self, place: int, row: Array, by_force: float, by_friction: float) -> Array:
        held, d = self.held, self.held.structure
        still = held.through(d.rows[:, place])
        still += held.static(d.flexibility[:, place], self.solution["friction"].coefficients)
        still += held.by_slid(place, self.change.slid)
        if held.elements is not None:
            still += held.elements.beyond(place - 1, self.change.elements)
        return np.asarray(row @ self.change.Q + by_force * held.force + by_friction * self.change.T + still)

    def _normal(self) -> Array:
        """Of rho + eta T at the samples, (N_t, p)."""
        synthesis, signals = self.problem.basis.synthesis, self.change.signals
        eta, T = synthesis @ self.here.kin.signals[:, 3], self.solution["friction"].samples
        normal = synthesis @ signals[:, 1] + T[:, None] * (synthesis @ signals[:, 2]) + eta[:, None] * self._friction
        rig, elements = self.problem.rig, self.held.elements
        if elements is None or not rig.contact.lift_off:
            return np.asarray(normal)
        tension = elements.tension(self.change.elements, rig.contact.normal_load, self.held.load)
        on_support = self.solution["normal"].samples[:, None] > 0.0
        return np.where(on_support, normal - synthesis @ tension, 0.0)


def _largest(samples: Array, change: Array) -> Array:
    """Derivatives of the largest magnitude of a sampled signal."""
    i = int(np.abs(samples).argmax())
    return np.asarray(np.sign(samples[i]) * change[i])


def _smooth_peak(samples: Array, change: Array) -> Array:
    """Derivatives of the top of the parabola through the three samples around the largest magnitude."""
    i = int(np.abs(samples).argmax())
    around = [i - 1, i, (i + 1) % len(samples)]
    before, top, after = np.abs(samples[around])
    bend = before + after - 2 * top
    x = (before - after) / (2 * bend) if bend < 0.0 else 0.0  # of the top, in samples; it moves along a level parabola
    weights = np.array([x * (x - 1) / 2, 1 - x**2, x * (x + 1) / 2])
    return np.asarray((weights * np.sign(samples[around])) @ change[around])
