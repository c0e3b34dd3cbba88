"""What supports the conclusion of a search beside a floor, in sentences."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from hbm.diagnosis.barred import told_of_barred
from hbm.diagnosis.evidence import at_bounds, shares_of_two
from hbm.diagnosis.misfit import nrmse
from hbm.diagnosis.remainder import LEFT, percent
from hbm.outputerror.background import LARGEST
from hbm.outputerror.evaluation import Evaluation
from hbm.outputerror.floored import FlooredCampaign
from hbm.outputerror.whitened import Whitened

if TYPE_CHECKING:
    from hbm.diagnosis.flooredsearch import FlooredSearch

MOST_TOLD = 6
"""So many candidates that could not be solved are named."""


def floored_evidence(
    search: "FlooredSearch",
    plain: Mapping[str, Evaluation],
    unseen: Mapping[str, Evaluation],
    named: Evaluation | None,
) -> Iterator[str]:
    """All of it.

    Parameters
    ----------
    search : FlooredSearch
        When it is done.
    plain, unseen : mapping of str to Evaluation
        Models by name, on the records fitted beside noise alone and on those held out.
    named : Evaluation or None
        The model with the cause that is named.
    """
    held = 0 if search.hidden is None else len(search.hidden.data.records)
    yield f"{search.campaign.described} fitted, {held} held out."
    basis = search.campaign.numerics.working.basis
    judged = plain["calibrated" if named is None else "extended"]
    yield (
        f"simulated with {basis.H} harmonics and {basis.N_t} samples; twice as many of both change the response by "
        f"{percent(search.unresolved(judged))}."
    )
    yield (
        "Models are compared beside what none of them describes, as the best one leaves it: noise of "
        f"{percent(search.campaign.floor)} of {search.campaign.floor_of}."
    )
    for name, e in plain.items():
        scored = ""
        if search.hidden is not None and name in unseen:
            further = search.hidden.worst(unseen[name].found)
            scored = f", {nrmse(unseen[name].white):.3%} on those held out{further}"
        yield (
            f"The {name} model is off by {nrmse(e.white):.3%} on the records fitted{scored} "
            f"({e.white.chi2 / len(e.white):.4g} noise variances)."
        )

    yield from at_bounds(search.trust, search.calibrated)
    yield from _raced(search)
    if search.barred is not None:
        yield told_of_barred(search.beside(search.barred, 0.0), search.trust)
    if named is None:
        return
    beside_largest = partial(white_beside, campaign=search.campaign, floor=LARGEST)
    yield from shares_of_two(named, search.alone, search.calibrated, beside_largest)
    if search.fits[0].chi2 < named.chi2:
        yield (
            f"{search.fits[0].model.label} takes {percent(1.0 - search.fits[0].chi2 / named.chi2)} of what "
            f"{named.model.label} leaves: the simpler one is named, where less than {1.0 - LEFT:.0%} is gained."
        )


def _raced(search: "FlooredSearch") -> Iterator[str]:
    """How many joints were tried, and which could not be."""
    if not search.scores:
        return
    promising, fitted, lost = (list(dict.fromkeys(names)) for names in search.raced)
    yield (
        f"Joints that promise to take some of the misfit, to first order: {len(promising)}. Models fitted with those "
        f"that promise most: {len(fitted)}."
    )
    if lost:
        named = ", ".join(lost[:MOST_TOLD]) + f" and {len(lost) - MOST_TOLD} more" * (len(lost) > MOST_TOLD)
        yield (
            f"Not solved on the {search.campaign.described} from any of their starts, {len(lost)} of {len(fitted)}, "
            f"which are in no ranking for that: {named}."
        )


def white_beside(e: Evaluation, campaign: FlooredCampaign, floor: float) -> Whitened:
    """Records beside a model, and beside noise of a floor."""
    return replace(campaign, floor=floor).whiten(e.found, e.by_x)
