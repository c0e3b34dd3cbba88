"""Predictions of a fitted model for records that no fit has seen."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hbm.diagnosis.misfit import Misfit, likeliest, misfit_of_new, nrmse
from hbm.diagnosis.remainder import LEFT, explained
from hbm.diagnosis.verdict import Errors
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation, evaluate
from hbm.outputerror.simulated import FAILURES
from hbm.outputerror.whitened import Whitened

LINEARISED = 4
"""Times the prediction of records held out is linearised anew where the first does not fit, at most;"""

FALLING = 0.8
"""while its chi2 falls to less than this share."""


WORSE = 1.05
"""So many times what calibration leaves of the records a cause that leaves more than noise may leave, at most."""

SAYS_NOTHING = 0.3
"""Records that a model misses by this share of the response, or of what was missed before if that was more, agree with
nothing, whatever their noise; unless it takes next to all of the misfit fitted, and nearly all of that held out."""


@dataclass(frozen=True, eq=False)
class Predicted:
    """A model on the records held out."""

    evaluation: Evaluation
    misfit: Misfit

    @property
    def errors(self) -> Errors:
        """Relative error, and noise variances on the mean."""
        return Errors(self.misfit.nrmse, self.evaluation.white.charged / len(self.evaluation.white))


def errors_of(models: Mapping[str, tuple[Evaluation, Predicted | None]]) -> dict[str, dict[str, Errors]]:
    """Errors of models on the records fitted and, where there are any, on those held out."""
    return {
        name: {"train": Errors(nrmse(e.white), e.white.charged / len(e.white))}
        | ({} if scored is None else {"held_out": scored.errors})
        for name, (e, scored) in models.items()
    }


def predicted(e: Evaluation, hidden: Campaign | None) -> Predicted | None:
    """A fitted model on records held out; None where there are none, or where they have no steady state."""
    if hidden is None:
        return None
    try:
        rough = evaluate(e.model, hidden, e.x, {})
        there = evaluate(e.model, hidden.corrected(e.model.rig(e.x), rough.solutions), e.x, rough.solutions)
    except FAILURES:
        return None
    first = misfit_of_new(there, e.x, e.covariance, hidden)
    return Predicted(there, replace(_within(there, e, first, hidden), nrmse=nrmse(there.white.predicted)))


def foretells(scored: Predicted | None, plain: Predicted | None) -> bool:
    """Whether the error on records held out, nothing fitted to them, is no larger than that of a model without a cause.

    Nor so large that it says nothing: transients take the place of whatever moves the modes alone, in each record anew.
    """
    if scored is None or plain is None:
        return True
    return scored.errors.nrmse <= min(WORSE * plain.errors.nrmse, SAYS_NOTHING)


def _within(there: Evaluation, e: Evaluation, found: Misfit, hidden: Campaign) -> Misfit:
    """Misfit linearised where it is least within the covariance of the numbers; they stay as they were fitted."""
    low, high = e.model.bounds()
    for _ in range(LINEARISED if len(e.x) else 0):
        if found.fits:
            break
        try:
            x = np.clip(likeliest(there, e.x, e.covariance), low, high)
            there = evaluate(e.model, hidden, x, there.solutions)
        except FAILURES:
            break
        before = found.chi2
        found = min(found, misfit_of_new(there, e.x, e.covariance, hidden), key=lambda m: -m.probability)
        if found.chi2 > FALLING * before:
            break
    return found


def pays_unseen(best: Evaluation, raced: Sequence[Evaluation], unseen: Callable[[Evaluation], Whitened | None]) -> bool:
    """Whether a second cause takes its share of what the first, if that was fitted, leaves of records held out.

    Parameters
    ----------
    best : Evaluation
    raced : sequence of Evaluation
        Fits of all that was tried, first causes alone among them.
    unseen : callable
        Records held out beside a model; None where there are none, or where it has no steady state.
    """
    firsts = [e for e in raced if e.model.causes and e.model.causes == best.model.causes[:-1]]
    after = unseen(best) if firsts else None
    whites = [] if after is None else [white for e in firsts if (white := unseen(e)) is not None]
    return all(explained(white, after) >= 1.0 - LEFT for white in whites if after is not None)
