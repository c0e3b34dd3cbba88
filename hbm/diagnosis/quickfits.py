"""Quick fits of candidates: on few records, a coarse discretisation, some steps from the best of many starts."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import pairwise, product

import numpy as np
from scipy.optimize import minimize_scalar

from hbm.diagnosis.calibrate import lighter
from hbm.diagnosis.decide import held_by
from hbm.diagnosis.screen import coarse, telling
from hbm.diagnosis.signatures import Score, starting
from hbm.fourier import Array
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation, evaluate
from hbm.outputerror.fit import MANY, Descent, begun_at, best_start, descended, fit_model
from hbm.outputerror.model import Model
from hbm.outputerror.simulated import FAILURES, Solutions
from hbm.parallel import each
from models.causes.cause import Cause, Unknown

RECORDS = 6
"""Records that a quick fit sees."""

MISSED = 1.5
"""Mean square misfit from which on a record shows something."""

STARTS, STEPS = 2, 7
"""Starts from which steps are taken, and how many."""

SETTLED, PART = 1.0, 0.01
"""They end when chi2 would fall by less than this, or by less than this part of its excess."""

AT_ONCE = 4
"""Candidates that run, side by side where there is an executor, before their outcome is looked at."""

CLOSE = 30.0
"""Fits are close whose chi2 differs by less."""

CHANCE = 4.0
"""Fall of chi2 of few records that noise alone gives one or two more numbers."""

VALLEYS, APART = 2, 3.0
"""Other valleys that are fitted to all records, at most; fits stand in different ones that differ by more than so many
standard deviations."""

PROMISING = 0.3
"""Steps are taken from next to no effect too where the score test sees this share of the misfit fall, or where every
start does harm."""

DENSE, DENSER, ROUNDING = 10.0**0.5, 10.0**0.125, 1e-9
"""Starts of how strong an effect is that nothing else shapes are at most this factor apart; of a stiffness that the rig
file takes for rigid the second one: by less a resonance may move by its width."""

SEEN = 0.5
"""An effect is seen at once whose best start leaves at most this share of the misfit."""

SECOND, WORSE = 3.0, 10.0
"""The second start is tried where its chi2 is within this factor of the best, and none where it is so many times what
it was before."""

UNTOUCHED = 1e-3
"""Share by which chi2 changes at most where a limit is not reached."""

BETWEEN = {"maxiter": 10, "xatol": 0.005}
"""How the best value of a limit between two is looked for."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A candidate after a quick fit: chi2 as far as it is known, where it stands, and where it may stand as well."""

    cause: Cause
    chi2: float
    x: Array
    others: tuple[Array, ...] = ()


def needless(rich: Candidate, others: Sequence[Candidate]) -> bool:
    """Whether a candidate holds a simpler one that leaves hardly more: noise alone gives further numbers as much."""
    held = held_by(rich.cause) - {rich.cause.label}
    return any(r.cause.label in held and r.chi2 - rich.chi2 < CHANCE for r in others)


Starts = list[tuple[float, Array]]
"""Chi2 and where, the one to try first at the beginning."""

Begun = tuple[str, bytes]
"""A candidate, and where steps began."""


