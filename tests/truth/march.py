"""Marching a batch of records through time: modes exactly for forces linear over a step, friction solved in each step.

Arrays are (records, copies, ...): every record has its own time step and perhaps its own rig, and is marched in
several copies at once, which shooting needs. Modes without inertia, and those too fast for the step, follow the
forces statically.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from tests.truth.beam import Reduced
from tests.truth.effects import Motion
from tests.truth.laws import Trial, side_by_side
from tests.truth.rig import TrueRig

Array = np.ndarray
FASTEST = 1.3  # omega dt of the fastest mode that is given its inertia
TRIALS = 60
COLUMNS = 4  # that are read beside the pull and the effects' rows


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
    """The system at the end of a step; T, R, u, slip velocity of the modes v_slip (records, copies), forces p.

    `smooth`, and that of a step before, are the forces without those of hidden effects, which may come at once.
    """

    state: State
    p: Array
    smooth: Array
    smooth_before: Array
    T: Array
    R: Array
    u: Array
    v_slip: Array
    rest: Array
    T_before: Array
    trials: int = 0
    mismatch: float = 0.0


def pairs(a: State, b: State) -> list[tuple[Array, Array]]:
    return [(getattr(a, f.name), getattr(b, f.name)) for f in fields(State)]


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
        qq, qv, q0, q1, vq, vv, v0, v1 = exact
        self.kept = [np.stack(pair) for pair in ((qq, vq), (qv, vv), (q0, v0))]  # (q and v, records, 1, n)
        self.moved = np.stack([q1, v1])
        self.P = np.array([[rig.normal_load] for rig in rigs])
        self.scale = np.array([[rig.variable_normal_load] for rig in rigs])
        self.axial = m["axial"][:, None]
        self.hidden = [effect for effect in self.rig.effects if effect.nonlinear]
        self.row_flexibility = (m["rows"] ** 2 * q1).sum(axis=-1)[:, None]
        self.row_count = [len(effect.rows(self.rig.complete())) for effect in self.hidden]
        self._readings()

    def _readings(self) -> None:
        """What is read from q, v and p in one product each, and the answers of all of it to the forces of a step.

        Columns: -G q, to which the contact's row is added; then half the linear slip, the reaction, what tension adds
        to it and the rest's slip; then the effects' rows and their rates.
        """
        m, dynamic = self.m, self.dynamic
        records, n = dynamic.shape
        c, tip = m["contact"] + 0 * dynamic, np.where(dynamic, m["tip_mass_row"], 0.0)
        R_q = m["tip_stiffness_row"] - tip * m["omega2"]
        R_v = np.where(dynamic, m["tip_damping_row"] - tip * m["damping"], 0.0)
        nothing, rows = 0 * c, m["rows"].swapaxes(1, 2) + np.zeros((records, 1, 1))
        columns = np.array(
            [
                [c / 2, R_q, m["tip_geometric_row"] + nothing, np.where(dynamic, 0.0, c)],
                [nothing, R_v, nothing, nothing],
                [nothing, tip, nothing, nothing],
            ]
        )
        whole = np.zeros((3, records, n, n + COLUMNS + 2 * rows.shape[-1]))
        whole[0, ..., :n] = -m["G"]
        whole[..., n : n + COLUMNS] = np.moveaxis(columns, 1, -1)
        effects = whole[..., n + COLUMNS :]
        effects[0, ..., : rows.shape[-1]] = effects[1, ..., rows.shape[-1] :] = rows
        self.read, (q1, v1) = whole, self.moved[:, :, 0, :, None]
        self.answers = q1 * whole[0] + v1 * whole[1] + whole[2]
        self.turns = np.ascontiguousarray(self.answers[..., :n])
        self.stretches = self.moved[:, :, 0, :, None]
        self.contact = np.zeros((records, 1, whole.shape[-1]))
        self.contact[..., :n] = c[:, None]
        self.wide: tuple[Array, ...] = ()

    def _of_each_copy(self, copies: int) -> tuple[Array, ...]:
        """What moves q and v, and rows of the contact and the drive, repeated: products of equal shapes are cheap."""
        if not self.wide or self.wide[0].shape[2] != copies:
            narrow = (self.moved, self.contact, self.m["drive"][:, None] + 0 * self.moved[0])
            self.wide = tuple(np.repeat(a, copies, axis=-2) for a in narrow)
        return self.wide

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

    def _effects(self, q: Array, seen: Array, phase: float, start: Array, tried: Array, soft: Array, dt: Array):
        """Generalised force, extra tension, extra part of R and new memory of the hidden effects."""
        if not self.hidden:
            return 0.0, 0.0, 0.0, start
        n, rows = q.shape[-1], self.m["rows"]
        middle = n + COLUMNS + sum(self.row_count)
        Gq, y, y_rate = self.contact[..., :n] - seen[..., :n], seen[..., n + COLUMNS : middle], seen[..., middle:]
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
        force = forces[0] if len(forces) == 1 else np.concatenate(forces, axis=-1)
        at_tip = -(force @ self.m["tip_loads"][..., None])[..., 0]
        return force @ rows, tension, at_tip, np.concatenate(memory, axis=-1)

    def begin(self, state: State, F: Array) -> Instant:
        """The instant that belongs to a remembered state: the static modes and forces follow from it."""
        m, T = self.m, self.law.force(state.law)
        q, v = np.where(self.dynamic[:, None], state.q, 0.0), np.where(self.dynamic[:, None], state.v, 0.0)
        still, soft = np.where(self.dynamic[:, None], 0.0, 1.0 / m["omega2"][:, None]), 0 * self.row_flexibility
        whole, driven = state.q, F[..., None] * m["drive"][:, None]
        seen = whole @ self.read[0] + v @ self.read[1] + self.contact
        for _ in range(8):
            push, tension, at_tip, _ = self._effects(whole, seen, 0.0, state.hidden, state.hidden, soft, 0 * self.dt)
            p = self._forces(driven, T, seen[..., : q.shape[-1]], tension, push)
            whole = q + still * p
            seen = whole @ self.read[0] + v @ self.read[1] + p @ self.read[2] + self.contact
        u, v_slip, R, rest = self._contact(np.stack([whole, v]), seen, T, tension, at_tip)
        smooth = p - push if self.hidden else p
        return Instant(replace(state, q=whole, v=v), p, smooth, smooth, T, R, u, v_slip, rest, T)

    def _forces(self, driven: Array, T: Array, pull: Array, tension: Array | float, push: Array | float) -> Array:
        """Forces on the modes; `driven` are those of the excitation, `pull` is the row along which friction acts."""
        p = pull * T[..., None]
        p += driven
        if self.hidden:
            p -= np.asarray(tension)[..., None] * (self.contact[..., : p.shape[-1]] - pull)
            p += push
        return p

    def _contact(self, qv: Array, seen: Array, T: Array, tension, at_tip) -> tuple[Array, Array, Array, Array]:
        """Slip, slip velocity of the modes, reaction, and the slip of what has no inertia."""
        n, along = qv.shape[-1], self.axial * T
        u, v_slip = np.einsum("krci,rci->krc", qv, seen[..., :n])
        u = u / 2 + seen[..., n] + along
        R = self.P + seen[..., n + 1] + (T + tension) * seen[..., n + 2]
        return u, v_slip, R + at_tip, seen[..., n + 3] + along

    def normal(self, R: Array) -> Array:
        """What the friction law is given for the reaction."""
        return self.P + self.scale * (R - self.P)

    def advance(self, now: Instant, F: Array, phase: float) -> Instant:
        """One step; F (records, 1) and the phase at its end."""
        law, old = self.law, now.state
        from_q, from_v, from_p = self.kept
        start = from_q * old.q
        start += from_v * old.v
        start += from_p * now.p
        moved, contact, drive = self._of_each_copy(start.shape[2])
        base = start[0] @ self.read[0] + start[1] @ self.read[1] + contact
        T, p, n = 2 * now.T - now.T_before, now.p + now.smooth - now.smooth_before, now.p.shape[-1]
        qv, seen, memory, push = start + moved * p, base + p @ self.answers, old.hidden, 0.0
        R_old, tolerance, driven = self.normal(now.R), self.tolerance * self.P, F[..., None] * drive
        turned, answers = self._slopes(seen, T)
        for trial in range(1, TRIALS + 1):
            before = push
            push, tension, at_tip, memory = self._effects(
                qv[0], seen, phase, old.hidden, memory, self.row_flexibility, self.dt
            )
            p = self._forces(driven, T, seen[..., :n], tension, push)
            qv = moved * p
            qv += start  # in place: new arrays cost more than what is done with them
            seen = p @ self.answers
            seen += base
            u, v_slip, R, rest = self._contact(qv, seen, T, tension, at_tip)
            w = v_slip + (rest - now.rest) / self.dt
            at = Trial(
                u - now.u, v_slip, w, self.normal(R), now.v_slip, R_old, self.dt, self.P,
                *answers, u,
            )  # fmt: skip
            remembered, slope = law.advance(old.law, at)
            change = (law.force(remembered) - T) / np.maximum(1.0 - slope, 0.3)
            mismatch = np.abs(change) / tolerance
            T = T + change
            seen[..., :n] += turned * change[..., None]
            worst = largest(mismatch)
            if self.hidden and trial > 1:
                worst = max(worst, 0.01 * largest(np.abs(push - before) / tolerance[..., None]))
            if worst < 1.0 and trial > 1:
                break
        state, smooth = State(*qv, remembered, memory), p - push if self.hidden else p
        return Instant(state, p, smooth, now.smooth, T, R, u, v_slip, rest, now.T, trial, worst)

    def _slopes(self, seen: Array, T: Array) -> tuple[Array, tuple[Array, ...]]:
        """What pull, slip, both slip velocities and the law's reaction answer to the friction force of a step."""
        n = self.dynamic.shape[1]
        pull = seen[..., :n]
        more = pull + T[..., None] * (pull @ self.turns)  # what is pulled turns, and pulls less
        answer = more @ self.answers
        u_T, v_T = ((pull * more) @ self.stretches)[..., 0]
        R_T = self.scale * (answer[..., n + 1] + seen[..., n + 2] + T * answer[..., n + 2])
        w_T = v_T + (answer[..., n + 3] + self.axial) / self.dt
        return answer[..., :n], (u_T + self.axial, v_T, w_T, R_T)

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
