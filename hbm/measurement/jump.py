"""Jumps of phase within a record: samples that were lost, in a file whose times do not say so.

A frequency that is off turns phases from block to block alike, one that drifts turns them smoothly. Lost samples turn
all of them at once, by the same angle in every channel.
"""

from typing import NamedTuple

import numpy as np

from hbm.fourier import Array
from hbm.measurement.steadiness import Complex

FEWEST_BLOCKS = 10
"""Blocks in which a jump can be told from what is smooth."""

SMOOTH = 3
"""Degree of what is smooth."""

ABRUPT = 0.05
"""A jump, beside a frequency that is off, leaves at most this part of the square that is left by what is smooth."""

CERTAIN = 5.0
"""Standard deviations from which a jump is there beyond doubt."""


class Jump(NamedTuple):
    """A jump of phase.

    Attributes
    ----------
    angle, std : float
        By which the phase goes on after it, and its standard deviation [rad].
    time : float
        Middle of the block that it is in [s].
    """

    angle: float
    std: float
    time: float


def jump(t: Array, c: Complex) -> Jump | None:
    """Find the jump of complex amplitudes of blocks, if there is one.

    Parameters
    ----------
    t : (B,) array
        Middle of each block [s], equally spaced.
    c : (B,) complex array
    """
    B = len(t)
    if B < FEWEST_BLOCKS or not c.all():
        return None
    x, phase = np.linspace(-1.0, 1.0, B), np.unwrap(np.angle(c))
    smooth = np.polynomial.Polynomial.fit(x, phase, SMOOTH)(x)
    angle, std, left = _tried(x, phase)
    best = int(np.argmin(left))
    if left[best] > ABRUPT * float(np.sum((phase - smooth) ** 2)) or abs(angle[best]) < CERTAIN * std[best]:
        return None
    return Jump(float(angle[best]), float(std[best]), float(t[best + 2]))


def _tried(x: Array, phase: Array) -> tuple[Array, Array, Array]:
    """Angle of a jump within each block but two at both ends, its standard deviation, and the square that is left."""
    block, j = np.arange(len(x)), np.arange(2, len(x) - 2)[:, None]
    others = block != j  # the block that it is in has some of both phases
    A = np.stack([others, others * x, block > j], axis=2)
    inverse = np.linalg.inv(A.swapaxes(1, 2) @ A)
    found = (inverse @ (A.swapaxes(1, 2) @ phase)[:, :, None])[:, :, 0]
    left = np.sum((others * phase - (A @ found[:, :, None])[:, :, 0]) ** 2, axis=1)
    return found[:, 2], np.sqrt(left / (len(x) - 4) * inverse[:, 2, 2]), left
