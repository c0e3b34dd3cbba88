"""What harmonics above those measured may do at the contact: no sensor saw them, the prior says how large they may be.

A harmonic that meets a mode of the structure moves the contact many times as much as it otherwise would, and so makes
the friction that drives it: stick and slip at the frequency of the mode. That is no tail of a smooth loop. There
friction may be as large as if it jumped from the last harmonic measured on, and even harmonics as large as odd ones.
A contact that sticks for a part of the period stiffens the mode: the same holds up to the frequency it then has.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from hbm.fourier import Array
from hbm.inverse.contactforce import ForceEstimate, Indices, last_counted
from hbm.inverse.sensing import Complex, Sensing, dynamic_stiffness

AMPLIFIED = 25.0
"""A harmonic meets a mode that answers it so many times as much as a steady force: within 2 % of its frequency."""

SATURATED = 150.0
"""From here on the motion grows no more: friction opposes what it excites."""

HELD = 1.5
"""A harmonic meets a mode that the contact stiffens where friction is so many times what causes it, rms."""

RELEVANT = 0.1
"""Such a harmonic is told where it may be this share of the alternating part of a signal, rms."""

SIGNALS = {"normal": "reaction", "slip_velocity": "slip velocity"}
"""Signals that modes above those measured move most, as they are told."""


@dataclass(frozen=True, eq=False)
class Unseen:
    """Harmonics above those measured, of r records.

    Attributes
    ----------
    sensing : Sensing
    estimate : ForceEstimate
    """

    sensing: Sensing
    estimate: ForceEstimate

    @property
    def harmonics(self) -> Indices:
        """Those that count, (K,)."""
        H = self.sensing.H
        return np.arange(H + 1, last_counted(H) + 1)

    @cached_property
    def i_omega(self) -> Complex:
        """The factor i k Omega [rad/s], (r, K)."""
        return np.asarray(self.sensing.i_omega[:, 1:2] * self.harmonics)

    @cached_property
    def friction(self) -> Array:
        """Size of friction that is expected, (r, K) [N]."""
        expected, H = self.estimate.expected(self.harmonics), self.sensing.H
        last = self.estimate.expected(np.array([H, H + 1])).max(axis=1)  # an even and an odd one
        jumping = last[:, None] * H / self.harmonics * np.minimum(SATURATED / self.amplified, 1.0)
        return np.where(self.meets, np.maximum(expected, jumping) * np.maximum(self.held, 1.0), expected)

    @property
    def meets(self) -> npt.NDArray[np.bool_]:
        """Whether a harmonic meets a mode, (r, K)."""
        return np.asarray((self.amplified > AMPLIFIED) | (self.held > HELD))

    @cached_property
    def held(self) -> Array:
        """How many times what causes it friction is where the contact holds the motion, rms, (r, K).

        A contact of stiffness s c, the share s anything between 0 and 1, makes it 1 / (1 + s z) times as large, z being
        c times the slip per friction. The mean of the square over s is arg(1 + z) / Im z. c is that of the fundamental.
        """
        row = signal_rows(self.sensing, self.sensing.i_omega[:, 1:2])["slip"][:, 0]
        T, state = self.estimate.friction[:, 1], self.estimate
        slip = np.einsum("rj,rj->r", row, np.concatenate([np.stack([T, state.force[:, 1]], axis=1), state.q[:, 1]], 1))
        z = -(T / np.where(slip == 0.0, np.inf, slip))[:, None] * self.gains["slip"]
        z.imag[np.abs(z.imag) < 1e-12] = 1e-12  # the limit, where nothing is lost
        return np.minimum(np.sqrt(np.angle(1.0 + z) / z.imag), SATURATED)

    @property
    def amplified(self) -> Array:
        """How many times as much as a steady force the mode answers that is nearest, (r, K)."""
        return np.asarray(self._amplification.max(axis=2))

    @cached_property
    def _amplification(self) -> Array:
        s = self.sensing.structure
        return np.abs(s.omega_n**2 / dynamic_stiffness(s, self.i_omega))

    @cached_property
    def gains(self) -> dict[str, Complex]:
        """Each signal per friction, (r, K)."""
        pushes = self.sensing.structure.slip_row / dynamic_stiffness(self.sensing.structure, self.i_omega)
        one = np.ones((*self.i_omega.shape, 1))
        per_friction = np.concatenate([one, np.zeros_like(one), pushes], axis=2)
        rows = signal_rows(self.sensing, self.i_omega)
        return {name: np.einsum("rkj,rkj->rk", row, per_friction) for name, row in rows.items()}

    @cached_property
    def std(self) -> dict[str, Array]:
        """Standard deviation of each signal, (r,)."""
        return {name: np.linalg.norm(gain * self.friction, axis=1) for name, gain in self.gains.items()}

    @cached_property
    def energy(self) -> Array:
        """Root of the mean square of the energy that friction takes, of random phases [J], (r,).

        Of harmonic k it is pi k |T|^2 Im(u / T): what it does to its own slip goes to the body, always.
        """
        power = 2.0 * np.pi * self.harmonics * self.friction**2  # pi k times the mean of |T|^2
        taken = power * self.gains["slip"].imag
        return np.asarray(np.sqrt(taken.sum(axis=1) ** 2 + np.sum(taken**2, axis=1)))

    def warnings(self, samples: Mapping[str, Array], slips: npt.NDArray[np.bool_]) -> list[str]:
        """A line about a harmonic that meets a mode, where it matters.

        Parameters
        ----------
        samples : mapping of str to (r, N) array
            Signals at the contact.
        slips : (r,) bool array
        """
        share = {name: self._share(name, samples[name]) * slips[:, None] for name in SIGNALS}
        most = np.max(list(share.values()), axis=0)
        records = int(np.count_nonzero(most.max(axis=1) > RELEVANT))
        if not records:
            return []
        r, i = np.unravel_index(int(most.argmax()), most.shape)
        mode, s, spectra = int(self._amplification[r, i].argmax()), self.sensing.structure, self.sensing.spectra
        k, said = int(self.harmonics[i]), [f"{100 * share[n][r, i]:.0f} % of the {SIGNALS[n]}" for n in SIGNALS]
        at = f"at {s.omega_n[mode] / (2 * np.pi):.4g} Hz"
        stiffened = "" if self.amplified[r, i] > AMPLIFIED else ", as the contact stiffens it"
        beside = f", the like in {records} of {len(most)} records" if records > 1 else ""
        return [
            f"record {spectra.labels[r]}: harmonic {k}, {k * spectra.hz[r]:.4g} Hz, was not measured and meets mode "
            f"{mode + 1} {at}{stiffened}: it may be {' and '.join(said)}, rms{beside}; "
            f"measure harmonics up to {self._last(most)}"
        ]

    def _share(self, name: str, samples: Array) -> Array:
        """Size of harmonics that meet a mode beside the alternating part of a signal, (r, K)."""
        size = np.abs(self.gains[name]) * self.friction / np.maximum(samples.std(axis=1), np.finfo(float).tiny)[:, None]
        return np.where(self.meets, size, 0.0)

    def _last(self, share: Array) -> int:
        """The last harmonic that matters in any record."""
        return int(self.harmonics[np.flatnonzero((share > RELEVANT).any(axis=0)).max()])


def signal_rows(sensing: Sensing, i_omega: Complex) -> dict[str, Complex]:
    """Signals as linear forms of (friction, force, q) at i k Omega (r, K), products left out, (r, K, 2 + n)."""
    s = sensing.structure
    one, reaction = np.ones(i_omega.shape), s.reaction

    def row(friction: float, force: float, q: Complex | Array) -> Complex:
        head = np.stack([friction * one, force * one], axis=2)
        return np.concatenate([head, np.broadcast_to(q, (*i_omega.shape, s.n))], axis=2).astype(complex)

    inertia = i_omega[..., None] ** 2 * reaction.inertia + i_omega[..., None] * reaction.damping + reaction.stiffness
    slip = row(s.compliance, s.residual.slip_by_force, s.slip_row)
    return {
        "friction": row(1.0, 0.0, np.zeros(s.n)),
        "slip": slip,
        "slip_velocity": i_omega[..., None] * slip,
        "normal": row(-reaction.friction_lever, -reaction.force_share, inertia),
        "modal_slip": row(0.0, s.residual.slip_by_force, s.slip_row),
        "rho": row(0.0, -reaction.force_share, inertia),
        "eta": row(0.0, 0.0, reaction.stretch),
    }
