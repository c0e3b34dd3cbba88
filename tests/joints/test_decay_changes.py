"""Derivatives of a free decay to the numbers of its rig, against differences of decays solved anew."""

import numpy as np
import pytest

from hbm.fourier import Array, FourierBasis
from hbm.modes.backbone import NonlinearMode
from hbm.modes.decaying import at_channel, near_states, over_channel
from hbm.modes.sensitivity import decay_changes
from models import Dahl, Jenkins
from models.bodies.modal import ModalModel
from models.jointed import JointedRig
from models.joints import CubicSpring, Friction, Joint
from models.parts import Channel, Damping, Excitation

AMPLITUDES = np.array([2.0, 5.0, 8.0])
BASIS = FourierBasis(5, 64)


def loaded_rig() -> JointedRig:
    """Two modes of three places with residual flexibility: a bristle, a cubic spring, a slider loaded by the motion."""
    flexibility = 1e-8 * np.array([[3.0, 1.0, 0.5], [1.0, 2.0, 0.3], [0.5, 0.3, 4.0]])
    body = ModalModel(
        (80.0, 210.0),
        {"a": (0.7, 0.4), "b": (-0.5, 0.6), "drive": (0.9, -0.3)},
        tuple(map(tuple, flexibility.tolist())),
        None,
        {"s": (3.0, 1.0)},
        {"s": (1e-3, 2e-3, 1e-3)},
    )
    joints = (
        Joint("bristle", Friction(Dahl(1.0, 2e4), 0.5), ("a",)),
        Joint("spring", CubicSpring(1e11), ("a",), ("b",)),
        Joint("slider", Friction(Jenkins(0.4, 2e-5), 5.0), ("b",), loaded_by="s"),
    )
    channels = (Channel("acc", "acceleration", at="b", gain=1.1, delay=1e-5),)
    return JointedRig("two modes", body, Damping(modal_ratios=(0.002,)), joints, Excitation(1.0, at="drive"), channels)


def found(rig: JointedRig) -> NonlinearMode:
    branch = over_channel(rig, 1, "acc", (float(AMPLITUDES[0]), float(AMPLITUDES[-1])), BASIS)
    return at_channel(branch, "acc", AMPLITUDES)


def described(mode: NonlinearMode) -> Array:
    """Frequency [Hz] and damping xi [1/s], (2, m)."""
    return np.array([mode.hz, 4 * np.pi * mode.hz * mode.damping_ratio])


def test_derivatives_are_those_of_decays_solved_anew() -> None:
    """All numbers together along two random ways, by differences of second order; amplitudes of the channel are met."""
    rig = loaded_rig()
    keys = ["joints.bristle.stiffness", "joints.spring.cubic", "modal.frequencies_hz[1]", "modal.frequencies_hz[2]"]
    keys += ["modal.ports.a[1]", "modal.ports.b[2]", "modal.ports.drive[1]", "damping.modal_ratios[1]"]
    keys += ["channels.acc.gain", "joints.slider.normal_load"]
    values = np.array([rig.numbers[key][0] for key in keys])
    mode = found(rig)
    assert [np.hypot(*p["acc"].coefficients[[1, BASIS.H + 1]]) for p in mode.points] == pytest.approx(AMPLITUDES)
    exact = np.array([(c.hz, c.relief) for c in decay_changes(mode, "acc", keys)])
    for way in np.random.default_rng(3).normal(size=(2, len(keys))):
        way *= values
        way[2:4] *= 0.01  # else the frequencies hide all others
        ahead, behind = (
            described(found(rig.with_numbers(dict(zip(keys, (values + sign * 1e-4 * way).tolist(), strict=True)))))
            for sign in (1, -1)
        )
        slope = (ahead - behind) / 2e-4
        assert np.all(np.abs((exact @ way).T - slope).max(axis=1) < 1e-5 * np.abs(slope).max(axis=1))


def test_a_decay_from_motions_nearby_is_that_from_the_linear_mode() -> None:
    rig = loaded_rig()
    before = found(rig.with_number("joints.bristle.stiffness", 1.7e4))
    states, relief = [p.state for p in before.points], 2.0 * described(before)[1]
    near, anew = near_states(rig, BASIS, states, relief, "acc", AMPLITUDES), found(rig)
    np.testing.assert_allclose(described(near), described(anew), rtol=1e-8)
    keys = ["joints.bristle.stiffness", "joints.slider.normal_load"]
    for a, b in zip(decay_changes(near, "acc", keys), decay_changes(anew, "acc", keys), strict=True):
        np.testing.assert_allclose(a.relief, b.relief, rtol=1e-6)
