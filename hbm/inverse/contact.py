"""All signals at the contact from the friction force: slip, reaction, energy, and their uncertainty."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.special import erf

from hbm.fourier import Array
from hbm.inverse.contactforce import (
    ForceEstimate,
    element_forces,
    product,
    to_amplitudes,
    to_samples,
)
from hbm.inverse.reconstruction import Estimates, LawInputs
from hbm.inverse.sensing import Complex, Sensing
from hbm.inverse.unseen import Unseen, signal_rows

SAMPLES = 256
"""Samples per period, at least."""

SHOWN = ("friction", "modal_slip", "rho", "eta")
"""Friction, and what laws that are to make it are shown."""

NEARLY, SETTLED = 0.1, 0.9
"""Friction is near its limit within this share of it; means are settled where that is so for this share of a stroke."""


@dataclass(frozen=True, eq=False)
class Contact:
    """Signals at the contact of r records, harmonics 0..H, N samples.

    Attributes
    ----------
    sensing : Sensing
    estimate : ForceEstimate
    rows : dict of str to (r, H+1, 2 + n) complex array
        Each signal as a linear form of (friction, force, q), products left out.
    amplitudes : dict of str to (r, H+1) complex array
        `friction`, `slip`, `slip_velocity`, `normal`, and what laws are shown: `modal_slip`, `rho`, `eta`.
    samples : dict of str to (r, N) array
    """

    sensing: Sensing
    estimate: ForceEstimate
    rows: dict[str, Complex]
    amplitudes: dict[str, Complex]
    samples: dict[str, Array]

    @property
    def load(self) -> float:
        """Static normal load [N]."""
        return float(self.sensing.rig.contact.normal_load)

    # ---- uncertainty

    def _deviations(self, name: str) -> Complex:
        """Deviations of a signal's harmonics, (r, H+1, m), see :attr:`ForceEstimate.factor`."""
        return np.asarray(np.einsum("rkj,rkjm->rkm", self.rows[name], self.estimate.factor))

    def std(self, name: str) -> Array:
        """Standard deviation of each cosine and sine of a signal by noise, (r, H+1)."""
        return np.asarray(np.linalg.norm(self._deviations(name), axis=2))

    def mean_std(self, name: str, slips: npt.NDArray[np.bool_]) -> Array:
        """Standard deviation of a signal's mean, (r,).

        The mean friction of a contact that slips comes from the force at two instants, see
        :func:`hbm.inverse.reconstruct.reconstruct`, and holds as far as it then slides. One that sticks may keep any
        mean that friction bears: what else follows from it is as uncertain as that is.
        """
        at_once = np.sqrt(np.sum(self.std("friction")[:, 1:] ** 2, axis=1) + self.unseen.std["friction"] ** 2)
        found = np.hypot(at_once / np.sqrt(2.0), self._unsettled)
        mean = np.where(slips, found, self._kept(slips))
        return np.asarray(np.abs(self.rows[name][:, 0] @ self._static) * mean)

    def _kept(self, slips: npt.NDArray[np.bool_]) -> Array:
        """Standard deviation of the mean friction where the contact sticks, (r,) [N].

        As large as friction itself, but no more than what is left to the limits that the records which slip reach,
        evenly.
        """
        T, R = self.samples["friction"], np.maximum(self.samples["normal"], 0.0)
        size = T.std(axis=1)
        if not slips.any():
            return np.asarray(size)
        limit = np.max((np.abs(T) / np.maximum(R, 0.02 * self.load))[slips]) * R
        most, least = np.min(limit - T, axis=1), np.max(-limit - T, axis=1)  # of a mean
        return np.asarray(np.minimum(size, np.maximum(np.maximum(most, -least), 0.0) / np.sqrt(3.0)))

    @cached_property
    def _unsettled(self) -> Array:
        """Standard deviation of the mean friction where it does not slide all the way, (r,) [N].

        A part of the contact that sticks has no part in the limits, whose equality tells the mean. The mean is then
        anywhere between none and that, evenly; it is settled where most of each stroke is near the limit.
        """
        T, R, u = (self.samples[name] for name in ("friction", "normal", "slip"))
        stroke = np.roll(u, -1, axis=1) - u
        against = -(np.roll(T, -1, axis=1) + T) / np.maximum(np.roll(R, -1, axis=1) + R, 0.02 * self.load)
        shares = []
        limits = [np.where(way * stroke > 0.0, way * against, -np.inf).max(axis=1, keepdims=True) for way in (1, -1)]
        for way, limit in zip((1, -1), limits, strict=True):
            moving = np.where(way * stroke > 0.0, np.abs(stroke), 0.0)
            near = way * against >= limit - NEARLY * (limits[0] + limits[1]) / 2
            shares.append(np.sum(moving * near, axis=1) / np.sum(moving, axis=1))
        missing = np.maximum(1.0 - np.minimum(*shares) / SETTLED, 0.0)
        return np.asarray(np.abs(self.amplitudes["friction"][:, 0].real) * missing / np.sqrt(3.0))

    @property
    def _static(self) -> Array:
        """Static change of (friction, force, q) per mean friction, (2 + n,)."""
        s = self.sensing.structure
        return np.concatenate([[1.0, 0.0], s.slip_row / s.omega_n**2])

    @cached_property
    def unseen(self) -> Unseen:
        """Harmonics above those measured."""
        return Unseen(self.sensing, self.estimate)

    # ---- energy

    @cached_property
    def energy(self) -> Estimates:
        """Energy that friction takes per period, - Int T du [J].

        It is what the excitation brings less what damping takes, and varies like that: as an area, most of what changes
        in T and u cancels, down to the terms that the linear deviations leave out.
        """
        s, state = self.sensing.structure, self.estimate
        T, u, F = self.amplitudes["friction"], self.amplitudes["slip"], state.force
        k = np.arange(T.shape[1])
        drive = state.q @ s.excitation + s.residual.slip_by_force * T + s.residual.drive_by_force * F
        by_force = s.residual.drive_by_force * F.conj() - drive.conj()
        head = np.stack([s.residual.slip_by_force * F.conj(), by_force], axis=2)
        damped = 2j * self.sensing.i_omega[..., None].imag * s.damping * state.q.conj()
        weights = np.concatenate([head, F.conj()[..., None] * s.excitation + damped], axis=2)
        change = np.einsum("k,rkj,rkjm->rkm", np.pi * k, weights, state.factor)
        lost = np.pi * np.sum(k * (T.conj() * u).imag, axis=1)
        return Estimates(lost, np.hypot(np.linalg.norm(change, axis=(1, 2)), self._energy_of_errors), "J")

    @property
    def _energy_of_errors(self) -> Array:
        """Root of the mean square of the energy that errors of friction take from those of slip [J], (r,).

        Of harmonic k it is pi k Im(dT* du), a quadratic form of normal numbers: most where friction is hardly known.
        """
        T, u = self._deviations("friction"), self._deviations("slip")
        k = np.pi * np.arange(T.shape[1])
        both = np.einsum("rkm,rkm->rk", T.conj(), u)
        sizes = np.linalg.norm(T, axis=2) * np.linalg.norm(u, axis=2)
        mean = np.sum(2.0 * k * both.imag, axis=1)
        variance = np.sum(2.0 * k**2 * (sizes**2 - (both**2).real), axis=1)
        return np.asarray(np.sqrt(mean**2 + np.maximum(variance, 0.0)))

    @cached_property
    def work_rate(self) -> Estimates:
        """Wear work rate, the mean of R |v| (26) [W]."""
        R, v = np.maximum(self.samples["normal"], 0.0), self.samples["slip_velocity"]
        H = self.sensing.H
        by_R, by_v = to_amplitudes(np.abs(v), H).conj(), to_amplitudes(R * np.sign(v), H).conj()
        by_R[:, 1:] /= 2
        by_v[:, 1:] /= 2
        change = by_R[..., None] * self._deviations("normal") + by_v[..., None] * self._deviations("slip_velocity")
        return Estimates((R * np.abs(v)).mean(axis=1), np.linalg.norm(change, axis=(1, 2)), "W")

    @property
    def work_unseen(self) -> Array:
        """Root of the mean square of what harmonics above those measured do to the work rate [W], (r,).

        They turn the velocity where it is small, and so add to |v| there whatever their phases: E|v + d| of a normal
        d is |v| and more. To first order they act through the harmonics of R sign(v), smoothed alike, and of |v|.
        """
        unseen, k = self.unseen, self.unseen.harmonics
        R, v = np.maximum(self.samples["normal"], 0.0), self.samples["slip_velocity"]
        size = np.maximum(unseen.std["slip_velocity"], 1e-100)[:, None]  # 0 where none is expected
        sign = erf(v / (np.sqrt(2.0) * size))
        more = v * sign + size * np.sqrt(2.0 / np.pi) * np.exp(-((v / size) ** 2) / 2.0) - np.abs(v)
        by_v, by_R = (to_amplitudes(s, k[-1])[:, k].conj() / 2.0 for s in (R * sign, np.abs(v)))
        change = (by_v * unseen.gains["slip_velocity"] + by_R * unseen.gains["normal"]) * unseen.friction
        return np.asarray(np.hypot(np.linalg.norm(change, axis=1), (R * more).mean(axis=1)))

    # ---- for friction laws

    def law_inputs(self, other: "Contact", slips: npt.NDArray[np.bool_]) -> LawInputs:
        """Signals that a friction law is shown; `other` has a mean friction that is a standard deviation larger."""
        factor = np.stack([self._deviations(name) for name in SHOWN], axis=2)
        moved = np.stack([other.amplitudes[name] - self.amplitudes[name] for name in SHOWN], axis=2)
        u, rho, eta = (self.amplitudes[name] for name in SHOWN[1:])
        return LawInputs(u, rho, eta, factor, np.where(slips[:, None, None], 0.0, moved))


