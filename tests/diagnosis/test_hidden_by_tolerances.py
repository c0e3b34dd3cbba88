"""An effect that numbers within their tolerances take nearly all of: its rest is told from noise by its name alone."""

from dataclasses import replace

import numpy as np
import pytest

from hbm.diagnosis.conclusion import Conclusion
from hbm.diagnosis.confidence import RELIABLE
from hbm.diagnosis.decide import DECISIVE, accepted, evidence, inclusion, same_or_held, tied
from hbm.diagnosis.diagnose import diagnose
from hbm.diagnosis.judge import beside, lead
from hbm.diagnosis.misfit import misfit
from hbm.diagnosis.search import Search
from hbm.diagnosis.signatures import starting
from hbm.outputerror.evaluation import evaluate
from hbm.outputerror.fit import fit_model
from hbm.outputerror.measured import campaign_of
from hbm.outputerror.model import Model
from hbm.outputerror.nominal import nominal_scalars
from hbm.response.synthesis import synthesize
from models.causes.cause import candidates_of
from models.causes.clamp import ClampFriction
from models.causes.friction import ViscousContact
from models.causes.parameter import WrongParameter
from models.causes.sensors import SensorGain
from models.causes.structure import AddedMass, ClampRotation
from tests.hbm.rigs import beam

E, STIFFER = "beam.youngs_modulus", 1.005
LEVELS, HZ = (3.0, 6.5), (46.0, 49.0, 51.0, 53.0, 55.0, 58.0)


def diagnosed(coefficient):
    """A beam half a tolerance too stiff, whose contact is viscous too [N s/m]."""
    rig = beam(alpha=2.0)
    viscous = ViscousContact().extend(rig, {"coefficient": coefficient})
    built = viscous.with_numbers({E: STIFFER * rig.body.youngs_modulus})
    spectra = synthesize(built, LEVELS, HZ, snr=50.0, seed=1, harmonics=5).spectra
    return diagnose(rig, spectra, held_out=(), causes=(ViscousContact, AddedMass))


def test_a_dashpot_that_damping_within_its_tolerance_hides_is_named():
    found = diagnosed(120.0)
    calibrated = found.calibrated
    assert misfit(calibrated, found.campaign).fits  # alone it leaves noise
    assert (found.verdict, found.cause) == ("cause-found", "viscous-contact"), found
    coefficient = found.parameters["coefficient"]
    assert abs(coefficient.value - 120.0) < 3.0 * coefficient.std
    assert calibrated.chi2 - found.extended_fit.chi2 > 38.0  # BIC falls by 30
    assert found.confidence <= RELIABLE["noise"]
    assert found.remainder.explained["train"] == pytest.approx(1.0, abs=0.01)  # of the rig file as it is


@pytest.fixture(scope="module")
def elastic_clamp():
    """A search for an elastic clamp that tolerances hide, though not from the score test; each cause over the rig."""
    rig = beam(alpha=2.0)
    built = ClampRotation().extend(rig, {"stiffness": 3e4})
    spectra = synthesize(built, LEVELS, HZ, snr=50.0, seed=1, harmonics=5).spectra
    causes = (AddedMass(), ClampRotation(), ClampFriction())
    search = Search(rig, spectra, causes, None, lambda doing, done: None, None)
    assert misfit(search.calibrated, search.campaign).fits
    fits = {}
    for cause in (AddedMass(), ClampRotation()):
        model = search.nominal.model.extended_by(cause)
        fits[cause.label] = fit_model(model, search.campaign, starting(model, search.nominal, {}), {})
    return search, fits


def test_a_cause_that_adds_nothing_to_tolerances_does_not_end_the_search(elastic_clamp):
    search, fits = elastic_clamp
    (mass,) = search._over_tolerances(fits["added-mass"])
    assert search._enough(mass)
    assert not search._settles(mass)
    assert search._settles(fits["clamp-rotation"])


