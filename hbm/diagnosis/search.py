"""The search for the simplest story that explains the records fitted: what is tried, in which order."""

from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import replace

from hbm.diagnosis.attached import same_force
from hbm.diagnosis.calibrate import blamed, calibrate, off, off_beside_sensors, profiled
from hbm.diagnosis.candidates import fit_candidates
from hbm.diagnosis.decide import (
    BARE,
    DECISIVE,
    MOST_RANKED,
    PAYS,
    Decision,
    best_first,
    best_of,
    evidence,
    held_by,
    inside,
    leading,
    nearest,
    one_of_each,
    others_of,
    pays,
    plainest,
    same_or_held,
    simpler,
    suspicious,
    tied,
)
from hbm.diagnosis.foremost import foremost
from hbm.diagnosis.fullfits import suits
from hbm.diagnosis.judge import background_of, beside
from hbm.diagnosis.misfit import misfit
from hbm.diagnosis.remainder import beyond_noise, explained
from hbm.diagnosis.restart import apart, in_place_of, led_to, less_moved, moving_alike, started
from hbm.diagnosis.screen import Screening, small
from hbm.diagnosis.standing import COMPARED, NEARLY, Standing
from hbm.outputerror.background import LARGEST
from hbm.outputerror.evaluation import Evaluation
from hbm.outputerror.fit import fit_model, refine
from hbm.outputerror.simulated import FAILURES
from models.causes.parameter import WrongParameter
from models.causes.records import NotSteady

TOLERATED = 0.015
"""Misfit of the rig file as it is, relative to the response, in which no cause is looked for that tolerances do for."""

HARDLY = 0.1
"""Share of the misfit of identified modes that calibration takes at most where another race over it would repeat."""

CLOSEST, LAST = 1, 4
"""Causes found over the rig file as it is that are calibrated too; steps of the last fit."""

AHEAD = 4
"""Causes that promise most over the calibrated rig file, and are tried over it as it is."""

ALIKE = 0.99
"""Cosine of the signatures of two numbers from which on one is tried where the other was found."""


