"""Why a cause that was asked for is in no ranking: one sentence for each."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from hbm.diagnosis.flooredsearch import FlooredSearch
from hbm.diagnosis.search import Search
from hbm.diagnosis.verdict import Diagnosis
from models import causes as catalogue
from models.causes.addedjoint import AddedJoint
from models.causes.cause import Cause

Why = Callable[[Cause], str]


def asked_for(
    candidates: Sequence[Cause], causes: Iterable[str | Cause | type[Cause]] | None
) -> dict[str, list[Cause]]:
    """Candidates of each cause that was asked for, by its name; the whole catalogue is nothing in particular."""
    given = [] if causes is None else [*causes]
    whole = {c for c in given if isinstance(c, type)} >= set(catalogue.CAUSES.values())
    particular = [g for g in given if not (whole and g in catalogue.CAUSES.values())]
    return {_name(g): [c for c in candidates if _meant(g, c)] for g in particular}


def _name(asked: str | Cause | type[Cause]) -> str:
    return asked if isinstance(asked, str) else asked.name if isinstance(asked, type) else asked.label


def _meant(asked: str | Cause | type[Cause], candidate: Cause) -> bool:
    if isinstance(asked, str):
        return asked in (candidate.label, candidate.name) or asked.endswith(f".py:{type(candidate).__name__}")
    return type(candidate) is asked if isinstance(asked, type) else candidate == asked


def unfitted(asked: Mapping[str, Sequence[Cause]], found: Diagnosis, why: Why) -> Iterator[str]:
    """A sentence for each cause asked for that no model of the ranking has.

    Parameters
    ----------
    asked : mapping of str to sequence of Cause
        As :func:`asked_for` returns them.
    found : Diagnosis
    why : callable
        Why a candidate was not fitted, or is not ranked.
    """
    ranked = {c.label for e in found.tried for c in e.model.causes}
    for name, candidates in asked.items():
        if not any(c.label in ranked for c in candidates):
            reasons = dict.fromkeys(map(why, candidates)) or ["there is nothing in this rig that it can act on"]
            if found.verdict == "consistent":
                reasons = ["the rig file explains the records without it"]
            yield f"{name} is in no ranking: {'; '.join(reasons)}."


def why_unfitted(search: Search, candidate: Cause) -> str:
    """Why a search has no fit of a candidate to rank."""
    label = candidate.label
    if candidate not in search.candidates:
        return "what was measured does not tell of it"
    if fits := [e for e in search.fitted if any(c.label == label for c in e.model.causes)]:
        if all(e.missing for e in fits):
            return "where it was fitted, records have no steady state"
        if not any(map(search.tolerable, fits)):
            return "where it was fitted, numbers of the rig file leave their tolerances"
        return "it was fitted, and others explain the records better"
    if (solved := search.quickly.get(label)) is not None:
        if solved:
            return "it was fitted to few records, and leaves too much of them"
        return "no steady state of a few records was found from any of its starts"
    scores = [s for screening in search.screenings for s in screening.scores if s.cause.label == label]
    if not search.screenings:
        return "nothing was left for it to explain"
    if not scores:
        return "others promise far more" if isinstance(candidate, AddedJoint) else "what is missed has no such form"
    if not any(s.signature.any() for s in scores):
        return "its first start changes nothing that numbers of the rig file within tolerances do not change alike"
    if not any(s.drop for s in scores):
        return "a small effect of it makes the misfit no smaller"
    return "others promise more, by a small effect"


def why_unraced(search: FlooredSearch, candidate: Cause) -> str:
    """Why a search beside a floor has no fit of a candidate to rank."""
    promising, fitted, lost = search.raced
    if any(candidate.label in label.split(" + ") for label in lost):
        return "not solved from any of its starts"
    if any(candidate.label in label.split(" + ") for label in fitted):
        return "where it was fitted, it leaves too much, or numbers of the rig file leave their tolerances"
    if not isinstance(candidate, AddedJoint):
        return (
            "of such measurements only joints of the catalogue are tried, and numbers of the rig file whose tolerance "
            "costs much"
        )
    more = "others promise more, to first order"
    return more if candidate.label in promising else "it promises nothing, to first order"
