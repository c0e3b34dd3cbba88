"""Harmonic balance against time integration on the paper's beam, every stable branch, as a table.

The two share the mechanics and the friction law; harmonic balance has no time step, time integration no Fourier
series. Damping is ten times the paper's (alpha 0.6 1/s) so that transients end. Each harmonic balance solution is
the start of a shooting iteration; a solution that is unstable in time is listed and not compared.

Run: python benchmarks/two_paths.py
"""

from dataclasses import replace

import numpy as np
from rich.console import Console
from rich.table import Table

from hbm.balance.solution import PeriodicSolution, describe
from hbm.integration.handover import state_at_phase_zero
from hbm.integration.integrate import PeriodicMotion
from hbm.integration.integrate import steady_state as shoot
from hbm.response.curve import ResponseCurve
from hbm.response.trace import solve_near, trace_frequency
from models import Damping, Rig
from models.published import paper_rig

CHANNELS = ("drive", "slip", "friction", "normal")
HARMONICS = 5
NEUTRAL = 1e-6  # a contact that never slips has a multiplier at 1: its mean friction is what its history left
FREQUENCIES = (44.0, 45.5, 47.0, 48.0, 48.5, 49.0, 49.5, 50.5, 51.5, 52.0, 52.5, 53.5, 54.5, 56.0, 58.0, 60.0, 62.0)


def damped(rig: Rig, modes: int) -> Rig:
    """Return the rig with finite transients and enough modes that neither path is short of them."""
    return replace(rig, damping=Damping(mass_proportional=0.6)).with_modes(modes)


def solutions_at(curve: ResponseCurve, hz: float) -> list[PeriodicSolution]:
    """One solution for each crossing of the curve with a frequency."""
    problem, found = curve.problem, []
    for i in np.flatnonzero((curve.hz[:-1] - hz) * (curve.hz[1:] - hz) <= 0.0):
        near = curve.points[i if abs(curve.hz[i] - hz) <= abs(curve.hz[i + 1] - hz) else i + 1]
        lam = problem.lam_at(hz)
        solution = describe(problem, solve_near(problem, lam, near), lam)
        if not any(np.allclose(solution.state.Q, other.state.Q, rtol=1e-6) for other in found):
            found.append(solution)
    return found


def differences(solution: PeriodicSolution, motion: PeriodicMotion) -> dict[str, float]:
    """Largest difference of harmonics 1..5, relative to the channel's peak."""
    out = {}
    for name in CHANNELS:
        signal, history = solution.channels[name], motion.history.channels[name].values
        a, b = signal.coefficients, motion.history.coefficients(name, HARMONICS)
        H = len(a) // 2
        ours = np.concatenate([a[1 : HARMONICS + 1], a[H + 1 : H + 1 + HARMONICS]])
        out[name] = float(np.abs(ours - b[1:]).max() / np.abs(history - history.mean()).max())
    return out


def main() -> None:
    """Trace the curve, shoot from each solution, print the table."""
    rig = damped(paper_rig(), modes=8)
    curve = trace_frequency(rig, (43.0, 63.0), harmonics=27, samples=1024)
    table = Table("Hz", *(f"{name}\n%" for name in CHANNELS), "largest\nmultiplier", "compared")
    worst = 0.0
    for hz in FREQUENCIES:
        for solution in solutions_at(curve, hz):
            motion = shoot(rig, hz, start=state_at_phase_zero(solution), steps_per_period=2048)
            largest = float(np.abs(motion.multipliers[0]))
            change = differences(solution, motion)
            compared = motion.converged and largest < 1.0 + NEUTRAL
            worst = max(worst, *change.values()) if compared else worst
            reason = "yes" if compared else "unstable" if motion.converged else "no periodic motion found"
            table.add_row(f"{hz:g}", *(f"{100 * v:.3f}" for v in change.values()), f"{largest:.4f}", reason)
    Console().print(table, f"largest difference {worst:.3%} of the channel's peak")


if __name__ == "__main__":
    main()
