"""Whether the numbers of a cause are the same at every level and in every band: those of a look-alike are not.

A stop that stands for a hardening spring stiffens from level to level, a Young's modulus that stands for a wrong clock
differs between modes. All that is left may be too little to be told from noise in thousands of squares; put as one
number that changes, it is clear. This is the score test of parameters that vary between groups of records.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import compress

import numpy as np
from scipy import special

from hbm.diagnosis.decide import ALARM, DECISIVE
from hbm.diagnosis.projection import Span
from hbm.diagnosis.remainder import BAND, LEVEL
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation
from hbm.outputerror.groups import near_each_other
from hbm.outputerror.model import Free
from hbm.outputerror.records import Record


@dataclass(frozen=True)
class Varying:
    """Numbers that are not the same in every group of records: the fall of chi2 if they may differ, and in words."""

    gain: float
    sentence: str


def varying(e: Evaluation, campaign: Campaign, std: float = 0.0) -> Varying | None:
    """The clearest change of the first cause's numbers between levels or bands; None where they are constant.

    So they are, as far as anybody is told, where the first of them changes by less than its standard deviation. What a
    level or a band does not determine is not compared: a joint that sticks there does not say at what it slips.

    Parameters
    ----------
    e : Evaluation
        Fit of a cause, all numbers of the rig file that have a tolerance among its own.
    campaign : Campaign
        Its records.
    std : float
        That the first number is said to have.
    """
    found = [v for groups, name in _groupings(campaign) for v in _between(e, groups, name, std)]
    return max(found, key=lambda v: v.gain, default=None)


def _groupings(campaign: Campaign) -> Iterator[tuple[list[list[Record]], Callable[[list[Record]], str]]]:
    records = campaign.data.records
    yield list(near_each_other(records, lambda r: r.force, LEVEL)), _level
    yield list(near_each_other(records, lambda r: r.hz, BAND)), _band


def _level(records: list[Record]) -> str:
    return f"at {np.mean([r.force for r in records]):.3g} N"


def _band(records: list[Record]) -> str:
    return f"about {np.mean([r.hz for r in records]):.3g} Hz"


def _between(
    e: Evaluation, groups: list[list[Record]], name: Callable[[list[Record]], str], std: float
) -> Iterator[Varying]:
    found = [group for group in groups if any(r.number in e.found for r in group)]
    own = [i for i, f in enumerate(e.model.free) if f.cause == 0]
    if len(found) < 2 or not own:
        return
    J, r = np.vstack([e.white.jacobian, e.expected]), np.concatenate([e.white.residual, -e.pulls])
    record = np.concatenate([e.white.record, np.zeros(len(e.x), dtype=int)])
    apart = [np.isin(record, [r.number for r in group])[:, None] * J[:, own] for group in found]
    rest = np.delete(J, own, axis=1)
    each, (free, first) = Span(np.column_stack([rest, *apart])), (e.model.free[own[0]], float(e.x[own[0]]))
    steps, stds = (of_each[rest.shape[1] :: len(own)] for of_each in (each.amplitudes(r), each.std))
    known = [_determined(free, first, *pair) for pair in zip(steps, stds, strict=True)]
    if sum(known) < 2:
        return
    beside = [rest, *(columns for columns, k in zip(apart, known, strict=True) if not k)]
    alike = Span(np.column_stack([*beside, sum(compress(apart, known))]))
    gain = float(np.sum(alike.across(r) ** 2) - np.sum(each.across(r) ** 2))
    if gain < max(DECISIVE, float(special.chdtri(len(own) * (sum(known) - 1), ALARM))):
        return
    # from the number that was found: that it moves with others of the rig file, at all levels alike, is not at issue
    moved = first - alike.amplitudes(r)[sum(columns.shape[1] for columns in beside)]
    values = [free.value(float(np.clip(moved + step, *free.bounds))) for step in compress(steps, known)]
    if np.ptp(values) <= std:
        return
    told = ", ".join(f"{value:.4g} {name(group)}" for value, group in zip(values, compress(found, known), strict=True))
    unit = "" if free.unit == "1" else f" [{free.unit}]"
    yield Varying(gain, f"{free.name}{unit} is not one number: {told} (chi2 falls by {gain:.3g} if it may change)")


def _determined(free: Free, x: float, step: float, std: float) -> bool:
    """Whether records say what a number is: to within itself, and not by an end of its scale that means none.

    A linear number may well be at its end, where a cause has no effect; a limit that is out of reach is not found.
    """
    low, high = free.bounds
    size = 1.0 if free.form == "logarithmic" else abs(x)
    return bool(std < size and (free.form == "linear" or low < x + step < high))
