"""Parts of friction laws: limits, stick-slip return mapping, relaxation, bristles."""

import casadi as ca

from models.friction.law import ContactSample, Value

UNLOADED = 1e-12
"""Fraction of the static load that a bristle's limit keeps where the tip would lift off: zero over zero is no force."""


def clip(value: Value, low: Value, high: Value) -> Value:
    """`value` within `low` and `high`."""
    return ca.fmin(ca.fmax(value, low), high)


def sides(mu: Value, ratio: Value) -> tuple[Value, Value]:
    """Friction coefficients forward (v > 0) and backward, in a ratio, with the mean `mu`.

    >>> sides(0.5, 1.5)
    (0.6, 0.4)
    """
    return 2.0 * mu * ratio / (1.0 + ratio), 2.0 * mu / (1.0 + ratio)


def limits(mu: Value, s: ContactSample, ratio: Value = 1.0) -> tuple[Value, Value]:
    """Lowest and highest friction force, -mu R and mu R with R = rho + eta T solved for T.

    A reaction that would be negative (the tip would lift off) leaves no friction. `ratio` as in :func:`sides`.
    """
    pressed = ca.fmax(s.rho, 0.0)
    forward, backward = sides(mu, ratio)
    return -forward * pressed / (1.0 + forward * s.eta), backward * pressed / (1.0 - backward * s.eta)


def return_map(z: Value, stiffness: Value, mu: Value, s: ContactSample, ratio: Value = 1.0) -> tuple[Value, Value]:
    """Jenkins element with its anchor at `z`: exact stick-slip return mapping.

    The anchor stays while the spring force is within the limits and is dragged along otherwise.
    """
    T = clip(stiffness * (z - s.u), *limits(mu, s, ratio))
    return s.u + T / stiffness, T


def weakening(mu_static: Value, mu: Value, velocity: Value, exponent: Value, v: Value) -> Value:
    """Friction coefficient that falls from `mu_static` to `mu` with the speed (20)."""
    # |v| smoothed far below any velocity that matters: |v|^exponent has no derivative at 0 for exponent <= 1
    speed = ca.sqrt((v / velocity) ** 2 + 1e-16)
    return mu + (mu_static - mu) * ca.exp(-(speed**exponent))


def mean_decay(x: Value) -> Value:
    """(1 - exp(-x)) / x, also at x = 0."""
    large = ca.fmax(x, 1e-4)
    series = 1.0 - x / 2.0 * (1.0 - x / 3.0 * (1.0 - x / 4.0))
    return ca.if_else(x < 1e-4, series, -ca.expm1(-large) / large)


def relax(y: Value, target_before: Value, target_now: Value, x: Value) -> Value:
    """Advance y' = -x (y - target) over a step of length 1, exactly for a target that moves linearly.

    For x -> 0 nothing changes, for x -> infinity y is the target: stiff relaxation needs no small steps.
    """
    moved = target_now - target_before
    return target_now + ca.exp(-x) * (y - target_before) - moved * mean_decay(x)


def bristle(z: Value, slip: Value, limit_before: Value, limit_now: Value) -> tuple[Value, Value]:
    """Advance the bristle dz = dw - |dw| z / limit over a `slip` w, exactly for a limit that moves linearly.

    Returns also the slope dz/dw of the end as seen by the step, times the slip.
    """
    sign = ca.if_else(slip < 0.0, -1.0, 1.0)  # at slip 0 the derivative is that of a bristle, not zero
    x = 2.0 * sign * slip / (limit_before + limit_now)
    z_new = relax(z, sign * limit_before, sign * limit_now, x)
    return z_new, x * (sign * limit_now - z_new)


def contact_velocity(before: ContactSample, now: ContactSample) -> Value:
    """Velocity of the contact itself at `now`, v + C dT/dt [m/s]; dT/dt by the backward difference."""
    return now.v + now.C * (now.T - before.T) / now.dt


def share_within(band: Value, before: Value, now: Value) -> Value:
    """Share of a step during which a value that moves linearly from `before` to `now` is within +-`band`."""
    moved = now - before
    inside = clip(now, -band, band) - clip(before, -band, band)
    still = ca.fabs(moved) < 1e-9 * band
    return ca.if_else(still, ca.fabs(now) < band, inside / ca.if_else(still, 1.0, moved))
