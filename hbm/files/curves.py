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
from hbm.response.curve import ChannelCurve, NumericalError, ResponseCurve
from hbm.textfiles import Contents, StrPath, check_ending, csv_text, read_rows, why, write_together

SCHEMA = 1
KEYS = ("point", "level", "frequency_hz", "stable", "channel", "peak", "rms")


# ----------------------------------------------------------------------------------------------------- writing


def write_curves(path: StrPath, curves: ResponseCurve | Sequence[ResponseCurve]) -> list[Path]:
    """Write curves and, beside them, their companion.

    Parameters
    ----------
    path : str or path
        CSV file; the companion is :func:`companion` of it.
    curves : ResponseCurve or sequence of them
        One per level, of one rig. Columns go up to the largest H, blank where a curve has fewer.

    Returns
    -------
    list of Path
        Files written.

    Raises
    ------
    InputError
        If there are no curves, or the files cannot be written; then neither is.
    """
    check_ending(path, (".csv",), "write_curves: path")
    return write_together(curve_contents(path, one_or_several(curves, ResponseCurve, "write_curves", "curves")))


def curve_contents(path: StrPath, curves: Sequence[ResponseCurve]) -> Contents:
    """What :func:`write_curves` writes."""
    return with_companion(path, _table(curves), curve_summary(curves))


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


def columns(H: int) -> list[str]:
    """Columns of a curve file."""
    return [*KEYS, "h0", *(f"h{k}_{part}" for k in range(1, H + 1) for part in ("cos", "sin"))]


def _table(curves: Sequence[ResponseCurve]) -> Iterator[list[Any]]:
    """Heading, and the rows of the curves filled with blanks up to the largest H."""
    heading = columns(max(c.basis.H for c in curves))
    yield heading
    for row in chain.from_iterable(map(curve_rows, curves)):
        yield row + [""] * (len(heading) - len(row))


def curve_rows(curve: ResponseCurve) -> Iterator[list[Any]]:
    """Rows of a curve, point by point and channel by channel."""
    stable = _stability(curve)
    channels = {
        name: (c.peak.tolist(), c.rms.tolist(), _in_pairs(c.coefficients)) for name, c in curve.channels.items()
    }
    hz, level = curve.hz.tolist(), float(curve.level)
    for i in range(len(hz)):
        for name, (peak, rms, coefficients) in channels.items():
            yield [i + 1, level, hz[i], stable[i], name, peak[i], rms[i], *coefficients[i]]


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


def curve_summary(curves: Sequence[ResponseCurve]) -> dict[str, Any]:
    """Content of the companion of curves."""
    first = curves[0]
    return {
        "schema": SCHEMA,
        "version": installed_version(),
        "rig": first.rig.name,
        "law": first.rig.law_name,
        "units": {name: channel.unit for name, channel in first.channels.items()},
        "levels": [_level(c) for c in curves],
    }


def _level(curve: ResponseCurve) -> dict[str, Any]:
    known = curve.assessment
    return {
        "level": curve.level,
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
        "folds_hz": list(curve.folds),
        "corners_hz": list(curve.corners),
        "lift_off_hz": list(curve.lift_off),
        "bifurcations": [
            {"kind": b.kind.value, "frequency_hz": b.hz, "level": b.level, "before_point": b.behind + 1}
            for b in curve.bifurcations
        ],
    }


def _error(error: NumericalError) -> dict[str, Any]:
    return {
        "at_peak": asdict(error.at_peak),
        "worst": asdict(error.worst),
        "closure": error.closure,
        "probes": [asdict(p) for p in error.probes],
    }


# ----------------------------------------------------------------------------------------------------- reading


@dataclass(frozen=True, eq=False)
class SavedCurve:
    """A curve read from a file.

    Attributes
    ----------
    level : float
        Force amplitude [N].
    hz : (points,) array
        Excitation frequency [Hz].
    stable : (points,) array
        1, 0, or nan where not computed.
    channels : dict of str to ChannelCurve
        As in :class:`hbm.ResponseCurve`; the unit is empty without the companion.
    summary : dict
        Entries of the companion for this level, empty without it.
    """

    level: float
    hz: Array
    stable: Array
    channels: Mapping[str, ChannelCurve]
    summary: Mapping[str, Any]

    def __getitem__(self, name: str) -> ChannelCurve:
        """Channel by name."""
        return channel_named(self.channels, name)


def read_curves(path: StrPath) -> list[SavedCurve]:
    """Read a curve file and, where there is one, its companion.

    Parameters
    ----------
    path : str or path
        CSV file of :func:`write_curves`.

    Returns
    -------
    list of SavedCurve
        One per level, in the order of the file.

    Raises
    ------
    InputError
        If the file is not a curve file.
    """
    rows = read_rows(path, "a curve file (CSV)")
    heading = next(rows, (0, []))[1]
    H = (len(heading) - len(KEYS) - 1) // 2
    if heading != columns(H):
        raise InputError(f"{path} line 1: {','.join(heading[:9])!r}; must be {','.join(KEYS)},h0,h1_cos,h1_sin,...")
    levels: dict[float, dict[str, list[list[float]]]] = {}
    for line, row in rows:
        level, channel, numbers = parsed(row, len(heading), f"{path} line {line}")
        levels.setdefault(level, {}).setdefault(channel, []).append(numbers)
    summary = summary_of(path)
    units = summary.get("units", {})
    said = {entry["level"]: entry for entry in summary.get("levels", [])}
    return [saved(level, table, units, said.get(level, {})) for level, table in levels.items()]


def parsed(row: list[str], columns: int, where: str) -> tuple[float, str, list[float]]:
    """Level, channel, and the numbers frequency, stable, peak, rms, h0, h1_cos... with nan where blank."""
    if len(row) != columns:
        raise InputError(f"{where}: {len(row)} entries; must have {columns}")
    try:
        numbers = [float(entry) if entry else math.nan for entry in (*row[2:4], *row[5:])]
        return float(row[1]), row[4], numbers
    except ValueError as bad:
        raise InputError(f"{where}: {bad}; must be a number") from None


def saved(
    level: float, table: dict[str, list[list[float]]], units: Mapping[str, str], said: Mapping[str, Any]
) -> SavedCurve:
    """A curve of the numbers of its channels, point by point."""
    arrays = {name: np.array(rows) for name, rows in table.items()}
    first = next(iter(arrays.values()))
    return SavedCurve(
        level=level,
        hz=first[:, 0],
        stable=first[:, 1],
        channels={name: _channel(a, units.get(name, "")) for name, a in arrays.items()},
        summary=said,
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
