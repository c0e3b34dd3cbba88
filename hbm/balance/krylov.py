"""Linear equations with many right sides at once, by GMRES: each in a Krylov space of its own, all in step.

The operator is applied to one vector of every right side together, which for fast Fourier transforms and recurrences
over a period costs little more than to one alone.

References
----------
Y. Saad, M. H. Schultz, SIAM J. Sci. Stat. Comput. 7 (1986) 856-869.
"""

from collections.abc import Callable

import numpy as np

from hbm.fourier import Array

Operator = Callable[[Array], Array]

TRUE = 1.01
"""The residual that the recurrence has told is the true one to within rounding: so much more of that is accepted."""


def solved(
    apply: Operator, nearly: Operator, right: Array, accuracy: float, most: int, again: int
) -> tuple[Array, bool]:
    """Solutions (c, N) of A x = b for right sides (c, N), as near as they were found, and whether all are.

    Parameters
    ----------
    apply : callable
        A x for vectors (c, N).
    nearly : callable
        About the inverse of A, the preconditioner from the right.
    right : (c, N) array
    accuracy : float
        Norm of the residual relative to that of the right side.
    most : int
        Directions that are kept.
    again : int
        Times it begins, at most.
    """
    x, left, target = np.zeros_like(right), right, accuracy * np.linalg.norm(right, axis=1)
    reached = False
    while not reached and again > 0:
        x += nearly(_within_space(lambda v: apply(nearly(v)), left, target, most))
        left, again = right - apply(x), again - 1
        reached = bool(np.all(np.linalg.norm(left, axis=1) <= TRUE * target))
    return x, reached


def _within_space(apply: Operator, left: Array, target: Array, most: int) -> Array:
    """Vectors (c, N) of the Krylov spaces of what is left with the least residuals: Arnoldi, Givens rotations."""
    c, n = left.shape
    V, R = np.zeros((c, most + 1, n)), np.zeros((most, most, c))
    turns = np.zeros((2, most, c))
    missed = np.zeros((most + 1, c))
    missed[0] = np.linalg.norm(left, axis=1)
    V[:, 0] = _over(left, missed[0])
    for k in range(most):
        w = apply(V[:, k])
        along = V[:, : k + 1] @ w[:, :, None]
        w = w - (along.transpose(0, 2, 1) @ V[:, : k + 1])[:, 0]
        column, beyond = along[:, :, 0].T.copy(), np.linalg.norm(w, axis=1)
        V[:, k + 1] = _over(w, beyond)
        for i in range(k):
            column[i], column[i + 1] = _turned(turns[:, i], column[i], column[i + 1])
        size = np.hypot(column[k], beyond)
        turns[:, k] = _over(np.array([column[k], beyond]).T, size).T
        column[k], _ = _turned(turns[:, k], column[k], beyond)
        R[: k + 1, k] = column
        missed[k], missed[k + 1] = _turned(turns[:, k], missed[k], missed[k + 1])
        if np.all(np.abs(missed[k + 1]) <= target):
            break
    y = np.zeros((k + 1, c))
    for i in reversed(range(k + 1)):
        y[i] = _over((missed[i] - np.sum(R[i, i + 1 : k + 1] * y[i + 1 :], axis=0))[:, None], R[i, i])[:, 0]
    return np.asarray((y.T[:, None] @ V[:, : k + 1])[:, 0])


def _turned(turn: Array, above: Array, below: Array) -> tuple[Array, Array]:
    return turn[0] * above + turn[1] * below, turn[0] * below - turn[1] * above


def _over(vectors: Array, sizes: Array) -> Array:
    """Vectors (c, ...) by sizes (c,); nothing by nothing is nothing."""
    there = sizes != 0.0
    return np.where(there, 1.0, 0.0)[:, None] * vectors / np.where(there, sizes, 1.0)[:, None]
