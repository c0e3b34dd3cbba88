"""The force that a model lacks: where it would have to act, with which harmonics and phase, and how it grows.

The misfit of a record is the receptance of its linearised steady state times an unknown force, harmonic by harmonic, at
each place in turn. No law is assumed: what is left of the misfit with such a force says where the model is wrong. The
calibrated numbers move along, within what is expected of them, so that no place is charged with what they hid.
"""

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hbm.balance.solution import PeriodicSolution
from hbm.diagnosis.jointplaces import joint_places_of
from hbm.diagnosis.missingforce import CLEAR, MissingForce, character, share_text
from hbm.diagnosis.places import CONTACT, AnyPlace, Complex, all_at_once, places_of, sensor
from hbm.diagnosis.projection import Span
from hbm.diagnosis.remainder import LEFT, NEARLY_ALL
from hbm.fourier import Array
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation
from hbm.outputerror.records import Measurement, Record, parts
from hbm.outputerror.whitened import uncorrelated
from hbm.parallel import each
from hbm.sensitivity.derivatives import disturbed
from hbm.sensitivity.jointforces import pushed
from models.jointed import AnyRig, JointedRig
from models.parts import UNITS

LEFT_OVER = 0.1
"""Share of the coefficients that must be left beyond the unknowns, for a place to be told."""


BEYOND = 5.0
"""Misfit above noise, in standard deviations of its own, from which there is something to explain."""


MOST_LISTED = 3
"""Places that are named beside the best one."""


