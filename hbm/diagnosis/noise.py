"""Whether stated standard deviations are too small, alike everywhere: then no model fits, and none is to blame."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hbm.diagnosis.judge import widened
from hbm.diagnosis.misfit import misfit
from hbm.diagnosis.predict import SAYS_NOTHING
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation

TOO_SMALL = 1.3
"""A misfit of so many noise variances on, everywhere alike, is put down to the standard deviations."""


def understated(e: Evaluation, campaign: Campaign, others: Sequence[Evaluation] = ()) -> float | None:
    """Noise variances that every record, channel and harmonic is off by alike; None where they are not alike.

    None, too, where another model leaves noise alone: then the deviations are as stated. In few records a missing
    effect is as large everywhere. And where the model agrees with nothing, whatever the noise.

    Parameters
    ----------
    e : Evaluation
        A model beside the records of the campaign.
    campaign : Campaign
    others : sequence of Evaluation
        Other models beside these records.
    """
    found = misfit(e, campaign)
    k = found.chi2 / found.dof
    if found.fits or k < TOO_SMALL or found.nrmse > SAYS_NOTHING:
        return None
    if any(misfit(widened(o, campaign), campaign).fits for o in others if not o.missing):
        return None
    white = replace(e.white, residual=e.white.residual / np.sqrt(k), jacobian=e.white.jacobian / np.sqrt(k))
    return k if misfit(replace(e, white=white), campaign).fits else None


def said(k: float, noise: str) -> str:
    """Say by how much all standard deviations are too small, and what they are of."""
    return (
        f"chi2 of every model is {k:.3g} times too large on all records, channels and harmonics alike: the standard "
        f"deviations of {noise} are stated too small by about {np.sqrt(k):.3g}; the causes below may be noise."
    )
