"""What linear modes lag by behind their steady states in a sweep, found from the sweep itself.

In the frame exp(i phi) of a sweep a mode of exponent sigma answers the force F by P with dP/dt = F - s P, where
s = i dphi/dt - sigma. Its steady state is Q = F/s. What it is off that, E = P - Q, obeys dE/dt = -s E - dQ/dt, which is
integrated along the sweep with dQ/dt constant in small steps. Exponents are those with which all channels are fitted
best, by variable projection: residues, what other modes answer, and what the start of the sweep lets ring are linear.

What a window sees of P is not quite its mean: the fit of the window takes what bends within it for some of its other
waves. It is linear in P and in its conjugate, and known from the fit: so much of P at each of some instants.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg.blas import ztbsv
from scipy.ndimage import uniform_filter1d
from scipy.optimize import least_squares

from hbm.fourier import Array

Complex = npt.NDArray[np.complex128]

INSTANTS, _WEIGHTS = np.polynomial.legendre.leggauss(24)
"""Where a window is looked at, from -1 to 1."""

_DEGREES = np.arange(len(INSTANTS))
_OF_LEGENDRE = (_DEGREES + 0.5)[:, None] * np.polynomial.legendre.legvander(INSTANTS, _DEGREES[-1]).T * _WEIGHTS
"""Legendre polynomials that make up the one that is 1 at an instant and 0 at all others, (degrees, instants): a rule of
Gauss integrates their products exactly."""

SHARPEST = 1e-4
"""Part that no response is known better than when modes are fitted, nor a lag by them."""

REACHES, DEGREE, AS_WELL = (3, 5, 8, 15), 3, 1.2
"""Windows on either side that a local polynomial is fitted to, its degree, and by how much it may leave more."""

MOST_MODES = 8

CANDIDATES, RATIOS = 60, (2e-3, 8e-3, 0.03)
"""Frequencies and damping ratios at which a further mode is looked for."""

PROMISING = 2.0
"""A candidate becomes a mode that takes at most this times as much."""

LEAST_RATIO, MOST_RATIO = 1e-5, 0.3
"""No mode has another damping ratio."""

ABOUT = 15
"""Windows on either side of one that say what modes leave there."""

ROOM = 10.0
"""How far beyond these ratios a fit is followed, so that one that ends beside them is told from one that ends at them;
beyond the frequencies of a sweep by its width. Further out nothing holds a pole, and it runs off."""


@dataclass(frozen=True, eq=False)
class Drive:
    """Force of a sweep in w windows, and at i instants in each.

    Attributes
    ----------
    omega : (w,) array
        How fast the phase runs in the middle of a window [rad/s].
    force : (w,) complex array
        Without its noise.
    time, phase, pace : (w i,) array
        Of the instants [s, rad, rad/s].
    forces : (w i,) complex array
        At the instants.
    seen : (w, 2, i) complex array
        Shares of each instant, and of its conjugate, in what a window sees.
    """

    omega: Array
    force: Complex
    time: Array
    phase: Array
    pace: Array
    forces: Complex
    seen: Complex


class Seen(NamedTuple):
    """What windows see of motions (w, m), and of their conjugates, which goes with conjugates of amounts."""

    direct: Complex
    mirrored: Complex

    def of(self, amounts: Complex) -> Complex:
        """All that is seen of amounts (m, c) of the motions, (w, c)."""
        return np.asarray(self.direct @ amounts + self.mirrored @ amounts.conj())

    def real(self) -> Array:
        """Columns (2w, 2m) of real amounts and of imaginary ones."""
        columns = np.hstack([self.direct + self.mirrored, 1j * (self.direct - self.mirrored)])
        return np.concatenate([columns.real, columns.imag])


class Smooth(NamedTuple):
    """Value, first derivative, its standard deviation, second derivative, and variance of what is left, (w,) each."""

    value: npt.NDArray[np.inexact[Any]]
    first: npt.NDArray[np.inexact[Any]]
    std: Array
    second: npt.NDArray[np.inexact[Any]]
    variance: Array

    def at(self, x: Array) -> npt.NDArray[np.inexact[Any]]:
        """Values beside the middles, x (w, n)."""
        return np.asarray(self.value[:, None] + x * (self.first[:, None] + 0.5 * x * self.second[:, None]))


def shares(x: Array, wave: Complex, found: Complex) -> Complex:
    """Shares of instants, and of their conjugates, in what a window sees of a motion, (2, i).

    Parameters
    ----------
    x : (n,) array
        Samples of the window, from -1 to 1.
    wave : (n,) complex array
        exp(i phi) at the samples.
    found : (n,) complex array
        Amplitude that the fit of the window finds, per value of each sample.
    """
    both = 0.5 * np.array([found * wave, found * wave.conj()])
    return np.asarray(both @ np.polynomial.legendre.legvander(x, _DEGREES[-1]) @ _OF_LEGENDRE)


def drive_of(time: Array, half: Array, phase: Array, force: Complex, seen: Complex) -> Drive:
    """Force of a sweep by the middles of windows and half their lengths [s], phases [rad] and amplitudes, (w,) each.

    `seen` is of :func:`shares`, (w, 2, i).
    """
    x = half[:, None] * INSTANTS
    motion = smooth(time, phase)
    size = np.maximum(np.abs(force), 1e-12 * np.abs(force).max())  # a force that pauses has no logarithm
    log = smooth(time, np.log(size) + 1j * np.unwrap(np.angle(force)))
    return Drive(
        omega=motion.first.real,
        force=np.exp(log.value),
        time=(time[:, None] + x).ravel(),
        phase=motion.at(x).real.ravel(),
        pace=(motion.first[:, None] + motion.second[:, None] * x).real.ravel(),
        forces=np.exp(log.at(x)).ravel(),
        seen=seen,
    )


def smooth(t: Array, y: npt.NDArray[np.inexact[Any]]) -> Smooth:
    """Values, first and second derivatives by local polynomials, over as many windows as those describe (w,) values."""
    tried = [_smooth(t, y, reach) for reach in REACHES]
    least = tried[0].variance.mean()
    return [s for s in tried if s.variance.mean() <= AS_WELL * least][-1]


def _smooth(t: Array, y: npt.NDArray[np.inexact[Any]], reach: int) -> Smooth:
    size = min(2 * reach + 1, len(t))
    at = np.clip(np.arange(len(t)) - reach, 0, len(t) - size)[:, None] + np.arange(size)
    x = t[at] - t[:, None]
    scale = np.max(np.abs(x), axis=1)
    powers = (x / scale[:, None])[:, :, None] ** np.arange(min(DEGREE, size - 1) + 1)
    inverse = np.linalg.pinv(powers)
    c = np.einsum("wpn,wn->wp", inverse, y[at])
    left = y[at] - np.einsum("wnp,wp->wn", powers, c)
    variance = np.sum(np.abs(left) ** 2, axis=1) / max(size - powers.shape[2], 1)
    std = np.sqrt(np.median(variance) * np.sum(inverse[:, 1] ** 2, axis=1)) / scale
    second = c[:, 2] if c.shape[1] > 2 else np.zeros_like(c[:, 1])
    return Smooth(c[:, 0], c[:, 1] / scale, std, 2.0 * second / scale**2, variance)


def answers(drive: Drive, sigma: Complex) -> tuple[Seen, Complex]:
    """Answers of modes of exponents (r,) to the force per residue, as windows see them and steady, (w, r) each."""
    steady = drive.force[:, None] / (1j * drive.omega[:, None] - sigma)
    swept = Seen(np.empty_like(steady), np.empty_like(steady))
    turned, passed = 1j * np.diff(drive.phase), np.diff(drive.time)
    band = np.zeros((2, len(drive.time)), dtype=complex, order="F")  # E is kept in part from instant to instant
    for r, exponent in enumerate(sigma):
        Q = drive.forces / (1j * drive.pace - exponent)
        turn = turned - exponent * passed
        kept, pulled = np.exp(-turn), -np.diff(Q) / turn
        band[1, :-1] = -kept
        E = ztbsv(1, band, np.append(pulled[0], pulled * (1.0 - kept)), lower=1, diag=1, overwrite_x=1)
        swept.direct[:, r], swept.mirrored[:, r] = _seen(drive, Q + E)
    return swept, steady


def rings(drive: Drive, sigma: Complex) -> Seen:
    """Free vibration since the start in the frame of the sweep, as windows see it, (w, r)."""
    since, turned = drive.time - drive.time[0], drive.phase - drive.phase[0]
    ringing = Seen(*np.empty((2, len(drive.omega), len(sigma)), dtype=complex))
    for r, exponent in enumerate(sigma):
        ringing.direct[:, r], ringing.mirrored[:, r] = _seen(drive, np.exp(exponent * since - 1j * turned))
    return ringing


def _seen(drive: Drive, values: Complex) -> tuple[Complex, Complex]:
    """What windows see of values at the instants (w i,), and of their conjugates, (w,) each."""
    of_windows = values.reshape(drive.seen[:, 0].shape)
    return np.sum(drive.seen[:, 0] * of_windows, axis=1), np.sum(drive.seen[:, 1] * of_windows.conj(), axis=1)


class _Fit:
    """Channels X (w, c) of standard deviations (w, c) beside modes."""

    def __init__(self, drive: Drive, X: Complex, std: Array) -> None:
        self.drive, self.X = drive, X
        self.weight = np.divide(1.0, std, out=np.zeros_like(std), where=std > 0.0)
        middle, width = np.mean(drive.omega), np.ptp(drive.omega) or 1.0
        x = (drive.omega - middle) / width
        self.others = drive.force[:, None] * x[:, None] ** np.arange(3)  # of modes outside the sweep, and at rest

    def linear(self, sigma: Complex) -> tuple[Complex, Complex]:
        """What channels are off their steady states by the best fit beside exponents, and what it leaves, (w, c)."""
        swept, steady = answers(self.drive, sigma)
        ringing, others = rings(self.drive, sigma), Seen(self.others, np.zeros_like(self.others))
        seen = Seen(*(np.hstack(parts) for parts in zip(swept, ringing, others, strict=True)))
        columns = seen.real()
        size, amounts = np.linalg.norm(columns, axis=0), np.empty((columns.shape[1], self.X.shape[1]))
        for j, w in enumerate(np.tile(self.weight.T, 2)):
            read = np.concatenate([self.X[:, j].real, self.X[:, j].imag])
            amounts[:, j] = np.linalg.lstsq(w[:, None] * columns / size, w * read, rcond=None)[0] / size
        real, imaginary = np.split(amounts, 2)
        whole = real + 1j * imaginary
        seen_of_all, r = seen.of(whole), len(sigma)
        off = seen_of_all - others.of(whole[2 * r :]) - steady @ whole[:r]
        return off, self.X - seen_of_all

    def further(self, left: Complex) -> tuple[complex, float]:
        """Exponent of the mode that takes most from what is left, and how much of chi square."""
        omega = np.quantile(self.drive.omega, np.linspace(0.0, 1.0, CANDIDATES))
        tried = np.concatenate([omega * (1j - ratio) for ratio in RATIOS])
        columns = answers(self.drive, tried)[0].direct
        overlap = np.abs(columns.conj().T @ (self.weight**2 * left)) ** 2
        size = np.abs(columns.T) ** 2 @ self.weight**2
        taken = np.sum(np.divide(overlap, size, out=np.zeros_like(size), where=size > 0.0), axis=1)
        return complex(tried[np.argmax(taken)]), float(taken.max())

    def improved(self, sigma: Complex) -> Complex:
        """Exponents that fit best, among those of modes and in some room about them."""
        slow, fast = self.drive.omega.min(), self.drive.omega.max()
        width = fast - slow
        least = np.append(np.full(len(sigma), np.log(LEAST_RATIO * slow / ROOM)), np.full(len(sigma), slow - width))
        most = np.append(np.full(len(sigma), np.log(MOST_RATIO * fast * ROOM)), np.full(len(sigma), fast + width))

        def of(x: Array) -> Complex:
            return np.asarray(-np.exp(x[: len(sigma)]) + 1j * x[len(sigma) :])

        def residual(x: Array) -> Array:
            left = (self.weight * self.linear(of(x))[1]).ravel()
            return np.concatenate([left.real, left.imag])

        start = np.concatenate([np.log(-sigma.real), sigma.imag])
        limits = {"x_scale": "jac", "xtol": 1e-8, "ftol": 1e-8, "max_nfev": 30}
        return of(least_squares(residual, start, bounds=(least, most), **limits).x)

    def chi2(self, left: Complex) -> float:
        """Chi square of what is left."""
        return float(np.sum(np.abs(self.weight * left) ** 2))

    def better(self, chi2: float, before: float) -> bool:
        """Whether one mode more is worth it by BIC, for noise of unknown size: sigma, residues and rings are its."""
        points, c = 2 * self.X.size, self.X.shape[1]
        return bool(points * np.log(before / max(chi2, before * 1e-16)) > (2 + 4 * c) * np.log(points))

    def plausible(self, sigma: Complex) -> bool:
        """Whether modes lie apart, within the sweep, and are damped as modes are."""
        sigma = sigma[np.argsort(sigma.imag)]
        ratio = -sigma.real / np.abs(sigma)
        apart = np.diff(sigma.imag) > -0.5 * (sigma.real[1:] + sigma.real[:-1])
        within = self.drive.omega.min() < sigma.imag[0] and sigma.imag[-1] < self.drive.omega.max()
        return bool(within and apart.all() and ratio.min() > LEAST_RATIO and ratio.max() < MOST_RATIO)


def off_steady(drive: Drive, X: Complex, std: Array) -> tuple[Complex, Complex]:
    """What channels are off their steady states, and what modes leave of them.

    Parameters
    ----------
    drive : Drive
    X : (w, c) complex array
        Responses.
    std : (w, c) array
        Their standard deviations.

    Returns
    -------
    (w, c) complex array
        Response less its steady state, 0 where no mode stands out.
    (w, c) complex array
        Response less the fit.
    """
    fit, sigma = _Fit(drive, X, np.hypot(std, SHARPEST * np.abs(X))), np.empty(0, dtype=complex)
    off, left = fit.linear(sigma)
    for _ in range(MOST_MODES):
        start, taken = fit.further(left)
        before = fit.chi2(left)
        if before == 0.0 or not fit.better(max(before - PROMISING * taken, 0.0), before):
            break
        more = fit.improved(np.append(sigma, start))
        off_more, left_more = fit.linear(more)
        if not fit.plausible(more) or not fit.better(fit.chi2(left_more), before):
            break
        sigma, off, left = more, off_more, left_more
    return off, left


def not_described(off: Complex, left: Complex, noise: Array) -> tuple[float, Array]:
    """What modes leave of a response beyond its noise, over what they are off their steady states, where they are.

    In all, and about each window (w,) where that is more, as beside a low peak.
    """
    size, beyond = np.abs(off) ** 2, np.abs(left) ** 2 - 2.0 * noise**2
    if not size.any():
        return 1.0, np.ones(len(off))
    share = max(float(np.sqrt(max(np.sum(size * beyond), 0.0) / np.sum(size**2))), SHARPEST)
    rest, whole = (uniform_filter1d(part, 2 * ABOUT + 1, mode="constant") for part in (size * beyond, size**2))
    here = np.divide(rest, whole, out=np.zeros_like(rest), where=whole > 0.0)
    return share, np.maximum(np.sqrt(np.maximum(here, 0.0)), share)
