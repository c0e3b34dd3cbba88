"""What a rig file is uncertain by, in what was reconstructed with it: tables, a section of a page, a calibrated rig."""

from pathlib import Path

import numpy as np

from hbm.figures.page import Section, Table
from hbm.files.extendedrig import corrections, rig_file
from hbm.files.inversefiles import record_columns
from hbm.files.outputs import Columns, columns_of, columns_text
from hbm.fourier import Array
from hbm.identification.contacterrors import ContactErrors
from hbm.identification.known import Known

ERROR_FILE, NUMBER_FILE, CALIBRATED_FILE = "rig_errors.csv", "rig_numbers.csv", "calibrated.toml"
FILES = (ERROR_FILE, NUMBER_FILE, CALIBRATED_FILE)

HEADINGS = ("quantity", "largest", "± by noise", "± by the rig file", "most by (tolerance)")
NOTE = (
    "± is one standard deviation, where the quantity is largest; what a rig file is off by is the same in all records"
)

Contents = dict[str, str | bytes]


def rig_error_contents(errors: ContactErrors, nominal: Path | None) -> Contents:
    """Contents of the files, by their names.

    Parameters
    ----------
    errors : ContactErrors
    nominal : Path or None
        The rig file, of which a calibrated one is made where sensors ask for other numbers.
    """
    contents: Contents = {
        ERROR_FILE: columns_text(error_columns(errors)),
        NUMBER_FILE: columns_text(number_columns(errors.known)),
    }
    if nominal is not None and errors.known.asked:
        contents |= calibrated_rig(errors, nominal)
    return contents


def error_columns(errors: ContactErrors) -> Columns:
    """Columns of ``rig_errors.csv``: a row per quantity and record; of signals root mean squares over the period."""
    found, rows = errors.reconstruction, []
    for name, s in found.signals.items():
        values = (_rms(part) for part in (s.samples, s.std, errors.std(name)))
        rows += [(name, s.unit, *row) for row in zip(*values, strict=True)]
    for name, e in found.energies.items():
        rows += [(name, e.unit, *row) for row in zip(e.value, e.std, errors.std(name), strict=True)]
    places = np.tile(np.arange(len(found)), len(rows) // len(found))
    return record_columns(found, places) | dict(columns_of(("quantity", "unit", "value", "std", "rig_std"), rows))


def _rms(samples: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(samples**2, axis=1)))


def number_columns(known: Known) -> Columns:
    """Columns of ``rig_numbers.csv``: what is known of each number of the rig file."""
    rows = [(*row, value) for row, value in zip(known.rows, known.calibrated.values(), strict=True)]
    return columns_of((*Known.ROW, "calibrated"), rows)


def calibrated_rig(errors: ContactErrors, nominal: Path) -> Contents:
    """The rig file with its numbers as sensors ask for them."""
    values, rig = errors.known.calibrated, errors.reconstruction.rig
    length = np.inf if rig.beam is None else rig.beam.length  # a place asked for beyond a beam is its end
    kept = {key: min(value, length) if key.endswith(".position") else value for key, value in values.items()}
    return rig_file(CALIBRATED_FILE, nominal, corrections(rig, kept))


def rig_error_section(errors: ContactErrors) -> Section:
    """What the rig file is uncertain by, on a page."""
    asks, more = errors.known.asks, f" {CALIBRATED_FILE} has them." if errors.known.asked else ""
    told = (
        "Forces are what the structure does not explain, and the structure is told by the rig file. Its numbers may be "
        "off by their tolerances (--tolerance, or those of a diagnosis), as far as the sensors leave these: they "
        "contradict each other where a number is wrong.",
        *filter(None, [asks and f"{asks[0].upper()}{asks[1:]}.{more}"]),
    )
    table = Table(HEADINGS, [list(row) for row in errors.told], NOTE)
    return Section("What the rig file is uncertain by", text=told, table=table, csv=(ERROR_FILE, NUMBER_FILE))
