"""Repeatability: the share of a response that differs between mountings and that no model can predict.

It is known from experience (a percentage), by channel in the rig file, or from records of the same level and frequency
that were measured more than once. It counts as noise, coefficient by coefficient.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from hbm.fourier import Array
from hbm.measurement.spectra import MeasuredSpectra
from models.jointed import AnyRig

SAME = 1e-4
"""Records of one level are of one frequency which differ in it by less than this share."""


def repeatability_of(rig: AnyRig, spectra: MeasuredSpectra, least: float = 0.0) -> dict[str, float]:
    """Share of its response by which each channel of motion does not repeat: the largest of what is known of it.

    Parameters
    ----------
    rig : Rig
        Its channels may state one.
    spectra : MeasuredSpectra
        Records of the same level and frequency show it.
    least : float
        What is known of all channels.

    Returns
    -------
    dict of str to float
        By channel, those that were measured.
    """
    stated = {c.name: c.repeatability for c in rig.response_channels if c.name in spectra.channels}
    seen = _of_repetitions(rig, spectra, list(stated))
    return {name: max(least, share, seen.get(name, 0.0)) for name, share in stated.items()}


def unrepeatable(spectra: MeasuredSpectra, shares: Mapping[str, float]) -> MeasuredSpectra:
    """Spectra whose standard deviations hold what does not repeat, by channel, beside the noise."""
    chosen = [name for name, share in shares.items() if share > 0.0]
    if not chosen:
        return spectra
    places = [spectra.index(name) for name in chosen]
    share = np.array([shares[name] for name in chosen])[:, None]
    size = np.stack([np.abs(spectra.complex(name)) for name in chosen], axis=1)  # (r, c, H+1)
    typical = np.stack([typical_size(size[:, :, k]) for k in range(spectra.H + 1)], axis=2)
    std = spectra.std.copy()
    std[:, places] = np.hypot(std[:, places], share * typical / np.sqrt(2.0))
    return replace(spectra, std=std)


def typical_size(size: Array) -> Array:
    """How large amplitudes (r, c) of records and channels are: the channel's own size, in records as large as these.

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
    """Places of the records of each level and frequency that was measured more than once."""
    key = np.column_stack([spectra.level, np.round(np.log(spectra.hz) / SAME)])
    _, group = np.unique(key, axis=0, return_inverse=True)
    for g in range(group.max() + 1):
        place = np.flatnonzero(group.ravel() == g)
        if len(place) > 1:
            yield place


def _force(rig: AnyRig, spectra: MeasuredSpectra) -> npt.NDArray[np.complex128]:
    """Fundamental of the force of each record; its level where it was not measured."""
    forces = [c.name for c in rig.channels if c.quantity == "force" and c.name in spectra.channels]
    measured = spectra.complex(forces[0])[:, 1] if forces else np.full(len(spectra), np.nan + 0j)
    return np.where(np.isfinite(measured), measured, spectra.level)
