"""All records of a campaign simulated at any rig, with exact derivatives, in standard deviations.

Uncertain are the responses, force and frequency (through the model), and what the discretisation leaves.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from scipy.linalg import block_diag

from continuation import ConvergenceError
from hbm.diagnosis.background import Basis, basis_of
from hbm.diagnosis.numerics import Correction, Grid, Numerics, amplitudes_of, corrections
from hbm.fourier import Array, FourierBasis
from hbm.identification.records import Measurement, Record, force_columns, parts, solve_from, solve_record
from hbm.residual import State
from hbm.sensitivity import FORCE, HZ, Disturbance, sensitivities
from hbm.solution import PeriodicSolution
from hbm.sweep import each
from hbm.transient import transients
from models.change import drift_scalars, tone_scalars
from models.friction import parameters
from models.numbers import number
from models.rig import Rig

Solutions = Mapping[int, PeriodicSolution]
States = Mapping[int, State]
"""Steady states by the number of their record."""

Result = TypeVar("Result")

NEWTON = 15
"""Iterations from the last steady state, and from the reconstruction where those did not get there."""

CLOCKS = 1e-5
"""What the clocks of generator and recorder agree to, relative standard deviation of the frequency of a record."""

INEXACT = 0.2
"""Of a transient, what its superposition on a steady state leaves out, relative standard deviation."""

LOSSLESS = 1e-9
"""Of the largest loop that friction and slip could close, the loss of a contact that sticks."""

TINY = 1e-12
"""Variance of a disturbance that is none."""

FAILURES = (ConvergenceError, ArithmeticError, ValueError, np.linalg.LinAlgError)


@dataclass(frozen=True, eq=False)
class Simulated:
    """One record as simulated: amplitudes (2, c, H), derivatives to p keys (..., p), to force and to frequency.

    Where the harmonics of the force were simulated, `by_tones` (2, c, H, 2t) has the derivatives to their coefficients;
    where the contact never slips, `by_history` (2, c, H) what one standard deviation of its mean friction does; and
    where transients may not have died out, `by_transients` (2, c, H, k) what each motion of a start from rest leaves.
    `Q_by_keys` (2H'+1, n, p) and `T_by_keys` (2H'+1, p) are the derivatives of the unknowns of the balance.
    """

    solution: PeriodicSolution
    amplitudes: Array
    by_keys: Array
    by_force: Array
    by_hz: Array
    by_tones: Array | None
    by_history: Array | None
    by_transients: Array | None
    Q_by_keys: Array
    T_by_keys: Array

    @property
    def transients(self) -> int:
        """How many motions of a start from rest are left in it."""
        return 0 if self.by_transients is None else self.by_transients.shape[-1]

    def moved(self, change: Array) -> State:
        """Where the steady state is to first order when the numbers of the keys change by so much, (p,)."""
        state = self.solution.state
        return replace(state, Q=state.Q + self.Q_by_keys @ change, T=state.T + self.T_by_keys @ change)


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
        Measured less simulated in units of the channel, less the likeliest transients where there are any.
    measured : (m,) array
        In units of the channel.
    record, channel, harmonic, part : (m,) int array
        Where each entry belongs: number of the record, place of the channel, harmonic, 0 of a cosine and 1 of a sine.
    spreads : dict of int to float
        Logarithm of the determinant of the covariance beside that of the noise of the responses alone, by record.
    shared : float
        What a background, which records share, adds to that.
    free : float
        What transients that are free in each record add to it: so much chi2 their freedom costs.
    lasting : (m,) array
        Those transients, in units of the channel.
    """

    residual: Array
    jacobian: Array
    raw: Array
    measured: Array
    record: npt.NDArray[np.int64]
    channel: npt.NDArray[np.int64]
    harmonic: npt.NDArray[np.int64]
    part: npt.NDArray[np.int64]
    spreads: Mapping[int, float]
    shared: float = 0.0
    free: float = 0.0
    lasting: Array | None = None

    @property
    def predicted(self) -> "Whitened":
        """The same as predicted: transients that are free in each record foretell nothing of another."""
        return self if self.lasting is None else replace(self, raw=self.raw + self.lasting, lasting=None)

    @property
    def charged(self) -> float:
        """Sum of squares and what transients cost: they explain whatever they are fitted to, records held out too."""
        return self.chi2 + self.free

    @property
    def spread(self) -> float:
        """Of all records together."""
        return float(sum(self.spreads.values())) + self.shared

    def deviance(self, record: int) -> float:
        """Twice the negative logarithm of a record's likelihood, but for a constant."""
        return float(np.sum(self.residual[self.record == record] ** 2)) + self.spreads[record]

    @property
    def chi2(self) -> float:
        """Sum of squares."""
        return float(self.residual @ self.residual)

    def __len__(self) -> int:
        """Number of coefficients."""
        return len(self.residual)