def contact_of(sensing: Sensing, estimate: ForceEstimate) -> Contact:
    """Signals at the contact that follow from force and motion; docs/theory/equations.md section 2."""
    s, H = sensing.structure, sensing.H
    N = max(SAMPLES, 1 << int(np.ceil(np.log2(8 * H))))
    state = np.concatenate([np.stack([estimate.friction, estimate.force], axis=2), estimate.q], axis=2)
    rows = signal_rows(sensing, sensing.i_omega)
    amplitudes = {name: np.einsum("rkj,rkj->rk", row, state) for name, row in rows.items()}
    if s.shortening.any():
        drawn_in = product(estimate.q, estimate.q @ s.shortening).sum(axis=2) / 2
        for name in ("slip", "modal_slip"):
            amplitudes[name] -= drawn_in
        amplitudes["slip_velocity"] -= sensing.i_omega * drawn_in
    amplitudes["rho"] -= element_forces(sensing, estimate.q)[..., -1]
    amplitudes["rho"][:, 0] += sensing.rig.contact.normal_load
    amplitudes["eta"][:, 0] -= s.reaction.friction_lever
    samples = {name: to_samples(c, N) for name, c in amplitudes.items()}
    samples["normal"] = samples["rho"] + samples["eta"] * samples["friction"]
    amplitudes["normal"] = to_amplitudes(samples["normal"], H)
    return Contact(sensing, estimate, rows, amplitudes, samples)
