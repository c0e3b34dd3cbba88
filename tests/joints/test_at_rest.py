"""Linear modes and backbones about rest: where joints that push and the body balance, and where joints hold rigidly."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import eigvalsh

from continuation import ConvergenceError
from hbm import linear_modes, nonlinear_mode, phase_resonance
from hbm.modes.backbone import Backbone
from models import Coulomb, Iwan, Jenkins, LuGre
from models.bodies.modal import ModalModel
from models.friction import FrictionLaw
from models.jointed import JointedRig
from models.joints import Friction, Joint, PlaneFriction, Stop
from models.parts import Damping, Excitation

OMEGA = 2 * np.pi * 20.0
PRESSED, BUMPER = Stop(2e4, -5e-4), Stop(4e4, 1e-4)
REST = -(2e4 * 5e-4 + 4e4 * 1e-4) / (OMEGA**2 + 6e4)
RESTS = np.sqrt(OMEGA**2 + 6e4) / (2 * np.pi)
"""Where an oscillator rests that a pressed stop moves onto a bumper [m], and its small vibrations there [Hz]."""


def pressed(ratio: float = 0.01) -> JointedRig:
    """That oscillator."""
    joints = (Joint("pressed", PRESSED, ("a",)), Joint("bumper", BUMPER, ("-1*a",)))
    body, damping = ModalModel((20.0,), {"a": (1.0,)}), Damping(modal_ratios=(ratio,))
    return JointedRig("pressed", body, damping, joints, Excitation(0.01, at="a"))


def test_a_pressed_stop_closes_a_bumper() -> None:
    """Both are closed where it rests, by a tenth of a millimetre."""
    assert REST < -1.8e-4
    assert linear_modes(pressed()).stuck_hz == pytest.approx([RESTS], rel=1e-12)


def test_a_pressed_stop_closes_friction_in_a_plane() -> None:
    """A contact that is open by 0.1 mm is closed by a stop, and sticks: modes of an eigenvalue problem about rest."""
    rows, hz = np.array([[1.0, 0.4, -0.3], [0.2, -0.9, 0.5], [-0.4, 0.3, 1.0]]), np.array([22.0, 28.0, 34.0])
    stop, plane = Stop(6e4, -6e-4), PlaneFriction(0.5, 1e5, -10.0, 1e5)
    body = ModalModel(tuple(hz.tolist()), {name: tuple(row) for name, row in zip("abc", rows.tolist(), strict=True)})
    joints = (Joint("stop", stop, ("a",)), Joint("plane", plane, ("b", "c", "-1*a")))
    rig = JointedRig("plane", body, Damping(modal_ratios=(0.01,)), joints, Excitation(1e-3, at="a"))

    joined = np.diag((2 * np.pi * hz) ** 2) + rows.T @ np.diag([6e4 + 1e5, 1e5, 1e5]) @ rows
    rest = rows @ np.linalg.solve(joined, rows.T @ [-6e4 * 6e-4 - 10.0, 0.0, 0.0])
    load = -10.0 - 1e5 * rest[0]
    assert -6e-4 < rest[0] and 1e5 * np.hypot(*rest[1:]) < 0.5 * load  # the stop is closed, the contact sticks
    expected = np.sqrt(eigvalsh(joined)) / (2 * np.pi)
    assert linear_modes(rig).stuck_hz == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    "law", [Jenkins(0.4, 1e-6), Coulomb(0.4), Iwan(0.4, 1e6), LuGre(0.5, 0.3, 1e-3, 4e6, 200.0, 1.0)]
)
def test_friction_that_is_open_at_rest_leaves_the_modes_of_the_body(law: FrictionLaw) -> None:
    body = ModalModel((20.0, 50.0), {"a": (1.0, 0.5), "b": (0.3, -0.8)}, ((1e-6, 0.0), (0.0, 1e-6)))
    gap = Joint("gap", Friction(law, -2.0, 4e3, 2.0), ("a", "b"))
    modes = linear_modes(JointedRig("gap", body, Damping(modal_ratios=(0.01,)), (gap,), Excitation(1.0, at="a")))
    np.testing.assert_allclose(modes.stuck_hz, modes.sliding_hz, rtol=1e-12)
    np.testing.assert_allclose(modes.stuck_damping_ratio, 0.01, rtol=1e-12)


def free_vibration(start: float, steps: int = 200_000) -> tuple[float, float]:
    """Frequency [Hz] and fundamental amplitude [m] of the oscillator let go undamped, by a leap-frog of its own."""
    dt = 0.1 / steps

    def pull(x: float) -> float:
        return -(OMEGA**2) * x - 2e4 * max(x + 5e-4, 0.0) + 4e4 * max(-x - 1e-4, 0.0)

    x, v, path, turns = start, 0.5 * dt * pull(start), [start], []
    while len(turns) < 2:
        x += dt * v
        slower = v + dt * pull(x)
        if v * slower <= 0.0:
            turns.append(len(path) + v / (v - slower) - 0.5)
        v = slower
        path.append(x)
    period = turns[1]
    phase = 2 * np.pi * np.arange(int(period)) / period
    return 1.0 / (period * dt), abs(2.0 * np.mean(np.exp(-1j * phase) * path[: int(period)]))


def test_a_mode_about_rest_is_described_by_its_amplitude() -> None:
    """The place where it rests, 20 times as far off, is no part of it."""
    mode = nonlinear_mode(pressed(), amplitudes=(1e-5, 2e-5), harmonics=3)
    assert repr(mode).startswith(f"nonlinear mode: {len(mode.points)} motions, drive amplitude 1e-05 to 2e-05 m, ")


@pytest.mark.parametrize("kind", [nonlinear_mode, phase_resonance])
def test_backbones_are_about_rest(kind: Callable[..., Backbone]) -> None:
    """Vibrations that keep both stops closed are linear, and need few points; larger ones those of a free march.

    To 0.1 %: the square of the damping, and what 15 harmonics leave.
    """
    found = kind(pressed(), amplitudes=(1e-6, 1e-3))
    assert found.complete and len(found.points) < 60
    closed = found.amplitude < 0.9 * (-REST - 1e-4)
    assert found.hz[closed] == pytest.approx(RESTS, rel=1e-4)
    hz, amplitude = free_vibration(REST + 6e-4)
    assert found.at([amplitude]).hz[0] == pytest.approx(hz, rel=1e-3)


def test_a_joint_that_holds_rigidly_takes_a_mode_away() -> None:
    """Two modes whose port stands still move as one: omega^2 weighted with the other's square at the port."""
    body = ModalModel((31.0, 74.5), {"left": (0.8, 1.1), "shaker": (0.5, 0.3)})
    held = Joint("bolt", Friction(Coulomb(0.4), 50.0), ("left",))
    rig = JointedRig("held", body, Damping(modal_ratios=(0.003,)), (held,), Excitation(3.0, at="shaker"))
    expected = np.sqrt((31.0**2 * 1.1**2 + 74.5**2 * 0.8**2) / (1.1**2 + 0.8**2))
    modes = linear_modes(rig)
    assert modes.stuck_hz == pytest.approx([expected, np.nan], rel=1e-12, nan_ok=True)
    assert modes.stuck_damping_ratio == pytest.approx([modes.stuck_damping_ratio[0], np.nan], nan_ok=True)
    small = nonlinear_mode(rig, amplitudes=(1e-6, 2e-6), harmonics=5)
    assert small.complete
    assert small.hz[0] == pytest.approx(expected, rel=1e-6)


def test_no_motion_lags_where_other_modes_outweigh_it() -> None:
    """Below the third of three modes at a drive where it moves most, the real part of the receptance has no zero.

    Phase resonance of the first mode then does not exist, and the line names the amplitude that was asked for.
    """
    hz, drive, ratio = np.array([42.5, 45.5, 55.5]), np.array([0.12, 0.06, 0.69]), 0.015
    Omega, omega = 2 * np.pi * np.linspace(1.0, 55.0, 2000)[:, None], 2 * np.pi * hz
    assert np.all((drive**2 / (omega**2 - Omega**2 + 2j * ratio * omega * Omega)).sum(axis=1).real > 0.0)
    body = ModalModel(tuple(hz.tolist()), {"a": tuple(drive.tolist())})
    joint = Joint("stop", Stop(1e4, 1.0), ("a",))
    rig = JointedRig("outweighed", body, Damping(modal_ratios=(ratio,)), (joint,), Excitation(1.0, at="a"))
    with pytest.raises(ConvergenceError, match=r"no first motion at a drive amplitude of 1e-06 m.* none lags by 90°"):
        phase_resonance(rig, amplitudes=(1e-6, 1e-5), harmonics=3)
