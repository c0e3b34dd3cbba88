"""Rig files that a diagnosis makes: the extended rig, and where nothing was named the candidates that came nearest.

Each is the nominal file as it is, with an extension for each number that was calibrated and for each cause.
"""

import json
import re
import tomllib
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from hbm.diagnosis.misfit import nrmse
from hbm.diagnosis.remainder import percent
from hbm.diagnosis.verdict import Diagnosis, Ranked
from hbm.errors import InputError
from hbm.outputerror.evaluation import Evaluation
from hbm.rigfiles.extensions import Extension
from hbm.rigfiles.laws import Consent
from hbm.rigfiles.load import rig_of_table
from hbm.rigfiles.matrixbody import FILES, file_of
from hbm.rigfiles.write import extended_rig_text
from hbm.textfiles import StrPath, why, write_together
from models.causes.parameter import WrongParameter
from models.causes.sensors import SensorDelay, SensorGain, SensorPosition
from models.jointed import AnyRig

EXTENDED_FILE, CANDIDATES = "extended.toml", "candidates"

MOST_CANDIDATES = 3
"""Candidates that are written where nothing is named, at most."""

LONGEST = 80
"""Characters of a label, which may hold the name of a channel, in the name of a file."""

Contents = dict[str, str | bytes]


def write_extended(path: StrPath, nominal: StrPath, diagnosis: Diagnosis) -> Path:
    """Write the extended rig of a diagnosis, as ``hbm diagnose`` writes ``extended.toml``.

    Parameters
    ----------
    path : str or path
        Rig file to write; :func:`hbm.load_rig` reads it back. Files that it names are copied beside it.
    nominal : str or path
        Rig file that was diagnosed. Its text is kept, and extensions are added beneath it.
    diagnosis : Diagnosis

    Returns
    -------
    Path

    Raises
    ------
    InputError
        If the diagnosis names no cause, or a file cannot be read or written; nothing is written then.
    """
    if diagnosis.extended is None:
        raise InputError(
            f"write_extended: the verdict is {diagnosis.verdict}; must name a cause to have an extended rig"
        )
    try:
        return write_extended_rig(path, nominal, extensions_of(diagnosis.extended_fit, {}))
    except OSError as refused:
        raise InputError(f"write_extended: {refused.filename}: {why(refused)}; must be a rig file") from None


def write_extended_rig(path: StrPath, nominal: StrPath, extensions: Sequence[Extension]) -> Path:
    """Write a rig file with extensions, and copies of the files it names beside it.

    Raises
    ------
    InputError
        If a reader would not accept it; nothing is written.
    ValueError
        As :func:`hbm.rigfiles.write.extended_rig_text`.
    """
    target = Path(path)
    contents = rig_file(target.name, Path(nominal), extensions)
    write_together({target.parent / name: content for name, content in contents.items()})
    return target


def extensions_of(e: Evaluation | None, named: Mapping[type, str]) -> list[Extension]:
    """Extensions that make the rig of a fit of the nominal one: calibrated numbers, then causes."""
    if e is None:
        return []
    out = corrections(e.model.nominal, e.model.calibrated_at(e.x))
    for i, cause in enumerate(e.model.causes):
        out.append(Extension.of(cause, e.model.values(e.x, i), named.get(type(cause), "")))
    return out


def corrections(rig: AnyRig, values: Mapping[str, float]) -> list[Extension]:
    """Extensions that set numbers of a rig file, in an order in which each can be set after those before.

    Modes that are close do not change places on the way, nor does a limit at rest fall below the one in motion.
    """
    left, out = dict(values), list[Extension]()
    while left:
        steps = ((key, _set(rig, key, value)) for key, value in left.items())
        key, rig = next(((k, there) for k, there in steps if there is not None), (next(iter(left)), rig))
        out.append(corrected(key, left.pop(key)))
    return out


def _set(rig: AnyRig, key: str, value: float) -> AnyRig | None:
    """The rig with a number set; None where none can be made."""
    try:
        there = rig.with_number(key, value)
    except ValueError:
        return None
    return None if any(True for _ in there.too_low) else there


def corrected(key: str, value: float) -> Extension:
    """The extension that sets a number of a rig file."""
    table, _, rest = key.partition(".")
    if table != "channels":
        return Extension.of(WrongParameter(key), {"value": value})
    channel, _, name = rest.rpartition(".")
    if name == "gain":
        return Extension.of(SensorGain(channel), {"gain": value})
    if name == "delay":
        return Extension.of(SensorDelay(channel), {"delay_s": value})
    return Extension.of(SensorPosition(channel), {"position": value})


