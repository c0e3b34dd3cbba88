"""Joint forces from sensors: found within their stated uncertainty, and refused where sensors are too few."""

from dataclasses import replace

import numpy as np
import pytest

from hbm import contact_errors
from hbm.errors import InputError
from hbm.inverse.jointed import receptances, reconstruct_joints
from hbm.measurement.spectra import MeasuredSpectra
from hbm.outputerror.nominal import tolerances
from hbm.response.trace import steady_state
from models import Jenkins
from models.bodies import ModalModel
from models.jointed import JointedRig
from models.joints import Friction, Joint, PolynomialSpring, Stop
from models.parts import Channel, Damping, Excitation
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


def _kept(coefficients: np.ndarray, most: int = H) -> np.ndarray:
    full = len(coefficients) // 2
    return np.r_[coefficients[: most + 1], coefficients[full + 1 : full + 1 + most]]


def _spectra(solution: object, draws: int, most: int = H, noise: float = STD) -> MeasuredSpectra:
    rng = np.random.default_rng(0)
    exact = np.array([_kept(solution[c.name].coefficients, most) for c in CHANNELS])
    noisy = exact + noise * rng.normal(size=(draws, *exact.shape))
    names = tuple(c.name for c in CHANNELS)
    std = np.full((draws, len(names), most + 1), noise)
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


def _energy(solution: object, joint: str) -> float:
    """What a joint takes in a period by all harmonics of its force and motion."""
    f, u = (solution[f"{joint}.{what}"].coefficients for what in ("force", "motion"))
    most = len(f) // 2
    k = np.arange(1, most + 1)
    return -np.pi * float(f[1 : most + 1] @ (k * u[most + 1 :]) - f[most + 1 :] @ (k * u[1 : most + 1]))


def test_energies_are_as_uncertain_as_stated(solution: object) -> None:
    """By noise: all harmonics are measured."""
    found = reconstruct_joints(RIG, _spectra(solution, 300, most=25))
    for joint in RIG.joints:
        energy = found.energy[joint.name]
        pulls = (energy.value - _energy(solution, joint.name)) / energy.std
        assert np.std(pulls) == pytest.approx(1.0, abs=0.13), joint.name
        assert abs(np.mean(pulls)) < 0.2, joint.name
    assert found.energy["rub"].value.mean() > 100 * found.energy["rub"].std.mean()


def test_energies_are_as_uncertain_as_harmonics_leave_them_that_were_not_measured(solution: object) -> None:
    """Hardly any noise: what is wrong is the energy of harmonics above the third and the fifth, some of it lost."""
    pulls = []
    for most in (3, 5):
        found = reconstruct_joints(RIG, _spectra(solution, 1, most=most, noise=1e-6))
        for joint in RIG.joints:
            energy, exact = found.energy[joint.name], _energy(solution, joint.name)
            pulls.append((energy.value[0] - exact) / energy.std[0])
    assert 0.3 < np.sqrt(np.mean(np.square(pulls))) < 1.5


def test_a_contradiction_widens_the_deviations(solution: object) -> None:
    spectra = _spectra(solution, 2)
    coefficients = spectra.coefficients.copy()
    coefficients[1, 0] *= 1.01  # the second record's first sensor
    found = reconstruct_joints(RIG, replace(spectra, coefficients=coefficients))
    assert found.probability[0] > 1e-3 > found.probability[1]
    wide = found["rub.force"].coefficient_std
    assert wide[1, 1] / wide[0, 1] == pytest.approx(np.sqrt(found.misfit.reduced[1]))
    assert len(found.findings) == 1 and found.findings[0].startswith("a1: contradicts the other channels, ")
    assert found.warnings == (
        *found.findings,
        f"records 2: sensors contradict the body beyond noise, chi2_reduced up to {found.misfit.reduced[1]:.3g}; "
        "standard deviations are widened by its square root",
    )


def test_a_record_of_noise_alone_is_named(solution: object) -> None:
    spectra = _spectra(solution, 2)
    spectra.coefficients[1] = np.random.default_rng(3).normal(scale=STD, size=spectra.coefficients[1].shape)
    (line,) = reconstruct_joints(RIG, spectra).warnings
    assert line == "record 2 of made: every channel reads noise alone; was the shaker off?"


