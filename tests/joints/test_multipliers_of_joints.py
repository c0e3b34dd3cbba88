"""Floquet multipliers beside springs and stops, against the variational equation along the same motion."""

import numpy as np
import pytest
from scipy.linalg import expm

from continuation import Kind
from hbm.balance.solution import PeriodicSolution
from hbm.response.bifurcations import stability_of, with_stability
from hbm.response.branching import doubled
from hbm.response.trace import steady_state, trace_frequency
from models import Damping, Excitation
from models.bodies import ModalModel
from models.jointed import JointedRig
from models.joints import Joint, JointLaw, PolynomialSpring, Stop

STIFFNESS, GAP, DAMPING = 4.0, 0.5, 0.05
HZ = 1 / (2 * np.pi)
"""Of 1 rad/s, the natural frequency."""


def oscillator(law: JointLaw, force: float) -> JointedRig:
    """One of mass and stiffness 1."""
    body, damping = ModalModel((HZ,), {"a": (1.0,)}), Damping(modal_ratios=(DAMPING / 2,))
    return JointedRig("oscillator", body, damping, (Joint("j", law, ("a",)),), Excitation(force, at="a"))


def of_stop(solution: PeriodicSolution) -> np.ndarray:
    """Magnitudes of the multipliers, from 2^16 steps in each of which the stop is met or not."""
    steps = 2**16
    t = np.arange(steps) + 0.5
    motion, H = solution["drive"].coefficients, solution.basis.H
    phases = np.outer(2 * np.pi * t / steps, np.arange(1, H + 1))
    u = motion[0] + np.cos(phases) @ motion[1 : H + 1] + np.sin(phases) @ motion[H + 1 :]
    dt = 2 * np.pi / solution.state.Omega / steps
    free, met = (expm(dt * np.array([[0.0, 1.0], [-1.0 - k, -DAMPING]])) for k in (0.0, STIFFNESS))
    changes = np.flatnonzero(np.diff(u > GAP)) + 1
    found = np.eye(2)
    for stretch in np.split(u > GAP, changes):
        found = np.linalg.matrix_power(met if stretch[0] else free, len(stretch)) @ found
    return np.sort(np.abs(np.linalg.eigvals(found)))[::-1]


@pytest.mark.parametrize("w", [0.72, 0.76, 0.8, 1.3, 1.34])
def test_multipliers_beside_a_stop_are_as_exact_as_they_say(w: float) -> None:
    solution = steady_state(oscillator(Stop(STIFFNESS, GAP), 0.3), w * HZ, harmonics=25)
    stability = stability_of(oscillator(Stop(STIFFNESS, GAP), 0.3), solution)
    assert np.abs(stability.magnitudes[:2] - of_stop(solution)).max() < stability.error < 0.1


def test_multipliers_of_twice_the_period_too() -> None:
    rig = oscillator(Stop(STIFFNESS, GAP), 0.3)
    curve = with_stability(trace_frequency(rig, (0.79 * HZ, 0.83 * HZ), harmonics=15))
    (b,) = (b for b in curve.bifurcations if b.kind is Kind.PERIOD_DOUBLING)
    assert b.hz == pytest.approx(0.8117 * HZ, rel=1e-3)
    twice = doubled(curve, b)
    for solution in twice.points[2:9:3]:
        stability = stability_of(rig, solution)
        assert np.abs(stability.magnitudes[:2] - of_stop(solution)).max() < max(stability.error, 1e-4)


def test_multipliers_of_folds_beside_a_strong_spring_are_one() -> None:
    """It softens and hardens again: four folds. Marched from a point of the curve they were 0.983 to 1.0085."""
    curve = trace_frequency(oscillator(PolynomialSpring(cubic=-1.0, quintic=0.3), 0.05), (0.3 * HZ, 1.6 * HZ))
    found = with_stability(curve).bifurcations
    assert [b.kind for b in found] == [Kind.FOLD] * 4
    assert [b.hz for b in found] == pytest.approx(curve.folds, rel=1e-4)
    assert [b.multiplier for b in found] == pytest.approx([1.0] * 4, abs=1e-5)
