"""A hidden force that conserves energy and one that takes some, on a structure of three modes."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from hbm.diagnosis.calibrate import calibrate, trusted
from hbm.diagnosis.diagnose import diagnose
from hbm.diagnosis.discrepancy import Discrepancy, discrepancy
from hbm.diagnosis.misfit import misfit
from hbm.diagnosis.noise import understated
from hbm.files.diagnosed import Diagnosed
from hbm.files.diagnosisplates import diagnosis_plates
from hbm.measurement.spectra import MeasuredSpectra, spectra_of
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation, evaluate
from hbm.outputerror.fit import fall
from hbm.outputerror.measured import campaign_of
from hbm.outputerror.model import Model
from hbm.outputerror.nominal import tolerances
from hbm.response.trace import steady_state
from models.bodies import ModalModel
from models.causes.joints import CubicStiffness, QuadraticDamping, QuinticStiffness
from models.jointed import JointedRig
from models.joints import CubicSpring, Dashpot, Joint
from models.joints.law import JointLaw
from models.parts import Channel, Damping, Excitation

PORTS = {
    "m1": (0.2655, -0.5474, -0.3604),
    "m2": (0.5249, -0.1458, 0.6082),
    "m3": (0.6677, 0.6073, -0.4306),
}
RIG = JointedRig(
    "three masses",
    ModalModel((16.45, 39.66, 55.3), PORTS),
    Damping(modal_ratios=(0.012, 0.0075, 0.008)),
    (),
    Excitation(6.0, at="m1"),
    (Channel("force", "force"), *(Channel(f"a{i}", "acceleration", at=f"m{i}") for i in (1, 2, 3))),
)
STATES = tuple((level, hz) for level in (2.0, 15.0) for hz in (15.5, 16.2, 16.8, 17.6, 38.0, 41.0))
H, NOISE = 5, 2e-3
"""Harmonics measured; standard deviation of a coefficient, of the fundamental of its channel."""

CUBIC, DAMPER = CubicSpring(6e9), Dashpot(4.0)

States = tuple[tuple[float, float], ...]


@cache
def records(law: JointLaw, states: States = STATES, structure: JointedRig = RIG) -> MeasuredSpectra:
    """Noisy records of a structure with a law between m2 and m3."""
    rng = np.random.default_rng(7)
    hidden = replace(structure, joints=(Joint("hidden", law, ("m2",), ("m3",)),))
    found = [steady_state(hidden, hz, level=level, harmonics=15, samples=256) for level, hz in states]
    kept, coefficients, std = np.r_[0 : H + 1, 16 : 16 + H], {}, {}
    for c in RIG.channels:
        rows = np.array([s[c.name].coefficients[kept] for s in found])
        noise = NOISE * np.linalg.norm(rows[:, [1, H + 1]], axis=1, keepdims=True)
        coefficients[c.name] = rows + noise * rng.standard_normal(rows.shape)
        std[c.name] = np.tile(noise, (1, H + 1))
        coefficients[c.name][:, 0] = std[c.name][:, 0] = np.nan
    level, hz = np.array(states).T
    return spectra_of(RIG, hz, level, coefficients, std)


@cache
def beside(law: JointLaw, states: States = STATES, structure: JointedRig = RIG) -> tuple[Evaluation, Campaign]:
    """The rig file beside the records."""
    campaign, _ = campaign_of(RIG, records(law, states, structure))
    bare = Model(RIG, {})
    return evaluate(bare, campaign, bare.start, {}), campaign


@cache
def calibrated(law: JointLaw) -> Evaluation:
    nominal, campaign = beside(law)
    return calibrate(trusted(RIG, campaign.data.channels), campaign, nominal.solutions)


def lacking(e: Evaluation, campaign: Campaign) -> Discrepancy:
    found = discrepancy(e, campaign)
    assert found.best.place.name == "m2 to m3"
    return found


# ---- calibration


def test_calibration_never_ends_worse_than_the_rig_file() -> None:
    """What lowers the misfit of a few records raises that of all here, and more than four steps lower it again."""
    body, damping = ModalModel((16.46, 39.6, 55.3), PORTS), Damping(modal_ratios=(0.01125, 0.00775, 0.0081))
    states = tuple(state for state in STATES if state[1] != 17.6)
    nominal, campaign = beside(CubicSpring(5.5e9), states, replace(RIG, body=body, damping=damping))
    trust = trusted(RIG, campaign.data.channels)
    assert fall(nominal, calibrate(trust, campaign, nominal.solutions)) > 0.0


# ---- what a missing force does to the energy


def test_motion_is_with_what_the_force_adds_to_it() -> None:
    """The model's own is far from it: the force that is found would be out of phase with that."""
    nominal, campaign = beside(CUBIC)
    best = lacking(nominal, campaign).best
    assert nominal.white.chi2 > 1e3 * len(nominal.white)
    assert best.dissipative_share < 0.01


