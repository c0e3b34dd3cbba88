"""What sensors leave of the tolerances of a rig file, and what that does to forces that are reconstructed with it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from hbm import ContactErrors, contact_errors, reconstruct, steady_state
from hbm.identification.known import Known
from hbm.inverse.reconstruct import reconstruct_again
from hbm.inverse.reconstruction import Reconstruction
from hbm.measurement.spectra import MeasuredSpectra
from hbm.outputerror.nominal import tolerances
from models import Rig
from models.causes import CAUSES
from tests.inverse.measurement import CHANNELS, RIG, SAMPLES, Truth, measured, respond, with_noise

HZ = (46.0, 49.0, 50.0, 52.0, 58.0)
SIGNALS = ("friction", "slip", "normal")
E = "beam.youngs_modulus"


def records(rig: Rig) -> list[tuple[float, Truth]]:
    """Motion of a rig, typed anew, under the friction that its law makes in the balance."""
    friction = [steady_state(rig, hz, harmonics=25, samples=SAMPLES)["friction"].samples for hz in HZ]
    force = complex(rig.excitation.amplitude)
    return [(hz, respond(rig, hz, force, T)) for hz, T in zip(HZ, friction, strict=True)]


def spectra(truths: list[tuple[float, Truth]], rng: np.random.Generator, decibel: float = 60.0) -> MeasuredSpectra:
    """What sensors of the rig file read, with noise."""
    names = [c.name for c in RIG.channels]
    std = {n: 10 ** (-decibel / 20) * max(np.abs(t.channels[n]).max() for _, t in truths) / np.sqrt(2) for n in names}
    return with_noise(measured(RIG, truths, std, 9), rng)


def badly_built(rng: np.random.Generator) -> tuple[list[tuple[float, Truth]], dict[str, float]]:
    """Records of a rig whose numbers are off by a draw of their tolerances, and by how many tolerances each is."""
    std = {k: v for k, v in tolerances(RIG, [c.name for c in CHANNELS]).items() if not k.startswith("contact.friction")}
    off = {key: float(rng.normal()) for key in std}
    sensors = {key for key in off if key.endswith((".gain", ".delay"))}
    numbers = {key: RIG.number(key) * (1.0 + off[key] * std[key]) for key in off if key not in sensors}
    truths = records(RIG.with_numbers(numbers))
    for hz, truth in truths:
        for name, c in truth.channels.items():
            gain, delay = (off.get(f"channels.{name}.{part}", 0.0) for part in ("gain", "delay"))
            late = np.exp(-2j * np.pi * hz * np.arange(len(c)) * delay * std.get(f"channels.{name}.delay", 0.0))
            truth.channels[name] = c * (1.0 + gain * std.get(f"channels.{name}.gain", 0.0)) * late
    return truths, off


def missed(found: Reconstruction, truths: list[tuple[float, Truth]], name: str) -> np.ndarray:
    """Reconstructed less true signals; without means, which no accelerometer sees."""
    off = found[name].samples - np.array([getattr(truth, name) for _, truth in truths])
    return off if name == "normal" else off - off.mean(axis=1, keepdims=True)


def rms(values: object) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def test_errors_are_as_large_as_they_are_said_to_be_where_a_rig_is_off_within_its_tolerances() -> None:
    """Eight rigs of which every number is off, seen by sensors that are: noise alone says half and less."""
    rng = np.random.default_rng(20261127)
    whole, noise, before, after = {n: [] for n in SIGNALS}, [], [], []
    moduli = []
    for _ in range(8):
        truths, off = badly_built(rng)
        found = reconstruct(RIG, spectra(truths, rng))
        errors = contact_errors(found)
        for name in SIGNALS:
            whole[name].append(rms(missed(found, truths, name) / errors.stated[name].whole_std))
        noise.append(rms(missed(found, truths, "friction") / found["friction"].std))
        i = list(errors.known.values).index(E)
        moduli.append((errors.known.expected[i] - off[E]) / errors.known.left[i])
        again = reconstruct_again(found, found.rig.with_numbers(errors.known.calibrated))
        before.append(rms(missed(found, truths, "friction")))
        after.append(rms(missed(again, truths, "friction")))
    for name in SIGNALS:
        least, most = np.sqrt(chi2.ppf([0.005, 0.995], len(whole[name])) / len(whole[name]))  # of eight normal numbers
        assert least < rms(whole[name]) < most, (name, whole[name])
    assert rms(noise) > most  # which is far outside
    assert rms(moduli) < 2.0  # Young's modulus as sensors ask for it
    assert rms(after) < 0.4 * rms(before)


@pytest.fixture(scope="module")
def exact() -> Reconstruction:
    return reconstruct(RIG, spectra(records(RIG), np.random.default_rng(1)))


def test_of_an_exact_rig_file_sensors_ask_for_nothing(exact: Reconstruction) -> None:
    errors = contact_errors(exact)
    assert not errors.known.asked
    assert errors.known.asks == ""
    assert errors.known.left[list(errors.known.values).index(E)] < 0.3  # they know it better than 1 %
    assert errors.known.left[list(errors.known.values).index("contact.normal_load")] > 0.99  # which none of them sees


def test_changes_are_those_of_a_rig_that_is_off(exact: Reconstruction) -> None:
    """With Young's modulus a tolerance larger, the load smaller, a sensor elsewhere."""
    errors = contact_errors(exact)
    for key, share in ((E, 1.0), ("contact.normal_load", -1.0), ("channels.a3.position", 0.5)):
        value = exact.rig.number(key) * (1.0 + share * errors.known.tolerances[key])
        again = reconstruct_again(exact, exact.rig.with_numbers({key: value}))
        i = list(errors.known.values).index(key)
        for name in SIGNALS:
            change = again[name].samples - exact[name].samples
            assert np.abs(change - share * errors.signals[name][i]).max() <= 0.12 * np.abs(change).max() + 1e-9


