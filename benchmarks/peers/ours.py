"""A case by this package."""

import time
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from benchmarks.cases import CASES, Case, Traced
from hbm import ResponseCurve, trace_frequency, with_stability
from hbm.parallel import one_thread


def curve_of(case: Case, *, finer: int = 1) -> ResponseCurve:
    """Trace a case; `finer` divides the default step."""
    begin, end = case.hz
    step = None if finer == 1 else (end - begin) / (50 * finer)
    return trace_frequency(case.rig, case.hz, harmonics=case.H, samples=case.N_t, step_hz=step)


def traced(curve: ResponseCurve) -> Traced:
    """A curve as it is compared."""
    try:
        name = f"casadi-hbm {version('casadi-hbm')}"
    except PackageNotFoundError:
        name = "casadi-hbm"
    samples, dense = curve.problem.basis.N_t, curve.dense
    drawn = Traced(name, dense.hz, dense["drive"].coefficients, samples)
    return Traced(name, curve.hz, curve["drive"].coefficients, samples, drawn=drawn)


def prepared(case: Case) -> Callable[[], tuple[Traced, Callable[[], Any]]]:
    """What traces the case once, and returns the curve with one Newton iteration at its top."""

    def run() -> tuple[Traced, Callable[[], Any]]:
        curve = curve_of(case)
        problem, peak = curve.problem, curve.branch.points[int(np.argmax(curve["drive"].peak))]
        border = np.ones(problem.size)

        @one_thread
        def newton() -> None:
            linear = problem.linearize(peak.x, peak.lam)
            linear.solve_bordered(border, 1.0, -linear.residual, 0.0)

        return traced(curve), newton

    return run


def reference(case: Case, finer: int) -> Traced:
    """A fine curve."""
    return traced(curve_of(case, finer=finer))


def stability(name: str) -> float:
    """CPU seconds of the stability of a curve with its bifurcations, for each of its points."""
    curve = curve_of(CASES[name]())
    used = time.process_time()
    with_stability(curve)
    return (time.process_time() - used) / len(curve.points)
