"""Friction devices under an imposed displacement: laws fitted to measured loops, from Coulomb to play and breakaway.

The force needs no structure: it follows from the displacement alone. One spring stands for all that is elastic, behind
a play of width B (lost motion) and before a slider whose limit differs by direction:

    T = k e where e > 0,  0 where -B < e < 0,  k (e + B) where e < -B;
    e follows x up to T = F_+ and down to T = -F_-, and slips beyond.

Where the slider breaks away its limit is larger, F (1 + a exp(-s/d)) with s the way slipped since it stuck. What moves
with the device adds its mass times the acceleration, and a load cell its zero, which the force in the gap of a play
shows: without play it is half of what the limits differ by. The laws here are that one with fewer or more of its
numbers free.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from hbm.fourier import Array
from hbm.identification.loopmarch import MARCHED, marched
from hbm.measurement.cycles import acceleration, cycles_in
from hbm.measurement.loopsfile import MeasuredLoop
from models.display import Displayed

NAMES = (*MARCHED, "mass", "offset")
UNITS = ("N/m", "N", "N", "m", "1", "m", "kg", "N")

LAWS: dict[str, tuple[str, ...]] = {
    "coulomb": ("stiffness", "forward"),
    "asymmetric": ("stiffness", "forward", "backward"),
    "backlash": ("stiffness", "forward", "backward", "backlash"),
    "backlash and breakaway": NAMES[:6],
    "backlash and mass": (*NAMES[:4], "mass"),
    "all of it": NAMES[:7],
    "coulomb and mass": ("stiffness", "forward", "mass"),
    "asymmetric and mass": ("stiffness", "forward", "backward", "mass"),
    "backlash and offset": (*NAMES[:4], "offset"),
    "backlash and breakaway and offset": (*NAMES[:6], "offset"),
    "backlash and mass and offset": (*NAMES[:4], "mass", "offset"),
    "all of it and offset": NAMES,
}
"""Numbers that are free in each law; limits are alike where the backward one is not."""

PLAYS = (0.02, 0.08, 0.2)
"""Parts of the whole way at which a play is looked for."""

MISSED = 0.2
"""A law whose energy of a cycle is off by more of what was measured is not that of the loop."""

STARTS = {
    "stiffness": 20.0,
    "forward": 1.0,
    "backward": 1.0,
    "breakaway": 0.1,
    "distance": 0.05,
    "mass": 0.1,
    "offset": 0.0,
}
"""Where the others are looked for, in parts of what is usual of the loop."""

BOUNDS = {
    "stiffness": (1e-3, 1e6),
    "forward": (1e-3, 1e3),
    "backward": (1e-3, 1e3),
    "backlash": (1e-4, 1.0),
    "breakaway": (1e-3, 2.0),
    "distance": (1e-3, 1.0),
    "mass": (1e-4, 1e3),
}
"""Least and largest of them. A limit that goes to zero while its breakaway grows is a spring that yields, not friction:
no friction is known to break away at more than three times what it slides at, nor to take the whole way for it."""

VANISHING = ("backlash", "breakaway", "mass")
"""Numbers at whose least a law is the one without."""

NEAR = 0.01
"""A number within this part of its bound is at it."""

GAP = 0.2
"""Part of the rms of a force that its usual size is at least."""

EVALUATIONS = 200
"""Marches of a fit at most."""


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
    at_bounds : tuple of str
        Numbers that end where they must: the loop has no such law.
    """

    law: str
    values: dict[str, float]
    stds: dict[str, float]
    left: float
    work: float
    work_measured: float
    bic: float
    force: Array
    at_bounds: tuple[str, ...] = ()

    @property
    def work_error(self) -> float:
        """Relative error of the energy."""
        return self.work / self.work_measured - 1.0

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to beware of in the numbers."""
        return tuple(self._doubts())

    def _doubts(self) -> Iterator[str]:
        if abs(self.work_error) > MISSED:
            taken = f"takes {self.work:.3g} J a cycle, measured are {self.work_measured:.3g} J"
            yield f"none of these laws is that of the loop: the best one {taken}"
        if self.at_bounds:
            verb = "is" if len(self.at_bounds) == 1 else "are"
            yield f"no law fits without a number at its bound; {', '.join(self.at_bounds)} {verb} not determined"
        if "backward" in self.values and "backlash" not in self.values:
            zero = 0.5 * (self.values["forward"] - self.values["backward"])
            yield f"a zero of the load cell of {zero:.3g} N would look the same as these limits: take it off before"

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
        The best first, by the Bayesian information criterion; those with a number at its bound last. Neighbouring
        samples do not count for themselves: what the closest law leaves says how far they are alike.
    """
    motion = _Motion.of(loop)
    found: dict[str, _Found] = {}
    for name in laws:
        found[name] = _fitted(motion, LAWS[name], found.get(name.removesuffix(" and offset")))
    left = min((loop.force - each.force for each in found.values()), key=lambda r: float(r @ r))
    alike = max(float(left[1:] @ left[:-1] / (left @ left)), 0.0)
    points = len(left) * (1.0 - alike) / (1.0 + alike)
    fits = [_described(loop, name, each, points) for name, each in found.items()]
    return sorted(fits, key=lambda fit: (bool(fit.at_bounds), fit.bic))


