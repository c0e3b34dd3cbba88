"""Standard deviations of harmonic coefficients: from the scatter of blocks of the record, or from what a fit leaves."""

import numpy as np
import numpy.typing as npt

from hbm.fourier import Array


def trends(by_block: Array) -> Array:
    """Change over the record of each coefficient of blocks (B, c, 2H+1), by a straight line through them."""
    x = (np.arange(len(by_block)) - 0.5 * (len(by_block) - 1)) / len(by_block)
    return np.asarray(np.tensordot(x, by_block, axes=1) / (x @ x))


def of_blocks(by_block: Array, blocks: float) -> tuple[Array, Array]:
    """Standard deviation of the mean from the scatter of blocks, (c, H+1), and the correlation it was raised for.

    Parameters
    ----------
    by_block : (B, c, 2H+1) array
    blocks : float
        Length of the record in blocks, B or up to one more.
    """
    B, H = len(by_block), by_block.shape[2] // 2
    deviation = by_block - by_block.mean(axis=0)
    square = _pooled(np.sum(deviation**2, axis=0), H)
    product = _pooled(np.sum(deviation[1:] * deviation[:-1], axis=0), H)
    pairs = np.where(np.arange(H + 1), 2, 1)
    rho = _significant_correlation(square, product, B, pairs)
    variance = square / (pairs * (B - 1) - 2) / blocks * (1.0 + rho) / (1.0 - rho)
    return np.sqrt(variance), rho


def _pooled(of_coefficients: Array, H: int) -> Array:
    """Sum over cos and sin, (c, 2H+1) to (c, H+1)."""
    out = of_coefficients[:, : H + 1].copy()
    out[:, 1:] += of_coefficients[:, H + 1 :]
    return out


def _significant_correlation(square: Array, product: Array, B: int, pairs: npt.NDArray[np.int_]) -> Array:
    """Correlation of neighbouring blocks, (c, H+1), 0 where it may be chance.

    Own correlation of a harmonic above three standard deviations of chance, or that of all harmonics of the channel
    together, which shows less, above two. A mean taken off biases a correlation by -1/B.
    """
    tiny = np.finfo(float).tiny
    own = product / np.maximum(square, tiny) + 1.0 / B
    shared = np.mean(own[:, 1:], axis=1, keepdims=True) if own.shape[1] > 1 else np.zeros((len(own), 1))
    values = B * int(pairs[1:].sum())
    shared = np.where(shared > 2.0 / np.sqrt(max(values, 1)), shared, 0.0)
    own = np.where(own > 3.0 / np.sqrt(B * pairs), own, 0.0)
    return np.minimum(np.maximum(own, shared), 0.98)


def of_residual(residual: Array, periods: int, H: int) -> Array:
    """Standard deviation from the power that the fit leaves around each harmonic, (c, H+1)."""
    N = len(residual)
    if periods == 1:  # nothing lies between the harmonics: noise is taken for white
        freedom = max(N - 2 * H - 1, 3)
        white = np.sum(residual**2, axis=0) / (freedom - 2)
        return np.asarray(np.sqrt(white[:, None] * np.where(np.arange(H + 1), 2.0, 1.0) / N))
    power = np.abs(np.fft.rfft(residual, axis=0)) ** 2
    out = np.empty((residual.shape[1], H + 1))
    for k in range(H + 1):
        near = np.arange(max(k - 1, 0) * periods + 1, (k + 1) * periods)
        near = near[(near % periods != 0) & (near < len(power))]
        freedom = 2 * len(near)
        variance = power[near].mean(axis=0) / N**2 * (2.0 if k else 1.0)
        out[:, k] = np.sqrt(variance * (freedom / (freedom - 2) if freedom > 2 else 3.0))
    return out
