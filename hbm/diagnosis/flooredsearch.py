"""A diagnosis beside a floor, of records of many lines and of backbones: the same questions as of other records.

What no model describes counts as noise of one level on all that a channel reads in a record. How large it is, the
model says that is judged best: with it, its misfit is what noise makes. All models are fitted and compared beside it.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np

from hbm.diagnosis.barred import barred
from hbm.diagnosis.calibrate import tolerable, trusted
from hbm.diagnosis.conclusion import MAIN
from hbm.diagnosis.confidence import FORETOLD, RELIABLE
from hbm.diagnosis.decide import accepted, best_of, hardly_behind, inclusion, inside, leading, takes_much, tied
from hbm.diagnosis.deviations import std_of_records
from hbm.diagnosis.estimates import estimates, name_of, told_of
from hbm.diagnosis.flooredevidence import floored_evidence, white_beside
from hbm.diagnosis.jointscan import Scanned
from hbm.diagnosis.misfit import nrmse
from hbm.diagnosis.predict import SAYS_NOTHING, pays_unseen
from hbm.diagnosis.remainder import LEFT, Remainder, beyond_noise, explained, negligible, within_noise
from hbm.diagnosis.shortlist import alike, elsewhere, hopeful
from hbm.diagnosis.signatures import starting
from hbm.diagnosis.standing import NEARLY, OnProgress
from hbm.diagnosis.verdict import NAMED, Diagnosis, Errors, Ranked, Verdict
from hbm.fourier import Array
from hbm.outputerror.background import LARGEST
from hbm.outputerror.evaluation import Evaluation, evaluate, start_from
from hbm.outputerror.fit import SETTLED as LEAST
from hbm.outputerror.fit import fit_from, fit_model
from hbm.outputerror.floored import FlooredCampaign, likeliest_floor
from hbm.outputerror.model import Model
from hbm.outputerror.simulated import FAILURES, Solutions
from hbm.outputerror.valley import along_valley
from hbm.outputerror.whitened import Whitened
from models.causes.addedjoint import AddedJoint
from models.causes.cause import Cause
from models.jointed import AnyRig

FLOORS, SETTLED = 4, 0.1
"""Times the floor is found anew, at most, and the relative change of it at which it is settled."""

TOLD = 2000.0
"""Chi2 of what calibration leaves, at least, beside the floor of the race: beside all that it leaves, any would do."""

BEHIND = 2.0
"""A fit is given up that will not leave less than so many times what the best one does."""

OTHER_MODES = "measure another mode too: in what was measured these places move alike"

ENOUGH = 1e-3
"""A fit ends where a step promises to take less than this share of chi2: beside a floor, noise does not say when. After
the race it is begun anew once, for steps that were damped promise less than there is."""

PULLED = 2.0
"""A number of the rig file may be wrong that costs as much of chi2 as one moved by so many tolerances alone would."""


Candidate = tuple[Cause, Sequence[dict[str, float]]]
"""A cause, and the numbers from which it may be fitted."""

Scan = Callable[[Evaluation, Any, Sequence[AddedJoint]], Iterable[Scanned]]
"""Scores joints that a model may lack, on the records of a campaign."""


class FlooredSearch:
    """The search on the records fitted, and its score on those held out.

    Parameters
    ----------
    rig : JointedRig
        Nominal.
    campaign, hidden : FlooredCampaign
        Records fitted, and held out if any.
    scan : callable
        For the campaign's kind of records.
    candidates : sequence of Cause
    tolerances : mapping of str to float or None
    tell : callable
    """

    def __init__(
        self,
        rig: AnyRig,
        campaign: FlooredCampaign,
        hidden: FlooredCampaign | None,
        scan: Scan,
        candidates: Sequence[Cause],
        tolerances: Mapping[str, float] | None,
        tell: OnProgress,
    ) -> None:
        self.tell, self.candidates, self.scan = tell, candidates, scan
        self.campaign, self.hidden = campaign, hidden
        self.predicted = cache(partial(_on, hidden))
        self.trust = trusted(rig, self.campaign.data.channels, tolerances)
        tell("nominal", 0.0)
        bare = Model(rig, {})
        self.nominal = evaluate(bare, self.campaign, bare.start, {})
        tell("calibration", 0.1)
        self.fits: list[Evaluation] = []
        self.alone: list[Evaluation] = []
        self.leads: list[Evaluation] = []
        self.scores: list[Scanned] = []
        self.begun: list[str] = []
        self.unsolved: list[str] = []
        self.barred: Evaluation | None = None
        self.calibrated = self._settled(fit_model(self.trust, self.campaign, self.trust.start, self.nominal.solutions))
        self.tried = 1

    # ---- fits

    @property
    def raced(self) -> tuple[list[str], list[str], list[str]]:
        """Candidates that promised something to first order, the models that were fitted, and those not solved."""
        return [s.cause.label for s in self.scores], self.begun, self.unsolved

    def _settled(self, e: Evaluation) -> Evaluation:
        """A fit beside what it leaves itself, which from then on all are compared beside."""
        for _ in range(FLOORS):
            before = self.campaign.floor
            self.campaign = replace(self.campaign, floor=likeliest_floor(e, self.campaign)[0])
            e = self._again(e)
            if abs(self.campaign.floor - before) <= SETTLED * self.campaign.floor:
                break
        return e

    def beside(self, e: Evaluation, floor: float) -> Evaluation:
        """A model where it is, beside another floor."""
        return replace(e, white=white_beside(e, self.campaign, floor))

    def race(self, base: Evaluation, most: float = np.inf) -> list[Evaluation]:
        """Fits of the candidates that may explain what a model leaves, over it; `most` is what is of use to leave."""
        joints = [c for c in self.candidates if isinstance(c, AddedJoint)]
        self.tell("joints that may be missing", 0.3)
        scores = [s for s in self.scan(base, self.campaign, joints) if s.starts]
        self.scores += scores
        self.tried += len(joints)
        chosen = hopeful(scores, base.chi2)
        pulled: list[Candidate] = [(cause, ({},)) for cause in self._pulled(base)]
        found = self._fits(base, [*((s.cause, s.starts) for s in chosen), *pulled], most)
        best = min(found, key=lambda e: e.bic, default=None)
        if best is None:
            return []
        further = [(s.cause, s.starts) for s in elsewhere(best.model.causes[-1], scores) if s not in chosen]
        return [*found, *self._fits(base, further, min(most, BEHIND * best.chi2))]

    def _fits(self, base: Evaluation, candidates: Sequence[Candidate], of_use: float) -> list[Evaluation]:
        """Fits of candidates over a model, given up where they will leave more than is of use."""
        found: list[Evaluation] = []
        for i, (cause, starts) in enumerate(candidates):
            self.tell(f"{cause.label} ({i + 1} of {len(candidates)})", 0.4)
            best = self._fitted(base, cause, starts, of_use)
            if best is not None and not best.missing:
                found.append(best)
                of_use = min(of_use, BEHIND * best.chi2)
        return found

    def _pulled(self, base: Evaluation) -> Iterator[Cause]:
        """Numbers of the rig file that may be wrong: those whose tolerance costs much, as what is left tells."""
        moved = {f.name for f, cost in zip(base.model.free, base.costs, strict=True) if cost > PULLED**2}
        for cause in self.candidates:
            if not isinstance(cause, AddedJoint) and not base.model.causes:
                keys = {u.key for u in cause.unknowns(base.model.nominal)}
                if keys and keys <= moved:
                    self.tried += 1
                    yield cause

    def _fitted(
        self, base: Evaluation, cause: Cause, starts: Sequence[dict[str, float]], of_use: float
    ) -> Evaluation | None:
        """The fit of a candidate from the best of its starts; None where no start has all steady states."""
        model, campaign, needed = base.model.extended_by(cause), self.campaign.roughly(), base.found
        begun = list[tuple[float, Solutions, Array]]()
        for start in starts:
            with suppress(*FAILURES):
                x = starting(model, base, start)
                begun.append((*start_from(model, campaign, x, base.solutions, needed), x))
        self.begun.append(model.label)
        if begun:
            _, solutions, x = min(begun, key=lambda b: b[0])
            with suppress(*FAILURES):
                enough = max(LEAST, ENOUGH * base.chi2)
                return fit_model(model, campaign, x, solutions, settled=enough, needed=needed, reach=of_use)
        self.unsolved.append(model.label)
        return None

    # ---- the decision

    def decide(self) -> Evaluation | None:
        """The simplest model whose causes each take much of what is left without them; None where there is none."""
        if beyond_noise(self.beside(self.calibrated, 0.0).white) <= LARGEST and tolerable(self.trust, self.calibrated):
            return None
        settled = self.campaign
        few = min(1.0, np.sqrt(len(self.calibrated.white) / TOLD))
        self.campaign = replace(settled, floor=few * settled.floor)
        found = self._raced(settled.floor)
        self.campaign = settled if found is None else self.campaign
        if not self.fits:  # none was accepted: what was tried is ranked all the same
            self.fits = best_of([self.beside(e, self.campaign.floor) for e in self.alone])
        return found

    def _raced(self, left: float) -> Evaluation | None:
        self.alone = sorted(self.race(self.beside(self.calibrated, self.campaign.floor)), key=self._judged)
        first = self._best(self.calibrated, self.alone)
        base = first or self.calibrated
        if negligible(self.beside(base, 0.0).white):
            return first
        whole = partial(self.beside, floor=left)
        most = hardly_behind([self._judged(e) for e in self.alone])
        strong = leading(whole(self.calibrated), first and whole(first), [whole(e) for e in self.alone], most)
        self.leads = [self.beside(e, self.campaign.floor) for e in strong]
        pairs = [e for lead in self.leads for e in self.race(lead, LEFT * lead.chi2) if takes_much(lead, e)]
        return self._best(base, sorted(pairs, key=self._judged)) or first

    def _best(self, base: Evaluation, raced: Sequence[Evaluation]) -> Evaluation | None:
        """The simplest of some fits over a base, the best first, that does as well as that, if it is accepted."""
        fits, before = [e for e in raced if tolerable(self.trust, e)], self.campaign
        if not fits:
            return None
        leader = self._settled(fits[0])
        leader = along_valley(leader, self.campaign)
        if not accepted(self.beside(base, self.campaign.floor), leader, self.tried):
            self.campaign = before
            return None
        beside = [(self.beside(e, self.campaign.floor), e.chi2 / fits[0].chi2) for e in fits[1:]]
        # one that was near in the race may be far off beside a lower floor, until it is fitted there
        again = [min(e.chi2 / leader.chi2, raced) < BEHIND for e, raced in beside]
        others = [self._again(e) if near else e for (e, _), near in zip(beside, again, strict=True)]
        fits = best_of([leader, *others])
        told = {e.model.label for e in fits}
        self.fits = [*fits, *(self.beside(e, self.campaign.floor) for e in self.fits if e.model.label not in told)]
        return next((e for e in inside(fits[0], fits) if not takes_much(e, fits[0])), fits[0])

    def _judged(self, e: Evaluation) -> float:
        """A model beside the floor that it leaves itself, as by :attr:`Evaluation.bic`; the least is best."""
        _, deviance = likeliest_floor(e, self.campaign)
        return deviance + float(e.pulls @ e.pulls) + e.model.counted * float(np.log(len(e.white)))

    def _again(self, e: Evaluation) -> Evaluation:
        """A fit beside the floor there is now."""
        here = self.beside(e, self.campaign.floor)
        enough = ENOUGH * here.chi2
        if enough <= LEAST or not e.model.causes:  # on the rig file without a cause all others rest
            return fit_from(here, self.campaign, e.solutions)
        once = fit_model(e.model, self.campaign, e.x, e.solutions, settled=enough)
        return fit_from(once, self.campaign, once.solutions, settled=enough)

    def noise_alone(self, e: Evaluation) -> bool:
        """Whether a model leaves no more than the noise stated, and is within tolerances."""
        return within_noise(self.beside(e, 0.0).white) and tolerable(self.trust, e)

    # ---- the conclusion

    def diagnosis(self) -> Diagnosis:
        """Verdict, and all that supports it."""
        best = self.decide()
        self.tell("records held out", 0.9)
        if best is not None and not pays_unseen(best, self.leads, self._unseen):
            best = self._best(self.calibrated, self.alone)
        self.barred = self._barred(best)
        models = {"nominal": self.nominal, "calibrated": self.calibrated} | ({} if best is None else {"extended": best})
        plain = {name: self.beside(e, 0.0) for name, e in models.items()}
        unseen = {name: held for name, e in models.items() if (held := self.predicted(e)) is not None}
        shares = self._shares(plain, unseen)
        verdict = self._verdict(plain, unseen, shares)
        named = best if verdict in NAMED else None
        if named is None:
            for part in (plain, unseen):
                part.pop("extended", None)
            shares = {}
        judged = plain["calibrated" if named is None else "extended"]
        ties = [] if named is None else [told_of(e) for e in self._ties(named)]
        places = [] if named is None else [c.label for c in alike(named.model.causes[0], self.scores)]
        return Diagnosis(
            verdict=verdict,
            cause=None if named is None else name_of(named),
            parameters={} if named is None else estimates(named, np.maximum(named.std, std_of_records(named))),
            confidence=self._confidence(verdict, named, shares),
            not_separable=tuple(dict.fromkeys([*places, *ties])),
            separate_by=OTHER_MODES if places else "",
            remainder=self._remainder(judged, shares, unseen.get("extended" if named else "calibrated")),
            errors=_errors(plain, unseen),
            held_out_records=() if self.hidden is None else tuple(self.hidden.numbers),
            ranking=tuple(self._ranked(e) for e in self.fits),
            evidence=tuple(floored_evidence(self, plain, unseen, named)),
            extended=None if named is None else named.model.rig(named.x),
            nominal=self.beside(self.nominal, self.campaign.floor),
            calibrated=self.beside(self.calibrated, self.campaign.floor),
            extended_fit=named,
            campaign=replace(self.campaign, floor=0.0, executor=None),
            held=unseen,
            held_campaign=None if self.hidden is None else replace(self.hidden, executor=None),
            tried=tuple(self.fits),
        )

    def _ties(self, named: Evaluation) -> list[Evaluation]:
        """Single causes that the records cannot tell from the first one named, where that is fitted alone."""
        singles = [e for e in self.fits if len(e.model.causes) == 1]
        return [other for e in singles if e.model.causes == named.model.causes[:1] for other in tied(singles, e)]

    def _barred(self, best: Evaluation | None) -> Evaluation | None:
        """See :func:`hbm.diagnosis.barred.barred`."""
        judged = self.beside(best or self.calibrated, self.campaign.floor)
        noise = self.noise_alone(judged)
        return barred(judged, self.alone, self.trust, self.campaign, self.tried, noise_alone=noise)

    def _unseen(self, e: Evaluation) -> Whitened | None:
        """Records held out beside a model and the largest background that may be."""
        held = self.predicted(e)
        return None if held is None or self.hidden is None else white_beside(held, self.hidden, LARGEST)

    def _shares(self, plain: Mapping[str, Evaluation], unseen: Mapping[str, Evaluation]) -> dict[str, float]:
        """Share of the misfit that the extended rig does not leave, of records fitted and held out.

        Beside the largest background that may be: else lines where nothing was excited, and noise is least, outweigh
        all others.
        """
        parts = (("train", plain, self.campaign), ("held_out", unseen, self.hidden))
        found = {}
        for name, part, campaign in parts:
            if campaign is not None and "extended" in part:
                before, after = (white_beside(part[model], campaign, LARGEST) for model in ("calibrated", "extended"))
                found[name] = explained(before, after)
        return found

    def _verdict(
        self, plain: Mapping[str, Evaluation], unseen: Mapping[str, Evaluation], shares: Mapping[str, float]
    ) -> Verdict:
        if shares:
            least, left = min(shares.values()), plain["extended"].white
            if least >= NEARLY and negligible(left) and self.barred is None:
                return "cause-found"
            if least >= MAIN and beyond_noise(left) <= SAYS_NOTHING:
                return "main-cause"
        whites = [part["calibrated"].white for part in (plain, unseen) if "calibrated" in part]
        return (
            "consistent" if tolerable(self.trust, self.calibrated) and all(map(negligible, whites)) else "unexplained"
        )

    def _confidence(self, verdict: Verdict, named: Evaluation | None, shares: Mapping[str, float]) -> float:
        if named is None:
            return RELIABLE[verdict]
        foretold = verdict == "cause-found" and self.noise_alone(named) and shares.get("held_out", 0.0) >= FORETOLD
        same = [self.beside(self.calibrated, self.campaign.floor), *self.fits]
        return RELIABLE["foretold" if foretold else verdict] * inclusion(same, named)

    def _remainder(self, e: Evaluation, shares: Mapping[str, float], unseen: Evaluation | None) -> Remainder:
        structured = not self.noise_alone(e)
        size = beyond_noise(e.white) if structured else 0.0
        missed = 0.0 if structured or unseen is None or negligible(unseen.white) else nrmse(unseen.white)
        return Remainder(shares, size, e.white.chi2 / len(e.white), structured, missed=missed)

    def _ranked(self, e: Evaluation) -> Ranked:
        held = self.predicted(e)
        return Ranked(
            e.model.label, name_of(e), estimates(e), e.bic, e.chi2, None if held is None else nrmse(held.white)
        )

    def unresolved(self, e: Evaluation) -> float:
        """Relative change of the response of one record on twice the harmonics and samples."""
        one = self.campaign.of(self.campaign.numbers[:1])
        try:
            fine = evaluate(e.model, one.refined(), e.x, {})
        except FAILURES:
            return float("nan")
        same = fine.white.record[0] == e.white.record
        return float(np.linalg.norm(fine.white.raw - e.white.raw[same]) / np.linalg.norm(fine.white.measured))


def _on(hidden: FlooredCampaign | None, e: Evaluation) -> Evaluation | None:
    """A model on records held out, beside noise alone; None where it has no steady state there."""
    if hidden is None:
        return None
    try:
        found = evaluate(e.model, hidden, e.x, {})
    except FAILURES:
        return None
    return None if found.missing else found


def _errors(plain: Mapping[str, Evaluation], unseen: Mapping[str, Evaluation]) -> dict[str, dict[str, Errors]]:
    return {
        name: {
            part: Errors(nrmse(of[name].white), of[name].white.chi2 / len(of[name].white))
            for part, of in (("train", plain), ("held_out", unseen))
            if name in of
        }
        for name in plain
    }
