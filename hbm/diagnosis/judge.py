"""Models beside a background: what they leave that no candidate describes counts as neither noise nor proof.

What the best model leaves says how large the background may be; all models are then compared, and their numbers known,
as well as that allows.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
import numpy.typing as npt

from hbm.diagnosis.decide import DECISIVE, evidence, simpler
from hbm.fourier import Array
from hbm.outputerror.background import Linear, expected_sizes, likeliest_sizes, weights
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.fit import Evaluation, evaluate
from hbm.outputerror.model import Model

Ints = npt.NDArray[np.int64]

FREE = 1e-12
"""Precision of a number of which nothing is known before."""

TRUSTED = (0.0, 0.01, 0.03, 0.1, 0.3, 1.0)
"""What the rig file and its modes may be off by, as shares of the tolerances; equally likely before."""


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


def beside(e: Evaluation, campaign: Campaign) -> Evaluation:
    """A model where it is likeliest beside the background of a campaign, to first order."""
    there = widened(e, campaign)
    white, step = there.white, _step(there)
    return replace(there, x=e.x + step, white=replace(white, residual=white.residual - white.jacobian @ step))


def stands(best: Evaluation, base: Evaluation, rival: Evaluation | None, tried: int, campaign: Campaign) -> bool:
    """Whether a cause is decisively likelier than none, each model beside the background that it leaves itself.

    What noise alone cannot make of a rig file, a background may. `base` is what the cause extends. `rival` is
    the calibrated rig file where that is another one and within its tolerances: many small errors in place of a cause.
    """
    known, before = (_beside_its_own(e, campaign) for e in (best, base))
    if rival is not None and not simpler(known, _beside_its_own(rival, campaign), tried):
        return False
    return bool(evidence(known) + 2.0 * np.log(tried) + DECISIVE < evidence(before))


def _beside_its_own(e: Evaluation, campaign: Campaign) -> Evaluation:
    return beside(e, replace(campaign, background=background_of(e, campaign)))


def _step(e: Evaluation) -> Array:
    if not len(e.x):
        return e.x
    low, high = e.model.bounds()
    std = np.array([f.std for f in e.model.free])
    gradient = e.white.jacobian.T @ e.white.residual - e.pulls / std
    return np.asarray(np.clip(e.x + e.covariance @ gradient, low, high) - e.x)


def freed(e: Evaluation, tolerances: Mapping[str, float], campaign: Campaign) -> Evaluation:
    """A fit of causes over the rig file as it is, whose numbers are free within their tolerances, where it is.

    Raises
    ------
    ConvergenceError
        If the steady state of no record is found.
    """
    model = Model(e.model.nominal, tolerances, e.model.causes)
    known = e.coordinates
    x = np.array([known.get((f.cause, f.name), f.expected) for f in model.free])
    return evaluate(model, replace(campaign, corrections=e.corrections), x, e.solutions)


def std_within(e: Evaluation, wide: Evaluation, frequencies: Array, ratios: Array) -> Array:
    """Standard deviations of the values of a model's numbers, as far as all that it holds may be off too.

    A cause that is found over the rig file as it is has numbers as exact as the noise allows, if all others are exact;
    any cause has, if each mode is. How far they are off is averaged over shares of the tolerances of the rig file, of
    the frequencies of modes and of their damping ratios, each share as likely as it makes the records.

    Parameters
    ----------
    e : Evaluation
        Fit of causes.
    wide : Evaluation
        The same from :func:`freed`, or itself where it is calibrated.
    frequencies, ratios : (m, k) array
        From :func:`hbm.diagnosis.modesoff.by_modes`.

    Returns
    -------
    (n,) array
        About the values of `e`, which stay.
    """
    free, J = wide.model.free, wide.white.jacobian
    held = np.array([f.cause < 0 and not e.model.calibrated for f in free])
    std = np.array([f.std for f in free])
    known = np.isfinite(std[~held])
    precision = np.where(known, 1.0 / np.where(known, std[~held], 1.0) ** 2, FREE)
    pull = np.where(known, (wide.x - [f.expected for f in free])[~held], 0.0)
    others = (J[:, held] * std[held], frequencies, ratios)
    square = _mean_square(J[:, ~held], others, wide.white.residual, precision, pull)
    slopes = np.array([f.slope(x) for f, x in zip(e.model.free, e.x, strict=True)])
    return np.asarray(np.maximum(np.abs(slopes) * np.sqrt(square), e.std))


def std_of_records(e: Evaluation) -> Array:
    """Standard deviations of the values of a model's numbers by how much the records disagree on them, (n,).

    No covariance is right, least of all beside a jump of the response, where one record may be off by far more than a
    background is elsewhere. Each record pulls the numbers its own way: the mean square of these pulls is what their sum
    is off by, whatever the misfit is made of (Huber, Proc. 5th Berkeley Symp. 1 (1967), 221; White, Econometrica 50
    (1982), 1), records being independent once they are whitened.
    """
    slopes = np.array([f.slope(x) for f, x in zip(e.model.free, e.x, strict=True)])
    square = _disagreement(e.white.jacobian, e.white.residual, e.white.record, e.covariance, e.expected)
    return np.asarray(np.abs(slopes) * np.sqrt(square))


def _disagreement(J: Array, residual: Array, record: Ints, covariance: Array, expected: Array) -> Array:
    """Mean square of what numbers are off by as records disagree on them, (n,)."""
    pulls = np.array([J[record == k].T @ residual[record == k] for k in np.unique(record)])
    spread = pulls.T @ pulls * len(pulls) / max(len(pulls) - 1, 1) + expected**2
    return np.asarray(np.einsum("ij,jk,ik->i", covariance, spread, covariance))


def _mean_square(own: Array, others: Sequence[Array], residual: Array, precision: Array, pull: Array) -> Array:
    """Mean square of what numbers are off by, (n,), groups of others being off by a share of one tolerance each.

    `precision` (n,) is what is known of the numbers before, `pull` (n,) how far from expected they are.
    """
    n, groups = own.shape[1], [group for group in others if group.shape[1]]
    rows = np.hstack([own, *groups, residual[:, None]])
    gram = rows.T @ rows
    prior = np.concatenate([precision, np.ones(rows.shape[1] - 1 - n)])
    pulled = np.concatenate([precision * pull, np.zeros(len(prior) - n)])
    squares, deviances = [], []
    for shares in product(TRUSTED, repeat=len(groups)):
        size = np.repeat([1.0, *shares], [n, *(group.shape[1] for group in groups)])
        A = size[:, None] * gram[:-1, :-1] * size + np.diag(prior)
        gradient = size * gram[:-1, -1] - pulled
        covariance = np.linalg.inv(A)
        step = covariance @ gradient
        squares.append((np.diag(covariance) + step**2)[:n])
        deviances.append(float(np.linalg.slogdet(A)[1] - gradient @ step))
    return np.asarray(weights(deviances) @ np.array(squares))
