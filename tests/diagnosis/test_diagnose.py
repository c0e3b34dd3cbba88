"""Diagnosis of the example measurements, whose answers are known, with a small catalogue; some of the records."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import hbm.diagnosis.conclusion
from hbm import load_rig, load_spectra
from hbm.diagnosis.calibrate import calibrate, trusted
from hbm.diagnosis.candidates import followed
from hbm.diagnosis.conclusion import Conclusion
from hbm.diagnosis.confidence import RELIABLE
from hbm.diagnosis.decide import Decision, sidak
from hbm.diagnosis.diagnose import HALF, diagnose
from hbm.diagnosis.estimates import lifted
from hbm.diagnosis.heldout import choose_held_out
from hbm.diagnosis.misfit import misfit
from hbm.diagnosis.restart import started
from hbm.diagnosis.screen import INSTEAD, screen
from hbm.diagnosis.search import Search
from hbm.errors import InputError
from hbm.outputerror.background import LARGEST
from hbm.outputerror.evaluation import evaluate
from hbm.outputerror.fit import fit_model
from hbm.outputerror.measured import campaign_of
from hbm.outputerror.model import Model, free_of
from hbm.outputerror.whitened import uncorrelated
from models.causes.cause import Unknown
from models.causes.friction import StribeckWeakening, ViscousContact
from models.causes.parameter import WrongParameter
from models.causes.sensors import SensorGain, SensorPosition, SwappedChannels
from models.causes.structure import AddedMass, AddedSpring, AttachedResonator, ClampRotation, SupportRotationSpring

EXAMPLES = Path(__file__).parents[3] / "shared" / "data" / "examples"
pytestmark = pytest.mark.skipif(not EXAMPLES.exists(), reason=f"the example measurements are not at {EXAMPLES}")
STRUCTURE = (AddedMass, AddedSpring, ClampRotation, SupportRotationSpring)
CAUSES = (WrongParameter, *STRUCTURE)
E = "beam.youngs_modulus"


@cache
def example(name, every):
    rig = load_rig(EXAMPLES / name / "rig.toml")
    spectra = load_spectra(EXAMPLES / name / "spectra.csv", rig)
    return rig, spectra.select(records=spectra.records[::every])


def truth(name):
    return json.loads((EXAMPLES / "answers.json").read_text())[name]["parameters"]


@cache
def diagnosed(name, every, stiffer=1.0):
    rig, spectra = example(name, every)
    rig = rig.with_numbers({E: stiffer * rig.body.youngs_modulus})
    return diagnose(rig, spectra, causes=CAUSES)


@cache
def calibrated(name, every):
    rig, spectra = example(name, every)
    campaign, _ = campaign_of(rig, spectra)
    bare = Model(rig, {})
    nominal = evaluate(bare, campaign, bare.start, {})
    return campaign, calibrate(trusted(rig), campaign, nominal.solutions)


# ---- verdicts


def test_nothing_is_found_where_nothing_is_wrong():
    found = diagnosed("null", 4)
    assert found.verdict == "consistent"
    assert found.cause is None and found.extended is None and found.parameters == {}
    assert found.errors["nominal"]["held_out"].chi2_reduced == pytest.approx(1.0, abs=0.2)
    assert set(found.errors) == {"nominal", "calibrated"}
    assert RELIABLE["within"] < found.confidence <= RELIABLE["consistent"]


def test_what_a_score_test_promises_does_not_make_noise_unlikely_where_no_cause_is_accepted(monkeypatch):
    """A background that is lost in noise promises something to many causes: the verdict is right all the same."""
    monkeypatch.setattr(hbm.diagnosis.conclusion, "nothing_missing", lambda search, decision: 0.0)
    rig, spectra = example("null", 4)
    found = diagnose(rig, spectra, causes=(AddedMass,))
    assert (found.verdict, found.confidence) == ("consistent", RELIABLE["within"])


def test_an_elastic_clamp_is_found_in_place_of_many_numbers_that_do_as_well_within_their_tolerances():
    """Nothing else is known of it: calibration leaves noise, and its first effect takes nothing from that."""
    rig, spectra = example("clamp_rotation", 2)
    offered = [cause for kind in STRUCTURE for cause in kind.candidates(rig)]
    search = Search(rig, spectra, offered, None, lambda doing, done: None, None)
    assert misfit(search.calibrated, search.campaign).fits and search.tolerable(search.calibrated)
    alike = search.over(search.calibrated).instead
    assert alike[0].cause == ClampRotation() and alike[0].instead > 0.99
    assert all(s.instead >= INSTEAD for s in alike)
    found = search._within_tolerances(Decision(search.nominal, None, ()))
    assert found.best is not None and found.best.model.causes == (ClampRotation(),)
    stiffness = found.best.model.values(found.best.x, 0)["stiffness"]
    assert stiffness == pytest.approx(truth("clamp_rotation")["stiffness"], rel=0.02)


def test_no_cause_stands_in_place_of_one_number_within_its_tolerance():
    """A density does all that Young's modulus does, which alone is off by half of its tolerance."""
    rig, spectra = example("null", 4)
    stiffer = rig.with_numbers({E: 1.005 * rig.body.youngs_modulus})
    density = WrongParameter("beam.density")
    search = Search(stiffer, spectra, [density, WrongParameter(E)], None, lambda doing, done: None, None)
    assert not misfit(search.nominal, search.campaign).fits
    found = search._within_tolerances(Decision(search.nominal, None, ()))
    assert found.best is None and [e.model.label for e in found.fits] == [density.label]


