"""Coulomb's law and its kin: a limit mu R, and what happens below it.

`ratio` is mu forward over mu backward, 1 unless a law is made asymmetric (:func:`models.friction.extended.asymmetric`).
"""

from dataclasses import dataclass, field
from typing import ClassVar

import casadi as ca

from models.friction.elements import (
    clip,
    limits,
    mean_decay,
    relax,
    return_map,
    share_within,
    weakening,
)
from models.friction.law import Checked, ContactSample, Value, parameter

BAND_SOURCE = "paper's references 5 and 7"


@dataclass(frozen=True, eq=False)
class Coulomb(Checked):
    """Set-valued Coulomb friction (15): sticks exactly, slips at mu R.

    The contact point itself does not move while it sticks; what moves is the structure's compliance C
    in series with it, which must be positive. Where a structure brings none, the harmonic
    balance supplies it and takes it back (dynamic Lagrangian, :mod:`hbm.balance.problem`).
    """

    name: ClassVar[str] = "coulomb-lagrange"
    states: ClassVar[int] = 1
    set_valued: ClassVar[bool] = True
    ratio: ClassVar[Value] = 1.0

    mu: Value = field(metadata=parameter("1", "friction coefficient", "(15)"))

    def advance(self, z: Value, before: ContactSample, now: ContactSample) -> tuple[Value, Value]:
        """Return map of the series compliance alone."""
        return return_map(z, 1.0 / now.C, self.mu, now, self.ratio)


@dataclass(frozen=True, eq=False)
class Jenkins(Checked):
    """Coulomb friction with elastic slip, penalty form (16)-(19); k_t = mu P / critical_slip."""

    name: ClassVar[str] = "coulomb-penalty"
    states: ClassVar[int] = 1
    set_valued: ClassVar[bool] = False
    ratio: ClassVar[Value] = 1.0

    mu: Value = field(metadata=parameter("1", "friction coefficient", "(18)"))
    critical_slip: Value = field(metadata=parameter("m", "elastic slip u_crit at which sliding starts", "(17), (19)"))

    def advance(self, z: Value, before: ContactSample, now: ContactSample) -> tuple[Value, Value]:
        """Return map of the tangential spring in series with the structure."""
        stiffness = 1.0 / (self.critical_slip / (self.mu * now.P) + now.C)
        return return_map(z, stiffness, self.mu, now, self.ratio)


@dataclass(frozen=True, eq=False)
class VelocityLimited(Checked):
    """Coulomb friction with a linear ramp below a speed (VLFM): T = -mu R clip(v / velocity_limit).

    It never sticks, it creeps. The ramp is a dashpot mu R / velocity_limit in series with the structure's
    compliance, whose relaxation is integrated exactly for a velocity that is linear between samples.
    """

    name: ClassVar[str] = "vlfm"
    states: ClassVar[int] = 0
    set_valued: ClassVar[bool] = False

    mu: Value = field(metadata=parameter("1", "friction coefficient", "paper's reference 3"))
    velocity_limit: Value = field(
        metadata=parameter("m/s", "speed below which friction ramps up", "paper's reference 3")
    )

    def advance(self, z: Value, before: ContactSample, now: ContactSample) -> tuple[Value, Value]:
        """Relax towards the ramp, within the limits."""
        c_before, c_now = (self.mu * s.reaction / self.velocity_limit for s in (before, now))
        x = now.dt / ca.fmax(now.C * (c_before + c_now) / 2.0, 1e-9 * now.dt)
        return z, clip(relax(before.T, -c_before * before.v, -c_now * now.v, x), *limits(self.mu, now))


@dataclass(frozen=True, eq=False)
class Karnopp(Checked):
    """Karnopp's zero-velocity band: the contact is held, up to mu_static R while |v| is in the band, mu R outside.

    The limit is the average over the sample, so that the instant at which v leaves the band is not rounded to samples.
    v is the modal slip velocity, as in every limit: where the structure yields while the contact is held, it leaves a
    narrow band before the contact does, and the static limit has little to say.
    """

    name: ClassVar[str] = "karnopp"
    states: ClassVar[int] = 1
    set_valued: ClassVar[bool] = True
    ratio: ClassVar[Value] = 1.0

    mu_static: Value = field(metadata=parameter("1", "friction coefficient in the band", BAND_SOURCE, at_least="mu"))
    mu: Value = field(metadata=parameter("1", "friction coefficient outside", BAND_SOURCE))
    velocity_band: Value = field(
        metadata=parameter("m/s", "speed below which the contact counts as at rest", BAND_SOURCE)
    )

    def advance(self, z: Value, before: ContactSample, now: ContactSample) -> tuple[Value, Value]:
        """Return map of the series compliance alone, with the limit of the band."""
        within = share_within(self.velocity_band, before.v, now.v)
        return return_map(z, 1.0 / now.C, self.mu + (self.mu_static - self.mu) * within, now, self.ratio)


