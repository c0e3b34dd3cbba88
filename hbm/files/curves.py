"""Result files: curves and time histories written and read back, docs/reference/data_files.md.

A curve file (CSV) has a companion of the same name ending in ``.json`` with what a table of points has no
place for: numerical error, folds, corners, lift-off, why the curve ended. Every file appears complete or not at all.
"""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from hbm.errors import InputError, channel_named, one_or_several
from hbm.files.outputs import companion, with_companion
from hbm.files.version import installed_version
from hbm.fourier import Array
from hbm.integration.history import TimeHistory
from hbm.integration.jointed import JointHistory
from hbm.response.assessment import NumericalError
from hbm.response.curve import ChannelCurve, ResponseCurve, expect_alike
from hbm.textfiles import Contents, StrPath, check_ending, csv_text, read_rows, why, write_together
from hbm.tracking.parameterresponse import ParameterCurve
from models.scalars import HZ

SCHEMA = 1
KEYS = ("point", "level", "frequency_hz", "stable", "channel", "peak", "rms")
NUMBER = ("parameter",)
"""Column of the number that curves are along, where that is not the frequency alone: before the harmonics."""


# ----------------------------------------------------------------------------------------------------- writing


def write_curves(path: StrPath, curves: ResponseCurve | Sequence[ResponseCurve]) -> list[Path]:
    """Write curves and, beside them, their companion.

    Parameters
    ----------
    path : str or path
        CSV file; the companion is :func:`companion` of it.
    curves : ResponseCurve or sequence of them
        Of one rig, all along the same: one per level along the frequency, or along the force or another number, whose
        values are then the column ``parameter``. Columns go up to the largest H, blank where a curve has fewer.

    Returns
    -------
    list of Path
        Files written.

    Raises
    ------
    InputError
        If there are no curves, they are not along the same, or the files cannot be written; then neither is.
    """
    check_ending(path, (".csv",), "write_curves: path")
    return write_together(curve_contents(path, one_or_several(curves, ResponseCurve, "write_curves", "curves")))


def curve_contents(path: StrPath, curves: Sequence[ResponseCurve]) -> Contents:
    """What :func:`write_curves` writes."""
    expect_alike(curves, "write_curves")
    return with_companion(path, _table(curves), _summary(curves))


