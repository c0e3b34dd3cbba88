"""The compiled step: one implicit time step as a CasADi function, and its derivative.

The friction T at the end of a step moves the contact by kappa T, kappa > 0 the compliance of the step. The law
(:meth:`models.FrictionLaw.advance`) sees the contact with that displacement, and one Newton iteration after the
other closes T = law(T); for a set-valued law kappa is folded into the series compliance instead, and its return
mapping gives T at once. A second pass takes the foreshortening of the displacement found. The residual of the
implicit relation, evaluated with the final displacement, is an output of every step.

Nonlinear elements are linearised about the last motion found in every pass: what they do to the motion is then affine
in T, and the law sees it as another free motion and another compliance. The passes are Newton's method on both.
"""

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from hbm.aft.step import Form, law_step
from hbm.balance.elements import Described, symbolic_forces
from models import FrictionLaw
from models.friction import parameters
from models.structure import Array

NEWTON = (5, 1)  # iterations on T; again with the foreshortening of the new q, which differs by some 1e-7
NEWTON_BESIDE_ELEMENTS = (5, 1, 1)


@dataclass(frozen=True)
class Shape:
    """Choices that decide the instructions of a step; everything else is a run-time parameter.

    Attributes
    ----------
    form, states : Form, int
        Class and settings of the friction law, and the length of what it remembers.
    modes : int
    foreshortened, reaction_varies : bool
        Whether G and the rows of the reaction differ from zero.
    dissipative : bool
        Whether the friction force is delayed by a fraction of a step, see :func:`hbm.integration.timestep.weights`.
    elements : Described
        Nonlinear elements.
    law : FrictionLaw
        Any law of that form.
    """

    form: Form
    states: int
    modes: int
    foreshortened: bool
    reaction_varies: bool
    dissipative: bool
    elements: Described
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
        sizes = dict.fromkeys(rows, n) | dict.fromkeys(("dt", "delay", "compliance", "load", "slip_by_force"), 1)
        if self.foreshortened:
            sizes |= {"shortening": n * n}
        if self.reaction_varies:
            sizes |= {"R_q": n, "R_v": n, "eta_q": n, "eta": 1, "R_force": 1}
        if self.elements:
            r, _, _, numbers = (part.size1() for part in symbolic_forces(self.elements)[1])
            sizes |= dict.fromkeys((f"element_{name}" for name in ("q_old", "q_new", "v_old", "v_new")), n)
            sizes |= dict.fromkeys(("element_reaction", "element_weight", "element_by_force"), r)
            sizes |= {"element_rows": r * n, "element_numbers": numbers, "force_per_modal": 1}
        return sizes


def _contact_equation(shape: Shape) -> tuple[ca.Function, bool]:
    """T - law(T) with its derivative and the law's new state, as a function of the contact's scalars.

    A set-valued law gets the step's compliance as a series compliance, any other the displacement itself.
    Returns also whether the law gives T in one evaluation.
    """
    step, law_parameters = law_step(shape.law), ca.SX.sym("p", len(parameters(shape.law)))
    memory, s = ca.SX.sym("z", shape.states), ca.SX.sym("s", 10)
    T, u, kappa, v, kappa_v, rho, eta, C, P, dt = ca.vertsplit(s)
    folded = kappa if shape.law.set_valued else 0.0
    z, before = step.recall(memory, P)
    seen = ca.vertcat(u + (kappa - folded) * T, v + kappa_v * T, rho, eta)
    force, z_new = step.function(T, z, before, C, seen, ca.vertcat(C + folded, P, dt), law_parameters)
    residual = T - force
    slope = ca.jacobian(residual, T)
    kept = step.memory(z_new, ca.vertcat(u + kappa * T, v + kappa_v * T, rho, eta), T, P)
    return ca.Function("contact", [s, memory, law_parameters], [residual, slope, kept]), bool(slope.is_constant())


