"""Periodic responses of a rig: single steady states, and curves traced by continuation.

:func:`frequency_response` and :func:`force_response` return a :class:`ResponseCurve`, whose points are
:class:`PeriodicSolution` objects and whose channels are arrays with names and units.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from continuation import ConvergenceError, NewtonSettings, Predictor, Settings, continue_branch, solve_at
from hbm.balance.padding import pad
from hbm.balance.problem import TOLERANCE, AnyBalance, State, balance_of
from hbm.balance.solution import PeriodicSolution, describe, expect_periodic
from hbm.balance.tones import basis_for, holding
from hbm.errors import expect_frequency, expect_level, expect_positive, expect_range, expect_rig
from hbm.fourier import Array, FourierBasis, default_samples, sampled
from hbm.parallel import one_thread
from hbm.response.budget import Along, Budget, OnPoint, continue_within
from hbm.response.curve import ResponseCurve
from hbm.response.forceless import without_force
from hbm.response.liftoff import solve_lifting
from hbm.response.peak import with_peak
from hbm.response.settling import settled
from models.jointed import AnyRig

CURVE_TOLERANCE = 1.5e-3
"""Largest error of the curve between its points (:attr:`hbm.response.curve.ResponseCurve.dense`), of the motion."""

FEWEST = 10
"""Steps over a sweep at least, where the motion is small."""

RELATIVE_STEPS = {"free": 0.5, "asked": 0.01}
"""Largest step as a fraction of the motion, where that is more: on tall resonances; less where a step was asked for."""

SCOUTED = 128
"""Samples per period of a coarse curve."""

EXCURSION = 0.3
"""How far, relatively, a branch is followed beyond the ends of the sweep."""

SWEEP = (0.85, 1.35)
"""Default sweep in units of the first sliding resonance."""

FEW = (3, 5, 7, 9)
"""Harmonics along ramps of the force, before one with all: starts are soon found with few, which need not hold it."""

Way = Callable[[AnyBalance, float], Array | None]
"""From nothing to a solution at a value of the parameter, or to none."""


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
        Where to start from, any number of harmonics and modes; decides the branch where there are several.

    Returns
    -------
    PeriodicSolution

    Raises
    ------
    InputError
        If the force has a harmonic above H.
    continuation.ConvergenceError
        If neither Newton nor a ramp of the force nor a march in time finds it, or friction pushes a free body along.

    Notes
    -----
    The numerical error is not estimated, as it is by :func:`hbm.frequency_response`. What twice as many `harmonics` and
    `samples` change is about as large. Friction in a plane needs thousands of samples for 0.1 %: its error falls in
    proportion to their number, not to the square of it.
    """
    expect_rig(rig, "steady_state", joints=True)
    expect_frequency(hz, "steady_state")
    expect_level(level, "steady_state")
    problem = balance_of(rig, basis_for(rig, harmonics, samples, "steady_state"), level=level)
    lam = problem.lam_at(hz)
    x = first_solution(problem, lam) if start is None else solve_near(problem, lam, start)
    return expect_periodic(describe(problem, x, lam))


@one_thread
def solve_near(problem: AnyBalance, lam: float, start: PeriodicSolution) -> Array:
    """Solution at `lam` by Newton from another solution, padded or cut to the problem's harmonics and modes.

    Raises
    ------
    continuation.ConvergenceError
        If Newton does not converge.
    """
    result = solve_lifting(problem, start.state, lam, _newton())
    if not result.converged:
        hz = problem.hz_at(lam)
        raise ConvergenceError(
            f"steady state: no convergence at {hz:.6g} Hz from the given start, last residual "
            f"{result.residual_norm:.2g}; {result.reason.value}; start closer, or trace the curve"
        )
    return result.x


def first_solution(problem: AnyBalance, lam: float) -> Array:
    """Solution at `lam` from nothing, by the first way that works.

    Newton from rest; from fewer samples, where there are more than usual; from one harmonic upwards; along ramps of the
    force with few harmonics, and with all; along the frequency from far off, where the contact sticks; from where a
    rig with joints settles in time.

    Raises
    ------
    continuation.ConvergenceError
        If none does.
    """
    few = (partial(_by_force, H=H) for H in FEW if H < problem.basis.H)
    ways: tuple[Way, ...] = (_from_rest, _by_samples, _by_harmonics, *few, _by_force, _from_afar, _by_time)
    for way in ways:
        x = way(problem, lam)
        if x is not None and np.isfinite(problem.residual(x, lam)).all():  # a law may have no numbers from its rest
            return x
    where = f"{problem.hz_at(lam):.6g} Hz and {problem.at(lam)[1]:g} N"
    if silent := without_force(problem, lam):
        raise ConvergenceError(f"first solution: none at {where}: {silent}: force not finite; must be for every motion")
    raise ConvergenceError(
        f"first solution: none at {where}, neither from rest, nor with few harmonics first, nor along a force ramp, "
        "from a far frequency or from a march in time; try more samples, another frequency or softer contacts"
    )


def _from_rest(problem: AnyBalance, lam: float) -> Array | None:
    result = solve_lifting(problem, problem.unpack(np.zeros(problem.size), lam), lam, _newton())
    return result.x if result.converged else None


def _by_samples(problem: AnyBalance, lam: float) -> Array | None:
    usual = default_samples(problem.basis.H)
    if problem.basis.N_t <= usual:
        return None
    coarse = problem.on(FourierBasis(problem.basis.H, usual))
    try:
        start = coarse.unpack(first_solution(coarse, lam), lam)
    except ConvergenceError:
        return None
    result = solve_lifting(problem, start, lam, _newton())
    return result.x if result.converged else None


