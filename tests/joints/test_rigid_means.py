"""The mean of rigid motions: undetermined where joints slide both ways, decided by the contact where it sticks."""

import numpy as np
import pytest
from scipy.linalg import eigh

from continuation import ConvergenceError
from hbm import frequency_response, steady_state
from hbm.errors import InputError
from hbm.integration.jointed import simulate_joints
from hbm.modes.linear import linear_modes, sliding_to_stuck
from hbm.response.trace import sweep_of, trace_frequency
from models import Coulomb, Dahl, Iwan, Jenkins
from models.bodies.matrix import MatrixBody
from models.bodies.modal import ModalModel
from models.friction.law import FrictionLaw
from models.jointed import JointedRig
from models.joints import Friction, HystereticDamping, Joint, PolynomialSpring, Stop
from models.parts import Damping, Excitation

MU, LOAD, SLIP, FORCE = 0.5, 20.0, 1e-5, 15.0


def mass(law: FrictionLaw) -> JointedRig:
    """A kilogram on dry friction."""
    joint = Joint("floor", Friction(law, LOAD), ("mass",))
    return JointedRig(
        "mass", ModalModel((0.0,), {"mass": (1.0,)}), Damping(0.0), (joint,), Excitation(FORCE, at="mass")
    )


def half_swing(hz: float, periods: int = 60, steps: int = 4000) -> float:
    """Half the way [m] that a kilogram goes behind a spring that slides at its limit, by a leap-frog of its own."""
    dt, k, limit = 1.0 / (hz * steps), MU * LOAD / SLIP, MU * LOAD
    force = FORCE * np.cos(2 * np.pi * np.arange(steps) / steps)
    x = v = anchor = 0.0
    for _ in range(periods):
        low = high = x
        for F in force.tolist():
            pull = min(max(k * (x - anchor), -limit), limit)
            anchor = x - pull / k
            v += dt * (F - pull)
            x += dt * v
            low, high = min(low, x), max(high, x)
    return (high - low) / 2


@pytest.mark.parametrize("hz", [20.0, 30.0, 60.0])
def test_a_mass_slides_about_where_it_was(hz: float) -> None:
    """Half a swing is that of a march in time, to the 0.5 % that 31 harmonics leave; it is about rest."""
    drive = steady_state(mass(Jenkins(MU, SLIP)), hz, harmonics=31, samples=2048)["drive"]
    assert drive.peak == pytest.approx(half_swing(hz), rel=5e-3)
    assert abs(drive.coefficients[0]) < 1e-6 * drive.peak


@pytest.mark.parametrize("law", [Coulomb(MU), Dahl(MU, 1e6), Iwan(MU, 1e6)], ids=lambda law: law.name)
def test_every_law_slides_about_where_it_was(law: FrictionLaw) -> None:
    """The mean is nobody's but the mean force is: none."""
    found = steady_state(mass(law), 30.0, harmonics=15)
    assert found["floor.force"].peak == pytest.approx(MU * LOAD, rel=1e-6)
    assert abs(found["drive"].coefficients[0]) < 1e-6 * found["drive"].peak
    assert abs(found.energy_error) < 1e-6


def test_a_curve_of_a_sliding_mass_is_complete() -> None:
    """Its swing falls with the frequency."""
    curve = trace_frequency(mass(Jenkins(MU, SLIP)), (20.0, 60.0), harmonics=9)
    assert curve.complete and len(curve.points) < 100
    assert np.all(np.diff(curve["drive"].peak) < 0.0)


