"""The search for the simplest story that explains the records fitted: what is tried, in which order."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace

import numpy as np

from hbm.diagnosis.calibrate import SENSORS, calibrate, off, profiled, trusted
from hbm.diagnosis.decide import (
    DECISIVE,
    Decision,
    accepted,
    best_first,
    best_of,
    simpler,
    suspicious,
    tied,
)
from hbm.diagnosis.fit import Evaluation, evaluate, fit_model, refine
from hbm.diagnosis.misfit import misfit
from hbm.diagnosis.model import Model
from hbm.diagnosis.numerics import Numerics, choose
from hbm.diagnosis.order import ordered
from hbm.diagnosis.race import EXPLAINED, race
from hbm.diagnosis.records import FAILURES, Campaign
from hbm.diagnosis.screen import Screening, screen, starting
from hbm.errors import InputError
from hbm.identification.records import measurement_of
from hbm.inverse.reconstruct import reconstruct
from hbm.inverse.sensing import sensing
from hbm.measurement.spectra import MeasuredSpectra
from models.causes.cause import Cause
from models.causes.parameter import WrongParameter
from models.causes.records import ForceDistortion, NotSteady
from models.causes.structure import ContactLoss
from models.rig import Rig

MOST_RANKED = 10
"""Fits that are kept for the ranking."""

STRONGER = 0.7
"""A second cause is looked for where the first leaves less than this share of chi2: of two, the stronger takes half."""

TOLERANCES_LEAVE = 0.01
"""Share of the excess of chi2 that is left, at most, where numbers within tolerances were most of what was wrong."""

DISTORTED = 5.0
"""A force is distorted that has a harmonic of so many standard deviations."""

OnProgress = Callable[[str, float], None]


def campaign_of(
    rig: Rig, spectra: MeasuredSpectra, numerics: Numerics | None = None, executor: Executor | None = None
) -> tuple[Campaign, tuple[str, ...]]:
    """Records of spectra, with the discretisation that resolves them; and what the sensors say of each other.

    Raises
    ------
    InputError
        If no response was measured.
    """
    seen = reconstruct(rig, spectra)
    data = measurement_of(seen, sensing(seen.rig, spectra))
    if not any(r.listed.any() for r in data.records):
        raise InputError(f"{spectra.source}: no harmonic of any response was measured; must have one")
    numerics = choose(seen.rig, data, executor) if numerics is None else numerics
    return Campaign(data, numerics, executor=executor), seen.warnings


class Search:
    """The search on the records fitted."""

    def __init__(
        self,
        rig: Rig,
        spectra: MeasuredSpectra,
        candidates: Sequence[Cause],
        tolerances: Mapping[str, float] | None,
        tell: OnProgress,
        executor: Executor | None,
    ) -> None:
        self.rig, self.spectra, self.tell = rig, spectra, tell
        tell("sensors and numerics", 0.0)
        self.campaign, self.sensors = campaign_of(rig, spectra, executor=executor)
        channels = self.campaign.data.channels
        self.candidates = [c for c in candidates if self._seen(c)]
        self.trust = trusted(rig, channels, tolerances)
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
        tell("screening", 0.1)
        self.screening: Screening = self._screened(self.nominal)
        tell("calibration", 0.2)
        self.calibrated = calibrate(self.trust, self.campaign, self.nominal.solutions)

    def _seen(self, cause: Cause) -> bool:
        """Whether what was measured can speak of a cause: its channels, or the harmonics of the force."""
        channels = self.campaign.data.channels
        if isinstance(cause, ForceDistortion):
            return (self.campaign.data.distorted or 0.0) > DISTORTED
        return all(getattr(cause, name, channels[0]) in channels for name in ("channel", "other"))

    def _screened(self, base: Evaluation, candidates: Sequence[Cause] | None = None) -> Screening:
        """Scores over a model of candidates, all unless given; of transients only where what is missed has no order."""
        offered = self.candidates if candidates is None else candidates
        if not self._disordered(base):
            offered = [c for c in offered if not isinstance(c, NotSteady)]
        offered = [c for c in offered if not isinstance(c, ContactLoss)]  # has no size: see _lifted
        return screen(base, self.campaign, offered)

    def _disordered(self, base: Evaluation) -> bool:
        """Whether what a model misses has no order.

        Calibration may take the order from an effect with what it takes of it: only where it takes next to all was that
        tolerances alone.
        """
        left, before = (e.white.chi2 - len(e.white) for e in (base, self.nominal))
        models = {base} if left < TOLERANCES_LEAVE * before else {base, self.nominal}
        return not any(ordered(e, self.campaign) for e in models)

    @property
    def tried(self) -> int:
        """Candidates, each shape that was scanned counted."""
        return max(self.screening.tried, 1)

    def decide(self) -> Decision:
        """The simplest story that will do: see :mod:`hbm.diagnosis.decide`."""
        nominal = misfit(self.nominal, self.campaign)
        if nominal.fits and not suspicious(self.screening, self.rig):
            return Decision(self.nominal, None, ())
        exact = self._race(self.nominal, self.screening, 0.3)
        if self._explains(exact) and exact.best is not None:
            if simpler(exact.best, self.calibrated, self.tried) or not self._within():
                return exact
        if self._within():
            return Decision(self.calibrated, None, exact.fits)
        if nominal.fits:
            return Decision(self.nominal, None, exact.fits)
        self.tell("screening over the calibrated model", 0.5)
        first = self._race(self.calibrated, self._screened(self.calibrated), 0.55)
        further = self._calibrated_from(first)
        if further is not None:
            self.calibrated = further
            if self._within():
                return Decision(self.calibrated, None, exact.fits)
            first = _decided(self.calibrated, first.fits, self.tried)
        if self._explains(first):
            return self._plainest(exact, first)
        several = self._several() if off(self.trust, self.calibrated) else None
        if several is not None:
            return several
        single = best_first(exact, first)
        if single.best is None or single.best.chi2 > STRONGER * self.calibrated.chi2:
            return single
        pair = self._pair(single, single.best)
        return pair if self._explains(pair) else best_first(single, pair)

    def _explains(self, decision: Decision) -> bool:
        return decision.best is not None and self._fits(decision.best)

    def _fits(self, e: Evaluation) -> bool:
        return misfit(e, self.campaign).fits

    def _within(self) -> bool:
        """Whether numbers of the rig file that move within their tolerances explain everything."""
        return self._fits(self.calibrated) and not off(self.trust, self.calibrated)

    def _race(self, base: Evaluation, screening: Screening, done: float) -> Decision:
        lifted = self._lifted(base, done)
        if any(self._fits(e) for e in lifted):
            return _decided(base, lifted, self.tried)
        fits = race(base, self.campaign, screening, lambda doing: self.tell(doing, done))
        return _decided(base, [*lifted, *fits], self.tried)

    def _lifted(self, base: Evaluation, done: float) -> list[Evaluation]:
        """A model whose tip lifts off, where its reaction turns negative; else nothing.

        It has no number to fit, and what corrects the discretisation of a tip that is kept on its support says nothing
        of one that is not: quick fits would not tell.
        """
        causes = [c for c in self.candidates if isinstance(c, ContactLoss) and _suits(c, base.model.rig(base.x))]
        if not causes or not any(s.lift_off for s in base.solutions.values()):
            return []
        model = base.model.extended_by(causes[0])
        self.tell(f"{causes[0].label}, all records", done)
        try:
            return [refine(fit_model(model, self.campaign, starting(model, base, {}), base.solutions), self.campaign)]
        except FAILURES:
            return []

    def _calibrated_from(self, found: Decision) -> Evaluation | None:
        """Calibration from where a cause is found, where it gets further: then it had ended in a wrong valley."""
        again = [] if found.best is None else started(self.calibrated, found.best, (), self.campaign)
        return next((e for e in again if e.chi2 <= self.calibrated.chi2 - DECISIVE), None)

    def _plainest(self, exact: Decision, first: Decision) -> Decision:
        """What explains over the calibrated model, over the rig file as it is if it does so there too.

        Whether a search over the latter gets into the right valley may hang on little.
        """
        close = [] if first.best is None else [first.best, *tied(first.fits, first.best)]
        again = [e for found in close for e in started(self.nominal, found, found.model.causes, self.campaign)]
        plain = _decided(self.nominal, [*again, *exact.fits], self.tried)
        return plain if self._explains(plain) else first

    def _several(self) -> Decision | None:
        """Only numbers of the rig file are wrong, several of them: each of those becomes a cause."""
        self.tell("free calibration", 0.65)
        base = calibrate(profiled(self.trust), self.campaign, self.calibrated.solutions)
        if not self._fits(base) or not accepted(self.calibrated, base, self.tried):
            return None
        far = {key: pull for key, pull in off(self.trust, base).items() if not key.startswith(SENSORS)}
        wrong = far or {base.model.free[0].name: 0.0}
        model = Model(self.rig, self.trust.calibrated, tuple(WrongParameter(key) for key in wrong))
        x = {f.name: v for f, v in zip(base.model.free, base.x, strict=True)}
        keys = list(wrong)
        names = [f.name if f.cause < 0 else keys[f.cause] for f in model.free]
        start = np.array([f.of(np.exp(x[name])) for f, name in zip(model.free, names, strict=True)])
        best = fit_model(model, self.campaign, start, base.solutions)
        return Decision(self.calibrated, best, (best,))

    def _pair(self, earlier: Decision, single: Evaluation) -> Decision:
        """Two causes: one more beside the best."""
        rest = [c for c in self.candidates if c not in single.model.causes and _suits(c, single.model.rig(single.x))]
        screening = self._screened(single, rest)
        fits = race(single, self.campaign, screening, lambda doing: self.tell(f"{single.model.label} and {doing}", 0.7))
        # the first of a pair may only have led to where the second is found
        pairs = [pair for pair in fits[:1] if self._fits(pair)]
        alone = [e for pair in pairs for e in started(earlier.base, pair, pair.model.causes[1:], self.campaign)]
        found = _decided(earlier.base, [*fits, *alone, *earlier.fits], self.tried**2)
        return replace(found, fits=found.fits[:MOST_RANKED])


def _decided(base: Evaluation, fits: Sequence[Evaluation], tried: int) -> Decision:
    """The best of fits over a base, if it is better than that by more than chance in so many tries."""
    ranked = best_of(fits)
    best = next((e for e in ranked[:1] if accepted(base, e, tried)), None)
    return Decision(base, best, tuple(ranked))


def started(base: Evaluation, found: Evaluation, causes: Sequence[Cause], campaign: Campaign) -> list[Evaluation]:
    """Fit of a model with some of the causes of another one, from where these were found.

    Parameters
    ----------
    base : Evaluation
        Of the model without the causes.
    found : Evaluation
        Of one with them, maybe with others before them and over other calibrated numbers.
    causes : sequence of Cause
        The last ones of its model.
    campaign : Campaign

    Returns
    -------
    list of Evaluation
        Empty where there is no fit.
    """
    model = base.model
    for added in causes:
        model = model.extended_by(added)
    before = len(found.model.causes) - len(model.causes)  # so many more come before them there
    known = base.coordinates
    for (cause, name), x in found.coordinates.items():
        known[cause if cause < 0 else cause - before, name] = x
    start = np.array([known[f.cause, f.name] for f in model.free])
    try:
        best = fit_model(model, campaign, start, found.solutions, reach=EXPLAINED * len(found.white))
        return [refine(best, campaign)]
    except FAILURES:
        return []


def _suits(cause: Cause, rig: Rig) -> bool:
    """Whether an extended rig can be extended by a cause too."""
    return any(offered == cause for offered in type(cause).candidates(rig))
