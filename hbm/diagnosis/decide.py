"""The decision, docs/theory/diagnosis.md: who explains the misfit, who cannot be told from it, and whether it holds.

Accepted over the calibrated nominal is what lowers BIC by more than :data:`DECISIVE` and chi2 by more than chance over
all that were tried (Sidak), and what then fits records it has not seen.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from scipy import special

from hbm.diagnosis.projection import Span
from hbm.diagnosis.remainder import LEFT, explained
from hbm.diagnosis.screen import Screening
from hbm.diagnosis.signatures import Score
from hbm.outputerror.evaluation import Evaluation
from models.causes.addedjoint import AddedJoint
from models.causes.cause import Cause
from models.jointed import AnyRig

ALARM = 0.003
"""Probability of a false alarm by chance over all that was tried."""

CONTENDING = 3
"""So many of the best models, and of the causes that the score test favours, are judged anew with more records."""

MOST_RANKED = 10
"""Fits that are kept for the ranking."""

DECISIVE = 30.0
"""Fall of BIC that a cause must bring; less may be what two exact simulations differ by."""

TIED = 9.0
"""Causes are not separable where their chi2 differs by less."""

STRONGER, TOGETHER = 0.7, 2
"""A second cause is looked for where the first leaves less than this share of chi2: of two, the stronger takes half.
Where none was accepted alone, beside so many at most."""

BARE = 2.0
"""Difference of BIC not worth more than a bare mention (Kass and Raftery 1995): what tolerances do comes first, and
causes that differ by no more are as likely."""

SEVERAL, SEEN = 2, 20.0
"""Transients must be seen in so many records, each of which they make likelier by so much of chi2."""

PAYS = 0.7
"""Share of what one cause leaves that a second one must take."""

HARDLY = 0.01
"""Share by which a number must be above another of its cause that it does not fall below, as friction at rest above
that of sliding: with less it is a law without what the cause adds."""

DRAWS = 400
"""Repetitions of the measurement that the confidence is counted from."""


def sidak(tried: int, parameters: int = 1) -> float:
    """Fall of chi2 that chance brings in :data:`ALARM` of the searches over so many candidates.

    >>> round(sidak(27), 1)
    14.9
    """
    each = -np.expm1(np.log1p(-ALARM) / max(tried, 1))
    return float(special.chdtri(parameters, each))


def suspicious(screening: Screening, rig: AnyRig) -> bool:
    """Whether the score test finds a cause that would be accepted."""
    return any(
        s.gain > DECISIVE and s.drop > sidak(screening.tried, max(len(s.cause.unknowns(rig)), 1))
        for s in screening.scores
    )


def accepted(base: Evaluation, e: Evaluation, tried: int) -> bool:
    """Whether an extended model is better than the calibrated one by more than chance."""
    more = max(e.model.counted - base.model.counted, 1)
    fell = base.chi2 - e.chi2
    return base.bic - e.bic > DECISIVE and fell > sidak(tried, more) and _in_several(base, e) and _is_its_own(e)


def _is_its_own(e: Evaluation) -> bool:
    """Whether numbers that do not fall below others are above them: else the cause is the law of fewer numbers.

    By a share of these, or by more than one of the two is off: what is hardly above may come from both being wrong.
    """
    found = e.values
    return all(
        found[i, u.name] - found[i, least.name]
        > min(HARDLY * found[i, least.name], *(abs(found[i, n.name] - n.neutral) for n in (u, least)))
        for i, unknowns in enumerate(e.model.unknowns)
        for u, least in permutations(unknowns, 2)
        if u.least == least.name
    )


def _in_several(base: Evaluation, e: Evaluation) -> bool:
    """Whether transients, which are free in each record, are seen in several: in one they explain whatever it is."""
    if e.settled:
        return True
    both = set(base.white.spreads) & set(e.white.spreads)
    gained = [base.white.deviance(number) - e.white.deviance(number) for number in both]
    return sum(gain > SEEN for gain in gained) >= SEVERAL


def best_of(fits: Sequence[Evaluation]) -> list[Evaluation]:
    """Fits in order of BIC; those that lost records come last."""
    return sorted(fits, key=lambda e: (len(e.missing), e.bic))


def leading(
    base: Evaluation, first: Evaluation | None, raced: Sequence[Evaluation], most: int = TOGETHER
) -> list[Evaluation]:
    """Causes over a base beside which a second one is looked for: the one accepted, or else the first of those raced.

    Of two that hide each other, as one that softens and one that hardens, none may be believed alone, nor leave the
    rig file within its tolerances. Transients never lead: they take most of anything.
    """
    whole = [e for e in raced if not e.missing and e.settled]
    labels = list(dict.fromkeys(e.model.label for e in whole))[:most]
    firsts = [next(e for e in whole if e.model.label == label) for label in labels] if first is None else [first]
    return [e for e in firsts if e.settled and e.chi2 <= STRONGER * base.chi2]


def hardly_behind(bic: Sequence[float]) -> int:
    """How many causes may lead a pair where readings are few: also those hardly behind the last that does anyhow."""
    return sum(found <= bic[min(TOGETHER, len(bic)) - 1] + BARE for found in bic)


def pays(pair: Evaluation, fits: Sequence[Evaluation]) -> bool:
    """Whether a second cause takes a large share of what the first leaves, believed alone or not."""
    first = [e for e in fits if e.model.causes == pair.model.causes[:1] and not e.missing]
    return all(explained(e.white, pair.white) >= PAYS for e in first)


def takes_much(simple: Evaluation, rich: Evaluation) -> bool:
    """Whether a richer model takes a large share of what a simpler one leaves, beside the same floor."""
    return bool(rich.chi2 < LEFT * simple.chi2)


def nearest(fits: Sequence[Evaluation]) -> list[Evaluation]:
    """Single causes, the best first, that lost no records."""
    return [e for e in best_of(fits) if not e.missing and len(e.model.causes) == 1]


def others_of(best: Evaluation, ranked: Sequence[Evaluation]) -> list[Evaluation]:
    """Fits with other causes, the best one of each."""
    return [e for e in one_of_each(ranked) if e.model.label != best.model.label]


def one_of_each(ranked: Sequence[Evaluation]) -> list[Evaluation]:
    """Of fits with the same causes the first alone."""
    first: dict[str, Evaluation] = {}
    for e in ranked:
        first.setdefault(e.model.label, e)
    return list(first.values())


def tied(fits: Sequence[Evaluation], best: Evaluation) -> list[Evaluation]:
    """Fits that the records cannot tell from the best one, but for those that only contain it or hold its causes."""
    others = [e for e in fits if not e.missing and not adds_to(best, e)]
    close = [e for e in others if abs(e.chi2 - best.chi2) < TIED]
    return [e for e in close if len(e.x) <= len(best.x) or best.chi2 - e.chi2 > 1.0 or not undetermined(e)]


def plainest(best: Evaluation, fits: Sequence[Evaluation]) -> Evaluation:
    """The best fit, or a simpler one that it contains and is not decisively better than."""
    return next((e for e in inside(best, fits) if e.bic - best.bic < DECISIVE), best)


def seconded(best: Evaluation, e: Evaluation) -> bool:
    """Whether of two models with two causes each the first cause is the same, and the second another."""
    mine, other = best.model.causes, e.model.causes
    return len(mine) == len(other) == 2 and mine[0] == other[0] and mine[1] != other[1]


def adds_to(best: Evaluation, e: Evaluation) -> bool:
    """Whether the causes of one fit, or richer ones that contain them, are those of another or stand beside more."""
    named, causes = best.model.causes, e.model.causes
    held = {label for cause in causes for label in held_by(cause)}
    beside_more = len(causes) > len(named) and {c.label for c in named} <= held
    return bool(named) and (set(named) <= set(causes) or beside_more)


def inside(rich: Evaluation, fits: Sequence[Evaluation]) -> list[Evaluation]:
    """Fits whose causes are among, or special cases of, those of a richer one, the simplest first."""
    more = [held_by(cause) for cause in rich.model.causes]
    simpler = [e for e in fits if e.model.causes and e.model.counted < rich.model.counted]
    held = [e for e in simpler if all(any(c.label in names for names in more) for c in e.model.causes)]
    return sorted(held, key=lambda e: (e.model.counted, e.bic))


def same_or_held(e: Evaluation, by: Evaluation) -> bool:
    """Whether a model has the causes of another one, or one that the only one of these contains."""
    return e.model.causes == by.model.causes or (len(by.model.causes) == 1 and bool(inside(by, [e])))


def held_by(cause: Cause) -> set[str]:
    """Labels of a cause and of the simpler ones that it is at some values: of a joint, at the same place."""
    return {cause.label, *(name + cause.label.removeprefix(cause.name) for name in getattr(cause, "contains", ()))}


def contenders(
    fits: Sequence[Evaluation], better: Sequence[bool], scores: Sequence[Score], candidates: Sequence[Cause]
) -> list[Cause]:
    """Causes of the best models, and of those that foretell the records held out better; of joints at all places.

    And those that the score test over the calibrated rig file favours, which may be weak on the records fitted.
    """
    chosen = [c for i, e in enumerate(fits) if i < CONTENDING or better[i] for c in e.model.causes]
    chosen += [s.cause for s in scores[:CONTENDING] if s.gain > 0.0]
    laws = {c.name for c in chosen if isinstance(c, AddedJoint)}
    return [c for c in candidates if c in chosen or c.name in laws]


def undetermined(e: Evaluation) -> bool:
    """Whether a number of a cause may be anything."""
    known = [(abs(f.value(x)), s) for f, x, s in zip(e.model.free, e.x, e.std, strict=True) if f.cause >= 0]
    return any(s > value for value, s in known)


def evidence(e: Evaluation) -> float:
    """Twice the negative logarithm of a model's evidence: by Laplace where numbers are expected, else by BIC."""
    std = np.array([f.std for f in e.model.free])
    known = np.isfinite(std)
    if not known.any():
        return e.bic
    narrowed = np.outer(std[known], std[known]) * e.information[np.ix_(known, known)]
    return e.bic + float(np.linalg.slogdet(narrowed)[1])


