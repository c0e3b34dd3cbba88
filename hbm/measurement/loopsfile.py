"""Loops files: displacement imposed on a friction device and the force it took, docs/reference/data_files.md."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hbm.errors import InputError
from hbm.fourier import Array
from hbm.measurement.cycles import cycles_in
from hbm.measurement.recording import recording
from hbm.textfiles import StrPath, read_columns
from models.plausible import PlausibilityWarning

COLUMNS = ("loop", "time_s", "displacement_m", "force_n")
FEWEST = 32
"""Samples of a loop."""

SLACK = 0.02
"""Part of a cycle that may be missing from the last one."""

ALONE = (0.9, 1.3)
"""Cycles that may be one: its length is not known to better where it is not seen twice."""

CLOSED = 2.0
"""A loop is closed where it ends within so many of its largest steps of where it began."""

GIVEN = 0.01
"""Energy that a loop gives, as a part of range of force times range of displacement, which no noise makes."""

LONG = 1.0
"""Range of a displacement that is more likely in millimetres [m]."""


@dataclass(frozen=True, eq=False)
class MeasuredLoop:
    """One steady test over whole cycles.

    Attributes
    ----------
    name : str
    time, displacement, force : (n,) array
        [s], [m], and the force on the device along the displacement [N].
    notes : tuple of str
        What to beware of in what was read.
    """

    name: str
    time: Array
    displacement: Array
    force: Array
    notes: tuple[str, ...] = ()

    @property
    def gives(self) -> bool:
        """Whether it gives out energy, which no friction does: force or displacement is of reversed sign."""
        return self.work < -GIVEN * float(np.ptp(self.force) * np.ptp(self.displacement))

    @property
    def work(self) -> float:
        """Energy that the device takes, first sample to last and back to the first [J]."""
        x, F = (np.append(values, values[0]) for values in (self.displacement, self.force))
        return float(np.sum(0.5 * (F[1:] + F[:-1]) * np.diff(x)))


def load_loops(path: StrPath, only: Sequence[str] = ()) -> list[MeasuredLoop]:
    """Read a loops file.

    Loops that give out energy are left out where they are fewer than the others.

    Parameters
    ----------
    path : str or path
        CSV with the columns ``loop,time_s,displacement_m,force_n``, in any order, others left out. Of each loop whole
        cycles at steady amplitude, in the order of time; samples beyond the last whole cycle are left out.
    only : sequence of str
        Loops that are asked for, all where omitted; the others may be none.

    Returns
    -------
    list of MeasuredLoop
        In the order of the file.

    Raises
    ------
    InputError
        If a column or a loop is missing, an entry is no number, time does not increase, or a loop is too short, no
        whole cycle, or has a force of one sign; or if half of the loops have a force of the wrong sign.

    Warns
    -----
    models.plausible.PlausibilityWarning
        Of each loop that is left out.
    """
    kept, reversed_ = read_loops(path, only)
    for loop in reversed_:
        warnings.warn(f"{path}: loop {loop.name}: {reversed_sign(loop)}; left out", PlausibilityWarning, stacklevel=2)
    return kept


def reversed_sign(loop: MeasuredLoop) -> str:
    """What is said of a loop that gives out energy."""
    return f"force_n gives out {-loop.work:.4g} J, as where it or displacement_m is of reversed sign"


def read_loops(path: StrPath, only: Sequence[str] = ()) -> tuple[list[MeasuredLoop], list[MeasuredLoop]]:
    """Loops of a file, and those that are left out of it, see :func:`load_loops`."""
    found: dict[str, list[list[float]]] = {}
    for where, (loop, *numbers) in read_columns(path, "a loops file (CSV)", COLUMNS):
        try:
            found.setdefault(loop.strip(), []).append([float(text) for text in numbers])
        except ValueError:
            raise InputError(f"{where}: {', '.join(numbers)}; must be numbers, {', '.join(COLUMNS[1:])}") from None
    if not found:
        raise InputError(f"{path}: no rows; must have at least one loop")
    missing = next((name for name in only if name not in found), None)
    if missing is not None:
        raise InputError(f"{path}: no loop {missing}; loops are {', '.join(found)}")
    asked = {name: table for name, table in found.items() if not only or name in only}
    loops = [_loop(f"{path}: loop {name}", name, np.array(table).T) for name, table in asked.items()]
    kept, giving = [loop for loop in loops if not loop.gives], [loop for loop in loops if loop.gives]
    if len(giving) >= max(len(kept), 1):
        raise InputError(
            f"{path}: loop {giving[0].name}: force_n gives out {-giving[0].work:.4g} J, as one of reversed sign does; "
            "must be the force on the device along displacement_m, which takes energy"
        )
    return kept, giving


def _loop(where: str, name: str, columns: Array) -> MeasuredLoop:
    checked = recording(where, columns[0], {"displacement": columns[1], "force": columns[2]})
    x = checked.channels["displacement"]
    if len(x) < FEWEST or np.ptp(x) == 0.0:
        raise InputError(f"{where}: {len(x)} samples over {np.ptp(x):g} m; must be {FEWEST} or more, and move")
    force = checked.channels["force"]
    if np.ptp(force) == 0.0:
        raise InputError(f"{where}: force_n is {force[0]:g} throughout; must change")
    if force.min() > 0.0 or force.max() < 0.0:
        raise InputError(
            f"{where}: force_n is {force.min():.4g} to {force.max():.4g} N, of one sign throughout; must resist both "
            "ways: take the zero of the load cell off"
        )
    return _whole(where, MeasuredLoop(name, checked.time, x, force))


def _whole(where: str, loop: MeasuredLoop) -> MeasuredLoop:
    """The whole cycles of a loop, with notes on what was read."""
    samples, cycles = len(loop.time), cycles_in(loop.time, loop.displacement)
    count = 0 if np.isnan(cycles) else int(cycles + SLACK)
    kept = samples if count == 0 else min(samples, round(count * samples / cycles))
    if (np.isnan(cycles) or ALONE[0] < cycles < ALONE[1]) and _closed(loop):
        kept = samples
    elif count == 0:
        held = "no steady cycle" if np.isnan(cycles) else f"{cycles:.2g} cycles"
        raise InputError(
            f"{where}: {samples} samples hold {held} of displacement_m and do not end where they began; must be whole "
            "cycles at steady amplitude"
        )
    notes, reach = [], float(np.ptp(loop.displacement))
    if samples - kept > 1:  # one more is the first of the next cycle
        whole = f"{count} whole cycle{'s' * (count > 1)}"
        notes.append(f"{samples - kept} of {samples} samples are beyond {whole} and left out")
    if reach > LONG:
        notes.append(f"displacement_m spans {reach:.4g} m; is it in mm?")
    return MeasuredLoop(loop.name, loop.time[:kept], loop.displacement[:kept], loop.force[:kept], tuple(notes))


def _closed(loop: MeasuredLoop) -> bool:
    """Whether both signals end where they began."""
    return all(abs(v[-1] - v[0]) <= CLOSED * np.abs(np.diff(v)).max() for v in (loop.displacement, loop.force))
