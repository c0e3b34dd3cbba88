"""Fits that go on along a valley: by strides in the direction in which the records determine numbers of causes least.

Where a combination of two numbers is seen and hardly more, as the stiffness squared over the limit of a joint that
slips in parts, chi2 falls little along a long valley, and any ripple of it ends a descent.
"""

from contextlib import suppress

import numpy as np

from hbm.fourier import Array
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation
from hbm.outputerror.fit import fit_model
from hbm.outputerror.simulated import FAILURES

STRIDE, STEPS = 2.0, 5
"""Factor by which a stride changes the number that it changes most; steps of least squares after it, at most."""

WORTH = 0.01
"""Share of the excess of chi2, 1 at least, by which it must fall for a stride to be kept and followed by a next one."""

LONG = 3.0
"""A valley is long where one combination of numbers, as factors, is known so many times less well than another one."""

FLAT = 30.0
"""And flat where a stride along it would raise chi2, to first order, by less than so many times what it is, or as there
are coefficients."""


def along_valley(e: Evaluation, campaign: Campaign) -> Evaluation:
    """The fit that strides along its valley lead to, one way or else the other.

    Parameters
    ----------
    e : Evaluation
        Where a descent has ended; what is returned where no stride helps, or the valley is not long and flat.
    campaign : Campaign
    """
    tangent = _least_determined(e)
    for way in () if tangent is None else (tangent, -tangent):
        best = _walked(e, campaign, way)
        if best is not e:
            return best
    return e


def _walked(e: Evaluation, campaign: Campaign, way: Array) -> Evaluation:
    """The last fit of strides that each help, the first of them that way."""
    worth = max(WORTH * (e.chi2 - len(e.white)), 1.0)
    there = None
    with suppress(*FAILURES):
        there = fit_model(e.model, campaign, _strode(e, way), e.solutions, STEPS, needed=e.found, reach=e.chi2 - worth)
    if there is None or there.chi2 >= e.chi2 - worth:
        return e
    tangent = _least_determined(there)
    return there if tangent is None else _walked(there, campaign, tangent if tangent @ way > 0.0 else -tangent)


def _least_determined(e: Evaluation) -> Array | None:
    """Change of the coordinates, of the logarithms of numbers of causes, in the direction least determined, (n,).

    All others follow to first order. None where the valley is not long or not flat, as that of fewer than two numbers.
    """
    own = _own(e)
    if len(own) < 2:
        return None
    scale = np.ones(len(e.x))
    scale[own] = [e.model.free[i].slope(e.x[i]) / e.model.free[i].value(e.x[i]) for i in own]
    covariance = scale[:, None] * e.covariance * scale
    spread, vectors = np.linalg.eigh(covariance[np.ix_(own, own)])
    change = covariance[:, own] @ vectors[:, -1]
    change /= np.abs(change[own]).max()
    rise = np.log(STRIDE) ** 2 * float(change[own] @ change[own]) / spread[-1]
    return None if spread[-1] < LONG**2 * spread[0] or rise > FLAT * max(e.chi2, len(e.white)) else np.asarray(change)


def _own(e: Evaluation) -> list[int]:
    """Coordinates of numbers of causes that are not at a bound."""
    low, high = e.model.bounds()
    inside = (low < e.x) & (e.x < high)
    return [i for i, f in enumerate(e.model.free) if f.cause >= 0 and inside[i] and f.value(e.x[i]) != 0.0]


def _strode(e: Evaluation, way: Array) -> Array:
    """Coordinates one stride that way."""
    x, change = e.x.copy(), np.log(STRIDE) * way
    own = _own(e)
    x += np.where(np.isin(np.arange(len(x)), own), 0.0, change)
    for i in own:
        f = e.model.free[i]
        x[i] = f.of(f.value(e.x[i]) * float(np.exp(change[i])))
    return x
