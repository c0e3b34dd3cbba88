"""Harmonics, samples and modes on which records are simulated, and what they leave: a cause of misfit too.

What a fit needs again and again is simulated on a working discretisation and corrected by its difference to a fine one,
found where it starts and once more where it ends; what the fine one may leave counts as noise.
"""

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

import numpy as np

from continuation import ConvergenceError
from hbm.balance.solution import PeriodicSolution
from hbm.balance.tones import holding
from hbm.fourier import Array, FourierBasis, sampled
from hbm.outputerror.records import Measurement, Record, parts, solve_record
from hbm.parallel import each
from models.jointed import AnyRig

RESOLVED = 8.0
"""A working discretisation will do that is corrected by less than this, in standard deviations of a record in all."""

PROBED = 4
"""Records on which it is judged: those that slip fastest, spread over the levels."""

LADDER = ((21, 256, 0), (21, 512, 0), (25, 512, 4), (35, 1024, 6), (45, 1024, 8))
"""Harmonics, samples, and modes beyond those the highest measured harmonic needs, of working discretisations;"""

FINE = (60, 1024, 12)
"""of the fine one."""

NEGLIGIBLE = 0.1
"""Records that the rung before the fine one changes by less than this are not simulated on it [std]."""

LEFT, LEFT_OFF = 0.5, 3.0
"""Share of the last refinement that the fine discretisation may leave; and where the tip is off its support, whose
motion converges with the inverse of the number of modes: from 16 to 20 is a quarter of what is left."""


@dataclass(frozen=True, eq=False)
class Grid:
    """A basis and a number of modes."""

    basis: FourierBasis
    modes: int

    def rig(self, rig: AnyRig) -> AnyRig:
        """The rig on so many modes; one with joints keeps its own, beside which it has the others at rest."""
        if rig.beam is None or rig.beam.modes == self.modes:
            return rig
        return rig.with_modes(self.modes)


@dataclass(frozen=True, eq=False)
class Numerics:
    """Discretisations of a campaign.

    Attributes
    ----------
    working, finer, fine : Grid
        On which records are fitted, one between, and the one to whose solutions they are corrected.
    change : float
        Length of the correction of a record, in standard deviations, the largest that was probed.
    holding : int
        Harmonics that hold the force of the rig file, which any other discretisation has at least.
    """

    working: Grid
    finer: Grid
    fine: Grid
    change: float
    holding: int = 1

    def __repr__(self) -> str:
        fine = f"{self.fine.basis.H}, {self.fine.basis.N_t} and {self.fine.modes}"
        if self.fine.modes == self.working.modes:
            fine = f"{self.fine.basis.H} and {self.fine.basis.N_t}"
        return (
            f"simulated with {self.working.basis.H} harmonics, {self.working.basis.N_t} samples and "
            f"{self.working.modes} modes, corrected to {fine}: by up to {self.change:.2g} standard deviations of a "
            "record in all"
        )


def choose(rig: AnyRig, data: Measurement, executor: Executor | None = None) -> Numerics:
    """Coarsest working discretisation that will do.

    Parameters
    ----------
    rig : Rig
        With as many modes as the highest measured harmonic needs.
    data : Measurement
    executor : concurrent.futures.Executor, optional
        Does the records side by side.
    """
    n, extends = rig.structure.n, rig.beam is not None  # a body of another kind has no more modes to offer
    held = max(data.H + 6, holding(rig, 1))
    *rungs, fine = [Grid(sampled(max(H, held), N_t), n + more * extends) for H, N_t, more in (*LADDER, FINE)]
    probed = [data.records[i] for i in np.argsort(-data.speed)[:: max(1, len(data.records) // 8)][:PROBED]]
    best: list[Array | None] | None = None
    change = np.inf
    for working in rungs:
        found = each(executor, partial(_solved, working.rig(rig), working.basis), probed, [None] * len(probed))
        if best is None:
            best = _amplitudes(data, each(executor, partial(_solved, fine.rig(rig), fine.basis), probed, found))
        pairs = zip(_amplitudes(data, found), best, probed, strict=True)
        lengths = [_length(a - b, r) for a, b, r in pairs if a is not None and b is not None]
        change = max(lengths, default=np.inf)
        if change < RESOLVED:
            break
    return Numerics(working, rungs[-1], fine, change, holding(rig, 1))


def _length(change: Array, record: Record) -> float:
    """Length of a change of amplitudes (2, c, H), in standard deviations."""
    return float(np.sqrt(np.nansum((change / record.std) ** 2)))


def _amplitudes(data: Measurement, solutions: list[PeriodicSolution | None]) -> list[Array | None]:
    return [None if s is None else amplitudes_of(data, s) for s in solutions]


def amplitudes_of(data: Measurement, solution: PeriodicSolution) -> Array:
    """Amplitudes of the channels: real and imaginary parts of harmonics 1..H, (2, c, H)."""
    columns = [parts(solution.basis, solution[name].coefficients, data.H) for name in data.channels]
    return np.stack(columns, axis=1)


def _solved(
    rig: AnyRig, basis: FourierBasis, record: Record, start: PeriodicSolution | None
) -> PeriodicSolution | None:
    """Steady state of a record; None where it is not found."""
    try:
        return solve_record(record.rig(rig), basis, record, None if start is None else start.state)[0]
    except (ConvergenceError, ValueError):
        return None


@dataclass(frozen=True, eq=False)
class Correction:
    """Correction of the simulation of a record (2, c, H), and the standard deviation of what is left (c, H)."""

    added: Array
    left: Array


def corrections(
    rig: AnyRig,
    data: Measurement,
    numerics: Numerics,
    solutions: Mapping[int, PeriodicSolution],
    executor: Executor | None = None,
) -> dict[int, Correction]:
    """Corrections of records whose steady states at a rig are known on the working discretisation.

    Parameters
    ----------
    rig : Rig
    data : Measurement
    numerics : Numerics
    solutions : mapping of int to PeriodicSolution
        By the number of the record.
    executor : concurrent.futures.Executor, optional
        Does the records side by side.

    Returns
    -------
    dict of int to Correction
        Without those that cannot be simulated more finely.
    """
    records = [r for r in data.records if r.number in solutions]
    found = each(executor, partial(correction, rig, data, numerics), records, [solutions[r.number] for r in records])
    return {r.number: c for r, c in zip(records, found, strict=True) if c is not None}


def correction(
    rig: AnyRig, data: Measurement, numerics: Numerics, record: Record, solution: PeriodicSolution
) -> Correction | None:
    """Correction of one record."""
    between = _solved(numerics.finer.rig(rig), numerics.finer.basis, record, solution)
    if between is None:
        return None
    coarse, finer = amplitudes_of(data, solution), amplitudes_of(data, between)
    share = LEFT_OFF if rig.lift_off and solution.off else LEFT
    if _length(finer - coarse, record) < NEGLIGIBLE:
        return Correction(finer - coarse, share * size(finer - coarse))
    last = _solved(numerics.fine.rig(rig), numerics.fine.basis, record, between)
    if last is None:
        return None
    best = amplitudes_of(data, last)
    return Correction(best - coarse, share * size(best - finer))


def size(change: Array) -> Array:
    """Rms of the two parts of a change (2, c, H), (c, H)."""
    return np.asarray(np.sqrt(np.mean(change**2, axis=0)))
