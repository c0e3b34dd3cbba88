"""Candidates against each other, by the score test where the misfit is small and else by quick fits; then full fits."""

import re
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from hbm.diagnosis.attached import attached_starts
from hbm.diagnosis.fullfits import HELPS, REFINED, full_fits, refined
from hbm.diagnosis.otherstarts import ALIKE, BEHIND, MORE_STARTS, MORE_STEPS, Tell, from_other_starts, is_joint, scanned
from hbm.diagnosis.quickfits import AT_ONCE, CLOSE, Candidate, QuickFits, elsewhere, needless, rank
from hbm.diagnosis.screen import Screening, small, telling
from hbm.diagnosis.signatures import Score, starting
from hbm.diagnosis.turns import NEARLY, in_order, of_the_rig, simpler_joint, simpler_there, unseen
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation
from hbm.outputerror.fit import fit_model, refine
from hbm.outputerror.simulated import FAILURES
from models.causes.addedjoint import AddedJoint
from models.causes.cause import Cause
from models.causes.parameter import WrongParameter

SCANNED = 10
"""Records that are scanned for what may be attached."""

FAVOURED = 1 + AT_ONCE
"""After so many in the order of the score test, the first of them alone, the others run in that of what their best
start leaves."""

COMPARED = 8
"""Where joints were scanned and one explains the records, so many of those that promised most are compared with it."""

FITTED, LEAST, HOPE = 5, 3, 3.0
"""Candidates that are fitted to all records, at most; and so many where none explains the few but the mean square
misfit of the best gives hope: else it is fitted alone, for what it is worth."""

TIED = 0.02
"""Fits that leave far more than noise are alike where they differ by no more than this share of it."""

SHARE = 0.7
"""Where the misfit is small, those run whose predicted fall of BIC is at least this share of the best."""

EXPLAINED, LITTLE = 1.5, 0.03
"""Mean square misfit of the quick fit, or share of what it was, from which on only look-alikes of the best one run."""

REST, HALF, LEAD = 0.1, 0.5, 3.0
"""A candidate is alone ahead that leaves at most the first share of what exceeds noise, and every other one so many
times as much. Nor are more tried where it leaves the second, and those whose starts were next so many times as much."""

FORESEEN = 1.5
"""A quick fit, or the score test of a small misfit, may leave so many times what a fit to all records may leave."""

ENTRY = re.compile(r"\[\d+\]")
"""Which entry of a list a label is of."""

Enough = Callable[[Evaluation], bool]


def fit_candidates(
    quick: QuickFits,
    screening: Screening,
    tell: Tell,
    enough: Enough,
    likely: Collection[str] | None = None,
    useful: float = np.inf,
) -> list[Evaluation]:
    """Fit the candidates that may explain a misfit, over a model that was calibrated or not.

    Parameters
    ----------
    quick : QuickFits
        Over the model on the records; those made before are known.
    screening : Screening
        Score tests of the candidates over the same base.
    tell : callable
        Progress.
    enough : callable
        Whether a fit leaves so little that no other candidates are looked at.
    likely : collection of str, optional
        Labels of candidates that are tried beside the first of the score test, and no others; all where omitted.
    useful : float
        Share of the misfit beyond noise that a fit may leave; one that will leave more is given up.

    Returns
    -------
    list of Evaluation
        Fits of the best candidates to all records, the least chi2 first.
    """
    base, campaign = quick.base, quick.campaign
    screening = _started(screening, base, campaign)
    of_use, foreseen = (_left(base.chi2, len(base.white), share) for share in (useful, FORESEEN * useful))
    reached = of_few = _left(quick.before, quick.few.points, FORESEEN * useful)
    if small(base):
        promising = [c for c in _by_score(quick, screening) if c.chi2 <= foreseen]
        done = refined(full_fits(promising, base, campaign, tell, of_use), base, campaign, foreseen)
        tried, rest = {e.model.causes[-1].label for e in done}, [s for s in screening.scores if unseen(s)]
    else:
        little = LITTLE if likely is None and not scanned(base) else 0.0
        chosen, richer, tried = _by_quick_fits(quick, screening, tell, little, of_few, likely=likely)
        lost = min((r.chi2 for r in chosen), default=0.0) > HOPE * quick.few.points
        reach = min(EXPLAINED * len(base.white) if lost and not len(base.x) else np.inf, of_use)
        done = refined(full_fits(chosen, base, campaign, tell, reach, one=lost), base, campaign, foreseen)
        if richer and not any(enough(e) for e in done):
            done = sorted(
                [*done, *refined(full_fits(richer, base, campaign, tell, of_use), base, campaign, foreseen)], key=rank
            )
        rest = in_order(screening, base)
        reached = min(of_few, chosen[0].chi2 if lost else np.inf)
    rest = [s for s in rest if likely is None and s.cause.label not in tried]
    if rest and not any(enough(e) for e in done):
        chosen, _, _ = _by_quick_fits(quick, replace(screening, scores=tuple(rest)), tell, 0.0, reached)
        more = sorted(full_fits(chosen, base, campaign, tell, of_use), key=rank)
        if more and more[0].chi2 < min((e.chi2 for e in done), default=np.inf) + REFINED:
            more = refined(more, base, campaign, foreseen)
        done = sorted([*done, *more], key=rank)
    if not any(enough(e) for e in done[:1]):
        return done
    if scanned(base) and isinstance(done[0].model.causes[-1], WrongParameter):
        joints = _taken_for(done[0].model.causes[-1], screening, {e.model.causes[-1].label for e in done})
        near = [c for c in quick.run(joints) if c is not None and c.chi2 <= EXPLAINED * quick.few.points]
        done = sorted([*done, *full_fits(near, base, campaign, tell, of_use)], key=rank)
    return followed(done, campaign)


