"""Frequency responses per force, of all records of spectra at a low level."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from hbm.fourier import Array
from hbm.measurement.multisine import excited_lines
from hbm.measurement.spectra import MeasuredSpectra

Complex = npt.NDArray[np.complex128]

SHARP = 0.2
"""A response is used whose force is known to this part of it."""


@dataclass(frozen=True, eq=False)
class FrequencyResponses:
    """Responses per force of c channels at n frequencies.

    Attributes
    ----------
    hz : (n,) array
        Ascending [Hz].
    channels : mapping of str to str
        Quantity by channel: displacement, velocity or acceleration.
    H : (n, c) complex array
        nan where not measured.
    own_std : (n, c) array
        Standard deviation of each of real and imaginary part, by what the channel reads.
    force_error : (n,) array or float
        Standard deviation of each part of the force over its amplitude: it errs all channels alike.
    """

    hz: Array
    channels: Mapping[str, str]
    H: Complex
    own_std: Array
    force_error: Array | float = 0.0

    @cached_property
    def by_force(self) -> Complex:
        """What one standard deviation of the force does, (n, c)."""
        return np.asarray(self.H * np.broadcast_to(self.force_error, self.hz.shape)[:, None])

    @property
    def std(self) -> Array:
        """Standard deviation of each of real and imaginary part, (n, c)."""
        return np.hypot(self.own_std, np.abs(self.by_force))

    def between(self, low: float, high: float) -> "FrequencyResponses":
        """Those in a band of frequencies."""
        kept = (self.hz >= low) & (self.hz <= high)
        force_error = np.broadcast_to(self.force_error, self.hz.shape)[kept]
        return FrequencyResponses(self.hz[kept], self.channels, self.H[kept], self.own_std[kept], force_error)


def frequency_responses(spectra: MeasuredSpectra, force: str, channels: Mapping[str, str]) -> FrequencyResponses:
    """Responses per force at every harmonic that the force excites, of all records.

    Parameters
    ----------
    spectra : MeasuredSpectra
        Stepped sines, sweeps or multisines at a low level.
    force : str
    channels : mapping of str to str
        Quantity of each response.

    Raises
    ------
    InputError
        If a channel was not measured.
    """
    U, U_std = spectra.complex(force), spectra.std[:, spectra.index(force)]
    there = np.array([excited_lines(u) for u in U])
    with np.errstate(invalid="ignore"):
        there &= U_std < SHARP * np.abs(U)
    i, k = np.nonzero(there)
    order = np.argsort(spectra.hz[i] * k, kind="stable")
    i, k = i[order], k[order]
    H, std = np.empty((len(i), len(channels)), dtype=complex), np.empty((len(i), len(channels)))
    for j, name in enumerate(channels):
        H[:, j] = spectra.complex(name)[i, k] / U[i, k]
        std[:, j] = spectra.std[i, spectra.index(name), k] / np.abs(U[i, k])
    return FrequencyResponses(spectra.hz[i] * k, dict(channels), H, std, U_std[i, k] / np.abs(U[i, k]))
