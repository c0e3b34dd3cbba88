"""How long the next step is: as long as the cubic between two points stays true, and corrections stay short."""

from .geometry import Metric
from .problem import Array
from .settings import Settings
from .step import Step

_GROWTH = (0.5, 2.0)
_RISE = (1.0, 3.0)
_SAFETY = 0.85


class StepSize:
    """Chooses steps along a curve from what the step before tells.

    Parameters
    ----------
    metric : Metric
        Measures lengths.
    settings : Settings
        Limits and tolerances.

    Attributes
    ----------
    size : float
        The next step.
    curvature : float
        Turn of the tangent per length over the last smooth step, else 0.
    """

    def __init__(self, metric: Metric, settings: Settings) -> None:
        self._metric, self._settings = metric, settings
        self.size, self.curvature = settings.step, 0.0

    def restart(self, step: Step) -> None:
        """Go on from a corner or a jump as before; it tells nothing about the curve behind."""
        self.curvature = 0.0
        self._limit(step.size, step.frame.state)

    def proceed(self, step: Step, curvature: float) -> None:
        """Go on from a smooth step, at whose end the tangent turns by `curvature` per length."""
        settings = self._settings
        growth = settings.target_iterations / max(step.iterations, 1)
        if curvature > 0.0:  # if it keeps rising as it did
            low, high = _RISE
            rise = min(max(curvature / self.curvature, low), high) if self.curvature > 0.0 else high
            growth = min(growth, 0.5 * settings.max_angle / (curvature * rise * step.size))
        if step.error > 0.0:
            growth = min(growth, _SAFETY * (settings.curve_tolerance / step.error) ** 0.25)
        self.curvature = curvature
        self._limit(step.size * min(max(growth, _GROWTH[0]), _GROWTH[1]), step.frame.state)

    def _limit(self, size: float, state: Array) -> None:
        settings = self._settings
        longest = max(settings.step_max, settings.relative_step * self._metric.motion(state))
        self.size = min(max(size, settings.step_min), longest)
