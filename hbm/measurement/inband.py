"""Whether measured frequencies lie where the structure has its modes, or thousands of times below, as in kHz."""

import warnings

import numpy as np

from hbm.measurement.spectra import MeasuredSpectra
from models.jointed import AnyRig
from models.plausible import PlausibilityWarning

FAR = 20.0
"""Frequencies so many times below the first mode are doubted; a structure is measured so where nothing resonates."""

KHZ, BESIDE = 1e3, 2.0
"""They are likely in kHz where they then lie among the modes, but for this factor on either side."""


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
