"""First solutions where no short way leads to them: joints that strike, resonances of hardly any damping."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from continuation import ConvergenceError
from hbm import steady_state, trace_frequency
from models import Jenkins
from models.bodies.modal import ModalModel
from models.jointed import JointedRig
from models.joints import CubicSpring, Friction, Joint, Stop
from models.parts import Damping, Excitation
from tests.joints.rigs import loaded

HZ, RATIO, STIFFNESS, FORCE = 10.0, 0.05, 4e4, 10.0


def largest(hz: float, periods: int = 100, steps: int = 4000) -> float:
    """Largest displacement [m] of an oscillator whose crack closes where it is positive, by a leap-frog of its own."""
    dt, omega = 1.0 / (hz * steps), 2 * np.pi * HZ
    force = FORCE * np.cos(2 * np.pi * np.arange(steps) / steps)
    x = v = top = 0.0
    for _ in range(periods):
        top = 0.0
        for F in force.tolist():
            v += dt * (F - 2 * RATIO * omega * v - (omega**2 + (STIFFNESS if x > 0.0 else 0.0)) * x)
            x += dt * v
            top = max(top, abs(x))
    return top


@pytest.mark.parametrize("hz", [15.38, 16.0, 17.0])
@pytest.mark.parametrize("harmonics", [7, 31])
def test_a_crack_that_closes_has_a_first_solution(hz: float, harmonics: int) -> None:
    """It is that of a march in time, to 0.2 %, and grows in proportion to the force: there is no scale but that."""
    body = ModalModel((HZ,), {"a": (1.0,)})
    crack = Joint("crack", Stop(STIFFNESS), ("a",))
    rig = JointedRig("crack", body, Damping(modal_ratios=(RATIO,)), (crack,), Excitation(FORCE, at="a"))
    found = steady_state(rig, hz, harmonics=harmonics)["drive"].peak
    assert found == pytest.approx(largest(hz), rel=2e-3)
    assert steady_state(rig, hz, level=0.01 * FORCE, harmonics=harmonics)["drive"].peak == pytest.approx(0.01 * found)


@pytest.mark.parametrize("hz", [9.999, 10.0, 10.0001])
def test_a_resonance_of_hardly_any_damping_has_a_first_solution(hz: float) -> None:
    """A ratio of 1e-5 and friction that takes 95 % of the force: the motion is a thousand times that of sticking.

    It is that of one harmonic of a Masing loop in closed form, to what the other harmonics bring (6e-4). Four samples
    lie on the elastic slip: it takes 6 mrad of the period.
    """
    ratio, force, limit, u_crit, omega_n, omega = 1e-5, 2.0, 1.5, 1e-5, 2 * np.pi * HZ, 2 * np.pi * hz

    def balance(a: float) -> float:
        turn = np.arccos(1.0 - 2.0 * u_crit / a)
        stiffness = limit / u_crit * (turn - np.sin(2.0 * turn) / 2.0) / np.pi
        lost = 4.0 * limit / np.pi * (1.0 - u_crit / a)
        return float(np.hypot((omega_n**2 - omega**2 + stiffness) * a, 2 * ratio * omega_n * omega * a + lost) - force)

    body = ModalModel((HZ,), {"a": (1.0,)})
    joint = Joint("rub", Friction(Jenkins(0.3, u_crit), limit / 0.3), ("a",))
    rig = JointedRig("light", body, Damping(modal_ratios=(ratio,)), (joint,), Excitation(force, at="a"))
    found = steady_state(rig, hz, samples=4096)
    assert found["drive"].amplitude[1] == pytest.approx(brentq(balance, 2.0 * u_crit, 10.0), rel=1e-3)


STIFF_BRISTLES = """
name = "bristles"
beam = { length = 0.606, width = 0.03888, thickness = 0.00478, youngs_modulus = 210e9, density = 7800.0, modes = 2 }
damping = { modal_ratios = [0.01] }
excitation = { amplitude = 20.0, position = 0.555 }
[[joints]]
name = "bristles"
law = "lugre"
mu_static = 0.12
mu = 0.1
stribeck_velocity = 0.01
stiffness = 1e7
bristle_damping = 300.0
viscous = 1.0
normal_load = 40.0
at = "y(0.25)"
"""


def test_a_law_that_is_not_solved_at_its_samples_is_no_steady_state(tmp_path: Path) -> None:
    """Too few samples for what bristles damp: Newton's method goes round in circles at some of them."""
    rig = loaded(tmp_path, STIFF_BRISTLES)
    fine = steady_state(rig, 55.0, harmonics=7, samples=4096)
    assert fine.closure < 1e-10
    with pytest.raises(ConvergenceError, match=r"not solved at its samples at 55 Hz, 20 N, .* try more samples"):
        steady_state(rig, 55.0, harmonics=7, samples=512, start=fine)


def test_a_curve_says_where_a_law_is_not_solved_at_its_samples() -> None:
    spring = Joint("spring", CubicSpring(1e6), ("a",))
    body = ModalModel((HZ,), {"a": (1.0,)})
    rig = JointedRig("spring", body, Damping(modal_ratios=(RATIO,)), (spring,), Excitation(FORCE, at="a"))
    curve = trace_frequency(rig, (15.0, 16.0), harmonics=5)
    assert curve.unsolved == [] and "not solved" not in str(curve)
    first, *others = curve.points
    open_loop = replace(curve, points=(replace(first, closure=0.42), *others))
    assert open_loop.unsolved == [(15.0, 15.0)]
    assert "no solution from 15 to 15 Hz, laws are not solved at their samples" in str(open_loop)