def test_what_sticks_keeps_the_mean_of_its_history() -> None:
    """A lopsided spring shifts the means of a body afloat but for a contact that sticks: as far as in time from rest.

    Nothing else sees the rigid motion, so that the mean force of the contact is zero.
    """
    body = ModalModel((0.0, 50.0), {"one": (0.6, 0.8), "two": (0.6, -0.8)})
    joints = (
        Joint("floor", Friction(Jenkins(MU, 1e-2), 1e4), ("one",)),
        Joint("spring", PolynomialSpring(linear=1e4, quadratic=3e7), ("one",), ("two",)),
    )
    rig = JointedRig("lopsided", body, Damping(mass_proportional=10.0), joints, Excitation(20.0, at="two"))
    found = steady_state(rig, 40.0, harmonics=9)
    late = simulate_joints(rig, 40.0, periods=200, steps_per_period=1024, last_periods=1)
    drive = late.channels["drive"].values[1:]
    mean, force = found["drive"].coefficients[0], found["floor.force"].coefficients[0]
    assert abs(mean) > 1e-2 * found["drive"].peak
    assert mean == pytest.approx(drive.mean(), rel=1e-4)
    assert abs(force) < 1e-4 * found["floor.force"].peak


def shuffling(force: float) -> JointedRig:
    """A block on a foot whose load goes with the force that pushes it: it is lighter one way than the other."""
    body = ModalModel((0.0, 40.0), {"along": (1.0, 0.4), "pressed": (0.0, 1.0), "pushed": (0.5, 1.0)})
    foot = Joint("foot", Friction(Jenkins(0.3, 1e-5), 20.0, normal_stiffness=3e4), ("along", "pressed"))
    return JointedRig("block", body, Damping(modal_ratios=(0.02,)), (foot,), Excitation(force, at="pushed"))


def test_what_walks_has_no_periodic_motion() -> None:
    """In time it goes a like way in every period; the balance says so, for a motion as for a curve."""
    rig = shuffling(12.0)
    late = simulate_joints(rig, 45.0, periods=60, steps_per_period=1024, last_periods=21)
    drive = late.channels["drive"].values[1:].reshape(-1, 1024).mean(axis=1)
    steps = np.diff(drive)
    assert np.all(np.abs(steps / steps.mean() - 1.0) < 0.2) and abs(steps.mean()) > 1e-5
    with pytest.raises(ConvergenceError, match=r"no motion is periodic at 45 Hz, 12 N; friction pushes the body along"):
        steady_state(rig, 45.0)
    curve = frequency_response(rig, (44.5, 45.5), harmonics=9)
    assert curve.assessment is not None
    assert any("friction pushes the body along" in line for line in curve.assessment.warnings)
    assert curve.walking[0][0] == pytest.approx(44.5) and curve.walking[-1][1] == pytest.approx(45.5)


def test_what_sticks_does_not_walk() -> None:
    """Its mean is held, however its load goes."""
    found = steady_state(shuffling(12.0), 26.0, harmonics=15)
    assert not found.walks
    assert abs(found["foot.force.1"].coefficients[0]) < 1e-9 * found["foot.force.1"].peak


@pytest.mark.parametrize("start", [10.0, 5.0])
def test_a_curve_begins_at_the_frequency_of_an_undamped_mode(start: float) -> None:
    """Or where one of its harmonics is: there the linear structure has no answer, with its spring it has."""
    body = ModalModel((10.0,), {"mass": (1.0,)})
    spring = Joint("spring", PolynomialSpring(cubic=1e9), ("mass",))
    rig = JointedRig("undamped", body, Damping(modal_ratios=(0.0,)), (spring,), Excitation(2.0, at="mass"))
    curve = trace_frequency(rig, (start, 1.3 * start), harmonics=7)
    begins = steady_state(rig, start, harmonics=7)["drive"].peak
    beside = steady_state(rig, start * (1.0 + 1e-9), harmonics=7)["drive"].peak
    assert curve.complete
    assert curve["drive"].peak[0] == pytest.approx(begins, rel=1e-6) == pytest.approx(beside, rel=1e-6)


