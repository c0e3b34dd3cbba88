"""An oscillator by harmonicbalance (pip install harmonicbalance), which has one variable and 4 H + 1 samples.

Version 0.2.0 differentiates with the wrong sign, `Fourier.dt()` is -dx/dt: the damping carries a minus here. Its
solver does not look at scipy's `success` and, with the default settings, misses most points: `use_jac=True`, and
every residual is checked here.
"""

import contextlib
import io
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

import numpy as np

from benchmarks.cases import Case, Traced

STEP = 0.05  # arclength over coefficients and rad/s: of five tried the longest whose peak has four digits
CLOSED = 1e-6


def prepared(case: Case) -> Callable[[], tuple[Traced, Callable[[], Any]]]:
    """What traces the case once, and returns the curve with a residual and its derivative at its top."""
    from harmonicbalance.fourier import Fourier
    from harmonicbalance.predictorcorrector import PredictorCorrectorSolver
    from harmonicbalance.solvers import numerical_jacobian

    damping = float(np.ravel(case.rig.structure.damping)[0])
    begin, end = (2 * np.pi * hz for hz in case.hz)

    def residual(X: Any) -> Any:
        U = Fourier(omega=X.omega, n=case.H)
        U[1] = case.rig.excitation.amplitude
        return X.dt().dt() - damping * X.dt() + X - X.nonlinearity(case.march) - U

    def balance(params: np.ndarray) -> np.ndarray:
        return residual(Fourier.from_params(params)).coeffs()

    def run() -> tuple[Traced, Callable[[], Any]]:
        start = Fourier(omega=begin, n=case.H)
        solver = PredictorCorrectorSolver(
            residual, start, alpha_start=begin, alpha_end=end, alpha_step=STEP, use_jac=True, tol=1e-10
        )
        with contextlib.redirect_stdout(io.StringIO()):
            found = solver.solve()
        good = [X for X in found if np.abs(residual(X).coeffs()).max() < CLOSED]
        hz, drive = np.array([X.omega / (2 * np.pi) for X in good]), np.array([X.coeffs() for X in good])
        name = f"harmonicbalance {version('harmonicbalance')}"
        curve = Traced(name, hz, drive, 4 * case.H + 1, len(found) - len(good))
        top = good[int(np.argmax(curve.height))]
        return curve, lambda: (balance(top.params()), numerical_jacobian(balance, top.params()))

    return run
