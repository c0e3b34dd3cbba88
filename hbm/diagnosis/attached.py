"""Where something may be attached to the beam or stand beside it, and how large it is, from the force it makes.

What is attached at a place makes a force there that is its dynamic stiffness times the deflection; a stop pushes back
what is beyond its gap. Places along the beam and whatever else shapes the force (the frequency of a resonator, the gap)
are scanned, its size is linear: starts of fits. Where the contact follows its linearised law the force is seen best;
beside a contact force that is free all that is left of a rig is linear, so that it holds however large the misfit.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hbm.diagnosis.atjoints import SAMPLES
from hbm.diagnosis.discrepancy import LEFT_OVER
from hbm.diagnosis.forcedrecords import WhiteRecord, read_by
from hbm.diagnosis.places import Complex, Place, all_at_once, contact_of, points_of
from hbm.diagnosis.projection import Span
from hbm.fourier import Array, sampled
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation
from hbm.sensitivity.derivatives import disturbed
from models.attachments import LISTS, PointMass, PointSpring, Resonator
from models.causes.addedjoint import AddedJoint
from models.causes.cause import Cause, Unknown
from models.causes.structure import AddedSpring
from models.elements import Element, Reading
from models.jointed import JointedRig
from models.rig import Rig

PLACES, CLOSE = 12, 3
"""Positions along the beam, equally far apart; and more between the best and each of its neighbours."""

STEP, BEYOND = 0.003, 1.5
"""Relative step of what shapes a stiffness, and how far it is scanned beyond its least and its largest start."""

GAPS = (0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)
"""Gaps that are scanned, in units of the largest deflection at a place."""

MOST, HELPS = 4, 0.3
"""Starts of a cause by each scan, at most; and the least fall of chi2 of one beside that of the best."""

APART, TUNED = 0.1, 0.01
"""How far apart places of starts are, in lengths of the beam; and any other shape, relatively: of those only the best
place counts."""

CHANCE = 30.0
"""Fall of chi2 that a scan brings by chance, nearly."""

Start = dict[str, float]
Attachment = PointMass | PointSpring | Resonator


Acting = Callable[[Complex], tuple[list[Start], Complex]]
"""Shapes of a thing of unit size, and its force (s, r, H) of each on deflections of r records at a place, (r, H+1)."""


@dataclass(frozen=True)
class _Attached:
    """One more thing attached, or beside the beam; a tuned one is told by a number that all places share."""

    size: Unknown
    acting: Acting
    tuned: bool = False


def attached_starts(base: Evaluation, campaign: Campaign, causes: Sequence[Cause]) -> dict[str, tuple[Start, ...]]:
    """Where the fits of causes may start that attach something to a place on a beam.

    Parameters
    ----------
    base : Evaluation
        The model that misses the records.
    campaign : Campaign
        Records, few or all.
    causes : sequence of Cause

    Returns
    -------
    dict of str to tuple of dict
        Values of their unknowns by the labels of causes. Empty where there are too few sensors to tell a force.
    """
    rig = campaign.numerics.working.rig(base.model.rig(base.x))
    if isinstance(rig, JointedRig) or rig.beam is None:
        return {}
    numbers = [r.number for r in campaign.data.records if r.number in base.found]
    few = campaign.of(numbers)
    omega = 2 * np.pi * np.array([[r.hz] for r in few.data.records]) * np.arange(1, few.data.H + 1)
    each = {c.label: _attached(c, rig, omega) or _with_gap(c, rig) for c in causes}
    found = {label: attached for label, attached in each.items() if attached is not None}
    if not found or few.points <= 2 * few.data.H * len(numbers):
        return {}
    along = rig.beam.length * np.arange(1, PLACES + 1) / (PLACES + 1)
    beside = few.points > (1.0 + LEFT_OVER) * 4 * few.data.H * len(numbers)
    records = _records(base, few, *points_of(rig, rig.beam, along))
    scans = [_Scan(base, records, free) for free in ((False, True) if beside else (False,))]
    gains = {label: [scan.gains(a) for scan in scans] for label, a in found.items()}
    best = max((by_scan[-1].fall for by_scan in gains.values()), key=np.max)
    near = along[int(best.max(axis=1).argmax())] + along[0] * np.arange(-CLOSE, CLOSE + 1) / (CLOSE + 1)
    closer = _Scan(base, _records(base, few, *points_of(rig, rig.beam, near)), beside)
    return {
        label: (
            *(start for gain in gains[label] for start in _best(a, gain, along)),
            *_best(a, closer.gains(a), near, most=1),
        )
        for label, a in found.items()
    }


def same_force(found: Evaluation, i: int, cause: Cause, campaign: Campaign) -> Start:
    """Size at which a cause attaches what pushes as what the cause `i` of a model attaches does, by name.

    At the frequencies of the records: a resonator far above its own frequency pushes as a spring. Nothing where either
    attaches nothing, or is shaped by what the other has not.
    """
    rig: Any = found.model.nominal
    values, there = found.model.values(found.x, i), found.model.causes[i]
    if isinstance(there, AddedJoint | AddedSpring):
        return there.plainly(rig, values)
    if isinstance(rig, JointedRig) or not (unknowns := cause.unknowns(rig)):
        return {}
    size, *shapes = unknowns
    if any(u.name not in values for u in shapes):
        return {}
    own = _added(there, rig, values)
    one = _added(cause, rig, {size.name: 1.0, **{u.name: values[u.name] for u in shapes}})
    if len(own) != 1 or len(one) != 1:
        return {}
    omega = 2 * np.pi * np.array([r.hz for r in campaign.data.records])
    whole, unit = (attached[0].force(omega).real for attached in (own, one))
    return {size.name: float(unit @ whole / (unit @ unit))}


def _records(base: Evaluation, campaign: Campaign, probed: Rig, points: Sequence[Place]) -> list["_Record"]:
    places, H, records = [contact_of(probed), *points], campaign.data.H, []
    for record in campaign.data.records:
        here, solution = record.rig(probed), base.found[record.number].solution
        assert isinstance(here, Rig)
        change = disturbed(here, solution, all_at_once(places, solution, H))
        white = WhiteRecord(record, base, campaign, places, read_by(campaign.data, solution, change))
        moved = np.stack([solution.basis.complex(change[p.name])[1 : H + 1] for p in points])
        mean = [float(p.seen(solution)[0].real) for p in points]
        records.append(_Record(white, np.stack(np.split(moved, len(places), axis=2)), mean))
    return records


def _attached(cause: Cause, rig: Rig, omega: Array) -> _Attached | None:
    """The one thing that a cause attaches at a place; None if it attaches nothing, or does more."""
    size, *shapes = cause.unknowns(rig) or (None,)
    others = [u for u in shapes if u.name != "position"]
    if size is None or len(shapes) != len(others) + 1 or len(others) > 1 or not all(u.shapes for u in shapes):
        return None
    first: Start = {size.name: size.starts[-1], **{u.name: u.starts[0] for u in shapes}}
    if any(min(u.starts) <= 0.0 for u in others) or len(_added(cause, rig, first)) != 1:
        return None
    scanned: list[Start] = [{u.name: float(value) for u in others} for value in _values(others)]
    stiffness = np.array([_added(cause, rig, first | shape)[0].force(omega) / size.starts[-1] for shape in scanned])
    return _Attached(size, lambda moved: (scanned, stiffness * moved[:, 1:]), bool(others))


def _with_gap(cause: Cause, rig: Rig) -> _Attached | None:
    """The one element that a cause puts beside the beam at a place, with a gap; None if it does anything else."""
    size, *shapes = cause.unknowns(rig) or (None,)
    gaps = [u for u in shapes if u.name != "position" and u.unit == "m"]
    if size is None or len(gaps) != 1 or len(shapes) != 2:
        return None
    first: Start = {size.name: 1.0, **{u.name: u.starts[0] for u in shapes}}
    if len(new := _elements(cause, rig, first)) != 1 or new[0].reads is not Reading.POINT:
        return None

    def acting(moved: Complex) -> tuple[list[Start], Complex]:
        basis = sampled(moved.shape[1] - 1, SAMPLES)
        y = basis.samples(basis.real(moved.T))
        scanned: list[Start] = [{gaps[0].name: share * float(y.max())} for share in GAPS]
        pushed = [_elements(cause, rig, first | shape)[0].force(y, np.zeros_like(y), 1.0) for shape in scanned]
        return scanned, np.stack([basis.complex(basis.coefficients(np.asarray(f)))[1:].T for f in pushed])

    return _Attached(size, acting)


def _elements(cause: Cause, rig: Rig, values: Start) -> Sequence[Element]:
    """Elements of a cause that the rig has not."""
    after: Sequence[Element] = cause.extend(rig, values).elements
    return after[len(rig.elements) :]


def _added(cause: Cause, rig: Rig, values: Start) -> list[Attachment]:
    """Attachments of a cause at places that the rig has not."""
    before, after = rig.attachments, cause.extend(rig, values).attachments
    return [entry for kind in LISTS for entry in getattr(after, kind)[len(getattr(before, kind)) :]]


def _values(others: Sequence[Unknown]) -> Array:
    """Values of the one unknown that shapes a stiffness beside its place; one without meaning where there is none."""
    if not others:
        return np.zeros(1)
    low, high = min(others[0].starts) / BEYOND, max(others[0].starts) * BEYOND
    return np.asarray(np.geomspace(low, high, int(np.log(high / low) / STEP)))


@dataclass(frozen=True, eq=False)
class _Record:
    """A record with forces at the contact and at p points: what they are read by, and the deflections they make.

    Attributes
    ----------
    white : WhiteRecord
    moved : (1+p, p, H, 2H) complex array
        Amplitudes at the points by cosines, then sines of the force at the contact and at each point.
    mean : sequence of float, (p,)
        Mean deflection at the points [m].
    """

    white: WhiteRecord
    moved: Complex
    mean: Sequence[float]

    def free(self, beside: bool) -> Array:
        """Columns of a contact force that is free, none where it follows the law."""
        contact = self.white.columns[0]
        return contact if beside else contact[:, :0]

    def deflection(self, point: int, beside: bool) -> Complex:
        """Mean and amplitudes (H+1,) at a point, under the forces there and at the contact that the misfit asks for."""
        own, free = self.white.columns[1 + point], self.free(beside)
        force = Span(np.hstack([own, free])).amplitudes(self.white.residual)
        here, contact = self.moved[1 + point, point], self.moved[0, point, :, : free.shape[1]]
        moved = here @ force[: own.shape[1]] + contact @ force[own.shape[1] :]
        return np.concatenate([[self.mean[point]], self.white.seen[1 + point] + moved])


@dataclass(frozen=True, eq=False)
class _Gains:
    """Of one thing at p points in s shapes: the shapes, the fall of chi2 and the size that brings it, (p, s)."""

    fall: Array
    size: Array
    shapes: Sequence[Sequence[Start]]


class _Scan:
    """Forces at points, beside one at the contact that is free or follows the law."""

    def __init__(self, base: Evaluation, records: Sequence[_Record], beside: bool) -> None:
        points = range(len(records[0].moved) - 1)
        each = [(Span(r.free(beside)), r) for r in records]
        self.columns = [[free.across(r.white.columns[1 + i]) for free, r in each] for i in points]
        self.deflection = [np.stack([r.deflection(i, beside) for r in records]) for i in points]
        self.numbers = len(base.x)
        self.calibration = Span(np.vstack([*(free.across(r.white.jacobian) for free, r in each), base.expected]))
        rows = [*(free.across(r.white.residual) for free, r in each), -base.pulls]
        self.residual = self.calibration.across(np.concatenate(rows))

    def gains(self, attached: _Attached) -> _Gains:
        """What a thing does at each point."""
        found = [self._at(i, attached) for i in range(len(self.columns))]
        fall, size, shapes = zip(*found, strict=True)
        return _Gains(np.array(fall), np.array(size), shapes)

    def _at(self, point: int, attached: _Attached) -> tuple[Array, Array, list[Start]]:
        shapes, forces = attached.acting(self.deflection[point])
        rows = [
            columns @ np.hstack([force.real, -force.imag]).T
            for columns, force in zip(self.columns[point], forces.swapaxes(0, 1), strict=True)
        ]
        v = self.calibration.across(np.vstack([*rows, np.zeros((self.numbers, len(shapes)))]))
        along, square = v.T @ self.residual, np.maximum(np.sum(v**2, axis=0), 1e-300)
        return np.where(along > 0.0, along**2 / square, 0.0), along / square, shapes


def _best(attached: _Attached, gains: _Gains, positions: Array, most: int = MOST) -> Iterator[Start]:
    """Starts of most gain, apart from each other."""
    span = positions[-1] + positions[0]
    left, least = gains.fall.copy(), max(CHANCE, HELPS * float(gains.fall.max()))
    for _ in range(most):
        p, s = divmod(int(left.argmax()), left.shape[1])
        if left[p, s] < least:
            return
        known = float(np.clip(gains.size[p, s], attached.size.lower, attached.size.upper))
        yield {attached.size.name: known, **gains.shapes[p][s], "position": float(positions[p])}
        if attached.tuned:
            others = np.log([list(shape.values()) for shape in gains.shapes[p]])
            left[:, np.abs(others - others[s])[:, 0] < TUNED] = 0.0
        else:
            left[np.abs(positions - positions[p]) < APART * span] = 0.0
