"""What a rig file leaves of the records fitted, as it is and calibrated, and which models count as explaining it."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from functools import cache

from hbm.diagnosis.calibrate import calibrate, tolerable, trusted
from hbm.diagnosis.decide import DECISIVE, Decision, accepted, best_of, one_of_each, simpler, suspicious
from hbm.diagnosis.fullfits import lifted_off, measurable
from hbm.diagnosis.misfit import misfit
from hbm.diagnosis.order import disordered, drifts_beyond_rooms, drifts_within_levels, rooms_do
from hbm.diagnosis.quickfits import QuickFits
from hbm.diagnosis.remainder import beyond_noise, explained
from hbm.diagnosis.restart import alone, started
from hbm.diagnosis.screen import Screening, screen
from hbm.errors import InputError
from hbm.measurement.spectra import MeasuredSpectra
from hbm.outputerror.background import LARGEST
from hbm.outputerror.evaluation import Evaluation, evaluate
from hbm.outputerror.measured import campaign_of
from hbm.outputerror.model import Model
from models.causes.cause import Cause
from models.causes.parameter import WrongParameter
from models.causes.records import NotSteady
from models.causes.structure import ContactLoss
from models.jointed import AnyRig, JointedRig
from models.scalars import SENSORS

NEARLY, NEXT_TO_ALL = 0.9, 0.999
"""Share of the misfit that a cause explains next to all of; and the one from which on it may leave more than a
background: a thousandth of a large effect is that."""

COMPARED = 5
"""Causes, and numbers, that are compared in place of all that calibration has moved."""

OnProgress = Callable[[str, float], None]


class Standing:
    """A rig file beside the records fitted: as it is, calibrated, and what over either counts as an explanation."""

    def __init__(
        self,
        rig: AnyRig,
        spectra: MeasuredSpectra,
        candidates: Sequence[Cause],
        tolerances: Mapping[str, float] | None,
        tell: OnProgress,
        executor: Executor | None,
        before: int = 0,
    ) -> None:
        self.rig, self.spectra, self.tell, self._before = rig, spectra, tell, before
        tell("sensors and numerics", 0.0)
        self.campaign, self.sensors = campaign_of(rig, spectra, executor=executor)
        channels = self.campaign.data.channels
        self.candidates = [c for c in candidates if measurable(c, rig, self.campaign)]
        self.trust = trusted(rig, channels, tolerances)
        self._tolerated = {WrongParameter(key).label: key for key in self.trust.calibrated}
        least = len([f for f in self.trust.free if not f.name.startswith(SENSORS)]) + 1
        if self.campaign.points <= least:
            raise InputError(
                f"{spectra.source}: {self.campaign.points} coefficients; must be more than the {least} numbers to fit"
            )
        tell("nominal", 0.05)
        bare = Model(rig, {})
        rough = evaluate(bare, self.campaign, bare.start, {})
        self.campaign = self.campaign.corrected(rig, rough.solutions)
        self.nominal = evaluate(bare, self.campaign, bare.start, rough.solutions)
        self.first = self.nominal
        if self.identified:
            self.first = evaluate(self.trust, self.campaign, self.trust.start, self.nominal.solutions)
        tell("calibration", 0.1)
        self.calibrated = calibrate(self.trust, self.campaign, self.nominal.solutions)
        self.fitted: list[Evaluation] = []
        self.screenings: list[Screening] = []
        self.quickly: dict[str, bool] = {}
        self.over, self._over_tolerances = cache(self._over_base), cache(self._calibrated_beside)
        self._alone = cache(self._alone_within)
        self._lifted = cache(self._lifted_over)
        self._quick = cache(QuickFits)

    @property
    def identified(self) -> bool:
        """Whether joints act on modes that were identified.

        These are never exact: they move along from the beginning, and all candidates run at once.
        """
        return isinstance(self.rig, JointedRig)

    def _screened(self, base: Evaluation, candidates: Sequence[Cause] | None = None) -> Screening:
        """Scores over a model of candidates, all unless given; of transients only where what is missed has no order.

        Numbers that leave their tolerances bring one of their own.
        """
        offered = self.candidates if candidates is None else candidates
        if not disordered(base if self.tolerable(base) else self.nominal, self.nominal, self.campaign):
            offered = [c for c in offered if not isinstance(c, NotSteady)]
        offered = [c for c in offered if not isinstance(c, ContactLoss)]  # has no size: see lifted_off
        return screen(base, self.campaign, offered)

    def _over_base(self, base: Evaluation) -> Screening:
        """Scores over a model, which take as long as some fits."""
        self.tell("screening" if base is self.first else "screening over the calibrated model", 0.3)
        self.screenings.append(self._screened(base))
        return self.screenings[-1]

    def _alone_within(self, calibrated: Evaluation) -> list[Evaluation]:
        """Over the rig file as it is single numbers within their tolerances, of those that calibration has moved."""
        known = self._tolerated
        moved = [known[s.cause.label] for s in self.over(calibrated).instead if s.cause.label in known]
        return list(alone(self.nominal, calibrated, moved[:COMPARED], self.campaign))

    def _lifted_over(self, base: Evaluation) -> list[Evaluation]:
        """A model whose tip lifts off, where it would: the same for all races over a base."""
        self.fitted += (lifted := lifted_off(base, self.candidates, self.campaign, lambda what: self.tell(what, 0.3)))
        return lifted

    @property
    def tried(self) -> int:
        """Candidates, each shape that was scanned counted, here or before."""
        return max(*(s.tried for s in self.screenings[:1]), self._before, 1)

    def _calibrated_beside(self, found: Evaluation) -> list[Evaluation]:
        """A model with the same causes, its rig file within tolerances."""
        self.tell(f"{found.model.label}, calibrated", 0.5)
        self.fitted += (again := started(self.calibrated, found, found.model.causes, self.campaign))
        return again

    def _settles(self, e: Evaluation) -> bool:
        """Whether a model leaves next to nothing that tolerances of the rig file do not."""
        if self._enough(e):
            return not e.model.calibrated or self._adds(e)
        if e.model.calibrated:
            return self._fits(e) and self._calibrates(e)
        if explained(self.nominal.white, e.white) < NEARLY or not self.tolerable(e):
            return False
        return any(self._enough(again) and self._adds(again) for again in self._over_tolerances(e))

    def _adds(self, e: Evaluation) -> bool:
        """Whether a cause over the calibrated rig file is worth its numbers there, where that leaves noise alone."""
        return not self._fits(self.calibrated) or e.bic < self.calibrated.bic - DECISIVE

    def _calibrates(self, e: Evaluation) -> bool:
        """Whether calibration leaves noise from where a number within its tolerance does, as before it did not.

        It stands there then.
        """
        if self.calibrates:
            return False
        again = started(self.calibrated, e, (), self.campaign)
        further = next((a for a in again if self._fits(a) and self.tolerable(a)), None)
        self.calibrated = further or self.calibrated
        return further is not None

    def _is_small_error(self, e: Evaluation) -> bool:
        """Whether a model is one number of the rig file, within its tolerance."""
        return e.model.label in self._tolerated and not self.tolerable(e)

    def _calibrated_from(self, found: Evaluation) -> Evaluation | None:
        """Calibration from where a cause is found, where it gets further: then it had ended in a wrong valley."""
        again = started(self.calibrated, found, (), self.campaign)
        return next((e for e in again if e.chi2 <= self.calibrated.chi2 - DECISIVE), None)

    def _fitted_over(self, model: Model) -> list[Evaluation]:
        """What was fitted over the same rig file as a model: as it is, or calibrated."""
        return [e for e in self.fitted if bool(e.model.calibrated) == bool(model.calibrated)]

    def _enough(self, e: Evaluation) -> bool:
        """Whether a model within tolerances leaves noise, or so little that it may be a background."""
        return self.tolerable(e) and self._nearly(e)

    def _nearly(self, e: Evaluation) -> bool:
        """Whether a model leaves noise, or so little of what the rig file does that it may be a background."""
        return self._fits(e) or (self._takes(e) and beyond_noise(e.white) <= LARGEST)

    def _takes(self, e: Evaluation) -> bool:
        """Whether a model takes most of what the rig file leaves, calibrated or not as the model is."""
        before = self.calibrated if e.model.calibrated else self.nominal
        return explained(before.white, e.white) >= NEARLY

    def tolerable(self, e: Evaluation) -> bool:
        """As :func:`hbm.diagnosis.calibrate.tolerable`, by the tolerances of this search."""
        return tolerable(self.trust, e)

    def _decided(self, base: Evaluation, fits: Sequence[Evaluation], tried: int) -> Decision:
        """The best of fits over a base, if it is better than that by more than chance in so many tries.

        What leaves the tolerances of the rig file beside its causes is none of them.
        """
        ranked = one_of_each(best_of([e for e in fits if self.tolerable(e)]))
        best = next((e for e in ranked[:1] if self._accepted(base, e, tried, ranked)), None)
        return Decision(base, best, tuple(ranked))

    def _accepted(self, base: Evaluation, e: Evaluation, tried: int, fits: Sequence[Evaluation]) -> bool:
        """As :func:`hbm.diagnosis.decide.accepted`, of some fits.

        No drift of what a room does, nor one that such a drift does for, or that is of another size at each level.
        """
        better = accepted(base, e, tried) or (base is self.calibrated and self.replaces(e))
        beyond = better and drifts_beyond_rooms(e) and not rooms_do(e, fits, DECISIVE)
        return beyond and drifts_within_levels(e, self.campaign)

    def replaces(self, e: Evaluation) -> bool:
        """Whether a cause that leaves noise is likelier than calibration that leaves its tolerances, which is no story.

        It need not be better than that, but than the rig file as it is. Of identified modes alone: else causes are
        tried over the rig file as it is too.
        """
        if not self.identified or self.tolerable(self.calibrated) or not self._enough(e):
            return False
        return accepted(self.first, e, self.tried) and simpler(e, self.calibrated, self.tried)

    def _explains(self, decision: Decision) -> bool:
        return decision.best is not None and self._fits(decision.best)

    def _fits(self, e: Evaluation) -> bool:
        return misfit(e, self.campaign).fits

    def _within(self) -> bool:
        """Whether numbers of the rig file that move within their tolerances explain everything.

        They may take all of an effect but a rest that noise hides in thousands of squares: a cause that has a name for
        it tells it.
        """
        return self.calibrates and not suspicious(self.over(self.calibrated), self.rig)

    @property
    def calibrates(self) -> bool:
        """Whether numbers of the rig file that move within their tolerances leave noise alone."""
        return self._fits(self.calibrated) and self.tolerable(self.calibrated)