@dataclass(frozen=True, eq=False)
class QuickFits:
    """Quick fits of candidates, each on one core; none is made again.

    Attributes
    ----------
    base : Evaluation
        What they are fitted over.
    campaign : Campaign
    compared : dict of str to Starts
        Starts of the candidates that were looked at.
    given : dict of str to tuple of dict
        What their scores had them start from.
    descents : dict of Begun to Descent or None
        Steps taken so far; None where there is no steady state.
    """

    base: Evaluation
    campaign: Campaign
    compared: dict[str, Starts] = field(default_factory=dict)
    given: dict[str, tuple[dict[str, float], ...]] = field(default_factory=dict)
    descents: dict[Begun, Descent | None] = field(default_factory=dict)

    @cached_property
    def few(self) -> Campaign:
        """Campaign of the records that they run on; none that the base misses weighs far more than the others.

        A record beside a jump of the response may be missed a thousand times as much as all others together, and be on
        the wrong branch whatever a small step does: least squares would follow it and nothing else.
        """
        few = replace(coarse(self.campaign, self._numbers, self.base), executor=None)
        heavier = {r.number: self._missed[r.number] / self._usual - 1.0 for r in few.data.records}
        wider = {r.number: np.sqrt(heavier[r.number]) * few.std(r) for r in few.data.records if heavier[r.number] > 0.0}
        corrections = {n: replace(c, left=np.hypot(c.left, wider.get(n, 0.0))) for n, c in few.corrections.items()}
        return replace(few, corrections=corrections)

    @cached_property
    def _numbers(self) -> list[int]:
        return telling(self.base, self.campaign, RECORDS)

    @cached_property
    def _missed(self) -> dict[int, float]:
        """Mean square misfit of each of these records before."""
        white = self.base.white
        return {n: float(np.mean(white.residual[white.record == n] ** 2)) for n in self._numbers}

    @property
    def _usual(self) -> float:
        """What half of those exceed that leave more than noise: an effect with a threshold may be seen in few."""
        seen = [missed for missed in self._missed.values() if missed > MISSED]
        return float(np.median(seen)) if seen else 1.0

    @cached_property
    def before(self) -> float:
        """Chi2 of these records before, as they weigh."""
        points = {n: int(np.sum(self.base.white.record == n)) for n in self._numbers}
        return sum(points[n] * min(missed, self._usual) for n, missed in self._missed.items())

    @cached_property
    def _quick(self) -> Evaluation:
        """The base on these records alone."""
        return replace(self.base, found={number: self.base.found[number] for number in self.few.numbers})

    @property
    def solved(self) -> dict[str, bool]:
        """Whether steady states were found from a start of each candidate that was looked at, by label."""
        begun = {label for (label, _), descent in self.descents.items() if descent is not None}
        return {label: label in begun for label in self.given}

    def ordered(self, scores: Sequence[Score]) -> list[Score]:
        """Candidates by what their best start leaves."""
        self._compare(scores)
        return sorted(scores, key=self._least)

    def giving_way(self, scores: Sequence[Score]) -> list[Score]:
        """Of candidates that let give way what the rig file takes for rigid, those seen at once."""
        rigid = [s for s in scores if _rigid(s.cause.unknowns(self.base.model.nominal))]
        self._compare(rigid)
        return [s for s in rigid if self._least(s) <= SEEN * self.before]

    def _least(self, score: Score) -> float:
        """Chi2 that the best start of a candidate leaves."""
        return min((chi2 for chi2, _ in self.compared[score.cause.label]), default=np.inf)

    @cached_property
    def spread(self) -> float:
        """Logarithm of the determinant of the covariance of these records before."""
        return self.few.whiten(self._quick.found, self._quick.by_x).spread

    def run(
        self, scores: Sequence[Score], most: int = STARTS, steps: int = STEPS, reach: float = np.inf
    ) -> list[Candidate | None]:
        """Candidates where they stand, None where there is no fit; those that do not get to a chi2 of use end early."""
        self._compare(scores)
        near = [_near(self._quick, self.before, s, self.compared[s.cause.label], most) for s in scores]
        begun = [{(s.cause.label, x.tobytes()): (s.cause, x) for x in xs} for s, xs in zip(scores, near, strict=True)]
        self._step({key: start for starts in begun for key, start in starts.items()}, steps, reach)
        descents = [[self.descents[key] for key in starts] for starts in begun]
        fits = [[descent.here for descent in each_of if descent is not None] for each_of in descents]
        limited = each(self.campaign.executor, partial(_limited, self._quick, self.few, steps, reach), fits)
        return [_candidate(self._quick, self.spread, s.cause, f) for s, f in zip(scores, limited, strict=True)]

    def _compare(self, scores: Sequence[Score]) -> None:
        new = [s for s in scores if self.given.get(s.cause.label) != s.starts]
        task = partial(_compared, self._quick, self.few, WORSE * self.before)
        found = each(self.campaign.executor, task, new)
        self.compared.update((s.cause.label, starts) for s, starts in zip(new, found, strict=True))
        self.given.update((s.cause.label, s.starts) for s in new)

    def _step(self, begun: Mapping[Begun, tuple[Cause, Array]], steps: int, reach: float) -> None:
        """Go on with steps of candidates from where they began until there are so many."""
        known = self.descents
        going = [key for key in begun if key not in known or ((d := known[key]) is not None and d.goes_on(steps))]
        causes, where = [begun[key][0] for key in going], [begun[key][1] for key in going]
        task = partial(_stepped, self._quick, self.few, steps, reach)
        found = each(self.campaign.executor, task, causes, where, [known.get(key) for key in going])
        known.update(zip(going, found, strict=True))


