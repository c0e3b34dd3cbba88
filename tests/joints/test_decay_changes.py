"""Derivatives of a free decay to the numbers of its rig, against differences of decays solved anew."""

from dataclasses import replace

import numpy as np
import pytest

from hbm.fourier import Array, FourierBasis
from hbm.modes.backbone import NonlinearMode
from hbm.modes.decaying import at_channel, near_states, over_channel, predicted, toward_channel
from hbm.modes.sensitivity import decay_changes
from hbm.response.budget import Budget
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


def hardening(second: float, cubic: float = 1e12) -> JointedRig:
    """Modes of 80 and 262 Hz, the latter with a part at the tip, where there is a cubic spring: they meet at 1 to 3."""
    body = ModalModel((80.0, 262.0), {"tip": (0.8, second)})
    joints, channels = (Joint("spring", CubicSpring(cubic), ("tip",)),), (Channel("acc", "acceleration", at="tip"),)
    return JointedRig("hardening", body, Damping(modal_ratios=(0.002,)), joints, Excitation(1.0, at="tip"), channels)


def test_a_mode_is_followed_to_the_amplitude_asked_for_and_not_into_what_is_beyond_it() -> None:
    """By its frequency in the linear mode 80 m/s2 would be where the modes meet, which takes all points there are."""
    mode = over_channel(hardening(0.3), 1, "acc", (1.0, 80.0), FourierBasis(7, 128), Budget(points=60))
    assert len(mode.points) < 40
    assert not mode.folds
    assert mode.hz[-1] < 262.0 / 3 < mode.rig.structure.omega_n[1]


def test_amplitudes_are_met_where_a_channel_does_not_grow_as_the_drive() -> None:
    """One harmonic of one mode: w^2 = w0^2 + 3/4 k phi^2 X^2, by which an acceleration X w^2 grows with up to X^3."""
    amplitudes, k = np.array([2.0, 60.0, 120.0, 400.0]), 1e12
    branch = over_channel(hardening(0.0), 1, "acc", (2.0, 400.0), FourierBasis(1, 64))
    mode = at_channel(branch, "acc", amplitudes)
    omega2 = (2 * np.pi * mode.hz) ** 2
    closed = (2 * np.pi * 80.0) ** 2 + 0.75 * k * 0.8**2 * (amplitudes / omega2) ** 2
    assert mode.hz[-1] > 1.2 * mode.hz[0]
    np.testing.assert_allclose(omega2, closed, rtol=1e-8)


@pytest.mark.parametrize(("quantity", "power"), [("displacement", 0), ("velocity", 1), ("acceleration", 2)])
def test_a_decay_is_predicted_as_its_channel_falls(quantity: str, power: int) -> None:
    """One harmonic of a mode, w^2 = w0^2 + 3/4 k phi^2 X^2: the action X^2 w falls at 2 zeta w0, a channel is X w^p."""
    w0, k, at = 2 * np.pi * 80.0, 1e12, 6e-4
    seen = (Channel("v", quantity, at="tip"),)
    omega = np.sqrt(w0**2 + 0.75 * k * 0.8**2 * at**2)
    by_X = 1.0 - (w0 / omega) ** 2  # d ln w / d ln X
    rate = 2 * 0.002 * w0 * (1.0 + power * by_X) / (2.0 + by_X)
    amplitude = at * omega**power
    branch = over_channel(
        replace(hardening(0.0), channels=seen), 1, "v", (0.1 * amplitude, amplitude), FourierBasis(1, 64)
    )
    hz, ratio = predicted(branch, "v", np.array([amplitude]))
    assert by_X > 0.4
    assert ratio[0] * 2 * np.pi * hz[0] / np.sqrt(1 - ratio[0] ** 2) == pytest.approx(rate, rel=1e-5)


def test_what_a_mode_does_not_reach_is_not_predicted() -> None:
    """It folds short of the largest amplitude; the amplitudes that it reaches have the motion it comes to first."""
    mode = toward_channel(hardening(0.6), 1, "acc", (1.0, 200.0), FourierBasis(7, 128), Budget(points=60))
    assert mode.folds
    hz, ratio = predicted(mode, "acc", np.array([2.0, 60.0, 200.0]))
    there = at_channel(over_channel(mode.rig, 1, "acc", (1.0, 60.0), FourierBasis(7, 128)), "acc", np.array([60.0]))
    assert hz[1] == pytest.approx(there.decaying_hz[0], rel=1e-3)  # lines between points of the branch
    assert np.isnan([hz[2], ratio[2]]).all()
    assert not np.isnan([*hz[:2], *ratio[:2]]).any()
