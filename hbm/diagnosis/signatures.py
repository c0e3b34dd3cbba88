"""Signatures of causes: how the records move with their first small effects, calibrated numbers held harmless.

Differentiated once are a model and all its numbers; causes that change different numbers go into its rig together.
"""

from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import chain, product
from typing import Any

import numpy as np
import numpy.typing as npt

from hbm.diagnosis.projection import Span
from hbm.fourier import Array
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation, evaluate
from hbm.outputerror.model import Free, Model
from hbm.outputerror.nominal import nominal_scalars
from hbm.outputerror.simulated import FAILURES
from hbm.parallel import each
from models.causes.cause import Cause, Unknown
from models.causes.parameter import WrongParameter
from models.jointed import AnyRig, JointedRig

Mask = npt.NDArray[np.bool_]

MOST_PORTS, MOST_RESONATORS = 8, 6
"""Joints of candidates that are put into one rig have so many ports, and these so many resonators, at most: its system
grows with them."""

VISIBLE = 0.05
"""Beside the first number of a cause those count whose range moves the records by this share of what its range does."""

SEEN = 1e-6
"""A signature of which calibration leaves less than this share is none."""


@dataclass(frozen=True, eq=False)
class Score:
    """The fall of chi2 that a candidate promises.

    Attributes
    ----------
    cause : Cause
    drop : float
        Predicted fall of chi2 on the records looked at.
    z : float
        The same in standard deviations, signed like the change of the first parameter away from no effect.
    signature : (m,) array
        Unit vector in standard deviations; zero where the cause is not seen.
    start : dict of str to float
        Shape of the best one.
    instead : float
        Share of what calibrated numbers have moved the records by that the cause does in their place.
    gain : float
        Predicted fall of BIC.
    starts : tuple of dict of str to float
        Where fits start, if that was found from the force that is missing.
    """

    cause: Cause
    drop: float
    z: float
    signature: Array
    start: dict[str, float]
    instead: float = 0.0
    gain: float = 0.0
    starts: tuple[dict[str, float], ...] = ()


def starting(model: Model, base: Evaluation, start: dict[str, float]) -> Array:
    """Coordinates with the calibrated numbers (and earlier causes) of another model and the last cause at a start."""
    last = len(model.causes) - 1
    return model.at(base.values | {(last, name): value for name, value in start.items()})


def scores(base: Evaluation, few: Campaign, sized: Sequence[Cause]) -> list[Score]:
    """Scores on few records of causes that have a size, of every shape; none without derivatives of the model."""
    wrong = [c for c in sized if isinstance(c, WrongParameter)]
    others = [c for c in sized if not isinstance(c, WrongParameter)]
    known = _known(base, few, wrong)
    if known is None:
        return []
    groups = _groups(known.rig, others)
    found = each(few.executor, partial(_of_group, known), *zip(*groups, strict=True)) if groups else []
    return [*(known.of_number(c) for c in wrong), *chain.from_iterable(found)]


@dataclass(frozen=True)
class _Entry:
    """A candidate with one of its shapes, and the place of its cause in the model of its group."""

    cause: Cause
    start: dict[str, float]
    place: int


def _groups(bare: AnyRig, candidates: Sequence[Cause]) -> list[tuple[Model, list[_Entry]]]:
    """Candidates with their shapes, those together that change different numbers of the rig."""
    base = Model(bare, {})
    kinds: dict[tuple[Any, ...], list[Cause]] = {}
    for cause in candidates:
        kinds.setdefault(_neutral(base.extended_by(cause)).kind, []).append(cause)
    return [group for causes in kinds.values() for group in _grouped(base, causes)]


def _grouped(base: Model, candidates: Sequence[Cause]) -> list[tuple[Model, list[_Entry]]]:
    """The same for those of one kind: resonators may have no steady state, elements and transients are slow."""
    bare = base.nominal
    alone: list[tuple[Model, list[_Entry]]] = []
    together, rig, taken, entries = base, bare, set[str](), list[_Entry]()
    for cause in candidates:
        for start in _shapes(cause.unknowns(bare)):
            keys, more = {u.key for u in cause.unknowns(rig)}, cause.extend(rig, start)
            if _meets(rig, more, keys & taken):
                alone.append((base.extended_by(cause), [_Entry(cause, start, 0)]))
                continue
            if more.ports > MOST_PORTS or more.resonators > MOST_RESONATORS:
                alone.append((together, entries))
                together, taken, entries = base, set(), []
                keys, more = {u.key for u in cause.unknowns(bare)}, cause.extend(bare, start)
            entries.append(_Entry(cause, start, len(together.causes)))
            together, rig, taken = together.extended_by(cause), more, taken | keys
    return [*alone, (together, entries)] if entries else alone


