"""Marching a batch of records through time: modes exactly for forces linear over a step, friction solved in each step.

Arrays are (records, copies, ...): every record has its own time step and perhaps its own rig, and is marched in
several copies at once, which shooting needs. Modes without inertia, and those too fast for the step, follow the
forces statically.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tests.truth.beam import Reduced
from tests.truth.effects import Motion
from tests.truth.laws import Trial, side_by_side
from tests.truth.rig import TrueRig

Array = np.ndarray
FASTEST = 1.3  # omega dt of the fastest mode that is given its inertia
TRIALS = 60


@dataclass(frozen=True)
class State:
    """What the system remembers: coordinates and rates (records, copies, n), memory of the law and of the effects."""

    q: Array
    v: Array
    law: Array
    hidden: Array

    def map(self, pick) -> "State":
        return State(pick(self.q), pick(self.v), pick(self.law), pick(self.hidden))


@dataclass(frozen=True)
class Instant:
    """The system at the end of a step; T, R, u, slip velocity of the modes v_slip (records, copies), forces p."""

    state: State
    p: Array
    Gq: Array
    T: Array
    R: Array
    u: Array
    v_slip: Array
    rest: Array
    T_before: Array
    trials: int = 0
    mismatch: float = 0.0


def stack(items: Sequence[Reduced]) -> dict[str, Array]:
    """Fields of the reduced structures, (records or 1, ...)."""
    return {name: np.array([getattr(item, name) for item in items]) for name in Reduced.__dataclass_fields__}


def largest(sizes: Array) -> float:
    """Largest size, of the records that have not run away: they are given up, the others go on."""
    return float(np.fmax.reduce(sizes, axis=None, initial=0.0))


def transition(omega2: Array, d: Array, dt: Array) -> tuple[Array, ...]:
    """Exact step of q'' + d q' + omega2 q = p, p linear: (q from q, v, p0, p1; v from the same)."""
    a = d / 2
    wd = np.sqrt(omega2 - a**2)
    decay = np.exp(-a * dt)
    C, S = decay * np.cos(wd * dt), decay * np.sin(wd * dt) / wd
    qq, qv, vq, vv = C + a * S, S, -omega2 * S, C - a * S
    q1 = (dt * omega2 - d + qq * d - qv * omega2) / (dt * omega2**2)
    v1 = (1 + vq * d / omega2 - vv) / (dt * omega2)
    return qq, qv, (1 - qq) / omega2 - q1, q1, vq, vv, S - v1, v1


def newmark(omega2: Array, d: Array, dt: Array, beta: float = 1 / 12) -> tuple[Array, ...]:
    """The same by Newmark's rule with gamma 1/2: no damping of its own, and stable for omega dt < 2.4.

    Its frequencies are of fourth order. Those of the trapezoidal rule, beta 1/4, are of second: at 1024 steps a sharp
    mode at three times the excitation then moved the response by 0.5 %, more than most backgrounds.
    """
    early, late = dt**2 * (0.5 - beta), dt**2 * beta
    c, D = d * dt / 2 + omega2 * early, 1 + d * dt / 2 + omega2 * late
    first = (-omega2, -d, 1.0, 0.0)  # acceleration at the beginning from q, v, p0, p1; then at the end
    last = ((c - 1) * omega2 / D, ((c - 1) * d - omega2 * dt) / D, -c / D, 1 / D)
    q = [early * a + late * b for a, b in zip(first, last, strict=True)]
    v = [dt / 2 * (a + b) for a, b in zip(first, last, strict=True)]
    return 1 + q[0], dt + q[1], q[2], q[3], v[0], 1 + v[1], v[2], v[3]


