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

MOST_WARNINGS, MOST_LISTED = 12, 50
SILENT = 2.0
"""A record whose mean square of all channels and harmonics is below so many noise variances holds noise alone."""

AT = "@"
"""Between the name of records and the frequency of one of them."""


@dataclass(frozen=True, eq=False)
class MeasuredSpectra(Displayed):
    """Harmonic coefficients of measured steady states, docs/reference/data_files.md.

    All channels of a record share one time origin: s(t) = a_0 + sum a_k cos(k Omega t) + b_k sin(k Omega t).

    Attributes
    ----------
    source : str
        Where they come from, for messages.
    records : (r,) int array
        Numbers of the records, ascending: as in the file, or 1..r in its order where it names them by text.
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
    names : tuple of str
        Names of the records where they are no numbers, by number less one; of a selection too, those of all.
    assumed : tuple of str
        Channels in which a repeatability that was stated stands in for standard deviations that are not given.
    unrepeatable : tuple of str
        Channels whose standard deviations hold what does not repeat beside the noise.
    """

    source: str
    records: npt.NDArray[np.int64]
    level: Array
    hz: Array
    channels: tuple[str, ...]
    coefficients: Array
    std: Array
    notes: tuple[tuple[int, str], ...] = ()
    names: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()
    unrepeatable: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Summary in words."""
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
    def noise(self) -> str:
        """What its standard deviations are of, in words."""
        return "noise and what does not repeat" if self.assumed or self.unrepeatable else "noise"

    @property
    def labels(self) -> npt.NDArray[Any]:
        """Records as the file calls them: numbers, or texts, (r,)."""
        return self.labels_of(self.records)

    def labels_of(self, records: npt.NDArray[np.int64]) -> npt.NDArray[Any]:
        """What the file calls records, by their numbers, in an array of the same shape."""
        return np.array(self.names, dtype=object)[records - 1] if self.names else records

    def label(self, record: int) -> str:
        """What the file calls a record, by its number."""
        return str(self.labels_of(np.array(record)))

    def numbers(self, named: Iterable[int | str]) -> list[int]:
        """Numbers of records: themselves, or what the file calls them, a text.

        A text may name many, ``sweep1`` those at all frequencies, of which one is ``sweep1@79.2Hz``.

        Raises
        ------
        InputError
            If there is no such record.
        """
        known: dict[int | str, list[int]] = {}
        for label, number in zip(map(str, self.labels), self.records.tolist(), strict=True):
            for name in {number, label, label.partition(AT)[0]}:
                known.setdefault(name, []).append(number)
        for name in (named := list(named)):
            if name not in known:
                raise InputError(f"{self.source}: no record {name}; records are {_listed(self.labels)}")
        return [number for name in named for number in known[name]]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about records, one sentence each; of many alike the first is given in full."""
        silent = [f"{line[0].upper()}{line[1:].rstrip('?')}." for line in self.silent]
        said = [f"Record {self.label(record)} of {self.source}: {text.rstrip('?')}." for record, text in self.notes]
        more = len(said) - MOST_WARNINGS
        return (*silent, *said[:MOST_WARNINGS], *([f"{more} more warnings are in {self.source}."] if more > 0 else []))

    @property
    def silent(self) -> tuple[str, ...]:
        """A sentence that names the records of noise alone in every channel, if there are any."""
        squared = (self.coefficients[:, :, 1:] / np.tile(self.std[:, :, 1:], 2)) ** 2
        off = self.labels[np.nansum(squared, axis=(1, 2)) < SILENT * np.isfinite(squared).sum(axis=(1, 2))]
        records = f"record{'s' * (len(off) > 1)} {_listed(off)} of {self.source}"
        return (f"{records}: every channel reads noise alone; was the shaker off?",) if len(off) else ()

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
            "record": (("record",), self.labels, ""),
            "hz": (("record",), self.hz, "Hz"),
            "level": (("record",), self.level, "N"),
            "channel": (("channel",), list(self.channels), ""),
            "coefficient": (("coefficient",), coefficient_names(self.H), ""),
            "harmonic": (("harmonic",), np.arange(self.H + 1), ""),
        }
        return dataset("to_xarray", variables, coordinates, source=self.source)

    def to_dataframe(self) -> Any:
        """A pandas.DataFrame with a row per record and channel: record, level, hz, channel and every coefficient.

        Raises
        ------
        InputError
            If pandas is not installed.
        """
        c = len(self.channels)
        return frame(
            "to_dataframe",
            {
                "record": repeated(self.labels, c),
                "level": repeated(self.level, c),
                "hz": repeated(self.hz, c),
                "channel": np.tile(self.channels, len(self)),
                **coefficient_columns(self.coefficients),
                **{f"std{k}": self.std[..., k].ravel() for k in range(self.H + 1)},
            },
        )

    @property
    def measured(self) -> npt.NDArray[np.bool_]:
        """True where a harmonic of a channel was measured, (r, c, H+1)."""
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
        records: Iterable[int | str] | None = None,
        levels: Iterable[float] | None = None,
        hz: tuple[float, float] | None = None,
        channels: Iterable[str] | None = None,
        harmonics: Iterable[int] | None = None,
    ) -> "MeasuredSpectra":
        """Keep what is named, all of what is not.

        Parameters
        ----------
        records : iterable of int or str, optional
            Records, as the file calls them.
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
            keep &= np.isin(self.records, self.numbers(records))
        if levels is not None:
            keep &= self._of_levels(levels)
        if hz is not None:
            keep &= (min(hz) <= self.hz) & (self.hz <= max(hz))
        if not keep.any():
            raise InputError(
                f"{self.source}: no record is left of the selection; records are {_listed(self.labels)}, "
                f"levels {_listed(np.unique(self.level))} N, from {self.hz.min():g} to {self.hz.max():g} Hz"
            )
        chosen = self._of_records(keep)
        if channels is not None:
            chosen = chosen._of_channels(sorted({self.index(name) for name in channels}))
        return chosen if harmonics is None else chosen._of_harmonics(list(harmonics))

    def split(self, held_out: Iterable[int | str]) -> tuple["MeasuredSpectra", "MeasuredSpectra"]:
        """Split into the records to fit and the records to hold out.

        Raises
        ------
        InputError
            If a record is not there, or nothing is left on one of the sides.
        """
        held = np.isin(self.records, self.numbers(held_out))
        if held.all() or not held.any():
            found = "all records are" if held.all() else "no record is"
            raise InputError(f"{self.source}: {found} held out; must be some of {_listed(self.labels)}")
        return self._of_records(~held), self._of_records(held)

    def between(self, low: float, high: float, responses: Iterable[str]) -> "MeasuredSpectra":
        """Leave out what lies beyond a band of frequencies: of responses there, of the force up to twice its upper end.

        Parameters
        ----------
        low, high : float
            Ends of the band [Hz].
        responses : iterable of str
            Channels of motion.

        Raises
        ------
        InputError
            If no response lies in the band.
        """
        at = self.hz[:, None] * np.arange(self.H + 1)
        H = max(1, min(self.H, int(2 * high // self.hz.min())))
        channels = [self.index(name) for name in responses]
        inside = np.repeat((at <= 2 * high)[:, None], len(self.channels), axis=1)
        inside[:, channels] = ((low <= at) & (at <= high))[:, None]
        std, both = np.where(inside, self.std, np.nan), np.concatenate([inside, inside[..., 1:]], axis=2)
        coefficients = np.where(both, self.coefficients, np.nan)
        cut = [*range(H + 1), *range(self.H + 1, self.H + 1 + H)]
        there = np.asarray(np.isfinite(std[:, channels]).any(axis=(1, 2)))
        if not there.any():
            raise InputError(
                f"{self.source}: no response between {low:g} and {high:g} Hz; they are from {self.hz.min():g} to "
                f"{at.max():g} Hz"
            )
        return replace(self, coefficients=coefficients[..., cut], std=std[..., : H + 1])._of_records(there)

    def without(self, channel: str) -> "MeasuredSpectra":
        """Everything but one channel.

        Raises
        ------
        InputError
            If it was not measured.
        """
        gone = self.index(channel)
        return self._of_channels([i for i in range(len(self.channels)) if i != gone])

    def _of_levels(self, named: Iterable[float]) -> npt.NDArray[np.bool_]:
        levels = list(named)
        for level in levels:
            if level not in self.level:
                listed = _listed(np.unique(self.level))
                raise InputError(f"{self.source}: no level {level:g}; levels are {listed}")
        return np.isin(self.level, levels)

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
    every = [f"{v:g}" if isinstance(v, float | np.floating) else str(v) for v in values]
    return ", ".join(
        every if len(every) <= MOST_LISTED else [*every[:MOST_LISTED], f"and {len(every) - MOST_LISTED} more"]
    )
