"""Inverse harmonic balance of a rig with joints: the forces at all ports and the motion there, no law assumed.

Beside its joints a body is linear: harmonic by harmonic its channels read the joint forces and the excitation through
receptances, and weighted least squares turn that round. As many forces can be found as there are sensors; which
harmonics tell them apart, the standard deviations say.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import stats

from hbm.channels import factor
from hbm.errors import InputError
from hbm.fourier import Array, FourierBasis, coefficients_of
from hbm.inverse.reconstruction import EstimatedSignal
from hbm.measurement.spectra import MeasuredSpectra
from models.jointed import JointedRig, JointedStructure

Complex = npt.NDArray[np.complex128]

SAMPLES = 256
"""Per period, of the signals returned."""

KNOWN = 1e-9
"""Standard deviation of a force that is nominal, as a fraction of the largest."""

TOLD_APART = 1e-10
"""Forces are told apart where the least singular value of what sensors read of them exceeds this of the largest."""


class Receptances(NamedTuple):
    """Motion at response channels and joints per force at joints and drive, at one frequency [m/N]."""

    channels_by_joints: Complex
    channels_by_force: Complex
    joints_by_joints: Complex
    joints_by_force: Complex


def receptances(s: JointedStructure, omega: float) -> Receptances:
    """Receptances of a body at `omega` [rad/s], > 0."""
    dynamic = np.diag(s.omega_n**2 - omega**2) + 1j * omega * s.damping
    through = np.linalg.solve(dynamic, np.column_stack([s.joints.T, s.excitation]))
    by_joints, by_force = through[:, :-1], through[:, -1]
    return Receptances(
        np.asarray(s.channels @ by_joints + s.channels_by_joints, dtype=complex),
        np.asarray(s.channels @ by_force + s.channels_by_force, dtype=complex),
        np.asarray(s.joints @ by_joints + s.flexibility, dtype=complex),
        np.asarray(s.joints @ by_force + s.flexibility_to_force, dtype=complex),
    )


@dataclass(frozen=True, eq=False)
class JointReconstruction:
    """Forces and motions at the ports of all joints, record by record.

    Attributes
    ----------
    rig : JointedRig
    spectra : MeasuredSpectra
    signals : mapping of str to EstimatedSignal
        By the names that solutions give them, ``tip.force``, ``tip.motion``; without their means, which no
        accelerometer sees. Where sensors do not tell the forces of a harmonic apart it is nan.
    chi2, freedom : (r,) array
        Squared residuals in units of standard deviations, and how many noise alone leaves on the mean.
    """

    rig: JointedRig
    spectra: MeasuredSpectra
    signals: Mapping[str, EstimatedSignal]
    chi2: Array
    freedom: Array

    def __getitem__(self, name: str) -> EstimatedSignal:
        """Signal by name."""
        return self.signals[name]

    @property
    def probability(self) -> Array:
        """Probability that noise alone makes so large a misfit, (r,); 1 where no sensors are left over."""
        return np.where(self.freedom > 0, stats.chi2.sf(self.chi2, np.maximum(self.freedom, 1)), 1.0)

    def __repr__(self) -> str:
        """How large each force was found, and how sure that is."""
        lines = [f"joint forces of {self.rig.name}, {len(self.spectra)} records, peak ± standard deviation there:"]
        for name in self.rig.forces:
            s = self.signals[name]
            peak = np.abs(s.samples)
            r, i = np.unravel_index(int(np.nanargmax(peak)), peak.shape)
            lines.append(f"  {name:24s} {peak[r, i]:.4g} ± {s.std[r, i]:.2g} {s.unit}")
        return "\n".join(lines)


def reconstruct_joints(rig: JointedRig, spectra: MeasuredSpectra) -> JointReconstruction:
    """Forces and motions at the joints of a rig, from its channels; the laws of the joints are not used.

    Parameters
    ----------
    rig : JointedRig
    spectra : MeasuredSpectra
        Spectra of response channels and, if measured, the force; else the force is the nominal cosine of its level.

    Raises
    ------
    InputError
        If there are more ports than response channels measured.
    """
    measured = [c for c in rig.response_channels if c.name in spectra.channels]
    if len(measured) < rig.ports:
        raise InputError(
            f"reconstruct_joints: {len(measured)} response channels measured and {rig.ports} joint forces unknown; "
            "must be at least as many channels"
        )
    r, H, m = len(spectra), spectra.H, rig.ports
    force, force_std = _force(rig, spectra)
    seen = [[c.name for c in rig.response_channels].index(c.name) for c in measured]
    y = np.stack([spectra.complex(c.name) for c in measured], axis=1)
    std = np.stack([spectra.std[:, spectra.index(c.name)] for c in measured], axis=1)
    f, u = (np.full((r, H + 1, m), np.nan, dtype=complex) for _ in range(2))
    f_std, u_std = (np.full((r, H + 1, m), np.nan) for _ in range(2))
    chi2, freedom = np.zeros(r), np.zeros(r)
    for i in range(r):
        for k in range(1, H + 1):
            omega = 2 * np.pi * k * float(spectra.hz[i])
            known = np.isfinite(y[i, :, k]) & np.isfinite(std[i, :, k])
            if np.count_nonzero(known) < m:
                continue
            read = np.array([factor(c, np.array(1j * omega)) for c in measured])[known]
            on = receptances(rig.structure, omega)
            rows = [place for place, there in zip(seen, known, strict=True) if there]
            # the force is an unknown too, and what was measured of it one more reading
            G = np.column_stack([on.channels_by_joints[rows], on.channels_by_force[rows]]) * read[:, None]
            A = np.vstack([G / std[i, known, k][:, None], np.eye(m + 1)[-1:] / force_std[i, k]])
            b = np.append(y[i, known, k] / std[i, known, k], force[i, k] / force_std[i, k])
            scale = np.linalg.norm(A, axis=0)
            values = np.linalg.svd(A[:-1, :-1] / np.linalg.norm(A[:-1, :-1], axis=0), compute_uv=False)
            if values[-1] < TOLD_APART * values[0]:
                continue
            inverse = np.linalg.pinv(A / scale) / scale[:, None]
            found = inverse @ b
            to_motion = np.column_stack([on.joints_by_joints, on.joints_by_force])
            f[i, k], u[i, k] = found[:-1], to_motion @ found
            f_std[i, k] = np.linalg.norm(inverse[:-1], axis=1)  # of each of cosine and sine
            u_std[i, k] = np.linalg.norm(to_motion @ inverse, axis=1)
            chi2[i] += float(np.sum(np.abs(A @ found - b) ** 2))
            freedom[i] += 2 * (len(b) - m - 1)
    signals = {}
    for j, (name, motion, units) in enumerate(zip(rig.forces, rig.motions, rig.units, strict=True)):
        signals[name] = _signal(units[1], f[..., j], f_std[..., j])
        signals[motion] = _signal(units[0], u[..., j], u_std[..., j])
    return JointReconstruction(rig, spectra, signals, chi2, freedom)


def _force(rig: JointedRig, spectra: MeasuredSpectra) -> tuple[Complex, Array]:
    """Complex coefficients of the excitation and the standard deviations of cosine and sine, (r, H+1) each."""
    name = next((c.name for c in rig.channels if c.quantity == "force" and c.name in spectra.channels), None)
    if name is None:
        nominal = np.zeros((len(spectra), spectra.H + 1), dtype=complex)
        for k, cosine, sine in rig.excitation.tones:
            if k <= spectra.H:
                nominal[:, k] = spectra.level * (cosine - 1j * sine)
        return nominal, np.full(nominal.shape, KNOWN * float(np.abs(nominal).max()))
    found, std = spectra.complex(name), spectra.std[:, spectra.index(name)]
    known = np.isfinite(std)
    return np.where(known, found, 0.0), np.where(known, std, KNOWN * float(np.nanmax(np.abs(found))))


def _signal(unit: str, values: Complex, std: Array) -> EstimatedSignal:
    """A signal of its harmonics; those that were not found are left out of its samples."""
    basis = FourierBasis(values.shape[1] - 1, SAMPLES)
    coefficients = coefficients_of(values)
    samples = np.nan_to_num(coefficients) @ basis.synthesis.T
    spread = np.sqrt(np.sum(np.nan_to_num(std) ** 2, axis=1))[:, None] * np.ones(SAMPLES)
    return EstimatedSignal(unit, coefficients, std, samples, spread)
