"""The friction laws' equations as docs/theory/equations.md prints them, marched over a period with fine steps.

No line is shared with the package. Below the limit every law is an ordinary differential equation, advanced by the
classical Runge-Kutta scheme; what limits a law is applied after each step. Both are of second order or better in a
step that is a hundred times finer than the samples these references judge.

`u` displacement of the modes at the contact, v its rate; w = u + C T the contact's own displacement. R = rho + eta T.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import copysign, exp

import numpy as np

from models import (
    Coulomb,
    Dahl,
    ForceBalance,
    FrictionLaw,
    Frictionless,
    Hybrid,
    Iwan,
    Jenkins,
    Karnopp,
    LuGre,
    SpringDamper,
    Stribeck,
    VelocityLimited,
    Viscous,
)

Vector = tuple[float, ...]


@dataclass(frozen=True)
class Motion:
    """What the contact is made to do: u, v, rho, eta at steps and half steps (2 N + 1,), and their time step."""

    u: list[float]
    v: list[float]
    rho: list[float]
    eta: list[float]
    dt: float
    C: float
    P: float

    @property
    def steps(self) -> int:
        """Whole steps of the period."""
        return len(self.u) // 2

    def half_steps(self) -> Iterator[tuple[int, int, int]]:
        """Indices of the beginning, the middle and the end of each step."""
        return ((2 * i, 2 * i + 1, 2 * i + 2) for i in range(self.steps))


def fine(synthesis: Callable[[np.ndarray], np.ndarray], Omega: float, steps: int, C: float, P: float) -> Motion:
    """Sample signals, a function of the phase that returns (phases, 4), over one period."""
    columns = synthesis(2 * np.pi * np.arange(2 * steps + 1) / (2 * steps)).T.tolist()
    return Motion(*columns, dt=2 * np.pi / (Omega * steps), C=C, P=P)


def runge_kutta(rate: Callable[[int, Vector], Vector], y: Vector, at: tuple[int, int, int], dt: float) -> Vector:
    """One step of the classical scheme; `rate` takes the index of a half step."""
    a = rate(at[0], y)
    b = rate(at[1], tuple(v + dt / 2 * s for v, s in zip(y, a, strict=True)))
    c = rate(at[1], tuple(v + dt / 2 * s for v, s in zip(y, b, strict=True)))
    d = rate(at[2], tuple(v + dt * s for v, s in zip(y, c, strict=True)))
    return tuple(v + dt / 6 * (p + 2 * q + 2 * r + s) for v, p, q, r, s in zip(y, a, b, c, d, strict=True))


def clipped(T: float, mu: float, rho: float, eta: float) -> float:
    """T within +-mu (rho + eta T)."""
    return min(max(T, -mu * rho / (1 + mu * eta)), mu * rho / (1 - mu * eta))


def weakening(mu_static: float, mu: float, speed: float, v: float, exponent: float = 2.0) -> float:
    return mu + (mu_static - mu) * exp(-((abs(v) / speed) ** exponent))


def jenkins(stiffness: float, mu: Callable[[float], float], m: Motion, periods: int = 2) -> np.ndarray:
    """Spring in series with a slider of limit mu(v) R."""
    T, out = 0.0, []
    for _ in range(periods):
        out = []
        for a, _, b in m.half_steps():
            T = clipped(T - stiffness * (m.u[b] - m.u[a]), mu(m.v[b]), m.rho[b], m.eta[b])
            out.append(T)
    return np.array(out)


def velocity_limited(law: VelocityLimited, m: Motion) -> np.ndarray:
    """T = -mu R w' / v_lim within +-mu R, so that C T' = -T v_lim / (mu R) - v."""

    def rate(i: int, y: Vector) -> Vector:
        return (-(y[0] * law.velocity_limit / (law.mu * (m.rho[i] + m.eta[i] * y[0])) + m.v[i]) / m.C,)

    if m.C == 0.0:
        ramp = np.clip(np.array(m.v[2::2]) / law.velocity_limit, -1.0, 1.0) * law.mu
        return -ramp * np.array(m.rho[2::2]) / (1.0 + ramp * np.array(m.eta[2::2]))
    T, out = 0.0, []
    for _ in range(2):
        out = []
        for at in m.half_steps():
            (T,) = runge_kutta(rate, (T,), at, m.dt)
            T = clipped(T, law.mu, m.rho[at[2]], m.eta[at[2]])
            out.append(T)
    return np.array(out)


def spring_damper(law: SpringDamper, m: Motion) -> np.ndarray:
    """Stuck T = -k z - c w'; always c z' = -T - k z: what the spring and damper under the slider feel."""
    k, c = law.stiffness, law.damping

    def rate(i: int, y: Vector) -> Vector:
        T, z = y
        z_rate = -(T + k * z) / c
        return (z_rate - m.v[i]) / m.C, z_rate

    def deflection(i: int, y: Vector) -> Vector:
        T = clipped(-k * y[0] - c * m.v[i], law.mu, m.rho[i], m.eta[i])
        return (-(T + k * y[0]) / c,)

    T, z, out = 0.0, 0.0, []
    for _ in range(2):
        out = []
        for at in m.half_steps():
            b = at[2]
            if m.C == 0.0:
                (z,) = runge_kutta(deflection, (z,), at, m.dt)
                T = clipped(-k * z - c * m.v[b], law.mu, m.rho[b], m.eta[b])
            else:
                free, z_free = runge_kutta(rate, (T, z), at, m.dt)
                T_old, T = T, clipped(free, law.mu, m.rho[b], m.eta[b])
                if free == T:
                    z = z_free
                else:  # the deflection relaxes under the force, which is linear over this step
                    z += m.dt * (-((T_old + T) / 2 + k * z) / c) / (1 + m.dt * k / (2 * c))
            out.append(T)
    return np.array(out)


def dahl(law: Dahl, m: Motion) -> np.ndarray:
    """z' = w' - |w'| z / z_max with w' = v - C k z'."""
    k = law.stiffness

    def rate(i: int, y: Vector) -> Vector:
        (z,) = y
        bend = 1.0 - copysign(1.0, m.v[i]) * z * k / (law.mu * (m.rho[i] - m.eta[i] * k * z))
        return (m.v[i] * bend / (1.0 + m.C * k * bend),)

    z, out = 0.0, []
    for _ in range(2):
        out = []
        for at in m.half_steps():
            (z,) = runge_kutta(rate, (z,), at, m.dt)
            out.append(-k * z)
    return np.array(out)


