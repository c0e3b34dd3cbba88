"""Harmonic coefficients of whole periods, by least squares or by an FFT, with those of blocks of the record."""

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hbm.fourier import Array
from hbm.measurement.waves import design

Leak = Callable[[Array], Array]
"""What a trend of all coefficients (c, 2H+1), by their change over the record, adds to each of them."""

KEPT = 2**20
"""Numbers of the columns of a whole record that are kept; of longer ones those of a block are worked out as needed."""


class Periods(NamedTuple):
    """Coefficients of whole periods.

    Attributes
    ----------
    coefficients : (c, 2H+1) array
        Of each channel over the record.
    by_block : (B, c, 2H+1) array
        Of each block.
    residual : (N, c) array
        What is left of the samples.
    leak : callable
        What a trend leaks into the coefficients.
    """

    coefficients: Array
    by_block: Array
    residual: Array
    leak: Leak


def fitted(t: Array, Y: Array, hz: float, H: int, edges: Array) -> Periods:
    """Coefficients of samples Y (N, c) at times t (N,) by least squares; blocks begin at the `edges`."""
    known = design(t, hz, H) if len(t) * (2 * H + 1) <= KEPT else None

    def chunks() -> Iterator[tuple[Array, Array, Array]]:
        """Times, samples and design of each block."""
        for at in _blocks(t, edges):
            yield t[at], Y[at], design(t[at], hz, H) if known is None else known[at]

    sums = [(A.T @ A, A.T @ y) for _, y, A in chunks()]
    whole, middle, length = sum(G for G, _ in sums), 0.5 * (t[0] + t[-1]), t[-1] - t[0]
    coefficients = np.asarray(np.linalg.solve(whole, sum(r for _, r in sums)).T, dtype=float)
    residual = np.concatenate([y - A @ coefficients.T for _, y, A in chunks()])

    def leak(trend: Array) -> Array:
        seen = np.zeros_like(trend.T)
        for x, _, A in chunks():
            seen += A.T @ (((x - middle) / length)[:, None] * (A @ trend.T))
        return np.asarray(np.linalg.solve(whole, seen).T)

    return Periods(coefficients, np.stack([np.linalg.solve(G, r).T for G, r in sums]), residual, leak)


def transformed(Y: Array, turns: float, H: int, samples: int, starts: npt.NDArray[np.int_]) -> Periods:
    """The same by an FFT of each period; `starts` are the first periods of all blocks but the first.

    `turns` is the time of the first sample in periods.
    """
    turn = np.exp(-2j * np.pi * turns * np.arange(H + 1))

    def of_periods(values: Array) -> Array:
        kept = np.fft.rfft(values, axis=-1)[..., : H + 1] / samples * turn
        return np.concatenate([kept[..., :1].real, 2.0 * kept[..., 1:].real, -2.0 * kept[..., 1:].imag], axis=-1)

    def periodic(coefficients: Array) -> Array:
        a, b = coefficients[:, : H + 1], np.pad(coefficients[:, H + 1 :], ((0, 0), (1, 0)))
        halved = (a - 1j * b) * np.where(np.arange(H + 1), 0.5, 1.0)
        return np.asarray(np.fft.irfft(halved / turn, samples, axis=1) * samples)

    periods = Y.reshape(-1, samples, Y.shape[1])
    each = of_periods(np.moveaxis(periods, 2, 1))
    coefficients = each.mean(axis=0)
    residual = periods - periodic(coefficients).T
    first = np.concatenate([[0], starts])
    count = np.diff(np.append(first, len(each)))
    within = (np.arange(samples) - 0.5 * (samples - 1)) / len(Y)  # from one period to the next it adds up to nothing

    def leak(trend: Array) -> Array:
        return np.asarray(of_periods(within * periodic(trend)))

    by_block = np.add.reduceat(each, first) / count[:, None, None]
    return Periods(coefficients, by_block, residual.reshape(Y.shape), leak)


def _blocks(t: Array, edges: Array) -> Iterator[slice]:
    return (slice(*ends) for ends in pairwise([0, *np.searchsorted(t, edges).tolist(), len(t)]))
