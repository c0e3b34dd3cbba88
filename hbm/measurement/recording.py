"""Recordings: channels measured over time, in SI units on one time axis.

:class:`Recording` is what :mod:`hbm.measurement.historyfile` reads and :mod:`hbm.measurement.harmonics` turns into
spectra; :func:`recording` makes one of whatever a file holds, or refuses it.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from hbm.errors import InputError
from hbm.fourier import Array
from hbm.measurement.clock import UNEVEN, even_clock, unevenness
from hbm.measurement.units import VOLT, to_si
from models.parts import UNITS
from models.plausible import impossible

TIMES = ("time_s", "time", "t")
KIND = "a time history"

DRIVES = ("force",)
"""Channels that may be the voltage of a shaker in place of its force, where none are named."""


class Found(NamedTuple):
    """Content of a file as read: time [s], values by channel, units by channel."""

    time: Any
    channels: Mapping[str, Any]
    units: Mapping[str, str]


@dataclass(frozen=True, eq=False)
class Recording:
    """Channels measured over time.

    Attributes
    ----------
    source : str
        Where it comes from, for messages.
    time : (N,) array
        Increasing [s]; its zero is the phase reference of all channels.
    channels : dict of str to (N,) array
        Values in SI units.
    units : dict of str to str
        SI unit of each channel, empty where the source does not say: then it must be SI.
    """

    source: str
    time: Array
    channels: Mapping[str, Array]
    units: Mapping[str, str]

    @property
    def step(self) -> float:
        """Mean time between samples [s]."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)

    @property
    def span(self) -> str:
        """First and last time in words, to a thousandth of a step."""
        digits = 3 - math.floor(math.log10(self.step))
        first, last = (round(float(t), digits) + 0.0 for t in self.time[[0, -1]])
        return f"{first:.9g} to {last:.9g} s"

    def between(self, begin: float, end: float) -> "Recording":
        """The part from one time to another, both included [s].

        Raises
        ------
        InputError
            If it has fewer than three samples.
        """
        kept = (self.time >= begin) & (self.time <= end)
        if kept.sum() < 3:
            raise InputError(
                f"{self.source}: {kept.sum()} samples from {begin:g} to {end:g} s; must be at least 3, of {self.span}"
            )
        channels = {name: values[kept] for name, values in self.channels.items()}
        return replace(self, time=self.time[kept], channels=channels)

    def expect_channel(self, name: str) -> None:
        """Refuse a channel that is not there.

        Raises
        ------
        InputError
            With those that are.
        """
        if name not in self.channels:
            raise InputError(f'{self.source}: no channel "{name}"; channels are {", ".join(self.channels)}')

    def expect_quantity(self, name: str, quantity: str, where: str = "") -> None:
        """Refuse a channel in units of something else than a quantity, which it is of in a place such as ``the rig``.

        A voltage may stand for a force.

        Raises
        ------
        InputError
            If the source says so.
        """
        unit = self.units.get(name, "")
        stands = (VOLT,) if quantity == "force" else ()
        if unit not in ("", UNITS[quantity], *stands):
            in_place = f", in {where}" if where else ""
            raise InputError(
                f"{self.source}: channel {name} is in {unit}; must be {quantity}, {UNITS[quantity]}{in_place}"
            )

    def expect_even(self, purpose: str) -> None:
        """Refuse times beside an even clock, which a purpose, ``to find ...``, needs.

        Raises
        ------
        InputError
            If they lie beside it by more than a thousandth of a step.
        """
        if unevenness(self.time) > UNEVEN:
            steps = np.diff(self.time)
            raise InputError(
                f"{self.source}: time steps from {steps.min():.6g} to {steps.max():.6g} s; must be equal {purpose}"
            )


def constant(values: Array) -> npt.NDArray[np.bool_]:
    """Which columns of values (N, c) are constant but for rounding: of dead channels."""
    return np.asarray(np.ptp(values, axis=0) <= 1e-12 * np.max(np.abs(values), axis=0))