@dataclass(frozen=True)
class _Motion:
    """A loop as it is marched, and what is usual of it: numbers are fitted in parts of that.

    Its first cycle is marched twice: once to forget where it began.
    """

    force: Array
    steps: Array
    acceleration: Array
    usual: Mapping[str, float]

    @classmethod
    def of(cls, loop: MeasuredLoop) -> "_Motion":
        """That of a loop."""
        x, samples = loop.displacement, len(loop.time)
        cycles = cycles_in(loop.time, x)
        if np.isnan(cycles):
            cycles = 1.0
        path = np.concatenate([x[: min(round(samples / cycles), samples)], x])
        steps = np.diff(path, prepend=x[0])
        moving = acceleration(loop.time, x, cycles)
        size, way = _usual_size(loop.force), float(np.ptp(x))
        mass = size / float(np.sqrt(np.mean(moving**2)))
        usual = (size / way, size, size, way, 1.0, way, mass, size)
        return cls(loop.force, steps, moving, dict(zip(NAMES, usual, strict=True)))

    def values(self, free: tuple[str, ...], x: Array) -> Array:
        """Numbers by what is fitted: their logarithms, but of an offset, which may have either sign."""
        usual = np.array([self.usual[name] for name in free])
        return np.asarray(usual * np.where([name == "offset" for name in free], x, np.exp(x)))

    def slopes(self, free: tuple[str, ...], x: Array) -> Array:
        """Derivatives of the numbers."""
        usual = np.array([self.usual[name] for name in free])
        return np.asarray(usual * np.where([name == "offset" for name in free], 1.0, np.exp(x)))

    def predicted(self, free: tuple[str, ...], x: Array) -> tuple[Array, Array]:
        """Force of a law, and its Jacobian to what is fitted."""
        values, within = self.values(free, x), tuple(name for name in free if name in MARCHED)
        force, slope = marched(within, values[: len(within)], self.steps, len(self.force))
        more = {"mass": self.acceleration, "offset": np.ones(len(self.force))}
        linear = [more[name] for name in free[len(within) :]]
        for value, column in zip(values[len(within) :], linear, strict=True):
            force = force + value * column
        return force, np.column_stack([slope, *linear]) * self.slopes(free, x)


def _usual_size(force: Array) -> float:
    """Median of a force without its signs; part of the rms where it is zero most of the time, as in a long gap."""
    return float(max(np.median(np.abs(force)), GAP * np.sqrt(np.mean(force**2))))


@dataclass(frozen=True)
class _Found:
    """Numbers of a law as they are fitted and as they are, derivatives of these, force and Jacobian."""

    free: tuple[str, ...]
    x: Array
    values: Array
    slopes: Array
    force: Array
    jacobian: Array
    at_bounds: tuple[str, ...]


def _fitted(motion: _Motion, free: tuple[str, ...], within: _Found | None) -> _Found:
    """A law from several plays, or from a law within it that is fitted, whose free numbers come first."""
    lower, upper = np.array([np.log(BOUNDS[name]) if name in BOUNDS else (-np.inf, np.inf) for name in free]).T
    if within is not None:
        begun = np.append(within.x, STARTS[free[-1]])
        starts = [np.clip(begun, lower + NEAR, upper - NEAR)]
    else:
        starts = [_start(free, play) for play in (PLAYS if "backlash" in free else PLAYS[:1])]
    fits = [_least_squares(motion, free, start, lower, upper) for start in starts]
    x = min(fits, key=lambda fit: float(fit.cost)).x
    force, slope = motion.predicted(free, x)
    at_bounds = tuple(_at_bounds(dict(zip(free, zip(x - lower, upper - x, strict=True), strict=True))))
    return _Found(free, x, motion.values(free, x), motion.slopes(free, x), force, slope, at_bounds)


def _start(free: tuple[str, ...], play: float) -> Array:
    usual = {**STARTS, "backlash": play}
    return np.array([usual[name] if name == "offset" else np.log(usual[name]) for name in free])


def _least_squares(motion: _Motion, free: tuple[str, ...], start: Array, lower: Array, upper: Array) -> Any:
    """A fit from one start; a march gives force and Jacobian, so the last one is kept."""

    @lru_cache(maxsize=1)
    def at(x: bytes) -> tuple[Array, Array]:
        force, slope = motion.predicted(free, np.frombuffer(x))
        return (force - motion.force) / motion.usual["forward"], slope / motion.usual["forward"]

    return least_squares(
        lambda x: at(x.tobytes())[0],
        start,
        jac=lambda x: at(x.tobytes())[1],
        bounds=(lower, upper),
        max_nfev=EVALUATIONS,
    )


def _at_bounds(room: Mapping[str, tuple[float, float]]) -> Iterator[str]:
    """Numbers that end at a bound, of their room to the least and the largest; not those that a law does without."""
    gone = [name for name in VANISHING if name in room and room[name][0] < NEAR]
    gone += ["distance"] * ("breakaway" in gone)
    yield from (name for name, both in room.items() if name not in gone and min(both) < NEAR)


def _described(loop: MeasuredLoop, name: str, found: _Found, points: float) -> LoopFit:
    left, J = loop.force - found.force, found.jacobian
    mean, numbers = float(left @ left) / len(left), len(found.x)
    covariance = np.linalg.pinv(J.T @ J) * mean * len(left) / max(points - numbers, 1.0)
    stds = np.abs(found.slopes) * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return LoopFit(
        law=name,
        values=dict(zip(found.free, found.values.tolist(), strict=True)),
        stds=dict(zip(found.free, stds.tolist(), strict=True)),
        left=float(np.sqrt(mean / np.mean(loop.force**2))),
        work=MeasuredLoop(loop.name, loop.time, loop.displacement, found.force).work,
        work_measured=loop.work,
        bic=float(points * np.log(mean) + numbers * np.log(points)),
        force=found.force,
        at_bounds=found.at_bounds,
    )
