"""Time histories in CSV: ours, and what data loggers and spreadsheets export.

Columns are separated by commas, or by semicolons or tabs; with the latter numbers may have decimal commas. The first
column is the time, ``time_s`` or a name with its unit, ``Time (ms)``. Units stand in brackets behind the names, or in a
line of their own beneath them. Lines that begin with ``#`` are comments, as is what stands above the names.
"""

import csv
import io
import json
import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hbm.errors import InputError
from hbm.fourier import Array
from hbm.measurement.recording import KIND, TIMES, Found
from hbm.measurement.units import is_unit, seconds
from hbm.textfiles import delimiter_of, why

BRACKETED = re.compile(r"(?P<name>.*?)\s*(?:\[(?P<square>[^\[\]]*)\]|\((?P<round>[^()]*)\))")
"""A name with a unit behind it."""

WESTERN = frozenset("²³µ°äöüÄÖÜßéèàç")
"""Letters in names and units of files that are not in UTF-8 but in the encoding of Windows."""

MOST_ABOVE = 200
"""Among so many lines names are looked for: exports tell of the recorder, the date and the channels above them."""

TIME_NAMES = (*TIMES, "zeit", "temps", "tiempo")


class _Line(NamedTuple):
    """A line that is no comment, and its number."""

    number: int
    text: str


class _Heading(NamedTuple):
    """Names and units of the columns, what separates them and may end lines, seconds in the unit of time, its lines."""

    names: list[str]
    units: list[str]
    delimiter: str
    scale: float
    lines: int
    ended: bool


def read_csv(path: Path) -> Found:
    """Read a CSV file.

    Raises
    ------
    InputError
        If it cannot be read, has no time, or an entry is not a number.
    """
    lines = [_Line(i, x) for i, x in enumerate(_text(path).splitlines(), start=1) if x.strip() and x.lstrip()[0] != "#"]
    above, heading = next(
        ((i, found) for i in range(min(len(lines), MOST_ABOVE)) if (found := _heading(lines[i : i + 2]))), (0, None)
    )
    if heading is None:
        first = _above_numbers(lines)
        shown = first.text.strip()[:60]
        raise InputError(
            f'{path} line {first.number}: columns "{shown}"; must be time_s, or as Time (ms), and one per channel, '
            "between commas, semicolons or tabs; without times: NPZ or MAT with fs"
        )
    names = heading.names
    for i, name in enumerate(names):
        if name in names[:i]:
            raise InputError(f'{path} line {lines[above].number}: column "{name}" a second time; must be once')
    table = _table(path, lines[above + heading.lines :], heading)
    channels = {name: table[:, i] for i, name in enumerate(names) if i}
    units = {name: unit for name, unit in zip(names, heading.units, strict=True) if unit}
    return Found(heading.scale * table[:, 0], channels, units)


def _text(path: Path) -> str:
    try:
        content = path.read_bytes()
        if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
            return content.decode("utf-16")
        try:
            return content.decode("utf-8-sig")
        except UnicodeDecodeError:
            western = content.decode("cp1252", "replace")
            if {letter for letter in western if not letter.isascii()} <= WESTERN:
                return western
            raise
    except (OSError, UnicodeDecodeError) as refused:
        raise InputError(f"{path}: cannot be read ({why(refused)}); must be {KIND} (CSV)") from None


# ------------------------------------------------------------------------------------------------------------- heading


def _cells(text: str, delimiter: str) -> list[str]:
    """Entries of a line; exports often end each line with a delimiter."""
    text = text.rstrip("\r\n ").removesuffix(delimiter)
    return [cell.strip() for cell in next(csv.reader([text], delimiter=delimiter), [])]


def _heading(lines: Sequence[_Line]) -> "_Heading | None":
    """Names of the columns, if the first of some lines has them, and their units; the second may be these."""
    delimiter = delimiter_of(lines[0].text)
    named = [_named(cell) for cell in _cells(lines[0].text, delimiter)]
    names, units = [name for name, _ in named], [unit for _, unit in named]
    beneath = _cells(lines[1].text, delimiter) if len(lines) > 1 else []
    if below := bool(beneath) and _are_units(beneath, len(names)):
        units = [own or _plain_unit(cell) for own, cell in zip(units, beneath, strict=True)]
    scale = _seconds(names[0], units[0]) if names else None
    if scale is None or len(names) < 2 or not all(names):
        return None
    ended = delimiter != "," or lines[0].text.rstrip().endswith(delimiter)  # a comma may come before what is missing
    return _Heading(names, units, delimiter, scale, 2 if below else 1, ended)


def _above_numbers(lines: Sequence[_Line]) -> _Line:
    """The line above the first that begins with a number, which should be the heading; else the first."""
    number = re.compile(r"\s*[\"+-]?[0-9]")
    for line, beneath in pairwise(lines[:MOST_ABOVE]):
        if number.match(beneath.text) and not number.match(line.text):
            return line
    return lines[0] if lines else _Line(1, "")


def _named(cell: str) -> tuple[str, str]:
    """Name and unit: ``a1 [g]`` and ``a1 (g)`` have one, ``a1 (top)`` has none."""
    said = BRACKETED.fullmatch(cell)
    if said is None or not said["name"]:
        return cell, ""
    if said["square"] is not None:
        return said["name"], said["square"].strip()
    return (said["name"], said["round"].strip()) if is_unit(said["round"]) else (cell, "")


def _are_units(cells: list[str], columns: int) -> bool:
    """Whether a line has units under the names; the time's at least, and numbers nowhere."""
    units = [_plain_unit(cell) for cell in cells]
    return len(cells) == columns and seconds(units[0]) is not None and all(not u or is_unit(u) for u in units)


def _plain_unit(cell: str) -> str:
    return cell.strip("[]() ")


def _seconds(name: str, unit: str) -> float | None:
    """Seconds in the unit of the first column, None if it is not the time."""
    if name == "time_s":
        return 1.0
    return seconds(unit) if unit and name.lower() in TIME_NAMES else None


# ------------------------------------------------------------------------------------------------------------- numbers


def _table(path: Path, lines: list[_Line], heading: _Heading) -> Array:
    """Numbers beneath the heading; if they cannot be read, the first faulty line is named."""
    names, delimiter = heading.names, heading.delimiter
    if not lines:
        raise InputError(f"{path}: no samples; must have one row per sample")
    text = "\n".join(line.text for line in lines)
    if heading.ended:
        text = re.sub(rf"{delimiter}[ \r]*$", "", text, flags=re.MULTILINE)
    if delimiter != ",":
        text = text.replace(",", ".")
    try:
        table = np.loadtxt(io.StringIO(text), delimiter=delimiter, ndmin=2, comments=None, quotechar='"')
        if table.shape[1] == len(names) and np.isfinite(table).all():
            return table
    except ValueError:
        pass
    for line, row in zip(lines, csv.reader(io.StringIO(text), delimiter=delimiter), strict=False):
        _check_row(f"{path} line {line.number}", row, names)
    raise InputError(f"{path}: cannot be read as numbers; must be {KIND} (CSV)")


def _check_row(where: str, row: list[str], names: list[str]) -> None:
    if row and len(row) != len(names):
        raise InputError(f"{where}: {len(row)} entries; must have {len(names)}")
    for name, entry in zip(names, row, strict=False):
        try:
            finite = np.isfinite(float(entry))
        except ValueError:
            finite = False
        if not finite:
            raise InputError(
                f"{where}: {name} = {json.dumps(entry.strip()[:60], ensure_ascii=False)}; must be a finite number"
            )
