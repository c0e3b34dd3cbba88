"""Linear recurrences over the samples of a period: z_k = A_k z_(k-1) + ..., forwards and as adjoints."""

import numpy as np
from scipy.linalg import lapack

from hbm.fourier import Array

FEW_STATES = 2
"""Up to so many internal states the recurrence is solved as one banded system, else sample by sample."""


def monodromy(A: Array) -> Array:
    """Product of the state transitions (N, n, n) over a period."""
    if A.shape[1] == 1:
        return np.asarray(np.multiply.reduce(A[:, 0, 0])).reshape(1, 1)
    while len(A) > 1:  # pairwise, so that the products are batched
        last = A[-1:] if len(A) % 2 else A[:0]
        A = np.concatenate([A[1::2] @ A[: len(A) - 1 : 2], last])
    return np.asarray(A[0])


def radius(A: Array) -> float:
    """Spectral radius of the product of the state transitions; infinite where a law left the numbers."""
    over_period = monodromy(A)
    if not np.isfinite(over_period).all():
        return float("inf")
    return float(np.abs(over_period if len(over_period) == 1 else np.linalg.eigvals(over_period)).max(initial=0.0))


def through_states(adjoint: Array, local: Array, i: int) -> Array:
    """Chain the adjoint states with the derivatives of the states to input `i` of `local`, (2H+1, N_t)."""
    if adjoint.shape[2] == 1:
        return adjoint[:, :, 0] * local[:, 1, i]
    return np.asarray(np.einsum("mkz,kz->mk", adjoint, local[:, 1:, i]))


def backwards(A: Array, right: Array) -> Array:
    """Solve lambda_{N-1} = right_0 and lambda_{k-1} = right_{N-k} + A_k' lambda_k for falling k.

    Parameters
    ----------
    A : (N_t, n_z, n_z) array
        dz_k / dz_{k-1}.
    right : (m, N_t + 1, n_z) array
        Right sides of m outputs, in the order of solution; overwritten.

    Returns
    -------
    (m, N_t + 1, n_z) array
        lambda in the order of solution; the last stands before the first sample.
    """
    N_t, n_z = A.shape[:2]
    if n_z > FEW_STATES:
        lam = np.ascontiguousarray(right.transpose(1, 0, 2))
        for before, after, transition in zip(lam, lam[1:], A[::-1], strict=False):
            after += before @ transition
        return lam.transpose(1, 0, 2)
    band = np.zeros(((N_t + 1) * n_z, 2 * n_z)).T  # unit lower triangular, stored by columns
    for i in range(n_z):
        for j in range(n_z):
            band[n_z + i - j, j : N_t * n_z : n_z] = -A[::-1, j, i]
    solution, _ = lapack.dtbtrs(band, right.reshape(len(right), -1).T, uplo="L", diag="U", overwrite_b=1)
    return np.asarray(solution.T.reshape(right.shape))


def forwards(A: Array, start: Array, driven: Array) -> Array:
    """States (N_t + 1, n_z, p) of z_k = A_k z_{k-1} + driven_k from `start` (n_z, p)."""
    right = np.ascontiguousarray(np.concatenate([start[None], driven]).transpose(2, 0, 1))
    return backwards(A[::-1].transpose(0, 2, 1), right).transpose(1, 2, 0)


def in_time(lam: Array) -> Array:
    """Order the solution of :func:`backwards` as derivative to the state after each sample, (m, N_t, n_z)."""
    return lam[:, -2::-1]


def sources(c: Array, W: Array, extra: int) -> Array:
    """Right sides c_k W_k of the force samples, with `extra` empty outputs, (m + extra, N_t + 1, n_z)."""
    N_t, n_z = c.shape
    right = np.zeros((len(W) + extra, N_t + 1, n_z))
    np.multiply(W[:, ::-1, None], c[::-1], out=right[: len(W), 1:])
    return right


def periodic_adjoint(c: Array, A: Array, W: Array) -> Array:
    """Adjoint states (m, N_t, n_z) of a loop that closes: lambda after the last sample is lambda before the first."""
    m, n_z = len(W), A.shape[1]
    right = sources(c, W, n_z)
    right[m:, 0] = np.eye(n_z)
    lam = backwards(A, right)
    over_period = lam[m:, -1]  # the monodromy
    if n_z == 1:
        lam[:m, :, 0] += np.multiply.outer(lam[:m, -1, 0] / (1.0 - over_period[0, 0]), lam[m, :, 0])
    else:
        seed = np.linalg.solve(np.eye(n_z) - over_period.T, lam[:m, -1].T).T
        lam[:m] += np.tensordot(seed, lam[m:], axes=1)
    return in_time(lam[:m])
