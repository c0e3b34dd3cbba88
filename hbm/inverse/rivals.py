"""Whether a small error of the rig file explains the sensors as well as a fault of one of them does."""

from dataclasses import replace

import numpy as np

from hbm.fourier import Array
from hbm.inverse.readings import Readings, readings
from hbm.inverse.sensing import Complex, sensing
from models.change import structure_change
from models.rig import Rig, beam_of

WITHIN = 0.1
"""Properties of the rig file are off by this share at most."""

INSIDE = 0.999
"""Share of the length that the excitation is tried within: at the tip, which is held, it moves nothing."""

EVALUATIONS = 8
"""Steps of the fit, each of which linearises anew."""

PROPERTIES = (
    "beam.youngs_modulus",
    "beam.density",
    "beam.length",
    "beam.thickness",
    "excitation.position",
    "damping.mass_proportional",
)


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
    from scipy.optimize import least_squares

    if rig.beam is None:
        return float("inf")

    def at(off: Array) -> Readings:
        seen = sensing(_changed(rig, off), base.seen.spectra)
        return readings(seen, base.coupling) if seen.structure.n == base.seen.structure.n else base

    def misfit(off: Array) -> Array:
        return _parts(at(off).residual[..., None])[:, 0]

    def slope(off: Array) -> Array:
        return _parts(_residual_change(at(off)) * nominal)

    nominal = np.array([rig.number(key) for key in PROPERTIES])
    start = np.zeros(len(PROPERTIES))
    bounds = (-WITHIN, WITHIN)
    found = least_squares(misfit, start, slope, bounds=bounds, x_scale=1e-3, max_nfev=EVALUATIONS)
    return float(2.0 * found.cost + np.log(base.total))


def _parts(values: Complex) -> Array:
    """Real and imaginary parts of (r, H, c, p), in rows, (2 r H c, p)."""
    flat = values.reshape(-1, values.shape[-1])
    return np.concatenate([flat.real, flat.imag])


def _residual_change(at: Readings) -> Complex:
    """Derivatives (r, H, c, p) of the residual to the properties, as the fit of friction and force follows.

    Variable projection has two parts. The one that vanishes with the residual is left out (Kaufman 1975).
    """
    seen, s = at.seen, at.seen.structure
    change, (T, F, *_) = structure_change(seen.rig, PROPERTIES), np.moveaxis(at.everyone.state, 2, 0)
    i_omega, stiffness = seen.i_omega[:, 1:, None], seen.stiffness[:, 1:]
    q = (T[..., None] * s.slip_row + F[..., None] * s.excitation + at.coupling.forces[:, 1:]) / stiffness
    names = [channel.name for channel in seen.rig.response_channels]
    places = [2 + names.index(name) for name in seen.channels]
    columns = []
    for p in range(len(PROPERTIES)):
        resisting = (
            q @ change.stiffness[p].T + i_omega**2 * (q @ change.mass[p].T) + i_omega * (q @ change.damping[p].T)
        )
        slip, drive = change.rows[p, :2]
        moved = (T[..., None] * slip + F[..., None] * drive - resisting) / stiffness
        static = np.stack([T, F], axis=2) @ change.flexibility[p, places].T
        columns.append(seen.factor[:, 1:] * (moved @ seen.rows.T + q @ change.rows[p, places].T + static))
    read = np.zeros((*at.read.shape, len(PROPERTIES)), dtype=complex)
    read[:, :, :-1] = -at.weight[:, :, :-1, None] * np.stack(columns, axis=3)  # the force channel stays
    A = at.rows[..., :2]
    return np.asarray(read - A @ (at.everyone.covariance @ (A.conj().swapaxes(2, 3) @ read)))


def _changed(rig: Rig, off: Array) -> Rig:
    """The rig with its properties off by these shares; sensors stay where they are."""
    body = beam_of(rig)
    E, density, longer, thickness, place, alpha = (1.0 + off).tolist()
    length = max(longer * body.length, *(c.position for c in rig.channels))
    return replace(
        rig,
        body=replace(
            body,
            youngs_modulus=E * body.youngs_modulus,
            density=density * body.density,
            length=length,
            thickness=thickness * body.thickness,
        ),
        excitation=replace(rig.excitation, position=min(place * rig.excitation.position, INSIDE * length)),
        damping=replace(rig.damping, mass_proportional=alpha * rig.damping.mass_proportional),
    )
