"""Measured records: harmonic coefficients of the rig's channels, with their standard deviations.

:class:`MeasuredSpectra` holds all records of one campaign in arrays, nan where nothing was measured. It is immutable:
selecting makes a smaller one.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from hbm.errors import InputError
from hbm.fourier import Array, complex_of
from hbm.labelled import coefficient_columns, coefficient_names, dataset, frame, repeated
from models.display import Displayed
from models.jointed import AnyRig

MOST_WARNINGS = 12


@dataclass(frozen=True, eq=False)
class MeasuredSpectra(Displayed):
    """Harmonic coefficients of measured steady states, docs/reference/data_files.md.

    All channels of a record share one time origin: s(t) = a_0 + sum a_k cos(k Omega t) + b_k sin(k Omega t).

    Attributes
    ----------
    source : str
        Where they come from, for messages.
    records : (r,) int array
        Numbers of the records, as in the file, ascending.
    level : (r,) array
        Nominal force amplitude [N].
    hz : (r,) array
        Fundamental frequency [Hz].
    channels : tuple of str, (c,)
        Names of the rig's channels that were measured, in the order of the rig.
    coefficients : (r, c, 2H+1) array
        a_0, a_1..a_H, b_1..b_H in the channel's unit (N, m/s2, m/s, m); nan where not measured.
    std : (r, c, H+1) array
        Standard deviation of each of cos and sin, by harmonic; nan where not measured.
    notes : tuple of (int, str)
        What speaks against a record, by its number, one sentence each: it is not steady, a channel is clipped...
    """

    source: str
    records: npt.NDArray[np.int64]
    level: Array
    hz: Array
    channels: tuple[str, ...]
    coefficients: Array
    std: Array
    notes: tuple[tuple[int, str], ...] = ()

    def __repr__(self) -> str:
        """Say what there is."""
        return (
            f"{self.source}: {len(self)} records, {self.level.min():g} to {self.level.max():g} N, "
            f"{self.hz.min():g} to {self.hz.max():g} Hz; {', '.join(self.channels)}; harmonics up to {self.H}"
        )

    def __len__(self) -> int:
        """Number of records."""
        return len(self.records)

    @property
    def H(self) -> int:
        """Highest harmonic listed."""
        return int(self.std.shape[2]) - 1

    @property
    def warnings(self) -> tuple[str, ...]:
        """What speaks against records, one sentence each, the first of many in full."""
        said = [f"Record {record} of {self.source}: {text.rstrip('?')}." for record, text in self.notes]
        more = len(said) - MOST_WARNINGS
        return (*said[:MOST_WARNINGS], *([f"{more} more warnings are in {self.source}."] if more > 0 else []))

    def to_xarray(self) -> Any:
        """Coefficients (record, channel, coefficient) and standard deviations, as an xarray.Dataset.

        Raises
        ------
        InputError
            If xarray is not installed.
        """
        variables = {
            "coefficients": (("record", "channel", "coefficient"), self.coefficients, ""),
            "std": (("record", "channel", "harmonic"), self.std, ""),
        }
        coordinates = {
            "record": (("record",), self.records, ""),
            "hz": (("record",), self.hz, "Hz"),
            "level": (("record",), self.level, "N"),
            "channel": (("channel",), list(self.channels), ""),
            "coefficient": (("coefficient",), coefficient_names(self.H), ""),
            "harmonic": (("harmonic",), np.arange(self.H + 1), ""),
        }
        return dataset("to_xarray", variables, coordinates, source=self.source)

    def to_dataframe(self) -> Any:
        """One row a record and channel, as a pandas.DataFrame: record, level, hz, channel and every coefficient.

        Raises
        ------
        InputError
            If pandas is not installed.
        """
        c = len(self.channels)
        return frame(
            "to_dataframe",
            {
                "record": repeated(self.records, c),
                "level": repeated(self.level, c),
                "hz": repeated(self.hz, c),
                "channel": np.tile(self.channels, len(self)),
                **coefficient_columns(self.coefficients),
                **{f"std{k}": self.std[..., k].ravel() for k in range(self.H + 1)},
            },
        )

    @property
    def measured(self) -> npt.NDArray[np.bool_]:
        """Which harmonics of which channels were measured, (r, c, H+1)."""
        return np.isfinite(self.std)

    def complex(self, channel: str) -> npt.NDArray[np.complex128]:
        """Complex coefficients c_k of a channel, s = Re sum c_k exp(i k Omega t), (r, H+1), nan where not measured."""
        return complex_of(self.coefficients[:, self.index(channel)])

    def index(self, channel: str) -> int:
        """Place of a channel among `channels`.

        Raises
        ------
        InputError
            If it was not measured.
        """
        if channel not in self.channels:
            raise InputError(f'{self.source}: channel "{channel}" is not in it; channels are {_listed(self.channels)}')
        return self.channels.index(channel)

    def select(
        self,
        *,
        records: Iterable[int] | None = None,
        levels: Iterable[float] | None = None,
        hz: tuple[float, float] | None = None,
        channels: Iterable[str] | None = None,
        harmonics: Iterable[int] | None = None,
    ) -> "MeasuredSpectra":
        """Keep what is named, all of what is not.

        Parameters
        ----------
        records : iterable of int, optional
            Numbers of records.
        levels : iterable of float, optional
            Nominal force amplitudes [N].
        hz : (float, float), optional
            Lowest and highest frequency, both included [Hz].
        channels : iterable of str, optional
            Names of channels.
        harmonics : iterable of int, optional
            Harmonics; the others count as not measured.

        Returns
        -------
        MeasuredSpectra

        Raises
        ------
        InputError
            If a name is not there, or nothing is left.
        """
        keep = np.ones(len(self), dtype=bool)
        if records is not None:
            keep &= self._among("record", self.records, records)
        if levels is not None:
            keep &= self._among("level", self.level, levels)
        if hz is not None:
            keep &= (min(hz) <= self.hz) & (self.hz <= max(hz))
        if not keep.any():
            raise InputError(
                f"{self.source}: no record is left of the selection; records are {_listed(self.records)}, "
                f"levels {_listed(np.unique(self.level))} N, from {self.hz.min():g} to {self.hz.max():g} Hz"
            )
        chosen = self._of_records(keep)
        if channels is not None:
            chosen = chosen._of_channels(sorted({self.index(name) for name in channels}))
        return chosen if harmonics is None else chosen._of_harmonics(list(harmonics))

    def split(self, held_out: Iterable[int]) -> tuple["MeasuredSpectra", "MeasuredSpectra"]:
        """Records to fit, and the records named, which are held out.

        Raises
        ------
        InputError
            If a record is not there, or nothing is left on one of the sides.
        """
        held = self._among("record", self.records, held_out)
        if held.all() or not held.any():
            found = "all records are" if held.all() else "no record is"
            raise InputError(f"{self.source}: {found} held out; must be some of {_listed(self.records)}")
        return self._of_records(~held), self._of_records(held)

    def without(self, channel: str) -> "MeasuredSpectra":
        """Everything but one channel.

        Raises
        ------
        InputError
            If it was not measured.
        """
        gone = self.index(channel)
        return self._of_channels([i for i in range(len(self.channels)) if i != gone])

    def _among(self, what: str, values: npt.NDArray[np.generic], named: Iterable[float]) -> npt.NDArray[np.bool_]:
        keep = np.zeros(len(self), dtype=bool)
        for value in named:
            found = values == value
            if not found.any():
                raise InputError(f"{self.source}: no {what} {value:g}; {what}s are {_listed(np.unique(values))}")
            keep |= found
        return keep

    def _of_records(self, keep: npt.NDArray[np.bool_]) -> "MeasuredSpectra":
        return replace(
            self,
            records=self.records[keep],
            level=self.level[keep],
            hz=self.hz[keep],
            coefficients=self.coefficients[keep],
            std=self.std[keep],
            notes=tuple((record, text) for record, text in self.notes if record in self.records[keep]),
        )

    def _of_channels(self, keep: list[int]) -> "MeasuredSpectra":
        return replace(
            self,
            channels=tuple(self.channels[i] for i in keep),
            coefficients=self.coefficients[:, keep],
            std=self.std[:, keep],
        )

    def _of_harmonics(self, keep: list[int]) -> "MeasuredSpectra":
        kept = np.isin(np.arange(self.H + 1), keep)
        both = np.concatenate([kept, kept[1:]])
        return replace(
            self,
            coefficients=np.where(both, self.coefficients, np.nan),
            std=np.where(kept, self.std, np.nan),
        )


def spectra_of(
    rig: AnyRig,
    hz: Array,
    level: Array,
    coefficients: dict[str, Array],
    std: dict[str, Array],
    source: str = "spectra",
) -> MeasuredSpectra:
    """Measured spectra of arrays, one per channel of a rig.

    Parameters
    ----------
    rig : Rig or JointedRig
    hz, level : (r,) array
        Fundamental frequency [Hz] and nominal force amplitude [N] of each record.
    coefficients : dict of str to (r, 2H+1) array
        By channel, nan where not measured.
    std : dict of str to (r, H+1) array
        By channel, nan where not measured.
    source : str
        For messages.

    Returns
    -------
    MeasuredSpectra
        Records are numbered from 1.

    Raises
    ------
    InputError
        If a channel is not the rig's.
    """
    names = [c.name for c in rig.channels]
    for name in coefficients:
        if name not in names:
            raise InputError(f'{source}: channel "{name}" is not in the rig; channels are {_listed(names)}')
    channels = tuple(name for name in names if name in coefficients)
    return MeasuredSpectra(
        source=source,
        records=np.arange(1, len(hz) + 1),
        level=np.asarray(level, dtype=float),
        hz=np.asarray(hz, dtype=float),
        channels=channels,
        coefficients=np.stack([coefficients[name] for name in channels], axis=1),
        std=np.stack([std[name] for name in channels], axis=1),
    )


def _listed(values: Iterable[object]) -> str:
    return ", ".join(f"{v:g}" if isinstance(v, float | np.floating) else str(v) for v in values)
