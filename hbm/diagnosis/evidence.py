"""What supports a conclusion, in sentences."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hbm.diagnosis.calibrate import moved, off
from hbm.diagnosis.decide import ALARM, Decision, best_of, sidak
from hbm.diagnosis.estimates import beside_it, lifted
from hbm.diagnosis.judge import beside_noise
from hbm.diagnosis.misfit import Misfit, misfit
from hbm.diagnosis.predict import Predicted
from hbm.diagnosis.remainder import explained, first_of, nearly_all, percent
from hbm.diagnosis.search import Search
from hbm.inverse.units import with_gain
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation
from hbm.outputerror.model import Model
from hbm.outputerror.whitened import Whitened
from models.causes.parameter import WrongParameter
from models.causes.sensors import SensorGain

MOVED = 3
"""So many numbers that calibration moves far are named."""

MOST_TOLD = 8
"""So many are listed that it moves within their tolerances, or that look alike."""

AT_END = 1e-3
"""A number of a cause is at an end of where it is looked for that differs from that by no more than this share."""

TIMED = {"beam.youngs_modulus": 0.5, "beam.density": -0.5, "beam.thickness": 1.0}
"""Power of a number that all natural frequencies are proportional to."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """What was seen on the way to a verdict.

    Attributes
    ----------
    search : Search
    decision : Decision
    noise : Campaign
        The records fitted, beside noise alone.
    held : int
        How many records were held out.
    plain : mapping of str to (Evaluation, Predicted or None)
        The models without a cause, on the records fitted and on those held out.
    scored : Predicted, optional
        The best model on the records held out.
    within : bool
        Whether numbers within their tolerances leave noise alone without the cause that was found beside them.
    """

    search: Search
    decision: Decision
    noise: Campaign
    held: int
    plain: Mapping[str, tuple[Evaluation, Predicted | None]]
    scored: Predicted | None
    within: bool

    def lines(self, verdict: str, best: Evaluation | None, seconds: Sequence[Evaluation] = ()) -> Iterator[str]:
        """All of it; `best` is the model with the cause that is named, `seconds` have another one beside that."""
        search = self.search
        held = f", {self.held} held out" if self.held else "; none held out: too few records or levels"
        yield f"{len(search.campaign.numbers)} records with {search.campaign.points} coefficients fitted{held}."
        yield f"{search.campaign.numerics}."
        yield from self._background()
        if len(np.unique(search.spectra.level)) == 1:
            yield "One level only: damping laws, and friction from its amplitude, cannot be told apart."
        yield from (f"Sensors: {line}." for line in search.sensors)
        yield from self._misfits()
        yield from lifted(self.decision.best or self.decision.base)
        yield from at_bounds(search.trust, search.calibrated)
        if verdict == "consistent" and not misfit(self.plain["nominal"][0], self.noise).fits:
            yield from _calibrated(self.plain["calibrated"][0])
        yield from self._scores()
        if best is not None:
            yield from self._found(best, seconds)
        elif verdict == "unexplained" and self.decision.fits:
            tried = self.decision.fits[0]
            m = misfit(beside_noise(tried, search.campaign), self.noise)
            far = list(off(search.trust, tried))[:MOVED]
            beyond = f", with {' and '.join(far)} farther off than tolerances explain" if far else ""
            yield f"Best tried: {tried.model.label}, {m.chi2_reduced:.3g} noise variances{beyond}{_clearest(m)}."
            if (scored := self.scored) is not None and not scored.misfit.fits:
                yield (
                    f"{scored.evaluation.model.label} does not predict the records held out: "
                    f"{scored.errors.chi2_reduced:.4g} noise variances{_clearest(scored.misfit)}; chance "
                    f"{scored.misfit.probability:.2g}."
                )

    def _background(self) -> Iterator[str]:
        """Say what counts beside the noise because no candidate describes it."""
        sizes = {k: size for k, size in self.search.campaign.background.items() if size > 0.0}
        if sizes:
            told = ", ".join(f"{percent(size)} of harmonic {k}" for k, size in sizes.items())
            yield f"Compared beside a background that no candidate describes, as the best model leaves it: {told}."

    def _misfits(self) -> Iterator[str]:
        for name, (e, scored) in self.plain.items():
            m = misfit(e, self.noise)
            hidden = "" if scored is None else f", {scored.errors.chi2_reduced:.4g} on those held out"
            yield (
                f"The {name} model is off by {m.nrmse:.3%}, {e.white.chi2 / len(e.white):.4g} noise variances on the "
                f"mean{hidden}; probability by noise {m.probability:.2g}" + ("." if m.fits else f"{_clearest(m)}.")
            )
            if e.missing:
                yield f"No steady state of the {name} model was found for records {', '.join(map(str, e.missing))}."

    def _scores(self) -> Iterator[str]:
        screening = self.search.screenings[0]
        if not screening.scores or not screening.scores[0].drop:
            return
        told = ", ".join(f"{s.cause.label} {s.drop:.3g}" for s in screening.scores[:4])
        yield (
            f"Score test on {screening.records} records, predicted fall of chi2: {told}; chance reaches "
            f"{sidak(self.search.tried):.3g} in {ALARM:.1%} of the searches over {self.search.tried} candidates."
        )
        first = screening.scores[0].cause.label
        alike = [f"{name} (cosine {c:.3f})" for name, c in screening.look_alikes(first).items()]
        if alike:
            yield f"Looks like {first}: {first_of(alike, MOST_TOLD)}."

    def _found(self, best: Evaluation, seconds: Sequence[Evaluation]) -> Iterator[str]:
        base = self.plain["calibrated" if best.model.calibrated else "nominal"][0]
        bounded = best.model.calibrated and not self.search.tolerable(self.search.calibrated)
        whole = self.search.nominal if bounded else base  # calibration at its bounds is no rig to compare with
        plain, scored = beside_noise(best, self.search.campaign), self.scored
        hidden = "" if scored is None else f"; on records held out {scored.errors.chi2_reduced:.4g} noise variances"
        yield (
            f"{best.model.label} lowers chi2 from {whole.chi2:.5g} to {plain.chi2:.5g} "
            f"(BIC by {whole.bic - plain.bic:.4g}){hidden}."
        )
        yield from clock(best)
        yield from _unit(best)
        yield from at_ends(best)
        if self.within:
            yield "Without it numbers within their tolerances leave noise alone too, but are further from the rig file."
        if not best.settled:
            yield (
                "Size and phase of the transients are free in each record, those held out too; what the records miss "
                "has no order from one to the next. Hold each frequency longer, measure some again: they then agree."
            )
        yield from (f"Beside it: {beside_it(best, i)}." for i in range(1, len(best.model.causes)))
        if seconds:
            yield f"In place of that as good: {' or '.join(map(beside_it, seconds))}."
        same = [e for e in self.search.fitted if bool(e.model.calibrated) == bool(best.model.calibrated)]
        yield from shares_of_two(best, same, base, lambda e: beside_noise(e, self.search.campaign).white)


def at_bounds(trust: Model, calibrated: Evaluation) -> Iterator[str]:
    """Numbers of the rig file that calibration moves as far as it may, if any."""
    far = [f"{key} ({pull:+.1f})" for key, pull in off(trust, calibrated).items()]
    if far:
        yield (
            f"Calibration moves {first_of(far, MOVED)} as many tolerances as it may: a number of the rig file is "
            "wrong, or physics is missing."
        )


def at_ends(best: Evaluation) -> Iterator[str]:
    """Numbers of the rig file that are wrong and stand at an end of where they are looked for, if it goes on there."""
    for i, cause in enumerate(best.model.causes):
        if not isinstance(cause, WrongParameter):
            continue
        value, (u,) = best.model.values(best.x, i)["value"], best.model.unknowns[i]
        accepted = best.model.nominal.numbers[cause.key][1]
        for end, beyond in ((u.lower, "less"), (u.upper, "more")):
            if accepted.lower < end < accepted.upper and np.isclose(value, end, rtol=AT_END, atol=0.0):
                yield f"{cause.label}: no value {beyond} than {end:.4g} is looked for; it may be {beyond}."


def _calibrated(e: Evaluation) -> Iterator[str]:
    """Numbers that calibration moved within their tolerances."""
    if told := moved(e):
        yield f"Calibration moves within tolerances: {first_of(told, MOST_TOLD)}."


def _clearest(m: Misfit) -> str:
    """Where a misfit is least probable, unless that is everywhere."""
    return f", most clearly in {m.clearest}" if m.clearest else ""


def shares_of_two(
    best: Evaluation, fitted: Sequence[Evaluation], base: Evaluation, white: Callable[[Evaluation], Whitened]
) -> Iterator[str]:
    """What each of two causes explains of what a base leaves, where it was fitted alone, and what both do."""
    if len(best.model.causes) != 2:
        return
    before, told = white(base), []
    for i, cause in enumerate(best.model.causes):
        alone = best_of([e for e in fitted if e.model.causes == best.model.causes[i : i + 1] and not e.missing])
        told += [f"{cause.label} alone explains {nearly_all(explained(before, white(e)))}" for e in alone[:1]]
    if told:
        both = nearly_all(explained(before, white(best)))
        yield f"Of the misfit on the records fitted {', '.join(told)}, both together {both}."


def _unit(best: Evaluation) -> Iterator[str]:
    """What is in another unit where a gain is that between two."""
    cause = best.model.causes[0]
    if isinstance(cause, SensorGain):
        said = with_gain(best.model.nominal, cause.channel, best.model.values(best.x, 0)["gain"])
        if said:
            yield f"Such a gain is found where {' or '.join(said)}."


def clock(best: Evaluation) -> Iterator[str]:
    """What else moves all natural frequencies alike: nobody looks for it, and the records cannot tell."""
    cause = best.model.causes[0]
    if isinstance(cause, WrongParameter) and cause.key in TIMED:
        (now,) = cause.unknowns(best.model.nominal)
        share = (best.model.values(best.x, 0)["value"] / now.neutral) ** TIMED[cause.key] - 1.0
        way = "low" if share < 0.0 else "high"
        yield f"A clock does nearly the same, frequencies stated {abs(share):.2%} too {way}: compare it with another."
