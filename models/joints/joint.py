"""A joint: a law, and where it acts on a body."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

from models.joints.law import JointLaw, numbers
from models.plausible import impossible

GROUND = ""
"""In place of a name: the ground."""

NORMAL = {
    1: "; with normal_stiffness it has 2, the second along the normal",
    2: ", the second along the normal, where its normal_stiffness acts",
}
"""What makes a friction joint have so many places."""

BETWEEN = re.compile(r"\s+\+\s+|\s+(?=-\s)")
"""What parts the terms of a sum: a hyphen without blanks belongs to a name, such as ``acc-1``."""


def terms(end: str) -> list[tuple[float, str]]:
    """Places of the end of a port with their weights; none of the ground.

    >>> terms("2.5e-3*slope(0.6) + axial(0.6)")
    [(0.0025, 'slope(0.6)'), (1.0, 'axial(0.6)')]
    >>> terms("-acc-1 - 0.5*acc-2")
    [(-1.0, 'acc-1'), (-0.5, 'acc-2')]

    Raises
    ------
    ValueError
        If a weight is no number, or one that no lever has.
    """
    found = []
    for term in BETWEEN.split(end.strip()) if end else []:
        size = term.removeprefix("-").strip()
        weight, star, place = size.rpartition("*")
        try:
            factor = float(weight) if star else 1.0
        except ValueError:
            raise ValueError(f'place "{end}": "{weight}" is no number; must be like 0.5*PLACE - PLACE') from None
        found.append((-factor if term.startswith("-") else factor, place.strip()))
        if accepted := "must be finite" if not isfinite(found[-1][0]) else impossible("weight", found[-1][0]):
            raise ValueError(f'place "{end}": weight {weight}; {accepted}')
    return found


def is_sum(end: str) -> bool:
    """Whether the end of a port is a sum of places, or a multiple of one.

    >>> [is_sum(end) for end in ("4 - 2*1", "-1*y(0.6)", "acc-1")]
    [True, True, False]
    """
    return "*" in end or end.startswith("-") or BETWEEN.search(end) is not None


def _no_law(given: object) -> str:
    """What is wrong with something in the place of a joint's law: most often a friction law that nothing presses."""
    if hasattr(given, "set_valued") and not hasattr(given, "ports"):
        name = given.__name__ if isinstance(given, type) else type(given).__name__
        needed = f"Friction({name}(...), normal_load=...), of hbm.models.joints"
        return f"law is {name}, a friction law that nothing presses; must be {needed}"
    return f"law = {given!r:.80}; must be a law of hbm.models.joints, such as CubicSpring(cubic=1e9)"


@dataclass(frozen=True, eq=False)
class Joint:
    """A law between places of a body, or between the body and the ground.

    Attributes
    ----------
    name : str
    law : JointLaw
    at : tuple of str, (ports,)
        Place of the body at each port of the law, or a sum such as ``0.0074*slope(0.606) + axial(0.606)``;
        signs between places stand between blanks.
    to : tuple of str, (ports,)
        The place it is joined to; the ground where empty. The law sees the motion of `at` relative to `to`.
    loaded_by : str
        Support whose reaction, beside the static load, presses a friction joint; constant load where empty.
    """

    name: str
    law: JointLaw
    at: tuple[str, ...]
    to: tuple[str, ...] = ()
    loaded_by: str = ""

    def __post_init__(self) -> None:
        """Refuse what is no law, another number of places than it has ports, and places joined to themselves."""
        if isinstance(self.law, type) or not hasattr(self.law, "ports"):
            raise ValueError(f"joint {self.name}: {_no_law(self.law)}")
        for what, places in (("at", self.at), ("to", self.to)):
            if (isinstance(places, str) and places) or not isinstance(places, Sequence):
                said = f'"{places}"' if isinstance(places, str) else repr(places)
                raise ValueError(f'joint {self.name}: {what} = {said}; must be a tuple of names, ("{places}",)')
            for place in places:
                if not isinstance(place, str):
                    raise ValueError(f'joint {self.name}: {what} has {place!r}; must be names, such as "{place}"')
            if len(places) != self.law.ports and (places or what == "at"):
                there, needed = len(places), self.law.ports
                hint = NORMAL.get(needed, "") if self.law.name == "friction" else ""
                raise ValueError(
                    f"joint {self.name}: {what} has {there} places; must have {needed} for {self.law.name}{hint}"
                )
        still = next((at for at, to in self.ends if to and terms(at) == terms(to)), None)
        if still is not None:
            raise ValueError(f'joint {self.name}: at and to are both "{still}"; must differ, or leave out to')
        if self.loaded_by and (self.law.name != "friction" or self.law.ports != 1):
            raise ValueError(
                f"joint {self.name}: loaded_by goes with friction along one direction; {self.law.name} has its own load"
            )

    @property
    def ends(self) -> list[tuple[str, str]]:
        """Both ends of each port."""
        return list(zip(self.at, self.to or (GROUND,) * len(self.at), strict=True))

    @property
    def varying_load(self) -> bool:
        """Whether the load on what rubs varies: then records tell it from the friction coefficient."""
        return bool(self.loaded_by or getattr(self.law, "normal_stiffness", None))

    @property
    def where(self) -> str:
        """Both ends of each port in words."""
        return ", ".join(f"{at} to {to}" if to else at for at, to in self.ends)

    def __str__(self) -> str:
        """In words."""
        law: Any = getattr(self.law, "law", self.law)
        values = ", ".join(f"{name} {float(value):.6g}" for name, value in numbers(self.law).items())
        loaded = f", loaded by the reaction at {self.loaded_by}" if self.loaded_by else ""
        return f"{self.name}: {law.name} ({values}) at {self.where}{loaded}"
