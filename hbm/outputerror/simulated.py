"""One record simulated at a rig: its steady state, and how what was measured of it follows every number."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from continuation import ConvergenceError, Correction
from hbm.balance.jointednewton import JointLinearization
from hbm.balance.problem import State
from hbm.balance.solution import PeriodicSolution
from hbm.fourier import Array, FourierBasis
from hbm.outputerror.jointhistory import history_of_joints, lossless
from hbm.outputerror.numerics import amplitudes_of
from hbm.outputerror.records import Measurement, Record, parts, solve_from, solve_record, start_on
from hbm.outputerror.transients import transients
from hbm.sensitivity.derivatives import changes_where_solved
from hbm.sensitivity.moving import Disturbance
from models.change import tone_scalars
from models.jointed import AnyRig
from models.jointednumbers import GAINS
from models.numbers import OF_FORCE
from models.parts import alike
from models.scalars import FORCE, HZ

Solutions = Mapping[int, PeriodicSolution]
States = Mapping[int, State]
"""Steady states by the number of their record."""


NEWTON = 15
"""Iterations from the last steady state, and from the reconstruction where those did not get there."""


FAILURES = (ConvergenceError, ArithmeticError, ValueError, np.linalg.LinAlgError)


@dataclass(frozen=True, eq=False)
class Simulated:
    """One record as simulated: amplitudes (2, c, H), derivatives to p keys (..., p), to force and to frequency.

    Where the harmonics of the force were simulated, `by_tones` (2, c, H, 2t) has the derivatives to their coefficients;
    where a contact or joints never slip, `by_history` (2, c, H, k) what one standard deviation of the mean friction of
    each does; and where transients may not have died out, `by_transients` (2, c, H, k) what each motion of a start from
    rest leaves. `Q_by_keys` (2H'+1, n, p) and `T_by_keys` (2H'+1, p), of joints (2H'+1, m, p), are the derivatives of
    the unknowns of the balance.
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


def states(solutions: Solutions) -> dict[int, State]:
    """Their unknowns."""
    return {number: solution.state for number, solution in solutions.items()}


def steady(rig: AnyRig, basis: FourierBasis, record: Record, last: State | None) -> PeriodicSolution | None:
    """Steady state of a record, from the last one or from the reconstruction; None where it is not found."""
    solved = _steady(rig, basis, record, last)
    return None if solved is None else solved[1]


def _steady(
    rig: AnyRig, basis: FourierBasis, record: Record, last: State | None
) -> tuple[AnyRig, PeriodicSolution, Correction] | None:
    """The rig of a record, its steady state, and where Newton's method found it."""
    try:
        rig = record.rig(rig)
        if last is None:
            return rig, *solve_record(rig, basis, record, None)
    except FAILURES:
        return None
    for start in starts_of(rig, last, record):
        try:
            return rig, *solve_from(rig, basis, record, start, NEWTON)
        except FAILURES:
            continue
    return None


def starts_of(rig: AnyRig, last: State, record: Record) -> list[State]:
    """States to start from, whole and by their friction alone; that first where something was attached that swings.

    Its modes share a resonance with others; what the friction is there is nearer than how they move.
    """
    near = start_on(rig, record, last)
    if rig.lift_off:  # which is marched to where Newton's method does not get
        return [near]
    given = [near] if last is record.start else [near, start_on(rig, record, record.start)]
    forced = [replace(state, Q=state.Q[:, :0]) for state in given]
    return [*given, *forced] if last.Q.shape[1] == rig.structure.n else [*forced, *given]


def simulated(
    rig: AnyRig, basis: FourierBasis, data: Measurement, keys: tuple[str, ...], record: Record, last: State | None
) -> Simulated | None:
    """One record at a rig on a basis, with derivatives to keys; None where no steady state is found."""
    solved = _steady(rig, basis, record, last)
    if solved is None:
        return None
    here, solution, found = solved
    own, by_keys = in_record(rig, keys, record)
    tones = tuple(tone_scalars(here.excitation)) if here.excitation.measured_harmonics else ()
    spare = spare_friction(here, solution)
    try:
        beside = held_beside(solution) if spare > 0.0 else None
        by = changes_where_solved(found, solution, (*own, HZ, *tones), beside)
        left = left_by_transients(here, solution, data)
        at = found.linearization
        kept = history_of_joints(at, solution, data) if isinstance(at, JointLinearization) else None
    except FAILURES:
        return None
    p = len(own)
    slopes = np.stack([parts(basis, by[name].coefficients, data.H) for name in data.channels], axis=1)
    by_tones = slopes[..., p + 1 :] if tones else None
    return Simulated(
        solution=solution,
        amplitudes=amplitudes_of(data, solution),
        by_keys=slopes[..., :p] @ by_keys,
        by_force=slopes[..., p - 1] * here.excitation.gain(record.level),
        by_hz=slopes[..., p],
        by_tones=by_tones,
        by_history=history(spare, by.disturbed, solution, data) if spare > 0.0 else kept,
        by_transients=left,
        Q_by_keys=by.own_Q[..., :p] @ by_keys,
        T_by_keys=by.T[..., :p] @ by_keys,
    )


def sticks(solution: PeriodicSolution) -> bool:
    """Whether the contact never slips: then what it was through before decides its mean friction."""
    return lossless(solution.friction_loss, solution["friction"].samples, solution["slip"].samples)


def spare_friction(rig: AnyRig, solution: PeriodicSolution) -> float:
    """Friction that the contact can hold beside what oscillates, where it never slips; else 0 [N]."""
    if rig.holds == 0.0 or not sticks(solution):
        return 0.0
    return max(rig.holds - float(np.ptp(solution["friction"].samples)) / 2.0, 0.0)


def held_beside(solution: PeriodicSolution) -> Disturbance:
    """A constant friction force."""
    constant = np.zeros((solution.basis.size, 1))
    constant[0] = 1.0
    none = np.zeros_like(constant)
    return Disturbance(np.zeros((*solution.state.Q.shape, 1)), constant, none, none, {})


def history(spare: float, by_force: Mapping[str, Array], solution: PeriodicSolution, data: Measurement) -> Array:
    """Change of the amplitudes (2, c, H, 1) with one standard deviation of the mean friction of a contact that sticks.

    The mean may be anything that friction can hold beside what oscillates; it stiffens or softens the beam like a
    force along it (foreshortening), which near a sharp resonance is seen. `by_force` is what a constant friction force
    does, `spare` what friction can hold.
    """
    size = spare / np.sqrt(3.0) / float(by_force["friction"][0, 0])
    change = [parts(solution.basis, by_force[name], data.H) for name in data.channels]
    return np.asarray(size * np.stack(change, axis=1))


def left_by_transients(rig: AnyRig, solution: PeriodicSolution, data: Measurement) -> Array | None:
    """Amplitudes that the transients of a start from rest leave, (2, c, H, k): each as large as it may well be.

    None where all have died out.
    """
    if rig.excitation.settled:
        return None
    found = transients(rig, solution, data.H)
    coefficients = found.coefficients.reshape(*found.coefficients.shape[:2], -1)
    of_channels = [c.name for c in rig.response_channels]
    basis = FourierBasis(data.H, 2 * data.H + 1)
    picked = coefficients[:, [of_channels.index(name) for name in data.channels]]
    return np.asarray(np.moveaxis(parts(basis, picked, data.H), 1, 2))


def in_record(rig: AnyRig, keys: Sequence[str], record: Record) -> tuple[tuple[str, ...], Array]:
    """Numbers of the rig of a record that some numbers of a rig decide, and their derivatives to these.

    Parameters
    ----------
    rig : Rig
    keys : sequence of str, (p,)
        Its numbers; it may drift, or have another force per unit at each level.
    record : Record

    Returns
    -------
    tuple of str, (q,)
        Numbers of :meth:`hbm.outputerror.records.Record.rig`, the force last.
    (q, p) array
    """
    after = record.number - 1
    drifting = {key: rig.drifted(drift) for key, drift in rig.drifting.items()}
    grown = {key: 1.0 + rig.drifting[rate].rate * after for rate, numbers in drifting.items() for key in numbers}
    by_force = _force_by(rig, record)
    acts_on = [drifting.get(key, () if key in by_force else (key,)) for key in keys]
    own = (*dict.fromkeys(target for targets in acts_on for target in targets if target != FORCE), FORCE)
    by_keys = np.zeros((len(own), len(keys)))
    for j, (key, targets) in enumerate(zip(keys, acts_on, strict=True)):
        by_keys[-1, j] = by_force.get(key, 0.0)
        for target in targets:
            by_keys[own.index(target), j] = after * rig.number(target) if key in drifting else grown.get(target, 1.0)
    return own, by_keys


def _force_by(rig: AnyRig, record: Record) -> dict[str, float]:
    """Derivatives of the force on a rig to what the force channel may read of it, by the keys of these."""
    e = rig.excitation
    found = {
        f"{GAINS}{i}]": record.force_on(rig) / gain if alike(level, record.level) else 0.0
        for i, (level, gain) in enumerate(e.force_gain, 1)
    }
    return found if e.channel_gain is None else found | {OF_FORCE: -record.force_on(rig) / e.channel_gain}
