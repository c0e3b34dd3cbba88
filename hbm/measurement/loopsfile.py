"""Loops files: displacement imposed on a friction device and the force it took, docs/reference/data_files.md."""

from dataclasses import dataclass

import numpy as np

from hbm.errors import InputError
from hbm.fourier import Array
from hbm.measurement.recording import recording
from hbm.textfiles import StrPath, read_columns

COLUMNS = ("loop", "time_s", "displacement_m", "force_n")
FEWEST = 32
"""Samples of a loop."""


@dataclass(frozen=True, eq=False)
class MeasuredLoop:
    """One steady test over whole cycles.

    Attributes
    ----------
    name : str
    time, displacement, force : (n,) array
        [s], [m], and the force on the device along the displacement [N].
    """

    name: str
    time: Array
    displacement: Array
    force: Array

    @property
    def work(self) -> float:
        """Energy that the device takes, first sample to last and back to the first [J]."""
        x, F = (np.append(values, values[0]) for values in (self.displacement, self.force))
        return float(np.sum(0.5 * (F[1:] + F[:-1]) * np.diff(x)))


def load_loops(path: StrPath) -> list[MeasuredLoop]:
    """Read a loops file.

    Parameters
    ----------
    path : str or path
        CSV with the columns ``loop,time_s,displacement_m,force_n``, in any order, others left out. Of each loop whole
        cycles at steady amplitude, in the order of time.

    Returns
    -------
    list of MeasuredLoop
        In the order of the file.

    Raises
    ------
    InputError
        If a column is missing, an entry is no number, time does not increase, or a loop is too short.
    """
    found: dict[str, list[list[float]]] = {}
    for where, (loop, *numbers) in read_columns(path, "a loops file (CSV)", COLUMNS):
        try:
            found.setdefault(loop.strip(), []).append([float(text) for text in numbers])
        except ValueError:
            raise InputError(f"{where}: {', '.join(numbers)}; must be numbers, {', '.join(COLUMNS[1:])}") from None
    if not found:
        raise InputError(f"{path}: no rows; must have at least one loop")
    return [_loop(f"{path}: loop {name}", name, np.array(table).T) for name, table in found.items()]


def _loop(where: str, name: str, columns: Array) -> MeasuredLoop:
    checked = recording(where, columns[0], {"displacement": columns[1], "force": columns[2]})
    x = checked.channels["displacement"]
    if len(x) < FEWEST or np.ptp(x) == 0.0:
        raise InputError(f"{where}: {len(x)} samples over {np.ptp(x):g} m; must be {FEWEST} or more, and move")
    force = checked.channels["force"]
    if np.ptp(force) == 0.0:
        raise InputError(f"{where}: force_n is {force[0]:g} throughout; must change")
    return MeasuredLoop(name, checked.time, x, force)
