"""Whether measured frequencies are those of the structure: or thousands of times lower, as in kHz, or in rad/s."""

import warnings

import numpy as np

from hbm.channels import DERIVATIVES
from hbm.fourier import Array
from hbm.measurement.spectra import MeasuredSpectra
from models.jointed import AnyRig, JointedStructure
from models.plausible import PlausibilityWarning

FAR = 20.0
"""Frequencies so many times below the first mode are doubted; a structure is measured so where nothing resonates."""

KHZ, BESIDE = 1e3, 2.0
"""They are likely in kHz where they then lie among the modes, but for this factor on either side."""

ALIKE, OTHER, ENOUGH = 0.3, 1.0, 6
"""Medians of logarithms of ratios up to which responses are alike, and from which they are others, of so many."""


def warn_far_below(rig: AnyRig, spectra: MeasuredSpectra) -> None:
    """Warn of frequencies that all lie far below the first elastic mode of a rig.

    Warns
    -----
    models.plausible.PlausibilityWarning
    """
    omega = rig.structure.omega_n
    modes = omega[omega > 0.0] / (2.0 * np.pi)
    low, high = float(spectra.hz.min()), float(spectra.hz.max())
    if not len(modes) or FAR * high > modes.min():
        return
    below = (
        f"{spectra.source}: frequency_hz = {low:.4g} to {high:.4g} Hz, {modes.min() / high:.2g} times below the first "
        f"mode of the rig; usual are frequencies about its modes, from {modes.min():.4g} Hz on"
    )
    meant = modes.min() / BESIDE < KHZ * high and KHZ * low < BESIDE * modes.max()
    advice = f"are they meant in kHz ({KHZ * low:.4g} to {KHZ * high:.4g} Hz)?" if meant else "check their unit"
    warnings.warn(f"{below}; {advice}", PlausibilityWarning, stacklevel=3)


def warn_in_radians(rig: AnyRig, spectra: MeasuredSpectra) -> None:
    """Warn of frequencies in rad/s, of the records or of the rig: without its joints it then answers as was measured.

    Warns
    -----
    models.plausible.PlausibilityWarning
    """
    measured = _measured(rig, spectra)
    turn = 2.0 * np.pi
    as_they_are, of_records, of_rig = (
        _apart(measured, _answer(rig, spectra, factor, power))
        for factor, power in ((1.0, 0), (1.0 / turn, 0), (turn, 2))
    )
    if as_they_are < OTHER or min(of_records, of_rig) > ALIKE:
        return
    low, high = float(spectra.hz.min()), float(spectra.hz.max())
    if of_records < of_rig:
        said = (
            f"frequency_hz = {low:.4g} to {high:.4g}: the rig answers so at {low / turn:.4g} to {high / turn:.4g} Hz; "
            "are they in rad/s?"
        )
    else:
        said = (
            f"the rig answers as was measured at {low:.4g} to {high:.4g} Hz if its modes are 2 pi times lower; are "
            "their frequencies in rad/s?"
        )
    warnings.warn(f"{spectra.source}: {said}", PlausibilityWarning, stacklevel=3)


def _measured(rig: AnyRig, spectra: MeasuredSpectra) -> Array:
    """Fundamentals of the sensors over the force, (R, c); over its level where it was not measured."""
    force = rig.force_among(spectra.channels)
    by = spectra.level if force is None else np.abs(spectra.complex(force)[:, 1])
    sensors = [c.name for c in rig.response_channels if c.name in spectra.channels]
    found = np.array([np.abs(spectra.complex(name)[:, 1]) for name in sensors]).reshape(len(sensors), -1).T
    return np.asarray(found / by[:, None])


def _answer(rig: AnyRig, spectra: MeasuredSpectra, factor: float, power: int) -> Array:
    """What the structure without its joints answers in the sensors at frequencies times a factor, per force (R, c).

    A power of 2 is for modes that are divided by the factor in place of frequencies that are multiplied by it.
    """
    s, names = rig.structure, [c.name for c in rig.response_channels]
    sensors = [c for c in rig.response_channels if c.name in spectra.channels]
    if isinstance(s, JointedStructure):
        at, damping = s.channels[[names.index(c.name) for c in sensors]], s.damping.diagonal()
    else:
        at, damping = np.array([s.channel_rows[c.name] for c in sensors]).reshape(-1, s.n), s.damping
    w = 2.0 * np.pi * factor * spectra.hz[:, None]
    moved = np.abs((s.excitation / (s.omega_n**2 - w**2 + 1j * w * damping)) @ at.T)
    order = np.array([DERIVATIVES[c.quantity] for c in sensors])
    return np.asarray(moved * w**order * factor ** np.maximum(power - order, 0))


def _apart(measured: Array, answer: Array) -> float:
    """Median of the logarithm of how far they are apart; infinite of few numbers."""
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.abs(np.log(measured / answer))
    logs = logs[np.isfinite(logs)]
    return float(np.median(logs)) if len(logs) >= ENOUGH else np.inf
