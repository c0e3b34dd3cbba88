"""Records taken before a transient died out, by the independent simulator; and what only looks like them."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hbm import load_rig, load_spectra
from hbm.diagnosis.conclusion import Conclusion, foretells
from hbm.diagnosis.decide import accepted
from hbm.diagnosis.misfit import nrmse
from hbm.diagnosis.order import _Missing, disordered, ordered
from hbm.diagnosis.predict import predicted
from hbm.diagnosis.verdict import Errors
from hbm.fourier import FourierBasis
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation, evaluate
from hbm.outputerror.measured import campaign_of
from hbm.outputerror.model import Model
from hbm.outputerror.numerics import Grid, Numerics
from models.causes.records import NotSteady
from models.parts import Damping
from models.published import paper_rig
from models.rig import Attachments
from tests.truth import (
    Coulomb,
    Settings,
    Truth,
    measure,
    scattered,
    simulate_records,
    table_1,
    write_rig,
    write_spectra,
)
from tests.truth.simulate import taken_early

EXAMPLE = Path(__file__).resolve().parents[3] / "shared" / "data" / "examples" / "clamp_rotation"
H, LATE = 5, NotSteady()
PLAIN = replace(table_1(Coulomb(mu=0.52, critical_slip=4.15e-6)), elements=24, modes=10)
RECORDS = scattered([(level, hz) for level in (0.4, 1.5) for hz in (48.0, 50.5, 53.0, 55.5)], np.random.default_rng(2))
GRID = Grid(FourierBasis(15, 256), 10)
NUMERICS = Numerics(GRID, GRID, GRID, 0.0)
QUICK = Settings(ramp=10, hold=5, coarse=64, tolerance=1e-7, chord=True)


@pytest.fixture(scope="module")
def steady() -> Truth:
    return simulate_records(PLAIN, RECORDS, 128, QUICK)


@pytest.fixture(scope="module")
def early(steady) -> Truth:
    """The force grew from half of its size 32 periods before; 8 periods were recorded."""
    return taken_early(steady, 0.5, 32, 8)


def nominal(folder, truth: Truth) -> tuple[Campaign, Evaluation]:
    """What was measured at 50 dB, beside the rig as it is."""
    write_rig(folder / "rig.toml", PLAIN, amplitude=1.5)
    write_spectra(folder / "spectra.csv", measure(truth, 50.0, np.random.default_rng(1), harmonics=H))
    rig = load_rig(folder / "rig.toml")
    campaign, _ = campaign_of(rig, load_spectra(folder / "spectra.csv", rig), NUMERICS)
    model = Model(rig, {})
    return campaign, evaluate(model, campaign, model.start, {})


def extended(campaign: Campaign, base: Evaluation) -> Evaluation:
    model = base.model.extended_by(LATE)
    return evaluate(model, campaign, model.start, base.solutions)


def per_coefficient(e: Evaluation) -> float:
    return e.white.chi2 / len(e.white)


def test_transients_leave_noise_and_explain_what_was_measured(tmp_path, steady, early):
    campaign, base = nominal(tmp_path, early)
    e = extended(campaign, base)
    noise = 4 * np.sqrt(2 / len(base.white))
    assert per_coefficient(base) > 3.0 and per_coefficient(e) < 1.0 + noise
    assert nrmse(e.white) < 0.3 * nrmse(base.white)
    assert accepted(base, e, 30) and not ordered(base, campaign)
    assert e.model.values(e.x, 0)["decay_rate"] == pytest.approx(PLAIN.alpha / 2)
    campaign, base = nominal(tmp_path, steady)
    assert per_coefficient(base) < 1.0 + noise
    assert not accepted(base, extended(campaign, base), 30)


def test_what_is_free_in_each_record_takes_no_credit(tmp_path, steady, early):
    """Fitted to records held out they foretell nothing: the error there is that without them; chi2 pays for them."""
    campaign, base = nominal(tmp_path, early)
    e = extended(campaign, base)
    unseen = predicted(e, campaign)
    assert unseen.errors.nrmse == pytest.approx(nrmse(base.white), rel=1e-2)
    assert unseen.errors.chi2_reduced == pytest.approx((e.white.chi2 + e.white.free) / len(e.white), rel=1e-2)
    assert e.white.free > 10.0 * len(e.found) and base.white.free == 0.0


@pytest.mark.parametrize(("left", "calibrated", "does"), [(0.2, 0.2, True), (0.2, 0.1, False), (0.4, 0.5, False)])
def test_a_model_foretells_that_is_no_worse_than_calibration_and_says_something(left, calibrated, does):
    def held_out(error: float) -> Any:
        return SimpleNamespace(errors=Errors(error, 1.0))

    assert foretells(held_out(left), held_out(calibrated)) is does
    assert foretells(None, held_out(calibrated)) and foretells(held_out(left), None)


@pytest.mark.parametrize(("tolerable", "does"), [(True, False), (False, True)])
def test_calibration_beyond_tolerances_is_no_measure_of_what_is_foretold(tolerable: bool, does: bool) -> None:
    """Numbers at 3.5 tolerances left 3.4 % of records held out, in place of 4.7: a late start was `unexplained`."""
    errors = {"scored": 0.0476, "calibrated": 0.0339, "nominal": 0.0468}
    held_out = {name: SimpleNamespace(errors=Errors(error, 1.0)) for name, error in errors.items()}
    found = SimpleNamespace(search=SimpleNamespace(calibrated=None, tolerable=lambda e: tolerable), **held_out)
    assert Conclusion._transients_foretell(found, held_out["scored"]) is does


def test_one_record_alone_is_no_evidence_of_them(tmp_path, steady, early):
    """Whatever is wrong with a record, two numbers of its own explain much of it."""
    _, base = nominal(tmp_path, early)
    clearest = max(base.white.spreads, key=lambda n: float(np.sum(base.white.residual[base.white.record == n] ** 2)))
    mixed = steady.acceleration.copy()
    mixed[clearest - 1] = early.acceleration[clearest - 1]
    campaign, base = nominal(tmp_path, replace(steady, acceleration=mixed))
    e = extended(campaign, base)
    assert base.bic - e.bic > 100.0 and not accepted(base, e, 30)


@pytest.mark.skipif(not EXAMPLE.is_dir(), reason=f"needs {EXAMPLE}")
def test_what_belongs_to_the_rig_has_an_order():
    rig = load_rig(EXAMPLE / "rig.toml")
    campaign, _ = campaign_of(rig, load_spectra(EXAMPLE / "spectra.csv", rig), NUMERICS)
    base = evaluate(Model(rig, {}), campaign, np.array([]), {})
    assert per_coefficient(base) > 3.0 and ordered(base, campaign)


@pytest.mark.parametrize(
    ("clear", "offered"),
    [((10.0, 12.0, 14.0), False), ((10.0,), False), ((20.0,), True), ((10.0, 20.0), True), ((), True)],
)
def test_records_far_from_each_other_do_not_tell_that_there_is_no_order(monkeypatch, clear, offered):
    """Beside a record that misses a force another one that misses none, or another one, has to be measured."""

    def missing(record: Any, found: None, campaign: Any) -> _Missing:
        return _Missing(record, 1j**record.number, 100.0 if record.hz in clear else 0.0)

    monkeypatch.setattr("hbm.diagnosis.order._missing", missing)
    hz = (10.0, 12.0, 14.0, 20.0, 21.0)
    records = [SimpleNamespace(number=i, hz=f, force=2.0, listed=np.ones(1, bool)) for i, f in enumerate(hz)]
    campaign: Any = SimpleNamespace(data=SimpleNamespace(records=records))
    white = type("White", (), {"chi2": 100.0, "__len__": lambda self: 10})()
    base: Any = type("Base", (), {"found": dict.fromkeys(range(len(hz))), "white": white})()
    assert disordered(base, base, campaign) is offered


def test_they_are_offered_once_and_where_they_are_known():
    rig = paper_rig()
    assert list(NotSteady.candidates(rig)) == [LATE]
    late = LATE.extend(rig, {"decay_rate": 0.4})
    assert not late.excitation.settled and late.damping.mass_proportional == 0.8
    assert list(NotSteady.candidates(late)) == []
    slipping = replace(rig, attachments=Attachments(clamp_stiffness=1e5, clamp_limit=1.0))
    lifting = replace(rig, contact=replace(rig.contact, lift_off=True))
    assert list(NotSteady.candidates(slipping)) == list(NotSteady.candidates(lifting)) == []
    ratios = replace(rig, damping=Damping(modal_ratios=(1e-3,)))
    assert LATE.unknowns(ratios) == () and not LATE.extend(ratios, {}).excitation.settled
