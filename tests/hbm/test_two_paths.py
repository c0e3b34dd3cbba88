"""Harmonic balance against time integration: two codes that share the mechanics and the law, and no method."""

from dataclasses import replace

import numpy as np
import pytest
from rigs import beam

from hbm.integration.handover import state_at_phase_zero
from hbm.integration.integrate import simulate
from hbm.integration.integrate import steady_state as shoot
from hbm.response.trace import steady_state
from models import Attachments, Coulomb, FrictionLaw, Jenkins, PointMass, PointSpring, Resonator, Stribeck, Viscous

CHANNELS = ("drive", "slip", "friction", "normal")
CASES = [
    (Jenkins(0.52, 4.15e-6), 47.0),
    (Jenkins(0.52, 4.15e-6), 49.0),
    (Jenkins(0.52, 4.15e-6), 53.5),
    (Coulomb(0.52), 50.0),
    (Coulomb(0.52), 56.0),
    (Stribeck(mu_static=0.55, mu=0.5, stribeck_velocity=2e-3, critical_slip=4e-6), 49.5),
    (Viscous(300.0), 48.5),
]


def harmonics(coefficients: np.ndarray, highest: int = 5) -> np.ndarray:
    H = len(coefficients) // 2
    return np.concatenate([coefficients[1 : highest + 1], coefficients[H + 1 : H + 1 + highest]])


@pytest.mark.parametrize(("law", "hz"), CASES, ids=lambda v: v if isinstance(v, float) else v.name)
def test_harmonics_agree_with_the_periodic_motion_in_time(law: FrictionLaw, hz: float):
    """0.5 % of each channel's peak, harmonics 1..5."""
    rig = beam(law, modes=6)
    solution = steady_state(rig, hz, harmonics=25, samples=1024)
    motion = shoot(rig, hz, start=state_at_phase_zero(solution), steps_per_period=2048)
    assert motion.converged
    for name in CHANNELS:
        values = motion.history.channels[name].values
        ours, theirs = solution.channels[name].coefficients, motion.history.coefficients(name, 5)
        peak = np.abs(values - values.mean()).max()
        assert np.abs(harmonics(ours) - theirs[1:]).max() < 5e-3 * peak, name


def test_march_from_rest_settles_on_the_harmonic_balance():
    """No shooting: the transient dies out by itself (alpha 12 1/s)."""
    rig = beam(alpha=12.0)
    history = simulate(rig, 49.0, duration=3.0, steps_per_period=512, last_periods=2)
    solution = steady_state(rig, 49.0, harmonics=25, samples=1024)
    assert history.steadiness < 1e-6
    for name in CHANNELS:
        theirs = history.coefficients(name, 5)
        assert np.abs(harmonics(solution.channels[name].coefficients) - theirs[1:]).max() < 5e-3 * np.abs(theirs).max()


@pytest.mark.parametrize("support", [None, 1e6], ids=["rigid support", "support yields"])
def test_attached_springs_masses_and_resonators_act_alike_in_time(support: float | None):
    """0.5 % of each channel's peak; the reaction has an elastic part here."""
    attached = Attachments(
        clamp_stiffness=5e3,
        support_stiffness=support,
        tip_stiffness=50.0,
        masses=(PointMass(0.01, 0.4),),
        springs=(PointSpring(500.0, 0.25),),
        resonators=(Resonator(0.02, 70.0, 0.3),),
    )
    rig = replace(beam(Jenkins(0.52, 4.15e-6), modes=6), attachments=attached)
    solution = steady_state(rig, 47.5, harmonics=25, samples=1024)
    motion = shoot(rig, 47.5, start=state_at_phase_zero(solution), steps_per_period=2048)
    assert motion.converged
    for name in CHANNELS:
        values = motion.history.channels[name].values
        ours, theirs = solution.channels[name].coefficients, motion.history.coefficients(name, 5)
        peak = np.abs(values - values.mean()).max()
        assert np.abs(harmonics(ours) - theirs[1:]).max() < 5e-3 * peak, name
