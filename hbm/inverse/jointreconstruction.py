"""Reconstructed joint forces and motions: signals, energies, agreement of the sensors, and warnings."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import special

from hbm.fourier import Array
from hbm.inverse.findings import FORCE_FREE
from hbm.inverse.reconstruction import (
    CONSISTENT,
    EstimatedSignal,
    Estimates,
    Misfit,
    Reconstructed,
    estimate_arrays,
    record_coordinates,
    signal_arrays,
)
from hbm.inverse.resolution import harmonics
from hbm.inverse.sensing import Complex
from hbm.labelled import Variables, frame
from hbm.measurement.spectra import MeasuredSpectra
from models.jointed import JointedRig

SAMPLES = 256
"""Per period, of the signals returned."""


@dataclass(frozen=True, eq=False)
class JointReconstruction(Reconstructed):
    """Forces and motions at the ports of all joints, record by record.

    Attributes
    ----------
    rig : JointedRig
    spectra : MeasuredSpectra
    signals : mapping of str to EstimatedSignal
        By the names that solutions give them, ``tip.force``, ``tip.motion``; without their means, which no
        accelerometer sees. Where sensors do not tell the forces of a harmonic apart it is nan, and left out of samples.
    energy : mapping of str to Estimates
        By the names of the joints: what each takes from the body in a period [J], of the harmonics found.
    misfit : Misfit
        Of the response channels measured, and of the force where it was.
    residual : (r, H+1, c + 1) complex array
        Measured less explained, of the channels of `misfit`, in standard deviations; 0 where not measured.
    findings : tuple of str
        What would make the sensors agree where they do not: another unit, or leaving a channel out.
    """

    rig: JointedRig
    spectra: MeasuredSpectra
    signals: Mapping[str, EstimatedSignal]
    energy: Mapping[str, Estimates]
    misfit: Misfit
    residual: Complex
    findings: tuple[str, ...] = ()

    @property
    def energies(self) -> Mapping[str, Estimates]:
        """Energy per cycle of each joint by the names of its columns."""
        return {f"{joint}.energy_per_cycle": energy for joint, energy in self.energy.items()}

    @property
    def widening(self) -> Array:
        """By how much standard deviations are larger than noise makes them, where sensors contradict, (r,)."""
        return widening(self.misfit)

    def _energies_from(self, energies: Mapping[str, Estimates]) -> Mapping[str, Mapping[str, Estimates]]:
        return {"energy": dict(zip(self.energy, energies.values(), strict=True))}

    @property
    def found(self) -> npt.NDArray[np.bool_]:
        """Whether the sensors tell all joint forces apart, by record and harmonic, (r, H+1)."""
        return np.isfinite(self.signals[self.rig.forces[0]].coefficient_std)

    @property
    def chi2(self) -> Array:
        """Squared residuals in units of standard deviations, (r,)."""
        return np.asarray(self.misfit.chi2.sum(axis=1))

    @property
    def freedom(self) -> Array:
        """How many of them noise alone leaves on the mean, (r,)."""
        return _freedom(self.misfit)

    @property
    def probability(self) -> Array:
        """Probability that noise alone makes a misfit as large, (r,); 1 where there are as many forces as sensors."""
        return _probability(self.misfit)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings with numbers, a line each."""
        said, found = [*self.spectra.silent, *self.findings], self.found[:, 1:]
        if self.rig.force_among(self.spectra.channels) is None:
            said.append(FORCE_FREE)
        missing = np.flatnonzero(~found.all(axis=0)).tolist()
        if missing:
            said.append(
                f"{harmonics(missing)}: the sensors do not tell the joint forces apart in "
                f"{np.count_nonzero(~found.all(axis=1))} of {len(self)} records; left out there"
            )
        wrong = self.spectra.labels[~consistent(self.misfit)].tolist()
        if wrong:
            said.append(
                f"records {', '.join(map(str, wrong))}: sensors contradict the body beyond noise, chi2_reduced up to "
                f"{np.nanmax(self.misfit.reduced):.3g}; standard deviations are widened by its square root"
            )
        if not self.freedom.any():
            said.append("as many sensors as joint forces: nothing is left to check the body by")
        return tuple(said)

    def to_dataframe(self) -> Any:
        """A pandas.DataFrame with a row per record: peaks at every port, and what each joint takes.

        Raises
        ------
        InputError
            If pandas is not installed.
        """
        columns = self._peaks()
        for name, energy in self.energies.items():
            columns |= {name: energy.value, f"{name}_std": energy.std}
        return frame("to_dataframe", columns)

    def arrays(self) -> tuple[Variables, Variables]:
        """Arrays and coordinates by names that every format takes, each with its dimensions and unit.

        Returns
        -------
        arrays, coordinates : mapping of str to (dimensions, values, unit)
            As of a :class:`hbm.inverse.reconstruction.Reconstruction`; ``bolt 1.force`` is ``bolt_1_force``.
        """
        arrays = signal_arrays({plain(name): signal for name, signal in self.signals.items()})
        arrays |= estimate_arrays({plain(name): energy for name, energy in self.energies.items()})
        arrays["chi2_reduced"] = ("record",), self.misfit.reduced, "1"
        return arrays, record_coordinates(self.spectra, self.phase)

    def __repr__(self) -> str:
        """Sentences: the size of each force, its uncertainty, and warnings."""
        lines = [
            f"joint forces of {self.rig.name}, {len(self)} records, peak of the series ± standard deviation there:"
        ]
        for name in self.rig.forces:
            s = self.signals[name]
            peak = np.abs(s.samples)
            r, i = np.unravel_index(int(np.argmax(peak)), peak.shape)
            lines.append(f"  {name:24s} {peak[r, i]:.4g} ± {s.std[r, i]:.2g} {s.unit}")
        return "\n".join([*lines, *self.warnings])


def plain(name: str) -> str:
    """A name with nothing but letters, digits and underscores.

    >>> plain("bolt 1.force")
    'bolt_1_force'
    """
    return "".join(letter if letter.isalnum() else "_" for letter in name)


def _freedom(misfit: Misfit) -> Array:
    return np.asarray(np.round(misfit.expected.sum(axis=1)))


def _probability(misfit: Misfit) -> Array:
    freedom = _freedom(misfit)
    return np.where(freedom > 0, special.chdtrc(np.maximum(freedom, 1), misfit.chi2.sum(axis=1)), 1.0)


def consistent(misfit: Misfit) -> npt.NDArray[np.bool_]:
    """Whether noise alone explains the misfit of a record, (r,); so it does where nothing is left to check it by."""
    return np.asarray(_probability(misfit) > CONSISTENT)


def widening(misfit: Misfit) -> Array:
    """Root of the misfit where noise does not explain it, else 1, (r,)."""
    return np.where(consistent(misfit), 1.0, np.sqrt(np.nan_to_num(misfit.reduced, nan=1.0)))
