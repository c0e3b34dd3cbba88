"""Reconstruction files: written, and the table of signals read back, docs/reference/data_files.md.

``reconstruction.csv`` holds the signals over the period, ``energy.csv`` a row per record, ``harmonics.csv`` a row per
record and harmonic; ``reconstruction.mat`` and ``reconstruction.nc`` hold all of it as arrays.
"""

import math
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from hbm.errors import InputError
from hbm.files.outputs import columns_text, write_folder
from hbm.fourier import Array
from hbm.inverse.reconstruction import SIGNALS, Estimates, Reconstructed, Reconstruction
from hbm.labelled import Variables
from hbm.measurement.exchange import write_arrays
from hbm.textfiles import StrPath, csv_text, read_rows

RECORD = ("record", "level", "frequency_hz")
COLUMNS = (*RECORD, "phase", *(f"{name}{part}" for name in SIGNALS for part in ("", "_std")))
IN_HARMONICS = ("friction", "slip", "normal")
PARTS = ("cos", "sin", "amplitude", "std")
SIGNAL_FILE, NETCDF_FILE = "reconstruction.csv", "reconstruction.nc"
FILES = (SIGNAL_FILE, "energy.csv", "harmonics.csv", "reconstruction.mat", NETCDF_FILE)
NEEDED_FOR_NETCDF = "h5netcdf"


# ------------------------------------------------------------------------------------------------------------ writing


def write_reconstruction(folder: StrPath, reconstruction: Reconstruction, *, netcdf: bool | None = None) -> list[Path]:
    """Write a reconstruction into a folder.

    Parameters
    ----------
    folder : str or path
        Made where it does not exist, in a directory that does.
    reconstruction : Reconstruction
    netcdf : bool, optional
        Write ``reconstruction.nc`` too; where omitted, if the package that makes it is there.

    Returns
    -------
    list of Path
        Files written.

    Raises
    ------
    InputError
        If the files cannot be written; then none is. If NetCDF is asked for and its package is missing.
    """
    return write_folder(folder, reconstruction_contents(reconstruction, netcdf=netcdf), FILES)


def reconstruction_contents(reconstruction: Reconstruction, *, netcdf: bool | None = None) -> dict[str, str | bytes]:
    """Contents of the files, see :func:`write_reconstruction`."""
    arrays = reconstruction.arrays()
    contents: dict[str, str | bytes] = {
        SIGNAL_FILE: csv_text(_signal_rows(reconstruction)),
        "energy.csv": columns_text(energy_columns(reconstruction)),
        "harmonics.csv": columns_text(harmonic_columns(reconstruction)),
        "reconstruction.mat": array_bytes(".mat", *arrays),
    }
    if netcdf or (netcdf is None and has_netcdf()):
        contents[NETCDF_FILE] = array_bytes(".nc", *arrays)
    return contents


def has_netcdf() -> bool:
    """Whether the package that makes NetCDF files is installed."""
    from importlib.util import find_spec

    return find_spec(NEEDED_FOR_NETCDF) is not None


def record_columns(reconstruction: Reconstructed, places: npt.ArrayLike) -> dict[str, npt.NDArray[Any]]:
    """Number, level and frequency of records by their places."""
    spectra, i = reconstruction.spectra, np.asarray(places)
    return dict(zip(RECORD, (spectra.labels[i], spectra.level[i], spectra.hz[i]), strict=True))


def _signal_rows(reconstruction: Reconstruction) -> Iterator[list[Any]]:
    yield list(COLUMNS)
    phase = reconstruction.phase.tolist()
    spectra = reconstruction.spectra
    for i, state in enumerate(zip(spectra.labels.tolist(), spectra.level.tolist(), spectra.hz.tolist(), strict=True)):
        signals = (reconstruction[name] for name in SIGNALS)
        columns = [part[i].tolist() for s in signals for part in (s.samples, s.std)]
        yield from ([*state, *row] for row in zip(phase, *columns, strict=True))


def energy_columns(reconstruction: Reconstruction) -> dict[str, npt.NDArray[Any]]:
    """Columns of ``energy.csv``: a row per record."""
    columns = record_columns(reconstruction, np.arange(len(reconstruction)))
    for name, number in reconstruction.energies.items():
        columns |= estimate_columns(name, number)
    return columns | {"slips": reconstruction.slips, "chi2_reduced": reconstruction.misfit.reduced}


def estimate_columns(name: str, number: Estimates) -> dict[str, npt.NDArray[Any]]:
    """Columns of a number per record with its standard deviations."""
    by_rig = {} if number.rig_std is None else {f"{name}_rig_std": number.rig_std}
    return {name: number.value, f"{name}_std": number.std, **by_rig}