@pytest.mark.parametrize("base", ["nominal", "calibrated"])
def test_spring_is_not_said_to_take_energy(base: str) -> None:
    nominal, campaign = beside(CUBIC)
    found = lacking(nominal if base == "nominal" else calibrated(CUBIC), campaign)
    assert not found.best.taken.certain
    assert not any("energy" in line for line in found.sentences())


def test_a_record_alone_says_nothing_of_energy() -> None:
    found = discrepancy(*beside(DAMPER, STATES[:1]))
    force = next(p for p in found.places if p.place.name == "m2 to m3")
    assert force.taken.value > 0.8 and not force.taken.certain


def test_damper_takes_energy_all_that_it_could() -> None:
    found = lacking(*beside(DAMPER))
    assert found.best.dissipative_share > 0.9
    assert found.best.taken.certain and found.best.taken.value == pytest.approx(1.0, abs=0.1)
    assert any("it takes energy from the structure" in line for line in found.sentences())


# ---- beside a cause that was named


def test_a_cause_that_explains_more_is_said_beside_the_place() -> None:
    _, campaign = beside(CUBIC)
    e = calibrated(CUBIC)
    cause = CubicStiffness("m2", "m3")
    model = Model(RIG, {}).extended_by(cause)
    named = evaluate(model, campaign, np.array([f.of(6e9) for f in model.free]), {})
    lines = lacking(e, campaign).sentences(named)
    assert lines[0].startswith("To first order the missing force acts at m2 to m3: explains ")
    assert lines[-1].startswith("cubic-stiffness m2 to m3 explains more, to any order: it leaves ")


# ---- records without a fundamental


def test_a_diagnosis_without_fundamentals_has_all_other_figures() -> None:
    """A band of frequencies may leave harmonics alone; models that are off alike are drawn too."""
    spectra = records(CUBIC)
    harmonics = spectra.coefficients.copy()
    for name in ("a1", "a2", "a3"):
        harmonics[:, spectra.index(name), [1, H + 1]] = np.nan
    above = replace(spectra, coefficients=harmonics)
    exact = dict.fromkeys(tolerances(RIG, above.channels), 0.0)
    d = diagnose(RIG, above, causes=[CubicStiffness("m2", "m3")], tolerances=exact)
    found = Diagnosed(d, RIG, above, discrepancy(d.calibrated, d.campaign))
    assert any("lost in noise" in line for line in found.evidence)
    plates = {plate.name for plate in diagnosis_plates(found)}
    assert {"overview", "gain", "misfit_map", "missing_force"} <= plates
    assert not {"responses", "deviations"} & plates


# ---- deviations that are stated too small


def test_one_record_that_a_cause_explains_is_no_reason_to_doubt_the_noise() -> None:
    """A single record is missed alike everywhere; the deviations are as stated where another model leaves noise."""
    nominal, campaign = beside(CUBIC, STATES[-2:-1])
    white = nominal.white
    white = replace(white, raw=0.1 * white.measured, residual=1.5 * np.ones(len(white)))
    doubled = replace(nominal, white=white)
    assert understated(doubled, campaign) is not None
    model = Model(RIG, {}).extended_by(CubicStiffness("m2", "m3"))
    right = evaluate(model, campaign, np.array([f.of(6e9) for f in model.free]), {})
    assert misfit(right, campaign).fits
    assert understated(doubled, campaign, [right]) is None


def test_a_model_that_agrees_with_nothing_is_no_reason_to_doubt_the_noise() -> None:
    """What misses most of the response is off, whatever the standard deviations."""
    nominal, campaign = beside(CUBIC, STATES[-2:-1])
    white = nominal.white
    for share, said in ((0.1, True), (0.5, False)):
        raw, residual = share * white.measured, 5.0 * np.ones(len(white))
        off = replace(nominal, white=replace(white, raw=raw, residual=residual))
        assert (understated(off, campaign) is not None) == said


# ---- what is said of the simulation


