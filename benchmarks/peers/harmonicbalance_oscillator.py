"""The oscillator by harmonicbalance (pip install harmonicbalance).

Version 0.2.0 differentiates with the wrong sign, `Fourier.dt()` is -dx/dt: the damping carries a minus here. Its
solver does not look at scipy's `success` and, with the default settings, misses most points: `use_jac=True`, and
every residual is checked here.
"""

import contextlib
import io
from importlib.metadata import version
from typing import Any

import numpy as np
from cases import Case, Row, load, seconds, timed

STEP = 0.05  # arclength over coefficients and rad/s: of five tried the longest whose peak has four digits
CLOSED = 1e-6


def row(case: Case) -> Row:
    """Time the oscillator."""
    from harmonicbalance.fourier import Fourier
    from harmonicbalance.predictorcorrector import PredictorCorrectorSolver
    from harmonicbalance.solvers import numerical_jacobian

    rig = case.rig
    law, damping = rig.contact.law, rig.damping.mass_proportional
    limit = law.mu * rig.contact.normal_load
    stiffness = limit / law.critical_slip
    begin, end = (2 * np.pi * hz for hz in case.hz)

    def friction(u: np.ndarray) -> np.ndarray:
        spring, before, force = 0.0, 0.0, []
        for now in [*u.tolist(), *u.tolist()]:
            spring = min(max(spring + stiffness * (now - before), -limit), limit)
            before = now
            force.append(spring)
        return np.array(force[len(u) :])

    def residual(X: Any) -> Any:
        U = Fourier(omega=X.omega, n=case.H)
        U[1] = rig.excitation.amplitude
        return X.dt().dt() - damping * X.dt() + X + X.nonlinearity(friction) - U

    def solved(_: None) -> Any:
        start = Fourier(omega=begin, n=case.H)
        solver = PredictorCorrectorSolver(
            residual, start, alpha_start=begin, alpha_end=end, alpha_step=STEP, use_jac=True, tol=1e-10
        )
        with contextlib.redirect_stdout(io.StringIO()):
            return solver.solve()

    found, wall, cpu = timed(solved)
    good = [X for X in found if np.abs(residual(X).coeffs()).max() < CLOSED]
    drive = np.array([X.coeffs() for X in good])
    top = good[int(np.argmax(np.abs(drive[:, 1] + 1j * drive[:, case.H + 1])))]

    def balance(params: np.ndarray) -> np.ndarray:
        return residual(Fourier.from_params(params)).coeffs()

    return Row(
        tool=f"harmonicbalance {version('harmonicbalance')}",
        wall=wall,
        cpu=cpu,
        hz=[X.omega / (2 * np.pi) for X in good],
        drive=drive.tolist(),
        rejected=len(found) - len(good),
        linearize=seconds(lambda: (balance(top.params()), numerical_jacobian(balance, top.params()))),
        load=load(),
    )
