"""Least squares of a model over the records of a campaign, through the harmonic balance (output error).

The force noise of each record is profiled out: the covariance follows the model, and chi2 of different models compare.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from continuation import ConvergenceError
from hbm.fourier import Array
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation, evaluate
from hbm.outputerror.model import Model
from hbm.outputerror.simulated import FAILURES, Solutions
from models.causes.addedjoint import AddedJoint
from models.jointed import AnyRig

STEPS = 15
"""Steps of least squares, at most."""

REFINED = 4
"""Steps after the discretisation was corrected."""

SETTLED, PART = 0.05, 1e-3
"""Least squares ends when a step promises to lower chi2 by less than this, or by less than this part of its excess."""

ASTRAY, ASTRAY_SHARE, NEARER = 100.0, 0.1, 0.5
"""A record may be on another branch than the measured one where its mean square misfit is more than the first, and more
than the second of its size is missed; it is moved to one that leaves less than the third of that misfit."""

DAMPED = 1e-6
ROUNDING = 1e-13
LEAST_DAMPED = 1e-10
MOST_DAMPED = 1e4

MANY, MISSED = 5, 2
"""More starts than this are compared on so many records first."""

MOST = 0.7
"""Longest step of a coordinate; of one that is in proportion to its number and larger than 1, as a share of it."""

LONGER, SHORTER, SHORTEST = 2.0, 0.25, 0.01
"""Factors of the length of a step where the last one helped and where it did not; from the last on it is damped."""


def fit_model(
    model: Model,
    campaign: Campaign,
    x: Array,
    last: Solutions,
    steps: int = STEPS,
    settled: float = SETTLED,
    part: float = PART,
    needed: Collection[int] = (),
    reach: float = np.inf,
) -> Evaluation:
    """Coordinates of least chi2 near `x` (Gauss and Newton, steps shortened or damped where that fails).

    Parameters
    ----------
    model : Model
    campaign : Campaign
    x : (n,) array
        Where to start.
    last : mapping of int to PeriodicSolution
        Where steady states start.
    steps : int
        Evaluations, at most.
    settled : float
        Promised fall of chi2 at which the search ends.
    part : float
        The same as a part of what chi2 exceeds the number of coefficients by.
    needed : collection of int
        Records that must have a steady state at `x`.
    reach : float
        Chi2 that is of use: the search ends where steps as good as the last one would not get there.

    Raises
    ------
    ConvergenceError
        If the steady state of no record is found at `x`, or that of one that is needed is not.
    """
    begun = Descent(begun_at(model, campaign, x, last, needed))
    return descended(begun, campaign, last, steps, settled, part, reach).here


def begun_at(model: Model, campaign: Campaign, x: Array, last: Solutions, needed: Collection[int] = ()) -> Evaluation:
    """A model evaluated where a fit of it begins; arguments as :func:`fit_model`."""
    here = evaluate(model, campaign, np.clip(x, *model.bounds()), last)
    if not set(needed).isdisjoint(here.missing):
        here = found_again(here, campaign)
    if lost := [r.name for r in campaign.data.records if r.number in here.missing and r.number in needed]:
        raise ConvergenceError(f"diagnose: record {lost[0]} has lost its steady state")
    return _on_branches_measured(here, campaign)


def _on_branches_measured(here: Evaluation, campaign: Campaign) -> Evaluation:
    """The same, records that are far off on the branch that what was measured leads to, where that is nearer."""
    far = _astray(here, campaign)
    if not far:
        return here
    chi2 = campaign.chi2(here.solutions)
    others = campaign.of(far).reconstructed(here.model.rig(here.x))
    nearer = {n: others[n] for n, c in campaign.chi2(others).items() if c < NEARER * chi2[n]}
    return _with(here, campaign, nearer)


def _astray(here: Evaluation, campaign: Campaign) -> list[int]:
    """Records that may be on another branch than the measured one."""
    chi2 = campaign.chi2(here.solutions)
    missed = [r for r in campaign.data.records if chi2.get(r.number, 0.0) > ASTRAY * r.listed.sum()]
    size = {r.number: np.nansum((r.measured / campaign.std(r)) ** 2) for r in missed}
    return [number for number, squares in size.items() if chi2[number] > ASTRAY_SHARE**2 * squares]


def found_again(here: Evaluation, campaign: Campaign) -> Evaluation:
    """The same with those records that have a steady state far from where they started."""
    return _with(here, campaign, campaign.of(here.missing).solve(here.model.rig(here.x), {}))


def _with(here: Evaluation, campaign: Campaign, others: Solutions) -> Evaluation:
    """The same with other steady states of some records."""
    if not others:
        return here
    known = {**here.solutions, **others}
    there = evaluate(here.model, campaign.of([*known]), here.x, known, needed=here.found)
    return replace(there, missing=tuple(n for n in campaign.numbers if n not in there.solutions))


def fit_from(
    here: Evaluation,
    campaign: Campaign,
    last: Solutions,
    steps: int = STEPS,
    settled: float = SETTLED,
    reach: float = np.inf,
) -> Evaluation:
    """As :func:`fit_model`, from a model that is evaluated where it starts."""
    return descended(Descent(here), campaign, last, steps, settled, reach=reach).here


@dataclass(frozen=True, eq=False)
class Descent:
    """How far steps of least squares have come; they can be gone on with.

    Attributes
    ----------
    here : Evaluation
        The best so far.
    taken : int
        Steps so far.
    damping, length : float
        Of the next one.
    ended : bool
        Whether no step promises anything more.
    """

    here: Evaluation
    taken: int = 0
    damping: float = DAMPED
    length: float = 1.0
    ended: bool = False

    def goes_on(self, steps: int) -> bool:
        """Whether a further step is of use before there are so many."""
        return self.taken < steps and not self.ended


def descended(
    descent: Descent,
    campaign: Campaign,
    last: Solutions,
    steps: int,
    settled: float = SETTLED,
    part: float = PART,
    reach: float = np.inf,
) -> Descent:
    """Steps of least squares gone on with until there are so many; arguments as :func:`fit_model`."""
    if not len(descent.here.x):
        return replace(descent, ended=True)
    while descent.goes_on(steps):
        length = descent.length
        descent, gained = _stepped(descent, campaign, last, settled, part)
        if gained > 0.0 and descent.here.chi2 - (steps - descent.taken) * gained / length > reach:
            break
        if not descent.goes_on(steps):
            descent = _few_astray(descent, campaign)
    return descent


def _few_astray(descent: Descent, campaign: Campaign) -> Descent:
    """The end of a descent, or where it goes on from if few records are on another branch than the measured one.

    That branch need not be there, at their frequency, where the descent began.
    """
    here = descent.here
    if 2 * len(_astray(here, campaign)) > len(here.found):
        return descent
    there = _on_branches_measured(here, campaign)
    return descent if there is here else replace(descent, here=there, damping=DAMPED, length=1.0, ended=False)


def _stepped(
    descent: Descent, campaign: Campaign, last: Solutions, settled: float, part: float
) -> tuple[Descent, float]:
    """One step more, and what it gained; or the end."""
    here, damping, length = descent.here, descent.damping, descent.length
    strictness = _strictness(here)
    step, promised = bounded_step(here, damping, strictness, MOST)
    if promised < max(settled, part * (here.chi2 - len(here.white))):
        return replace(descent, ended=True), 0.0
    low, high = here.model.bounds()
    try:
        there = evaluate(here.model, campaign, np.clip(here.x + length * step, low, high), last, here)
        pulled = float(here.pulls @ here.pulls - there.pulls @ there.pulls)
        gained = fall(here, there) + (strictness - 1.0) * pulled
    except FAILURES:
        gained = -1.0
    if gained > 0.0:
        # valleys are narrow and bent: the direction is kept, and followed further while it pays
        here, damping, length = there, max(damping / 10.0, LEAST_DAMPED), min(1.0, length * LONGER)
    else:
        length *= SHORTER
        if length < SHORTEST:
            damping, length = damping * 1e3, 1.0
    return Descent(here, descent.taken + 1, damping, length, damping > MOST_DAMPED), gained


def refine(e: Evaluation, campaign: Campaign, steps: int = REFINED) -> Evaluation:
    """Fit a model again with the discretisation corrected where the fit is."""
    there = campaign.corrected(e.model.rig(e.x), e.solutions)
    return fit_model(e.model, there, e.x, e.solutions, steps)


def _reach(here: Evaluation) -> Array:
    """Size of each coordinate, which steps are compared with: the scale of its start may be far from it."""
    linear = [f.form == "linear" for f in here.model.free]
    return np.where(linear, np.maximum(np.abs(here.x), 1.0), 1.0)


def fall(before: Evaluation, after: Evaluation) -> float:
    """Fall of chi2 on the records that were found before."""
    more = after.white.residual[np.isin(after.white.record, before.missing)]
    return before.chi2 - after.chi2 + float(more @ more)


def _strictness(here: Evaluation) -> float:
    """How many times what is expected of calibrated numbers counts beside the records.

    As often as these exceed their noise where a joint is fitted, which has far to go: numbers many tolerances off would
    be the shortest way to less misfit, and not the way to the joint.
    """
    joint = any(isinstance(cause, AddedJoint) for cause in here.model.causes)
    return max(here.white.chi2 / max(len(here.white), 1), 1.0) if joint else 1.0


def bounded_step(
    here: Evaluation, damping: float = 0.0, strictness: float = 1.0, most: float = np.inf
) -> tuple[Array, float]:
    """Step of least squares within the bounds, and the fall of chi2 it promises.

    Parameters
    ----------
    here : Evaluation
    damping : float
        Of each coordinate, as a share of what the records know of it.
    strictness : float
        How many times what is expected of calibrated numbers counts.
    most : float
        Longest step of a coordinate: one that would go farther stops there, and holds no other back.
    """
    low, high = here.model.bounds()
    reach = most * _reach(here)
    low, high = np.maximum(low, here.x - reach), np.minimum(high, here.x + reach)
    std = np.array([f.std for f in here.model.free])
    gradient = here.white.jacobian.T @ here.white.residual - strictness * here.pulls / std
    A = here.information + (strictness - 1.0) * here.expected**2
    size = np.sqrt(np.maximum(np.diag(A), 1e-300))
    values, vectors = np.linalg.eigh(A / np.outer(size, size))
    root = np.sqrt(np.maximum(values, 0.0) + max(damping, ROUNDING))
    least = lsq_linear(
        root[:, None] * vectors.T,
        vectors.T @ (gradient / size) / root,
        bounds=((low - here.x) * size, (high - here.x) * size),
        method="bvls",
    )
    step = least.x / size
    return step, float(2.0 * gradient @ step - step @ A @ step)


def best_start(
    model: Model,
    campaign: Campaign,
    starts: list[Array],
    last: Solutions,
    most: int = MANY,
    limit: float = np.inf,
) -> list[tuple[float, Array]]:
    """Starts by their chi2 on a few records, the least first; a record without a steady state counts as in `last`.

    More than `most` are compared on the records that `last` misses most, and the best of them on all. Of a start whose
    chi2 exceeds the limit no more is known than that.
    """
    before = campaign.chi2(last)
    worst = sorted(before, key=lambda number: -before[number])[:MISSED]
    if len(starts) > most:
        starts = [x for _, x in _ordered(model, campaign.of(worst), starts, last, before, limit)][:most]
    return _ordered(model, campaign, starts, last, before, limit)


def _ordered(
    model: Model,
    campaign: Campaign,
    starts: list[Array],
    last: Solutions,
    before: Mapping[int, float],
    limit: float,
) -> list[tuple[float, Array]]:
    known = {number: before[number] for number in campaign.numbers if number in before}
    found = []
    for x in starts:
        try:
            chi2 = _chi2_up_to(limit, campaign, model.rig(x), last, known)
        except FAILURES:
            continue
        if chi2 is not None:
            found.append((chi2, x))
    if not found:
        raise ConvergenceError(f"{model.label}: no start has steady states")
    return sorted(found, key=lambda pair: pair[0])


def _chi2_up_to(
    limit: float, campaign: Campaign, rig: AnyRig, last: Solutions, before: Mapping[int, float]
) -> float | None:
    """Chi2 of records at a rig, those not found as before; None where none is. Beyond the limit no more are sought."""
    chi2, total = dict(before), None
    for number, solution in campaign.solved_in_turn(rig, last):
        chi2 |= campaign.chi2({number: solution})
        total = float(sum(chi2.values()))
        if total > limit:
            break
    return total
