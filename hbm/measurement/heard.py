"""Channels that hear nothing while others move: dead, or at rest."""

import numpy as np
import numpy.typing as npt

from hbm.fourier import Array

HEARD, LOUD = 2.0, 100.0
"""Standard deviations beyond the largest that noise has of so many harmonics, from which one stands out; and those of
another channel from which it is plain that the structure moved: one that hears nothing then is dead, or at rest."""


def unheard(clear: Array) -> npt.NDArray[np.bool_]:
    """Which channels, of harmonics (c, n) over their standard deviations, have none that stands out; none where all do.

    Parameters
    ----------
    clear : (c, n) array
        Amplitudes over the standard deviation of each of cos and sin.
    """
    largest = clear.max(axis=1)
    quiet = largest < HEARD + np.sqrt(2.0 * np.log(max(clear.shape[1], 9)))
    return np.asarray(quiet & (largest.max() >= LOUD))


def unheard_of(name: str) -> str:
    """What is told of such a channel."""
    return f"{name} has no harmonic that stands out of its noise: left out. Is it dead?"