def _taken_for(number: WrongParameter, screening: Screening, known: Collection[str]) -> list[Score]:
    """Joints of one number that say they may be taken for a number of the rig file.

    Where that is calibrated it has taken what they do before the test asks for them.
    """
    joints = (s for s in screening.scores if isinstance(s.cause, AddedJoint) and len(s.cause.numbers) == 1)
    label = ENTRY.sub("[i]", number.label)
    return [s for s in joints if label in s.cause.confused_with and s.cause.label not in known]


def _left(chi2: float, points: int, share: float) -> float:
    """Chi2 of a fit that leaves a share of what exceeds noise."""
    return points + share * max(chi2 - points, 1.0)


def followed(done: Sequence[Evaluation], campaign: Campaign) -> list[Evaluation]:
    """Fits in order, where what is simpler than the best starts once more at the place that the best has found.

    An effect with more numbers gets along narrow valleys that a simpler one, which it contains, is caught in: a
    resonator of no frequency of its own is a spring.
    """
    best, *others = done
    return sorted([best, *(_beside(best, e, campaign) for e in others)], key=rank)


def _beside(best: Evaluation, e: Evaluation, campaign: Campaign) -> Evaluation:
    """A fit, or a better one from where the best stands, if that has more numbers and is elsewhere."""
    own = _place(e)
    x = starting(e.model, e, {name: value for name, value in _place(best).items() if name in own})
    if len(e.x) >= len(best.x) or not elsewhere(e, x):
        return e
    with suppress(*FAILURES):
        return min(e, refine(fit_model(e.model, campaign, x, best.solutions), campaign), key=rank)
    return e


def _place(e: Evaluation) -> dict[str, float]:
    """Values of what shapes the last cause of a model, by name."""
    values = e.model.values(e.x, len(e.model.causes) - 1)
    return {u.name: values[u.name] for u in e.model.unknowns[-1] if u.shapes}


def _started(screening: Screening, base: Evaluation, campaign: Campaign) -> Screening:
    """The same with starts of what may be attached to the beam."""
    starts = attached_starts(base, campaign.of(telling(base, campaign, SCANNED)), [s.cause for s in screening.scores])
    scores = tuple(replace(s, starts=starts.get(s.cause.label, s.starts)) for s in screening.scores)
    return replace(screening, scores=scores)


def _by_score(quick: QuickFits, screening: Screening) -> list[Candidate]:
    """Candidates whose predicted fall of BIC is near the best; those with a place from other places too."""
    base = quick.base
    best = screening.scores[0].gain if screening.scores else 0.0
    chosen = [s for s in screening.scores[:FITTED] if s.gain > 0.0 and s.gain >= SHARE * best]
    placed = [s for s in chosen if any(u.shapes for u in s.cause.unknowns(base.model.nominal))]
    elsewhere_too = quick.run(placed, MORE_STARTS) if placed else []
    found = {r.cause.label: (r.x, *r.others) for r in elsewhere_too if r is not None}
    return [
        Candidate(
            s.cause,
            base.chi2 - s.drop,
            starting(base.model.extended_by(s.cause), base, s.start),
            found.get(s.cause.label, ()),
        )
        for s in chosen
    ]