def _neutral(model: Model) -> AnyRig:
    return model.rig(model.start)


def _shapes(unknowns: Sequence[Unknown]) -> list[dict[str, float]]:
    """Starts of a cause, without effect and of every shape."""
    grids = [u.starts if u.shapes else u.starts[:1] for u in unknowns]
    return [dict(zip((u.name for u in unknowns), values, strict=True)) for values in product(*grids)]


def _meets(rig: AnyRig, more: AnyRig, shared: Collection[str]) -> bool:
    """Whether a cause decides or changes numbers that are there, or of what law there is: then it is scored alone."""
    if shared or rig.laws != more.laws[: len(rig.laws)]:
        return True
    before, after = nominal_scalars(rig), nominal_scalars(more)
    return any(after.get(k) != v for k, v in before.items())


@dataclass(frozen=True, eq=False)
class _Known:
    """A calibrated model on few records, derivatives to all its numbers beside it.

    Attributes
    ----------
    few : Campaign
    here : Evaluation
        With numbers free that may be wrong.
    calibrated : (n,) array of bool
        Which coordinates calibration moves, and those of earlier causes: what they can do is no sign of another one.
    residual : (m,) array
        What the model misses, exactly.
    spans : dict of bytes to Span
        What calibration can do, remembered: most causes free none of its numbers.
    """

    few: Campaign
    here: Evaluation
    calibrated: Mask
    residual: Array
    spans: dict[bytes, Span] = field(default_factory=dict)

    @cached_property
    def found(self) -> Mask:
        """Coefficients of records that have derivatives, (m,)."""
        return self.rows(self.here)

    @cached_property
    def deviation(self) -> float:
        """What the model misses of a rig whose modes were identified, rms, in standard deviations; at least 1."""
        return max(float(np.sqrt(np.mean(self.residual**2))), 1.0) if isinstance(self.rig, JointedRig) else 1.0

    @property
    def rig(self) -> AnyRig:
        """The calibrated rig."""
        return self.here.model.rig(self.here.x)

    @cached_property
    def moved(self) -> Array:
        """What the calibrated numbers have moved the coefficients found by, to first order."""
        std = np.array([f.std for f in self.here.model.free])
        known = np.isfinite(std)
        return np.asarray(self.here.white.jacobian[:, known] @ (self.here.pulls[known] * std[known]))

    def rows(self, e: Evaluation) -> Mask:
        """Coefficients of the records of an evaluation, (m,)."""
        return np.repeat(np.isin(self.few.numbers, list(e.found)), [int(r.listed.sum()) for r in self.few.data.records])

    def of_number(self, cause: WrongParameter) -> Score:
        """Score of a number that may be wrong: then it is not held to its tolerance."""
        e, free = self.here, self.here.model.free
        own = np.array([f.name == cause.key and f.cause < 0 for f in free])
        if not own.any():  # another cause decides it
            return Score(cause, 0.0, 0.0, np.zeros(len(self.residual)), {})
        strength = cause.unknowns(e.model.nominal)[0]
        mine = [f for f, m in zip(free, own, strict=True) if m]
        relief = self.deviation**2 * float(np.sum(e.pulls[own] ** 2))
        score = self._scored(cause, {}, strength, mine, e.white.jacobian[:, own], own, self.found)
        return replace(score, drop=score.drop + relief) if score.drop else score

    def of_cause(self, e: Evaluation, entry: _Entry) -> Score:
        """Score of a cause in the model of its group."""
        own = np.array([f.cause == entry.place for f in e.model.free])
        mine = [f for f in e.model.free if f.cause == entry.place]
        unknowns = e.model.unknowns[entry.place]
        decided = {u.key for u in unknowns}
        taken = np.array([f.name in decided and f.cause < 0 for f in self.here.model.free], dtype=bool)
        return self._scored(entry.cause, entry.start, unknowns[0], mine, e.white.jacobian[:, own], taken, self.rows(e))

    def _scored(
        self,
        cause: Cause,
        start: dict[str, float],
        strength: Unknown,
        free: Sequence[Free],
        columns: Array,
        freed: Mask,
        seen: Mask,
    ) -> Score:
        """Score by derivatives (r, k) of the coefficients `seen`, calibrated numbers that it frees left out.

        Where modes were identified, the misfit is counted in standard deviations as large as it is, as it is for
        joints: in those of the noise, numbers that move by many tolerances would do for what a sensor reads.
        """
        rows, pulls = seen & self.found, np.where(freed, 0.0, self.here.pulls)
        known, wide = self._calibration(rows, freed), self.deviation
        mine = np.vstack([columns[rows[seen]] / wide, np.zeros((len(pulls), len(free)))])
        missed = np.concatenate([self.residual[rows] / wide, -pulls])
        drop, z, shown = _projected(known, missed, mine, free, strength)
        signature = np.zeros(len(self.residual))
        signature[rows] = shown[: int(rows.sum())]
        moved = self.moved[rows[self.found]]
        left = Span(columns[rows[seen]]).across(moved)
        instead = 1.0 - float(left @ left) / max(float(moved @ moved), 1e-300)
        return Score(cause, wide**2 * drop, wide * z, signature, start, instead)

    def _calibration(self, rows: Mask, freed: Mask) -> Span:
        """What calibrated numbers can do to coefficients, and to what is expected of them, without those freed."""
        key = np.append(rows, freed).tobytes()
        if key not in self.spans:
            expected = np.where(freed, 0.0, self.here.expected)
            both = np.vstack([self.here.white.jacobian[rows[self.found]] / self.deviation, expected])
            self.spans[key] = Span(both[:, self.calibrated & ~freed])
        return self.spans[key]