def test_a_joint_that_no_rigid_motion_moves_does_not_hold_one_by_rounding() -> None:
    """Rigid shapes of matrices are uniform to rounding only: a stop between two masses held the chain at 1e12 m."""
    masses = np.array([1.0, 2.0, 1.5, 1.0])
    K = np.zeros((4, 4))
    for i, k in enumerate((2e5, 3e5, 1e5)):
        K[i : i + 2, i : i + 2] += k * np.array([[1.0, -1.0], [-1.0, 1.0]])
    body = MatrixBody(np.diag(masses), K, ("1", "2", "3", "4"), modes=4, damping_matrix=1e-4 * K)
    squares, shapes = eigh(K, np.diag(masses))
    squares[0], shapes[:, 0] = 0.0, 1.0 / np.sqrt(masses.sum())
    ports = {str(i): tuple(row) for i, row in enumerate(shapes.tolist(), 1)}
    damping = tuple(map(tuple, np.diag(1e-4 * squares)))
    exact = ModalModel(tuple(np.sqrt(squares) / (2 * np.pi)), ports, damping_matrix=damping)
    stop = Joint("stop", Stop(1e5, 2e-5), ("2",), ("4",))
    found, expected = (
        steady_state(
            JointedRig("chain", b, Damping(), (stop,), Excitation(30.0, at="1")), 45.0, harmonics=9, samples=512
        )
        for b in (body, exact)
    )
    for name in ("drive", "stop.motion", "stop.force"):
        there = expected[name].coefficients
        assert np.abs(found[name].coefficients - there).max() < 1e-5 * np.abs(there).max(), name
    assert expected["stop.force"].peak > 10.0


def test_a_free_body_with_a_loss_factor_has_modes() -> None:
    """Its rigid motion has no frequency at which to ask for the loss."""
    loss = Joint("loss", HystereticDamping(2e4, 45.0), ("a",), ("b",))
    body = ModalModel((0.0, 40.0), {"a": (0.5, 0.5), "b": (0.5, -0.5)})
    rig = JointedRig("free", body, Damping(modal_ratios=(0.01,)), (loss,), Excitation(1.0, at="a"))
    assert linear_modes(rig).stuck_hz[0] == pytest.approx(0.0, abs=1e-6)


def mounted(hz: tuple[float, ...], *joints: Joint) -> JointedRig:
    """A block that moves as a whole, with what else it has."""
    shapes = {"mount": (0.7, 0.5), "pad": (0.7, -0.3)}
    body = ModalModel(hz, {place: row[: len(hz)] for place, row in shapes.items()})
    return JointedRig("block", body, Damping(modal_ratios=(0.01,)), joints, Excitation(1.0, at="pad"))


@pytest.mark.parametrize("hz", [(0.0,), (0.0, 0.0), (0.0, 30.0)])
def test_a_sweep_is_about_the_resonance_of_a_body_on_its_mounts(hz: tuple[float, ...]) -> None:
    """With friction that slides, and that sticks beside the mount; a dense eigenvalue problem says where."""
    k, sticks = 2.4e4, MU * LOAD / 1e-3
    mount = Joint("mount", PolynomialSpring(linear=k), ("mount",))
    rig = mounted(hz, mount, Joint("pad", Friction(Jenkins(MU, 1e-3), LOAD), ("pad",)))
    row, pad = np.array(rig.body.ports["mount"]), np.array(rig.body.ports["pad"])
    free = np.diag((2 * np.pi * np.array(hz)) ** 2) + k * np.outer(row, row)
    first = [np.sqrt(np.abs(eigh(K)[0])) / (2 * np.pi) for K in (free, free + sticks * np.outer(pad, pad))]
    sliding, stuck = (float(f[f > 1e-3][0]) for f in first)
    assert sweep_of(rig, None, "frf") == pytest.approx((0.85 * sliding, 1.35 * sliding))
    assert sliding_to_stuck(rig) == pytest.approx((0.85 * min(sliding, stuck), max(1.35 * sliding, 1.1 * stuck)))


def test_a_body_that_nothing_holds_has_no_resonance_to_sweep_about() -> None:
    with pytest.raises(InputError, match="block: no spring holds it, so there is no resonance"):
        sweep_of(mounted((0.0, 0.0)), None, "frf")
