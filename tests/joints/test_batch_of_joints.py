"""Records of a rig with joints solved together: the same steady states and derivatives as one by one."""

from dataclasses import replace

import numpy as np
import pytest

from hbm.balance.batch import Motions
from hbm.balance.batchednewton import Solved, solve
from hbm.balance.jointbatch import JointBatch, JointMatrices, is_batched
from hbm.balance.jointed import JointBalance
from hbm.balance.problem import State
from hbm.balance.solution import PeriodicSolution, describe_joints
from hbm.fourier import FourierBasis
from hbm.outputerror.measured import campaign_of
from hbm.outputerror.simulated import simulated
from hbm.outputerror.together import simulated_together
from hbm.response.trace import steady_state
from hbm.sensitivity.jointbatch import joint_changes_together
from hbm.sensitivity.jointed import followed, joint_sensitivities, linearized
from models import Iwan, Jenkins, LuGre
from models.jointed import JointedRig
from models.joints import Friction, Joint, PolynomialSpring
from models.parts import Channel, Drift
from models.scalars import solution_numbers
from tests.joints.rigs import beam_rig, made_up
from tests.three_modes import rig_of, spectra_with_noise

SENSORS = (
    Channel("a", "acceleration", at="a", gain=1.02, delay=3e-4),
    Channel("b", "displacement", at="e"),
    Channel("c", "velocity", at="c", delay=-1e-3),
)
MADE_UP = replace(made_up(damped=False, rigid=False), channels=SENSORS)
RIGS = {
    "reaction": (MADE_UP, ((0.8, 1.0), (1.4, 1.0), (2.1, 0.3))),
    "coupled": (replace(made_up(damped=True, rigid=False), channels=SENSORS), ((0.8, 1.0), (2.1, 0.3))),
    "jenkins": (beam_rig(Friction(Jenkins(0.4, 1e-6), 5.0)), ((42.0, 20.0), (45.0, 20.0), (46.0, 6.0), (52.0, 20.0))),
    "iwan": (beam_rig(Friction(Iwan(0.4, 1e6), 5.0)), ((42.0, 20.0), (46.0, 6.0))),
    "lugre": (beam_rig(Friction(LuGre(0.5, 0.3, 1e-3, 4e6, 200.0, 1.0), 40.0)), ((42.0, 20.0), (46.0, 6.0))),
}
BASIS = FourierBasis(7, 128)


def alone(rig: JointedRig, hz: float, level: float, start: PeriodicSolution | None = None) -> PeriodicSolution:
    return steady_state(rig, hz, level=level, harmonics=BASIS.H, samples=BASIS.N_t, start=start)


def together(rig: JointedRig, starts: list[PeriodicSolution], at: tuple[tuple[float, float], ...]) -> Solved:
    first, (hz, levels) = JointBalance(rig, BASIS), zip(*at, strict=True)
    batch = JointBatch([first.at_level(level) for level in levels], np.array(hz))
    begin = Motions(*(np.stack([getattr(s.state, name) for s in starts]) for name in "QT"))
    return solve(JointMatrices(batch), begin, 15)


@pytest.mark.parametrize("name", RIGS)
def test_steady_states_and_derivatives_are_those_of_each_alone(name: str) -> None:
    rig, at = RIGS[name]
    assert is_batched(rig, BASIS)
    there = [alone(rig, hz, level) for hz, level in at]
    near = [alone(rig, 1.0005 * s.hz, s.level, s) for s in there]
    found = together(rig, near, at)
    assert found.converged.all()
    keys, sensors, ports = list(solution_numbers(rig, *at[0])), [c.name for c in rig.response_channels], [0, 1]
    by, pushed = joint_changes_together(found, keys, sensors, ports)
    assert by.solved.all()
    for i, solution in enumerate(there):
        assert np.abs(found.motions.Q[i] - solution.state.Q).max() < 1e-8 * np.abs(solution.state.Q).max()
        assert np.abs(found.motions.T[i] - solution.state.T).max() < 1e-8 * np.abs(solution.state.T).max()
        batch = found.matrices.batch
        state = State(found.motions.Q[i], found.motions.T[i], float(batch.Omega[i, 0]), at[i][1])
        here = describe_joints(batch.problems[i], state, at[i][0], batch.of_joints(found.seen.signals[i]))
        one = joint_sensitivities(rig, here, keys)
        for j, sensor in enumerate(sensors):
            np.testing.assert_allclose(by.reads[i, j], here[sensor].coefficients, rtol=0, atol=1e-9 * here[sensor].peak)
            alike(by.channels[i, j], one[sensor].coefficients)
        alike(by.own_Q[i], one.own_Q)
        alike(by.T[i], one.T)
        linear = linearized(rig, here)
        change = np.zeros((linear.problem.size, len(ports)))
        laws = change[BASIS.size * rig.structure.n :].reshape(BASIS.size, rig.ports, len(ports))
        laws[0, ports, range(len(ports))] = -1.0 / linear.problem.f_ref[ports]
        alike(pushed[i, len(sensors) :], followed(linear, change)[1][:, ports].transpose(1, 0, 2))


