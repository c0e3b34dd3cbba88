"""Fits of candidates to all records."""

from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from hbm.diagnosis.otherstarts import Tell, scanned
from hbm.diagnosis.quickfits import CLOSE, Candidate, rank, with_limits
from hbm.diagnosis.screen import small
from hbm.diagnosis.signatures import starting
from hbm.fourier import Array
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation
from hbm.outputerror.fit import STEPS, fit_from, fit_model, found_again, refine
from hbm.outputerror.model import Model
from hbm.outputerror.simulated import FAILURES, Solutions
from hbm.outputerror.valley import along_valley
from models.causes.cause import Cause, candidates_of
from models.causes.records import ForceDistortion
from models.causes.sensors import SensorGain
from models.causes.structure import ContactLoss
from models.change import VARIATION
from models.jointed import AnyRig

HELPS = 0.5
"""Where the best leaves more than this share of chi2 of few records nothing will explain them; where the first does of
all records another one is fitted."""

REFINABLE = 10.0
"""Mean square misfit up to which the discretisation is corrected anew where a fit is."""

FINISHED = 40
"""Evaluations of the best fit of a joint that leaves more, at most."""

REFINED, FAR = 300.0, 1500.0
"""Fits whose chi2 is within the first of the best are refined too, unless the best is this far from fitting."""

DISTORTED = 5.0
"""A force is distorted that has a harmonic of so many standard deviations."""


def full_fits(
    candidates: Sequence[Candidate],
    base: Evaluation,
    campaign: Campaign,
    tell: Tell,
    of_use: float = np.inf,
    *,
    one: bool = False,
) -> list[Evaluation]:
    """Fits of candidates to all records, as far as they may get below a chi2 of use; of several valleys the deepest.

    Of `one` no more than the first that takes its share, as it did of few records.
    """
    done: list[Evaluation] = []
    margin = CLOSE if small(base) else REFINED
    for candidate in candidates:
        tell(f"{candidate.cause.label}, all records")
        model = base.model.extended_by(candidate.cause)
        fits: list[Evaluation] = []
        for x in (candidate.x, *candidate.others):
            reach = min(of_use, min((e.chi2 for e in (*done, *fits) if not e.missing), default=np.inf) + margin)
            needed = fits[0].found if fits else ()
            fits = sorted([*fits, *_fits(model, campaign, x, base.solutions, needed, reach)], key=rank)
        done += fits[:1]
        if one and any(e.chi2 < HELPS * base.chi2 for e in done):
            break
    return done


def lifted_off(base: Evaluation, candidates: Sequence[Cause], campaign: Campaign, tell: Tell) -> list[Evaluation]:
    """A model whose tip lifts off, where its reaction turns negative; else nothing.

    It has no number to fit, and what corrects the discretisation of a tip that is kept on its support says nothing
    of one that is not: quick fits would not tell. Of a load that is held constant only the lifted model says whether
    the tip leaves its support; where it never does, the load would vary, which is another cause.
    """
    rig = base.model.rig(base.x)
    causes = [c for c in candidates if isinstance(c, ContactLoss) and suits(c, rig)]
    if not causes or (rig.number(VARIATION) > 0.0 and not any(s.lift_off for s in base.solutions.values())):
        return []
    model = base.model.extended_by(causes[0])
    tell(f"{causes[0].label}, all records")
    with suppress(*FAILURES):
        fit = refine(fit_model(model, campaign, starting(model, base, {}), base.solutions), campaign)
        return [fit] if any(max(s.off.values()) > 0.0 for s in fit.solutions.values()) else []
    return []


def measurable(cause: Cause, rig: AnyRig, campaign: Campaign) -> bool:
    """Whether what was measured of a rig can speak of a cause: its channels, or the harmonics of the force.

    Nothing but what the force channel of a rig with one contact reads is asked where it agrees with the responses in
    another unit.
    """
    if campaign.data.other_unit:
        return isinstance(cause, SensorGain) and cause.of_force(rig)
    if isinstance(cause, ForceDistortion):
        return distorted(campaign)
    unseen = {c.name for c in rig.response_channels} - {*campaign.data.channels}
    return not any(getattr(cause, name, "") in unseen for name in ("channel", "other"))


def distorted(campaign: Campaign) -> bool:
    """Whether a harmonic of the force was measured plainly."""
    return (campaign.data.distorted or 0.0) > DISTORTED


def suits(cause: Cause, rig: AnyRig) -> bool:
    """Whether an extended rig can be extended by a cause too."""
    return any(offered == cause for offered in candidates_of(type(cause), rig))


def _fits(
    model: Model, campaign: Campaign, x: Array, last: Solutions, needed: Collection[int], reach: float
) -> list[Evaluation]:
    """From a start, records that it lacks looked for where it ends, limits lowered too.

    None where it has no steady states, or lacks one that is needed.
    """
    fits: list[Evaluation] = []
    with suppress(*FAILURES):
        fit = fit_model(model, campaign, x, last, needed=needed, reach=reach)
        if fit.missing and fit.chi2 <= reach:
            fit = fit_from(found_again(fit, campaign), campaign, last, reach=reach)
        fits += [fit, *with_limits(fit, campaign, STEPS)]
    return fits


def refinable(e: Evaluation) -> bool:
    """Whether a better correction of the discretisation may be what a fit is missing."""
    return e.chi2 <= REFINABLE * len(e.white)


def refined(done: list[Evaluation], base: Evaluation, campaign: Campaign, of_use: float = np.inf) -> list[Evaluation]:
    """Fits in order, the best ones refined: where the misfit is small the campaign is corrected near enough.

    The best one of a joint goes on along its valley, if its chi2 is of use.
    """
    ordered = sorted(done, key=rank)
    if not ordered:
        return []
    first, *others = ordered
    if not refinable(first):
        if scanned(base):  # a joint's stiffness and what it slips at go along narrow valleys, which take more steps
            first = fit_model(first.model, campaign, first.x, first.solutions, FINISHED)
            first = along_valley(first, campaign) if first.chi2 <= of_use else first
        return [first, *others]
    first = refine(first, campaign)
    if scanned(base) and first.chi2 <= of_use:
        first = along_valley(first, replace(campaign, corrections=first.corrections))
    if not small(base) and first.chi2 - len(first.white) < FAR:
        others = [refine(e, campaign) if e.chi2 < first.chi2 + REFINED else e for e in others]
    return sorted([first, *others], key=rank)
