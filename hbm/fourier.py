"""The Fourier basis: the only home of the coefficient order [a_0, a_1..a_H, b_1..b_H]."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from numbers import Integral
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import sparse

Array = npt.NDArray[np.float64]

MANY = 200
"""Harmonics above which series and samples are turned into each other by fast transforms, without a matrix."""


class Turn(NamedTuple):
    """Complex factors of the harmonics of some series, as they act on the coefficients of these.

    Attributes
    ----------
    direct, crossed : (2H+1, n) arrays
        Factor of each coefficient, and that of the other one of the same harmonic.
    swapped : (2H+1,) array of int
        Index of that other one.
    """

    direct: Array
    crossed: Array
    swapped: npt.NDArray[np.intp]

    def of(self, coefficients: Array) -> Array:
        """Coefficients (2H+1, n) or (2H+1, n, r) turned."""
        other = coefficients[self.swapped]
        if coefficients.ndim == 2:
            return self.direct * coefficients + self.crossed * other
        return self.direct[:, :, None] * coefficients + self.crossed[:, :, None] * other

    def adjoint_of(self, coefficients: Array) -> Array:
        """Coefficients (2H+1, n) turned by the conjugate factors."""
        return self.direct * coefficients - self.crossed * coefficients[self.swapped]

    def back(self, first: int) -> "Turn":
        """The inverse for the series from `first` on."""
        direct, crossed = self.direct[:, first:], self.crossed[:, first:]
        squares = direct * direct + crossed * crossed
        return Turn(direct / squares, crossed / -squares, self.swapped)


@lru_cache(maxsize=16, typed=True)  # 3 and 3.0 are two: one would become the other
def _known(_H: int, _N_t: int) -> "FourierBasis":
    return object.__new__(FourierBasis)


@dataclass(frozen=True)
class FourierBasis:
    """Real Fourier series of one period, s = a_0 + sum a_k cos k theta + b_k sin k theta.

    Attributes
    ----------
    H : int
        Harmonics kept, >= 1.
    N_t : int
        Samples per period, > 2 H.

    Examples
    --------
    >>> basis = FourierBasis(2, 16)
    >>> bool(np.allclose(basis.analysis @ basis.synthesis, np.eye(5)))
    True
    """

    H: int
    N_t: int

    def __new__(cls, H: int, N_t: int) -> "FourierBasis":
        """One object for all that ask for the same basis: its matrices are worked out once."""
        return _known(H, N_t)

    def __post_init__(self) -> None:
        """Check that the samples resolve the harmonics."""
        whole = isinstance(self.H, Integral) and isinstance(self.N_t, Integral)
        if not whole or self.H < 1 or self.N_t <= 2 * self.H:
            accepted = "must have H >= 1 harmonics and N_t > 2 H samples, whole numbers"
            raise ValueError(f"FourierBasis: H = {self.H}, N_t = {self.N_t}; {accepted}")

    def __reduce__(self) -> tuple[type["FourierBasis"], tuple[int, int]]:
        """Pickled without its matrices: solutions go to other processes."""
        return FourierBasis, (self.H, self.N_t)

    @property
    def size(self) -> int:
        """Number of coefficients, 2 H + 1."""
        return 2 * self.H + 1

    @property
    def fundamental(self) -> int:
        """Index of the coefficient a_1."""
        return 1

    @cached_property
    def k(self) -> Array:
        """Harmonic number of each coefficient, (2H+1,)."""
        numbers = np.arange(1.0, self.H + 1)
        return np.concatenate([[0.0], numbers, numbers])

    @cached_property
    def theta(self) -> Array:
        """Phase of the samples, (N_t,) [rad]."""
        return 2 * np.pi * np.arange(self.N_t) / self.N_t

    @cached_property
    def synthesis(self) -> Array:
        """Coefficients to samples, (N_t, 2H+1)."""
        phase = np.outer(self.theta, self.k[: self.H + 1])
        return np.hstack([np.cos(phase), np.sin(phase[:, 1:])])

    @cached_property
    def analysis(self) -> Array:
        """Samples to coefficients (least squares), (2H+1, N_t)."""
        rows = self.synthesis.T * (2.0 / self.N_t)
        rows[0] /= 2.0
        return np.ascontiguousarray(rows)

    @property
    def many(self) -> bool:
        """Whether a transform is cheaper than the matrices: these have half a million entries and more."""
        return self.H > MANY

    def samples(self, coefficients: Array) -> Array:
        """Values (N_t, ...) at the samples of coefficients (2H+1, ...)."""
        if not self.many:
            flat = self.synthesis @ coefficients.reshape(self.size, -1)
            return np.asarray(flat.reshape(self.N_t, *coefficients.shape[1:]))
        from scipy import fft  # it takes long, and few harmonics need none

        lines = self.complex(coefficients) * (self.N_t / 2.0)
        lines[0] *= 2.0
        return np.asarray(fft.irfft(lines, self.N_t, axis=0))

    def coefficients(self, samples: Array) -> Array:
        """Coefficients (2H+1, ...) of samples (N_t, ...), those above H left out."""
        if not self.many:
            flat = self.analysis @ samples.reshape(self.N_t, -1)
            return np.asarray(flat.reshape(self.size, *samples.shape[1:]))
        from scipy import fft  # it takes long, and few harmonics need none

        lines = fft.rfft(samples, axis=0)[: self.H + 1] * (2.0 / self.N_t)
        lines[0] /= 2.0
        return self.real(lines)

    @cached_property
    def swapped(self) -> npt.NDArray[np.intp]:
        """Index of the other coefficient of the same harmonic."""
        H = self.H
        return np.concatenate([[0], np.arange(H + 1, 2 * H + 1), np.arange(1, H + 1)])

    @cached_property
    def signed_k(self) -> Array:
        """Factor of each coefficient of ds/dtheta, (2H+1,): k for cosines, -k for sines."""
        return np.where(np.arange(self.size) <= self.H, self.k, -self.k)

    def derivative(self, coefficients: Array) -> Array:
        """Coefficients of ds/dtheta, (2H+1, ...)."""
        swapped = coefficients[self.swapped]
        factor = self.signed_k if coefficients.ndim == 1 else self.signed_k[:, None]
        return np.asarray(factor * swapped)

    def derivative_on_right(self, matrix: Array) -> Array:
        """Product of a (k, 2H+1) matrix, or of each of (k, 2H+1, m), with the matrix of :meth:`derivative`."""
        factor = -self.signed_k if matrix.ndim == 2 else -self.signed_k[:, None]
        return np.asarray(factor * matrix[:, self.swapped])

    def complex(self, coefficients: Array) -> npt.NDArray[np.complex128]:
        """Amplitudes c_k with s = Re sum c_k exp(i k theta), (H+1, ...)."""
        c = np.zeros((self.H + 1, *coefficients.shape[1:]), dtype=complex)
        c.real = coefficients[: self.H + 1]
        c[1:].imag = -coefficients[self.H + 1 :]
        return c

    def real(self, amplitudes: npt.NDArray[np.complex128]) -> Array:
        """Coefficients of Re sum c_k exp(i k theta), inverse of :meth:`complex`, (2H+1, ...)."""
        return np.concatenate([amplitudes.real, -amplitudes.imag[1:]])

    def multiplication(self, coefficients: Array) -> Array:
        """Matrices that multiply a series by given ones, truncated to H.

        Parameters
        ----------
        coefficients : (2K+1,) or (2K+1, m) array
            One series or m of them, of any number K of harmonics; those above 2 H do not matter.

        Returns
        -------
        (2H+1, 2H+1) or (2H+1, 2H+1, m) array
            `out[..., j] @ b` are the coefficients of a_j b.
        """
        return np.asarray(_products(self.H, len(coefficients) // 2) @ coefficients).reshape(
            (self.size, self.size, *coefficients.shape[1:])
        )

    @cached_property
    def doubled(self) -> "FourierBasis":
        """Twice the harmonics on the same samples, which must be more than four a period of the highest."""
        return FourierBasis(2 * self.H, self.N_t)

    @cached_property
    def exact_products(self) -> "FourierBasis":
        """The coarsest basis whose samples carry products of two series without aliasing into 0..H."""
        return FourierBasis(self.H, 3 * self.H + 2)


def complex_of(coefficients: Array) -> npt.NDArray[np.complex128]:
    """Complex c_k of series along the last axis, s = Re sum c_k exp(i k theta), (..., 2H+1) to (..., H+1)."""
    H = coefficients.shape[-1] // 2
    out = coefficients[..., : H + 1].astype(complex)
    out[..., 1:] -= 1j * coefficients[..., H + 1 :]
    return out


def coefficients_of(c: npt.NDArray[np.complex128]) -> Array:
    """Inverse of :func:`complex_of`, (..., H+1) to (..., 2H+1)."""
    return np.concatenate([c.real, -c.imag[..., 1:]], axis=-1)


@lru_cache(maxsize=32)
def _products(H: int, K: int) -> sparse.csr_array:
    """Linear map from the K harmonics of a to the matrix of b -> a b, truncated to H."""
    n = 2 * H + 1
    j, m = np.meshgrid(np.arange(2 * K + 1), np.arange(n), indexing="ij")
    p, q = np.where(j > K, j - K, j), np.where(m > H, m - H, m)
    j_sine, m_sine = j > K, m > H
    same = j_sine == m_sine
    # cos cos and sin sin give cosines, the mixed products sines, of the sum and of the difference
    total, difference = p + q, np.where(same | j_sine, p - q, q - p)
    terms = [(total, np.where(j_sine & m_sine, -0.5, 0.5)), (difference, np.full(j.shape, 0.5))]
    rows, columns, values = [], [], []
    for harmonic, value in terms:
        kept = (np.abs(harmonic) <= H) & (same | (harmonic != 0))
        row = np.where(same, np.abs(harmonic), H + np.abs(harmonic))
        signed = np.where(same | (harmonic > 0), value, -value)
        rows.append((row * n + m)[kept])
        columns.append(j[kept])
        values.append(signed[kept])
    shape = (n * n, 2 * K + 1)
    return sparse.csr_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=shape)


def sampled(H: int, N_t: int) -> FourierBasis:
    """Basis of H harmonics on N_t samples, or on four a period of the highest where these are more.

    Of many harmonics the number of samples is a power of two.
    """
    return FourierBasis(H, max(N_t, 1 << int(np.ceil(np.log2(4 * H))) if H > MANY else 4 * H))


def default_samples(H: int) -> int:
    """Samples per period for H harmonics: 256, or the power of two from 12 H up."""
    return max(256, 1 << int(np.ceil(np.log2(12 * max(H, 1)))))
