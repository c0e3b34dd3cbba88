"""First solutions of joints that strike, where no way through the balance leads to them."""

import numpy as np
import pytest

from hbm import steady_state
from models.bodies.modal import ModalModel
from models.jointed import JointedRig
from models.joints import Joint, Stop
from models.parts import Damping, Excitation

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
