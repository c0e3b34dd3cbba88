"""A mode next above the band: where what modes there answer is more than a constant and the square of the frequency.

The two are the first terms of a series in (omega / omega_b)^2, of which many count where a mode at omega_b is near. One
term, V omega^2 / (1 - (omega / omega_b)^2), has the sum of all of them, and what it adds to U at rest is nothing: U
stays the static flexibility of all modes above the band. The frequency is one for all channels.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hbm.fourier import Array


class Beyond(NamedTuple):
    """The mode above the band.

    Attributes
    ----------
    hz, hz_std : float
        Natural frequency [Hz]; that of several modes is between them.
    A, A_std : (c,) array
        Product of a channel's shape and that of the drive [1/kg].
    rest : (c,) array
        Static flexibility of all modes above it [m/N].
    """

    hz: float
    hz_std: float
    A: Array
    A_std: Array
    rest: Array

    def answer(self, squared: Array) -> Array:
        """Displacement per force (n, c) at squares of frequencies (n, 1) [rad2/s2]."""
        return np.asarray(self.A / ((2 * np.pi * self.hz) ** 2 - squared))


def beyond_of(rest: Array, share: float, middle: float, covariance: Array, places: npt.NDArray[np.intp]) -> Beyond:
    """The mode by what it was fitted as.

    Parameters
    ----------
    rest : (c, q) array
        U and V first, as flexibilities at the middle frequency [m/N].
    share : float
        Square of the middle frequency over that of the mode.
    middle : float
        [rad/s].
    covariance : (p, p) array
        Of all unknowns, the share being the last.
    places : (c,) array of int
        Where V is among the unknowns.
    """
    U, V = rest[:, 0], rest[:, 1]
    per_V, per_share = (middle / share) ** 2, -2.0 * middle**2 * V / share**3
    variance = (
        per_V**2 * covariance[places, places]
        + 2.0 * per_V * per_share * covariance[places, -1]
        + per_share**2 * covariance[-1, -1]
    )
    hz = middle / np.sqrt(share) / (2 * np.pi)
    return Beyond(
        hz=float(hz),
        hz_std=float(0.5 * hz / share * np.sqrt(covariance[-1, -1])),
        A=per_V * V,
        A_std=np.sqrt(np.maximum(variance, 0.0)),
        rest=U - V / share,
    )
