"""Where a force may be missing: directions of rank one, each with the motion at its place.

A clamp that turns and a support that moves are directions too. There the motion is what is missing, and the load of the
clamp or the support is what it is held against.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal, Protocol

import numpy as np
import numpy.typing as npt

from hbm.balance.scaled import force_shape
from hbm.balance.solution import PeriodicSolution
from hbm.fourier import Array
from hbm.sensitivity.moving import Disturbance
from models.beam import Beam, lift_shape, rotation_shape
from models.parts import Channel
from models.rig import Rig

CONTACT = "the contact"

POINTS = 8
"""Positions along the beam, equally far apart."""

LIFT_BY_TURN, LIFT_BY_LIFT = 11.0 / 280.0, 33.0 / 140.0
"""Integrals over the length of the shapes of a turned clamp and a lifted tip, and of the latter squared."""

Complex = npt.NDArray[np.complex128]
Kind = Literal["force", "motion", "reading"]


class AnyPlace(Protocol):
    """What is told of a place, of a rig of any kind."""

    @property
    def name(self) -> str:
        """In words."""
        ...

    @property
    def kind(self) -> Kind:
        """Kind of quantity that is missing."""
        ...

    @property
    def unit(self) -> str:
        """Unit of what is missing."""
        ...

    @property
    def against(self) -> str:
        """Unit of what it is held against."""
        ...

    @property
    def seen(self) -> Callable[[PeriodicSolution], Complex]:
        """Amplitudes (H+1,) of what it is held against."""
        ...


@dataclass(frozen=True, eq=False)
class Place:
    """A direction in which a harmonic force, motion or reading may be missing.

    Attributes
    ----------
    name : str
        In words, "the contact".
    kind : str
        Kind of quantity that is missing.
    unit, against : str
        Units of what is missing, and of what it is compared with.
    seen : function of a solution
        Amplitudes (H+1,) of what it is held against: the motion at the place, for a motion the load there, for a
        reading the reading.
    modes : (3, n) array
        Forces on the modes per unit, and per unit of its first and second time derivative.
    reaction : (float, float, float)
        The same of the normal reaction.
    friction, slip : float
        Friction force and modal slip per unit.
    channels : mapping of str to float
        Displacement of response channels per unit, the modes held.
    """

    name: str
    kind: Kind
    unit: str
    against: str
    seen: Callable[[PeriodicSolution], Complex]
    modes: Array
    reaction: tuple[float, float, float] = (0.0, 0.0, 0.0)
    friction: float = 0.0
    slip: float = 0.0
    channels: Mapping[str, float] = field(default_factory=dict)

    def disturbance(self, solution: PeriodicSolution, H: int) -> Disturbance:
        """Cosines, then sines of harmonics 1..H, one of each column."""
        basis, Omega = solution.basis, solution.state.Omega
        unit = np.zeros((basis.size, 2 * H))
        unit[1 : H + 1, :H] = unit[basis.H + 1 : basis.H + H + 1, H:] = np.eye(H)
        rates = [unit]
        for _ in range(2):
            rates.append(Omega * basis.derivative(rates[-1]))
        series = np.stack(rates)
        return Disturbance(
            modes=np.einsum("rkp,rn->knp", series, self.modes),
            friction=self.friction * unit,
            slip=self.slip * unit,
            reaction=np.tensordot(np.array(self.reaction), series, axes=1),
            channels={name: moved * unit for name, moved in self.channels.items()},
        )


def all_at_once(places: Sequence[Place], solution: PeriodicSolution, H: int) -> Disturbance:
    """Disturbances of several places, one after the other."""
    parts = [place.disturbance(solution, H) for place in places]
    names = sorted({name for p in parts for name in p.channels})
    none = np.zeros_like(parts[0].slip)
    return Disturbance(
        modes=np.concatenate([p.modes for p in parts], axis=2),
        friction=np.concatenate([p.friction for p in parts], axis=1),
        slip=np.concatenate([p.slip for p in parts], axis=1),
        reaction=np.concatenate([p.reaction for p in parts], axis=1),
        channels={name: np.concatenate([p.channels.get(name, none) for p in parts], axis=1) for name in names},
    )


def places_of(rig: Rig) -> list[Place]:
    """Where a rig may lack a force or a motion; sensors are not among them."""
    if rig.beam is None:
        return [contact_of(rig), _drive(rig)]
    held = [] if rig.attachments else [_clamp(rig, rig.beam), _support(rig, rig.beam)]
    along = rig.beam.length * np.arange(1, POINTS + 1) / (POINTS + 1)
    return [contact_of(rig), _drive(rig), *held, *points_of(rig, rig.beam, along)[1]]


def contact_of(rig: Rig) -> Place:
    """Friction, or a moment on the tip: over the arm of the contact they are the same."""
    none = np.zeros((3, rig.structure.n))
    return Place(CONTACT, "force", "N", "m", lambda s: s.basis.complex(s["slip"].coefficients), none, friction=1.0)


def _drive(rig: Rig) -> Place:
    s = rig.structure
    return Place(
        name="the excitation",
        kind="force",
        unit="N",
        against="m",
        seen=lambda solution: solution.basis.complex(solution["drive"].coefficients),
        modes=_static(s.excitation),
        reaction=(-s.reaction.force_share, 0.0, 0.0),
        slip=s.residual.slip_by_force,
        channels={name: by_force for name, (by_force, _) in s.residual.channels.items()},
    )


def points_of(rig: Rig, beam: Beam, positions: Array) -> tuple[Rig, list[Place]]:
    """Places along a beam, and the rig with a probe of the deflection at each, named as the place is.

    What the modes left out make of a force there at the contact follows by reciprocity.
    """
    probes = tuple(Channel(f"the beam at {1e3 * x:.0f} mm", "displacement", float(x)) for x in positions)
    probed = replace(rig, channels=(*rig.channels, *probes))
    return probed, [_point(probed, beam, probe) for probe in probes]


def _point(probed: Rig, beam: Beam, probe: Channel) -> Place:
    row = probed.structure.channel_rows[probe.name]
    carried = probed.contact.load_variation * float(beam.tip_load_shape(np.array([probe.position]))[0])
    _, by_friction = probed.structure.residual.channels.get(probe.name, (0.0, 0.0))
    return Place(
        name=probe.name,
        kind="force",
        unit="N",
        against="m",
        seen=partial(_deflection, row, by_friction),
        modes=_static(row),
        reaction=(-carried, 0.0, 0.0),
        slip=by_friction,
    )


def _deflection(row: Array, by_friction: float, s: PeriodicSolution) -> Complex:
    return s.basis.complex(s.state.Q @ row + by_friction * s["friction"].coefficients)


def _clamp(rig: Rig, beam: Beam) -> Place:
    """A clamp that turns, against the moment on the beam there."""
    L, EI, scale = beam.length, beam.bending_stiffness, rig.contact.load_variation
    inertia = _signed(rig, beam) * EI * beam.shapes(np.array([0.0]), 2)[0] / rig.structure.omega_n**2
    arm = rig.contact.radius + beam.thickness / 2
    carried = beam.mass_per_length * L**2 * LIFT_BY_TURN
    at_drive = float(L * rotation_shape(rig.excitation.position / L))
    damping = rig.structure.damping

    def moment(s: PeriodicSolution) -> Complex:
        i_omega = 1j * s.state.Omega * np.arange(s.basis.H + 1)
        Q, T = s.basis.complex(s.state.Q), s.basis.complex(s["friction"].coefficients)
        force = s.level * s.basis.complex(force_shape(rig.excitation, s.basis, 1))
        m = (Q @ inertia).T * i_omega**2 + (Q @ (damping * inertia)) * i_omega
        return np.asarray(m - at_drive * force - arm * float(rotation_shape(1.0, 1)) * T)

    return Place(
        name="the clamp",
        kind="motion",
        unit="rad",
        against="N m",
        seen=moment,
        modes=-np.stack([np.zeros_like(inertia), damping * inertia, inertia]),
        reaction=(-3.0 * EI / L**2 * scale, 0.0, carried * scale),
        slip=arm * float(rotation_shape(1.0, 1)),
        channels={c.name: float(L * rotation_shape(c.position / L)) for c in rig.response_channels},
    )


def _support(rig: Rig, beam: Beam) -> Place:
    """A support that moves up and down, against the reaction."""
    L, EI, scale = beam.length, beam.bending_stiffness, rig.contact.load_variation
    inertia = _signed(rig, beam) * EI * beam.shapes(np.array([L]), 3)[0] / rig.structure.omega_n**2
    arm = rig.contact.radius + beam.thickness / 2
    return Place(
        name="the support, vertically",
        kind="motion",
        unit="m",
        against="N",
        seen=lambda s: s.basis.complex(s["normal"].coefficients),
        modes=-np.stack([np.zeros_like(inertia), rig.structure.damping * inertia, inertia]),
        reaction=(3.0 * EI / L**3 * scale, 0.0, beam.mass_per_length * L * LIFT_BY_LIFT * scale),
        slip=arm / L * float(lift_shape(1.0, 1)),
        channels={c.name: float(lift_shape(c.position / L)) for c in rig.response_channels},
    )


def sensor(name: str, unit: str) -> Place:
    """Place that stands for what a sensor reads beside the motion."""
    return Place(
        f"sensor {name}", "reading", unit, unit, lambda s: s.basis.complex(s[name].coefficients), np.zeros((3, 0))
    )


def _static(row: Array) -> Array:
    return np.stack([row, np.zeros_like(row), np.zeros_like(row)])


def _signed(rig: Rig, beam: Beam) -> Array:
    """Signs of the modes of a rig beside those of its beam, (n,)."""
    return np.asarray(np.sign(rig.structure.slip_row * beam.shapes(np.array([beam.length]), 1)[0]))
