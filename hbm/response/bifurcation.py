"""Where the stability or the number of periodic solutions changes along a curve."""

from dataclasses import dataclass

import numpy as np

from continuation import Kind, SpecialPoint
from hbm.balance.solution import PeriodicSolution
from hbm.stability.multipliers import Stability


@dataclass(frozen=True, eq=False)
class Bifurcation:
    """Where the stability or the number of periodic solutions changes.

    Attributes
    ----------
    solution : PeriodicSolution
        There.
    stability : Stability
        Its multipliers; one, or a pair, on the unit circle.
    special : continuation.SpecialPoint
        The same in scaled unknowns, with the tangents of the curves that meet there.
    behind : int
        Index of the first point of the curve behind it.
    along : str
        Along a number of the rig its value there, such as ``joints.tip.mu = 0.31``.
    span : (float, float), optional
        Along a number, or the force, the values between which multipliers cross for certain.
    """

    solution: PeriodicSolution
    stability: Stability
    special: SpecialPoint
    behind: int
    along: str = ""
    span: tuple[float, float] | None = None

    @property
    def kind(self) -> Kind:
        """Kind of the bifurcation."""
        return Kind(self.special.kind)

    @property
    def multiplier(self) -> complex:
        """The multiplier on the unit circle, of a pair the upper one: 1, -1 where the period doubles."""
        found = self.stability.multipliers
        if self.kind is Kind.NEIMARK_SACKER:
            pairs = found[found.imag > 0.0]
            return complex(pairs[np.abs(np.abs(pairs) - 1.0).argmin()])
        return complex(found[np.abs(found - (-1.0 if self.kind is Kind.PERIOD_DOUBLING else 1.0)).argmin()])

    @property
    def hz(self) -> float:
        """Excitation frequency [Hz]."""
        return self.solution.hz

    @property
    def level(self) -> float:
        """Force amplitude [N]."""
        return self.solution.level

    def __repr__(self) -> str:
        """Say what and where."""
        within = "" if self.span is None else " ({:.4g} to {:.4g})".format(*self.span)
        number = f"{self.along}{within}, " if self.along else ""
        return f"{self.kind.value} at {number}{self.hz:.6g} Hz, {self.level:.4g} N{'' if self.along else within}"
