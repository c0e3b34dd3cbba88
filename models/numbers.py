"""Numbers of a rig by the keys of its rig file, read and changed."""

import re
from dataclasses import replace
from typing import Any

from models.rig import Rig

ENTRY = re.compile(r"(\w+)\[(\d+)\]\.(\w+)")


def number(rig: Rig, key: str) -> float:
    """Value of one of a rig's numbers.

    >>> from models.published import paper_rig
    >>> number(paper_rig(), "contact.friction.mu"), number(paper_rig(), "channels.a3.position")
    (0.52, 0.3)
    """
    owner, name = _owner(rig, key)
    return float(getattr(owner, name))


def with_number(rig: Rig, key: str, value: float) -> Rig:
    """The rig with another value of one of its numbers.

    Parameters
    ----------
    rig : Rig
    key : str
        A key of :func:`models.change.structure_scalars`, of the friction law, or of the contact, such as
        ``channels.a3.gain``, ``attachments.masses[0].position`` or ``contact.friction.mu``.
    value : float

    Returns
    -------
    Rig

    Raises
    ------
    KeyError
        If the rig has no such number.
    """
    owner, name = _owner(rig, key)
    changed = owner._replace(**{name: value}) if hasattr(owner, "_replace") else replace(owner, **{name: value})
    return _with_owner(rig, key, changed)


def _owner(rig: Rig, key: str) -> tuple[Any, str]:
    """What in a rig holds a number, and the number's name there."""
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
    elif not place and table in ("damping", "contact", "excitation", "attachments"):
        owner = getattr(rig, table)
    if not isinstance(getattr(owner, name, None), int | float):
        raise KeyError(f"{key} is not a number of the rig {rig.name}")
    return owner, name


def _with_owner(rig: Rig, key: str, changed: Any) -> Rig:
    """The rig with what holds a number changed."""
    table, _, rest = key.partition(".")
    if table == "beam":
        return replace(rig, body=changed)
    if table == "channels":
        return replace(rig, channels=tuple(changed if c.name == changed.name else c for c in rig.channels))
    if rest.startswith("friction."):
        return replace(rig, contact=replace(rig.contact, law=changed))
    if entry := ENTRY.fullmatch(rest):
        entries = list(getattr(rig.attachments, entry[1]))
        entries[int(entry[2])] = changed
        return replace(rig, attachments=replace(rig.attachments, **{entry[1]: tuple(entries)}))
    return replace(rig, **{table: changed})