def _known(base: Evaluation, few: Campaign, wrong: Sequence[WrongParameter]) -> _Known | None:
    """A model on few records, numbers free that may be wrong; None where too few have a steady state."""
    model = base.model
    freed = {c.key: np.inf for c in wrong if c.key not in model.calibrated}
    model = Model(model.nominal, {**model.calibrated, **freed}, model.causes)
    try:
        here = evaluate(model, few, starting(model, base, {}), base.solutions)
    except FAILURES:
        return None
    calibrated = np.array([f.cause >= 0 or f.name in base.model.calibrated for f in model.free], dtype=bool)
    residual = base.white.residual[np.isin(base.white.record, few.numbers)]
    found = _Known(replace(few, executor=None), here, calibrated, residual)
    return found if 2 * found.found.sum() >= len(residual) else None


def _of_group(known: _Known, model: Model, entries: Sequence[_Entry]) -> list[Score]:
    """Scores of a group of candidates; nothing is promised where too few records have a steady state."""
    own = {e.place: e.start for e in entries}
    x = np.array([f.of(own.get(f.cause, {}).get(f.name, f.start)) for f in model.free])
    with suppress(*FAILURES):
        e = evaluate(model, known.few, x, known.here.solutions)
        if 2 * known.rows(e).sum() >= len(known.residual):
            return [known.of_cause(e, entry) for entry in entries]
    return [Score(entry.cause, 0.0, 0.0, np.zeros(len(known.residual)), entry.start) for entry in entries]


def _projected(
    calibration: Span, r: Array, mine: Array, free: Sequence[Free], strength: Unknown
) -> tuple[float, float, Array]:
    """Predicted drop, its signed root by the strength alone, and the unit signature of the strength."""
    whole = float(np.linalg.norm(mine[:, 0]))
    r, mine = calibration.across(r), calibration.across(mine)
    first = mine[:, 0]
    size = float(np.linalg.norm(first))
    if size <= SEEN * whole or size == 0.0:
        return 0.0, 0.0, np.zeros(len(r))
    z = float(first @ r) / size
    toward = free[0].of(strength.starts[-1]) - free[0].of(strength.starts[0])
    one_sided = strength.neutral <= strength.lower or strength.neutral >= strength.upper
    if one_sided and z * toward < 0.0:
        return 0.0, 0.0, first / size
    effect = np.linalg.norm(mine, axis=0) * np.array([min(np.ptp(f.bounds), 10.0) for f in free])
    explained = r - Span(mine[:, effect >= VISIBLE * effect[0]]).across(r)
    return float(explained @ explained), z * (np.sign(toward) or 1.0), first / size