def lugre(law: LuGre, m: Motion) -> np.ndarray:
    """z' = w' - |w'| k z / g; with compliance T is a state, for T = -(k z + s1 z' + s2 w') gives w'.

    Only where s2 + s1 (1 - |k z| / g) > 0: a contact that resists less the faster it moves runs away on a
    massless spring.
    """
    k, s1, s2 = law.stiffness, law.bristle_damping, law.viscous

    mu = [weakening(law.mu_static, law.mu, law.stribeck_velocity, v) for v in m.v]

    def steady(i: int, T: float) -> float:
        return mu[i] * (m.rho[i] + m.eta[i] * T)

    def rigid(i: int, z: float) -> tuple[float, float]:
        """Force and z' where the contact moves with v."""
        T, v = 0.0, m.v[i]
        for _ in range(30):
            before = T
            z_rate = v - abs(v) * k * z / steady(i, T)
            T = -(k * z + s1 * z_rate + s2 * v)
            if before == T:
                break
        return T, z_rate

    def rate(i: int, y: Vector) -> Vector:
        z, T = y
        drive, used = -(T + k * z), k * z / steady(i, T)
        sign = 1.0 if drive > 0 else -1.0
        w_rate = drive / (s1 * (1.0 - sign * used) + s2)
        return w_rate - abs(w_rate) * used, (w_rate - m.v[i]) / m.C

    y: Vector = (0.0, 0.0) if m.C else (0.0,)
    out: list[float] = []
    for _ in range(2):
        out = []
        for at in m.half_steps():
            y = runge_kutta(rate if m.C else lambda i, y: (rigid(i, y[0])[1],), y, at, m.dt)
            out.append(y[1] if m.C else rigid(at[2], y[0])[0])
    return np.array(out)


