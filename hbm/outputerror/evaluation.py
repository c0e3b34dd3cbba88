"""A model evaluated beside the records of a campaign: what it leaves of them, and its derivatives there."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import numpy as np

from hbm.balance.problem import State
from hbm.fourier import Array
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.model import Model
from hbm.outputerror.numerics import Correction
from hbm.outputerror.simulated import Simulated, Solutions, states
from hbm.outputerror.whitened import Whitened


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
    def costs(self) -> Array:
        """Of each number, by how much chi2 would fall if nothing were expected of it, to first order, (n,).

        It is more than the square of its pull, for others are pulled in its place: of two numbers of which the records
        see the product alone, by as much again.
        """
        known = np.diag(self.covariance) * np.diag(self.expected) ** 2  # share of its expectation in what is known
        return self.pulls**2 / np.maximum(1.0 - known, np.finfo(float).tiny)

    @property
    def scales(self) -> Array:
        """Standard deviations of the values by those of the coordinates, (n,)."""
        return np.abs([f.slope(v) for f, v in zip(self.model.free, self.x, strict=True)])

    @property
    def std(self) -> Array:
        """Standard deviations of the values, (n,); infinite where rounding makes a variance negative."""
        variance = np.diag(self.covariance)
        return np.asarray(self.scales * np.sqrt(np.where(variance < 0.0, np.inf, variance)))

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
