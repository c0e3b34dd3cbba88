"""March of a body with joints over a period of the force, and the number of steps it needs."""

from dataclasses import replace

import numpy as np

from hbm.aft.recurrence import monodromy
from hbm.integration.jointstep import SOLVED, JointedStep
from models.jointed import JointedRig
from models.structure import Array

LEAST_STEPS = 512
FEWEST_STEPS = 8
"""Steps per period that may be asked for at least."""
MOST_STEPS = 32768
"""Steps per period up to which they are chosen to resolve the highest mode."""

GROWTH_TOLERANCE = 1e-3
"""Tolerance of the growth in a period about rest; rounding splits the double root of a rigid motion by less."""

AT_ONCE = 128
"""Steps whose derivatives are held at once: those of a period of thousands take longer to store than to multiply."""


def resolving_steps(rig: JointedRig, hz: float, least: int) -> int:
    """Steps per period in which no mode turns by more than a radian: `least`, or twice as many as often as needed.

    Forces that are linear over a step and found at its end make joints of any stiffness stable there; with steps that
    are longer in the time of the highest mode they need not be.

    Raises
    ------
    ArithmeticError
        If that takes more than :data:`MOST_STEPS`.
    """
    highest, steps = float(rig.structure.omega_n[-1]), least
    while highest > hz * steps:
        steps *= 2
    if steps > max(MOST_STEPS, least):
        mode = f"mode {rig.structure.n} of {rig.name} at {highest / (2 * np.pi):.4g} Hz"
        raise ArithmeticError(
            f"time step: {mode} needs {steps} steps per period of {hz:g} Hz; must be <= {MOST_STEPS}; keep fewer modes"
        )
    return steps


class JointMarcher:
    """A rig at one frequency, force amplitude and step: marches states period by period."""

    def __init__(self, rig: JointedRig, hz: float, level: float, steps_per_period: int) -> None:
        self.rig, self.hz, self.level, self.steps = rig, hz, level, steps_per_period
        self.dt = 1.0 / (hz * steps_per_period)
        self.step = JointedStep(rig, self.dt, level)
        excitation, phase = replace(rig.excitation, amplitude=level), 2 * np.pi * np.arange(steps_per_period + 1)
        phase = phase / steps_per_period
        force, rate = excitation.force(phase), 2 * np.pi * hz * excitation.force(phase, 1)
        self.told = np.column_stack([force[:-1], force[1:], rate[1:]])

    @property
    def size(self) -> int:
        """Length of a state."""
        return self.step.layout.size

    @property
    def excess(self) -> float:
        """Excess growth of motions about rest, joints stuck, in a period, over steps that resolve every mode.

        As a logarithm; what a rig that is unstable at rest does by itself is not counted.

        Raises
        ------
        ArithmeticError
            As :func:`resolving_steps`.
        """
        enough, growth = resolving_steps(self.rig, self.hz, self.steps), self._growth()
        if enough == self.steps or growth <= GROWTH_TOLERANCE:
            return 0.0
        return growth - 2.0 * JointMarcher(self.rig, self.hz, self.level, enough)._growth()

    def refuse_growth(self) -> None:
        """Refuse a step that is too long for the joints at rest.

        Raises
        ------
        ArithmeticError
            With the number of steps that is enough.
        """
        if (excess := self.excess) > 0.0:
            enough = resolving_steps(self.rig, self.hz, self.steps)
            raise ArithmeticError(
                f"time step: {self.rig.name} at {self.hz:g} Hz: in {self.steps} steps per period motions about rest "
                f"grow by exp({excess:.2g}) a period; try {enough} steps"
            )

    def _growth(self) -> float:
        """Logarithm of the largest factor by which small motions about rest grow in a period."""
        rest = np.zeros((1, self.size))
        slopes = self.step.jacobians(rest, rest, np.zeros((1, 3)))[0]
        return self.steps * float(np.log(np.abs(np.linalg.eigvals(slopes)).max()))

    def period(self, x: Array) -> tuple[Array, float]:
        """States after every step of a period from a state at phase 0, (steps, size), and the largest residual.

        Raises
        ------
        ArithmeticError
            If a step was not solved.
        """
        X, residual = self.step.march(x, self.told)
        largest = float(residual.max())
        if not largest < SOLVED:
            raise ArithmeticError(
                f"time step: {self.rig.name} at {self.hz:g} Hz: the joints' forces are {largest:.1e} of the excitation "
                f"short of their laws; must be below {SOLVED:g}; try {2 * self.steps} steps per period"
            )
        return X, largest

    def monodromy(self, x: Array, X: Array) -> Array:
        """Derivative of the state after a period from `x`, marched as `X`, to that before."""
        before = np.vstack([x, X[:-1]])
        parts = (slice(first, first + AT_ONCE) for first in range(0, len(X), AT_ONCE))
        stretches = [monodromy(self.step.jacobians(before[at], X[at], self.told[at])) for at in parts]
        return monodromy(np.array(stretches))
