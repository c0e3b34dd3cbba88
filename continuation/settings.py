"""Settings of the corrector and of the tracer, checked when they are made."""

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np

from .problem import Array


class Predictor(Enum):
    """How the next point is guessed from those already found."""

    TANGENT = "along the tangent"
    SECANT = "along the chord of the last two points"
    CURVED = "along the tangent, bent by the change of the last two tangents"


@dataclass(frozen=True, kw_only=True)
class NewtonSettings:
    """When the corrector accepts and when it gives up.

    Attributes
    ----------
    tolerance : float
        Largest accepted max-norm of the residual; the caller's scaling of the residual gives it meaning.
    max_iterations : int
        Linearizations allowed in one correction.
    """

    tolerance: float = 1e-9
    max_iterations: int = 8

    def __post_init__(self) -> None:
        """Refuse settings that cannot work."""
        _check_positive("tolerance", self.tolerance)
        _check_count("max_iterations", self.max_iterations)


@dataclass(frozen=True, kw_only=True, eq=False)
class Settings(NewtonSettings):
    """Where to go, with which steps, in which metric.

    Lengths and angles are those of the metric |(dx, dlam)|^2 = sum(weights dx^2) + lam_weight dlam^2.

    Attributes
    ----------
    lam_end : float
        Target; the last point lies there to the last bit.
    lam_min, lam_max : float, optional
        The trace also ends where the curve leaves this interval; default: the interval from the start to `lam_end`.
    step, step_min, step_max : float
        First, smallest and largest arclength step.
    relative_step : float
        Largest step as a fraction of |x|, where that is more than `step_max`: a resonance a hundred times as high needs
        not a hundred times as many points.
    curve_tolerance : float
        Largest error of the cubic between two points (`Branch.dense`), judged at two places, as a fraction of |x|:
        steps are as long as that allows, and where it is not enough points are added. Default: not judged.
    target_iterations : int
        Newton matrices per point that the step control aims at.
    max_points : int
        Points after which the trace stops.
    max_angle : float
        Largest turn of the tangent over one step of a smooth piece [rad]; the step control aims at half of it.
    corner_angle : float
        Sudden turns below this angle [rad] are not looked at as corners.
    tangent_slack : float
        How far from a point, in steps, its tangent may be taken where that saves a linearization; exact near folds.
    weights : (N,) array, optional
        Positive weights of the unknowns in the metric; default: ones.
    lam_weight : float
        Weight of the parameter in the metric.
    predictor : Predictor
        How the next point is guessed.

    Raises
    ------
    ValueError
        If a value is out of range; the message shows it.
    """

    lam_end: float
    lam_min: float | None = None
    lam_max: float | None = None
    step: float = 0.05
    step_min: float = 1e-6
    step_max: float = 0.5
    relative_step: float = 0.0
    curve_tolerance: float = math.inf
    target_iterations: int = 3
    max_points: int = 2000
    max_angle: float = 0.5
    corner_angle: float = 0.15
    tangent_slack: float = 1e-3
    weights: Array | None = None
    lam_weight: float = 1.0
    predictor: Predictor = Predictor.TANGENT

    def __post_init__(self) -> None:
        """Refuse settings that cannot work."""
        super().__post_init__()
        self._check_interval()
        for name in ("step", "step_min", "step_max", "max_angle", "corner_angle", "tangent_slack", "lam_weight"):
            _check_positive(name, getattr(self, name))
        if not (math.isfinite(self.relative_step) and self.relative_step >= 0.0):
            raise ValueError(f"Settings: relative_step = {self.relative_step:g}; must be >= 0")
        if not self.curve_tolerance > 0.0:
            raise ValueError(f"Settings: curve_tolerance = {self.curve_tolerance:g}; must be > 0")
        for name in ("target_iterations", "max_points"):
            _check_count(name, getattr(self, name))
        if not self.step_min <= self.step <= self.step_max:
            raise ValueError(
                f"Settings: step = {self.step:g}; must lie between step_min = {self.step_min:g} "
                f"and step_max = {self.step_max:g}"
            )
        if not isinstance(self.predictor, Predictor):
            raise ValueError(f"Settings: predictor = {self.predictor!r}; must be a Predictor")
        if self.weights is not None and not (np.ndim(self.weights) == 1 and np.all(np.asarray(self.weights) > 0.0)):
            raise ValueError(f"Settings: weights = {self.weights}; must be a vector of numbers > 0")

    def _check_interval(self) -> None:
        if not math.isfinite(self.lam_end):
            raise ValueError(f"Settings: lam_end = {self.lam_end:g}; must be finite")
        low = -math.inf if self.lam_min is None else self.lam_min
        high = math.inf if self.lam_max is None else self.lam_max
        if not low <= self.lam_end <= high:
            raise ValueError(
                f"Settings: lam_end = {self.lam_end:g}; must lie between lam_min = {low:g} and lam_max = {high:g}"
            )

    def interval(self, lam0: float) -> tuple[float, float]:
        """Bounds of the parameter for a trace that starts at `lam0`.

        Raises
        ------
        ValueError
            If `lam0` lies outside, or is already `lam_end`.
        """
        low = min(lam0, self.lam_end) if self.lam_min is None else self.lam_min
        high = max(lam0, self.lam_end) if self.lam_max is None else self.lam_max
        if not low <= lam0 <= high:
            raise ValueError(f"trace: lam0 = {lam0:g}; must lie between lam_min = {low:g} and lam_max = {high:g}")
        if lam0 == self.lam_end:
            raise ValueError(f"trace: lam0 = {lam0:g} equals lam_end; they must differ")
        return low, high


def _check_positive(name: str, value: float) -> None:
    if not (value > 0.0 and math.isfinite(value)):
        raise ValueError(f"Settings: {name} = {value:g}; must be > 0 and finite")


def _check_count(name: str, value: int) -> None:
    if not (isinstance(value, int) and value >= 1):
        raise ValueError(f"Settings: {name} = {value}; must be a whole number >= 1")
