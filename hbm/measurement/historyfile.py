"""Time histories of measurements read from files: CSV, MAT (v4 to v7.3), NPZ, UFF58, TDMS, and SEP005 dictionaries.

Every reader only finds time, channels and units; :func:`hbm.measurement.recording.recording` checks and converts them.
Without a unit, values must be in SI.

========  ==================================================  ============================  =========================
format    time                                                channel names                 units
========  ==================================================  ============================  =========================
CSV       first column, ``time_s`` or ``Time (ms)``           heading                       heading, line 2, or SI
MAT       ``time_s``, ``time`` or ``t``; or a scalar ``fs``   the other vectors             struct ``units``, or SI
NPZ       the same, or a scalar ``sampling_hz``               the other vectors             SI
UFF58     abscissa, in s; the step has 6 digits in the file   response entity, or node and  axis label, or the system
          and is taken for 1/n s where that is all it can be  direction, ``3+Y``            of data set 164, or SI
TDMS      ``wf_increment``, or a channel ``time_s``           channel, or group/channel     ``unit_string``, or SI
SEP005    ``time`` or ``fs``                                  ``name``                      ``unit_str``
========  ==================================================  ============================  =========================
"""

import logging
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from math import floor, log10
from pathlib import Path
from typing import Any

import numpy as np

from hbm.errors import InputError
from hbm.fourier import Array
from hbm.labelled import extra
from hbm.measurement.csvhistory import read_csv
from hbm.measurement.matfile import load_variables
from hbm.measurement.npzfile import load_npz
from hbm.measurement.recording import DRIVES, KIND, TIMES, Found, Recording, recording, renamed
from hbm.measurement.ufffile import DataSet, functions, label_of, place, read_uff, system_of, unit_of
from hbm.measurement.units import with_sensitivity
from hbm.textfiles import StrPath, damage, expect_file

RATES = ("fs", "sampling_hz")


def load_history(
    source: StrPath | Sequence[Mapping[str, Any]],
    channels: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    *,
    drives: Sequence[str] = DRIVES,
    known: Collection[str] = (),
) -> Recording:
    """Read a measured time history.

    Parameters
    ----------
    source : str, path or list of dict
        CSV, MAT, NPZ, UFF58 (``.uff``, ``.unv``) or TDMS file, by its ending; or SEP005 dictionaries, one per channel.
    channels : mapping of str to str, optional
        Name of a channel to its name in the file; all, under their own names, if omitted. ``time_s`` names the vector
        of the times [s] where the file has several.
    units : mapping of str to str, optional
        Units of channels, by their names here, where the file does not say them: ``g``, ``mm/s``, ``lbf``, whatever
        pint knows of force, acceleration, velocity and displacement; ``100 mV/g`` of a sensor whose volts are read.
    drives : sequence of str
        Channels that may be in volts, such as the voltage of a shaker in place of its force.
    known : collection of str
        Names in the file that are kept beside those of `channels`.

    Returns
    -------
    Recording
        In SI units.

    Raises
    ------
    InputError
        If it cannot be read, channels do not fit together, a unit is not known, or another one is in the file.
    """
    if isinstance(source, str) or hasattr(source, "__fspath__"):
        where, found = str(source), _read(Path(source))
    else:
        where = "SEP005"
        found = _sep005(where, source)
    columns, values = dict(channels or {}), dict(found.channels)
    time = found.time
    if (clock := columns.pop(TIMES[0], None)) is not None:
        if clock not in values:
            raise InputError(f'{where}: no vector "{clock}" of times; vectors are {", ".join(values) or "none"}')
        time = values.pop(clock)
    if time is None:
        raise InputError(
            f"{where}: no time; must have a vector {', '.join(TIMES)}, or a scalar {' or '.join(RATES)} > 0 [Hz]"
        )
    values, said = renamed(where, values, found.units, columns, known)
    return recording(where, time, values, _with_units(where, said, units or {}), drives=drives)


def _with_units(where: str, said: Mapping[str, str], given: Mapping[str, str]) -> dict[str, str]:
    """Units of the file, and of what it says nothing of those given; volts with the sensitivity given for them."""
    sensed = {name: with_sensitivity(said.get(name, ""), unit) for name, unit in given.items()}
    for name, unit in given.items():
        if sensed[name] is None and said.get(name, "").strip() not in ("", unit.strip()):
            raise InputError(f"{where}: {name} is in {said[name]} in the file; must not be given as {unit}")
    return {**said, **given, **{name: unit for name, unit in sensed.items() if unit}}


