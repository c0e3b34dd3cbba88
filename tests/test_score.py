"""What the score of the diagnosis calls right, and its rates, on made-up results and closed forms."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm

from benchmarks.score import ceiling, figures, page, rates, region, run, sets
from benchmarks.score.ceiling import Allowed, Ceiling, Direction, Signatures
from benchmarks.score.rules import Outcome, estimates, fits_label
from hbm.measurement.spectra import spectra_of
from models.published import paper_rig

RIG = {
    "beam": {"youngs_modulus": 200e9},
    "excitation": {"position": 0.3},
    "channels": [{"name": "force", "position": 0.5}, {"name": "a3", "position": 0.2}],
}
NONE = Allowed({}, {})
VALIDATION = Path(__file__).parents[1] / "docs" / "validation"


def estimate(value, std=None):
    return {"value": value} if std is None else {"value": value, "std": std, "unit": "1"}


def outcome(
    truth, named=None, *, true=None, found=None, verdict=None, rho=100.0, lacks=100.0, seconds=20.0, sizes=(), **more
):
    """One case: the hidden cause (None: nothing; "outside ..."), sizes of background and effect, and what was said."""
    outside = str(truth).startswith("outside")
    kind = "consistent" if truth is None else "unexplained" if outside else "cause-found"
    answer = {
        "verdict": kind, "cause": truth if kind == "cause-found" else None, "drawn": truth,
        "parameters": true or {}, "rho": rho if truth else 0.0, "rig_seed": 1,
    } | dict(zip(("background", "effect"), sizes, strict=False))  # fmt: skip
    said = {
        "verdict": verdict or ("cause-found" if named else "consistent"), "cause": named, "parameters": found or {},
        "confidence": 0.99, "not_separable": [], "errors": {},
    } | more  # fmt: skip
    took = {"seconds": seconds, "cpu_seconds": 0.9 * seconds}
    return Outcome("0001", {"case": "0001", "diagnosis": said, "lack_of_fit": lacks} | took, answer, RIG)


def row(rows, group, name):
    return next(r for r in rows if r.group.startswith(group) and r.name.startswith(name))


# ---- rules


@pytest.mark.parametrize(
    ("truth", "true", "named", "found", "right"),
    [
        ("added-mass", {"mass": 0.1}, "added-mass", {}, True),
        ("added-mass", {"mass": 0.1}, "added-spring", {}, False),
        ("parameter:beam.length", {"value": 1.0}, "parameter:beam.length", {}, True),
        ("parameter:beam.length", {"value": 1.0}, "parameter:beam.density", {}, False),
        ("sensor-gain", {"channel": "a3"}, "sensor-gain", {"channel": estimate("a3")}, True),
        ("sensor-gain", {"channel": "a3"}, "sensor-gain", {"channel": estimate("a2")}, False),
        ("sensor-gain", {"channel": "a3"}, "sensor-delay", {"channel": estimate("a3")}, False),
        ("swapped-channels", {"channel": "a1", "other": "a2"}, "swapped-channels",
         {"channel": estimate("a2"), "other": estimate("a1")}, True),
        ("swapped-channels", {"channel": "a1", "other": "a2"}, "swapped-channels",
         {"channel": estimate("a2"), "other": estimate("a3")}, False),
        ("drift", {"parameter": "beam.length"}, "drift", {"parameter": estimate("beam.length")}, True),
        ("drift", {"parameter": "beam.length"}, "drift", {"parameter": estimate("contact.radius")}, False),
    ],
)  # fmt: skip
def test_a_name_is_right_with_what_belongs_to_it(truth, true, named, found, right):
    assert outcome(truth, named, true=true, found=found).right is right


def test_verdicts_without_a_name():
    assert outcome(None).right
    assert not outcome(None, "added-mass").right
    assert not outcome(None, verdict="unexplained").right
    assert outcome("outside magnet", verdict="unexplained").right
    assert not outcome("outside magnet").right
    assert not outcome("added-mass", verdict="consistent").right
    failed = Outcome("0001", {"case": "0001", "failed": "no steady state"}, outcome(None).answer, RIG)
    assert (failed.verdict, failed.right, failed.named, failed.covered) == ("failed", False, False, False)


def left(size, structured=True):
    return {"size": size, "structured": structured, "explained": {"train": 0.9, "held_out": 0.9}}


def test_a_main_cause_is_a_name():
    assert outcome("added-mass", "added-mass", verdict="main-cause").right
    assert not outcome("added-mass", "added-spring", verdict="main-cause").right
    assert outcome("added-mass", "drift", verdict="main-cause", not_separable=["added-mass"]).covered
    alarm = outcome(None, "added-mass", verdict="main-cause")
    assert alarm.named and not alarm.right


@pytest.mark.parametrize("verdict", ["cause-found", "main-cause"])
def test_a_name_outside_the_catalogue_needs_a_rest_above_the_background(verdict):
    def right(remainder, background):
        stranger = "outside magnet"
        return outcome(stranger, "drift", verdict=verdict, sizes=(background, 0.1), remainder=remainder).right

    assert right(left(0.02), 0.01) and right(left(0.02), 0.0)
    assert not right(left(0.005), 0.01)
    assert not right(left(0.02, structured=False), 0.01)
    assert not right(None, 0.0)


def test_answers_without_sizes_still_count():
    old = outcome("added-mass", "added-mass")
    assert (old.background, old.effect, old.dominance) == (0.0, None, np.inf)
    assert outcome("added-mass", sizes=(0.01, 0.03)).dominance == pytest.approx(3.0)
    assert outcome("added-mass", sizes=(0.01,)).dominance is None


def test_a_number_that_calibration_may_move_is_told_apart():
    def tolerated(cause, value):
        return outcome(cause, true={"value": value}).tolerated

    assert tolerated("parameter:beam.youngs_modulus", 206e9)  # three tolerances of 1 %
    assert not tolerated("parameter:beam.youngs_modulus", 208e9)
    assert not tolerated("parameter:beam.length", 0.5)  # has none
    assert tolerated("parameter:excitation.position", 0.3015)  # three tolerances of 0.5 mm
    assert not tolerated("parameter:excitation.position", 0.302)
    assert not outcome("added-mass", true={"mass": 0.1}).tolerated
    assert not outcome(None).tolerated

    def clock(ratio):
        return replace(
            outcome(None), answer={"cause": None, "drawn": "clock", "parameters": {"ratio": ratio}}
        ).tolerated

    assert clock(0.985) and not clock(1.02)  # of a modulus off by 3 % and 4 %


def test_truth_among_those_not_separable():
    tied = outcome("added-mass", "added-spring", not_separable=["parameter:beam.density", "added-mass"])
    assert tied.covered and not tied.right and tied.set_size == 3
    assert not outcome("added-mass", "added-spring", not_separable=["drift"]).covered
    assert not outcome("added-mass", verdict="unexplained", not_separable=["added-mass"]).covered
    gain = outcome("sensor-gain", true={"channel": "a3"}).answer
    assert [fits_label(x, gain) for x in ("sensor-gain", "sensor-gain a3", "sensor-gain a1")] == [True, True, False]


def test_errors_of_parameters_and_of_their_change():
    key = "parameter:beam.youngs_modulus"
    young = outcome(key, key, true={"value": 210e9}, found={"value": estimate(209e9, 0.5e9)})
    (e,) = estimates(young)
    assert e.of_value == pytest.approx(1 / 210) and e.of_change == pytest.approx(0.1) and e.z == pytest.approx(-2.0)
    gain = {"channel": "a3", "gain": 1.04}
    (e,) = estimates(
        outcome(
            "sensor-gain", "sensor-gain", true=gain, found={"channel": estimate("a3"), "gain": estimate(1.02, 0.01)}
        )
    )
    assert e.of_change == pytest.approx(0.5)
    moved = {"channel": "a3", "position": 0.21}
    (e,) = estimates(
        outcome(
            "sensor-position", "sensor-position", true=moved,
            found={"channel": estimate("a3"), "position": estimate(0.211, 0.0)},
        )
    )  # fmt: skip
    assert e.of_change == pytest.approx(0.1) and e.z is None


def test_explained_share_of_the_excess():
    errors = {"calibrated": {"held_out": {"chi2_reduced": 11.0}}, "extended": {"held_out": {"chi2_reduced": 1.5}}}
    assert outcome("added-mass", "added-mass", errors=errors).explained == pytest.approx(0.95)
    nothing = {"calibrated": {"held_out": {"chi2_reduced": 1.0}}, "extended": {"held_out": {"chi2_reduced": 1.0}}}
    assert outcome("added-mass", "added-mass", errors=nothing).explained is None


# ---- rates


def test_wilson_is_the_published_one():
    """Newcombe 1998, Statistics in Medicine 17:857, table I, method 3."""
    for k, n, low, high in ((81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611)):
        assert rates.wilson(k, n) == pytest.approx((low, high), abs=5e-5)
    assert rates.wilson(29, 29) == pytest.approx((0.8830, 1.0), abs=5e-5)


def test_table_counts_what_it_says():
    found = [
        outcome("added-mass", "added-mass", rho=10.0),
        outcome("added-mass", "added-spring", rho=100.0, not_separable=["added-mass"]),
        outcome("added-mass", "parameter:beam.length", rho=100.0),
        outcome("parameter:beam.length", "added-mass", rho=100.0, true={"value": 1.0}, confidence=0.4),
        outcome("parameter:beam.length", rho=19.0, true={"value": 1.0}),
        *(outcome(None) for _ in range(7)),
        outcome(None, "added-mass"),
        outcome(None, verdict="unexplained"),
        outcome("outside magnet", verdict="unexplained"),
        outcome("outside magnet", "added-mass"),
        outcome("outside magnet", lacks=3.0),
    ]
    rows = rates.table(found, Allowed({"added-mass": Ceiling((1.0,) * 10, (2.0,) * 10)}, {}))

    def counted(group, name):
        r = row(rows, group, name)
        return r.k, r.n

    assert counted("right cause", "all causes") == (1, 5)
    assert counted("right cause", "rho < 20") == (1, 2)
    assert counted("right cause", "added-mass") == (1, 3)
    assert counted("cause and those", "hold the truth, all") == (2, 5)
    assert counted("cause and those", "hold the truth, where") == (2, 4)
    assert row(rows, "cause and those", "mean").value == pytest.approx(5 / 4)
    assert counted("false alarms", "a cause named") == (1, 9)
    assert counted("false alarms", "unexplained") == (1, 9)
    assert counted("false alarms", "a cause named, background") == (0, 0)
    assert counted("outside", "right") == (1, 3)
    assert counted("outside", "called unexplained") == (1, 3)
    assert counted("outside", "called unexplained, lack of fit") == (1, 2)
    assert counted("outside", "a name with") == (1, 3)
    assert counted("mistaken", "parameter for physics") == (2, 3)
    assert counted("mistaken", "wrong parameter") == (1, 1)
    assert counted("mistaken", "physics called") == (1, 2)
    assert counted("mistaken", "wrong name with") == (2, 3)
    assert row(rows, "right cause", "added-mass").ceiling == 1.0
    assert row(rows, "right cause", "parameter:").ceiling is None
    json.dumps([r.json() for r in rows], allow_nan=False)
    lines = page.markdown({"set": "E"}, rows, {}).splitlines()
    assert "| all causes | 0.200 | 1/5 | 0.036 to 0.624 | 1 |  |" in lines
    assert "| a cause named | 0.111 | 1/9 | 0.020 to 0.435 |" in lines


def test_confidence_that_keeps_its_word():
    """Of ten named with confidence 0.8 eight are right; with 0.3 none are."""
    sure = [outcome("added-mass", "added-mass" if i < 8 else "drift", confidence=0.8) for i in range(10)]
    assert row(rates.confidence(sure), "calibration", "expected").value == pytest.approx(0.0)
    unsure = [outcome("added-mass", "drift", confidence=0.3) for _ in range(10)]
    assert row(rates.confidence(sure + unsure), "calibration", "expected").value == pytest.approx(0.15)


def test_calibration_error_of_few_cases_that_chance_makes():
    """Of n verdicts stated at c, the share right is off by sqrt(2 c (1 - c) / (pi n)) on the mean."""
    for n in (40, 400):
        by_chance = rates.error_if_calibrated([0.6] * n)
        assert by_chance == pytest.approx(np.sqrt(2 * 0.6 * 0.4 / (np.pi * n)), rel=0.1)


def test_region_of_names_is_what_the_scores_it_cites_say():
    """The page is made of the archived scores that it links, and adds up those of one set."""
    written = (VALIDATION / "region.md").read_text(encoding="utf-8")
    cited = [VALIDATION / name for name in re.findall(r"\]\((archive/[^)]+)\)", written)]
    assert cited and region.markdown(region.regions(cited)) == written
    twice = region.regions([cited[0], cited[0]])
    once = region.regions(cited[:1])
    for which, found in once.items():
        assert twice[which].cases == 2 * found.cases
        assert all(twice[which].tried[key] == 2 * n for key, n in found.tried.items())
    with pytest.raises(ValueError, match="must be a score"):
        region.regions([VALIDATION / "scores.md"])


def test_bins_of_effect_and_background():
    found = [
        outcome("added-mass", "added-mass", sizes=(0.0, 0.02)),
        outcome("added-mass", "added-mass", verdict="main-cause", sizes=(0.002, 0.02), remainder=left(0.003)),
        outcome("added-mass", "drift", sizes=(0.004, 0.02)),
        outcome("added-mass", "added-mass", sizes=(0.01, 0.015), remainder=left(0.02)),
        outcome("added-mass", "added-mass"),
    ]
    rows = rates.table(found, NONE)

    def counted(group, name):
        r = row(rows, group, name)
        return r.k, r.n

    sizes, ratio = "right cause first, by effect and", "right cause first, by effect over"
    assert counted(sizes, "effect 1.0% to 3.0%, no background") == (1, 1)
    assert counted(sizes, "effect 1.0% to 3.0%, background < 0.3%") == (1, 1)
    assert counted(sizes, "effect 1.0% to 3.0%, background 0.3% to 0.6%") == (0, 1)
    assert counted(sizes, "effect 1.0% to 3.0%, background > 0.6%") == (1, 1)
    assert sum(r.n for r in rows if r.group.startswith(sizes)) == 4
    assert [counted(ratio, name) for name in (">= 5", "2 to 5", "< 2")] == [(3, 4), (0, 0), (1, 1)]
    assert row(rows, "remainder of causes", "size over").value == pytest.approx((1.5 + 2.0) / 2)
    apart = [outcome("outside magnet", "drift", verdict="main-cause", sizes=(0.01, 0.1), remainder=left(0.02))]
    rows = rates.table([*apart, outcome("outside magnet", verdict="unexplained")], NONE)
    assert counted("outside", "right") == (2, 2)
    assert counted("outside", "called unexplained") == (1, 2)
    assert counted("outside", "main-cause, structured rest") == (1, 2)
    assert counted("outside", "cause-found, structured rest") == (0, 2)


def test_pulls_with_and_without_background():
    def found(error, background):
        true, said = {"mass": 0.1}, {"mass": estimate(0.1 + error, 0.01)}
        return outcome("added-mass", "added-mass", true=true, found=said, sizes=(background, 0.1))

    rows = rates.parameters([found(0.0, 0.0), found(0.015, 0.0), found(0.05, 0.01), found(0.01, 0.01)])
    within = {name: row(rows, "parameters", f"within 2 std{name}") for name in ("", ", no background", ", background")}
    assert {name: (r.k, r.n) for name, r in within.items()} == {
        "": (3, 4), ", no background": (2, 2), ", background": (1, 2),
    }  # fmt: skip
    assert row(rows, "parameters", "std of pulls, background").value == pytest.approx(2.0)


def test_certain_and_wrong_and_what_it_cost():
    sure = [outcome("added-mass", "drift", confidence=0.999), outcome("added-mass", "added-mass", confidence=0.996)]
    slow = outcome("added-mass", "added-mass", verdict="main-cause", confidence=0.99, seconds=50.0)
    certain = row(rates.confidence([*sure, slow]), "calibration", "wrong of those stated")
    assert (certain.k, certain.n) == (1, 2)
    rows = rates.cost([*sure, slow])
    assert row(rows, "runs", "seconds, median, cause-found").value == 20.0
    assert row(rows, "runs", "seconds of processor, largest, main-cause").value == 45.0
    assert row(rows, "runs", "seconds, largest, unexplained").value is None
    assert row(rows, "runs", "seconds, largest").value == 50.0


def test_confusion_keeps_wrong_channels_apart():
    found = [
        outcome("sensor-gain", "sensor-gain", true={"channel": "a3"}, found={"channel": estimate(name)})
        for name in ("a3", "a2", "a2")
    ]
    assert rates.confusion(found) == {
        ("sensor-gain", "sensor-gain"): 1,
        ("sensor-gain", "sensor-gain, elsewhere"): 2,
    }
    drawn = figures.confusion_figure([*found, outcome(None)], "made up")
    texts = {t.get_text() for t in drawn.axes[0].texts}
    assert {"1", "2", "measurement", "null"} <= texts


# ---- ceiling


def two(angle, sign=0):
    """Two causes whose signatures make this angle."""
    raw = np.array([[1.0, np.cos(angle)], [0.0, np.sin(angle)], [0.0, 0.0]])
    return Signatures((Direction("a", "a", 0, sign), Direction("b b1", "b", 0, sign)), raw, raw)


def test_ceiling_of_two_causes_is_the_closed_form():
    """|z_a| > |z_b|: (z_a - z_b)(z_a + z_b) > 0, two independent normals of means rho (1 -+ c) / sqrt(2 (1 -+ c))."""
    angle = 0.4
    c = np.cos(angle)
    found = ceiling.ceilings(two(angle), two(angle), np.random.default_rng(1))
    for i, rho in enumerate(ceiling.RHO[:3]):
        above = [norm.cdf(rho * np.sqrt((1 + s * c) / 2)) for s in (-1, 1)]
        expected = above[0] * above[1] + (1 - above[0]) * (1 - above[1])
        tolerance = 4 * np.sqrt(expected * (1 - expected) / ceiling.DRAWS) + 1e-3
        assert found["a"].top1[i] == pytest.approx(expected, abs=tolerance)
    assert found["a"].ties[0] > 1.5 and found["a"].ties[-1] == 1.0


def test_ceiling_counts_what_tolerances_leave():
    """A cause of which tolerances leave a hundredth is as hard to name as one a hundredth as long."""
    whole = two(1.2)
    hidden = Signatures(whole.directions, whole.raw, 0.01 * whole.raw)
    rng = np.random.default_rng(2)
    near, far = ceiling.ceilings(hidden, whole, rng)["a"], ceiling.ceilings(whole, whole, rng)["a"]
    assert near.top1[ceiling.RHO.index(1000.0)] == pytest.approx(far.top1[ceiling.RHO.index(10.0)], abs=0.05)
    assert near.top1[0] < 0.75 < far.top1[0]
    assert ceiling.at(near, 30.0)[0] == pytest.approx(np.interp(np.log(30), np.log([20, 50]), near.top1[2:4]))
    both = Allowed({"a": near}, {"a": far})
    assert ceiling.average([both.json(), both.json()]) == both


def test_what_is_not_seen_is_never_named():
    whole = two(1.2)
    part = Signatures(whole.directions[:1], whole.raw[:, :1], whole.left[:, :1])
    found = ceiling.ceilings(part, whole, np.random.default_rng(3))
    assert set(found["b"].top1) == {0.0} and set(found["a"].top1) == {1.0}


# ---- sets and runs


def spectra():
    """Two bands and levels of the paper's rig, two sensors, two harmonics."""
    rig = paper_rig()
    sensors = [c.name for c in rig.channels if c.quantity != "force"][:2]
    assert len(sensors) == 2, "the rig needs two sensors"
    hz, level = np.array([48.0, 52.0, 50.0, 52.0, 150.0, 160.0]), np.array([2.0, 2.0, 6.0, 6.0, 3.0, 9.0])
    rng = np.random.default_rng(3)
    names = ("force", *sensors)
    coefficients = {n: np.concatenate([np.zeros((6, 1)), rng.uniform(1, 2, (6, 4))], axis=1) for n in names}
    return rig, spectra_of(rig, hz, level, coefficients, {n: np.full((6, 3), 1e-4) for n in names})


