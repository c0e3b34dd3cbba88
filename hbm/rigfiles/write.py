"""Extended rig files: the nominal file as it is, and ``[[extensions]]`` tables after it."""

import json
import tomllib
from collections.abc import Sequence
from pathlib import Path

from hbm.rigfiles.extensions import Extension
from hbm.rigfiles.laws import Consent
from hbm.rigfiles.load import rig_of_table
from hbm.textfiles import StrPath, write_together


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


def write_extended_rig(
    path: StrPath, nominal: StrPath, extensions: Sequence[Extension], *, allow_code: bool | None = None
) -> Path:
    """Write a rig file with extensions, after it was read back.

    Parameters
    ----------
    path : str or path
        Where to; files of laws or causes of one's own are looked for beside it.
    nominal : str or path
        Rig file to extend.
    extensions : sequence of Extension
    allow_code : bool, optional
        As :func:`hbm.rigfiles.load.load_rig`, for it is read back.

    Raises
    ------
    InputError
        If a reader would not accept it; nothing is written.
    ValueError
        As :func:`extended_rig_text`.
    """
    text = extended_rig_text(Path(nominal).read_text(encoding="utf-8-sig"), extensions)
    rig_of_table(tomllib.loads(text), str(path), Consent.of_data(allow_code))
    write_together({Path(path): text})
    return Path(path)
