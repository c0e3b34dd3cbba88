"""A body with any number of joints: everything a simulation of it needs."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar, TypeAlias

import numpy as np

from models.bodies.ported import Body, PlaceError, PortedModes
from models.bounds import several
from models.jointednumbers import modes_change, scalars, with_scalars
from models.joints.joint import Joint, is_sum, terms
from models.joints.law import numbers
from models.joints.rubbing import Friction
from models.numbers import Described, Numbered, no_such_number
from models.parts import Channel, Damping, Drift, Excitation, check_names
from models.plausible import Doubtful, warn_of
from models.rig import Rig
from models.structure import Array

ROTATION = re.compile(r"^slope\(|\.r[xyz]$")
"""Places that are rotations."""

STILL = "where nothing moves; must be where a mode moves, or where there is flexibility"
"""What is wrong with a place."""


@dataclass(frozen=True, eq=False)
class JointedStructure:
    """A body in modes as its joints, its excitation and its channels see it.

    ``q'' + damping q' + omega_n^2 q = joints' f + excitation F``, and the motion at the joints is
    ``joints q + flexibility f + flexibility_to_force F``.

    Attributes
    ----------
    omega_n : (n,) array
        Natural frequencies without the joints [rad/s].
    damping : (n, n) array
        [1/s]
    joints : (m, n) array
        Relative displacement at each port of each joint, in turn, per mode.
    flexibility : (m, m) array
        The same per force at each, beyond the modes [m/N].
    excitation : (n,) array
        Drive displacement per mode.
    flexibility_to_force : (m,) array
        Motion at the joints per excitation force beyond the modes, and by reciprocity of the drive per joint force.
    drive_by_force : float
        Drive displacement per excitation force beyond the modes.
    channels : (c, n) array
        Displacement at each response channel per mode.
    channels_by_joints : (c, m) array
    channels_by_force : (c,) array
        The same per force at the joints and at the drive, beyond the modes.
    loads_inertia, loads_damping : (j, n) array
        What the reaction that loads each joint differs by from that at rest, per modal acceleration and velocity; zero
        where a joint has no reaction to load it.
    loads_by_joints : (j, m) array
    loads_by_force : (j,) array
        The same per force at the joints and at the drive.
    """

    omega_n: Array
    damping: Array
    joints: Array
    flexibility: Array
    excitation: Array
    flexibility_to_force: Array
    drive_by_force: float
    channels: Array
    channels_by_joints: Array
    channels_by_force: Array
    loads_inertia: Array
    loads_damping: Array
    loads_by_joints: Array
    loads_by_force: Array

    @property
    def n(self) -> int:
        """Number of modes."""
        return len(self.omega_n)

    def stacked(self, changes: "Sequence[JointedStructure]") -> "JointedStructure":
        """Changes of this structure in one, along a last axis."""
        found: dict[str, Any] = {f.name: np.zeros((*np.shape(getattr(self, f.name)), 0)) for f in fields(self)}
        if changes:
            found = {name: np.stack([getattr(c, name) for c in changes], axis=-1) for name in found}
        return JointedStructure(**found)

    def damps(self, shape: Array) -> float:
        """Damping 2 zeta omega of a mass-normalised shape (n,) [1/s]."""
        return float(shape @ self.damping @ shape)


@dataclass(frozen=True, eq=False)
class JointedRig(Numbered):
    """A body, its joints, its excitation and what is measured of it.

    Change it with :func:`dataclasses.replace`; `structure` follows.

    Attributes
    ----------
    name : str
        Title of plots and reports.
    body : Body
        Structure that vibrates.
    damping : Damping
        Damping of its modes, unless it brings a damping matrix.
    joints : tuple of Joint
    excitation : Excitation
        With its place `at`.
    channels : tuple of Channel
        Each with its place `at`.
    drift : tuple of Drift
        What changes from record to record; minded by the diagnosis alone, as is the next.
    tolerances : mapping of str to float
        What some of its numbers may be off by, by their keys: standard deviations, relative, but of numbers that are 0.
    """

    limits: ClassVar[tuple[str, str]] = ("joined", "free")
    followed_modes: ClassVar[None] = None
    beam: ClassVar[None] = None
    modal: ClassVar[None] = None
    """Its body is neither of those of a rig with one contact: its places are named, none is a number along it."""
    holds: ClassVar[float] = 0.0
    """Mean force of joints that stick and that a channel sees [N]: it leaves a linear body as it is."""

    name: str
    body: Body
    damping: Damping
    joints: tuple[Joint, ...]
    excitation: Excitation
    channels: tuple[Channel, ...] = field(default=())
    drift: tuple[Drift, ...] = field(default=())
    tolerances: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse names that are given twice or taken, and places that are none."""
        several(f"{self.name}: joints", self.joints, Joint)
        names = [j.name for j in self.joints]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f'{self.name}: joint "{twice}" is there twice; names must differ')
        check_names(self.name, self.channels, self.computed)
        try:
            self.ported  # noqa: B018  # a place that is none is refused here
        except PlaceError as refused:
            raise ValueError(f"{self.name}: {self._sum_of_places or self._misplaced(refused)}") from None
        except ValueError as refused:
            raise ValueError(f"{self.name}: {refused}") from None
        if not self.body.damped_by_modes and self.damping != Damping():
            raise ValueError(f"{self.name}: damping and a damping matrix of its body; must have one of them")
        self._refuse_still()
        warn_of(self.quantities, self.proportions)

    @property
    def _sum_of_places(self) -> str:
        """What is wrong with the first place of the force or a channel that is a sum, as places of joints may be."""
        placed = {"excitation": self.excitation} | {f"channels[{i}]": c for i, c in enumerate(self.channels, 1)}
        for key, what in placed.items():
            if is_sum(what.at):
                return f'{key}.at = "{what.at}"; must be one place, sums and multiples of places are for joints'
        return ""

    def _misplaced(self, refused: PlaceError) -> str:
        """What the body refuses of a place, with what first asks for it."""
        asking = [
            (f'joint {j.name}: {key} = "{end}"', end, [place for _, place in terms(end)])
            for j in self.joints
            for key, end in (*(("at", at) for at in j.at), *(("to", to) for to in j.to), ("loaded_by", j.loaded_by))
        ]
        placed = {"excitation": self.excitation} | {f"channels[{i}]": c for i, c in enumerate(self.channels, 1)}
        for key, what in placed.items():
            position = f"position = {what.position!r}" if what.position else "at is missing"
            at = f'at = "{what.at}"' if what.at else position
            asking.append((f"{key}.{at}", place_of(what), [place_of(what)]))
        for said, end, places in asking:
            if refused.place in places:
                part = "" if end == refused.place else f' has "{refused.place}"'
                return f"{said}{part}; {refused.accepted}"
        return str(refused)

    def _refuse_still(self) -> None:
        """Refuse a force and joints that can never act: one port that moves is enough for a joint of several."""
        s = self.structure
        if not (s.excitation.any() or s.drive_by_force):
            raise ValueError(f"{self.name}: excitation at {place_of(self.excitation)}, {STILL}")
        moves = np.hstack([s.joints, s.flexibility])
        for j, (_, ports) in zip(self.joints, self.pressed, strict=True):
            if not moves[ports].any():
                raise ValueError(f"{self.name}: joint {j.name} at {j.where}, {STILL}")

    @property
    def quantities(self) -> Iterator[tuple[str, str, Any]]:
        """Numbers with a usual range: key of the rig file, quantity of :mod:`models.plausible`, value."""
        yield from getattr(self.body, "quantities", ())
        yield from self.damping.quantities
        yield "excitation.amplitude", "amplitude", self.excitation.amplitude

    @property
    def proportions(self) -> Iterator[Doubtful]:
        """Numbers of its body that look wrong beside others of it, and damping that is not there."""
        yield from getattr(self.body, "proportions", ())
        if self.body.damped_by_modes:
            yield self.damping

    def __str__(self) -> str:
        """In words."""
        lines = [f"{self.name}: {self.body}", *map(str, self.joints)]
        lines.append(f"excitation: {self.excitation.amplitude:g} N at {place_of(self.excitation)}")
        if self.channels:
            lines.append("channels: " + ", ".join(f"{c.name} ({c.quantity})" for c in self.channels))
        return "\n  ".join(lines)

    @property
    def law_name(self) -> str:
        """Names of the laws of its joints, each once."""
        names = [law.law.name if isinstance(law, Friction) else law.name for law in (j.law for j in self.joints)]
        return ", ".join(dict.fromkeys(names))

    @property
    def lift_off(self) -> bool:
        """Whether a tip leaves its support by an equation of its own: joints that separate do so in their law."""
        return False

    @property
    def laws(self) -> tuple[type, ...]:
        """Kinds of the laws of its joints, in turn."""
        return tuple(type(j.law) for j in self.joints)

    @property
    def kind(self) -> tuple[Any, ...]:
        """What it has that takes long to simulate or may have no steady state: joints, transients."""
        return bool(self.joints), self.excitation.settled

    @property
    def pressed(self) -> list[tuple[float, slice]]:
        """Static load of each joint [N], 0 where none presses it, and its ports."""
        ends = np.cumsum([0, *(j.law.ports for j in self.joints)]).tolist()
        loads = [float(numbers(j.law).get("normal_load", 0.0)) for j in self.joints]
        return [(load, slice(*at)) for load, at in zip(loads, pairwise(ends), strict=True)]

    @property
    def ports(self) -> int:
        """Ports of all joints."""
        return sum(j.law.ports for j in self.joints)

    @property
    def resonators(self) -> int:
        """None are attached to such a body."""
        return 0

    @property
    def places(self) -> tuple[str, ...]:
        """Places of the body that anything touches, each once."""
        return places_of(self.joints, self.excitation, self.response_channels)

    @cached_property
    def ported(self) -> PortedModes:
        """The body in modes with these places."""
        supports = dict.fromkeys(j.loaded_by for j in self.joints if j.loaded_by)
        return self.body.ported(self.places, self.damping, tuple(supports))

    @cached_property
    def structure(self) -> JointedStructure:
        """The body as its joints, its excitation and its channels see it."""
        return self._seen(self.ported)

    def structure_changes(self, keys: tuple[str, ...]) -> tuple[list[int], JointedStructure]:
        """Which of some numbers the structure depends on, and its exact derivatives to these, along a last axis."""
        known = self._changes
        if keys not in known:
            of_body = self.body.numbers
            moving = [i for i, key in enumerate(keys) if key in of_body or key.startswith("damping.")]
            known[keys] = moving, self.structure.stacked([self._seen(modes_change(self, keys[i])) for i in moving])
        return known[keys]

    @cached_property
    def _changes(self) -> dict[tuple[str, ...], tuple[list[int], JointedStructure]]:
        """Those asked for before: every record asks again."""
        return {}

    @cached_property
    def _touched(self) -> tuple[Array, int, list[int]]:
        """Weight of each place in each port (ports, places), and which are those of the drive and of the channels."""
        index = {place: i for i, place in enumerate(self.places)}
        at = np.zeros((self.ports, len(index)))
        for row, (one, other) in zip(at, (pair for j in self.joints for pair in j.ends), strict=True):
            for sign, end in ((1.0, one), (-1.0, other)):
                for weight, place in terms(end):
                    row[index[place]] += sign * weight
        return at, index[place_of(self.excitation)], [index[place_of(c)] for c in self.response_channels]

    @property
    def moved_places(self) -> Array:
        """How far the places of each port move per mode, added up whatever their direction, (m, n)."""
        return np.asarray(np.abs(self._touched[0]) @ np.abs(self.ported.rows))

    def _seen(self, p: PortedModes) -> JointedStructure:
        """Modes as joints, excitation and channels see them; linear in these."""
        at, drive, seen = self._touched
        loads = np.zeros((len(self.joints), len(p.supports)))
        for row, j in zip(loads, self.joints, strict=True):
            if j.loaded_by:
                row[p.supports.index(j.loaded_by)] = 1.0
        return JointedStructure(
            omega_n=p.omega_n,
            damping=p.damping,
            joints=at @ p.rows,
            flexibility=at @ p.flexibility @ at.T,
            excitation=p.rows[drive],
            flexibility_to_force=at @ p.flexibility[:, drive],
            drive_by_force=float(p.flexibility[drive, drive]),
            channels=p.rows[seen],
            channels_by_joints=p.flexibility[seen] @ at.T,
            channels_by_force=p.flexibility[seen, drive],
            loads_inertia=loads @ p.reaction_inertia,
            loads_damping=loads @ p.reaction_damping,
            loads_by_joints=-loads @ p.reaction_share @ at.T,
            loads_by_force=-loads @ p.reaction_share[:, drive],
        )

    def with_modes(self, modes: int) -> "JointedRig":
        """Return the same rig on another number of modes, or on as many as its body has."""
        body = self.body.with_modes(modes, self.places)
        return replace(self, body=body, damping=self.damping.on_modes(body.modes))

    def with_joint(self, name: str, law: Any) -> "JointedRig":
        """Return the same rig with another law in a joint.

        Raises
        ------
        ValueError
            If there is no such joint.
        """
        names = [j.name for j in self.joints]
        if name not in names:
            raise ValueError(f'{self.name}: no joint "{name}"; there are {", ".join(names)}')
        return replace(self, joints=tuple(replace(j, law=law) if j.name == name else j for j in self.joints))

    @cached_property
    def numbers(self) -> Described:
        """All its numbers by the keys of its rig file, with unit and bounds."""
        return scalars(self)

    def number(self, key: str) -> float:
        """Value of one of its numbers."""
        if key not in (known := self.numbers):
            raise no_such_number(key, known, self.name)
        return known[key][0]

    def with_numbers(self, values: Mapping[str, float]) -> "JointedRig":
        """Return the same rig with other values of some of its numbers, such as ``joints.tip.mu``."""
        return with_scalars(self, values)

    @cached_property
    def units(self) -> list[tuple[str, str]]:
        """Units of motion and force at every port: rotations and moments where both its ends are rotations."""
        ends = [[term for end in pair for term in terms(end)] for j in self.joints for pair in j.ends]
        turns = [all(abs(weight) == 1.0 and ROTATION.search(place) for weight, place in end) for end in ends]
        return [("rad", "N m") if turn else ("m", "N") for turn in turns]

    def _named(self, what: str) -> list[str]:
        ports = [(j, f".{i}" * (j.law.ports > 1)) for j in self.joints for i in range(1, j.law.ports + 1)]
        return [f"{j.name}.{what}{port}" for j, port in ports]

    @property
    def computed(self) -> tuple[str, ...]:
        """Names of the signals that a simulation gives beside the channels."""
        return ("drive", *self.motions, *self.forces)

    @property
    def motions(self) -> list[str]:
        """Names of the relative displacements at the ports, (m,)."""
        return self._named("motion")

    @property
    def forces(self) -> list[str]:
        """Names of the forces on the body at the ports, (m,)."""
        return self._named("force")


def places_of(joints: Iterable[Joint], excitation: Excitation, channels: Iterable[Channel]) -> tuple[str, ...]:
    """Places that joints, a force and channels of motion touch, each once."""
    ends = [place for j in joints for pair in j.ends for end in pair for _, place in terms(end)]
    return tuple(dict.fromkeys([*ends, place_of(excitation), *map(place_of, channels)]))


def place_of(what: Channel | Excitation) -> str:
    """Where something is on a body that names its places; on a beam the deflection at its position."""
    return what.at or f"y({what.position!r})"


AnyRig: TypeAlias = Rig | JointedRig
"""A rig with one contact, or with joints."""
