"""Responses along any number of a rig, at a held frequency and force, traced by continuation.

:func:`parameter_response` returns a :class:`ParameterCurve`: a :class:`hbm.response.curve.ResponseCurve` whose points
know the value of the number. Folds in a law's parameter, in the load or in a length are passed as those in frequency
are.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from continuation import Branch, ConvergenceError, Problem, Settings
from hbm.balance.problem import AnyBalance, State
from hbm.balance.solution import PeriodicSolution, describe
from hbm.balance.tones import harmonics_for
from hbm.errors import expect_frequency, expect_level, expect_rig, expect_two
from hbm.fourier import Array, FourierBasis, default_samples, sampled
from hbm.parallel import one_thread
from hbm.response.accuracy import TOLERANCE, finer, ladder, relative_change, scales_of
from hbm.response.budget import Along, Budget, OnPoint, continue_within
from hbm.response.curve import ResponseCurve
from hbm.response.peak import with_peak
from hbm.response.start import first_solution
from hbm.response.steps import EXCURSION, trace_settings
from hbm.response.trace import SCOUTED, solve_near
from hbm.tracking.parameter import Key, ParameterBalance, check_value, parameter_key
from models.jointed import AnyRig
from models.scalars import FORCE, HZ


@dataclass(frozen=True, eq=False)
class ParameterCurve(ResponseCurve):
    """A branch of periodic solutions along one number of the rig, in physical terms.

    Attributes
    ----------
    along : ParameterBalance
        Problem that the branch solves; `problem` is that at the first value.
    error : float
        Largest change of drive displacement or friction force over the period, relative to their peaks on the curve,
        when harmonics, samples and modes are refined at the first, the last and the highest point; nan where none was
        solved again.
    reason : str
        Why this number of harmonics.
    """

    along: ParameterBalance = field(kw_only=True)
    error: float = field(kw_only=True)
    reason: str = field(kw_only=True)

    @property
    def key(self) -> Key:
        """The number: name, value in the rig, unit and bounds."""
        return self.along.key

    @property
    def parameter(self) -> str:
        """Key of the number in the rig file."""
        return self.key.name

    @property
    def unit(self) -> str:
        """Unit of the number."""
        return self.key.accepted.unit

    @property
    def traced(self) -> Problem:
        """Problem that the branch solves, for continuation."""
        return self.along

    def solution_at(self, x: Array, lam: float) -> PeriodicSolution:
        """A solution of the traced problem in physical terms."""
        return self.along.describe(x, lam)

    def balance_at(self, x: Array, lam: float) -> tuple[AnyBalance, State]:
        """The balance of the rig at a value of the number, and the state of unknowns of the traced problem."""
        return self.along.state(x, lam)

    def value_at(self, lam: float) -> float:
        """Value of the number."""
        return self.along.value_at(lam)

    def number_at(self, lam: float) -> str:
        """The number and its value, unless it is the frequency or the force, which every solution tells."""
        if self.parameter in (HZ, FORCE):
            return ""
        return f"{self.parameter} = {self.value_at(lam):.6g}{self.suffix}"

    def __repr__(self) -> str:
        """Say what was found."""
        top, values = self.peak, self.values
        text = (
            f"{len(self.points)} points, {self.parameter} from {values[0]:.5g} to {values[-1]:.5g}{self.suffix}, "
            f"H = {self.basis.H}, {self.basis.N_t} samples, {self.problem.structure.n} modes; peak "
            f"{top.channels['drive'].peak * 1e3:.4g} mm at {values[self.points.index(top)]:.5g}; "
            f"{len(self.folds)} folds, {len(self.corners)} corners; numerical error {self.error:.2%}"
            + (f"; {self.past_start}" if self.past_start else "")
        )
        return text if self.complete else f"{text}; partial: {self.branch.message}"


@one_thread
def parameter_response(
    rig: AnyRig,
    key: str,
    values: tuple[float, float],
    *,
    hz: float | None = None,
    level: float | None = None,
    harmonics: int | None = None,
    on_point: OnPoint | None = None,
    budget: Budget | None = None,
) -> ParameterCurve:
    """Response along one number of a rig.

    Parameters
    ----------
    rig : Rig
    key : str
        Key of the number in the rig file, such as ``contact.friction.mu`` or ``beam.length``, of
        :func:`models.scalars.solution_numbers`; ``frequency_hz`` for the excitation frequency.
    values : (float, float)
        First and last value, either may be the larger. Where the curve folds back past the first it is followed there,
        up to 30 % beyond, as a frequency response is: :attr:`ParameterCurve.past_start` says so.
    hz : float, optional
        Excitation frequency [Hz]; omitted where it is the number.
    level : float, optional
        Force amplitude [N]; the rig's where omitted.
    harmonics : int, optional
        H; where omitted it is raised until drive displacement and friction force at the first, the last and the highest
        point change less than half a per cent.
    on_point : callable, optional
        Progress: called with the value and the number of every point found.
    budget : Budget, optional
        Most points and seconds of the trace; :class:`hbm.response.budget.Budget` where omitted.

    Returns
    -------
    ParameterCurve
        Partial, and marked so, where a step could not be made, the budget was spent, or the curve turns in place.

    Raises
    ------
    ValueError
        If the rig has no such number, a value or the frequency is not accepted, or the force has a harmonic above H.
    continuation.ConvergenceError
        If there is no first solution.

    Examples
    --------
    >>> from hbm.models.published import paper_rig
    >>> curve = parameter_response(paper_rig(), "contact.friction.mu", (0.5, 0.55), hz=50.0, harmonics=3)
    >>> curve.values[[0, -1]].tolist()
    [0.5, 0.55]
    """
    expect_rig(rig, "parameter_response", joints=True)
    expect_level(level, "parameter_response")
    expect_two(values, "values", "parameter_response")
    if hz is not None:
        expect_frequency(hz, "parameter_response")
    number = checked(rig, key, values, hz=hz, level=level)
    frequency = values[0] if hz is None else hz
    force = rig.excitation.amplitude if level is None else level

    def along(H: int, N_t: int | None = None) -> ParameterBalance:
        return ParameterBalance(
            rig, number, values, FourierBasis(H, N_t or default_samples(H)), hz=frequency, level=force
        )

    if harmonics is None:
        harmonics, reason = _choose_harmonics(rig, along, budget)
    else:
        harmonics = harmonics_for(rig, harmonics, "parameter_response")
        reason = f"H = {harmonics} as asked for"
    problem = along(harmonics)
    branch = _trace(problem, budget, on_point)
    points = tuple(problem.describe(p.x, p.lam) for p in branch.points)
    curve = with_peak(ParameterCurve(rig, points, branch, problem.first, along=problem, error=np.nan, reason=reason))
    return replace(curve, error=_error(curve))


def checked(
    rig: AnyRig, key: str, values: tuple[float, float], *, hz: float | None = None, level: float | None = None
) -> Key:
    """The number of a rig that a curve can be followed along, between accepted values; see :func:`parameter_response`.

    Raises
    ------
    ValueError
        If it cannot.
    """
    number = parameter_key(
        rig, key, values[0] if hz is None else hz, rig.excitation.amplitude if level is None else level
    )
    if hz is None and key != HZ:
        raise ValueError(f"{key}: no frequency; must be given unless the parameter is {HZ}")
    if hz is not None and key == HZ:
        raise ValueError(f"frequency = {hz:g} Hz and parameter {HZ}; must be one of them")
    if level is not None and key == FORCE:
        raise ValueError(f"level = {level:g} N and parameter {FORCE}; must be one of them")
    for value in values:
        check_value(rig, number, value)
    if values[0] == values[1]:
        raise ValueError(f"{key} from {values[0]:g} to {values[1]:g}; must differ")
    return number


def _trace(problem: ParameterBalance, budget: Budget | None, on_point: OnPoint | None = None) -> Branch:
    first, unit = problem.first, problem.key.accepted.unit
    along = Along(problem.value_at, "" if unit == "1" else unit)
    x = first_solution(first, first.lam_at(problem.hz_at(0.0)))
    return continue_within(budget, along, problem, x, 0.0, _settings(problem), on_point)


def _settings(problem: ParameterBalance) -> Settings:
    """Settings whose interval goes as far beyond both values as that of a frequency does, within the bounds."""
    low, high = sorted(problem.values)
    p = problem.key.accepted
    low, high = max(low - EXCURSION * abs(low), p.lower), min(high + EXCURSION * abs(high), p.upper)
    ends = sorted((problem.lam_at(low), problem.lam_at(high)))
    return replace(trace_settings(problem.first, 0.0, 1.0), lam_min=ends[0], lam_max=ends[1])


# ---- how accurate it is


def _telling(points: Sequence[PeriodicSolution]) -> list[int]:
    """The first point, the last, and the highest: by which to judge."""
    return sorted({0, int(np.argmax([p.channels["drive"].peak for p in points])), len(points) - 1})


def _again(problem: ParameterBalance, lam: float, start: PeriodicSolution) -> PeriodicSolution | None:
    """A point on another discretisation, None where it is not found."""
    here = problem.at(lam)
    try:
        at = here.lam_at(problem.hz_at(lam))
        return describe(here, solve_near(here, at, start), at)
    except ConvergenceError:
        return None


def _choose_harmonics(
    rig: AnyRig, along: Callable[[int, int | None], ParameterBalance], budget: Budget | None
) -> tuple[int, str]:
    """Fewest harmonics of the ladder that keep the telling points of a coarse curve within the tolerance."""
    tried = ladder(rig)
    pilot = along(tried[0], sampled(tried[0], SCOUTED).N_t)
    branch = _trace(pilot, budget)
    points = [pilot.describe(p.x, p.lam) for p in branch.points]
    scales = scales_of(pilot.rig, points)
    found = [(branch.points[i].lam, points[i]) for i in _telling(points)]
    for H in tried:
        coarse, fine = along(H, default_samples(finer(H))), along(finer(H), None)
        pairs = [(lam, _again(coarse, lam, start)) for lam, start in found]
        moved = [relative_change(p, _again(fine, lam, p), scales) for lam, p in pairs if p is not None]
        if moved and np.nanmax([*moved, -1.0]) < TOLERANCE:
            return H, f"H = {H}: {finer(H)} harmonics change the ends and the peak by {np.nanmax(moved):.2%}"
    return H, f"H = {H}, the most that is tried"


def _error(curve: ParameterCurve) -> float:
    """Largest relative change of the telling points with harmonics, samples and modes refined."""
    along, basis, n = curve.along, curve.basis, curve.rig.structure.n
    refined = FourierBasis(finer(basis.H), 2 * basis.N_t)
    fine = ParameterBalance(
        curve.rig.with_modes(2 * n), along.key, along.values, refined, hz=along.hz_at(0.0), level=along.level_at(0.0)
    )
    scales, points = scales_of(curve.rig, curve.points), curve.branch.points
    moved = [
        relative_change(curve.points[i], _again(fine, points[i].lam, curve.points[i]), scales)
        for i in _telling(curve.points)
    ]
    return max((m for m in moved if np.isfinite(m)), default=float("nan"))
