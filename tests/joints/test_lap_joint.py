"""The example of two plates in a lap joint: its matrices, its reduction, its motion and its backbone."""

import importlib.util
import re
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.linalg import eigsh

from hbm import joint_steady_state, nonlinear_mode, steady_state
from hbm.balance.jointed import JointBalance
from hbm.integration.jointed import state_at_phase_zero
from models.jointed import JointedRig

pytest.importorskip("skfem")

FILE = Path(__file__).parents[2] / "examples" / "lap_joint.py"
HZ, FORCE = 154.4, 0.5  # about the top of the resonance with two contacts, which slip


@pytest.fixture(scope="module")
def example() -> ModuleType:
    spec = importlib.util.spec_from_file_location(FILE.stem, FILE)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module", params=["jenkins", "plane"])
def rig(example: ModuleType, request: pytest.FixtureRequest) -> JointedRig:
    made: JointedRig = example.lap_joint(2, request.param == "plane", FORCE)
    return made


def joined_hz(rig: JointedRig, example: ModuleType, plane: bool) -> float:
    """First frequency of all degrees of freedom with springs in place of the joints [Hz]."""
    body, contacts = rig.body, len(rig.joints)
    number = {name: i for i, name in enumerate(body.dofs)}
    ends = sparse.lil_array((rig.ports, len(number)))
    for row, (at, to) in enumerate(pair for j in rig.joints for pair in j.ends):
        ends[row, [number[at], number[to]]] = 1.0, -1.0
    each = [example.SHEAR / contacts] * 2 + [example.NORMAL / contacts] if plane else [example.SHEAR / contacts]
    held = body.stiffness + ends.T @ sparse.diags_array(each * contacts) @ ends
    free = [i for name, i in number.items() if name not in set(body.fixed)]
    K, M = (sparse.csc_array(m)[free][:, free] for m in (held, body.mass))
    return float(np.sqrt(eigsh(K, 1, M, sigma=0.0)[0][0])) / (2 * np.pi)


def test_names_say_where_and_which_way(example: ModuleType) -> None:
    names = example.names("left", (0.0, 0.0, 0.0))
    _, _, M, K = example.plate()
    found = [re.fullmatch(r"left\((.*),(.*),(.*)\)\.([xyz])", name) for name in names]
    x, y, _ = (np.array([float(m[i]) for m in found if m]) for i in (1, 2, 3))
    along = np.array([m[4] for m in found if m])
    volume = 1e-9 * example.LENGTH * example.WIDTH * example.THICKNESS
    for direction in "xyz":
        moved = (along == direction).astype(float)
        assert moved @ (M @ moved) == pytest.approx(example.DENSITY * volume, rel=1e-9)
    turned = np.select([along == "x", along == "y"], [-y, x], 0.0)
    assert np.abs(K @ turned).max() < 1e-9 * (abs(K) @ np.abs(turned)).max()


def test_the_reduction_states_its_error(rig: JointedRig) -> None:
    assert rig.body.receptance_error(rig.places, rig.damping, (140.0, 155.0, 170.0)) < 1e-4


def test_time_integration_agrees_and_energy_closes(rig: JointedRig) -> None:
    solution = steady_state(rig, HZ, harmonics=28, samples=1024)
    start = state_at_phase_zero(JointBalance(rig, solution.basis), solution.state)
    marched = joint_steady_state(rig, HZ, steps_per_period=1024, start=start)
    drive = solution["drive"].coefficients
    expected = marched.history.coefficients("drive", 1)[1:]
    assert np.hypot(*(drive[[1, 29]] - expected)) < 5e-3 * np.hypot(*expected)
    assert abs(solution.energy_error) < 1e-6
    assert solution.friction_loss > 0.5 * np.pi * FORCE * np.hypot(*expected)  # most of it goes into the contacts


def test_both_reductions_move_alike(rig: JointedRig) -> None:
    other = replace(rig, body=replace(rig.body, reduction="craig-bampton", modes=14))
    peaks = [steady_state(r, HZ, harmonics=15, samples=512)["drive"].peak for r in (rig, other)]
    assert peaks[1] == pytest.approx(peaks[0], rel=3e-3)


def test_the_backbone_leaves_the_joined_mode(rig: JointedRig, example: ModuleType) -> None:
    mode = nonlinear_mode(rig, amplitudes=(1e-5, 5e-4), harmonics=5, samples=128)
    assert mode.complete
    assert mode.hz[0] == pytest.approx(joined_hz(rig, example, rig.ports > 2), rel=1e-5)
    assert mode.hz[-1] < mode.hz[0] - 1.0
    assert mode.damping_ratio.max() > 3 * mode.damping_ratio[0]
