"""What is said of what a model leaves: shares, size, places; and of nested causes the plainest."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from hbm.diagnosis.conclusion import Conclusion
from hbm.diagnosis.confidence import RELIABLE, rivals
from hbm.diagnosis.decide import DECISIVE, Decision, _is_its_own, contenders, plainest
from hbm.diagnosis.remainder import beyond_noise, explained, remainder, tells
from hbm.diagnosis.search import Search
from hbm.diagnosis.untested import to_hold_out
from hbm.outputerror.whitened import Whitened
from models.causes.clamp import ClampFriction
from models.causes.friction import StribeckWeakening
from models.causes.joints import CubicStiffness, QuinticStiffness
from models.causes.sensors import SensorGain
from models.causes.structure import AddedMass, AddedSpring, AttachedResonator, ClampRotation
from models.published import paper_rig

HZ, FORCES, CHANNELS, H = np.array([50.0, 52.0, 54.0, 150.0, 155.0]), (2.0, 6.0), 3, 4
STD, RESPONSE = 0.01, 1.0


@pytest.fixture
def campaign():
    pairs = [(force, hz) for force in FORCES for hz in HZ]
    records = [SimpleNamespace(number=i, hz=hz, force=force) for i, (force, hz) in enumerate(pairs, 1)]
    return SimpleNamespace(data=SimpleNamespace(records=records, channels=("a1", "a2", "a3")))


@pytest.fixture
def noise(campaign):
    """Noise of one standard deviation beside a response of one unit in each fundamental."""
    shape = (len(campaign.data.records), 2, CHANNELS, H)
    record, part, channel, harmonic = (a.ravel() for a in np.indices(shape))
    residual = np.random.default_rng(6).standard_normal(len(record))
    residual *= np.sqrt(len(residual) / np.sum(residual**2))
    measured = np.where(harmonic == 0, RESPONSE, 0.0)
    return Whitened(
        residual, np.zeros((len(record), 0)), STD * residual, measured, record + 1, channel, harmonic + 1, part, {}
    )


def missing(white, where, size):
    """The same where a share of the response is missing in some of the coefficients."""
    added = size * RESPONSE / STD * where
    return replace(white, residual=white.residual + added, raw=white.raw + STD * added)


def test_noise_alone_has_no_size_and_says_so(noise, campaign):
    left = remainder(noise, campaign, False, {"train": 1.0, "held_out": 1.0})
    assert left.size == 0.0 and left.noise_variances == pytest.approx(1.0)
    assert left.sentence.endswith("What remains is noise.")
    assert explained(noise, noise) == 0.0


def test_shares_of_what_is_hardly_more_than_noise_are_of_the_whole_at_most(noise, campaign):
    """One channel has a little more than noise, the others so much less that hardly anything is left in all."""
    quiet = replace(noise, residual=noise.residual * np.where(noise.channel == 0, 1.1, 0.951))
    left = remainder(quiet, campaign, True, {"train": 1.0, "held_out": 1.0})
    assert "in channel a1 (100%)" in left.sentence
    assert 0.0 < sum(left.harmonics.values()) <= 1.0


def test_size_is_the_share_of_the_response_that_is_missing(noise):
    """In every fundamental: noise is not counted, whatever it is."""
    for size in (0.02, 0.1):
        assert beyond_noise(missing(noise, noise.harmonic == 1, size)) == pytest.approx(size, rel=0.1)


def test_explained_is_a_share_of_the_squares_beyond_noise(noise):
    before, after = (missing(noise, noise.harmonic == 1, size) for size in (0.2, 0.02))
    assert explained(before, after) == pytest.approx(0.99, abs=0.005)
    assert explained(after, before) == 0.0


def scattered(white, chi2):
    """The same with an effect of so much chi2 that has nothing to do with its noise."""
    added = np.random.default_rng(8).standard_normal(len(white))
    added -= (added @ white.residual) / white.chi2 * white.residual
    added *= np.sqrt(chi2 / np.sum(added**2))
    return replace(white, residual=white.residual + added)


def concluded(before, after, share):
    """A cause that leaves noise alone of records fitted, and of those held out what is given, with and without it."""
    best = SimpleNamespace(model=SimpleNamespace(calibrated=True, causes=(AddedMass(),)), settled=True)
    fits = SimpleNamespace(misfit=SimpleNamespace(fits=True), evaluation=SimpleNamespace(white=after))
    found = SimpleNamespace(
        best=(best, fits),
        plain={
            "calibrated": (SimpleNamespace(white=before), SimpleNamespace(evaluation=SimpleNamespace(white=before)))
        },
        campaign=None,
        decision=SimpleNamespace(base=None, fits=()),
        _extends=lambda best: "calibrated",
        _noise=lambda e: e,
        _within_too=lambda best: False,
        _std=None,
    )
    found._untested = Conclusion._untested.func(found)
    found._shares = {"train": 1.0} if found._untested else {"train": 1.0, "held_out": share}
    found._foretells = lambda best: Conclusion._foretells(found, best)
    return found


def test_records_held_out_that_fit_as_well_without_a_cause_do_not_test_it(monkeypatch, noise, campaign):
    """Whatever share it takes of next to nothing, it is no cause that was foretold, and no share is told.

    Nor is one whose size may be none.
    """
    monkeypatch.setattr("hbm.diagnosis.conclusion.inclusion", lambda fits, best: 1.0)
    monkeypatch.setattr("hbm.diagnosis.conclusion.misfit", lambda e, campaign: SimpleNamespace(fits=True))
    scatter = np.sqrt(2 * len(noise))
    for effect, tested in ((0.5 * scatter, False), (2.0 * scatter, True)):
        before = scattered(noise, effect)
        assert explained(before, noise) == pytest.approx(1.0) and tells(before, noise) is tested
        found = concluded(before, noise, 1.0)
        monkeypatch.setattr("hbm.diagnosis.conclusion.matters", lambda best, std: True)
        confidence = Conclusion._confidence(found, "cause-found", found.best[0])
        assert confidence == RELIABLE["foretold" if tested else "noise"]
        monkeypatch.setattr("hbm.diagnosis.conclusion.matters", lambda best, std: False)
        assert Conclusion._confidence(found, "cause-found", found.best[0]) == RELIABLE["noise"]
        found.best[0].settled = False  # transients are free in each record, and have no size
        assert (
            Conclusion._confidence(found, "cause-found", found.best[0]) == RELIABLE["foretold" if tested else "noise"]
        )
        shares, found.best[0].white = {"train", *(["held_out"] if tested else [])}, noise
        assert Conclusion._shares.func(found).keys() == shares  # what tests nothing decides nothing
    left = replace(remainder(noise, campaign, False, {"train": 0.986}), untested=True)
    assert left.sentence == (
        "Explained: 98.6 % of the misfit on the records fitted. The records held out do not test the cause: noise "
        "alone is left of them without it, too. What remains is noise."
    )


def test_what_is_no_larger_than_noise_but_improbable_somewhere_is_said_so(noise, campaign):
    """Less than noise as a whole: it was said to be 0 % of the response and more than noise."""
    quiet = replace(noise, residual=0.9 * noise.residual)
    left = remainder(quiet, campaign, True, {})
    assert beyond_noise(quiet) == left.size == 0.0
    said = left.sentence.partition(":")[0].rstrip(".")
    assert said == "What remains is no larger than noise (0.81 noise variances), but not spread like it"


@pytest.mark.parametrize(
    ("taken", "said"),
    [
        (
            {1: 5.0, 2: 900.0, 3: 40.0, 4: 0.0, 5: 70.0, 6: 300.0, 7: 20.0},
            "Records that would test added-mass, held out: --hold-out 6 3.",
        ),
        (
            {1: 5.0, 2: 900.0, 3: 20.0},
            "Too few records show added-mass clearly: record 2 alone; measure more of that kind, and hold out some.",
        ),
    ],
)
def test_records_that_would_test_a_cause_are_named_but_not_the_clearest(taken: dict[int, float], said: str):
    """Every second of those that show it: without any of them fitted nothing would be found."""
    before, after = (
        SimpleNamespace(spreads=taken, deviance=deviance) for deviance in (taken.__getitem__, lambda number: 0.0)
    )
    records = [SimpleNamespace(number=number, name=str(number)) for number in taken]
    campaign = SimpleNamespace(data=SimpleNamespace(records=records))
    (line,) = to_hold_out("added-mass", before, after, campaign)
    assert line == said


@pytest.mark.parametrize(
    ("fitted", "held_out", "missed"), [(True, False, 0.031), (True, True, 0.0), (False, False, 0.0)]
)
def test_what_shows_in_the_records_held_out_alone_is_told(
    monkeypatch, noise, campaign, fitted: bool, held_out: bool, missed: float
):
    monkeypatch.setattr("hbm.diagnosis.conclusion.misfit", lambda e, campaign: SimpleNamespace(fits=fitted))
    scored = SimpleNamespace(misfit=SimpleNamespace(fits=held_out, nrmse=0.031))
    found = SimpleNamespace(_scored=lambda e: scored, _noise=lambda e: e, campaign=None)
    assert Conclusion._missed(found, None) == missed
    told = replace(remainder(noise, campaign, False, {}), missed=missed).sentence
    others = " on the records fitted; those held out are missed by 3.1 %" if missed else ""
    assert told == f"What remains is noise{others}."


def test_a_cause_that_leaves_noise_of_the_records_fitted_alone_leaves_what_those_held_out_miss(
    monkeypatch, noise, campaign
):
    """Its remainder was said to be noise, at 12 % of the response of the records held out."""
    monkeypatch.setattr("hbm.diagnosis.conclusion.misfit", lambda e, campaign: SimpleNamespace(fits=True))
    held = missing(noise, (noise.harmonic == 1) & (noise.channel == 2), 0.03)
    unseen = SimpleNamespace(misfit=SimpleNamespace(fits=False, nrmse=0.03), evaluation=SimpleNamespace(white=held))
    best = SimpleNamespace(white=noise, settled=True)
    found = SimpleNamespace(
        _no_cause=SimpleNamespace(base=None),
        _scored=lambda e: unseen,
        _noise=lambda e: e,
        _missed=lambda e: 0.03,
        _uncertain=lambda e: 0.0,
        _shares={"train": 1.0, "held_out": 0.72},
        **dict.fromkeys(("verdict", "_untested", "_varying")),
        **dict.fromkeys(("campaign", "hidden"), campaign),
    )
    left = Conclusion._remainder(found, best)
    assert left.structured and left.size == pytest.approx(beyond_noise(held))
    assert left.noise_variances == pytest.approx(held.chi2 / len(held)) and left.harmonics == {
        1: pytest.approx(1.0, abs=0.1)
    }
    rest = f"those held out are missed by {100.0 * left.size:.2g} % of the response ({left.noise_variances:.3g} noise"
    assert (
        f"72 % of the misfit on the records held out. What remains is noise on the records fitted; {rest}"
        in left.sentence
    )
    assert "in channel a3" in left.sentence


@pytest.mark.parametrize(("fits", "variances", "told"), [(True, 7.2, 7.2), (True, 1.0, 0.0), (False, 7.2, 0.0)])
def test_what_uncertain_numbers_take_of_the_records_held_out_is_told(
    noise, campaign, fits: bool, variances: float, told: float
):
    """Of the mean square alone they are no noise; that the numbers could be others makes it so."""
    white = replace(noise, residual=noise.residual * np.sqrt(variances))
    scored = SimpleNamespace(
        misfit=SimpleNamespace(fits=fits),
        errors=SimpleNamespace(chi2_reduced=variances),
        evaluation=SimpleNamespace(white=white),
    )
    found = SimpleNamespace(_scored=lambda e: scored)
    left = Conclusion._uncertain(found, SimpleNamespace(settled=True))
    assert left == told and Conclusion._uncertain(found, SimpleNamespace(settled=False)) == 0.0
    said = replace(remainder(noise, campaign, False, {}), uncertain=left).sentence
    rest = "; those held out leave 7.2 noise variances, no more than the fitted numbers are uncertain by"
    assert said == f"What remains is noise{rest if told else ''}."


def test_freedom_of_transients_is_charged_for(noise):
    """What transients explain that are free in each record costs what their freedom does."""
    before = missing(noise, noise.harmonic == 1, 0.1)
    cost = 0.25 * (before.chi2 - len(before))
    assert explained(before, replace(noise, free=cost)) == pytest.approx(0.75, abs=0.01)


def test_places_say_where_most_of_it_is(noise, campaign):
    """In one channel, one harmonic, one level of one band."""
    there = (noise.harmonic == 3) & (noise.channel == 1) & (noise.record > len(HZ)) & (noise.record <= len(HZ) + 3)
    left = remainder(missing(noise, there, 0.3), campaign, True, {})
    assert left.harmonics.keys() == {3} and left.harmonics[3] > 0.9
    told = "; ".join(left.places)
    assert "50 to 54 Hz at 6 N" in told and "in channel a2" in told and "by harmonic 3" in told
    assert "150" not in told
    alike = remainder(missing(noise, noise.harmonic == 1, 0.3), campaign, True, {})
    assert "alike in all channels" in alike.places


def fit(bic, counted, *causes):
    labels = SimpleNamespace(causes=causes, counted=counted, label=" + ".join(c.label for c in causes))
    return SimpleNamespace(bic=bic, model=labels)


def test_a_cause_that_another_contains_wins_unless_the_rest_pays():
    """An elastic clamp in a slipping one, a spring or a mass in a resonator, one cause in two; others never."""
    elastic, slipping = fit(1000.0, 1, ClampRotation()), fit(1000.0 - DECISIVE / 2, 2, ClampFriction())
    assert plainest(slipping, [slipping, elastic]) is elastic
    assert plainest(slipping, [slipping, fit(1000.0 + DECISIVE, 1, ClampRotation())]) is slipping
    resonator = fit(900.0, 3, AttachedResonator())
    for simple in (AddedMass(), AddedSpring()):
        plain = fit(910.0, 2, simple)
        assert plainest(resonator, [resonator, plain]) is plain
    assert plainest(resonator, [resonator, fit(905.0, 1, ClampRotation())]) is resonator
    pair = fit(980.0, 3, AddedMass(), ClampRotation())
    assert plainest(pair, [pair, elastic]) is elastic


@pytest.mark.parametrize(
    ("static", "sliding", "weakens"),
    [
        (0.4, 0.4, False),
        (0.4001, 0.3969, True),  # next to nothing, but all that is off: it was 1.9 % of a response, and no cause
        (0.403, 0.3999, True),
        (0.48, 0.4769, False),  # both are off by 20 %
        (0.48, 0.47, True),
        (0.38, 0.39, False),
    ],
)
def test_a_friction_weakens_where_that_is_more_than_what_is_off(static: float, sliding: float, weakens: bool) -> None:
    unknowns = StribeckWeakening().unknowns(paper_rig())
    nominal = unknowns[0].neutral
    model = SimpleNamespace(unknowns=(unknowns,))
    values = {(0, "mu_static"): static / 0.4 * nominal, (0, "mu"): sliding / 0.4 * nominal}
    assert _is_its_own(SimpleNamespace(model=model, values=values)) is weakens


def test_what_contains_the_best_cause_is_no_rival_of_it():
    """A repetition decides for it only where it is decisively likelier, as the measurement did not."""
    base, elastic, mass = fit(2000.0, 0), fit(1000.0, 1, ClampRotation()), fit(1001.0, 2, AddedMass())
    slipping, pair = fit(990.0, 2, ClampFriction()), fit(980.0, 3, AddedMass(), ClampRotation())
    decision = Decision(base, elastic, (slipping, pair, elastic, mass))
    assert rivals(decision, elastic) == [base, elastic, mass]
    assert rivals(decision, slipping) == [base, slipping, pair, elastic, mass]
    other = fit(981.0, 3, AddedMass(), AddedSpring())  # of two the first gives the name
    assert rivals(Decision(base, pair, (pair, other, mass)), pair) == [base, pair, mass]


def judged(
    monkeypatch,
    *,
    settled,
    noise,
    shares,
    left=0.0,
    before=0.1,
    foretells=True,
    predicts=True,
    varies=None,
    stands=True,
):
    """The verdict on a cause, from what is known of it."""
    best = SimpleNamespace(settled=settled, white=left)
    monkeypatch.setattr("hbm.diagnosis.conclusion.misfit", lambda e, campaign: SimpleNamespace(fits=noise))
    monkeypatch.setattr("hbm.diagnosis.conclusion.beyond_noise", lambda white: white)
    concluded = SimpleNamespace(
        best=(best, None),
        campaign=None,
        search=SimpleNamespace(calibrated=None),
        _transients_foretell=lambda scored: foretells,
        _varying=varies,
        _lead=np.inf if stands else 0.0,
        _shares=dict(zip(("train", "held_out"), shares, strict=True)),
        _noise=lambda e: e,
        _before=lambda e: SimpleNamespace(white=before),
        _holds=lambda scored: True,
        _as_well=lambda best, scored: predicts,
        calibrated=None,
        _no_cause=SimpleNamespace(verdict="none"),
    )
    return Conclusion._claimed.func(concluded)


@pytest.mark.parametrize(
    ("lead", "untested", "sized", "said"),
    [
        (np.inf, False, False, "cause-found"),
        (np.inf, True, True, "cause-found"),
        (np.inf, True, False, "none"),
        (1.0, False, True, "cause-found"),
        (1.0, False, False, "none"),
    ],
)
def test_a_cause_has_a_size_unless_records_held_out_tell_of_it(
    monkeypatch: pytest.MonkeyPatch, lead: float, untested: bool, sized: bool, said: str
):
    """Transients of one record were called a resonator of 1.8 g, give or take 150 g."""
    monkeypatch.setattr("hbm.diagnosis.conclusion.matters", lambda e, std: sized)
    concluded = SimpleNamespace(
        best=(None, None),
        search=SimpleNamespace(calibrated=None),
        _claimed="cause-found",
        _lead=lead,
        _untested=untested,
        _std=None,
        _no_cause=SimpleNamespace(verdict="none"),
    )
    assert Conclusion.verdict.func(concluded) == said


@pytest.mark.parametrize(
    ("fitted", "held_out", "size", "as_well"),
    [
        (1.0, 1.0, 0.1, True),
        (1.04, 1.04, 0.1, True),
        (1.9, 0.7, 0.1, False),
        (1.9, 0.7, 0.008, True),
        (0.7, 1.2, 0.008, False),
    ],
)
def test_a_main_cause_leaves_no_more_than_calibration(
    monkeypatch: pytest.MonkeyPatch, fitted: float, held_out: float, size: float, as_well: bool
):
    """A radius within its uncertainty of the rig file left 12 % of the response, twice as much, and was named."""
    monkeypatch.setattr("hbm.diagnosis.conclusion.beyond_noise", lambda white: size)

    def leaving(charged: float) -> SimpleNamespace:
        white = SimpleNamespace(charged=charged)
        return SimpleNamespace(white=white, evaluation=SimpleNamespace(white=white))

    found = SimpleNamespace(
        _noise=lambda e: e, search=SimpleNamespace(calibrated=leaving(1.0)), calibrated=leaving(1.0)
    )
    assert Conclusion._as_well(found, leaving(fitted), leaving(held_out)) is as_well


def test_a_verdict_has_a_name_and_a_remainder(monkeypatch):
    """Noise left; a background; more, and of a far larger effect; the response missed; most left; and so on.

    A force that reads too large by thousands leaves nothing that moves, which a rig that moves 59 times too far is not.
    """
    for noise, shares, left, before, said in (
        (True, (0.3, 0.3), 0.0, 0.002, "cause-found"),
        (False, (0.99, 0.97), 0.004, 0.1, "cause-found"),
        (False, (0.99, 0.97), 0.02, 0.1, "main-cause"),
        (False, (0.9999, 0.9995), 0.0107, 1.6, "cause-found"),
        (False, (0.9999, 0.998), 0.0107, 1.6, "main-cause"),
        (False, (0.95, 0.97), 0.87, 1.93, "none"),
        (False, (0.9994, 0.97), 0.47, 0.99, "main-cause"),
        (False, (0.97, 0.97), 0.65, 1850.0, "main-cause"),
        (False, (0.9997, 0.9996), 0.995, 59.0, "none"),
        (False, (0.8, 0.6), 0.004, 0.01, "main-cause"),
        (False, (0.8, 0.4), 0.004, 0.01, "none"),
        (False, (0.99, 0.99), 0.001, 0.004, "none"),
    ):
        assert judged(monkeypatch, settled=True, noise=noise, shares=shares, left=left, before=before) == said
    assert judged(monkeypatch, settled=True, noise=False, shares=(0.9, 0.9), predicts=False) == "none"
    assert (
        judged(monkeypatch, settled=True, noise=True, shares=(0.9, 0.9), stands=False) == "none"
    )  # a background may be it
    for noise in (True, False):  # a look-alike, whose number changes with the level
        assert judged(monkeypatch, settled=True, noise=noise, shares=(0.99, 0.97), varies="so") == "main-cause"


def test_transients_are_only_named_where_they_pay_and_calibration_foretells_no_better(monkeypatch):
    """What is free in each record leaves noise of anything."""
    assert judged(monkeypatch, settled=False, noise=True, shares=(0.9, 0.9)) == "cause-found"
    assert judged(monkeypatch, settled=False, noise=True, shares=(0.43, 0.39)) == "none"
    assert judged(monkeypatch, settled=False, noise=True, shares=(0.9, 0.9), foretells=False, left=0.02) == "none"
    assert judged(monkeypatch, settled=False, noise=False, shares=(0.9, 0.8), left=0.13) == "none"


@pytest.mark.parametrize(
    ("foretold", "too"),
    [((0.1, 0.1, 0.1, 0.1), False), ((0.1, 0.3, 0.06, 0.04), True), ((0.1, None, None, 0.2), False)],
)
def test_the_best_and_those_that_foretell_better_are_looked_at_again(foretold, too):
    """With more records; a second cause beside the first, which was there already; a joint at all places."""
    a, b, c, d = SensorGain("a1"), SensorGain("a2"), CubicStiffness("drive"), CubicStiffness("c")
    quintic = QuinticStiffness("c")
    fits = [SimpleNamespace(model=SimpleNamespace(causes=causes)) for causes in ((a,), (b,), (a, c), (a, quintic))]
    candidates = [a, b, SensorGain("a3"), c, d, quintic]
    better = Conclusion._better.fget(SimpleNamespace(_nrmse_held_out=foretold))
    assert contenders(fits, better, (), candidates) == [a, b, c, d, *([quintic] if too else [])]


def test_what_is_weak_on_the_records_fitted_is_looked_at_again_where_the_score_test_favours_it():
    """Over the calibrated rig file, which leaves noise of them: of the first three those worth their numbers."""
    causes = [SensorGain(f"a{i}") for i in range(1, 6)]
    scores = [SimpleNamespace(cause=c, gain=gain) for c, gain in zip(causes, (19.0, 5.0, -7.0, 3.0), strict=False)]
    assert contenders((), (), scores, causes) == causes[:2]


@pytest.mark.parametrize(("screened", "before", "tried"), [([], 0, 1), ([], 123, 123), ([5, 7], 123, 123), ([9], 0, 9)])
def test_candidates_count_that_were_tried_before_too(screened, before, tried):
    """What numbers within tolerances do for may be decided without a candidate."""
    search = SimpleNamespace(screenings=[SimpleNamespace(tried=n) for n in screened], _before=before)
    assert Search.tried.fget(search) == tried


@pytest.mark.parametrize(
    ("foretold", "untold"),
    [((0.1, 0.06, 0.04), True), ((0.1, 0.06), False), ((0.1, None), False), ((None, 0.04), False)],
)
def test_a_main_cause_is_judged_anew_where_another_foretells_much_better(foretold, untold):
    """Not where the first foretells nothing to compare with."""
    found = SimpleNamespace(hidden=(), verdict="main-cause", _nrmse_held_out=list(foretold))
    found._better = Conclusion._better.fget(found)
    assert Conclusion.untold.fget(found) is untold
