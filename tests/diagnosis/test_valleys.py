"""Fits that begin on another branch or in another valley than the one that was measured, and get out of it."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import hbm.diagnosis.candidates
import hbm.diagnosis.fullfits
from hbm.diagnosis.attached import same_force
from hbm.diagnosis.candidates import HALF, TIED, _ahead, _alone_ahead, _chosen, fit_candidates
from hbm.diagnosis.decide import BARE, DECISIVE, Decision, tied
from hbm.diagnosis.fullfits import HELPS, full_fits, refined
from hbm.diagnosis.quickfits import CHANCE, SEEN, QuickFits, _apart, _limited
from hbm.diagnosis.restart import apart, started
from hbm.diagnosis.screen import Screening
from hbm.diagnosis.search import Search
from hbm.measurement.spectra import MeasuredSpectra, spectra_of
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation, evaluate
from hbm.outputerror.fit import fit_model
from hbm.outputerror.measured import campaign_of
from hbm.outputerror.model import Model
from hbm.outputerror.valley import along_valley
from hbm.response.trace import steady_state, trace_frequency
from models.bodies import ModalModel
from models.causes.clamp import ClampFriction
from models.causes.elements import ImpactStopCause
from models.causes.joints import (
    CubicStiffness,
    JointMicroslip,
    LocalBacklash,
    LocalDamper,
    LocalFriction,
    OneSidedStop,
    QuinticStiffness,
)
from models.causes.parameter import WrongParameter
from models.causes.records import NotSteady
from models.causes.sensors import SensorDelay
from models.causes.structure import (
    AddedMass,
    AddedSpring,
    AttachedResonator,
    ClampRotation,
    SupportFlexibility,
    SupportRotationSpring,
)
from models.friction import Iwan
from models.jointed import JointedRig
from models.joints import CubicSpring, Friction, Joint, PolynomialSpring
from models.parts import Channel, Damping, Excitation
from models.published import paper_rig

H, HZ, NOISE, K3 = 3, 21.0, 1e-3, 5e10
BODY, DAMPING = ModalModel((20.0,), {"tip": (1.0,)}), Damping(modal_ratios=(0.005,))
CHANNELS = (Channel("force", "force"), Channel("x", "displacement", at="tip"))
SPRING = Joint("hidden", CubicSpring(K3), ("tip",))
RIG = JointedRig("one mode", BODY, DAMPING, (SPRING,), Excitation(0.05, at="tip"), CHANNELS)


def branches() -> list[Any]:
    """Steady states at one frequency between the folds, the smallest first: made by the curve that passes all three."""
    curve = trace_frequency(RIG, (19.0, 24.0), harmonics=H)
    hz = np.array(curve.hz)
    crossed = np.flatnonzero((hz[1:] - HZ) * (hz[:-1] - HZ) <= 0.0)
    assert len(crossed) == 3
    near = [curve.points[i] for i in crossed]
    return sorted(near, key=lambda s: float(np.abs(s["x"].coefficients).max()))


def spectra_at(*solutions: Any, larger: float = 1.0, noise: float = NOISE) -> MeasuredSpectra:
    """Of motions so many times as large."""
    rows = {name: np.array([s[name].coefficients[: 2 * H + 1] for s in solutions]) for name in ("x", "force")}
    rows["x"] = larger * rows["x"]
    size = np.abs(rows["x"]).max()
    std = {"x": np.full((len(solutions), H + 1), noise * size), "force": np.full((len(solutions), H + 1), 1e-6)}
    at = np.array([[s.hz, s.level] for s in solutions])
    return spectra_of(RIG, *at.T, rows, std)


@pytest.mark.parametrize("measured", [0, 2])
def test_a_record_is_followed_on_the_branch_that_was_measured(measured: int) -> None:
    """Its last steady state is on the other one, where Newton's method would stay."""
    found = branches()
    campaign, _ = campaign_of(RIG, spectra_at(found[measured]))
    model = Model(RIG, {})
    astray = {1: found[2 - measured]}
    stays = evaluate(model, campaign, model.start, astray)
    assert stays.chi2 > 1e4 * len(stays.white)
    assert fit_model(model, campaign, model.start, astray).chi2 < 10.0 * len(stays.white)


def test_a_fit_gets_to_a_branch_that_was_not_there_where_it_began() -> None:
    """With 0.3 times the cubic stiffness the curve has folded before the last record."""
    curve = trace_frequency(RIG, (19.0, HZ), harmonics=H)
    below = [min(curve.points, key=lambda s: abs(s.hz - hz)) for hz in (20.0, 20.3, 20.6)]
    spectra = spectra_at(*below, branches()[-1])
    bare = replace(RIG, joints=())
    campaign, _ = campaign_of(bare, spectra)
    model = Model(bare, {}).extended_by(CubicStiffness("tip"))
    softer = trace_frequency(RIG.with_joint("hidden", CubicSpring(0.3 * K3)), (19.0, 24.0), harmonics=H)
    assert max(softer.folds) < HZ
    begun = evaluate(model, campaign, np.array([f.of(0.3 * K3) for f in model.free]), {})
    found = fit_model(model, campaign, begun.x, begun.solutions)
    assert begun.chi2 > 1e4 * len(begun.white)
    assert found.chi2 < 3.0 * len(found.white)
    assert abs(model.free[0].value(found.x[0]) - K3) < 3.0 * found.std[0] + 1e-3 * K3


