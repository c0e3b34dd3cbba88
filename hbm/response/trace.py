"""Periodic responses of a rig: single steady states, and curves traced by continuation.

:func:`frequency_response` and :func:`force_response` return a :class:`ResponseCurve`, whose points are
:class:`PeriodicSolution` objects and whose channels are arrays with names and units.
"""

import math
import time
from dataclasses import replace
from functools import partial

import numpy as np

from continuation import ConvergenceError, Settings
from hbm.balance.balanced import expect_joints_of
from hbm.balance.problem import AnyBalance, balance_of
from hbm.balance.solution import PeriodicSolution, describe
from hbm.balance.tones import basis_for, holding
from hbm.balance.touching import first_sliding
from hbm.errors import expect_frequency, expect_level, expect_positive, expect_range, expect_rig
from hbm.fourier import Array, sampled
from hbm.parallel import one_thread
from hbm.response.budget import Along, Budget, OnPoint, continue_within
from hbm.response.curve import ResponseCurve
from hbm.response.liftoff import solve_lifting
from hbm.response.peak import with_peak
from hbm.response.start import first_solution
from hbm.response.steps import RELATIVE_STEPS, newton_settings, trace_settings
from models.jointed import AnyRig

SCOUTED = 128
"""Samples per period of a coarse curve."""

SWEEP = (0.85, 1.35)
"""Default sweep in units of the first sliding resonance."""


@one_thread
def steady_state(
    rig: AnyRig,
    hz: float,
    *,
    level: float | None = None,
    harmonics: int | None = None,
    samples: int | None = None,
    start: PeriodicSolution | None = None,
) -> PeriodicSolution:
    """One periodic response at a given frequency and force.

    Parameters
    ----------
    rig : Rig
    hz : float
        Excitation frequency [Hz].
    level : float, optional
        Force amplitude [N]; the rig's where omitted.
    harmonics : int, optional
        H; 15 where omitted, more where the force has harmonics that these would not hold.
    samples : int, optional
        Samples per period; :func:`default_samples` where omitted.
    start : PeriodicSolution, optional
        Where to start from, any number of harmonics and modes; decides the branch where there are several. A motion of
        another rig will do that has joints of the same names, places and order.

    Returns
    -------
    PeriodicSolution

    Raises
    ------
    InputError
        If the force has a harmonic above H, or `start` is no motion of these joints.
    continuation.ConvergenceError
        If neither Newton nor a ramp of the force nor a march in time finds it, or friction pushes a free body along.

    Notes
    -----
    Neither its numerical error nor its stability is judged: :func:`hbm.error_of` and :func:`hbm.stability_of` do that.
    Far beyond where a contact first opens, many solutions are unstable, or change much with more harmonics. Friction in
    a plane needs thousands of samples for 0.1 %: its error falls in proportion to their number, not to its square.
    """
    expect_rig(rig, "steady_state", joints=True)
    expect_frequency(hz, "steady_state")
    expect_level(level, "steady_state")
    if start is not None:
        expect_joints_of(rig, start, "steady_state")
    problem = balance_of(rig, basis_for(rig, harmonics, samples, "steady_state"), level=level)
    lam = problem.lam_at(hz)
    x = first_solution(problem, lam) if start is None else solve_near(problem, lam, start)
    return expect_periodic(describe(problem, x, lam))


def expect_periodic(found: PeriodicSolution) -> PeriodicSolution:
    """The same, a motion about a place where the body stays.

    Raises
    ------
    ConvergenceError
        If it walks: then there is none. If a law is not solved at its samples.
    """
    if found.unsolved:
        raise ConvergenceError(
            f"steady state: a law is not solved at its samples at {found.hz:.6g} Hz, {found.level:g} N, "
            f"{found.closure:.1%} of its force is open; try more samples, or less damping in the law"
        )
    if found.walks:
        raise ConvergenceError(
            f"steady state: no motion is periodic at {found.hz:.6g} Hz, {found.level:g} N; friction pushes the body "
            f"along, nothing balances its mean, {found.unheld:.2g} of the excitation; simulate it in time instead"
        )
    return found


@one_thread
def solve_near(problem: AnyBalance, lam: float, start: PeriodicSolution) -> Array:
    """Solution at `lam` by Newton from another solution, padded or cut to the problem's harmonics and modes.

    Raises
    ------
    continuation.ConvergenceError
        If Newton does not converge.
    """
    result = solve_lifting(problem, start.state, lam, newton_settings())
    if not result.converged:
        hz = problem.hz_at(lam)
        raise ConvergenceError(
            f"steady state: no convergence at {hz:.6g} Hz from the given start, last residual "
            f"{result.residual_norm:.2g}; {result.reason.value}; start closer, or trace the curve"
        )
    return result.x


def sweep_of(rig: AnyRig, hz: tuple[float, float] | None, where: str) -> tuple[float, float]:
    """Where a sweep starts and ends [Hz]: as asked for, or about the first sliding resonance.

    Raises
    ------
    InputError
        If there is no rig, or the range has no length; or none is given and there is no resonance.
    """
    expect_rig(rig, where, joints=True)
    if hz is None:
        first = first_sliding(rig) / (2 * np.pi)
        return SWEEP[0] * first, SWEEP[1] * first
    expect_range(hz, where)
    return hz


