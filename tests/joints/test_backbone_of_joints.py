"""Nonlinear modes of rigs with joints: closed forms, eigenvalue problems, the one contact, forced responses."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipk

from hbm.balance.solution import PeriodicSolution
from hbm.fourier import Array, FourierBasis
from hbm.integration.jointed import simulate_joints, state_at_phase_zero
from hbm.modes.amplitudes import default_amplitudes
from hbm.modes.backbone import Backbone, nonlinear_mode, phase_resonance
from hbm.modes.epmc import DriveAmplitude, ForcedMotion, FreeMotion
from hbm.modes.linear import linear_modes
from hbm.modes.sustained import SustainedJoints
from hbm.response.budget import Budget
from hbm.response.trace import steady_state, trace_frequency
from models import Jenkins
from models.bodies.finite import FiniteBeam
from models.bodies.modal import ModalModel
from models.jointed import JointedRig
from models.joints import CubicSpring, Dashpot, Friction, HystereticDamping, Joint, PolynomialSpring
from models.parts import Channel, Damping, Excitation
from tests.decay import cycles_of
from tests.joints.rigs import BEAM, contact_and_joint, made_up
from tests.slopes import check_motion

STIFFNESS = (1.6e4, 1e4)
LOADS = (40.0, 10.0)


def two_sliders() -> JointedRig:
    """A beam on two Jenkins elements, which slip one after the other."""
    laws = [Friction(Jenkins(0.4, 0.4 * P / k), P) for k, P in zip(STIFFNESS, LOADS, strict=True)]
    joints = tuple(Joint(name, law, (at,)) for name, law, at in zip("ab", laws, ("y(0.25)", "y(0.4)"), strict=True))
    return JointedRig(
        "two sliders", FiniteBeam(BEAM), Damping(modal_ratios=(0.01,)), joints, Excitation(20.0, 0.555), ()
    )


@pytest.mark.parametrize("kind", [FreeMotion, ForcedMotion])
@pytest.mark.parametrize("damped", [False, True])
@pytest.mark.parametrize("rigid", [False, True])
def test_derivative_of_the_residual(damped: bool, rigid: bool, kind: type[DriveAmplitude]) -> None:
    check_motion(kind(made_up(damped, rigid), FourierBasis(3, 64)), -1.3)


def test_joined_modes_lose_what_joints_do_and_are_as_stiff_as_these_are_at_their_frequency() -> None:
    """Beside a rigid motion: a spring, a dashpot, and a loss factor of 20 Hz, whose stiffness goes with ln f."""
    loss, reference, k, c = 1000.0, 20.0, 2e4, 3.0
    joints = (
        Joint("spring", PolynomialSpring(k), ("a",)),
        Joint("loss", HystereticDamping(loss, reference), ("a",)),
        Joint("dashpot", Dashpot(c), ("b",)),
    )
    body = ModalModel((0.0, 20.0), {"a": (1.0, 0.3), "b": (1.0, -0.8)})
    rig = JointedRig("lossy", body, Damping(modal_ratios=(0.001,)), joints, Excitation(1.0, at="b"), ())
    a, b = np.array([1.0, 0.3]), np.array([1.0, -0.8])
    found = linear_modes(rig)
    for hz, ratio in zip(found.stuck_hz, found.stuck_damping_ratio, strict=True):
        stiffness = k + loss * (2 / np.pi * np.log(hz / reference) + 1j)
        K = np.diag([0.0, (2 * np.pi * reference) ** 2]) + stiffness * np.outer(a, a)
        C = np.diag([0.0, 2 * 0.001 * 2 * np.pi * reference]) + c * np.outer(b, b)
        roots = np.linalg.eigvals(np.block([[np.zeros((2, 2)), np.eye(2)], [-K, -C]]))
        root = min(roots, key=lambda s: abs(s - 2j * np.pi * hz))
        assert abs(root) / (2 * np.pi) == pytest.approx(hz, rel=2e-3)
        assert -root.real / abs(root) == pytest.approx(ratio, rel=0.03)
    assert found.damping_ratio == pytest.approx([0.0, 0.001])


def test_limits_are_the_linear_modes_with_springs_and_without() -> None:
    rig = two_sliders()
    s, (low, high) = rig.structure, default_amplitudes(rig)
    # springs in series with what the modes leave out, as an eigenvalue problem of its own
    springs = np.linalg.inv(np.diag(1 / np.array(STIFFNESS)) + s.flexibility)
    K = np.diag(s.omega_n**2) + s.joints.T @ springs @ s.joints

    def eigenvalue(relief: float) -> complex:
        zero, one = np.zeros_like(K), np.eye(s.n)
        values = np.linalg.eigvals(np.block([[zero, one], [-K, relief * one - s.damping]]))
        return complex(min(values[values.imag > 0.0], key=lambda value: value.imag))

    relief = brentq(lambda xi: eigenvalue(xi).real, 0.0, 100.0, xtol=1e-12)
    mode = nonlinear_mode(rig, amplitudes=(low, 10 * high), harmonics=7)
    assert mode.complete
    omega = eigenvalue(relief).imag
    assert mode.hz[0] == pytest.approx(omega / (2 * np.pi), rel=1e-9)
    assert mode.damping_ratio[0] == pytest.approx(relief / (2 * omega), rel=1e-7)
    # of a Jenkins element that slides by A there is left a stiffness that falls as 1/A^(3/2)
    missing = mode.at([high, 10 * high]).hz / (s.omega_n[0] / (2 * np.pi)) - 1
    assert missing[1] < 1e-5
    assert missing[0] / missing[1] == pytest.approx(10**1.5, rel=0.1)
    # both slide one after the other, and what is lost is friction and damping: by samples, and by harmonics
    velocities = [2 * np.pi * p.hz * p.basis.derivative(p.state.Q) for p in mode.points]
    damped = np.array([np.sum(v**2 @ s.damping) for v in velocities]) / (2 * mode.hz)
    rubbed = sum(np.array([_work(p, name) for p in mode.points]) for name in ("a", "b"))
    np.testing.assert_allclose(mode.lost, damped + rubbed, rtol=1e-9)
    np.testing.assert_allclose(mode.lost, damped + mode.rubbed, rtol=5e-4)
    assert {p["a.motion"].peak > 0.4 * LOADS[0] / STIFFNESS[0] for p in mode.points} == {False, True}


def _work(point: PeriodicSolution, joint: str) -> float:
    force, motion = (point[f"{joint}.{what}"].coefficients[1:] for what in ("force", "motion"))
    H = len(force) // 2
    k = np.arange(1, H + 1)
    return float(-np.pi * (force[:H] @ (k * motion[H:]) - force[H:] @ (k * motion[:H])))


@pytest.mark.parametrize("kind", [nonlinear_mode, phase_resonance])
def test_a_mode_of_a_pair_that_leaves_the_joint_at_rest_is_linear(kind: Callable[..., Backbone]) -> None:
    """Of two equal modes one combination has a node at the joint, to rounding, which sets no scale of amplitudes."""
    ports = {"joint": (1.0, 0.3, 1.0), "drive": (0.3, 1.0, -1.0)}
    joint = Joint("joint", Friction(Jenkins(0.3, 1e-5), 5.0), ("joint",))
    body, ratio = ModalModel((10.0, 10.0, 30.0), ports), 1e-3
    rig = JointedRig("equal", body, Damping(modal_ratios=(ratio,)), (joint,), Excitation(1.0, at="drive"))
    at_exact_node = replace(rig, body=ModalModel((10.0, 30.0), {"joint": (0.0, 1.0), "drive": (1.0, -1.0)}))
    assert default_amplitudes(rig) == default_amplitudes(at_exact_node)
    backbone = kind(rig, harmonics=3)
    assert backbone.complete
    assert backbone.hz == pytest.approx(10.0, rel=1e-6)
    assert backbone.damping_ratio == pytest.approx(ratio, rel=1e-6)


def test_one_joint_is_the_contact_of_old() -> None:
    contact, joint = contact_and_joint()
    amplitudes = [1e-6, 3e-6, 1e-5, 1e-4]
    for trace, what in ((nonlinear_mode, "nonlinear mode: "), (phase_resonance, "phase resonance: ")):
        one, other = (trace(rig, amplitudes=(1e-6, 1.1e-4), harmonics=5).at(amplitudes) for rig in (contact, joint))
        np.testing.assert_allclose(one.hz, other.hz, rtol=1e-9)
        np.testing.assert_allclose(one.damping_ratio, other.damping_ratio, rtol=1e-7)
        np.testing.assert_allclose(one.force, other.force, rtol=1e-7)
        np.testing.assert_allclose(one.rubbed, other.rubbed, atol=1e-9 * one.lost.max())
        assert repr(other).startswith(f"{what}4 motions, drive amplitude 1e-06 to 0.0001 m, ")
    assert default_amplitudes(contact) == pytest.approx(default_amplitudes(joint), rel=1e-9)


def test_cubic_spring_has_the_elliptic_integral() -> None:
    body = ModalModel((1 / (2 * np.pi),), {"mass": (1.0,)})
    spring = Joint("spring", CubicSpring(1.0), ("mass",))
    rig = JointedRig("duffing", body, Damping(0.02, high_mode_ratio=0.0), (spring,), Excitation(1.0, at="mass"))
    found = nonlinear_mode(rig, amplitudes=(0.01, 3.0))
    crest = np.array([p["drive"].samples.max() for p in found.points])
    hardening = crest**2
    exact: Array = np.pi * np.sqrt(1 + hardening) / (2 * ellipk(hardening / (2 * (1 + hardening))))
    np.testing.assert_allclose(2 * np.pi * found.hz, exact, rtol=1e-9)
    np.testing.assert_allclose(4 * np.pi * found.hz * found.damping_ratio, 0.02, rtol=1e-7)


def test_forced_response_passes_through_the_backbones() -> None:
    rig, levels = two_sliders(), (2.0, 6.0, 12.0)
    ends = default_amplitudes(rig)
    resonance = phase_resonance(rig, amplitudes=ends, harmonics=7).at_force(levels)
    free = nonlinear_mode(rig, amplitudes=ends, harmonics=7)
    for i, level in enumerate(levels):
        # where it crosses 90 degrees, the frequency response has the frequency and amplitude of phase resonance
        hz = float(resonance.hz[i])
        forced = steady_state(rig, hz, level=level, harmonics=7)
        cosine, sine = forced["drive"].coefficients[[1, 8]]
        assert sine == pytest.approx(resonance.amplitude[i], rel=1e-6)
        assert abs(cosine) < 1e-6 * sine
        # the free motion of that amplitude differs in frequency by the square of the damping, about
        mode = free.at([sine])
        assert mode.hz[0] == pytest.approx(hz, rel=2 * float(mode.damping_ratio[0]) ** 2 + 1e-4)
        assert mode.force[0] == pytest.approx(level, rel=0.02)
        curve = trace_frequency(rig, (0.8 * hz, 1.2 * hz), level=level, harmonics=7)
        assert curve.peak["drive"].peak == pytest.approx(sine, rel=0.02)


def test_free_decay_while_both_slide() -> None:
    """Marched in time from a point of the mode: frequency and rate at every amplitude that it comes through."""
    rig = two_sliders()
    mode = nonlinear_mode(rig, amplitudes=(2e-3, 2e-2), harmonics=11)
    start = mode.at([1.5e-2])
    balance, *_ = start.problem.unpack(start.branch.points[0].x, start.branch.points[0].lam)
    assert isinstance(balance, SustainedJoints)
    state = state_at_phase_zero(balance, start.points[0].state)
    history = simulate_joints(rig, float(start.hz[0]), periods=12, level=0.0, start=state)
    cycles = cycles_of(history.time, history.channels["drive"].values)
    amplitudes = np.geomspace(2e-3, 2e-2, 16)
    along, log = mode.at(amplitudes), np.log(cycles[:, 2])
    found = (along.decay_rate, along.hz, along.damping_ratio)
    rate, hz, damping = (np.interp(log, np.log(amplitudes), values) for values in found)
    assert cycles[-1, 2] < 0.25 * cycles[0, 2]
    measured = -(log[2:] - log[:-2]) / (cycles[2:, 0] - cycles[:-2, 0])
    # averaging neglects the square of the change per cycle, 2 pi D; the frequency is that of damping taken away, to D^2
    assert (np.abs(measured / rate[1:-1] - 1) < (2 * np.pi * damping[1:-1]) ** 2).all()
    assert (np.abs(cycles[:, 1] / hz - 1) < damping**2).all()


THREE, RATIO, CUBIC = (10.0, 30.0), 0.06, 4e3
"""Modes of two masses at 1:3 [Hz], their damping ratio, and a cubic spring at one of the masses [N/m3]."""


def two_masses(hz: tuple[float, float], ratio: float) -> JointedRig:
    body = ModalModel(hz, {"a": (0.5**0.5, 0.5**0.5)})
    spring = Joint("spring", CubicSpring(CUBIC), ("a",))
    return JointedRig("two masses", body, Damping(modal_ratios=(ratio, ratio)), (spring,), Excitation(1.0, at="a"), ())


def missed(motion: PeriodicSolution, relief: float) -> float:
    """By how much a motion does not close after a period, of its largest velocity, by equations of its own."""
    omega, row = 2 * np.pi * np.array(THREE), np.full(2, 0.5**0.5)

    def rates(_: float, state: Array) -> Array:
        q, v = np.split(state, 2)
        return np.concatenate([v, -(omega**2) * q - (2 * RATIO * omega - relief) * v - row * CUBIC * (row @ q) ** 3])

    H, Q = motion.basis.H, motion.state.Q
    velocity = 2 * np.pi * motion.hz * (np.arange(1, H + 1) @ Q[H + 1 :])
    start = np.concatenate([Q[: H + 1].sum(axis=0), velocity])
    end = solve_ivp(rates, (0.0, 1.0 / motion.hz), start, rtol=1e-9, atol=1e-9).y[:, -1]
    return float(np.abs(end - start).max() / np.abs(velocity).max())


def test_a_backbone_goes_through_an_internal_resonance() -> None:
    """Where the drive nearly rests and the third harmonic moves the second mode: steps are in proportion to that."""
    mode = nonlinear_mode(two_masses(THREE, RATIO), amplitudes=(0.5, 3.8), harmonics=11, budget=Budget(points=800))
    assert mode.complete and len(mode.folds) == 2
    assert mode.folds[1] < 0.25 * mode.folds[0]
    for i in (*(i for i, p in enumerate(mode.branch.points) if p.fold), -1):
        motion = mode.points[i]
        assert missed(motion, 4 * np.pi * motion.hz * mode.damping_ratio[i]) < 0.02  # 0.16 with 7 harmonics


def test_a_backbone_that_ends_beside_an_internal_resonance_names_it() -> None:
    late, early = (
        nonlinear_mode(two_masses((10.0, 35.0), 0.02), amplitudes=(0.5, 3.8), harmonics=5, budget=Budget(points=n))
        for n in (35, 5)
    )
    Q, H = late.points[-1].state.Q, 5
    energy = np.arange(1, H + 1) ** 2 * np.sum(Q[1 : H + 1] ** 2 + Q[H + 1 :] ** 2, axis=1)
    said = f"internal resonance: {energy[2] / energy.sum():.0%} of the kinetic energy is in harmonic 3, "
    assert not late.complete and energy[2] > 0.5 * energy.sum()
    assert f"{said}{3 * late.hz[-1]:.5g} Hz, most in mode 2" in str(late)
    assert not early.complete and "internal" not in str(early)


def test_what_is_no_mode_is_refused() -> None:
    rig = two_sliders()
    with pytest.raises(ValueError, match=r"mode = 7; must be from 1 to 6"):
        nonlinear_mode(rig, 7)
    afloat = JointedRig(
        "afloat",
        ModalModel((0.0, 1.0), {"one": (1.0, 1.0), "two": (1.0, -1.0)}),
        Damping(0.1),
        (Joint("spring", CubicSpring(1.0), ("one",), ("two",)),),
        Excitation(1.0, at="one"),
        (Channel("force", "force"),),
    )
    with pytest.raises(ValueError, match=r"mode = 1 is a rigid motion; must be from 2 to 2"):
        nonlinear_mode(afloat)
    assert nonlinear_mode(replace(afloat), 2, amplitudes=(1e-3, 1e-2), harmonics=3).complete
