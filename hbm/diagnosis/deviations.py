"""How exactly the numbers of a cause are known, as noise, a background, the rest of the rig file and kinks allow.

And whether they say, known so, that it matters at all.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import product

import numpy as np
import numpy.typing as npt

from hbm.diagnosis.judge import FREE
from hbm.fourier import Array
from hbm.outputerror.background import weights
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation, evaluate
from hbm.outputerror.simulated import FAILURES

Ints = npt.NDArray[np.int64]

TRUSTED = (0.0, 0.01, 0.03, 0.1, 0.3, 1.0)
"""What the rig file and its modes may be off by, as shares of the tolerances; equally likely before."""

ALONE = 0.5
"""Share of what is known of a number from which on one record alone says it."""

SURE = 3.0
"""Standard deviations by which a number differs for sure."""


def matters(e: Evaluation, std: Array) -> bool:
    """Whether each cause, of those that have a size, has a number that is surely not the one where it changes nothing.

    Parameters
    ----------
    e : Evaluation
    std : (n,) array
        Standard deviations of the values of its numbers.
    """
    for i, unknowns in enumerate(e.model.unknowns):
        neutral = {u.name: u.neutral for u in unknowns if not u.shapes}
        own = [
            (f.value(x), s, neutral[f.name])
            for f, x, s in zip(e.model.free, e.x, std, strict=True)
            if f.cause == i and f.name in neutral
        ]
        if own and not any(_differs(*number) for number in own):
            return False
    return True


def _differs(value: float, std: float, neutral: float) -> bool:
    if np.isinf(neutral):  # an infinite stiffness is a compliance of zero, as uncertain as its inverse
        return np.isfinite(value) and value > SURE * std
    return abs(value - neutral) > SURE * std


def deviations(
    known: Evaluation, wide: Evaluation, modes: tuple[Array, Array], noise: Evaluation, campaign: Campaign
) -> Array:
    """Standard deviations of the values of a model's numbers, (n,): the largest that any of these gives.

    Parameters
    ----------
    known, wide, modes
        As for :func:`std_within`.
    noise : Evaluation
        The fit beside noise alone.
    campaign : Campaign
        Its records, without a background.
    """
    within = std_within(known, wide, *modes)
    return np.asarray(np.max([within, std_of_records(known), std_at_kinks(noise, campaign)], axis=0))


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
        The same with the rig file free within its tolerances; both from :func:`hbm.diagnosis.judge.rig_freed`.
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
    return np.asarray(np.maximum(e.scales * np.sqrt(square), e.std))


def std_of_records(e: Evaluation) -> Array:
    """Standard deviations of the values of a model's numbers by how much the records disagree on them, (n,).

    No covariance is right, least of all beside a jump of the response, where one record may be off by far more than a
    background is elsewhere. Each record pulls the numbers its own way: the mean square of these pulls is what their sum
    is off by, whatever the misfit is made of (Huber, Proc. 5th Berkeley Symp. 1 (1967), 221; White, Econometrica 50
    (1982), 1), records being independent once they are whitened.
    """
    square = _disagreement(e.white.jacobian, e.white.residual, e.white.record, e.covariance, e.expected)
    return np.asarray(e.scales * np.sqrt(square))


def std_at_kinks(e: Evaluation, campaign: Campaign) -> Array:
    """Standard deviations of the values of a model's numbers, (n,), where a record that says one alone has a kink.

    At the onset of slip, of lift-off or of contact with a stop a response changes with a number on one side only, and
    a fit that makes the most of such a record ends at its kink. There a derivative holds for one side. The record is
    simulated one standard deviation to either side, and counts as on the side that says less.
    """
    covariance = e.covariance
    std, known = np.sqrt(np.diag(covariance)), np.linalg.inv(covariance)
    for i, f in enumerate(e.model.free):
        step = covariance[:, i] / std[i]
        record, share = _tells_most(e, step)
        if f.cause >= 0 and share > ALONE:
            own = e.white.jacobian[e.white.record == record]
            others = known - own.T @ own
            sides = (np.linalg.inv(others + J.T @ J)[i, i] for J in _beside(e, campaign, record, step))
            std[i] = max([std[i], *np.sqrt([*sides])])
    return np.asarray(e.scales * std)


def _tells_most(e: Evaluation, step: Array) -> tuple[int, float]:
    """The record that changes most along a step of one standard deviation, and its share of all that is known."""
    change = (e.white.jacobian @ step) ** 2
    numbers = np.unique(e.white.record)
    shares = np.array([change[e.white.record == number].sum() for number in numbers])
    return int(numbers[np.argmax(shares)]), float(shares.max())


def _beside(e: Evaluation, campaign: Campaign, record: int, step: Array) -> Iterator[Array]:
    """Jacobians of a record on either side of a fit, as far as it has a steady state there."""
    alone = replace(campaign.of((record,)), corrections=e.corrections)
    for x in (e.x - step, e.x + step):
        with suppress(*FAILURES):
            yield evaluate(e.model, alone, np.clip(x, *e.model.bounds()), e.solutions).white.jacobian


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
