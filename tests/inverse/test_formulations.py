"""Formulations that fit the deflection first: modes, the series (14) and a spline."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from hbm.errors import InputError
from hbm.inverse.contact import Contact, contact_of
from hbm.inverse.reconstruct import FORMULATIONS, reconstruct
from hbm.inverse.sensing import sensing
from hbm.inverse.shapes import Functions, by_force, by_moment, fitted_shapes, series, spline
from hbm.measurement.spectra import MeasuredSpectra, spectra_of
from models import Beam
from models.parts import ModalBody
from tests.inverse.measurement import CHANNELS, RIG, SAMPLES, force_shape, measured, moment_shape, respond, with_noise

FITTED = ("modal", "nnm", "nnm-spline")
BEAM = RIG.body
assert isinstance(BEAM, Beam)
STD = {"force": 1e-4, **{f"a{i}": 0.02 for i in range(1, 7)}}
HARMONICS = 9


def friction(size: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Harmonics up to 9 that fall like k^-2, no mean."""
    k = np.arange(1, 10)
    theta = 2 * np.pi * np.arange(SAMPLES) / SAMPLES
    amplitude = size * k**-2.0 * np.where(k % 2, 1.0, 0.3)
    return (amplitude * np.cos(np.outer(theta, k) + rng.uniform(0, 2 * np.pi, len(k)))).sum(axis=1)


RNG = np.random.default_rng(11)
RECORDS = [
    (hz, respond(RIG, hz, 6.5 * np.exp(1j * RNG.uniform(0, 2 * np.pi)), friction(size, RNG)))
    for hz, size in ((46.0, 20.0), (50.0, 40.0), (54.0, 30.0), (57.5, 10.0))
]


@pytest.fixture(scope="module")
def clean() -> MeasuredSpectra:
    return measured(RIG, RECORDS, STD, HARMONICS)


def true_amplitudes(name: str) -> NDArray[np.complex128]:
    samples = np.array([getattr(truth, name) for _, truth in RECORDS])
    return np.fft.rfft(samples, axis=1)[:, 1 : HARMONICS + 1] * 2 / SAMPLES


def contact(spectra: MeasuredSpectra, formulation: str) -> Contact:
    """Contact signals without mean friction, as in the records."""
    seen = sensing(RIG, spectra)
    return contact_of(seen, FORMULATIONS[formulation](seen, np.zeros(len(spectra))))


def relative_errors(found: Contact, name: str) -> NDArray[np.float64]:
    true = true_amplitudes(name)
    return np.linalg.norm(found.amplitudes[name][:, 1:] - true, axis=1) / np.linalg.norm(true, axis=1)


@pytest.mark.parametrize("formulation", FITTED)
def test_without_noise_only_the_error_of_the_shapes_is_left(clean: MeasuredSpectra, formulation: str) -> None:
    """Below 1e-3: five modes, or smooth forms through six sensors, miss the inertia of the sixth mode.

    The reaction has products of harmonics beyond the ninth, which nobody measured.
    """
    found = contact(replace(clean, std=clean.std / 100), formulation)
    assert relative_errors(found, "friction").max() < 5e-4
    assert relative_errors(found, "slip").max() < 6e-4
    assert relative_errors(found, "normal").max() < 1e-3


@pytest.mark.parametrize("formulation", FITTED)
def test_sensors_without_any_noise_are_no_trouble(clean: MeasuredSpectra, formulation: str) -> None:
    found = contact(replace(clean, std=clean.std / 1e8), formulation)
    assert relative_errors(found, "friction").max() < 5e-4


@pytest.mark.parametrize("family", [series, spline])
def test_free_shapes_are_clamped_pinned_and_without_end_moment(family: Callable[[Beam], Functions]) -> None:
    functions, L = family(BEAM), BEAM.length
    start, end, inside = np.array([0.0]), np.array([L]), np.linspace(0.0, L, 50)
    for where, order in ((start, 0), (start, 1), (end, 0), (end, 2)):
        assert np.abs(functions(where, order)).max() < 1e-12 * np.abs(functions(inside, order)).max()


