"""One implicit time step of a rig, exact for its linear modes, with the friction law solved at its end.

Each mode is propagated exactly under the cosine force and under a generalised friction force that is linear
over the step. The friction at the end of the step then moves the contact by an amount proportional to it: the
step's own compliance kappa stands in series with the contact and the law's return mapping does the rest
(:meth:`models.FrictionLaw.advance`). What remains implicit, limits that depend on the slip velocity and the
foreshortening, is solved by a fixed number of Newton iterations whose residual every step returns.

Start with :class:`Stepper`: a rig at one frequency and step, ready to march.
"""

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np
from scipy.linalg import expm

from models import ContactSample, FrictionLaw, Rig
from models.friction import parameters, with_symbols
from models.structure import Array, ModalStructure

NEWTON_ITERATIONS = 5  # a piecewise linear law needs 3; smooth ones converge quadratically from the last force
LINEARISATIONS = 2  # of the foreshortening, whose change over a step is of the order of 1e-7
GROWTH_TOLERANCE = 1e-7  # per step about rest
RESIDUAL_TOLERANCE = 1e-8  # of the largest force
DISSIPATION = (None, 0.8, 0.5, 0.2, 0.0)  # spectral radii tried in turn, None: linear interpolation


@dataclass(frozen=True)
class Shape:
    """What decides the instructions of a step; everything else is a run-time parameter.

    Attributes
    ----------
    law_type, states : type, int
        Class of the friction law and its number of internal states.
    modes : int
    foreshortened, reaction_varies : bool
        Whether G and the rows of the reaction differ from zero.
    dissipative : bool
        Whether the friction force is delayed by a fraction of a step, see :func:`weights`.
    law : FrictionLaw
        Any law of that class.
    """

    law_type: type
    states: int
    modes: int
    foreshortened: bool
    reaction_varies: bool
    dissipative: bool
    law: FrictionLaw = field(compare=False)

    @property
    def size(self) -> int:
        """Length of the state vector (q, q', friction, z)."""
        return 2 * self.modes + 1 + self.states

    @property
    def layout(self) -> dict[str, int]:
        """Names and lengths of the run-time parameters, law parameters excluded."""
        n = self.modes
        rows = ("qq", "qv", "vq", "vv", "q_old", "q_new", "v_old", "v_new", "slip_row")
        sizes = dict.fromkeys(rows, n) | dict.fromkeys(("dt", "delay", "compliance", "load"), 1)
        if self.foreshortened:
            sizes |= {"shortening": n * n}
        if self.reaction_varies:
            sizes |= {"R_q": n, "R_v": n, "eta_q": n, "eta": 1, "R_force": 1}
        return sizes


def propagators(structure: ModalStructure, Omega: float, dt: float) -> Array:
    """Exact one-step maps of every mode.

    Parameters
    ----------
    structure : ModalStructure
    Omega : float
        Frequency of the force [rad/s].
    dt : float
        Step [s].

    Returns
    -------
    (n, 2, 6) array
        (q, q') at the end of the step from its inputs at the start: q [m], q' [m/s], a generalised force that
        stays [N], one that grows from 0 to 1 N over the step, and cos and sin of the phase of the unit force.
    """
    w, n = structure.omega_n, structure.n
    scale = np.maximum(w, 1.0 / dt)  # modal displacement as a velocity, so that all entries are of order one
    M = np.zeros((n, 6, 6))
    M[:, 0, 1] = scale * dt
    M[:, 1, 0] = -(w**2) / scale * dt
    M[:, 1, 1] = -structure.damping * dt
    M[:, 1, 2] = M[:, 1, 4] = M[:, 2, 3] = 1.0
    M[:, 4, 5], M[:, 5, 4] = -Omega * dt, Omega * dt
    E = np.asarray(expm(M))[:, :2]
    E[:, :, 2:] *= dt
    E[:, :, 0] *= scale[:, None]
    E[:, 0] /= scale[:, None]
    return E


