"""Text of extended rig files: the nominal file as it is, and ``[[extensions]]`` tables after it."""

import json
from collections.abc import Sequence

from hbm.rigfiles.extensions import Extension


def extended_rig_text(nominal: str, extensions: Sequence[Extension]) -> str:
    """Text of a rig file with extensions.

    Parameters
    ----------
    nominal : str
        Text of the nominal rig file, kept as it is.
    extensions : sequence of Extension
        In the order in which they are applied.

    Raises
    ------
    ValueError
        If a parameter is not finite; such a cause changes nothing and is left out.
    """
    tables = ["[[extensions]]\n" + "".join(map(_entry, e.table().items())) for e in extensions]
    return "\n".join([nominal.rstrip("\n") + "\n", *tables])


def _entry(item: tuple[str, object]) -> str:
    name, value = item
    if isinstance(value, float) and not abs(value) < float("inf"):
        raise ValueError(f"{name} = {value}; must be finite, leave the extension out")
    text = json.dumps(value, ensure_ascii=False) if isinstance(value, str) else repr(value)
    return f"{name} = {text}\n"
