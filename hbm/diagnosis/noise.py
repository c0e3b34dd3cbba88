"""Whether stated standard deviations are too small, alike everywhere: then no model fits, and none is to blame."""

from dataclasses import replace

import numpy as np

from hbm.diagnosis.misfit import misfit
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.fit import Evaluation

TOO_SMALL = 1.3
"""A misfit of so many noise variances on, everywhere alike, is put down to the standard deviations."""


def understated(e: Evaluation, campaign: Campaign) -> float | None:
    """Noise variances that every record, channel and harmonic is off by alike; None where they are not alike.

    Parameters
    ----------
    e : Evaluation
        A model beside the records of the campaign.
    campaign : Campaign
    """
    found = misfit(e, campaign)
    k = found.chi2 / found.dof
    if found.fits or k < TOO_SMALL:
        return None
    white = replace(e.white, residual=e.white.residual / np.sqrt(k), jacobian=e.white.jacobian / np.sqrt(k))
    return k if misfit(replace(e, white=white), campaign).fits else None


def said(k: float) -> str:
    """Say by how much all standard deviations are too small."""
    return (
        f"chi2 of every model is {k:.3g} times too large on all records, channels and harmonics alike: the standard "
        f"deviations of the spectra file are too small by about {np.sqrt(k):.3g}; the causes below may be noise."
    )