def test_a_fit_goes_on_along_its_valley_beyond_a_ripple_of_it() -> None:
    """Of a joint whose parts slip one after the other little more is seen than its stiffness squared over its limit."""
    stiffness, limit = 2e3, 0.3
    hidden = Joint("hidden", Friction(Iwan(1.0, stiffness), limit), ("tip",))
    held = Joint("held", PolynomialSpring(-stiffness), ("tip",))
    slips, linear = replace(RIG, joints=(hidden, held)), replace(RIG, joints=())
    levels = [replace(slips, excitation=Excitation(level, at="tip")) for level in (0.03, 0.1)]
    states = [steady_state(rig, hz, harmonics=1) for rig in levels for hz in (19.4, 19.8, 20.0)]
    rows = {name: np.array([s[name].coefficients[:3] for s in states]) for name in ("x", "force")}
    size = 2e-3 * np.abs(rows["x"]).max(axis=1, keepdims=True)
    rows["x"] = rows["x"] + size * np.random.default_rng(0).normal(size=rows["x"].shape)
    std = {"x": np.hstack([size, size]), "force": np.full((len(states), 2), 1e-6)}
    measured = spectra_of(linear, *np.array([[s.hz, s.level] for s in states]).T, rows, std)
    campaign, _ = campaign_of(linear, measured)
    bare = Model(linear, {})
    base, model = evaluate(bare, campaign, bare.start, {}), bare.extended_by(JointMicroslip("tip"))
    far = model.at({(0, "stiffness"): 1.5 * stiffness, (0, "limit"): 2.2 * limit})
    ended = fit_model(model, campaign, far, base.solutions, 40)
    assert ended.chi2 > 2.0 * len(ended.white)
    (found,) = refined([ended], base, campaign)
    assert found.chi2 < len(found.white) and along_valley(found, campaign) is found
    (of_no_use,) = refined([ended], base, campaign, of_use=0.5 * ended.chi2)
    assert of_no_use.chi2 > 2.0 * len(ended.white)


@pytest.mark.parametrize(("larger", "times"), [(1.05, 0), (1.3, 1)])
def test_a_record_that_is_missed_by_little_of_its_size_is_on_its_branch(
    monkeypatch: pytest.MonkeyPatch, larger: float, times: int
) -> None:
    """However many standard deviations that is: it is not solved for from what was measured."""
    found = branches()[0]
    campaign, _ = campaign_of(RIG, spectra_at(found, larger=larger, noise=1e-5))
    again, solve = [], Campaign.reconstructed

    def counted(self: Campaign, rig: Any) -> Any:
        again.append(rig)
        return solve(self, rig)

    monkeypatch.setattr(Campaign, "reconstructed", counted)
    model = Model(RIG, {})
    fit = fit_model(model, campaign, model.start, {1: found})
    assert fit.chi2 > 1e4 * len(fit.white) and len(again) == times


@pytest.mark.parametrize(
    ("left", "alone", "before_the_next"),
    [
        ((900.0, 4000.0, 9000.0), True, True),  # of 10000
        ((900.0, 2000.0, 9000.0), False, True),
        ((2000.0, 9000.0, 9000.0), False, True),
        ((4000.0, 9000.0, 9000.0), False, False),
        ((6000.0, 60000.0, 60000.0), False, False),
        ((0.0, 40.0, 40.0), False, False),  # all leave but noise
    ],
)
def test_one_is_ahead_that_leaves_little_and_others_far_more(
    left: tuple[float, ...], alone: bool, before_the_next: bool
) -> None:
    few = SimpleNamespace(points=100)
    base = SimpleNamespace(model=SimpleNamespace(nominal=None))
    quick_fits: Any = SimpleNamespace(few=few, before=10100.0, base=base)
    fitted = [quick(str(i), 100.0 + chi2, 1) for i, chi2 in enumerate(left)]
    assert _alone_ahead(fitted, quick_fits) is alone
    assert _ahead(fitted, fitted[2:], HALF, quick_fits) is before_the_next


def quick(label: str, chi2: float, numbers: int) -> Any:
    return SimpleNamespace(cause=SimpleNamespace(label=label), chi2=chi2, numbers=numbers)


def order(candidate: Any) -> float:
    return float(candidate.numbers)


