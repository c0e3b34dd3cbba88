"""Records beside which what no model describes counts as noise of one level, the floor."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from scipy.optimize import minimize_scalar

from hbm.fourier import Array, FourierBasis
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation
from hbm.outputerror.numerics import Grid
from hbm.outputerror.records import Record
from hbm.outputerror.simulated import Simulated, Solutions
from models.jointed import AnyRig


@dataclass(frozen=True, eq=False)
class FlooredCampaign(Campaign, ABC):
    """Records whose discretisation needs no correction, and a floor.

    Attributes
    ----------
    floor : float
        What no model describes, as noise of one level: its standard deviation as a share of the rms that a channel
        has in the record.
    """

    floor_of: ClassVar[str]
    """What the floor is a share of, in words."""

    floor: float = 0.0

    @property
    @abstractmethod
    def described(self) -> str:
        """The records in words."""

    def worst(self, found: Mapping[int, Simulated]) -> str:
        """What else is said of how far a model is off, in words."""
        return ""

    def std(self, record: Record) -> Array:
        """Standard deviation of each amplitude of a record, (c, H) or (2, c, H)."""
        rms = np.sqrt(np.nanmean(record.measured**2, axis=(0, 2)))
        return np.asarray(np.hypot(record.std, self.floor * rms[:, None]))

    def of(self, numbers: Sequence[int]) -> Self:
        """Some of the records."""
        return replace(self, data=super().of(numbers).data)

    def corrected(self, rig: AnyRig, solutions: Solutions) -> Self:
        """The same: the discretisation is fine enough as it is."""
        return self

    def disturbances(self, record: Record, simulated: Simulated) -> Array:
        """None: all uncertainty is in the standard deviations of the channels."""
        return np.zeros((0, *record.measured.shape))

    def roughly(self) -> Self:
        """The same for a race, in which derivatives need not be exact."""
        return self

    def refined(self) -> Self:
        """The same on twice the harmonics and samples."""
        basis = self.numerics.working.basis
        fine = Grid(FourierBasis(2 * basis.H, 2 * basis.N_t), self.numerics.working.modes)
        return replace(self, numerics=replace(self.numerics, working=fine))


def likeliest_floor(e: Evaluation, campaign: FlooredCampaign) -> tuple[float, float]:
    """The floor beside which what a model leaves is likeliest, and twice the negative logarithm of how likely it is."""
    plain = replace(campaign, floor=0.0)
    records = [r for r in plain.data.records if r.number in e.found]
    missed = np.concatenate([plain.missed(r, e.found[r.number]) for r in records]) ** 2
    noise = np.concatenate([plain.listed_std(r) for r in records]) ** 2
    unit = np.concatenate([replace(plain, floor=1.0).listed_std(r) for r in records]) ** 2 - noise

    def deviance(log_floor: float) -> float:
        variance = noise + np.exp(2 * log_floor) * unit
        return float(np.sum(np.log(variance) + missed / variance))

    found = minimize_scalar(deviance, bounds=(np.log(1e-6), np.log(2.0)), method="bounded")
    return float(np.exp(found.x)), float(found.fun)
