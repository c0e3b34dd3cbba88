"""Poles beside flexibilities that are eliminated: what is linear in responses is fitted exactly, whatever poles are.

Flexibilities of modes and residuals are linear beside poles and a phase, so that only these are left to be searched:
few unknowns, however many channels there are, and none of the narrow valleys along which a pole and its flexibilities
move together. Slopes are those of Kaufman (BIT 15, 1975, 49-57).

An error of the force errs all channels of a frequency alike, so that their flexibilities are fitted together. They are
taken in an orthonormal basis of what each channel can do: what couples them is a matrix as well conditioned as the
force is known, however alike the columns of a narrow band are.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import least_squares

from hbm.fourier import Array
from hbm.measurement.responses import Complex

REST, LOSSES = 3, 2
"""Residual terms of a channel: of stiffness and mass, and of damping."""

POSITIVE = (1e-100, 1e100)
"""Frequencies and ratios whose squares and products are numbers; a pole that runs off ends here."""

STEPS = 200
"""Steps of a search at most."""

APART = 1e-12
"""Columns with a smaller part of their own are told from others by rounding alone."""

Rest = Callable[[Complex], Complex]
"""Takes from (n, c, p) all that flexibilities can do."""


@dataclass(frozen=True, eq=False)
class Projection:
    """Responses of c channels at n frequencies, weighted, beside poles (r, 2) of frequencies [Hz] and damping ratios.

    Attributes
    ----------
    omega : (n,) array
        [rad/s].
    motion, measured : (n, c) complex array
        Powers of i omega by quantity, and responses, over the standard deviation of each; 0 where not measured.
    by_force : (n, c) complex array
        What one standard deviation of the force does to the measured, over the standard deviation of each.
    lossy : bool
        Whether modes beyond the band are damped.
    """

    omega: Array
    motion: Complex
    measured: Complex
    by_force: Complex
    lossy: bool = False

    @property
    def rest(self) -> int:
        """Number of residual terms of a channel."""
        return REST + LOSSES * self.lossy

    @cached_property
    def middle(self) -> float:
        """Median of the frequencies [rad/s], by which residuals are of the size of flexibilities."""
        return float(np.median(self.omega))

    @cached_property
    def _residuals(self) -> Complex:
        """Columns of U, V, L and of losses, with frequencies in units of the middle one: all are flexibilities."""
        x = self.omega / self.middle
        terms = [np.ones_like(x), x**2, -1.0 / x**2, -1j * x, -1j / x**3]
        return np.column_stack(terms[: self.rest]).astype(complex)

    @cached_property
    def _force(self) -> Array:
        """Squared size of what the force does at each frequency, (n, 1)."""
        return np.asarray(np.sum(np.abs(self.by_force) ** 2, axis=1, keepdims=True))

    def columns(self, poles: Array) -> Complex:
        """Responses of modes with a flexibility of 1 each, and of the residuals, (n, r + rest)."""
        return np.column_stack([1.0 / _stiffness(self.omega, poles), self._residuals])

    def answer(self, poles: Array, phase: float, flexibility: Array) -> Complex:
        """Weighted responses (n, c) of flexibilities (c, r + rest)."""
        return np.asarray(self.motion * np.exp(1j * phase) * (self.columns(poles) @ flexibility.T))

    def whitened(self, z: Complex) -> Complex:
        """Weighted (n, c, ...) beside an error of the force, which adds b b^H to their covariance 1."""
        more = (1,) * (z.ndim - 2)
        b, size = (part.reshape(*part.shape, *more) for part in (self.by_force, self._force))
        taken = np.divide(1.0 - 1.0 / np.sqrt(1.0 + size), size, out=np.zeros_like(size), where=size > 0.0)
        return np.asarray(z - b * (taken * np.sum(b.conj() * z, axis=1, keepdims=True)))

    def slopes(self, poles: Array, phase: float, flexibility: Array) -> Complex:
        """Derivatives of the answer to logarithms of frequencies and of ratios, and to the phase, (n, c, 2 r + 1)."""
        modes, x, stiffness = len(poles), _ratios(self.omega, poles), _stiffness(self.omega, poles)
        damping = 2j * poles[:, 1] * x
        per_mode = np.hstack([(damping - 2.0 * x**2) / stiffness, -damping / stiffness]) / np.tile(stiffness, 2)
        moved = per_mode[:, None] * np.tile(flexibility[:, :modes], 2)
        turned = 1j * (self.columns(poles) @ flexibility.T)[:, :, None]
        return np.asarray((self.motion * np.exp(1j * phase))[:, :, None] * np.concatenate([moved, turned], axis=2))

    def flexibilities(self, poles: Array, phase: float) -> Array:
        """Those (c, r + rest) that fit best beside poles and a phase."""
        return self._best(poles, phase)[0]

    def fitted(self, start: Array, phase: float, turns: bool) -> tuple[Array, float]:
        """Poles that fit best from where they start, and the phase too where it `turns`."""
        modes = len(start)

        def unpacked(x: Array) -> tuple[Array, float]:
            return np.exp(x[: 2 * modes]).reshape(2, modes).T, float(x[-1]) if turns else phase

        known: list[tuple[Array, Rest]] = []  # of the last that was tried: its slopes are asked for, or none

        def left(x: Array) -> Array:
            poles, turn = unpacked(x)
            if not np.isfinite(self.columns(poles)).all():
                return np.full(2 * self.measured.size, np.nan)  # SciPy tries a shorter step
            known[:] = [self._best(poles, turn)]
            return _parts(self.whitened(known[0][1](self.measured[:, :, None]))).ravel()

        def slopes(x: Array) -> Array:
            flexibility, rest = known[0]
            moved = rest(-self.slopes(*unpacked(x), flexibility)[:, :, : len(x)])
            return _parts(self.whitened(moved)).reshape(-1, len(x))

        x = np.concatenate([np.log(np.clip(start, *POSITIVE)).T.ravel(), [phase] * turns])
        with np.errstate(all="ignore"):  # in SciPy's own step, where a pole has run off
            fit = least_squares(left, x, jac=slopes, x_scale="jac", max_nfev=STEPS)
            return unpacked(fit.x)

    def _best(self, poles: Array, phase: float) -> tuple[Array, Rest]:
        """Best flexibilities (c, r + rest), and what these leave of others."""
        columns, c = self.columns(poles), self.measured.shape[1]
        turned = self.motion * np.exp(1j * phase)
        bases, uppers, sizes = zip(*(_orthonormal(turned[:, j, None] * columns) for j in range(c)), strict=True)
        basis = np.stack(bases)  # (c, n, q), orthonormal by their real and imaginary parts
        q = basis.shape[2]
        weight = 1.0 / (1.0 + self._force)
        felt = (self.by_force.conj().T[:, :, None] * basis).transpose(1, 0, 2).reshape(len(columns), c * q)
        stacked = _parts(np.sqrt(weight) * felt)
        coupled = cho_factor(np.eye(c * q) - stacked.T @ stacked)

        def solved(z: Complex) -> Array:
            seen = z - self.by_force[:, :, None] * np.sum(
                weight[:, :, None] * self.by_force.conj()[:, :, None] * z, axis=1, keepdims=True
            )
            across = (basis.conj().transpose(0, 2, 1) @ seen.transpose(1, 0, 2)).real
            return np.asarray(cho_solve(coupled, across.reshape(c * q, -1)).reshape(c, q, -1))

        def rest(z: Complex) -> Complex:
            return np.asarray(z - (basis @ solved(z)).transpose(1, 0, 2))

        of_basis = solved(self.measured[:, :, None])[:, :, 0]
        best = [
            np.linalg.lstsq(upper, own, rcond=APART)[0] / size
            for upper, own, size in zip(uppers, of_basis, sizes, strict=True)
        ]
        return np.array(best), rest


def _orthonormal(columns: Complex) -> tuple[Complex, Array, Array]:
    """Basis (n, q) of columns whose size is taken off, their coordinates (q, q) in it, and that size (q,)."""
    stacked = _parts(columns)
    size = np.maximum(np.linalg.norm(stacked, axis=0), np.finfo(float).tiny)
    basis, upper = np.linalg.qr(stacked / size)
    return basis[: len(columns)] + 1j * basis[len(columns) :], upper, size


def _ratios(omega: Array, poles: Array) -> Array:
    return np.asarray(omega[:, None] / (2 * np.pi * poles[:, 0]))


def _stiffness(omega: Array, poles: Array) -> Complex:
    x = _ratios(omega, poles)
    return np.asarray(1.0 - x**2 + 2j * poles[:, 1] * x)


def _parts(z: npt.NDArray[np.complex128]) -> Array:
    """Real parts above imaginary ones."""
    return np.concatenate([z.real, z.imag])