@dataclass(frozen=True, eq=False)
class ForceBalance(Karnopp):
    """Force balance in a Karnopp band (FBFM): friction balances the other forces, up to mu_static R; mu R outside.

    Karnopp's law holds the velocity at zero and lets the force follow, this one sets the force and lets the velocity
    follow. Step by step with last step's forces the two differ; with the reaction solved in the step, as here, a
    massless contact in balance is one at rest, and they are the same law.
    """

    name: ClassVar[str] = "fbfm"


@dataclass(frozen=True, eq=False)
class SpringDamper(Checked):
    """Spring and damper in parallel below the limit mu R (SDFM). State: their deflection [m].

    At all times damping dz/dt + stiffness z = -T. Stuck in series with the structure's compliance, T + stiffness z
    relaxes towards -damping v / (1 + stiffness C), exactly for a velocity that is linear between samples. What the
    limit cuts off that force lets the deflection go back.
    """

    name: ClassVar[str] = "sdfm"
    states: ClassVar[int] = 1
    set_valued: ClassVar[bool] = False

    mu: Value = field(metadata=parameter("1", "friction coefficient", "paper's reference 6"))
    stiffness: Value = field(metadata=parameter("N/m", "spring k_s of the stick phase", "paper's reference 6"))
    damping: Value = field(
        metadata=parameter("N s/m", "damper c_s of the stick phase", "paper's reference 6", strict=False)
    )

    def advance(self, z: Value, before: ContactSample, now: ContactSample) -> tuple[Value, Value]:
        """Spring and damper as if stuck; then what is cut off, and how far the deflection goes back."""
        k, C = self.stiffness, now.C
        c = ca.fmax(self.damping, 1e-9 * now.dt * k)
        yielding, x_slip = 1.0 + k * C, now.dt * k / c  # relaxation times per sample: of the spring and damper alone
        x_series = now.dt / ca.fmax(c * C, 1e-9 * now.dt)  # and of the damper with the compliance
        damped = relax(before.T + k * z, -c * before.v / yielding, -c * now.v / yielding, x_series + x_slip)
        stuck = (z + now.u - before.u + C * (damped - before.T)) / yielding
        held = damped - k * stuck
        T = clip(held, *limits(self.mu, now))

        cut, grown = held - T, 1.0 - ca.exp(-x_series - x_slip)
        settled, limit = -c * before.v / yielding - k * z, self.mu * before.reaction
        start = settled - clip(settled, -limit, limit)
        start = clip(start, ca.fmin(2.0 * cut / grown, 0.0), ca.fmax(2.0 * cut / grown, 0.0))
        at_once = relax(0.0, 1.0, 1.0, x_slip) - x_slip * ca.exp(-x_slip) * mean_decay(x_series)
        back = start * at_once + (cut - start * grown) * relax(0.0, 0.0, 1.0, x_slip)
        return stuck + back / k, T


@dataclass(frozen=True, eq=False)
class Stribeck(Checked):
    """Friction that falls with sliding speed (20), sticking branch as penalty with mu_static.

    The limit mu(v) R applies at every instant; k_t = mu_static P / critical_slip; exponent 1 is the decay law.
    """

    name: ClassVar[str] = "stribeck"
    states: ClassVar[int] = 1
    set_valued: ClassVar[bool] = False
    ratio: ClassVar[Value] = 1.0

    mu_static: Value = field(metadata=parameter("1", "friction coefficient at rest", "(20)", at_least="mu"))
    mu: Value = field(metadata=parameter("1", "friction coefficient at high speed", "(20)"))
    stribeck_velocity: Value = field(metadata=parameter("m/s", "speed v_s over which friction falls", "(20)"))
    exponent: Value = field(
        default=2.0, kw_only=True, metadata=parameter("1", "Stribeck exponent delta; 1 is the decay law", "(20)")
    )
    critical_slip: Value = field(metadata=parameter("m", "elastic slip u_crit at which sliding starts", "(17), (20)"))

    def advance(self, z: Value, before: ContactSample, now: ContactSample) -> tuple[Value, Value]:
        """Return map with the limit of the present slip velocity."""
        stiffness = 1.0 / (self.critical_slip / (self.mu_static * now.P) + now.C)
        mu = weakening(self.mu_static, self.mu, self.stribeck_velocity, self.exponent, now.v)
        return return_map(z, stiffness, mu, now, self.ratio)
