"""All records of a campaign simulated at any rig, with exact derivatives, in standard deviations.

Uncertain are the responses, force and frequency (through the model), and what the discretisation leaves.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from scipy.linalg import block_diag

from continuation import ConvergenceError
from hbm.balance.problem import State
from hbm.balance.solution import PeriodicSolution
from hbm.fourier import Array, sampled
from hbm.outputerror.background import ALIKE_OVER, Basis, Reach, basis_of
from hbm.outputerror.numerics import Correction, Grid, Numerics, amplitudes_of, corrections
from hbm.outputerror.records import Measurement, Record, force_columns
from hbm.outputerror.simulated import Simulated, Solutions, States, states
from hbm.outputerror.together import simulated_together, steady_in_turn, steady_together
from hbm.outputerror.whitened import Whitened, log_determinant, uncorrelated, uncorrelated_many
from hbm.parallel import cores, each
from models.jointed import AnyRig

Result = TypeVar("Result")


CLOCKS = 1e-5
"""What the clocks of generator and recorder agree to, relative standard deviation of the frequency of a record."""


INEXACT = 0.2
"""Of a transient, what its superposition on a steady state leaves out, relative standard deviation."""


@dataclass(frozen=True, eq=False)
class Campaign:
    """Measured records, how they are simulated and by whom, and what corrects the simulation of each.

    `background` is the size of what no model describes, by harmonic, `reach` over what it is alike: see
    :mod:`hbm.outputerror.background`.
    """

    data: Measurement
    numerics: Numerics
    corrections: Mapping[int, Correction] = field(default_factory=dict)
    executor: Executor | None = None
    background: Mapping[int, float] = field(default_factory=dict)
    reach: Reach = ALIKE_OVER

    def of(self, numbers: Sequence[int]) -> "Campaign":
        """Some of the records."""
        keep = [i for i, r in enumerate(self.data.records) if r.number in set(numbers)]
        chosen = tuple(self.data.records[i] for i in keep)
        return replace(self, data=replace(self.data, records=chosen, speed=self.data.speed[keep]))

    def corrected(self, rig: AnyRig, solutions: Solutions) -> "Campaign":
        """The same, with the discretisation corrected where it is now."""
        return replace(self, corrections=corrections(rig, self.data, self.numerics, solutions, self.executor))

    def coarsely(self, H: int, N_t: int, modes: int) -> "Campaign":
        """The same on another discretisation that holds the force, without a correction."""
        working = Grid(sampled(max(H, self.numerics.holding), N_t), modes)
        return replace(self, numerics=replace(self.numerics, working=working), corrections={})

    @property
    def numbers(self) -> list[int]:
        """Numbers of its records."""
        return [r.number for r in self.data.records]

    @property
    def points(self) -> int:
        """Coefficients that were measured."""
        return sum(int(r.listed.sum()) for r in self.data.records)

    def simulate(
        self, rig: AnyRig, keys: Sequence[str], starts: States, needed: Collection[int] = ()
    ) -> dict[int, Simulated]:
        """Steady states of a rig with derivatives to keys; records whose steady state is not found are left out.

        Parameters
        ----------
        rig : Rig or JointedRig
        keys : sequence of str
            Keys of :func:`models.scalars.solution_numbers`.
        starts : mapping of int to State
            Where to start; where there is none, from the reconstruction.
        needed : collection of int
            Records without which the others are of no use.

        Returns
        -------
        dict of int to Simulated

        Raises
        ------
        ConvergenceError
            If the steady state of a record that is needed is not found.
        """
        task = partial(
            simulated_together, self.numerics.working.rig(rig), self.numerics.working.basis, self.data, tuple(keys)
        )
        return self._found(task, starts, needed)

    def solve(self, rig: AnyRig, last: Solutions) -> dict[int, PeriodicSolution]:
        """Steady states alone, from the last ones."""
        return self._steady(rig, states(last))

    def solved_in_turn(self, rig: AnyRig, last: Solutions) -> Iterator[tuple[int, PeriodicSolution]]:
        """The same one after the other, by number; those that are found soonest come first."""
        if self.executor is not None:
            yield from self.solve(rig, last).items()
            return
        records, starts, grid = self.data.records, states(last), self.numerics.working
        given = [starts.get(r.number) for r in records]
        for i, solution in steady_in_turn(grid.rig(rig), grid.basis, records, given):
            if solution is not None:
                yield records[i].number, solution

    def reconstructed(self, rig: AnyRig) -> dict[int, PeriodicSolution]:
        """Steady states alone, from what was measured."""
        return self._steady(rig, {r.number: r.start for r in self.data.records})

    def _steady(self, rig: AnyRig, starts: States) -> dict[int, PeriodicSolution]:
        task = partial(steady_together, self.numerics.working.rig(rig), self.numerics.working.basis)
        return self._found(task, starts)

    def _found(
        self,
        task: Callable[[Sequence[Record], Sequence[State | None]], Iterable[Result | None]],
        starts: States,
        needed: Collection[int] = (),
    ) -> dict[int, Result]:
        """Results of a task for records, without those that have none; it ends with one that is needed and has none.

        Raises
        ------
        ConvergenceError
            If one that is needed has none.
        """
        records = self.data.records
        given = [starts.get(r.number) for r in records]
        parts = 1 if self.executor is None else cores()
        of, starting = [records[i::parts] for i in range(parts)], [given[i::parts] for i in range(parts)]
        alone = self.executor is None
        done = map(task, of, starting) if alone else each(self.executor, partial(_listed, task), of, starting)
        found = {}
        for part, results in zip(of, done, strict=True):
            for record, result in zip(part, results, strict=True):
                if result is not None:
                    found[record.number] = result
                elif record.number in needed:
                    raise ConvergenceError(f"diagnose: record {record.name} has lost its steady state")
        return {number: found[number] for number in self.numbers if number in found}

    def amplitudes(self, number: int, solution: PeriodicSolution) -> Array:
        """Amplitudes of the channels in a record, corrected, (2, c, H)."""
        return self.correct(number, amplitudes_of(self.data, solution))

    def correct(self, number: int, amplitudes: Array) -> Array:
        """Amplitudes (2, c, H) of a record as simulated, with what the discretisation adds."""
        correction = self.corrections.get(number)
        return amplitudes + (0.0 if correction is None else correction.added)

    def std(self, record: Record) -> Array:
        """Standard deviation of each amplitude of a record: noise and what the discretisation leaves, as the noise."""
        correction = self.corrections.get(record.number)
        return np.asarray(np.hypot(record.std, 0.0 if correction is None else correction.left))

    def disturbances(self, record: Record, simulated: Simulated) -> Array:
        """Effect of one standard deviation of force, frequency, history and each transient on a record as a whole.

        They are (k, 2, c, H), transients last.
        """
        force = force_columns(record, simulated.amplitudes, simulated.by_force, simulated.by_tones)
        history = [] if simulated.by_history is None else list(np.moveaxis(simulated.by_history, -1, 0))
        lasting = [] if simulated.by_transients is None else list(np.moveaxis(simulated.by_transients, -1, 0))
        return np.concatenate([force, [CLOCKS * record.hz * simulated.by_hz, *history, *lasting]])

    def listed_std(self, record: Record) -> Array:
        """Standard deviation of each coefficient listed, (m,)."""
        return np.asarray(np.broadcast_to(self.std(record), record.listed.shape)[record.listed])

    def missed(self, record: Record, simulated: Simulated) -> Array:
        """Measured less simulated of each coefficient listed, (m,)."""
        return np.asarray((record.measured - self.correct(record.number, simulated.amplitudes))[record.listed])

    def correlated(self, record: Record, simulated: Simulated) -> Array:
        """Disturbances of the coefficients listed, in standard deviations of these, (m, k)."""
        return np.asarray((self.disturbances(record, simulated)[:, record.listed] / self.listed_std(record)).T)

    def lasting(self, record: Record, simulated: Simulated) -> Array:
        """The likeliest transients in a record, (2, c, H); nothing where all have died out."""
        if simulated.by_transients is None:
            return np.zeros(record.listed.shape)
        columns = self.correlated(record, simulated)
        residual = self.missed(record, simulated) / self.listed_std(record)
        size = np.linalg.solve(np.eye(columns.shape[1]) + columns.T @ columns, columns.T @ residual)
        return np.asarray(simulated.by_transients @ size[len(size) - simulated.transients :])

    def _inexact(self, record: Record, lasting: Array) -> float:
        """Standard deviation that what the superposition of transients leaves out makes of that of the noise."""
        size = lasting[record.listed] / self.listed_std(record)
        return float(np.hypot(1.0, INEXACT * np.linalg.norm(size) / np.sqrt(max(len(size), 1))))

    def whiten(self, found: Mapping[int, Simulated], by_x: Array) -> Whitened:
        """Records found, in standard deviations; `by_x` (p, n) turns derivatives to keys into those to coordinates."""
        there = [r for r in self.data.records if r.number in found]
        rows = [self._whitened(r, found[r.number], by_x) for r in there]
        if not rows:
            raise ConvergenceError("diagnose: the steady state of no record was found")
        residual, jacobian, raw, measured, record, channel, harmonic, part = (
            np.concatenate([row[i] for row in rows]) for i in range(8)
        )
        spreads = {r.number: float(row[8]) for r, row in zip(there, rows, strict=True)}
        free = float(sum(float(row[9]) for row in rows))
        lasting = np.concatenate([row[10] for row in rows]) if free else None
        white = Whitened(
            residual, jacobian, raw, measured, record, channel, harmonic, part, spreads, free=free, lasting=lasting
        )
        return self._beside_background(white, there, found, by_x) if any(self.background.values()) else white

    def basis(self, numbers: Sequence[int]) -> Basis:
        """Independent combinations of the coefficients of some records."""
        records = [r for r in self.data.records if r.number in set(numbers)]
        return basis_of(records, [self.std(r) for r in records], self.reach)

    def _beside_background(
        self, white: Whitened, there: Sequence[Record], found: Mapping[int, Simulated], by_x: Array
    ) -> Whitened:
        """The same where a background correlates the records."""
        basis = self.basis([r.number for r in there])
        rows, columns = self.unwhitened(there, found, by_x)
        rows, columns = (basis.whiten(self.background, a) for a in (rows, columns))
        whole, determinant = uncorrelated_many(columns, rows)
        shared = basis.spread(self.background) + determinant - sum(white.spreads.values())
        return replace(white, residual=whole[:, 0], jacobian=whole[:, 1:], shared=shared)

    def unwhitened(self, there: Sequence[Record], found: Mapping[int, Simulated], by_x: Array) -> tuple[Array, Array]:
        """Residual and derivatives (m, 1 + n) in noise's standard deviations; and disturbances, each of one record."""
        rows, columns = [], []
        for r in there:
            s, std = found[r.number], self.listed_std(r)
            inexact = self._inexact(r, self.lasting(r, s))
            rows.append(np.column_stack([self.missed(r, s), s.by_keys[r.listed] @ by_x]) / (inexact * std[:, None]))
            columns.append(self.correlated(r, s) / inexact)
        return np.concatenate(rows), block_diag(*columns)

    def _whitened(self, record: Record, simulated: Simulated, by_x: Array) -> tuple[npt.NDArray[Any], ...]:
        listed, std, raw = record.listed, self.listed_std(record), self.missed(record, simulated)
        whole = self.lasting(record, simulated)
        lasting, inexact = whole[listed], self._inexact(record, whole)
        columns = self.correlated(record, simulated) / inexact
        rows = np.column_stack([raw, simulated.by_keys[listed] @ by_x]) / (inexact * std[:, None])
        white = uncorrelated(columns, rows)
        part, channel, harmonic = np.nonzero(listed)
        number = np.full(len(raw), record.number)
        spread = log_determinant(columns) + 2.0 * len(raw) * np.log(inexact)
        settled = columns[:, : columns.shape[1] - simulated.transients]
        return (
            white[:, 0],
            white[:, 1:],
            raw - lasting,
            record.measured[listed],
            number,
            np.asarray(channel),
            np.asarray(harmonic + 1),
            np.asarray(part),
            spread,
            np.asarray(spread - log_determinant(settled) if simulated.transients else 0.0),
            lasting,
        )

    def chi2(self, solutions: Solutions) -> dict[int, float]:
        """Squared misfit of each record by the noise of its responses and what the discretisation leaves."""
        return {
            r.number: float(
                np.nansum(((r.measured - self.amplitudes(r.number, solutions[r.number])) / self.std(r)) ** 2)
            )
            for r in self.data.records
            if r.number in solutions
        }


def _listed(task: Callable[..., Iterable[Result]], *parts: Sequence[Any]) -> list[Result]:
    """Results of a task that yields them, as another process returns them."""
    return list(task(*parts))
