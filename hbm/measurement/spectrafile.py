"""Spectra files: measured harmonic coefficients read, checked and written, docs/reference/data_files.md.

The CSV file is the contract; NPZ, NetCDF and MAT files hold the same numbers and are read back through the same checks,
see :mod:`hbm.measurement.exchange`. A record is one steady state: what a file names by text may have many, at other
levels and frequencies, and each is a record. Lines that begin with ``#`` are comments; ``# record 3: a1 is not
steady`` is what ``hbm spectra`` warned of, and goes on to whatever is made of the record.
"""

import json
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hbm.errors import InputError, expect_rig
from hbm.measurement.exchange import (
    mat_bytes,
    mat_rows,
    netcdf_bytes,
    netcdf_rows,
    note_lines,
    npz_bytes,
    npz_rows,
    uff_bytes,
)
from hbm.measurement.inband import warn_far_below, warn_in_radians
from hbm.measurement.repeatability import with_std
from hbm.measurement.spectra import AT, MeasuredSpectra
from hbm.textfiles import StrPath, csv_text, expect_file, read_rows, write_together
from models.jointed import AnyRig
from models.plausible import impossible

COLUMNS = ("record", "level", "frequency_hz", "channel", "harmonic", "cos", "sin", "std")
READ = (".csv", ".npz", ".nc", ".mat")
WRITTEN = (*READ, ".uff")
LARGEST_HARMONIC = 8192

SMALLEST_STD, RESOLVED = 1e-30, 1e-20
"""Least standard deviation, in any unit and of a coefficient: a reading has 16 digits, a mean of 1e8 of them 20."""

WHOLE = re.compile(r"[+-]?[0-9]{1,15}")
NOTE = re.compile(r"#\s*record (?P<record>.+?): (?P<text>.+)")
LONGEST_NAME = 100
HOW_STD = "estimate it from the time history with hbm spectra"


State = tuple[str, float, float]
"""Name, level and frequency of a steady state."""


class Row(NamedTuple):
    """One pair of coefficients and its place in the file; its standard deviation is nan where none is given."""

    where: str
    record: str
    level: float
    hz: float
    channel: str
    harmonic: int
    cos: float
    sin: float
    std: float


# ------------------------------------------------------------------------------------------------------------ reading


def _refuse_copies(spectra: MeasuredSpectra) -> None:
    """Refuse records that are others to the last digit: they say nothing of what does not repeat, and count twice."""
    first: dict[bytes, int] = {}
    for i, (hz, coefficients) in enumerate(zip(spectra.hz, spectra.coefficients, strict=True)):
        before = first.setdefault(hz.tobytes() + coefficients.tobytes(), i)
        if before != i:
            copy, record = (spectra.label(int(spectra.records[j])) for j in (i, before))
            raise InputError(
                f"{spectra.source}: record {copy} is a copy of record {record}; must be measured anew, or left out"
            )


def load_spectra(path: StrPath, rig: AnyRig | None = None, *, repeatability: float = 0.0) -> MeasuredSpectra:
    """Read a spectra file.

    Parameters
    ----------
    path : str or path
        CSV, NPZ, NetCDF or MAT file, by its ending.
    rig : Rig, optional
        Its channels are accepted, in any order of rows; what only a simulation knows, such as ``drive``, is left out.
        Without a rig all channels are, in the order of the file.
    repeatability : float
        Share of a response, 0.01 for 1 %, that stands in for standard deviations that the file does not give and
        records measured more than once do not show.

    Returns
    -------
    MeasuredSpectra

    Raises
    ------
    InputError
        If the file cannot be read or says something that is not accepted.

    Warns
    -----
    models.plausible.PlausibilityWarning
        Of frequencies that look as if in kHz or in rad/s.
    """
    if rig is not None:
        expect_rig(rig, "load_spectra", joints=True)
    source, ending = str(path), Path(path).suffix.lower()
    if ending not in READ:
        raise InputError(f"{source}: not a spectra file; must end in {' or '.join(READ)}")
    expect_file(source, "a spectra file")
    tables = {".csv": _csv_rows, ".npz": npz_rows, ".nc": netcdf_rows, ".mat": mat_rows}
    rows = list(tables[ending](path))
    said = [NOTE.fullmatch(",".join(cells).strip()) for _, cells in rows if _is_note(cells)]
    numbers = (_row(where, cells) for where, cells in rows if not _is_note(cells))
    notes = [(note["record"], note["text"]) for note in said if note is not None]
    spectra = _assembled(source, numbers, rig, notes)
    _refuse_copies(spectra)
    if rig is not None:
        warn_far_below(rig, spectra)
        warn_in_radians(rig, spectra)
    return with_std(rig, spectra, repeatability)


