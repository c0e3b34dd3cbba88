"""The conclusion from a decision: scored on the records held out, and said in numbers and sentences."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache, cached_property, partial

import numpy as np

from hbm.diagnosis.confidence import FORETOLD, RELIABLE, nothing_missing, rivals
from hbm.diagnosis.constancy import Varying, varying
from hbm.diagnosis.decide import DECISIVE, TIED, Decision, contenders, inclusion, seconded, tied
from hbm.diagnosis.deviations import deviations, matters
from hbm.diagnosis.estimates import beside_it, estimates, name_of, ranked, told_of
from hbm.diagnosis.evidence import Evidence
from hbm.diagnosis.judge import CLEAR, beside, beside_noise, lead, possible_background_of, rig_freed
from hbm.diagnosis.misfit import misfit, nrmse
from hbm.diagnosis.modesoff import by_modes
from hbm.diagnosis.nocause import NoCause
from hbm.diagnosis.predict import SAYS_NOTHING, WORSE, Predicted, errors_of, foretells, pays_unseen, predicted
from hbm.diagnosis.remainder import Remainder, beyond_noise, explained, remainder, tells, within_noise
from hbm.diagnosis.search import Search
from hbm.diagnosis.separate import separate
from hbm.diagnosis.standing import NEARLY, NEXT_TO_ALL
from hbm.diagnosis.untested import to_hold_out
from hbm.diagnosis.verdict import NAMED, Diagnosis, Errors, Verdict
from hbm.fourier import Array
from hbm.measurement.spectra import MeasuredSpectra
from hbm.outputerror.background import CHANGING, LARGEST
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation, evaluate
from hbm.outputerror.measured import campaign_of
from hbm.outputerror.simulated import FAILURES
from hbm.outputerror.whitened import Whitened
from models.causes.cause import Cause

MAIN, NOTABLE = 0.5, 0.005
"""Share of the misfit of the rig file, on records held out too, that a main cause explains; and how large that misfit
is, relative to the response, where a cause is named that leaves more than noise."""

BETTER = 0.5
"""Another cause foretells records held out much better where it leaves less than this share of the error."""

AS_GOOD = 4.0
"""Records held out may fit a cause worse than a calibrated nominal by this chi2, which does not fit them either."""


class Conclusion:
    """The decision scored on the records held out, and said."""

    def __init__(
        self, search: Search, decision: Decision, unseen: MeasuredSpectra | None, held: tuple[int, ...]
    ) -> None:
        self.search, self.decision, self.held = search, decision, held
        search.tell("records held out", 0.9)
        self.campaign = replace(search.campaign, background={})  # errors are in standard deviations of the noise
        self.hidden = (
            None
            if unseen is None
            else campaign_of(search.rig, unseen, self.campaign.numerics, self.campaign.executor)[0]
        )
        self._predicted = cache(partial(predicted, hidden=self.hidden))
        self.nominal, self.calibrated = self._predicted(search.nominal), self._predicted(search.calibrated)
        if decision.best is not None and not self._paid(decision.best):
            self.decision = decision = search.without_second(decision, decision.best)
        self.best = None if decision.best is None else (decision.best, self._predicted(decision.best))
        bare = decision.base if decision.best is None else search.calibrated
        self._no_cause = NoCause(search.trust, search.nominal, bare, decision.fits, self.campaign, self._scored)

    def _paid(self, best: Evaluation) -> bool:
        """Whether noise alone is left, or a second cause takes its share of the records held out too."""
        return misfit(self._noise(best), self.campaign).fits or pays_unseen(best, self.search.fitted, self._unseen)

    def _unseen(self, e: Evaluation) -> Whitened | None:
        """Records held out beside a model."""
        scored = self._predicted(e)
        return None if scored is None else scored.evaluation.white

    def _noise(self, e: Evaluation) -> Evaluation:
        """A model beside noise alone."""
        return beside_noise(e, self.search.campaign)

    @property
    def plain(self) -> dict[str, tuple[Evaluation, Predicted | None]]:
        """The models without a cause, on the records fitted and on those held out."""
        search = self.search
        return {"nominal": (search.nominal, self.nominal), "calibrated": (search.calibrated, self.calibrated)}

    @property
    def untold(self) -> bool:
        """Whether the records fitted are explained, but for a background, and do not tell of those held out.

        Or name a main cause where another one foretells these much better.
        """
        if self.hidden is None:
            return False
        if self.verdict == "main-cause":
            return self._nrmse_held_out[0] is not None and any(self._better)
        story = self._noise(self.decision.story)
        told = misfit(story, self.campaign).fits or beyond_noise(story.white) <= LARGEST
        return self.verdict == "unexplained" and told and nrmse(story.white) <= SAYS_NOTHING

    @property
    def contenders(self) -> list[Cause]:
        """Causes that more records are to decide between."""
        scores = self.search.over(self.search.calibrated).scores
        return contenders(self.decision.fits, self._better, scores, self.search.candidates)

    @property
    def _better(self) -> list[bool]:
        """Of the fits, which foretell the records held out much better than the first does."""
        foretold = [np.inf if error is None else error for error in self._nrmse_held_out]
        return [error < BETTER * foretold[0] for error in foretold]

    def diagnosis(self) -> Diagnosis:
        """Verdict, and all that supports it."""
        verdict = self.verdict
        best = self.decision.best if verdict in NAMED else None
        ties, seconds = ([], []) if best is None else self._ties(best)
        told = self._no_cause.told if verdict == "consistent" else ""
        return Diagnosis(
            verdict=verdict,
            cause=None if best is None else name_of(best),
            parameters={} if best is None else estimates(best, self._std),
            confidence=self._confidence(verdict, best),
            not_separable=tuple(dict.fromkeys(told_of(e) for e in ties)),
            separate_by=self._advice(best, ties),
            seconds=tuple(map(beside_it, seconds)),
            room=told,
            remainder=self._remainder(best),
            errors=self._errors(best),
            held_out_records=self.held,
            ranking=tuple(map(ranked, self.decision.fits, self._nrmse_held_out)),
            evidence=(*self._evidence.lines(verdict, best, seconds), *self._to_hold_out(best), *filter(None, [told])),
            extended=None if best is None else best.model.rig(best.x),
            nominal=self.search.nominal,
            calibrated=self.search.calibrated,
            extended_fit=None if best is None else self._noise(best),
            campaign=replace(self.campaign, executor=None),
            held=self._held(best),
            held_campaign=None if self.hidden is None else replace(self.hidden, executor=None),
            tried=self.decision.fits,
        )

    def _ties(self, best: Evaluation) -> tuple[list[Evaluation], list[Evaluation]]:
        """Fits of another cause that cannot be told from the best one, beside whatever background there may be.

        And of two causes those with another second one.
        """
        fits = [e if e.missing else beside(e, self._beside) for e in self.decision.fits]
        ties, first = tied(fits, beside(best, self._beside)), best.model.causes[0]
        return [e for e in ties if e.model.causes[0] != first], [e for e in ties if seconded(best, e)]

    @cached_property
    def _beside(self) -> Campaign:
        """The records beside whatever background there may be."""
        assert self.best is not None
        if any(self.search.campaign.background.values()):
            return self.search.campaign
        return replace(self.campaign, background=possible_background_of(self.best[0], self.campaign))

    @cached_property
    def _varying(self) -> Varying | None:
        """How the numbers of the cause change between levels or bands, which those of a look-alike do."""
        assert self.best is not None
        _, wide = rig_freed(self.best[0], self.search.trust, replace(self._beside, reach=CHANGING))
        if not wide.settled:
            return None
        own = [i for i, f in enumerate(self.best[0].model.free) if f.cause == 0]
        return varying(wide, self.campaign, float(self._std[own[0]]) if own else 0.0)

    @cached_property
    def _std(self) -> Array:
        """Of the numbers of the best cause, as a background, the rest of the rig file and each record leave them."""
        assert self.best is not None
        known, wide = rig_freed(self.best[0], self.search.trust, self._beside)
        return deviations(known, wide, by_modes(wide, self._beside), self._noise(self.best[0]), self.campaign)

    def _remainder(self, best: Evaluation | None) -> Remainder:
        """The misfit that the model of the verdict leaves."""
        plain = self._no_cause.judged if self.verdict == "consistent" else self._no_cause.base
        model = best or plain
        white, campaign = self._noise(model).white, self.campaign
        shares, untested = {} if best is None else self._shares, best is not None and self._untested
        told = () if best is None or self._varying is None else (self._varying.sentence,)
        structured = bool(told) or not misfit(self._noise(model), campaign).fits
        missed, scored = self._missed(model), self._scored(model)
        if best is not None and missed and scored is not None and self.hidden is not None:
            white, campaign, structured = scored.evaluation.white, self.hidden, True
        left = remainder(white, campaign, structured, shares, told)
        return replace(left, untested=untested, missed=missed, uncertain=self._uncertain(model))

    def _uncertain(self, e: Evaluation) -> float:
        """Noise variances of the records held out, where only how uncertain its numbers are makes noise of these.

        Not of transients, which are free there.
        """
        scored = self._scored(e)
        if scored is None or not e.settled or not scored.misfit.fits or within_noise(scored.evaluation.white):
            return 0.0
        return scored.errors.chi2_reduced

    def _missed(self, e: Evaluation) -> float:
        """Error of the records held out, where these are not noise although those fitted are; else 0."""
        scored = self._scored(e)
        alone = scored is not None and not scored.misfit.fits and misfit(self._noise(e), self.campaign).fits
        return scored.misfit.nrmse if scored is not None and alone else 0.0

    def _scored(self, e: Evaluation) -> Predicted | None:
        """A model with causes, the rig file as it is or calibrated, on the records held out."""
        if e.model.causes:
            return self._predicted(e)
        return self.nominal if e is self.search.nominal else self.calibrated

    @cached_property
    def _shares(self) -> dict[str, float]:
        """Share of the misfit of the rig file beyond noise that the best model explains, fitted and held out.

        Where records held out test it.
        """
        if self.best is None:
            return {}
        best, scored = self.best
        before, unseen = self.plain[self._extends(best)]
        shares = {"train": explained(before.white, self._noise(best).white)}
        if scored is not None and unseen is not None and not self._untested:
            shares["held_out"] = explained(unseen.evaluation.white, scored.evaluation.white)
        return shares

    @cached_property
    def _untested(self) -> bool:
        """Whether the records held out fit noise with the best cause, and hardly worse without it."""
        if self.best is None:
            return False
        best, scored = self.best
        unseen = self.plain[self._extends(best)][1]
        if scored is None or unseen is None or not scored.misfit.fits:
            return False
        return not tells(unseen.evaluation.white, scored.evaluation.white)

    def _to_hold_out(self, best: Evaluation | None) -> Iterator[str]:
        """Which of the records fitted would test the cause that none held out tells of."""
        if best is None or not self._untested:
            return iter(())
        return to_hold_out(name_of(best), self._before(best).white, self._noise(best).white, self.campaign)

    def _held(self, best: Evaluation | None) -> dict[str, Evaluation]:
        scored = {"nominal": self.nominal, "calibrated": self.calibrated}
        if best is not None and self.best is not None:
            scored["extended"] = self.best[1]
        return {name: s.evaluation for name, s in scored.items() if s is not None}

    @cached_property
    def verdict(self) -> Verdict:
        """Verdict that follows from the decision, on the records fitted and those held out."""
        claimed = self._claimed
        clear = self._lead > CLEAR and not self._untested if claimed in NAMED else True
        if clear or self.best is None or matters(self.best[0], self._std):
            return claimed
        return self._no_cause.verdict

    def _foretells(self, best: Evaluation) -> bool:
        """Whether a cause that leaves noise foretells the records held out, and is needed; transients have no size."""
        foretold = self._shares.get("held_out", 0.0) >= FORETOLD
        return foretold and not self._within_too(best) and (not best.settled or matters(best, self._std))

    @cached_property
    def _claimed(self) -> Verdict:
        """The verdict by how much is explained, however uncertain the numbers of the cause are."""
        if self.best is None or self._lead <= DECISIVE:
            return self._no_cause.verdict
        best, scored = self.best
        settled, least = best.settled, min(self._shares.values())
        noise = misfit(self._noise(best), self.campaign).fits and self._holds(scored)
        if noise and (settled or (least >= MAIN and self._transients_foretell(scored))):
            return "main-cause" if self._varying else "cause-found"
        left = beyond_noise(self._noise(best).white)
        before = beyond_noise(self._before(best).white)
        agrees = left <= SAYS_NOTHING * max(1.0, before) or (self._shares["train"] >= NEXT_TO_ALL and least >= NEARLY)
        still = left**2 > 1.0 - MAIN  # a rig that does not move at all misses the response once
        if least < MAIN or before <= NOTABLE or still or not agrees or not self._as_well(best, scored):
            return self._no_cause.verdict
        nearly = least >= (NEARLY if left <= LARGEST else NEXT_TO_ALL)
        if nearly and (settled or self._transients_foretell(scored)) and not self._varying:
            return "cause-found"
        # what is free in each record takes most of anything
        return "main-cause" if settled else self._no_cause.verdict

    @cached_property
    def _lead(self) -> float:
        """How much likelier the best cause is than none, each beside the background that it would leave."""
        assert self.best is not None
        best, search = self.best[0], self.search
        base = search.first if search.replaces(best) else search.calibrated if best.model.calibrated else search.nominal
        rival = search.calibrated if base is search.nominal and search.tolerable(search.calibrated) else None
        return lead(best, base, rival, search.tried, self.campaign)

    def _extends(self, best: Evaluation) -> str:
        """Name of the model whose misfit a cause explains: the one that it extends, calibrated or as it is.

        Calibration that leaves noise alone has no misfit: then it is the rig file as it is.
        """
        return "calibrated" if best.model.calibrated and not self._within_too(best) else "nominal"

    def _before(self, best: Evaluation) -> Evaluation:
        """The model whose misfit a cause explains."""
        return self.plain[self._extends(best)][0]

    def _within_too(self, best: Evaluation) -> bool:
        """Whether numbers of the rig file leave noise alone without the cause that is found beside them."""
        return bool(best.model.calibrated) and misfit(self.search.calibrated, self.campaign).fits

    def _as_well(self, best: Evaluation, scored: Predicted | None) -> bool:
        """Whether a cause leaves no more than calibration, of records held out, and of those fitted if that is much."""
        mine, other = (self._noise(e).white for e in (best, self.search.calibrated))
        whites = [(mine, other)] if beyond_noise(mine) > LARGEST else []
        if scored is not None and self.calibrated is not None:
            whites.append((scored.evaluation.white, self.calibrated.evaluation.white))
        return all(left.charged <= WORSE * by_many.charged for left, by_many in whites)

    def _transients_foretell(self, scored: Predicted | None) -> bool:
        """Whether they foretell as calibration does, within tolerances: beyond these it hides what is missing."""
        within = self.search.tolerable(self.search.calibrated)
        return foretells(scored, self.calibrated if within else self.nominal)

    def _holds(self, scored: Predicted | None) -> bool:
        """Whether a cause leaves noise alone on the records held out, and no more than calibration does."""
        if scored is None:
            return True
        calibrated = self.calibrated
        better = calibrated is None or calibrated.misfit.fits or scored.misfit.chi2 < calibrated.misfit.chi2 + AS_GOOD
        return scored.misfit.fits and better

    def _confidence(self, verdict: Verdict, best: Evaluation | None) -> float:
        """Share of repetitions that would decide alike; else how improbable it is that another verdict is right.

        Times how often such a verdict was right in blind cases: a model that is wrong otherwise would decide alike.
        """
        if best is not None:
            kind: str = verdict
            if verdict == "cause-found" and misfit(self._noise(best), self.campaign).fits:
                kind = "foretold" if self._foretells(best) else "noise"
            return RELIABLE[kind] * inclusion(rivals(self.decision, best), best)
        if verdict == "unexplained":
            story, scored = self.decision.story, self._scored(self.decision.story)
            by_noise = [misfit(self._noise(story), self.campaign), *([] if scored is None else [scored.misfit])]
            return RELIABLE[verdict] * (1.0 - min(m.probability for m in by_noise))
        noise = misfit(self.search.nominal, self.campaign).fits
        alone = nothing_missing(self.search, self.decision) if noise else 0.0
        return alone * RELIABLE[verdict] + (1.0 - alone) * RELIABLE["within"]

    def _errors(self, best: Evaluation | None) -> dict[str, dict[str, Errors]]:
        models = dict(self.plain)
        if best is not None and self.best is not None:
            models["extended"] = (self._noise(best), self.best[1])
        return errors_of(models)

    @cached_property
    def _nrmse_held_out(self) -> list[float | None]:
        """Error of each fit on the records held out; None where it has none there."""
        return [self._held_out(e) for e in self.decision.fits]

    def _held_out(self, e: Evaluation) -> float | None:
        if self.best is not None and e is self.best[0] and self.best[1] is not None:
            return self.best[1].misfit.nrmse
        known = {} if self.calibrated is None else self.calibrated.evaluation.solutions
        try:
            return None if self.hidden is None else nrmse(evaluate(e.model, self.hidden, e.x, known).white)
        except FAILURES:
            return None

    def _advice(self, best: Evaluation | None, ties: list[Evaluation]) -> str:
        if best is None or not ties:
            return ""
        self.search.tell("what would separate", 0.95)
        found = separate(best, ties[0], self.search.campaign)
        return "" if found is None or found.chi2 < TIED else str(found)

    @property
    def _evidence(self) -> Evidence:
        scored = None if self.best is None else self.best[1]
        within = self.best is not None and self._within_too(self.best[0]) and self.search.calibrates
        return Evidence(self.search, self.decision, self.campaign, len(self.held), self.plain, scored, within)
