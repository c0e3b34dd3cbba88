"""Records of a campaign simulated together, where their rig allows it; else, and where that fails, one by one."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from hbm.balance.batch import Batch, Motions, Which, is_batched
from hbm.balance.batchednewton import Matrices, Solved, solve
from hbm.balance.jointbatch import JointBatch, JointMatrices
from hbm.balance.jointbatch import is_batched as joints_are_batched
from hbm.balance.jointed import JointBalance
from hbm.balance.padding import pad
from hbm.balance.problem import AnyBalance, HarmonicBalance, State
from hbm.balance.solution import PeriodicSolution, describe_joints, described
from hbm.fourier import Array, FourierBasis
from hbm.outputerror.jointhistory import spare_forces
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
from hbm.sensitivity.batch import Changes, changes_together
from hbm.sensitivity.jointbatch import joint_changes_together
from models.jointed import AnyRig
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

    solved: Solved[Matrices | JointMatrices]
    which: Which


@one_thread
def _solved(
    rig: AnyRig, basis: FourierBasis, records: Sequence[Record], starts: Sequence[State | None]
) -> _Found | None:
    """Steady states of those records that Newton's method finds from where they start; None where it finds none."""
    if not records:
        return None
    try:
        matrices = _matrices(rig, basis, records)
        if matrices is None:
            return None
        problems: Sequence[AnyBalance] = matrices.batch.problems
        given = zip(problems, records, starts, strict=True)
        begin = [_on(problem, _first_start(rig, r, start)) for problem, r, start in given]
        Q, T = (np.stack(parts) for parts in zip(*begin, strict=True))
        solved = solve(matrices, Motions(Q, T), NEWTON)
    except FAILURES:
        return None
    which = np.flatnonzero(solved.converged)
    if not len(which):
        return None
    return _Found(solved if len(which) == len(records) else solved.of(which), which)


def _matrices(rig: AnyRig, basis: FourierBasis, records: Sequence[Record]) -> Matrices | JointMatrices | None:
    """Newton's matrices of the balances of records, none of them worked out; None for rigs solved one by one."""
    hz = np.array([record.hz for record in records])
    if joints_are_batched(rig, basis):
        joined = JointBalance(rig, basis)
        return JointMatrices(JointBatch([joined.at_level(record.force_on(rig)) for record in records], hz))
    if not is_batched(rig):
        return None
    balance = HarmonicBalance(rig, basis)
    its_own = ((balance.with_contact_of(rig.at_record(record.number)), record) for record in records)
    return Matrices(Batch([own.at_level(record.force_on(rig)) for own, record in its_own], hz))


def _first_start(rig: AnyRig, record: Record, last: State | None) -> State:
    """The state that a record alone starts from first."""
    return start_on(rig, record, record.start) if last is None else starts_of(rig, last, record)[0]


def _on(problem: AnyBalance, state: State) -> Motions:
    """A state on the harmonics and modes of a balance."""
    if state.Q.shape != (problem.basis.size, problem.structure.n) or state.T.shape != problem.touching:
        state = problem.unpack(pad(problem, state), 1.0)
    return Motions(state.Q, state.T)


def _described(found: _Found, i: int) -> PeriodicSolution:
    batch, (Q, T), seen = found.solved.matrices.batch, found.solved.motions, found.solved.seen
    problem, hz = batch.problems[i], float(batch.hz[i])
    state = State(Q[i].copy(), T[i].copy(), float(batch.Omega[i, 0]), problem.level)
    if isinstance(batch, JointBatch):
        return describe_joints(batch.problems[i], state, hz, batch.of_joints(seen.signals[i]))
    return described(batch.problems[i], state, hz, batch.kinematics(i, seen))


@one_thread
def _differentiated(
    rig: AnyRig, found: _Found, data: Measurement, keys: tuple[str, ...], records: Sequence[Record]
) -> dict[int, Simulated]:
    """Records found, with derivatives to keys; without those that have none."""
    in_records = [in_record(rig, keys, record) for record in records]
    own, batch = in_records[0][0], found.solved.matrices.batch
    solutions = [_described(found, i) for i in range(len(records))]
    try:
        by, histories = _changes(found.solved, solutions, (*own, HZ), data)
    except FAILURES:
        return {}
    amplitudes, slopes = _parts(by.reads, data.H), _parts(by.channels, data.H)
    p, done = len(own), {}
    for i in np.flatnonzero(by.solved).tolist():
        record, by_keys, solution, here = records[i], in_records[i][1], solutions[i], batch.problems[i].rig
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
            by_history=histories[i],
            by_transients=left,
            Q_by_keys=by.own_Q[i, ..., :p] @ by_keys,
            T_by_keys=by.T[i, ..., :p] @ by_keys,
        )
    return done


def _changes(
    solved: Solved[Any], solutions: Sequence[PeriodicSolution], keys: Sequence[str], data: Measurement
) -> tuple[Changes, list[Array | None]]:
    """Derivatives of records to keys; and of each what the history of what sticks does to it."""
    problems = solved.matrices.batch.problems
    if isinstance(solved.matrices, JointMatrices):
        kept = [dict(spare_forces(p, solution)) for p, solution in zip(problems, solutions, strict=True)]
        ports = sorted(set().union(*kept))
        changes, pushed = joint_changes_together(solved, keys, data.channels, ports)
        return changes, [_history(by, ports, own, data) for by, own in zip(pushed, kept, strict=True)]
    changes, histories = changes_together(solved, keys, data.channels), []
    for i, (problem, solution) in enumerate(zip(problems, solutions, strict=True)):
        spare = spare_friction(problem.rig, solution)
        by_force = {name: series[i][:, None] for name, series in changes.by_mean.items()}
        histories.append(history(spare, by_force, solution, data) if spare > 0.0 else None)
    return changes, histories


def _history(pushed: Array, ports: list[int], spare: Mapping[int, float], data: Measurement) -> Array | None:
    """Change of the amplitudes (2, c, H, k) with one standard deviation of the mean force of each joint that sticks.

    By what constant forces at some ports do (c + b, 2H'+1, b), and what those of joints that stick can hold.
    """
    if not spare:
        return None
    at, sensors = np.array([ports.index(port) for port in spare]), len(data.channels)
    size = np.array(list(spare.values())) / np.sqrt(3.0) / pushed[sensors + at, 0, at]
    return np.asarray(_parts(pushed[None, :sensors, :, at], data.H)[0] * size)


def _parts(coefficients: Array, H: int) -> Array:
    """Real and imaginary part (R, 2, c, H, ...) of amplitudes 1..H of coefficients (R, c, 2H'+1, ...)."""
    sines = coefficients.shape[2] // 2 + 1
    return np.stack([coefficients[:, :, 1 : H + 1], -coefficients[:, :, sines : sines + H]], axis=1)
