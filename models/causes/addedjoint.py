"""A joint that was not modelled as a cause: one law between two places of a body, or a place and the ground.

Each of :mod:`models.causes.joints` is a law and its numbers, :class:`Number`; where it may act, and how large its
effect is, all have in common.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations
from math import nan
from typing import ClassVar, Self

import numpy as np

from models.causes.cause import Cause, Unknown
from models.jointed import JointedRig
from models.joints import Joint, JointLaw, PolynomialSpring
from models.joints.joint import terms
from models.parts import Channel
from models.structure import Array

SMALL = 1e-6
"""Of the excitation: a force that changes hardly anything."""

WIDEST = 1e9
"""Numbers stay within this factor of the unit that force and motion give them."""

SHARES = (0.01, 0.1, 1.0)
"""Starts of the force of a joint, in units of the excitation."""

DIRECTION = re.compile(r"^(\w+)\(|\.(\w+)$")

SAME = 1e-9
"""Of the larger: rows of places that differ by less are of one place."""


@dataclass(frozen=True)
class Number:
    """A number of a law; with a force f [N], an amplitude A [m] and a frequency w [rad/s] its unit is f^p A^q w^r.

    Attributes
    ----------
    name, unit : str
    key : str
        The number of the law that it is.
    powers : (int, int, int)
        p, q and r: 1, -3, 0 of a cubic stiffness. The force of the law is in proportion to numbers with p = 1 together.
    shapes : tuple of float
        Starts in that unit where it is no strength: it may not do without another number.
    signed : bool
        Whether it may be negative.
    """

    name: str
    unit: str
    key: str
    powers: tuple[int, int, int]
    shapes: tuple[float, ...] = ()
    signed: bool = False

    def of(self, force: float, motion: float, omega: float) -> float:
        """Its unit."""
        p, q, r = self.powers
        return float(force**p * motion**q * omega**r)


@dataclass(frozen=True)
class AddedJoint(Cause):
    """A joint with one law.

    Attributes
    ----------
    at : str
        Place of the body.
    to : str
        The place it is joined to; the ground where empty.
    numbers : tuple of Number
        Strengths first.
    made : type
        Class of the law, where it takes the numbers by their keys.
    one_sided : bool
        Whether it answers one direction of the motion alone: then it may be there either way round.
    """

    made: ClassVar[type[JointLaw]]
    numbers: ClassVar[tuple[Number, ...]]
    rigs: ClassVar[tuple[type, ...]] = (JointedRig,)
    one_sided: ClassVar[bool] = False
    placed: ClassVar[bool] = True

    at: str
    to: str = ""

    @classmethod
    def candidates(cls, rig: JointedRig) -> Iterator[Self]:
        """Offer it between the places of a rig, and to the ground, where there is none of its law yet."""
        there = {(type(j.law), *pair) for j in rig.joints for pair in j.ends}
        kind = type(cls.law({n.key: 1.0 for n in cls.numbers}))
        for pair in ends_of(rig):
            ways = (pair, turned(pair)) if cls.one_sided else (pair,)
            yield from (cls(at, to) for at, to in ways if (kind, at, to) not in there)

    @property
    def label(self) -> str:
        """Name and place."""
        return f"{self.name} {self.at}" + f" to {self.to}" * bool(self.to)

    def way(self, ends: tuple[str, str]) -> float:
        """Sign with which it sees the motion of a pair of ends: 0 where it is not there."""
        there = (self.at, self.to)
        return 1.0 if there == ends else -1.0 if there == turned(ends) else 0.0

    @classmethod
    def law(cls, values: Mapping[str, float]) -> JointLaw:
        """The law with values of its numbers, by their keys."""
        return cls.made(**values)

    @staticmethod
    def held(values: Mapping[str, float]) -> float:
        """Stiffness of the joint that the modes hold already, having been identified with it at rest [N/m]."""
        return 0.0

    def beside(self, rig: JointedRig) -> tuple[str, ...]:
        """Other places along which it acts too, in proportion to the motion there."""
        return ()

    def plainly(self, rig: JointedRig, values: Mapping[str, float]) -> dict[str, float]:
        """Numbers of what it contains, beside those of the same name, where that does the same."""
        return {}

    @staticmethod
    def inertia(values: Mapping[str, float]) -> float:
        """Mass that moves with the place [kg]."""
        return 0.0

    def unknowns(self, rig: JointedRig) -> tuple[Unknown, ...]:
        """Numbers of the law, of the size that the linear rig's motion at its resonances gives them."""
        motion, omega = reach(rig, self.at, self.to)
        unit = [n.of(rig.excitation.amplitude, motion, omega) for n in self.numbers]
        return tuple(self._unknown(rig, n, size) for n, size in zip(self.numbers, unit, strict=True))

    def key(self, rig: JointedRig, number: Number) -> str:
        """Key of one of its numbers in the extended rig."""
        return f"joints.{self._joint(rig)}.{number.key}"

    def _unknown(self, rig: JointedRig, n: Number, size: float) -> Unknown:
        key = self.key(rig, n)
        if n.shapes:
            lower = -WIDEST * size if n.signed else size / WIDEST
            return Unknown(n.name, n.unit, key, lower, WIDEST * size, nan, tuple(s * size for s in n.shapes))
        starts = (SMALL, *SHARES, *(-s for s in SHARES if n.signed))
        lower = -WIDEST * size if n.signed else 0.0
        return Unknown(n.name, n.unit, key, lower, WIDEST * size, 0.0, tuple(s * size for s in starts))

    def extend(self, rig: JointedRig, values: Mapping[str, float]) -> JointedRig:
        """Put the joint there."""
        of_law, name, to = (
            {n.key: values[n.name] for n in self.numbers},
            self._joint(rig),
            (self.to,) if self.to else (),
        )
        added = [Joint(name, self.law(of_law), (self.at,), to)]
        if held := self.held(of_law):
            added.append(Joint(f"{name}-held", PolynomialSpring(linear=-held), (self.at,), to))
        return replace(rig, joints=(*rig.joints, *added))

    def _joint(self, rig: JointedRig) -> str:
        """Name of the joint: that of the cause, numbered where there are several."""
        taken = [j.name for j in rig.joints if j.name == self.name or j.name.startswith(f"{self.name}-")]
        taken = [name for name in taken if not name.endswith("-held")]
        return f"{self.name}-{len(taken) + 1}" if taken else self.name


