"""Records of rigs with joints, or of modes alone, taken before a start from rest died out: by the independent march."""

from collections.abc import Sequence
from functools import cache

import numpy as np
import pytest

from hbm.diagnosis.decide import accepted
from hbm.diagnosis.diagnose import diagnose
from hbm.diagnosis.misfit import nrmse
from hbm.diagnosis.order import ordered
from hbm.diagnosis.predict import predicted
from hbm.measurement.spectra import MeasuredSpectra
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation, evaluate
from hbm.outputerror.measured import campaign_of
from hbm.outputerror.model import Model
from hbm.outputerror.transients import transients
from hbm.response.trace import steady_state
from models.causes import all_candidates
from models.causes.joints import CubicStiffness, LocalDamper
from models.causes.records import NotSteady
from models.friction import Jenkins
from models.jointed import JointedRig
from models.joints import CubicSpring, Friction, Joint, PlaneFriction
from tests import three_modes
from tests.three_modes import HZ as ONCE
from tests.three_modes import NOMINAL, OFF, SENSORS, spectra_with_noise
from tests.truth.modal import Hidden, Modes, cubic, jenkins, last_periods, nothing

H = 5
HZ = np.tile(ONCE, 3)
FORCE = np.repeat((0.2, 0.6, 1.0), 11) * np.where(HZ > 40.0, 4.0, 1.0)
EARLY, LATER, STEADY, RECORDED = 25, 40, 200, 8
"""Periods after the start at which a record of so many begins; after the first, 10 % are left of the first mode."""

K3, STIFFNESS, LIMIT = 2e7, 3000.0, 0.6
LATE = NotSteady()
CASES: dict[str, tuple[Hidden, tuple[Joint, ...]]] = {
    "no joint": (nothing, ()),
    "cubic": (cubic(K3), (Joint("spring", CubicSpring(K3), ("c",)),)),
    "friction": (jenkins(STIFFNESS, LIMIT), (Joint("rub", Friction(Jenkins(1.0, LIMIT / STIFFNESS), LIMIT), ("c",)),)),
}


def rig_of(joints: tuple[Joint, ...]) -> JointedRig:
    return three_modes.rig_of(joints=joints, quantity="displacement")


def last_ones(modes: Modes, hidden: Hidden, parts: Sequence[tuple[int, int]], kept: int) -> np.ndarray:
    return last_periods(modes, hidden, modes.rows["c"], "drive", HZ, FORCE, parts, H, kept)


@cache
def started(hidden: Hidden) -> np.ndarray:
    """Harmonics of each period from that on at which the first record begins to the end of the later one."""
    return last_ones(NOMINAL, hidden, [(LATER + RECORDED, 512)], LATER + RECORDED - EARLY)


@cache
def measured(hidden: Hidden, wait: int, *, exact: bool = True) -> MeasuredSpectra:
    """Harmonics of records of whole periods, each after a start from rest: those of their mean period.

    What coarse steps at first err by has died out before a record that is steady.
    """
    rng = np.random.default_rng(1)
    modes = NOMINAL if exact else NOMINAL.disturbed(rng, **OFF)
    if wait == STEADY:
        q = last_ones(modes, hidden, [(90, 64), (60, 128), (50 + RECORDED, 512)], RECORDED)
    elif exact:
        q = started(hidden)[wait - EARLY :][:RECORDED]
    else:
        q = last_ones(modes, hidden, [(wait + RECORDED, 512)], RECORDED)
    q = q.mean(axis=0)
    return spectra_with_noise(rig_of(()), {name: q @ modes.rows[name] for name in SENSORS}, HZ, FORCE, rng)


def beside(joints: tuple[Joint, ...], spectra: MeasuredSpectra) -> tuple[Campaign, Evaluation, Evaluation]:
    """Records, the rig as it is, and with transients in each record."""
    rig = rig_of(joints)
    campaign, _ = campaign_of(rig, spectra)
    bare = Model(rig, {})
    base = evaluate(bare, campaign, bare.start, {})
    late = bare.extended_by(LATE)
    return campaign, base, evaluate(late, campaign, late.start, base.solutions)


