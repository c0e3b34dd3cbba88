"""Periodic multisines: how much even, odd and noise content a response has, before any model.

A multisine that excites some odd harmonics only shows nonlinearity where it excites nothing: a response at even
harmonics comes from an even nonlinearity, at the odd harmonics left out (detection lines) from an odd one. What the
force itself has on these lines goes through the linear structure and is taken off to first order, by the frequency
response at the excited lines beside. Noise is what periods differ by, of the response and of the force that was taken
off.

References
----------
R. Pintelon, J. Schoukens, System identification, a frequency domain approach, 2nd ed. (2012), section 4.3; first-order
correction: J. Schoukens, J. Lataire, R. Pintelon, G. Vandersteen, IEEE Trans. Instrum. Meas. 58 (2009) 1393-1402.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hbm.errors import InputError
from hbm.measurement.spectra import MeasuredSpectra

NEAR = 8
"""Harmonics to each side among which an excited one is looked for."""

EXCITED = 0.3
"""A line is excited whose force is more than this part of the largest of those near it,"""

IN_BAND = 0.05
"""and more than this part of the largest of all."""

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Content:
    """What one channel of a record is made of within the band excited; levels as rms of a line, in the channel's unit.

    Attributes
    ----------
    record, channel : str
    excited, even, odd, noise : float
        Rms over the lines of each kind; nan where there are none, or the record does not tell. Noise is that of the
        lines not excited, where of a response the force was taken off: even and odd content are noise where no larger.
    lines : (int, int, int)
        Number of excited, even and odd detection lines.
    """

    record: str
    channel: str
    excited: float
    even: float
    odd: float
    noise: float
    lines: tuple[int, int, int]

    def db(self, kind: str) -> float:
        """Level of ``even``, ``odd`` or ``noise`` below the excited lines [dB]."""
        level = getattr(self, kind) / self.excited
        return 20.0 * math.log10(level) if level else -math.inf


def contents(spectra: MeasuredSpectra, force: str) -> list[Content]:
    """Even, odd and noise content of every response in every record of a multisine.

    Errors of the force and of a response are taken to be independent; those that the shaker makes, which the structure
    follows, are taken off with the force, and noise is then less than is stated.

    Parameters
    ----------
    spectra : MeasuredSpectra
        Standard deviations are those of the mean of the periods: noise is what is left of it in the mean.
    force : str
        The channel that excites.

    Returns
    -------
    list of Content
        The force itself too, uncorrected.

    Raises
    ------
    InputError
        If the force was not measured, or a record is no multisine that leaves harmonics out.
    """
    found = []
    U = spectra.complex(force)
    for i, name in enumerate(map(str, spectra.labels)):
        excited = excited_lines(U[i])
        if excited.sum() < 3:
            raise InputError(
                f"{spectra.source}: record {name}: {excited.sum()} harmonics of {force} are excited; must be 3 or more"
            )
        k = np.arange(len(excited))
        first, last = k[excited][[0, -1]]
        band = (k >= first) & (k <= last) & ~excited
        if not band.any():
            raise InputError(f"{spectra.source}: record {name}: {force} excites every harmonic; must leave some out")
        for channel in spectra.channels:
            Y, std = spectra.complex(channel)[i], spectra.std[i, spectra.index(channel)]
            if channel != force:
                G = _through(U[i], Y, excited)
                Y = np.where(excited, Y, Y - G * U[i])
                std = np.hypot(std, np.abs(G) * spectra.std[i, spectra.index(force)])
            kinds = excited, band & (k % 2 == 0), band & (k % 2 == 1)
            lit, even, odd = (_rms(Y[mask]) for mask in kinds)
            a, b, c = (int(np.isfinite(Y[mask]).sum()) for mask in kinds)
            noise = float(np.sqrt(np.nanmean(std[band] ** 2)))  # of cos and of sin: that is the rms of a line
            found.append(Content(name, channel, lit, even, odd, noise, (a, b, c)))
    return found


def excited_lines(U: npt.NDArray[np.complex128]) -> Mask:
    """Which harmonics a force excites, (H+1,)."""
    size = np.nan_to_num(np.abs(U))
    size[0] = 0.0
    padded = np.pad(size, NEAR)
    around = np.max([padded[i : i + len(size)] for i in range(2 * NEAR + 1)], axis=0)
    return np.asarray((size > EXCITED * around) & (size > IN_BAND * size.max()))


def _through(U: npt.NDArray[np.complex128], Y: npt.NDArray[np.complex128], excited: Mask) -> npt.NDArray[np.complex128]:
    """Frequency response at every harmonic, between those at the excited ones."""
    k = np.arange(len(U))
    there = excited & np.isfinite(Y)
    G = Y[there] / U[there]
    return np.asarray(np.interp(k, k[there], G.real) + 1j * np.interp(k, k[there], G.imag))


def _rms(lines: npt.NDArray[np.complex128]) -> float:
    """Rms value of the average line."""
    power = np.abs(lines[np.isfinite(lines)]) ** 2 / 2.0
    return float(np.sqrt(power.mean())) if len(power) else float("nan")
