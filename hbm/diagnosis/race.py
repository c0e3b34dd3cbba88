"""Candidates against each other: quickly on few records, the best of them on all.

The quick heat compares starts, then takes some steps from the best two, on a coarse discretisation; the final is exact.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from continuation import ConvergenceError
from hbm.diagnosis.fit import Evaluation, best_start, fit_model
from hbm.diagnosis.model import Model
from hbm.diagnosis.records import FAILURES, Campaign
from hbm.diagnosis.screen import Screening, coarse, spread, starting
from hbm.fourier import Array
from models.causes.cause import Cause

HEAT_RECORDS = 6
"""Records of the quick heat."""

HEAT_STEPS = 7
HEAT_STARTS = 2
"""Starts from which the quick heat takes steps, so many of them."""

FINALISTS = 5
"""Candidates that are fitted to all records, and those as close as this to the best:"""

CLOSE = 30.0

LINEAR = 3.0
"""Where the mean square misfit is below this, the score test is trusted to say who runs."""

PROMISING = 25.0
"""Then those run whose predicted fall of chi2 is within this of the best, or within half of it."""

EXPLAINED = 1.5
"""Mean square misfit of the quick heat from which on only look-alikes of the best one run,"""

ALIKE = 0.7
"""those whose signature has this cosine with it."""

SECOND = 3.0
"""The second start is tried where its chi2 is within this factor of the best."""


@dataclass(frozen=True, eq=False)
class Runner:
    """A candidate after the quick heat: chi2 on its records, and where it stands."""

    cause: Cause
    chi2: float
    x: Array


def race(
    base: Evaluation,
    campaign: Campaign,
    candidates: Sequence[Cause],
    screening: Screening | None,
    tell: Callable[[str], None],
) -> list[Evaluation]:
    """Fit the candidates that may explain a misfit, over a calibrated model.

    Parameters
    ----------
    base : Evaluation
        The calibrated model on the records.
    campaign : Campaign
    candidates : sequence of Cause
    screening : Screening or None
        Where given, it decides who runs if the misfit is small, and where places start.
    tell : callable
        Progress.

    Returns
    -------
    list of Evaluation
        Of the finalists on all records, the least chi2 first.
    """
    few = coarse(campaign, [n for n in spread(campaign, HEAT_RECORDS) if n in base.found])
    running = list(_promising(base, candidates, screening))
    heat: list[Runner] = []
    for i, cause in enumerate(running):
        if screening is not None and _settled(heat, few, cause, screening):
            continue
        tell(f"{cause.label} ({i + 1} of {len(running)})")
        runner = _heat(base, few, cause)
        if runner is not None:
            heat.append(runner)
    heat.sort(key=lambda r: r.chi2)
    if not heat:
        return []
    scale = len(campaign.numbers) / len(few.numbers)
    finalists = [r for i, r in enumerate(heat) if i < FINALISTS and scale * (r.chi2 - heat[0].chi2) < _margin(heat[0])]
    done = []
    for runner in finalists:
        tell(f"{runner.cause.label}, all records")
        try:
            done.append(fit_model(base.model.extended_by(runner.cause), campaign, runner.x, base.solutions))
        except FAILURES:
            continue
    return sorted(done, key=lambda e: e.chi2)


def _settled(heat: Sequence[Runner], few: Campaign, cause: Cause, screening: Screening) -> bool:
    """Whether a candidate that ran explains the records and this one looks different."""
    winner = min(heat, key=lambda r: r.chi2, default=None)
    if winner is None or winner.chi2 > EXPLAINED * few.points:
        return False
    return cause.label not in screening.look_alikes(winner.cause.label, ALIKE)


def _margin(best: Runner) -> float:
    """Within which the quick heat does not decide."""
    return max(10 * CLOSE, best.chi2)


def _promising(base: Evaluation, candidates: Iterable[Cause], screening: Screening | None) -> Iterable[Cause]:
    if screening is None or base.white.chi2 > LINEAR * len(base.white):
        return [s.cause for s in screening.scores] if screening is not None else candidates
    drops = [s.drop for s in screening.scores]
    least = max(0.0, min(drops[0] - PROMISING, 0.5 * drops[0]))
    return [s.cause for s in screening.scores if s.drop >= least and s.drop > 0.0]


def _heat(base: Evaluation, few: Campaign, cause: Cause) -> Runner | None:
    model = base.model.extended_by(cause)
    try:
        here = starting(model, base, {})
        starts = _starts(model, here)
        if not base.model.causes:  # calibration may have gone far to make up for the cause
            starts += _starts(model, model.start)
        ordered = best_start(model, few, starts, base.solutions)
        near = [x for chi2, x in ordered[:HEAT_STARTS] if chi2 <= SECOND * ordered[0][0]]
        fits = [fit_model(model, few, x, base.solutions, HEAT_STEPS, settled=1.0) for x in near]
    except (*FAILURES, ConvergenceError):
        return None
    best = min(fits, key=lambda e: e.chi2 + 1e6 * len(e.missing))
    return Runner(cause, best.chi2, best.x)


def _starts(model: Model, x: Array) -> list[Array]:
    """Where the last cause may start, everything else as in `x`."""
    own = np.array([f.cause == len(model.causes) - 1 for f in model.free])
    unique = {tuple(s[own]) for s in model.starts(x)}
    return [np.where(own, _placed(own, values), x) for values in sorted(unique)]


def _placed(own: Array, values: tuple[float, ...]) -> Array:
    out = np.zeros(len(own))
    out[own] = values
    return out
