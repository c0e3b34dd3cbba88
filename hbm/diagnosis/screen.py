"""Score test of every candidate cause: what its first small effect would take from chi2, calibration held harmless.

The signature of a cause is the exact derivative of the steady states to its parameters where it has next to no effect,
less what the calibrated numbers can do as well. A number that only shapes an effect (a place, a frequency) is scanned.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, product
from typing import Any

import numpy as np
import numpy.typing as npt

from hbm.diagnosis.jointscan import scan
from hbm.diagnosis.projection import Span
from hbm.fourier import Array
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.fit import Evaluation, evaluate
from hbm.outputerror.model import Model
from hbm.outputerror.nominal import nominal_scalars
from hbm.outputerror.numerics import LEFT, Correction, size
from hbm.outputerror.simulated import FAILURES
from hbm.parallel import each
from models.causes.addedjoint import AddedJoint
from models.causes.cause import Cause, Unknown
from models.causes.parameter import WrongParameter
from models.jointed import AnyRig

Mask = npt.NDArray[np.bool_]

RECORDS, FEW = 20, 8
"""Records whose derivatives make the signatures, spread over levels and frequencies: where the misfit is small, and
where it is too large for the score test to do more than to say who goes first."""

LINEAR = 2.0
"""Mean square misfit up to which it is small."""

PROBED = 6
"""Records on which causes are tried that have no size."""

COARSE = (15, 256)
"""Harmonics and samples for the derivatives; the misfit itself is that of the fine simulation."""

HOPELESS = 0.15
"""Joints whose scan promises a smaller share of the best one's fall of chi2 are left out."""

MOST_PORTS = 8
"""Joints of candidates that are put into one rig have so many ports, at most: its system grows with them."""

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
    gain: float = 0.0
    starts: tuple[dict[str, float], ...] = ()


@dataclass(frozen=True, eq=False)
class Screening:
    """Scores, the best first; how many records they saw; how many candidates, of every shape, were tried."""

    scores: tuple[Score, ...]
    records: int
    tried: int

    def look_alikes(self, label: str, least: float = 0.9) -> dict[str, float]:
        """Candidates whose signature is like that of one, with the cosine: 1 where they look alike whatever their size.

        The most alike first.
        """
        mine = next(s.signature for s in self.scores if s.cause.label == label)
        cosines = {s.cause.label: float(abs(s.signature @ mine)) for s in self.scores if s.cause.label != label}
        return {name: c for name, c in sorted(cosines.items(), key=lambda pair: -pair[1]) if c >= least}


def small(base: Evaluation) -> bool:
    """Whether the misfit of a model is small enough for what is linear in it."""
    return base.white.chi2 < LINEAR * len(base.white)


