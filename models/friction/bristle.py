"""Laws whose state is the deflection of bristles: Dahl, LuGre, and the hybrid model of Azizian & Mureithi.

All share dz/dt = w' - |w'| z / z_max with w the displacement of the contact itself and z_max = mu(v) R / stiffness. In
terms of the distance slid that is a relaxation towards +-z_max, integrated exactly for a z_max that moves linearly
between samples (:func:`models.friction.elements.bristle`): second order, and stable however stiff the bristles are.
What a law adds in proportion to velocities uses w' = v + C dT/dt at the sample.
"""

from dataclasses import dataclass, field
from typing import ClassVar

import casadi as ca

from models.friction.elements import UNLOADED, bristle, clip, contact_velocity, relax, weakening
from models.friction.law import Checked, ContactSample, Value, parameter

LIGHT = 1e-3
"""Fraction of the static load below which a contact counts as hardly loaded."""

GAUSSIAN = 2.0
"""Exponent of the Stribeck function of LuGre and hybrid, (23)."""


def _limit(mu: Value, s: ContactSample) -> Value:
    """Friction force mu R at which bristles slide [N], never quite zero."""
    return mu * ca.fmax(s.reaction, UNLOADED * s.P)


@dataclass(frozen=True, eq=False)
class Dahl(Checked):
    """Dahl's law with exponent 1: dz/dt = v - stiffness |v| z / (mu R), T = -stiffness z."""

    name: ClassVar[str] = "dahl"
    states: ClassVar[int] = 1
    set_valued: ClassVar[bool] = False

    mu: Value = field(metadata=parameter("1", "friction coefficient", "paper's reference 9"))
    stiffness: Value = field(metadata=parameter("N/m", "rest stiffness sigma_0", "paper's reference 9"))

    def advance(self, z: Value, before: ContactSample, now: ContactSample) -> tuple[Value, Value]:
        """Relax over the distance slid."""
        before = before._replace(T=-self.stiffness * z)
        reach_before, reach_now = (_limit(self.mu, s) / self.stiffness for s in (before, now))
        z_new, _ = bristle(z, now.displacement - before.displacement, reach_before, reach_now)
        return z_new, -self.stiffness * z_new


@dataclass(frozen=True, eq=False)
class LuGre(Checked):
    """LuGre: dz/dt = v - stiffness |v| z / g(v), T = -(stiffness z + bristle_damping dz/dt + viscous v).

    g = R [mu + (mu_static - mu) exp(-(v / v_s)^2)].
    """

    name: ClassVar[str] = "lugre"
    states: ClassVar[int] = 1
    set_valued: ClassVar[bool] = False

    mu_static: Value = field(
        metadata=parameter("1", "friction coefficient at rest", "paper's reference 19", at_least="mu")
    )
    mu: Value = field(metadata=parameter("1", "friction coefficient at high speed", "paper's reference 19"))
    stribeck_velocity: Value = field(metadata=parameter("m/s", "speed v_s over which friction falls", "(23)"))
    stiffness: Value = field(metadata=parameter("N/m", "bristle stiffness sigma_0", "paper's reference 19"))
    bristle_damping: Value = field(
        metadata=parameter("N s/m", "bristle damping sigma_1", "paper's reference 19", strict=False)
    )
    viscous: Value = field(
        metadata=parameter("N s/m", "viscous coefficient sigma_2", "paper's reference 19", strict=False)
    )

    def advance(self, z: Value, before: ContactSample, now: ContactSample) -> tuple[Value, Value]:
        """Relax over the distance slid; add what goes with the velocities."""
        reach_before, reach_now = (_steady(self, s) / self.stiffness for s in (before, now))
        slip = now.displacement - before.displacement
        z_new, z_change = bristle(z, slip, reach_before, reach_now)
        v = contact_velocity(before, now)
        # z_change goes with the mean velocity of the step; to second order the velocity of its end counts, by as much
        # as the contact is loaded: the direction of a bristle that carries nothing is a matter of rounding
        v_mean, bent = slip / now.dt, clip(z_new / reach_now, -1.0, 1.0)
        later = (v - v_mean - (ca.fabs(v) - ca.fabs(v_mean)) * bent) * now.reaction / (now.reaction + LIGHT * now.P)
        z_rate = z_change / now.dt + later
        return z_new, -(self.stiffness * z_new + self.bristle_damping * z_rate + self.viscous * v)


