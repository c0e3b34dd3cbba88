"""All records of a campaign simulated at any rig, with exact derivatives, in standard deviations.

Uncertain are the responses, the force that was measured (through the model), and what the discretisation leaves.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from continuation import ConvergenceError
from hbm.diagnosis.numerics import Correction, Grid, Numerics, amplitudes_of, corrections
from hbm.fourier import Array, FourierBasis
from hbm.identification.records import Measurement, Record, force_columns, parts, solve_from, solve_record
from hbm.sensitivity import FORCE, sensitivities
from hbm.solution import PeriodicSolution
from models.rig import Rig

Solutions = Mapping[int, PeriodicSolution]
"""Steady states by the number of their record."""

NEWTON = 15
"""Iterations from the reconstruction, where those from the last steady state did not get there."""

FAILURES = (ConvergenceError, ArithmeticError, ValueError, np.linalg.LinAlgError)


@dataclass(frozen=True, eq=False)
class Simulated:
    """One record as simulated: amplitudes (2, c, H), derivatives to p keys (2, c, H, p) and to the force (2, c, H)."""

    solution: PeriodicSolution
    amplitudes: Array
    by_keys: Array
    by_force: Array


@dataclass(frozen=True, eq=False)
class Whitened:
    """Records in standard deviations, one after the other.

    Attributes
    ----------
    residual : (m,) array
        Measured less simulated.
    jacobian : (m, p) array
        Of the simulated amplitudes.
    raw : (m,) array
        Measured less simulated in units of the channel.
    measured : (m,) array
        In units of the channel.
    record, channel, harmonic : (m,) int array
        Where each entry belongs: number of the record, place of the channel, harmonic.
    """

    residual: Array
    jacobian: Array
    raw: Array
    measured: Array
    record: npt.NDArray[np.int64]
    channel: npt.NDArray[np.int64]
    harmonic: npt.NDArray[np.int64]

    @property
    def chi2(self) -> float:
        """Sum of squares."""
        return float(self.residual @ self.residual)

    def __len__(self) -> int:
        """Number of coefficients."""
        return len(self.residual)


@dataclass(frozen=True, eq=False)
class Campaign:
    """Measured records, how they are simulated, and what corrects the simulation of each."""

    data: Measurement
    numerics: Numerics
    corrections: Mapping[int, Correction] = field(default_factory=dict)

    def of(self, numbers: Sequence[int]) -> "Campaign":
        """Some of the records."""
        keep = [i for i, r in enumerate(self.data.records) if r.number in set(numbers)]
        chosen = tuple(self.data.records[i] for i in keep)
        return replace(self, data=Measurement(chosen, self.data.channels, self.data.H, self.data.speed[keep]))

    def corrected(self, rig: Rig, solutions: Solutions) -> "Campaign":
        """The same, with the discretisation corrected where it is now."""
        return replace(self, corrections=corrections(rig, self.data, self.numerics, solutions))

    def coarsely(self, H: int, N_t: int) -> "Campaign":
        """The same on another basis, without a correction."""
        working = Grid(FourierBasis(H, N_t), self.numerics.working.modes)
        return replace(self, numerics=replace(self.numerics, working=working), corrections={})

    @property
    def numbers(self) -> list[int]:
        """Of its records."""
        return [r.number for r in self.data.records]

    @property
    def points(self) -> int:
        """Coefficients that were measured."""
        return sum(int(r.listed.sum()) for r in self.data.records)

    def simulate(self, rig: Rig, keys: Sequence[str], last: Solutions) -> dict[int, Simulated]:
        """Steady states of a rig with derivatives to keys; records whose steady state is not found are left out.

        Parameters
        ----------
        rig : Rig
        keys : sequence of str
            Of :func:`hbm.sensitivity.rig_scalars`.
        last : mapping of int to PeriodicSolution
            Where to start; where there is none, from the reconstruction.

        Returns
        -------
        dict of int to Simulated
        """
        fine = self.numerics.working.rig(rig)
        found = {r.number: self._one(fine, r, tuple(keys), last.get(r.number)) for r in self.data.records}
        return {number: simulated for number, simulated in found.items() if simulated is not None}

    def solve(self, rig: Rig, last: Solutions) -> dict[int, PeriodicSolution]:
        """Steady states alone."""
        fine = self.numerics.working.rig(rig)
        found = {r.number: self._solution(fine, r, last.get(r.number)) for r in self.data.records}
        return {number: solution for number, solution in found.items() if solution is not None}

    def _solution(self, rig: Rig, record: Record, last: PeriodicSolution | None) -> PeriodicSolution | None:
        basis = self.numerics.working.basis
        try:
            return solve_record(rig, basis, record, last)
        except FAILURES:
            if last is None:
                return None
        try:
            return solve_from(rig, basis, record, record.start, NEWTON)
        except FAILURES:
            return None

    def _one(self, rig: Rig, record: Record, keys: tuple[str, ...], last: PeriodicSolution | None) -> Simulated | None:
        solution = self._solution(rig, record, last)
        if solution is None:
            return None
        try:
            by = sensitivities(rig, solution, (*keys, FORCE))
        except FAILURES:
            return None
        basis, H = self.numerics.working.basis, self.data.H
        slopes = np.stack([parts(basis, by[name].coefficients, H) for name in self.data.channels], axis=1)
        return Simulated(solution, amplitudes_of(self.data, solution), slopes[..., :-1], slopes[..., -1])

    def amplitudes(self, number: int, solution: PeriodicSolution) -> Array:
        """Of the channels in a record, corrected, (2, c, H)."""
        correction = self.corrections.get(number)
        return amplitudes_of(self.data, solution) + (0.0 if correction is None else correction.added)

    def whiten(self, found: Mapping[int, Simulated], by_x: Array) -> Whitened:
        """Records found, in standard deviations; `by_x` (p, n) turns derivatives to keys into those to coordinates."""
        rows = [self._whitened(r, found[r.number], by_x) for r in self.data.records if r.number in found]
        if not rows:
            raise ConvergenceError("diagnose: the steady state of no record was found")
        columns = [np.concatenate([row[i] for row in rows]) for i in range(7)]
        return Whitened(*columns)

    def _whitened(self, record: Record, simulated: Simulated, by_x: Array) -> tuple[npt.NDArray[Any], ...]:
        listed = record.listed
        correction = self.corrections.get(record.number)
        left = 0.0 if correction is None else correction.left
        std = np.broadcast_to(np.hypot(record.std, left), listed.shape)[listed]
        raw = (record.measured - self.amplitudes(record.number, simulated.solution))[listed]
        columns = force_columns(record, simulated.amplitudes, simulated.by_force)[:, listed] / std
        white = uncorrelated(columns.T, np.column_stack([raw, simulated.by_keys[listed] @ by_x]) / std[:, None])
        _, channel, harmonic = np.nonzero(listed)
        number = np.full(len(raw), record.number)
        return (
            white[:, 0],
            white[:, 1:],
            raw,
            record.measured[listed],
            number,
            np.asarray(channel),
            np.asarray(harmonic + 1),
        )

    def chi2(self, solutions: Solutions) -> dict[int, float]:
        """Squared misfit of each record by the noise of its responses alone."""
        return {
            r.number: float(np.nansum(((r.measured - self.amplitudes(r.number, solutions[r.number])) / r.std) ** 2))
            for r in self.data.records
            if r.number in solutions
        }


def uncorrelated(columns: Array, rows: Array) -> Array:
    """(1 + A A')^-1/2 B for a few columns A (m, k) and B (m, n)."""
    U, s, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(rows - U @ ((1.0 - 1.0 / np.sqrt(1.0 + s**2))[:, None] * (U.T @ rows)))
