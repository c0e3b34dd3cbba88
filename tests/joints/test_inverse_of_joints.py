"""Joint forces from sensors: found within their stated uncertainty, and refused where sensors are too few."""

from dataclasses import replace

import numpy as np
import pytest

from hbm.errors import InputError
from hbm.inverse.jointed import receptances, reconstruct_joints
from hbm.measurement.spectra import MeasuredSpectra
from hbm.response.trace import steady_state
from models import Jenkins
from models.joints import Friction, Joint, PolynomialSpring, Stop
from models.parts import Channel
from tests.joints.rigs import beam_rig

H, STD = 5, 1e-3
CHANNELS = (*(Channel(f"a{i}", "acceleration", 0.1 * i) for i in range(1, 6)), Channel("force", "force"))
RIG = replace(
    beam_rig(Friction(Jenkins(0.4, 1e-6), 5.0)),
    joints=(
        Joint("rub", Friction(Jenkins(0.4, 1e-6), 5.0), ("y(0.25)",)),
        Joint("spring", PolynomialSpring(linear=1e3, cubic=1e13), ("y(0.3)",), ("y(0.45)",)),
        Joint("stop", Stop(2e4, 4e-6), ("y(0.4)",)),
    ),
    channels=CHANNELS,
)


@pytest.fixture(scope="module")
def solution() -> object:
    return steady_state(RIG, 45.0, harmonics=25, samples=1024)


def _kept(coefficients: np.ndarray) -> np.ndarray:
    full = len(coefficients) // 2
    return np.r_[coefficients[: H + 1], coefficients[full + 1 : full + 1 + H]]


def _spectra(solution: object, draws: int) -> MeasuredSpectra:
    rng = np.random.default_rng(0)
    exact = np.array([_kept(solution[c.name].coefficients) for c in CHANNELS])
    noisy = exact + STD * rng.normal(size=(draws, *exact.shape))
    names = tuple(c.name for c in CHANNELS)
    std = np.full((draws, len(names), H + 1), STD)
    ones = np.ones(draws)
    return MeasuredSpectra("made", np.arange(1, draws + 1), 20.0 * ones, 45.0 * ones, names, noisy, std)


def test_errors_are_as_large_as_stated(solution: object) -> None:
    found = reconstruct_joints(RIG, _spectra(solution, 300))
    for name in (*RIG.forces, *RIG.motions):
        signal, exact = found[name], _kept(solution[name].coefficients)
        pulls = (signal.coefficients - exact)[:, 1:] / np.hstack([signal.coefficient_std[:, 1:]] * 2)
        assert np.std(pulls) == pytest.approx(1.0, abs=0.06), name
        assert abs(np.mean(pulls)) < 0.1, name
        assert np.isnan(signal.coefficients[:, 0]).all()
    assert np.mean(found.chi2 / found.freedom) == pytest.approx(1.0, abs=0.1)
    assert np.mean(found.probability < 0.05) < 0.12


def test_a_wrong_body_is_told_by_the_misfit(solution: object) -> None:
    stiffer = replace(RIG, body=replace(RIG.body, beam=replace(RIG.body.beam, youngs_modulus=230e9)))
    assert reconstruct_joints(stiffer, _spectra(solution, 1)).probability[0] < 1e-6


def test_receptances_obey_reciprocity() -> None:
    found = receptances(RIG.structure, 300.0)
    assert np.allclose(found.joints_by_joints, found.joints_by_joints.T)


def test_fewer_sensors_than_forces_are_refused(solution: object) -> None:
    few = _spectra(solution, 1).select(channels=["a1", "a2", "force"])
    with pytest.raises(InputError, match="2 response channels measured and 3 joint forces unknown"):
        reconstruct_joints(RIG, few)