def _read(path: Path) -> Found:
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{path}: not {KIND}; must end in {' or '.join(READERS)}")
    expect_file(path, KIND)
    return reader(path)


# ---------------------------------------------------------------------------------------------------------------- MAT


def _mat(path: Path) -> Found:
    try:
        content = load_variables(path)
    except InputError:
        raise
    except Exception as refused:  # whatever SciPy and h5py raise
        raise InputError(f"{path}: cannot be read ({damage(refused)}); must be a MAT file (v4 to v7.3)") from None
    units = content.get("units")
    said = {name: str(unit) for name, unit in units.items() if np.size(unit)} if isinstance(units, dict) else {}
    return _of_variables(path, content, said)


def _npz(path: Path) -> Found:
    return _of_variables(path, load_npz(path), {})


def _of_variables(path: Path, content: Mapping[str, Any], units: Mapping[str, str]) -> Found:
    """Vectors by name, and the time by a vector or a scalar rate; None where neither is there."""
    numbers = {name: values for name, values in content.items() if not name.startswith("__") and _numeric(values)}
    vectors = {name: np.squeeze(values) for name, values in numbers.items() if np.size(values) > 1}
    time = next((vectors.pop(name) for name in TIMES if name in vectors), None)
    if time is None and not vectors:
        raise InputError(f"{path}: no vectors; must have {', '.join(TIMES)} or a scalar fs, and one vector per channel")
    rates = [np.squeeze(numbers[name]) for name in RATES if np.size(numbers.get(name, ())) == 1]
    rate = next((float(rate) for rate in rates if np.isrealobj(rate)), 0.0)
    if time is None and 0.0 < rate < float("inf"):
        time = np.arange(len(next(iter(vectors.values())))) / rate
    return Found(time, vectors, units)


def _numeric(values: Any) -> bool:
    return isinstance(values, int | float | complex | np.ndarray) and np.asarray(values).dtype.kind in "iufbc"


# -------------------------------------------------------------------------------------------------------------- UFF58


def _uff(path: Path) -> Found:
    sets = read_uff(path)
    responses, system = functions(sets, 1), system_of(sets)
    if not responses:
        raise InputError(f"{path}: no time response; must have data sets 58 of function type 1")
    axes = [_uff_time(s) for s in responses]
    for name, axis in zip(_uff_names(responses), axes, strict=True):
        _same_time(str(path), name, axis, axes[0])
    names = _unique(str(path), _uff_names(responses))
    scaled = [_uff_values(s, system) for s in responses]
    return Found(
        axes[0],
        {name: values for name, (values, _) in zip(names, scaled, strict=True)},
        {name: unit for name, (_, unit) in zip(names, scaled, strict=True)},
    )


def _uff_names(sets: list[dict[str, Any]]) -> list[str]:
    """Response entities where each has its own, otherwise node and direction."""
    entities = [str(s["rsp_ent_name"]).strip() for s in sets]
    if len(set(entities)) == len(sets) and not {"", "NONE"} & set(entities):
        return entities
    return [place(s, "rsp") for s in sets]


def _uff_time(s: dict[str, Any]) -> Array:
    """Abscissa; its digits are too few for a long record, so that a step of 1/n s within them is taken for it."""
    x = np.asarray(s["x"], dtype=float)
    if not s["abscissa_spacing"] or len(x) < 2:
        return x
    step = float(s["abscissa_inc"])
    if not step > 0.0:
        return x
    rate, rounding = round(1.0 / step), 0.51 * 10.0 ** (floor(log10(step)) - 5)
    exact = 1.0 / rate if rate and abs(1.0 / rate - step) <= rounding else step
    return np.asarray(float(s["abscissa_min"]) + exact * np.arange(len(x)), dtype=float)


def _uff_values(s: DataSet, system: DataSet) -> tuple[Array, str]:
    """Values and their unit: the label's, or SI by the units of the file's data set 164."""
    unit, per = unit_of(s, "ordinate", label_of(s, "ordinate"), system)
    return np.asarray(s["data"]) / per, unit


# --------------------------------------------------------------------------------------------------------------- TDMS