def _by_quick_fits(
    quick: QuickFits,
    screening: Screening,
    tell: Tell,
    little: float,
    reached: float = np.inf,
    *,
    likely: Collection[str] | None = None,
) -> tuple[list[Candidate], list[Candidate], set[str]]:
    """Candidates by quick fits, until one leaves but `little` of the misfit; and the labels of all that were tried.

    Those that leave more than `reached` are out. Between them, those that explain these records as well as what is
    simpler does, which may not explain the others.
    """
    few = quick.few
    limit = max(EXPLAINED * few.points, little * quick.before)
    fitted, free, tried = _first_quick_fits(quick, screening, limit, tell, likely, reached)
    fitted, free = [r for r in fitted if r.chi2 < BEHIND * reached], [r for r in free if r.chi2 < reached]
    if not fitted or (likely is not None and fitted[0].chi2 > limit):
        return [*fitted[:1], *free], [], tried
    if not quick.base.model.causes:
        first = bool(np.isinf(reached)) and not quick.base.pulls.any()
        contested = 1 if _alone_ahead(fitted, quick) else len(fitted)
        again = from_other_starts(fitted[:contested], EXPLAINED * few.points, quick, screening, tell, first=first)
        fitted = [*again, *fitted[contested:]]
    if scanned(quick.base):
        confused = _confused(fitted, EXPLAINED * few.points, screening, tried)
        tried |= {s.cause.label for s in confused}
        fitted = sorted(
            [*fitted, *(r for r in quick.run(confused, steps=MORE_STEPS) if r is not None)], key=lambda r: r.chi2
        )
    hopeless = fitted[0].chi2 > HELPS * quick.before
    # what is richer at many places must not crowd out what is simpler
    bare = quick.base.model.nominal
    order = (lambda r: float(len(r.cause.unknowns(bare)))) if scanned(quick.base) else (lambda r: r.chi2)
    chosen = _chosen(fitted, few, hopeless, len(quick.campaign.numbers) / len(few.numbers), order)
    richer = [r for r in fitted if r.chi2 <= EXPLAINED * few.points and needless(r, fitted)]
    return [*(r for r in chosen if r.chi2 < reached), *free], richer[:LEAST], tried


def _free(cause: Cause) -> bool:
    """Whether it is free in each record, and so takes most of anything: it neither ends a search nor crowds out."""
    return bool(getattr(cause, "free", False))


def _first_quick_fits(
    quick: QuickFits,
    screening: Screening,
    explained: float,
    tell: Tell,
    likely: Collection[str] | None,
    of_use: float,
) -> tuple[list[Candidate], list[Candidate], set[str]]:
    """Quick fits of what may explain the records, and of what is free in each, the best first; and what was tried."""
    listed = in_order(screening, quick.base)
    if likely is not None:
        named = [s for s in screening.scores if s.cause.label in likely]
        listed = [*named, *[s for s in listed if s not in named][:FAVOURED]]
    waiting, started, by_start = listed, 0, False
    fitted: list[Candidate] = []
    free: list[Candidate] = []
    tried: set[str] = set()

    favoured = FAVOURED + sum(of_the_rig(s.cause) for s in listed)

    def explains() -> bool:
        return any(r.chi2 <= explained for r in fitted)

    while waiting := [s for s in waiting if not _settled(fitted, explained, s.cause, screening)]:
        if likely is None and not by_start and started >= favoured and not explains():
            tell("starts of all others")
            waiting, by_start = quick.ordered(waiting), True
        if started >= COMPARED and scanned(quick.base) and explains():
            break
        count = AT_ONCE if started else 1
        batch, waiting = waiting[:count], waiting[count:]
        started += len(batch)
        tell(", ".join(s.cause.label for s in batch) + f" ({started} of {len(listed)})")
        found = [r for r in quick.run(batch, reach=min(_reach(fitted, explained), of_use)) if r is not None]
        tried |= {s.cause.label for s in batch}
        free += [r for r in found if _free(r.cause)]
        fitted += (forces := [r for r in found if not _free(r.cause)])
        if by_start and _ahead(fitted, forces, HALF, quick):
            break
        if started >= FAVOURED and _alone_ahead(fitted, quick):
            explained = max(explained, min(r.chi2 for r in fitted))
    return sorted(fitted, key=lambda r: r.chi2), sorted(free, key=lambda r: r.chi2), tried