@dataclass(frozen=True, eq=False)
class _Mechanics:
    """The structure as the contact sees it, in symbols: run-time parameters `p`, force and force rate at the end."""

    shape: Shape
    p: dict[str, ca.SX]
    F: ca.SX
    F_rate: ca.SX

    def _shortening(self, q: ca.SX) -> ca.SX:
        return ca.reshape(self.p["shortening"], self.shape.modes, self.shape.modes) @ q

    def direction(self, q: ca.SX) -> ca.SX:
        """du/dq = c - G q."""
        row = self.p["slip_row"]
        return row - self._shortening(q) if self.shape.foreshortened else row

    def pushed(self, row: ca.SX, v: ca.SX) -> ca.SX:
        """du/dq at the instant that the friction force of the scheme stands for, `delay` steps before `row`."""
        if not (self.shape.foreshortened and self.shape.dissipative):
            return row
        return row + self.p["delay"] * self.p["dt"] * self._shortening(v)

    def slip(self, q: ca.SX) -> ca.SX:
        """Modal slip, c.q - q'Gq / 2 and what the force brings by itself."""
        return ca.dot(self.p["slip_row"] + self.direction(q), q) / 2.0 + self.p["slip_by_force"] * self.F

    def slip_velocity(self, row: ca.SX, v: ca.SX) -> ca.SX:
        """Rate of the modal slip where du/dq is `row`."""
        return ca.dot(row, v) + self.p["slip_by_force"] * self.F_rate

    def reaction(self, q: ca.SX, v: ca.SX) -> ca.SX:
        """R without the part due to T itself."""
        p = self.p
        if not self.shape.reaction_varies:
            return p["load"]
        return p["load"] + p["R_force"] * self.F - ca.dot(p["R_q"], q) - ca.dot(p["R_v"], v)

    def lever(self, q: ca.SX) -> Any:
        """dR/dT at given motion."""
        return self.p["eta"] + ca.dot(self.p["eta_q"], q) if self.shape.reaction_varies else 0.0

    def lever_through(self, q: ca.SX, q_gain: ca.SX, v_gain: ca.SX) -> Any:
        """dR/dT with the motion that T causes within the step."""
        if not self.shape.reaction_varies:
            return 0.0
        return self.lever(q) - ca.dot(self.p["R_q"], q_gain) - ca.dot(self.p["R_v"], v_gain)


