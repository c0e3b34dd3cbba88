"""Modes of a structure from its frequency responses: frequencies, damping ratios, shapes, residuals, each with its std.

The response of channel j per force is (i omega)^d (sum_r A_jr / (omega_r^2 - omega^2 + 2 i zeta_r omega_r omega) + U_j
+ V_j omega^2 - L_j / omega^2): normal modes, what modes above the band answer at rest and next to it, and what modes
below it do as masses; d is 0, 1 or 2 for displacement, velocity and acceleration. All of it is fitted by weighted least
squares, which is the most likely answer for the noise stated; derivatives are CasADi's. Modes are added one at a time,
where what is left asks for one most, as long as the Bayesian information criterion falls: no pole is picked by hand.
"""

from collections.abc import Callable
from functools import cached_property

import casadi as ca
import numpy as np
from scipy.optimize import least_squares

from hbm.channels import DERIVATIVES
from hbm.errors import InputError
from hbm.fourier import Array
from hbm.identification.modes import Modes
from hbm.measurement.responses import Complex, FrequencyResponses

MOST_MODES = 30
GRID, RATIOS = 400, (5e-4, 2e-3, 8e-3, 0.03)
"""Frequencies and damping ratios at which a further mode is looked for."""

POSITIVE = (1e-300, 1e300)  # numbers with a logarithm
REST = 3
"""Residual terms of a channel."""

OUTSIDE, LEAST_RATIO, MOST_RATIO = 1.05, 1e-6, 0.5
"""A pole beyond the band by this factor is no mode of it, nor one with another damping ratio than these."""


def fit_modes(
    responses: FrequencyResponses, modes: int | None = None, *, phase: bool = False, drive: str | None = None
) -> Modes:
    """Fit modes to frequency responses.

    Parameters
    ----------
    responses : FrequencyResponses
    modes : int, optional
        How many in the band; as many as the data ask for where omitted.
    phase : bool
        Whether the channel that stands for the force, such as a shaker's voltage, may be off by one phase.
    drive : str, optional
        Channel at the point that is driven, along the force: no mode is added in which it moves against the force.

    Raises
    ------
    InputError
        If there are too few frequencies, for one mode or for as many as are asked for, or nothing moves.
    """
    n, c = len(responses.hz), len(responses.channels)
    if n < 8:
        raise InputError(f"modal: {n} frequencies at which the force excites; must be at least 8")
    most = (2 * n * c - REST * c) // (2 + c)  # as many unknowns as numbers were measured
    if modes is not None and modes > most:
        raise InputError(f"modal: modes = {modes}; must be <= {most} with {n} frequencies of {c} channels")
    problem = _Problem(responses, phase, drive)
    if not problem.measured.any():
        raise InputError("modal: no channel moves; must be driven by the force")
    best = problem.fitted(poles := np.empty((0, 2)))
    for _ in range(modes or MOST_MODES):
        tried = problem.fitted(np.vstack([poles, problem.further(poles, best)]), problem.phase(best))
        if modes is None and not problem.asks_for(tried, best, len(poles) + 1):
            break
        best, poles = tried, problem.poles(tried, len(poles) + 1)
    if not len(poles):
        raise InputError("modal: no mode stands out of the noise; must be measured around one")
    if problem.by_force.any():
        problem.expect(best, len(poles))
        best = problem.fitted(problem.poles(best, len(poles)), problem.phase(best))
    return problem.described(best, len(poles))


