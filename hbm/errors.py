"""The error a user can cause."""

import re
from collections.abc import Iterable, Mapping
from math import inf
from numbers import Integral, Real
from typing import Any, TypeVar, cast

Found = TypeVar("Found")

LONGEST = re.compile(r"\S{300,}")
"""A word of a message that nobody reads to its end."""


def visible(text: str) -> str:
    r"""Text as one line of characters that are seen: whatever else is in it, by its escape.

    A name from a file can hold what clears a terminal or turns the direction of writing.

    >>> visible("a\x1b[31m\nb\u202e")
    'a\\x1b[31m\\nb\\u202e'
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def readable(text: str) -> str:
    """Text whose longest words are left out but for their ends.

    >>> readable('no port "' + 1000 * "x" + '"') == 'no port "' + 99 * "x" + "..." + 19 * "x" + '"'
    True
    """
    return LONGEST.sub(lambda word: f"{word[0][:100]}...{word[0][-20:]}", text)


def shortened(name: str, most: int) -> str:
    """A name of at most so many characters: of a longer one the middle is left out, of a sum its middle terms.

    >>> shortened("rig file calibrated", 36)
    'rig file calibrated'
    >>> shortened("mass at tip + gap of stop + friction at root", 34)
    'mass at tip + … + friction at root'
    >>> shortened("parameter:joints.ground12.critical_slip", 24)
    'parameter:jo…itical_slip'
    """
    if len(name) <= most:
        return name
    first, *between, last = name.split(" + ") if " + " in name else (name, name)
    ends = f"{first} + … + {last}"
    if between and len(ends) <= most:
        return ends
    tail = (most - 1) // 2
    return f"{name[: most - 1 - tail]}…{name[len(name) - tail :]}"


class InputError(ValueError):
    """A file, key or option that cannot be accepted; exit status 2.

    The message is one line: ``<where>: <what was found>; <what is accepted>[; <what to try>]``. Control characters of
    names in it are made visible, words without end are cut.
    """

    def __init__(self, message: str) -> None:
        super().__init__(readable(visible(message)))


def expect_rig(rig: object, where: str, *, joints: bool = False) -> None:
    """Refuse what is no rig, such as the path of its file; and one with joints, unless these are accepted.

    Raises
    ------
    InputError
        With what was given.
    """
    from models.jointed import JointedRig
    from models.rig import Rig

    if isinstance(rig, JointedRig):
        if not joints:
            found = "has [[joints]]" if rig.joints else "has no [contact]"
            raise InputError(f"{where}: {rig.name} {found}; must be a rig with [contact] alone")
    elif not isinstance(rig, Rig):
        raise InputError(f"{where}: rig = {rig!r:.80}; must be a Rig, as load_rig(path) returns")


def expect_joints(rig: object, where: str) -> None:
    """Refuse what is no rig with joints: one with a contact among it.

    Raises
    ------
    InputError
        With what was given.
    """
    from models.rig import Rig

    expect_rig(rig, where, joints=True)
    if isinstance(rig, Rig):
        raise InputError(f"{where}: {rig.name} has [contact]; must be a rig with [[joints]]")


def channel_named(channels: Mapping[str, Found], name: str) -> Found:
    """What is known of a channel.

    Raises
    ------
    KeyError
        With the channels that there are.
    """
    if name not in tuple(channels):
        raise KeyError(f'no channel "{name}"; there are {", ".join(channels)}')
    return channels[name]


def expect_positive(value: Any, what: str, where: str, unit: str) -> None:
    """Refuse what is no number > 0, text among it.

    Raises
    ------
    InputError
        With what was given.
    """
    _expect_from_zero(value, what, where, unit, "> 0")


def expect_not_negative(value: Any, what: str, where: str, unit: str) -> None:
    """Refuse what is no number >= 0, text among it.

    Raises
    ------
    InputError
        With what was given.
    """
    _expect_from_zero(value, what, where, unit, ">= 0")


def _expect_from_zero(value: Any, what: str, where: str, unit: str, least: str) -> None:
    try:
        accepted = bool(0.0 < value < inf) or (least == ">= 0" and bool(value == 0.0))
    except (TypeError, ValueError):
        accepted = False
    if not accepted:
        raise InputError(f"{where}: {what} = {_shown(value)}; must be {least} and finite [{unit}]")


def expect_frequency(hz: Any, where: str) -> None:
    """Refuse a frequency that is not one.

    Raises
    ------
    InputError
        With the number.
    """
    expect_positive(hz, "hz", where, "Hz")


def expect_level(level: Any, where: str) -> None:
    """Refuse a force amplitude that is not one; None stands for that of the rig.

    Raises
    ------
    InputError
        With the number.
    """
    if level is not None:
        expect_positive(level, "level", where, "N")


def expect_two(ends: Any, what: str, where: str) -> tuple[Any, Any]:
    """Both ends of a range, which must have two.

    Raises
    ------
    InputError
        With what was given.
    """
    try:
        begin, end = ends
    except (TypeError, ValueError):
        raise InputError(f"{where}: {what} = {_shown(ends)}; must be two numbers") from None
    return begin, end


def expect_range(ends: Any, where: str, what: str = "hz", unit: str = "Hz") -> None:
    """Refuse a range of frequencies, or of another number > 0, that has no length, or an end that is none.

    Raises
    ------
    InputError
        With its ends.
    """
    begin, end = expect_two(ends, what, where)
    expect_positive(begin, what, where, unit)
    expect_positive(end, what, where, unit)
    if begin == end:
        raise InputError(f"{where}: {what} = ({begin:g}, {end:g}); must be two different numbers > 0 [{unit}]")


def one_or_several(given: Found | Iterable[Found], kind: type[Found], where: str, what: str) -> list[Found]:
    """One of a kind or several as a list.

    Raises
    ------
    InputError
        If there is none.
    """
    found = [given] if isinstance(given, kind) else list(cast(Iterable[Found], given))
    if not found:
        raise InputError(f"{where}: {what} is empty; must have one at least")
    return found


def expect_whole(value: Any, what: str, where: str, least: int = 1, most: int | None = None) -> None:
    """Refuse what is no whole number within bounds.

    Raises
    ------
    InputError
        With what was given.
    """
    whole = isinstance(value, Integral) and not isinstance(value, bool)
    if not whole or value < least or (most is not None and value > most):
        bounds = f">= {least}" if most is None else f"{least} to {most}"
        raise InputError(f"{where}: {what} = {_shown(value)}; must be a whole number {bounds}")


def _shown(value: Any) -> str:
    return f"{value:g}" if isinstance(value, Real) else f"{value!r:.80}"
