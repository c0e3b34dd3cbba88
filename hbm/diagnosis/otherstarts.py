"""Quick fits once more from other starts, of what may have stopped in a wrong valley."""

from collections.abc import Callable, Iterable, Sequence

from hbm.diagnosis.quickfits import Candidate, QuickFits
from hbm.diagnosis.screen import Screening
from hbm.diagnosis.signatures import Score
from hbm.outputerror.evaluation import Evaluation
from models.causes.addedjoint import AddedJoint
from models.causes.cause import Cause
from models.jointed import AnyRig, JointedRig

AGAIN, MORE_STARTS, MORE_STEPS = 3, 5, 12
"""Where nothing explains the records so many candidates run again, from more starts and for more steps."""

SIMPLER = 4
"""Where one does, so many of those behind it at most that are simpler."""

BEHIND = 30.0
"""Nothing more is tried with what leaves so many times what the best one does."""

ALIKE = 0.5
"""Causes look alike whose signatures have this cosine."""

Tell = Callable[[str], None]


def scanned(base: Evaluation) -> bool:
    """Whether candidates were scored at the size that they have, as joints are."""
    return isinstance(base.model.nominal, JointedRig)


def is_joint(score: Score) -> bool:
    """Whether a candidate was scored by the force that is missing."""
    return isinstance(score.cause, AddedJoint)


def from_other_starts(
    fitted: list[Candidate],
    explained: float,
    quick: QuickFits,
    screening: Screening,
    tell: Tell,
    *,
    first: bool,
) -> list[Candidate]:
    """Quick fits, some of them fitted again.

    Parameters
    ----------
    fitted : list of Candidate
        The least chi2 first.
    explained : float
        Chi2 that explains the records.
    quick : QuickFits
    screening : Screening
    tell : callable
        Progress.
    first : bool
        Whether these are the first that are fitted, over the rig file as it is. Where none of them explains the
        records, every law of joints is fitted again where it promised most, and at all places if it then is the best.

    Returns
    -------
    list of Candidate
        The least chi2 first.
    """
    stuck = _stuck(fitted, explained, quick.base.model.nominal, screening, laws=first and scanned(quick.base))
    if not stuck:
        return fitted
    lost, fitted = fitted[0].chi2 > explained, _again(fitted, stuck, quick, screening, tell)
    best = fitted[0].cause
    if not (first and lost and isinstance(best, AddedJoint)):
        return fitted
    known = {r.cause.label for r in stuck}
    places = [r for r in fitted if r.cause.name == best.name and r.cause.label not in known]
    return _again(fitted, places, quick, screening, tell) if places else fitted


def _again(
    fitted: Sequence[Candidate], stuck: Sequence[Candidate], quick: QuickFits, screening: Screening, tell: Tell
) -> list[Candidate]:
    """The same with some fitted from more starts and for more steps."""
    tell(", ".join(r.cause.label for r in stuck) + ", from other starts")
    scores = {s.cause.label: s for s in screening.scores}
    more = quick.run([scores[r.cause.label] for r in stuck], MORE_STARTS, MORE_STEPS)
    better = {r: min(again or r, r, key=lambda r: r.chi2) for r, again in zip(stuck, more, strict=True)}
    return sorted((better.get(r, r) for r in fitted), key=lambda r: r.chi2)


def _stuck(
    fitted: Sequence[Candidate], explained: float, rig: AnyRig, screening: Screening, *, laws: bool
) -> list[Candidate]:
    """Candidates that may have stopped in a wrong valley: where none explains the best, and maybe the first of laws.

    Else the best if it has a place, and what is simpler and alike.
    """
    best, *others = fitted
    if best.chi2 > explained:
        again = {r.cause.label for r in fitted[:AGAIN]}
        again |= {cause.label for cause in _first_of_laws(fitted, screening)} if laws else set()
        return [r for r in fitted if r.cause.label in again and r.chi2 <= BEHIND * best.chi2]
    alike, own = screening.look_alikes(best.cause.label, ALIKE), best.cause.unknowns(rig)
    simpler = [r for r in others[:SIMPLER] if r.cause.label in alike and len(r.cause.unknowns(rig)) < len(own)]
    placed = any(u.shapes for u in own) and not isinstance(best.cause, AddedJoint)  # a joint has one place
    return [best] * placed + simpler


def _first_of_laws(fitted: Sequence[Candidate], screening: Screening) -> Iterable[Cause]:
    """Of every law of joints that was fitted, the place that promised most."""
    known = {r.cause.label for r in fitted}
    first: dict[str, Cause] = {}
    for s in screening.scores:
        if is_joint(s) and s.cause.label in known:
            first.setdefault(s.cause.name, s.cause)
    return first.values()
