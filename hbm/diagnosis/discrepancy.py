"""The force that a model lacks: where it would have to act, with which harmonics and phase, and how it grows.

The misfit of a record is the receptance of its linearised steady state times an unknown force, harmonic by harmonic, at
each place in turn. No law is assumed: what is left of the misfit with such a force says where the model is wrong. The
calibrated numbers move along, within what is expected of them, so that no place is charged with what they hid.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hbm.diagnosis.forcedrecords import Placed, record_places, response_of
from hbm.diagnosis.missingforce import CLEAR, MissingForce, character, share_text
from hbm.diagnosis.places import CONTACT, AnyPlace, Complex
from hbm.diagnosis.projection import Span
from hbm.diagnosis.remainder import LEFT, NEARLY_ALL
from hbm.fourier import Array
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation
from hbm.parallel import each
from models.jointed import AnyRig, JointedRig

LEFT_OVER = 0.1
"""Share of the coefficients that must be left beyond the unknowns, for a place to be told."""


BEYOND = 5.0
"""Misfit above noise, in standard deviations of its own, from which there is something to explain."""


MOST_LISTED = 3
"""Places that are named beside the best one."""


SAME = 1e-6
"""Relative difference of what two places leave, below which forces there can do the same."""


ALIKE = 1.1
"""Places are not told apart that leave less than so many times what the best one leaves, where noise is less."""


class Known(NamedTuple):
    """What unknown forces at what rubs already explain alone, as :class:`MissingForce`: the contact, or all joints."""

    at: str
    several: bool
    share: float
    chi2: float
    left: float
    unknowns: int

    def __str__(self) -> str:
        """In words."""
        return f"{'unknown forces' if self.several else 'an unknown force'} at {self.at}"


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """The missing force at each place.

    Attributes
    ----------
    records : (r,) int array
    level, hz : (r,) array
        Nominal force [N] and frequency [Hz].
    chi2, points : float, int
        Misfit of the model, and the number of coefficients measured.
    places : tuple of MissingForce
        Each alone; the one that explains most first.
    beside : tuple of MissingForce
        Each beside free forces at the contact, or at all joints: what is left then is the linear structure, so that
        these hold however large the misfit. Empty where there are too few sensors for so many forces.
    known : Known, optional
        What these free forces explain alone.
    """

    records: npt.NDArray[np.int64]
    level: Array
    hz: Array
    chi2: float
    points: int
    places: tuple[MissingForce, ...]
    beside: tuple[MissingForce, ...] = ()
    known: Known | None = None

    @property
    def explainable(self) -> bool:
        """Whether there is a misfit beyond noise, and whether sensors are enough to place it."""
        return self.beyond_noise and self.localised

    @property
    def beyond_noise(self) -> bool:
        """Whether there is something to explain."""
        return bool(self.chi2 - self.points > BEYOND * np.sqrt(2.0 * self.points))

    @property
    def localised(self) -> bool:
        """Whether there are more coefficients than unknowns of one place."""
        return self.points - self.places[0].unknowns > LEFT_OVER * self.points

    @property
    def ranked(self) -> tuple[MissingForce, ...]:
        """Places that the best one is taken from, itself first."""
        return self.beside if self.two else self.places

    @property
    def alike(self) -> tuple[MissingForce, ...]:
        """The best place, and those that these records cannot tell from it."""
        if self.placed:
            return tuple(p for p in self.ranked if self._noise_alone(p))
        return tuple(p for p in self.ranked if p.left <= ALIKE * self.best.left)

    @property
    def two(self) -> bool:
        """Whether it takes a force beside those of what rubs: a place alone leaves more than noise, both far less.

        A force elsewhere changes those of the contact too, beyond what is linear: alone, it may seem to act there.
        Where next to all is explained by a place alone, two must leave noise.
        """
        single = self.places[0]
        if self.known is None or not self.beside or self._noise_alone(single) or self._noise_alone(self.known):
            return False
        both = self.beside[0]
        worth = single.share <= NEARLY_ALL or self._noise_alone(both)
        return worth and both.left - 1.0 < LEFT * (min(single.left, self.known.left) - 1.0)

    @property
    def own(self) -> bool:
        """Whether forces at the joints that are known explain far more than one place does, and as much as with one."""
        return self.known is not None and not self.two and self.known.left - 1.0 < LEFT * (self.places[0].left - 1.0)

    @property
    def left(self) -> float:
        """Noise variances that are left by what is told: forces at the joints where these alone do, else the best."""
        return self.known.left if self.own and self.known is not None else self.best.left

    @property
    def contact(self) -> MissingForce | None:
        """The force at the contact alone, of a rig that has one."""
        return next((p for p in self.places if p.place.name == CONTACT), None)

    @property
    def best(self) -> MissingForce:
        """At the place that explains most, alone or, where that does not do, beside free forces of what rubs."""
        return self.ranked[0]

    @property
    def placed(self) -> bool:
        """Whether a force at the best place leaves noise alone."""
        return self._noise_alone(self.best)

    def share(self, p: MissingForce) -> float:
        """Part that a place explains of the misfit beyond noise; of two, of what the known ones alone leave of it."""
        if not self.two or self.known is None:
            return p.share
        return float(np.clip(1.0 - (p.left - 1.0) / (self.known.left - 1.0), 0.0, 1.0))

    def _noise_alone(self, p: MissingForce | Known) -> bool:
        dof = self.points - p.unknowns
        return bool(p.chi2 < dof + CLEAR * np.sqrt(2.0 * dof))

    def sentences(self, named: Evaluation | None = None) -> list[str]:
        """Findings in sentences, with numbers, beside the model with the cause that was named, if one was."""
        return list(self._sentences(named))

    def _sentences(self, named: Evaluation | None) -> Iterator[str]:
        if not self.localised:
            yield "A missing force cannot be placed: there are hardly more sensors than forces to find."
            if self.contact is not None and self.beyond_noise:
                yield "The following holds if it acts at the contact."
                yield from character(self.contact)
            return
        if self.explainable:
            doubted = named is not None and not self.placed and _left(named) < self.best.left
            yield from self._place("To first order the" if doubted else "The")
            yield from character(self.best)
            if named is not None and doubted:
                yield (
                    f"{named.model.label} explains more, to any order: it leaves {_left(named):.3g} noise variances. "
                    "Where it acts elsewhere, that is the place."
                )

    def _place(self, the: str) -> Iterator[str]:
        best, others = self.best, [p.place.name for p in self.alike if p is not self.best]
        acts = {"force": "force acts at", "motion": "motion is that of", "reading": "part is read by"}[best.place.kind]
        beside, whole = "", "the misfit beyond noise"
        if self.two and self.known is not None:
            beside = f" beside {self.known}"
            whole = f"what that alone leaves, {self.known.left:.3g} noise variances,"
        told = ", ".join(f"{p.place.name} {share_text(self.share(p))}, {p.left:.3g}" for p in self.ranked[1:4])
        yield (
            f"{the} missing {acts} {best.place.name}{beside}: explains {share_text(self.share(best))} of {whole} "
            f"and leaves {best.left:.3g} noise variances; next: {told}."
        )
        if self.two:
            single = self.places[0]
            yield f"No place alone will do: {single.place.name}, the best, leaves {single.left:.3g} noise variances."
        if self.own and self.known is not None:
            yield (
                f"With {self.known}, all together, {self.known.left:.3g} noise variances are left: "
                "what is wrong may be there."
            )
        left = "noise alone" if self.placed else "hardly more"
        if len(others) > MOST_LISTED:
            yield f"These records place it poorly: {left} is left by {len(others)} other places as well."
        elif others:
            yield f"{left.capitalize()} is left by {', '.join(others)}: these records do not tell them apart."


def _left(e: Evaluation) -> float:
    """What a model leaves, in noise variances."""
    return e.white.charged / len(e.white)


def best_placed(
    calibrated: Evaluation, nominal: Evaluation | None, campaign: Campaign, executor: Executor | None = None
) -> Discrepancy:
    """The force that a calibrated model lacks, or that the rig file lacks as it is, where that places it better.

    Numbers of the rig file that make up for a force that is missing may go far: then the structure is wrong as well.

    Parameters
    ----------
    calibrated : Evaluation
    nominal : Evaluation or None
    campaign : Campaign
    executor : concurrent.futures.Executor, optional
        Does the records side by side.
    """
    found = discrepancy(calibrated, campaign, executor)
    if nominal is None or not found.explainable or found.placed:
        return found
    before = discrepancy(nominal, campaign, executor)
    return before if ALIKE * before.left < found.left else found


def discrepancy(e: Evaluation, campaign: Campaign, executor: Executor | None = None) -> Discrepancy:
    """The force that a model lacks, at each place in turn.

    Parameters
    ----------
    e : Evaluation
        A model beside the records of the campaign.
    campaign : Campaign
    executor : concurrent.futures.Executor, optional
        Does the records side by side.
    """
    rig = campaign.numerics.working.rig(e.model.rig(e.x))
    found = [r for r in campaign.data.records if r.number in e.found]
    rigs = [r.rig(rig) for r in found]
    responses = each(executor, partial(response_of, campaign.data), rigs, [e.found[r.number].solution for r in found])
    white = [
        Placed(r, e, campaign, record_places(here, campaign.data), c)
        for r, here, c in zip(found, rigs, responses, strict=True)
    ]
    places = record_places(rig, campaign.data)
    points, numbers = sum(len(w.residual) for w in white), sum(w.beside.shape[1] + 2 * campaign.data.H for w in white)
    alone = [_at(place, [Span(w.columns[i]) for w in white], white, e, i) for i, place in enumerate(places)]
    beside, known = [], None
    if white[0].beside.size and points - numbers > LEFT_OVER * points:
        known = _known(rig, white, e)
        beside = [
            _at(place, [Span(np.hstack([w.columns[i], w.beside])) for w in white], white, e, i)
            for i, place in enumerate(places)
            if place.name != CONTACT
        ]
    records, level, hz = ([getattr(w.record, name) for w in white] for name in ("number", "level", "hz"))
    return Discrepancy(
        np.array(records),
        np.array(level),
        np.array(hz),
        e.chi2,
        points,
        places=_by_misfit(alone),
        beside=_by_misfit(_apart(beside)),
        known=known,
    )


def _by_misfit(found: Iterable[MissingForce]) -> tuple[MissingForce, ...]:
    """The one that leaves least first."""
    return tuple(sorted(found, key=lambda m: m.chi2))


def _apart(found: Iterable[MissingForce]) -> Iterator[MissingForce]:
    """Without those that can do what one before them can: from a place to a joint whose force is free, say."""
    kept = list[float]()
    for m in found:
        if not any(math.isclose(m.chi2, other, rel_tol=SAME) for other in kept):
            kept.append(m.chi2)
            yield m


class _Explained(NamedTuple):
    """What forces explain with calibrated numbers that move along by `step`, as :class:`MissingForce`."""

    step: Array
    share: float
    chi2: float
    left: float
    unknowns: int


def _explained(spans: Sequence[Span], white: Sequence[Placed], e: Evaluation) -> _Explained:
    """What forces explain that span so much of each record."""
    left = np.concatenate([s.across(w.residual) for s, w in zip(spans, white, strict=True)])
    slopes = np.concatenate([s.across(w.jacobian) for s, w in zip(spans, white, strict=True)])
    calibration, rows = Span(np.vstack([slopes, e.expected])), np.concatenate([left, -e.pulls])
    step, chi2 = calibration.amplitudes(rows), float(np.sum(calibration.across(rows) ** 2))
    points, unknowns = len(left), sum(s.rank for s in spans)
    excess, remains = e.chi2 - points, max(chi2 - (points - unknowns), 0.0)
    share = float(np.clip(1.0 - remains / excess, 0.0, 1.0)) if excess > 0.0 else 0.0
    return _Explained(step, share, chi2, chi2 / max(points - unknowns, 1), unknowns)


def _known(rig: AnyRig, white: Sequence[Placed], e: Evaluation) -> Known:
    """What free forces at the contact explain, or at all joints of a rig."""
    found = _explained([Span(w.beside) for w in white], white, e)
    if not isinstance(rig, JointedRig):
        return Known("the contact", False, *found[1:])
    joints = f"the joint{'s' * (len(rig.joints) > 1)} {' and '.join(j.name for j in rig.joints)}"
    return Known(joints, len(rig.structure.joints) > 1, *found[1:])


def _at(place: AnyPlace, spans: Sequence[Span], white: Sequence[Placed], e: Evaluation, i: int) -> MissingForce:
    """The missing force at the i-th place."""
    step, share, chi2, left, unknowns = _explained(spans, white, e)
    H = len(white[0].seen[i])
    missed = [w.residual - w.jacobian @ step for w in white]
    found = [_harmonics(s, rows, H) for s, rows in zip(spans, missed, strict=True)]
    against = [
        w.held_against(i, s.amplitudes(rows), s.across(rows)) for w, s, rows in zip(white, spans, missed, strict=True)
    ]
    return MissingForce(
        place=place,
        share=share,
        chi2=chi2,
        left=left,
        unknowns=unknowns,
        force=np.array([force for force, _ in found]),
        std=np.array([std for _, std in found]),
        seen=np.array([seen for seen, _ in against]),
        missed=np.array([part for _, part in against]),
        hz=np.array([w.record.hz for w in white]),
    )


def _harmonics(span: Span, rows: Array, H: int) -> tuple[Complex, Array]:
    """Amplitudes (H,) of a place, whose columns are the first, and the standard deviation of their parts.

    Both are nan where no sensor sees any.
    """
    std = span.std[: 2 * H]
    x = np.where(np.isnan(std), np.nan, span.amplitudes(rows)[: 2 * H])
    return x[:H] - 1j * x[H:], np.sqrt((std[:H] ** 2 + std[H:] ** 2) / 2)
