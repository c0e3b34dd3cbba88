"""Numbers of a rig by the keys of its rig file, read and changed."""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, overload

from models.jointed import AnyRig, JointedRig
from models.rig import Rig

ENTRY = re.compile(r"(\w+)\[(\d+)\]\.(\w+)")
LISTS = ("elements", "drift")
"""Lists of a rig whose entries have numbers."""
ATTRIBUTES = {"beam": "body", "friction": "law"}
"""What tables of a rig file are called in a rig, where that differs."""


def number(rig: AnyRig, key: str) -> float:
    """Value of one of a rig's numbers.

    >>> from models.published import paper_rig
    >>> number(paper_rig(), "contact.friction.mu"), number(paper_rig(), "channels.a3.position")
    (0.52, 0.3)
    """
    if isinstance(rig, JointedRig):
        return rig.number(key)
    owner, name = _owner(rig, key)
    return float(getattr(owner, name))


@overload
def with_number(rig: Rig, key: str, value: float) -> Rig: ...
@overload
def with_number(rig: JointedRig, key: str, value: float) -> JointedRig: ...
@overload
def with_number(rig: AnyRig, key: str, value: float) -> AnyRig: ...
def with_number(rig: AnyRig, key: str, value: float) -> AnyRig:
    """The rig with another value of one of its numbers.

    Parameters
    ----------
    rig : Rig
    key : str
        A key of :func:`models.change.structure_scalars`, of the friction law, or of the contact, such as
        ``channels.a3.gain``, ``attachments.masses[0].position``, ``elements[0].gap``, ``drift[0].rate`` or
        ``contact.friction.mu``; of a rig with joints one of :attr:`models.jointed.JointedRig.numbers`.
    value : float

    Returns
    -------
    Rig

    Raises
    ------
    KeyError
        If the rig has no such number.
    """
    return with_numbers(rig, {key: value})


def with_numbers(rig: AnyRig, values: Mapping[str, float]) -> AnyRig:
    """The rig with other values of several of its numbers, see :func:`with_number`."""
    if isinstance(rig, JointedRig):
        return rig.with_numbers(values)
    if not values:
        return rig
    tree: dict[str, Any] = {}
    for key, value in values.items():
        _owner(rig, key)  # refuses what is no number
        *way, name = key.split(".")
        below = tree
        for step in [way[0], ".".join(way[1:])] if way[0] == "channels" else way:
            below = below.setdefault(step, {})
        below[name] = value
    changed: Rig = _with(rig, tree)
    return changed


def _with(owner: Any, tree: Mapping[str, Any]) -> Any:
    """A part of a rig with numbers changed, by their names or, where they stand in a part of it, by those in it."""
    changes: dict[str, Any] = {}
    for step, below in tree.items():
        name, _, index = step.rstrip("]").partition("[")
        name = ATTRIBUTES.get(name, name)
        if not isinstance(below, Mapping):
            changes[name] = below
        elif index:
            entries = list(changes.get(name, getattr(owner, name)))
            entries[int(index)] = _with(entries[int(index)], below)
            changes[name] = tuple(entries)
        elif name == "channels":
            changes[name] = tuple(_with(c, below[c.name]) if c.name in below else c for c in owner.channels)
        else:
            changes[name] = _with(getattr(owner, name), below)
    return owner._replace(**changes) if hasattr(owner, "_replace") else replace(owner, **changes)


def at_record(rig: AnyRig, record: int) -> AnyRig:
    """The rig as it is in a record, 1 the first; it drifts no more.

    Raises
    ------
    ValueError
        If what drifts is not a number of the rig, or not positive there.
    """
    for drift in rig.drift:
        factor = 1.0 + drift.rate * (record - 1)
        if factor <= 0.0:
            raise ValueError(f"drift of {drift.parameter}: {factor:g} times its value in record {record}; must be > 0")
        try:
            rig = with_number(rig, drift.parameter, number(rig, drift.parameter) * factor)
        except KeyError as unknown:
            raise ValueError(f"drift: {unknown.args[0]}") from None
    return replace(rig, drift=()) if rig.drift else rig


def _owner(rig: Rig, key: str) -> tuple[Any, str]:
    """Part of a rig that holds a number, and the number's name there."""
    table, _, rest = key.partition(".")
    place, _, name = rest.rpartition(".")
    owner: Any = None
    if table == "beam":
        owner = rig.body
    elif table == "channels":
        owner = next((c for c in rig.channels if c.name == place), None)
    elif place == "friction":
        owner = rig.contact.law
    elif entry := ENTRY.fullmatch(rest):
        entries = getattr(rig.attachments, entry[1], ())
        owner = entries[int(entry[2])] if int(entry[2]) < len(entries) else None
    elif (entry := ENTRY.fullmatch(key)) and entry[1] in LISTS:
        entries = getattr(rig, entry[1])
        owner, name = entries[int(entry[2])] if int(entry[2]) < len(entries) else None, entry[3]
    elif not place and table in ("damping", "contact", "excitation", "attachments"):
        owner = getattr(rig, table)
    if not isinstance(getattr(owner, name, None), int | float):
        raise KeyError(f"{key} is not a number of the rig {rig.name}")
    return owner, name
