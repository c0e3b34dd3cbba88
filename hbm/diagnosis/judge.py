"""Models beside a background: what they leave that no candidate describes counts as neither noise nor proof.

What the best model leaves says how large the background may be; all models are then compared, and their numbers known,
as well as that allows.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from hbm.diagnosis.background import Linear, likeliest_sizes
from hbm.diagnosis.fit import Evaluation
from hbm.diagnosis.records import Campaign
from hbm.fourier import Array

FREE = 1e-12
"""Precision of a number of which nothing is known before."""


def linear(e: Evaluation, campaign: Campaign) -> Linear:
    """A model near where it is, its disturbances among the numbers."""
    campaign = replace(campaign, corrections=e.corrections)
    there = [r for r in campaign.data.records if r.number in e.found]
    rows, disturbances = campaign.unwhitened(there, e.found, e.by_x)
    std = np.array([f.std for f in e.model.free])
    expected = np.array([f.expected for f in e.model.free])
    known = np.isfinite(std)
    precision = np.where(known, 1.0 / np.where(known, std, 1.0) ** 2, FREE)
    none = np.zeros(disturbances.shape[1])
    return Linear(
        campaign.basis([r.number for r in there]),
        rows[:, 0],
        np.hstack([rows[:, 1:], disturbances]),
        np.concatenate([precision, none + 1.0]),
        np.concatenate([np.where(known, e.x - expected, 0.0), none]),
    )


def background_of(e: Evaluation, campaign: Campaign) -> Mapping[int, float]:
    """Size of what a model leaves, by harmonic, as far as it may be a background."""
    return likeliest_sizes(linear(e, campaign))


def widened(e: Evaluation, campaign: Campaign) -> Evaluation:
    """A model where it is, beside noise and whatever background the campaign has."""
    return replace(e, white=replace(campaign, corrections=e.corrections).whiten(e.found, e.by_x))


def beside(e: Evaluation, campaign: Campaign) -> Evaluation:
    """A model where it is likeliest beside the background of a campaign, to first order."""
    there = widened(e, campaign)
    white, step = there.white, _step(there)
    return replace(there, x=e.x + step, white=replace(white, residual=white.residual - white.jacobian @ step))


def _step(e: Evaluation) -> Array:
    if not len(e.x):
        return e.x
    low, high = e.model.bounds()
    std = np.array([f.std for f in e.model.free])
    gradient = e.white.jacobian.T @ e.white.residual - e.pulls / std
    return np.asarray(np.clip(e.x + e.covariance @ gradient, low, high) - e.x)
