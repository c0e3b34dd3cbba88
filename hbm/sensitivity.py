"""Exact derivatives of a periodic solution to the parameters of its rig.

The balance J [dQ; dT] = -dF/dp of the implicit function theorem is solved with the elimination that Newton's method
uses. That one leaves weak foreshortening out of its matrix, so its solution is refined against the complete linearised
balance until nothing changes: the derivatives are those of the discretised equations, to rounding.

Where a sample changes between stick and slip, the discretised balance has a kink and its derivative is one-sided: that
of the side the solution lies on. Between such changes the derivative is exact for the samples given; its jumps fall
with their number (on the paper's beam near resonance, a few per cent with 256 samples).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from hbm.aft import InputChange
from hbm.fourier import Array
from hbm.residual import HarmonicBalance, Linearization
from hbm.solution import DERIVATIVES, PeriodicSolution
from hbm.threads import one_thread
from models.friction import describe, parameters
from models.rig import Rig

REFINED = 1e-12
"""Refinement ends when it changes the derivatives by less than this fraction."""

MOST_REFINEMENTS = 50

UNBALANCED = 1e-6
"""A state that misses the balance by more than this fraction of the excitation is not a solution of the rig."""

RIG_PARAMETERS = {
    "contact.normal_load": "N",
    "excitation.amplitude": "N",
    "frequency_hz": "Hz",
    "damping.mass_proportional": "1/s",
}
"""Parameters besides the law's, with their units; they come last."""

LOAD, FORCE, HZ, ALPHA = range(-len(RIG_PARAMETERS), 0)
"""Their columns."""


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
        Keys of the rig file: the friction law's, then those of `RIG_PARAMETERS`.
    values : (p,) array
        Their values; force and frequency are those of the solution.
    Q, T : (2H+1, n, p) and (2H+1, p) arrays
        Derivatives of the unknowns, :class:`hbm.residual.State`.
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
def sensitivities(rig: Rig, solution: PeriodicSolution) -> Sensitivities:
    """Exact derivatives of a periodic solution to the parameters of its rig.

    Parameters
    ----------
    rig : Rig
        The rig of the solution; its force amplitude may differ.
    solution : PeriodicSolution
        Steady state or point of a curve.

    Returns
    -------
    Sensitivities

    Raises
    ------
    ValueError
        If the solution is not one of this rig.
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
    modal, inputs = _held(here)
    balance = _LinearBalance(here)
    law = problem.basis.analysis @ _friction(here, inputs)
    x, refinements = _refined(here, balance, balance.scaled(-modal, law))
    d_Q, d_T = balance.unpack(x)
    inputs = replace(inputs, signals=inputs.signals + balance.signals(d_Q, d_T))
    friction = _friction(here, inputs)
    channels = _channels(problem, solution, _Change(d_Q, inputs.signals, friction))
    return Sensitivities(solution, *_parameters(rig, solution), d_Q, d_T, channels, refinements)


def _parameters(rig: Rig, solution: PeriodicSolution) -> tuple[tuple[str, ...], tuple[str, ...], Array]:
    """Keys, units and values of the parameters."""
    law = [(f"contact.friction.{name}", p.unit) for name, p in describe(type(rig.contact.law)).items()]
    names, units = zip(*law, *RIG_PARAMETERS.items(), strict=True)
    ours = [rig.contact.normal_load, solution.level, solution.hz, rig.damping.mass_proportional]
    return names, units, np.array([*parameters(rig.contact.law).values(), *ours])


@dataclass(frozen=True)
class _Change:
    """Derivatives of Q (2H+1, n, p), of u, rho, eta (2H+1, 3, p), and of T at the samples (N_t, p)."""

    Q: Array
    signals: Array
    friction: Array


# ---- with the unknowns held


def _held(here: Linearization) -> tuple[Array, InputChange]:
    """Derivatives of the modal balance (2H+1, n, p) and of the law's inputs to the parameters, Q and T held."""
    problem, state = here.problem, here.state
    s, basis, Q, Omega = problem.structure, problem.basis, state.Q, state.Omega
    of_law = len(problem.environment.parameters) + 1  # the load, which it sees too, comes first of the others
    count = of_law - 1 + len(RIG_PARAMETERS)
    modal, signals, d_Omega = np.zeros((*Q.shape, count)), np.zeros((basis.size, 3, count)), np.zeros(count)
    u, rho, _ = signals.transpose(1, 0, 2)
    rho[0, LOAD] = 1.0
    modal[basis.fundamental, :, FORCE] = -s.excitation
    u[basis.fundamental, FORCE] = s.residual.slip_by_force
    rho[basis.fundamental, FORCE] = -s.reaction.force_share
    turning = -2 * Omega * basis.k**2
    modal[:, :, HZ] = 2 * np.pi * (s.damping * basis.derivative(Q) + turning[:, None] * Q)
    rho[:, HZ] = 2 * np.pi * (basis.derivative(Q @ s.reaction.damping) + turning * (Q @ s.reaction.inertia))
    d_Omega[HZ] = 2 * np.pi
    modal[:, :, ALPHA] = Omega * basis.derivative(Q) * problem.rig.damping.by_mass_proportional(s.omega_n)
    rho[:, ALPHA] = modal[:, :, ALPHA] @ s.reaction.inertia
    return modal, InputChange(signals, d_Omega, np.eye(of_law, count))


