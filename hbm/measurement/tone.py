"""A tone that goes on while a motion decays, such as of mains or a pump: found where the motion has fallen."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hbm.fourier import Array

TAILS = 0.5, 0.25
"""Last parts of a recording in which a tone is looked for, the longest first."""

FEWEST, MOST = 20, 1500
"""Samples of such a part, at least; and at most, beyond which it is thinned to the lower frequencies, for the time
grows with the cube."""

CLEAR = 10.0
"""A tone stands out by so many standard deviations of its amplitude."""

STEADY, SURE = 0.03, 3.0
"""Its halves differ by this share at most, or by so many standard deviations."""

KNOWN = 0.3
"""That difference must be known to be less than this: a decay falls by more in so large a part of its recording."""


BEAT = 2.0 * np.pi
"""Tone and decay turn against each other by this in such a part: else a decay that bends is taken for both."""


class Tone(NamedTuple):
    """Frequency beside the one that amplitudes are turned to rest by [rad/s], and amplitude."""

    omega: float
    amplitude: float

    def said(self, hz: float) -> str:
        """What to do about it, where amplitudes are turned to rest by a frequency [Hz]."""
        return (
            f"has a steady tone at {hz + self.omega / (2.0 * np.pi):.4g} Hz, of {self.amplitude:.3g}: it counts as "
            "noise, and smaller amplitudes than ten times that are left out. Look for its source, such as mains"
        )

    def beside(self, t: Array, log: npt.NDArray[np.complex128]) -> npt.NDArray[np.complex128]:
        """What it adds to the logarithm of larger amplitudes at times (n,), its phase left to chance."""
        return np.asarray(self.amplitude * np.exp(1j * self.omega * t - log))


def steady_tone(t: Array, z: npt.NDArray[np.complex128]) -> Tone | None:
    """Tone beneath the complex amplitudes (n,) of a decay at even times [s], None where none is known.

    The last of them are two exponentials: what is left of the decay, and a tone that does not fall.
    """
    for part in TAILS:
        few = int(part * len(z))
        if few >= FEWEST and (tone := _in_tail(*_thinned(t[-few:] - t[-few], z[-few:]))) is not None:
            return tone
    return None


def _thinned(t: Array, z: npt.NDArray[np.complex128]) -> tuple[Array, npt.NDArray[np.complex128]]:
    from scipy.signal import resample_poly  # it takes long, and a decay that is read needs none

    every = -(-len(z) // MOST)
    return t[::every], z if every == 1 else resample_poly(z, 1, every)


def _in_tail(t: Array, z: npt.NDArray[np.complex128]) -> Tone | None:
    poles = _poles(z) / t[1]
    first = int(np.argmin(np.abs(poles.real)))
    omega, other = float(poles[first].imag), poles[1 - first]
    if abs(other.imag - omega) * t[-1] < BEAT:
        return None
    early = t < t[len(t) // 2]
    turning = np.exp(1j * omega * t)
    E = np.column_stack([turning * early, turning * ~early, np.exp(complex(min(other.real, 0.0), other.imag) * t)])
    a = np.linalg.lstsq(E, z, rcond=None)[0]
    variance = float(np.sum(np.abs(z - E @ a) ** 2)) / (len(z) - E.shape[1] - 2)
    std = np.sqrt(variance * np.diag(np.linalg.pinv(E.conj().T @ E)).real)[:2]
    size = np.abs(a[:2])
    if (size < CLEAR * std).any():
        return None
    changes, known_to = abs(np.log(size[0] / size[1])), SURE * float(np.hypot(*(std / size)))
    steady = changes <= max(STEADY, known_to) and changes + known_to <= KNOWN
    return Tone(omega, float(size.mean())) if steady else None


def _poles(z: npt.NDArray[np.complex128]) -> npt.NDArray[np.complex128]:
    """Two exponents per sample that describe a signal best.

    References
    ----------
    Y. Hua & T. Sarkar, Matrix pencil method, IEEE Trans. ASSP 38 (1990) 814-824.
    """
    rows = np.lib.stride_tricks.sliding_window_view(z, len(z) // 3)
    signal = np.linalg.svd(rows, full_matrices=False)[2][:2].T
    turned = np.linalg.eigvals(np.linalg.lstsq(signal[:-1], signal[1:], rcond=None)[0])
    return np.asarray(np.log(turned))
