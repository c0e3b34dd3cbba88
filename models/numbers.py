"""Numbers of a rig by the keys of its rig file, read and changed."""

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from typing import Any, Self

from models.bounds import refuse_text
from models.display import Displayed
from models.friction.law import Parameter
from models.parts import Channel, Drift, Excitation

STEP = re.compile(r"(\w+)(?:\[(\d+)\])?")
ATTRIBUTES = {"beam": "body", "friction": "law"}
"""What tables of a rig file are called in a rig, where that differs."""

GAIN, DELAY = Parameter("1", "gain", "", lower=-float("inf")), Parameter("s", "delay", "", lower=-float("inf"))
OF_FORCE, READ = "excitation.channel_gain", Parameter("1", "what the force channel reads of the force", "")
RATE = Parameter("1", "change per record", "", lower=-float("inf"))

Step = str | int
Described = dict[str, tuple[float, Parameter]]


class NoSuchNumber(KeyError, ValueError):
    """The key of a number that a rig does not have."""

    def __str__(self) -> str:
        """The message as it is; a KeyError would quote it."""
        return str(self.args[0])


def no_such_number(key: str, known: Iterable[str], rig: str) -> NoSuchNumber:
    """What is wrong with a key: the numbers that there are, the closest as a hint."""
    known = list(known)
    last = key.rpartition(".")[2]  # who knows the number may not know where it stands
    alike = [other for other in known if other.rpartition(".")[2] == last]
    close = get_close_matches(key, alike, n=1, cutoff=0.0) or get_close_matches(key, known, n=1, cutoff=0.5)
    hint = f"; did you mean {close[0]}?" if close else ""
    return NoSuchNumber(f"{key} is not a number of the rig {rig}; must be one of {', '.join(known)}{hint}")


