"""Records of a campaign simulated together, where their rig allows it; else, and where that fails, one by one."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from hbm.balance.batch import Batch, Motions, Which, is_batched
from hbm.balance.batchednewton import Solved, solve
from hbm.balance.padding import pad
from hbm.balance.problem import HarmonicBalance, State
from hbm.balance.solution import PeriodicSolution, described
from hbm.fourier import Array, FourierBasis
from hbm.outputerror.records import Measurement, Record, start_on
from hbm.outputerror.simulated import (
    FAILURES,
    NEWTON,
    Simulated,
    history,
    in_record,
    left_by_transients,
    simulated,
    spare_friction,
    starts_of,
    steady,
)
from hbm.parallel import one_thread
from hbm.sensitivity.batch import changes_together
from models.jointed import AnyRig
from models.rig import Rig
from models.scalars import HZ


def steady_together(
    rig: AnyRig, basis: FourierBasis, records: Sequence[Record], starts: Sequence[State | None]
) -> Iterator[PeriodicSolution | None]:
    """Steady states of records, as :func:`hbm.outputerror.simulated.steady`."""
    found = dict(steady_in_turn(rig, basis, records, starts))
    return (found[i] for i in range(len(records)))


def steady_in_turn(
    rig: AnyRig, basis: FourierBasis, records: Sequence[Record], starts: Sequence[State | None]
) -> Iterator[tuple[int, PeriodicSolution | None]]:
    """The same with the place of each record: first those found together, then the others, which take longer."""
    found = _solved(rig, basis, records, starts)
    which = [] if found is None else found.which.tolist()
    if found is not None:
        yield from ((i, _described(found, at)) for at, i in enumerate(which))
    for i in sorted(set(range(len(records))).difference(which)):
        yield i, steady(rig, basis, records[i], starts[i])


def simulated_together(
    rig: AnyRig,
    basis: FourierBasis,
    data: Measurement,
    keys: tuple[str, ...],
    records: Sequence[Record],
    starts: Sequence[State | None],
) -> Iterator[Simulated | None]:
    """Records at a rig with derivatives to keys, as :func:`hbm.outputerror.simulated.simulated`."""
    done: dict[int, Simulated] = {}
    found = _solved(rig, basis, records, starts)
    if found is not None:
        done = _differentiated(rig, found, data, keys, [records[i] for i in found.which])
    for i, (record, start) in enumerate(zip(records, starts, strict=True)):
        yield done[i] if i in done else simulated(rig, basis, data, keys, record, start)


class _Found(NamedTuple):
    """Records whose steady states were found together, `which` of those that were asked for."""

    solved: Solved
    which: Which


@one_thread
def _solved(
    rig: AnyRig, basis: FourierBasis, records: Sequence[Record], starts: Sequence[State | None]
) -> _Found | None:
    """Steady states of those records that Newton's method finds from where they start; None where it finds none."""
    if not records or not is_batched(rig):
        return None
    try:
        rigs = [rig.at_record(record.number) for record in records]
        balance = HarmonicBalance(rig, basis)
        its_own = zip(map(balance.with_contact_of, rigs), records, strict=True)
        problems = [own.at_level(record.force_on(rig)) for own, record in its_own]
        batch = Batch(problems, np.array([r.hz for r in records]))
        given = zip(batch.problems, records, starts, strict=True)
        begin = [_on(problem, _first_start(rig, r, start)) for problem, r, start in given]
        Q, T = (np.stack(parts) for parts in zip(*begin, strict=True))
        solved = solve(batch, Motions(Q, T), NEWTON)
    except FAILURES:
        return None
    which = np.flatnonzero(solved.converged)
    if not len(which):
        return None
    return _Found(solved if len(which) == len(records) else solved.of(which), which)


def _first_start(rig: Rig, record: Record, last: State | None) -> State:
    """The state that a record alone starts from first."""
    return start_on(rig, record, record.start) if last is None else starts_of(rig, last, record)[0]


def _on(problem: HarmonicBalance, state: State) -> Motions:
    """A state on the harmonics and modes of a balance."""
    if state.Q.shape != (problem.basis.size, problem.structure.n):
        state = problem.unpack(pad(problem, state), 1.0)
    return Motions(state.Q, state.T)


def _described(found: _Found, i: int) -> PeriodicSolution:
    batch, (Q, T) = found.solved.batch, found.solved.motions
    problem = batch.problems[i]
    state = State(Q[i].copy(), T[i].copy(), float(batch.Omega[i, 0]), problem.level)
    return described(problem, state, float(batch.hz[i]), batch.kinematics(i, found.solved.seen))


@one_thread
def _differentiated(
    rig: AnyRig, found: _Found, data: Measurement, keys: tuple[str, ...], records: Sequence[Record]
) -> dict[int, Simulated]:
    """Records found, with derivatives to keys; without those that have none."""
    in_records = [in_record(rig, keys, record) for record in records]
    own = in_records[0][0]
    try:
        by = changes_together(found.solved, (*own, HZ), data.channels)
    except FAILURES:
        return {}
    amplitudes, slopes = _parts(by.reads, data.H), _parts(by.channels, data.H)
    p, done = len(own), {}
    for i in np.flatnonzero(by.solved).tolist():
        record, by_keys, solution = records[i], in_records[i][1], _described(found, i)
        here = found.solved.batch.problems[i].rig
        spare = spare_friction(here, solution)
        pushed = {name: series[i][:, None] for name, series in by.by_mean.items()}
        try:
            left = left_by_transients(here, solution, data)
        except FAILURES:
            continue
        done[int(found.which[i])] = Simulated(
            solution=solution,
            amplitudes=amplitudes[i],
            by_keys=slopes[i, ..., :p] @ by_keys,
            by_force=slopes[i, ..., p - 1] * here.excitation.gain(record.level),
            by_hz=slopes[i, ..., p],
            by_tones=None,
            by_history=history(spare, pushed, solution, data) if spare > 0.0 else None,
            by_transients=left,
            Q_by_keys=by.own_Q[i, ..., :p] @ by_keys,
            T_by_keys=by.T[i, :, :p] @ by_keys,
        )
    return done


def _parts(coefficients: Array, H: int) -> Array:
    """Real and imaginary part (R, 2, c, H, ...) of amplitudes 1..H of coefficients (R, c, 2H'+1, ...)."""
    sines = coefficients.shape[2] // 2 + 1
    return np.stack([coefficients[:, :, 1 : H + 1], -coefficients[:, :, sines : sines + H]], axis=1)
