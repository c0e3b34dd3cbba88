"""Whether a small error of the rig file explains the sensors as well as a fault of one of them does."""

from dataclasses import replace

import numpy as np
from scipy import optimize

from hbm.fourier import Array
from hbm.inverse.readings import Readings, readings
from hbm.inverse.sensing import sensing
from models.beam import Beam
from models.rig import Rig

WITHIN = 0.1
"""Properties of the rig file are off by this share at most."""

EVALUATIONS = 8
"""Steps of the fit, each of which linearises anew."""

PROPERTIES = ("youngs_modulus", "density", "length", "thickness", "excitation position", "mass_proportional")


def structure_score(rig: Rig, base: Readings) -> float:
    """Bayesian information criterion of a structure whose properties are fitted, all sensors being right.

    Parameters
    ----------
    rig : Rig
    base : Readings
        By the properties of the rig file.

    Returns
    -------
    float
        With the price of one parameter, since one is wrong more often than all are; inf where the structure is given
        by its modes.
    """
    if not isinstance(rig.body, Beam):
        return float("inf")

    def misfit(off: Array) -> Array:
        seen = sensing(_changed(rig, off), base.seen.spectra)
        trial = readings(seen, base.coupling) if seen.structure.n == base.seen.structure.n else base
        residual = trial.residual.ravel()
        return np.concatenate([residual.real, residual.imag])

    start = np.zeros(len(PROPERTIES))
    found = optimize.least_squares(misfit, start, bounds=(-WITHIN, WITHIN), x_scale=1e-3, max_nfev=EVALUATIONS)
    return float(2.0 * found.cost + np.log(base.total))


def _changed(rig: Rig, off: Array) -> Rig:
    """The rig with its properties off by these shares; sensors stay where they are."""
    body = rig.body
    assert isinstance(body, Beam)
    E, density, length, thickness, place, alpha = (1.0 + off).tolist()
    return replace(
        rig,
        body=replace(
            body,
            youngs_modulus=E * body.youngs_modulus,
            density=density * body.density,
            length=max(length * body.length, *(c.position for c in rig.channels)),
            thickness=thickness * body.thickness,
        ),
        excitation=replace(rig.excitation, position=min(place * rig.excitation.position, length * body.length)),
        damping=replace(rig.damping, mass_proportional=alpha * rig.damping.mass_proportional),
    )
