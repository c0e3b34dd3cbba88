"""Spectra and recordings for other programs: NPZ (NumPy), NetCDF (h5netcdf, xarray), MAT (SciPy) and UFF58 (pyuff).

Each format is made and taken apart by a library its users know. Contents are built as bytes, so that a file
appears complete or not at all (:func:`hbm.textfiles.write_together`).
"""

import io
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from traceback import clear_frames
from typing import Any

import numpy as np

from hbm.errors import InputError
from hbm.fourier import Array
from hbm.labelled import Variables, extra
from hbm.measurement.matfile import load_mat
from hbm.measurement.npzfile import load_npz
from hbm.measurement.recording import Recording
from hbm.measurement.spectra import MeasuredSpectra
from hbm.measurement.ufffile import TYPES
from hbm.textfiles import StrPath, damage, write_together

PARTS = ("cos", "sin")
UFF_NAME = 10
"""Characters of an entity name in data set 58."""


# ------------------------------------------------------------------------------------------------------------- NetCDF


def write_arrays(path: StrPath, arrays: Variables, coordinates: Variables) -> None:
    """Write named arrays to a NetCDF or MAT file.

    Parameters
    ----------
    path : str or path
        Ending in ``.nc`` or ``.mat``.
    arrays, coordinates : mapping of str to (dimensions, values, unit)
        In a MAT file coordinates are variables like the others, and units are in the struct ``units``.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending not in (".nc", ".mat"):
        raise InputError(f"{path}: ending of a file of arrays; must be .nc or .mat")
    make = _netcdf if ending == ".nc" else _mat
    write_together({path: make(str(path), arrays, coordinates)})


def netcdf_bytes(where: str, spectra: MeasuredSpectra, units: Mapping[str, str]) -> bytes:
    """Spectra as a NetCDF file: ``coefficient`` (record, channel, harmonic, part), ``std`` (record, channel, harmonic).

    Coordinates: record, level [N], frequency_hz [Hz], channel, unit (of each channel), harmonic, part (cos, sin).
    nan where not measured.
    """
    return _netcdf(where, *_named_arrays(spectra, units))


def npz_bytes(where: str, spectra: MeasuredSpectra, units: Mapping[str, str]) -> bytes:
    """Spectra as a NumPy archive: the variables of :func:`netcdf_bytes`, texts as arrays of characters."""
    arrays, coordinates = _named_arrays(spectra, units)
    file = io.BytesIO()
    plain: dict[str, Any] = {name: np.asarray(values) for name, (_, values, _) in {**coordinates, **arrays}.items()}
    np.savez_compressed(file, **{n: v.astype(str) if v.dtype == object else v for n, v in plain.items()})
    return file.getvalue()


def npz_rows(path: StrPath) -> Iterator[tuple[str, list[str]]]:
    """Rows of a NumPy archive as a CSV file would have them, and where they stand."""
    yield from _rows(str(path), load_npz(path))


def mat_bytes(where: str, spectra: MeasuredSpectra, units: Mapping[str, str]) -> bytes:
    """Spectra as a MAT file (v5): the variables of :func:`netcdf_bytes`, texts as cell arrays."""
    return _mat(where, *_named_arrays(spectra, units))


def netcdf_rows(path: StrPath) -> Iterator[tuple[str, list[str]]]:
    """Rows of a NetCDF file as a CSV file would have them, and where they stand."""
    xarray = extra("xarray", str(path))
    extra("h5netcdf", str(path))
    try:
        with extra("h5py", str(path)).File(path):  # h5netcdf complains on stderr of what is not HDF5
            pass
        with _quiet_end(), xarray.open_dataset(path, engine="h5netcdf") as found:
            variables = {name: found[name].values for name in found.variables}
    except Exception as refused:  # the libraries let through whatever HDF5 raises
        raise InputError(f"{path}: cannot be read ({damage(refused)}); must be NetCDF-4") from None
    yield from _rows(str(path), variables)


@contextmanager
def _quiet_end() -> Iterator[None]:
    """Close silently what h5netcdf has partly opened of a damaged file."""
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        yield
    except Exception as refused:
        clear_frames(refused.__traceback__)
        raise
    finally:
        sys.unraisablehook = hook


def mat_rows(path: StrPath) -> Iterator[tuple[str, list[str]]]:
    """Rows of a MAT file as a CSV file would have them, and where they stand."""
    try:
        variables = load_mat(path)
    except Exception as refused:  # SciPy lets through whatever a damaged file makes it do
        raise InputError(f"{path}: cannot be read ({damage(refused)}); must be a MAT file (v5)") from None
    yield from _rows(str(path), variables)


def _named_arrays(spectra: MeasuredSpectra, units: Mapping[str, str]) -> tuple[Variables, Variables]:
    H, name_of = spectra.H, list(spectra.channels)
    cos = spectra.coefficients[:, :, : H + 1]
    sin = np.concatenate([np.where(spectra.measured[:, :, :1], 0.0, np.nan), spectra.coefficients[:, :, H + 1 :]], 2)
    arrays: Variables = {
        "coefficient": (("record", "channel", "harmonic", "part"), np.stack([cos, sin], axis=3), "see unit"),
        "std": (("record", "channel", "harmonic"), spectra.std, "see unit"),
    }
    coordinates: Variables = {
        "record": (("record",), spectra.labels, "" if spectra.names else "1"),
        "level": (("record",), spectra.level, "N"),
        "frequency_hz": (("record",), spectra.hz, "Hz"),
        "channel": (("channel",), np.array(name_of, dtype=object), ""),
        "unit": (("channel",), np.array([units.get(name, "") for name in name_of], dtype=object), ""),
        "harmonic": (("harmonic",), np.arange(H + 1), "1"),
        "part": (("part",), np.array(PARTS, dtype=object), ""),
    }
    if spectra.notes:
        notes = np.array(list(note_lines(spectra)), dtype=object)
        coordinates = {**coordinates, "note": (("note",), notes, "")}
    return arrays, coordinates


def note_lines(spectra: MeasuredSpectra) -> Iterator[str]:
    """Comment lines of a spectra file: what speaks against a record, one line each."""
    for record, text in spectra.notes:
        yield f"# record {spectra.label(record)}: {' '.join(text.split())}"


def _netcdf(where: str, arrays: Variables, coordinates: Variables) -> bytes:
    """As xarray writes and reads it, without the second that its import takes."""
    h5netcdf, file = extra("h5netcdf", where), io.BytesIO()
    text, entries = extra("h5py", where).string_dtype(), {**coordinates, **arrays}
    with h5netcdf.File(file, "w") as made:
        sizes = (zip(dims, np.shape(values), strict=True) for dims, values, _ in entries.values())
        made.dimensions = dict(chain.from_iterable(sizes))
        for name, (dims, values, unit) in entries.items():
            data = np.asarray(values)
            kind = text if data.dtype.kind in "OU" else data.dtype
            missing = np.nan if data.dtype.kind == "f" else None
            variable = made.create_variable(name, dims, kind, data.astype(kind), missing)
            beside = [other for other, (own, _, _) in coordinates.items() if (other,) != own and set(own) <= set(dims)]
            notes = {"units": unit, "coordinates": " ".join(sorted(beside)) if name in arrays else ""}
            variable.attrs.update({key: note for key, note in notes.items() if note})
    return file.getvalue()


def _mat(where: str, arrays: Variables, coordinates: Variables) -> bytes:
    from scipy.io import savemat

    named = {**coordinates, **arrays}
    content = {name: values for name, (_, values, _) in named.items()}
    content["units"] = {name: unit for name, (_, _, unit) in named.items()}
    file = io.BytesIO()
    try:
        savemat(file, content, oned_as="column", do_compression=True)  # its checksums find damage
    except (TypeError, ValueError) as refused:
        raise InputError(f"{where}: cannot be written ({_first_line(refused)}); must be arrays of numbers") from None
    return file.getvalue()


def _rows(source: str, variables: Mapping[str, Any]) -> Iterator[tuple[str, list[str]]]:
    """Take the variables of :func:`_named_arrays` apart, numbers by every digit."""
    for name in ("record", "level", "frequency_hz", "channel", "harmonic", "coefficient"):
        if name not in variables:
            raise InputError(f"{source}: no variable {name}; must be a spectra file, as hbm spectra writes it")
    flat = {name: _plain(variables[name]) for name in ("record", "level", "frequency_hz")}
    channels = [str(np.asarray(name).item()) for name in np.asarray(variables["channel"]).ravel()]
    harmonics = _plain(variables["harmonic"])
    shape = len(flat["record"]), len(channels), len(harmonics)
    std = _shaped(source, "std", variables, shape) if "std" in variables else np.full(shape, np.nan)
    pairs = _shaped(source, "coefficient", variables, (*shape, len(PARTS)))
    for i, j, k in np.argwhere(~(np.isnan(std) & np.isnan(pairs).all(axis=3))).tolist():
        record, *state = (flat[name][i] for name in ("record", "level", "frequency_hz"))
        where = f"{source} record {record}, {channels[j]}, harmonic {harmonics[k]}"
        pair, own = pairs[i, j, k].tolist(), "" if np.isnan(std[i, j, k]) else repr(float(std[i, j, k]))
        yield where, [str(record), *map(repr, state), channels[j], repr(harmonics[k]), *map(repr, pair), own]
    for note in np.asarray(variables.get("note", ())).ravel():
        yield source, [str(np.asarray(note).item())]


def _plain(values: Any) -> list[Any]:
    """Numbers or texts of a vector; MATLAB writes whole numbers as floats and texts in cells."""
    flat = [v.item() if isinstance(v, np.ndarray) else v for v in np.asarray(values).ravel().tolist()]
    return [int(v) if isinstance(v, float) and v.is_integer() else v for v in flat]


def _shaped(source: str, name: str, variables: Mapping[str, Any], shape: tuple[int, ...]) -> Array:
    values = np.asarray(variables[name], dtype=float)
    if values.size != np.prod(shape):
        found = " x ".join(map(str, values.shape))
        raise InputError(f"{source}: {name} is {found}; must be {' x '.join(map(str, shape))}")
    return values.reshape(shape)  # MATLAB drops dimensions of one at the end


# -------------------------------------------------------------------------------------------------------------- UFF58


def uff_bytes(where: str, spectra: MeasuredSpectra, units: Mapping[str, str]) -> bytes:
    """Spectra as a UFF file of data sets 58, two for each record and channel.

    First the complex amplitudes c_k over frequency, s = Re sum c_k exp(i k Omega t), then their standard deviations
    (of each of real and imaginary part). The response entity is the channel, the response node its number from 1; ID
    line 1 says which of the two it is, ID line 4 record, level and fundamental. A fundamental has 6 digits there.
    """
    sets = []
    for i, record in enumerate(spectra.labels.tolist()):
        state = f"record {record}, level {spectra.level[i]:.8g} N, fundamental {spectra.hz[i]:.8g} Hz"
        for j, name in enumerate(spectra.channels):
            kept = np.flatnonzero(spectra.measured[i, j])
            if not len(kept):
                continue
            std = np.asarray(spectra.std[i, j, kept])
            header = _uff_header(where, name, j, units.get(name, ""), state) | {"z_axis_value": spectra.level[i]}
            axis = _uff_axis(kept * spectra.hz[i], 18)
            sets.append(header | axis | {"id1": "harmonic amplitudes", "data": spectra.complex(name)[i, kept]})
            sets.append(header | axis | {"id1": "standard deviations", "data": std})
    return _uff(where, sets)


def write_recording(path: StrPath, recorded: Recording) -> None:
    """Write a recording to a UFF file, one data set 58 (time response) per channel.

    Parameters
    ----------
    path : str or path
        Ending in ``.uff`` or ``.unv``.
    recorded : Recording
        Equally spaced; the format keeps 6 digits of the time step and 12 of each value.

    Raises
    ------
    InputError
        If it is not equally spaced or the file cannot be written.
    """
    source, steps = str(path), np.diff(recorded.time)
    if np.ptp(steps) > 1e-3 * recorded.step:
        raise InputError(f"{source}: time steps from {steps.min():.6g} to {steps.max():.6g} s; must be equal for UFF58")
    sets = []
    for j, (name, values) in enumerate(recorded.channels.items()):
        axis = {
            "abscissa_spacing": 1,
            "x": recorded.time[0] + recorded.step * np.arange(2),
            "abscissa_spec_data_type": 17,
        }
        header = _uff_header(source, name, j, recorded.units.get(name, ""), "NONE")
        sets.append(header | axis | {"id1": "time history", "func_type": 1, "data": np.asarray(values)})
    write_together({Path(path): _uff(source, sets)})


def _uff_header(where: str, name: str, j: int, unit: str, state: str) -> dict[str, Any]:
    if not (name.isascii() and name.isprintable()) or len(name) > UFF_NAME:
        raise InputError(f'{where}: channel "{name}"; must be ASCII of at most {UFF_NAME} characters in UFF58')
    return {
        **{"type": 58, "binary": 0, "func_type": 0, "id4": state, "load_case_id": 0},
        **{"rsp_ent_name": name, "rsp_node": j + 1, "rsp_dir": 2, "ref_ent_name": "NONE", "ref_node": 0, "ref_dir": 0},
        **{"ordinate_spec_data_type": TYPES.get(unit, 0), "ordinate_axis_units_lab": unit or "NONE"},
        "orddenom_spec_data_type": 0,
    }


def _uff_axis(x: Array, kind: int) -> dict[str, Any]:
    """Abscissa of a data set, evenly spaced where it is, for pyuff at least two of it."""
    steps = np.diff(x)
    even = len(x) < 2 or bool(np.ptp(steps) <= 1e-9 * steps[0])
    return {
        "abscissa_spacing": int(even),
        "x": x if len(x) > 1 else np.array([x[0], x[0] + 1.0]),
        "abscissa_spec_data_type": kind,
    }


def _uff(where: str, sets: list[dict[str, Any]]) -> bytes:
    pyuff = extra("pyuff", where)
    return _through_a_file(lambda file: pyuff.UFF(file).write_sets(sets, "overwrite"))


# ------------------------------------------------------------------------------------------------------------- common


def _through_a_file(write: Callable[[str], Any]) -> bytes:
    """Content of a file that a library writes."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "content"
        write(str(file))
        return file.read_bytes()


def _first_line(refused: Exception) -> str:
    return (str(refused).strip() or type(refused).__name__).splitlines()[0].rstrip(".")