def harmonic_columns(reconstruction: Reconstruction) -> dict[str, npt.NDArray[Any]]:
    """Columns of ``harmonics.csv``: a row per record and harmonic; blank resolution where the sensors see nothing."""
    r, k = np.indices((len(reconstruction), reconstruction.H + 1)).reshape(2, -1)
    columns = {**record_columns(reconstruction, r), "harmonic": k}
    for name in IN_HARMONICS:
        c, std = reconstruction[name].complex[r, k], reconstruction[name].coefficient_std[r, k]
        parts = (c.real, np.where(k, -c.imag, 0.0), np.abs(c), std)
        columns |= {f"{name}_{part}": values for part, values in zip(PARTS, parts, strict=True)}
    return columns | {"resolution": reconstruction.resolution[r, k], "condition": reconstruction.condition[r, k]}


def array_bytes(ending: str, arrays: Variables, coordinates: Variables) -> bytes:
    """Contents of a file of arrays with this ending."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"reconstruction{ending}"
        write_arrays(file, arrays, coordinates)
        return file.read_bytes()


# ------------------------------------------------------------------------------------------------------------ reading


@dataclass(frozen=True, eq=False)
class SavedReconstruction:
    """Signals read from a reconstruction file.

    Attributes
    ----------
    records : (r,) int array
        Numbers of the records.
    level, hz : (r,) array
        Nominal force amplitude [N] and fundamental frequency [Hz].
    phase : (N,) array
        0..1 of a period.
    samples, std : dict of str to (r, N) array
        `slip` [m], `slip_velocity` [m/s], `friction` [N], `normal` [N].
    """

    records: npt.NDArray[np.int64]
    level: Array
    hz: Array
    phase: Array
    samples: Mapping[str, Array]
    std: Mapping[str, Array]

    def __len__(self) -> int:
        """Number of records."""
        return len(self.records)


def read_reconstruction(path: StrPath) -> SavedReconstruction:
    """Read ``reconstruction.csv``.

    Raises
    ------
    InputError
        If it is not a reconstruction file.
    """
    rows = read_rows(path, "a reconstruction file (CSV)")
    line, heading = next(rows, (1, []))
    if tuple(heading) != COLUMNS:
        raise InputError(f"{path} line {line}: {','.join(heading)!r}; must be {','.join(COLUMNS)}")
    blocks: dict[int, list[list[float]]] = {}
    for line, row in rows:
        record, numbers = _parsed(row, f"{path} line {line}")
        blocks.setdefault(record, []).append(numbers)
    if not blocks:
        raise InputError(f"{path}: no rows; must have at least one record")
    return _saved(path, {record: np.array(block) for record, block in blocks.items()})


def _parsed(row: list[str], where: str) -> tuple[int, list[float]]:
    """Number of the record, and the numbers level, frequency, phase, slip, slip_std..."""
    if len(row) != len(COLUMNS):
        raise InputError(f"{where}: {len(row)} entries; must have {len(COLUMNS)}")
    for name, text in zip(COLUMNS, row, strict=True):
        try:
            accepted = math.isfinite(int(text) if name == "record" else float(text))
        except ValueError:
            accepted = False
        if not accepted:
            raise InputError(
                f'{where}: {name} = "{text}"; must be a {"whole" if name == "record" else "finite"} number'
            )
        if name.endswith("_std") and float(text) < 0.0:
            raise InputError(f"{where}: {name} = {text}; must be >= 0")
    return int(row[0]), [float(text) for text in row[1:]]


def _saved(path: StrPath, blocks: Mapping[int, Array]) -> SavedReconstruction:
    first, block = next(iter(blocks.items()))
    for record, other in blocks.items():
        if len(other) != len(block) or not np.array_equal(other[:, 2], block[:, 2]):
            raise InputError(f"{path}: record {record} has other phases than record {first}; must have the same")
        if np.ptp(other[:, :2], axis=0).any():
            raise InputError(f"{path}: record {record} has several levels or frequencies; must have one of each")
    table = np.stack(list(blocks.values()))  # record, phase, column
    signal = {name: 3 + 2 * i for i, name in enumerate(SIGNALS)}
    return SavedReconstruction(
        records=np.array(list(blocks)),
        level=table[:, 0, 0],
        hz=table[:, 0, 1],
        phase=table[0, :, 2],
        samples={name: table[:, :, i] for name, i in signal.items()},
        std={name: table[:, :, i + 1] for name, i in signal.items()},
    )
