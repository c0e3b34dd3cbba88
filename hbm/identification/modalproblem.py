"""Weighted residuals of frequency responses beside modes, what asks for one more, and what a fit says of all numbers.

It is what :mod:`.modalfit` searches; what is linear in responses is fitted exactly, see :mod:`.projection`.
"""

from copy import copy
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize_scalar

from hbm.channels import DERIVATIVES
from hbm.fourier import Array
from hbm.identification.beyond import beyond_of
from hbm.identification.modes import Modes
from hbm.identification.projection import POSITIVE, REST, Projection, as_reals
from hbm.measurement.responses import Complex, FrequencyResponses

GRID, RATIOS = 400, (5e-4, 2e-3, 8e-3, 0.03)
"""Frequencies and damping ratios at which a further mode is looked for."""

OUTSIDE, LEAST_RATIO, MOST_RATIO = 1.05, 1e-6, 0.5
"""A pole beyond the band by this factor is no mode of it, nor one with another damping ratio than these."""

FAR, SHARES, CLOSER = 2.0, 8, 1e-4
"""A mode above the band is at so many times its highest frequency at most; shares tried, and how near to the best."""

LATEST, STEP, LOWEST, FINER = 8.0, 0.125, 16, 6
"""Delays are looked for up to so many periods of the highest frequency, in such steps, and from so many of the lowest
misfits in steps of a quarter, so many times: of a mode all delays that differ by half its periods look alike, but for
its flanks."""


