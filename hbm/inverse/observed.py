"""Reconstructed records as friction laws are judged by them.

A law answers a slip with a force that has more harmonics than were measured, and those move the contact in turn. That
motion was not measured, but the structure tells it: modal slip, rho and eta at harmonics above H are linear in the
force there. The law is therefore shown the measured signals up to H, and above H those that its own force causes.
The mean friction is treated alike: accelerometers do not see it, but it bends the loaded beam, and the reconstruction
had to assume one.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hbm.fourier import Array, FourierBasis
from hbm.inverse.contactforce import nonlinear_forces, regularised
from hbm.inverse.reconstruction import Reconstruction
from hbm.inverse.sensing import Complex, Sensing, dynamic_stiffness, sensing
from models.structure import ModalStructure

ABOVE = 48
"""Harmonics above those measured at which a law's own motion is worked out."""

SAMPLES = 1024
"""Samples per period at which a law is evaluated, at least."""

SLIP_FLOOR = 2e-5
"""Numerical floor of each coefficient of slip, as a fraction of the largest harmonic: products cut off at H."""

COUPLED = 1e-12
MOST_ITERATIONS = 60


@dataclass(frozen=True, eq=False)
class ObservedRecord:
    """One record; coefficients on the basis of :class:`Observed`, zero where not measured.

    Attributes
    ----------
    number : int
    name : str
        As in the file.
    level, hz : float
        Nominal force [N] and frequency [Hz].
    slips : bool
    friction : (2H+1,) array
        Reconstructed force; its mean is what the reconstruction assumed [N].
    signals : (2H+1, 3) array
        u, rho, eta.
    gains : (3, H+1) complex array
        u, rho, eta per friction force, at harmonics that were not measured; else zero.
    by_mean : (2H+1,) array
        Change of the reconstructed force with the mean friction that is assumed.
    noise : (4, 2H+1, m) array
        Deviations of (T, u, rho, eta) by m independent numbers of unit variance.
    numerical : int
        How many of these, the last ones, are no noise but a floor for what numerics leave.
    informed : float
        How many of the coefficients the sensors decide, not the prior of the reconstruction.
    """

    number: int
    name: str
    level: float
    hz: float
    slips: bool
    friction: Array
    signals: Array
    gains: Complex
    by_mean: Array
    noise: Array
    numerical: int
    informed: float

    @property
    def Omega(self) -> float:
        """Fundamental frequency [rad/s]."""
        return 2 * np.pi * self.hz


