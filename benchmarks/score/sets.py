"""Poorer sets of a measurement, made by leaving things out of it or by adding noise.

Of a set E: D the first mode's band; C its fundamental alone; A of that the highest level and one sensor; `one-level`
the highest level of the first mode's band, all harmonics and sensors; `one-sensor` everything of one sensor; `40dB`
everything, with a noise of 1 % of each channel's largest fundamental, 0.1 % on the force.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hbm.measurement.spectra import MeasuredSpectra
from models.rig import Rig

Poorer = Callable[[Rig, MeasuredSpectra, np.random.Generator], MeasuredSpectra]
DECIBELS, FORCE_DECIBELS = 40, 60


def complete(rig: Rig, spectra: MeasuredSpectra, rng: np.random.Generator) -> MeasuredSpectra:
    return spectra


def first_band(rig: Rig, spectra: MeasuredSpectra, rng: np.random.Generator) -> MeasuredSpectra:
    """Records nearer to the first natural frequency than to the second, by ratio."""
    between = float(np.sqrt(rig.structure.omega_n[0] * rig.structure.omega_n[1])) / (2 * np.pi)
    return spectra.select(hz=(0.0, between))


def fundamental(rig: Rig, spectra: MeasuredSpectra, rng: np.random.Generator) -> MeasuredSpectra:
    return first_band(rig, spectra, rng).select(harmonics=[1])


def highest_level(rig: Rig, spectra: MeasuredSpectra, rng: np.random.Generator) -> MeasuredSpectra:
    band = first_band(rig, spectra, rng)
    return band.select(levels=[float(band.level.max())])


def any_sensor(rig: Rig, spectra: MeasuredSpectra, rng: np.random.Generator) -> MeasuredSpectra:
    forces = [c.name for c in rig.channels if c.quantity == "force" and c.name in spectra.channels]
    sensors = [name for name in spectra.channels if name not in forces]
    return spectra.select(channels=[*forces, str(rng.choice(sensors))])


def least(rig: Rig, spectra: MeasuredSpectra, rng: np.random.Generator) -> MeasuredSpectra:
    one = any_sensor(rig, fundamental(rig, spectra, rng), rng)
    return one.select(levels=[float(one.level.max())])


def noisier(rig: Rig, spectra: MeasuredSpectra, rng: np.random.Generator) -> MeasuredSpectra:
    """Independent noise on top, up to the decibels of this set; what is noisier already stays as it is."""
    forces = {c.name for c in rig.channels if c.quantity == "force"}
    decibels = np.array([FORCE_DECIBELS if name in forces else DECIBELS for name in spectra.channels])
    fundamentals = np.stack([np.abs(spectra.complex(name)[:, 1]) for name in spectra.channels])
    wanted = np.nanmax(fundamentals, axis=1) * 10.0 ** (-decibels / 20)
    std = np.maximum(spectra.std, wanted[None, :, None])
    added = np.sqrt(std**2 - spectra.std**2)
    both = np.concatenate([added, added[..., 1:]], axis=2)
    coefficients = spectra.coefficients + both * rng.standard_normal(both.shape)
    return replace(spectra, coefficients=coefficients, std=std)


SETS: dict[str, Poorer] = {
    "E": complete,
    "D": first_band,
    "C": fundamental,
    "A": least,
    "one-level": highest_level,
    "one-sensor": any_sensor,
    "40dB": noisier,
}


def poorer(which: str, rig: Rig, spectra: MeasuredSpectra, seed: int, name: str) -> MeasuredSpectra:
    """A set of one case; its draws depend on the seed and the name of the case alone."""
    return SETS[which](rig, spectra, np.random.default_rng([seed, *name.encode()]))
