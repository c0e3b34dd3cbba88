"""A channel's reading of a displacement: its derivative, times a gain, a delay later. The one formula for all.

A displacement s(t) = exp(p t) at the place of a channel is read as gain p^n exp(-p delay) s(t), with n derivatives.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from hbm.fourier import Array, FourierBasis
from models.parts import Channel

Rates = npt.NDArray[np.complexfloating[Any, Any]]

DERIVATIVES = {"displacement": 0, "velocity": 1, "acceleration": 2}

DISPLACEMENT, VELOCITY = Channel("true", "displacement"), Channel("true", "velocity")
"""Channels that read what is there."""


def turn(channel: Channel, rate: Rates) -> npt.NDArray[np.complex128]:
    """From the quantity of a channel to what it reads, at complex rates p [1/s]: its gain, a delay later."""
    return np.asarray(channel.gain * np.exp(-rate * channel.delay))


def factor(channel: Channel, rate: Rates) -> npt.NDArray[np.complex128]:
    """From displacement to what a channel reads of it, at complex rates p [1/s]."""
    return np.asarray(rate ** DERIVATIVES[channel.quantity] * turn(channel, rate))


def read(channel: Channel, basis: FourierBasis, displacement: Array, Omega: float) -> Array:
    """Fourier coefficients (2H+1, ...) of what a channel reads of a periodic displacement at its place."""
    return _times(basis, displacement, factor(channel, _rates(basis, Omega)))


def turned(channel: Channel, basis: FourierBasis, quantity: Array, Omega: float) -> Array:
    """Fourier coefficients (2H+1, ...) of what a channel reads of a periodic motion in its own quantity."""
    return _times(basis, quantity, turn(channel, _rates(basis, Omega)))


def _rates(basis: FourierBasis, Omega: float) -> Rates:
    return np.asarray(1j * Omega * np.arange(basis.H + 1))


def _times(basis: FourierBasis, coefficients: Array, factors: Rates) -> Array:
    return basis.real((basis.complex(coefficients).T * factors).T)


def late(channel: Channel, values: Array, dt: float) -> Array:
    """Samples that a channel reads of its quantity, equally spaced: the gain times the value a delay ago.

    Between samples on straight lines, for what jumps must not swing; before the first sample what is there at it.

    Parameters
    ----------
    channel : Channel
    values : (N,) array
        Samples of its quantity, the derivatives taken.
    dt : float
        Between them [s].
    """
    index = np.arange(len(values))
    return np.asarray(channel.gain * np.interp(index - channel.delay / dt, index, values))
