"""Time integration that begins with a motion of a harmonic balance: a point of a curve, or of a nonlinear mode."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from hbm import InputError, joint_steady_state, nonlinear_mode, simulate, steady_state, trace_frequency
from hbm.balance.solution import PeriodicSolution
from hbm.integration.handover import state_at_phase_zero
from hbm.response.curve import ResponseCurve
from models import Iwan
from models.bodies import MatrixBody
from models.jointed import AnyRig, JointedRig
from models.joints import CubicSpring, Friction, Joint
from models.parts import Channel, Damping, Excitation
from models.published import paper_rig

CHANNELS = ("drive", "a3")


def frame() -> JointedRig:
    """Three masses in a row; the last rubs on the ground, a cable holds the second: the curve leans to the right."""
    stiffness = 1e5 * np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    return JointedRig(
        "frame",
        MatrixBody(np.eye(3), stiffness, dofs=("1", "2", "3"), modes=3),
        Damping(modal_ratios=(0.002,)),
        (
            Joint("bolt", Friction(Iwan(mu=0.4, stiffness=5e3), normal_load=10.0), at=("3",)),
            Joint("cable", CubicSpring(cubic=2e8), at=("2",)),
        ),
        Excitation(6.0, at="3"),
        (Channel("a3", "acceleration", at="3"),),
    )


@pytest.fixture(scope="module")
def leaning() -> ResponseCurve:
    return trace_frequency(frame(), (22.0, 28.0), harmonics=9)


def departure(rig: AnyRig, point: PeriodicSolution, periods: int = 30) -> float:
    """Largest change of a coefficient from a point to the last period of a march from it, relative to the channel."""
    history = simulate(rig, point.hz, level=point.level, start=point, duration=periods / point.hz)
    changes = []
    for name in [c for c in CHANNELS if c in point.channels]:
        H = 5
        own, found = point[name].coefficients, history.coefficients(name, H)
        kept = np.r_[own[: H + 1], own[point.basis.H + 1 : point.basis.H + 1 + H]]
        changes.append(np.abs(found - kept).max() / np.abs(own).max())
    return float(max(changes))


def branches(curve: ResponseCurve, within: tuple[float, float]) -> Sequence[PeriodicSolution]:
    """Highest and lowest motion between two frequencies where the curve has several."""
    found = [p for p in curve.points if within[0] < p.hz < within[1]]
    ordered = sorted(found, key=lambda p: p["drive"].peak)
    return ordered[-1], ordered[0]


def test_a_march_from_a_point_stays_on_its_branch(leaning: ResponseCurve) -> None:
    first, last = sorted(leaning.folds)
    upper, lower = branches(leaning, (first, last))
    assert upper["drive"].peak > 3.0 * lower["drive"].peak
    for point in (leaning.peak, upper, lower):
        assert departure(leaning.rig, point) < 1e-3
    assert departure(leaning.rig, leaning.points[0]) < 1e-3


def test_a_march_of_a_rubbing_beam_stays_on_its_branch() -> None:
    curve = trace_frequency(paper_rig(), (47.0, 52.0), harmonics=19)
    first, last = sorted(curve.folds)
    for point in branches(curve, (first, last)):
        assert departure(curve.rig, point) < 1e-3
    peak = curve.peak
    own, same = (
        simulate(curve.rig, peak.hz, level=peak.level, start=start, duration=2 / peak.hz)
        for start in (peak, state_at_phase_zero(peak))
    )
    np.testing.assert_array_equal(own.q, same.q)


def test_shooting_begins_with_a_point_too(leaning: ResponseCurve) -> None:
    peak = leaning.peak
    period = joint_steady_state(leaning.rig, peak.hz, start=peak)
    assert np.abs(period.history.channels["drive"].values).max() == pytest.approx(peak["drive"].peak, rel=1e-3)
    assert period.iterations < 10


def test_a_free_motion_decays_along_its_mode() -> None:
    """Cycle by cycle, from a point where a cycle takes 8 % of the motion."""
    mode = nonlinear_mode(frame(), amplitudes=(1e-4, 1e-2))
    start = mode.at([6e-3])
    history = simulate(mode.rig, start.hz[0], level=0.0, start=start.points[0], duration=8 / start.hz[0])
    t, y = history.time, history.channels["drive"].values
    up = np.flatnonzero((y[:-1] < 0.0) & (y[1:] >= 0.0))
    crossing = t[up] - y[up] * (t[up + 1] - t[up]) / (y[up + 1] - y[up])
    largest = np.array([np.abs(y[i:j]).max() for i, j in pairwise(up)])
    rate = np.log(largest[:-2] / largest[2:]) / (crossing[2:-1] - crossing[:-3])
    along = mode.at(largest[1:-1])
    np.testing.assert_allclose(rate, along.decay_rate, rtol=0.03)
    np.testing.assert_allclose(1 / np.diff(crossing)[1:-1], along.decaying_hz, rtol=2e-3)


def test_motions_of_other_rigs_are_refused(leaning: ResponseCurve) -> None:
    peak, other = leaning.peak, paper_rig()
    with pytest.raises(InputError) as refused:
        simulate(other, 50.0, start=peak)
    assert str(refused.value) == f"simulate: start has no slip; must be a motion of {other.name}"
    fewer = leaning.rig.with_modes(2)
    with pytest.raises(InputError) as refused:
        simulate(fewer, 25.0, start=peak)
    said = "start has 3 modes; must have 2 as frame; simulate the rig of its curve, curve.rig"
    assert str(refused.value) == f"simulate: {said}"
    with pytest.raises(InputError) as refused:
        joint_steady_state(fewer, 25.0, start=peak)
    assert str(refused.value) == f"joint_steady_state: {said}"


def test_a_motion_goes_on_in_a_rig_of_other_numbers(leaning: ResponseCurve) -> None:
    peak, softer = leaning.peak, leaning.rig.with_number("joints.cable.cubic", 1.9e8)
    history = simulate(softer, peak.hz, level=peak.level, start=peak, duration=1 / peak.hz)
    began = history.channels["drive"].values[0]
    assert began == pytest.approx(peak["drive"].samples[0], rel=1e-6)


@pytest.mark.parametrize(
    ("joints", "said"),
    [
        (lambda j: j[:1], "start has cable.motion; must be a motion of frame, which has no such joint"),
        (lambda j: j[::-1], "start has its joints in another order; must be as in frame, cable.motion, bolt.motion"),
        (lambda j: (*j, replace(j[1], name="rope")), "start has no rope.motion; must be a motion of frame"),
    ],
    ids=["one less", "another order", "one more"],
)
def test_motions_of_other_joints_are_refused(
    leaning: ResponseCurve, joints: Callable[[tuple[Joint, ...]], tuple[Joint, ...]], said: str
) -> None:
    peak, other = leaning.peak, replace(leaning.rig, joints=joints(leaning.rig.joints))
    with pytest.raises(InputError) as refused:
        simulate(other, peak.hz, start=peak)
    assert str(refused.value) == f"simulate: {said}"
    with pytest.raises(InputError) as refused:
        steady_state(other, peak.hz, start=peak)
    assert str(refused.value) == f"steady_state: {said}"
