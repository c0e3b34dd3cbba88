"""Responses of the sensors of a rig to friction and force, harmonic by harmonic.

:func:`sensing` puts measured spectra beside the linear structure: complex amplitudes, weights, and receptances of all
records at once. Everything here is linear; the product of friction and motion (foreshortening) enters as one more
excitation of the modes.
"""

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from hbm.channels import factor
from hbm.errors import InputError
from hbm.fourier import Array
from hbm.measurement.spectra import MeasuredSpectra
from models.jointed import AnyRig
from models.rig import Rig
from models.structure import ModalStructure

Complex = npt.NDArray[np.complex128]

STATIC_FROM = 5.0
"""Modes are kept up to this many times the highest frequency measured; those above answer statically."""

MOST_MODES = 30

UNKNOWN_FORCE = 10.0
"""Without a force channel the fundamental is unknown, within this many times the nominal level."""


@dataclass(frozen=True, eq=False)
class Readings:
    """What was measured of a rig; r records, harmonics 0..H, c channels.

    Attributes
    ----------
    spectra : MeasuredSpectra
    channels : tuple of str, (c,)
        Response channels measured.
    i_omega : (r, H+1) complex array
        i k Omega [rad/s].
    measured : (r, H+1, c) complex array
        Amplitudes, 0 where not measured.
    weight : (r, H+1, c) array
        1 / std, 0 where not measured; harmonic 0 is not used.
    force, force_std : (r, H+1) complex array and array
        Measured excitation and its standard deviation, of each of cos and sin [N].
    """

    spectra: MeasuredSpectra
    channels: tuple[str, ...]
    i_omega: Complex
    measured: Complex
    weight: Array
    force: Complex
    force_std: Array

    @property
    def H(self) -> int:
        """Highest harmonic."""
        return int(self.i_omega.shape[1]) - 1


@dataclass(frozen=True, eq=False, kw_only=True)
class Sensing(Readings):
    """Measured spectra and the linear structure they were measured on; n modes.

    Attributes
    ----------
    rig : Rig
        With as many modes as the highest harmonic needs.
    stiffness : (r, H+1, n) complex array
        Modal dynamic stiffness, omega_n^2 - (k Omega)^2 + i k Omega d [1/s2].
    """

    rig: Rig
    stiffness: Complex

    @property
    def structure(self) -> ModalStructure:
        """The linear structure."""
        return self.rig.structure

    @cached_property
    def rows(self) -> Array:
        """Mode shapes at the channels, (c, n)."""
        return np.array([self.structure.channel_rows[name] for name in self.channels])

    @cached_property
    def factor(self) -> Complex:
        """Factors from displacement to the reading of each channel, (r, H+1, c)."""
        named = {channel.name: channel for channel in self.rig.channels}
        return np.stack([factor(named[name], self.i_omega) for name in self.channels], axis=-1)

    @cached_property
    def by_friction(self) -> Complex:
        """Response of each channel per friction force, (r, H+1, c)."""
        static = [self.structure.residual.channels.get(name, (0.0, 0.0))[1] for name in self.channels]
        return self._response(self.structure.slip_row, np.array(static))

    @cached_property
    def by_force(self) -> Complex:
        """Response of each channel per excitation force, (r, H+1, c)."""
        static = [self.structure.residual.channels.get(name, (0.0, 0.0))[0] for name in self.channels]
        return self._response(self.structure.excitation, np.array(static))

    def _response(self, excitation: Array, static: Array) -> Complex:
        return np.asarray(self.factor * ((excitation / self.stiffness) @ self.rows.T + static))

    @cached_property
    def condition(self) -> Array:
        """Condition number of the columns for friction and for force, the measured force included, (r, H+1)."""
        columns = self.weight[..., None] * np.stack([self.by_friction, self.by_force], axis=3)
        known = self.force_std > 0.0
        row = np.zeros((*columns.shape[:2], 1, 2), dtype=complex)
        row[..., 0, 1] = np.where(known, 1.0 / np.where(known, self.force_std, 1.0), 0.0)
        A = np.concatenate([columns, row], axis=2)
        length = np.linalg.norm(A, axis=2)
        exact = ~known  # an excitation that is known exactly cannot be confused with friction
        A = A / np.where(length > 0.0, length, 1.0)[:, :, None]
        values = np.linalg.svd(A, compute_uv=False)
        condition = np.where(
            values[..., 1] > 0.0, values[..., 0] / np.where(values[..., 1] > 0.0, values[..., 1], 1.0), np.inf
        )
        return np.asarray(np.where(length[..., 0] > 0.0, np.where(exact, 1.0, condition), np.inf))

    def by_modal_forces(self, forces: Complex) -> Complex:
        """Response of each channel to forces on the modes (r, H+1, n), (r, H+1, c)."""
        return np.asarray(self.factor * ((forces / self.stiffness) @ self.rows.T))