def rigs_of(diagnosis: Diagnosis, nominal: Path, named: Mapping[type, str]) -> Contents:
    """Rig files of a diagnosis by their names in its folder: the extended rig, or candidates where nothing is named.

    Parameters
    ----------
    diagnosis : Diagnosis
    nominal : Path
        Rig file that was diagnosed.
    named : mapping of type to str
        Names of causes of one's own, ``file.py:Class``. The Python files are copied beside the rigs that name them.
    """
    if diagnosis.extended is not None:
        return rig_file(EXTENDED_FILE, nominal, extensions_of(diagnosis.extended_fit, named))
    contents: Contents = {}
    for name, ranked, e in candidates(diagnosis):
        with suppress(ValueError, InputError):  # one that changes nothing, or is none of this rig: not worth a file
            contents |= rig_file(name, nominal, extensions_of(e, named), _not_believed(diagnosis, ranked, e))
    return contents


def candidates(diagnosis: Diagnosis) -> Iterator[tuple[str, Ranked, Evaluation]]:
    """File, place in the ranking and fit of the best candidates of a diagnosis that is `unexplained`."""
    if diagnosis.verdict != "unexplained":
        return
    pairs = zip(diagnosis.ranking, diagnosis.tried, strict=False)
    for i, (ranked, e) in enumerate(list(pairs)[:MOST_CANDIDATES], start=1):
        label = re.sub(r"[^0-9A-Za-z._-]+", "-", ranked.label)[:LONGEST]
        yield f"{CANDIDATES}/{i}-{label}.toml", ranked, e


def earlier_candidates(folder: Path) -> list[str]:
    """Candidates that an earlier run has written into a folder."""
    found = (folder / CANDIDATES).glob("[0-9]-*.toml")
    return [f"{CANDIDATES}/{path.name}" for path in found]


def _not_believed(diagnosis: Diagnosis, ranked: Ranked, e: Evaluation) -> str:
    """Comment at the top of the rig file of a candidate."""
    fitted = percent(nrmse(e.white))
    held = "" if ranked.held_out_nrmse is None else f", and by {percent(ranked.held_out_nrmse)} of those held out"
    return (
        f"# NOT BELIEVED. The verdict of hbm diagnose is {diagnosis.verdict}; {ranked.label} is only a candidate.\n"
        f"# This rig misses the records fitted by {fitted} of their response{held}.\n"
        "# Use it to see what is missed, not to predict: its numbers may mean nothing.\n\n"
    )


def rig_file(name: str, nominal: Path, extensions: Sequence[Extension], heading: str = "") -> Contents:
    """A rig file, read back as a check, and copies of the files it names, which must be beside it."""
    text = heading + extended_rig_text(nominal.read_text(encoding="utf-8-sig"), extensions)
    table = tomllib.loads(text)
    file_name = name.rpartition("/")[2]
    rig_of_table(table, str(nominal.parent / file_name), Consent.NAMED)
    contents = Contents()
    copies: dict[str, str] = {}
    for named, file in files_named(table):
        if file not in copies:
            copies[file] = _free(Path(file).name, copies.values())
            contents[name.removesuffix(file_name) + copies[file]] = (nominal.parent / file).read_bytes()
        there = json.dumps(copies[file] + named.removeprefix(file), ensure_ascii=False)
        for quoted in (json.dumps(named, ensure_ascii=False), f"'{named}'"):
            text = text.replace(quoted, there)
    contents[name] = text
    return contents


def files_named(table: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """What a rig file names files by, ``file``, ``file:key`` or ``file.py:Class``, and the files."""
    code = [joint["law"] for joint in table.get("joints", ())]
    if "contact" in table:
        code.append(table["contact"]["friction"]["law"])
    code += [e["cause"] for e in table.get("extensions", ())]
    yield from ((named, file) for named in dict.fromkeys(code) if (file := named.rpartition(":")[0]).endswith(".py"))
    matrices = [named for key, named in table.get("matrix", {}).items() if key in FILES]
    yield from ((named, file_of(named)) for named in dict.fromkeys(matrices))


def _free(name: str, taken: Collection[str]) -> str:
    """A name for a copy of a file, numbered where another has it."""
    return name if name not in taken else _free(f"another_{name}", taken)
