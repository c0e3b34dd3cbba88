"""From a rig and measured spectra to a diagnosis: calibrate, screen, fit, decide, and score on records held out.

:func:`diagnose` is the entry. Only the records to fit reach a fit; those held out are opened once, at the end.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, fields, is_dataclass, replace

import numpy as np

import models.causes
from continuation import ConvergenceError
from hbm.diagnosis.calibrate import SENSORS, calibrate, off, profiled, trusted
from hbm.diagnosis.decide import (
    ALARM,
    Decision,
    accepted,
    best_first,
    best_of,
    inclusion,
    sidak,
    simpler,
    suspicious,
    tied,
    weights,
)
from hbm.diagnosis.fit import Evaluation, evaluate, fit_model
from hbm.diagnosis.heldout import check_held_out, choose_held_out
from hbm.diagnosis.misfit import Misfit, likeliest, misfit, misfit_of_new, nrmse
from hbm.diagnosis.model import Model
from hbm.diagnosis.numerics import Numerics, choose
from hbm.diagnosis.race import race
from hbm.diagnosis.records import Campaign
from hbm.diagnosis.screen import Screening, screen
from hbm.diagnosis.separate import separate
from hbm.diagnosis.verdict import Diagnosis, Errors, Estimate, Ranked, Verdict
from hbm.errors import InputError
from hbm.identification.records import measurement_of
from hbm.inverse.reconstruct import reconstruct
from hbm.inverse.sensing import sensing
from hbm.measurement.spectra import MeasuredSpectra
from hbm.threads import one_thread
from models.causes.cause import Cause
from models.causes.parameter import WrongParameter
from models.causes.records import ForceDistortion
from models.rig import Rig

MOST_RANKED = 10
"""Fits that are kept for the ranking."""

MOVED = 3
"""So many numbers that calibration moves far are named."""

DISTORTED = 5.0
"""A force is distorted that has a harmonic of so many standard deviations."""

AS_GOOD = 4.0
"""Records held out may fit a cause worse than a calibrated nominal by this chi2, which does not fit them either."""

LINEARISED = 4
"""Times the prediction of records held out is linearised anew where the first does not fit, at most;"""

FALLING = 0.8
"""while its chi2 falls to less than this share."""

OnProgress = Callable[[str, float], None]


@one_thread
def diagnose(
    rig: Rig,
    spectra: MeasuredSpectra,
    *,
    held_out: Iterable[int] | None = None,
    causes: Iterable[Cause | type[Cause]] | None = None,
    tolerances: Mapping[str, float] | None = None,
    on_progress: OnProgress | None = None,
    executor: Executor | None = None,
) -> Diagnosis:
    """Say what a simulation gets wrong, which missing effect explains it, and what the extended model gains.

    Parameters
    ----------
    rig : Rig
        The nominal rig.
    spectra : MeasuredSpectra
    held_out : iterable of int, optional
        Records that no fit sees; where omitted a level and a frequency band, see :mod:`hbm.diagnosis.heldout`.
    causes : iterable of Cause, optional
        Candidates, or classes of them; the whole catalogue and every nominal value where omitted.
    tolerances : mapping of str to float, optional
        What numbers of the rig file are off by at most, relative standard deviations by their keys; within these
        nothing is called wrong. :data:`hbm.diagnosis.nominal.TOLERANCES` where omitted.
    on_progress : callable, optional
        Called with what is done and the fraction done.
    executor : concurrent.futures.Executor, optional
        Simulates records side by side, in processes for a gain; one after the other where omitted.

    Returns
    -------
    Diagnosis

    Raises
    ------
    InputError
        If no response was measured, a record to hold out is not there, or a rig cannot be told from its measurements.
    ConvergenceError
        If the steady state of no record is found.
    """
    held = choose_held_out(spectra) if held_out is None else tuple(held_out)
    check_held_out(spectra, held)
    train, unseen = spectra.split(held) if held else (spectra, None)
    tell = on_progress or (lambda doing, done: None)
    search = _Search(rig, train, list(_candidates(rig, causes)), tolerances, tell, executor)
    return _Report(search, search.decide(), unseen, held).diagnosis()


def _candidates(rig: Rig, causes: Iterable[Cause | type[Cause]] | None) -> Iterator[Cause]:
    for cause in models.causes.CAUSES.values() if causes is None else causes:
        yield from cause.candidates(rig) if isinstance(cause, type) else (cause,)


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
    numerics = choose(seen.rig, data) if numerics is None else numerics
    return Campaign(data, numerics, executor=executor), seen.warnings


class _Search:
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
        self.screening: Screening = screen(self.nominal, self.campaign, self.candidates)
        tell("calibration", 0.2)
        self.calibrated = calibrate(self.trust, self.campaign, self.nominal.solutions)

    def _seen(self, cause: Cause) -> bool:
        """Whether what was measured can speak of a cause: its channels, or the harmonics of the force."""
        channels = self.campaign.data.channels
        if isinstance(cause, ForceDistortion):
            return (self.campaign.data.distorted or 0.0) > DISTORTED
        return all(getattr(cause, name, channels[0]) in channels for name in ("channel", "other"))

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
        first = self._race(self.calibrated, screen(self.calibrated, self.campaign, self.candidates), 0.55)
        if self._explains(first):
            return first
        several = self._several() if off(self.trust, self.calibrated) else None
        if several is not None:
            return several
        single = best_first(exact, first)
        pair = self._pair(single, single.best) if single.best is not None else single
        return pair if self._explains(pair) else best_first(single, pair)

    def _explains(self, decision: Decision) -> bool:
        return decision.best is not None and misfit(decision.best, self.campaign).fits

    def _within(self) -> bool:
        """Whether numbers of the rig file that move within their tolerances explain everything."""
        return misfit(self.calibrated, self.campaign).fits and not off(self.trust, self.calibrated)

    def _race(self, base: Evaluation, screening: Screening, done: float) -> Decision:
        fits = best_of(race(base, self.campaign, screening, lambda doing: self.tell(doing, done)))
        best = next((e for e in fits[:1] if accepted(base, e, self.tried)), None)
        return Decision(base, best, tuple(fits))

    def _several(self) -> Decision | None:
        """Only numbers of the rig file are wrong, several of them: each of those becomes a cause."""
        self.tell("free calibration", 0.65)
        base = calibrate(profiled(self.trust), self.campaign, self.calibrated.solutions)
        if not misfit(base, self.campaign).fits or not accepted(self.calibrated, base, self.tried):
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
        rest = [c for c in self.candidates if c not in single.model.causes and _fits(c, single.model.rig(single.x))]
        screening = screen(single, self.campaign, rest)
        fits = race(single, self.campaign, screening, lambda doing: self.tell(f"{single.model.label} and {doing}", 0.7))
        ranked = best_of([*fits, *earlier.fits])
        best = next((e for e in ranked[:1] if accepted(earlier.base, e, self.tried**2)), None)
        return Decision(earlier.base, best, tuple(ranked[:MOST_RANKED]))


@dataclass(frozen=True, eq=False)
class _Scored:
    """A model on the records held out."""

    evaluation: Evaluation
    misfit: Misfit

    @property
    def errors(self) -> Errors:
        return Errors(self.misfit.nrmse, self.evaluation.white.chi2 / len(self.evaluation.white))


class _Report:
    """The decision scored on the records held out, and said."""

    def __init__(
        self, search: _Search, decision: Decision, unseen: MeasuredSpectra | None, held: tuple[int, ...]
    ) -> None:
        self.search, self.decision, self.held = search, decision, held
        search.tell("records held out", 0.9)
        campaign = search.campaign
        self.hidden = (
            None if unseen is None else campaign_of(search.rig, unseen, campaign.numerics, campaign.executor)[0]
        )
        self.nominal = self._scored(search.nominal)
        self.calibrated = self._scored(search.calibrated)
        self.best = None if decision.best is None else (decision.best, self._scored(decision.best))

    def _scored(self, e: Evaluation) -> _Scored | None:
        if self.hidden is None:
            return None
        try:
            rough = evaluate(e.model, self.hidden, e.x, {})
            hidden = self.hidden.corrected(e.model.rig(e.x), rough.solutions)
            there = evaluate(e.model, hidden, e.x, rough.solutions)
        except (ConvergenceError, ValueError):
            return None
        best = misfit_of_new(there, e.x, e.covariance, hidden)
        return _Scored(there, replace(_within(there, e, best, hidden), nrmse=best.nrmse))

    def diagnosis(self) -> Diagnosis:
        verdict = self._verdict()
        best = self.decision.best if verdict == "cause-found" else None
        ties = tied(self.decision.fits, best) if best is not None else []
        return Diagnosis(
            verdict=verdict,
            cause=None if best is None else _name(best),
            parameters={} if best is None else estimates(best),
            confidence=self._confidence(verdict, best),
            not_separable=tuple(_name(e) for e in ties),
            separate_by=self._advice(best, ties),
            errors=self._errors(best),
            held_out_records=self.held,
            ranking=tuple(self._ranked(e) for e in self.decision.fits),
            evidence=tuple(self._evidence(verdict, best)),
            extended=None if best is None else best.model.rig(best.x),
            nominal=self.search.nominal,
            calibrated=self.search.calibrated,
            extended_fit=best,
            campaign=self.search.campaign,
            held=self._held(best),
            held_campaign=self.hidden,
        )

    def _held(self, best: Evaluation | None) -> dict[str, Evaluation]:
        scored = {"nominal": self.nominal, "calibrated": self.calibrated}
        if best is not None and self.best is not None:
            scored["extended"] = self.best[1]
        return {name: s.evaluation for name, s in scored.items() if s is not None}

    def _verdict(self) -> Verdict:
        search, calibrated = self.search, self.calibrated
        if self.best is None:
            scored = self.nominal if self.decision.base is search.nominal else calibrated
            fits = misfit(self.decision.base, search.campaign).fits and (scored is None or scored.misfit.fits)
            return "consistent" if fits else "unexplained"
        _, scored = self.best
        if scored is None:
            return "cause-found"
        if not scored.misfit.fits:
            return "unexplained"
        better = calibrated is None or calibrated.misfit.fits or scored.misfit.chi2 < calibrated.misfit.chi2 + AS_GOOD
        return "cause-found" if better else "unexplained"

    def _confidence(self, verdict: Verdict, best: Evaluation | None) -> float:
        """Share of repetitions that would decide alike; else how improbable it is that another verdict is right."""
        search = self.search
        if best is not None:
            return inclusion((self.decision.base, *self.decision.fits), best)
        if verdict == "unexplained":
            e = self.decision.best or search.calibrated
            return 1.0 - misfit(e, search.campaign).probability
        return float(weights([0.0, *(-s.gain for s in search.screening.scores[:1])])[0])

    def _errors(self, best: Evaluation | None) -> dict[str, dict[str, Errors]]:
        search = self.search
        models = {"nominal": (search.nominal, self.nominal), "calibrated": (search.calibrated, self.calibrated)}
        if best is not None and self.best is not None:
            models["extended"] = (best, self.best[1])
        out = {}
        for name, (e, scored) in models.items():
            m = misfit(e, search.campaign)
            out[name] = {"train": Errors(m.nrmse, e.white.chi2 / len(e.white))}
            out[name] |= {} if scored is None else {"held_out": scored.errors}
        return out

    def _ranked(self, e: Evaluation) -> Ranked:
        return Ranked(e.model.label, _name(e), estimates(e), e.bic, e.chi2, self._nrmse_held_out(e))

    def _nrmse_held_out(self, e: Evaluation) -> float | None:
        if self.best is not None and e is self.best[0] and self.best[1] is not None:
            return self.best[1].misfit.nrmse
        try:
            return None if self.hidden is None else nrmse(evaluate(e.model, self.hidden, e.x, {}).white)
        except (ConvergenceError, ValueError):
            return None

    def _advice(self, best: Evaluation | None, ties: list[Evaluation]) -> str:
        if best is None or not ties:
            return ""
        self.search.tell("what would separate", 0.95)
        found = separate(best, ties[0], self.search.campaign)
        return "" if found is None else str(found)

    def _evidence(self, verdict: str, best: Evaluation | None) -> Iterator[str]:
        search = self.search
        records, points = len(search.campaign.numbers), search.campaign.points
        held = f", {len(self.held)} held out" if self.held else "; none held out: too few records or levels"
        yield f"{records} records with {points} coefficients fitted{held}."
        yield f"{search.campaign.numerics}."
        if len(np.unique(search.spectra.level)) == 1:
            yield "One level only: damping laws, and friction from its amplitude, cannot be told apart."
        yield from (f"Sensors: {line}." for line in search.sensors)
        yield from self._misfits()
        yield from self._lifted()
        yield from self._moved()
        yield from self._scores()
        if best is not None:
            yield from self._found(best)
        elif verdict == "unexplained" and self.decision.fits:
            tried = self.decision.fits[0]
            m = misfit(tried, search.campaign)
            yield f"Best tried: {tried.model.label}, {m.chi2_reduced:.3g} noise variances; worst {m.worst.what}."
            scored = self.best[1] if self.best is not None else None
            if scored is not None and not scored.misfit.fits:
                worst = scored.misfit.worst
                yield (
                    f"It does not predict the records held out: {scored.errors.chi2_reduced:.4g} noise variances, "
                    f"most clearly in {worst.what} ({worst.chi2_reduced:.3g}); chance {scored.misfit.probability:.2g}."
                )

    def _misfits(self) -> Iterator[str]:
        search = self.search
        for name, e, scored in (
            ("nominal", search.nominal, self.nominal),
            ("calibrated", search.calibrated, self.calibrated),
        ):
            m = misfit(e, search.campaign)
            hidden = "" if scored is None else f", {scored.errors.chi2_reduced:.4g} on those held out"
            yield (
                f"The {name} model is off by {m.nrmse:.3%}, {e.white.chi2 / len(e.white):.4g} noise variances on the "
                f"mean{hidden}; probability by noise {m.probability:.2g}"
                + ("." if m.fits else f", most clearly in {m.worst.what} ({m.worst.chi2_reduced:.3g}).")
            )
            if e.missing:
                yield f"No steady state of the {name} model was found for records {', '.join(map(str, e.missing))}."

    def _lifted(self) -> Iterator[str]:
        """Where the simulation has left what it can say."""
        base = self.decision.best or self.decision.base
        lifted = [str(number) for number, solution in base.solutions.items() if solution.lift_off]
        if lifted:
            yield (
                f"In the simulation the normal force reaches zero in records {', '.join(lifted)}: the tip may lift off "
                "there (contact-loss), which is not simulated."
            )

    def _moved(self) -> Iterator[str]:
        for key, pull in list(off(self.search.trust, self.search.calibrated).items())[:MOVED]:
            yield f"Calibration moves {key} by {pull:+.1f} tolerances."

    def _scores(self) -> Iterator[str]:
        screening = self.search.screening
        if not screening.scores or not screening.scores[0].drop:
            return
        told = ", ".join(f"{s.cause.label} {s.drop:.3g}" for s in screening.scores[:4])
        yield (
            f"Score test on {screening.records} records, predicted fall of chi2: {told}; chance reaches "
            f"{sidak(self.search.tried):.3g} in {ALARM:.1%} of the searches over {self.search.tried} candidates."
        )
        first = screening.scores[0].cause.label
        alike = screening.look_alikes(first)
        if alike:
            yield f"Looks like {first}: " + ", ".join(f"{name} (cosine {c:.3f})" for name, c in alike.items()) + "."

    def _found(self, best: Evaluation) -> Iterator[str]:
        base = self.search.calibrated
        scored = self.best[1] if self.best is not None else None
        hidden = "" if scored is None else f"; on records held out {scored.errors.chi2_reduced:.4g} noise variances"
        yield (
            f"{best.model.label} lowers chi2 from {base.chi2:.5g} to {best.chi2:.5g} "
            f"(BIC by {base.bic - best.bic:.4g}){hidden}."
        )
        for i, cause in enumerate(best.model.causes[1:], start=1):
            said = ", ".join(f"{name} = {value:.4g}" for name, value in best.model.values(best.x, i).items())
            yield f"Beside it: {cause.label}, {said}."


def _fits(cause: Cause, rig: Rig) -> bool:
    """Whether an extended rig can be extended by a cause too."""
    return any(offered == cause for offered in type(cause).candidates(rig))


def _within(there: Evaluation, e: Evaluation, found: Misfit, hidden: Campaign) -> Misfit:
    """Misfit linearised where it is least within the covariance of the numbers; they stay as they were fitted."""
    low, high = e.model.bounds()
    for _ in range(LINEARISED if len(e.x) else 0):
        if found.fits:
            break
        try:
            x = np.clip(likeliest(there, e.x, e.covariance), low, high)
            there = evaluate(e.model, hidden, x, there.solutions)
        except (ConvergenceError, ValueError):
            break
        before = found.chi2
        found = min(found, misfit_of_new(there, e.x, e.covariance, hidden), key=lambda m: -m.probability)
        if found.chi2 > FALLING * before:
            break
    return found


def _name(e: Evaluation) -> str:
    """Name of the first cause, as formats.md has it."""
    cause = e.model.causes[0]
    return cause.label if isinstance(cause, WrongParameter) else cause.name


def estimates(e: Evaluation) -> dict[str, Estimate]:
    """Parameters of the first cause of a fitted model."""
    cause, std = e.model.causes[0], e.std
    named: dict[str, Estimate] = {}
    if is_dataclass(cause) and not isinstance(cause, WrongParameter):
        named = {f.name: Estimate(v) for f in fields(cause) for v in [getattr(cause, f.name)] if isinstance(v, str)}
    return named | {
        f.name: Estimate(f.value(x), float(s), f.unit)
        for f, x, s in zip(e.model.free, e.x, std, strict=True)
        if f.cause == 0
    }
