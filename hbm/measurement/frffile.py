"""Frequency responses read from files: UFF58, as analysers write them, and CSV.

A CSV file has the columns ``frequency_hz,channel,real,imag,std``, in SI units per newton, for exp(+i omega t). The
standard deviation, of each part, may be empty.

Of UFF58 the data sets of function type 4 are read, in the units that they name. Their responses belong to one place of
the force; or, where a hammer went about, to one sensor: then reciprocity makes its places the channels. Coherence
(function type 6) says how standard deviations compare, not how large they are, for the number of averages is not there.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hbm.errors import InputError
from hbm.fourier import Array
from hbm.measurement.responses import QUANTITIES, Complex, FrequencyResponses
from hbm.measurement.ufffile import DataSet, functions, label_of, place, read_uff, system_of, unit_of
from hbm.measurement.units import to_si
from hbm.textfiles import csv_heading, read_columns

COLUMNS = ("frequency_hz", "channel", "real", "imag", "std")
NUMBERS = ("frequency_hz", "real", "imag", "std")
ENDINGS = (".uff", ".unv")
FRF, COHERENCE = 4, 6
"""Function types of data set 58."""

FORCES = ("N", "kN", "mN", "lbf")

INCOHERENT = 1e-6
"""Least share of noise that a coherence tells, of the power."""


class Line(NamedTuple):
    """Responses of one channel: frequencies, values and standard deviations, (n,); nan where there are none."""

    hz: Array
    H: Complex
    std: Array


def is_frf(path: Path) -> bool:
    """Whether a file holds frequency responses: by its ending, or of CSV by its heading."""
    return path.suffix.lower() in ENDINGS or {"frequency_hz", "real", "imag"} <= csv_heading(path)


def load_responses(path: Path) -> FrequencyResponses:
    """Frequency responses of a file; a quantity is empty where it does not say it.

    Raises
    ------
    InputError
        If it cannot be read, or not what a force does is in it.
    """
    lines, known = _uff(path) if path.suffix.lower() in ENDINGS else (_csv(path), dict[str, str]())
    hz = np.unique(np.concatenate([line.hz for line in lines.values()]))
    H, std = np.full((len(hz), len(lines)), complex(np.nan, np.nan)), np.full((len(hz), len(lines)), np.nan)
    for j, line in enumerate(lines.values()):
        at = np.searchsorted(hz, line.hz)
        H[at, j], std[at, j] = line.H, line.std
    listed = np.isfinite(H)
    stated = bool(np.isfinite(std[listed]).all())
    if not stated:  # then none counts: they are alike at all frequencies of a channel
        std = np.where(listed, np.sqrt(np.nanmean(np.abs(H) ** 2, axis=0)), np.nan)
    channels = {name: known.get(name, "") for name in lines}
    return FrequencyResponses(hz, channels, H, std, sized=stated and path.suffix.lower() not in ENDINGS)


# ---------------------------------------------------------------------------------------------------------------- CSV


def _csv(path: Path) -> dict[str, Line]:
    found: dict[str, list[list[float]]] = {}
    for where, entries in read_columns(path, "frequency responses (CSV)", COLUMNS):
        hz, channel, *numbers = (entry.strip() for entry in entries)
        row = [_number(where, name, text) for name, text in zip(NUMBERS, (hz, *numbers), strict=True)]
        found.setdefault(channel, []).append(row)
    if not found:
        raise InputError(f"{path}: no rows; must have one per frequency and channel")
    return {name: _line(str(path), name, np.array(rows).T) for name, rows in found.items()}


def _number(where: str, name: str, text: str) -> float:
    """A number of a row; nan where a standard deviation is left out."""
    if name == "std" and not text:
        return np.nan
    positive = name in ("frequency_hz", "std")
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value) or (positive and value <= 0.0):
        raise InputError(f"{where}: {name} = {text or 'empty'}; must be a number{' > 0' * positive}")
    return value


def _line(where: str, name: str, columns: Array) -> Line:
    hz, real, imag, std = columns
    order = np.argsort(hz, kind="stable")
    same = np.flatnonzero(np.diff(hz[order]) == 0.0)
    if len(same):
        raise InputError(f"{where}: {name} at {hz[order][same[0]]:g} Hz a second time; must be once")
    return Line(hz[order], (real + 1j * imag)[order], std[order])


# -------------------------------------------------------------------------------------------------------------- UFF58


def _uff(path: Path) -> tuple[dict[str, Line], dict[str, str]]:
    """Responses by channel, and the quantity of each that the file says."""
    sets = read_uff(path)
    found, system = functions(sets, FRF), system_of(sets)
    if not found:
        raise InputError(f"{path}: no frequency response; must have data sets 58 of function type {FRF}")
    coherence = {_places(s): s for s in functions(sets, COHERENCE)}
    lines, quantities = dict[str, Line](), dict[str, str]()
    for name, s in _named(path, found):
        if name in lines:
            raise InputError(f"{path}: response of {name} a second time; must be once")
        factor, unit = _per_newton(path, name, s, system)
        hz, H = np.asarray(s["x"], dtype=float), factor * np.asarray(s["data"], dtype=complex)
        std, beside = np.full(len(hz), np.nan), coherence.get(_places(s))
        if beside is not None and len(beside["data"]) == len(hz):
            seen = np.clip(np.asarray(beside["data"]).real, INCOHERENT, 1.0 - INCOHERENT)
            std = np.abs(H) * np.sqrt((1.0 - seen) / seen)
        kept = (hz > 0.0) & np.isfinite(H)
        if not kept.any():
            raise InputError(f"{path}: response of {name} has no number above 0 Hz; must have some")
        lines[name] = _line(str(path), name, np.array([hz, H.real, H.imag, std])[:, kept])
        if unit:
            quantities[name] = QUANTITIES[unit]
    return lines, quantities


def _places(s: DataSet) -> tuple[str, str]:
    """Where it moves, and where the force acts."""
    return place(s, "rsp"), place(s, "ref")


def _named(path: Path, sets: list[dict[str, Any]]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Responses by the place that differs between them."""
    moving, driven = ({_places(s)[i] for s in sets} for i in (0, 1))
    if len(moving) > 1 and len(driven) > 1:
        raise InputError(
            f"{path}: responses of {len(moving)} places to forces at {len(driven)}; must be to a force at one place, "
            "or of one place"
        )
    for s in sets:
        yield _places(s)[0 if len(driven) == 1 else 1], s


def _per_newton(path: Path, name: str, s: DataSet, system: DataSet) -> tuple[float, str]:
    """Factor to SI per newton of a response, and the SI unit of its numerator, empty where the file does not say."""
    (up, down), whose = _labels(s), str(path)
    motion, motion_per = unit_of(s, "ordinate", up, system)
    force, force_per = unit_of(s, "orddenom", down, system)
    (by_motion, unit), (by_force, newton) = to_si(whose, name, motion), to_si(whose, f"the force of {name}", force)
    if newton not in ("", "N") or unit == "N":
        raise InputError(f"{path}: {name} is in {unit or '1'} per {newton or '1'}; must be a motion per force")
    return by_motion / motion_per / (by_force / force_per), unit


def _labels(s: DataSet) -> tuple[str, str]:
    """Units of motion and force as labelled; some write both into one label, ``g/N``."""
    up, down = label_of(s, "ordinate"), label_of(s, "orddenom")
    motion, _, force = up.rpartition("/")
    return (motion.strip("()"), force) if force in FORCES and down in ("", force) else (up, down)