def ends_of(rig: JointedRig) -> list[tuple[str, str]]:
    """Where a joint may be: between each place that the rig names and the ground, and between each two of them.

    Places that move alike are one. Only what moves the same way is joined.
    """
    places = places_apart(rig)
    pairs = [pair for pair in combinations(places, 2) if _direction(pair[0]) == _direction(pair[1])]
    return [(place, "") for place in places] + pairs


def naming(rig: JointedRig, places: Iterable[str]) -> JointedRig:
    """The rig with sensors, which no record has, at places that it does not name: joints may be there then.

    Raises
    ------
    ValueError
        If a place is none of its body.
    """
    unknown = [place for place in dict.fromkeys(places) if place and place not in rig.places]
    sensors = tuple(Channel(f"motion of {place}", "displacement", at=place) for place in unknown)
    return replace(rig, channels=(*rig.channels, *sensors)) if sensors else rig


def moving_most(rig: JointedRig, places: Iterable[str]) -> dict[str, float]:
    """How far some places move by forces of low frequency there, the one that moves most first."""
    named = tuple(places)
    p = rig.laden_at(named).modes
    flexible = p.omega_n[p.omega_n > 0.0]
    squares = p.omega_n**2 + (float(flexible[0] ** 2) if len(flexible) else 1.0)
    size = dict(zip(named, (p.rows**2 @ (1.0 / squares)).tolist(), strict=True))
    return dict(sorted(size.items(), key=lambda pair: -pair[1]))


def turned(ends: tuple[str, str]) -> tuple[str, str]:
    """The same two ends the other way round, as a joint names them.

    >>> turned(("a", "b")), turned(("a", ""))
    (('b', 'a'), ('-1*a', ''))
    """
    at, to = ends
    return (to, at) if to else (f"-1*{at}", "")


@lru_cache(maxsize=16)
def _rows(rig: JointedRig) -> dict[str, Array]:
    """Displacement per mode at each place that a rig names."""
    named = tuple(dict.fromkeys([*rig.places, *getattr(rig.body, "ports", ())]))
    return dict(zip(named, rig.laden_at(named).modes.rows, strict=True))


def places_apart(rig: JointedRig) -> list[str]:
    """Places that a rig names and that move, each of those that move alike once."""
    rows, places = _rows(rig), list[str]()
    for place, row in rows.items():
        if row.any() and not any(_alike(row, rows[other]) for other in places):
            places.append(place)
    return places


def _direction(place: str) -> str:
    """Which way a place moves, as far as its name says: ``y`` of ``y(0.3)``, ``uz`` of ``12.uz``."""
    found = DIRECTION.search(place)
    return "" if found is None else found[1] or found[2]


def _alike(one: Array, other: Array) -> bool:
    size = max(np.abs(one).max(), np.abs(other).max())
    return bool(np.abs(one - other).max() <= SAME * size)


def reach(rig: JointedRig, at: str, to: str) -> tuple[float, float]:
    """Largest motion [m] that the excitation makes between two ends without a joint, and its frequency [rad/s]."""
    rows, s = _rows(naming(rig, (place for end in (at, to) for _, place in terms(end)))), rig.structure
    row = np.sum([w * rows[place] for w, place in terms(at)], axis=0)
    row = row - np.sum([w * rows[place] for w, place in terms(to)], axis=0)
    omega = np.where(s.omega_n > 0.0, s.omega_n, np.inf)
    loss = np.maximum(s.damping.diagonal(), 1e-6 * np.where(s.omega_n > 0.0, s.omega_n, 1.0))
    size = np.abs(row * s.excitation) * rig.excitation.amplitude / (omega * loss)
    static = np.abs(row) @ np.abs(s.excitation / omega**2) * rig.excitation.amplitude
    i = int(size.argmax())
    found = max(float(size[i]), float(static))
    return (found if found > 0.0 else 1e-6), float(s.omega_n[i]) or 1.0