def test_without_a_force_channel_its_fundamental_is_one_more_unknown(solution: object) -> None:
    """Phases are counted from anywhere then: forces turn along with the responses, and err by what is stated."""
    spectra, turn = _spectra(solution, 100).without("force"), np.exp(1j * np.arange(H + 1))
    c = np.stack([spectra.complex(name) for name in spectra.channels], axis=1) * turn
    turned = replace(spectra, coefficients=np.concatenate([c.real, -c.imag[..., 1:]], axis=2))
    found = reconstruct_joints(RIG, turned)
    assert found.warnings[0].startswith("force: not measured; its fundamental is free within 10 times the level")
    for name in RIG.forces:
        exact = _kept(solution[name].coefficients)
        exact = (exact[1 : H + 1] - 1j * exact[H + 1 :]) * turn[1:]
        pulls = (found[name].complex[:, 1:] - exact) / found[name].coefficient_std[:, 1:]
        assert np.sqrt(np.mean(np.abs(pulls) ** 2) / 2) == pytest.approx(1.0, abs=0.1), name
    few = reconstruct_joints(RIG, turned.select(channels=["a1", "a3", "a5"]))
    assert (few["rub.force"].coefficient_std[:, 1] > 1.0).all()  # of 2 N: nothing tells them from the force


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
        "harmonic 4: the sensors do not tell the joint forces apart in 1 of 3 records; left out there"
    )
    assert np.isfinite(found["rub.force"].samples).all()


def test_records_are_found_as_each_is_alone(solution: object) -> None:
    """What those of the same frequency, deviations and readings share is no other record's."""
    spectra = _spectra(solution, 7)
    std = spectra.std * np.array([1.0, 1.0, 2.0, 1.0, 1.0, 3.0, 1.0])[:, None, None]
    std[0, :3, 4] = 1e13  # two channels left: not told apart
    std[3, 1, 2], std[4, 0, 3], std[5, :3, 4] = np.nan, np.nan, np.nan
    spectra = replace(spectra, std=std, hz=np.array([45.0, 45.0, 45.0, 46.0, 45.0, 44.0, 46.0]))
    together = reconstruct_joints(RIG, spectra)
    assert np.argwhere(~together.found[:, 1:]).tolist() == [[0, 3], [5, 3]]
    for i, record in enumerate(spectra.records):
        alone = reconstruct_joints(RIG, spectra.select(records=[record]))
        for name in (*RIG.forces, *RIG.motions):
            for what in ("coefficients", "coefficient_std"):
                found, expected = getattr(together[name], what)[i], getattr(alone[name], what)[0]
                np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12 * np.nanmax(expected))
        for joint in RIG.joints:
            found, expected = together.energy[joint.name], alone.energy[joint.name]
            assert found.std[i] == pytest.approx(expected.std[0], rel=1e-9)
            assert found.value[i] == pytest.approx(expected.value[0], abs=1e-9 * expected.std[0])
        assert together.chi2[i] == pytest.approx(alone.chi2[0], rel=1e-9)


MODES, RATIO = np.array([20.0, 47.0]), 0.01
ROWS = {"drive": (0.8, 0.5), "a": (0.5, 0.9), "b": (0.9, -0.4)}
LIMIT, SLIDES = 10.0, np.geomspace(1.05, 30.0, 40)
"""Of a Jenkins element [N], and how many times farther it moves than it takes to slide."""


def _loops(phase: np.ndarray) -> np.ndarray:
    """Force of a Jenkins element that swings like a cosine, in closed form, (r, N)."""
    back = phase % 0.5  # since it last turned
    falls = np.maximum(1.0 - SLIDES[:, None] * (1.0 - np.cos(2 * np.pi * back)), -1.0)
    return LIMIT * falls * np.where(phase < 0.5, 1.0, -1.0)