def _by_force(problem: AnyBalance, lam: float, H: int | None = None) -> Array | None:
    hz, F = problem.hz_at(lam), problem.at(lam)[1]
    basis = problem.basis if H is None else FourierBasis(H, problem.basis.N_t)
    ramp = balance_of(problem.rig, basis, parameter="force", hz=hz, level=F)
    settings = _ramp_settings(ramp, 1e-3, 1.0, 0.02)
    branch = continue_branch(ramp, np.zeros(ramp.size), 1e-3, settings)
    return _upwards(problem, lam, basis.H, ramp.unpack(branch.points[-1].x, 1.0)) if branch.complete else None


def _from_afar(problem: AnyBalance, lam: float) -> Array | None:
    sweep = balance_of(problem.rig, problem.basis, level=problem.at(lam)[1])
    end = sweep.lam_at(problem.hz_at(lam))
    for far in (0.7 * end, 1.4 * end):
        x = _from_rest(sweep, far)
        if x is not None:
            settings = _ramp_settings(sweep, far, end, abs(end - far) / 20)
            branch = continue_branch(sweep, x, far, settings)
            if branch.complete:
                return pad(problem, sweep.unpack(branch.points[-1].x, end))
    return None


def _by_time(problem: AnyBalance, lam: float) -> Array | None:
    start = settled(problem, lam)
    result = None if start is None else solve_at(problem, start, lam, _newton())
    return result.x if result is not None and result.converged else None


def _by_harmonics(problem: AnyBalance, lam: float) -> Array | None:
    return _upwards(problem, lam, 1, None)


def _upwards(problem: AnyBalance, lam: float, H: int, state: State | None) -> Array | None:
    """From few harmonics, where a state may be known, to all of them: twice as many at a time, or as go."""
    known, all_of_them = 0, problem.basis.H
    H = min(H, all_of_them)
    while H > known:
        finer = problem.on(FourierBasis(H, problem.basis.N_t))
        start = np.zeros(finer.size) if state is None else pad(finer, state)
        result = solve_at(finer, start, lam, _newton())
        if not result.converged:
            H = known + (H - known) // 2 if known else 0
        elif H == all_of_them:
            return result.x
        else:
            state, known, H = finer.unpack(result.x, lam), H, min(2 * H + 1, all_of_them)
    return None


def _newton() -> NewtonSettings:
    return NewtonSettings(tolerance=TOLERANCE, max_iterations=30)


def trace_settings(problem: AnyBalance, lam0: float, lam_end: float, step_max: float | None = None) -> Settings:
    """Settings of a trace from `lam0` to `lam_end`, with a largest step where one is asked for."""
    relative = RELATIVE_STEPS["free" if step_max is None else "asked"]
    step_max = abs(lam_end - lam0) / FEWEST if step_max is None else step_max
    # a reference amplitude counts as much as the whole sweep; the friction force follows from the motion and turns
    # much faster: it hardly counts
    weights = np.full(problem.size, (lam_end - lam0) ** 2)
    weights[problem.basis.size * problem.structure.n :] *= 1e-3
    return Settings(
        lam_end=lam_end,
        # a branch may fold back past its start and return
        lam_min=min(lam0, lam_end) * (1.0 - EXCURSION),
        lam_max=max(lam0, lam_end) * (1.0 + EXCURSION),
        step=step_max / 5,
        step_min=step_max * 1e-6,
        step_max=step_max,
        relative_step=relative,
        curve_tolerance=CURVE_TOLERANCE,
        target_iterations=4,
        tolerance=TOLERANCE,
        weights=weights,
        max_points=20000,
        max_angle=2.0,
        corner_angle=0.5,
        tangent_slack=0.01,
        predictor=Predictor.CURVED,
    )


def _ramp_settings(problem: AnyBalance, lam0: float, lam_end: float, step_max: float) -> Settings:
    """Settings of a way to a solution: nobody looks at what lies between its points."""
    settings = trace_settings(problem, lam0, lam_end, step_max)
    return replace(settings, max_points=300, relative_step=RELATIVE_STEPS["free"], curve_tolerance=math.inf)


def sweep_of(rig: AnyRig, hz: tuple[float, float] | None, where: str) -> tuple[float, float]:
    """Where a sweep starts and ends [Hz]: as asked for, or about the first sliding resonance.

    Raises
    ------
    InputError
        If there is no rig, or the range has no length.
    """
    expect_rig(rig, where, joints=True)
    if hz is None:
        omega_n = rig.structure.omega_n
        first = float(omega_n[omega_n > 0.0][0]) / (2 * np.pi)
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
        Where to start and where to end [Hz], either may be the larger.
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
    return _trace(problem, lam0, replace(settings, curve_tolerance=math.inf, corner_angle=np.pi), None, budget)


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
    branch = continue_within(budget, along, problem, first_solution(problem, lam0), lam0, settings, on_point)
    points = tuple(describe(problem, p.x, p.lam) for p in branch.points)
    return ResponseCurve(problem.rig, points, branch, problem)


def _shown(problem: AnyBalance, lam: float) -> float:
    """Frequency [Hz] or force [N] at a value of the continuation parameter."""
    return problem.hz_at(lam) if problem.parameter == "frequency" else problem.at(lam)[1]
