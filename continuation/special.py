"""Special points: what their kinds are called, and what is known of each."""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from .geometry import Frame
from .problem import Array


class Kind(Enum):
    """Kind of a special point. `SpecialPoint` takes members of any other `Enum` too, a caller's own kinds."""

    FOLD = "fold"
    BRANCH_POINT = "branch point"
    NEIMARK_SACKER = "Neimark-Sacker"
    PERIOD_DOUBLING = "period doubling"
    CUSP = "cusp"
    ISOLA_CENTRE = "isola centre: a closed curve is born"
    CROSSING = "two curves meet and cross"


@dataclass(frozen=True, slots=True, eq=False)
class SpecialPoint:
    """A point on a curve at which a test function vanishes.

    Attributes
    ----------
    kind : Enum
        Kind of the point.
    x : (N,) array
        Unknowns.
    lam : float
        Parameter.
    null_space : (k, N + 1) array
        Directions (dx, dlam) in which the residual does not change to first order, unit in the metric of the settings.
        The first is the tangent of the curve on which the point was found; k = 1, but 2 at a branch point, where the
        second is the tangent of the other curve. At a fold `null_space[0, :-1]` is the null vector of J_x.
    test : float
        Remaining value of the test function.
    arclength : float
        Length of the branch up to here.
    located : bool
        False where the curve could not be solved close to the point: the branch's own point behind it stands for it.
    """

    kind: Enum
    x: Array
    lam: float
    null_space: Array
    test: float
    arclength: float
    located: bool = True

    def __repr__(self) -> str:
        """Kind and parameter, in the problem's own units."""
        where = f"{self.kind.value} at lam = {self.lam:.10g}, {self.x.size} unknowns"
        return where if self.located else f"{where}; not located, of the point behind"

    @property
    def state(self) -> Array:
        """(x, lam), (N + 1,)."""
        return np.append(self.x, self.lam)

    @property
    def tangent(self) -> Array:
        """Unit tangent of the curve on which the point was found, (N + 1,)."""
        return np.asarray(self.null_space[0])


def special(kind: Enum, frame: Frame, test: float, arclength: float) -> SpecialPoint:
    """Special point with one tangent."""
    return SpecialPoint(kind, frame.state[:-1], float(frame.state[-1]), frame.tangent[None], test, arclength)
