"""Harmonic balance over joints: exact Newton steps, the one contact it contains, energy, and time integration."""

from dataclasses import replace

import numpy as np
import pytest

from hbm import InputError, simulate
from hbm.balance.jointed import JointBalance
from hbm.fourier import FourierBasis
from hbm.integration.jointed import JointMarcher, joint_steady_state, simulate_joints, state_at_phase_zero
from hbm.response.accuracy import scales_of
from hbm.response.trace import steady_state, trace_frequency
from hbm.stability.jointed import joint_stability
from models import Coulomb, Dahl, Iwan, Jenkins, Karnopp, LuGre, Stribeck
from models.bodies.modal import ModalModel
from models.jointed import JointedRig
from models.joints import CubicSpring, Dashpot, Friction, Joint, PolynomialSpring, Stop
from models.parts import Damping, Excitation
from tests.joints.rigs import beam_rig, contact_and_joint, made_up

H, N_T = 25, 1024
LAWS = {
    "jenkins": Jenkins(0.4, 4e-6),
    "stribeck": Stribeck(0.5, 0.3, 1e-3, 4e-6),
    "dahl": Dahl(0.4, 4e6),
    "lugre": LuGre(0.5, 0.3, 1e-3, 4e6, 200.0, 1.0),
    "iwan": Iwan(0.4, 4e6, elements=8),
    "coulomb": Coulomb(0.4),
    "karnopp": Karnopp(0.5, 0.4, 1e-4),
}


@pytest.mark.parametrize("parameter", ["frequency", "force"])
@pytest.mark.parametrize("damped", [False, True])
@pytest.mark.parametrize("rigid", [False, True])
def test_bordered_steps_are_those_of_a_dense_system_of_differences(damped: bool, rigid: bool, parameter: str) -> None:
    problem = JointBalance(made_up(damped, rigid), FourierBasis(3, 64), parameter=parameter, hz=1.1)
    rng = np.random.default_rng(2)
    x, row, rhs = (rng.normal(size=problem.size) for _ in range(3))
    x, lam, e = 0.3 * x, 1.1, 1e-6
    by_x = np.array(
        [(problem.residual(x + e * u, lam) - problem.residual(x - e * u, lam)) / (2 * e) for u in np.eye(len(x))]
    )
    by_lam = (problem.residual(x, lam + e) - problem.residual(x, lam - e)) / (2 * e)
    dense = np.block([[by_x.T, by_lam[:, None]], [row[None], np.array([[0.7]])]])
    expected = np.linalg.solve(dense, np.append(rhs, 0.2))
    linear = problem.linearize(x, lam)
    found = np.append(*linear.solve_bordered(row, 0.7, rhs, 0.2))
    assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()
    assert linear.determinant_sign(row, 0.7) == np.sign(np.linalg.det(dense))


def test_one_joint_is_the_contact_of_old() -> None:
    rig, same = contact_and_joint()
    for hz in (45.0, 49.0, 52.0):
        one, other = (steady_state(r, hz, harmonics=9, samples=256) for r in (rig, same))
        for a, b in (("drive", "drive"), ("friction", "tip.force"), ("slip", "tip.motion")):
            assert np.abs(one[a].coefficients - other[b].coefficients).max() < 1e-9 * one[a].peak


def test_a_joint_may_be_named_drive() -> None:
    """Its signals have the name of the port behind a point: none is that of the displacement at the force."""
    _, rig = contact_and_joint()
    named = replace(rig, joints=tuple(replace(j, name="drive") for j in rig.joints))
    one, other = (steady_state(r, 49.0, harmonics=5, samples=128) for r in (rig, named))
    for name in ("drive", "tip.motion", "tip.force"):
        np.testing.assert_array_equal(one[name].coefficients, other[name.replace("tip", "drive")].coefficients)


