"""Files of responses along a number of the rig: a curve file with one column more, ``parameter``."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from hbm.errors import InputError
from hbm.files.curves import KEYS, SavedCurve, columns, curve_rows, curve_summary, parsed, saved, summary_of
from hbm.files.outputs import with_companion
from hbm.fourier import Array
from hbm.textfiles import Contents, StrPath, read_rows
from hbm.tracking.parameterresponse import ParameterCurve

PLACE = len(KEYS)
"""Column of the number: behind those that every curve file has, before the harmonics."""


def parameter_contents(path: StrPath, curve: ParameterCurve) -> Contents:
    """Contents of the file of a curve, and of its companion, which names the number.

    Parameters
    ----------
    path : str or path
        CSV file; the companion is :func:`hbm.files.outputs.companion` of it.
    curve : ParameterCurve
    """
    return with_companion(path, _table(curve), _summary(curve))


def _table(curve: ParameterCurve) -> Iterator[list[Any]]:
    top = columns(curve.basis.H)
    yield [*top[:PLACE], "parameter", *top[PLACE:]]
    values, force = curve.values.tolist(), curve.force.tolist()
    for row in curve_rows(curve):
        i = row[0] - 1
        yield [row[0], force[i], *row[2:PLACE], values[i], *row[PLACE:]]


def _summary(curve: ParameterCurve) -> dict[str, Any]:
    summary = curve_summary([curve])
    (level,) = summary["levels"]
    for name in ("folds", "corners", "lift_off"):
        level[name] = level.pop(f"{name}_hz")
    level |= {"reason": curve.reason, "numerical_error": {"ends_and_peak": curve.error}}
    return summary | {"parameter": {"key": curve.parameter, "unit": curve.unit}}


@dataclass(frozen=True, eq=False)
class SavedParameterCurve:
    """A curve along a number, read from a file.

    Attributes
    ----------
    parameter, unit : str
        Key of the number and its unit, empty without the companion.
    values : (points,) array
        Values of the number followed.
    curve : SavedCurve
        Everything else; its level is that of the first point.
    """

    parameter: str
    unit: str
    values: Array
    curve: SavedCurve


def read_parameter_curve(path: StrPath) -> SavedParameterCurve:
    """Read a curve along a number and, where there is one, its companion.

    Parameters
    ----------
    path : str or path
        CSV file of :func:`parameter_contents`.

    Raises
    ------
    InputError
        If the file is not one.
    """
    rows = read_rows(path, "a curve file (CSV)")
    top = next(rows, (0, []))[1]
    H = (len(top) - PLACE - 2) // 2
    expected = columns(H)
    if top != [*expected[:PLACE], "parameter", *expected[PLACE:]]:
        raise InputError(f"{path} line 1: {','.join(top[:9])!r}; must be {','.join(KEYS)},parameter,h0,h1_cos,...")
    table: dict[str, list[list[float]]] = {}
    values: dict[str, float] = {}
    levels: list[float] = []
    for line, row in rows:
        where = f"{path} line {line}"
        level, channel, numbers = parsed(row[:PLACE] + row[PLACE + 1 :], len(top) - 1, where)
        try:
            values[row[0]] = float(row[PLACE])
        except ValueError as bad:
            raise InputError(f"{where}: {bad}; must be a number") from None
        table.setdefault(channel, []).append(numbers)
        levels.append(level)
    summary = summary_of(path)
    said = summary.get("parameter", {})
    curve = saved(levels[0], table, summary.get("units", {}), next(iter(summary.get("levels", [])), {}))
    return SavedParameterCurve(said.get("key", ""), said.get("unit", ""), np.array(list(values.values())), curve)