def test_of_those_that_leave_alike_the_simplest_comes_first_where_none_leaves_noise() -> None:
    few, richer = SimpleNamespace(points=50), quick("quintic", 1e5, 3)
    for share, first in ((0.5 * TIED, "cubic"), (2.0 * TIED, "quintic")):
        fitted = [richer, quick("cubic", (1.0 + share) * 1e5, 2), quick("poor", 1e7, 1)]
        chosen = [c.cause.label for c in _chosen(fitted, few, False, 1.0, order)]
        assert chosen[0] == first and set(chosen) == {"cubic", "quintic"}
    explains = [quick("quintic", 49.0, 3), quick("cubic", 49.5, 2)]
    assert _chosen(explains, few, False, 1.0, order)[0].cause.label == "quintic"


@pytest.mark.parametrize(("ahead", "run"), [(-1.0, 1), (0.9 * CHANCE, 1), (1.1 * CHANCE, 2)])
def test_what_holds_a_simpler_one_is_fitted_to_all_records_where_it_is_better_by_more_than_chance(
    ahead: float, run: int
) -> None:
    rich, plain = (SimpleNamespace(cause=cause, numbers=0) for cause in (ClampFriction(), ClampRotation()))
    rich.chi2, plain.chi2 = 60.0 - ahead, 60.0
    fitted: list[Any] = sorted([rich, plain], key=lambda r: float(r.chi2))
    chosen = _chosen(fitted, SimpleNamespace(points=50), False, 1.0, order)  # type: ignore[arg-type]
    assert plain in chosen and len(chosen) == run


@pytest.mark.parametrize(("left", "fitted"), [(0.9 * HELPS, 1), (1.1 * HELPS, 2)])
def test_another_is_fitted_where_the_first_does_not_take_its_share_of_all(
    monkeypatch: pytest.MonkeyPatch, left: float, fitted: int
) -> None:
    fits = (SimpleNamespace(chi2=share * 1e4, missing=(), bic=share, white=()) for share in (left, 0.1))
    monkeypatch.setattr(hbm.diagnosis.fullfits, "_fits", lambda *_: [next(fits)])
    monkeypatch.setattr(hbm.diagnosis.fullfits, "small", lambda base: False)
    model = SimpleNamespace(extended_by=lambda cause: None)
    base = SimpleNamespace(chi2=1e4, model=model, solutions={})
    two = [SimpleNamespace(cause=SimpleNamespace(label=name), x=None, others=()) for name in "ab"]
    assert len(full_fits(two, base, None, lambda said: None, one=True)) == fitted


def test_a_valley_that_leaves_noise_alone_too_is_fitted_to_all_records() -> None:
    """Few records cannot tell it from the best, however much less that leaves."""

    def fit(chi2: float, x: float, missing: tuple[int, ...] = ()) -> Any:
        return SimpleNamespace(
            chi2=chi2, x=np.array([x]), white=np.zeros(600), missing=missing, covariance=np.array([[1e-4]])
        )

    best, noise, same, worse, lost = fit(400, 1), fit(590, 2), fit(410, 1.001), fit(610, 3), fit(420, 4, (2,))
    assert _apart(best, [same, lost, noise, worse]) == [noise]
    near = fit(1025, 2)
    assert _apart(fit(1000, 1), [near, fit(1035, 3)]) == [near]


def test_each_of_a_pair_is_fitted_alone_from_where_both_were_found() -> None:
    """The first of them keeps the number that it has in the pair, not the start of a search."""
    found = branches()[0]
    linear = JointedRig("one mode", BODY, DAMPING, (), RIG.excitation, CHANNELS)
    campaign, _ = campaign_of(linear, spectra_at(found))
    bare = Model(linear, {})
    base = evaluate(bare, campaign, bare.start, {})
    first, second = CubicStiffness("tip"), LocalDamper("tip")
    both = bare.extended_by(first).extended_by(second)
    x = np.array([f.of(K3 if f.cause == 0 else 1e-9) for f in both.free])
    pair = evaluate(both, campaign, x, {1: found})
    alone = apart(base, pair, campaign)
    assert [e.model.causes for e in alone] == [(first,), (second,)]
    assert alone[0].chi2 == pytest.approx(pair.chi2, rel=0.2, abs=1.0) and alone[1].chi2 > 1e3 * alone[0].chi2
    (found_alone,) = started(base, pair, (first,), campaign)
    assert found_alone.model.values(found_alone.x, 0)[first.unknowns(linear)[0].name] == pytest.approx(K3, rel=0.01)


@pytest.mark.parametrize(
    ("explained", "calibrated", "settled", "asked"),
    [(0.95, True, True, 1), (0.95, False, False, 1), (0.5, True, False, 0)],
)
def test_a_cause_that_takes_nearly_all_is_calibrated_before_others_are_looked_for(
    monkeypatch: pytest.MonkeyPatch, explained: float, calibrated: bool, settled: bool, asked: int
) -> None:
    again: list[Any] = []

    def beside(e: Any) -> list[Any]:
        again.append(e)
        return ["calibrated"]

    monkeypatch.setattr("hbm.diagnosis.standing.explained", lambda before, after: explained)
    e = SimpleNamespace(model=SimpleNamespace(calibrated={}), white=None)
    search = SimpleNamespace(
        _enough=lambda one: one == "calibrated" and calibrated,
        nominal=SimpleNamespace(white=None),
        tolerable=lambda one: True,
        _over_tolerances=beside,
        _adds=lambda one: True,
    )
    assert Search._settles(search, e) is settled and len(again) == asked


