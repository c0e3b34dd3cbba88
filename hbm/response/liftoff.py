"""Steady states of a tip that lifts off: Newton's method, or where that does not get there, time integration first."""

import numpy as np

from continuation import Correction, NewtonSettings, solve_at
from hbm.balance.jointed import JointBalance
from hbm.balance.padding import pad
from hbm.balance.problem import AnyBalance, HarmonicBalance
from hbm.balance.scaled import State
from hbm.balance.solution import describe
from hbm.fourier import Array, FourierBasis
from hbm.integration.handover import state_at_phase_zero
from hbm.integration.march import march
from hbm.integration.timestep import Stepper

HELD = 1e6
"""Multiple of the load under which no tip lifts off."""

SPARE = 1.0 + 1e-6
"""So much more than the largest tension holds it."""

LOADS = (0.75, 0.5, 0.25, 0.0)
"""On the way from that load to the rig's own, in units of the logarithm."""

PERIODS, STEPS = 60, 1024
"""Marched until what follows a lift has about settled, in steps per period."""


def solve_lifting(problem: AnyBalance, start: State, lam: float, settings: NewtonSettings) -> Correction:
    """Solution at a fixed parameter from a state on any harmonics and modes; see :func:`continuation.solve_at`.

    Where Newton's method does not get there and the tip of the rig can lift off, modes that are new are added one by
    one. Else the tip is first held on its support by a load that no tension exceeds, which is then lowered to the rig's
    own; and if that does not get there either, the motion is marched in time from where the tip was held, and solved
    for from there.
    """
    x = pad(problem, start)
    result = solve_at(problem, x, lam, settings)
    if (
        result.converged
        or isinstance(problem, JointBalance)
        or problem.elements is None
        or not problem.rig.contact.lift_off
    ):
        return result
    by_modes = _by_modes(problem, start, lam, settings)
    if by_modes is not None:
        return by_modes
    held = solve_at(problem.with_load_on_lift(HELD), x, lam, settings)
    if not held.converged:
        return result
    lowered = _lowered(problem, held.x, lam, settings)
    if lowered is not None:
        return lowered
    marched = _marched(problem, held.x, lam)
    return result if marched is None else solve_at(problem, marched, lam, settings)


def _by_modes(problem: HarmonicBalance, state: State, lam: float, settings: NewtonSettings) -> Correction | None:
    """Solution by adding modes that a state does not have, one after the other."""
    beam, more = problem.rig.beam, problem.structure.n - state.Q.shape[1]
    if beam is None or not state.Q.shape[1] or more >= beam.modes:
        return None
    result = None
    for missing in range(more - 1, -1, -1):
        rig = problem.rig.with_modes(beam.modes - missing)
        fewer = HarmonicBalance(
            rig,
            problem.basis,
            parameter=problem.parameter,
            hz=problem.fixed_hz,
            level=problem.level,
            like=problem,
            periods=problem.periods,
        )
        result = solve_at(fewer, pad(fewer, state), lam, settings)
        if not result.converged:
            return None
        state = fewer.unpack(result.x, lam)
    return result


def _lowered(problem: HarmonicBalance, x: Array, lam: float, settings: NewtonSettings) -> Correction | None:
    """Solution from one with the tip held, by lowering what holds it."""
    state = problem.unpack(x, lam)
    if problem.elements is None:
        return None
    way = float(np.log(SPARE * max(1.0, problem.elements.pull(state.Q, state.F * problem.force_shape))))
    result = None
    for share in LOADS:
        result = solve_at(problem.with_load_on_lift(float(np.exp(share * way))), x, lam, settings)
        if not result.converged:
            return None
        x = result.x
    return result


def _marched(problem: HarmonicBalance, x: Array, lam: float) -> Array | None:
    """Unknowns of the motion some periods after the tip is let go."""
    if problem.periods != 1:
        return None
    hz, state = problem.hz_at(lam), problem.unpack(x, lam)
    held = describe(problem.with_load_on_lift(HELD), x, lam)
    try:
        stepper = Stepper.stable(problem.rig, hz, state.F, STEPS)
        history = march(stepper, state_at_phase_zero(held), PERIODS * STEPS, first=(PERIODS - 1) * STEPS)
    except ArithmeticError:
        return None
    analysis = FourierBasis(problem.basis.H, STEPS).analysis
    found = State(analysis @ history.q[:-1], analysis @ history.friction[:-1], state.Omega, state.F)
    return problem.pack(found)[0]
