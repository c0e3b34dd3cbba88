"""Modes of a structure from its frequency responses: frequencies, damping ratios, shapes, residuals, each with its std.

The response of channel j per force is (i omega)^d (sum_r A_jr / (omega_r^2 - omega^2 + 2 i zeta_r omega_r omega) + U_j
+ V_j omega^2 - L_j / omega^2): normal modes, what modes above the band answer at rest and next to it, and what modes
below it do as masses; d is 0, 1 or 2 for displacement, velocity and acceleration. Where the data ask for them there are
losses of modes above and below, - i (W_j omega + S_j / omega^3): beside peaks that are known to 1e-5 they are seen, and
modes would be off without them by several of their deviations.

All of it is fitted by weighted least squares, which is the most likely answer for the noise stated, over poles alone:
see :mod:`.projection`. Modes are added one at a time, where what is left asks for one most, as long as the Bayesian
information criterion falls: no pole is picked by hand.
"""

from copy import copy
from dataclasses import replace

import numpy as np

from hbm.channels import DERIVATIVES
from hbm.errors import InputError
from hbm.fourier import Array
from hbm.identification.modes import Modes
from hbm.identification.projection import POSITIVE, REST, Projection
from hbm.measurement.responses import Complex, FrequencyResponses

MOST_MODES = 30
GRID, RATIOS = 400, (5e-4, 2e-3, 8e-3, 0.03)
"""Frequencies and damping ratios at which a further mode is looked for."""

OUTSIDE, LEAST_RATIO, MOST_RATIO = 1.05, 1e-6, 0.5
"""A pole beyond the band by this factor is no mode of it, nor one with another damping ratio than these."""