def rank(e: Evaluation) -> tuple[int, float]:
    """Order of fits: those that lost no records first, by chi2."""
    return len(e.missing), e.chi2


def _compared(base: Evaluation, few: Campaign, limit: float, score: Score) -> Starts:
    """Starts of a candidate, of no use beyond the limit of chi2; empty where none has steady states."""
    model = lighter(base).extended_by(score.cause)
    try:
        starts = _starts(model, starting(model, base, {}), score)
        if not base.model.causes and len(base.x):  # calibration may have gone far to make up for the cause
            starts += [x for x in _starts(model, model.start, score) if not any(np.array_equal(x, y) for y in starts)]
        return _by_place(model, few, starts, base.solutions, limit)
    except FAILURES:
        return []


def _near(base: Evaluation, before: float, score: Score, starts: Starts, most: int) -> list[Array]:
    """Where steps are taken from, by what starts leave of chi2 before; nowhere where none has steady states."""
    if not starts:
        return []
    first = [(chi2, x) for chi2, x in starts[:most] if chi2 < WORSE * before]
    near = [x for chi2, x in first if chi2 <= SECOND * first[0][0] or most > STARTS]
    if score.drop > PROMISING * before or not near or starts[0][0] > before:
        near.append(starting(lighter(base).extended_by(score.cause), base, score.start))
    return near


def _stepped(
    base: Evaluation, few: Campaign, steps: int, reach: float, cause: Cause, x: Array, known: Descent | None
) -> Descent | None:
    """Quick fit of a candidate from one start, or from where it is known to; None where that has no steady state."""
    try:
        begun = known or Descent(begun_at(lighter(base).extended_by(cause), few, x, base.solutions))
        return descended(begun, few, base.solutions, steps, SETTLED, PART, reach)
    except FAILURES:
        return None


def _limited(base: Evaluation, few: Campaign, steps: int, reach: float, fits: Sequence[Evaluation]) -> list[Evaluation]:
    """Fits of a candidate, the best first, with those whose limits are lowered where that may be of use.

    From the best fit, and from no effect: what gives way beyond its limit alone is not near what yields throughout.
    """
    found = sorted(fits, key=rank)
    if found and found[0].chi2 <= reach:
        model = found[0].model
        with suppress(*FAILURES):
            found += with_limits(found[0], few, steps)
        if _limits(model):
            with suppress(*FAILURES):
                found += with_limits(evaluate(model, few, starting(model, base, {}), base.solutions), few, steps)
    return sorted(found, key=rank)


def _candidate(base: Evaluation, spread: float, cause: Cause, fits: Sequence[Evaluation]) -> Candidate | None:
    """A candidate as its best fit leaves it; None where there is none.

    What it leaves counts with what its covariance spreads beyond `spread`: transients may explain much.
    """
    if not fits:
        return None
    best, *others = fits
    model = base.model.extended_by(cause)
    carried = [model.at(base.values | e.values) for e in (best, *_apart(best, others))]
    return Candidate(cause, best.chi2 + best.white.spread - spread, carried[0], tuple(carried[1:]))


