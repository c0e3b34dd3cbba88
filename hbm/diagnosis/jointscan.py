"""Joints that may not have been modelled, scored by the force that is missing: no steady state is solved for.

At a place the misfit asks for a force, harmonic by harmonic and whatever its law, and with it the motion there is
known. A law makes a force of that motion. Its strength is linear; what shapes it (a gap, a slip at which it slides) is
scanned. What the records then still miss says how well each law at each place would do, and where its fit starts: a
force-state map, fitted by one law after the other.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Protocol

import numpy as np
from scipy.optimize import minimize

from hbm.aft.joint import JointOverPeriod
from hbm.diagnosis.atjoints import HARMONICS, SAMPLES, joints_between, missing_at
from hbm.diagnosis.forcedrecords import WhiteRecord, read_by
from hbm.diagnosis.freeforces import EndsOfRig
from hbm.diagnosis.jointplaces import JointPlace
from hbm.diagnosis.places import Complex
from hbm.diagnosis.projection import Span
from hbm.fourier import Array, sampled
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation
from hbm.outputerror.records import Record
from hbm.sensitivity.jointforces import Ends, pushed
from models.causes.addedjoint import AddedJoint, ends_of
from models.jointed import JointedRig
from models.joints.joint import GROUND

MOST, APART = 3, 0.5
"""Starts of a candidate, at most, whose gain is at least this share of its best."""

FOREMOST, CLOSELY, ASIDE = 6, 20, 0.25
"""Candidates whose shape is found closely; shapes that are tried about the best one, for each of its numbers; and the
first stride, in logarithms."""

TELLING = 1e-9
"""A column of which calibration leaves less than this share of the largest says nothing."""


@dataclass(frozen=True)
class Scanned:
    """A candidate: the fall of chi2 by it, in all and signed by its first strength, its direction, and its starts.

    `reach` is the largest motion where it acts [m], `deviation` what the base misses, rms, in standard deviations;
    `shape` is what shapes the first start, in units of the motion.
    """

    cause: AddedJoint
    drop: float
    z: float
    signature: Array
    starts: tuple[dict[str, float], ...]
    reach: float = 0.0
    deviation: float = 0.0
    shape: Mapping[str, float] = field(default_factory=dict)


def scan(base: Evaluation, few: Campaign, causes: Sequence[AddedJoint], *, large: bool = False) -> Iterator[Scanned]:
    """Score candidates on some records of a base.

    Parameters
    ----------
    base : Evaluation
        The model that misses the records.
    few : Campaign
        Those records, simulated as in the base.
    causes : sequence of AddedJoint
    large : bool
        Whether the base misses so much that what is linear in that does not hold: then the linear structure takes its
        place, with free forces at its joints, if a force at one place explains nearly all.
    """
    rig = few.numerics.working.rig(base.model.rig(base.x))
    records = [r for r in few.data.records if r.number in base.found]
    if not isinstance(rig, JointedRig) or not causes or not records:
        return
    ends = tried_ends(rig, causes)
    free = EndsOfRig(rig, few.data, ends) if large else None
    by_joints = free is not None and free.told_by_joints(base.white.chi2 / len(base.white))
    told = free if free is not None and not by_joints and free.told else None
    pushed_there = [
        _pushed(base, few, rig, ends, r) if told is None else _linear(base, r, *told.of_record(r)) for r in records
    ]
    own = dict(_at_joints(base, records, rig, few, ends, causes)) if by_joints else {}
    share = 1.0 if told is None else _share(base, records, pushed_there)
    for found in scanned(base, pushed_there, ends, causes, exact=told is not None):
        yield own.get(found.cause, _promising(found, share))


def _at_joints(
    base: Evaluation,
    records: Sequence[Record],
    rig: JointedRig,
    few: Campaign,
    ends: Sequence[Ends],
    causes: Sequence[AddedJoint],
) -> Iterator[tuple[AddedJoint, Scanned]]:
    """Candidates where the rig has a joint already, beside its law: at any size of the misfit."""
    for i, joint, port, way in joints_between(rig, ends):
        beside = [_linear(base, r, *missing_at(rig, few.data, r, joint, port), way) for r in records]
        share = _share(base, records, beside)
        there = [c for c in causes if c.way(ends[i]) and not c.beside(rig)]
        for found in scanned(base, beside, [ends[i]], there, exact=True):
            yield found.cause, _promising(found, share)


def _share(base: Evaluation, records: Sequence[Record], beside: Sequence["PushedRecord"]) -> float:
    """What the base misses of some records over what they miss beside free forces at joints, which take their part."""
    here = np.isin(base.white.record, [r.number for r in records])
    missed = sum(float(r.residual @ r.residual) for r in beside)
    return float(np.sum(base.white.residual[here] ** 2)) / max(missed, np.finfo(float).tiny)


def _promising(found: Scanned, share: float) -> Scanned:
    """The same as a share of what the base leaves, to be compared with what other causes promise of that."""
    return replace(found, drop=share * found.drop, z=float(np.sqrt(share)) * found.z)


def tried_ends(rig: JointedRig, causes: Sequence[AddedJoint]) -> list[Ends]:
    """Places of a rig where some causes act."""
    named = [pair for pair in ends_of(rig) if any(c.way(pair) for c in causes)]
    return list(dict.fromkeys([*named, *((place, GROUND) for c in causes for place in c.beside(rig))]))


def scanned(
    base: Evaluation,
    records: Sequence["PushedRecord"],
    ends: Sequence[Ends],
    causes: Sequence[AddedJoint],
    *,
    exact: bool = False,
) -> Iterator[Scanned]:
    """Score candidates on records with forces at places; where these are exact, the best shapes are found closely."""
    rig = base.model.nominal
    assert isinstance(rig, JointedRig)
    places = {pair: _Place(base, records, i) for i, pair in enumerate(ends)}
    offered = [
        (place, c, way, [places[other, GROUND] for other in c.beside(rig)])
        for pair, place in places.items()
        for c in causes
        if (way := c.way(pair))
    ]
    found = [place.scanned(c, way, beside) for place, c, way, beside in offered]
    least = sorted((f.drop for f in found), reverse=True)[:FOREMOST][-1:] if exact else []
    for f, (place, c, way, beside) in zip(found, offered, strict=True):
        yield place.closer(f, c, way, beside) if least and f.drop >= least[0] else f


class Columns(Protocol):
    """What a record reads, in standard deviations, of cosines, then sines of harmonics 1..H of a force."""

    def __matmul__(self, force: Array, /) -> Array:
        """Readings (m,) of a force (2 H,)."""
        ...


@dataclass(frozen=True, eq=False)
class PushedRecord:
    """A record with forces at p places: what reads them, and the motion there with those that the misfit asks for.

    Attributes
    ----------
    residual : (m,) array
        Misfit of the base, in standard deviations.
    jacobian : (m, n) array
        Derivatives to its coordinates.
    columns : sequence of Columns, (p,)
    motion : (p, H) complex array
        Amplitudes.
    largest : (p,) array
        Motion [m].
    omega : float
        Frequency of the motion [rad/s].
    fundamental : float
        Of the record [rad/s].
    """

    residual: Array
    jacobian: Array
    columns: Sequence[Columns]
    motion: Complex
    largest: Array
    omega: float
    fundamental: float

    def read(self, i: int, force: Complex) -> Array:
        """Readings (m,) of a force at a place, in standard deviations, by its amplitudes from the fundamental on."""
        amplitudes = force[: self.motion.shape[1]]
        return np.asarray(self.columns[i] @ np.concatenate([amplitudes.real, -amplitudes.imag]))


def _linear(
    base: Evaluation, record: Record, missed: Array, columns: Array, motion: Complex, way: float = 1.0
) -> PushedRecord:
    """A record beside the linear structure, at any size of its misfit; places are turned round where `way` is -1."""
    listed, omega = record.listed, 2 * np.pi * record.hz
    residual, largest = missed[listed], np.abs(motion).sum(axis=1)
    by_place = list(np.moveaxis(way * columns[listed], 1, 0))
    return PushedRecord(residual, np.zeros((len(residual), len(base.x))), by_place, way * motion, largest, omega, omega)


def _pushed(base: Evaluation, few: Campaign, rig: JointedRig, ends: Sequence[Ends], record: Record) -> PushedRecord:
    here, solution, H = record.rig(rig), base.found[record.number].solution, few.data.H
    assert isinstance(here, JointedRig)
    found = pushed(here, solution, ends, H)
    places = [JointPlace(here, pair) for pair in ends]
    white = WhiteRecord(record, base, few, places, read_by(few.data, solution, found.channels))
    everywhere, own = Span(np.hstack(white.columns)), 2 * H
    motion = np.empty((len(ends), H), dtype=complex)
    for i, (columns, seen) in enumerate(zip(white.columns, white.seen, strict=True)):
        span = Span(columns)
        forces = everywhere.damped(span.across(white.residual))
        forces[i * own : (i + 1) * own] += np.nan_to_num(span.amplitudes(white.residual))
        moved = found.moved[i].reshape(len(solution.basis.k), -1) @ forces
        motion[i] = seen + solution.basis.complex(moved)[1 : H + 1]
    omega = 2 * np.pi * record.hz
    largest = np.abs(motion).sum(axis=1)
    return PushedRecord(white.residual, white.jacobian, white.columns, motion, largest, omega, omega)


class _Place:
    """The records as forces at one place may explain them.

    Their misfit is counted in standard deviations that are as large as it is: in those of the noise, calibrated numbers
    many tolerances off would explain anything, and no force would be missing.
    """

    def __init__(self, base: Evaluation, records: Sequence[PushedRecord], i: int) -> None:
        self.records, self.i, self.base = records, i, base
        missed = np.concatenate([r.residual for r in records])
        self.points, self.deviation = len(missed), max(float(np.sqrt(np.mean(missed**2))), 1.0)
        self.calibration = Span(np.vstack([np.vstack([r.jacobian for r in records]) / self.deviation, base.expected]))
        self.residual = self.calibration.across(np.concatenate([missed / self.deviation, -base.pulls]))
        loudest = max(records, key=lambda r: float(r.largest[i]))
        self.reach, self.omega = float(loudest.largest[i]), loudest.omega
        self.basis = sampled(max(HARMONICS, *(r.motion.shape[1] for r in records)), SAMPLES)
        self._moved = [self._motion(r) for r in records]

    def _motion(self, r: "PushedRecord") -> tuple[Array, Array]:
        """Motion here in a record: its coefficients (2H+1,), and what a law is shown of it at the samples (N_t, 3)."""
        u = self.basis.real(np.pad(r.motion[self.i], (1, self.basis.H - r.motion.shape[1])))
        signals = np.column_stack([u, r.fundamental * self.basis.derivative(u), np.zeros_like(u)])
        return u, self.basis.samples(signals)

    def scanned(self, cause: AddedJoint, way: float, beside: "Sequence[_Place]") -> Scanned:
        """A candidate here, which sees the motion with a sign, and acts at other places too."""
        tried = [(shape, self._tried(cause, way, shape, beside)) for shape in _shapes(cause)]
        shapes, best = zip(*sorted(tried, key=lambda t: -t[1].drop), strict=True)
        starts = tuple(t.start for t in best[:MOST] if t.start and t.drop >= APART * best[0].drop)
        first = best[0]
        return Scanned(cause, first.drop, first.z, first.signature, starts, self.reach, self.deviation, shapes[0])

    def closer(self, found: Scanned, cause: AddedJoint, way: float, beside: "Sequence[_Place]") -> Scanned:
        """The same with the shape that explains most, from the best that was tried."""
        names, values = list(found.shape), np.array(list(found.shape.values()))
        if not names or not values.all():
            return found

        def shape(x: Array) -> dict[str, float]:
            return dict(zip(names, (np.sign(values) * np.exp(x)).tolist(), strict=True))

        def left(x: Array) -> float:
            return -self._tried(cause, way, shape(x), beside).drop

        start = np.log(np.abs(values))
        corners = np.vstack([start, start + ASIDE * np.eye(len(names))])
        options = {"initial_simplex": corners, "maxfev": CLOSELY * len(names), "xatol": ASIDE / 100.0, "fatol": 1.0}
        there = self._tried(cause, way, shape(minimize(left, start, method="Nelder-Mead", options=options).x), beside)
        if there.drop <= found.drop:
            return found
        starts = (there.start, *found.starts)
        return replace(found, drop=there.drop, z=there.z, signature=there.signature, starts=starts)

    def _tried(self, cause: AddedJoint, way: float, shape: dict[str, float], beside: "Sequence[_Place]") -> "_Tried":
        strengths = [n for n in cause.numbers if not n.shapes]
        of = {n.name: n.of(1.0, self.reach, self.omega) for n in cause.numbers} if self.reach > 0.0 else {}
        scaled = [n.name for n in cause.numbers if n.powers[0]]
        columns, none = [], _Tried(0.0, 0.0, np.zeros(self.points), {})
        for one in strengths if of else ():
            values = {n.key: (shape[n.name] if n.shapes else float(n is one)) * of[n.name] for n in cause.numbers}
            try:
                columns.append(
                    sum((place._felt(cause, 1.0, values) for place in beside), self._felt(cause, way, values))
                )
            except ValueError:  # no law is of that size: a model that is far off moves there by kilometres
                return none
        if not columns:
            return none
        v = np.vstack([np.array(columns).T / self.deviation, np.zeros((len(self.base.x), len(columns)))])
        whole = np.linalg.norm(v, axis=0)
        v = self.calibration.across(v)
        if not np.isfinite(v).all() or np.any(np.linalg.norm(v, axis=0) <= TELLING * whole.max()):
            return none
        size = np.linalg.lstsq(v, self.residual, rcond=None)[0]
        if any(x <= 0.0 and not n.signed for n, x in zip(strengths, size, strict=True)):
            return none
        drop = self.deviation**2 * float(self.residual @ (v @ size))
        by = dict(zip((n.name for n in strengths), size.tolist(), strict=True))
        start = {
            n.name: (by[n.name] if n.name in by else shape[n.name] * (size[0] if n.name in scaled else 1.0))
            * of[n.name]
            for n in cause.numbers
        }
        along = (v @ size)[: self.points]
        return _Tried(drop, float(np.sqrt(drop) * np.sign(size[0])), along / (np.linalg.norm(along) or 1.0), start)

    def _felt(self, cause: AddedJoint, way: float, values: dict[str, float]) -> Array:
        """What the records read of the force of a law, in standard deviations."""
        law = JointOverPeriod(cause.law(values), self.basis, loaded=False)
        samples = [
            law.forces_of_samples(way * shown, r.fundamental)[0][:, 0].copy()
            for r, (_, shown) in zip(self.records, self._moved, strict=True)
        ]
        motion = np.column_stack([u for u, _ in self._moved])
        speeds = np.array([r.fundamental for r in self.records])
        accelerated = self.basis.derivative(self.basis.derivative(motion)) * speeds**2
        beside = way * (cause.held(values) * motion - cause.inertia(values) * accelerated)
        forces = self.basis.complex(self.basis.coefficients(np.column_stack(samples)) + beside).T
        of_record = zip(self.records, forces, strict=True)
        return way * np.concatenate([r.read(self.i, force[1:]) for r, force in of_record])


@dataclass(frozen=True)
class _Tried:
    """A candidate of one shape, as :class:`Scanned`."""

    drop: float
    z: float
    signature: Array
    start: dict[str, float]


def _shapes(cause: AddedJoint) -> list[dict[str, float]]:
    """Values of what shapes a cause, in units of the motion."""
    shaping = [n for n in cause.numbers if n.shapes]
    return [
        dict(zip((n.name for n in shaping), values, strict=True)) for values in product(*(n.shapes for n in shaping))
    ]
