"""Settings of traces over the frequency or the force, and of Newton's method for a single state."""

import math
from dataclasses import replace

import numpy as np

from continuation import NewtonSettings, Predictor, Settings
from hbm.balance.problem import TOLERANCE, AnyBalance

CURVE_TOLERANCE = 1.5e-3
"""Largest error of the curve between its points (:attr:`hbm.response.curve.ResponseCurve.dense`), of the motion."""

FEWEST = 10
"""Steps over a sweep at least, where the motion is small."""

RELATIVE_STEPS = {"free": 0.5, "scouted": 0.05, "asked": 0.01}
"""Largest step as a fraction of the motion, where that is more: on tall resonances; less where a step was asked for, or
where the error of the curve between its points is not judged."""

EXCURSION = 0.3
"""How far, relatively, a branch is followed beyond the ends of the sweep."""


def newton_settings() -> NewtonSettings:
    """Settings of Newton's method for a single state."""
    return NewtonSettings(tolerance=TOLERANCE, max_iterations=30)


def trace_settings(problem: AnyBalance, lam0: float, lam_end: float, step_max: float | None = None) -> Settings:
    """Settings of a trace from `lam0` to `lam_end`, with a largest step where one is asked for."""
    relative = RELATIVE_STEPS["free" if step_max is None else "asked"]
    step_max = abs(lam_end - lam0) / FEWEST if step_max is None else step_max
    # a reference amplitude counts as much as the whole sweep; the friction force follows from the motion and turns
    # much faster: it hardly counts
    weights = np.full(problem.size, (lam_end - lam0) ** 2)
    weights[problem.basis.size * problem.structure.n :] *= 1e-3
    return Settings(
        lam_end=lam_end,
        # a branch may fold back past its start and return
        lam_min=min(lam0, lam_end) * (1.0 - EXCURSION),
        lam_max=max(lam0, lam_end) * (1.0 + EXCURSION),
        step=step_max / 5,
        step_min=step_max * 1e-6,
        step_max=step_max,
        relative_step=relative,
        curve_tolerance=CURVE_TOLERANCE,
        target_iterations=4,
        tolerance=TOLERANCE,
        weights=weights,
        max_points=20000,
        max_angle=2.0,
        corner_angle=0.5,
        tangent_slack=0.01,
        predictor=Predictor.CURVED,
    )


def ramp_settings(problem: AnyBalance, lam0: float, lam_end: float, step_max: float) -> Settings:
    """Settings of a way to a solution: nobody looks at what lies between its points."""
    settings = trace_settings(problem, lam0, lam_end, step_max)
    return replace(settings, max_points=300, relative_step=RELATIVE_STEPS["free"], curve_tolerance=math.inf)