@pytest.mark.parametrize(("enough", "fitted"), [(True, ["plain"]), (False, ["plain", "rich"])])
def test_what_was_left_out_for_a_simpler_one_is_fitted_to_all_records_where_that_does_not_do(
    monkeypatch: pytest.MonkeyPatch, enough: bool, fitted: list[str]
) -> None:
    plain, rich, done = quick("plain", 60.0, 1), quick("rich", 58.0, 3), list[str]()

    def full(chosen: list[Any], *_: Any, **__: Any) -> list[Any]:
        done.extend(c.cause.label for c in chosen)
        return [SimpleNamespace(chi2=c.chi2, missing=(), model=None) for c in chosen]

    base: Any = SimpleNamespace(white=np.zeros(50), x=np.zeros(0), chi2=9e3)
    for name, stand_in in {
        "_started": lambda screening, *_: screening,
        "small": lambda _: False,
        "scanned": lambda _: False,
        "_by_quick_fits": lambda *_, **__: ([plain], [rich], {"plain", "rich"}),
        "full_fits": full,
        "refined": lambda fits, *_: fits,
        "in_order": lambda *_: [],
        "followed": lambda fits, _: fits,
    }.items():
        monkeypatch.setattr(hbm.diagnosis.candidates, name, stand_in)
    over: Any = SimpleNamespace(base=base, campaign=None, few=SimpleNamespace(points=50), before=9e3)
    fit_candidates(over, None, lambda _: None, lambda _: enough)  # type: ignore[arg-type]
    assert done == fitted


@pytest.mark.parametrize(("fits", "raced"), [(False, False), (True, True)])
def test_where_tolerances_leave_noise_alone_single_causes_are_tried_in_their_place(
    monkeypatch: pytest.MonkeyPatch, fits: bool, raced: bool
) -> None:
    """Also where that noise looks suspicious; where they take next to all but leave more, they have a start there."""
    monkeypatch.setattr("hbm.diagnosis.search.off_beside_sensors", lambda *_: ())
    monkeypatch.setattr("hbm.diagnosis.search.explained", lambda *_: 0.99)
    model: Any = SimpleNamespace(white=None)
    search: Any = SimpleNamespace(
        identified=False, trust=None, nominal=model, calibrated=model, first="as it is", over=lambda base: base,
        _fits=lambda _: fits, _within=lambda: False, _race=lambda *_: "raced",
    )  # fmt: skip
    assert (Search._exact(search) == "raced") is raced


@pytest.mark.parametrize(("useful", "fitted"), [(np.inf, ["poor", "fair", "good"]), (0.3, ["good"])])
def test_a_second_cause_that_will_not_pay_is_not_fitted_to_all_records(
    monkeypatch: pytest.MonkeyPatch, useful: float, fitted: list[str]
) -> None:
    """Of a small misfit the score test foresees what a fit leaves: 0.3 of 1000 beyond noise, and half as much again."""
    chosen, done, limits = [quick("poor", 901.0, 1), quick("fair", 501.0, 1), quick("good", 499.0, 1)], list[str](), []

    def full(candidates: list[Any], *arguments: Any) -> list[Any]:
        done.extend(c.cause.label for c in candidates)
        limits.append(arguments[-1])
        return []

    base: Any = SimpleNamespace(white=np.zeros(50), x=np.zeros(0), chi2=1050.0)
    for name, stand_in in {
        "_started": lambda screening, *_: screening,
        "small": lambda _: True,
        "_by_score": lambda *_: chosen,
        "full_fits": full,
        "refined": lambda fits, *_: fits,
    }.items():
        monkeypatch.setattr(hbm.diagnosis.candidates, name, stand_in)
    screening: Any = SimpleNamespace(scores=())
    over: Any = SimpleNamespace(base=base, campaign=None, few=SimpleNamespace(points=50), before=9e3)
    fit_candidates(over, screening, lambda _: None, lambda _: False, useful=useful)
    assert done == fitted
    assert limits == [50.0 + useful * 1000.0]


