"""What a rig file says: structure, damping, contact, excitation and channels."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from models.beam import Beam, beam_structure
from models.friction import FrictionLaw
from models.structure import Array, ModalStructure, Reaction, modal_damping

Quantity = Literal["force", "acceleration", "velocity", "displacement"]
QUANTITIES: tuple[str, ...] = get_args(Quantity)
UNITS: dict[str, str] = {"force": "N", "acceleration": "m/s2", "velocity": "m/s", "displacement": "m"}


@dataclass(frozen=True)
class ModalBody:
    """Any structure given by its mass-normalised modes instead of a beam's geometry.

    Attributes
    ----------
    frequencies_hz : tuple of float, (n,)
        Natural frequencies with the contact sliding freely [Hz].
    shapes : tuple of tuple of float, (channels, n)
        Mode shapes at each of the rig's channels, in their order.
    contact_shape : tuple of float, (n,)
        du/dq of each mode.
    excitation_shape : tuple of float, (n,)
        Mode shapes at the excitation.
    """

    frequencies_hz: tuple[float, ...]
    shapes: tuple[tuple[float, ...], ...]
    contact_shape: tuple[float, ...]
    excitation_shape: tuple[float, ...]


@dataclass(frozen=True)
class Damping:
    """Damping of the modes; see :func:`models.structure.modal_damping`.

    Attributes
    ----------
    mass_proportional : float
        alpha [1/s] (25).
    modal_ratios : tuple of float or None
        Ratios that replace alpha and the high-mode ratio.
    stiffness_proportional : float
        beta [s].
    high_mode_ratio, high_mode_from : float, int
        Ratio of the modes from this one (counted from 1) up; 0 leaves alpha there too.
    """

    mass_proportional: float = 0.0
    modal_ratios: tuple[float, ...] | None = None
    stiffness_proportional: float = 0.0
    high_mode_ratio: float = 0.02
    high_mode_from: int = 6

    def viscous(self, omega_n: Array) -> Array:
        """Viscous damping coefficients of the modes, strain-rate part left out, (n,) [1/s]."""
        return modal_damping(
            omega_n, self.mass_proportional, self.modal_ratios, self.high_mode_ratio, self.high_mode_from
        )

    def by_mass_proportional(self, omega_n: Array) -> Array:
        """Derivative of :meth:`viscous` to alpha, (n,): 1 for the modes that alpha damps, 0 for the others."""
        unit, none = replace(self, mass_proportional=1.0), replace(self, mass_proportional=0.0)
        return unit.viscous(omega_n) - none.viscous(omega_n)


@dataclass(frozen=True, eq=False)
class Contact:
    """The support and the friction on it.

    Attributes
    ----------
    normal_load : float
        P [N].
    law : FrictionLaw
        Friction law with its parameters.
    radius : float
        Half-cylinder radius r [m]; used by a beam only, like the three switches.
    variable_normal_load, residual_compliance, foreshortening : bool
        Keep R(t), C_res and the T G q coupling of physics.md section 2.
    """

    normal_load: float
    law: FrictionLaw
    radius: float = 0.0
    variable_normal_load: bool = True
    residual_compliance: bool = True
    foreshortening: bool = True


@dataclass(frozen=True)
class Excitation:
    """Shaker force: cosine of the fundamental, `amplitude` [N], at `position` [m] of a beam."""

    amplitude: float
    position: float = 0.0


@dataclass(frozen=True)
class Channel:
    """What is, or would be, measured: a name, one of `QUANTITIES`, and the place on a beam [m]."""

    name: str
    quantity: str
    position: float = 0.0


@dataclass(frozen=True, eq=False)
class Rig:
    """A structure on its support: everything a simulation needs.

    Change it with :func:`dataclasses.replace`; `structure` follows.

    Attributes
    ----------
    name : str
        Title of plots and reports.
    body : Beam or ModalBody
        What vibrates.
    damping : Damping
    contact : Contact
    excitation : Excitation
    channels : tuple of Channel
    """

    name: str
    body: Beam | ModalBody
    damping: Damping
    contact: Contact
    excitation: Excitation
    channels: tuple[Channel, ...] = field(default=())

    @property
    def response_channels(self) -> tuple[Channel, ...]:
        """Channels that measure motion (all but force)."""
        return tuple(c for c in self.channels if c.quantity != "force")

    @cached_property
    def structure(self) -> ModalStructure:
        """The linear structure in modes, with the rows that couple it to the contact."""
        return _of_beam(self, self.body) if isinstance(self.body, Beam) else _of_modes(self, self.body)

    def with_modes(self, modes: int) -> "Rig":
        """Return the same beam rig on another number of modes; a modal rig is returned as it is.

        Where each mode has a damping ratio of its own, modes beyond those listed have that of the last.
        """
        if not isinstance(self.body, Beam):
            return self
        damping, ratios = self.damping, self.damping.modal_ratios
        if ratios is not None and len(ratios) > 1:
            damping = replace(damping, modal_ratios=(ratios + ratios[-1:] * modes)[:modes])
        return replace(self, body=replace(self.body, modes=modes), damping=damping)


def _of_beam(rig: Rig, beam: Beam) -> ModalStructure:
    return beam_structure(
        beam,
        radius=rig.contact.radius,
        excitation_position=rig.excitation.position,
        viscous_damping=rig.damping.viscous(beam.natural_frequencies()),
        stiffness_proportional=rig.damping.stiffness_proportional,
        variable_normal_load=rig.contact.variable_normal_load,
        residual_compliance=rig.contact.residual_compliance,
        foreshortening=rig.contact.foreshortening,
        positions={c.name: c.position for c in rig.response_channels},
    )


def _of_modes(rig: Rig, body: ModalBody) -> ModalStructure:
    omega_n = 2 * np.pi * np.asarray(body.frequencies_hz)
    n = len(omega_n)
    rows = dict(zip((c.name for c in rig.channels), map(np.asarray, body.shapes), strict=True))
    return ModalStructure(
        omega_n=omega_n,
        damping=rig.damping.viscous(omega_n) + rig.damping.stiffness_proportional * omega_n**2,
        slip_row=np.asarray(body.contact_shape),
        shortening=np.zeros((n, n)),
        excitation=np.asarray(body.excitation_shape),
        compliance=0.0,
        reaction=Reaction.constant(n),
        channel_rows={c.name: rows[c.name] for c in rig.response_channels},
    )