def _is_note(cells: list[str]) -> bool:
    return cells[0].startswith("#")


def _csv_rows(path: StrPath) -> Iterator[tuple[str, list[str]]]:
    rows = read_rows(path, "a spectra file (CSV)")
    line, heading = next(rows, (1, []))
    if not heading:
        raise InputError(f"{path}: is empty; must have the columns {','.join(COLUMNS)}")
    columns = [name.strip() for name in heading]
    if sorted(columns) not in (sorted(COLUMNS), sorted(COLUMNS[:-1])):
        raise InputError(f"{path} line {line}: {_wrong_heading(columns)}; must be {','.join(COLUMNS)}")
    at = [columns.index(name) for name in COLUMNS if name in columns]
    for line, row in rows:
        where = f"{path} line {line}"
        if _is_note(row):
            yield where, row
            continue
        if len(row) != len(columns):
            raise InputError(f"{where}: {len(row)} entries; must have {len(columns)}")
        yield where, [row[i] for i in at] + [""] * (len(COLUMNS) - len(columns))


def _wrong_heading(names: list[str]) -> str:
    missing = [name for name in COLUMNS[:-1] if name not in names]
    unknown = [_shown(name) for name in names if name not in COLUMNS]
    if missing:
        return f"no column {', '.join(missing)}"
    if unknown:
        return f"unknown column {', '.join(unknown)}"
    return f"columns are {','.join(names)}"


def _row(where: str, cells: list[str]) -> Row:
    """Check the entries of one row, in their order."""
    record = _record(where, cells[0].strip())
    level = _positive(where, "level", cells[1], "N")
    hz = _positive(where, "frequency_hz", cells[2], "Hz")
    channel, harmonic = cells[3].strip(), _whole(where, "harmonic", cells[4])
    if not 0 <= harmonic <= LARGEST_HARMONIC:
        raise InputError(f"{where}: harmonic = {harmonic}; must be a whole number from 0 to {LARGEST_HARMONIC}")
    cos, sin = _finite(where, "cos", cells[5]), _finite(where, "sin", cells[6])
    if harmonic == 0 and sin != 0.0:
        raise InputError(f"{where}: sin of harmonic 0 = {sin:g}; must be 0")
    if not cells[7].strip():
        return Row(where, record, level, hz, channel, harmonic, cos, sin, math.nan)
    std = _number(where, "std", cells[7], "must be a number > 0")
    if not 0.0 < std < math.inf:
        raise InputError(f"{where}: std = {std:g}; must be > 0, for each of cos and sin; {HOW_STD}")
    return Row(where, record, level, hz, channel, harmonic, cos, sin, std)


def _record(where: str, name: str) -> str:
    """Name of a record; numbers without signs and zeros in front of them."""
    if WHOLE.fullmatch(name):
        return str(int(name))
    if not 0 < len(name) <= LONGEST_NAME or not name.isprintable() or ": " in name:
        raise InputError(
            f"{where}: record = {_shown(name)}; must be a whole number, or a name of at most {LONGEST_NAME} characters "
            'without ": "'
        )
    return name