class Problem:
    """Weighted residuals of channels beside a number of modes; x holds log f, log zeta, all that is linear, and turns.

    Turns are those of :class:`.projection.Projection`: a phase of the force and delays of the channels. A force that is
    not exact errs all channels of a frequency alike: their residuals are whitened together. What is only looked for
    takes each channel `alone`.
    """

    def __init__(self, responses: FrequencyResponses, turns: bool, drive: str | None) -> None:
        self.responses, self.driven = responses, [name == drive for name in responses.channels]
        self.sought = np.append(turns, np.zeros(len(self.driven), dtype=bool))
        self.wanders = False
        listed = np.isfinite(responses.H)
        measured: Complex = np.where(listed, responses.H, 0.0)
        omega = 2 * np.pi * responses.hz
        motion = (1j * omega[:, None]) ** np.array([DERIVATIVES[quantity] for quantity in responses.channels.values()])
        own, alone = (
            np.where(listed, 1.0 / np.where(listed, std, 1.0), 0.0) for std in (responses.own_std, responses.std)
        )
        self.force_error = np.broadcast_to(responses.force_error, omega.shape)[:, None]
        self._measured: Complex = own * measured
        self.together = Projection(omega, own * motion, self._measured, self.force_error * self._measured)
        self.alone = Projection(omega, alone * motion, alone * measured, np.zeros_like(measured))
        self.points = 2 * int(listed.sum())

    def expect(self, x: Array, modes: int) -> None:
        """What an error of the force does, by a fit, and that error at each frequency.

        What was measured is large where the force errs that way, and both weights and slopes go with the force that was
        read: flexibilities would come out small by twice the square of its error. They do not where what is left goes
        with the force that is most likely beside all channels, which is what total least squares asks for.
        """
        answer = self._answer(self.together, x, modes)
        felt, left = self.force_error * answer, self._measured - answer
        across = np.sum(felt.conj() * left, axis=1, keepdims=True)
        force = 1.0 + self.force_error * across / (1.0 + np.sum(np.abs(felt) ** 2, axis=1, keepdims=True))
        self.together = replace(self.together, by_force=felt, measured=answer + force.conj() * left)

    def lossy(self) -> "Problem":
        """The same with damped modes beyond the band."""
        of = copy(self)
        of.together, of.alone = replace(self.together, lossy=True), replace(self.alone, lossy=True)
        return of

    def beyond(self, x: Array, modes: int) -> "Problem":
        """The same with a mode above the band where it takes most of what is left, beside poles and turns as they are.

        It is at twice the highest frequency at most: what is further is described as well without it.
        """
        poles, turns = self.poles(x, modes), self.turns(x)

        def left(share: float) -> float:
            of = self.with_beyond(share)
            return of._chi2(of._beside(poles, turns, of.together), modes)

        nearest, furthest = self._shares
        tried = np.linspace(furthest, nearest, SHARES)
        best = int(np.argmin([left(share) for share in tried]))
        around, close = (tried[max(best - 1, 0)], tried[min(best + 1, SHARES - 1)]), {"xatol": CLOSER * nearest}
        return self.with_beyond(minimize_scalar(left, bounds=around, method="bounded", options=close).x)

    @property
    def _shares(self) -> tuple[float, float]:
        """Shares of a mode just above the band, and of one as far above as is looked for."""
        highest = float(self.together.middle / self.together.omega[-1]) ** 2
        return highest / OUTSIDE**2, highest / FAR**2

    def with_beyond(self, share: float) -> "Problem":
        """The same with a mode above the band, of a share between those of the nearest and of the furthest."""
        nearest, furthest = self._shares
        of, share = copy(self), float(np.clip(share, furthest, nearest))
        of.together, of.alone = replace(self.together, beyond=share), replace(self.alone, beyond=share)
        return of

    def late(self) -> "Problem":
        """The same where each channel may come late, wherever it is that moves with the force."""
        of = self.seeking(np.append(self.sought[0], np.ones(len(self.driven), dtype=bool)))
        of.wanders, of.driven = True, [False] * len(self.driven)
        return of

    def seeking(self, sought: npt.NDArray[np.bool_]) -> "Problem":
        """The same with these turns (1 + c,) alone, from where they are started."""
        of = copy(self)
        of.sought, of.wanders = sought, False
        return of

    def free(self) -> "Problem":
        """The same where each channel has phases of its own in all modes: what no delay alone describes."""
        of = self.seeking(np.zeros_like(self.sought))
        of.together, of.alone = replace(self.together, free=True), replace(self.alone, free=True)
        of.driven = [False] * len(self.driven)
        return of

    def losses(self, x: Array, modes: int) -> float:
        """Size of losses of modes beyond the band, beside that of all else that these answer."""
        columns, flexibility = self.together.columns(np.empty((0, 2))), self.flexibility(x, modes)[:, modes:]
        rest, losses = (columns[:, part] @ flexibility[:, part].T for part in (slice(REST), slice(REST, None)))
        return float(np.linalg.norm(losses) / max(float(np.linalg.norm(rest)), POSITIVE[0]))

    # ---- where to begin

    def further(self, poles: Array, x: Array) -> Array:
        """Frequency and damping ratio of the mode that takes most from what is left, (1, 2)."""
        motion = self.alone.turned(self.turns(x))
        left = motion.conj() * (self.alone.measured - self._answer(self.alone, x, len(poles)))
        hz = np.geomspace(self.responses.hz[0], self.responses.hz[-1], GRID)
        tried, taken = [], []
        for ratio in RATIOS:  # in turn: their columns are the largest arrays here
            poles_tried = np.column_stack([hz, np.full(GRID, ratio)])
            columns = self.alone.of_modes(poles_tried)
            across = columns.conj().T @ left
            taken_by = np.abs(across) ** 2 if self.wanders else across.real**2
            shares = taken_by / ((columns.real**2 + columns.imag**2).T @ np.abs(motion) ** 2)
            tried.append(poles_tried)
            taken.append(shares.sum(axis=1))
        return np.concatenate(tried)[[np.argmax(np.concatenate(taken))]]

    def _delays(self, poles: Array) -> Array:
        """Turns (1 + c,) to begin with: delays with which each channel alone is described best beside poles."""
        best = [self._delay(poles, j) for j in range(len(self.driven))]
        return np.where(self.sought, np.append(0.0, best), 0.0)

    def _delay(self, poles: Array, channel: int) -> float:
        period = 2 * np.pi * self.alone.middle / self.alone.omega[-1]
        periods, parts = np.arange(-LATEST, LATEST + 1.0), np.arange(0.0, 1.0, STEP)
        within = slice(int(2 * LATEST / STEP) + 1)
        tried, step = (period * np.add.outer(periods, parts)).ravel()[within], period * STEP
        misfits = self.alone.misfits(poles, channel, period * periods, period * parts).ravel()[within]
        dips = np.flatnonzero((misfits[1:-1] <= misfits[:-2]) & (misfits[1:-1] <= misfits[2:])) + 1
        best = tried[dips[np.argsort(misfits[dips])][:LOWEST]]
        if not len(best):
            return 0.0
        for _ in range(FINER):
            beside = step * np.linspace(-1.0, 1.0, 9)
            around, misfits = np.add.outer(best, beside), self.alone.misfits(poles, channel, best, beside)
            best, step = around[np.arange(len(best)), misfits.argmin(axis=1)], step / 4.0
        return float(best[misfits.min(axis=1).argmin()])

    # ---- all of it

    def _answer(self, weighted: Projection, x: Array, modes: int) -> Complex:
        return weighted.answer(self.poles(x, modes), self.turns(x), self.flexibility(x, modes))

    def turns(self, x: Array) -> Array:
        """Phase by which the force leads, and what delays turn the middle frequency back by, (1 + c,) [rad]."""
        out = np.zeros(len(self.sought))
        out[self.sought] = x[len(x) - int(self.sought.sum()) :]
        return out

    def flexibility(self, x: Array, modes: int) -> Array:
        """Flexibilities (c, q) of modes and residuals."""
        c, q = len(self.driven), self.together.size(modes)
        return np.asarray(x[2 * modes : 2 * modes + c * q].reshape(c, q))

    def at_drive(self, x: Array, modes: int) -> Array:
        """Flexibilities (d, r) of modes where the force acts, of d = 1 channel there or none."""
        return self.flexibility(x, modes)[self.driven, :modes]

    @staticmethod
    def poles(x: Array, modes: int) -> Array:
        """Frequencies and damping ratios, (r, 2)."""
        return np.exp(x[: 2 * modes]).reshape(2, modes).T

    def fitted(self, start: Array, turns: Array | None = None) -> Array:
        """Most likely x from poles and turns to start from."""
        turns = np.zeros(len(self.sought)) if turns is None else turns
        if not len(start):
            return self._beside(start, turns, self.alone)
        if self.wanders:  # poles are right before delays are, where phases are their own
            freed = self.free()
            start = np.clip(freed.alone.fitted(start, 0.0 * turns, freed.sought)[0], *POSITIVE)
            turns = self._delays(start)
        begun = [(start, turns)]
        if self.together.by_force.any():  # each channel alone is another way to the same end
            begun.append(self.alone.fitted(start, turns, self.sought))
        found = [self._beside(*self.together.fitted(*one, self.sought), self.together) for one in begun]
        return min(found, key=lambda x: self._chi2(x, len(start)))

    def _beside(self, poles: Array, turns: Array, weighted: Projection) -> Array:
        """All unknowns by poles and turns."""
        poles = np.clip(poles, *POSITIVE)  # a pole that ran off is none, and is seen as one
        return np.concatenate(
            [np.log(poles).T.ravel(), weighted.flexibilities(poles, turns).ravel(), turns[self.sought]]
        )

    def _left(self, x: Array, modes: int) -> Complex:
        """What a fit leaves, (n, c), of the noise 1."""
        return self.together.whitened(self.together.measured - self._answer(self.together, x, modes))

    def _chi2(self, x: Array, modes: int) -> float:
        return float(np.sum(np.abs(self._left(x, modes)) ** 2))

    def _slopes(self, x: Array, modes: int) -> Array:
        """Derivatives of what is left to x, real parts above imaginary ones, (2 n c, p)."""
        weighted, poles, turns = self.together, self.poles(x, modes), self.turns(x)
        of_others = weighted.slopes(poles, turns, self.flexibility(x, modes))
        columns = weighted.columns(poles)
        n, c, q = *weighted.measured.shape, weighted.size(modes)
        of_linear = np.zeros((n, c, c, q), dtype=complex)
        for j in range(c):
            of_linear[:, j, j] = weighted.turned(turns)[:, [j]] * columns
        of_turns = of_others[:, :, 2 * modes :][:, :, self.sought]
        parts = [of_others[:, :, : 2 * modes], of_linear.reshape(n, c, c * q), of_turns]
        slopes = weighted.whitened(-np.concatenate(parts, axis=2))
        return as_reals(slopes).reshape(-1, len(x))

    def asks_for(self, more: Array, less: Array, modes: int) -> bool:
        """Whether a fit is better by BIC, for noise of unknown size, and its modes lie apart and in the band.

        Two within half their bandwidths, seen from one drive, are one that is not linear; that moves with its force.
        """
        poles, band = self.poles(more, modes), self.responses.hz
        hz, ratio = poles[np.argsort(poles[:, 0])].T
        together = np.diff(hz) < 0.5 * (hz[1:] * ratio[1:] + hz[:-1] * ratio[:-1])
        outside = hz[0] < band[0] / OUTSIDE or hz[-1] > band[-1] * OUTSIDE
        against = (self.at_drive(more, modes) <= 0.0).any()
        if against or outside or together.any() or ratio.min() < LEAST_RATIO or ratio.max() > MOST_RATIO:
            return False
        return self.bic(more, modes) < self.bic(less, modes - 1)

    def bic(self, x: Array, modes: int) -> float:
        """Bayesian information criterion, for noise of unknown size; infinite of as many unknowns as numbers."""
        return self.criterion(self._chi2(x, modes), len(x))

    def misfit(self, x: Array, modes: int) -> float:
        """What a fit leaves, in noise variances."""
        return self.per_number(self._chi2(x, modes), len(x))

    def criterion(self, chi2: float, unknowns: int) -> float:
        """Bayesian information criterion of a fit that leaves chi2."""
        unknowns += self.together.beyond > 0.0
        if unknowns >= self.points:
            return float("inf")
        mean = max(chi2 / self.points, POSITIVE[0])
        return float(self.points * np.log(mean) + unknowns * np.log(self.points))

    def per_number(self, chi2: float, unknowns: int) -> float:
        """What is left of each number that is free."""
        return chi2 / max(self.points - unknowns, 1)

    def noise(self, misfit: float) -> float:
        """Factor of a covariance by the misfit, where that is above 1 or the size of the noise is not known."""
        return max(misfit, 1.0) if self.responses.sized else misfit

    def pulls(self, x: Array, modes: int) -> Array:
        """Delays that a fit without them asks for, by one step from it, over their standard deviations, (c,)."""
        late, none = self.late(), np.zeros(len(self.driven))
        beside, left = np.append(x, none), self._left(x, modes).ravel()
        covariance = covariance_of(late._slopes(beside, modes))
        step = -covariance @ late._slopes(beside, modes).T @ as_reals(left)
        spread = np.sqrt(np.maximum(np.diag(covariance), POSITIVE[0]) * self.noise(self.misfit(x, modes)))
        return np.asarray((step / spread)[len(x) :])

    def described(self, x: Array, modes: int) -> Modes:
        """Modes in the order of their frequencies, with standard deviations."""
        poles, c, middle = self.poles(x, modes), len(self.driven), self.together.middle
        w, flexibility = 2 * np.pi * poles[:, 0], self.flexibility(x, modes)
        share, rest = self.together.beyond, flexibility[:, modes:]
        whole = self.covariance(self._slopes(x, modes), rest, self.turns(x), self.misfit(x, modes))
        covariance = whole[: len(x), : len(x)]
        place = 2 * modes + np.arange(flexibility.size).reshape(flexibility.shape)

        def std(rows: Array) -> Array:
            return np.asarray(np.sqrt(np.maximum(np.einsum("...i,ij,...j->...", rows, covariance, rows), 0.0)))

        of_A = np.zeros((c, modes, len(x)))  # A = flexibility omega_r^2
        for j, r in np.ndindex(c, modes):
            of_A[j, r, place[j, r]] = w[r] ** 2
            of_A[j, r, r] = 2 * w[r] ** 2 * flexibility[j, r]
        spread, order = np.sqrt(np.maximum(np.diag(covariance), 0.0)), np.argsort(poles[:, 0])
        turns, turns_std = self.turns(x), self.turns(spread)
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
            phase=float(turns[0]),
            phase_std=float(turns_std[0]),
            delays=turns[1:] / middle,
            delays_std=turns_std[1:] / middle,
            chi2_reduced=self.misfit(x, modes),
            beyond=beyond_of(rest, share, middle, whole, place[:, modes + 1]) if share else None,
        )

    def covariance(self, slopes: Array, rest: Array, turns: Array, misfit: float) -> Array:
        """Covariance of unknowns by slopes of what is left, and of the share of a mode above the band beside them."""
        return covariance_of(self.with_share(slopes, rest, turns)) * self.noise(misfit)

    def with_share(self, slopes: Array, rest: Array, turns: Array) -> Array:
        """Slopes of what is left, and those to the share of a mode above the band beside them, where there is one."""
        if not self.together.beyond:
            return slopes
        moved = self.together.turned(turns) * self.together.of_beyond(rest)
        return np.column_stack([slopes, as_reals(self.together.whitened(-moved)).ravel()])


def covariance_of(slopes: Array) -> Array:
    """Covariance of unknowns by the slopes of what is left of noise 1."""
    size = np.linalg.norm(slopes, axis=0)
    scale = np.divide(1.0, size, out=0.0 * size, where=size > 0.0)  # unknowns are of another size each
    scaled = slopes * scale
    return np.asarray(np.linalg.pinv(scaled.T @ scaled) * np.outer(scale, scale))
