"""Steps of joints in time: short enough for stiff contacts, by themselves or with one line; their exact derivatives."""

from dataclasses import replace

import numpy as np
import pytest

from hbm.balance.jointed import JointBalance
from hbm.fourier import FourierBasis
from hbm.integration.integrate import simulate
from hbm.integration.jointmarch import MOST_STEPS, JointMarcher, resolving_steps
from hbm.response.trace import steady_state
from hbm.stability.jointed import joint_stability
from models import Damping, Excitation, FrictionLaw, Jenkins, Stribeck
from models.bodies import ModalModel
from models.bodies.finite import FiniteBeam
from models.jointed import JointedRig
from models.joints import CubicSpring, Friction, Joint, PolynomialSpring

from .rigs import BEAM

PLACES = ("0.00739*slope(0.606) + axial(0.606)", "-1*y(0.606)")


PENALTY = Jenkins(0.52, 4.15e-6)


def stiff(law: FrictionLaw = PENALTY, modes: int = 10) -> JointedRig:
    """The paper's beam on a support of 1e9 N/m, far stiffer than the beam."""
    tip = Joint("tip", Friction(law, 83.0, 1e9), PLACES)
    body = FiniteBeam(replace(BEAM, modes=modes), tip="free")
    return JointedRig("stiff tip", body, Damping(0.06), (tip,), Excitation(6.5, 0.555))


def test_too_few_steps_are_refused_with_how_many_are_enough() -> None:
    rig = stiff()
    told = r"^time step: stiff tip at 50 Hz: in 128 steps per period motions about rest grow by exp\(.*; try 512 steps$"
    with pytest.raises(ArithmeticError, match=told):
        simulate(rig, 50.0, duration=0.02, steps_per_period=128)
    enough = simulate(rig, 50.0, duration=0.1, steps_per_period=512).channels["drive"].values
    more = simulate(rig, 50.0, duration=0.1, steps_per_period=2048).channels["drive"].values[::4]
    assert np.abs(enough - more).max() < 0.02 * np.abs(more).max()


def test_steps_resolve_the_highest_mode_unless_given() -> None:
    rig = stiff(modes=15)
    assert simulate(rig, 50.0, duration=0.02).samples_per_period == 1024
    assert resolving_steps(rig, 50.0, 100) == 800
    with pytest.raises(
        ArithmeticError, match=f"needs 65536 steps per period of 1 Hz; must be <= {MOST_STEPS}; keep few"
    ):
        simulate(rig, 1.0, duration=1.0)


def test_a_rig_that_is_unstable_at_rest_is_marched_all_the_same() -> None:
    """A spring that pushes away: what grows is the rig, in steps of any length."""
    pushed = Joint("away", CubicSpring(-1e12), ("y(0.606)",))
    soft = Joint("soft", Friction(Jenkins(0.4, 1e-5), 5.0), ("y(0.3)",))
    rig = JointedRig("pushed", FiniteBeam(BEAM, tip="free"), Damping(0.06), (soft, pushed), Excitation(0.1, 0.555))
    assert simulate(rig, 40.0, duration=0.1, steps_per_period=64).samples_per_period == 64


def test_stability_of_a_stiff_contact_does_not_depend_on_the_samples() -> None:
    """In 128 steps a period the march itself is unstable: multipliers of 1e33 in place of 1."""
    rig = stiff()
    found = []
    for samples in (128, 1024):
        solution = steady_state(rig, 55.0, harmonics=9, samples=samples)
        found.append(joint_stability(JointBalance(rig, FourierBasis(9, samples)), solution.state))
    assert JointMarcher(rig, 55.0, 6.5, 128).excess > 1.0
    assert found[0].stable
    assert found[1].stable
    assert abs(found[0].multipliers).max() == pytest.approx(abs(found[1].multipliers).max(), abs=0.02)


@pytest.mark.parametrize("law", [Jenkins(0.52, 4.15e-6), Stribeck(0.52, 0.3, 1e-3, 4.15e-6)], ids=lambda law: law.name)
def test_derivative_of_a_step_is_that_of_differences(law) -> None:
    marcher = JointMarcher(stiff(law, modes=4), 50.0, 6.5, 512)
    X, _ = marcher.period(np.zeros(marcher.size))
    before = np.vstack([np.zeros((1, marcher.size)), X[:-1]])
    exact = marcher.step.jacobians(before, X, marcher.told)
    size = np.abs(before).max(axis=0)
    for k in (7, 150, 400):
        by_difference = np.zeros_like(exact[k])
        for i in range(marcher.size):
            e = np.zeros(marcher.size)
            e[i] = 1e-6 * max(size[i], 1e-6)
            up, down = (marcher.step.march(before[k] + sign * e, marcher.told[k : k + 1])[0][0] for sign in (1, -1))
            by_difference[:, i] = (up - down) / (2 * e[i])
        scale = np.abs(by_difference).max(axis=1, keepdims=True)
        np.testing.assert_allclose(exact[k] / scale, by_difference / scale, atol=1e-4)


def test_a_step_that_full_newton_steps_do_not_solve_is_solved_with_shorter_ones() -> None:
    """Long steps between a buckled spring and an element of 5e6 N/m that starts to slip, from either side."""
    body = ModalModel((10.0, 35.0), {"a": (1.0, 0.6), "b": (0.5, -0.8)})
    joints = (
        Joint("f", Friction(Jenkins(0.5, 1.2e-5), 128.0), ("a",)),
        Joint("c", PolynomialSpring(linear=-860.0, cubic=7e6), ("b",)),
    )
    rig = JointedRig("snapping", body, Damping(0.01), joints, Excitation(44.0, at="a"))
    marcher = JointMarcher(rig, 10.0, 44.0, 32)
    x = np.zeros(marcher.size)
    for _ in range(3):
        X, residual = marcher.period(x)
        assert residual < 1e-9
        x = X[-1]
