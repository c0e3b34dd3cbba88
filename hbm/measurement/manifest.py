"""Files of a campaign with the frequency, level, channels and units of each, from a list or a folder.

A manifest is a CSV file with the columns ``file,frequency_hz`` and, where there is something to say, ``level``,
``channels``, ``units``, ``begin_s`` and ``end_s``, the part of the file that is one steady state; or a TOML file with a
``[[records]]`` table for each recording and ``[channels]`` and ``[units]`` for all of them. Files are looked for beside
the manifest.
"""

import csv
import io
import math
import re
import tomllib
import warnings
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, combinations
from pathlib import Path
from typing import Any

from hbm.errors import InputError
from hbm.measurement.historyfile import READERS
from hbm.measurement.recording import Recording
from hbm.textfiles import refuse_endless, why
from models.plausible import PlausibilityWarning

COLUMNS = ("file", "frequency_hz", "level", "channels", "units", "begin_s", "end_s")
NAMES = ("manifest.csv", "manifest.toml")
KIND = "a manifest"

FREQUENCY = re.compile(r"(?<![0-9.])([0-9]+(?:[.,][0-9]+)?)[ _-]?Hz(?![A-Za-z])", re.IGNORECASE)
LEVEL = re.compile(r"(?<![0-9.])([0-9]+(?:[.,][0-9]+)?)[ _-]?N(?![A-Za-z])")
"""Pattern of frequency and level in file names: ``sweep_48.5Hz_2N.csv``."""


@dataclass(frozen=True)
class Entry:
    """One recording of a campaign.

    Attributes
    ----------
    file : Path
    hz, level : float or None
        Excitation frequency [Hz] and nominal force amplitude [N]; None where nothing is said.
    channels : dict of str to str
        Name of a channel to its column in the file; empty for all under their own names.
    units : dict of str to str
        Units of channels, where the file does not say them.
    begin, end : float
        Part of the file that is the recording [s].
    """

    file: Path
    hz: float | None = None
    level: float | None = None
    channels: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    begin: float = -math.inf
    end: float = math.inf

    def part(self, recorded: Recording) -> Recording:
        """What of its file is the recording.

        Raises
        ------
        InputError
            If that is fewer than three samples.

        Warns
        -----
        models.plausible.PlausibilityWarning
            Of a begin or an end beyond the file, where more than a sample is missing.
        """
        kept, few = recorded.between(self.begin, self.end), 1.5 * recorded.step
        for name, value, beyond in (
            ("begin_s", self.begin, recorded.time[0] - self.begin),
            ("end_s", self.end, self.end - recorded.time[-1]),
        ):
            if math.isfinite(value) and beyond > few:
                said = f"{recorded.source}: {name} = {value:g} s is not in it; it has {recorded.span}"
                warnings.warn(said, PlausibilityWarning, stacklevel=2)
        return kept


def entries_of(paths: Iterable[Path]) -> list[Entry]:
    """Recordings of a campaign, in the order in which they are given.

    Parameters
    ----------
    paths : iterable of Path
        Each a recording, a manifest, or a folder: with a manifest in it, ``manifest.csv`` or ``manifest.toml``, what
        that lists; without one all recordings in it, sorted by name, with the frequency and level that their names say,
        ``run_48.5Hz_2N.csv``.

    Raises
    ------
    InputError
        If a manifest or a folder cannot be read or says something that is not accepted.

    Warns
    -----
    models.plausible.PlausibilityWarning
        Of recordings that have samples in common.
    """
    entries = [entry for path in paths for entry in _of_path(path)]
    of_file = defaultdict(list)
    for i, entry in enumerate(entries, start=1):
        of_file[entry.file].append((i, entry))
    for (i, one), (j, other) in chain.from_iterable(combinations(same, 2) for same in of_file.values()):
        apart = one.end <= other.begin or other.end <= one.begin
        if one.channels == other.channels and not apart:
            said = f"{one.file}: records {i} and {j} overlap; what they have in common counts twice"
            warnings.warn(said, PlausibilityWarning, stacklevel=2)
    return entries


def _of_path(path: Path) -> Sequence[Entry]:
    if not path.exists():
        raise InputError(f"{path}: no such file or folder; must be a time history, a manifest or a folder")
    if path.is_dir():
        return _of_folder(path)
    if path.suffix.lower() == ".toml":
        return list(_of_toml(path))
    if path.suffix.lower() == ".csv" and _lists_files(path):
        return list(_of_csv(path))
    return [Entry(path)]


# -------------------------------------------------------------------------------------------------------------- folder


def _of_folder(folder: Path) -> Sequence[Entry]:
    for name in NAMES:
        if (folder / name).is_file():
            return _of_path(folder / name)
    files = sorted((f for f in folder.iterdir() if f.suffix.lower() in READERS), key=_natural)
    if not files:
        raise InputError(f"{folder}: no recordings; must have files that end in {' or '.join(READERS)}")
    return [Entry(file, _in_name(FREQUENCY, file), _in_name(LEVEL, file)) for file in files]


