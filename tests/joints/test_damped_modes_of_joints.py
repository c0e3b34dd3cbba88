"""Linear modes of what joints damp, from next to nothing to beyond critical: complex ones, as a decay shows them."""

import numpy as np
import pytest

from hbm import linear_modes, simulate
from hbm.fourier import Array
from models.bodies import MatrixBody, ModalModel
from models.jointed import JointedRig
from models.joints import CubicSpring, Dashpot, Joint
from models.parts import Channel, Damping, Excitation

N, RATIO, BETWEEN = 12, 0.005, 1e6
K = BETWEEN * (2 * np.eye(N) - np.eye(N, k=1) - np.eye(N, k=-1))
K[-1, -1] = BETWEEN


def chain(coefficient: float) -> JointedRig:
    """Masses of 1 kg in a row, held at one end, a dashpot to the ground at the other."""
    places = tuple(str(i) for i in range(1, N + 1))
    return JointedRig(
        "chain",
        MatrixBody(np.eye(N), K, dofs=places, modes=N),
        Damping(modal_ratios=(RATIO,)),
        (Joint("damper", Dashpot(coefficient), (places[-1],)),),
        Excitation(1.0, at="3"),
        tuple(Channel(f"x{place}", "displacement", at=place) for place in places),
    )


def roots(coefficient: float) -> tuple[Array, Array]:
    """Roots and shapes of the chain's motion by its masses, the slowest first."""
    squares, shapes = np.linalg.eigh(K)
    C = shapes @ np.diag(2 * RATIO * np.sqrt(squares)) @ shapes.T
    C[-1, -1] += coefficient
    s, both = np.linalg.eig(np.block([[np.zeros((N, N)), np.eye(N)], [-K, -C]]))
    slowest = np.argsort(np.abs(s))
    return s[slowest], both[:, slowest]


@pytest.mark.parametrize(("coefficient", "still"), [(0.5, 0), (300.0, 0), (1200.0, 1), (3000.0, 1), (1e5, 1)])
def test_they_are_those_of_the_state_matrix(coefficient: float, still: int) -> None:
    """A pair of real roots is one mode beyond critical: its frequency is their geometric mean."""
    s, _ = roots(coefficient)
    turning, real = s[s.imag > 1e-6], np.sort(-s[np.abs(s.imag) < 1e-6].real)
    assert len(real) == 2 * still
    expected = [(abs(root), -root.real / abs(root)) for root in turning]
    expected += [(np.sqrt(a * b), (a + b) / (2 * np.sqrt(a * b))) for a, b in [real[:2]] * still]
    omega, ratio = np.array(sorted(expected)).T
    found = linear_modes(chain(coefficient))
    assert 2 * np.pi * found.stuck_hz == pytest.approx(omega, rel=1e-8)
    assert found.stuck_damping_ratio == pytest.approx(ratio, rel=1e-6)
    assert [found.stuck_damping_ratio[i - 1] > 1.0 for i in found.overdamped] == [True] * still


@pytest.mark.parametrize(("coefficient", "number"), [(300.0, 1), (3000.0, 1)])
def test_a_decay_in_time_shows_them(coefficient: float, number: int) -> None:
    """Started in the shape of a mode, every period is the one before, smaller by what its ratio says."""
    rig, found = chain(coefficient), linear_modes(chain(coefficient))
    omega, ratio = 2 * np.pi * found.stuck_hz[number - 1], found.stuck_damping_ratio[number - 1]
    turning = omega * np.sqrt(1 - ratio**2)
    s, shapes = roots(coefficient)
    shape = shapes[:, np.flatnonzero(s.imag > 1e-6)[number - 1]].real
    modes = rig.structure.channels.T  # of masses of 1 kg
    start = np.concatenate([modes @ shape[:N], modes @ shape[N:], [-coefficient * shape[-1]]])  # and the damper's force
    hz = turning / (2 * np.pi)
    history = simulate(rig, hz, level=0.0, start=start, duration=2 / hz, steps_per_period=2048)
    moved = history.channels["x1"].values[: 2 * 2048]
    assert moved[2048:] == pytest.approx(np.exp(-ratio * omega / hz) * moved[:2048], abs=1e-4 * np.abs(moved).max())


def test_a_free_body_with_a_damper_has_a_motion_that_nothing_brings_back() -> None:
    """Of one rigid and one elastic mode: the rigid one stops where it is; without the damper it goes on."""
    body = ModalModel((0.0, 20.0), {"tip": (1.0, 1.0)})
    damper, drive = Joint("damper", Dashpot(5.0), ("tip",)), Excitation(1.0, at="tip")
    rig = JointedRig("free", body, Damping(modal_ratios=(0.01,)), (damper,), drive)
    found = linear_modes(rig)
    assert found.stuck_hz[0] == 0.0 and found.stuck_damping_ratio[0] == np.inf
    squares, c = (2 * np.pi * 20.0) ** 2, 5.0
    C = np.array([[c, c], [c, c + 0.02 * np.sqrt(squares)]])
    s = np.linalg.eigvals(np.block([[np.zeros((2, 2)), np.eye(2)], [-np.diag([0.0, squares]), -C]]))
    root = s[s.imag > 1.0][0]
    assert found.stuck_hz[1] == pytest.approx(abs(root) / (2 * np.pi), rel=1e-9)
    assert found.stuck_damping_ratio[1] == pytest.approx(-root.real / abs(root), rel=1e-8)


def test_every_motion_that_nothing_brings_back_is_at_zero() -> None:
    """Two masses on a spring that is free in two directions, each rubbing on the ground: two roots 0 and two -1 / s."""
    pair = 1e4 * np.kron(np.eye(2), [[1.0, -1.0], [-1.0, 1.0]])
    body = MatrixBody(np.eye(4), pair, damping_matrix=np.eye(4), dofs=("1.x", "2.x", "1.y", "2.y"), modes=4)
    rig = JointedRig(
        "free", body, Damping(), (Joint("spring", CubicSpring(1.0), ("1.x",), to=("2.x",)),), Excitation(1.0, at="1.x")
    )
    found = linear_modes(rig)
    assert found.stuck_hz[:2].tolist() == [0.0, 0.0] and found.stuck_damping_ratio[:2].tolist() == [np.inf, np.inf]
    assert found.stuck_hz[2:] == pytest.approx(2 * [np.sqrt(2e4) / (2 * np.pi)], rel=1e-9)
    assert found.stuck_damping_ratio[2:] == pytest.approx(2 * [0.5 / np.sqrt(2e4)], rel=1e-6)