def test_many_small_errors_are_chosen_again_no_more_often_than_they_are_likely(elastic_clamp):
    """In BIC they cost nothing, though they have as many numbers as there are tolerances."""
    search, fits = elastic_clamp
    clamp, calibrated = fits["clamp-rotation"], search.calibrated
    assert calibrated.bic < clamp.bic
    assert evidence(calibrated) > evidence(clamp) + DECISIVE
    assert inclusion((calibrated,), clamp) > 0.99


def test_causes_that_do_the_same_are_as_likely(elastic_clamp):
    _, fits = elastic_clamp
    clamp = fits["clamp-rotation"]
    assert inclusion((replace(clamp),), clamp) == inclusion((replace(clamp), clamp), clamp) == 0.5
    assert inclusion((replace(clamp), replace(clamp)), clamp) == pytest.approx(1 / 3)


def test_a_clamp_that_never_slips_is_tried_as_the_elastic_one_that_it_contains(elastic_clamp):
    search, fits = elastic_clamp
    clamp = fits["clamp-rotation"]
    model = search.nominal.model.extended_by(ClampFriction())
    values = clamp.values | {(0, "limit"): 1e5}
    slipping = evaluate(model, search.campaign, model.at(values), clamp.solutions)
    (elastic,) = search._held_in(slipping, (slipping,))
    assert same_or_held(elastic, slipping) and not same_or_held(slipping, elastic)
    assert elastic.model.label == "clamp-rotation"
    assert elastic.values[0, "stiffness"] == pytest.approx(3e4, rel=0.05)
    assert search._held_in(slipping, (slipping, clamp)) == []
    assert (
        search._held_in(slipping, (slipping, *search._fitted_over(slipping.model))) == []
    )  # ranked or not, it was fitted


def measured_of(off, snr):
    """A beam, and what it measures where some numbers of its rig file are off."""
    rig = beam(alpha=2.0)
    values = nominal_scalars(rig)
    built = rig.with_numbers({key: factor * values[key] for key, factor in off.items()})
    return rig, synthesize(built, LEVELS, HZ, snr=snr, seed=1, harmonics=5).spectra


def test_one_wrong_number_beside_a_background_is_named_where_small_errors_would_leave_noise():
    """A wrong radius, and Young's modulus off by a twelfth of its tolerance: a background of 0.8 % of the response.

    One of 1 % is as large as a cause that is found may leave.
    """
    rig, spectra = measured_of({"contact.radius": 1.05, E: 1.0008}, 50.0)
    radius, others = WrongParameter("contact.radius"), (AddedMass, ViscousContact)
    found = diagnose(rig, spectra, held_out=(), causes=(radius, *others))
    assert misfit(found.calibrated, found.campaign).fits
    assert not misfit(found.extended_fit, found.campaign).fits
    assert (found.verdict, found.cause) == ("cause-found", "parameter:contact.radius"), found
    value = found.parameters["value"]
    assert abs(value.value - 1.05 * nominal_scalars(rig)["contact.radius"]) < 3.0 * value.std


def test_what_a_background_may_hide_is_not_told_apart():
    rig, spectra = measured_of({"damping.mass_proportional": 1.3, E: 1.001}, 40.0)
    causes = (WrongParameter("damping.mass_proportional"), *candidates_of(ViscousContact, rig))
    search = Search(rig, spectra, causes, None, lambda doing, done: None, None)
    conclusion = Conclusion(search, search.decide(), None, ())
    best = conclusion.decision.best
    assert best is not None and best.model.label == "parameter:damping.mass_proportional"
    ties = {}
    for size in (0.0, 0.1):
        conclusion.__dict__["_beside"] = replace(conclusion.campaign, background=dict.fromkeys(range(1, 6), size))
        ties[size] = [e.model.label for e in conclusion._ties(best)[0]]
    assert ties == {0.0: [], 0.1: ["viscous-contact"]}
    # the same cause beside another small one is not another cause
    pairs = [best.model.extended_by(c) for c in (WrongParameter("contact.radius"), WrongParameter(E))]
    one, other = (fit_model(pair, search.campaign, starting(pair, best, {}), best.solutions) for pair in pairs)
    conclusion.decision = replace(conclusion.decision, fits=(one, other))
    fits = [beside(e, conclusion._beside) for e in (one, other)]
    assert [e.model.label for e in tied(fits, fits[0])] == [other.model.label]
    ties = conclusion._ties(one)
    assert [[e.model.label for e in part] for part in ties] == [[], [other.model.label]]


