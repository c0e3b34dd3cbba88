"""Folds of F(x, lam, mu) = 0 as the solutions of a larger system, a `Problem` in X = (x, lam) with parameter mu.

A fold is a solution at which J_x is singular. One scalar g says so, from a bordered solve,

    [[J_x, b], [c, 0]] [v, g] = [0, 1],

so that J_x v = -g b, c . v = 1 (minimally augmented system; Govaerts, Numerical Methods for Bifurcations of
Dynamical Equilibria, SIAM 2000). The matrix is regular at simple folds, at cusps, and where closed curves are born, if
b is not in the range of J_x and c not orthogonal to v. With psi the left null vector, (psi J_lam, psi J_mu) is the
normal of the fold curve in the plane of the parameters, and b = J_lam (psi J_lam) + J_mu (psi J_mu) serves everywhere.
The Newton step needs the change of g along four directions: exact, -psi (d J_x / dw) v, from second derivatives, or by
short secants of g, while the block of F stays exact. (Broyden's secants, of the values of g that Newton's method meets
anyway, cost less but leave the tangent half a step behind: four times as many points over a cusp, which they miss.)
"""

from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np

from .problem import Array
from .twoparameter import TwoParameterProblem

SecondDerivative: TypeAlias = Callable[[Array, float, float, Array, Array], Array]
"""`second(x, lam, mu, v, W) -> (N, r)`: change of J_x v along the columns of W, (N + 2, r), of (x, lam, mu)."""

_SECANT = 1e-5


class Border(NamedTuple):
    """Column b and row c."""

    column: Array
    row: Array


class FoldSystem:
    """The system {F = 0, g = 0}.

    Parameters
    ----------
    problem : TwoParameterProblem
        The system with folds.
    fold : (N + 2,) array
        A fold, (x, lam, mu), or a point close to one.
    second : SecondDerivative, optional
        Second derivatives of F; secants of g where omitted.
    """

    def __init__(self, problem: TwoParameterProblem, fold: Array, second: SecondDerivative | None = None) -> None:
        self.problem, self.second = problem, second
        column, row = np.random.default_rng(0).standard_normal((2, fold.size - 2))
        self.border = Border(_scaled(column), _scaled(row))
        self.recentre(fold[:-1], float(fold[-1]))

    def residual(self, X: Array, mu: float) -> Array:
        """Residual (F, g), (N + 1,)."""
        return self.linearize(X, mu).residual

    def linearize(self, X: Array, mu: float) -> "FoldLinearization":
        """Residual and Jacobian at (x, lam), mu."""
        return FoldLinearization(self, self.border, np.append(X, mu))

    def recentre(self, X: Array, mu: float) -> "FoldLinearization":
        """Take the borders from a fold, so that they serve around it; the linearization there."""
        here = self.linearize(X, mu)
        column = _scaled(here.normal[0] * here.inner.J_lam + here.normal[1] * here.inner.J_mu)
        self.border = Border(column, here.v / (here.v @ here.v))
        return self.linearize(X, mu)


class FoldLinearization:
    """Residual and Jacobian of a `FoldSystem`, by block elimination of J_x.

    Attributes
    ----------
    residual : (N + 1,) array
        F and g.
    v : (N,) array
        Null vector of J_x at a fold.
    g : float
        Zero at a fold.
    normal : (2,) array
        psi J_lam and psi J_mu.
    directions : (N + 2, 3) array
        Along v, and the solutions of F = 0 along lam and along mu, as far as J_x has an inverse.
    """

    def __init__(self, system: FoldSystem, border: Border, y: Array) -> None:
        self.system, self.border, self.y = system, border, y
        self.inner = inner = system.problem.linearize(y[:-2], float(y[-2]), float(y[-1]))
        rhs = np.column_stack([np.zeros(y.size - 2), -inner.J_lam, -inner.J_mu])
        x, last = self._solve(rhs, np.array([1.0, 0.0, 0.0]))
        self.v, self.g, self.normal = x[:, 0], float(last[0]), -last[1:]
        self.directions = np.vstack([x, np.eye(3)[1:]])
        self.residual = np.append(inner.residual, self.g)

    @property
    def turn(self) -> float:
        """Change of g along v, -psi F_xx v v: its sign says to which side a fold opens; zero at a cusp."""
        return float(self._slopes[0])

    def slopes(self, directions: Array) -> Array:
        """Change of g along the columns of (N + 2, r), (r,)."""
        if self.system.second is None:
            return np.array([self._secant(direction) for direction in directions.T])
        x, lam, mu = self.y[:-2], float(self.y[-2]), float(self.y[-1])
        bent = -self.system.second(x, lam, mu, self.v, directions)
        return self._solve(bent, np.zeros(directions.shape[1]))[1]

    def _secant(self, direction: Array) -> float:
        """Change of g along a direction, by a secant over a short length on either side."""
        length = float(np.linalg.norm(direction))
        if length == 0.0:
            return 0.0
        reach = _SECANT * (1.0 + float(np.linalg.norm(self.y))) / length
        behind, ahead = (FoldLinearization(self.system, self.border, self.y + r * direction).g for r in (-reach, reach))
        return (ahead - behind) / (2.0 * reach)

    def solve_bordered(self, row: Array, row_mu: float, rhs: Array, rhs_row: float) -> tuple[Array, float]:
        """Solve the bordered system of N + 2 unknowns, see `Linearization`."""
        x, last = self._solve(rhs[:-1, None], np.zeros(1))
        particular = np.append(x, [0.0, 0.0])
        border = np.append(row, row_mu)
        small = np.array([rhs[-1] - self.slopes(particular[:, None])[0], rhs_row - border @ particular, -last[0]])
        y = particular + self.directions @ np.linalg.solve(self._small(border), small)
        return y[:-1], float(y[-1])

    def determinant_sign(self, row: Array, row_mu: float) -> int:
        """Sign of the determinant of the bordered matrix."""
        small = np.linalg.det(self._small(np.append(row, row_mu)))
        return int(self.inner.determinant_sign(*self.border, 0.0) * np.sign(small))

    def _small(self, border: Array) -> Array:
        """Schur complement of the inner bordered matrix, for the factors of `directions`, (3, 3)."""
        inner = np.array([self.g, -self.normal[0], -self.normal[1]])
        return np.array([self._slopes, border @ self.directions, inner])

    @cached_property
    def _slopes(self) -> Array:
        return self.slopes(self.directions)

    def _solve(self, rhs: Array, rhs_row: Array) -> tuple[Array, Array]:
        try:
            return self.inner.solve(*self.border, 0.0, rhs, rhs_row)
        except np.linalg.LinAlgError:
            return np.full_like(rhs, np.nan), np.full_like(rhs_row, np.nan)


def _scaled(a: Array) -> Array:
    return np.asarray(a / np.abs(a).max())
