"""Repeatability: the share of a response that differs between mountings and that no model can predict.

It is known from experience (a percentage), by channel in the rig file, or from records of the same level and frequency
that were measured more than once. It counts as noise, coefficient by coefficient, and stands in for standard deviations
that are not given (:func:`with_std`).
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from hbm.errors import InputError
from hbm.fourier import MANY, Array
from hbm.measurement.spectra import MeasuredSpectra
from models.jointed import AnyRig

SAME = 1e-5
"""Records of one level are of one frequency which differ in it by less than this share, as clocks do: in vacuum a
resonance is stepped through in steps of less than 1e-4."""

LEAST = 1e-9
"""Least standard deviation that a share makes, of the largest amplitude of its channel."""


def with_floor(spectra: MeasuredSpectra, channels: Iterable[str], share: float) -> MeasuredSpectra:
    """Spectra whose standard deviations hold a share of the response of channels, once."""
    return unrepeatable(spectra, {name: share for name in channels if name not in spectra.assumed})


def repeatability_of(rig: AnyRig, spectra: MeasuredSpectra, least: float = 0.0) -> dict[str, float]:
    """Share of its response by which each channel of motion does not repeat: the largest of what is known of it.

    Parameters
    ----------
    rig : Rig
        Its channels may state one.
    spectra : MeasuredSpectra
        Records of the same level and frequency show it.
    least : float
        What is known of all channels; it counts once in those whose standard deviations are made of it already.

    Returns
    -------
    dict of str to float
        By channel, those that were measured.
    """
    stated = {c.name: c.repeatability for c in rig.response_channels if c.name in spectra.channels}
    seen = _of_repetitions(rig, spectra, list(stated))
    floor = {name: 0.0 if name in spectra.assumed else least for name in stated}
    return {name: max(floor[name], share, seen.get(name, 0.0)) for name, share in stated.items()}


def unrepeatable(spectra: MeasuredSpectra, shares: Mapping[str, float]) -> MeasuredSpectra:
    """Spectra whose standard deviations hold what does not repeat, by channel, beside the noise."""
    chosen = [name for name, share in shares.items() if share > 0.0]
    if not chosen:
        return spectra
    places = [spectra.index(name) for name in chosen]
    share = np.array([shares[name] for name in chosen])[:, None]
    std = spectra.std.copy()
    std[:, places] = np.hypot(std[:, places], share * _typical(spectra, places) / np.sqrt(2.0))
    return replace(spectra, std=std, unrepeatable=tuple(chosen))


def with_std(rig: AnyRig | None, spectra: MeasuredSpectra, share: float = 0.0) -> MeasuredSpectra:
    """Spectra in which every coefficient has a standard deviation.

    Where none is given it is the scatter of records measured more than once, relative to the size of the coefficient,
    with phases and responses by the force; where there are none, or it is less, the share stated.

    Parameters
    ----------
    rig : Rig or None
        Says which channel is the force.
    spectra : MeasuredSpectra
        nan where a standard deviation is not given.
    share : float
        Of the amplitude of a response.

    Raises
    ------
    InputError
        If nothing says what a standard deviation is.
    """
    listed = np.isfinite(spectra.coefficients[:, :, : spectra.H + 1])
    missing = listed & np.isnan(spectra.std)
    if not missing.any():
        return spectra
    relative = np.fmax(_scatter(rig, spectra), share / np.sqrt(2.0) if share else np.nan)
    unknown = missing & np.isnan(relative)
    if unknown.any():
        i, j, k = (int(places[0]) for places in np.nonzero(unknown))
        raise InputError(
            f"{spectra.source}: record {spectra.label(int(spectra.records[i]))}, {spectra.channels[j]}, harmonic {k} "
            "has no std; must be > 0, for each of cos and sin; measure records of its level and frequency more than "
            "once, or state --repeatability PERCENT"
        )
    size = np.empty(listed.shape)
    is_force = np.isin(spectra.channels, _forces(rig))
    for own in (np.flatnonzero(is_force), np.flatnonzero(~is_force)):
        if len(own):
            size[:, own] = _typical(spectra, own.tolist())
    least = np.maximum(LEAST * size.max(axis=(0, 2), keepdims=True), np.finfo(float).tiny)
    std = np.where(missing, np.maximum(relative * size, least), spectra.std)
    made = missing.any(axis=(0, 2)) if share else np.zeros(len(spectra.channels), dtype=bool)
    return replace(spectra, std=std, assumed=tuple(np.array(spectra.channels)[made].tolist()))


def _typical(spectra: MeasuredSpectra, places: list[int]) -> Array:
    """Typical size of every harmonic of channels beside each other, (r, c, H+1)."""
    size = np.stack([np.abs(spectra.complex(spectra.channels[i])) for i in places], axis=1)
    return np.stack([typical_size(size[:, :, k]) for k in range(spectra.H + 1)], axis=2)


def _scatter(rig: AnyRig | None, spectra: MeasuredSpectra) -> Array:
    """Relative standard deviation of cos and sin by records measured more than once, (c, H+1); nan without any.

    That of Student's distribution, as of :mod:`hbm.measurement.harmonics`.
    """
    force, k = _force(rig, spectra), np.arange(spectra.H + 1)
    turn = np.exp(-1j * np.angle(force)[:, None] * k)
    forces = _forces(rig)
    out = np.full((len(spectra.channels), len(k)), np.nan)
    for j, name in enumerate(spectra.channels):
        scale = np.abs(force)[:, None] if name not in forces else 1.0
        parts = np.where((k == 0) | ((k == 1) & (name in forces[:1])), 1, 2)  # of the reference the amplitude alone
        freedom, off, size, count = np.zeros((4, len(k)))
        for g in _repeated(spectra):
            values = (spectra.complex(name) * turn / scale)[g]
            n = np.isfinite(values).sum(axis=0)
            mean = np.nansum(values, axis=0) / np.maximum(n, 1)
            freedom += parts * np.maximum(n - 1, 0)
            off += np.nansum(np.abs(values - mean) ** 2, axis=0)
            size += n * np.abs(mean) ** 2
            count += n
        seen = freedom > 0
        nu = freedom[seen]
        student = np.where(nu > 2, nu / np.maximum(nu - 2, 1), 3.0)
        mean_square = np.maximum(size[seen] / count[seen], np.finfo(float).tiny)
        out[j, seen] = np.sqrt(off[seen] / nu * student / mean_square)
    return out


def typical_size(size: Array) -> Array:
    """Typical size of the amplitudes of each record and channel, (r, c): the size of the channel in records as large.

    Near a node a channel hardly moves, and there a share of what it reads would be nothing.
    """
    there = np.isfinite(size)
    squared = np.where(there, size, 0.0) ** 2
    own = np.sqrt(squared.sum(axis=0) / np.maximum(there.sum(axis=0), 1))
    relative = squared / np.where(own > 0.0, own, 1.0) ** 2
    of_record = np.sqrt(relative.sum(axis=1) / np.maximum(there.sum(axis=1), 1))
    return np.asarray(of_record[:, None] * own)


def _of_repetitions(rig: AnyRig, spectra: MeasuredSpectra, names: list[str]) -> dict[str, float]:
    """Relative scatter of the fundamentals of records measured more than once, noise taken off."""
    groups = list(_repeated(spectra))
    if not groups or spectra.H < 1:
        return {}
    force = _force(rig, spectra)
    found = {}
    for name in names:
        i = spectra.index(name)
        transfer = spectra.complex(name)[:, 1] / force
        scatter = [np.abs(transfer[g] - transfer[g].mean()) ** 2 * len(g) / (len(g) - 1) for g in groups]
        noise = [2.0 * (spectra.std[g, i, 1] / np.abs(force[g])) ** 2 for g in groups]
        size = [np.full(len(g), np.abs(transfer[g].mean()) ** 2) for g in groups]
        beyond = (np.concatenate(scatter) - np.concatenate(noise)) / np.concatenate(size)
        found[name] = float(np.sqrt(max(np.nanmean(beyond), 0.0)))
    return found


def _repeated(spectra: MeasuredSpectra) -> Iterator[npt.NDArray[np.int64]]:
    """Places of the records of each level and frequency that was measured more than once.

    Records of many lines are none: they are realisations of a multisine, whose phases differ.
    """
    if spectra.H > MANY:
        return
    key = np.column_stack([spectra.level, np.round(np.log(spectra.hz) / SAME)])
    _, group = np.unique(key, axis=0, return_inverse=True)
    for g in range(group.max() + 1):
        place = np.flatnonzero(group.ravel() == g)
        if len(place) > 1:
            yield place


def _forces(rig: AnyRig | None) -> list[str]:
    return [c.name for c in rig.channels if c.quantity == "force"] if rig else []


def _force(rig: AnyRig | None, spectra: MeasuredSpectra) -> npt.NDArray[np.complex128]:
    """Fundamental of the force of each record; its level where it was not measured."""
    forces = [name for name in _forces(rig) if name in spectra.channels]
    measured = spectra.complex(forces[0])[:, 1] if forces else np.full(len(spectra), np.nan + 0j)
    return np.where(np.isfinite(measured), measured, spectra.level)