@pytest.mark.parametrize("name", LAWS)
def test_time_integration_agrees_and_energy_closes(name: str) -> None:
    rig = beam_rig(Friction(LAWS[name], 40.0))
    solution = steady_state(rig, 45.0, harmonics=H, samples=N_T)
    assert abs(solution.energy_error) < 1e-6
    problem = JointBalance(rig, FourierBasis(H, N_T))
    period = joint_steady_state(rig, 45.0, start=state_at_phase_zero(problem, solution.state))
    for channel in ("drive", "spring.force", "stop.motion", "plane.force.1", "plane.force.2", "plane.force.3"):
        a, b = solution[channel].coefficients, period.history.coefficients(channel, H)
        fundamental = np.hypot(a[1], a[H + 1])
        if channel != "plane.force.1" or fundamental > 1e-6:  # the bending beam hardly moves along
            assert np.hypot(a[1] - b[1], a[H + 1] - b[H + 1]) < 5e-3 * fundamental, channel
    rubbed = np.abs(solution["rub.force"].coefficients - period.history.coefficients("rub.force", H)).max()
    assert rubbed < 5e-3 * solution["rub.force"].peak
    # what a small disturbance becomes, along either of the two motions
    stability = joint_stability(problem, solution.state)
    kept = stability.multipliers
    own = np.linalg.eigvals(period.monodromy)
    own = own[np.argsort(np.abs(own - 1.0))[stability.undying :]]
    assert stability.stable
    assert np.abs(own).max() == pytest.approx(np.abs(kept).max(), abs=0.02)


def test_springs_and_stops_lose_nothing_and_a_dashpot_what_it_brakes() -> None:
    c, rig = 0.05, made_up(damped=True, rigid=False)
    joints = (
        Joint("spring", CubicSpring(1e4), ("b",), ("c",)),
        Joint("stop", Stop(3.0, gap=0.01), ("d",)),
        Joint("dashpot", Dashpot(c), ("e",)),
    )
    found = steady_state(replace(rig, joints=joints), 0.15, harmonics=15, samples=256)
    assert found["stop.force"].peak > 0.01 and found["spring.force"].peak > 0.01
    assert found.taken("spring") == found.taken("stop") == 0.0
    rate = found.state.Omega * found.basis.derivative(found["dashpot.motion"].coefficients)
    assert found.friction_loss == found.taken("dashpot")
    assert found.friction_loss == pytest.approx(np.pi * c * rate[1:] @ rate[1:] / found.state.Omega, rel=2e-3)


def test_a_march_from_rest_settles_on_it() -> None:
    rig = beam_rig(Friction(LAWS["lugre"], 40.0))  # forgets where it came from, sticking or not
    solution = steady_state(rig, 45.0, harmonics=H, samples=N_T)
    history = simulate_joints(rig, 45.0, periods=120, steps_per_period=1024, last_periods=1)
    a, b = solution["drive"].coefficients, history.coefficients("drive", H)
    assert np.hypot(a[1] - b[1], a[H + 1] - b[H + 1]) < 5e-4 * np.hypot(a[1], a[H + 1])


def test_thinning_keeps_the_samples_of_the_full_march_and_the_rates_of_its_forces() -> None:
    """One step in four is kept; what is added up of it, accelerations by forces among it, are the same numbers."""
    rig = beam_rig(Friction(LAWS["jenkins"], 40.0))
    full = simulate(rig, 45.0, steps_per_period=256, duration=4 / 45.0)
    thin = simulate(rig, 45.0, steps_per_period=256, duration=4 / 45.0, every=4)
    assert (len(thin.time), thin.samples_per_period) == (4 * 64 + 1, 64)
    np.testing.assert_allclose(thin.time, full.time[::4], rtol=1e-14)
    for name, signal in thin.channels.items():
        np.testing.assert_array_equal(signal.values, full.channels[name].values[::4])
    last = simulate(rig, 45.0, steps_per_period=256, duration=4 / 45.0, last_periods=2, every=64)
    np.testing.assert_array_equal(last.states, full.states[-2 * 256 - 1 :: 64])
    with pytest.raises(InputError, match="simulate: every = 7; must divide 512 steps per period"):
        simulate(rig, 45.0, duration=1 / 45.0, every=7)