def test_elastic_clamp_is_found_with_its_stiffness():
    found = diagnosed("clamp_rotation", 1)
    assert (found.verdict, found.cause) == ("cause-found", "clamp-rotation")
    stiffness = found.parameters["stiffness"]
    assert abs(stiffness.value - truth("clamp_rotation")["stiffness"]) < 3 * stiffness.std
    # many numbers within their tolerances predict as well, far from the rig file: the clamp alone does it with one
    assert found.gain["held_out_chi2_ratio"] <= 1.0
    assert (
        found.calibrated.chi2 - found.extended_fit.chi2 > 16.0
        and found.extended_fit.pulls @ found.extended_fit.pulls == 0.0
    )
    extended, nominal = (found.errors[name]["held_out"].chi2_reduced for name in ("extended", "nominal"))
    assert extended < 1.2 < 100.0 < nominal
    assert found.extended.attachments.clamp_stiffness == stiffness.value


def test_wrong_youngs_modulus_is_called_by_its_key():
    found = diagnosed("null", 4, stiffer=1.08)
    assert (found.verdict, found.cause) == ("cause-found", f"parameter:{E}")
    value = found.parameters["value"]
    assert value.unit == "Pa"
    assert abs(value.value - example("null", 4)[0].body.youngs_modulus) < 3 * value.std
    assert found.gain["held_out_nrmse_ratio"] <= 1.0
    (clock,) = [line for line in found.evidence if line.startswith("A clock does nearly the same")]
    softer = 1.0 - np.sqrt(value.value / (1.08 * example("null", 4)[0].body.youngs_modulus))
    assert f"frequencies stated {softer:.2%} too low" in clock


def test_a_friction_of_the_same_stiffness_that_is_off_does_not_weaken():
    """Coefficient and critical slip are off together: a friction at rest as large as that of sliding would do too."""
    rig, spectra = example("null", 4)
    law = rig.contact.law
    off = replace(law, mu=law.mu / 1.2, critical_slip=law.critical_slip / 1.2)
    wrong = replace(rig, contact=replace(rig.contact, law=off))
    d = diagnose(wrong, spectra, causes=(WrongParameter, StribeckWeakening))
    assert (d.verdict, d.cause) == ("cause-found", "parameter:contact.friction.mu")
    assert abs(d.extended.number("contact.friction.mu") / law.mu - 1.0) < 0.03
    assert abs(d.extended.number("contact.friction.critical_slip") / law.critical_slip - 1.0) < 0.03


def test_exchanged_channels_are_found_beside_a_force():
    # both are misfits far too large for derivatives, of which one has nothing to fit
    rig, spectra = example("null", 6)
    exchanged = SwappedChannels("a2", "a4")
    found = diagnose(exchanged.extend(rig, {}), spectra, causes=(exchanged, ClampRotation))
    assert (found.verdict, found.cause) == ("cause-found", "swapped-channels")
    assert {name: p.value for name, p in found.parameters.items()} == {"channel": "a2", "other": "a4"}