def test_a_number_that_is_known_exactly_does_nothing(exact: Reconstruction) -> None:
    others = dict.fromkeys(tolerances(exact.rig, exact.spectra.channels), 0.0)
    errors = contact_errors(exact, others | {"contact.normal_load": 1e-9})
    assert list(errors.signals["normal"]) and errors.std("normal").max() < 1e-6
    assert errors.std("energy_per_cycle").max() < 1e-12


def test_what_is_left_is_that_of_linear_least_squares() -> None:
    """Two numbers, three readings: beside a solution of the normal equations with the tolerances as readings."""
    rng = np.random.default_rng(3)
    J, r, changes = rng.normal(size=(2, 3)), rng.normal(size=3), rng.normal(size=(2, 4))
    known = Known({"a": 2.0, "b": 0.0}, {"a": 0.1, "b": 0.5}, r, J)
    A, b = np.vstack([J.T, np.eye(2)]), np.concatenate([-r, np.zeros(2)])
    x, *_ = np.linalg.lstsq(A, b)
    C = np.linalg.inv(A.T @ A)
    assert np.allclose(known.expected, x) and np.allclose(known.covariance, C)
    assert known.calibrated == pytest.approx({"a": 2.0 * (1 + 0.1 * x[0]), "b": 0.5 * x[1]})
    assert np.allclose(known.errors(changes) ** 2, np.diag(changes.T @ (C + np.outer(x, x)) @ changes))


def test_it_is_said_in_words(exact: Reconstruction) -> None:
    off = RIG.with_numbers({E: 0.99 * RIG.number(E)})
    errors = contact_errors(reconstruct(off, exact.spectra))
    assert list(errors.known.asked) == [E]
    assert errors.known.asked[E] == pytest.approx(RIG.number(E), rel=3e-3)
    said = str(errors)
    assert "friction [N]" in said and f"most by {E} (1 %)" in said
    assert f"sensors agree better with {E} = 2." in said
    assert isinstance(errors, ContactErrors) and errors.stated["friction"].rig_std is not None


def test_what_no_tolerance_explains_is_no_number_to_move(exact: Reconstruction) -> None:
    """A mass that the rig file has not: sensors would have to err by many tolerances, and are not asked to."""
    heavy = CAUSES["added-mass"]().extend(RIG, {"mass": 0.05, "position": 0.3})
    solutions = [steady_state(heavy, hz, harmonics=9, samples=SAMPLES) for hz in HZ]
    coefficients = np.array([[s[name].coefficients for name in exact.spectra.channels] for s in solutions])
    found = contact_errors(reconstruct(RIG, replace(exact.spectra, coefficients=coefficients)))
    assert found.known.strained and not found.known.asked
    assert "by more than the tolerances of the rig file explain" in found.known.asks
