"""Results of the inverse harmonic balance: contact signals with uncertainty, and how well the sensors fit."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import numpy.typing as npt
from scipy import special

from hbm.fourier import Array, complex_of
from hbm.inverse.sensing import Complex
from hbm.labelled import Variables, dataset, frame
from hbm.measurement.spectra import MeasuredSpectra
from models.display import Displayed
from models.jointed import AnyRig
from models.rig import Rig

SIGNALS = {"slip": "m", "slip_velocity": "m/s", "friction": "N", "normal": "N"}
"""Contact signals that are reconstructed, with their units."""

CONSISTENT = 1e-3
"""Sensors contradict the structure where their misfit is less probable than this by noise alone."""


@dataclass(frozen=True, eq=False)
class EstimatedSignal:
    """One contact signal of r records over a period, with standard deviations.

    Attributes
    ----------
    unit : str
    coefficients : (r, 2H+1) array
        Fourier coefficients a_0, a_1..a_H, b_1..b_H.
    coefficient_std : (r, H+1) array
        Standard deviation of each of the cosine and sine coefficients.
    samples : (r, N) array
        Values at the phases 0, 1/N... of the period.
    std : (r, N) array
        Standard deviation of the samples: noise, and the harmonics above those measured.
    rig_std : (r, N) array, optional
        Beside it, by what the numbers of the rig file may be off by, where that was worked out.
    """

    unit: str
    coefficients: Array
    coefficient_std: Array
    samples: Array
    std: Array
    rig_std: Array | None = None

    @property
    def whole_std(self) -> Array:
        """Standard deviation of the samples by all that was worked out, (r, N)."""
        return self.std if self.rig_std is None else np.hypot(self.std, self.rig_std)

    @property
    def complex(self) -> Complex:
        """Complex coefficients c_k, s = Re sum c_k exp(i k Omega t), (r, H+1)."""
        return complex_of(self.coefficients)

    @property
    def amplitude(self) -> Array:
        """Amplitude of harmonics 0..H, (r, H+1)."""
        return np.abs(self.complex)


@dataclass(frozen=True, eq=False)
class Estimates:
    """A number per record with its standard deviation and unit; `value` and `std` are (r,) arrays.

    `rig_std` is the deviation beside it by what the numbers of the rig file may be off by, where that was worked out.
    """

    value: Array
    std: Array
    unit: str
    rig_std: Array | None = None


@dataclass(frozen=True, eq=False)
class Misfit:
    """Misfit of the sensors to the fitted motion, by record and response channel.

    Attributes
    ----------
    channels : tuple of str, (c,)
    chi2 : (r, c) array
        Squared residuals, in units of the standard deviations, summed over harmonics.
    expected : (r, c) array
        Misfit that noise alone leaves on the mean: the degrees of freedom.
    """

    channels: tuple[str, ...]
    chi2: Array
    expected: Array

    @property
    def reduced(self) -> Array:
        """Reduced chi2 of each record, (r,): 1 where only noise is left, nan without degrees of freedom."""
        expected = self.expected.sum(axis=1)
        return np.asarray(
            np.divide(self.chi2.sum(axis=1), expected, out=np.full(len(expected), np.nan), where=expected > 0)
        )

    @property
    def probability(self) -> Array:
        """Probability that noise alone makes so large a misfit, (r,)."""
        return np.asarray(special.chdtrc(np.maximum(self.expected.sum(axis=1), 1e-9), self.chi2.sum(axis=1)))

    @property
    def consistent(self) -> npt.NDArray[np.bool_]:
        """Whether noise alone explains the misfit of a record, (r,)."""
        return self.probability > CONSISTENT

    @property
    def widening(self) -> Array:
        """Root of the misfit where noise does not explain it, else 1, (r,)."""
        return np.asarray(np.where(self.consistent, 1.0, np.sqrt(np.maximum(self.reduced, 1.0))))


@dataclass(frozen=True, eq=False)
class LawInputs:
    """Signals that a friction law is shown in each record, and their joint uncertainty.

    Attributes
    ----------
    u, rho, eta : (r, H+1) complex arrays
        Modal slip (without the residual compliance's part), and the reaction R = rho + eta T.
    factor : (r, H+1, 4, m) complex array
        Deviations of (T, u, rho, eta) are ``factor @ xi``, real and imaginary parts of xi independent, unit variance.
    by_kept : (r, H+1, 4) complex array
        Their changes with the mean friction that a contact which sticks may have kept, one standard deviation of it; 0
        of one that slips.
    """

    u: Complex
    rho: Complex
    eta: Complex
    factor: Complex
    by_kept: Complex


@dataclass(frozen=True, eq=False)
class Reconstructed(Displayed):
    """What spectra say of the motion and the forces where a rig touches, record by record."""

    rig: AnyRig
    spectra: MeasuredSpectra
    signals: Mapping[str, EstimatedSignal]
    residual: Complex

    @property
    def energies(self) -> Mapping[str, Estimates]:
        """Numbers per record, by the names of their columns in ``energy.csv``."""
        raise NotImplementedError

    @property
    def widening(self) -> Array:
        """By how much standard deviations are larger than noise makes them, where sensors contradict, (r,)."""
        raise NotImplementedError

    def _energies_from(self, energies: Mapping[str, Estimates]) -> Mapping[str, Any]:
        """Fields that hold :attr:`energies`."""
        raise NotImplementedError

    def with_rig_std(self, of: Callable[[str], Array]) -> Self:
        """The same with standard deviations by the rig file, of signals and numbers per record by their names."""
        signals = {name: replace(s, rig_std=of(name)) for name, s in self.signals.items()}
        energies = {name: replace(e, rig_std=of(name)) for name, e in self.energies.items()}
        changes: dict[str, Any] = {"signals": signals, **self._energies_from(energies)}
        return replace(self, **changes)

    def __len__(self) -> int:
        """Number of records."""
        return len(self.spectra)

    def __getitem__(self, name: str) -> EstimatedSignal:
        """Signal by name."""
        return self.signals[name]

    @property
    def H(self) -> int:
        """Highest harmonic."""
        return self.spectra.H

    @property
    def phase(self) -> Array:
        """Phases of the samples, (N,), 0..1 of a period."""
        N = self.signals[self.rig.forces[0]].samples.shape[1]
        return np.asarray(np.arange(N) / N)

    def index(self, record: int | str) -> int:
        """Place of a record by its number or name.

        Raises
        ------
        InputError
            If it is not there.
        """
        return int(np.flatnonzero(self.spectra.records == self.spectra.numbers([record])[0])[0])

    def arrays(self) -> tuple[Variables, Variables]:
        """Arrays and coordinates by name, each with its dimensions and unit."""
        raise NotImplementedError

    def to_xarray(self) -> Any:
        """All of :meth:`arrays` as an xarray.Dataset with units, as in ``reconstruction.nc``.

        Raises
        ------
        InputError
            If xarray is not installed.
        """
        return dataset("to_xarray", *self.arrays(), **self._about())

    def _about(self) -> dict[str, Any]:
        return {"rig": self.rig.name}

    def _peaks(self) -> dict[str, Any]:
        """Columns of a table with a row per record: what it is, and the peak of each signal."""
        columns = {"record": self.spectra.labels, "level": self.spectra.level, "hz": self.spectra.hz}
        return columns | {f"{name}_peak": np.abs(s.samples).max(axis=1) for name, s in self.signals.items()}


@dataclass(frozen=True, eq=False)
class Reconstruction(Reconstructed):
    """Contact forces and motion of r measured records.

    Attributes
    ----------
    rig : Rig
        With the number of modes that was used.
    spectra : MeasuredSpectra
        Spectra that were used.
    formulation : str
    signals : dict of str to EstimatedSignal
        `slip`, `slip_velocity`, `friction`, `normal`.
    slips : (r,) bool array
        Whether the contact slips. Where it does not, its mean friction cannot be known: it counts as zero, and mean
        slip with it.
    energy_per_cycle, work_rate : Estimates
        Energy lost to friction per period [J], and the wear work rate (26) [W], the mean of R |v|.
    misfit : Misfit
    residual : (r, H+1, c + 1) complex array
        Measured less explained, of the response channels of `misfit`, then of the force, in standard deviations; 0
        where not measured.
    resolution : (r, H+1) array
        Standard deviation of harmonics of friction by the sensors alone [N].
    condition : (r, H+1) array
        Condition number of telling friction from the excitation, harmonic by harmonic.
    law_inputs : LawInputs
    warnings : tuple of str
        Warnings, a line each, with numbers.
    unit : str
        The warning about channels in another unit, with which no number here is right; empty where there is none.
    """

    rig: Rig
    spectra: MeasuredSpectra
    formulation: str
    signals: Mapping[str, EstimatedSignal]
    slips: npt.NDArray[np.bool_]
    energy_per_cycle: Estimates
    work_rate: Estimates
    misfit: Misfit
    residual: Complex
    resolution: Array
    condition: Array
    law_inputs: LawInputs
    warnings: tuple[str, ...]
    unit: str = ""

    @property
    def energies(self) -> Mapping[str, Estimates]:
        """Work rate and energy per cycle by their names."""
        return {"work_rate": self.work_rate, "energy_per_cycle": self.energy_per_cycle}

    @property
    def widening(self) -> Array:
        """By how much standard deviations are larger than noise makes them, where sensors contradict, (r,)."""
        return self.misfit.widening

    def _energies_from(self, energies: Mapping[str, Estimates]) -> Mapping[str, Estimates]:
        return energies

    def _about(self) -> dict[str, Any]:
        return {**super()._about(), "formulation": self.formulation}

    def to_dataframe(self) -> Any:
        """A pandas.DataFrame with a row per record: quantities of the contact with standard deviations.

        Raises
        ------
        InputError
            If pandas is not installed.
        """
        columns = self._peaks()
        for name, found in self.energies.items():
            columns |= {name: found.value, f"{name}_std": found.std}
        return frame("to_dataframe", {**columns, "slips": self.slips})

    def arrays(self) -> tuple[Variables, Variables]:
        """Arrays and coordinates by the names of docs/reference/data_files.md, each with its dimensions and unit.

        Returns
        -------
        arrays, coordinates : mapping of str to (dimensions, values, unit)
            Signals and their ``_std`` over (record, phase); their ``_cos``, ``_sin`` and ``_harmonic_std`` over
            (record, harmonic); numbers per record.
        """
        arrays, each = signal_arrays(self.signals), ("record",)
        arrays |= estimate_arrays(self.energies)
        arrays["slips"] = each, self.slips.astype(np.int8), "1"
        arrays["chi2_reduced"] = each, self.misfit.reduced, "1"
        arrays["resolution"] = OVER_HARMONICS, self.resolution, "N"
        arrays["condition"] = OVER_HARMONICS, self.condition, "1"
        return arrays, record_coordinates(self.spectra, self.phase)

    def __repr__(self) -> str:
        """Summary in words, with warnings."""
        head = f"{self.formulation} reconstruction of {', '.join(self.signals)} from {self.spectra}"
        return "\n".join([head, *self.warnings])


OVER_HARMONICS = ("record", "harmonic")


def signal_arrays(signals: Mapping[str, EstimatedSignal]) -> dict[str, tuple[Sequence[str], Any, str]]:
    """Signals with their deviations over (record, phase) and (record, harmonic), by the names of files of arrays."""
    arrays: dict[str, tuple[Sequence[str], Any, str]] = {}
    over_phase = ("record", "phase")
    for name, s in signals.items():
        arrays[name] = over_phase, s.samples, s.unit
        arrays[f"{name}_std"] = over_phase, np.array(s.std), s.unit
        if s.rig_std is not None:
            arrays[f"{name}_rig_std"] = over_phase, s.rig_std, s.unit
        arrays[f"{name}_cos"] = OVER_HARMONICS, s.complex.real, s.unit
        arrays[f"{name}_sin"] = OVER_HARMONICS, -s.complex.imag, s.unit
        arrays[f"{name}_harmonic_std"] = OVER_HARMONICS, s.coefficient_std, s.unit
    return arrays


def estimate_arrays(estimates: Mapping[str, Estimates]) -> dict[str, tuple[Sequence[str], Any, str]]:
    """Numbers per record with their deviations, by the names of files of arrays."""
    arrays: dict[str, tuple[Sequence[str], Any, str]] = {}
    for name, e in estimates.items():
        parts = {"": e.value, "_std": e.std, "_rig_std": e.rig_std}
        arrays |= {f"{name}{part}": (("record",), v, e.unit) for part, v in parts.items() if v is not None}
    return arrays


def record_coordinates(spectra: MeasuredSpectra, phase: Array) -> Variables:
    """Coordinates of arrays over records, phases and harmonics."""
    each = ("record",)
    return {
        "record": (each, spectra.labels, "" if spectra.names else "1"),
        "level": (each, spectra.level, "N"),
        "frequency_hz": (each, spectra.hz, "Hz"),
        "phase": (("phase",), phase, "1"),
        "harmonic": (("harmonic",), np.arange(spectra.H + 1), "1"),
    }