def sensing(rig: Rig, spectra: MeasuredSpectra) -> Sensing:
    """Put measured spectra beside the linear structure of a rig, with its tip on the support.

    Raises
    ------
    InputError
        If no response was measured.
    """
    # what is measured is explained with the tip on its support; the reaction turns negative where it is off
    rig = replace(rig, contact=replace(rig.contact, lift_off=False))
    seen, fine = readings(rig, spectra), _fine(rig, spectra)
    return Sensing(
        **{f.name: getattr(seen, f.name) for f in fields(seen)},
        rig=fine,
        stiffness=dynamic_stiffness(fine.structure, seen.i_omega),
    )


def readings(rig: AnyRig, spectra: MeasuredSpectra) -> Readings:
    """What was measured of a rig.

    Raises
    ------
    InputError
        If no response was measured.
    """
    channels = tuple(c.name for c in rig.response_channels if c.name in spectra.channels)
    if not channels:
        raise InputError(
            f"{spectra.source}: holds no response channel; must hold at least one of "
            f"{', '.join(c.name for c in rig.response_channels)}"
        )
    i_omega = np.asarray(2j * np.pi * spectra.hz[:, None] * np.arange(spectra.H + 1), dtype=np.complex128)
    measured = np.stack([spectra.complex(name) for name in channels], axis=2)
    std = np.stack([spectra.std[:, spectra.index(name)] for name in channels], axis=2)
    usable = np.isfinite(std)
    usable[:, 0] = False  # accelerometers and vibrometers see no mean
    force, force_std = _force(spectra, rig.force_among(spectra.channels))
    return Readings(
        spectra=spectra,
        channels=channels,
        i_omega=i_omega,
        measured=np.where(usable, measured, 0.0),
        weight=np.where(usable, 1.0 / np.where(usable, std, 1.0), 0.0),
        force=force,
        force_std=force_std,
    )


def dynamic_stiffness(structure: ModalStructure, i_omega: Complex) -> Complex:
    """Modal dynamic stiffness at i k Omega (...), (..., n)."""
    s = i_omega[..., None]
    return np.asarray(structure.omega_n**2 + s**2 + s * structure.damping)


def _fine(rig: Rig, spectra: MeasuredSpectra) -> Rig:
    """The rig on as many modes as move dynamically at the highest harmonic measured, at least its own."""
    if rig.beam is None:
        return rig
    highest = 2 * np.pi * spectra.hz.max() * spectra.H
    dynamic = int(np.sum(replace(rig.beam, modes=MOST_MODES).natural_frequencies() < STATIC_FROM * highest))
    return rig.with_modes(max(rig.beam.modes, dynamic))


def _force(spectra: MeasuredSpectra, channel: str | None) -> tuple[Complex, Array]:
    """Measured force; harmonics that were not measured count as absent."""
    shape = (len(spectra), spectra.H + 1)
    if channel is None:
        std = np.zeros(shape)
        std[:, 1] = UNKNOWN_FORCE * spectra.level
        return np.zeros(shape, dtype=complex), std
    listed = spectra.std[:, spectra.index(channel)]
    absent = ~np.isfinite(listed)
    absent[:, 0] = True
    force, std = np.where(absent, 0.0, spectra.complex(channel)), np.where(absent, 0.0, listed)
    std[:, 1] = np.where(absent[:, 1], UNKNOWN_FORCE * spectra.level, std[:, 1])
    return force, std
