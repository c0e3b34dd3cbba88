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


def test_energies_are_as_uncertain_as_stated(solution: object) -> None:
    found = reconstruct_joints(RIG, _spectra(solution, 300))
    for joint in RIG.joints:
        f, u = (_kept(solution[f"{joint.name}.{what}"].coefficients) for what in ("force", "motion"))
        k = np.arange(1, H + 1)
        exact = -np.pi * float(f[1 : H + 1] @ (k * u[H + 1 :]) - f[H + 1 :] @ (k * u[1 : H + 1]))  # of these harmonics
        energy = found.energy[joint.name]
        pulls = (energy.value - exact) / energy.std
        assert np.std(pulls) == pytest.approx(1.0, abs=0.13), joint.name
        assert abs(np.mean(pulls)) < 0.2, joint.name
    assert found.energy["rub"].value.mean() > 100 * found.energy["rub"].std.mean()


def test_a_contradiction_widens_the_deviations(solution: object) -> None:
    spectra = _spectra(solution, 2)
    coefficients = spectra.coefficients.copy()
    coefficients[1, 0] *= 1.01  # the second record's first sensor
    found = reconstruct_joints(RIG, replace(spectra, coefficients=coefficients))
    assert found.probability[0] > 1e-3 > found.probability[1]
    wide = found["rub.force"].coefficient_std
    assert wide[1, 1] / wide[0, 1] == pytest.approx(np.sqrt(found.misfit.reduced[1]))
    assert found.warnings == (
        f"records 2: sensors contradict the body beyond noise, chi2_reduced up to {found.misfit.reduced[1]:.3g}; "
        "standard deviations are widened by its square root",
    )


def test_as_many_sensors_as_forces_leave_nothing_to_check(solution: object) -> None:
    found = reconstruct_joints(RIG, _spectra(solution, 2).select(channels=["a1", "a3", "a5", "force"]))
    assert found.warnings == ("as many sensors as joint forces: nothing is left to check the body by",)
    assert np.isnan(found.misfit.reduced).all() and (found.probability == 1.0).all()


def test_sensors_that_do_not_tell_forces_apart_are_refused(solution: object) -> None:
    spectra = _spectra(solution, 1)
    twice = replace(RIG, joints=(RIG.joints[0], replace(RIG.joints[0], name="again")))
    with pytest.raises(InputError, match=r"made: channels a1, .*, a5 do not tell the 2 joint forces apart at any"):
        reconstruct_joints(twice, spectra)


def test_a_harmonic_that_was_not_measured_is_left_out(solution: object) -> None:
    spectra = _spectra(solution, 3)
    std = spectra.std.copy()
    std[1, :3, 4] = np.nan
    found = reconstruct_joints(RIG, replace(spectra, std=std))
    assert np.argwhere(~found.found[:, 1:]).tolist() == [[1, 3]]
    assert found.warnings[0] == (
        "harmonic 4 of the joint forces: the sensors do not tell them apart in 1 of 3 records; left out there"
    )
    assert np.isfinite(found["rub.force"].samples).all()


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
