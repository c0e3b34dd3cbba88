"""Measured records of a rig of either kind, with where Newton's method starts: on the branch they were measured on."""

from concurrent.futures import Executor
from dataclasses import replace

import numpy as np

from hbm.channels import factor
from hbm.errors import InputError
from hbm.fourier import Array
from hbm.inverse.reconstruct import reconstruct_likeliest
from hbm.inverse.sensing import Complex, Readings, readings, sensing
from hbm.measurement.spectra import MeasuredSpectra
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.numerics import Numerics, choose
from hbm.outputerror.records import Measurement, expect_fundamental, measurement_of, turned
from models.jointed import AnyRig, JointedRig

FOLLOWED = 10.0
"""Standard deviation of the force that may be missing on each mode to make it follow its sensors, in units of what the
excitation does to the mode it drives most."""


def campaign_of(
    rig: AnyRig, spectra: MeasuredSpectra, numerics: Numerics | None = None, executor: Executor | None = None
) -> tuple[Campaign, tuple[str, ...]]:
    """Records of spectra, with the discretisation that resolves them; and what the sensors say of each other.

    Raises
    ------
    InputError
        If no response was measured.
    """
    rig, data, warnings = measured(rig, spectra)
    if not any(r.listed.any() for r in data.records):
        raise InputError(f"{spectra.source}: no harmonic of any response was measured; must have one")
    numerics = choose(rig, data, executor) if numerics is None else numerics
    return Campaign(data, numerics, executor=executor), warnings


def measured(rig: AnyRig, spectra: MeasuredSpectra) -> tuple[AnyRig, Measurement, tuple[str, ...]]:
    """Records of spectra, the rig with as many modes as they need, and what the sensors say of each other.

    Raises
    ------
    InputError
        If no response was measured, or the force without its fundamental.
    """
    if isinstance(rig, JointedRig):
        return rig, _of_joints(rig, readings(rig, spectra)), ()
    seen, _ = reconstruct_likeliest(rig, spectra)
    data = measurement_of(seen, sensing(seen.rig, spectra))
    return seen.rig, replace(data, other_unit=bool(seen.unit)), seen.warnings


def _of_joints(rig: JointedRig, seen: Readings) -> Measurement:
    expect_fundamental(rig, seen)
    q = _motion(rig, seen)
    none = np.zeros((seen.H + 1, 0), dtype=complex)
    records = tuple(turned(seen, q[i], none, i) for i in range(len(q)))
    size = np.abs(seen.measured) * (seen.weight > 0.0)
    loudest = np.sqrt(np.mean(size**2, axis=(0, 1)))
    return Measurement(records, seen.channels, seen.H, _rms(size / np.where(loudest > 0.0, loudest, 1.0)))


def _rms(size: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(size**2, axis=(1, 2))))


def _motion(rig: JointedRig, seen: Readings) -> Complex:
    """Modal amplitudes (r, H+1, n): the linear response, and what missing forces on the modes add to it.

    These are the least that make the channels read what was measured; beside them stands the stated noise.
    """
    s, named = rig.structure, {c.name: c for c in rig.channels}
    rows = s.channels[[[c.name for c in rig.response_channels].index(name) for name in seen.channels]]
    out = np.zeros((*seen.i_omega.shape, s.n), dtype=complex)
    level = np.abs(seen.force[:, 1:2]) + np.where(seen.force[:, 1:2] == 0.0, seen.spectra.level[:, None], 0.0)
    for i, k in np.ndindex(*seen.i_omega.shape):
        rate, listed = seen.i_omega[i, k], seen.weight[i, k] > 0.0
        if k == 0:
            continue
        through = np.linalg.inv(np.diag(s.omega_n**2 + rate**2) + rate * s.damping)
        force = seen.force[i, k] if seen.force[i].any() else float(level[i, 0]) * (k == 1)
        q = through @ s.excitation * force
        if listed.any():
            factors = np.array([factor(named[name], np.array(rate)) for name in seen.channels])[listed]
            reading, weight = factors[:, None] * rows[listed], seen.weight[i, k, listed]
            scale = FOLLOWED * float(level[i, 0]) * float(np.abs(s.excitation).max())
            A = weight[:, None] * (reading @ through) * scale
            left = weight * (seen.measured[i, k, listed] - reading @ q)
            missing = np.linalg.lstsq(np.vstack([A, np.eye(s.n)]), np.append(left, np.zeros(s.n)), rcond=None)[0]
            q = q + through @ missing * scale
        out[i, k] = q
    return out
