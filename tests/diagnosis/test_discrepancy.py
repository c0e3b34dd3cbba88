"""The missing force, on records simulated with one that is known: its place, phase, harmonics and growth."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from hbm import load_rig
from hbm.diagnosis.attached import PLACES, attached_starts
from hbm.diagnosis.discrepancy import discrepancy
from hbm.diagnosis.places import all_at_once, places_of
from hbm.fourier import FourierBasis
from hbm.measurement.spectra import spectra_of
from hbm.outputerror import campaign as records
from hbm.outputerror import simulated
from hbm.outputerror.evaluation import evaluate
from hbm.outputerror.measured import campaign_of
from hbm.outputerror.model import Model
from hbm.outputerror.numerics import Grid, Numerics
from hbm.response.trace import steady_state
from hbm.sensitivity.derivatives import disturbed, sensitivities
from models import Attachments, Jenkins, PointMass, PointSpring
from models.causes.elements import ImpactStopCause
from models.causes.friction import ViscousContact
from models.causes.structure import AddedMass, AddedSpring, AttachedResonator

PAPER = load_rig(Path(__file__).parents[2] / "examples" / "paper_beam.toml")
RIG = replace(PAPER, damping=replace(PAPER.damping, mass_proportional=0.6))
L = RIG.body.length
H, SAMPLES, NOISE = 9, 128, 1e-4
STATES = (*((level, hz) for hz in (44.0, 48.0, 62.0) for level in (3.0, 6.5)), (6.5, 150.0))


def amplitude(rows, k):
    """Complex amplitudes of a harmonic."""
    return rows[k] - 1j * rows[len(rows) // 2 + k]


@cache
def measured(*rigs):
    """Noisy harmonics 1..7 of the states, of one rig for all or each its own."""
    rng = np.random.default_rng(5)
    kept = np.r_[0:8, H + 1 : H + 8]
    rigs = rigs * len(STATES) if len(rigs) == 1 else rigs
    found = [
        steady_state(rig, hz, level=level, harmonics=H, samples=SAMPLES)
        for rig, (level, hz) in zip(rigs, STATES, strict=True)
    ]
    coefficients, std = {}, {}
    for c in RIG.channels:
        noise = 1e-6 if c.quantity == "force" else NOISE
        rows = np.array([s[c.name].coefficients[kept] for s in found])
        coefficients[c.name] = rows + noise * rng.standard_normal(rows.shape)
        std[c.name] = np.full((len(STATES), 8), noise)
        std[c.name][:, 0] = coefficients[c.name][:, 0] = np.nan
    level, hz = np.array(STATES).T
    return spectra_of(RIG, hz, level, coefficients, std)


@pytest.fixture(autouse=True)
def exactly(monkeypatch):
    """Frequencies and the history of the contact are exact here; the effects are so small that both would hide them."""
    monkeypatch.setattr(records, "CLOCKS", 0.0)
    monkeypatch.setattr(simulated, "sticks", lambda solution: False)


def beside(spectra):
    """The nominal rig beside spectra."""
    grid = Grid(FourierBasis(H, SAMPLES), 5)
    campaign, _ = campaign_of(RIG, spectra, Numerics(grid, grid, grid, 0.0))
    bare = Model(RIG, {})
    return evaluate(bare, campaign, bare.start, {}), campaign


def lacking(spectra):
    """What the nominal rig lacks."""
    return discrepancy(*beside(spectra))


@cache
def spring():
    attached = Attachments(springs=(PointSpring(stiffness=5.0, position=5 * L / 9),))
    return lacking(measured(replace(RIG, attachments=attached)))


# ---- receptances


def test_response_to_a_third_harmonic_is_the_receptance():
    base = steady_state(RIG, 51.0, level=6.5, harmonics=H, samples=SAMPLES)
    small = 1e-6
    tone = replace(RIG.excitation, harmonics=((3, 0.0, small),))
    other = steady_state(replace(RIG, excitation=tone), 51.0, level=6.5, harmonics=H, samples=SAMPLES)
    place = next(p for p in places_of(RIG) if p.name == "the excitation")
    change = disturbed(RIG, base, all_at_once([place], base, 5))
    for name in ("a1", "a6"):
        sine_of_third = change[name][:, 5 + 2]
        moved = (other[name].coefficients - base[name].coefficients) / (small * 6.5)
        assert np.abs(moved - sine_of_third).max() < 1e-4 * np.abs(sine_of_third).max()


YIELDING = pytest.mark.parametrize(
    ("name", "key", "stiffness"),
    [("the clamp", "clamp_stiffness", 1e9), ("the support, vertically", "support_stiffness", 1e11)],
)


def yielded(rig, name, key, stiffness):
    """What channels read of a place that yields: by the motion of its load, and by the derivative of the rig."""
    rigid = steady_state(rig, 51.0, harmonics=H, samples=256)
    place = next(p for p in places_of(rig) if p.name == name)
    motion = -place.seen(rigid)[1:] / stiffness
    change = disturbed(rig, rigid, all_at_once([place], rigid, H))
    elastic = replace(rig, attachments=Attachments(**{key: stiffness}))
    yields = steady_state(elastic, 51.0, harmonics=H, samples=256)
    by = sensitivities(elastic, yields, (f"attachments.{key}",))
    for channel in ("a1", "a3", "a6"):
        predicted = change[channel] @ np.concatenate([motion.real, -motion.imag])
        yield predicted, -stiffness * by[channel].coefficients[:, 0]  # 1/k d/d(1/k)


@YIELDING
def test_yielding_is_the_motion_that_the_load_makes_on_a_stiff_spring(name, key, stiffness):
    for predicted, exact in yielded(RIG.with_modes(8), name, key, stiffness):
        # foreshortening in the clamp's moment, and the mean of the load, are left out
        assert np.abs(predicted - exact)[1:].max() < 0.02 * np.abs(exact).max()


@YIELDING
def test_the_load_there_has_the_harmonics_of_the_force(name, key, stiffness):
    """A third harmonic of the force is borne by the clamp as its fundamental is."""
    rig = replace(RIG, excitation=replace(RIG.excitation, harmonics=((3, 0.2, 0.1),))).with_modes(8)
    for predicted, exact in yielded(rig, name, key, stiffness):
        for k in (1, 3):
            assert np.abs(amplitude(predicted - exact, k)) < 0.02 * np.abs(amplitude(exact, k))


# ---- places


def test_spring_is_found_where_it_is_with_its_stiffness():
    found = spring()
    assert found.explainable and not found.two
    assert found.best.place.name == "the beam at 337 mm"
    assert found.best.share > 0.98
    assert found.best.left == pytest.approx(1.0, abs=0.2)
    assert found.best.stiffness == pytest.approx(5.0, rel=0.02)
    assert found.best.dissipative_share < 0.02
    with_motion, with_frequency = found.best.growth
    assert abs(with_motion.value - 1.0) < max(3 * with_motion.std, 0.05)
    assert abs(with_frequency.value) < max(3 * with_frequency.std, 0.1)


def test_levels_are_nominal_not_what_the_force_channel_reads():
    """As in the spectra file: the force that was measured differs from it by its noise, and more in a laboratory."""
    assert spring().level.tolist() == [level for level, _ in STATES]


def test_mass_grows_with_the_square_of_the_frequency():
    attached = Attachments(masses=(PointMass(mass=2e-5, position=5 * L / 9),))
    best = lacking(measured(replace(RIG, attachments=attached))).best
    assert best.place.name == "the beam at 337 mm"
    assert best.stiffness < 0.0 and best.dissipative_share < 0.02
    _, with_frequency = best.growth
    assert abs(with_frequency.value - 2.0) < max(3 * with_frequency.std, 0.2)


def test_dashpot_at_the_contact_takes_energy_and_grows_as_a_dashpot():
    cause = ViscousContact()
    found = lacking(measured(cause.extend(RIG, {"coefficient": 20.0})))
    best = found.best
    assert best.place.name == "the contact"
    assert best.share > 0.98
    assert best.dissipative_share > 0.9
    assert np.all(best.work[np.abs(best.force[:, 0]) > 3 * best.std[:, 0]] < 0.0)
    assert best.taken.certain and best.taken.value > 0.8
    with_motion, with_frequency = best.growth
    assert abs(with_motion.value - 1.0) < max(3 * with_motion.std, 0.1)
    assert abs(with_frequency.value - 1.0) < max(3 * with_frequency.std, 0.2)


def test_friction_that_was_lower_in_one_run_is_missing_there_alone():
    law = RIG.contact.law
    other = replace(RIG, contact=replace(RIG.contact, law=Jenkins(0.999 * law.mu, law.critical_slip)))
    found = lacking(measured(*(other if i == 3 else RIG for i in range(len(STATES)))))
    best = found.best
    assert best.place.name == "the contact"
    size = np.sqrt(np.sum(np.abs(best.force) ** 2, axis=1) / np.sum(2 * best.std**2, axis=1))
    assert np.argmax(size) == 3
    assert size[3] > 10.0 and np.delete(size, 3).max() < 2.0
    # a Jenkins element under a modal slip of amplitude U loses 4 mu P (U - u_c), u_c = mu P (1/k_t + C)
    limit = law.mu * RIG.contact.normal_load
    level, hz = STATES[3]
    solution = steady_state(RIG, hz, level=level, harmonics=H, samples=SAMPLES)
    compliance = RIG.structure.compliance
    U = np.ptp(solution["slip"].samples - compliance * solution["friction"].samples) / 2
    u_c = law.critical_slip + compliance * limit
    expected = 4 * 1e-3 * limit * (U - 2 * u_c)
    assert 0.2 < best.work[3] / expected < 5.0  # the reaction varies, and U is near 2 u_c


def test_sensor_that_reads_too_much_is_named():
    spectra = measured(RIG)
    coefficients = spectra.coefficients.copy()
    coefficients[:, spectra.index("a3")] *= 1.0005
    best = lacking(replace(spectra, coefficients=coefficients)).best
    assert best.place.name == "sensor a3"
    assert best.dissipative_share < 0.05
    assert best.growth[0].value == pytest.approx(1.0, abs=0.1)


# ---- what it says


def test_sentences_have_place_phase_and_growth():
    first, *_, second, third = spring().sentences()
    assert first.startswith("The missing force acts at the beam at 337 mm: explains ")
    assert "of its squared fundamental is in quadrature" in second
    assert third.startswith("It grows with the motion there to the power ")


def test_nothing_is_said_of_noise():
    found = lacking(measured(RIG))
    assert not found.explainable
    assert found.sentences() == []


def test_too_few_sensors_are_said():
    found = lacking(measured(RIG).select(channels=["force", "a3"]))
    assert not found.localised
    assert found.sentences() == ["A missing force cannot be placed: there are hardly more sensors than forces to find."]


# ---- starts of what may be attached


@pytest.mark.parametrize(
    ("cause", "true"),
    [
        (AddedMass(), {"mass": 5e-3, "position": 0.4 * L}),
        (AddedSpring(), {"stiffness": 3e3, "position": 0.4 * L}),
        (AttachedResonator(), {"mass": 2e-4, "frequency_hz": 90.0, "position": 0.4 * L}),
    ],
)
def test_what_is_attached_is_found_from_its_force_however_large_the_misfit(cause, true):
    nominal, campaign = beside(measured(cause.extend(RIG, true)))
    assert nominal.white.chi2 > 1e4 * len(nominal.white)
    starts = attached_starts(nominal, campaign, [cause])[cause.name]
    apart = {"position": L / PLACES / 4, "frequency_hz": 1.0}
    near = [
        all(abs(start[name] - value) < apart.get(name, 0.05 * value) for name, value in true.items())
        for start in starts
    ]
    assert any(near), starts


def test_a_stop_is_found_from_its_force():
    """The motion that strikes it is known but for what the sensors do not see: its numbers are near, not exact."""
    true = {"stiffness": 3e3, "gap": 3e-5, "position": 0.4 * L}
    nominal, campaign = beside(measured(ImpactStopCause().extend(RIG, true)))
    assert nominal.white.chi2 > 1e3 * len(nominal.white)
    starts = attached_starts(nominal, campaign, [ImpactStopCause()])["impact-stop"]
    near = {"stiffness": 0.3 * true["stiffness"], "gap": 0.2 * true["gap"], "position": L / PLACES / 2}
    assert any(all(abs(start[name] - true[name]) < apart for name, apart in near.items()) for start in starts), starts


def test_what_is_not_attached_has_no_start():
    nominal, campaign = beside(measured(RIG))
    causes = [AddedMass(), AddedSpring(), AttachedResonator(), ImpactStopCause(), ViscousContact()]
    assert not any(attached_starts(nominal, campaign, causes).values())
