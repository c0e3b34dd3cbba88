"""Whether what a model misses has an order from record to record, as everything has but a transient.

What is missing in a record is put into one complex force beside the measured one, over the motion where it acts: a
dynamic stiffness, which whatever belongs to the rig leaves alike at neighbouring frequencies of a level. What is left
of a transient is of another phase in every record.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TypeVar

import numpy as np

from hbm.diagnosis.projection import Span
from hbm.fourier import Array
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation
from hbm.outputerror.groups import near_each_other
from hbm.outputerror.records import Record, force_columns
from hbm.outputerror.simulated import Simulated
from models.causes.records import ParameterDrift

Item = TypeVar("Item")

CLEAR, CLEAREST = 3.0, 10.0
"""Records count that miss a force of so many standard deviations, the more so the clearer that is up to the second."""

LEVEL, NEAR = 1.12, 1.1
"""Records are of one level whose forces follow each other by less than the first factor, and neighbours whose
frequencies do by less than the second."""

ALIKE, CHANCE = 0.4, 1.64
"""There is an order where the cosine between neighbours is more than this on the mean, and than so many standard
deviations of that mean where there is none."""

TOLERANCES_LEAVE = 0.01
"""Share of the excess of chi2 that is left, at most, where numbers within tolerances were most of what was wrong."""

ROOM = 2e-3
"""What drifts by no more than this over the records, relative, does what a room of changing temperature does: steel
loses about 3e-4 of its stiffness per kelvin."""


@dataclass(frozen=True)
class _Missing:
    """Force that a record misses over the motion, by its phase alone, and how clear it is in standard deviations."""

    record: Record
    phase: complex
    clear: float


def ordered(base: Evaluation, campaign: Campaign) -> bool:
    """Whether the force that neighbouring records miss is alike over their motion.

    Parameters
    ----------
    base : Evaluation
        A model beside the records.
    campaign : Campaign

    Returns
    -------
    bool
        False where no two neighbours miss one clearly.
    """
    levels = _by_level(_clear(base, campaign), lambda m: m.record)
    pairs = [(a, b) for level in levels for a, b in pairwise(level) if b.record.hz < NEAR * a.record.hz]
    weight = np.array([min(a.clear, CLEAREST) * min(b.clear, CLEAREST) for a, b in pairs])
    cosine = np.array([(a.phase * b.phase.conjugate()).real for a, b in pairs])
    return bool(weight @ cosine > max(ALIKE * weight.sum(), CHANCE * np.sqrt(weight @ weight / 2.0)))


def apart(base: Evaluation, campaign: Campaign) -> bool:
    """Whether some records miss a force clearly, and none of these was measured beside another one.

    Then nothing says whether there is an order.

    Parameters
    ----------
    base : Evaluation
        A model beside the records.
    campaign : Campaign
    """
    clear = {m.record.number for m in _clear(base, campaign)}
    levels = _by_level(_there(base, campaign), lambda r: r)
    beside = [{a.number, b.number} for level in levels for a, b in pairwise(level) if b.hz < NEAR * a.hz]
    return bool(clear) and not any(clear & pair for pair in beside)


def _there(base: Evaluation, campaign: Campaign) -> list[Record]:
    return [r for r in campaign.data.records if r.number in base.found and r.listed.any()]


def _clear(base: Evaluation, campaign: Campaign) -> list[_Missing]:
    """What is missing in records where that is clear."""
    missing = (_missing(r, base.found[r.number], campaign) for r in _there(base, campaign))
    return [m for m in missing if m.clear > CLEAR]


def _by_level(items: Sequence[Item], record: Callable[[Item], Record]) -> list[list[Item]]:
    """Items level by level, in the order of their frequencies."""
    levels = near_each_other(items, lambda item: record(item).force, LEVEL)
    return [sorted(level, key=lambda item: record(item).hz) for level in levels]


def _missing(record: Record, simulated: Simulated, campaign: Campaign) -> _Missing:
    std = campaign.listed_std(record)
    by_force = force_columns(replace(record, force_std=1.0), simulated.amplitudes, simulated.by_force)
    columns = by_force[:, record.listed] / std
    covariance = np.linalg.pinv(columns @ columns.T)
    force = complex(*(covariance @ (columns @ (campaign.missed(record, simulated) / std))))
    motion = simulated.solution.basis.complex(simulated.solution["drive"].coefficients)[1]
    phase = complex(np.exp(1j * (np.angle(force) - np.angle(motion))))
    return _Missing(record, phase, abs(force) / float(np.hypot(np.sqrt(np.trace(covariance)), record.force_std)))


def disordered(base: Evaluation, nominal: Evaluation, campaign: Campaign) -> bool:
    """Whether what a model misses has no order, where neighbours say so.

    Calibration may take the order from an effect with what it takes of it: only where it takes next to all was that
    tolerances alone, and what the rig file as it is misses counts no more.
    """
    left, before = (e.white.chi2 - len(e.white) for e in (base, nominal))
    models = {base} if left < TOLERANCES_LEAVE * before else {base, nominal}
    return not any(ordered(e, campaign) or apart(e, campaign) for e in models)


def drifts_within_levels(e: Evaluation, campaign: Campaign) -> bool:
    """Whether no more is explained where what drifts is free at each level, but by chance; true where nothing drifts.

    Where levels were measured one after the other, all that depends on the amplitude looks like a drift.

    Parameters
    ----------
    e : Evaluation
        A model beside the records.
    campaign : Campaign
        As it was evaluated.
    """
    causes = [e.model.causes[f.cause] if f.cause >= 0 else None for f in e.model.free]
    rates = [i for i, cause in enumerate(causes) if isinstance(cause, ParameterDrift)]
    return all(_evenly(e, rate, replace(campaign, corrections=e.corrections)) for rate in rates)


def drifts_beyond_rooms(e: Evaluation) -> bool:
    """Whether what drifts does so by more than a room makes it; true where nothing drifts."""
    over = max(e.found) - min(e.found)
    return all(abs(e.values[i, "rate"]) * over > ROOM for i in _drifting(e))


def of_a_room(fits: Iterable[Evaluation]) -> Evaluation | None:
    """The first of some fits that has no cause but a drift of what a room does."""
    drifts = (e for e in fits if len(e.model.causes) == 1 and _drifting(e) and not e.missing)
    return next((e for e in drifts if not drifts_beyond_rooms(e)), None)


def told_of_room(e: Evaluation) -> str:
    """A sentence on such a drift."""
    drift = e.model.causes[0]
    assert isinstance(drift, ParameterDrift)
    change = e.values[0, "rate"] * (max(e.found) - min(e.found))
    return f"{drift.parameter} drifts by {change:+.2%} over all records: no cause, for rooms that grow warm do as much."


def rooms_do(e: Evaluation, fits: Iterable[Evaluation], margin: float) -> bool:
    """Whether a drift of what a room does explains nearly as much as a larger one, its BIC higher by a margin at most.

    A resonance moves by as much where a room changes the stiffness by little as where friction changes by far more.
    """
    alike = (o for o in fits if _drifting(o) and not drifts_beyond_rooms(o))
    return bool(_drifting(e)) and any(o.bic <= e.bic + margin for o in alike)


def _drifting(e: Evaluation) -> list[int]:
    """Places among the causes of those that drift."""
    return [i for i, cause in enumerate(e.model.causes) if isinstance(cause, ParameterDrift)]


def _evenly(e: Evaluation, rate: int, campaign: Campaign) -> bool:
    """The same of what has this rate of drift."""
    there = [r for r in campaign.data.records if r.number in e.found]
    levels = [[r.number for r in level] for level in near_each_other(there, lambda r: r.force, LEVEL)]
    known = np.vstack([np.column_stack([e.white.jacobian, e.white.residual]), np.column_stack([e.expected, -e.pulls])])
    own = np.vstack([_offsets(e, rate, campaign, levels), np.zeros((len(e.x), len(levels)))])
    # what is off in all records alike is the number itself, within its tolerance
    spans = (Span(np.column_stack([known[:, :-1], more])) for more in (own.sum(axis=1), own))
    alike, each = (np.sum(span.across(known[:, -1]) ** 2) for span in spans)
    return bool(alike - each <= (len(levels) - 1) * np.log(len(e.white)))


def _offsets(e: Evaluation, rate: int, campaign: Campaign, levels: Sequence[Sequence[int]]) -> Array:
    """Derivatives (m, levels) of the records to what drifts, off in one level alone; not of the first record."""
    columns = []
    for level in levels:
        after = {number: 1.0 / (number - 1) if number in level and number > 1 else 0.0 for number in e.found}
        off = {number: replace(s, by_keys=s.by_keys * after[number]) for number, s in e.found.items()}
        columns.append(campaign.whiten(off, e.by_x[:, [rate]]).jacobian[:, 0])
    return np.stack(columns, axis=1)
