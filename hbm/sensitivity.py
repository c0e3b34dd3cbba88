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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hbm.aft import InputChange
from hbm.complete import CompleteBalance
from hbm.elements import ElementChange, stacked
from hbm.fourier import Array
from hbm.residual import HarmonicBalance, Linearization
from hbm.solution import DERIVATIVES, TRUE, PeriodicSolution, as_read
from hbm.threads import one_thread
from models.change import Scalar, element_scalars, elements_change, structure_change, structure_scalars
from models.friction import describe, parameters
from models.rig import Channel, Rig

REFINED = 1e-12
"""Refinement ends when it changes the derivatives by less than this fraction."""

MOST_REFINEMENTS = 50

UNBALANCED = 1e-6
"""A state that misses the balance by more than this fraction of the excitation is not a solution of the rig."""

FRICTION = "contact.friction."
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
        The channels of the solution.
    refinements : int
        Corrections of the first back-substitution.
    """

    solution: PeriodicSolution
    parameters: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    Q: Array
    T: Array
    channels: Mapping[str, ChannelSensitivity]
    refinements: int

    def __getitem__(self, name: str) -> ChannelSensitivity:
        """Channel by name."""
        return self.channels[name]

    def logarithmic(self, channel: str) -> dict[str, float]:
        """Derivative d ln(peak) / d ln(p) of a channel's peak to each parameter: per cent per per cent.

        At the top of a resonance the derivative at the held frequency is also that of the resonance's height
        (envelope theorem): the shift of the resonance does not count, since the curve is level there. How level is
        told by the entry of ``frequency_hz``.
        """
        relative = self.values * self[channel].peak / self.solution[channel].peak
        return dict(zip(self.parameters, relative.tolist(), strict=True))


@one_thread
def sensitivities(rig: Rig, solution: PeriodicSolution, keys: Sequence[str] | None = None) -> Sensitivities:
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
    x, refinements = _refined(here, balance, balance.scaled(-held.modal, law))
    d_Q, d_T = balance.unpack(x)
    inputs = replace(held.inputs, signals=held.inputs.signals + balance.signals(d_Q, d_T))
    channels = _channels(solution, held, _Change(d_Q, inputs.signals, _friction(here, inputs)))
    values, units = zip(*(known[key] for key in keys), strict=True)
    return Sensitivities(solution, keys, units, np.array(values), d_Q, d_T, channels, refinements)


def rig_scalars(rig: Rig, solution: PeriodicSolution) -> dict[str, Scalar]:
    """Numbers that a solution depends on, with the keys of the rig file; force and frequency are the solution's."""
    law = rig.contact.law
    described = zip(_law_keys(rig), parameters(law).values(), describe(type(law)).values(), strict=True)
    return {key: Scalar(value, p.unit) for key, value, p in described} | {
        LOAD: Scalar(rig.contact.normal_load, "N"),
        FORCE: Scalar(solution.level, "N"),
        HZ: Scalar(solution.hz, "Hz"),
        **structure_scalars(rig),
        **sensor_scalars(rig),
        **element_scalars(rig),
    }


def sensor_scalars(rig: Rig) -> dict[str, Scalar]:
    """What channels make of what they measure, with the keys of the rig file."""
    gains = {f"channels.{c.name}.gain": Scalar(c.gain, "1") for c in rig.response_channels}
    return gains | {f"channels.{c.name}.delay": Scalar(c.delay, "s") for c in rig.response_channels}


def _law_keys(rig: Rig) -> list[str]:
    return [FRICTION + name for name in describe(type(rig.contact.law))]


@dataclass(frozen=True)
class _Change:
    """Derivatives of Q (2H+1, n, p), of u, rho, eta (2H+1, 3, p), and of T at the samples (N_t, p)."""

    Q: Array
    signals: Array
    friction: Array


# ---- with the unknowns held