def _tdms(path: Path) -> Found:
    reader = extra("nptdms", str(path))
    try:
        with path.open("rb") as stream, _remarks() as remarks:
            groups = reader.TdmsFile.read(stream).groups()
        found = [(c.group_name, c.name, c[:], dict(c.properties)) for group in groups for c in group.channels()]
    except Exception as refused:  # nptdms lets through whatever struct and NumPy raise
        raise InputError(f"{path}: cannot be read ({damage(refused)}); must be a TDMS file") from None
    if remarks:
        raise InputError(f"{path}: is cut short or damaged; must be a whole TDMS file")
    if not found:
        raise InputError(f"{path}: no channels; must have at least one")
    alone = [name for _, name, _, _ in found]
    names = alone if len(set(alone)) == len(alone) else [f"{group}/{name}" for group, name, _, _ in found]
    times = {name: values for name, (_, plain, values, _) in zip(names, found, strict=True) if plain in TIMES}
    kept = [(name, values, said) for name, (_, _, values, said) in zip(names, found, strict=True) if name not in times]
    time = next(iter(times.values()), None)
    if time is None:
        axes = {name: _tdms_time(path, name, values, said) for name, values, said in kept}
        time = next(iter(axes.values()))
        for name, axis in axes.items():
            _same_time(str(path), name, axis, time)
    return Found(
        time,
        {name: values for name, values, _ in kept},
        {name: str(said.get("unit_string", "")) for name, _, said in kept},
    )


@contextmanager
def _remarks() -> Iterator[list[str]]:
    """Collect the messages that nptdms logs about a file; it reads on where a part is missing."""
    found: list[str] = []

    def note(record: logging.LogRecord) -> bool:
        found.append(record.getMessage())
        return False

    handler = import_module("nptdms.log").log_manager.console_handler
    handler.addFilter(note)
    try:
        yield found
    finally:
        handler.removeFilter(note)


def _tdms_time(path: Path, name: str, values: Any, said: Mapping[str, Any]) -> Array:
    step = said.get("wf_increment")
    if not isinstance(step, int | float) or not step > 0.0:
        raise InputError(f"{path}: {name} has no wf_increment; must have it, or a channel {' or '.join(TIMES)}")
    return np.asarray(float(said.get("wf_start_offset", 0.0)) + float(step) * np.arange(len(values)), dtype=float)


# ------------------------------------------------------------------------------------------------------------- SEP005


def _sep005(where: str, entries: Sequence[Mapping[str, Any]]) -> Found:
    schema = extra("sdypy_sep005", where).Sep005Data
    from pydantic import ValidationError

    if not entries:
        raise InputError(f"{where}: no channels; must have at least one")
    checked = []
    for i, entry in enumerate(entries, start=1):
        try:
            plain = dict(entry)
            if plain.get("time") is not None:
                plain["time"] = np.asarray(plain["time"], dtype=float).tolist()
            checked.append(schema.model_validate(plain))
        except (ValidationError, TypeError, ValueError) as refused:
            raise InputError(f"{where} channel {i}: {_complaint(refused)}; must be a channel of SEP005") from None
    axes = [_sep005_time(channel) for channel in checked]
    for channel, axis in zip(checked, axes, strict=True):
        _same_time(where, channel.name, axis, axes[0])
    names = _unique(where, [channel.name for channel in checked])
    return Found(
        axes[0],
        {name: channel.data for name, channel in zip(names, checked, strict=True)},
        {name: channel.unit_str for name, channel in zip(names, checked, strict=True)},
    )


def _sep005_time(channel: Any) -> Array:
    if channel.time is not None:
        return np.asarray(channel.time, dtype=float)
    return np.asarray(np.arange(len(channel.data)) / float(channel.fs))


def _complaint(refused: Exception) -> str:
    """First error of pydantic, with its key."""
    listed = getattr(refused, "errors", None)
    if listed is None:
        return _first_line(refused)
    first = listed()[0]
    key = ".".join(map(str, first["loc"][:1]))
    return f"{key}: {first['msg']}" if key else str(first["msg"])


# ------------------------------------------------------------------------------------------------------------- common


def _same_time(where: str, name: str, axis: Array, first: Array) -> None:
    """All channels of a recording are sampled together."""
    if len(axis) != len(first):
        raise InputError(f"{where}: {name} has {len(axis)} samples, the first channel {len(first)}; must have as many")
    if len(axis) > 1 and not np.allclose(axis, first, rtol=0.0, atol=1e-6 * abs(first[1] - first[0])):
        raise InputError(f"{where}: {name} is sampled at other times than the first channel; must be at the same")


def _unique(where: str, names: list[str]) -> list[str]:
    for i, name in enumerate(names):
        if name in names[:i]:
            raise InputError(f'{where}: channel "{name}" a second time; must be once')
    return names


def _first_line(refused: Exception) -> str:
    text = (str(refused).strip() or type(refused).__name__).splitlines()[0].rstrip(".")
    return text[:1].lower() + text[1:]


READERS = {".csv": read_csv, ".mat": _mat, ".npz": _npz, ".uff": _uff, ".unv": _uff, ".tdms": _tdms}
"""Reader by ending."""