LIGHT = 0.05
"""Losses of modes beyond the band are this part at most of all that they answer; what is more is of another kind."""


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
        If the drive is no channel, there are too few frequencies, for one mode or for as many as are asked for, or
        nothing moves.
    """
    responses.expect_drive(drive)
    n, c = len(responses.hz), len(responses.channels)
    if n < 8:
        raise InputError(f"modal: {n} frequencies at which the force excites; must be at least 8")
    most = (2 * n * c - REST * c) // (2 + c)  # as many unknowns as numbers were measured
    if modes is not None and modes > most:
        raise InputError(f"modal: modes = {modes}; must be <= {most} with {n} frequencies of {c} channels")
    problem = _Problem(responses, phase, drive)
    if not problem.together.measured.any():
        raise InputError("modal: no channel moves; must be driven by the force")
    best = problem.fitted(poles := np.empty((0, 2)))
    for _ in range(modes or MOST_MODES):
        tried = problem.fitted(np.vstack([poles, problem.further(poles, best)]), problem.phase(best))
        if modes is None and not problem.asks_for(tried, best, len(poles) + 1):
            break
        best, poles = tried, problem.poles(tried, len(poles) + 1)
    if not len(poles):
        raise InputError("modal: no mode stands out of the noise; must be measured around one")
    if problem.together.by_force.any():
        problem.expect(best, len(poles))
        best = problem.fitted(problem.poles(best, len(poles)), problem.phase(best))
    lossy = problem.lossy()
    tried = lossy.fitted(problem.poles(best, len(poles)), problem.phase(best))
    if lossy.losses(tried, len(poles)) < LIGHT and lossy.bic(tried, len(poles)) < problem.bic(best, len(poles)):
        problem, best = lossy, tried
    return problem.described(best, len(poles))


class _Problem:
    """Weighted residuals of channels beside a number of modes; x holds log f, log zeta, all that is linear, a phase.

    A force that is not exact errs all channels of a frequency alike: their residuals are whitened together. What is
    only looked for takes each channel `alone`.
    """

    def __init__(self, responses: FrequencyResponses, turns: bool, drive: str | None) -> None:
        self.responses, self.turns, self.driven = responses, turns, [name == drive for name in responses.channels]
        listed = np.isfinite(responses.H)
        measured: Complex = np.where(listed, responses.H, 0.0)
        omega = 2 * np.pi * responses.hz
        motion = (1j * omega[:, None]) ** np.array([DERIVATIVES[quantity] for quantity in responses.channels.values()])
        own, alone = (
            np.where(listed, 1.0 / np.where(listed, std, 1.0), 0.0) for std in (responses.own_std, responses.std)
        )
        self.force_error = np.broadcast_to(responses.force_error, omega.shape)[:, None]
        self.together = Projection(omega, own * motion, own * measured, self.force_error * own * measured)
        self.alone = Projection(omega, alone * motion, alone * measured, np.zeros_like(measured))
        self.points = 2 * int(listed.sum())

    def expect(self, x: Array, modes: int) -> None:
        """What an error of the force does, by a fit: what was measured is large where the force errs that way."""
        self.together = replace(self.together, by_force=self.force_error * self._answer(self.together, x, modes))

    def lossy(self) -> "_Problem":
        """The same with damped modes beyond the band."""
        of = copy(self)
        of.together, of.alone = replace(self.together, lossy=True), replace(self.alone, lossy=True)
        return of

    def losses(self, x: Array, modes: int) -> float:
        """Size of losses of modes beyond the band, beside that of all else that these answer."""
        columns, flexibility = self.together.columns(np.empty((0, 2))), self._flexibility(x, modes)[:, modes:]
        rest, losses = (columns[:, part] @ flexibility[:, part].T for part in (slice(REST), slice(REST, None)))
        return float(np.linalg.norm(losses) / max(float(np.linalg.norm(rest)), POSITIVE[0]))

    # ---- where to begin

    def further(self, poles: Array, x: Array) -> Array:
        """Frequency and damping ratio of the mode that takes most from what is left, (1, 2)."""
        motion = self.alone.motion * np.exp(1j * self.phase(x))
        left = motion.conj() * (self.alone.measured - self._answer(self.alone, x, len(poles)))
        hz = np.geomspace(self.responses.hz[0], self.responses.hz[-1], GRID)
        tried, taken = [], []
        for ratio in RATIOS:  # in turn: their columns are the largest arrays here
            poles_tried = np.column_stack([hz, np.full(GRID, ratio)])
            columns = self.alone.columns(poles_tried)[:, :GRID]
            shares = (columns.conj().T @ left).real ** 2 / (np.abs(columns.T) ** 2 @ np.abs(motion) ** 2)
            tried.append(poles_tried)
            taken.append(shares.sum(axis=1))
        return np.concatenate(tried)[[np.argmax(np.concatenate(taken))]]

    # ---- all of it

    def _answer(self, weighted: Projection, x: Array, modes: int) -> Complex:
        return weighted.answer(self.poles(x, modes), self.phase(x), self._flexibility(x, modes))

    def phase(self, x: Array) -> float:
        """By which the force leads [rad]."""
        return float(x[-1]) if self.turns else 0.0

    def _flexibility(self, x: Array, modes: int) -> Array:
        c, q = len(self.driven), modes + self.together.rest
        return np.asarray(x[2 * modes : 2 * modes + c * q].reshape(c, q))

    @staticmethod
    def poles(x: Array, modes: int) -> Array:
        """Frequencies and damping ratios, (r, 2)."""
        return np.exp(x[: 2 * modes]).reshape(2, modes).T

    def fitted(self, start: Array, phase: float = 0.0) -> Array:
        """Most likely x from poles and a phase to start from."""
        if not len(start):
            return self._beside(start, phase, self.alone)
        begun = [(start, phase)]
        if self.together.by_force.any():  # each channel alone is another way to the same end
            begun.append(self.alone.fitted(start, phase, self.turns))
        found = [self._beside(*self.together.fitted(*one, self.turns), self.together) for one in begun]
        return min(found, key=lambda x: float(np.sum(np.abs(self._left(x, len(start))) ** 2)))

    def _beside(self, poles: Array, phase: float, weighted: Projection) -> Array:
        """All unknowns by poles and a phase."""
        poles = np.clip(poles, *POSITIVE)  # a pole that ran off is none, and is seen as one
        return np.concatenate(
            [np.log(poles).T.ravel(), weighted.flexibilities(poles, phase).ravel(), [phase] * self.turns]
        )

    def _left(self, x: Array, modes: int) -> Complex:
        """What a fit leaves, (n, c), of the noise 1."""
        return self.together.whitened(self.together.measured - self._answer(self.together, x, modes))

    def _slopes(self, x: Array, modes: int) -> Array:
        """Derivatives of what is left to x, real parts above imaginary ones, (2 n c, p)."""
        weighted, poles, phase = self.together, self.poles(x, modes), self.phase(x)
        of_poles = weighted.slopes(poles, phase, self._flexibility(x, modes))
        columns = weighted.columns(poles)
        n, c, q = *weighted.measured.shape, modes + weighted.rest
        of_linear = np.zeros((n, c, c, q), dtype=complex)
        for j in range(c):
            of_linear[:, j, j] = (weighted.motion[:, j] * np.exp(1j * phase))[:, None] * columns
        parts = [of_poles[:, :, : 2 * modes], of_linear.reshape(n, c, c * q), of_poles[:, :, 2 * modes :]]
        slopes = weighted.whitened(-np.concatenate(parts, axis=2)[:, :, : len(x)])
        return np.concatenate([slopes.real, slopes.imag]).reshape(-1, len(x))

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
        return self.bic(more, modes) < self.bic(less, modes - 1)

    def bic(self, x: Array, modes: int) -> float:
        """Bayesian information criterion, for noise of unknown size; infinite of as many unknowns as numbers."""
        if len(x) >= self.points:
            return float("inf")
        chi2 = float(np.sum(np.abs(self._left(x, modes)) ** 2))
        return float(self.points * np.log(max(chi2 / self.points, POSITIVE[0])) + len(x) * np.log(self.points))

    def described(self, x: Array, modes: int) -> Modes:
        """Modes in the order of their frequencies, with standard deviations."""
        J = self._slopes(x, modes)
        chi2 = float(np.sum(np.abs(self._left(x, modes)) ** 2)) / max(self.points - len(x), 1)
        size = np.linalg.norm(J, axis=0)
        scale = np.divide(1.0, size, out=0.0 * size, where=size > 0.0)  # flexibilities are of another size
        covariance = np.linalg.pinv((J * scale).T @ (J * scale)) * np.outer(scale, scale)
        covariance *= max(chi2, 1.0) if self.responses.sized else chi2
        poles, c, middle = self.poles(x, modes), len(self.driven), self.together.middle
        w, flexibility = 2 * np.pi * poles[:, 0], self._flexibility(x, modes)
        place = 2 * modes + np.arange(flexibility.size).reshape(flexibility.shape)

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
            beside=flexibility[:, modes + 1] / middle**2,
            below=flexibility[:, modes + 2] * middle**2,
            below_std=spread[place[:, modes + 2]] * middle**2,
            phase=self.phase(x),
            phase_std=float(spread[-1]) if self.turns else 0.0,
            chi2_reduced=chi2,
        )