def test_a_sensor_far_from_its_place_is_found_where_small_steps_foresee_nothing():
    """Where the beam moves most a small step changes nothing and the gain is blamed: all numbers of its channel run."""
    rig, spectra = example("null", 6)
    length = float(rig.body.length)
    moved = rig.with_number("channels.a1.position", 0.58 * length)
    told = []
    causes = (SensorGain, SensorPosition)
    found = diagnose(moved, spectra, causes=causes, on_progress=lambda what, share: told.append(what))
    assert (found.verdict, found.cause) == ("cause-found", "sensor-position")
    position = found.parameters["position"]
    assert abs(position.value - rig.number("channels.a1.position")) < 3 * position.std
    # at once, behind the force and beside the gain, not after all else has failed
    assert "sensor-gain a1, sensor-position a1 (3 of 3)" in told


def test_no_cause_is_named_for_what_calibration_missed(monkeypatch):
    """Calibration that ends where it starts, from where a cause that does nothing leads to what tolerances explain."""
    rig, spectra = example("null", 6)
    stiffer = rig.with_numbers({E: 1.01 * rig.body.youngs_modulus})

    def stuck(model, campaign, last):
        return evaluate(model, campaign, model.start, last)

    monkeypatch.setattr("hbm.diagnosis.standing.calibrate", stuck)
    found = diagnose(stiffer, spectra, causes=(ViscousContact,))
    assert found.verdict == "consistent"
    assert found.errors["nominal"]["train"].chi2_reduced > 2.0
    assert found.errors["calibrated"]["train"].chi2_reduced == pytest.approx(1.0, abs=0.2)


# ---- report


def test_report_is_the_contract():
    wanted = {
        "schema", "verdict", "cause", "parameters", "confidence", "not_separable", "separate_by", "errors", "gain",
        "held_out_records", "ranking", "evidence", "remainder",
    }  # fmt: skip
    for found in (diagnosed("null", 4), diagnosed("null", 4, stiffer=1.08), diagnosed("clamp_rotation", 1)):
        table = json.loads(json.dumps(found.json(), allow_nan=False))
        assert set(table) == wanted
        assert table["schema"] == 1 and 0.0 <= table["confidence"] <= 1.0
        assert set(table["gain"]) == {"held_out_nrmse_ratio", "held_out_chi2_ratio"}
        assert all(set(p) == {"value", "std", "unit"} for p in table["parameters"].values())
        assert all(set(r) == {"cause", "parameters", "bic", "held_out_nrmse"} for r in table["ranking"])
        assert all(set(e) == {"nrmse", "chi2_reduced"} for parts in table["errors"].values() for e in parts.values())
        assert set(table["remainder"]) == {
            "explained", "size", "noise_variances", "structured", "places", "harmonics", "sentence"
        }  # fmt: skip
        assert table["evidence"] and str(found).count("\n") >= len(table["evidence"])


# ---- its parts


def test_score_of_a_small_effect_is_the_fall_of_chi2_of_a_refit():
    # a radius off by 3 %, on eight records, all of which the score test looks at
    rig, spectra = example("null", 6)
    radius = WrongParameter("contact.radius")
    wrong = rig.with_numbers({"contact.radius": 1.03 * rig.contact.radius})
    campaign, _ = campaign_of(wrong, spectra)
    bare = Model(wrong, {})
    nominal = evaluate(bare, campaign, bare.start, {})
    base = calibrate(trusted(wrong), campaign, nominal.solutions)
    score = screen(base, campaign, [radius]).scores[0]
    model = base.model.extended_by(radius)
    start = np.append(base.x, model.free[-1].of(wrong.contact.radius))
    refitted = fit_model(model, campaign, start, base.solutions)
    assert score.drop == pytest.approx(base.chi2 - refitted.chi2, rel=0.15)


def test_a_simpler_effect_starts_again_where_one_with_more_numbers_stands():
    """A mass taken for one elsewhere, beside a resonator far above all records where the mass is."""
    rig, spectra = example("added_mass", 4)
    campaign, _ = campaign_of(rig, spectra)
    mass, resonator = (Model(rig, {}, (kind(),)) for kind in (AddedMass, AttachedResonator))
    true = truth("added_mass")
    right, wrong = (
        evaluate(model, campaign, np.array([f.of(place[f.name]) for f in model.free]), {})
        for model, place in (
            (resonator, {**true, "frequency_hz": 3000.0}),
            (mass, {**true, "position": 0.6 * true["position"]}),
        )
    )
    assert right.chi2 < 0.1 * wrong.chi2
    found = followed([right, wrong], campaign)
    again = next(e for e in found if e.model is mass)
    place = dict(zip((f.name for f in mass.free), zip(again.x, again.std, strict=True), strict=True))["position"]
    assert again.model.values(again.x, 0)["position"] == pytest.approx(true["position"], abs=4 * place[1])
    assert again.chi2 < right.chi2 < wrong.chi2