ALIKE = 1.1
"""Places are not told apart that leave less than so many times what the best one leaves, where noise is less."""


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
        Each beside a contact force that is free too: what is left then is the linear structure, so that these hold
        however large the misfit. Empty where there are too few sensors for two forces.
    """

    records: npt.NDArray[np.int64]
    level: Array
    hz: Array
    chi2: float
    points: int
    places: tuple[MissingForce, ...]
    beside: tuple[MissingForce, ...] = ()

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
        if self._noise_alone(self.best):
            return tuple(p for p in self.ranked if self._noise_alone(p))
        return tuple(p for p in self.ranked if p.left <= ALIKE * self.best.left)

    @property
    def two(self) -> bool:
        """Whether it takes a force beside that of the contact: a place alone leaves more than noise, both far less.

        A force elsewhere changes that of the contact too, beyond what is linear: alone, it may seem to act there. Where
        next to all is explained by a place alone, two must leave noise.
        """
        single = self.places[0]
        if not self.beside or self._noise_alone(single):
            return False
        both = self.beside[0]
        worth = single.share <= NEARLY_ALL or self._noise_alone(both)
        return worth and both.left - 1.0 < LEFT * (single.left - 1.0)

    @property
    def contact(self) -> MissingForce | None:
        """The force at the contact alone, of a rig that has one."""
        return next((p for p in self.places if p.place.name == CONTACT), None)

    @property
    def best(self) -> MissingForce:
        """At the place that explains most, alone or, where that does not do, beside a free contact force."""
        return self.ranked[0]

    def share(self, p: MissingForce) -> float:
        """Part that a place explains of the misfit beyond noise; of two, of what the contact alone leaves of it."""
        if not self.two or self.contact is None:
            return p.share
        return float(np.clip(1.0 - (p.left - 1.0) / (self.contact.left - 1.0), 0.0, 1.0))

    def _noise_alone(self, p: MissingForce) -> bool:
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
            doubted = named is not None and not self._noise_alone(self.best) and _left(named) < self.best.left
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
        if self.two and self.contact is not None:
            beside = " beside one at the contact"
            whole = f"what that alone leaves, {self.contact.left:.3g} noise variances,"
        told = ", ".join(f"{p.place.name} {share_text(self.share(p))}, {p.left:.3g}" for p in self.ranked[1:4])
        yield (
            f"{the} missing {acts} {best.place.name}{beside}: explains {share_text(self.share(best))} of {whole} "
            f"and leaves {best.left:.3g} noise variances; next: {told}."
        )
        if self.two:
            single = self.places[0]
            yield f"No place alone will do: {single.place.name}, the best, leaves {single.left:.3g} noise variances."
        left = "noise alone" if self._noise_alone(best) else "hardly more"
        if len(others) > MOST_LISTED:
            yield f"These records place it poorly: {left} is left by {len(others)} other places as well."
        elif others:
            yield f"{left.capitalize()} is left by {', '.join(others)}: these records do not tell them apart."


def _left(e: Evaluation) -> float:
    """What a model leaves, in noise variances."""
    return e.white.charged / len(e.white)


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
    responses = each(executor, partial(_response, campaign.data), rigs, [e.found[r.number].solution for r in found])
    white = [
        _Placed(r, e, campaign, _places(here, campaign.data), c)
        for r, here, c in zip(found, rigs, responses, strict=True)
    ]
    places = _places(rig, campaign.data)
    points, numbers = sum(len(w.residual) for w in white), 2 * campaign.data.H * len(white)
    alone = [_at(place, [Span(w.columns[i]) for w in white], white, e, i) for i, place in enumerate(places)]
    beside = [
        _at(place, [Span(np.hstack([w.columns[i], w.columns[0]])) for w in white], white, e, i)
        for i, place in enumerate(places)
        if i and places[0].name == CONTACT and points - 2 * numbers > LEFT_OVER * points
    ]
    records, level, hz = ([getattr(w.record, name) for w in white] for name in ("number", "level", "hz"))
    return Discrepancy(
        np.array(records),
        np.array(level),
        np.array(hz),
        e.chi2,
        points,
        *(tuple(sorted(found, key=lambda m: m.chi2)) for found in (alone, beside)),
    )


def _places(rig: AnyRig, data: Measurement) -> list[AnyPlace]:
    """Where a force may be missing, and the sensors."""
    unit = {c.name: UNITS[c.quantity] for c in rig.channels}
    forces = joint_places_of(rig) if isinstance(rig, JointedRig) else places_of(rig)
    return [*forces, *(sensor(name, unit[name]) for name in data.channels)]


class WhiteRecord:
    """A record in standard deviations: its misfit, what calibrated numbers and forces at each place do to it.

    Parameters
    ----------
    record : Record
    e : Evaluation
    campaign : Campaign
    places : sequence of Place
        Of the rig as it is in the record.
    columns : (2, c, H, p 2 H) array
        Change of the amplitudes with cosines, then sines of harmonics 1..H at each of p places.
    """

    def __init__(
        self, record: Record, e: Evaluation, campaign: Campaign, places: Sequence[AnyPlace], columns: Array
    ) -> None:
        self.record, simulated = record, e.found[record.number]
        own = e.white.record == record.number
        self.residual, self.jacobian = e.white.residual[own], e.white.jacobian[own]
        noise, std = campaign.correlated(record, simulated), campaign.listed_std(record)
        white = uncorrelated(noise, columns[record.listed] / std[:, None])
        self.columns = np.split(white, len(places), axis=1)
        self.seen = [p.seen(simulated.solution)[1 : campaign.data.H + 1] for p in places]


class _Response(NamedTuple):
    """What cosines, then sines of harmonics 1..H at each of p places do.

    Attributes
    ----------
    channels : (2, c, H, p 2 H) array
        Change of the amplitudes of the channels.
    seen : tuple of (H, 2 H) complex array or None
        Change of what each place's own is held against; None where that is not known.
    """

    channels: Array
    seen: tuple[Complex | None, ...]


class _Placed(WhiteRecord):
    """A record in standard deviations, and how what is held against a force at each place changes with it."""

    def __init__(
        self, record: Record, e: Evaluation, campaign: Campaign, places: Sequence[AnyPlace], response: _Response
    ) -> None:
        super().__init__(record, e, campaign, places, response.channels)
        self.changes = response.seen
        own = e.white.record == record.number
        self.size = float(np.linalg.norm(e.white.measured[own] / campaign.listed_std(record)))

    def held_against(self, i: int, force: Complex, left: Array) -> tuple[Complex, float]:
        """Amplitudes (H,) of what the force (H,) found at the i-th place is held against, and how uncertain they are.

        The model moves as the records do only with the force; `left` is what they miss then, in standard deviations.
        """
        change = self.changes[i]
        if change is None:
            return self.seen[i], float(np.linalg.norm(self.residual)) / self.size
        moved = change @ np.nan_to_num(np.concatenate([force.real, -force.imag]))
        return self.seen[i] + moved, float(np.linalg.norm(left)) / self.size


def _response(data: Measurement, rig: AnyRig, solution: PeriodicSolution) -> _Response:
    """What forces at the places of the rig of a record do, and what is added to the readings of the sensors."""
    change, seen = _pushed(rig, data, solution)
    readings = [_of_reading(i, len(data.channels), data.H) for i in range(len(data.channels))]
    unit = np.eye(data.H)
    read = [np.hstack([unit, -1j * unit])] * len(readings)
    return _Response(np.concatenate([read_by(data, solution, change), *readings], axis=3), (*seen, *read))


def _pushed(
    rig: AnyRig, data: Measurement, solution: PeriodicSolution
) -> tuple[Mapping[str, Array], Sequence[Complex | None]]:
    """Change of the channels by forces at each place, and of the motion there by its own force where it is known."""
    if not isinstance(rig, JointedRig):
        places = places_of(rig)
        return disturbed(rig, solution, all_at_once(places, solution, data.H)), [None] * len(places)
    ends = [place.ends for place in joint_places_of(rig)]
    found, basis = pushed(rig, solution, ends, data.H), solution.basis
    return found.channels, [basis.complex(found.moved[i, :, i])[1 : data.H + 1] for i in range(len(ends))]


def read_by(data: Measurement, solution: PeriodicSolution, change: Mapping[str, Array]) -> Array:
    """Change of the amplitudes (2, c, H, p) of the channels, from that of the coefficients."""
    return np.stack([parts(solution.basis, change[name], data.H) for name in data.channels], axis=1)


def _of_reading(channel: int, channels: int, H: int) -> Array:
    """Amplitudes (2, c, H) of one channel with its own cosines and sines (2 H)."""
    out = np.zeros((2, channels, H, 2 * H))
    out[0, channel, :, :H] = np.eye(H)
    out[1, channel, :, H:] = -np.eye(H)
    return out


def _at(place: AnyPlace, spans: Sequence[Span], white: Sequence[_Placed], e: Evaluation, i: int) -> MissingForce:
    """The missing force at the i-th place; calibrated numbers move by `step` along with it."""
    left = np.concatenate([s.across(w.residual) for s, w in zip(spans, white, strict=True)])
    slopes = np.concatenate([s.across(w.jacobian) for s, w in zip(spans, white, strict=True)])
    calibration, rows = Span(np.vstack([slopes, e.expected])), np.concatenate([left, -e.pulls])
    step, chi2 = calibration.amplitudes(rows), float(np.sum(calibration.across(rows) ** 2))
    points, unknowns = len(left), sum(s.rank for s in spans)
    excess, remains = e.chi2 - points, max(chi2 - (points - unknowns), 0.0)
    H = len(white[0].seen[i])
    missed = [w.residual - w.jacobian @ step for w in white]
    found = [_harmonics(s, rows, H) for s, rows in zip(spans, missed, strict=True)]
    against = [
        w.held_against(i, force, s.across(rows))
        for w, (force, _), s, rows in zip(white, found, spans, missed, strict=True)
    ]
    return MissingForce(
        place=place,
        share=float(np.clip(1.0 - remains / excess, 0.0, 1.0)) if excess > 0.0 else 0.0,
        chi2=chi2,
        left=chi2 / max(points - unknowns, 1),
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
