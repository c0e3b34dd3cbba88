"""Least squares of a model over the records of a campaign, through the harmonic balance (output error).

The force noise of each record is profiled out: the covariance follows the model, and chi2 of different models compare.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import lsq_linear

from continuation import ConvergenceError
from hbm.balance.problem import State
from hbm.fourier import Array
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.model import Model
from hbm.outputerror.numerics import Correction
from hbm.outputerror.simulated import FAILURES, Simulated, Solutions, states
from hbm.outputerror.whitened import Whitened
from models.causes.addedjoint import AddedJoint

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


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A model at coordinates beside the records.

    Attributes
    ----------
    model : Model
    x : (n,) array
    found : dict of int to Simulated
        By record.
    white : Whitened
        Its Jacobian is to the coordinates.
    missing : tuple of int
        Records without a steady state.
    by_x : (p, n) array
        Derivatives of the numbers of the rig that the records are differentiated to.
    corrections : dict of int to Correction
        Corrections of the discretisation, by record.
    """

    model: Model
    x: Array
    found: dict[int, Simulated]
    white: Whitened
    missing: tuple[int, ...]
    by_x: Array
    corrections: Mapping[int, Correction] = field(default_factory=dict)

    @property
    def pulls(self) -> Array:
        """Calibrated numbers less expected, in standard deviations, (n,); 0 where nothing is expected."""
        return np.array([(v - f.expected) / f.std for f, v in zip(self.model.free, self.x, strict=True)])

    @property
    def chi2(self) -> float:
        """Misfit of the records, and of the calibrated numbers from what is expected of them."""
        return self.white.chi2 + float(self.pulls @ self.pulls)

    @property
    def solutions(self) -> Solutions:
        """Steady states by record."""
        return {number: s.solution for number, s in self.found.items()}

    @property
    def settled(self) -> bool:
        """Whether its records have no transients, which are free in each."""
        return self.model.rig(self.x).excitation.settled

    def states(self, x: Array) -> dict[int, State]:
        """Unknowns of the balance at other coordinates, to first order, by record."""
        change = self.by_x @ (x - self.x)
        return {number: s.moved(change) for number, s in self.found.items()}

    @property
    def values(self) -> dict[tuple[int, str], float]:
        """Of the free numbers, by cause and name: a coordinate has the scale of one model alone."""
        return {(f.cause, f.name): f.value(x) for f, x in zip(self.model.free, self.x, strict=True)}

    @property
    def expected(self) -> Array:
        """Expectations of the coordinates, as rows beside those of the records: (n, n), in standard deviations."""
        return np.diag([1.0 / f.std for f in self.model.free])

    @property
    def information(self) -> Array:
        """Inverse covariance of the coordinates by records and expectation, (n, n)."""
        J = self.white.jacobian
        return np.asarray(J.T @ J + self.expected**2)

    @property
    def covariance(self) -> Array:
        """Covariance of the coordinates, (n, n); what no record sees is known to within its bounds."""
        low, high = self.model.bounds()
        width = np.where(np.isfinite(high - low), high - low, 1e6)
        return np.asarray(np.linalg.inv(self.information + np.diag(1.0 / width**2)))

    @property
    def scales(self) -> Array:
        """Standard deviations of the values by those of the coordinates, (n,)."""
        return np.abs([f.slope(v) for f, v in zip(self.model.free, self.x, strict=True)])

    @property
    def std(self) -> Array:
        """Standard deviations of the values, (n,)."""
        return np.asarray(self.scales * np.sqrt(np.diag(self.covariance)))

    @property
    def bic(self) -> float:
        """Bayesian information criterion."""
        return self.chi2 + self.white.spread + self.model.counted * float(np.log(len(self.white)))


def evaluate(
    model: Model,
    campaign: Campaign,
    x: Array,
    last: Solutions,
    near: Evaluation | None = None,
    needed: Collection[int] = (),
) -> Evaluation:
    """A model at coordinates.

    Parameters
    ----------
    model : Model
    campaign : Campaign
    x : (n,) array
    last : mapping of int to PeriodicSolution
        Where steady states start.
    near : Evaluation, optional
        A fit of the same model. Its records start from there, extrapolated, and must all be found again.
    needed : collection of int
        Other records that must be found.

    Raises
    ------
    ConvergenceError
        If the steady state of no record is found, or one found `near` or needed is not.
    """
    rig = model.rig(x)
    keys, by_x = model.by_x(x, rig)
    starts = states(last)
    if near is not None:
        starts, needed = starts | near.states(x), {*needed, *near.found}
    found = campaign.simulate(rig, keys, starts, needed)
    missing = tuple(number for number in campaign.numbers if number not in found)
    return Evaluation(model, x, found, campaign.whiten(found, by_x), missing, by_x, campaign.corrections)


