"""Decay files, docs/reference/data_files.md: frequency and damping ratio over amplitude, as of ``hbm decay``."""

import numpy as np

from hbm.errors import InputError
from hbm.fourier import Array
from hbm.measurement.decay import Decay
from hbm.textfiles import StrPath, csv_heading, read_columns

NUMBERS = ("amplitude", "frequency_hz", "frequency_hz_std", "damping_ratio", "damping_ratio_std")
COLUMNS = ("channel", *NUMBERS)


def is_decay(path: StrPath) -> bool:
    """Whether a file is a CSV file with a damping ratio beside a frequency: a decay, or meant as one."""
    return {"frequency_hz", "damping_ratio"} <= csv_heading(path)


def load_decay(path: StrPath) -> Decay:
    """Read a decay file.

    Parameters
    ----------
    path : str or path
        CSV with the columns ``channel,amplitude,frequency_hz,frequency_hz_std,damping_ratio,damping_ratio_std``, in any
        order, others left out. One row per amplitude of one channel.

    Raises
    ------
    InputError
        If a column is missing, an entry is no number, a number is out of its bounds, or an amplitude is there twice.
    """
    rows: dict[tuple[str, float], Array] = {}
    for where, entries in read_columns(path, "a decay file (CSV)", COLUMNS):
        channel, *numbers = (entry.strip() for entry in entries)
        row = _numbers(where, numbers)
        if (channel, row[0]) in rows:
            raise InputError(f"{where}: amplitude {row[0]:g} of {channel} a second time; must be once in a file")
        rows[channel, row[0]] = row
    if not rows:
        raise InputError(f"{path}: no rows; must have one per amplitude")
    channels = list(dict.fromkeys(channel for channel, _ in rows))
    if len(channels) > 1:
        raise InputError(f"{path}: channels {', '.join(channels)}; must be one")
    amplitude, hz, hz_std, ratio, ratio_std = np.array(list(rows.values())).T
    return Decay(str(path), channels[0], "", amplitude, hz, hz_std, ratio, ratio_std)


def _numbers(where: str, texts: list[str]) -> Array:
    """Numbers of a row, all but the damping ratio above zero; what does not vibrate has no frequency."""
    try:
        row = np.array([float(text) for text in texts])
    except ValueError:
        raise InputError(f"{where}: {', '.join(texts)}; must be numbers, {', '.join(NUMBERS)}") from None
    for name, value in zip(NUMBERS, row, strict=True):
        signed = name == "damping_ratio"
        if not (abs(value) < 1.0 if signed else 0.0 < value < np.inf):
            accepted = "above -1 and below 1, 0.01 where it is 1 %" if signed else "> 0"
            raise InputError(f"{where}: {name} = {value:g}; must be {accepted}")
    return row
