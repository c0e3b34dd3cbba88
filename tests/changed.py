"""A rig with another value of one of its numbers, by the key of the rig file."""

import re
from dataclasses import replace

from models import Rig


def changed(rig: Rig, key: str, value: float) -> Rig:
    """The rig with one of its numbers changed."""
    table, _, name = key.partition(".")
    match table, name:
        case "beam", _:
            return replace(rig, body=replace(rig.body, **{name: value}))
        case "channels", _:
            moved, _, field = name.rpartition(".")
            return replace(
                rig, channels=tuple(replace(c, **{field: value}) if c.name == moved else c for c in rig.channels)
            )
        case "attachments", _ if entry := re.match(r"(\w+)\[(\d+)\]\.(\w+)", name):
            kind, i, field = entry[1], int(entry[2]), entry[3]
            entries = list(getattr(rig.attachments, kind))
            entries[i] = entries[i]._replace(**{field: value})
            return replace(rig, attachments=replace(rig.attachments, **{kind: tuple(entries)}))
        case "contact", _ if name.startswith("friction."):
            law = replace(rig.contact.law, **{name.removeprefix("friction."): value})
            return replace(rig, contact=replace(rig.contact, law=law))
        case "frequency_hz", _:
            return rig
    return replace(rig, **{table: replace(getattr(rig, table), **{name: value})})
