"""Folders of results: refused before anything is computed, written complete or not at all; and their tables."""

import json
import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from hbm.errors import InputError
from hbm.textfiles import Contents, StrPath, csv_text, why, write_together

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

Columns = Mapping[str, npt.NDArray[Any]]
"""A table by its columns, all of one length."""


def check_folder(path: StrPath, names: Iterable[str], where: str) -> None:
    """Refuse a folder that could not be written.

    Parameters
    ----------
    path : str or path
        Must exist or be made in an existing directory.
    names : iterable of str
        Files that will be written, relative to it; ``figures/a.png`` is in a folder of its own.
    where : str
        Option that names the folder, for messages.

    Raises
    ------
    InputError
    """
    path, said = Path(path), f"{where} = {json.dumps(str(path), ensure_ascii=False)}"
    parent = path.absolute().parent
    if path.exists() and not path.is_dir():
        raise InputError(f"{said}; is a file, must be a directory")
    if not parent.is_dir():
        raise InputError(f"{said}; there is no directory {str(path.parent)!r}, create it first")
    if not os.access(path if path.is_dir() else parent, os.W_OK | os.X_OK):
        raise InputError(f"{said}; directory {str(path if path.is_dir() else path.parent)!r} cannot be written")
    for name in names:
        inside = [path / folder for folder in Path(name).parents if folder != Path()]
        blocked = next((folder for folder in inside if folder.exists() and not folder.is_dir()), None)
        if blocked is not None:
            raise InputError(f"{said}; {str(blocked)!r} is a file, must be a directory")
        if (path / name).is_dir():
            raise InputError(f"{said}; {str(path / name)!r} is a directory, must be a file")


def write_folder(
    path: StrPath, contents: Mapping[str, str | bytes], owned: Iterable[str] = (), beside: Contents | None = None
) -> list[Path]:
    """Write files into a folder: all appear complete, or none; what else is in the folder stays.

    Parameters
    ----------
    path : str or path
        Made where it does not exist.
    contents : mapping of str to str or bytes
        By file, relative to the folder.
    owned : iterable of str
        Files of an earlier run that are removed if they are not among `contents`.
    beside : mapping of Path to str or bytes, optional
        Files elsewhere that belong to the same result.

    Returns
    -------
    list of Path
        Files written, in order.

    Raises
    ------
    InputError
        If one cannot be written; folders that were made are removed again.
    """
    path = Path(path)
    check_folder(path, contents, "folder")
    files = {path / name: content for name, content in contents.items()}
    made: list[Path] = []
    try:
        for folder in sorted({path, *(file.parent for file in files)}):
            if not folder.is_dir():
                folder.mkdir()
                made.append(folder)
        with _alone(path):
            write_together({**files, **(beside or {})})
            for file in (path / name for name in set(owned) - set(contents)):
                file.unlink(missing_ok=True)
                with suppress(OSError):  # a folder that holds others, or is not there
                    file.parent.rmdir()
    except BaseException as failed:
        for folder in reversed(made):
            with suppress(OSError):  # another run has put its files there
                folder.rmdir()
        if isinstance(failed, OSError):
            raise InputError(f"{failed.filename}: cannot be made ({why(failed)}); must be a directory") from None
        raise
    return list(files)


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Keep other runs from writing into a folder meanwhile: its files are those of one run."""
    if fcntl is None:
        yield
        return
    opened = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):  # file systems without locks
            fcntl.flock(opened, fcntl.LOCK_EX)
        yield
    finally:
        os.close(opened)  # and unlocked


def columns_text(columns: Columns) -> str:
    """Columns as the text of a CSV file."""
    return csv_text(column_rows(columns))


def column_rows(columns: Columns) -> list[list[Any]]:
    """Heading and rows of columns; blank where a number is not finite."""
    lists = [values.tolist() for values in columns.values()]
    return [list(columns), *([_entry(value) for value in row] for row in zip(*lists, strict=True))]


def columns_of(names: Sequence[str], rows: Iterable[Sequence[Any]]) -> Columns:
    """Rows as named columns."""
    listed = list(rows)
    return {name: np.array([row[i] for row in listed]) for i, name in enumerate(names)}


def json_text(entry: Any) -> str:
    """Text of a JSON file; numbers that are not finite, which JSON has not, are null."""
    return json.dumps(_finite(entry), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _finite(entry: Any) -> Any:
    """Numbers that are not finite as None, those of NumPy as plain ones."""
    if isinstance(entry, dict):
        return {key: _finite(value) for key, value in entry.items()}
    if isinstance(entry, list | tuple):
        return [_finite(value) for value in entry]
    if isinstance(entry, np.generic):
        entry = entry.item()
    return None if isinstance(entry, float) and not math.isfinite(entry) else entry


def companion(path: StrPath) -> Path:
    """The JSON file beside a table, with what a table of points has no place for."""
    return Path(path).with_suffix(".json")


def with_companion(path: StrPath, rows: Iterable[Sequence[Any]], summary: Mapping[str, Any]) -> Contents:
    """Contents of a table and of its companion."""
    return {Path(path): csv_text(rows), companion(path): json_text(summary)}


def _entry(value: Any) -> Any:
    if isinstance(value, bool):
        return int(value)
    return "" if isinstance(value, float) and not math.isfinite(value) else value