def _friction(here: Linearization, inputs: InputChange) -> Array:
    """Derivatives of the friction force at the samples, (N_t, p)."""
    problem = here.problem
    return problem.law.along(here.kin.signals, here.state.Omega, problem.environment, inputs)


# ---- with the unknowns moving


class _LinearBalance:
    """The complete linearised balance of a state, for changes of its unknowns in p columns."""

    def __init__(self, here: Linearization) -> None:
        problem, state, kin = here.problem, here.state, here.kin
        self.problem, self.state, self.by_T, self.contact = problem, state, kin.by_T, here.elimination.contact
        real, imaginary = problem.dynamic_stiffness(state.Omega)
        self._stiffness = (real + 1j * imaginary)[:, :, None]
        slope = -kin.Gq
        slope[0] += problem.structure.slip_row
        self._slip_by_modes = problem.basis.multiplication(slope)  # du/dq times a series, (2H+1, 2H+1, n)

    def signals(self, d_Q: Array, d_T: Array) -> Array:
        """Change (2H+1, 3, p) of u, rho, eta with the unknowns (2H+1, n, p) and (2H+1, p)."""
        problem = self.problem
        u = np.tensordot(self._slip_by_modes, d_Q, axes=2) - problem.dynamic_lagrangian * d_T
        inertia, damping, eta = np.einsum("kip,ir->rkp", d_Q, problem.rows[:, 1:])
        return np.stack([u, problem.reaction_of(inertia, damping, self.state.Omega), eta], axis=1)

    def __matmul__(self, x: Array) -> Array:
        """Scaled change (size, p) of the balance with the scaled unknowns (size, p)."""
        basis, (d_Q, d_T) = self.problem.basis, self.unpack(x)
        modal = basis.real(basis.complex(d_Q) * self._stiffness)
        modal -= np.einsum("kli,lp->kip", self._slip_by_modes, d_T)  # what maps the modes to u takes T to the modes
        if self.by_T is not None:
            modal += np.einsum("kl,ljp,ji->kip", self.by_T, d_Q, self.problem.structure.shortening, optimize=True)
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
    """Solve the complete balance with the elimination of the incomplete one; and count the refinements."""
    held = np.zeros(len(right))  # border that holds the frequency
    x, left = np.zeros_like(right), right
    for count in range(MOST_REFINEMENTS + 1):
        step = np.stack([here.solve_bordered(held, 1.0, column, 0.0)[0] for column in left.T], axis=1)
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


def _channels(problem: HarmonicBalance, solution: PeriodicSolution, change: _Change) -> dict[str, ChannelSensitivity]:
    """Derivatives of the channels, which are linear in motion, signals and friction, see :mod:`hbm.solution`."""
    s, basis, Omega = problem.structure, problem.basis, solution.state.Omega
    friction = basis.analysis @ change.friction
    force = np.zeros_like(friction)
    force[basis.fundamental, FORCE] = 1.0
    modal_slip = change.signals[:, 0] + problem.dynamic_lagrangian * friction
    slip = modal_slip + s.compliance * friction
    slip_samples = basis.synthesis @ modal_slip + s.compliance * change.friction
    normal = _normal(problem, solution, change)

    def motion(name: str, displacement: Array, times: int) -> ChannelSensitivity:
        coefficients = displacement
        for _ in range(times):
            coefficients = Omega * basis.derivative(coefficients)
        if times:
            coefficients[:, HZ] += times / solution.hz * solution[name].coefficients  # of Omega to that power
        samples = basis.synthesis @ coefficients
        return ChannelSensitivity(coefficients, samples, _smooth_peak(solution[name].samples, samples))

    def moved(row: Array, by_force: float, by_friction: float) -> Array:
        return row @ change.Q + by_force * force + by_friction * friction

    residual = s.residual
    channels = {
        c.name: motion(c.name, force, 0)
        if c.quantity == "force"
        else motion(
            c.name,
            moved(s.channel_rows[c.name], *residual.channels.get(c.name, (0.0, 0.0))),
            DERIVATIVES[c.quantity],
        )
        for c in problem.rig.channels
    }
    zero_mean = slip_samples - slip_samples.mean(axis=0)
    u, T, R = (solution[name].samples for name in ("slip", "friction", "normal"))
    return channels | {
        "drive": motion("drive", moved(s.excitation, residual.drive_by_force, residual.slip_by_force), 0),
        "slip": ChannelSensitivity(slip, slip_samples, _largest(u - u.mean(), zero_mean)),
        "slip_velocity": motion("slip_velocity", slip, 1),
        "friction": ChannelSensitivity(friction, change.friction, _largest(T, change.friction)),
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
