"""A body with any number of joints: everything a simulation of it needs."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar, TypeAlias

import numpy as np

from models.bodies.laden import Laden, LumpedMass, laden
from models.bodies.ported import Body, PlaceError, PortedModes
from models.bounds import several
from models.jointednumbers import modes_change, scalars, with_scalars
from models.jointedstructure import JointedStructure
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
    masses : tuple of LumpedMass
        What the body carries; its modes and its damping are those without.
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
    masses: tuple[LumpedMass, ...] = field(default=())

    def __post_init__(self) -> None:
        """Refuse names that are given twice or taken, and places that are none."""
        several(f"{self.name}: joints", self.joints, Joint)
        names = [j.name for j in self.joints]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f'{self.name}: joint "{twice}" is there twice; names must differ')
        check_names(self.name, self.channels, self.computed)
        several(f"{self.name}: masses", self.masses, LumpedMass)
        self._refuse_turning()
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

    def _refuse_turning(self) -> None:
        """Refuse masses at what is no translation of a point."""
        for i, lump in enumerate(self.masses, 1):
            if is_sum(lump.at) or ROTATION.search(lump.at):
                accepted = "must be one place, a translation: a lumped mass has no inertia against rotation"
                raise ValueError(f'{self.name}: masses[{i}].at = "{lump.at}"; {accepted}')

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
        asking += [(f'masses[{i}].at = "{lump.at}"', lump.at, [lump.at]) for i, lump in enumerate(self.masses, 1)]
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
        for i, lump in enumerate(self.masses, 1):
            at = self.places.index(lump.at)
            if not (self.ported.rows[at].any() or self.ported.flexibility[at].any()):
                raise ValueError(f"{self.name}: masses[{i}] at {lump.at}, {STILL}")

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
        lines = [f"{self.name}: {self.body}", *map(str, self.masses), *map(str, self.joints)]
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
        return places_of(self.joints, self.excitation, self.response_channels, self.masses)

    def laden_at(self, places: Sequence[str], supports: Sequence[str] = ()) -> Laden:
        """The body with its masses in modes, with some places and supports."""
        return laden(self.body, self.masses, places, self.damping, supports)

    @cached_property
    def laden(self) -> Laden:
        """The same with the places that anything touches, and the supports that load joints."""
        supports = dict.fromkeys(j.loaded_by for j in self.joints if j.loaded_by)
        return self.laden_at(self.places, tuple(supports))

    @property
    def ported(self) -> PortedModes:
        """The same as what joints see."""
        return self.laden.modes

    @cached_property
    def structure(self) -> JointedStructure:
        """The body as its joints, its excitation and its channels see it."""
        return self._seen(self.ported)

    def structure_changes(self, keys: tuple[str, ...]) -> tuple[list[int], JointedStructure]:
        """Which of some numbers the structure depends on, and its exact derivatives to these, along a last axis."""
        known = self._changes
        if keys not in known:
            of_body = self.body.numbers
            moving = [i for i, key in enumerate(keys) if key in of_body or key.startswith(("damping.", "masses["))]
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
        body = self.body.with_modes(modes, self.laden.bare.places)
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


def places_of(
    joints: Iterable[Joint], excitation: Excitation, channels: Iterable[Channel], masses: Iterable[LumpedMass] = ()
) -> tuple[str, ...]:
    """Places that joints, a force, channels of motion and masses touch, each once."""
    ends = [place for j in joints for pair in j.ends for end in pair for _, place in terms(end)]
    at = [*ends, place_of(excitation), *map(place_of, channels), *(lump.at for lump in masses)]
    return tuple(dict.fromkeys(at))


def place_of(what: Channel | Excitation) -> str:
    """Where something is on a body that names its places; on a beam the deflection at its position."""
    return what.at or f"y({what.position!r})"


AnyRig: TypeAlias = Rig | JointedRig
"""A rig with one contact, or with joints."""