def test_a_number_is_tried_where_one_that_acts_alike_was_found():
    """A modulus 3.5 % too low: a density explains it, with the modulus at the edge of its tolerance, as do both."""
    rig, spectra = measured_of({E: 1.035}, snr=50.0)
    numbers = [WrongParameter(key) for key in (E, "beam.density", "beam.length", "contact.radius")]
    search = Search(rig, spectra, numbers, None, lambda doing, done: None, None)
    search.over(search.first)
    model = search.trust.extended_by(numbers[1])
    found = fit_model(model, search.campaign, starting(model, search.calibrated, {}), search.calibrated.solutions)
    assert search._alike_in(found) == [(0, WrongParameter(E))]
    (modulus,) = search._held_in(found, (found,))
    assert modulus.values[0, "value"] == pytest.approx(1.035 * rig.body.youngs_modulus, rel=1e-3)
    assert misfit(modulus, search.campaign).fits and evidence(modulus) < evidence(found)
    # beside another cause too, of two
    gain = search.nominal.model.extended_by(SensorGain("a1"))
    two = gain.extended_by(numbers[1])
    stands = two.at({(0, "gain"): 1.001, (1, "value"): rig.body.density / 1.035})
    pair = evaluate(two, search.campaign, stands, search.calibrated.solutions)
    (again,) = search._held_in(pair, (pair,))
    assert again.model.causes == (SensorGain("a1"), WrongParameter(E)) and again.chi2 < pair.chi2
    assert again.values[1, "value"] == pytest.approx(1.035 * rig.body.youngs_modulus, rel=1e-3)


def test_a_damping_may_be_wrong_by_a_factor_of_a_hundred():
    rig = beam(alpha=2.0)
    (alpha,), (modulus,) = (WrongParameter(key).unknowns(rig) for key in ("damping.mass_proportional", E))
    assert (alpha.lower, alpha.upper) == pytest.approx((0.02, 200.0))
    assert modulus.upper == pytest.approx(10.0 * rig.body.youngs_modulus)


@pytest.mark.parametrize(("off", "stands_too"), [(1.0015, False), (1.004, True)])
def test_a_cause_that_a_background_could_be_is_not_believed(off, stands_too):
    """Noise alone is decisively less likely than either wrong radius; the smaller one a background might be."""
    rig, spectra = measured_of({"contact.radius": off}, 60.0)
    campaign, _ = campaign_of(rig, spectra)
    bare = Model(rig, {})
    base = evaluate(bare, campaign, bare.start, {})
    model = bare.extended_by(WrongParameter("contact.radius"))
    best = fit_model(model, campaign, model.start, base.solutions)
    assert accepted(base, best, tried=100)
    assert (lead(best, base, None, 100, campaign) > DECISIVE) is stands_too


@pytest.mark.parametrize(("off", "blamed"), [(1.02, False), (1.05, True)])
def test_a_number_is_not_blamed_for_what_its_tolerance_explains(off, blamed):
    """Young's modulus, known to 1 %: 3.5 tolerances are the bound, whichever route found it."""
    rig, spectra = measured_of({E: off}, 50.0)
    search = Search(rig, spectra, [WrongParameter(E)], None, lambda doing, done: None, None)
    model = search.nominal.model.extended_by(WrongParameter(E))
    true = np.array([f.of(off * rig.body.youngs_modulus) for f in model.free])
    found = fit_model(model, search.campaign, true, search.nominal.solutions)
    assert found.model.rig(found.x).body.youngs_modulus == pytest.approx(off * rig.body.youngs_modulus, rel=1e-3)
    assert accepted(search.nominal, found, tried=100)
    assert search.tolerable(found) is blamed