@dataclass(frozen=True, eq=False)
class Observed:
    """Reconstructed records, and what a law is told besides their signals.

    Attributes
    ----------
    records : tuple of ObservedRecord
    measured : int
        Highest harmonic measured.
    basis : FourierBasis
        With more harmonics than were measured.
    compliance, load : float
        Series compliance [m/N] and static normal load [N].
    """

    records: tuple[ObservedRecord, ...]
    measured: int
    basis: FourierBasis
    compliance: float
    load: float

    @property
    def compared(self) -> npt.NDArray[np.intp]:
        """Coefficients that are compared: cosines and sines of the harmonics 1..H measured."""
        k = np.arange(1, self.measured + 1)
        return np.concatenate([k, self.basis.H + k])

    def of(self, keep: npt.NDArray[np.bool_]) -> "Observed":
        """Some of the records."""
        chosen = tuple(r for r, kept in zip(self.records, keep, strict=True) if kept)
        return Observed(chosen, self.measured, self.basis, self.compliance, self.load)


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of the structure in each record; r records, harmonics 0..H, n modes."""

    sensing: Sensing
    q: Complex


def motion_of(reconstruction: Reconstruction) -> Motion:
    """Modal coordinates under the reconstructed friction and the measured excitation."""
    seen, friction = sensing(reconstruction.rig, reconstruction.spectra), reconstruction["friction"].complex
    if seen.rig.elements:  # under forces that hold the motion more than friction does, the turns below run away
        return Motion(seen, regularised(seen, friction[:, 0].real).q)
    s = seen.structure
    linear = np.stack([friction, seen.force], axis=2) @ np.stack([s.slip_row, s.excitation])
    q = linear / seen.stiffness
    for _ in range(MOST_ITERATIONS):
        before, q = q, (linear + nonlinear_forces(seen, friction, q)) / seen.stiffness
        if np.abs(q - before).max() <= COUPLED * np.abs(q).max():
            break
    return Motion(seen, q)


def observe(reconstruction: Reconstruction) -> Observed:
    """Records of a reconstruction, ready to be compared with laws."""
    H = reconstruction.H
    wide = H + ABOVE
    basis = FourierBasis(wide, max(SAMPLES, 1 << int(np.ceil(np.log2(12 * wide)))))
    by_mean, informed = _by_mean(reconstruction), _informed(reconstruction)
    records = tuple(_record(reconstruction, i, basis, by_mean[i], informed[i]) for i in range(len(reconstruction)))
    contact = reconstruction.rig.contact
    return Observed(records, H, basis, reconstruction.rig.structure.compliance, contact.normal_load)


def _record(r: Reconstruction, i: int, basis: FourierBasis, by_mean: Complex, informed: float) -> ObservedRecord:
    shown, slips = r.law_inputs, bool(r.slips[i])
    return ObservedRecord(
        number=int(r.spectra.records[i]),
        name=r.spectra.label(int(r.spectra.records[i])),
        level=float(r.spectra.level[i]),
        hz=float(r.spectra.hz[i]),
        slips=slips,
        friction=_wide(r["friction"].complex[i], basis),
        signals=np.stack([_wide(s[i], basis) for s in (shown.u, shown.rho, shown.eta)], axis=1),
        gains=_gains(r.rig.structure, 2 * np.pi * float(r.spectra.hz[i]), basis.H, r.H, slips),
        by_mean=_wide(by_mean if slips else np.zeros_like(by_mean), basis),
        noise=_noise(shown.factor[i] * r.widening[i], shown.by_kept[i], shown.u[i], basis),
        numerical=2 * r.H,
        informed=informed,
    )


def _wide(amplitudes: Complex, basis: FourierBasis) -> Array:
    """Coefficients of amplitudes 0..H, zero above."""
    out = np.zeros(basis.H + 1, dtype=complex)
    out[: len(amplitudes)] = amplitudes
    return basis.real(out)


def _noise(factor: Complex, by_kept: Complex, u: Complex, basis: FourierBasis) -> Array:
    """Deviations of coefficients (4, 2H+1, m) of complex ones (H+1, 4, m), by a mean (H+1, 4), and the floor of u."""
    measured, _, m = factor.shape
    k, H = np.arange(measured), basis.H
    out = np.zeros((4, basis.size, measured, 2, m))
    by_signal = factor.transpose(1, 0, 2)
    out[:, k, k, 0], out[:, k, k, 1] = by_signal.real, -by_signal.imag
    out[:, H + k[1:], k[1:], 0], out[:, H + k[1:], k[1:], 1] = -by_signal.imag[:, 1:], -by_signal.real[:, 1:]
    turning = np.concatenate([k[1:], H + k[1:]])
    floor = np.zeros((4, basis.size, len(turning)))
    floor[1, turning, np.arange(len(turning))] = SLIP_FLOOR * np.abs(u[1:]).max()
    kept = np.array([_wide(moved, basis) for moved in by_kept.T])[..., None]
    return np.concatenate([out.reshape(4, basis.size, -1), kept, floor], axis=2)


def _gains(s: ModalStructure, Omega: float, wide: int, measured: int, slips: bool) -> Complex:
    """u, rho, eta per friction force at harmonics 0 and above those measured, (3, wide+1).

    A contact that never slips answers with no harmonics of its own, and its mean is for its history to decide.
    """
    gains = np.zeros((3, wide + 1), dtype=complex)
    if not slips:
        return gains
    k = np.arange(wide + 1)
    unmeasured = (k == 0) | (k > measured)
    i_omega = np.asarray(1j * Omega * k, dtype=np.complex128)
    q = s.slip_row / dynamic_stiffness(s, i_omega)
    gains[0] = q @ s.slip_row
    gains[1] = i_omega**2 * (q @ s.reaction.inertia) + i_omega * (q @ s.reaction.damping)
    gains[2] = q @ s.reaction.stretch
    return np.where(unmeasured, gains, 0.0)


def _informed(r: Reconstruction) -> Array:
    """Number of coefficients of friction that the sensors decide, (records,)."""
    return np.asarray(2.0 * np.sum(_share(r)[:, 1:], axis=1))


def _share(r: Reconstruction) -> Array:
    """Share of the sensors in each harmonic of friction, the rest is the prior's, (records, H+1)."""
    std = np.linalg.norm(r.law_inputs.factor[:, :, 0], axis=2)
    return np.asarray(np.minimum((std / r.resolution) ** 2, 1.0))


def _by_mean(r: Reconstruction) -> Complex:
    """Change of the reconstructed harmonics with the mean friction that was assumed, (records, H+1).

    The sensors hold the motion; the force that explains it changes by what the mean friction does on the deflected
    beam, -T G q.
    """
    motion = motion_of(r)
    seen = motion.sensing
    unexplained = seen.weight * seen.by_modal_forces(-motion.q @ seen.structure.shortening)
    columns = seen.weight[..., None] * np.stack([seen.by_friction, seen.by_force], axis=3)
    normal = np.einsum("rkci,rkcj->rkij", columns.conj(), columns)
    known = seen.force_std > 0.0
    normal[..., 1, 1] += np.where(known, 1.0 / np.where(known, seen.force_std, 1.0) ** 2, np.inf)
    normal[~known] = np.where(np.eye(2, dtype=bool), normal[~known], 0.0)  # the force is exact: no unknown
    normal[..., 0, 0] = np.where(normal[..., 0, 0] == 0.0, 1.0, normal[..., 0, 0])
    normal[..., 1, 1] = np.where(np.isfinite(normal[..., 1, 1]), normal[..., 1, 1], 1.0)
    right = np.einsum("rkci,rkc->rki", columns.conj(), unexplained)
    right[..., 1] = np.where(known, right[..., 1], 0.0)
    change = -np.linalg.solve(normal, right[..., None])[..., 0, 0] * _share(r)
    change[:, 0] = 0.0
    return np.asarray(change)
