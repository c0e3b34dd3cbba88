"""A cause: a missing effect as a small change of the rig, its parameters numbers of the changed rig."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import isnan
from typing import Any, ClassVar, Protocol

from models.jointed import AnyRig, JointedRig
from models.rig import Rig

EITHER = (Rig, JointedRig)
"""Kinds of rigs: with one contact, with joints."""


@dataclass(frozen=True)
class Unknown:
    """One parameter of a cause.

    Attributes
    ----------
    name : str
        As in a diagnosis, docs/reference/causes.md.
    unit : str
        SI unit, "1" for a pure number.
    key : str
        The number of the extended rig that it is, a dotted key such as ``attachments.clamp_stiffness``.
    lower, upper : float
        Bounds, both included.
    neutral : float
        Value at which the cause changes nothing, may be inf; nan for a number that only shapes the effect.
    starts : tuple of float
        Where fits start, within the bounds; the first makes so small an effect that the score test may use it as
        neutral.
    times : float
        The number is so many times the parameter.
    known : bool
        Whether the neutral value is known as well as that number of a rig file is.
    least : str
        Another parameter of the cause that it does not fall below; none where empty.
    """

    name: str
    unit: str
    key: str
    lower: float
    upper: float
    neutral: float
    starts: tuple[float, ...]
    times: float = 1.0
    known: bool = False
    least: str = ""

    @property
    def shapes(self) -> bool:
        """Whether it only shapes the effect, such as a place or a frequency."""
        return isnan(self.neutral)


class Cause(Protocol):
    """A missing effect that may explain measurements; one object is one candidate, such as the gain of one channel.

    Attributes
    ----------
    name : str
        Name of the cause, docs/reference/causes.md.
    meaning, looks_like, confused_with : str
        In words: what it does, how it shows, and what shows alike.
    check : str
        The cheapest experiment that would confirm or refute it on the structure, in words that follow a colon.
    abrupt : bool
        Whether its first small effect says little of the whole: it sets in at a threshold, or is no steady state's.
    free : bool
        Whether it is free in each record, as transients are, and takes most of anything: it crowds no other cause out.
    contains : tuple of str
        Simpler causes that it is at some values of its parameters.
    placed : bool
        Whether it is at one of many places, which counts as a number beside those that are free.
    rigs : tuple of type
        Kinds of rigs that it is known for.
    """

    name: ClassVar[str]
    meaning: ClassVar[str]
    looks_like: ClassVar[str]
    confused_with: ClassVar[str]
    check: ClassVar[str] = (
        "change it on the structure by a known amount, or take it away, and repeat the records missed most"
    )
    abrupt: ClassVar[bool] = False
    free: ClassVar[bool] = False
    contains: ClassVar[tuple[str, ...]] = ()
    placed: ClassVar[bool] = False
    rigs: ClassVar[tuple[type, ...]] = (Rig,)

    @classmethod
    def candidates(cls, rig: Any) -> Iterator["Cause"]:
        """Candidates of this kind for a rig; none where it makes no sense."""
        ...

    @property
    def label(self) -> str:
        """Name that tells candidates apart, such as ``sensor-gain a3``; where there is but one, that of the cause."""
        return self.name

    def unknowns(self, rig: Any) -> tuple[Unknown, ...]:
        """Parameters, for a rig that is not extended yet."""
        ...

    def extend(self, rig: Any, values: Mapping[str, float]) -> Any:
        """The rig with the effect; `values` by the names of :meth:`unknowns`."""
        ...


def candidates_of(kind: type[Cause], rig: AnyRig) -> Iterator[Cause]:
    """Candidates of a kind for a rig of any kind."""
    if isinstance(rig, getattr(kind, "rigs", Cause.rigs)):
        yield from kind.candidates(rig)
