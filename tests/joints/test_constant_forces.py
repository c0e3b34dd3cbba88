"""Joints whose force depends on no signal: the rig is linear, and all that is known of it has a closed form."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest

from hbm import nonlinear_mode, sensitivities, stability_of, steady_state, trace_frequency
from hbm.aft.joint import JointOverPeriod
from hbm.fourier import FourierBasis
from hbm.integration.jointed import joint_steady_state
from models import Frictionless
from models.bodies.modal import ModalModel
from models.jointed import JointedRig
from models.joints import Friction, Joint, JointLaw
from models.joints.springs import Memoryless
from models.parts import Damping, Excitation

HZ, RATIO, FORCE, PUSH, AT = 10.0, 0.05, 3.0, -1.5, 9.0


@dataclass(frozen=True, eq=False)
class Constant(Memoryless):
    """A dead load."""

    name: ClassVar[str] = "constant"

    def force(self, u: Any, v: Any) -> list[Any]:
        """The same always."""
        return [PUSH]


LAWS: dict[str, tuple[JointLaw, float]] = {
    "none": (Friction(Frictionless(), 1.0), 0.0),
    "none, pressed": (Friction(Frictionless(), 1.0, 1e3), 0.0),
    "constant": (Constant(), PUSH),
}


def rig_with(law: JointLaw) -> JointedRig:
    """One mode, which its joint pushes along the first port."""
    body = ModalModel((HZ,), {"a": (1.0,), "held": (0.0,)})
    joint = Joint("joint", law, ("a", "held")[: law.ports])
    return JointedRig("pushed", body, Damping(modal_ratios=(RATIO,)), (joint,), Excitation(FORCE, at="a"))


@pytest.mark.parametrize("name", LAWS)
def test_a_joint_of_constant_force_leaves_the_rig_linear(name: str) -> None:
    """A mean deflection, the linear resonance curve, multipliers of the free decay, a backbone that stays put."""
    law, push = LAWS[name]
    rig, omega, omega_n = rig_with(law), 2 * np.pi * AT, 2 * np.pi * HZ
    found = steady_state(rig, AT, harmonics=3)
    drive = found["drive"].coefficients
    assert drive[0] == pytest.approx(push / omega_n**2, abs=1e-15)
    receptance = 1.0 / (omega_n**2 - omega**2 + 2j * RATIO * omega_n * omega)
    assert drive[1] - 1j * drive[4] == pytest.approx(FORCE * receptance, rel=1e-9)

    decay = omega_n * (-RATIO + 1j * np.sqrt(1.0 - RATIO**2))
    assert np.abs(stability_of(rig, found).multipliers).max() == pytest.approx(np.exp(decay.real / AT), rel=1e-6)
    curve = trace_frequency(rig, (8.0, 12.0), harmonics=3)
    assert curve.peak.hz == pytest.approx(HZ * np.sqrt(1.0 - 2.0 * RATIO**2), abs=0.01)
    marched = joint_steady_state(rig, AT).history.coefficients("drive", 3)
    assert marched == pytest.approx(drive, abs=1e-4 * np.abs(drive).max())
    by_hz = sensitivities(rig, found, ("frequency_hz",))["drive"].coefficients[:, 0]
    expected = FORCE * receptance**2 * (2 * omega - 2j * RATIO * omega_n) * 2 * np.pi
    assert by_hz[1] - 1j * by_hz[4] == pytest.approx(expected, rel=1e-9)
    assert nonlinear_mode(rig, amplitudes=(1e-3, 1e-2), harmonics=3).hz == pytest.approx(HZ, rel=1e-6)


@pytest.mark.parametrize("name", LAWS)
def test_a_constant_force_answers_no_change(name: str) -> None:
    """Neither by matrices nor without one."""
    law, _ = LAWS[name]
    basis = FourierBasis(3, 32)
    joint = JointOverPeriod(law, basis)
    signals = np.random.default_rng(0).normal(size=(basis.size, 2 * law.ports + 1))
    change = np.ones((*signals.shape, 2))
    assert not joint.pushed(signals, 60.0, change)[:, 0].any()
    assert not joint.linearize(signals, 60.0).by_signals[:, 0].any()
