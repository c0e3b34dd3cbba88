"""A cause once more, over another model of the rig file, from where it was found."""

from collections.abc import Sequence

import numpy as np

from hbm.diagnosis.candidates import EXPLAINED
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.fit import Evaluation, fit_model, refine
from hbm.outputerror.simulated import FAILURES
from models.causes.cause import Cause


def started(base: Evaluation, found: Evaluation, causes: Sequence[Cause], campaign: Campaign) -> list[Evaluation]:
    """Fit of a model with some of the causes of another one, from where these were found.

    Parameters
    ----------
    base : Evaluation
        Fit of the model without the causes.
    found : Evaluation
        Fit of a model with them, maybe with others before them and over other calibrated numbers.
    causes : sequence of Cause
        The last ones of its model.
    campaign : Campaign

    Returns
    -------
    list of Evaluation
        Empty where there is no fit.
    """
    model = base.model
    for added in causes:
        model = model.extended_by(added)
    before = len(found.model.causes) - len(model.causes)  # so many more come before them there
    known = base.coordinates
    for (cause, name), x in found.coordinates.items():
        known[cause if cause < 0 else cause - before, name] = x
    start = np.array([known[f.cause, f.name] for f in model.free])
    try:
        best = fit_model(model, campaign, start, found.solutions, reach=EXPLAINED * len(found.white))
        return [refine(best, campaign)]
    except FAILURES:
        return []
