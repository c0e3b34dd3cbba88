"""Newton's method on a bordered system: F = 0 together with one linear condition on the step.

A step that lowers the residual a hundredfold or more is followed by steps with the same matrix (chord method), for as
long as each still does: at the end of a correction a new matrix costs more than it brings.

The state is y = (x, lam), one array of N + 1 numbers. Every step keeps row . dy = 0, so the iterates stay in the
hyperplane of the first guess. Damping starts only where full steps do not help (a kink, or far away):
one full step that raises the residual is forgiven; if the next one does not make up for it,
a line search starts from the best iterate (watchdog technique, Chamberlain et al. 1982).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np

from .problem import Array, Linearization, Problem
from .settings import NewtonSettings

_DAMPING = (0.5, 0.25, 0.125, 0.0625)
FORGIVEN_GROWTH = 10.0
FAST = 0.01
_SHARPER = 1e-4


class Reason(Enum):
    """Why a correction ended."""

    CONVERGED = "residual below the tolerance"
    NOT_FINITE = "residual is not finite at the first guess"
    SINGULAR = "bordered matrix is singular"
    NO_DECREASE = "no step along the Newton direction lowers the residual"
    TOO_MANY_ITERATIONS = "too many iterations"


@dataclass(frozen=True, slots=True)
class Correction:
    """Where Newton's method ended.

    Attributes
    ----------
    state : (N + 1,) array
        Last iterate (x, lam).
    linearization : Linearization
        The one at `state`.
    solved_at : (N + 1,) array
        The iterate whose linearization gave the last step.
    solved_with : Linearization
        The one there. It is evaluated already: where the steps since were short it serves the tangent for nothing.
    iterations : int
        Linearizations solved with.
    residual_norm : float
        Max-norm of the residual at `state`.
    reason : Reason
        Why it ended.
    """

    state: Array
    linearization: Linearization
    iterations: int
    residual_norm: float
    reason: Reason
    solved_at: Array
    solved_with: Linearization

    @property
    def x(self) -> Array:
        """Unknowns, (N,)."""
        return self.state[:-1]

    @property
    def lam(self) -> float:
        """Parameter."""
        return float(self.state[-1])

    def near(self, norm: Callable[[Array], float], distance: float) -> bool:
        """Whether the iterate that gave the last step is no further from the end than that."""
        return norm(self.state - self.solved_at) <= distance

    @property
    def converged(self) -> bool:
        """Whether the residual is below the tolerance."""
        return self.reason is Reason.CONVERGED


class Border(NamedTuple):
    """The row that closes the system; `fixed` keeps lam to the last bit."""

    row: Array
    row_lam: float
    fixed: bool = False


class _Evaluated(NamedTuple):
    state: Array
    linearization: Linearization


class _Iterate(NamedTuple):
    state: Array
    linearization: Linearization
    norm: float
    before: _Evaluated | None = None


def solve_at(problem: Problem, x: Array, lam: float, settings: NewtonSettings) -> Correction:
    """Solution at a fixed parameter.

    Parameters
    ----------
    problem : Problem
        The system.
    x : (N,) array
        First guess.
    lam : float
        Parameter, kept to the last bit.
    settings : NewtonSettings
        Tolerance and iteration limit.

    Returns
    -------
    Correction
        Converged or not; look at `converged` and `reason`.
    """
    state = np.append(np.asarray(x, dtype=np.float64), lam)
    return correct(problem, state, Border(np.zeros(state.size - 1), 1.0, fixed=True), settings)


@np.errstate(all="ignore")
def correct(problem: Problem, state: Array, border: Border, settings: NewtonSettings) -> Correction:
    """Solution in the hyperplane row . (y - state) = 0.

    Parameters
    ----------
    problem : Problem
        The system.
    state : (N + 1,) array
        First guess (x, lam).
    border : Border
        The row of the hyperplane.
    settings : NewtonSettings
        Tolerance and iteration limit.

    Returns
    -------
    Correction
        Converged or not; look at `converged` and `reason`.
    """
    here = best = _iterate(problem, state)
    source, matrices = _Evaluated(here.state, here.linearization), 1  # a chord step is free of charge
    best_step = state
    forgiving = True
    while True:
        if here.norm <= settings.tolerance:
            return _ended(here, matrices if here.before else 0, Reason.CONVERGED)
        if not math.isfinite(here.norm):
            return _ended(here, matrices - 1, Reason.NOT_FINITE)
        if matrices > settings.max_iterations:
            return _ended(best, settings.max_iterations, Reason.TOO_MANY_ITERATIONS)
        step = _newton_step(source.linearization, here.linearization.residual, border)
        if step is None:
            return _ended(here, matrices, Reason.SINGULAR)
        if here is best:
            best_step = step
        trial = _iterate(problem, here.state + step, source)
        if trial.norm < best.norm and trial.norm <= FAST * here.norm:
            here = best = trial
            continue
        if trial.norm < best.norm:
            here = best = trial
        elif source.linearization is not here.linearization:
            pass  # a chord step that fails does not settle whether Newton steps help
        elif forgiving and here is best and trial.norm < FORGIVEN_GROWTH * best.norm:
            here, forgiving = trial, False
        else:
            damped = _line_search(problem, best, best_step)
            if damped is None:
                return _ended(best, matrices, Reason.NO_DECREASE)
            here = best = damped
        source, matrices = _Evaluated(here.state, here.linearization), matrices + 1


def correct_sharply(problem: Problem, state: Array, border: Border, settings: NewtonSettings) -> Correction:
    """Solution in a hyperplane, to rounding if possible; look at `residual_norm` to see if it serves."""
    sharp = NewtonSettings(tolerance=_SHARPER * settings.tolerance, max_iterations=settings.max_iterations)
    return correct(problem, state, border, sharp)


def _iterate(problem: Problem, state: Array, before: _Evaluated | None = None) -> _Iterate:
    linearization = problem.linearize(state[:-1], float(state[-1]))
    return _Iterate(state, linearization, max_norm(linearization.residual), before)


def max_norm(residual: Array) -> float:
    """Largest absolute entry; nan if one is nan."""
    return float(np.abs(residual).max())


def _newton_step(linearization: Linearization, residual: Array, border: Border) -> Array | None:
    """Newton's step within the hyperplane, or None where there is none."""
    try:
        dx, dlam = linearization.solve_bordered(border.row, border.row_lam, -residual, 0.0)
    except np.linalg.LinAlgError:
        return None
    step = np.empty(dx.size + 1)
    step[:-1] = dx
    step[-1] = 0.0 if border.fixed else dlam
    return step if math.isfinite(float(step @ step)) else None


def _line_search(problem: Problem, best: _Iterate, step: Array) -> _Iterate | None:
    for factor in _DAMPING:
        state = best.state + factor * step
        if max_norm(problem.residual(state[:-1], float(state[-1]))) < best.norm:
            return _iterate(problem, state)
    return None


def _ended(last: _Iterate, iterations: int, reason: Reason) -> Correction:
    before = last.before or _Evaluated(last.state, last.linearization)
    return Correction(last.state, last.linearization, iterations, last.norm, reason, *before)