def alike(these: np.ndarray, those: np.ndarray) -> None:
    """The same for each number, to what Newton's method leaves."""
    of_all = tuple(range(these.ndim - 1))
    assert np.all(np.abs(these - those).max(axis=of_all) <= 1e-8 * np.abs(those).max(axis=of_all))


def test_records_of_a_measurement_are_those_of_each_alone() -> None:
    """With what the history of a joint that sticks does to them."""
    joints = (
        Joint("stuck", Friction(Jenkins(0.4, 1e-5), 100.0), ("b",)),
        Joint("spring", PolynomialSpring(cubic=1e9), ("a",)),
    )
    rig, hz, level = rig_of(joints=joints), np.array([19.5, 20.1, 20.6, 46.5]), np.array([1.0, 1.0, 0.5, 4.0])
    there = [steady_state(rig, f, level=F, harmonics=7, samples=128) for f, F in zip(hz, level, strict=True)]
    seen = {name: np.array([kept(s[name].coefficients) for s in there]) for name in ("a", "b", "c")}
    campaign, _ = campaign_of(rig, spectra_with_noise(rig, seen, hz, level, np.random.default_rng(1)))
    working, data, keys = campaign.numerics.working, campaign.data, ("joints.spring.cubic", "modal.frequencies_hz[1]")
    starts = [record.start for record in data.records]
    found = list(simulated_together(working.rig(rig), working.basis, data, keys, data.records, starts))
    for record, start, one in zip(data.records, starts, found, strict=True):
        other = simulated(working.rig(rig), working.basis, data, keys, record, start)
        assert one is not None and other is not None
        assert one.by_history is not None and one.by_history.shape[-1] == 1
        for name in ("amplitudes", "by_keys", "by_force", "by_hz", "by_history", "Q_by_keys", "T_by_keys"):
            these, those = getattr(one, name), getattr(other, name)
            assert these.shape == those.shape
            assert np.abs(these - those).max() <= 1e-8 * np.abs(those).max(), name


def kept(coefficients: np.ndarray, most: int = 5) -> np.ndarray:
    """Coefficients of the lowest harmonics."""
    full = len(coefficients) // 2
    return np.r_[coefficients[: most + 1], coefficients[full + 1 : full + 1 + most]]


def test_a_record_that_leaves_the_numbers_is_given_up_and_the_others_found() -> None:
    rig, at = RIGS["jenkins"]
    near = [alone(rig, hz, level) for hz, level in at[:2]]
    far = replace(near[0], state=replace(near[0].state, Q=np.full_like(near[0].state.Q, 1e300)))
    found = together(rig, [near[0], far, near[1]], (at[0], at[0], at[1]))
    assert found.converged.tolist() == [True, False, True]


def test_free_bodies_drifts_and_many_unknowns_are_left_to_one_by_one() -> None:
    assert not is_batched(made_up(damped=False, rigid=True), BASIS)
    assert not is_batched(replace(MADE_UP, drift=(Drift("joints.rub.mu", 1e-3),)), BASIS)
    assert not is_batched(replace(MADE_UP, excitation=replace(MADE_UP.excitation, measured_harmonics=True)), BASIS)
    assert not is_batched(MADE_UP, FourierBasis(60, 512))
