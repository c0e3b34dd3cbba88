"""Measured coefficients beside those of models: all of them, the signal that shows a misfit best, errors of records."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from hbm.fourier import Array
from hbm.measurement.groups import frequency_bands, levels

if TYPE_CHECKING:
    from hbm.diagnosis.verdict import Diagnosis
    from hbm.outputerror.campaign import Campaign
    from hbm.outputerror.evaluation import Evaluation

MODELS = ("nominal", "calibrated", "extended")

CLEAR, CURVE = 3.0, 4
"""Deviations of so many standard deviations show a misfit; records from which on a level is drawn as a curve."""


@dataclass(frozen=True, eq=False)
class Compared:
    """Coefficients measured beside those of a model, one entry per record, channel and harmonic.

    Attributes
    ----------
    record, channel, harmonic : (m,) int array
        Number of the record, place of the channel.
    level, hz : (m,) array
        [N], [Hz].
    measured, simulated : (m,) complex array
        Amplitudes, the force a cosine.
    std : (m,) array
        Standard deviation of each part.
    held_out : (m,) bool array
    """

    record: npt.NDArray[np.int64]
    channel: npt.NDArray[np.int64]
    harmonic: npt.NDArray[np.int64]
    level: Array
    hz: Array
    measured: npt.NDArray[np.complex128]
    simulated: npt.NDArray[np.complex128]
    std: Array
    held_out: npt.NDArray[np.bool_]

    @property
    def deviation(self) -> Array:
        """Rms of both parts of measured less simulated, in standard deviations."""
        return np.asarray(np.abs(self.measured - self.simulated) / self.std / np.sqrt(2.0))

    def times(self, factor: float) -> "Compared":
        """The same in another unit."""
        return replace(self, measured=factor * self.measured, simulated=factor * self.simulated, std=factor * self.std)

    def where(self, chosen: npt.NDArray[np.bool_]) -> "Compared":
        """Some of the entries."""
        return Compared(*(getattr(self, f.name)[chosen] for f in fields(self)))


@dataclass(frozen=True)
class View:
    """One harmonic of one channel, at one level and in one band of frequencies.

    Attributes
    ----------
    channel, harmonic : int
        Place of the channel.
    level : float
        Mean of the nominal forces [N].
    band : (float, float)
        Its ends [Hz].
    """

    channel: int
    harmonic: int
    level: float
    band: tuple[float, float]

    def of(self, c: Compared) -> npt.NDArray[np.int64]:
        """Places of its entries, in the order of their frequencies."""
        own = (c.channel == self.channel) & (c.harmonic == self.harmonic) & np.isclose(levels(c.level), self.level)
        i = np.flatnonzero(own & (c.hz >= self.band[0]) & (c.hz <= self.band[1]))
        return np.asarray(i[np.argsort(c.hz[i])])


def clearest(models: Sequence[Compared], *, missed: bool) -> View:
    """Choose the harmonic of a channel that the models miss most relative to its response, or the one that moves most.

    Deviations that noise may make do not count. Curves of a few records are passed over where there are longer ones.
    """
    c = Compared(*(np.concatenate([getattr(m, f.name) for m in models]) for f in fields(Compared)))
    bands = frequency_bands(c.hz)
    band = np.array([next(i for i, (low, high) in enumerate(bands) if low <= hz <= high) for hz in c.hz])
    label = np.stack([c.channel, c.harmonic, levels(c.level), band], axis=1)
    found, place, count = np.unique(label, axis=0, return_inverse=True, return_counts=True)
    shown = np.where(c.deviation > CLEAR, np.abs(c.measured - c.simulated), 0.0) if missed else np.abs(c.measured)
    size = np.bincount(place.ravel(), shown / _typical(c))
    size[count < min(CURVE * len(models), int(count.max()))] = -np.inf
    channel, harmonic, level, i = found[int(size.argmax())]
    return View(int(channel), int(harmonic), float(level), bands[int(i)])


def _typical(c: Compared) -> Array:
    """Rms reading of the channel of each entry."""
    rms = np.sqrt(np.bincount(c.channel, np.abs(c.measured) ** 2) / np.maximum(np.bincount(c.channel), 1))
    return np.asarray(np.where(rms > 0.0, rms, 1.0)[c.channel])


def noise_error(c: Compared, *, held: bool) -> float:
    """Relative error that noise alone makes, on the records fitted or on those held out; 0 where there are none."""
    own = c.held_out == held
    size = _typical(c)[own]
    whole = np.linalg.norm(c.measured[own] / size)
    return float(np.linalg.norm(np.sqrt(2.0) * c.std[own] / size) / whole) if whole > 0.0 else 0.0


def record_errors(c: Compared) -> tuple[npt.NDArray[np.int64], Array, Array]:
    """Place of the first entry of each record, its relative error over channels and harmonics, and that by noise."""
    _, first, inverse = np.unique(c.record, return_index=True, return_inverse=True)
    size = _typical(c)
    off, noise, whole = (
        np.sqrt(np.bincount(inverse.ravel(), (part / size) ** 2))
        for part in (np.abs(c.measured - c.simulated), np.sqrt(2.0) * c.std, np.abs(c.measured))
    )
    return first, off / whole, noise / whole


def compared(diagnosis: "Diagnosis", level: Mapping[int, float]) -> dict[str, Compared]:
    """Compare the models of a diagnosis with all records, including those held out.

    Parameters
    ----------
    diagnosis : Diagnosis
    level : mapping of int to float
        Nominal force of each record [N].
    """
    fitted = dict(zip(MODELS, (diagnosis.nominal, diagnosis.calibrated, diagnosis.extended_fit), strict=True))
    out = {}
    for name, e in fitted.items():
        parts = [_entries(e, diagnosis.campaign, level, held=False)]
        parts.append(_entries(diagnosis.held.get(name), diagnosis.held_campaign, level, held=True))
        known = [part for part in parts if part]
        if e is not None and known:
            out[name] = Compared(*(np.concatenate(column) for column in zip(*known, strict=True)))
    return out


def _entries(
    e: "Evaluation | None", campaign: "Campaign | None", level: Mapping[int, float], *, held: bool
) -> tuple[npt.NDArray[Any], ...]:
    if e is None or campaign is None:
        return ()
    campaign, rows = replace(campaign, corrections=e.corrections), []
    for r in campaign.data.records:
        if r.number not in e.found:
            continue
        found = e.found[r.number]
        simulated = campaign.correct(r.number, found.amplitudes) + campaign.lasting(r, found)
        std = np.sqrt(np.mean(np.broadcast_to(r.std, r.measured.shape) ** 2, axis=0))
        channel, k = np.nonzero(r.listed.all(axis=0))
        size = np.ones(len(k))
        complex_of = [a[0, channel, k] + 1j * a[1, channel, k] for a in (r.measured, simulated)]
        numbers = np.full(len(k), r.number), channel, k + 1
        rows.append((*numbers, level[r.number] * size, r.hz * size, *complex_of, std[channel, k], size == held))
    return tuple(np.concatenate(column) for column in zip(*rows, strict=True)) if rows else ()