def start_from(
    model: Model, campaign: Campaign, x: Array, last: Solutions, needed: Collection[int] = ()
) -> tuple[float, Solutions]:
    """Chi2 of the records at coordinates, and their steady states: no derivatives are worked out.

    Raises
    ------
    ConvergenceError
        As :func:`evaluate`.
    """
    found = campaign.simulate(model.rig(x), (), states(last), needed)
    chi2 = campaign.whiten(found, np.zeros((0, len(x)))).chi2
    return chi2, {number: s.solution for number, s in found.items()}


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
    here = evaluate(model, campaign, np.clip(x, *model.bounds()), last)
    if not set(needed).isdisjoint(here.missing):
        here = found_again(here, campaign)
    if lost := [r.name for r in campaign.data.records if r.number in here.missing and r.number in needed]:
        raise ConvergenceError(f"diagnose: record {lost[0]} has lost its steady state")
    return fit_from(_on_branches_measured(here, campaign), campaign, last, steps, settled, part, reach)


def _on_branches_measured(here: Evaluation, campaign: Campaign) -> Evaluation:
    """The same, records that are far off on the branch that what was measured leads to, where that is nearer."""
    chi2 = campaign.chi2(here.solutions)
    missed = [r for r in campaign.data.records if chi2.get(r.number, 0.0) > ASTRAY * r.listed.sum()]
    far = [
        r.number for r in missed if chi2[r.number] > ASTRAY_SHARE**2 * np.nansum((r.measured / campaign.std(r)) ** 2)
    ]
    if not far:
        return here
    others = campaign.of(far).reconstructed(here.model.rig(here.x))
    nearer = {n: others[n] for n, c in campaign.chi2(others).items() if c < NEARER * chi2[n]}
    return _with(here, campaign, nearer)


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
    part: float = PART,
    reach: float = np.inf,
) -> Evaluation:
    """As :func:`fit_model`, from a model that is evaluated where it starts."""
    model, (low, high) = here.model, here.model.bounds()
    damping, length = DAMPED, 1.0
    for left in reversed(range(steps if len(here.x) else 0)):
        strictness = _strictness(here)
        step, promised = bounded_step(here, damping, strictness, MOST)
        if promised < max(settled, part * (here.chi2 - len(here.white))):
            break
        try:
            there = evaluate(model, campaign, np.clip(here.x + length * step, low, high), last, here)
            pulled = float(here.pulls @ here.pulls - there.pulls @ there.pulls)
            gained = fall(here, there) + (strictness - 1.0) * pulled
        except FAILURES:
            gained = -1.0
        if gained > 0.0:
            # valleys are narrow and bent: the direction is kept, and followed further while it pays
            here, damping = there, max(damping / 10.0, LEAST_DAMPED)
            if here.chi2 - left * gained / length > reach:
                break
            length = min(1.0, length * LONGER)
        else:
            length *= SHORTER
            if length < SHORTEST:
                damping, length = damping * 1e3, 1.0
        if damping > MOST_DAMPED:
            break
    return here


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
    model: Model, campaign: Campaign, starts: list[Array], last: Solutions, most: int = MANY
) -> list[tuple[float, Array]]:
    """Starts by their chi2 on a few records, the least first; a record without a steady state counts as in `last`.

    More than `most` are compared on the records that `last` misses most, and the best of them on all.
    """
    before = campaign.chi2(last)
    worst = sorted(before, key=lambda number: -before[number])[:MISSED]
    if len(starts) > most:
        starts = [x for _, x in _ordered(model, campaign.of(worst), starts, last, before)][:most]
    return _ordered(model, campaign, starts, last, before)


def _ordered(
    model: Model, campaign: Campaign, starts: list[Array], last: Solutions, before: Mapping[int, float]
) -> list[tuple[float, Array]]:
    known = {number: before[number] for number in campaign.numbers if number in before}
    found = []
    for x in starts:
        try:
            solutions = campaign.solve(model.rig(x), last)
        except FAILURES:
            continue
        if solutions:
            found.append((float(sum((known | campaign.chi2(solutions)).values())), x))
    if not found:
        raise ConvergenceError(f"{model.label}: no start has steady states")
    return sorted(found, key=lambda pair: pair[0])