@dataclass(frozen=True, eq=False)
class Campaign:
    """Measured records, how they are simulated and by whom, and what corrects the simulation of each.

    `background` is the size of what no model describes, by harmonic: see :mod:`hbm.diagnosis.background`.
    """

    data: Measurement
    numerics: Numerics
    corrections: Mapping[int, Correction] = field(default_factory=dict)
    executor: Executor | None = None
    background: Mapping[int, float] = field(default_factory=dict)

    def of(self, numbers: Sequence[int]) -> "Campaign":
        """Some of the records."""
        keep = [i for i, r in enumerate(self.data.records) if r.number in set(numbers)]
        chosen = tuple(self.data.records[i] for i in keep)
        return replace(self, data=Measurement(chosen, self.data.channels, self.data.H, self.data.speed[keep]))

    def corrected(self, rig: Rig, solutions: Solutions) -> "Campaign":
        """The same, with the discretisation corrected where it is now."""
        return replace(self, corrections=corrections(rig, self.data, self.numerics, solutions, self.executor))

    def coarsely(self, H: int, N_t: int, modes: int) -> "Campaign":
        """The same on another discretisation, without a correction."""
        working = Grid(FourierBasis(H, N_t), modes)
        return replace(self, numerics=replace(self.numerics, working=working), corrections={})

    @property
    def numbers(self) -> list[int]:
        """Of its records."""
        return [r.number for r in self.data.records]

    @property
    def points(self) -> int:
        """Coefficients that were measured."""
        return sum(int(r.listed.sum()) for r in self.data.records)

    def simulate(
        self, rig: Rig, keys: Sequence[str], starts: States, needed: Collection[int] = ()
    ) -> dict[int, Simulated]:
        """Steady states of a rig with derivatives to keys; records whose steady state is not found are left out.

        Parameters
        ----------
        rig : Rig
        keys : sequence of str
            Of :func:`hbm.sensitivity.rig_scalars`.
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
        task = partial(simulated, self.numerics.working.rig(rig), self.numerics.working.basis, self.data, tuple(keys))
        return self._each(task, starts, needed)

    def solve(self, rig: Rig, last: Solutions) -> dict[int, PeriodicSolution]:
        """Steady states alone, from the last ones."""
        task = partial(steady, self.numerics.working.rig(rig), self.numerics.working.basis)
        return self._each(task, states(last))

    def _each(
        self, task: Callable[[Record, State | None], Result | None], starts: States, needed: Collection[int] = ()
    ) -> dict[int, Result]:
        """Result of a task for each record, without those that have none; it ends where one that is needed has none."""
        records = self.data.records
        given = [starts.get(r.number) for r in records]
        found = {}
        results = map(task, records, given) if self.executor is None else each(self.executor, task, records, given)
        for record, result in zip(records, results, strict=True):
            if result is not None:
                found[record.number] = result
            elif record.number in needed:
                raise ConvergenceError(f"diagnose: record {record.number} has lost its steady state")
        return found

    def amplitudes(self, number: int, solution: PeriodicSolution) -> Array:
        """Of the channels in a record, corrected, (2, c, H)."""
        correction = self.corrections.get(number)
        return amplitudes_of(self.data, solution) + (0.0 if correction is None else correction.added)

    def std(self, record: Record) -> Array:
        """Of each amplitude of a record, noise and what the discretisation leaves, (c, H)."""
        correction = self.corrections.get(record.number)
        return np.asarray(np.hypot(record.std, 0.0 if correction is None else correction.left))

    def disturbances(self, record: Record, simulated: Simulated) -> Array:
        """What one standard deviation of force, frequency, history and each transient does to a record as a whole.

        They are (k, 2, c, H), transients last.
        """
        force = force_columns(record, simulated.amplitudes, simulated.by_force, simulated.by_tones)
        history = [] if simulated.by_history is None else [simulated.by_history]
        lasting = [] if simulated.by_transients is None else list(np.moveaxis(simulated.by_transients, -1, 0))
        return np.concatenate([force, [CLOCKS * record.hz * simulated.by_hz, *history, *lasting]])

    def listed_std(self, record: Record) -> Array:
        """Of each coefficient listed, (m,)."""
        return np.asarray(np.broadcast_to(self.std(record), record.listed.shape)[record.listed])

    def missed(self, record: Record, simulated: Simulated) -> Array:
        """Measured less simulated of each coefficient listed, (m,)."""
        return np.asarray((record.measured - self.amplitudes(record.number, simulated.solution))[record.listed])

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
        return basis_of(records, [self.std(r) for r in records])

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
        spread = _determinant(columns) + 2.0 * len(raw) * np.log(inexact)
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
            np.asarray(spread - _determinant(settled) if simulated.transients else 0.0),
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


def states(solutions: Solutions) -> dict[int, State]:
    """Their unknowns."""
    return {number: solution.state for number, solution in solutions.items()}


def steady(rig: Rig, basis: FourierBasis, record: Record, last: State | None) -> PeriodicSolution | None:
    """Steady state of a record, from the last one or from the reconstruction; None where it is not found."""
    solved = _steady(rig, basis, record, last)
    return None if solved is None else solved[1]


def _steady(rig: Rig, basis: FourierBasis, record: Record, last: State | None) -> tuple[Rig, PeriodicSolution] | None:
    """The rig of a record, and its steady state."""
    try:
        rig = record.rig(rig)
    except FAILURES:
        return None
    if last is None:
        try:
            return rig, solve_record(rig, basis, record, None)
        except FAILURES:
            return None
    for start in _starts(rig, last, record.start):
        try:
            return rig, solve_from(rig, basis, record, start, NEWTON)
        except FAILURES:
            continue
    return None


def _starts(rig: Rig, last: State, reconstructed: State) -> list[State]:
    """States to start from, whole and by their friction alone; that first where something was attached that swings.

    Its modes share a resonance with others; what the friction is there is nearer than how they move.
    """
    if rig.contact.lift_off:  # which is marched to where Newton's method does not get
        return [last]
    given = [last, reconstructed]
    forced = [replace(state, Q=state.Q[:, :0]) for state in given]
    return [*given, *forced] if last.Q.shape[1] == rig.structure.n else [*forced, *given]


def simulated(
    rig: Rig, basis: FourierBasis, data: Measurement, keys: tuple[str, ...], record: Record, last: State | None
) -> Simulated | None:
    """One record at a rig on a basis, with derivatives to keys; None where no steady state is found."""
    solved = _steady(rig, basis, record, last)
    if solved is None:
        return None
    here, solution = solved
    own, by_keys = in_record(rig, keys, record.number)
    tones = tuple(tone_scalars(here)) if here.excitation.measured_harmonics else ()
    spare = spare_friction(here, solution)
    try:
        by = sensitivities(here, solution, (*own, FORCE, HZ, *tones), held_beside(solution) if spare > 0.0 else None)
        left = None if here.excitation.settled else left_by_transients(here, solution, data)
    except FAILURES:
        return None
    p = len(own)
    slopes = np.stack([parts(basis, by[name].coefficients, data.H) for name in data.channels], axis=1)
    by_tones = slopes[..., p + 2 :] if tones else None
    return Simulated(
        solution=solution,
        amplitudes=amplitudes_of(data, solution),
        by_keys=slopes[..., :p] @ by_keys,
        by_force=slopes[..., p],
        by_hz=slopes[..., p + 1],
        by_tones=by_tones,
        by_history=history(spare, by.disturbed, solution, data) if spare > 0.0 else None,
        by_transients=left,
        Q_by_keys=by.own_Q[..., :p] @ by_keys,
        T_by_keys=by.T[..., :p] @ by_keys,
    )


def sticks(solution: PeriodicSolution) -> bool:
    """Whether the contact never slips: then what it was through before decides its mean friction."""
    T, slip = solution["friction"].samples, solution["slip"].samples
    return abs(solution.friction_loss) <= LOSSLESS * float(np.ptp(T) * np.ptp(slip))


def spare_friction(rig: Rig, solution: PeriodicSolution) -> float:
    """What friction can hold beside what oscillates, where the contact never slips; else 0 [N]."""
    if not sticks(solution):
        return 0.0
    law = parameters(rig.contact.law)
    held = max((float(law[name]) for name in ("mu", "mu_static") if name in law), default=0.0) * rig.contact.normal_load
    return max(held - float(np.ptp(solution["friction"].samples)) / 2.0, 0.0)


def held_beside(solution: PeriodicSolution) -> Disturbance:
    """A constant friction force."""
    constant = np.zeros((solution.basis.size, 1))
    constant[0] = 1.0
    none = np.zeros_like(constant)
    return Disturbance(np.zeros((*solution.state.Q.shape, 1)), constant, none, none, {})


def history(spare: float, by_force: Mapping[str, Array], solution: PeriodicSolution, data: Measurement) -> Array:
    """Change of the amplitudes (2, c, H) with one standard deviation of the mean friction of a contact that sticks.

    The mean may be anything that friction can hold beside what oscillates; it stiffens or softens the beam like a
    force along it (foreshortening), which near a sharp resonance is seen. `by_force` is what a constant friction force
    does, `spare` what friction can hold.
    """
    size = spare / np.sqrt(3.0) / float(by_force["friction"][0, 0])
    change = [parts(solution.basis, by_force[name], data.H)[..., 0] for name in data.channels]
    return np.asarray(size * np.stack(change, axis=1))


def left_by_transients(rig: Rig, solution: PeriodicSolution, data: Measurement) -> Array:
    """What the transients of a start from rest leave in amplitudes, (2, c, H, k): each as large as it may well be."""
    found = transients(rig, solution, data.H)
    coefficients = found.coefficients.reshape(*found.coefficients.shape[:2], -1)
    of_channels = [c.name for c in rig.response_channels]
    basis = FourierBasis(data.H, 2 * data.H + 1)
    picked = coefficients[:, [of_channels.index(name) for name in data.channels]]
    return np.asarray(np.moveaxis(parts(basis, picked, data.H), 1, 2))


def in_record(rig: Rig, keys: Sequence[str], record: int) -> tuple[tuple[str, ...], Array]:
    """Numbers of the rig of a record that numbers of a rig that drifts decide, and their derivatives to them.

    Parameters
    ----------
    rig : Rig
    keys : sequence of str, (p,)
        Its numbers.
    record : int

    Returns
    -------
    tuple of str, (q,)
        Numbers of :meth:`hbm.identification.records.Record.rig`.
    (q, p) array
    """
    after = record - 1
    drifting = dict(zip(drift_scalars(rig), rig.drift, strict=True))
    grown = {drift.parameter: 1.0 + drift.rate * after for drift in rig.drift}
    acts_on = [drifting[key].parameter if key in drifting else key for key in keys]
    own = tuple(dict.fromkeys(acts_on))
    by_keys = np.zeros((len(own), len(keys)))
    for j, (key, target) in enumerate(zip(keys, acts_on, strict=True)):
        by_keys[own.index(target), j] = after * number(rig, target) if key in drifting else grown.get(target, 1.0)
    return own, by_keys


def _determinant(columns: Array) -> float:
    """Logarithm of the determinant of 1 + A A'."""
    return float(np.linalg.slogdet(np.eye(columns.shape[1]) + columns.T @ columns)[1])


def uncorrelated_many(columns: Array, rows: Array) -> tuple[Array, float]:
    """As :func:`uncorrelated`, for hundreds of columns; and the logarithm of the determinant of 1 + A A'."""
    size, V = np.linalg.eigh(columns.T @ columns)
    size = np.maximum(size, 0.0)
    share = np.where(size > TINY, (1.0 - 1.0 / np.sqrt(1.0 + size)) / np.where(size > TINY, size, 1.0), 0.5)
    along = columns @ V
    return np.asarray(rows - along @ (share[:, None] * (along.T @ rows))), float(np.log1p(size).sum())


def uncorrelated(columns: Array, rows: Array) -> Array:
    """(1 + A A')^-1/2 B for a few columns A (m, k) and B (m, n)."""
    U, s, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(rows - U @ ((1.0 - 1.0 / np.sqrt(1.0 + s**2))[:, None] * (U.T @ rows)))