def test_the_step_is_differentiated_exactly() -> None:
    rig = beam_rig(Friction(LuGre(0.5, 0.3, 1e-3, 4e6, 200.0, 1.0), 40.0))
    marcher = JointMarcher(rig, 45.0, 20.0, 64)
    x = np.zeros(marcher.size)
    for _ in range(3):
        x = marcher.period(x)[0][-1]
    X, _ = marcher.period(x)
    step = 1e-6 * np.random.default_rng(0).normal(size=len(x)) * np.abs(X).max(axis=0)
    apart = (marcher.period(x + step)[0][-1] - marcher.period(x - step)[0][-1]) / 2
    found = marcher.monodromy(x, X) @ step
    assert np.abs(found - apart).max() < 1e-4 * np.abs(apart).max()


def test_two_bodies_afloat_swing_against_each_other() -> None:
    """Two free masses m1, m2 on a cubic spring: the relative motion is one oscillator of the reduced mass."""
    m1, m2, k, k3, F, hz = 2.0, 3.0, 400.0, 9e4, 1.0, 1.7
    total, reduced = m1 + m2, m1 * m2 / (m1 + m2)
    relative = np.sqrt(reduced)
    ports = {"one": (total**-0.5, relative / m1), "two": (total**-0.5, -relative / m2)}
    # one mode is rigid; the other is the relative motion without any spring, rigid as well
    body = ModalModel((0.0, 0.0), ports)
    spring = Joint("spring", PolynomialSpring(linear=k, cubic=k3), ("one",), ("two",))
    rig = JointedRig("afloat", body, Damping(0.5, high_mode_ratio=0.0), (spring,), Excitation(F, at="one"))
    found = steady_state(rig, hz, harmonics=7, samples=128)
    single = ModalModel((0.0,), {"mass": (reduced**-0.5,)})
    alone = Joint("spring", PolynomialSpring(linear=k, cubic=k3), ("mass",))
    one = JointedRig(
        "alone", single, Damping(0.5, high_mode_ratio=0.0), (alone,), Excitation(F * reduced / m1, at="mass")
    )
    expected = steady_state(one, hz, harmonics=7, samples=128)
    assert np.allclose(found["spring.motion"].coefficients, expected["spring.motion"].coefficients, atol=1e-9)
    # the centre of mass, which no joint sees, moves as a free mass
    x1, x2 = found["drive"].coefficients, found["drive"].coefficients - found["spring.motion"].coefficients
    centre = (m1 * x1 + m2 * x2) / total
    Omega = 2 * np.pi * hz
    assert (centre[1] - 1j * centre[8]) == pytest.approx(F / total / (-(Omega**2) + 0.5j * Omega), rel=1e-9)


def test_a_curve_of_joints_is_traced_through_its_peak() -> None:
    rig = beam_rig(Friction(Jenkins(0.4, 4e-6), 40.0))
    curve = trace_frequency(rig, (40.0, 90.0), harmonics=7, samples=128)
    assert curve.complete
    assert 40.0 < curve.peak.hz < 90.0
    assert max(abs(p.energy_error) for p in curve.points) < 1e-6


def test_errors_of_a_force_that_symmetry_forbids_are_not_relative_to_rounding() -> None:
    """A port that no mode reached moves: its force is what rounding, here a shape of 1e-13, leaves of none."""
    body = ModalModel(
        (31.0, 74.5),
        {"a": (0.8, 1.1), "r": (1e-13, 0.0), "c": (0.5, 0.3)},
        flexibility=tuple(tuple(row) for row in np.diag([0.0, 1e-3, 0.0])),
    )
    joints = (Joint("cub", CubicSpring(1e6), ("a",)), Joint("twist", PolynomialSpring(linear=20.0), ("r",)))
    rig = JointedRig("r", body, Damping(modal_ratios=(0.01,)), joints, Excitation(1.0, at="c"))
    points = [steady_state(rig, hz, harmonics=3, samples=64) for hz in (30.0, 31.0)]
    scales = scales_of(rig, points)
    peak = {name: max(p[name].peak for p in points) for name in scales}
    assert scales["drive"] == peak["drive"] and scales["cub.force"] == peak["cub.force"]
    assert peak["twist.force"] < 1e-12
    assert scales["twist.force"] > 1e-6