def test_poorer_sets_leave_out_what_they_say():
    rig, whole = spectra()
    made = {which: sets.poorer(which, rig, whole, 1, "0001") for which in sets.SETS}
    assert made["E"] is whole
    assert made["D"].hz.max() == 52.0 and len(made["D"]) == 4 and made["D"].H == 2
    assert np.isfinite(made["C"].std).sum() == 4 * 3 * 1
    assert set(made["A"].level) == {6.0} and len(made["A"].channels) == 2 and "force" in made["A"].channels
    assert set(made["one-level"].level) == {6.0} and made["one-level"].channels == whole.channels
    assert len(made["one-sensor"]) == 6 and len(made["one-sensor"].channels) == 2
    again = sets.poorer("one-sensor", rig, whole, 1, "0001")
    assert again.channels == made["one-sensor"].channels
    assert {sets.poorer("A", rig, whole, 1, f"{n}").channels[1] for n in range(20)} == set(whole.channels[1:])


def test_added_noise_is_what_its_std_says():
    rig, whole = spectra()
    noisy = sets.poorer("40dB", rig, whole, 1, "0001")
    largest = np.abs(whole.complex(whole.channels[1])[:, 1]).max()
    np.testing.assert_allclose(noisy.std[:, 1], 0.01 * largest)
    np.testing.assert_allclose(noisy.std[:, 0], 0.001 * np.abs(whole.complex("force")[:, 1]).max())
    scores = (noisy.coefficients - whole.coefficients)[:, 1:] / noisy.std[:, 1:, :1]
    assert 0.75 < scores.std() < 1.25


def test_what_fails_is_recorded(tmp_path):
    (tmp_path / "data" / "0007").mkdir(parents=True)
    out = tmp_path / "results"
    lines = list(run.run_all([tmp_path / "data" / "0007"], out, "E", 1, 1))
    assert len(lines) == 1 and "failed" in lines[0]
    written = json.loads((out / "0007.json").read_text())
    assert "rig.toml" in written["failed"] and written["case"] == "0007"
    assert list(run.run_all([tmp_path / "data" / "0007"], out, "E", 1, 1)) == []