def simpler(single: Evaluation, calibrated: Evaluation, tried: int) -> bool:
    """Whether one cause over a rig file that is right otherwise is likelier than many small errors of it."""
    return bool(evidence(single) + 2.0 * np.log(tried) < evidence(calibrated) + DECISIVE)


def inclusion(fits: Sequence[Evaluation], best: Evaluation, draws: int = DRAWS) -> float:
    """Share of repeated measurements in which the best of some models would be chosen again, if it were true.

    Every model is linear near its fit: noise drawn anew, each is refitted by projection and judged by its evidence.
    Models whose evidence differs by no more than :data:`BARE` share a repetition between them.
    """
    rng = np.random.default_rng(len(best.white))
    noise = rng.standard_normal((len(best.white), draws))
    found = []
    for e in (best, *(e for e in fits if e is not best and len(e.white) == len(best.white))):
        shift = e.white.residual - best.white.residual
        r = np.vstack([shift[:, None] + noise, np.tile(-e.pulls[:, None], draws)])
        left = Span(np.vstack([e.white.jacobian, e.expected])).across(r)
        found.append(np.sum(left**2, axis=0) + evidence(e) - e.chi2)
    chosen = found - np.min(found, axis=0) <= BARE
    return float(np.mean(chosen[0] / chosen.sum(axis=0)))


@dataclass(frozen=True, eq=False)
class Decision:
    """Outcome of the search on the records fitted.

    Attributes
    ----------
    base : Evaluation
        The calibrated model over which causes were tried.
    best : Evaluation or None
        The one accepted.
    fits : tuple of Evaluation
        All that were fitted to all records, the best first.
    """

    base: Evaluation
    best: Evaluation | None
    fits: tuple[Evaluation, ...]

    @property
    def story(self) -> Evaluation:
        """The fit that was decided for: that of the best cause, or of the base."""
        return self.best or self.base


def best_first(*decisions: Decision) -> Decision:
    """The decision whose best fit is likeliest; over different models of the rest."""
    return min(decisions, key=lambda d: min((evidence(e) for e in d.fits if not e.missing), default=np.inf))