@dataclass(frozen=True, eq=False)
class _Elements:
    """Forces of the nonlinear elements on the modes, in symbols, and last what they add to the reaction, (n+1,).

    `start` and `end` are the excitation at both ends of the step.
    """

    shape: Shape
    p: dict[str, ca.SX]
    start: ca.SX
    end: ca.SX

    @cached_property
    def _forces(self) -> ca.Function:
        """(q, v, excitation, run-time parameters) -> forces and their derivatives to q and v."""
        n = self.shape.modes
        force, (y, y_t, weight, numbers) = symbolic_forces(self.shape.elements)
        q, v, F = ca.SX.sym("q", n), ca.SX.sym("v", n), ca.SX.sym("F")
        reaction, by_force = (ca.SX.sym(name, y.size1()) for name in ("reaction", "by_force"))
        rows = ca.SX.sym("rows", y.size1(), n)
        onto = ca.horzcat(rows, reaction).T
        slopes = [onto @ ca.jacobian(force, of) @ rows for of in (y, y_t)]
        outputs = ca.substitute([onto @ force, *slopes], [y, y_t], [rows @ q + by_force * F, rows @ v])
        return ca.Function("elements", [q, v, F, rows, reaction, weight, by_force, numbers], outputs)

    def at(self, q: ca.SX, v: ca.SX, F: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Forces (n+1,) and their derivatives (n+1, n) to q and v."""
        p, n = self.p, self.shape.modes
        rows = ca.reshape(p["element_rows"], p["element_rows"].size1() // n, n)
        held = (p[f"element_{name}"] for name in ("reaction", "weight", "by_force", "numbers"))
        forces, by_q, by_v = self._forces(q, v, F, rows, *held)
        return forces, by_q, by_v

    def started(self, q: ca.SX, v: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Parts of q and v at the end of a step that the forces at its start add."""
        forces = self.at(q, v, self.start)[0][: self.shape.modes]
        return self.p["element_q_old"] * forces, self.p["element_v_old"] * forces

    def kept(self, q: ca.SX, v: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Parts that equal forces at the end add."""
        forces = self.at(q, v, self.end)[0][: self.shape.modes]
        return self.p["element_q_new"] * forces, self.p["element_v_new"] * forces

    def through(self, q: ca.SX, v: ca.SX, q_end: ca.SX, v_end: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        """Columns of q, v, forces on the modes and addition to the reaction with the forces at the end of the step.

        Parameters
        ----------
        q, v : (n, 2) SX
            Without them: free motion, and per friction force.
        q_end, v_end : (n,) SX
            Where the forces are linearised.
        """
        n, p = self.shape.modes, self.p
        forces, by_q, by_v = self.at(q_end, v_end, self.end)
        q_new, v_new = p["element_q_new"], p["element_v_new"]
        matrix = ca.SX.eye(n) - by_q[:n, :] @ ca.diag(q_new) - by_v[:n, :] @ ca.diag(v_new)
        fixed = ca.horzcat(forces - by_q @ q_end - by_v @ v_end, ca.SX.zeros(n + 1))
        modal = ca.solve(matrix, fixed[:n, :] + by_q[:n, :] @ q + by_v[:n, :] @ v)
        q, v = q + ca.diag(q_new) @ modal, v + ca.diag(v_new) @ modal
        return q, v, modal, fixed[n, :] + by_q[n, :] @ q + by_v[n, :] @ v


@dataclass(frozen=True)
class _Step:
    """Symbolic step.

    Attributes
    ----------
    x, T, end, drive, p : SX
        Inputs: state, guesses of the friction force and of the motion at the end of the step, drive, parameters.
    predicted : SX
        A guess of the motion, by the guess of the friction force.
    state, force, residual : SX
        Outputs.
    """

    x: ca.SX
    T: ca.SX
    end: ca.SX
    drive: ca.SX
    p: ca.SX
    predicted: ca.SX
    state: ca.SX
    force: ca.SX
    residual: ca.SX


def _step(shape: Shape, iterations: tuple[int, ...]) -> _Step:
    n, layout = shape.modes, shape.layout
    x, guess, drive = ca.SX.sym("x", shape.size), ca.SX.sym("T0"), ca.SX.sym("drive", 2 * n + 3)
    end = ca.SX.sym("end", 2 * n)
    parts = [ca.SX.sym(name, size) for name, size in layout.items()]
    p = dict(zip(layout, parts, strict=True))
    law_parameters = ca.SX.sym("law", len(parameters(shape.law)))
    q, v, held, z = x[:n], x[n : 2 * n], x[2 * n], x[2 * n + 1 :]
    mechanics = _Mechanics(shape, p, drive[2 * n], drive[2 * n + 1])
    elements = _Elements(shape, p, drive[2 * n + 2], drive[2 * n]) if shape.elements else None
    contact, explicit = _contact_equation(shape)
    constants = [p["compliance"], p["load"], p["dt"]]
    # (1 + delay) held_new = T + delay held
    lag = p["delay"] / (1.0 + p["delay"]) if shape.dissipative else 0.0
    gain = 1.0 / (1.0 + p["delay"]) if shape.dissipative else 1.0

    pushed = mechanics.pushed(mechanics.direction(q), v)
    q_free = p["qq"] * q + p["qv"] * v + p["q_old"] * pushed * held + drive[:n]
    v_free = p["vq"] * q + p["vv"] * v + p["v_old"] * pushed * held + drive[n : 2 * n]
    predicted = ca.vertcat(q_free + p["q_new"] * pushed * guess, v_free + p["v_new"] * pushed * guess)
    if elements is not None:
        started = elements.started(q, v)
        q_free, v_free = q_free + started[0], v_free + started[1]
        predicted += ca.vertcat(*started) + ca.vertcat(*elements.kept(q, v))
    q_end, v_end = end[:n], end[n:]
    T, row, kappa, modal = guess, pushed, ca.SX(0.0), ca.SX.zeros(n)
    for newton in iterations if shape.foreshortened or shape.elements else iterations[:1]:
        row = mechanics.direction(q_end)
        pushed = mechanics.pushed(row, v_end)
        q_gain, v_gain = p["q_new"] * pushed, p["v_new"] * pushed
        q_base, v_base = q_free + lag * held * q_gain, v_free + lag * held * v_gain
        q_gain, v_gain = gain * q_gain, gain * v_gain
        rho, rho_gain, forces = 0.0, 0.0, ca.SX.zeros(n, 2)
        if elements is not None:
            both = ca.horzcat(q_base, q_gain), ca.horzcat(v_base, v_gain)
            q_both, v_both, forces, added = elements.through(*both, q_end, v_end)
            (q_base, q_gain), (v_base, v_gain) = ca.horzsplit(q_both), ca.horzsplit(v_both)
            rho, rho_gain = added[0], added[1]
        kappa = ca.dot(row, q_gain)
        u = mechanics.slip(q_end) + ca.dot(row, q_base - q_end)  # linearised about the last q
        known = [u, kappa, mechanics.slip_velocity(row, v_base), ca.dot(row, v_gain)]
        known += [mechanics.reaction(q_base, v_base) + rho, mechanics.lever_through(q_end, q_gain, v_gain) + rho_gain]
        for _ in range(1 if explicit else newton):
            residual, slope, _ = contact(ca.vertcat(T, *known, *constants), z, law_parameters)
            T = T - residual / slope
        q_end, v_end, modal = q_base + q_gain * T, v_base + v_gain * T, forces[:, 0] + forces[:, 1] * T

    final = mechanics.direction(q_end)
    rho, missed = 0.0, 0.0
    if elements is not None:
        pushes, _, _ = elements.at(q_end, v_end, elements.end)
        rho, missed = pushes[n], p["force_per_modal"] * ca.norm_inf(pushes[:n] - modal)
    # the contact equation adds kappa T to the slip
    known = [mechanics.slip(q_end) - kappa * T, kappa, mechanics.slip_velocity(final, v_end), 0.0]
    known += [mechanics.reaction(q_end, v_end) + rho, mechanics.lever(q_end)]
    residual, _, z_new = contact(ca.vertcat(T, *known, *constants), z, law_parameters)
    turned = ca.sum1(ca.fabs(final - row)) / ca.sum1(ca.fabs(row)) if shape.foreshortened else 0.0
    return _Step(
        x=x,
        T=guess,
        end=end,
        drive=drive,
        p=ca.vertcat(*parts, law_parameters),
        predicted=predicted,
        state=ca.densify(ca.vertcat(q_end, v_end, gain * T + lag * held, z_new)),
        force=ca.densify(T),
        residual=ca.densify(ca.fabs(residual) + ca.fabs(T) * turned + missed),
    )


FEW_MODES = 12
"""Modes up to which the derivative of a step is one expression, the faster to evaluate and the slower to make."""


@lru_cache(maxsize=32)
def _advance(shape: Shape) -> ca.Function:
    """Function (state, drive, parameters) -> (state, T, residual) of one step, the same for any number of them."""
    s = _step(shape, NEWTON_BESIDE_ELEMENTS if shape.elements else NEWTON)
    outputs = ca.substitute([s.state, s.force, s.residual], [s.end], [s.predicted])
    outputs = ca.substitute(outputs, [s.T], [s.x[2 * shape.modes]])
    return ca.Function("step", [s.x, s.drive, s.p], outputs, {"cse": True})


@lru_cache(maxsize=32)
def marcher(shape: Shape, steps: int) -> ca.Function:
    """Function (state, drive, parameters) -> (states, T, residual) over `steps` steps."""
    step = _advance(shape)
    start, drives = ca.MX.sym("x", step.size1_in(0)), ca.MX.sym("d", step.size1_in(1), steps)
    values = ca.MX.sym("p", step.size1_in(2))
    marched = step.mapaccum(steps)(start, drives, ca.repmat(values, 1, steps))
    return ca.Function("march", [start, drives, values], marched)


@lru_cache(maxsize=32)
def _derivative(shape: Shape) -> ca.Function:
    """Function (state, T, end, drive, parameters) -> derivative of one step to the state that it starts at.

    One Newton iteration from a solution has the derivative of the solution.
    """
    s = _step(shape, (1, 1))
    arguments = [s.x, s.T, s.end, s.drive, s.p]
    if shape.modes <= FEW_MODES:
        jacobian = ca.densify(ca.jacobian(s.state, s.x))
        return ca.Function("jacobian", arguments, [jacobian], {"cse": True})
    return _by_columns(ca.Function("step", arguments, [s.state], {"cse": True}))


@lru_cache(maxsize=32)
def lineariser(shape: Shape, steps: int) -> ca.Function:
    """Jacobians of `steps` steps from the states they start at, and the friction and the motion they end with."""
    step = _derivative(shape)
    inputs = [ca.MX.sym("i", step.size1_in(i), steps) for i in range(step.n_in() - 1)]
    values = ca.MX.sym("p", step.size1_in(step.n_in() - 1))
    return ca.Function("linearise", [*inputs, values], [step.map(steps)(*inputs, ca.repmat(values, 1, steps))])


def _by_columns(step: ca.Function) -> ca.Function:
    """Derivative of a function to its first argument, column by column: its expression does not grow with its size."""
    given = [ca.MX.sym("i", step.size1_in(i)) for i in range(step.n_in())]
    size = step.size1_in(0)
    still = [ca.DM.zeros(part.shape[0], size) for part in given[1:]]
    told = [ca.repmat(part, 1, size) for part in (*given, step(*given))]
    return ca.Function("jacobian", given, [step.forward(1).map(size)(*told, ca.DM.eye(size), *still)])


def evaluate(function: ca.Function, *arguments: Array) -> list[Array]:
    """Outputs of a dense CasADi function in its own memory order, without the copies of an ordinary call.

    A (rows, columns) matrix of CasADi is a (columns, rows) array here, for arguments and outputs alike.
    """
    buffer, call = function.buffer()
    inputs = [np.ascontiguousarray(a, dtype=float) for a in arguments]
    outputs = [np.empty(function.size_out(i)[::-1]) for i in range(function.n_out())]
    for i, array in enumerate(inputs):
        if array.size != function.nnz_in(i):
            raise ValueError(f"{function.name()}: argument {i} has {array.size} values; must have {function.nnz_in(i)}")
        buffer.set_arg(i, array.data)
    for i, array in enumerate(outputs):
        buffer.set_res(i, array.data)
    call()
    return outputs