def test_no_modes_are_named_that_the_body_does_not_have() -> None:
    _, campaign = beside(CUBIC)
    assert "3 modes, corrected to 60 and 1024: by up to" in repr(campaign.numerics)


def test_a_misfit_everywhere_is_nowhere_most_clearly() -> None:
    everywhere = misfit(*beside(CUBIC))
    assert everywhere.worst.what == "all coefficients" and everywhere.clearest == ""
    somewhere = replace(
        everywhere, cells=tuple(replace(c, probability=float(i == 0)) for i, c in enumerate(everywhere.cells))
    )
    assert somewhere.clearest.startswith(somewhere.cells[1].what)


def test_calibration_that_trades_the_response_for_its_precise_harmonics_is_not_what_is_judged() -> None:
    """A structure with a mode that the rig file lacks: small harmonics move by far more than their noise."""
    stated = replace(RIG, joints=(Joint("between", CUBIC, ("m2",), ("m3",)),))
    further = {port: (*row, shape) for (port, row), shape in zip(PORTS.items(), (0.12, -0.14, 0.16), strict=True)}
    body = ModalModel((16.45, 39.66, 55.3, 170.0), further)
    true = replace(stated, body=body, damping=Damping(modal_ratios=(0.012, 0.0075, 0.008, 0.008)))
    rng, (level, hz) = np.random.default_rng(5), np.array(STATES).T
    found = [steady_state(true, f, level=F, harmonics=15, samples=256) for F, f in STATES]
    coefficients, std = {}, {}
    for c in stated.channels:
        rows = np.array([s[c.name].coefficients[np.r_[0 : H + 1, 16 : 16 + H]] for s in found])
        size = np.abs(rows[:, 1 : H + 1] + 1j * rows[:, H + 1 :])
        spread = 1e-3 * size + 1e-6 * size.max(axis=1, keepdims=True)
        std[c.name] = np.hstack([np.full((len(rows), 1), np.nan), spread])
        coefficients[c.name] = rows + np.hstack([std[c.name], spread]) * rng.standard_normal(rows.shape)
    diagnosis = diagnose(stated, spectra_of(stated, hz, level, coefficients, std), causes=(QuadraticDamping,))
    nominal, calibrated = diagnosis.errors["nominal"], diagnosis.errors["calibrated"]
    assert nominal["train"].nrmse < 0.01 < calibrated["train"].nrmse
    assert nominal["train"].chi2_reduced > calibrated["train"].chi2_reduced
    assert diagnosis.verdict == "consistent"
    assert diagnosis.remainder.size == pytest.approx(nominal["train"].nrmse, rel=1e-3)  # beyond noise


def test_flexibility_that_no_force_has_shown_does_not_hide_a_spring() -> None:
    """Modes above those of the rig file give way between the ends of the spring, and the drive does not show it."""
    shapes = (2.0, -2.4, 2.2)
    further = {port: (*row, shape) for (port, row), shape in zip(PORTS.items(), shapes, strict=True)}
    true = replace(
        RIG,
        body=ModalModel((16.45, 39.66, 55.3, 600.0), further),
        damping=Damping(modal_ratios=(0.012, 0.0075, 0.008, 0.008)),
    )
    static = np.array(true.body.with_modes(3, true.places).flexibility)
    seen = np.where(np.arange(3) * np.arange(3)[:, None] == 0, static, 0.0)
    unseen = {
        f"modal.flexibility[{i + 1}][{j + 1}]": abs(float(static[i, j])) for i, j in ((1, 1), (1, 2), (2, 2))
    }  # of what is 0 absolute
    stated = replace(RIG, body=replace(RIG.body, flexibility=tuple(map(tuple, seen.tolist()))), tolerances=unseen)
    measured = records(CUBIC, structure=true)
    found = diagnose(stated, measured, causes=(CubicStiffness, QuinticStiffness))
    assert (found.verdict, found.cause) == ("cause-found", "cubic-stiffness")
    assert found.parameters["at"].value == "m2" and found.parameters["to"].value == "m3"
    cubic = found.parameters["cubic"]
    assert isinstance(cubic.value, float) and cubic.std is not None
    assert abs(cubic.value - CUBIC.cubic) < 3.0 * cubic.std < 0.1 * CUBIC.cubic
    relative = np.array([0.0, -1.0, 1.0])  # of the ends of the spring
    assert found.extended is not None
    known = np.array(found.extended.body.flexibility)
    assert relative @ known @ relative == pytest.approx(relative @ static @ relative, rel=0.2)