def per_coefficient(e: Evaluation) -> float:
    return e.white.chi2 / len(e.white)


@pytest.mark.parametrize("name", CASES)
def test_transients_leave_noise_and_explain_what_was_measured(name: str) -> None:
    hidden, joints = CASES[name]
    campaign, base, e = beside(joints, measured(hidden, EARLY))
    noise = 4 * np.sqrt(2 / len(base.white))
    assert per_coefficient(base) > 50.0 and per_coefficient(e) < 1.0 + noise
    assert nrmse(e.white) < 0.3 * nrmse(base.white)
    assert accepted(base, e, 30) and not ordered(base, campaign)
    _, base, e = beside(joints, measured(hidden, STEADY))
    assert per_coefficient(base) < 1.0 + noise
    assert not accepted(base, e, 30)


@pytest.mark.parametrize("name", CASES)
def test_motions_are_those_of_the_march(name: str) -> None:
    """With their size free the four to six numbers of a record leave what the noise does, as one of them alone not."""
    hidden, joints = CASES[name]
    campaign, base, e = beside(joints, measured(hidden, LATER))
    left, free = 0.0, 0
    for record in campaign.data.records:
        std = campaign.listed_std(record)
        found = e.found[record.number].by_transients
        assert found is not None
        columns, missed = found[record.listed] / std[:, None], campaign.missed(record, base.found[record.number]) / std
        sizes = np.linalg.lstsq(columns, missed, rcond=1e-6)[0]
        left += float(np.sum((missed - columns @ sizes) ** 2))
        free += len(missed) - columns.shape[1]
    assert left / free < 1.3


def test_what_is_free_in_each_record_takes_no_credit() -> None:
    hidden, joints = CASES["cubic"]
    campaign, base, e = beside(joints, measured(hidden, EARLY))
    unseen = predicted(e, campaign)
    assert unseen.errors.nrmse == pytest.approx(nrmse(base.white), rel=1e-2)
    assert e.white.free > 10.0 * len(e.found) and base.white.free == 0.0


@pytest.mark.parametrize("name", ["cubic", "friction"])
def test_a_joint_that_is_missing_has_an_order(name: str) -> None:
    """So that transients are not tried: they would take it."""
    campaign, base, e = beside((), measured(CASES[name][0], STEADY))
    assert per_coefficient(base) > 3.0 and ordered(base, campaign)
    assert per_coefficient(e) < 0.5 * per_coefficient(base)


def test_what_sticks_where_it_once_reached_its_limit_is_a_mean_and_no_transient() -> None:
    """Friction in a plane that has shaken down touches its circle by rounding: the balance may say slip."""
    for mu in (1.0, 0.9997 * 0.4503200062453747):  # which only just suffices
        rig = rig_of((Joint("pad", PlaneFriction(mu, 3000.0, 1.0, 2000.0), ("c", "a", "b")),))
        found = transients(rig, steady_state(rig, 19.0, harmonics=H, samples=64), H)
        np.testing.assert_allclose(found.decay, (1.8900, 3.5389), rtol=1e-3)
        assert np.isfinite(found.coefficients).all()


def test_they_are_offered_once() -> None:
    for joints in ((), CASES["cubic"][1]):
        rig = rig_of(joints)
        assert LATE in all_candidates(rig) and LATE.unknowns(rig) == ()
        late = LATE.extend(rig, {})
        assert late.kind != rig.kind and not late.excitation.settled and LATE not in all_candidates(late)


def test_records_taken_too_early_are_called_that_and_steady_ones_consistent() -> None:
    hidden, joints = CASES["cubic"]
    rig = rig_of(joints)
    causes = [LATE, *(c for kind in (CubicStiffness, LocalDamper) for c in kind.candidates(rig) if not c.to)]
    early, steady = (
        measured(hidden, wait, exact=False).select(levels=(0.2, 1.0, 0.8, 4.0)) for wait in (EARLY, STEADY)
    )
    d = diagnose(rig, early, causes=causes)
    assert d.cause == "not-steady" and d.verdict == "cause-found"
    assert diagnose(rig, steady, causes=causes).verdict == "consistent"