@pytest.mark.parametrize(
    ("large", "raced"),
    [
        (False, ["second", "fourth", "fifth", "seventh"]),
        (True, ["second", "fourth", "fifth", "seventh", "eighth"]),
    ],
)
def test_what_leads_over_the_calibrated_rig_file_is_tried_over_it_as_it_is(
    monkeypatch: pytest.MonkeyPatch, large: bool, raced: list[str]
) -> None:
    """Four of them, and what does as calibration did; but for what was tried, or is a number within tolerances.

    Of a large misfit what is rigid and would take much by giving way too.
    """
    monkeypatch.setattr("hbm.diagnosis.search.small", lambda base: not large)
    quick = SimpleNamespace(giving_way=lambda scores: [s for s in scores if s.cause.label == "eighth"])

    def scores(*labels: str) -> Any:
        each = tuple(SimpleNamespace(cause=SimpleNamespace(label=name)) for name in labels)
        return SimpleNamespace(scores=each, instead=[s for s in each if s.cause.label in ("number", "seventh")])

    run = list[str]()

    def race(base: str, screening: Any, done: float) -> Decision:
        run.extend(s.cause.label for s in screening.scores)
        return tried

    fit: Any = SimpleNamespace(model=SimpleNamespace(label="third"), missing=(0,))
    tried = Decision(fit, None, (fit,))
    screenings = {
        "calibrated": scores("number", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth"),
        "as it is": Screening(
            scores("eighth", "seventh", "sixth", "fifth", "fourth", "third", "second", "number").scores, 1, 1
        ),
    }
    search: Any = SimpleNamespace(
        identified=False, calibrated="calibrated", first="as it is", over=screenings.__getitem__, _race=race,
        _quick=lambda *_: quick,
        _tolerated={"number": "number"}, _settles=lambda _: False, campaign=None,
    )  # fmt: skip
    Search._instead(search, tried)
    assert sorted(run) == sorted(raced)


@pytest.mark.parametrize(
    ("explained", "tolerable", "again"), [(0.95, False, ["takes"]), (0.5, False, []), (0.95, True, [])]
)
def test_what_takes_nearly_all_over_a_rig_file_gone_too_far_is_fitted_over_it_as_it_is(
    monkeypatch: pytest.MonkeyPatch, explained: float, tolerable: bool, again: list[str]
) -> None:
    """From where it was found: its own numbers are right there, those of the rig file are not."""
    asked = list[tuple[str, str]]()

    def from_there(base: str, found: Any, causes: Any, campaign: Any) -> list[Any]:
        asked.append((base, found.model.causes[0]))
        return [found]

    monkeypatch.setattr("hbm.diagnosis.search.started", from_there)
    monkeypatch.setattr("hbm.diagnosis.search.explained", lambda before, after: explained)
    takes, other = (
        SimpleNamespace(model=SimpleNamespace(causes=(name,)), missing=(), bic=bic, white=None)
        for name, bic in (("takes", 10.0), ("other", 20.0))
    )
    search: Any = SimpleNamespace(
        identified=False, fitted=[other, takes], nominal="as it is", calibrated=SimpleNamespace(white=None),
        campaign=None, tried=1, tolerable=lambda e: tolerable, _decided=lambda base, fits, tried: (base, fits),
    )  # fmt: skip
    before: Any = SimpleNamespace(fits=(other,))
    found = Search._gone_far(search, before)
    assert asked == [("as it is", name) for name in again]
    assert found == (("as it is", [takes, other]) if again else before)


@pytest.mark.parametrize(("stiffness", "near"), [(2.4e6, 1.0 / 16.0), (2.4e7, 3.0 / 16.0)])
def test_a_support_that_gives_way_is_seen_though_its_first_small_effect_is_not_the_one_it_has(
    stiffness: float, near: float
) -> None:
    """Its resonance has moved by more than its width; half a decade of stiffness misses that, an eighth does not.

    Of the stiffer one only a start beyond ten thousand times the beam's own stiffness sees it, one beside the nearest.
    """
    rig, levels = paper_rig(), np.full(4, 6.5)
    hz = np.array([38.0, 42.0, 46.0, 50.0])
    hidden = SupportFlexibility().extend(rig, {"stiffness": stiffness})
    found = [steady_state(hidden, f, harmonics=5, samples=256) for f in hz]
    rows = {c.name: np.array([s[c.name].coefficients for s in found]) for c in rig.channels}
    std = {name: np.full((len(hz), 6), 1e-3 * np.abs(values).max()) for name, values in rows.items()}
    campaign, _ = campaign_of(rig, spectra_of(rig, hz, levels, rows, std))
    bare = Model(rig, {})
    base = evaluate(bare, campaign, bare.start, {})
    causes = (SupportFlexibility(), ClampRotation(), AddedMass())
    quick_fits = QuickFits(base, campaign)
    scores: Any = [SimpleNamespace(cause=c, drop=0.0, start={}, starts=()) for c in causes]
    seen = quick_fits.giving_way(scores)
    assert [s.cause.label for s in seen] == ["support-flexibility"]
    chi2, x = quick_fits.compared["support-flexibility"][0]
    assert chi2 <= SEEN * quick_fits.before
    at = bare.extended_by(causes[0]).values(x, 0)["stiffness"]
    assert abs(np.log10(at / stiffness)) <= near + 1e-9


@pytest.mark.parametrize("further", [None, "further"])
@pytest.mark.parametrize("near", [True, False])
def test_calibration_goes_on_from_where_a_cause_is_found(further: Any, near: bool) -> None:
    """It may have ended in a wrong valley, and a cause of no size have led out of it: whatever found that cause."""
    cause, raced = SimpleNamespace(name="over it as it is"), SimpleNamespace(name="raced")
    search: Any = SimpleNamespace(
        calibrated="stuck", first=SimpleNamespace(model=SimpleNamespace(calibrated={})), tried=9,
        over=lambda base: None, _settles=lambda e: near, _fits=lambda e: False, _over_tolerances=lambda e: [e],
        _race=lambda base, scores, done: Decision(base, raced, (raced,)), _calibrated_from=lambda found: further,
        _decided=lambda base, fits, tried: Decision(base, fits[0] if base == "stuck" else None, tuple(fits)),
    )  # fmt: skip
    search._first_over_calibrated = lambda exact: Search._first_over_calibrated(search, exact)
    found = Search._over_calibrated(search, Decision(Any, None, (cause,)))  # type: ignore[arg-type]
    told = cause if near else raced
    assert found.fits == (told,)
    assert (found.best, found.base, search.calibrated) == (
        (None, "further", "further") if further else (told, "stuck", "stuck")
    )


def test_a_contained_cause_starts_where_it_pushes_alike() -> None:
    """A resonator far above its own frequency is a spring of its own stiffness, far below it its mass."""
    rig, records = paper_rig(), [SimpleNamespace(hz=hz) for hz in (90.0, 100.0, 110.0)]
    campaign: Any = SimpleNamespace(data=SimpleNamespace(records=records))

    def size(frequency_hz: float, cause: Any) -> dict[str, float]:
        model = Model(rig, {}).extended_by(AttachedResonator())
        x = model.at({(0, "mass"): 0.02, (0, "frequency_hz"): frequency_hz, (0, "position"): 0.2})
        return same_force(Evaluation(model, x, {}, None, (), np.zeros(0)), 0, cause, campaign)  # type: ignore[arg-type]

    assert size(5.0, AddedSpring())["stiffness"] == pytest.approx(0.02 * (10.0 * np.pi) ** 2, rel=5e-3)
    assert size(2000.0, AddedMass())["mass"] == pytest.approx(0.02, rel=5e-3)
    assert size(5.0, ImpactStopCause()) == {}


def test_a_spring_close_to_the_support_is_one_that_resists_its_rotation() -> None:
    """By the lever that it has. One of 82 N m/rad was told as 16 000 N/m, 7 cm from the support."""
    rig, stiffness, lever = paper_rig(), 1.6e4, 0.02
    assert rig.beam is not None
    spring, turning = AddedSpring(), SupportRotationSpring()
    assert spring.contains == (turning.name,)
    model = Model(rig, {}).extended_by(spring)
    x = model.at({(0, "stiffness"): stiffness, (0, "position"): rig.beam.length - lever})
    found: Any = Evaluation(model, x, {}, None, (), np.zeros(0))  # type: ignore[arg-type]
    start = same_force(found, 0, turning, SimpleNamespace())  # type: ignore[arg-type]
    assert start["stiffness"] == pytest.approx(stiffness * lever**2)
    held = spring.extend(rig, {"stiffness": stiffness, "position": rig.beam.length - lever})
    rigs = (held, turning.extend(rig, start), rig)
    near, alike, free = (float(steady_state(beside, 40.0, harmonics=3)["drive"].peak) for beside in rigs)
    assert abs(alike - near) < 0.1 * abs(free - near)


@pytest.mark.parametrize(("tried", "fitted"), [((), ["added-spring"]), (("added-spring",), [])])
def test_what_a_cause_contains_is_fitted_from_where_that_stands(
    monkeypatch: pytest.MonkeyPatch, tried: tuple[str, ...], fitted: list[str]
) -> None:
    """A stop pressed so hard that it never opens is a spring."""
    rig = paper_rig()
    stop, spring = ImpactStopCause(), AddedSpring()
    model = Model(rig, {}).extended_by(stop)
    x = model.at({(0, "stiffness"): 1e4, (0, "gap"): -3e-4, (0, "position"): 0.2})
    best: Any = Evaluation(model, x, {}, None, (), np.zeros(0))  # type: ignore[arg-type]
    starts = list[tuple[str, dict[str, float]]]()

    def fit(model: Model, campaign: Any, x: Any, last: Any) -> Any:
        starts.append((model.label, model.values(x, 0)))
        return SimpleNamespace(model=model)

    monkeypatch.setattr("hbm.diagnosis.search.fit_model", fit)
    monkeypatch.setattr("hbm.diagnosis.search.refine", lambda e, campaign: e)
    fits = (best, *(SimpleNamespace(model=SimpleNamespace(label=label)) for label in tried))
    search: Any = SimpleNamespace(
        identified=False, candidates=(stop, spring, ClampRotation()), campaign=Campaign(None, None),  # type: ignore[arg-type]
        fitted=[], tried=1, _alike_in=lambda best: [], _decided=lambda base, fits, tried: (base, fits),
        _is_small_error=lambda e: False,
    )  # fmt: skip
    search._held_in = partial(Search._held_in, search)
    found: Any = SimpleNamespace(best=best, base="as it is", fits=fits)
    decided = Search._contained(search, found)
    assert [label for label, _ in starts] == fitted
    assert all(at == pytest.approx({"stiffness": 1e4, "position": 0.2}) for _, at in starts)
    assert decided == (("as it is", [*search.fitted, *fits]) if fitted else found)


def test_what_one_of_two_causes_contains_is_fitted_in_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """A play of nothing before friction is a Jenkins element of the same limit and stiffness."""
    backlash, damper, friction = LocalBacklash("tip"), LocalDamper("tip"), LocalFriction("tip")
    model = Model(RIG, {}).extended_by(damper).extended_by(backlash)
    x = model.at({(0, "coefficient"): 0.7, (1, "stiffness"): 2e4, (1, "limit"): 3.0, (1, "play"): 1e-12})
    best: Any = Evaluation(model, x, {}, None, (), np.zeros(0))  # type: ignore[arg-type]
    starts = list[tuple[str, dict[str, float], dict[str, float]]]()

    def fit(model: Model, campaign: Any, x: Any, last: Any) -> Any:
        starts.append((model.label, model.values(x, 0), model.values(x, 1)))
        return SimpleNamespace(model=model)

    monkeypatch.setattr("hbm.diagnosis.search.fit_model", fit)
    monkeypatch.setattr("hbm.diagnosis.search.refine", lambda e, campaign: e)
    search: Any = SimpleNamespace(
        candidates=(backlash, damper, friction, CubicStiffness("tip")), campaign=Campaign(None, None),  # type: ignore[arg-type]
        fitted=[], _alike_in=lambda best: [],
    )  # fmt: skip
    again = Search._held_in(search, best, [best])
    (told,) = starts
    assert told[0] == again[0].model.label == "local-damper tip + local-friction tip"
    assert told[1:] == ({"coefficient": pytest.approx(0.7)}, pytest.approx({"limit": 3.0, "critical_slip": 1.5e-4}))
    assert Search._held_in(search, best, [best, *again]) == []


def test_causes_that_are_not_believed_are_ranked_once_each(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fits of one cause from two starts end next to each other."""

    def fit(label: str, value: float) -> Any:
        model = SimpleNamespace(label=label, causes=(label,), calibrated=True)
        return SimpleNamespace(model=model, bic=value, missing=())

    again, first, other = fit("spring", 2.1), fit("spring", 2.0), fit("stop", 3.0)
    monkeypatch.setattr("hbm.diagnosis.search.beside", lambda e, campaign: e)
    monkeypatch.setattr("hbm.diagnosis.search.background_of", lambda e, campaign: {})
    monkeypatch.setattr("hbm.diagnosis.search.evidence", lambda e: e.bic)
    base = fit("", 9.0)
    search: Any = SimpleNamespace(
        tell=lambda *_: None,
        fitted=[again, other, first],
        nominal=base,
        calibrated=base,
        campaign=Campaign(None, None),  # type: ignore[arg-type]
        tolerable=lambda e: True,
        tried=3,
        _calibrated_too=lambda: [],
        _less_moved=lambda e: [],
        _accepted=lambda *_: False,
    )
    assert Search._beside_background(search).fits == (first, other)


@pytest.mark.parametrize(
    ("small", "above", "named"), [(True, 0.9, None), (True, 1.1, "thickness"), (False, 0.9, "thickness")]
)
def test_a_number_within_its_tolerance_that_does_as_well_leads_calibration_out_of_a_wrong_valley(
    small: bool, above: float, named: str | None
) -> None:
    """There a thickness was named for a modulus 0.3 % off, and the calibrated rig file missed what either left."""
    thickness: Any = SimpleNamespace(name="thickness", bic=100.0)
    modulus: Any = SimpleNamespace(name="modulus", bic=100.0 + above * DECISIVE)
    search: Any = SimpleNamespace(
        calibrated="stuck", tried=9, _held_in=lambda best, fits: [modulus], _is_small_error=lambda e: small,
        _calibrated_from=lambda e: e.name, _decided=lambda base, fits, tried: Decision(base, fits[-1], tuple(fits)),
        _within_tolerances=lambda found: Decision(search.calibrated, None, found.fits),
    )  # fmt: skip
    search._within = lambda: search.calibrated == "modulus"
    found = Search._contained(search, Decision("as it is", thickness, (thickness,)))  # type: ignore[arg-type]
    assert (found.best and found.best.name) == named  # type: ignore[attr-defined]
    assert search.calibrated == ("stuck" if named else "modulus")


def test_a_limit_is_lowered_from_where_the_cause_has_no_effect_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """A clamp that gives way beyond a moment, and is rigid below it, is not near one that yields throughout."""
    rig = paper_rig()
    model = Model(rig, {}).extended_by(ClampFriction())
    elastic: Any = SimpleNamespace(model=model, chi2=50.0, missing=())
    rigid: Any = SimpleNamespace(chi2=100.0, missing=())
    slips = SimpleNamespace(chi2=1.0, missing=())
    monkeypatch.setattr("hbm.diagnosis.quickfits.evaluate", lambda model, few, x, last: rigid)
    monkeypatch.setattr("hbm.diagnosis.quickfits.with_limits", lambda e, few, steps: [slips] if e is rigid else [])
    base: Any = SimpleNamespace(values={}, solutions={})
    assert _limited(base, None, 7, np.inf, [elastic]) == [slips, elastic]  # type: ignore[arg-type]
    assert _limited(base, None, 7, 10.0, [elastic]) == [elastic]  # type: ignore[arg-type]


def test_a_delay_found_beside_held_sensors_is_the_same_delay_beside_free_ones() -> None:
    """Its coordinate is not: a sensor that is held where calibration moved it gives it another scale."""
    cause = SensorDelay("x")
    own = Model(RIG, {}).extended_by(cause)
    held = Model(RIG.with_numbers({"channels.x.delay": 7e-6}), {}).extended_by(cause)
    found = held.at({(0, "delay_s"): 3.1e-5})
    x = own.at(Evaluation(held, found, {}, None, (), np.zeros(0)).values)  # type: ignore[arg-type]
    assert own.values(x, 0)["delay_s"] == pytest.approx(3.1e-5, rel=1e-12)
    assert not np.allclose(x[-1], found[-1])


@pytest.mark.parametrize(
    ("cause", "above", "named"),
    [
        (AddedMass(), 0.9 * BARE, False),
        (AddedMass(), 1.1 * BARE, True),
        (WrongParameter("beam.thickness"), 0.9 * DECISIVE, False),
        (WrongParameter("beam.thickness"), 1.1 * DECISIVE, True),
    ],
)
def test_in_place_of_many_small_errors_no_cause_is_taken_that_one_of_them_alone_does_for(
    cause: Any, above: float, named: bool
) -> None:
    """A thickness does nearly what Young's modulus does, and is a large error where that is a small one.

    One of 0.1 % was named for a modulus of 0.2 % where a background made the difference of 17 in BIC.
    """
    cause = SimpleNamespace(bic=100.0, model=SimpleNamespace(causes=(cause,)))
    search: Any = SimpleNamespace(
        nominal=None, calibrated="calibrated", _fits=lambda _: False, _enough=lambda _: True,
        _alone=lambda calibrated: [SimpleNamespace(bic=100.0 + above)],
    )  # fmt: skip
    search._alone_does = lambda best, margin: Search._alone_does(search, best, margin)
    found: Any = Decision("calibrated", None, (cause,))  # type: ignore[arg-type]
    assert Search._simpler_than(search, found) == ([cause] if named else [])


@pytest.mark.parametrize(("tolerable", "judged"), [(True, "calibrated"), (False, "as it is")])
def test_transients_are_offered_by_the_order_of_a_rig_file_within_its_tolerances(
    monkeypatch: pytest.MonkeyPatch, tolerable: bool, judged: str
) -> None:
    """Numbers gone astray bring an order of their own into what is missed."""
    mass, late = AddedMass(), NotSteady()
    monkeypatch.setattr("hbm.diagnosis.standing.disordered", lambda base, nominal, _: base == judged)
    monkeypatch.setattr("hbm.diagnosis.standing.screen", lambda base, _, offered: offered)
    search: Any = SimpleNamespace(
        candidates=[mass, late], nominal="as it is", campaign=None, tolerable=lambda _: tolerable
    )
    assert Search._screened(search, "calibrated") == [mass, late]  # type: ignore[arg-type]
    monkeypatch.setattr("hbm.diagnosis.standing.disordered", lambda base, nominal, _: base != judged)
    assert Search._screened(search, "calibrated") == [mass]  # type: ignore[arg-type]


def test_a_law_that_contains_the_best_one_beside_another_is_no_other_story() -> None:
    """Nor is the best one beside another; the richer law in its place is."""
    cubic, rich, stop = CubicStiffness("tip"), QuinticStiffness("tip"), OneSidedStop("tip")

    def fit(chi2: float, *causes: Any) -> Any:
        model = SimpleNamespace(causes=causes)
        return SimpleNamespace(model=model, chi2=chi2, x=np.ones(len(causes)), missing=())

    best = fit(100.0, cubic)
    others = [fit(99.9, rich), fit(99.8, stop, rich), fit(99.7, stop, cubic), fit(99.6, stop)]
    assert tied(others, best) == [others[0], others[3]]
