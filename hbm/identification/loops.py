"""Friction devices under an imposed displacement: laws fitted to measured loops, from Coulomb to play and breakaway.

The force needs no structure: it follows from the displacement alone. One spring stands for all that is elastic, behind
a play of width B (lost motion) and before a slider whose limit differs by direction:

    T = k e where e > 0,  0 where -B < e < 0,  k (e + B) where e < -B;
    e follows x up to T = F_+ and down to T = -F_-, and slips beyond.

Where the slider breaks away its limit is larger, F (1 + a exp(-s/d)) with s the way slipped since it stuck. What moves
with the device adds its mass times the acceleration. The laws here are that one with fewer or more of its numbers free.
CasADi marches them over the samples and differentiates.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np
from scipy.optimize import least_squares

from hbm.fourier import Array
from hbm.measurement.loopsfile import MeasuredLoop
from models.display import Displayed

NAMES = ("stiffness", "forward", "backward", "backlash", "breakaway", "distance", "mass")
UNITS = ("N/m", "N", "N", "m", "1", "m", "kg")

LAWS: dict[str, tuple[str, ...]] = {
    "coulomb": ("stiffness", "forward"),
    "asymmetric": ("stiffness", "forward", "backward"),
    "backlash": ("stiffness", "forward", "backward", "backlash"),
    "backlash and breakaway": NAMES[:6],
    "backlash and mass": (*NAMES[:4], "mass"),
    "all of it": NAMES,
}
"""Numbers that are free in each law; limits are alike where the backward one is not."""

PLAYS = (0.02, 0.08, 0.2)
"""Parts of the whole way at which a play is looked for."""

CLEAR = 1e-3
"""Lines of the displacement below this part of its largest are noise: they do not count in the acceleration."""

CYCLES = 2
"""Times that the loop is marched: the first forgets where it began."""


@dataclass(frozen=True)
class LoopFit(Displayed):
    """One law fitted to one loop.

    Attributes
    ----------
    law : str
    values, stds : dict of str to float
        Numbers that are free, in SI units.
    left : float
        Rms of what is left over that of the force.
    work, work_measured : float
        Energy of the whole recording [J].
    bic : float
    force : (n,) array
        That of the law [N].
    """

    law: str
    values: dict[str, float]
    stds: dict[str, float]
    left: float
    work: float
    work_measured: float
    bic: float
    force: Array

    @property
    def work_error(self) -> float:
        """Relative error of the energy."""
        return self.work / self.work_measured - 1.0

    def __repr__(self) -> str:
        """Law, numbers, and what is left."""
        units = dict(zip(NAMES, UNITS, strict=True))
        said = ", ".join(f"{n} {v:.4g} ± {self.stds[n]:.2g} {units[n]}" for n, v in self.values.items())
        return f"{self.law}: {said}; {self.left:.1%} left, energy {self.work_error:+.1%}"


def fit_loop(loop: MeasuredLoop, laws: Sequence[str] = tuple(LAWS)) -> list[LoopFit]:
    """Fit laws to a loop.

    Parameters
    ----------
    loop : MeasuredLoop
    laws : sequence of str
        Names of `LAWS`.

    Returns
    -------
    list of LoopFit
        The best first, by the Bayesian information criterion. Neighbouring samples do not count for themselves: what
        the last law leaves says how far they are alike.
    """
    size, way = float(np.median(np.abs(loop.force))), float(np.ptp(loop.displacement))
    found = [(name, *_fitted(loop, LAWS[name], size, way)) for name in laws]
    left = min((loop.force - force for _, _, _, force in found), key=lambda r: float(r @ r))
    alike = max(float(left[1:] @ left[:-1] / (left @ left)), 0.0)
    points = len(left) * (1.0 - alike) / (1.0 + alike)
    fits = [_described(loop, name, x, J, force, points) for name, x, J, force in found]
    return sorted(fits, key=lambda fit: fit.bic)


def _fitted(loop: MeasuredLoop, free: tuple[str, ...], size: float, way: float) -> tuple[Array, Array, Array]:
    """Logarithms of the free numbers, the Jacobian of the force to them, and the force."""
    value, slope = _marched(free, len(loop.time))
    steps = np.diff(np.append(loop.displacement, loop.displacement[0]))
    steps = np.roll(steps, 1)[None]  # to reach each sample from the one before
    acceleration = _acceleration(loop)
    starts = {
        "stiffness": 20.0 * size / way,
        "forward": size,
        "backward": size,
        "breakaway": 0.1,
        "distance": 0.05 * way,
        "mass": 0.1 * size / float(np.sqrt(np.mean(acceleration**2))),
    }

    def force(x: Array) -> Array:
        return np.asarray(value(x, steps, acceleration).full().ravel())

    def jacobian(x: Array) -> Array:
        return np.asarray(slope(x, steps, acceleration).full())

    best = None
    for play in PLAYS if "backlash" in free else PLAYS[:1]:
        x = np.log([{**starts, "backlash": play * way}[name] for name in free])
        fit = least_squares(lambda x: (force(x) - loop.force) / size, x, jac=lambda x: jacobian(x) / size, method="lm")
        if best is None or fit.cost < best.cost:
            best = fit
    assert best is not None
    return best.x, jacobian(best.x), force(best.x)


def _acceleration(loop: MeasuredLoop) -> Array:
    """Acceleration of the displacement, by its clear lines over the recording [m/s2]."""
    n, step = len(loop.time), float(np.mean(np.diff(loop.time)))
    lines = np.fft.rfft(loop.displacement - loop.displacement.mean())
    lines[np.abs(lines) < CLEAR * np.abs(lines).max()] = 0.0
    return np.asarray(np.fft.irfft(-((2 * np.pi * np.fft.rfftfreq(n, step)) ** 2) * lines, n))


@cache
def _marched(free: tuple[str, ...], samples: int) -> tuple[ca.Function, ca.Function]:
    """Force of a law at every sample of the last cycle, by logarithms of its free numbers; and its Jacobian."""
    x, dx, state = ca.SX.sym("x", len(free)), ca.SX.sym("dx"), ca.SX.sym("state", 2)
    p = {name: ca.exp(x[i]) for i, name in enumerate(free)}
    k, forward = p["stiffness"], p["forward"]
    backward, play = p.get("backward", forward), p.get("backlash", 0.0)
    e, s = state[0], state[1]
    limit = 1 + p["breakaway"] * ca.exp(-s / p["distance"]) if "breakaway" in free else 1
    tried = e + dx
    there = ca.fmin(ca.fmax(tried, -play - limit * backward / k), limit * forward / k)
    slipped = ca.fabs(tried - there)
    after = ca.vertcat(there, ca.if_else(slipped > 0, s + slipped, 0))
    force = k * (ca.fmax(there, 0) + ca.fmin(there + play, 0))
    step = ca.Function("step", [state, dx, x], [after, force])
    march = step.mapaccum(samples * CYCLES)
    X, steps = ca.MX.sym("X", len(free)), ca.MX.sym("steps", 1, samples)
    acceleration = ca.MX.sym("acceleration", samples)
    _, forces = march(ca.DM.zeros(2), ca.repmat(steps, 1, CYCLES), ca.repmat(X, 1, samples * CYCLES))
    last, given = forces[:, samples * (CYCLES - 1) :].T, [X, steps, acceleration]
    if "mass" in free:
        last += ca.exp(X[free.index("mass")]) * acceleration
    return ca.Function("force", given, [last]), ca.Function("slope", given, [ca.jacobian(last, X)])


def _described(loop: MeasuredLoop, name: str, x: Array, J: Array, force: Array, points: float) -> LoopFit:
    free, left = LAWS[name], loop.force - force
    mean = float(left @ left) / len(left)
    covariance = np.linalg.pinv(J.T @ J) * mean * len(left) / max(points - len(x), 1.0)
    values = np.exp(x)
    stds = values * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return LoopFit(
        law=name,
        values=dict(zip(free, values.tolist(), strict=True)),
        stds=dict(zip(free, stds.tolist(), strict=True)),
        left=float(np.sqrt(mean / np.mean(loop.force**2))),
        work=MeasuredLoop(loop.name, loop.time, loop.displacement, force).work,
        work_measured=loop.work,
        bic=float(points * np.log(mean) + len(x) * np.log(points)),
        force=force,
    )
