"""What is judged where no cause is named: the rig file as it is, calibrated, or with what a room does to it."""

from collections.abc import Callable, Sequence
from functools import cached_property

from hbm.diagnosis.calibrate import tolerable
from hbm.diagnosis.judge import beside_noise
from hbm.diagnosis.misfit import misfit, nrmse
from hbm.diagnosis.order import of_a_room, told_of_room
from hbm.diagnosis.predict import SAYS_NOTHING, Predicted
from hbm.diagnosis.remainder import beyond_noise
from hbm.diagnosis.verdict import Verdict
from hbm.outputerror.background import LARGEST
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation
from hbm.outputerror.model import Model


class NoCause:
    """The models without a cause, on the records fitted and on those held out.

    Parameters
    ----------
    trust : Model
        Tolerances of the rig file.
    nominal, base : Evaluation
        The rig file as it is, and what stands without a cause, which may be the same.
    fits : sequence of Evaluation
        Of all causes tried.
    campaign : Campaign
        The records fitted, beside noise alone.
    scored : callable
        A model on the records held out; None where there are none, or where it has no steady state.
    """

    def __init__(
        self,
        trust: Model,
        nominal: Evaluation,
        base: Evaluation,
        fits: Sequence[Evaluation],
        campaign: Campaign,
        scored: Callable[[Evaluation], Predicted | None],
    ) -> None:
        self.trust, self.nominal, self.base = trust, nominal, base
        self.fits, self.campaign, self.scored = fits, campaign, scored

    @property
    def verdict(self) -> Verdict:
        """Consistent where noise, or a background, is all that is left within tolerances, held out too."""
        white, scored = self._noise(self.judged).white, self.scored(self.judged)
        if nrmse(white) > SAYS_NOTHING:
            return "unexplained"
        if self._fits(self.judged) and (scored is None or scored.misfit.fits):
            return "consistent"
        whites = [white, *([] if scored is None else [scored.evaluation.white])]
        return "consistent" if all(beyond_noise(w) <= LARGEST for w in whites) else "unexplained"

    @cached_property
    def judged(self) -> Evaluation:
        """What is judged: the rig file as it is, where calibration ends at its bounds.

        Or trades the response for its most precise harmonics: leaves more of it, of the records held out too. What a
        room does to it comes in where more than noise is left otherwise.
        """
        base = self.base if tolerable(self.trust, self.base) else self.nominal
        left, before = ([nrmse(self._noise(e).white), *self._unseen(e)] for e in (base, self.nominal))
        if all(a > b for a, b in zip(left, before, strict=True)):
            base = self.nominal
        return base if self._fits(base) or self._room is None else self._room

    @property
    def told(self) -> str:
        """What a room does, where that is judged; else nothing."""
        return "" if self.judged is self.base or self.judged is self.nominal else told_of_room(self.judged)

    @cached_property
    def _room(self) -> Evaluation | None:
        """A drift of no more than what a room does that leaves noise alone, on the records held out too."""
        e = of_a_room(f for f in self.fits if tolerable(self.trust, f))
        if e is None or not self._fits(e):
            return None
        scored = self.scored(e)
        return e if scored is None or scored.misfit.fits else None

    def _unseen(self, e: Evaluation) -> list[float]:
        """Error of a model on the records held out, if there are any."""
        scored = self.scored(e)
        return [] if scored is None else [scored.errors.nrmse]

    def _noise(self, e: Evaluation) -> Evaluation:
        """A model beside noise alone."""
        return beside_noise(e, self.campaign)

    def _fits(self, e: Evaluation) -> bool:
        """Whether a model leaves noise alone of the records fitted."""
        return misfit(self._noise(e), self.campaign).fits