def test_score_test_names_the_clamp_and_the_look_alikes():
    campaign, base = calibrated("clamp_rotation", 2)
    candidates = [c for kind in CAUSES for c in kind.candidates(base.model.nominal)]
    found = screen(base, campaign, candidates)
    assert found.scores[0].cause == ClampRotation()
    assert found.tried == len(candidates) + 2 * 3  # mass and spring at four places each
    assert ClampRotation() in [s.cause for s in found.instead]
    alike = list(found.look_alikes(found.scores[0].cause.label, 0.0).values())
    assert len(alike) == len(found.scores) - 1
    assert 1.0 + 1e-9 >= alike[0] > 0.0
    assert alike == sorted(alike, reverse=True)


def test_second_cause_of_a_pair_is_fitted_alone():
    campaign, base = calibrated("clamp_rotation", 2)
    few, model = campaign.of(campaign.numbers[:4]), base.model.extended_by(AddedMass()).extended_by(ClampRotation())
    here = evaluate(base.model, few, base.x, base.solutions)
    mass, position, stiffness = model.free[-3:]
    x = np.concatenate([base.x, [mass.of(1e-5), position.of(0.3), stiffness.of(3e4)]])
    pair = evaluate(model, few, x, base.solutions)
    (alone,) = started(here, pair, pair.model.causes[1:], few)
    assert alone.model.causes == (ClampRotation(),)
    assert alone.chi2 < pair.chi2
    assert alone.model.free[-1].value(alone.x[-1]) == pytest.approx(truth("clamp_rotation")["stiffness"], rel=0.2)


def test_jacobian_is_the_derivative_of_the_simulation():
    campaign, base = calibrated("null", 6)
    model = base.model.extended_by(AddedMass())
    mass, position = model.free[-2:]
    x = np.concatenate([base.x, [mass.of(6e-3), position.of(0.333)]])
    few = campaign.of(campaign.numbers[:2])
    here = evaluate(model, few, x, base.solutions)
    for i in range(len(x)):
        step = np.zeros(len(x))
        step[i] = 1e-5
        there = evaluate(model, few, x + step, here.solutions)
        slope = (here.white.raw - there.white.raw) / 1e-5
        std = here.white.raw / here.white.residual  # approximately: the force's noise is shared
        assert np.linalg.norm(slope / std - here.white.jacobian[:, i]) < 0.2 * np.linalg.norm(slope / std)


def test_whitening_gives_the_inverse_covariance():
    rng = np.random.default_rng(1)
    A, B = rng.normal(size=(6, 2)), rng.normal(size=(6, 3))
    white = uncorrelated(A, B)
    assert white.T @ white == pytest.approx(B.T @ np.linalg.inv(np.eye(6) + A @ A.T) @ B)


@pytest.mark.parametrize(
    "unknown",
    [
        Unknown("mass", "kg", "", 0.0, 1.0, 0.0, (1e-6, 0.1)),
        Unknown("stiffness", "N m/rad", "", 1e3, 1e8, np.inf, (1e7, 1e4)),
        Unknown("velocity", "m/s", "", 1e-5, 1.0, 1.0, (0.1, 1e-3)),
    ],
)
def test_coordinates_are_inverted_and_differentiated(unknown):
    free = free_of(unknown, 0)
    for value in unknown.starts:
        x = free.of(value)
        assert free.value(x) == pytest.approx(value)
        assert free.slope(x) == pytest.approx((free.value(x * (1 + 1e-6)) - free.value(x)) / (1e-6 * x), rel=1e-4)


def test_misfit_says_where_it_is():
    campaign, base = calibrated("null", 6)
    assert misfit(base, campaign).fits
    spoilt = base.white.residual + 6.0 * ((base.white.record == campaign.numbers[1]) & (base.white.harmonic == 2))
    found = misfit(replace(base, white=replace(base.white, residual=spoilt)), campaign)
    assert not found.fits
    assert any(f"record {campaign.numbers[1]} " in cell.what for cell in found.cells)


