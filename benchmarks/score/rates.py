"""Rates over many cases, with what they are rates of and how sure they are."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from benchmarks.score.ceiling import Allowed, at
from benchmarks.score.rules import NAMING, Outcome, estimates, is_parameter

NORMAL_95 = 1.959964
SIZES = "right cause first, by effect and background"
RATIO = "right cause first, by effect over background"
RHO_BINS = ((0.0, 20.0), (20.0, 50.0), (50.0, 200.0), (200.0, 1000.0), (1000.0, np.inf))
STRONG = 20.0
"""Rho from which on parameters and physics should not be taken for each other."""

LACKS = 10.0
"""What the best model fitted leaves beyond noise, from which on an effect is seen to be outside the catalogue."""

EFFECT_BINS = ((0.0, 0.01), (0.01, 0.03), (0.03, 0.1), (0.1, np.inf))
BACKGROUND_BINS = ((0.0, 0.003), (0.003, 0.006), (0.006, np.inf))
LARGE = 5.0
DOMINANCE_BINS = ((LARGE, np.inf), (2.0, LARGE), (0.0, 2.0))
CONFIDENT = 0.9
CERTAIN = 0.995
VERDICTS = (*NAMING, "consistent", "unexplained")
HELD_OUT = 1.2
EXPLAINED = 0.9
CLOSE = 0.05
RELIABILITY_BINS, CALIBRATED_DRAWS = 10, 400

Array = np.ndarray


def wilson(k: int, n: int) -> tuple[float, float]:
    """95 % interval of a rate of k in n.

    >>> [round(x, 3) for x in wilson(8, 10)]
    [0.49, 0.943]
    """
    if n == 0:
        return 0.0, 1.0
    z2 = NORMAL_95**2
    middle = (k + z2 / 2) / (n + z2)
    half = NORMAL_95 * np.sqrt(k * (n - k) / n + z2 / 4) / (n + z2)
    return (0.0 if k == 0 else float(middle - half)), (1.0 if k == n else float(middle + half))


@dataclass(frozen=True)
class Row:
    """A line of the table: a rate `k` in `n` with its 95 % interval, or a number over `n` values.

    `ceiling` is what Fisher information allows in the same cases (those it knows), with the tolerances of the rig file,
    `exact` where the rig file is exact.
    """

    group: str
    name: str
    value: float | None
    n: int
    k: int | None = None
    low: float | None = None
    high: float | None = None
    ceiling: float | None = None
    exact: float | None = None

    def json(self) -> dict[str, object]:
        return asdict(self)


def rate(group: str, name: str, happened: Iterable[bool]) -> Row:
    seen = [bool(x) for x in happened]
    k, n = sum(seen), len(seen)
    low, high = wilson(k, n)
    return Row(group, name, k / n if n else None, n, k, low, high)


def number(group: str, name: str, values: Sequence[float], of: Callable[[Sequence[float]], float]) -> Row:
    return Row(group, name, float(of(values)) if len(values) else None, len(values))


def quantile(q: float) -> Callable[[Sequence[float]], float]:
    return lambda values: float(np.quantile(values, q))


def beside(row: Row, outcomes: Iterable[Outcome], best: Allowed, which: int = 0) -> Row:
    """The row with its ceiling: probability to be nearest (0), or number of ties (1)."""
    means = []
    for ceilings in (best.tolerances, best.exact):
        known = [at(c, o.rho)[which] for o in outcomes for c in [ceilings.get(o.answer["cause"])] if c is not None]
        means.append(float(np.mean(known)) if known else None)
    return replace(row, ceiling=means[0], exact=means[1])


def table(outcomes: Sequence[Outcome], best: Allowed) -> list[Row]:
    """Every row of the score; nulls, causes and what is outside the catalogue together in `outcomes`."""
    causes = [o for o in outcomes if o.kind == "cause-found"]
    nulls = [o for o in outcomes if o.kind == "consistent"]
    outside = [o for o in outcomes if o.kind == "unexplained"]
    return [
        *names(causes, best),
        *over_background(causes),
        *sets(causes, best),
        *alarms(nulls),
        *strangers(outside),
        *mistaken(causes),
        *parameters(causes),
        *remainders(causes),
        *held_out(causes),
        *confidence(outcomes),
        *cost(outcomes),
    ]


def names(causes: Sequence[Outcome], best: Allowed) -> list[Row]:
    group = "right cause first"

    def row(name: str, chosen: Sequence[Outcome]) -> Row:
        return beside(rate(group, name, (o.right for o in chosen)), chosen, best)

    rows = [row("all causes", causes)]
    rows += [row(bin_name(low, high), in_bin(causes, low, high)) for low, high in RHO_BINS]
    named = sorted({str(o.answer["cause"]) for o in causes})
    rows += [row(cause, [o for o in causes if o.answer["cause"] == cause]) for cause in named]
    for verdict in ("consistent", "unexplained", "failed"):
        rows.append(rate("causes not named", verdict, (o.verdict == verdict for o in causes)))
    return rows


def in_bin(outcomes: Sequence[Outcome], low: float, high: float) -> list[Outcome]:
    return [o for o in outcomes if low <= o.rho < high]


def bin_name(low: float, high: float) -> str:
    return f"rho < {high:g}" if low == 0 else f"rho > {low:g}" if np.isinf(high) else f"rho {low:g} to {high:g}"


def over_background(causes: Sequence[Outcome]) -> list[Row]:
    """By the size of the effect and of the imperfections, of the answers that say them, and by their ratio."""
    known = [(o, o.effect) for o in causes if o.effect is not None]
    ratios = [(o, o.dominance) for o in causes if o.dominance is not None]
    rows = []
    for low, high in EFFECT_BINS:
        here = [o for o, effect in known if low <= effect < high]
        name = f"effect {share_name(low, high)}"
        rows.append(rate(SIZES, f"{name}, no background", (o.right for o in here if not o.background)))
        for least, most in BACKGROUND_BINS:
            chosen = [o for o in here if least < o.background <= most]
            rows.append(rate(SIZES, f"{name}, background {share_name(least, most)}", (o.right for o in chosen)))
    for low, high in DOMINANCE_BINS:
        chosen = [o for o, ratio in ratios if low <= ratio < high or ratio == high == np.inf]
        name = f">= {low:g}" if np.isinf(high) else f"< {high:g}" if low == 0 else f"{low:g} to {high:g}"
        rows.append(rate(RATIO, name, (o.right for o in chosen)))
        beyond = [o for o in chosen if not o.tolerated]
        rows.append(rate(RATIO, f"{name}, but for numbers within tolerances", (o.right for o in beyond)))
    within = [o for o, _ in ratios if o.tolerated]
    rows.append(rate(RATIO, "numbers within tolerances, consistent", (o.verdict == "consistent" for o in within)))
    return rows


def share_name(low: float, high: float) -> str:
    return f"< {high:.1%}" if low == 0 else f"> {low:.1%}" if np.isinf(high) else f"{low:.1%} to {high:.1%}"


def sets(causes: Sequence[Outcome], best: Allowed) -> list[Row]:
    group = "cause and those not separable"
    named = [o for o in causes if o.named]
    return [
        rate(group, "hold the truth, all causes", (o.covered for o in causes)),
        rate(group, "hold the truth, where a cause is named", (o.covered for o in named)),
        beside(number(group, "mean number", [o.set_size for o in named], lambda v: float(np.mean(v))), named, best, 1),
        number(group, "largest number", [o.set_size for o in named], max),
    ]


def alarms(nulls: Sequence[Outcome]) -> list[Row]:
    group = "false alarms on nulls"
    rows = []
    for what, chosen in (
        ("", nulls),
        (", no background", [o for o in nulls if not o.background]),
        (", background", [o for o in nulls if o.background]),
    ):
        rows.append(rate(group, f"a cause named{what}", (o.named for o in chosen)))
        rows.append(rate(group, f"unexplained{what}", (o.verdict == "unexplained" for o in chosen)))
    rows += [rate(group, verdict, (o.verdict == verdict for o in nulls)) for verdict in ("main-cause", "failed")]
    return rows


def strangers(outside: Sequence[Outcome]) -> list[Row]:
    group = "outside the catalogue"
    lacking = [o for o in outside if o.lacks >= LACKS]
    large = [o for o in outside if o.dominance is not None and o.dominance >= LARGE]
    return [
        rate(group, "right", (o.right for o in outside)),
        rate(group, f"right, effect >= {LARGE:g} x background", (o.right for o in large)),
        rate(group, "and but for clocks within tolerances", (o.right for o in large if not o.tolerated)),
        rate(group, "called unexplained", (o.verdict == "unexplained" for o in outside)),
        rate(group, f"called unexplained, lack of fit >= {LACKS:g}", (o.verdict == "unexplained" for o in lacking)),
        *(
            rate(group, f"{verdict}, structured rest above the background", (seen(o, verdict) for o in outside))
            for verdict in NAMING
        ),
        rate(group, "called consistent", (o.verdict == "consistent" for o in outside)),
        rate(group, "a name", (o.named for o in outside)),
        rate(group, f"a name with confidence >= {CONFIDENT}", (confident(o) for o in outside)),
    ]


def seen(o: Outcome, verdict: str) -> bool:
    return o.verdict == verdict and o.rest_seen


def confident(o: Outcome) -> bool:
    return o.named and o.confidence >= CONFIDENT


def mistaken(causes: Sequence[Outcome]) -> list[Row]:
    group = f"mistaken, rho >= {STRONG:g}"
    strong = [o for o in causes if o.rho >= STRONG]
    swaps = [(is_parameter(o.answer["cause"]), o.named and is_parameter(o.said["cause"]), o.named) for o in strong]
    return [
        rate(group, "parameter for physics or the reverse", (named and a != b for a, b, named in swaps)),
        rate(group, "wrong parameter called physics", (named and not b for a, b, named in swaps if a)),
        rate(group, "physics called a wrong parameter", (named and b for a, b, named in swaps if not a)),
        rate(group, f"wrong name with confidence >= {CONFIDENT}", (confident(o) and not o.right for o in strong)),
    ]


def parameters(causes: Sequence[Outcome]) -> list[Row]:
    group = "parameters of causes rightly named"
    pairs = [(o, e) for o in causes if o.right for e in estimates(o)]
    found = [e for _, e in pairs]
    values, changes = [e.of_value for e in found], [e.of_change for e in found if e.of_change is not None]
    rows = []
    for what, errors in (("value", values), ("change", changes)):
        rows += [
            number(group, f"relative error of the {what}, median", errors, quantile(0.5)),
            number(group, f"relative error of the {what}, 90 %", errors, quantile(0.9)),
            rate(group, f"{what} within {CLOSE:.0%}", (e <= CLOSE for e in errors)),
        ]
    for what, chosen in (
        ("", found),
        (", no background", [e for o, e in pairs if not o.background]),
        (", background", [e for o, e in pairs if o.background]),
    ):
        pulls = [e.z for e in chosen if e.z is not None]
        rows += [
            rate(group, f"within 2 std{what}", (abs(z) < 2 for z in pulls)),
            number(group, f"std of pulls{what}", pulls, lambda v: float(np.std(v))),
            number(group, f"1.48 median size of pulls{what}", pulls, lambda v: float(1.4826 * np.median(np.abs(v)))),
        ]
    return rows


def remainders(causes: Sequence[Outcome]) -> list[Row]:
    """What is said to be left of the response beside the true imperfections, where the name is right."""
    group = "remainder of causes rightly named"
    told = [o for o in causes if o.right and o.background and "size" in o.remainder]
    ratios = [float(o.remainder["size"]) / o.background for o in told]
    return [number(group, "size over the true background, median", ratios, quantile(0.5))]


def held_out(causes: Sequence[Outcome]) -> list[Row]:
    group = "records held out, cause named"
    named = [o for o in causes if o.named]
    explained = [e for o in named for e in [o.explained] if e is not None]
    misfits = [m for o in named for m in [o.held_out("extended")] if m is not None]
    return [
        number(group, "explained fraction, median", explained, quantile(0.5)),
        rate(group, f"explained fraction >= {EXPLAINED}", (e >= EXPLAINED for e in explained)),
        rate(group, f"reduced chi2 <= {HELD_OUT}", (m <= HELD_OUT for m in misfits)),
    ]


def confidence(outcomes: Sequence[Outcome]) -> list[Row]:
    group = "calibration of confidence"
    rows = []
    for what, chosen in (("causes named", [o for o in outcomes if o.named]), ("all verdicts", list(outcomes))):
        seen = [o for o in chosen if not o.failed]
        stated, right = np.array([o.confidence for o in seen]), np.array([o.right for o in seen], dtype=float)
        error = calibration_error(stated, right) if seen else None
        rows.append(Row(group, f"expected calibration error, {what}", error, len(seen)))
        chance = f"the same by chance alone, {what}"
        rows.append(number(group, chance, [float(c) for c in stated], error_if_calibrated))
    certain = [o for o in outcomes if not o.failed and o.confidence >= CERTAIN]
    return [*rows, rate(group, f"wrong of those stated at >= {CERTAIN}", (not o.right for o in certain))]


def reliability(outcomes: Sequence[Outcome]) -> list[tuple[float, float, int]]:
    """Mean confidence, share right and number, by tenths of the confidence."""
    seen = [o for o in outcomes if not o.failed]
    return by_tenths(np.array([o.confidence for o in seen]), np.array([o.right for o in seen], dtype=float))


def by_tenths(stated: Array, right: Array) -> list[tuple[float, float, int]]:
    """Mean confidence, share right and number, of confidences stated and whether each was right."""
    places = np.minimum((stated * RELIABILITY_BINS).astype(int), RELIABILITY_BINS - 1)
    bins = [places == i for i in range(RELIABILITY_BINS)]
    return [(float(stated[b].mean()), float(right[b].mean()), int(b.sum())) for b in bins if b.any()]


def calibration_error(stated: Array, right: Array) -> float:
    """Mean distance of the share right from the confidence, by tenths."""
    return sum(n * abs(said - was) for said, was, n in by_tenths(stated, right)) / max(len(stated), 1)


def error_if_calibrated(stated: Sequence[float]) -> float:
    """What that error is on the mean, over draws, if each verdict is right as often as it says: chance of few cases.

    >>> bool(error_if_calibrated([0.9] * 10) > 3 * error_if_calibrated([0.9] * 1000))
    True
    """
    c, rng = np.array(stated), np.random.default_rng(7)
    return float(np.mean([calibration_error(c, rng.random(len(c)) < c) for _ in range(CALIBRATED_DRAWS)]))


def cost(outcomes: Sequence[Outcome]) -> list[Row]:
    group = "runs"
    rows = [rate(group, "failed", (o.failed for o in outcomes))]
    for verdict in (None, *VERDICTS):
        chosen = [o for o in outcomes if (not o.failed if verdict is None else o.verdict == verdict)]
        for what, key in (("seconds", "seconds"), ("seconds of processor", "cpu_seconds")):
            spent = [float(o.result[key]) for o in chosen]
            kind = "" if verdict is None else f", {verdict}"
            rows += [
                number(group, f"{what}, median{kind}", spent, quantile(0.5)),
                number(group, f"{what}, largest{kind}", spent, max),
            ]
    return rows


def confusion(outcomes: Sequence[Outcome]) -> Counter[tuple[str, str]]:
    """Cases by truth and by what was said; the truth outside the catalogue by what it is, wrong channels apart."""
    return Counter((truth_of(o), said_of(o)) for o in outcomes)


def truth_of(o: Outcome) -> str:
    return str(o.answer["cause"] or o.answer["drawn"] or "null")


def said_of(o: Outcome) -> str:
    if not o.named:
        return o.verdict
    name = str(o.said["cause"])
    return name if o.right or name != o.answer["cause"] else f"{name}, elsewhere"