class Numbered(Displayed):
    """A rig whose numbers are read and changed by the keys of its rig file, such as ``channels.a3.gain``."""

    name: str
    excitation: Excitation
    channels: tuple[Channel, ...]
    drift: tuple[Drift, ...]

    @property
    def law_name(self) -> str:
        """Name of the law of what touches it, of several each once."""
        raise NotImplementedError

    @property
    def headline(self) -> str:
        """Its name and that of its laws, if it has any."""
        return ", ".join(filter(None, (self.name, self.law_name)))

    @property
    def numbers(self) -> Described:
        """All its numbers by the keys of its rig file, with unit and bounds."""
        raise NotImplementedError

    @property
    def response_channels(self) -> tuple[Channel, ...]:
        """Channels that measure motion (all but force)."""
        return tuple(c for c in self.channels if c.quantity != "force")

    def force_among(self, channels: Collection[str]) -> str | None:
        """Channel of the force, where it is among some; None where it is not."""
        return next((c.name for c in self.channels if c.quantity == "force" and c.name in channels), None)

    @property
    def of_measuring(self) -> Described:
        """Numbers of its channels, that of the force where it is asked, and rates of what drifts."""
        found: Described = {}
        for c in self.response_channels:
            found |= {f"channels.{c.name}.gain": (c.gain, GAIN), f"channels.{c.name}.delay": (c.delay, DELAY)}
        if self.excitation.channel_gain is not None:
            found[OF_FORCE] = self.excitation.channel_gain, READ
        return found | {key: (drift.rate, RATE) for key, drift in self.drifting.items()}

    @property
    def drifting(self) -> dict[str, Drift]:
        """What drifts, by the keys of the rates."""
        return {f"drift[{i}].rate": drift for i, drift in enumerate(self.drift)}

    def drifted(self, drift: Drift) -> tuple[str, ...]:
        """Keys of the numbers that drift together: one, or all of a list such as ``modal.frequencies_hz``.

        Raises
        ------
        KeyError
            If there is no such number.
        """
        together = tuple(key for key in self.numbers if key.startswith(f"{drift.parameter}["))
        if not together:
            self.number(drift.parameter)
        return together or (drift.parameter,)

    @property
    def too_low(self) -> Iterator[tuple[str, str]]:
        """Numbers of a law below another that they must not fall below, and that other."""
        numbers = self.numbers
        for key, (value, accepted) in numbers.items():
            other = f"{key.rpartition('.')[0]}.{accepted.at_least}"
            if accepted.at_least and value < numbers[other][0]:
                yield key, other

    def number(self, key: str) -> float:
        """Value of one of its numbers.

        >>> from hbm.models.published import paper_rig
        >>> paper_rig().number("contact.friction.mu"), paper_rig().number("channels.a3.position")
        (0.52, 0.3)

        Raises
        ------
        KeyError
            If there is no such number.
        """
        return self._found(key)[1]

    def with_number(self, key: str, value: float) -> Self:
        """The same rig with another value of one of its numbers.

        Raises
        ------
        KeyError
            If there is no such number.
        ValueError
            If the value is text, or not accepted.
        """
        return self.with_numbers({key: value})

    def with_numbers(self, values: Mapping[str, float]) -> Self:
        """The same rig with other values of several of its numbers, all at once.

        Raises
        ------
        KeyError
            If there is no such number.
        """
        for key, value in values.items():
            refuse_text(key, value)
        changed: Self = _with(self, {self._found(key)[0]: value for key, value in values.items()}) if values else self
        return changed

    def at_record(self, record: int) -> Self:
        """The rig as it is in a record, 1 the first; it drifts no more.

        Raises
        ------
        ValueError
            If what drifts is not a number of the rig, or not positive there.
        """
        rig = self
        for drift in self.drift:
            factor = 1.0 + drift.rate * (record - 1)
            if factor <= 0.0:
                raise ValueError(
                    f"drift of {drift.parameter}: {factor:g} times its value in record {record}; must be > 0"
                )
            try:
                rig = rig.with_numbers({key: rig.number(key) * factor for key in rig.drifted(drift)})
            except NoSuchNumber as unknown:
                raise ValueError(f"drift: {unknown}") from None
        return replace(rig, drift=()) if rig.drift else rig  # type: ignore[type-var]  # of the dataclasses that inherit

    def _found(self, key: str) -> tuple[tuple[Step, ...], float]:
        """Attributes and places in lists that lead to a number, and its value."""
        way = _steps(key, [c.name for c in self.channels])
        found: Any = self
        for step in way:
            found = _part(found, step)
        if not isinstance(found, int | float):
            raise no_such_number(key, self.numbers, self.name)
        return way, float(found)


def _steps(key: str, channels: Sequence[str]) -> tuple[Step, ...]:
    """Steps of a key, channels by their place among all; none where it is no key."""
    table, _, rest = key.partition(".")
    place, _, name = rest.rpartition(".")
    if table == "channels":
        return (table, channels.index(place), name) if place in channels else ()
    found: list[Step] = []
    for entry in map(STEP.fullmatch, key.split(".")):
        if entry is None or entry[1] in ATTRIBUTES.values():
            return ()
        found += [ATTRIBUTES.get(entry[1], entry[1]), *([int(entry[2])] if entry[2] else [])]
    return tuple(found) if isinstance(found[-1], str) else ()


def _part(owner: Any, step: Step) -> Any:
    """A field of a part of a rig, or an entry of a list; None where there is none."""
    if isinstance(step, int):
        return owner[step] if type(owner) is tuple and step < len(owner) else None
    known = getattr(owner, "__dataclass_fields__", getattr(owner, "_fields", ()))
    return getattr(owner, step) if step in known else None


def _with(owner: Any, values: Mapping[tuple[Step, ...], float]) -> Any:
    """A part of a rig with other numbers, by the ways to them."""
    if () in values:
        return values[()]
    below: dict[Step, dict[tuple[Step, ...], float]] = {}
    for (step, *way), value in values.items():
        below.setdefault(step, {})[tuple(way)] = value
    new: dict[Any, Any] = {step: _with(_part(owner, step), own) for step, own in below.items()}
    if type(owner) is tuple:
        return tuple(new.get(i, entry) for i, entry in enumerate(owner))
    return owner._replace(**new) if hasattr(owner, "_replace") else replace(owner, **new)
