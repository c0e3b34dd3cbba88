"""Poles beside flexibilities that are eliminated: what is linear in responses is fitted exactly, whatever poles are.

Flexibilities of modes and residuals are linear beside poles and turns, a phase and delays of the channels, so that only
these are left to be searched: few unknowns, however many channels there are, and none of the narrow valleys along which
a pole and its flexibilities move together. Slopes are those of Kaufman (BIT 15, 1975, 49-57).

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
    beyond : float
        Square of the middle frequency over that of a mode above the band, see :mod:`.beyond`; 0 where none is near.
    free : bool
        Whether flexibilities have phases of their own: every column is there a second time, a quarter of a turn ahead.

    Turns are (1 + c,) angles: the phase by which the force leads, and the delay of each channel, as what it turns the
    middle frequency back by [rad].
    """

    omega: Array
    motion: Complex
    measured: Complex
    by_force: Complex
    lossy: bool = False
    beyond: float = 0.0
    free: bool = False

    @property
    def rest(self) -> int:
        """Number of residual terms of a channel."""
        return REST + LOSSES * self.lossy

    def size(self, modes: int) -> int:
        """Number of flexibilities of a channel."""
        return (modes + self.rest) * (1 + self.free)

    @cached_property
    def middle(self) -> float:
        """Median of the frequencies [rad/s], by which residuals are of the size of flexibilities."""
        return float(np.median(self.omega))

    @cached_property
    def _residuals(self) -> Complex:
        """Columns of U, V, L and of losses, with frequencies in units of the middle one: all are flexibilities."""
        x = self.omega / self.middle
        terms = [np.ones_like(x), x**2 / (1.0 - self.beyond * x**2), -1.0 / x**2, -1j * x, -1j / x**3]
        return np.column_stack(terms[: self.rest]).astype(complex)

    @cached_property
    def _force(self) -> Array:
        """Squared size of what the force does at each frequency, (n, 1)."""
        return np.asarray(np.sum(np.abs(self.by_force) ** 2, axis=1, keepdims=True))

    @cached_property
    def _exact(self) -> bool:
        """Whether the force errs nowhere, so that every channel is fitted alone."""
        return not self.by_force.any()

    def of_modes(self, poles: Array) -> Complex:
        """Responses of modes with a flexibility of 1 each, (n, r)."""
        return np.asarray(1.0 / _stiffness(self.omega, poles))

    def columns(self, poles: Array) -> Complex:
        """Responses of modes with a flexibility of 1 each, and of the residuals, (n, q)."""
        columns = np.hstack([self.of_modes(poles), self._residuals])
        return np.hstack([columns, 1j * columns]) if self.free else columns

    def of_beyond(self, rest: Array) -> Complex:
        """Derivatives of motions to the share of the mode above the band, of residuals (c, q), (n, c)."""
        x = self.omega / self.middle
        return np.outer((x**2 / (1.0 - self.beyond * x**2)) ** 2, rest[:, 1]).astype(complex)

    def turned(self, turns: Array) -> Complex:
        """Motion (n, c) that is turned."""
        x = self.omega[:, None] / self.middle
        return np.asarray(self.motion * np.exp(1j * (turns[0] - x * turns[1:])))

    def answer(self, poles: Array, turns: Array, flexibility: Array) -> Complex:
        """Weighted responses (n, c) of flexibilities (c, q)."""
        return np.asarray(self.turned(turns) * (self.columns(poles) @ flexibility.T))

    def whitened(self, z: Complex) -> Complex:
        """Weighted (n, c, ...) beside an error of the force, which adds b b^H to their covariance 1."""
        if self._exact:
            return z
        more = (1,) * (z.ndim - 2)
        b, size = (part.reshape(*part.shape, *more) for part in (self.by_force, self._force))
        taken = np.divide(1.0 - 1.0 / np.sqrt(1.0 + size), size, out=np.zeros_like(size), where=size > 0.0)
        return np.asarray(z - b * (taken * np.sum(b.conj() * z, axis=1, keepdims=True)))

    def slopes(self, poles: Array, turns: Array, flexibility: Array) -> Complex:
        """Derivatives of the answer to logarithms of frequencies and of ratios, and to turns, (n, c, 2 r + 1 + c)."""
        modes, x, stiffness = len(poles), _ratios(self.omega, poles), _stiffness(self.omega, poles)
        damping = 2j * poles[:, 1] * x
        per_mode = np.hstack([(damping - 2.0 * x**2) / stiffness, -damping / stiffness]) / np.tile(stiffness, 2)
        of_modes = flexibility[:, :modes].astype(complex)
        if self.free:
            of_modes += 1j * flexibility[:, self.size(modes) // 2 :][:, :modes]
        motion, back = self.turned(turns), -self.omega[:, None] / self.middle
        moved = motion[:, :, None] * per_mode[:, None] * np.tile(of_modes, 2)
        turned = 1j * motion * (self.columns(poles) @ flexibility.T)
        own = (back * turned)[:, :, None] * np.eye(turned.shape[1])
        return np.asarray(np.concatenate([moved, turned[:, :, None], own], axis=2))

    def flexibilities(self, poles: Array, turns: Array) -> Array:
        """Those (c, q) that fit best beside poles and turns."""
        return self._best(self.columns(poles), self.turned(turns))[0]

    def misfits(self, poles: Array, channel: int, delays: Array, beside: Array) -> Array:
        """What flexibilities leave of a channel that is read alone, (m, k).

        Its delays, which are turns, are (m,) plus (k,): so many exponentials are enough.
        """
        columns = as_reals(self.motion[:, [channel]] * self.columns(poles))
        size = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
        basis = np.linalg.qr(columns / size)[0]
        turns, further = (np.exp(1j * np.outer(part, self.omega / self.middle)) for part in (delays, beside))
        measured, n = self.measured[:, channel], len(self.omega)
        across = turns[:, None, :] * ((basis[:n] - 1j * basis[n:]).T * measured)  # (m, q, n)
        described = np.sum((across @ further.T).real ** 2, axis=1)
        return np.asarray(np.sum(np.abs(measured) ** 2) - described)

    def fitted(self, start: Array, turns: Array, sought: npt.NDArray[np.bool_]) -> tuple[Array, Array]:
        """Poles that fit best from where they start, and those of the turns (1 + c,) that are sought."""
        modes = len(start)

        def unpacked(x: Array) -> tuple[Array, Array]:
            tried = turns.copy()
            tried[sought] = x[2 * modes :]
            return np.exp(x[: 2 * modes]).reshape(2, modes).T, tried

        known: list[tuple[Array, Rest]] = []  # of the last that was tried: its slopes are asked for, or none
        moving = np.append(np.ones(2 * modes, dtype=bool), sought)

        def left(x: Array) -> Array:
            poles, tried = unpacked(x)
            columns = self.columns(poles)
            if not np.isfinite(columns).all():
                return np.full(2 * self.measured.size, np.nan)  # SciPy tries a shorter step
            known[:] = [self._best(columns, self.turned(tried))]
            return as_reals(self.whitened(known[0][1](self.measured[:, :, None]))).ravel()

        def slopes(x: Array) -> Array:
            flexibility, rest = known[0]
            moved = -self.slopes(*unpacked(x), flexibility)[:, :, moving]
            moved = rest(np.where(np.isfinite(moved), moved, 0.0))  # a pole that has run off stays where it is
            return as_reals(self.whitened(moved)).reshape(-1, len(x))

        x = np.concatenate([np.log(np.clip(start, *POSITIVE)).T.ravel(), turns[sought]])
        with np.errstate(all="ignore"):  # in SciPy's own step, where a pole has run off
            fit = least_squares(left, x, jac=slopes, x_scale="jac", max_nfev=STEPS)
            return unpacked(fit.x)

    def _best(self, columns: Complex, turned: Complex) -> tuple[Array, Rest]:
        """Best flexibilities (c, q) of columns with a motion that is turned, and what these leave of others."""
        basis, uppers, sizes = _orthonormal(turned.T[:, :, None] * columns)
        coordinates = self._coordinates(basis)

        def rest(z: Complex) -> Complex:
            return np.asarray(z - (basis @ coordinates(z)).transpose(1, 0, 2))

        of_basis = coordinates(self.measured[:, :, None])[:, :, 0]
        best = [
            np.linalg.lstsq(upper, own, rcond=APART)[0] / size
            for upper, own, size in zip(uppers, of_basis, sizes, strict=True)
        ]
        return np.array(best), rest

    def _coordinates(self, basis: Complex) -> Callable[[Complex], Array]:
        """What takes from (n, c, p) the coordinates (c, q, p), in orthonormal bases (c, n, q), of what is nearest."""
        (c, n, q), across = basis.shape, basis.conj().transpose(0, 2, 1)

        def alone(z: Complex) -> Array:
            return np.asarray((across @ z.transpose(1, 0, 2)).real)

        if self._exact:
            return alone
        weight = 1.0 / (1.0 + self._force)
        felt = (self.by_force.conj().T[:, :, None] * basis).transpose(1, 0, 2).reshape(n, c * q)
        stacked = as_reals(np.sqrt(weight) * felt)
        coupled = cho_factor(np.eye(c * q) - stacked.T @ stacked)

        def together(z: Complex) -> Array:
            seen = z - self.by_force[:, :, None] * np.sum(
                weight[:, :, None] * self.by_force.conj()[:, :, None] * z, axis=1, keepdims=True
            )
            return np.asarray(cho_solve(coupled, alone(seen).reshape(c * q, -1)).reshape(c, q, -1))

        return together


def _orthonormal(columns: Complex) -> tuple[Complex, Array, Array]:
    """Bases (c, n, q) of columns whose size is taken off, orthonormal by their real and imaginary parts.

    Beside them the coordinates (c, q, q) of the columns, and their size (c, q).
    """
    stacked, n = np.concatenate([columns.real, columns.imag], axis=1), columns.shape[1]
    size = np.maximum(np.linalg.norm(stacked, axis=1), np.finfo(float).tiny)
    basis, upper = np.linalg.qr(stacked / size[:, None])
    return basis[:, :n] + 1j * basis[:, n:], upper, size


def _ratios(omega: Array, poles: Array) -> Array:
    return np.asarray(omega[:, None] / (2 * np.pi * poles[:, 0]))


def _stiffness(omega: Array, poles: Array) -> Complex:
    x = _ratios(omega, poles)
    out = np.empty(x.shape, dtype=complex)
    out.real, out.imag = 1.0 - x**2, 2.0 * poles[:, 1] * x
    return out


def as_reals(z: npt.NDArray[np.complex128]) -> Array:
    """Real parts above imaginary ones."""
    return np.concatenate([z.real, z.imag])