def weights(E: Array, dt: float, radius: float | None) -> tuple[float, dict[str, Array]]:
    """Weights of the friction force at both ends of the step.

    Linear interpolation leaves a contact that sticks without compliance unstable: with q = q' + ... = 0 at the
    end of each step the force follows ``f_new = -6 q' / dt - 2 f_old``, spectral radius 2 + sqrt(3), like the
    linear acceleration method. Then the force is delayed by ``delay`` steps and its weight in q raised, which
    for slow modes is the generalised-alpha method of Wood, Bossak and Zienkiewicz; second order remains.

    Parameters
    ----------
    E : (n, 2, 6) array
        From :func:`propagators`.
    dt : float
        Step [s].
    radius : float or None
        Spectral radius of a rigid contact, 0..1; None for linear interpolation.

    Returns
    -------
    delay : float
        In steps.
    dict of str to (n,) array
        `q_old`, `q_new` [s2], `v_old`, `v_new` [s].
    """
    delay = 0.0 if radius is None else (1.0 - radius) / (1.0 + radius)
    raised = 0.0 if radius is None else (1.0 / 12.0 + delay**2 / 4.0) * dt**2
    hold, ramp = E[:, :, 2], E[:, :, 3]
    new = ramp + delay * hold
    new[:, 0] += raised
    old = hold - new
    return delay, {"q_old": old[:, 0], "v_old": old[:, 1], "q_new": new[:, 0], "v_new": new[:, 1]}


def _contact_equation(shape: Shape) -> tuple[ca.Function, bool]:
    """T - law(T) with its derivative and the law's new state, as a function of the contact's scalars.

    A set-valued law gets the step's compliance as a series compliance, any other the displacement itself.
    Returns also whether the law gives T in one evaluation.
    """
    law, law_parameters = with_symbols(shape.law)
    z = ca.SX.sym("z", shape.states)
    s = ca.SX.sym("s", 10)
    T, u, kappa, v, kappa_v, rho, eta, C, P, dt = ca.vertsplit(s)
    folded = kappa if law.set_valued else 0.0
    sample = ContactSample(u + (kappa - folded) * T, v + kappa_v * T, rho, eta, C + folded, P, dt)
    z_new, force = law.advance(z, sample)
    residual = T - force
    slope = ca.jacobian(residual, T)
    explicit = bool(slope.is_constant())
    return ca.Function("contact", [s, z, law_parameters], [residual, slope, z_new]), explicit


def _step(shape: Shape, *, linearisations: int, iterations: int) -> tuple[list[ca.SX], list[ca.SX]]:
    """Symbolic step: inputs (state, guess of T, drive, parameters), outputs (state, T, residual)."""
    n, layout = shape.modes, shape.layout
    x, guess, drive = ca.SX.sym("x", shape.size), ca.SX.sym("T0"), ca.SX.sym("drive", 2 * n + 1)
    parts = [ca.SX.sym(name, size) for name, size in layout.items()]
    p = dict(zip(layout, parts, strict=True))
    law_parameters = ca.SX.sym("law", len(parameters(shape.law)))
    q, v, held, z = x[:n], x[n : 2 * n], x[2 * n], x[2 * n + 1 :]
    contact, explicit = _contact_equation(shape)
    G = ca.reshape(p["shortening"], n, n) if shape.foreshortened else None
    lag = p["delay"] / (1.0 + p["delay"]) if shape.dissipative else 0.0
    gain = 1.0 / (1.0 + p["delay"]) if shape.dissipative else 1.0

    def direction(q: ca.SX, v: ca.SX) -> tuple[ca.SX, ca.SX]:
        """du/dq, now and a delay ago."""
        now = p["slip_row"] - G @ q if G is not None else p["slip_row"]
        ago = now + p["delay"] * p["dt"] * (G @ v) if G is not None and shape.dissipative else now
        return now, ago

    def reaction(q: ca.SX, v: ca.SX) -> ca.SX:
        """Part of R that is linear in the motion and the force."""
        if not shape.reaction_varies:
            return p["load"]
        return p["load"] + p["R_force"] * drive[2 * n] - ca.dot(p["R_q"], q) - ca.dot(p["R_v"], v)

    def lever(q: ca.SX) -> Any:
        return p["eta"] + ca.dot(p["eta_q"], q) if shape.reaction_varies else 0.0

    _, pushed = direction(q, v)
    q_free = p["qq"] * q + p["qv"] * v + p["q_old"] * pushed * held + drive[:n]
    v_free = p["vq"] * q + p["vv"] * v + p["v_old"] * pushed * held + drive[n : 2 * n]
    q_end, v_end = q_free + p["q_new"] * pushed * guess, v_free + p["v_new"] * pushed * guess
    T, row = guess, pushed
    kappa: Any = 0.0
    for _ in range(linearisations if shape.foreshortened else 1):
        row, pushed = direction(q_end, v_end)
        q_gain, v_gain = p["q_new"] * pushed, p["v_new"] * pushed
        q_base, v_base = q_free + lag * held * q_gain, v_free + lag * held * v_gain
        q_gain, v_gain = gain * q_gain, gain * v_gain
        # slip linearised about the last q: exact without foreshortening
        u = ca.dot(p["slip_row"] + row, q_end) / 2.0 + ca.dot(row, q_base - q_end)
        kappa = ca.dot(row, q_gain)
        eta = lever(q_end)
        if shape.reaction_varies:
            eta = eta - ca.dot(p["R_q"], q_gain) - ca.dot(p["R_v"], v_gain)
        known = [u, kappa, ca.dot(row, v_base), ca.dot(row, v_gain), reaction(q_base, v_base), eta]
        known += [p["compliance"], p["load"], p["dt"]]
        for _ in range(1 if explicit else iterations):
            residual, slope, _ = contact(ca.vertcat(T, *known), z, law_parameters)
            T = T - residual / slope
        q_end, v_end = q_base + q_gain * T, v_base + v_gain * T

    final, _ = direction(q_end, v_end)
    u = ca.dot(p["slip_row"] + final, q_end) / 2.0 - kappa * T  # the contact equation adds kappa T
    known = [u, kappa, ca.dot(final, v_end), 0.0, reaction(q_end, v_end), lever(q_end)]
    residual, _, z_new = contact(ca.vertcat(T, *known, p["compliance"], p["load"], p["dt"]), z, law_parameters)
    turned = ca.sum1(ca.fabs(final - row)) / ca.sum1(ca.fabs(row)) if shape.foreshortened else 0.0
    held = gain * T + lag * held
    outputs = [ca.vertcat(q_end, v_end, held, z_new), T, ca.fabs(residual) + ca.fabs(T) * turned]
    return [x, guess, drive, ca.vertcat(*parts, law_parameters)], outputs