@pytest.mark.parametrize("measured", [5, 9, 15])
def test_a_series_that_overshoots_a_limit_is_as_uncertain_as_it_is_wrong(measured: int) -> None:
    """Closed-form loops of an element that slides, read through two modes: the force is 10 N and never more.

    A few harmonics overshoot this by some per cent, which noise does not say: its bands all but miss the loop. Bands
    with the harmonics above those measured hold the whole loop as often as 95 % stands for.
    """
    k, hz, noise = np.arange(1, measured + 1), 18.0, 1e-3
    f = -np.fft.rfft(_loops(np.arange(4096) / 4096))[:, 1 : measured + 1] / 2048  # on the body
    drive = np.zeros_like(f)
    drive[:, 0] = 20.0
    dynamic = (2 * np.pi) ** 2 * (MODES**2 - (k[:, None] * hz) ** 2 + 2j * RATIO * MODES * k[:, None] * hz)
    pushed = f[..., None] * np.array(ROWS["b"]) + drive[..., None] * np.array(ROWS["drive"])
    read = {name: pushed / dynamic @ np.array(ROWS[name]) * -((2 * np.pi * hz * k) ** 2) for name in ("a", "b")}
    read["force"] = drive
    rng, ones = np.random.default_rng(1), np.ones(len(SLIDES))
    rows = [np.hstack([np.zeros((len(SLIDES), 1)), y.real, -y.imag]) for y in read.values()]
    exact = np.stack(rows, axis=1)
    spectra = MeasuredSpectra(
        "made",
        np.arange(1, len(SLIDES) + 1),
        20.0 * ones,
        hz * ones,
        tuple(read),
        exact + noise * rng.standard_normal(exact.shape),
        np.full((len(SLIDES), 3, measured + 1), noise),
    )
    rig = JointedRig(
        "two modes",
        ModalModel(tuple(MODES.tolist()), ROWS),
        Damping(modal_ratios=(RATIO, RATIO)),
        (Joint("rub", Friction(Jenkins(1.0, 1e-6), LIMIT), ("b",)),),
        Excitation(20.0, at="drive"),
        (Channel("force", "force"), *(Channel(name, "acceleration", at=name) for name in ("a", "b"))),
    )
    found = reconstruct_joints(rig, spectra)["rub.force"]
    error = found.samples + _loops(np.arange(256) / 256)
    # samples of a record err together: the rate is that of 40 records
    assert np.mean(np.abs(error) < 1.96 * found.std) == pytest.approx(0.95, abs=np.sqrt(0.95 * 0.05 / len(SLIDES)))
    by_noise = np.sqrt(np.sum(found.coefficient_std[:, 1:] ** 2, axis=1))
    assert np.mean(np.abs(error) < 1.96 * by_noise[:, None]) < 0.2


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


def test_modes_that_are_close_are_tried_off_without_changing_places() -> None:
    """Each as far as a rig can be made, and the change told per tolerance."""
    body = ModalModel((31.0, 31.05, 31.1), {"a": (0.8, 1.1, 0.3), "b": (0.9, -1.2, 0.5), "c": (0.5, 0.3, 1.0)})
    channels = (Channel("x", "acceleration", at="a"), Channel("y", "acceleration", at="b"), Channel("force", "force"))
    rig = JointedRig(
        "r",
        body,
        Damping(modal_ratios=(0.01,)),
        (Joint("j", Stop(1e3, 1e-4), ("a",)),),
        Excitation(1.0, at="c"),
        channels,
    )
    exact = steady_state(rig, 31.0, harmonics=H, samples=64)
    coefficients = np.array([[_kept(exact[c.name].coefficients) for c in channels]])
    one, std = np.ones(1), np.full((1, 3, H + 1), 1e-3)
    spectra = MeasuredSpectra("made", np.array([1]), one, 31.0 * one, ("x", "y", "force"), coefficients, std)
    key = "modal.frequencies_hz[2]"
    exact = dict.fromkeys(tolerances(rig, spectra.channels), 0.0)
    wide, narrow = (contact_errors(reconstruct_joints(rig, spectra), exact | {key: std}) for std in (0.005, 1e-5))
    change = wide.signals["j.force"]
    assert np.abs(change - 500.0 * narrow.signals["j.force"]).max() < 0.02 * np.abs(change).max()
