"""From nothing to a first solution, by the first way that works."""

import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

import numpy as np

from continuation import ConvergenceError, continue_branch, solve_at
from hbm.balance.padding import pad
from hbm.balance.problem import AnyBalance, State, balance_of
from hbm.fourier import Array, FourierBasis, default_samples
from hbm.response.forceless import without_force
from hbm.response.liftoff import solve_lifting
from hbm.response.settling import March, march_from_rest, restless, settled
from hbm.response.steps import newton_settings, ramp_settings

FEW = (3, 5, 7, 9)
"""Harmonics along ramps of the force, before one with all: starts are soon found with few, which need not hold it."""

MOST_POINTS = 400
"""Of all ramps of the force together."""

Late = Callable[[object], bool]
"""Whether the time is over; asked with each point of a ramp."""

Begin = Callable[[AnyBalance, float], Array]
"""Where Newton's method begins at a value of the parameter."""

Marched = Callable[[], March | None]
"""The motion from rest at the value of the parameter, marched in time when first asked for."""

Way = Callable[[AnyBalance, float, Late], Array | None]
"""From nothing to a solution at a value of the parameter, or to none."""


def first_solution(problem: AnyBalance, lam: float, seconds: float = math.inf) -> Array:
    """Solution at `lam` from nothing, by the first way that works.

    Newton from rest; from fewer samples, where there are more than usual; from one harmonic upwards; along ramps of the
    force with few harmonics, and with all; along the frequency from far off, where the contact sticks; from where it
    settles in time; from the linear motion about rest, and along a ramp that begins with it.

    Parameters
    ----------
    problem : HarmonicBalance or JointBalance
    lam : float
    seconds : float
        No way is begun later, and no ramp goes on.

    Raises
    ------
    continuation.ConvergenceError
        If none does, or not in that time.
    """
    ends = time.monotonic() + seconds
    return _first(problem, lam, lambda _: time.monotonic() > ends, cache(partial(march_from_rest, problem, lam)))


def _first(problem: AnyBalance, lam: float, late: Late, marched: Marched) -> Array:
    linear: tuple[Way, ...] = (partial(_directly, begin=_linear), partial(_by_force, begin=_linear))
    by_samples, by_time = (partial(way, marched=marched) for way in (_by_samples, _by_time))
    ways: tuple[Way, ...] = (_directly, by_samples, _by_harmonics, _by_force, _from_afar, by_time, *linear)
    where = f"{problem.hz_at(lam):.6g} Hz and {problem.at(lam)[1]:g} N"
    for way in ways:
        x = way(problem, lam, late)
        if x is not None and np.isfinite(problem.residual(x, lam)).all():  # a law may have no numbers from its rest
            return x
        if late(way):
            raise ConvergenceError(
                f"first solution: none at {where} in its time; allow more seconds, or start elsewhere"
            )
    if silent := without_force(problem, lam):
        raise ConvergenceError(f"first solution: none at {where}: {silent}: force not finite; must be for every motion")
    raise ConvergenceError(
        f"first solution: none at {where}, neither from rest or linear motion, nor with few harmonics first, along a "
        f"force ramp, from a far frequency or a march in time{restless(marched())}; try more harmonics or "
        "samples, another frequency, softer contacts, more damping of the higher modes, or simulate it in time"
    )


def _rest(problem: AnyBalance, lam: float) -> Array:
    return np.zeros(problem.size)


@np.errstate(all="ignore")  # a law may have no numbers there
def _linear(problem: AnyBalance, lam: float) -> Array:
    """Motion with the slopes of the laws at rest, which is Newton's step from there, whole.

    Where a motion decides the mean of a law's memory and rest leaves it as it is, the mean follows no slope at rest:
    it may grow like the root of the motion. Then no part of the step lowers the residual, but from its end all do.
    """
    rest = _rest(problem, lam)
    there = problem.linearize(rest, lam)
    try:
        return there.solve_bordered(np.zeros(problem.size), 1.0, -there.residual, 0.0)[0]
    except np.linalg.LinAlgError:
        return rest


def _directly(problem: AnyBalance, lam: float, late: Late, begin: Begin = _rest) -> Array | None:
    result = solve_lifting(problem, problem.unpack(begin(problem, lam), lam), lam, newton_settings())
    return result.x if result.converged else None


def _by_samples(problem: AnyBalance, lam: float, late: Late, marched: Marched) -> Array | None:
    usual = default_samples(problem.basis.H)
    if problem.basis.N_t <= usual:
        return None
    coarse = problem.on(FourierBasis(problem.basis.H, usual))
    try:
        start = coarse.unpack(_first(coarse, lam, late, marched), lam)
    except ConvergenceError:
        return None
    result = solve_lifting(problem, start, lam, newton_settings())
    return result.x if result.converged else None


def _by_force(problem: AnyBalance, lam: float, late: Late, begin: Begin = _rest) -> Array | None:
    """Along ramps of the force, with few harmonics first; where one creeps, those with more would for longer."""
    hz, F, left = problem.hz_at(lam), problem.at(lam)[1], MOST_POINTS
    for H in (*(H for H in FEW if H < problem.basis.H), problem.basis.H):
        basis = FourierBasis(H, problem.basis.N_t)
        ramp = balance_of(problem.rig, basis, parameter="force", hz=hz, level=F)
        settings = ramp_settings(ramp, 1e-3, 1.0, 0.02)
        if begin is not _rest and solve_at(ramp, _rest(ramp, 1e-3), 1e-3, settings).converged:
            return None  # a ramp that begins at rest leads nowhere
        settings = replace(settings, max_points=min(left, settings.max_points))
        branch = continue_branch(ramp, begin(ramp, 1e-3), 1e-3, settings, late)
        left -= len(branch.points)
        found = _upwards(problem, lam, H, ramp.unpack(branch.points[-1].x, 1.0)) if branch.complete else None
        if found is not None or left <= 0 or late(branch):
            return found
    return None


def _from_afar(problem: AnyBalance, lam: float, late: Late) -> Array | None:
    sweep = balance_of(problem.rig, problem.basis, level=problem.at(lam)[1])
    end = sweep.lam_at(problem.hz_at(lam))
    for far in (0.7 * end, 1.4 * end):
        x = _directly(sweep, far, late)
        if x is not None:
            settings = ramp_settings(sweep, far, end, abs(end - far) / 20)
            branch = continue_branch(sweep, x, far, settings, late)
            if branch.complete:
                return pad(problem, sweep.unpack(branch.points[-1].x, end))
    return None


def _by_time(problem: AnyBalance, lam: float, late: Late, marched: Marched) -> Array | None:
    march = marched()
    if march is None:
        return None
    result = solve_at(problem, settled(problem, march), lam, newton_settings())
    return result.x if result.converged else None


def _by_harmonics(problem: AnyBalance, lam: float, late: Late) -> Array | None:
    return _upwards(problem, lam, 1, None)


def _upwards(problem: AnyBalance, lam: float, H: int, state: State | None) -> Array | None:
    """From few harmonics, where a state may be known, to all of them: twice as many at a time, or as go."""
    known, all_of_them = 0, problem.basis.H
    H = min(H, all_of_them)
    while H > known:
        finer = problem.on(FourierBasis(H, problem.basis.N_t))
        start = np.zeros(finer.size) if state is None else pad(finer, state)
        result = solve_at(finer, start, lam, newton_settings())
        if not result.converged:
            H = known + (H - known) // 2 if known else 0
        elif H == all_of_them:
            return result.x
        else:
            state, known, H = finer.unpack(result.x, lam), H, min(2 * H + 1, all_of_them)
    return None
