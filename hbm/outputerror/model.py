"""A model is a nominal rig with calibrated numbers, extended by causes: coordinates in, a rig out."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from hbm.fourier import Array
from hbm.outputerror.nominal import RESIDUALS, SHAPES, nominal_scalars, tolerances
from models.causes.cause import Cause, Unknown
from models.jointed import AnyRig

WIDE = 20.0
"""A number between positive bounds this factor apart is not fitted as it is."""

STEP = 1e-6
"""Of coordinates, of inverse ones as a share of them, for the derivative of a rig's numbers to them; no solution is
differentiated so."""

ASIDE = 1e-3
"""So far from where they start coordinates are no more neutral."""

BOUND, FAR = 3.0, 3.5
"""Calibrated numbers stay within this factor of the nominal ones, and within so many standard deviations: what asks for
more is missing physics, or a number that is wrong, which calibration must not hide."""

FAINT = 1e-9
"""A number of a cause that starts above 0 and may come down to it ends at so much of that: laws refuse to be none. The
inverse of one whose effect vanishes where it is infinite does too: there it has no slope."""

Form = Literal["linear", "logarithmic", "inverse"]


@dataclass(frozen=True)
class Free:
    """A free number and its coordinate, in which effects are near linear.

    Attributes
    ----------
    name, unit : str
    lower, upper, start : float
        Bounds of the number, and where fits start.
    form : str
        The coordinate is the number divided by `scale`, its logarithm, or `scale` divided by it: the last for a
        stiffness whose effect vanishes where it is infinite.
    scale : float
    expected, std : float
        Mean and standard deviation of the coordinate before anything is measured; std may be inf.
    cause : int
        Which cause it belongs to; -1 for a calibrated number of the rig file.
    """

    name: str
    unit: str
    lower: float
    upper: float
    start: float
    form: Form = "logarithmic"
    scale: float = 1.0
    expected: float = 0.0
    std: float = np.inf
    cause: int = -1

    def of(self, value: float) -> float:
        """Coordinate of a value."""
        if self.form == "linear":
            return value / self.scale
        return float(np.log(value)) if self.form == "logarithmic" else self.scale / value

    def value(self, x: float) -> float:
        """Value at a coordinate."""
        if self.form == "linear":
            found = x * self.scale
        else:
            found = float(np.exp(x)) if self.form == "logarithmic" else self.scale / x if x else np.inf
        return float(min(max(found, self.lower), self.upper))

    def slope(self, x: float) -> float:
        """Derivative of the value to the coordinate."""
        if self.form == "linear":
            return self.scale
        if self.form == "logarithmic":
            return self.value(x)
        return -self.scale / x**2 if x else -np.inf  # an infinite stiffness may be any that is large

    @property
    def bounds(self) -> tuple[float, float]:
        """Bounds of the coordinate."""
        ends = self.of(self.lower), self.of(self.upper)
        return min(ends), max(ends)


def free_of(unknown: Unknown, cause: int, tolerance: float = np.inf) -> Free:
    """Free number of an unknown of a cause, its neutral value known to within a relative standard deviation."""
    positive = unknown.lower > 0.0 and unknown.upper / unknown.lower > WIDE
    form: Form = "linear" if not positive else "inverse" if np.isinf(unknown.neutral) else "logarithmic"
    scale = unknown.starts[-1] if form == "inverse" else max(abs(s) for s in unknown.starts) or 1.0
    least = FAINT * scale if form == "linear" and unknown.starts[0] > 0.0 else 0.0
    most = max(scale / FAINT, unknown.starts[0]) if form == "inverse" else np.inf
    lower, upper = float(unknown.lower) or least, min(float(unknown.upper), most)
    free = Free(unknown.name, unknown.unit, lower, upper, unknown.starts[0], form, scale, cause=cause)
    if not np.isfinite(tolerance):
        return free
    expected = free.of(unknown.neutral)
    return replace(free, expected=expected, std=tolerance * (1.0 if form == "logarithmic" else expected))


def calibrated_of(rig: AnyRig, key: str, value: float, std: float) -> Free:
    """Free number that is expected to be what the rig file says, within a standard deviation and its own bounds."""
    accepted = rig.numbers[key][1]
    unit = accepted.unit
    least = float(np.nextafter(accepted.lower, np.inf)) if accepted.strict else accepted.lower
    most = accepted.upper
    if key.endswith(".position") and rig.beam is not None:
        most = min(most, float(rig.beam.length))
    if value == 0.0:
        lower, upper = max(-FAR * std, least), min(FAR * std, most)
        return Free(key, unit, lower, upper, 0.0, "linear", std, std=1.0)
    if value < 0.0 or key.startswith((SHAPES, RESIDUALS)):  # entries differ by shares of the largest
        reach = abs(value) * min(FAR * std, BOUND)
        lower, upper = max(value - reach, least), min(value + reach, most)
        return Free(key, unit, lower, upper, value, "linear", value, expected=1.0, std=std)
    factor = min(BOUND, float(np.exp(FAR * std)))
    lower, upper = max(value / factor, least), min(value * factor, most)
    return Free(key, unit, lower, upper, value, expected=float(np.log(value)), std=std)


@dataclass(frozen=True, eq=False)
class Model:
    """A nominal rig, the numbers that are calibrated, and causes.

    Attributes
    ----------
    nominal : Rig or JointedRig
    calibrated : dict of str to float
        Standard deviation of each calibrated number, relative where it is not 0; inf where it is free.
    causes : tuple of Cause
    """

    nominal: AnyRig
    calibrated: Mapping[str, float]
    causes: tuple[Cause, ...] = ()

    @property
    def label(self) -> str:
        """Names of the causes."""
        return " + ".join(cause.label for cause in self.causes) or "calibrated nominal"

    def extended_by(self, cause: Cause) -> "Model":
        """The model with one more cause."""
        return Model(self.nominal, self.calibrated, (*self.causes, cause))

    def with_cause(self, i: int, cause: Cause) -> "Model":
        """The model with another cause in the place of its i-th one."""
        return Model(self.nominal, self.calibrated, (*self.causes[:i], cause, *self.causes[i + 1 :]))

    @cached_property
    def unknowns(self) -> tuple[tuple[Unknown, ...], ...]:
        """Unknowns of each cause, for the rig that those before have extended."""
        rig, out = self.nominal, []
        for cause in self.causes:
            unknowns = cause.unknowns(rig)
            out.append(unknowns)
            rig = cause.extend(rig, {u.name: u.starts[0] for u in unknowns})
        return tuple(out)

    @cached_property
    def free(self) -> tuple[Free, ...]:
        """All free numbers, calibrated ones first; those that a cause decides are its own."""
        known = nominal_scalars(self.nominal)
        taken = {u.key for unknowns in self.unknowns for u in unknowns}
        calibrated = [
            calibrated_of(self.nominal, key, known[key], std)
            for key, std in self.calibrated.items()
            if key not in taken
        ]
        own = ((u, i) for i, unknowns in enumerate(self.unknowns) for u in unknowns)
        return (*calibrated, *(free_of(u, i, self._known(u)) for u, i in own))

    def _known(self, unknown: Unknown) -> float:
        """Relative standard deviation of a number of a cause before anything is measured."""
        known = {**tolerances(self.nominal), **self.calibrated} if unknown.known else {}
        return known.get(unknown.key, np.inf)

    @property
    def counted(self) -> int:
        """Numbers that the measurement alone decides: those that are free, and which place each joint is at."""
        placed = sum(bool(getattr(cause, "placed", False)) for cause in self.causes)  # one of a user's own may not say
        return sum(not np.isfinite(f.std) for f in self.free) + placed

    @property
    def start(self) -> Array:
        """Coordinates where the causes have next to no effect."""
        return np.array([f.of(f.start) for f in self.free])

    def at(self, values: Mapping[tuple[int, str], float]) -> Array:
        """Coordinates where the free numbers have these values, by cause and name, the others those of the start."""
        return np.array([f.of(values.get((f.cause, f.name), f.start)) for f in self.free])

    def bounds(self) -> tuple[Array, Array]:
        """Bounds of the coordinates."""
        low, high = np.array([f.bounds for f in self.free]).reshape(-1, 2).T
        return low, high

    def rig(self, x: Array) -> AnyRig:
        """The rig at coordinates."""
        rig = self.nominal.with_numbers(self.calibrated_at(x))
        for i, cause in enumerate(self.causes):
            rig = cause.extend(rig, self.values(x, i))
        return rig

    def calibrated_at(self, x: Array) -> dict[str, float]:
        """Calibrated numbers at coordinates; one that must not fall below another is raised with it."""
        values = self.values(x, -1)
        for key, other in self._ordered:
            low, least = (values.get(k, self.nominal.number(k)) for k in (key, other))
            if low < least:
                values |= {key: least} if key in values else {other: low}
        return values

    @cached_property
    def _ordered(self) -> tuple[tuple[str, str], ...]:
        """Numbers that must not fall below another, and that other, where one of both is calibrated."""
        known = {key: accepted.at_least for key, (_, accepted) in self.nominal.numbers.items()}
        pairs = [(key, f"{key.rpartition('.')[0]}.{other}") for key, other in known.items() if other]
        return tuple(pair for pair in pairs if not set(pair).isdisjoint(self.calibrated))

    def by_x(self, x: Array, rig: AnyRig) -> tuple[tuple[str, ...], Array]:
        """Numbers of the rig at coordinates that move with these, and their derivatives (p, n)."""
        here = nominal_scalars(rig)
        _, high = self.bounds()
        apart = self._apart and self.calibrated_at(x) == self.values(x, -1)
        columns = []
        for i, f in enumerate(self.free):
            if f.cause < 0 and apart:
                columns.append({f.name: f.slope(float(x[i]))})
                continue
            step = STEP * x[i] if f.form == "inverse" else STEP
            step = step if x[i] + step <= high[i] else -step
            moved = x.copy()
            moved[i] += step
            there = nominal_scalars(self.rig(moved))
            columns.append({key: (there[key] - value) / step for key, value in here.items() if there[key] != value})
        keys = tuple(key for key in here if any(key in column for column in columns))
        return keys, np.array([[column.get(key, 0.0) for column in columns] for key in keys]).reshape(len(keys), len(x))

    @cached_property
    def _apart(self) -> bool:
        """Whether a calibrated number moves no number of the rig but itself, whatever the causes are."""
        low, high = self.bounds()
        calibrated = np.array([f.cause < 0 for f in self.free], dtype=bool)
        aside = self.start + np.where(self.start + ASIDE <= high, ASIDE, np.maximum(low - self.start, -ASIDE))
        x, moved = np.where(calibrated, self.start, aside), aside
        here, there = (nominal_scalars(self.rig(at)) for at in (x, moved))
        changed = {key: there[key] for key, value in here.items() if there[key] != value}
        return changed == {f.name: f.value(v) for f, v in zip(self.free, moved, strict=True) if f.cause < 0}

    def values(self, x: Array, cause: int) -> dict[str, float]:
        """Parameters of a cause at coordinates, or with -1 what the coordinates of calibrated numbers say."""
        values = {f.name: f.value(v) for f, v in zip(self.free, x, strict=True) if f.cause == cause}
        ordered = [u for u in self.unknowns[cause] if u.least] if cause >= 0 else []
        return values | {u.name: max(values[u.name], values[u.least]) for u in ordered}
