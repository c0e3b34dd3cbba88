"""Data sets 58 of UFF files, functions at nodes: where they are and in which units."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hbm.errors import InputError
from hbm.labelled import extra
from hbm.textfiles import damage, expect_file

DataSet = Mapping[str, Any]
"""As pyuff reads it."""

TYPES = {"N": 13, "m/s2": 12, "m/s": 11, "m": 8}
"""Specific data types by unit: excitation force, acceleration, velocity, displacement."""

UNITS_OF_TYPES = {number: unit for unit, number in TYPES.items()} | {9: "N"}  # 9: a reaction


def read_uff(path: Path) -> list[dict[str, Any]]:
    """All data sets of a file.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    expect_file(path, "a UFF file")
    reader = extra("pyuff", str(path))
    try:
        sets = reader.UFF(str(path)).read_sets()
    except Exception as refused:  # pyuff raises bare exceptions
        raise InputError(f"{path}: cannot be read ({damage(refused)}); must be a UFF file") from None
    return sets if isinstance(sets, list) else [sets]


def functions(sets: Sequence[dict[str, Any]], kind: int) -> list[dict[str, Any]]:
    """The data sets 58 of a function type."""
    return [s for s in sets if s.get("type") == 58 and s.get("func_type") == kind]


def system_of(sets: Sequence[dict[str, Any]]) -> DataSet:
    """Data set 164, units of the file in those of SI; empty where there is none."""
    return next((s for s in sets if s.get("type") == 164), {})


def place(s: DataSet, end: str) -> str:
    """Node and direction of the response, ``rsp``, or of the reference, ``ref``: ``3+Y``."""
    return f"{int(s[f'{end}_node'])}{_direction(int(s[f'{end}_dir']))}"


def _direction(code: int) -> str:
    """Direction of data set 58: +Y for 2, -Z for -3, +RX for 4."""
    axes = ("", "X", "Y", "Z", "RX", "RY", "RZ")
    return f"{'-' if code < 0 else '+'}{axes[abs(code)]}" if 0 < abs(code) < len(axes) else ""


def label_of(s: DataSet, axis: str) -> str:
    """Unit that an axis, ``ordinate`` or its denominator ``orddenom``, is labelled with; empty where it is not."""
    label = str(s.get(f"{axis}_axis_units_lab", "")).strip()
    return "" if label == "NONE" else label


def unit_of(s: DataSet, axis: str, label: str, system: DataSet) -> tuple[str, float]:
    """Unit of an axis, and what its values are divided by: that of its label, or SI by the units of the file."""
    if label:
        return label, 1.0
    unit = UNITS_OF_TYPES.get(int(s.get(f"{axis}_spec_data_type", 0)), "")
    return unit, float(system.get("force" if unit == "N" else "length", 1.0)) if unit else 1.0
