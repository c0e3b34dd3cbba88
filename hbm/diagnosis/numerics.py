"""Harmonics, samples and modes on which records are simulated, and what they leave: a cause of misfit too."""

from dataclasses import dataclass

import numpy as np

from continuation import ConvergenceError
from hbm.fourier import Array, FourierBasis
from hbm.identification.records import Measurement, Record, parts, solve_record
from hbm.solution import PeriodicSolution
from models.beam import Beam
from models.rig import Rig

RESOLVED = 2.0
"""A discretisation will do where refining it moves a record by less than this in all, in standard deviations."""

PROBED = 4
"""Records on which it is judged: those that slip fastest, spread over the levels."""

LADDER = ((15, 512, 0), (21, 512, 2), (25, 1024, 4), (35, 1024, 6))
"""Harmonics, samples, and modes beyond those the highest measured harmonic needs; the last is never used but compared
with."""


@dataclass(frozen=True, eq=False)
class Numerics:
    """A discretisation and what it leaves.

    Attributes
    ----------
    basis : FourierBasis
    modes : int
    left : (c, H) array
        Change of each part of an amplitude by refinement, rms over the probed records, in the unit of the channel.
    change : float
        Length of the change of a record, in standard deviations, the largest.
    """

    basis: FourierBasis
    modes: int
    left: Array
    change: float

    def rig(self, rig: Rig) -> Rig:
        """The rig on so many modes."""
        return rig.with_modes(self.modes) if isinstance(rig.body, Beam) and rig.body.modes != self.modes else rig

    def __str__(self) -> str:
        return (
            f"simulated with {self.basis.H} harmonics, {self.basis.N_t} samples and {self.modes} modes; finer ones "
            f"move the fastest records by {self.change:.2g} standard deviations in all, which counts as noise"
        )


def choose(rig: Rig, data: Measurement) -> Numerics:
    """Coarsest discretisation that will do.

    Parameters
    ----------
    rig : Rig
        With as many modes as the highest measured harmonic needs.
    data : Measurement

    Returns
    -------
    Numerics
    """
    n = rig.structure.n
    rungs = [(max(H, data.H + 6), N_t, n + more) for H, N_t, more in LADDER]
    probed = [data.records[i] for i in np.argsort(-data.speed)[:: max(1, len(data.records) // 8)][:PROBED]]
    found: list[list[PeriodicSolution | None]] = []
    for rung in rungs:  # each starts from the one before
        found.append(_solved(rig, probed, *rung, found[-1] if found else [None] * len(probed)))
    amplitudes = [[_amplitudes(data, s) for s in row] for row in found]
    best = None
    for i, (H, N_t, modes) in enumerate(rungs[:-1]):
        pairs = zip(amplitudes[i], amplitudes[-1], probed, strict=True)
        changes = [(a - b, r) for a, b, r in pairs if a is not None and b is not None]
        change = max((float(np.sqrt(np.nansum((d / r.std) ** 2))) for d, r in changes), default=np.inf)
        left = np.sqrt(np.mean([d**2 for d, _ in changes], axis=(0, 1))) if changes else np.zeros(data.H)
        best = Numerics(FourierBasis(H, N_t), modes, np.nan_to_num(left), change)
        if change < RESOLVED:
            break
    assert best is not None
    return best


def _amplitudes(data: Measurement, solution: PeriodicSolution | None) -> Array | None:
    if solution is None:
        return None
    return np.stack([parts(solution.basis, solution[name].coefficients, data.H) for name in data.channels], axis=1)


def _solved(
    rig: Rig, records: list[Record], H: int, N_t: int, modes: int, last: list[PeriodicSolution | None]
) -> list[PeriodicSolution | None]:
    fine, basis = rig.with_modes(modes), FourierBasis(H, N_t)
    out: list[PeriodicSolution | None] = []
    for record, start in zip(records, last, strict=True):
        try:
            out.append(solve_record(fine, basis, record, start))
        except ConvergenceError:
            out.append(None)
    return out