def _alone_ahead(fitted: Sequence[Candidate], quick: QuickFits) -> bool:
    """Whether the best of some candidates leaves next to nothing and is far ahead of the others."""
    ranked = sorted(fitted, key=lambda r: r.chi2)
    return _ahead(ranked[:1], ranked[1:], REST, quick)


def _ahead(fitted: Sequence[Candidate], others: Sequence[Candidate], share: float, quick: QuickFits) -> bool:
    """Whether the best leaves a share of what exceeds noise, and others leave far more."""
    noise = quick.few.points
    left = max(min((r.chi2 for r in fitted), default=np.inf) - noise, (EXPLAINED - 1.0) * noise)
    behind = all(r.chi2 - noise > LEAD * left for r in others)
    return behind and left <= share * (quick.before - noise) and not scanned(quick.base)


def _reach(fitted: Sequence[Candidate], explained: float) -> float:
    """Chi2 from which on a candidate is of no use: where one explains the records, others must come near it."""
    best = min((r.chi2 for r in fitted), default=np.inf)
    return BEHIND * best if best <= explained else np.inf


def _confused(
    fitted: Sequence[Candidate], explained: float, screening: Screening, tried: Collection[str]
) -> list[Score]:
    """Candidates not tried that those that explain the records, or the best one, say they are confused with.

    A number that is wrong by more than a resonance is wide does not show its effect by the first of it, and its fit has
    further to go than that of a joint, which starts at the size that it has. The simplest of the laws that explain the
    records may do so at other places too, where few modes were measured.
    """
    told = [r.cause for i, r in enumerate(fitted) if i == 0 or r.chi2 <= explained]
    words = " ".join(cause.confused_with for cause in told)

    def meant(cause: Cause) -> bool:
        contained = any(simpler_there(cause, other) and cause.name in other.confused_with for other in told)
        return contained or ENTRY.sub("[i]", cause.label) in words

    untried = [s for s in screening.scores if s.cause.label not in tried]
    named = [s for s in untried if meant(s.cause)]
    best = fitted[0].cause
    least = NEARLY * next((s.drop for s in screening.scores if s.cause.label == best.label), np.inf)
    fewer = [s for s in untried if s.drop >= least and simpler_joint(s.cause, best) and s not in named]
    simplest = dict.fromkeys(c.name for c in told if not any(simpler_joint(other, c) for other in told))
    joints = [s for s in untried if is_joint(s) and s.drop >= least and s not in named]
    elsewhere_too = [s for name in simplest for s in [s for s in joints if s.cause.name == name][:AT_ONCE]]
    return list({s.cause.label: s for s in [*named, *fewer[:AT_ONCE], *elsewhere_too]}.values())


def _chosen(
    fitted: Sequence[Candidate],
    few: Campaign,
    hopeless: bool,
    scale: float,
    order: Callable[[Candidate], float],
) -> list[Candidate]:
    """The best, and in an order those close to it by a chi2 that grows by `scale` to all records.

    What is richer than another is left out if it is no better. Where none explains the few, what is left is no noise to
    count numbers by: of those alike to TIED the first in that order is the best.
    """
    best = fitted[0].chi2
    lost, margin = best > EXPLAINED * few.points, max(10 * CLOSE, best)
    least = LEAST if lost and best <= HOPE * few.points and not hopeless else 1
    most = 1 if hopeless else LEAST if lost else FITTED
    near = [r for r in fitted if r.chi2 <= BEHIND * best and (lost or not needless(r, fitted))]
    close = [r for i, r in enumerate(near) if i < least or scale * (r.chi2 - best) < margin]
    first = min((r for r in close if r.chi2 <= (1.0 + TIED) * best), key=order) if lost else close[0]
    return [first, *sorted((r for r in close if r is not first), key=order)][:most]


def _settled(fitted: Sequence[Candidate], explained: float, cause: Cause, screening: Screening) -> bool:
    """Whether a fitted candidate explains the records, its chi2 below a limit, and this one looks different."""
    best = min(fitted, key=lambda r: r.chi2, default=None)
    if best is None or best.chi2 > explained:
        return False
    return cause.label not in screening.look_alikes(best.cause.label, ALIKE)
