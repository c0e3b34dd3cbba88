"""Models beside a background: what they leave that no candidate describes counts as neither noise nor proof.

What the best model leaves says how large the background may be; all models are then compared, and their numbers known,
as well as that allows.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from hbm.diagnosis.decide import evidence, simpler
from hbm.outputerror.background import Linear, expected_sizes, likeliest_sizes
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation, evaluate
from hbm.outputerror.fit import bounded_step
from hbm.outputerror.model import Model

CLEAR = 100.0
"""A cause whose lead over none is less must have a number that is surely not the one at which it changes nothing."""

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


def possible_background_of(e: Evaluation, campaign: Campaign) -> Mapping[int, float]:
    """Size by harmonic of the background that may be in what a model leaves, even if noise alone may be."""
    return expected_sizes(linear(e, campaign))


def widened(e: Evaluation, campaign: Campaign) -> Evaluation:
    """A model where it is, beside noise and whatever background the campaign has."""
    return replace(e, white=replace(campaign, corrections=e.corrections).whiten(e.found, e.by_x))


def beside_noise(e: Evaluation, campaign: Campaign) -> Evaluation:
    """A model of a campaign where it is, beside noise alone."""
    return widened(e, replace(campaign, background={})) if any(campaign.background.values()) else e


def beside(e: Evaluation, campaign: Campaign) -> Evaluation:
    """A model where it is likeliest beside the background of a campaign, to first order."""
    there = widened(e, campaign)
    white, step = there.white, bounded_step(there)[0] if len(e.x) else e.x
    return replace(there, x=e.x + step, white=replace(white, residual=white.residual - white.jacobian @ step))


def lead(best: Evaluation, base: Evaluation, rival: Evaluation | None, tried: int, campaign: Campaign) -> float:
    """Fall of twice the logarithm of the evidence from no cause to one, each model beside what it leaves itself.

    What noise alone cannot make of a rig file, a background may. `base` is what the cause extends. `rival` is
    the calibrated rig file where that is another one and within its tolerances: many small errors in place of a cause.
    Minus infinity where these are likelier.
    """
    known, before = (_beside_its_own(e, campaign) for e in (best, base))
    if rival is not None and not simpler(known, _beside_its_own(rival, campaign), tried):
        return -np.inf
    return float(evidence(before) - evidence(known) - 2.0 * np.log(tried))


def _beside_its_own(e: Evaluation, campaign: Campaign) -> Evaluation:
    return beside(e, replace(campaign, background=background_of(e, campaign)))


def rig_freed(e: Evaluation, trust: Model, campaign: Campaign) -> tuple[Evaluation, Evaluation]:
    """A fit of causes beside the background of a campaign; and with all of the rig that has a tolerance free within it.

    Raises
    ------
    ConvergenceError
        If the steady state of no record is found.
    """
    known = widened(e, campaign)
    if known.model.calibrated:
        return known, known
    model = Model(e.model.nominal, trust.calibrated, e.model.causes)
    x = model.at(known.values)
    return known, evaluate(model, replace(campaign, corrections=e.corrections), x, e.solutions)