@pytest.mark.parametrize("family", [series, spline])
def test_an_end_moment_works_on_the_rotation_it_turns(
    clean: MeasuredSpectra, family: Callable[[Beam], Functions]
) -> None:
    """E I Int s_m'' psi'' = psi'(L), and a force on the deflection under it, by quadrature on 20000 midpoints.

    The free shapes, mass-normalised, hold the first natural modes.
    """
    seen = sensing(RIG, clean)
    assert isinstance(seen.rig.body, Beam)
    shapes = fitted_shapes(seen, seen.rig.body, family(BEAM))
    free, L, EI = shapes.free, BEAM.length, BEAM.bending_stiffness
    assert np.allclose(shapes.omega[:3], BEAM.natural_frequencies()[:3], rtol=1e-4)
    assert np.allclose(shapes.mass[:free, :free], np.eye(free), atol=1e-8)
    x = (np.arange(20000) + 0.5) * L / 20000
    raw = family(BEAM)
    curvature, slope = raw(x, 2), raw(np.array([L]), 1)[0]
    work = EI * curvature.T @ by_moment(BEAM, x, 2)[:, 0] * L / 20000
    assert np.allclose(work, slope, atol=1e-5 * np.abs(slope).max())
    X = RIG.excitation.position
    work = EI * curvature.T @ by_force(BEAM, X, x, 2)[:, 0] * L / 20000
    under = raw(np.array([X]), 0)[0]
    assert np.allclose(work, under, atol=1e-5 * np.abs(under).max())


def test_static_deflections_meet_the_boundary_conditions_and_a_textbook() -> None:
    L, X, EI = BEAM.length, RIG.excitation.position, BEAM.bending_stiffness
    x = np.array([0.0, 0.2, 0.4, X, 0.58, L])
    moment, force = by_moment(BEAM, x), by_force(BEAM, X, x)
    assert np.allclose(moment[:, 0], [moment_shape(at, L, EI) for at in x], rtol=1e-12, atol=1e-18)
    assert np.allclose(force[:, 0], [force_shape(at, X, L, EI) for at in x], rtol=1e-9, atol=1e-18)
    assert np.isclose(EI * by_moment(BEAM, np.array([L]), 2)[0, 0], 1.0, rtol=1e-12)  # of a coefficient h T: h T
    assert np.isclose(EI * by_force(BEAM, X, np.array([L]), 2)[0, 0], 0.0, atol=1e-12)


def repeated(spectra: MeasuredSpectra, times: int) -> MeasuredSpectra:
    again = {name: np.concatenate([getattr(spectra, name)] * times) for name in ("level", "hz", "coefficients", "std")}
    return replace(spectra, records=np.arange(1, times * len(spectra) + 1), **again)


@pytest.mark.parametrize(
    ("formulation", "slip"),
    [
        ("modal", (0.8, 1.25)),
        # forms are expected to do more between the sensors and the tip than they do
        ("nnm", (0.7, 1.25)),
        ("nnm-spline", (0.7, 1.25)),
    ],
)
def test_errors_by_noise_are_as_large_as_their_standard_deviations(
    clean: MeasuredSpectra, formulation: str, slip: tuple[float, float]
) -> None:
    """Root mean square over 100 draws, 4 records and 9 harmonics; the noise of 7200 numbers leaves 0.02."""
    draws = 100
    found = contact(with_noise(repeated(clean, draws), np.random.default_rng(5)), formulation)
    for name, (low, high) in {"friction": (0.8, 1.25), "slip": slip, "normal": (0.8, 1.25)}.items():
        error = found.amplitudes[name][:, 1:] - np.tile(true_amplitudes(name), (draws, 1))
        rms = np.sqrt(np.mean(np.abs(error / found.std(name)[:, 1:]) ** 2) / 2)
        assert low < rms < high, (name, rms)


@pytest.mark.parametrize("formulation", FITTED)
def test_shifting_the_time_origin_shifts_the_signals(clean: MeasuredSpectra, formulation: str) -> None:
    """Cosine and sine forms mix, what they span does not, but for directions too weak to be kept as test functions."""
    turn = np.exp(0.7j * np.arange(clean.H + 1))
    c = np.stack([clean.complex(name) for name in clean.channels], axis=1) * turn
    shifted = replace(clean, coefficients=np.concatenate([c.real, -c.imag[:, :, 1:]], axis=2))
    here, there = contact(clean, formulation), contact(shifted, formulation)
    for name in ("friction", "slip", "normal"):
        moved = here.amplitudes[name] * turn
        assert np.allclose(there.amplitudes[name], moved, atol=1e-4 * np.abs(moved).max())


