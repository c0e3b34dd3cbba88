"""A cause that would be named, did it not move a number of the rig file farther than its tolerance explains.

It is not believed; but neither is another one beyond doubt that is named in its place. Tolerances may be stated too
narrow, as where the rig file is a best fit to the records themselves.
"""

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from hbm.diagnosis.calibrate import off
from hbm.diagnosis.decide import DECISIVE, accepted, takes_much
from hbm.diagnosis.misfit import nrmse
from hbm.diagnosis.remainder import first_of, percent
from hbm.outputerror.evaluation import Evaluation
from hbm.outputerror.fit import fit_model
from hbm.outputerror.floored import FlooredCampaign
from hbm.outputerror.model import Model
from hbm.outputerror.simulated import FAILURES

MOVED = 3
"""Numbers that are told."""


def barred(
    named: Evaluation,
    raced: Sequence[Evaluation],
    trust: Model,
    campaign: FlooredCampaign,
    tried: int,
    *,
    noise_alone: bool,
) -> Evaluation | None:
    """The likeliest single cause that leaves the tolerances, if it would be named in the place of a model.

    The numbers that it takes to their bounds are free. It would be named where it is decisively likelier, or has fewer
    numbers and the model, which leaves more than noise, does not take a large share of what it leaves; in the place of
    none where it is accepted.

    Parameters
    ----------
    named : Evaluation
        The model with the causes that are named, or calibrated without one, beside the floor of the campaign.
    raced : sequence of Evaluation
        Fits of single causes, the likeliest first.
    trust : Model
        The rig file within its tolerances.
    campaign : FlooredCampaign
    tried : int
        Candidates.
    noise_alone : bool
        Whether the model leaves no more.
    """
    out = next((e for e in raced if not e.missing and off(trust, e)), None)
    if out is None:
        return None
    with suppress(*FAILURES):
        model = _freed(out.model, list(off(trust, out)))
        rival = fit_model(model, campaign, model.at(out.values), out.solutions)
        if rival.missing:
            return None
        if not named.model.causes:
            return rival if accepted(named, rival, tried) else None
        simpler = not noise_alone and rival.model.counted < named.model.counted and not takes_much(rival, named)
        return rival if simpler or named.bic - rival.bic > DECISIVE else None
    return None


def _freed(model: Model, keys: Sequence[str]) -> Model:
    """A model with some of its calibrated numbers free, but those that are 0, which have no scale of their own."""
    free = {key for key in keys if model.nominal.number(key)}
    calibrated = {key: np.inf if key in free else std for key, std in model.calibrated.items()}
    return Model(model.nominal, calibrated, model.causes)


def told_of_barred(e: Evaluation, trust: Model) -> str:
    """What is said of it, beside noise alone."""
    far = [
        f"{t.name} is {e.values[-1, t.name]:.5g} instead of {trust.nominal.number(t.name):.5g} "
        f"({(t.of(e.values[-1, t.name]) - t.expected) / t.std:+.1f} tolerances)"
        for t in trust.free
        if np.isinf(e.model.calibrated.get(t.name, 0.0))
    ]
    return (
        f"{e.model.label} alone would leave {percent(nrmse(e.white))} where {first_of(far, MOVED)}. That is as far off "
        "as tolerances reach, or farther: it is not believed. If it may be so far off, state it with --tolerance."
    )