class Batch:
    """Rigs, frequencies and the number of steps of a period, ready to march."""

    def __init__(
        self,
        rigs: Sequence[TrueRig],
        omega: Array,
        lag: Array,
        steps: int,
        tolerance: float = 1e-12,
        reduced: dict[str, Array] | None = None,
    ) -> None:
        """`lag` of the force in periods; `tolerance`, of P, is that of the friction force in each step.

        `reduced`: the rigs' reduced structures, stacked, where they are known.
        """
        self.rigs, self.steps, self.omega, self.lag, self.tolerance = rigs, steps, omega, lag, tolerance
        self.rig, self.law = rigs[0], side_by_side([rig.law for rig in rigs])
        m = self.m = stack([rig.reduced() for rig in rigs]) if reduced is None else reduced
        self.dt = (2 * np.pi / omega / steps)[:, None]
        self.dynamic = (m["inertia"] > 0) & (np.sqrt(m["omega2"]) * self.dt < FASTEST)
        static = 1.0 / np.broadcast_to(m["omega2"], self.dynamic.shape)
        exactly, ruled = (f(m["omega2"], m["damping"], self.dt) for f in (transition, newmark))
        rule = np.array([[rig.newmark] for rig in rigs])
        steps_of = [np.where(rule, a, b) for a, b in zip(ruled, exactly, strict=True)]
        fallback = (0.0, 0.0, 0.0, static, 0.0, 0.0, 0.0, 0.0)
        exact = [np.where(self.dynamic, a, b)[:, None] for a, b in zip(steps_of, fallback, strict=True)]
        self.qq, self.qv, self.q0, self.q1, self.vq, self.vv, self.v0, self.v1 = exact
        self.P = np.array([[rig.normal_load] for rig in rigs])
        self.scale = np.array([[rig.variable_normal_load] for rig in rigs])
        self.axial = m["axial"][:, None]
        self._contact_rows()
        rows = m["rows"]
        self.hidden = [effect for effect in self.rig.effects if effect.nonlinear]
        self.row_flexibility = (rows**2 * self.q1).sum(axis=-1)[:, None]
        self.row_count = [len(effect.rows(self.rig.complete())) for effect in self.rig.effects if effect.nonlinear]

    def _contact_rows(self) -> None:
        """Rows that read slip, reaction and the rest's slip from q, v and p, and their answers to T in a step."""
        m, dynamic = self.m, self.dynamic
        c, tip = m["contact"] + 0 * dynamic, np.where(dynamic, m["tip_mass_row"], 0.0)
        q_row = m["tip_stiffness_row"] - tip * m["omega2"]
        v_row = np.where(dynamic, m["tip_damping_row"] - tip * m["damping"], 0.0)
        self.q_rows = np.stack([c, q_row, m["tip_geometric_row"] + 0 * c, np.where(dynamic, 0.0, c)], axis=-1)
        self.v_rows = np.stack([c, v_row], axis=-1)
        self.p_row = tip[..., None]
        q1, v1 = self.q1[:, 0], self.v1[:, 0]
        rest_T = (np.where(dynamic, 0.0, c**2 * q1)).sum(axis=1, keepdims=True) + self.axial
        self.u_T = (c**2 * q1).sum(axis=1, keepdims=True) + self.axial
        self.v_T = (c**2 * v1).sum(axis=1, keepdims=True)
        self.w_T = self.v_T + rest_T / self.dt
        self.R_T = self.scale * (c * (tip + q_row * q1 + v_row * v1)).sum(axis=1, keepdims=True)

    def rest_state(self, copies: int = 1) -> State:
        """At rest and unloaded."""
        shape = (len(self.omega), copies)
        n = self.m["omega2"].shape[1]
        memory = sum(effect.states for effect in self.hidden)
        return State(
            np.zeros((*shape, n)),
            np.zeros((*shape, n)),
            np.zeros((*shape, self.law.states)),
            np.zeros((*shape, memory)),
        )

    def select(self, keep: Array) -> "Batch":
        """The same batch with some of its records."""
        rigs, reduced = self.rigs, self.m
        if len(rigs) > 1:
            rigs, reduced = [rigs[i] for i in np.flatnonzero(keep)], {name: a[keep] for name, a in self.m.items()}
        return Batch(rigs, self.omega[keep], self.lag[keep], self.steps, self.tolerance, reduced)

    def _effects(self, q: Array, v: Array, Gq: Array, phase: float, start: Array, tried: Array, soft: Array, dt: Array):
        """Generalised force, extra tension, extra part of R and new memory of the hidden effects."""
        if not self.hidden:
            return 0.0, 0.0, 0.0, start
        rows = self.m["rows"]
        y, y_rate = q @ rows.swapaxes(1, 2), v @ rows.swapaxes(1, 2)
        phase = phase - self.lag[:, None]
        forces, memory, tension, r, s = [], [], 0.0, 0, 0
        for effect, count in zip(self.hidden, self.row_count, strict=True):
            at = Motion(y[..., r : r + count], y_rate[..., r : r + count], q, Gq, phase, soft[..., r : r + count], dt)
            part = slice(s, s + effect.states)
            force, kept = effect.forces(at, start[..., part], tried[..., part])
            forces.append(force)
            memory.append(kept[..., : effect.states])
            tension = tension + effect.tension(at)
            r, s = r + count, s + effect.states
        force = np.concatenate(forces, axis=-1)
        at_tip = -(force @ self.m["tip_loads"][..., None])[..., 0]
        return force @ rows, tension, at_tip, np.concatenate(memory, axis=-1)

    def begin(self, state: State, F: Array) -> Instant:
        """The instant that belongs to a remembered state: the static modes and forces follow from it."""
        m, T = self.m, self.law.force(state.law)
        q, v = np.where(self.dynamic[:, None], state.q, 0.0), np.where(self.dynamic[:, None], state.v, 0.0)
        still, soft = np.where(self.dynamic[:, None], 0.0, 1.0 / m["omega2"][:, None]), 0 * self.row_flexibility
        whole, Gq, driven = state.q, state.q @ m["G"], self._driven(F)
        for _ in range(8):
            push, tension, at_tip, _ = self._effects(whole, v, Gq, 0.0, state.hidden, state.hidden, soft, 0 * self.dt)
            p = self._forces(driven, T, tension, Gq) + push
            whole = q + still * p
            Gq = whole @ m["G"]
        u, v_slip, R, rest = self._contact(whole, v, p, Gq, T, tension, at_tip)
        return Instant(replace(state, q=whole, v=v), p, Gq, T, R, u, v_slip, rest, T)

    def _forces(self, driven: Array, T: Array, tension: Array | float, Gq: Array) -> Array:
        """Forces on the modes; `driven` are those of the excitation."""
        p = self.m["contact"][:, None] - Gq
        p *= T[..., None]
        p += driven
        return p - np.asarray(tension)[..., None] * Gq if self.hidden else p

    def _driven(self, F: Array) -> Array:
        return F[..., None] * self.m["drive"][:, None]

    def _contact(self, q, v, p, Gq, T, tension, at_tip) -> tuple[Array, Array, Array, Array]:
        """Slip, slip velocity of the modes, reaction, and the slip of what has no inertia."""
        from_q, from_v = q @ self.q_rows, v @ self.v_rows
        u = from_q[..., 0] - np.einsum("rci,rci->rc", q, Gq) / 2 + self.axial * T
        v_slip = from_v[..., 0] - np.einsum("rci,rci->rc", v, Gq)
        R = self.P + (p @ self.p_row)[..., 0] + from_q[..., 1] + from_v[..., 1] + (T + tension) * from_q[..., 2]
        return u, v_slip, R + at_tip, from_q[..., 3] + self.axial * T

    def normal(self, R: Array) -> Array:
        """What the friction law is given for the reaction."""
        return self.P + self.scale * (R - self.P)

    def advance(self, now: Instant, F: Array, phase: float) -> Instant:
        """One step; F (records, 1) and the phase at its end."""
        m, law, old = self.m, self.law, now.state
        q0 = self.qq * old.q + self.qv * old.v + self.q0 * now.p
        v0 = self.vq * old.q + self.vv * old.v + self.v0 * now.p
        T, Gq, p, memory = 2 * now.T - now.T_before, now.Gq, now.p, old.hidden
        q, v, push, tension = q0 + self.q1 * p, v0 + self.v1 * p, 0.0, 0.0
        R_old, tolerance = self.normal(now.R), self.tolerance * self.P
        ones, driven = np.ones_like(T), self._driven(F)
        answers = [row * ones for row in (self.u_T, self.v_T, self.w_T, self.R_T)]
        for trial in range(1, TRIALS + 1):
            before = push
            push, tension, at_tip, memory = self._effects(
                q, v, Gq, phase, old.hidden, memory, self.row_flexibility, self.dt
            )
            p = self._forces(driven, T, tension, Gq)
            p += push
            q, v = self.q1 * p, self.v1 * p  # in place from here on: new arrays cost more than what is done with them
            q += q0
            v += v0
            Gq = q @ m["G"]
            u, v_slip, R, rest = self._contact(q, v, p, Gq, T, tension, at_tip)
            w = v_slip + (rest - now.rest) / self.dt
            at = Trial(
                u - now.u, v_slip, w, self.normal(R), now.v_slip, R_old, self.dt, self.P,
                *answers, u,
            )  # fmt: skip
            remembered, slope = law.advance(old.law, at)
            change = (law.force(remembered) - T) / np.maximum(1.0 - slope, 0.3)
            mismatch = np.abs(change) / tolerance
            T = T + change
            worst = largest(mismatch)
            if self.hidden and trial > 1:
                worst = max(worst, 0.01 * largest(np.abs(push - before) / tolerance[..., None]))
            if worst < 1.0 and trial > 1:
                break
        return Instant(State(q, v, remembered, memory), p, Gq, T, R, u, v_slip, rest, now.T, trial, worst)

    def acceleration(self, now: Instant) -> Array:
        """q'' of the modes with inertia."""
        m = self.m
        free = now.p - m["damping"][:, None] * now.state.v - m["omega2"][:, None] * now.state.q
        return np.where(self.dynamic[:, None], free, 0.0)

    def period(self, state: State, force: Array) -> State:
        """State one period on under the force (records, steps + 1)."""
        now = self.begin(state, force[:, :1])
        for i in range(1, self.steps + 1):
            now = self.advance(now, force[:, i : i + 1], i / self.steps)
        return now.state
