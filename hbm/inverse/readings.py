"""Innovations of sensors: the reading of each channel less what all others predict for it.

Friction and force are free at every harmonic here, without a prior, so that nothing is assumed of the contact: with c
channels, the force among them, c - 2 complex numbers per record and harmonic are left to contradict the structure, less
one number per record for the mean friction: no sensor sees it, but it stiffens the beam (foreshortening).
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import special

from hbm.fourier import Array
from hbm.inverse.reconstruction import CONSISTENT
from hbm.inverse.sensing import Complex, Sensing
from models.parts import Channel

FREE = 1e4
"""Friction may be this many times the load or the level: no prior, but harmonics that no sensor sees stay finite."""

EXACT = 1e-4
"""A force harmonic that is taken as zero is zero to this share of the level."""


HALF = 0.5

EVEN = 0.25
"""Standard deviations are wrong alike where groups of readings scatter alike to this share, beyond chance."""


def by_noise(chi2: float, dof: float) -> bool:
    """Whether noise alone explains a misfit."""
    return bool(special.chdtrc(max(dof, 1e-9), chi2) > CONSISTENT)


def even(chi2: Array, dof: Array) -> bool:
    """Whether groups scatter alike, beyond chance and `EVEN`."""
    seen = dof > 1.0
    overall = chi2[seen].sum() / dof[seen].sum()
    spread = np.abs(chi2[seen] / dof[seen] / overall - 1.0)
    return bool(np.all(spread < EVEN + 3.5 * np.sqrt(2.0 / dof[seen])))


@dataclass(frozen=True, eq=False)
class Coupling:
    """Forces on the modes that friction and motion make together, of r records at harmonics 0..H.

    Attributes
    ----------
    forces : (r, H+1, n) complex array
        Of alternating friction on the deflected structure, and of nonlinear elements.
    by_mean : (r, H+1, n) complex array
        Per mean friction.
    mean : (r,) array
        What the mean friction may be, its standard deviation around none [N].
    """

    forces: Complex
    by_mean: Complex
    mean: Array


@dataclass(frozen=True, eq=False)
class Others:
    """Friction and force by all channels but one: r records, harmonics 1..H.

    Attributes
    ----------
    state : (r, H, 4) complex array
        Friction and force [N], 1 for what is known, and the mean friction of the record [N].
    covariance : (r, H, 2, 2) complex array
    chi2, dof : float
        Misfit of the others among themselves, and its expectation by noise.
    """

    state: Complex
    covariance: Complex
    chi2: float
    dof: float

    @property
    def reduced(self) -> float:
        """Misfit per degree of freedom, nan without any."""
        return self.chi2 / self.dof if self.dof > HALF else float("nan")

    @property
    def excess(self) -> float:
        """Misfit beyond noise."""
        return self.chi2 - self.dof

    @property
    def agree(self) -> bool:
        """Whether noise alone explains the misfit."""
        return by_noise(self.chi2, self.dof)


@dataclass(frozen=True, eq=False)
class Readings:
    """Channels in units of their standard deviations, r records, harmonics 1..H, c channels; the force comes last.

    Attributes
    ----------
    seen : Sensing
    coupling : Coupling
        Which the channels see besides.
    channels : tuple of str, (c,)
    read : (r, H, c) complex array
        0 where not measured.
    rows : (r, H, c, 4) complex array
        Reading per friction, per force, by the coupling, and per mean friction.
    weight : (r, H, c) array
        1 / std, 0 where not measured.
    stated : Sensing
        With standard deviations as they are stated, where `seen` trusts the sensors less.
    """

    seen: Sensing
    coupling: Coupling
    channels: tuple[str, ...]
    read: Complex
    rows: Complex
    weight: Array
    stated: Sensing

    @property
    def k_Omega(self) -> Array:
        """Circular frequency of the harmonics, (r, H) [rad/s]."""
        return np.asarray(self.seen.i_omega[:, 1:].imag)

    @cached_property
    def _free(self) -> Complex:
        """Inverse covariance that keeps unseen friction finite, (2, 2)."""
        size = FREE * max(self.seen.rig.contact.normal_load, float(self.seen.spectra.level.max()))
        return np.diag([size**-2.0, size**-2.0]).astype(complex)

    @cached_property
    def everyone(self) -> Others:
        """Friction and force by all channels together."""
        return self.others(())

    @cached_property
    def as_stated(self) -> Others:
        """The same, sensors trusted as their standard deviations state."""
        return self.everyone if self.stated is self.seen else readings(self.stated, self.coupling).everyone

    @cached_property
    def leverage(self) -> Array:
        """Share of each reading that the fit follows, (r, H, c)."""
        A = self.rows[..., :2]
        return np.asarray(np.einsum("rkci,rkij,rkcj->rkc", A, self.everyone.covariance, A.conj()).real)

    @cached_property
    def residual(self) -> Complex:
        """Read less explained by all channels together, (r, H, c)."""
        return np.asarray(self.read - np.einsum("rkcs,rks->rkc", self.rows, self.everyone.state))

    def count(self, channel: str) -> int:
        """Numbers that a channel read, cosines and sines."""
        return 2 * int(np.count_nonzero(self.weight[:, :, self.channels.index(channel)]))

    @cached_property
    def total(self) -> int:
        """Numbers that all channels read."""
        return sum(self.count(name) for name in self.channels)

    def others(self, without: tuple[str, ...]) -> Others:
        """Friction and force by all channels but those named."""
        keep = [i for i, name in enumerate(self.channels) if name not in without]
        A, known = self.rows[:, :, keep, :2], self.rows[:, :, keep, 2]
        left = self.read[:, :, keep] - known
        A_h = A.conj().swapaxes(2, 3)
        covariance = _inverse(A_h @ A + self._free)
        state = (covariance @ (A_h @ left[..., None]))[..., 0]
        error = left - (A @ state[..., None])[..., 0]
        leverage = np.einsum("rkci,rkij,rkcj->rkc", A, covariance, A.conj()).real
        measured = self.weight[:, :, keep] > 0.0
        by_mean = self.rows[:, :, keep, 3]
        follows = (covariance @ (A_h @ by_mean[..., None]))[..., 0]
        seen = by_mean - (A @ follows[..., None])[..., 0]  # of a mean, beyond what friction and force make of it
        told, power = (
            self.coupling.mean * np.sum((seen.conj() * other).real, axis=(1, 2))
            for other in (error, self.coupling.mean[:, None, None] * seen)
        )
        share = told / (1.0 + power)  # of what the mean may be
        mean = (self.coupling.mean * share)[:, None, None] * np.ones((*state.shape[:2], 1))
        return Others(
            state=np.concatenate([state - mean * follows, np.ones_like(mean), mean], axis=2),
            covariance=covariance,
            chi2=float(np.sum(np.abs(error - mean * seen) ** 2) + np.sum(share**2)),
            dof=float(np.sum(2.0 * (measured - leverage)) - np.sum(power / (1.0 + power))),
        )

    def against(self, channel: str, others: Others) -> tuple[Complex, Array]:
        """Reading of a channel less what the others predict, and the variance of that, (r, H)."""
        j = self.channels.index(channel)
        rows = self.rows[:, :, j]
        unsure = np.einsum("rki,rkij,rkj->rk", rows[..., :2], others.covariance, rows[..., :2].conj()).real
        return self.read[:, :, j] - np.einsum("rks,rks->rk", rows, others.state), 1.0 + unsure

    def innovation(self, channel: str, rows: Complex, others: Others) -> Array:
        """Misfit that a channel with `rows` (m, r, H, 4) adds to that of the others, (m,)."""
        read = self.read[:, :, self.channels.index(channel)]
        error = read - np.einsum("mrks,rks->mrk", rows, others.state)
        A = rows[..., :2]
        unsure = np.einsum("mrki,rkij,mrkj->mrk", A, others.covariance, A.conj()).real
        return np.asarray(np.sum(np.abs(error) ** 2 / (1.0 + unsure), axis=(1, 2)))

    def rows_at(self, channel: str, positions: Array) -> Complex:
        """Rows that a channel has at other positions (m,) of a beam, (m, r, H, 4)."""
        s = self.seen
        quantity = next(c.quantity for c in s.rig.channels if c.name == channel)
        tried = tuple(Channel(f"x{i}", quantity, float(x)) for i, x in enumerate(positions))
        moved = replace(s, rig=replace(s.rig, channels=tried), channels=tuple(c.name for c in tried))
        weight = self.weight[:, :, self.channels.index(channel)]
        return np.moveaxis(_rows(moved, self.coupling), 2, 0) * weight[..., None]


def readings(seen: Sensing, coupling: Coupling, stated: Sensing | None = None) -> Readings:
    """Readings of all channels beside the forces of friction on the deflected structure.

    Parameters
    ----------
    seen : Sensing
    coupling : Coupling
    stated : Sensing, optional
        With standard deviations as stated, where those of `seen` are others.
    """
    force = np.zeros((*seen.force.shape, 1, 4))
    force[..., 0, 1] = 1.0
    std = np.maximum(seen.force_std, EXACT * seen.spectra.level[:, None])
    weight = np.concatenate([seen.weight, 1.0 / std[..., None]], axis=2)[:, 1:]
    rows = np.concatenate([_rows(seen, coupling), force[:, 1:]], axis=2)
    read = np.concatenate([seen.measured, seen.force[..., None]], axis=2)[:, 1:]
    name = next((c.name for c in seen.rig.channels if c.quantity == "force"), "force")
    names = (*seen.channels, name)
    return Readings(seen, coupling, names, weight * read, weight[..., None] * rows, weight, stated or seen)


def _rows(seen: Sensing, coupling: Coupling) -> Complex:
    """Responses per friction, per force, by the coupling, and per mean friction, at harmonics 1..H, (r, H, c, 4)."""
    beside = [seen.by_modal_forces(forces) for forces in (coupling.forces, coupling.by_mean)]
    return np.stack([seen.by_friction, seen.by_force, *beside], axis=3)[:, 1:]


def _inverse(N: Complex) -> Complex:
    """Inverses of Hermitian 2 x 2 matrices whose columns differ in scale."""
    scale = 1.0 / np.sqrt(np.einsum("...ii->...i", N).real)
    both = scale[..., :, None] * scale[..., None, :]
    return np.asarray(both * np.linalg.inv(both * N))