def trace_frequency(
    rig: AnyRig,
    hz: tuple[float, float] | None = None,
    *,
    level: float | None = None,
    harmonics: int | None = None,
    samples: int | None = None,
    step_hz: float | None = None,
    on_point: OnPoint | None = None,
    budget: Budget | None = None,
) -> ResponseCurve:
    """Frequency response with given harmonics and samples; see :func:`hbm.response.accuracy.frequency_response`.

    Parameters
    ----------
    rig : Rig
    hz : (float, float), optional
        Where to start and where to end [Hz], either may be the larger. Where the curve folds back past its start it is
        followed there, up to 30 % beyond: :attr:`ResponseCurve.past_start` says so.
    level : float, optional
        Force amplitude [N].
    harmonics, samples : int, optional
        Highest harmonic H, and samples per period N_t; as of :func:`steady_state` where omitted.
    step_hz : float, optional
        Largest step [Hz] (as arclength: shorter where the amplitude changes); a tenth of the range, or half of the
        motion where that is more, where omitted.
    on_point : callable, optional
        Progress: called with frequency and point number.
    budget : Budget, optional
        Most points and seconds; :class:`hbm.response.budget.Budget` where omitted.

    Returns
    -------
    ResponseCurve
        Partial, and marked so, where a step could not be made, the budget was spent, or the curve turns in place.

    Raises
    ------
    continuation.ConvergenceError
        If there is no first solution.
    """
    begin, end = sweep_of(rig, hz, "trace_frequency")
    expect_level(level, "trace_frequency")
    if step_hz is not None:
        expect_positive(step_hz, "step_hz", "trace_frequency", "Hz")
    problem = balance_of(rig, basis_for(rig, harmonics, samples, "trace_frequency"), level=level)
    lam0, lam1 = problem.lam_at(begin), problem.lam_at(end)
    step = None if step_hz is None else problem.lam_at(step_hz)
    return with_peak(_trace(problem, lam0, trace_settings(problem, lam0, lam1, step), on_point, budget))


def scout_frequency(
    rig: AnyRig,
    hz: tuple[float, float],
    *,
    level: float | None = None,
    harmonics: int = 7,
    budget: Budget | None = None,
) -> ResponseCurve:
    """Coarse frequency response, to see where the peaks are; no corner is looked for.

    Parameters and errors as for :func:`trace_frequency`; harmonics are more where the force needs them.
    """
    problem = balance_of(rig, sampled(holding(rig, harmonics), SCOUTED), level=level)
    lam0, lam1 = map(problem.lam_at, hz)
    settings = trace_settings(problem, lam0, lam1, abs(lam1 - lam0) / 20)
    settings = replace(settings, curve_tolerance=math.inf, corner_angle=np.pi, relative_step=RELATIVE_STEPS["scouted"])
    return _trace(problem, lam0, settings, None, budget)


def force_response(
    rig: AnyRig,
    hz: float,
    force: tuple[float, float],
    *,
    harmonics: int | None = None,
    samples: int | None = None,
    on_point: OnPoint | None = None,
) -> ResponseCurve:
    """Response over the force amplitude at a fixed frequency.

    Parameters
    ----------
    rig : Rig
    hz : float
        Excitation frequency [Hz].
    force : (float, float)
        First and last force amplitude [N], > 0.
    harmonics, samples : int, optional
        Highest harmonic H, and samples per period N_t; as of :func:`steady_state` where omitted.
    on_point : callable, optional
        Progress: called with force and point number.

    Returns
    -------
    ResponseCurve

    Raises
    ------
    continuation.ConvergenceError
        If there is no first solution.
    """
    expect_rig(rig, "force_response", joints=True)
    expect_frequency(hz, "force_response")
    expect_range(force, "force_response", "force", "N")
    basis = basis_for(rig, harmonics, samples, "force_response")
    problem = balance_of(rig, basis, parameter="force", hz=hz, level=max(force))
    lam0, lam1 = force[0] / problem.F_ref, force[1] / problem.F_ref
    return with_peak(_trace(problem, lam0, trace_settings(problem, lam0, lam1), on_point))


@one_thread
def _trace(
    problem: AnyBalance, lam0: float, settings: Settings, on_point: OnPoint | None, budget: Budget | None = None
) -> ResponseCurve:
    along = Along(partial(_shown, problem), "Hz" if problem.parameter == "frequency" else "N")
    budget, began = budget or Budget(), time.monotonic()
    x = first_solution(problem, lam0, budget.left)
    branch = continue_within(budget.after(time.monotonic() - began), along, problem, x, lam0, settings, on_point)
    points = tuple(describe(problem, p.x, p.lam) for p in branch.points)
    return ResponseCurve(problem.rig, points, branch, problem)


def _shown(problem: AnyBalance, lam: float) -> float:
    """Frequency [Hz] or force [N] at a value of the continuation parameter."""
    return problem.hz_at(lam) if problem.parameter == "frequency" else problem.at(lam)[1]
