"""Numbers of joints: exact derivatives, curves along them."""

import numpy as np
import pytest

from hbm.response.trace import steady_state
from hbm.sensitivity.jointed import joint_sensitivities
from hbm.tracking.parameterresponse import parameter_response
from models import Jenkins
from models.bodies.modal import ModalModel
from models.jointed import JointedRig
from models.joints import Friction, Joint
from models.joints.law import numbers
from models.parts import Damping, Excitation
from tests.joints.rigs import beam_rig

RIG = beam_rig(Friction(Jenkins(0.4, 1e-6), 5.0))
KEYS = (
    *("joints.rub.mu", "joints.rub.critical_slip", "joints.rub.normal_load", "joints.spring.linear"),
    *("joints.stop.gap", "joints.stop.stiffness", "joints.plane.mu", "joints.plane.normal_stiffness"),
    *("excitation.amplitude", "frequency_hz"),
)


@pytest.fixture(scope="module")
def solution() -> object:
    return steady_state(RIG, 45.0, harmonics=9, samples=512)


@pytest.mark.parametrize("key", KEYS)
def test_derivatives_are_those_of_solutions_nearby(solution: object, key: str) -> None:
    found = joint_sensitivities(RIG, solution, [key])
    value = float(found.values[0])
    step = 1e-5 * value

    def at(value: float) -> object:
        if key == "frequency_hz":
            return steady_state(RIG, value, harmonics=9, samples=512, start=solution)
        return steady_state(RIG.with_number(key, value), 45.0, harmonics=9, samples=512, start=solution)

    up, down = at(value + step), at(value - step)
    for name in ("drive", "x", "rub.force", "rub.motion", "stop.force", "plane.force.2", "plane.motion.3"):
        apart = (up[name].coefficients - down[name].coefficients) / (2 * step)
        assert np.abs(found[name].coefficients[:, 0] - apart).max() < 1e-3 * np.abs(apart).max(), name
        apart = (up[name].samples - down[name].samples) / (2 * step)
        assert np.abs(found[name].samples[:, 0] - apart).max() < 1e-3 * np.abs(apart).max(), name


def test_the_largest_friction_goes_with_its_limit(solution: object) -> None:
    """Whatever harmonics are kept: a series of them gave 7.6 to 12.9 for 10."""
    found = joint_sensitivities(RIG, solution, ["joints.rub.mu", "joints.rub.critical_slip"])
    assert solution["rub.force"].peak == pytest.approx(0.4 * 5.0)
    assert found["rub.force"].peak == pytest.approx([5.0, 0.0], abs=1e-9)


def test_a_curve_along_a_number_ends_where_a_single_solution_is(solution: object) -> None:
    curve = parameter_response(RIG, "joints.rub.mu", (0.4, 0.8), hz=45.0, harmonics=9)
    assert curve.complete
    last = steady_state(RIG.with_number("joints.rub.mu", 0.8), 45.0, harmonics=9)
    assert np.allclose(curve.points[-1]["drive"].coefficients, last["drive"].coefficients, rtol=0, atol=1e-9)


def test_a_number_that_is_none_is_refused_with_those_that_are() -> None:
    with pytest.raises(ValueError, match=r"joints.rub.nu is not a number of the rig.*joints.rub.mu"):
        parameter_response(RIG, "joints.rub.nu", (0.4, 0.8), hz=45.0)
    assert RIG.with_number("joints.rub.mu", 0.7).joints[0].law.law.mu == 0.7
    assert numbers(RIG.joints[0].law)["mu"] == 0.4


def test_a_curve_ends_next_to_where_its_number_must_not_be() -> None:
    body = ModalModel((20.0, 47.0), {"a": (1.0, 0.5), "b": (0.7, -0.9)})
    rub = Joint("j", Friction(Jenkins(0.4, 1e-4), 5.0), ("a",))
    rig = JointedRig("one", body, Damping(modal_ratios=(0.01,)), (rub,), Excitation(6.0, at="b"))
    curve = parameter_response(rig, "joints.j.critical_slip", (1e-3, 1e-7), hz=21.0, harmonics=3)
    assert curve.complete
    assert curve.values[-1] == 1e-7
