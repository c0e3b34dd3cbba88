"""Curves that branch off from a curve: at branch points, and where the period doubles."""

from dataclasses import replace

import numpy as np

from continuation import Branch, Kind, Point, Settings, leave_along, refine_branch_point, switch_branch
from hbm.balance.problem import AnyBalance, balance_of
from hbm.balance.solution import describe
from hbm.fourier import Array, FourierBasis
from hbm.parallel import one_thread
from hbm.response.bifurcation import Bifurcation
from hbm.response.curve import ResponseCurve


@one_thread
def crossing(curve: ResponseCurve, at: Bifurcation) -> tuple[ResponseCurve, ResponseCurve]:
    """The other curve through a branch point, both ways from it.

    Parameters
    ----------
    curve : ResponseCurve
        On which it was found.
    at : Bifurcation
        A branch point of the curve.

    Returns
    -------
    pair of ResponseCurve

    Raises
    ------
    ValueError
        If it is no branch point, or was not located.
    continuation.ConvergenceError
        If no point of the other curve is found.
    """
    _check(at, Kind.BRANCH_POINT)
    one, other = switch_branch(curve.problem, at.special, curve.branch.settings)
    return _described(curve.problem, one), _described(curve.problem, other)


@one_thread
def doubled(curve: ResponseCurve, at: Bifurcation) -> ResponseCurve:
    """The curve of motions of twice the period that branches off where the period doubles.

    The balance is that of half the frequency, with the force in its second harmonic: of 2 H harmonics those that are
    odd are new. There the doubling is a branch point. The curve leaves it both ways, but the two ways are one motion, a
    period of the force apart.

    Parameters
    ----------
    curve : ResponseCurve
        On which the doubling was found.
    at : Bifurcation
        A period doubling of the curve.

    Returns
    -------
    ResponseCurve
        Its bases have twice the harmonics and samples of the curve's.

    Raises
    ------
    ValueError
        If the period does not double there.
    continuation.ConvergenceError
        If no motion of twice the period is found.
    """
    _check(at, Kind.PERIOD_DOUBLING)
    single, basis = curve.problem, curve.basis
    problem = balance_of(
        curve.rig,
        FourierBasis(2 * basis.H, 2 * basis.N_t),
        parameter=single.parameter,
        hz=single.fixed_hz,
        level=single.level,
        periods=2 * single.periods,
    )
    settings = _settings(problem, curve.branch.settings)
    before, behind = (_embedded(problem, basis, p) for p in curve.branch.points[at.behind - 1 : at.behind + 1])
    origin = refine_branch_point(problem, before, behind, settings)
    return _described(problem, leave_along(problem, origin, origin.null_space[1], settings))


def _check(at: Bifurcation, kind: Kind) -> None:
    if at.kind is not kind or not at.special.located:
        found = "" if at.special.located else ", not located"
        raise ValueError(f"branching: {at}{found}; must be a {kind.value}")


def _embedded(problem: AnyBalance, basis: FourierBasis, point: Point) -> Point:
    """A point of the single period in the unknowns of the double one."""
    n, H = problem.structure.n, basis.H
    forces = problem.size // problem.basis.size - n
    harmonic = np.arange(H + 1)
    rows = np.concatenate([2 * harmonic, problem.basis.H + 2 * harmonic[1:]])

    def embed(x: Array) -> Array:
        split = basis.size * n
        Q, T = np.zeros((problem.basis.size, n)), np.zeros((problem.basis.size, forces))
        Q[rows], T[rows] = x[:split].reshape(-1, n), x[split:].reshape(-1, forces)
        return np.concatenate([Q.ravel(), T.ravel()])

    return replace(point, x=embed(point.x), tangent_x=embed(point.tangent_x))


def _settings(problem: AnyBalance, settings: Settings) -> Settings:
    """Settings of a curve for more unknowns; the metric weighs modes and friction as there."""
    if settings.weights is None:
        return settings
    modes, friction = settings.weights[0], settings.weights[-1]
    motion = problem.basis.size * problem.structure.n
    return replace(settings, weights=np.repeat([modes, friction], [motion, problem.size - motion]))


def _described(problem: AnyBalance, branch: Branch) -> ResponseCurve:
    points = tuple(describe(problem, p.x, p.lam) for p in branch.points)
    return ResponseCurve(problem.rig, points, branch, problem)