class Search(Standing):
    """The search on the records fitted."""

    def decide(self) -> Decision:
        """The simplest story that will do: see :mod:`hbm.diagnosis.decide`."""
        found = self._contained(self._plain())
        if not self._fits(found.story) or not self.tolerable(found.story):
            return self._beside_background()
        plain = self.campaign
        for e in self._simpler_than(found):
            beside_it = self._beside_background(e)
            if same_or_held(beside_it.story, e):
                return beside_it
            self.campaign = plain
        return found

    def _simpler_than(self, found: Decision) -> list[Evaluation]:
        """Fits that may do in place of what leaves noise alone, if what they leave is a background.

        Those that a cause contains; and in place of many small errors of the rig file the best single cause over it,
        if no single one of them does as well.
        """
        if found.best is None:
            best = None if self._fits(self.nominal) else next(filter(self._enough, found.fits), None)
            if best is None:
                return []
            margin = DECISIVE if isinstance(best.model.causes[0], WrongParameter) else BARE
            return [] if self._alone_does(best, margin) else [best]
        return inside(found.best, [e for e in self.fitted if self._enough(e)])

    def _contained(self, found: Decision) -> Decision:
        """The same beside causes that the one found contains, and numbers that do alike, that were not tried.

        Where one of these does it within its tolerance, calibration goes on from there: it had ended in a wrong valley.
        """
        again = [] if found.best is None else self._held_in(found.best, found.fits)
        for e in again:
            if found.best is not None and self._is_small_error(e) and e.bic <= found.best.bic + DECISIVE:
                self.calibrated = self._calibrated_from(e) or self.calibrated
                if self._within():
                    return self._within_tolerances(found)
        return self._decided(found.base, [*again, *found.fits], self.tried) if again else found

    def _held_in(self, best: Evaluation, fits: Sequence[Evaluation]) -> list[Evaluation]:
        """What one of its causes contains in its place, or acts alike, if not among the fits, from where it stands."""
        causes, known = best.model.causes, {e.model.label for e in fits}
        noise, again = replace(self.campaign, background={}), list[Evaluation]()
        held = [held_by(rich) - {rich.label} for rich in causes]
        for i, cause in ((i, c) for i, labels in enumerate(held) for c in self.candidates if c.label in labels):
            model = best.model.with_cause(i, cause)
            if model.label in known:
                continue
            start = {(i, name): value for name, value in same_force(best, i, cause, noise).items()}
            with suppress(*FAILURES):
                fit = fit_model(model, noise, model.at(best.values | start), best.solutions)
                again.append(refine(fit, noise))
        for i, number in self._alike_in(best):
            if best.model.with_cause(i, number).label not in known:
                with suppress(*FAILURES):
                    again.append(in_place_of(best, i, number, noise))
        self.fitted += again
        return again

    def _alike_in(self, best: Evaluation) -> list[tuple[int, WrongParameter]]:
        """Numbers that look like wrong ones among its causes whatever their size, by the places of these.

        Single ones of a rig with joints were all fitted side by side.
        """
        causes = best.model.causes
        if self.identified and len(causes) == 1:
            return []
        found = list[tuple[int, WrongParameter]]()
        for i, cause in enumerate(causes):
            if isinstance(cause, WrongParameter):
                by_test = self.screenings[0].look_alikes
                alike = moving_alike(best, i, ALIKE) if best.model.calibrated else by_test(cause.label, ALIKE)
                numbers = (c for c in self.candidates if isinstance(c, WrongParameter) and c not in causes)
                found += [(i, number) for number in numbers if number.label in alike]
        return found

    def _plain(self) -> Decision:
        """The simplest story that leaves noise alone; where there is none, the best of those that nearly do."""
        nominal = misfit(self.nominal, self.campaign)
        if nominal.fits and not suspicious(self.over(self.first), self.rig):
            return Decision(self.nominal, None, ())
        if self._within() and beyond_noise(self.nominal.white) <= TOLERATED:
            return Decision(self.calibrated, None, ())
        exact = self._exact()
        if self._stands(exact):
            return exact
        if self._within():
            return self._within_tolerances(exact)
        if nominal.fits:
            return Decision(self.nominal, None, exact.fits)
        exact = self._instead(exact)
        if self._stands(exact):  # calibration may have come to leave noise meanwhile
            return exact
        if self._within():
            return self._within_tolerances(exact)
        first = self._over_calibrated(exact)
        if self._within():
            return self._within_tolerances(exact)
        if self._explains(first):
            return self._plainest(exact, first)
        exact = self._gone_far(exact)
        if self._explains(exact):
            return exact
        if not (exact.fits or first.fits or self.identified):
            exact = self._race(self.first, self.over(self.first), 0.6)
        single = best_first(exact, first)
        if single.best is not None and self._enough(single.best):
            return single
        several = self._several() if off(self.trust, self.calibrated) else None
        if several is not None:
            return several
        small = beyond_noise(self.calibrated.white) <= LARGEST and self.tolerable(self.calibrated)
        leads = [] if small else leading(self.calibrated, single.best, best_of(self.fitted))
        return best_first(single, *[self._pair(single, lead) for lead in leads])

    def _exact(self) -> Decision:
        """What explains the rig file as it is, if it is likely, as what calibration takes to its bounds is.

        Nothing is tried where tolerances take next to all and leave more than noise, all where joints moved along from
        the start.
        """
        if self.identified:
            return self._race(self.first, self.over(self.first), 0.3)
        wrong = {WrongParameter(key).label for key in off_beside_sensors(self.trust, self.calibrated)}
        taken = explained(self.nominal.white, self.calibrated.white) >= NEARLY
        if not wrong and taken and not self._fits(self.calibrated):
            return Decision(self.nominal, None, ())
        return self._race(self.first, self.over(self.first), 0.3, wrong)

    def _within_tolerances(self, exact: Decision) -> Decision:
        """The calibrated rig file, or one cause that is likelier in place of all that its numbers have moved.

        Where these have moved, what they did is linear in what could have been in their place.
        """
        screening, known = self.over(self.calibrated), {e.model.label for e in exact.fits}
        causes = [s for s in screening.instead if s.cause.label not in known and s.cause.label not in self._tolerated]
        if self.identified or small(self.nominal) or not causes:
            return Decision(self.calibrated, None, exact.fits)
        found = self._race(self.nominal, replace(screening, scores=tuple(causes[:COMPARED])), 0.5)
        fits = tuple(one_of_each(best_of([*found.fits, *exact.fits])))
        return found if self._stands(found) else Decision(self.calibrated, None, fits)

    def _stands(self, found: Decision) -> bool:
        """Whether a cause over the rig file as it is explains it, and small errors of its numbers are less likely."""
        return self._explains(found) and (not self._within() or self._likelier(found))

    def _likelier(self, found: Decision) -> bool:
        """Whether the cause found is likelier than many small errors of the rig file, and than one of these alone."""
        best = found.best
        if best is None or not simpler(best, self.calibrated, self.tried):
            return False
        return not self._alone_does(best, DECISIVE)

    def _alone_does(self, best: Evaluation, margin: float) -> bool:
        """Whether one number within its tolerance, of those that calibration may have moved for it, does as a cause.

        Its BIC is larger by no more than a margin.
        """
        return any(e.bic <= best.bic + margin for e in self._alone(self.calibrated))

    def _over_calibrated(self, exact: Decision) -> Decision:
        """What explains the calibrated rig file, calibrated further from where that was found if it gets further."""
        first = self._first_over_calibrated(exact)
        further = None if first.best is None else self._calibrated_from(first.best)
        if further is None:
            return first
        self.calibrated = further
        return self._decided(self.calibrated, first.fits, self.tried)

    def _first_over_calibrated(self, exact: Decision) -> Decision:
        """What explains the calibrated rig file as it is; of what explains next to all of the other, the best alone."""
        near = [e for e in exact.fits if self._settles(e)][:CLOSEST]
        if near and not self._fits(self.calibrated):
            again = [e for found in near for e in self._over_tolerances(found)]
            return self._decided(self.calibrated, again, self.tried)
        # where the rig file moved along from the beginning, another race would but start elsewhere
        told = bool(self.first.model.calibrated) and (
            explained(self.first.white, self.calibrated.white) <= HARDLY
            or (exact.best is not None and explained(self.calibrated.white, exact.best.white) >= NEARLY)
        )
        return exact if told else self._race(self.calibrated, self.over(self.calibrated), 0.55)

    def _instead(self, exact: Decision) -> Decision:
        """The same with what promises most over the calibrated rig file, over it as it is if it was not tried there.

        There its effect may be too large for the score test, which is of the first small one; what gives way by any
        factor is looked for beside it. And the numbers of the calibrated one have gone far to do without it: what does
        as they did may be in their place.
        """
        if self.identified or any(map(self._settles, exact.fits)):
            return exact
        here, there = self.over(self.first), self.over(self.calibrated)
        known = self._tolerated.keys() | {e.model.label for e in exact.fits}
        ahead = [
            [s.cause.label for s in part if s.cause.label not in self._tolerated][:AHEAD]
            for part in (there.scores, there.instead)
        ]
        untried = [s for s in here.scores if s.cause.label not in known]
        large = [] if small(self.first) else self._quick(self.first, self.campaign).giving_way(untried)
        chosen = {s.cause.label for s in large}.union(*ahead)
        scores = tuple(s for s in untried if s.cause.label in chosen)
        found = self._race(self.first, replace(here, scores=scores), 0.5) if scores else exact
        return best_first(found, exact)

    def _gone_far(self, exact: Decision) -> Decision:
        """The same with the cause that takes nearly all over the calibrated rig file, over it as it is from there.

        Where that has left its tolerances: they had gone far to do without the cause, and hold it where it does not
        belong.
        """
        if self.identified:
            return exact
        best = [e for e in best_of(self.fitted)[:1] if len(e.model.causes) == 1 and not self.tolerable(e)]
        taken = [e for e in best if explained(self.calibrated.white, e.white) >= NEARLY]
        again = [e for found in taken for e in started(self.nominal, found, found.model.causes, self.campaign)]
        self.fitted += again
        return self._decided(self.nominal, [*again, *exact.fits], self.tried) if again else exact

    def _beside_background(self, leaves: Evaluation | None = None) -> Decision:
        """The likeliest story, all models beside what one of them leaves: the likeliest, where none leaves noise."""
        self.tell("beside a background", 0.8)
        whole = [e for e in (*self.fitted, *self._calibrated_too()) if not e.missing]
        within = [*filter(self.tolerable, whole), *self._less_moved(whole)]
        models = [e for e in within if len(e.model.causes) == 1 or pays(e, (*self.fitted, *within))]
        leaves = leaves or min((self.nominal, self.calibrated, *models), key=evidence)
        self.campaign = replace(self.campaign, background=background_of(leaves, self.campaign))
        nominal, calibrated, *others = (beside(e, self.campaign) for e in (self.nominal, self.calibrated, *models))
        ranked = sorted(others, key=evidence)
        bases = [(e, calibrated if e.model.calibrated else nominal) for e in ranked]
        best = next((e for e, base in bases if self._accepted(base, e, self.tried, ranked)), None)
        if best is None or (self.tolerable(calibrated) and not simpler(best, calibrated, self.tried)):
            near = [] if ranked else nearest(self.fitted)[:MOST_RANKED]  # none is within tolerances
            return Decision(calibrated, None, tuple(one_of_each([*ranked, *(beside(e, self.campaign) for e in near)])))
        # not only those ranked: a fit that none of these is would be made again without end
        if self._held_in(best, (best, *self._fitted_over(best.model))):
            return self._beside_background(leaves)
        best = self._fitted_beside(plainest(best, ranked), models)
        base = calibrated if best.model.calibrated else nominal
        best = min([best, *led_to(base, best, self.campaign)], key=evidence)
        return Decision(base, best, (best, *others_of(best, ranked)))

    def _less_moved(self, fits: Sequence[Evaluation]) -> list[Evaluation]:
        """The best cause and pair, if small errors move exact numbers out of tolerances, fitted so that they stay.

        Numbers at their bounds may leave more than these errors: how much is asked where they stay. And what they
        contain, which has but to be simpler.
        """
        of_size = [[e for e in best_of(fits) if len(e.model.causes) == size] for size in (1, 2)]
        chosen = [one_of_each([*ranked[:1], *inside(ranked[0], ranked)]) for ranked in of_size if ranked]
        best = [e for ranked in chosen for e in ranked if not self.tolerable(e) and self._takes(e)]
        again = ([*filter(self._stays, less_moved(e, self.nominal, self.campaign))] for e in best)
        return [min(stay, key=lambda w: w.chi2) for stay in again if stay]

    def _stays(self, e: Evaluation) -> bool:
        return self.tolerable(e) and self._takes(e)

    def _fitted_beside(self, best: Evaluation, models: Sequence[Evaluation]) -> Evaluation:
        """The model that was chosen to first order, fitted beside the background from where it stood without."""
        start = next(e for e in models if e.model is best.model)
        campaign = replace(self.campaign, corrections=start.corrections)
        with suppress(*FAILURES):
            return fit_model(start.model, campaign, start.x, start.solutions, LAST)
        return best

    def without_second(self, found: Decision, pair: Evaluation) -> Decision:
        """The same with the first cause of a pair alone, where that is accepted so; else without a cause."""
        alone = [e for e in found.fits if e.model.causes == pair.model.causes[:1]]
        best = next((e for e in alone if self._accepted(found.base, e, self.tried, found.fits)), None)
        return replace(found, best=best)

    def _calibrated_too(self) -> list[Evaluation]:
        """The best causes found over the rig file as it is, over the calibrated one where they are not known there."""
        known = {e.model.label for e in self.fitted if e.model.calibrated}
        plain = [e for e in best_of(self.fitted) if e.model.label not in known and not e.missing]
        too = [e for found in plain[:CLOSEST] for e in self._over_tolerances(found)]
        pairs = [e for e in too if len(e.model.causes) > 1]
        return [*too, *(e for pair in pairs[:1] for e in apart(self.calibrated, pair, self.campaign))]

    def _race(
        self, base: Evaluation, screening: Screening, done: float, likely: Collection[str] | None = None
    ) -> Decision:
        lifted = self._lifted(base)
        over = self.calibrated if base is self.first and base.model.calibrated else base
        if any(self._fits(e) for e in lifted):
            return self._decided(over, lifted, self.tried)
        screening = foremost(screening, base, self.calibrated, self.campaign, alone=base is self.calibrated)
        quick = self._quick(base, self.campaign)
        fits = fit_candidates(quick, screening, lambda doing: self.tell(doing, done), self._settles, likely)
        self.fitted += fits
        self.quickly |= quick.solved
        return self._decided(over, [*lifted, *fits], self.tried)

    def _plainest(self, exact: Decision, first: Decision) -> Decision:
        """What explains over the calibrated model, over the rig file as it is if it does so there too.

        Whether a search over the latter gets into the right valley may hang on little.
        """
        close = [] if first.best is None else [first.best, *tied(first.fits, first.best)]
        again = [e for found in close for e in started(self.nominal, found, found.model.causes, self.campaign)]
        plain = self._decided(self.nominal, [*again, *exact.fits], self.tried)
        return plain if self._explains(plain) else first

    def _several(self) -> Decision | None:
        """Only numbers of the rig file are wrong, several of them: each of those becomes a cause."""
        self.tell("free calibration", 0.65)
        base = calibrate(profiled(self.trust), self.campaign, self.calibrated.solutions)
        best = blamed(self.trust, base, self.calibrated, self.campaign) if self._nearly(base) else None
        if best is None:
            return None
        self.fitted.append(best)
        found = self._decided(self.calibrated, [best], self.tried)
        return None if found.best is None else found

    def _pair(self, earlier: Decision, single: Evaluation) -> Decision:
        """Two causes: one more beside one, if it pays; not transients, which are free and would take what is left."""
        base = earlier.base if earlier.best is single else self.calibrated if single.model.calibrated else self.nominal
        others = [c for c in self.candidates if c not in single.model.causes and not isinstance(c, NotSteady)]
        rest = [c for c in others if suits(c, single.model.rig(single.x))]
        name, scores = single.model.label, self._screened(single, rest)
        scores = foremost(scores, single, single, self.campaign, alone=True)
        fits = fit_candidates(
            self._quick(single, self.campaign),
            scores,
            lambda doing: self.tell(f"{name} and {doing}", 0.7),
            self._enough,
            useful=1.0 - PAYS,
        )
        parted = [e for pair in fits[:1] for e in apart(base, pair, self.campaign)]
        self.fitted += [*fits, *parted]
        found = self._decided(base, [*fits, *parted, *earlier.fits], self.tried**2)
        return replace(found, fits=found.fits[:MOST_RANKED])