@lru_cache(maxsize=32)
def _marcher(shape: Shape, steps: int) -> ca.Function:
    """Function (state, drive, parameters) -> (states, T, residual) over `steps` steps."""
    (x, guess, drive, p), outputs = _step(shape, linearisations=LINEARISATIONS, iterations=NEWTON_ITERATIONS)
    outputs = ca.substitute(outputs, [guess], [x[2 * shape.modes]])
    step = ca.Function("step", [x, drive, p], outputs, {"cse": True})
    start, drives, values = ca.MX.sym("x", x.shape[0]), ca.MX.sym("d", drive.shape[0], steps), ca.MX.sym("p", p.shape[0])
    return ca.Function("march", [start, drives, values], step.mapaccum(steps)(start, drives, ca.repmat(values, 1, steps)))


@lru_cache(maxsize=32)
def _linearised(shape: Shape, steps: int) -> ca.Function:
    """Jacobians of `steps` steps from the states they start at and the friction they end with.

    One Newton iteration from a solution has the derivative of the solution.
    """
    (x, T, drive, p), outputs = _step(shape, linearisations=LINEARISATIONS, iterations=1)
    jacobian = ca.densify(ca.jacobian(outputs[0], x))
    return ca.Function("jacobian", [x, T, drive, p], [jacobian], {"cse": True}).map(steps)