class _Held:
    """Derivatives to p parameters with the unknowns Q and T held.

    Attributes
    ----------
    structure : StructureChange
    force, hz : (p,) array
        1 where the parameter is the force, the frequency; else 0.
    gain, delay : dict of str to (p,) array
        The same, of each response channel.
    modal : (2H+1, n, p) array
        Of the modal balance.
    inputs : InputChange
        Of what the law is shown.
    """

    def __init__(self, here: Linearization, keys: tuple[str, ...]) -> None:
        self.problem, self.state = here.problem, here.state
        self.keys, self.structure = keys, structure_change(here.problem.rig, keys)
        self.load, self.force, self.hz = (np.array([float(key == name) for key in keys]) for name in (LOAD, FORCE, HZ))
        sensors = here.problem.rig.response_channels
        self.gain, self.delay = (
            {c.name: np.array([float(key == f"channels.{c.name}.{what}") for key in keys]) for c in sensors}
            for what in ("gain", "delay")
        )
        law = np.array([[key == name for key in keys] for name in _law_keys(here.problem.rig)], dtype=float)
        self.elements = self._elements()
        compliance = self.structure.flexibility[:, 0, 0]
        law = np.vstack([law.reshape(-1, len(keys)), self.load])
        self.inputs = InputChange(self._signals(), 2 * np.pi * self.hz, law, compliance)
        self.modal = self._modal(here.kin.by_T)

    def _elements(self) -> Array | None:
        """Of the forces of the elements on modes and support, (2H+1, n+1, p)."""
        problem, state = self.problem, self.state
        if problem.elements is None:
            return None
        rows = stacked(elements_change(problem.rig, self.keys), axis=1)
        own = np.array([[key == name for key in self.keys] for name in element_scalars(problem.rig)], dtype=float)
        return problem.elements.along(state.Q, state.Omega, ElementChange(rows, own, 2 * np.pi * self.hz))

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
        u += np.outer(s.residual.slip_by_force * problem.force_shape, self.force)
        if problem.coupled:
            fine = basis.exact_products
            q = fine.synthesis @ Q
            u -= 0.5 * fine.analysis @ np.einsum("ti,pij,tj->tp", q, d.shortening, q, optimize=True)
        rows = np.stack([self.through(row) for row in (d.inertia, d.reaction_damping, d.reaction_stiffness)], axis=1)
        rho = problem.reaction_of(rows, Omega)
        faster = basis.derivative(Q @ s.reaction.damping) - 2 * Omega * basis.k**2 * (Q @ s.reaction.inertia)
        rho += np.outer(faster, 2 * np.pi * self.hz)
        rho[0] += self.load
        rho -= np.outer(problem.force_shape, s.reaction.force_share * self.force + d.force_share * self.state.F)
        if self.elements is not None:
            rho -= self.elements[:, -1]
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
        modal -= np.multiply.outer(problem.force_shape, np.outer(s.excitation, self.force) + state.F * d.rows[:, 1].T)
        if self.elements is not None:
            modal -= self.elements[:, :-1]
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
        self.problem, self.state, self.by_T, self.contact = problem, state, kin.by_T, here.contact
        self._elements = here.newton.slope.by_Q if isinstance(here.newton, CompleteBalance) else None
        real, imaginary = problem.dynamic_stiffness(state.Omega)
        self._stiffness = (real + 1j * imaginary)[:, :, None]
        self._slip_by_modes = problem.slip_by_modes(kin)

    def signals(self, d_Q: Array, d_T: Array) -> Array:
        """Change (2H+1, 3, p) of u, rho, eta with the unknowns (2H+1, n, p) and (2H+1, p)."""
        problem = self.problem
        u = np.tensordot(self._slip_by_modes, d_Q, axes=2) - problem.dynamic_lagrangian * d_T
        rows = np.einsum("kip,ir->krp", d_Q, problem.rows[:, 1:])
        rho = problem.reaction_of(rows, self.state.Omega)
        if self._elements is not None:
            rho -= np.tensordot(self._elements[:, -1], d_Q, axes=2)
        return np.stack([u, rho, rows[:, 3]], axis=1)

    def __matmul__(self, x: Array) -> Array:
        """Scaled change (size, p) of the balance with the scaled unknowns (size, p)."""
        basis, (d_Q, d_T) = self.problem.basis, self.unpack(x)
        modal = basis.real(basis.complex(d_Q) * self._stiffness)
        modal -= np.einsum("kli,lp->kip", self._slip_by_modes, d_T)  # what maps the modes to u takes T to the modes
        if self.by_T is not None:
            modal += np.einsum("kl,ljp,ji->kip", self.by_T, d_Q, self.problem.structure.shortening, optimize=True)
        if self._elements is not None:
            modal -= np.tensordot(self._elements[:, :-1], d_Q, axes=2)
        return self.scaled(modal, d_T - self._law(self.signals(d_Q, d_T)))

    def _law(self, signals: Array) -> Array:
        """Change (2H+1, p) of the law's force coefficients with those of u, rho, eta."""
        change = np.zeros((len(signals), signals.shape[2]))
        for i, slope in enumerate((self.contact.by_u, self.contact.by_rho, self.contact.by_eta)):
            if slope is not None:
                change += slope @ signals[:, i]
        return change

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
    held = np.zeros(len(right))  # border that holds the frequency
    x, left = np.zeros_like(right), right
    for count in range(MOST_REFINEMENTS + 1):
        step, _ = here.newton.solve_columns(held, 1.0, left, 0.0)
        x += step
        if np.all(np.abs(step).max(axis=0) <= REFINED * np.abs(x).max(axis=0)):
            return x, count
        left = right - balance @ x
    hz = here.state.Omega / (2 * np.pi)
    raise ArithmeticError(
        f"sensitivities: no convergence in {MOST_REFINEMENTS} refinements at {hz:.6g} Hz and {here.state.F:g} N; "
        "at a fold the solution has no derivative at held frequency and force; step away from it"
    )


