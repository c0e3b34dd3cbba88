"""Friction laws over one time step of unknown end, for a batch of records and of copies of each.

A law sees a trial of the contact at the end of the step and returns its state there, the friction force first among
it, and how that force answers to the friction force that was tried: the march finds the force that agrees with itself.
Parameters are numbers, or (records, 1) arrays where they drift from record to record.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import ClassVar, NamedTuple, Protocol

import numpy as np

Array = np.ndarray
Value = float | Array


class Trial(NamedTuple):
    """The contact at the end of a step, (records, copies) each, and the derivative of each to the friction force.

    u slip, du its change over the step; v slip velocity of the modes; w slip velocity with that of the massless
    rest; R normal force; `*_old` at the beginning of the step.
    """

    du: Array
    v: Array
    w: Array
    R: Array
    v_old: Array
    R_old: Array
    dt: Array
    P: Array
    du_T: Array
    v_T: Array
    w_T: Array
    R_T: Array
    u: Array


class Law(Protocol):
    states: int

    def advance(self, old: Array, at: Trial) -> tuple[Array, Array]:
        """State at the end of the step (records, copies, states), and dT/dT."""
        ...

    def force(self, state: Array) -> Array:
        """Friction force of a state."""
        ...


def jenkins(T: Array, stiffness: Value, upper: Array, lower: Array, upper_T: Array, lower_T: Array, at: Trial):
    """Spring in series with a slider: force and dT/dT; the limits move with the trial by `upper_T`, `lower_T`."""
    trial = T - stiffness * at.du
    slope = np.where(trial > upper, upper_T, np.where(trial < lower, lower_T, -stiffness * at.du_T))
    return np.minimum(np.maximum(trial, lower), upper), slope  # np.clip takes longer


class Single:
    """A law whose state is its friction force."""

    states: ClassVar[int] = 1

    def force(self, state: Array) -> Array:
        return state[..., 0]


@dataclass(frozen=True)
class Coulomb(Single):
    """Penalty: k_t = mu P / critical_slip; `ratio` = mu_forward / mu_backward with the mean mu, forward is v > 0."""

    mu: Value
    critical_slip: Value
    ratio: Value = 1.0
    name: ClassVar[str] = "coulomb-penalty"

    def advance(self, old: Array, at: Trial) -> tuple[Array, Array]:
        forward, backward = 2 * self.mu * self.ratio / (1 + self.ratio), 2 * self.mu / (1 + self.ratio)
        R, R_T = np.maximum(at.R, 0.0), at.R_T * (at.R > 0)
        stiffness = self.mu * at.P / self.critical_slip
        T, slope = jenkins(old[..., 0], stiffness, backward * R, -forward * R, backward * R_T, -forward * R_T, at)
        return T[..., None], slope


@dataclass(frozen=True)
class PlaceDependent(Single):
    """Coulomb penalty whose friction coefficient is mu (1 + slope u / critical_slip): outside the catalogue."""

    mu: Value
    critical_slip: Value
    slope: Value
    name: ClassVar[str] = "place-dependent"

    def advance(self, old: Array, at: Trial) -> tuple[Array, Array]:
        R = np.maximum(at.R, 0.0)
        mu = self.mu * np.clip(1 + self.slope * at.u / self.critical_slip, 0.2, 1.8)
        limit = mu * R
        limit_T = mu * at.R_T * (at.R > 0) + self.mu * self.slope / self.critical_slip * at.du_T * R
        stiffness = self.mu * at.P / self.critical_slip
        T, slope = jenkins(old[..., 0], stiffness, limit, -limit, limit_T, -limit_T, at)
        return T[..., None], slope


@dataclass(frozen=True)
class Stribeck(Single):
    """Penalty with mu(v) = mu + (mu_static - mu) exp(-(|v|/v_s)^exponent); the limit holds at every instant."""

    mu_static: Value
    mu: Value
    stribeck_velocity: Value
    critical_slip: Value
    exponent: float = 2.0
    name: ClassVar[str] = "stribeck"

    def advance(self, old: Array, at: Trial) -> tuple[Array, Array]:
        speed = np.abs(at.v) / self.stribeck_velocity
        decay = (self.mu_static - self.mu) * np.exp(-(speed**self.exponent))
        falls = -decay * self.exponent * speed ** (self.exponent - 1) / self.stribeck_velocity
        R, mu = np.maximum(at.R, 0.0), self.mu + decay
        limit = mu * R
        limit_T = falls * np.sign(at.v) * at.v_T * R + mu * at.R_T * (at.R > 0)
        stiffness = self.mu_static * at.P / self.critical_slip
        T, slope = jenkins(old[..., 0], stiffness, limit, -limit, limit_T, -limit_T, at)
        return T[..., None], slope


@dataclass(frozen=True)
class Dahl(Single):
    """dz/du = 1 - z sign(du) sigma0 / (mu R): exact over a step in which the slip does not turn."""

    mu: Value
    stiffness: Value
    name: ClassVar[str] = "dahl"

    def advance(self, old: Array, at: Trial) -> tuple[Array, Array]:
        most = self.mu * np.maximum((at.R + at.R_old) / 2, 1e-9)
        sign = np.sign(at.du)
        T = -sign * most + (old[..., 0] + sign * most) * np.exp(-np.abs(at.du) * self.stiffness / most)
        return T[..., None], -self.stiffness * (1 + sign * T / most) * at.du_T


@dataclass(frozen=True)
class LuGre:
    """z exact over a step of constant velocity; T = -(sigma0 z + sigma1 z' + sigma2 w) at its end."""

    mu_static: Value
    mu: Value
    stribeck_velocity: Value
    stiffness: Value
    bristle_damping: Value
    viscous: Value = 0.0
    name: ClassVar[str] = "lugre"
    states: ClassVar[int] = 2

    def _limit(self, v: Array, R: Array) -> Array:
        fall = np.exp(-((v / self.stribeck_velocity) ** 2))
        return np.maximum(R, 1e-9) * (self.mu + (self.mu_static - self.mu) * fall)

    def advance(self, old: Array, at: Trial) -> tuple[Array, Array]:
        k, s1 = self.stiffness, self.bristle_damping
        g = self._limit((at.v + at.v_old) / 2, (at.R + at.R_old) / 2) / k
        sign = np.sign(at.du)
        z = sign * g + (old[..., 1] - sign * g) * np.exp(-np.abs(at.du) / g)
        used = z * k / self._limit(at.v, at.R)
        T = -(k * z + s1 * (at.w - np.abs(at.w) * used) + self.viscous * at.w)
        slope = -k * (1 - sign * z / g) * at.du_T - (s1 * (1 - np.sign(at.w) * used) + self.viscous) * at.w_T
        return np.stack([T, z], axis=-1), slope

    def force(self, state: Array) -> Array:
        return state[..., 0]


@dataclass(frozen=True)
class Iwan:
    """Jenkins elements of equal stiffness; limits uniform in (1 - spread .. 1 + spread) mu R / elements."""

    mu: Value
    stiffness: Value
    spread: Value
    elements: int = 10
    name: ClassVar[str] = "iwan"

    @property
    def states(self) -> int:
        return self.elements

    def advance(self, old: Array, at: Trial) -> tuple[Array, Array]:
        n = self.elements
        shares = (1 + np.asarray(self.spread)[..., None] * (2 * np.arange(n) + 1 - n) / n) / n
        mu = np.asarray(self.mu)[..., None] * shares
        limit = mu * np.maximum(at.R, 0.0)[..., None]
        k = np.asarray(self.stiffness)[..., None] / n
        trial = old - k * at.du[..., None]
        beyond = np.abs(trial) > limit
        stuck = -k * at.du_T[..., None]
        slope = np.where(beyond, np.sign(trial) * mu * at.R_T[..., None], stuck).sum(axis=-1)
        return np.clip(trial, -limit, limit), slope

    def force(self, state: Array) -> Array:
        return state.sum(axis=-1)


@dataclass(frozen=True)
class Viscous(Single):
    """T = -c w."""

    coefficient: Value
    name: ClassVar[str] = "viscous"

    def advance(self, old: Array, at: Trial) -> tuple[Array, Array]:
        return (-self.coefficient * at.w)[..., None], -self.coefficient * at.w_T


@dataclass(frozen=True)
class NoFriction(Single):
    name: ClassVar[str] = "none"

    def advance(self, old: Array, at: Trial) -> tuple[Array, Array]:
        return np.zeros_like(old), np.zeros_like(at.v)


@dataclass(frozen=True)
class Parallel:
    """Laws that share the slip."""

    laws: tuple[Law, ...]
    name: ClassVar[str] = "parallel"

    @property
    def states(self) -> int:
        return sum(law.states for law in self.laws)

    def _split(self, state: Array) -> list[Array]:
        return np.split(state, np.cumsum([law.states for law in self.laws])[:-1], axis=-1)

    def advance(self, old: Array, at: Trial) -> tuple[Array, Array]:
        parts = [law.advance(part, at) for law, part in zip(self.laws, self._split(old), strict=True)]
        return np.concatenate([state for state, _ in parts], axis=-1), sum(slope for _, slope in parts)

    def force(self, state: Array) -> Array:
        return sum(law.force(part) for law, part in zip(self.laws, self._split(state), strict=True))


def side_by_side(laws: Sequence[Law]) -> Law:
    """One law of all records: parameters in which they differ become arrays (records, 1)."""
    first = laws[0]
    if all(law == first for law in laws):
        return first
    if isinstance(first, Parallel):
        return Parallel(tuple(side_by_side(parts) for parts in zip(*(law.laws for law in laws), strict=True)))
    values = {f.name: [getattr(law, f.name) for law in laws] for f in fields(first)}
    return replace(first, **{name: np.array(v)[:, None] for name, v in values.items() if len(set(v)) > 1})
