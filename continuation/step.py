"""An accepted step of a trace."""

from dataclasses import dataclass
from typing import Any

from .corner import Corner
from .geometry import Frame
from .newton import Correction
from .problem import Linearization


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """An accepted step.

    Attributes
    ----------
    frame : Frame
        The new solution with its tangent in the direction of travel.
    iterations : int
        Newton matrices that it took.
    residual_norm : float
        Max-norm of the residual there.
    size, length, angle : float
        Step asked for, length of the path, turn of the tangent [rad].
    slope : Linearization, optional
        The one that gave the tangent.
    corner : Corner, optional
        The corner passed, if it was located.
    jumped : bool
        Whether smaller steps failed and the stretch in between is unknown.
    branch_point : bool
        Whether another branch was crossed.
    parts : tuple of Step
        Steps that it is made of, where there are points on the way.
    error : float
        Of the cubic over it, as a fraction of the motion; 0 where that was not asked.
    """

    frame: Frame
    iterations: int
    residual_norm: float
    size: float
    length: float
    angle: float
    slope: Linearization | None = None
    corner: Corner | None = None
    jumped: bool = False
    branch_point: bool = False
    parts: tuple["Step", ...] = ()
    error: float = 0.0

    @classmethod
    def to(cls, frame: Frame, found: Correction, size: float, length: float, angle: float, **flags: Any) -> "Step":
        """Step to a corrected solution."""
        return cls(frame, found.iterations, found.residual_norm, size, length, angle, **flags)