class _Problem:
    """Weighted residuals of channels beside a number of modes; x holds log f, log zeta, all that is linear, a phase.

    A force that is not exact errs all channels of a frequency alike: their residuals are whitened together. What is
    only looked for takes each channel `alone`.
    """

    def __init__(self, responses: FrequencyResponses, turns: bool, drive: str | None) -> None:
        self.responses, self.turns, self.driven = responses, turns, [name == drive for name in responses.channels]
        listed = np.isfinite(responses.H)
        self.weight, self.alone = (
            np.where(listed, 1.0 / np.where(listed, std, 1.0), 0.0) for std in (responses.own_std, responses.std)
        )
        self.measured = np.where(listed, responses.H, 0.0)
        self.by_force = self.weight * responses.felt(self.measured)
        self.omega = 2 * np.pi * responses.hz
        order = np.array([DERIVATIVES[quantity] for quantity in responses.channels.values()])
        self.by_motion = (1j * self.omega[:, None]) ** order
        self.middle = float(np.median(self.omega))
        self.points = 2 * int(listed.sum())

    def expect(self, x: Array, modes: int) -> None:
        """What an error of the force does, by a fit: what was measured is large where the force errs that way."""
        self.by_force = self.weight * self.responses.felt(self._answer(x, modes))

    # ---- linear in the residues

    @cached_property
    def _residuals(self) -> Complex:
        """Columns of U, V and L, (n, 3), with frequencies in units of the middle one: all are flexibilities."""
        squared = (self.omega / self.middle) ** 2
        return np.column_stack([np.ones_like(squared), squared, -1.0 / squared]).astype(complex)

    def _columns(self, poles: Array) -> Complex:
        """Responses of modes with a flexibility of 1 each, and of the residuals, (n, r + 3)."""
        w = 2 * np.pi * poles[:, 0]
        x = self.omega[:, None] / w
        return np.column_stack([1.0 / (1.0 - x**2 + 2j * poles[:, 1] * x), self._residuals])

    def _linear(self, poles: Array, phase: float) -> Array:
        """Flexibilities (c, r + 3) that fit best beside poles and a phase."""
        columns = self._columns(poles)
        out = []
        for j in range(self.measured.shape[1]):
            rows = (self.alone[:, j] * self.by_motion[:, j] * np.exp(1j * phase))[:, None] * columns
            rhs = self.alone[:, j] * self.measured[:, j]
            A, b = np.concatenate([rows.real, rows.imag]), np.concatenate([rhs.real, rhs.imag])
            size = np.linalg.norm(A, axis=0)
            out.append(np.linalg.lstsq(A / size, b, rcond=None)[0] / size)
        return np.array(out)

    def further(self, poles: Array, x: Array) -> Array:
        """Frequency and damping ratio of the mode that takes most from what is left, (1, 2)."""
        motion = self.alone * self.by_motion * np.exp(1j * self.phase(x))
        left = motion.conj() * self.alone * (self.measured - self._answer(x, len(poles)))
        hz = np.geomspace(self.responses.hz[0], self.responses.hz[-1], GRID)
        tried, taken = [], []
        for ratio in RATIOS:  # in turn: their columns are the largest arrays here
            poles_tried = np.column_stack([hz, np.full(GRID, ratio)])
            columns = self._columns(poles_tried)[:, :GRID]
            shares = (columns.conj().T @ left).real ** 2 / (np.abs(columns.T) ** 2 @ np.abs(motion) ** 2)
            tried.append(poles_tried)
            taken.append(shares.sum(axis=1))
        return np.concatenate(tried)[[np.argmax(np.concatenate(taken))]]

    # ---- all of it

    def _answer(self, x: Array, modes: int) -> Complex:
        motion = self.by_motion * np.exp(1j * self.phase(x))
        return np.asarray(motion * (self._columns(self.poles(x, modes)) @ self._flexibility(x, modes).T))

    def phase(self, x: Array) -> float:
        """By which the force leads [rad]."""
        return float(x[-1]) if self.turns else 0.0

    def _flexibility(self, x: Array, modes: int) -> Array:
        c = self.measured.shape[1]
        return np.asarray(x[2 * modes : 2 * modes + c * (modes + REST)].reshape(c, modes + REST))

    @staticmethod
    def poles(x: Array, modes: int) -> Array:
        """Frequencies and damping ratios, (r, 2)."""
        return np.exp(x[: 2 * modes]).reshape(2, modes).T

    def fitted(self, start: Array, phase: float = 0.0) -> Array:
        """Most likely x from poles and a phase to start from."""
        positive = np.clip(start, *POSITIVE)  # a pole that ran off is none, and is seen as one
        x = np.concatenate([np.log(positive).T.ravel(), self._linear(start, phase).ravel(), [phase] * self.turns])
        if not len(start):
            return x
        residual = self._residual(len(start))
        with np.errstate(all="ignore"):  # in SciPy's own step, where a pole has run off
            fit = least_squares(lambda x: residual(x)[0], x, jac=lambda x: residual(x)[1], x_scale="jac", max_nfev=200)
        return np.asarray(fit.x)

    def _residual(self, modes: int) -> Callable[[Array], tuple[Array, Array]]:
        """Weighted real and imaginary parts, of each frequency in turn, and their derivatives to x."""
        n, c = self.measured.shape
        value, slope = (f.map(n) for f in _misfit_at_a_frequency(modes, c, self.turns))
        motion, measured = self.by_motion.T, self.measured.T
        data = self.omega[None], motion.real, motion.imag, measured.real, measured.imag, self.weight.T, self.middle

        def residual(x: Array) -> tuple[Array, Array]:
            every = np.repeat(x[:, None], n, axis=1)
            left = self._whitened(value(every, *data).full().reshape(2 * c, n, 1))
            slopes = self._whitened(slope(every, *data).full().reshape(2 * c, n, len(x)))
            return left.transpose(1, 0, 2).ravel(), slopes.transpose(1, 0, 2).reshape(-1, len(x))

        return residual

    def _whitened(self, rows: Array) -> Array:
        """Real and imaginary parts (2c, n, p) beside an error of the force, which adds b b^H to their covariance 1."""
        b, c = self.by_force.T[:, :, None], len(rows) // 2
        size = np.sum(np.abs(b) ** 2, axis=0)
        taken = np.divide(1.0 - 1.0 / np.sqrt(1.0 + size), size, out=np.zeros_like(size), where=size > 0.0)
        z = rows[:c] + 1j * rows[c:]
        z = z - b * (taken * np.sum(b.conj() * z, axis=0))
        return np.concatenate([z.real, z.imag])

    def asks_for(self, more: Array, less: Array, modes: int) -> bool:
        """Whether a fit is better by BIC, for noise of unknown size, and its modes lie apart and in the band.

        Two within half their bandwidths, seen from one drive, are one that is not linear; that moves with its force.
        """
        poles, band = self.poles(more, modes), self.responses.hz
        hz, ratio = poles[np.argsort(poles[:, 0])].T
        together = np.diff(hz) < 0.5 * (hz[1:] * ratio[1:] + hz[:-1] * ratio[:-1])
        outside = hz[0] < band[0] / OUTSIDE or hz[-1] > band[-1] * OUTSIDE
        against = (self._flexibility(more, modes)[self.driven, :modes] <= 0.0).any()
        if against or outside or together.any() or ratio.min() < LEAST_RATIO or ratio.max() > MOST_RATIO:
            return False
        return self._bic(more, modes) < self._bic(less, modes - 1)

    def _bic(self, x: Array, modes: int) -> float:
        left = (self.weight * (self.measured - self._answer(x, modes))).T[:, :, None]
        chi2 = float(np.sum(self._whitened(np.concatenate([left.real, left.imag])) ** 2))
        return float(self.points * np.log(max(chi2 / self.points, POSITIVE[0])) + len(x) * np.log(self.points))

    def described(self, x: Array, modes: int) -> Modes:
        """Modes in the order of their frequencies, with standard deviations."""
        left, J = self._residual(modes)(x)
        chi2 = float(left @ left) / max(self.points - len(x), 1)
        size = np.linalg.norm(J, axis=0)
        scale = np.divide(1.0, size, out=0.0 * size, where=size > 0.0)  # flexibilities are of another size
        covariance = np.linalg.pinv((J * scale).T @ (J * scale)) * np.outer(scale, scale)
        covariance *= max(chi2, 1.0) if self.responses.sized else chi2
        poles, c = self.poles(x, modes), self.measured.shape[1]
        w, flexibility = 2 * np.pi * poles[:, 0], self._flexibility(x, modes)
        place = 2 * modes + np.arange(c * (modes + REST)).reshape(c, modes + REST)

        def std(rows: Array) -> Array:
            return np.asarray(np.sqrt(np.maximum(np.einsum("...i,ij,...j->...", rows, covariance, rows), 0.0)))

        of_A = np.zeros((c, modes, len(x)))  # A = flexibility omega_r^2
        for j, r in np.ndindex(c, modes):
            of_A[j, r, place[j, r]] = w[r] ** 2
            of_A[j, r, r] = 2 * w[r] ** 2 * flexibility[j, r]
        spread, order = np.sqrt(np.maximum(np.diag(covariance), 0.0)), np.argsort(poles[:, 0])
        return Modes(
            responses=self.responses,
            hz=poles[order, 0],
            hz_std=(poles[:, 0] * spread[:modes])[order],
            ratio=poles[order, 1],
            ratio_std=(poles[:, 1] * spread[modes : 2 * modes])[order],
            A=(flexibility[:, :modes] * w**2)[:, order],
            A_std=std(of_A)[:, order],
            above=flexibility[:, modes],
            above_std=spread[place[:, modes]],
            beside=flexibility[:, modes + 1] / self.middle**2,
            below=flexibility[:, modes + 2] * self.middle**2,
            below_std=spread[place[:, modes + 2]] * self.middle**2,
            phase=self.phase(x),
            phase_std=float(spread[-1]) if self.turns else 0.0,
            chi2_reduced=chi2,
        )