def _natural(file: Path) -> list[Any]:
    """Sort ``run2`` before ``run10``."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"([0-9]+)", file.name)]


def _in_name(pattern: re.Pattern[str], file: Path) -> float | None:
    found = pattern.findall(file.stem)
    value = float(found[0].replace(",", ".")) if len(found) == 1 else 0.0
    return value if value > 0.0 else None


# ------------------------------------------------------------------------------------------------------------------ CSV


def _lists_files(path: Path) -> bool:
    """Whether the first column of a CSV file has files, and not the time."""
    try:
        with path.open(encoding="utf-8-sig") as stream:
            return re.match(r"\s*\"?file\"?\s*[,;\t]", stream.readline()) is not None
    except (OSError, UnicodeDecodeError):
        return False


def _of_csv(path: Path) -> Iterator[Entry]:
    text = _text(path)
    heading = text.partition("\n")[0]
    delimiter = next(mark for mark in ("\t", ";", ",") if mark in heading)
    rows = [[cell.strip() for cell in row] for row in csv.reader(io.StringIO(text), delimiter=delimiter)]
    names = rows[0]
    for name in names:
        if name not in COLUMNS or names.count(name) > 1:
            raise InputError(f'{path} line 1: column "{name}"; must be each once of {", ".join(COLUMNS)}')
    listed = [(line, row) for line, row in enumerate(rows[1:], start=2) if any(row)]
    if not listed:
        raise InputError(f"{path}: no files; must have one row per recording")
    for line, row in listed:
        where = f"{path} line {line}"
        if len(row) != len(names):
            raise InputError(f"{where}: {len(row)} entries; must have {len(names)}")
        said: dict[str, Any] = {name: cell for name, cell in zip(names, row, strict=True) if cell}
        for name in ("channels", "units"):
            said |= {name: _pairs(where, name, said[name])} if name in said else {}
        for name in ("frequency_hz", "level", "begin_s", "end_s"):
            said |= {name: _number(where, name, said[name])} if name in said else {}
        yield _entry(path, where, said, {}, {})


def _pairs(where: str, name: str, text: str) -> dict[str, str]:
    """``force=Load cell|a1=Acc 1`` as a table."""
    pairs = [part.partition("=") for part in text.split("|")]
    if not all(key.strip() and value.strip() for key, _, value in pairs):
        raise InputError(f'{where}: {name} = "{text}"; must be NAME=VALUE|NAME=VALUE')
    return {key.strip(): value.strip() for key, _, value in pairs}


def _number(where: str, name: str, text: str) -> float:
    try:
        return float(text.replace(",", "."))
    except ValueError:
        raise InputError(f'{where}: {name} = "{text}"; must be a number') from None


# ----------------------------------------------------------------------------------------------------------------- TOML


def _of_toml(path: Path) -> Iterator[Entry]:
    text = _text(path)
    try:
        said = tomllib.loads(text)
    except tomllib.TOMLDecodeError as refused:
        raise InputError(f"{path}: {refused}; must be {KIND} (TOML)") from None
    except (ValueError, RecursionError):  # integers of thousands of digits, arrays nested thousands deep
        raise InputError(f"{path}: is too deep, or a number too long; must be {KIND} (TOML)") from None
    for key in said:
        if key not in ("records", "channels", "units"):
            raise InputError(f"{path}: {key}; must be one of records, channels, units")
    common = {name: _texts(str(path), name, said.get(name, {})) for name in ("channels", "units")}
    records = said.get("records", [])
    if not isinstance(records, list) or not records or not all(isinstance(r, dict) for r in records):
        raise InputError(f"{path}: no records; must have a [[records]] table for each file")
    for number, record in enumerate(records, start=1):
        yield _entry(path, f"{path} records[{number}]", record, common["channels"], common["units"])


def _texts(where: str, name: str, table: Any) -> dict[str, str]:
    if not isinstance(table, dict) or not all(isinstance(value, str) for value in table.values()):
        raise InputError(f'{where}: {name}; must be a table of texts, such as a1 = "g"')
    return table


# --------------------------------------------------------------------------------------------------------------- common


def _entry(
    path: Path, where: str, said: Mapping[str, Any], channels: Mapping[str, str], units: Mapping[str, str]
) -> Entry:
    for key in said:
        if key not in COLUMNS:
            raise InputError(f"{where}: {key}; must be one of {', '.join(COLUMNS)}")
    file = said.get("file")
    if not isinstance(file, str) or not file:
        raise InputError(f"{where}: no file; must have one")
    refuse_endless(path.parent / file, f'{where}: file = "{file}"')
    return Entry(
        file=path.parent / file,
        hz=_positive(where, "frequency_hz", said, "Hz"),
        level=_positive(where, "level", said, "N"),
        channels={**channels, **_texts(where, "channels", said.get("channels", {}))},
        units={**units, **_texts(where, "units", said.get("units", {}))},
        begin=_time(where, "begin_s", said, -math.inf),
        end=_time(where, "end_s", said, math.inf),
    )


def _time(where: str, name: str, said: Mapping[str, Any], otherwise: float) -> float:
    value = said.get(name, otherwise)
    if isinstance(value, bool) or not isinstance(value, int | float) or math.isnan(value):
        raise InputError(f"{where}: {name} = {value}; must be a number [s]")
    return float(value)


def _positive(where: str, name: str, said: Mapping[str, Any], unit: str) -> float | None:
    value = said.get(name)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < math.inf:
        raise InputError(f"{where}: {name} = {value}; must be a number > 0 [{unit}]")
    return float(value)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as refused:
        raise InputError(f"{path}: cannot be read ({why(refused)}); must be {KIND}") from None
