"""Text files: rows of CSV in and out, and writing files that appear complete or not at all."""

import csv
import io
import json
import os
import re
import stat
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from hbm.errors import InputError
from hbm.interrupts import held

StrPath = str | os.PathLike[str]
Contents = Mapping[Path, str | bytes]
"""What files hold, for :func:`write_together`."""
DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d*([eE][+-]?\d+)?\s*")
"""A number with one."""


def csv_text(rows: Iterable[Iterable[Any]]) -> str:
    """Rows as the text of a CSV file."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)  # floats by repr: every digit
    return text.getvalue()


def delimiter_of(heading: str) -> str:
    """What separates the columns of a CSV file, by its heading: tabs or semicolons where there are any, else commas."""
    return next((mark for mark in "\t;" if mark in heading), ",")


def read_rows(path: StrPath, kind: str) -> Iterator[tuple[int, list[str]]]:
    """Rows of a CSV file with the numbers of their lines; empty lines are left out.

    Where tabs or semicolons separate its columns, the decimal commas of numbers become points.

    Raises
    ------
    InputError
        If it cannot be read: it must be `kind`.
    """
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as refused:
        raise InputError(f"{path}: cannot be read ({why(refused)}); must be {kind}") from None
    delimiter = delimiter_of(next(filter(str.strip, text.splitlines()), ""))
    rows = csv.reader(io.StringIO(text), delimiter=delimiter)
    return _numbered(rows if delimiter == "," else map(_with_points, rows), path, kind)


def _with_points(row: list[str]) -> list[str]:
    return [cell.replace(",", ".") if DECIMAL_COMMA.fullmatch(cell) else cell for cell in row]


def read_columns(path: StrPath, kind: str, columns: Sequence[str]) -> Iterator[tuple[str, list[str]]]:
    """Entries of some columns of a CSV file, whatever their order and whatever else it has, each row with its place.

    Raises
    ------
    InputError
        If it cannot be read, a column is not there once, or a row is not as long as the heading.
    """
    rows = read_rows(path, kind)
    line, heading = next(rows, (1, []))
    names = [name.strip() for name in heading]
    if missing := [name for name in columns if names.count(name) != 1]:
        raise InputError(
            f"{path} line {line}: no column {', '.join(missing)}; must have {','.join(columns)}, each once"
        )
    at = [names.index(name) for name in columns]
    for line, row in rows:
        where = f"{path} line {line}"
        if len(row) != len(names):
            raise InputError(f"{where}: {len(row)} entries; must have {len(names)}")
        yield where, [row[i] for i in at]


def csv_heading(path: StrPath) -> set[str]:
    """Names in the heading of a CSV file; none of what is no such file, or cannot be read: who reads it says why."""
    if Path(path).suffix.lower() != ".csv" or not Path(path).is_file():
        return set()
    try:
        with Path(path).open(encoding="utf-8-sig", newline="") as stream:  # the heading alone, of what may be long
            first = next(filter(str.strip, stream), "")
        heading = next(csv.reader([first], delimiter=delimiter_of(first)), [])
    except (OSError, UnicodeDecodeError, csv.Error):
        return set()
    return {name.strip() for name in heading}


def _numbered(rows: Iterable[list[str]], path: StrPath, kind: str) -> Iterator[tuple[int, list[str]]]:
    try:
        yield from ((line, row) for line, row in enumerate(rows, start=1) if row)
    except csv.Error as refused:  # a quotation mark that is never closed
        raise InputError(f"{path}: cannot be read ({refused}); must be {kind}") from None


def check_ending(path: StrPath, endings: Sequence[str], where: str) -> None:
    """Refuse a file of another kind; arguments as of :func:`check_output`.

    Raises
    ------
    InputError
    """
    if Path(path).suffix.lower() not in endings:
        raise InputError(f"{_said(path, where)}; must end in {' or '.join(endings)}")


def _said(path: StrPath, where: str) -> str:
    return f"{where} = {json.dumps(str(path), ensure_ascii=False)}"


def check_output(path: StrPath, endings: Sequence[str], where: str) -> None:
    """Refuse an output file that could not be written, before anything is computed.

    Parameters
    ----------
    path : str or path
    endings : sequence of str
        Accepted endings such as ``.csv``.
    where : str
        Option that names the file, for messages.

    Raises
    ------
    InputError
    """
    check_ending(path, endings, where)
    path, said = Path(path), _said(path, where)
    if path.is_dir():
        raise InputError(f"{said}; is a directory, must be a file")
    if not path.parent.is_dir():
        raise InputError(f"{said}; there is no directory {str(path.parent)!r}, create it first")
    if not os.access(path.parent, os.W_OK):
        raise InputError(f"{said}; directory {str(path.parent)!r} cannot be written")


def write_together(contents: Contents) -> list[Path]:
    """Write files through temporary ones beside them: all appear complete, or none.

    Returns
    -------
    list of Path
        Files written, in order.

    Raises
    ------
    InputError
        If one cannot be written; nothing is left behind then.
    """
    written: dict[Path, Path] = {}
    placed: list[Path] = []
    try:
        for path, content in contents.items():
            written[path] = _temporary(path, content)
        with held():
            for path, temporary in written.items():
                os.replace(temporary, path)
                placed.append(path)
    except OSError as refused:
        for path in placed:  # its companion is missing
            path.unlink(missing_ok=True)
        name = next((p for p in contents if p not in written), refused.filename2 or refused.filename)
        raise InputError(
            f"{name}: cannot be written ({why(refused)}); must be a file in a writable directory"
        ) from None
    finally:
        for temporary in written.values():
            temporary.unlink(missing_ok=True)
    return list(contents)


def _temporary(path: Path, content: str | bytes) -> Path:
    """Write content into a new file in the directory of `path`."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with open(handle, "wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
        os.chmod(name, 0o666 & ~_umask())  # mkstemp makes files that only the owner can read
    except BaseException:
        with suppress(OSError):
            os.unlink(name)
        raise
    return Path(name)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def refuse_endless(path: StrPath, where: str) -> None:
    """Refuse a pipe or a device that another file names: it may have no end, and is not waited for.

    Raises
    ------
    InputError
    """
    try:
        kind = os.stat(path).st_mode
    except (OSError, ValueError):
        return  # what cannot be read says so where it is read
    if not (stat.S_ISREG(kind) or stat.S_ISDIR(kind)):
        raise InputError(f"{where}: is a pipe or a device; must be a file")


def expect_file(path: StrPath, kind: str) -> None:
    """Refuse what is no file, before a library says it in its own words: it must be `kind`.

    Raises
    ------
    InputError
    """
    given = Path(path)
    if not given.is_file():
        other = "is a pipe or a device" if given.exists() else "no such file"
        raise InputError(f"{path}: {'is a directory' if given.is_dir() else other}; must be {kind}")


def why(refused: Exception) -> str:
    """Why a file was not read or written, in the words of the system."""
    return (getattr(refused, "strerror", None) or str(refused)).lower()


def damage(refused: Exception) -> str:
    """Why a library could not read a file: the system's words, else none of the library's inside."""
    return why(refused) if isinstance(refused, OSError) and refused.strerror else "damaged, or of another format"
