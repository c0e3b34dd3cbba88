"""Set-valued friction that mostly sticks on structures that yield nowhere but in the modes kept."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import sparse
from scipy.linalg import eigh

from hbm import linear_modes, steady_state, trace_frequency
from hbm.balance.solution import PeriodicSolution
from hbm.fourier import Array
from hbm.integration.jointed import simulate_joints
from models import Coulomb, FrictionLaw, Karnopp
from models.bodies import MatrixBody
from models.bodies.modal import ModalModel
from models.jointed import JointedRig
from models.joints import Friction, Joint
from models.parts import Damping, Excitation

HZ, LIMIT = 21.0, 3.0
M = np.diag([1.0, 0.8, 0.5])
K = np.array([[35e3, -15e3, 0.0], [-15e3, 25e3, -10e3], [0.0, -10e3, 12e3]])
C = 0.4 * M + 2e-5 * K
HELD = [0, 2]
BODY = MatrixBody(
    sparse.csc_array(M), sparse.csc_array(K), ("a", "b", "c"), modes=3, damping_matrix=sparse.csc_array(C)
)
LAWS: dict[str, FrictionLaw] = {"coulomb": Coulomb(0.3), "karnopp": Karnopp(0.3, 0.3, 1e-4)}


def rubbing(law: FrictionLaw, force: float) -> JointedRig:
    """The middle one of three masses rubs on the ground, the first is driven."""
    joint = Joint("rub", Friction(law, LIMIT / 0.3), ("b",))
    return JointedRig("three masses", BODY, Damping(), (joint,), Excitation(force, at="a"))


@cache
def slipping(name: str, force: float) -> PeriodicSolution:
    return steady_state(rubbing(LAWS[name], force), HZ, harmonics=31)


def held(hz: float) -> tuple[float, float]:
    """Amplitudes per force of the drive and of the force that holds the middle mass."""
    omega = 2 * np.pi * hz
    D = K - omega**2 * M + 1j * omega * C
    x = np.linalg.solve(D[np.ix_(HELD, HELD)], [1.0, 0.0])
    return abs(x[0]), abs(D[1, HELD] @ x)


def amplitude(coefficients: Array) -> float:
    """Of the fundamental."""
    return float(np.hypot(coefficients[1], coefficients[len(coefficients) // 2 + 1]))


@pytest.mark.parametrize("harmonics", [15, 31])
@pytest.mark.parametrize("name", LAWS)
def test_a_joint_that_holds_leaves_the_linear_structure_it_holds(name: str, harmonics: int) -> None:
    """Below the limit of friction the mass does not move: the others answer as if it were clamped."""
    rig, (drive, holding) = rubbing(LAWS[name], 2.0), held(HZ)
    assert 2.0 * holding < LIMIT
    found = steady_state(rig, HZ, harmonics=harmonics)
    assert amplitude(found["drive"].coefficients) == pytest.approx(2.0 * drive, rel=1e-9)
    assert amplitude(found["rub.force"].coefficients) == pytest.approx(2.0 * holding, rel=1e-9)
    assert found["rub.motion"].peak < 1e-9 * found["drive"].peak
    assert trace_frequency(rig, (18.0, 22.0), harmonics=harmonics).complete
    clamped = eigh(K[np.ix_(HELD, HELD)], M[np.ix_(HELD, HELD)], eigvals_only=True)
    assert linear_modes(rig).stuck_hz[:2] == pytest.approx(np.sqrt(clamped) / (2 * np.pi), rel=1e-9)


@pytest.mark.parametrize("force", [5.0, 9.0])
@pytest.mark.parametrize("name", LAWS)
def test_a_joint_that_slips_at_times_has_a_first_solution(name: str, force: float) -> None:
    """It is that of a march in time, to what 31 harmonics leave out: sticking ends and begins with corners."""
    rig = rubbing(LAWS[name], force)
    marched = simulate_joints(rig, HZ, periods=200, steps_per_period=1024, last_periods=1).coefficients("drive", 1)
    found = slipping(name, force)
    assert amplitude(found["drive"].coefficients) == pytest.approx(amplitude(marched), rel=2e-3)
    assert abs(found.energy_error) < 1e-9


@pytest.mark.parametrize("compliance", [1e-11, 1e-9, 1e-7])
def test_a_small_compliance_of_the_structure_hardly_matters(compliance: float) -> None:
    """One far below what the structure yields at rest (0.07 mm/N) changes the motion by about its share of that."""
    rig = rubbing(LAWS["coulomb"], 5.0)
    s = rig.structure
    rows = {"a": tuple(s.excitation.tolist()), "b": tuple(s.joints[0].tolist())}
    body = ModalModel(
        tuple((s.omega_n / (2 * np.pi)).tolist()),
        rows,
        ((0.0, 0.0), (0.0, compliance)),
        tuple(map(tuple, s.damping.tolist())),
    )
    rigid, yielding = (
        slipping("coulomb", 5.0)["drive"],
        steady_state(replace(rig, body=body), HZ, harmonics=31)["drive"],
    )
    static = float(np.linalg.inv(K)[1, 1])
    assert amplitude(yielding.coefficients) == pytest.approx(
        amplitude(rigid.coefficients), rel=2.0 * compliance / static
    )