def hybrid(law: Hybrid, m: Motion) -> np.ndarray:
    """Two nodes; the second moves with z_s' = w' - |w'| T_resisting / g, c_z = g / |w'|.

    With compliance only without presliding damping, like the bristles of LuGre; then w' = v + C T' with
    T = -k_ps (z_s - z_p).
    """
    k_ps, c_p, c_s = law.stiffness_plastic_presliding, law.damping_plastic, law.damping_presliding
    k_p = 1.0 / (1.0 / law.stiffness + 1.0 / law.stiffness_elastic_plastic)
    assert m.C == 0.0 or c_s == 0.0

    mu = [weakening(law.mu_static, law.mu, law.stribeck_velocity, v) for v in m.v]

    def steady(i: int, T: float) -> float:
        return mu[i] * (m.rho[i] + m.eta[i] * T)

    def contact(i: int, p: float, s: float) -> tuple[float, float]:
        """Force and z_s' for a given state."""
        T, v = 0.0, m.v[i]
        if m.C:
            g = steady(i, -k_ps * (s - p))
            drive = v + m.C * k_ps * plastic(p, s)
            bend = 1.0 - (1.0 if drive > 0 else -1.0) * k_ps * (s - p) / g
            return -k_ps * (s - p), drive * bend / (1.0 + m.C * k_ps * bend)
        for _ in range(30):
            before, g = T, steady(i, T)
            s_rate = (v - abs(v) * k_ps * (s - p) / g) / (1.0 + c_s * abs(v) / g)
            T = -(k_ps * (s - p) + c_s * s_rate)
            if before == T:
                break
        return T, s_rate

    def plastic(p: float, s: float) -> float:
        return -(k_p * p + k_ps * (p - s)) / c_p

    y: Vector = (0.0, 0.0)
    out: list[float] = []
    for _ in range(2):
        out = []
        for at in m.half_steps():
            y = runge_kutta(lambda i, y: (plastic(*y), contact(i, *y)[1]), y, at, m.dt)
            out.append(contact(at[2], *y)[0])
    return np.array(out)


def iwan(law: Iwan, m: Motion) -> np.ndarray:
    """Springs and sliders side by side; the displacement that they share by bisection of w = u + C T."""
    n = len(law.limits) or law.elements
    shares = np.array(law.limits) if law.limits else 1.0 + law.spread * (2.0 * np.arange(n) + 1.0 - n) / n
    shares, k = shares / shares.sum(), law.stiffness / n
    forces, w, out = np.zeros(n), 0.0, []
    for _ in range(2):
        out = []
        for _, _, b in m.half_steps():
            T = forces.sum()
            for _ in range(40):  # a contraction with factor C k n / (1 + C k n), R included
                limit = law.mu * (m.rho[b] + m.eta[b] * T) * shares
                new = np.minimum(np.maximum(forces - k * (m.u[b] + m.C * T - w), -limit), limit)
                total = new.sum()
                if abs(total - T) < 1e-10:
                    break
                T += (total - T) / (1.0 + m.C * law.stiffness)
            forces, w = new, m.u[b] + m.C * T
            out.append(T)
    return np.array(out)


def viscous(law: Viscous, m: Motion) -> np.ndarray:
    """Maxwell element c C T' + T = -c v."""
    if m.C == 0.0:
        return -law.coefficient * np.array(m.v[2::2])
    T, out = 0.0, []
    for _ in range(2):
        out = []
        for at in m.half_steps():
            (T,) = runge_kutta(lambda i, y: (-(y[0] / law.coefficient + m.v[i]) / m.C,), (T,), at, m.dt)
            out.append(T)
    return np.array(out)


def steady_force(law: FrictionLaw, m: Motion) -> np.ndarray:
    """Friction force at the ends of the steps, in the second period from rest."""
    if isinstance(law, Coulomb):
        return jenkins(1.0 / m.C, lambda v: law.mu, m)
    if isinstance(law, Jenkins):
        return jenkins(1.0 / (law.critical_slip / (law.mu * m.P) + m.C), lambda v: law.mu, m)
    if isinstance(law, Stribeck):
        mu = (law.mu_static, law.mu, law.stribeck_velocity)
        spring = law.critical_slip / (law.mu_static * m.P)
        return jenkins(1.0 / (spring + m.C), lambda v: weakening(*mu, v, law.exponent), m)
    if isinstance(law, Karnopp | ForceBalance):  # a massless contact in balance is one at rest
        return jenkins(1.0 / m.C, lambda v: law.mu_static if abs(v) < law.velocity_band else law.mu, m)
    marches = {
        VelocityLimited: velocity_limited,
        SpringDamper: spring_damper,
        Dahl: dahl,
        LuGre: lugre,
        Hybrid: hybrid,
        Iwan: iwan,
    }
    if type(law) in marches:
        return marches[type(law)](law, m)
    if isinstance(law, Viscous):
        return viscous(law, m)
    if isinstance(law, Frictionless):
        return np.zeros(m.steps)
    raise NotImplementedError(law.name)
