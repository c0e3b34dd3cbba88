"""Joints in the order of where a force is missing: at places where a free one explains the records they come first."""

from collections.abc import Sequence
from dataclasses import replace

from hbm.diagnosis.discrepancy import discrepancy
from hbm.diagnosis.jointplaces import JointPlace
from hbm.diagnosis.otherstarts import is_joint, scanned
from hbm.diagnosis.screen import Screening, small
from hbm.diagnosis.signatures import Score
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation
from hbm.sensitivity.jointforces import Ends
from models.causes.addedjoint import AddedJoint

NEARLY = 0.99
"""Share of the misfit beyond noise from which on a free force at a place explains nearly all of it."""


def foremost(
    screening: Screening, base: Evaluation, lacking: Evaluation, campaign: Campaign, *, alone: bool = False
) -> Screening:
    """Scores whose joints come first at the places where the force is missing that a model lacks.

    What a law promises to first order may be most at the wrong place: the motion there, and what the joints of the rig
    file make of a force, are those of a model that misses the records. Whether any force at all at a place explains
    nearly all of them is known better, once calibration has taken what is in the numbers of the rig file. Places that
    cannot be told from the best one come first; their joints take the turns of those elsewhere that promise more.

    Parameters
    ----------
    screening : Screening
    base : Evaluation
        The model that was screened: where it misses little, what a law promises holds, and the order stays.
    lacking : Evaluation
        What misses the records by that force alone, all numbers within their tolerances.
    campaign : Campaign
    alone : bool
        Whether joints elsewhere are left out where such a place explains nearly all.
    """
    if small(base) or not scanned(base):
        return screening
    missing = discrepancy(lacking, campaign, campaign.executor)
    if not missing.explainable:
        return screening
    there = [p.place.ends for p in missing.alike if isinstance(p.place, JointPlace) and p.share >= NEARLY]
    scores = [s for s in screening.scores if not (alone and there and is_joint(s)) or _at(s, there)]
    turns = iter(sorted(filter(is_joint, scores), key=lambda s: not _at(s, there)))
    return replace(screening, scores=tuple(next(turns) if is_joint(s) else s for s in scores))


def _at(score: Score, places: Sequence[Ends]) -> bool:
    """Whether a joint is at one of some places."""
    return isinstance(score.cause, AddedJoint) and any(score.cause.way(ends) for ends in places)