@dataclass(frozen=True, eq=False)
class Stepper:
    """A rig at one frequency, force amplitude and step: marches states (q, q', friction, z), flattened.

    Attributes
    ----------
    rig : Rig
    hz, level : float
        Frequency [Hz] and amplitude [N] of the cosine force.
    steps_per_period : int
    phase : float
        Phase of the force at step 0 [rad].
    radius : float or None
        See :func:`weights`.
    """

    rig: Rig
    hz: float
    level: float
    steps_per_period: int
    phase: float = 0.0
    radius: float | None = None

    @staticmethod
    def stable(rig: Rig, hz: float, level: float, steps_per_period: int, phase: float = 0.0) -> "Stepper":
        """Least dissipative stepper that is stable about rest, with the contact stuck.

        Raises
        ------
        ArithmeticError
            If none is; more steps per period resolve the modes that the rigid contact destabilises.
        """
        for radius in DISSIPATION:
            stepper = Stepper(rig, hz, level, steps_per_period, phase, radius)
            growth = stepper.growth
            if growth <= 1.0 + GROWTH_TOLERANCE:
                return stepper
        raise ArithmeticError(
            f"time step: {steps_per_period} steps per period let the stuck contact grow by {growth - 1.0:.1e} per step; "
            f"must be below {GROWTH_TOLERANCE:g}; try {2 * steps_per_period} steps or residual_compliance = true"
        )

    @property
    def dt(self) -> float:
        """Step [s]."""
        return 1.0 / (self.hz * self.steps_per_period)

    @cached_property
    def shape(self) -> Shape:
        """Key of the compiled step."""
        structure, law = self.rig.structure, self.rig.contact.law
        return Shape(
            law_type=type(law),
            states=law.states,
            modes=structure.n,
            foreshortened=bool(structure.shortening.any()),
            reaction_varies=structure.reaction.varies,
            dissipative=self.radius is not None,
            law=law,
        )

    @cached_property
    def _propagators(self) -> Array:
        return propagators(self.rig.structure, 2 * np.pi * self.hz, self.dt)

    @cached_property
    def parameters(self) -> Array:
        """Run-time parameters in the order of :attr:`Shape.layout`, then those of the law."""
        s, E = self.rig.structure, self._propagators
        delay, force_weights = weights(E, self.dt, self.radius)
        values: dict[str, Array | float] = {
            **force_weights,
            "qq": E[:, 0, 0],
            "qv": E[:, 0, 1],
            "vq": E[:, 1, 0],
            "vv": E[:, 1, 1],
            "slip_row": s.slip_row,
            "shortening": s.shortening.ravel(),
            "dt": self.dt,
            "delay": delay,
            "compliance": s.compliance,
            "load": self.rig.contact.normal_load,
            **_reaction_rows(s),
        }
        law = np.array(list(parameters(self.rig.contact.law).values()), dtype=float)
        return np.concatenate([np.atleast_1d(values[name]) for name in self.shape.layout] + [law])

    def drive(self, steps: int) -> Array:
        """Response of the modes to the force over each of `steps` steps, and the force at their ends, (2n+1, steps)."""
        theta = self.phase + 2 * np.pi * (np.arange(steps + 1) % self.steps_per_period) / self.steps_per_period
        start = np.stack([np.cos(theta[:-1]), np.sin(theta[:-1])])
        response = np.moveaxis(self._propagators[:, :, 4:], 1, 0) * self.rig.structure.excitation[:, None]
        return self.level * np.vstack([response.reshape(-1, 2) @ start, np.cos(theta[1:])])

    def march(self, x: Array, steps: int) -> tuple[Array, Array, float]:
        """Advance a state.

        Parameters
        ----------
        x : (size,) array
            State at step 0 of this stepper's phase, or a whole number of periods later.
        steps : int

        Returns
        -------
        X : (size, steps) array
            States at the end of each step.
        T : (steps,) array
            Friction force there [N].
        residual : float
            Largest residual of the implicit relation [N].

        Raises
        ------
        ArithmeticError
            If the relation is not solved, as where friction falls too fast with speed for the step.
        """
        X, T, residuals = (m.full() for m in _marcher(self.shape, steps)(x, self.drive(steps), self.parameters))
        residual = float(np.max(residuals))
        allowed = RESIDUAL_TOLERANCE * max(self.level, self.rig.contact.normal_load, float(np.max(np.abs(T))))
        if not residual <= allowed:  # also when not a number
            raise ArithmeticError(
                f"time step: contact residual {residual:.1e} N at {self.hz:g} Hz; must be below {allowed:.1e} N; "
                f"try more than {self.steps_per_period} steps per period"
            )
        return X, T[0], residual

    def linearised(self, x: Array, X: Array, T: Array) -> Array:
        """Jacobian of each step of a march from `x` that gave `X` and `T`, (steps, size, size)."""
        steps, size = len(T), len(x)
        before = np.column_stack([x, X[:, :-1]])
        J = _linearised(self.shape, steps)(before, T[None, :], self.drive(steps), self.parameters).full()
        return np.moveaxis(J.reshape(size, steps, size), 1, 0)

    @property
    def growth(self) -> float:
        """Spectral radius of one unforced step about rest."""
        x, T = np.zeros(self.shape.size), np.zeros(1)
        J = self.linearised(x, x[:, None], T)[0]
        return float(np.max(np.abs(np.linalg.eigvals(J))))


def _reaction_rows(structure: ModalStructure) -> dict[str, Array | float]:
    """R = P + R_force F - R_q.q - R_v.q' + T (eta + eta_q.q), with q'' from the equation of motion (4)."""
    r = structure.reaction
    return {
        "R_q": r.inertia * structure.omega_n**2,
        "R_v": r.inertia * structure.damping - r.damping,
        "R_force": float(r.inertia @ structure.excitation) - r.force_share,
        "eta": float(r.inertia @ structure.slip_row) - r.friction_lever,
        "eta_q": r.stretch - structure.shortening @ r.inertia,
    }
