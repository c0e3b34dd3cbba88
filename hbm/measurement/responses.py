"""Frequency responses per force, and those of all records of spectra at a low level."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from hbm.errors import InputError
from hbm.fourier import Array
from hbm.measurement.multisine import excited_lines
from hbm.measurement.repeatability import typical_size
from hbm.measurement.spectra import MeasuredSpectra
from models.parts import UNITS

Complex = npt.NDArray[np.complex128]

QUANTITIES = {unit: quantity for quantity, unit in UNITS.items() if quantity != "force"}
"""What units of motion are of."""

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
    sized : bool
        Whether the standard deviations are known; else only how they compare.
    warnings : tuple of str
        What speaks against what was recorded, one sentence each.
    """

    hz: Array
    channels: Mapping[str, str]
    H: Complex
    own_std: Array
    force_error: Array | float = 0.0
    sized: bool = True
    warnings: tuple[str, ...] = ()

    def felt(self, responses: Complex) -> Complex:
        """What one standard deviation of the force does to responses (n, c)."""
        return np.asarray(responses * np.broadcast_to(self.force_error, self.hz.shape)[:, None])

    @property
    def std(self) -> Array:
        """Standard deviation of each of real and imaginary part, (n, c)."""
        return np.hypot(self.own_std, np.abs(self.felt(self.H)))

    def expect_drive(self, name: str | None) -> None:
        """Refuse a channel at the drive that is not there.

        Raises
        ------
        InputError
            With those that are.
        """
        if name is not None and name not in self.channels:
            raise InputError(f"modal: --drive = {name}; must be one of {', '.join(self.channels)}")

    def between(self, low: float, high: float) -> "FrequencyResponses":
        """Those in a band of frequencies."""
        kept = (self.hz >= low) & (self.hz <= high)
        force_error = np.broadcast_to(self.force_error, self.hz.shape)[kept]
        return replace(self, hz=self.hz[kept], H=self.H[kept], own_std=self.own_std[kept], force_error=force_error)

    def unrepeatable(self, share: float) -> "FrequencyResponses":
        """The same where a share of each response does not repeat from one mounting to the next, beside the noise."""
        if not share:
            return self
        beside = share / np.sqrt(2.0) * typical_size(np.abs(self.H))
        return replace(self, own_std=np.hypot(self.own_std, beside) if self.sized else beside, sized=True)


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