# ---- channels


def _channels(solution: PeriodicSolution, held: _Held, change: _Change) -> dict[str, ChannelSensitivity]:
    """Derivatives of the channels, which are linear in motion, signals and friction, see :mod:`hbm.solution`."""
    problem, d = held.problem, held.structure
    s, basis, Omega = problem.structure, problem.basis, solution.state.Omega
    T, d_T = solution["friction"], basis.analysis @ change.friction
    force = np.outer(problem.force_shape, held.force)
    modal_slip = change.signals[:, 0] + problem.dynamic_lagrangian * d_T
    yielding = d.flexibility[:, 0, 0]
    slip = modal_slip + s.compliance * d_T + np.outer(T.coefficients, yielding)
    slip_samples = basis.synthesis @ modal_slip + s.compliance * change.friction + np.outer(T.samples, yielding)
    normal = _normal(problem, solution, change)

    def motion(name: str, displacement: Array, times: int, sensor: Channel = TRUE) -> ChannelSensitivity:
        coefficients, read = displacement, solution[name].coefficients
        for _ in range(times):
            coefficients = Omega * basis.derivative(coefficients)
        coefficients = as_read(basis, coefficients, Omega, sensor)
        if times:  # of Omega to that power
            coefficients += np.outer(read, times / solution.hz * held.hz)
        if sensor is not TRUE:
            later = held.delay[name] * Omega + sensor.delay * 2 * np.pi * held.hz
            coefficients += np.outer(read / sensor.gain, held.gain[name]) - np.outer(basis.derivative(read), later)
        samples = basis.synthesis @ coefficients
        return ChannelSensitivity(coefficients, samples, _smooth_peak(solution[name].samples, samples))

    def moved(place: int, row: Array, by_force: float, by_friction: float) -> Array:
        still = held.through(d.rows[:, place]) + held.static(d.flexibility[:, place], T.coefficients)
        return row @ change.Q + by_force * force + by_friction * d_T + still

    residual = s.residual
    places = {c.name: i for i, c in enumerate(problem.rig.response_channels, start=2)}
    channels = {
        c.name: motion(c.name, force, 0)
        if c.quantity == "force"
        else motion(
            c.name,
            moved(places[c.name], s.channel_rows[c.name], *residual.channels[c.name]),
            DERIVATIVES[c.quantity],
            c,
        )
        for c in problem.rig.channels
    }
    zero_mean = slip_samples - slip_samples.mean(axis=0)
    u, R = solution["slip"].samples, solution["normal"].samples
    return channels | {
        "drive": motion("drive", moved(1, s.excitation, residual.drive_by_force, residual.slip_by_force), 0),
        "slip": ChannelSensitivity(slip, slip_samples, _largest(u - u.mean(), zero_mean)),
        "slip_velocity": motion("slip_velocity", slip, 1),
        "friction": ChannelSensitivity(d_T, change.friction, _largest(T.samples, change.friction)),
        "normal": ChannelSensitivity(basis.analysis @ normal, normal, normal[R.argmax()]),
    }


def _normal(problem: HarmonicBalance, solution: PeriodicSolution, change: _Change) -> Array:
    """Derivatives of rho + eta T at the samples, (N_t, p)."""
    synthesis = problem.basis.synthesis
    eta = synthesis @ problem.kinematics(solution.state).signals[:, 3]
    d_rho, d_eta = synthesis @ change.signals[:, 1], synthesis @ change.signals[:, 2]
    return np.asarray(d_rho + solution["friction"].samples[:, None] * d_eta + eta[:, None] * change.friction)


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
