"""The error a user can cause."""

import re

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


def expect_frequency(hz: float, where: str) -> None:
    """Refuse a frequency that is not one.

    Raises
    ------
    InputError
        With the number.
    """
    if not 0.0 < hz < float("inf"):
        raise InputError(f"{where}: hz = {hz:g}; must be > 0 and finite [Hz]")


def expect_range(hz: tuple[float, float], where: str) -> None:
    """Refuse a range of frequencies that has no length, or an end that is not a frequency.

    Raises
    ------
    InputError
        With its ends.
    """
    begin, end = hz
    expect_frequency(begin, where)
    expect_frequency(end, where)
    if begin == end:
        raise InputError(f"{where}: hz = ({begin:g}, {end:g}); must be two different frequencies [Hz]")