def write_history(path: StrPath, history: TimeHistory | JointHistory, *, contact: bool = False) -> list[Path]:
    """Write a time history, columns ``time_s`` and one per channel.

    Parameters
    ----------
    path : str or path
        CSV file.
    history : TimeHistory
    contact : bool
        Beside the rig's own channels, which could be measured, also the computed ones:
        drive, slip, slip_velocity, friction, normal.

    Returns
    -------
    list of Path
        The file written.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    check_ending(path, (".csv",), "write_history: path")
    return write_together(history_contents(path, history, contact=contact))


def history_contents(path: StrPath, history: TimeHistory | JointHistory, *, contact: bool = False) -> Contents:
    """What :func:`write_history` writes."""
    own = {channel.name for channel in history.rig.channels}
    signals = {name: s.values for name, s in history.channels.items() if contact or name in own}
    columns = zip(history.time.tolist(), *(values.tolist() for values in signals.values()), strict=True)
    return {Path(path): csv_text(chain([["time_s", *signals]], columns))}


def columns(H: int, named: Sequence[str] = ()) -> list[str]:
    """Columns of a curve file; with the number that a curve is along, unless that is the frequency alone."""
    return [*KEYS, *named, "h0", *(f"h{k}_{part}" for k in range(1, H + 1) for part in ("cos", "sin"))]


def _table(curves: Sequence[ResponseCurve]) -> Iterator[list[Any]]:
    """Heading, and the rows of the curves filled with blanks up to the largest H."""
    heading = columns(max(c.basis.H for c in curves), NUMBER if any(map(_named, curves)) else ())
    yield heading
    for row in chain.from_iterable(map(_rows, curves)):
        yield row + [""] * (len(heading) - len(row))


def _named(curve: ResponseCurve) -> bool:
    """Whether a curve has a column for the number that it is traced along."""
    return isinstance(curve, ParameterCurve) or curve.parameter != HZ


def _rows(curve: ResponseCurve) -> Iterator[list[Any]]:
    """Rows of a curve, point by point and channel by channel."""
    stable = _stability(curve)
    channels = {
        name: (c.peak.tolist(), c.rms.tolist(), _in_pairs(c.coefficients)) for name, c in curve.channels.items()
    }
    hz, values, named = curve.hz.tolist(), curve.values.tolist(), _named(curve)
    force = curve.force.tolist() if named else [float(curve.level)] * len(hz)
    for i in range(len(hz)):
        number = [values[i]] if named else []
        for name, (peak, rms, coefficients) in channels.items():
            yield [i + 1, force[i], hz[i], stable[i], name, peak[i], rms[i], *number, *coefficients[i]]


def _in_pairs(harmonics: Array) -> list[list[float]]:
    """Reorder a_0, a_1..a_H, b_1..b_H to a_0, a_1, b_1, a_2, b_2..."""
    H = harmonics.shape[1] // 2
    pairs = np.arange(1, H + 1)
    listed: list[list[float]] = harmonics[:, np.r_[0, np.column_stack([pairs, pairs + H]).ravel()]].tolist()
    return listed


def _stability(curve: ResponseCurve) -> list[str]:
    """1 or 0 where the curve says, blank where it does not, or is in doubt."""
    if curve.stable is None or curve.doubtful is None:
        return [""] * len(curve.points)
    return ["" if doubt else str(int(s)) for s, doubt in zip(curve.stable, curve.doubtful, strict=True)]


# --------------------------------------------------------------------------------------------------- companion


def _summary(curves: Sequence[ResponseCurve]) -> dict[str, Any]:
    """Content of the companion of curves."""
    first = curves[0]
    along = {"parameter": {"key": first.parameter, "unit": first.unit}} if any(map(_named, curves)) else {}
    return {
        "schema": SCHEMA,
        "version": installed_version(),
        "rig": first.rig.name,
        "law": first.rig.law_name,
        "units": {name: channel.unit for name, channel in first.channels.items()},
        "levels": [_level(c) for c in curves],
        **along,
    }


def _level(curve: ResponseCurve) -> dict[str, Any]:
    known, named = curve.assessment, _named(curve)
    hz = "" if named else "_hz"  # along another number in the unit of that, which the companion names
    return {
        "level": curve.points[0].level if named else curve.level,
        "points": len(curve.points),
        "complete": curve.complete,
        "message": curve.branch.message,
        "harmonics": curve.basis.H,
        "samples": curve.basis.N_t,
        "modes": curve.rig.structure.n,
        "reason": known.reason if known else None,
        "warnings": list(known.warnings) if known else [],
        "numerical_error": _error(known.error) if known else None,
        "energy_error": max(abs(p.energy_error) for p in curve.points),
        f"folds{hz}": list(curve.folds),
        f"corners{hz}": list(curve.corners),
        f"lift_off{hz}": list(curve.lift_off),
        "bifurcations": [
            {"kind": b.kind.value, "frequency_hz": b.hz, "level": b.level, "before_point": b.behind + 1}
            | ({"parameter": curve.value_at(b.special.lam)} if named else {})
            | ({} if b.span is None else {"between": list(b.span)})
            for b in curve.bifurcations
        ],
        **(
            {"reason": curve.reason, "numerical_error": _ends_and_peak(curve)}
            if isinstance(curve, ParameterCurve)
            else {}
        ),
    }


def _ends_and_peak(curve: ParameterCurve) -> dict[str, float]:
    return {"ends_and_peak": curve.error}


def _error(error: NumericalError) -> dict[str, Any]:
    return {
        "at_peak": asdict(error.at_peak),
        "worst": asdict(error.worst),
        "closure": error.closure,
        "chosen": error.chosen,
        "probes": [asdict(p) for p in error.probes],
    }


# ----------------------------------------------------------------------------------------------------- reading


@dataclass(frozen=True, eq=False)
class SavedCurve:
    """A curve read from a file.

    Attributes
    ----------
    level : float
        Force amplitude [N]; along the force, that of the first point.
    hz : (points,) array
        Excitation frequency [Hz].
    stable : (points,) array
        1, 0, or nan where not computed.
    channels : dict of str to ChannelCurve
        As in :class:`hbm.ResponseCurve`; the unit is empty without the companion.
    summary : dict
        Entries of the companion for this curve, empty without it.
    parameter, unit : str
        What the curve was traced along, as a key of the rig file, and the unit of that; empty where that was not the
        frequency and there is no companion.
    values : (points,) array
        Values of that.
    """

    level: float
    hz: Array
    stable: Array
    channels: Mapping[str, ChannelCurve]
    summary: Mapping[str, Any]
    parameter: str
    unit: str
    values: Array

    def __repr__(self) -> str:
        """What it is along, from where to where, and its channels."""
        unit = "" if self.unit in ("", "1") else f" {self.unit}"
        return (
            f"curve of {len(self.values)} points, {self.parameter or 'parameter'} from {self.values[0]:.6g} to "
            f"{self.values[-1]:.6g}{unit}, level {self.level:g} N; channels {', '.join(self.channels)}"
        )

    def __getitem__(self, name: str) -> ChannelCurve:
        """Channel by name."""
        return channel_named(self.channels, name)


def read_curves(path: StrPath) -> list[SavedCurve]:
    """Read a curve file and, where there is one, its companion.

    Parameters
    ----------
    path : str or path
        CSV file of :func:`write_curves`, ``hbm frf`` or ``hbm continue``.

    Returns
    -------
    list of SavedCurve
        In the order of the file: along the frequency one per level, and another where points start again.

    Raises
    ------
    InputError
        If the file is not a curve file.
    """
    rows = read_rows(path, "a curve file (CSV)")
    heading = next(rows, (0, []))[1]
    named = NUMBER if NUMBER[0] in heading else ()
    H = (len(heading) - len(KEYS) - len(named) - 1) // 2
    if heading != columns(H, named):
        raise InputError(
            f"{path} line 1: {','.join(heading[:9])!r}; must be {','.join(columns(0, named))},h1_cos,h1_sin,..."
        )
    tables: dict[float | None, list[_Table]] = {}  # by level; along another number there is but one list
    for line, row in rows:
        level, channel, numbers = _parsed(row, len(heading), f"{path} line {line}")
        own = tables.setdefault(None if named else level, [])
        if not own or row[0] in own[-1].seen.get(channel, ()):
            own.append(_Table(level))
        own[-1].add(row[0], channel, numbers)
    summary = summary_of(path)
    said: dict[float, list[dict[str, Any]]] = {}
    for entry in summary.get("levels", []):
        said.setdefault(entry["level"], []).append(entry)
    return [
        _saved(table, summary, said[table.level].pop(0) if said.get(table.level) else {}, named=bool(named))
        for own in tables.values()
        for table in own
    ]


class _Table:
    """Rows of one curve by channel, and the points that each has."""

    def __init__(self, level: float) -> None:
        self.level = level
        self.rows: dict[str, list[list[float]]] = {}
        self.seen: dict[str, set[str]] = {}

    def add(self, point: str, channel: str, numbers: list[float]) -> None:
        """Add a row."""
        self.rows.setdefault(channel, []).append(numbers)
        self.seen.setdefault(channel, set()).add(point)


def _parsed(row: list[str], columns: int, where: str) -> tuple[float, str, list[float]]:
    """Level, channel, and the numbers frequency, stable, peak, rms, ... with nan where blank."""
    if len(row) != columns:
        raise InputError(f"{where}: {len(row)} entries; must have {columns}")
    try:
        numbers = [float(entry) if entry else math.nan for entry in (*row[2:4], *row[5:])]
        return float(row[1]), row[4], numbers
    except ValueError as bad:
        raise InputError(f"{where}: {bad}; must be a number") from None


def _saved(table: _Table, summary: Mapping[str, Any], said: Mapping[str, Any], *, named: bool) -> SavedCurve:
    """A curve of the numbers of its channels, point by point."""
    arrays = {name: np.array(rows) for name, rows in table.rows.items()}
    first = next(iter(arrays.values()))
    units = summary.get("units", {})
    along = summary.get("parameter", {}) if named else {"key": HZ, "unit": "Hz"}
    return SavedCurve(
        level=table.level,
        hz=first[:, 0],
        stable=first[:, 1],
        channels={
            name: _channel(np.delete(a, 4, 1) if named else a, units.get(name, "")) for name, a in arrays.items()
        },
        summary=said,
        parameter=along.get("key", ""),
        unit=along.get("unit", ""),
        values=first[:, 4] if named else first[:, 0],
    )


def _channel(a: Array, unit: str) -> ChannelCurve:
    pairs = a[:, 5:][:, ~np.isnan(a[0, 5:])]  # blank columns belong to a curve of more harmonics
    return ChannelCurve(unit, np.hstack([a[:, 4:5], pairs[:, ::2], pairs[:, 1::2]]), peak=a[:, 2], rms=a[:, 3])


def summary_of(path: StrPath) -> dict[str, Any]:
    """Content of the companion of a curve file, empty without it."""
    beside = companion(path)
    if not beside.exists():
        return {}
    try:
        summary = json.loads(beside.read_text(encoding="utf-8"))
    except (OSError, ValueError) as refused:
        raise InputError(f"{beside}: cannot be read ({why(refused)}); must be the companion of {path}") from None
    if not isinstance(summary, dict) or summary.get("schema") != SCHEMA:
        raise InputError(f"{beside}: not schema {SCHEMA}; must be the companion of {path}")
    return summary