def spread(campaign: Campaign, number: int) -> list[int]:
    """Numbers of records spread over levels and frequencies, those that slip most among them."""
    order = np.lexsort(([r.hz for r in campaign.data.records], [r.force for r in campaign.data.records]))
    fastest = np.argsort(-campaign.data.speed)[: number // 3]
    even = order[np.unique(np.linspace(0, len(order) - 1, number - len(fastest)).round().astype(int))]
    return [campaign.data.records[i].number for i in sorted({*fastest.tolist(), *even.tolist()})]


def telling(base: Evaluation, campaign: Campaign, number: int) -> list[int]:
    """Numbers of records spread as by :func:`spread`, those that a model misses most among them."""
    found = [n for n in campaign.numbers if n in base.found]
    missed = sorted(found, key=lambda n: -float(np.sum(base.white.residual[base.white.record == n] ** 2)))
    if len(found) <= number:
        return found
    worst = missed[: number // 3]
    rest = campaign.of([n for n in found if n not in worst])
    return sorted([*worst, *spread(rest, number - len(worst))])


def coarse(campaign: Campaign, numbers: Sequence[int], base: Evaluation | None = None) -> Campaign:
    """Some records on few harmonics and samples, for what need not be exact.

    Corrected to a model that is known, on half of the modes: they do for the change from there.
    """
    H, N_t, modes = max(COARSE[0], campaign.data.H + 4), COARSE[1], campaign.numerics.working.modes
    if base is None:
        return campaign.of(numbers).coarsely(H, N_t, modes)
    few = campaign.of(numbers).coarsely(H, N_t, (modes + 1) // 2)
    there = few.solve(base.model.rig(base.x), base.solutions)
    added = {n: campaign.amplitudes(n, base.found[n].solution) - few.amplitudes(n, s) for n, s in there.items()}
    return replace(few, corrections={n: Correction(change, LEFT * size(change)) for n, change in added.items()})


@dataclass(frozen=True)
class _Entry:
    """A candidate with one of its shapes; `place` is its cause in the model of its group, -1 for a nominal value."""

    cause: Cause
    start: dict[str, float]
    place: int


def screen(base: Evaluation, campaign: Campaign, candidates: Sequence[Cause]) -> Screening:
    """Score every candidate over a calibrated model.

    Effects next to none do not meet: candidates are put into one rig together, as many as change different numbers of
    it, and differentiated to all at once.

    Parameters
    ----------
    base : Evaluation
        The calibrated model on the records.
    campaign : Campaign
    candidates : sequence of Cause
    """
    few = coarse(campaign, telling(base, campaign, RECORDS if small(base) else FEW))
    seen = np.isin(base.white.record, few.numbers)
    joints = [c for c in candidates if isinstance(c, AddedJoint)]
    candidates = [c for c in candidates if not isinstance(c, AddedJoint)]
    sized = [c for c in candidates if c.unknowns(base.model.nominal)]
    best = {s.cause.label: s for s in _tried(base, campaign, [c for c in candidates if c not in sized], seen)}
    groups = _groups(base.model, sized)
    tried = len(best) + sum(len(entries) for _, entries in groups)
    task = partial(_scores, base, replace(few, executor=None), base.white.residual[seen])
    for score in chain.from_iterable(each(campaign.executor, task, *zip(*groups, strict=True)) if groups else ()):
        other = best.get(score.cause.label)
        if other is None or score.drop > other.drop or not other.signature.any():
            best[score.cause.label] = score
    for cause in candidates:
        best.setdefault(cause.label, Score(cause, 0.0, 0.0, np.zeros(int(seen.sum())), {}))
    scanned = [s for s in scan(base, campaign.of(few.numbers), joints) if s.starts]
    likely = HOPELESS * max((s.drop for s in scanned), default=0.0)
    best |= {
        s.cause.label: Score(s.cause, s.drop, s.z, s.signature, s.starts[0], starts=s.starts)
        for s in scanned
        if s.drop >= likely
    }
    tried += len(joints)
    price = float(np.log(len(base.white)))  # of a number, in BIC
    scores = [replace(s, gain=s.drop - price * len(s.cause.unknowns(base.model.nominal))) for s in best.values()]
    return Screening(tuple(sorted(scores, key=lambda s: -s.gain)), len(few.numbers), tried)


def _tried(base: Evaluation, campaign: Campaign, causes: Sequence[Cause], seen: Mask) -> Iterator[Score]:
    """Scores of causes without a size: the fall of chi2 on few records."""
    few = coarse(campaign, telling(base, campaign, PROBED))
    plain = few.solve(base.model.rig(base.x), base.solutions) if causes else {}
    before, share = sum(few.chi2(plain).values()), seen.sum() / max(few.points, 1)
    for cause in causes:
        try:
            there = few.solve(base.model.extended_by(cause).rig(base.x), plain)
        except FAILURES:
            there = {}
        drop = (before - sum(few.chi2(there).values())) * share if len(there) == len(plain) else 0.0
        yield Score(cause, max(drop, 0.0), np.sqrt(max(drop, 0.0)), np.zeros(int(seen.sum())), {})


def _shapes(model: Model) -> list[dict[str, float]]:
    """Starts of the last cause of a model, without effect and of every shape."""
    unknowns = model.unknowns[-1]
    grids = [u.starts if u.shapes else u.starts[:1] for u in unknowns]
    return [dict(zip((u.name for u in unknowns), values, strict=True)) for values in product(*grids)]


def _groups(base: Model, candidates: Sequence[Cause]) -> list[tuple[Model, list[_Entry]]]:
    """Candidates with their shapes, those together that change different numbers of the rig."""
    wrong = [c for c in candidates if isinstance(c, WrongParameter)]
    calibrated = dict(base.calibrated)
    taken = {u.key for unknowns in base.unknowns for u in unknowns}
    freed = {c.key: np.inf for c in wrong if c.key not in calibrated and c.key not in taken}
    groups = []
    if wrong:
        own = [_Entry(c, {}, -1) for c in wrong if c.key not in taken]
        groups.append((Model(base.nominal, {**calibrated, **freed}, base.causes), own))
    rest = [c for c in candidates if not isinstance(c, WrongParameter)]
    kinds: dict[tuple[Any, ...], list[Cause]] = {}
    for cause in rest:
        kinds.setdefault(_kind(base.extended_by(cause)), []).append(cause)
    return [*groups, *(group for causes in kinds.values() for group in _grouped(base, causes))]


def _kind(model: Model) -> tuple[Any, ...]:
    """Resonators, which may have no steady state, elements, which are slow, and transients: alone of their kind."""
    return _neutral(model).kind


def _grouped(base: Model, candidates: Sequence[Cause]) -> list[tuple[Model, list[_Entry]]]:
    together, rig = base, _neutral(base)
    alone: list[tuple[Model, list[_Entry]]] = []
    entries: list[_Entry] = []
    for cause in candidates:
        for start in _shapes(base.extended_by(cause)):
            more = cause.extend(rig, start)
            if _meets(together, rig, more, cause):
                alone.append((base.extended_by(cause), [_Entry(cause, start, len(base.causes))]))
                continue
            if more.ports > MOST_PORTS:
                alone.append((together, entries))
                together, entries, more = base, [], cause.extend(_neutral(base), start)
            entries.append(_Entry(cause, start, len(together.causes)))
            together, rig = together.extended_by(cause), more
    return [*alone, (together, entries)] if entries else alone


def _neutral(model: Model) -> AnyRig:
    return model.rig(model.start)


def _meets(together: Model, rig: AnyRig, more: AnyRig, cause: Cause) -> bool:
    """Whether a cause decides or changes numbers that are there, or of what law there is: then it is scored alone."""
    before, after = nominal_scalars(rig), nominal_scalars(more)
    taken = {u.key for unknowns in together.unknowns for u in unknowns}
    if any(u.key in taken for u in together.extended_by(cause).unknowns[-1]):
        return True
    return rig.laws != more.laws[: len(rig.laws)] or any(after.get(k) != v for k, v in before.items())


def _scores(base: Evaluation, few: Campaign, residual: Array, model: Model, entries: Sequence[_Entry]) -> list[Score]:
    """Scores of a group of candidates; none where too few records have a steady state."""
    known = base.coordinates
    own = {e.place: e.start for e in entries}
    x = np.array([
        f.of(own.get(f.cause, {}).get(f.name, f.start)) if f.cause >= len(base.model.causes)
        else known.get((f.cause, f.name), f.of(f.start))
        for f in model.free
    ])  # fmt: skip
    try:
        e = evaluate(model, few, x, base.solutions)
    except FAILURES:
        return []
    found = np.repeat(np.isin(few.numbers, list(e.found)), [int(r.listed.sum()) for r in few.data.records])
    if 2 * found.sum() < len(found):
        return []
    scores = []
    for entry in entries:
        name = entry.cause.key if isinstance(entry.cause, WrongParameter) else ""
        mine = [f.name == name and f.cause < 0 if name else f.cause == entry.place for f in model.free]
        others = [
            ((f.cause < 0 and f.name in base.model.calibrated) or 0 <= f.cause < len(base.model.causes)) and not m
            for f, m in zip(model.free, mine, strict=True)
        ]
        strength = entry.cause.unknowns(model.nominal)[0] if name else model.unknowns[entry.place][0]
        drop, z, seen = _projected(e, residual[found], np.array(mine), np.array(others), strength)
        signature = np.zeros(len(residual))
        signature[found] = seen
        scores.append(Score(entry.cause, drop, z, signature, entry.start))
    return scores


def starting(model: Model, base: Evaluation, start: dict[str, float]) -> Array:
    """Coordinates with the calibrated numbers (and earlier causes) of another model and the last cause at a start."""
    known = base.coordinates
    last = len(model.causes) - 1
    return np.array(
        [
            f.of(start[f.name]) if f.cause == last and f.name in start else known.get((f.cause, f.name), f.of(f.start))
            for f in model.free
        ]
    )


def _projected(
    e: Evaluation, residual: Array, own: Mask, others: Mask, strength: Unknown
) -> tuple[float, float, Array]:
    """Predicted drop, its signed root by the strength alone, and the unit signature of the strength."""
    free = e.model.free
    J = np.vstack([e.white.jacobian, np.where(own, 0.0, e.expected)])
    r = np.concatenate([residual, -np.where(own, 0.0, e.pulls)])
    known, mine = J[:, others], J[:, own]
    whole = float(np.linalg.norm(mine[:, 0]))
    calibration = Span(known)
    r, mine = calibration.across(r), calibration.across(mine)
    first = mine[:, 0]
    size = float(np.linalg.norm(first))
    if size <= SEEN * whole or size == 0.0:
        return 0.0, 0.0, np.zeros(len(residual))
    z = float(first @ r) / size
    first_free = next(f for f, m in zip(free, own, strict=True) if m)
    toward = first_free.of(strength.starts[-1]) - first_free.of(strength.starts[0])
    one_sided = strength.neutral <= strength.lower or strength.neutral >= strength.upper
    if one_sided and z * toward < 0.0:
        return 0.0, 0.0, first[: len(residual)] / size
    reach = np.array([min(np.ptp(f.bounds), 10.0) for f in free])[own]
    effect = np.linalg.norm(mine, axis=0) * reach
    explained = r - Span(mine[:, effect >= VISIBLE * effect[0]]).across(r)
    relief = float(np.sum(np.where(own, e.pulls, 0.0) ** 2))  # a nominal value that is wrong is not held to tolerance
    return float(explained @ explained) + relief, z * (np.sign(toward) or 1.0), first[: len(residual)] / size
