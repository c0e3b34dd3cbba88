"""Force of one device with play, spring and slider over the samples of a displacement, with its derivatives.

CasADi differentiates one step; the derivatives go along with the states, so that one march gives both. See
:mod:`hbm.identification.loops` for the law.
"""

from functools import cache

import casadi as ca
import numpy as np

from hbm.fourier import Array

MARCHED = ("stiffness", "forward", "backward", "backlash", "breakaway", "distance")
"""Numbers of which the force is no linear function."""


def marched(free: tuple[str, ...], values: Array, steps: Array, samples: int) -> tuple[Array, Array]:
    """Force at the last samples of a march from rest, and its Jacobian to the numbers.

    Parameters
    ----------
    free : tuple of str
        Numbers of `MARCHED`; limits are alike without the backward one, the others 0.
    values : (p,) array
    steps : (m,) array
        Way to each sample from the one before [m].
    samples : int

    Returns
    -------
    force : (samples,) array
        [N]
    slope : (samples, p) array
    """
    numbers = np.broadcast_to(values[:, None], (len(values), len(steps)))
    _, out = _march(free, len(steps))(np.zeros(2 * (1 + len(free))), steps[None], numbers)
    out = out.full()[:, -samples:]
    return out[0], out[1:].T


@cache
def _march(free: tuple[str, ...], steps: int) -> ca.Function:
    return _step(free).mapaccum(steps)


@cache
def _step(free: tuple[str, ...]) -> ca.Function:
    """States (stretch, way slipped since it stuck) and their derivatives, a step further; force and its derivatives."""
    x, dx, state = ca.SX.sym("x", len(free)), ca.SX.sym("dx"), ca.SX.sym("state", 2)
    p = {name: x[i] for i, name in enumerate(free)}
    k, forward = p["stiffness"], p["forward"]
    backward, play = p.get("backward", forward), p.get("backlash", 0.0)
    e, s = state[0], state[1]
    limit = 1 + p["breakaway"] * ca.exp(-s / p["distance"]) if "breakaway" in free else 1
    tried = e + dx
    there = ca.fmin(ca.fmax(tried, -play - limit * backward / k), limit * forward / k)
    slipped = ca.fabs(tried - there)
    after = ca.vertcat(there, ca.if_else(slipped > 0, s + slipped, 0))
    force = k * (ca.fmax(there, 0) + ca.fmin(there + play, 0))
    slopes = ca.SX.sym("slopes", 2, len(free))
    carried = ca.jacobian(after, state) @ slopes + ca.jacobian(after, x)
    slope = ca.jacobian(force, state) @ slopes + ca.jacobian(force, x)
    given = [ca.vertcat(state, ca.vec(slopes)), dx, x]
    return ca.Function("step", given, [ca.vertcat(after, ca.vec(carried)), ca.vertcat(force, slope.T)], {"cse": True})
