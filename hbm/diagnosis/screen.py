"""Score test of every candidate cause: what its first small effect would take from chi2, calibration held harmless.

The signature of a cause is the exact derivative of the steady states to its parameters where it has next to no effect,
less what the calibrated numbers can do as well. A number that only shapes an effect (a place, a frequency) is scanned.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hbm.diagnosis.jointscan import scan
from hbm.diagnosis.signatures import Mask, Score, scores
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation
from hbm.outputerror.numerics import LEFT, Correction, size
from hbm.outputerror.simulated import FAILURES
from models.causes.addedjoint import AddedJoint
from models.causes.cause import Cause

RECORDS, FEW = 20, 8
"""Records whose derivatives make the signatures, spread over levels and frequencies: where the misfit is small, and
where it is too large for the score test to do more than to say who goes first."""

LINEAR = 2.0
"""Mean square misfit up to which it is small."""

PROBED = 6
"""Records on which causes are tried that have no size."""

COARSE = (15, 256)
"""Harmonics and samples for the derivatives; the misfit itself is that of the fine simulation."""

INSTEAD = 0.5
"""What does less than this share of what calibrated numbers did could not be in their place."""

HOPELESS = 0.15
"""Joints whose scan promises a smaller share of the best one's fall of chi2 are left out."""


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

    @property
    def instead(self) -> list[Score]:
        """Those that do most of what calibrated numbers did, numbers among them, the most alike first."""
        return sorted((s for s in self.scores if s.instead >= INSTEAD), key=lambda s: -s.instead)


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
    found = scores(base, few, sized)
    tried = len(best) + len(found) + len(joints)
    for score in found:
        other = best.get(score.cause.label)
        if other is None or score.drop > other.drop or not other.signature.any():
            best[score.cause.label] = score
    for cause in candidates:
        best.setdefault(cause.label, Score(cause, 0.0, 0.0, np.zeros(int(seen.sum())), {}))
    scanned = [s for s in scan(base, campaign.of(few.numbers), joints, large=not small(base)) if s.starts]
    likely = HOPELESS * max((s.drop for s in scanned), default=0.0)
    best |= {
        s.cause.label: Score(s.cause, s.drop, s.z, s.signature, s.starts[0], starts=s.starts)
        for s in scanned
        if s.drop >= likely
    }
    price = float(np.log(len(base.white)))  # of a number, in BIC
    ranked = [replace(s, gain=s.drop - price * len(s.cause.unknowns(base.model.nominal))) for s in best.values()]
    return Screening(tuple(sorted(ranked, key=lambda s: -s.gain)), len(few.numbers), tried)


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
