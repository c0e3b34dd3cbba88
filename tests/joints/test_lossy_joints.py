"""A loss factor and a play in every solver: closed form, harmonic balance, time integration, stability."""

import numpy as np
import pytest

from hbm.balance.jointed import JointBalance
from hbm.integration.jointed import joint_steady_state, state_at_phase_zero
from hbm.response.bifurcations import stability_of
from hbm.response.trace import steady_state
from hbm.sensitivity.jointed import joint_sensitivities
from models.bodies import ModalModel
from models.jointed import JointedRig
from models.joints import Backlash, HystereticDamping, Joint, JointLaw
from models.parts import Channel, Damping, Excitation

HZ, RATIO, SHAPE, FORCE = (20.0, 47.0), (0.002, 0.002), (0.8, -0.6), 2.0
LOSS = 300.0
LAWS = {"loss factor": HystereticDamping(LOSS, 30.0), "backlash": Backlash(4000.0, 0.6, 4e-4)}


def rig_with(law: JointLaw) -> JointedRig:
    body = ModalModel(HZ, {"p": SHAPE, "drive": (0.7, 0.9)})
    channels = (Channel("force", "force"), Channel("x", "displacement", at="p"))
    return JointedRig(
        "lossy", body, Damping(modal_ratios=RATIO), (Joint("j", law, ("p",)),), Excitation(FORCE, at="drive"), channels
    )


@pytest.mark.parametrize("hz", [19.5, 20.1, 46.0, 47.5])
def test_the_response_is_that_of_a_complex_stiffness(hz: float) -> None:
    """Two modes on a spring of i LOSS and what causality adds to it, 2/pi LOSS ln(f / reference): to 2 %."""
    row, drive, w = np.array(SHAPE), np.array([0.7, 0.9]), 2 * np.pi * hz
    w0 = 2 * np.pi * np.array(HZ)
    dynamic = np.diag(w0**2 - w**2 + 2j * np.array(RATIO) * w0 * w).astype(complex)
    dynamic += LOSS * (2.0 / np.pi * np.log(hz / 30.0) + 1j) * np.outer(row, row)
    expected = row @ np.linalg.solve(dynamic, drive * FORCE)
    solution = steady_state(rig_with(LAWS["loss factor"]), hz, harmonics=3, samples=256)
    found = solution.basis.complex(solution["x"].coefficients)[1]
    assert abs(found - expected) < 0.02 * abs(expected)


@pytest.mark.parametrize("name", LAWS)
def test_harmonic_balance_time_integration_and_stability_agree(name: str) -> None:
    rig, H, n = rig_with(LAWS[name]), 25, 1024
    solution = steady_state(rig, 20.6, harmonics=H, samples=n)
    assert abs(solution.energy_error) < 1e-4
    problem = JointBalance(rig, solution.basis)
    period = joint_steady_state(rig, 20.6, steps_per_period=n, start=state_at_phase_zero(problem, solution.state))
    for channel in ("x", "j.force"):
        a, b = solution[channel].coefficients, period.history.coefficients(channel, H)
        assert np.hypot(*(a - b)[[1, H + 1]]) < 5e-3 * np.hypot(*a[[1, H + 1]]), channel
    own = np.abs(np.linalg.eigvals(period.monodromy)).max()
    assert stability_of(rig, solution).largest == pytest.approx(own, abs=0.02)


@pytest.mark.parametrize("name", LAWS)
def test_sensitivities_are_those_of_differences(name: str) -> None:
    rig = rig_with(LAWS[name])
    solution = steady_state(rig, 20.6, harmonics=7, samples=512)
    keys = [key for key in rig.numbers if key.startswith("joints.j.")]
    found = joint_sensitivities(rig, solution, keys)
    for i, key in enumerate(keys):
        value, e = rig.number(key), 1e-4
        up, down = (
            steady_state(rig.with_numbers({key: value * (1 + s * e)}), 20.6, harmonics=7, samples=512, start=solution)
            for s in (1, -1)
        )
        by_difference = (up["x"].coefficients - down["x"].coefficients) / (2 * e * value)
        exact = found["x"].coefficients[:, i]
        assert np.abs(exact - by_difference).max() < 1e-3 * np.abs(by_difference).max(), key