@pytest.mark.parametrize("formulation", FITTED)
def test_harmonics_that_were_not_measured_have_the_uncertainty_of_the_prior(
    clean: MeasuredSpectra, formulation: str
) -> None:
    found = contact(clean.select(harmonics=[1, 2, 3, 4, 5, 6, 8, 9]), formulation).estimate
    assert np.all(np.isinf(found.resolution[:, 7]))
    assert np.allclose(found.friction[:, 7], 0.0)
    true = np.abs(true_amplitudes("friction")[:, 6])
    std = np.linalg.norm(found.factor[:, 7, 0], axis=1)
    assert np.all((true < 3 * std) & (std < 20 * true))


@pytest.mark.parametrize("formulation", FITTED)
def test_without_a_force_channel_the_responses_give_the_force_too(clean: MeasuredSpectra, formulation: str) -> None:
    found = contact(clean.without("force"), formulation).estimate
    true = np.array([truth.channels["force"][1] for _, truth in RECORDS])
    std = np.linalg.norm(found.factor[:, 1, 1], axis=1)
    assert np.all(np.abs(found.force[:, 1] - true) < 4 * std)
    assert np.all(std < 0.25 * np.abs(true))


MODAL_RIG = replace(
    RIG,
    body=ModalBody(
        frequencies_hz=tuple((BEAM.natural_frequencies()[:4] / (2 * np.pi)).tolist()),
        shapes=tuple(tuple(row) for row in BEAM.shapes(np.array([c.position for c in CHANNELS]))[:, :4].tolist()),
        contact_shape=tuple((0.0074 * BEAM.shapes(np.array([BEAM.length]), 1)[0, :4]).tolist()),
        excitation_shape=tuple(BEAM.shapes(np.array([0.555]))[0, :4].tolist()),
    ),
)


def modal_spectra() -> MeasuredSpectra:
    """Response of four modes to a force and to friction, typed anew."""
    body = MODAL_RIG.body
    assert isinstance(body, ModalBody)
    omega_n = 2 * np.pi * np.array(body.frequencies_hz)
    omega = 2 * np.pi * 50.0 * np.arange(HARMONICS + 1)[:, None]
    T = np.fft.rfft(RECORDS[1][1].friction)[: HARMONICS + 1] * 2 / SAMPLES
    F = 6.5 * (np.arange(HARMONICS + 1) == 1)
    forces = np.outer(F, body.excitation_shape) + np.outer(T * (omega[:, 0] > 0), body.contact_shape)
    q = forces / (omega_n**2 - omega**2 + 1j * omega * MODAL_RIG.structure.damping)
    rows = -(omega**2) * q @ np.array(body.shapes).T
    amplitudes = {"force": F.astype(complex), **{f"a{i}": rows[:, i] for i in range(1, 7)}}
    coefficients = {name: np.concatenate([c.real, -c.imag[1:]])[None] for name, c in amplitudes.items()}
    std = {name: np.full((1, HARMONICS + 1), STD[name] / 100) for name in coefficients}
    return spectra_of(MODAL_RIG, np.array([50.0]), np.array([6.5]), coefficients, std)


def test_modal_takes_a_rig_given_by_its_modes() -> None:
    """To 1e-8 of the largest harmonic, by which the priors draw them towards zero."""
    found = FORMULATIONS["modal"](sensing(MODAL_RIG, modal_spectra()), np.zeros(1))
    true = true_amplitudes("friction")[1]
    assert np.allclose(found.friction[0, 1:], true, atol=1e-8 * np.abs(true).max())


@pytest.mark.parametrize("formulation", ["nnm", "nnm-spline"])
def test_forms_need_a_beam(formulation: str) -> None:
    with pytest.raises(InputError) as refusal:
        reconstruct(MODAL_RIG, modal_spectra(), formulation=formulation)
    assert str(refusal.value) == (
        f'reconstruct: formulation = "{formulation}", but the rig is given by [modal]; '
        "must be regularised or modal there"
    )
