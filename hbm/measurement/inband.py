"""Whether measured frequencies are those of the structure: or thousands of times lower, as in kHz, or in rad/s."""

import warnings
from collections.abc import Sequence

import numpy as np

from hbm.channels import DERIVATIVES
from hbm.fourier import MANY, Array
from hbm.measurement.responses import Complex
from hbm.measurement.spectra import MeasuredSpectra
from models.jointed import AnyRig
from models.jointedstructure import JointedStructure
from models.parts import Channel
from models.plausible import PlausibilityWarning

FAR = 20.0
"""Frequencies so many times below the first mode are doubted; a structure is measured so where nothing resonates."""

KHZ, BESIDE = 1e3, 2.0
"""They are likely in kHz where they then lie among the modes, but for this factor on either side."""

ALIKE, OTHER, SENSORS = 0.98, 0.9, 3
"""Modal assurance criteria from which motions are alike, and up to which they are others, of so many sensors."""


def warn_far_below(rig: AnyRig, spectra: MeasuredSpectra) -> None:
    """Warn of frequencies that all lie far below the first elastic mode of a rig; of multisines their highest lines.

    Warns
    -----
    models.plausible.PlausibilityWarning
    """
    omega = rig.structure.omega_n
    modes = omega[omega > 0.0] / (2.0 * np.pi)
    low, high = float(spectra.hz.min()), float(spectra.hz.max())
    highest = high * spectra.H if spectra.H > MANY else high
    if not len(modes) or FAR * highest > modes.min():
        return
    below = (
        f"{spectra.source}: frequency_hz = {low:.4g} to {high:.4g} Hz, {modes.min() / high:.2g} times below the first "
        f"mode of the rig; usual are frequencies about its modes, from {modes.min():.4g} Hz on"
    )
    meant = modes.min() / BESIDE < KHZ * high and KHZ * low < BESIDE * modes.max()
    advice = f"are they meant in kHz ({KHZ * low:.4g} to {KHZ * high:.4g} Hz)?" if meant else "check their unit"
    warnings.warn(f"{below}; {advice}", PlausibilityWarning, stacklevel=3)


def warn_in_radians(rig: AnyRig, spectra: MeasuredSpectra) -> None:
    """Warn of frequencies in rad/s, of records or rig: sensors then move beside each other as was measured.

    That depends on the frequency, and hardly on joints, damping, units or the force.

    Warns
    -----
    models.plausible.PlausibilityWarning
    """
    sensors = [c for c in rig.response_channels if c.name in spectra.channels]
    if len(sensors) < SENSORS:
        return
    measured = np.column_stack([spectra.complex(c.name)[:, 1] for c in sensors])
    turn = 2.0 * np.pi
    as_they_are, of_records, of_rig = (
        _assurance(measured, _answer(rig, sensors, hz, modes))
        for hz, modes in ((spectra.hz, 1.0), (spectra.hz / turn, 1.0), (spectra.hz, 1.0 / turn))
    )
    if as_they_are > OTHER or max(of_records, of_rig) < ALIKE:
        return
    low, high = float(spectra.hz.min()), float(spectra.hz.max())
    if of_records > of_rig:
        said = (
            f"frequency_hz = {low:.4g} to {high:.4g}: the rig moves so at {low / turn:.4g} to {high / turn:.4g} Hz; "
            "are they in rad/s?"
        )
    else:
        said = (
            f"the rig moves as was measured at {low:.4g} to {high:.4g} Hz if its modes are 2 pi times lower; are "
            "their frequencies in rad/s?"
        )
    warnings.warn(f"{spectra.source}: {said}", PlausibilityWarning, stacklevel=3)


def _answer(rig: AnyRig, sensors: Sequence[Channel], hz: Array, modes: float) -> Complex:
    """What the structure without its joints answers in sensors, its natural frequencies times a factor, (R, c)."""
    s, names = rig.structure, [c.name for c in rig.response_channels]
    if isinstance(s, JointedStructure):
        at, damping = s.channels[[names.index(c.name) for c in sensors]], s.damping.diagonal()
    else:
        at, damping = np.array([s.channel_rows[c.name] for c in sensors]), s.damping
    w = 2.0 * np.pi * hz[:, None]
    moved = s.excitation / ((modes * s.omega_n) ** 2 - w**2 + 1j * w * modes * damping)
    return np.asarray((moved @ at.T) * (1j * w) ** np.array([DERIVATIVES[c.quantity] for c in sensors]))


def _assurance(measured: Complex, answer: Complex) -> float:
    """Modal assurance criterion between two motions (R, c) of the sensors, its median over records."""
    known = np.isfinite(measured)
    measured, answer = np.where(known, measured, 0.0), np.where(known, answer, 0.0)
    across = np.abs(np.sum(answer.conj() * measured, axis=1)) ** 2
    size = np.sum(np.abs(answer) ** 2, axis=1) * np.sum(np.abs(measured) ** 2, axis=1)
    return float(np.median(np.divide(across, size, out=np.ones_like(size), where=size > 0.0)))