def _number(where: str, name: str, text: str, accepted: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{where}: {name} = {_shown(text)}; {accepted}") from None


def _finite(where: str, name: str, text: str) -> float:
    value = _number(where, name, text, "must be a number")
    if not math.isfinite(value):
        raise InputError(f"{where}: {name} = {value}; must be finite, harmonics not measured are left out")
    return value


def _positive(where: str, name: str, text: str, unit: str) -> float:
    value = _number(where, name, text, f"must be a number > 0 [{unit}]")
    if not 0.0 < value < math.inf:
        raise InputError(f"{where}: {name} = {value:g}; must be a number > 0 [{unit}]")
    return value


def _whole(where: str, name: str, text: str) -> int:
    if not WHOLE.fullmatch(text.strip()):
        raise InputError(f"{where}: {name} = {_shown(text)}; must be a whole number")
    return int(text)


def _shown(text: str) -> str:
    """An entry in quotation marks, on one line."""
    return json.dumps(text.strip()[:60], ensure_ascii=False)


def _assembled(
    source: str, rows: Iterable[Row], rig: AnyRig | None, notes: Iterable[tuple[str, str]]
) -> MeasuredSpectra:
    """Put rows into arrays; a row that contradicts an earlier one is refused."""
    quantities = {channel.name: channel.quantity for channel in rig.channels} if rig else {}
    names, computed = list(quantities), rig.computed if rig else ()
    entries: dict[tuple[State, str, int], Row] = {}
    for row in rows:
        if row.channel in computed:
            continue
        if rig and row.channel not in names:
            accepted = f"channels are {', '.join(names)}" if names else "it has none"
            raise InputError(f"{row.where}: channel {_shown(row.channel)} is not in the rig; {accepted}")
        _refuse_impossible(row, quantities.get(row.channel, "reading"))
        key = (row.record, row.level, row.hz), row.channel, row.harmonic
        if key in entries:
            raise InputError(
                f"{row.where}: record {row.record}, {row.channel}, harmonic {row.harmonic} a second time; "
                "must be once in a file"
            )
        entries[key] = row
    if not entries:
        raise InputError(f"{source}: no rows; must have at least one coefficient")
    states = list(dict.fromkeys(state for state, _, _ in entries))
    names = names or list(dict.fromkeys(channel for _, channel, _ in entries))
    if all(WHOLE.fullmatch(name) for name, _, _ in states):
        _refuse_several(entries)
        states.sort(key=lambda state: int(state[0]))
        found = _arrays(source, states, entries, names)
        found = replace(found, records=np.array([int(name) for name, _, _ in states]))
    else:
        found = replace(_arrays(source, states, entries, names), names=_labels(states))
    number = dict(zip(map(str, found.labels), found.records.tolist(), strict=True))
    return replace(found, notes=tuple((number[name], text) for name, text in notes if name in number))


def _labels(states: list[State]) -> tuple[str, ...]:
    """Name of each state: that of its record, with the frequency where that has several, and the level if need be."""
    several = Counter(name for name, _, _ in states)
    by_hz = Counter((name, hz) for name, _, hz in states)
    return tuple(
        name if several[name] == 1 else f"{name}{AT}{hz:.10g}Hz" + (f"{AT}{level:.10g}N" if by_hz[name, hz] > 1 else "")
        for name, level, hz in states
    )


def _refuse_several(entries: Mapping[tuple[State, str, int], Row]) -> None:
    """Refuse several levels or frequencies in a record that has a number."""
    first: dict[str, Row] = {}
    for row in entries.values():
        before = first.setdefault(row.record, row)
        for what, value, other, unit in (
            ("level", row.level, before.level, "N"),
            ("frequency", row.hz, before.hz, "Hz"),
        ):
            if value != other:
                raise InputError(
                    f"{row.where}: record {row.record} has {what} {value:.10g} {unit} and before {other:.10g} {unit}; "
                    "must be the same in a record"
                )


def _refuse_impossible(row: Row, quantity: str) -> None:
    """Refuse numbers that no measurement gives; one of 0 passes, its standard deviation says how sure it is."""
    checked = {"level": "level", "frequency_hz": "frequencies_hz", "cos": quantity, "sin": quantity, "std": quantity}
    for name, (column, range_of) in zip(("level", "hz", "cos", "sin", "std"), checked.items(), strict=True):
        value = getattr(row, name)
        if not math.isnan(value) and (accepted := impossible(range_of, value)) is not None:
            raise InputError(f"{row.where}: {column} = {value!r}; {accepted}")
    least = max(SMALLEST_STD, RESOLVED * math.hypot(row.cos, row.sin))  # nothing is less than a nan
    if row.std < least:
        raise InputError(
            f"{row.where}: std = {row.std!r}; must be >= {least:.3g} beside cos = {row.cos:g}, sin = {row.sin:g}, "
            f"what a mean of readings resolves; {HOW_STD}"
        )


def _arrays(
    source: str, states: list[State], entries: Mapping[tuple[State, str, int], Row], names: list[str]
) -> MeasuredSpectra:
    channels = tuple(name for name in names if any(channel == name for _, channel, _ in entries))
    H = max(harmonic for _, _, harmonic in entries)
    if H == 0:
        raise InputError(f"{source}: has harmonic 0 alone; must have the fundamental, harmonic 1")
    coefficients = np.full((len(states), len(channels), 2 * H + 1), np.nan)
    std = np.full((len(states), len(channels), H + 1), np.nan)
    place = {state: i for i, state in enumerate(states)}
    channel_at = {name: j for j, name in enumerate(channels)}
    for (state, channel, k), row in entries.items():
        i, j = place[state], channel_at[channel]
        coefficients[i, j, k] = row.cos
        if k:
            coefficients[i, j, H + k] = row.sin
        std[i, j, k] = row.std
    _, level, hz = zip(*states, strict=True)
    return MeasuredSpectra(
        source, np.arange(1, len(states) + 1), np.array(level), np.array(hz), channels, coefficients, std
    )


# ------------------------------------------------------------------------------------------------------------ writing


def write_spectra(path: StrPath, spectra: MeasuredSpectra, units: Mapping[str, str] | None = None) -> None:
    """Write a spectra file.

    Parameters
    ----------
    path : str or path
        CSV (every digit), NPZ, NetCDF, MAT or UFF58 file, by its ending.
    spectra : MeasuredSpectra
    units : mapping of str to str, optional
        Units of channels, for the formats that have a place for them.

    Raises
    ------
    InputError
        If the file cannot be written; nothing is written then.
    """
    path = Path(path)
    write_together({path: spectra_content(path, spectra, units)})


def spectra_content(path: Path, spectra: MeasuredSpectra, units: Mapping[str, str] | None = None) -> str | bytes:
    """What :func:`write_spectra` writes."""
    contents = {".npz": npz_bytes, ".nc": netcdf_bytes, ".mat": mat_bytes, ".uff": uff_bytes}
    ending = path.suffix.lower()
    if ending not in WRITTEN:
        raise InputError(f"{path}: not a spectra file; must end in {' or '.join(WRITTEN)}")
    if ending == ".csv":
        notes = "".join(f"{line}\n" for line in note_lines(spectra))
        return csv_text(_table(spectra)) + notes
    return contents[ending](str(path), spectra, units or {})


def _table(spectra: MeasuredSpectra) -> Iterator[list[object]]:
    yield list(COLUMNS)
    H, level, hz, called = spectra.H, spectra.level.tolist(), spectra.hz.tolist(), spectra.labels.tolist()
    coefficients, std = spectra.coefficients.tolist(), spectra.std.tolist()
    for i, j, k in np.argwhere(spectra.measured).tolist():
        pair = (coefficients[i][j][k], coefficients[i][j][H + k] if k else 0.0)
        yield [called[i], level[i], hz[i], spectra.channels[j], k, *pair, std[i][j][k]]