def recording(
    source: str,
    time: npt.ArrayLike,
    channels: Mapping[str, npt.ArrayLike],
    units: Mapping[str, str] | None = None,
    *,
    drives: Sequence[str] = DRIVES,
) -> Recording:
    """Check what was read and convert it to SI.

    Times that are those of an even clock to the digits they have become the times of that clock.

    Parameters
    ----------
    source : str
        For messages.
    time : (N,) array
        [s].
    channels : mapping of str to (N,) array
        Values as recorded.
    units : mapping of str to str, optional
        Units as recorded, of any of the channels.
    drives : sequence of str
        Channels that may be voltages, for a force that is not measured: no motion is.

    Raises
    ------
    InputError
        If lengths differ, a number is not finite, time does not increase, or a unit is not known.
    """
    said = dict(units or {})
    t = _samples(source, "time", time)
    if not channels:
        raise InputError(f"{source}: no channel; must have time and at least one channel")
    _refuse_impossible(source, "time", t, "time")
    scaled = {name: to_si(source, name, said.get(name, ""), drives=name in drives) for name in channels}
    values = {name: scaled[name][0] * _samples(source, name, given) for name, given in channels.items()}
    for name, v in values.items():
        _refuse_impossible(source, name, v, "reading")
        if len(v) != len(t):
            raise InputError(f"{source}: {name} has {len(v)} samples, time has {len(t)}; must have as many")
    if len(t) < 3:
        raise InputError(f"{source}: {len(t)} samples; must have at least 3")
    if not np.all(np.diff(t) > 0.0):
        at = int(np.argmin(np.diff(t) > 0.0)) + 1
        digits = ", with more digits than it has" if t[at] == t[at - 1] else ""
        raise InputError(
            f"{source}: time is {t[at]:g} s at sample {at + 1} after {t[at - 1]:g} s; must increase{digits}"
        )
    found = Recording(source, t, values, {name: unit for name, (_, unit) in scaled.items()})
    _refuse_impossible(source, "the mean step of time", np.array([found.step]), "sampling_step")
    for name, v in values.items():
        _refuse_impossible(source, f"the largest of {name}", np.array([np.abs(v).max()]), "signal")
    return replace(found, time=even_clock(t))


def renamed(
    source: str,
    channels: Mapping[str, npt.ArrayLike],
    units: Mapping[str, str],
    columns: Mapping[str, str],
    known: Collection[str] = (),
) -> tuple[dict[str, npt.ArrayLike], dict[str, str]]:
    """Keep the columns named, under new names, and others that have names which are known.

    Parameters
    ----------
    source : str
        For messages.
    channels, units : mapping
        By column, as in :func:`recording`.
    columns : mapping of str to str
        New name to column; all under their own names if empty.
    known : collection of str
        Names of columns that are kept as well.

    Returns
    -------
    channels, units : dict
        By new name.

    Raises
    ------
    InputError
        If a column is not there.
    """
    if not columns:
        return dict(channels), dict(units)
    for column in columns.values():
        if column not in channels:
            raise InputError(f'{source}: no channel "{column}"; channels are {", ".join(channels) or "none"}')
    taken = {*columns, *columns.values()}
    columns = {**columns, **{name: name for name in channels if name in known and name not in taken}}
    return (
        {name: channels[column] for name, column in columns.items()},
        {name: units.get(column, "") for name, column in columns.items()},
    )


def _samples(source: str, name: str, values: npt.ArrayLike) -> Array:
    if np.iscomplexobj(values):
        raise InputError(f"{source}: {name} is complex; must be one real number per sample")
    try:
        numbers = np.squeeze(np.asarray(values, dtype=float))
    except (TypeError, ValueError):
        raise InputError(f"{source}: {name} is not numbers; must be one number per sample") from None
    if numbers.ndim != 1:
        shape = " x ".join(map(str, numbers.shape)) or "one number"
        raise InputError(f"{source}: {name} is {shape}; must be one number per sample")
    if not np.isfinite(numbers).all():
        at = int(np.argmin(np.isfinite(numbers)))
        raise InputError(f"{source}: {name} is {numbers[at]} at sample {at + 1}; must be a finite number")
    return numbers


def _refuse_impossible(source: str, name: str, values: Array, quantity: str) -> None:
    if not values.size:
        return
    at = int(np.argmax(np.abs(values)))
    if (accepted := impossible(quantity, values[at])) is not None:
        where = f" at sample {at + 1}" if len(values) > 1 else ""
        raise InputError(f"{source}: {name} is {values[at]:g}{where}; {accepted}")