def _by_place(model: Model, few: Campaign, starts: Sequence[Array], last: Solutions, limit: float) -> Starts:
    """The best start at each place, or of each value of whatever shapes the cause, then the others."""
    unknowns = model.unknowns[-1]
    shapes = [i - len(unknowns) for i, u in enumerate(unknowns) if u.shapes]
    places: dict[float, list[Array]] = {}
    for x in starts:
        places.setdefault(float(x[shapes[-1]]) if shapes else 0.0, []).append(x)
    most = max(1, MANY // len(places))
    ordered = [best_start(model, few, there, last, most, limit) for there in places.values()]
    firsts, others = [o[0] for o in ordered], [pair for o in ordered for pair in o[1:]]
    return [*sorted(firsts, key=lambda p: p[0]), *sorted(others, key=lambda p: p[0])]


def _apart(best: Evaluation, others: Sequence[Evaluation]) -> list[Evaluation]:
    """Those nearly as good as the best, or that leave no more than noise either, in other valleys."""
    close = max(best.chi2 + CLOSE, len(best.white))
    near = [e for e in others if e.chi2 < close and len(e.missing) == len(best.missing)]
    return [e for e in near if elsewhere(best, e.x)][:VALLEYS]


def elsewhere(e: Evaluation, x: Array) -> bool:
    """Whether other coordinates are further from those of a fit than noise explains."""
    return bool(np.any(np.abs(x - e.x) > APART * np.sqrt(np.diag(e.covariance))))


def _starts(model: Model, x: Array, score: Score) -> list[Array]:
    """Where the last cause may start with an effect, everything else as in `x`; its limits out of reach."""
    unknowns = model.unknowns[-1]
    rest = len(x) - len(unknowns)
    own = model.free[rest:]
    if score.starts:
        given = [tuple(start[u.name] for u in unknowns) for start in score.starts]
    else:
        grids = [u.starts[1:] or u.starts if i == 0 else u.starts for i, u in enumerate(unknowns)]
        if grids and not any(u.shapes for u in unknowns):
            grids[0] = _dense(grids[0], DENSER if _rigid(unknowns) else DENSE)
        given = list(product(*(g[:1] if rest + i in _limits(model) else g for i, g in enumerate(grids))))
    return [np.concatenate([x[:rest], [f.of(v) for f, v in zip(own, values, strict=True)]]) for values in given]


def _rigid(unknowns: Sequence[Unknown]) -> bool:
    """Whether a cause is one stiffness, of what is rigid without it."""
    return len(unknowns) == 1 and unknowns[0].neutral == np.inf


def _dense(starts: Sequence[float], apart: float) -> tuple[float, ...]:
    """Starts in ascending order with more of them between, none of one sign more than a factor apart."""
    values, between = sorted(starts), list[float]()
    for low, high in pairwise(values):
        if low * high > 0.0:
            parts = int(np.ceil(abs(np.log(high / low)) / np.log(apart) - ROUNDING))
            between += np.geomspace(low, high, parts + 1)[1:-1].tolist()
    return tuple(sorted([*values, *between]))


def _limits(model: Model) -> list[int]:
    """Coordinates of limits of the last cause: beside its first number, out of reach nominally."""
    unknowns = model.unknowns[-1]
    return [len(model.free) - len(unknowns) + i for i, u in enumerate(unknowns) if i and np.isinf(u.neutral)]


def with_limits(e: Evaluation, campaign: Campaign, steps: int) -> list[Evaluation]:
    """Fits from the best value of each limit; none where it does no good."""
    return [fit for i in _limits(e.model) for fit in _with_limit(e, campaign, i, steps)]


def _with_limit(e: Evaluation, campaign: Campaign, i: int, steps: int) -> list[Evaluation]:
    """Fit from the best value of one limit below where it stands."""
    f, unknown = e.model.free[i], e.model.unknowns[-1][i - len(e.x)]

    def at(limit: float) -> Array:
        return np.where(np.arange(len(e.x)) == i, f.of(limit), e.x)

    def left(limit: float) -> float:
        try:
            return best_start(e.model, campaign, [at(limit)], e.solutions)[0][0]
        except FAILURES:
            return np.inf

    now, before = f.value(e.x[i]), sum(campaign.chi2(e.solutions).values())  # of the same kind as of starts
    best, least = _lowered(left, [value for value in unknown.starts if value < now], now, before)
    if least * (1.0 + UNTOUCHED) >= before:
        return []
    return [fit_model(e.model, campaign, at(best), e.solutions, steps, SETTLED, PART)]


def _lowered(left: Callable[[float], float], limits: Sequence[float], now: float, before: float) -> tuple[float, float]:
    """Best limit and what it leaves: from value to value until one does harm, then beside the lowest that does none.

    Whatever slips in one record alone may do good between two values only.
    """
    tried = [(now, before)]
    for limit in limits:
        tried.append((limit, left(limit)))
        if tried[-1][1] > SECOND * before:
            break
    harmless = (1.0 + UNTOUCHED) * min(chi2 for _, chi2 in tried)
    lowest = max(k for k, (_, chi2) in enumerate(tried) if chi2 <= harmless)
    touched = before > harmless
    beside = np.log([limit for limit, _ in tried[lowest - touched : lowest + 2]])
    if len(beside) > 1:
        ends = (beside[-1], beside[0])
        found = minimize_scalar(lambda x: left(float(np.exp(x))), bounds=ends, method="bounded", options=BETWEEN)
        tried.append((float(np.exp(found.x)), float(found.fun)))
    return min(tried, key=lambda pair: pair[1])