def _misfit_at_a_frequency(modes: int, c: int, turns: bool) -> tuple[ca.Function, ca.Function]:
    """Weighted misfit of c channels at one frequency, (2c,), and its Jacobian."""
    linear = c * (modes + REST)
    x = ca.SX.sym("x", 2 * modes + linear + turns)
    omega, middle = ca.SX.sym("omega"), ca.SX.sym("middle")
    motion, measured = (tuple(ca.SX.sym(f"{name}_{part}", c) for part in "ri") for name in ("motion", "measured"))
    weight = ca.SX.sym("weight", c)
    ratio = omega / (2 * np.pi * ca.exp(x[:modes]))
    zeta = ca.exp(x[modes : 2 * modes])
    stiffness, damping = 1 - ratio**2, 2 * zeta * ratio
    size = stiffness**2 + damping**2
    squared = (omega / middle) ** 2
    real = ca.vertcat(stiffness / size, 1, squared, -1 / squared)
    imaginary = ca.vertcat(-damping / size, ca.SX.zeros(REST))
    flexibility = ca.reshape(x[2 * modes : 2 * modes + linear], modes + REST, c).T  # by channel in x
    straight, across = flexibility @ real, flexibility @ imaginary
    cos, sin = (ca.cos(x[-1]), ca.sin(x[-1])) if turns else (1, 0)
    re, im = cos * straight - sin * across, sin * straight + cos * across
    left = ca.vertcat(
        weight * (motion[0] * re - motion[1] * im - measured[0]),
        weight * (motion[0] * im + motion[1] * re - measured[1]),
    )
    given = [x, omega, *motion, *measured, weight, middle]
    return ca.Function("misfit", given, [left]), ca.Function("slope", given, [ca.jacobian(left, x)])