def test_a_level_and_a_band_are_held_out():
    _, spectra = example("null", 1)
    held = choose_held_out(spectra)
    levels = spectra.level[np.isin(spectra.records, held)]
    assert np.sum(levels == np.unique(spectra.level)[1]) == 16
    others = spectra.hz[np.isin(spectra.records, held) & (spectra.level != np.unique(spectra.level)[1])]
    assert len(np.unique(others)) == 2 and len(others) == 4
    assert choose_held_out(spectra.select(records=spectra.records[:3])) == ()


def test_no_more_than_half_is_held_out():
    """Where one level has most of the records every second one of it is fitted."""
    _, spectra = example("null", 1)
    middle = spectra.level == np.unique(spectra.level)[1]
    uneven = spectra.select(records=spectra.records[middle | (np.arange(len(spectra)) % 4 == 0)])
    held = choose_held_out(uneven)
    own = np.isin(uneven.records, held)
    assert 0.2 < own.mean() <= 0.5
    assert 0 < np.sum(own & (uneven.level == np.unique(uneven.level)[1])) < middle.sum()


def test_where_only_records_held_out_disagree_half_of_them_are_fitted():
    rig, spectra = example("null", 4)
    held = choose_held_out(spectra)
    spoilt = 1.0 + 0.5 * np.isin(spectra.records, held)[:, None, None]
    found = diagnose(rig, replace(spectra, coefficients=spectra.coefficients * spoilt), causes=())
    assert found.held_out_records == held[1::2]
    assert found.verdict == "unexplained" and found.evidence[0] == HALF
    assert found.errors["nominal"]["train"].chi2_reduced > 10.0


@pytest.mark.parametrize(("left", "again"), [(0.9 * LARGEST, True), (1.1 * LARGEST, False)])
def test_records_fitted_but_for_a_background_are_explained_too(monkeypatch, left, again):
    """Where they are no more than that from noise, and those held out disagree, half of these are fitted as well."""
    story = SimpleNamespace(white=None)
    found = SimpleNamespace(
        hidden=story, verdict="unexplained", campaign=None, decision=SimpleNamespace(story=story), _noise=lambda e: e
    )
    for name, value in {"misfit": SimpleNamespace(fits=False), "beyond_noise": left, "nrmse": left}.items():
        monkeypatch.setattr(f"hbm.diagnosis.conclusion.{name}", lambda *_, value=value: value)
    assert Conclusion.untold.fget(found) is again


def test_chance_grows_with_the_number_of_candidates():
    """Normal quantiles squared: of 0.003 two-sided, and of a 27th of it."""
    assert sidak(1) == pytest.approx(2.968**2, abs=0.01)
    assert sidak(27) == pytest.approx(3.865**2, abs=0.02)


def test_record_to_hold_out_that_is_not_there_is_refused():
    rig, spectra = example("null", 12)
    with pytest.raises(InputError, match="no record 999; records are 1, 13, 25, 37"):
        diagnose(rig, spectra, held_out=(999,), causes=())


def test_fewer_coefficients_than_numbers_are_refused():
    rig, spectra = example("null", 12)
    few = spectra.select(records=[1], channels=["force", "a1", "a2"], harmonics=[0, 1])
    with pytest.raises(InputError, match="4 coefficients; must be more than the 7 numbers to fit"):
        diagnose(rig, few, held_out=(), causes=())


@pytest.mark.parametrize(
    ("left", "says"), [(4.0, "sets in where the tip would lift off"), (1.2, "nothing more is missing")]
)
def test_what_records_leave_in_which_the_tip_would_lift_off_is_said(left, says):
    record = np.repeat([1, 2, 3], 10)
    white = SimpleNamespace(record=record, residual=np.where(record == 2, left, 1.0))
    solutions = {n: SimpleNamespace(lift_off=n == 2) for n in (1, 2, 3)}
    kept = SimpleNamespace(rig=lambda x: SimpleNamespace(lift_off=False))
    first, second = lifted(SimpleNamespace(white=white, solutions=solutions, model=kept, x=None))
    assert "reaches zero in records 2: " in first
    assert f"{left**2:.3g} noise variances, all others 1" in second and says in second
