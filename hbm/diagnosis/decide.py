"""The decision of diagnosis.md section 4: who explains the misfit, who cannot be told from it, and whether it holds.

Accepted over the calibrated nominal is what lowers BIC by more than :data:`DECISIVE` and chi2 by more than chance over
all that were tried (Sidak), and what then fits records it has not seen.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from hbm.diagnosis.fit import Evaluation
from hbm.diagnosis.misfit import SIGNIFICANCE
from hbm.diagnosis.screen import Screening
from hbm.fourier import Array

DECISIVE = 10.0
"""Fall of BIC that a cause must bring."""

TIED = 9.0
"""Causes are not separable where their chi2 differs by less."""


def sidak(tried: int, parameters: int = 1) -> float:
    """Fall of chi2 that chance brings in one of a hundred searches over so many candidates.

    >>> round(sidak(27), 1)
    12.7
    """
    each = -np.expm1(np.log1p(-SIGNIFICANCE) / max(tried, 1))
    return float(stats.chi2.isf(each, parameters))


def suspicious(screening: Screening, points: int) -> bool:
    """Whether the score test finds a cause that would be accepted."""
    if not screening.scores:
        return False
    best = screening.scores[0]
    own = len(best.start) or 1
    return bool(best.drop > max(sidak(screening.tried, own), DECISIVE + own * np.log(points)))


def accepted(base: Evaluation, e: Evaluation, tried: int) -> bool:
    """Whether an extended model is better than the calibrated one by more than chance."""
    more = max(e.model.counted - base.model.counted, 1)
    fell = base.chi2 - e.chi2
    return base.bic - e.bic > DECISIVE and fell > sidak(tried, more)


def best_of(fits: Sequence[Evaluation]) -> list[Evaluation]:
    """Fits in order of BIC; those that lost records come last."""
    return sorted(fits, key=lambda e: (len(e.missing), e.bic))


def tied(fits: Sequence[Evaluation], best: Evaluation) -> list[Evaluation]:
    """Fits that the records cannot tell from the best one."""
    return [e for e in fits if e is not best and abs(e.chi2 - best.chi2) < TIED and not e.missing]


def weights(bics: Sequence[float]) -> Array:
    """Probabilities of models by their BIC alone."""
    b = np.asarray(bics)
    w = np.exp(-0.5 * (b - b.min()))
    return np.asarray(w / w.sum())


@dataclass(frozen=True, eq=False)
class Decision:
    """Outcome of the search on the records fitted.

    Attributes
    ----------
    base : Evaluation
        The calibrated model over which causes were tried.
    best : Evaluation or None
        The one accepted.
    fits : tuple of Evaluation
        All that were fitted to all records, the best first.
    """

    base: Evaluation
    best: Evaluation | None
    fits: tuple[Evaluation, ...]