@dataclass(frozen=True, eq=False)
class Hybrid(Checked):
    """Hybrid elastic-plastic-partial-slip model of Azizian & Mureithi, (21)-(23).

    Three massless nodes in series from the support to the sliding surface. The first is algebraic,
    z_e = k_ep z_p / (k_e + k_ep); states: z_p and z_s. The third balance is taken with the sign k_ps (z_s - z_p), the
    only one that is passive: the three add up to

        resisting force = c_z (v - dz_s/dt),   c_z = g(v) / |v|,

    and the power fed in, v times the resisting force, is

        d/dt (stored in the springs) + c_p (dz_p/dt)^2 + c_s (dz_s/dt)^2 + c_z (v - dz_s/dt)^2 :

    what is not stored is dissipated, and nothing dissipated is negative.
    """

    name: ClassVar[str] = "hybrid"
    states: ClassVar[int] = 2
    set_valued: ClassVar[bool] = False

    mu_static: Value = field(metadata=parameter("1", "friction coefficient at rest", "(23)", at_least="mu"))
    mu: Value = field(metadata=parameter("1", "friction coefficient at high speed", "(23)"))
    stribeck_velocity: Value = field(metadata=parameter("m/s", "speed v_s over which friction falls", "(23)"))
    stiffness: Value = field(metadata=parameter("N/m", "elastic stiffness k_e", "(21)"))
    stiffness_elastic_plastic: Value = field(metadata=parameter("N/m", "transition stiffness k_ep", "(21)"))
    stiffness_plastic_presliding: Value = field(metadata=parameter("N/m", "transition stiffness k_ps", "(21)"))
    damping_plastic: Value = field(metadata=parameter("N s/m", "plastic damping c_p", "(21)", strict=False))
    damping_presliding: Value = field(metadata=parameter("N s/m", "presliding damping c_s", "(21)", strict=False))

    def advance(self, z: Value, before: ContactSample, now: ContactSample) -> tuple[Value, Value]:
        """Relax both nodes, each exactly for targets that move linearly; the pair is linear in the new nodes."""
        p, s = z[0], z[1]
        k_ps, c_s = self.stiffness_plastic_presliding, self.damping_presliding
        k_p = 1.0 / (1.0 / self.stiffness + 1.0 / self.stiffness_elastic_plastic)
        carried = k_ps / (k_p + k_ps)  # where the plastic node rests between its springs
        x_p = now.dt * (k_p + k_ps) / ca.fmax(self.damping_plastic, 1e-9 * now.dt * (k_p + k_ps))

        slip = now.displacement - before.displacement
        sign = ca.if_else(slip < 0.0, -1.0, 1.0)
        g_before, g_now = _steady(self, before), _steady(self, now)
        x_s = sign * slip * k_ps / ((g_before + g_now) / 2.0 + c_s * sign * slip / now.dt)

        # new p = a_p + b_p (new s), new s = a_s + b_s (new p): relax() is linear in the target of the end
        a_p = relax(p, carried * s, 0.0, x_p)
        b_p = relax(0.0, 0.0, carried, x_p)
        a_s = relax(s, p + sign * g_before / k_ps, sign * g_now / k_ps, x_s)
        b_s = relax(0.0, 0.0, 1.0, x_s)
        s_new = (a_s + b_s * a_p) / (1.0 - b_s * b_p)
        p_new = a_p + b_p * s_new

        v, stretched = contact_velocity(before, now), k_ps * (s_new - p_new)
        s_rate = (g_now * v - ca.fabs(v) * stretched) / (g_now + c_s * ca.fabs(v))
        return ca.vertcat(p_new, s_new), -(stretched + c_s * s_rate)


def _steady(law: LuGre | Hybrid, s: ContactSample) -> Value:
    """Friction force g(v) R of steady sliding (23) [N]."""
    return _limit(weakening(law.mu_static, law.mu, law.stribeck_velocity, GAUSSIAN, s.v), s)
