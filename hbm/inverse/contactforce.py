"""The friction force that the sensors imply: a regularised weighted least-squares problem at every harmonic.

The structure is linear outside the contact, so that each harmonic of the responses is a known combination of that
harmonic of the friction force and of the excitation, plus the small product of friction and motion (foreshortening),
which is iterated, as are the forces of nonlinear elements at the motion found. Boundary conditions and the balance of
forces hold exactly, whatever the noise. Unknown are two complex numbers per harmonic, weighed by the standard
deviations of all that was measured.

Harmonics that the sensors hardly see are held by a prior: friction falls with the number k of the harmonic like
k^-p. Its size, for odd and for even harmonics, and its order p are those that make the measured record most
likely (empirical Bayes, the Gaussian form of generalised Tikhonov regularisation): the noise decides, not a hand. The
fundamental alone may be as large as the load whatever the others are, which are small beside it where a contact sticks.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from hbm.balance.elements import forces_in_time
from hbm.fourier import Array
from hbm.inverse.sensing import Complex, Sensing

Indices = npt.NDArray[np.signedinteger[Any]]

ORDERS = np.array([0.0, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0])
"""Orders p of the prior that are tried; a force that jumps has 1, one with corners 2."""

CORNERS = 2.0
"""Order of a force with corners, as friction has them where its motion turns."""

SIZES = 57
"""Sizes that are tried, from a tenth of the smallest harmonic to ten times the largest, each divided by k^-p."""

MOST_NUMBERS = 4_000_000
"""Likelihoods that are held in memory at once."""

AS_LIKELY = 2.0
"""Largest size counts whose log-likelihood is so close to the best: the upper end of its 95 % interval."""

ORDER_AS_LIKELY = 4.5
"""So is the least order whose log-likelihood is so close to the best: three standard deviations."""

MOST_UNSEEN = 256
"""Harmonics above those measured that are counted in the uncertainty, at most."""

UNBOUND = 1e3
"""Before a prior is known: friction harmonics up to this many times the load or the force."""

COUPLED = 1e-10
"""The product of friction and motion, and what elements do, is iterated until it changes by less than this fraction."""

MOST_ITERATIONS = 60


@dataclass(frozen=True, eq=False)
class Solution:
    """Friction, excitation and motion of r records at harmonics 0..H under one prior, and their joint uncertainty.

    Attributes
    ----------
    friction, force : (r, H+1) complex array
        Amplitudes [N]; harmonic 0 of friction is what was assumed.
    q : (r, H+1, n) complex array
        Modal coordinates.
    factor : (r, H+1, 2 + n, m) complex array
        Deviations of (friction, force, q) are ``factor @ xi``, xi of independent numbers whose real and imaginary parts
        have unit variance.
    residual : (r, H+1, c) complex array
        Measured less explained, in standard deviations.
    leverage : (r, H+1, c) array
        Share of each measurement that the fit follows, 0..1.
    resolution : (r, H+1) array
        Standard deviation of friction by the sensors alone, without the prior [N]; inf where they see nothing of it.
    """

    friction: Complex
    force: Complex
    q: Complex
    factor: Complex
    residual: Complex
    leverage: Array
    resolution: Array


S = TypeVar("S", bound=Solution)


@dataclass(frozen=True, eq=False)
class ForceEstimate(Solution):
    """The solution under the prior that is most likely.

    Attributes
    ----------
    condition : (r, H+1) array
        Condition number of telling friction from force, columns scaled to equal length; inf where not measured.
    order : (r,) array
        p of the prior.
    size : (r, 2) array
        Most likely size of the even and of the odd harmonics, at harmonic 1 [N].
    """

    condition: Array
    order: Array
    size: Array

    def expected(self, k: Indices) -> Array:
        """Size of friction harmonics `k` (m,) above those measured, (r, m) [N]."""
        return decay(self.order, self.size, k)


def regularised(sensing: Sensing, mean: Array) -> ForceEstimate:
    """Friction force by regularised weighted least squares, with the balance of forces as a constraint.

    Parameters
    ----------
    sensing : Sensing
    mean : (r,) array
        Mean friction, which no accelerometer sees [N].
    """
    return most_likely(sensing, lambda expected, _: _solve(sensing, mean, expected))


def likeliest(sensing: Sensing, mean: Array) -> ForceEstimate:
    """As :func:`regularised`, of the order that is likeliest: the best guess where its uncertainty does not matter."""
    return most_likely(sensing, lambda expected, _: _solve(sensing, mean, expected), cautious=False)


def most_likely(sensing: Sensing, solve: Callable[[Array, S | None], S], *, cautious: bool = True) -> ForceEstimate:
    """Solve with friction unbound, then with the prior that this makes most likely.

    Parameters
    ----------
    sensing : Sensing
    solve : callable
        Solution by the sizes (r, H+1) that are expected of friction, and the solution before.
    cautious : bool
        As of :func:`prior`.
    """
    shape = sensing.i_omega.shape
    largest = np.maximum(np.abs(sensing.force).max(axis=1), sensing.rig.contact.normal_load)
    unbound = np.broadcast_to(UNBOUND * np.maximum(largest, sensing.spectra.level)[:, None], shape)
    free = solve(unbound, None)
    seen, k = (np.abs(free.friction[:, 1:]), free.resolution[:, 1:]), np.arange(1, shape[1])
    order, size, largest_size = prior(*seen, cautious=cautious)
    expected = np.zeros(shape)
    expected[:, 1:] = decay(order, largest_size, k)
    if cautious:  # beside the fundamental of a contact that mostly sticks all others are small: they do not tell it
        expected[:, 1] = np.maximum(expected[:, 1], sensing.rig.contact.normal_load)
    held = solve(expected, free)
    return ForceEstimate(
        friction=held.friction,
        force=held.force,
        q=held.q,
        factor=held.factor,
        residual=held.residual,
        leverage=held.leverage,
        resolution=free.resolution,
        condition=sensing.condition,
        order=order,
        size=size,
    )


def last_counted(H: int) -> int:
    """The last harmonic that counts in the uncertainty where H were measured."""
    return min(8 * H, H + MOST_UNSEEN)


def decay(order: Array, size: Array, k: Indices) -> Array:
    """Sizes of harmonics `k` (m,) as a :func:`prior` has them, (r, m)."""
    return np.asarray(size[:, k % 2] * (1.0 * k) ** -order[:, None])


def prior(amplitude: Array, std: Array, *, cautious: bool = False) -> tuple[Array, Array, Array]:
    """Order and sizes of the prior that make amplitudes of harmonics 1..H most likely.

    Where it holds harmonics that were measured, a steep order would call some known that nobody saw: then the least
    order is cautious that is as likely within the noise.

    Parameters
    ----------
    amplitude : (r, H) array
        Magnitude of each harmonic by the sensors alone [N].
    std : (r, H) array
        Standard deviation of each of its cos and sin; inf where not measured [N].
    cautious : bool
        Whether the least order is taken that is as likely, from that of corners on.

    Returns
    -------
    order : (r,) array
        One of `ORDERS`.
    size, largest : (r, 2) arrays
        Size of even and of odd harmonics: the most likely, and the largest as likely within the noise [N].
    """
    parts = max(1, amplitude.size * SIZES * len(ORDERS) // MOST_NUMBERS)
    rows = zip(np.array_split(amplitude, parts), np.array_split(std, parts), strict=True)
    orders, sizes, largest = zip(*(_most_likely_decay(a, s, cautious) for a, s in rows), strict=True)
    return np.concatenate(orders), np.concatenate(sizes), np.concatenate(largest)


def _most_likely_decay(a: Array, std: Array, cautious: bool) -> tuple[Array, Array, Array]:
    """Order and sizes of some records at once, see :func:`prior`."""
    k, every = np.arange(1, a.shape[1] + 1), np.arange(len(a))
    decay, seen = k ** -ORDERS[:, None], np.isfinite(std)
    own = np.maximum(a[:, None] / decay, np.finfo(float).tiny)  # (r, orders, H)
    low = np.where(seen[:, None], own, np.inf).min(axis=2)
    low, high = np.where(np.isfinite(low), low, 1.0), np.where(seen[:, None], own, 0.0).max(axis=2)
    tried = np.geomspace(0.1 * low, 10.0 * np.maximum(high, low), SIZES, axis=1)  # (r, sizes, orders)
    variance = (tried[..., None] * decay) ** 2 + np.where(seen, std, 1.0)[:, None, None] ** 2
    terms = np.where(
        seen[:, None, None], -np.log(variance) - a[:, None, None] ** 2 / (2 * variance), 0.0
    )  # cos and sin
    likelihood = np.stack([_of_kind(terms, seen, k % 2 == odd) for odd in (0, 1)], axis=1)  # (r, kinds, sizes, orders)
    by_order = likelihood.max(axis=2).sum(axis=1)
    best = _cautious(by_order) if cautious else by_order.argmax(axis=1)
    likelihood, tried = likelihood[every, :, :, best], tried[every, :, best]  # (r, kinds, sizes), (r, sizes)
    likely = likelihood >= likelihood.max(axis=2, keepdims=True) - AS_LIKELY
    last = SIZES - 1 - likely[..., ::-1].argmax(axis=2)
    return ORDERS[best], tried[every[:, None], likelihood.argmax(axis=2)], tried[every[:, None], last]


def _cautious(likelihood: Array) -> npt.NDArray[np.intp]:
    """Index of the least order, from that of corners on, as likely within the noise as the best, (r, orders)."""
    best = likelihood.argmax(axis=1)
    likely = likelihood >= likelihood.max(axis=1, keepdims=True) - ORDER_AS_LIKELY
    return np.asarray(np.maximum(likely.argmax(axis=1), np.minimum(best, int(np.searchsorted(ORDERS, CORNERS)))))


def _of_kind(terms: Array, seen: npt.NDArray[np.bool_], kind: npt.NDArray[np.bool_]) -> Array:
    """Sum over harmonics of a kind; where none was measured they are like the others, (r, sizes, orders)."""
    chosen = seen & kind
    chosen = np.where(chosen.any(axis=1, keepdims=True), chosen, seen)
    return np.asarray(np.einsum("rsoh,rh->rso", terms, chosen))


def _solve(sensing: Sensing, mean: Array, expected: Array) -> Solution:
    """Least squares for friction and for the error of the measured force, each with an expected size."""
    s = sensing.structure
    size = np.stack([expected, sensing.force_std], axis=2)
    columns = np.stack([sensing.by_friction, sensing.by_force], axis=3)
    A = sensing.weight[..., None] * columns * size[:, :, None]
    A_h = A.conj().swapaxes(2, 3)
    inverse = np.linalg.inv(np.eye(2) + A_h @ A)
    gain = size[..., None] * (inverse @ A_h)
    pushes = np.stack([s.slip_row, s.excitation])
    known = sensing.measured - sensing.by_force * sensing.force[..., None]

    coupling, change = np.zeros(sensing.stiffness.shape, dtype=complex), np.inf
    for _ in range(MOST_ITERATIONS):
        left = sensing.weight * (known - sensing.by_modal_forces(coupling))
        found = (gain @ left[..., None])[..., 0]
        friction, force = found[..., 0].copy(), sensing.force + found[..., 1]
        friction[:, 0] = mean
        q = (np.stack([friction, force], axis=2) @ pushes + coupling) / sensing.stiffness
        before, coupling = coupling, nonlinear_forces(sensing, friction, q)
        last, change = change, float(np.abs(coupling - before).max())
        still = change <= COUPLED * max(np.abs(friction).max(), np.finfo(float).tiny)
        if still or change > last:  # it grows where sensors contradict each other grossly: the misfit says so
            break
    root = size[..., None] * np.linalg.cholesky(inverse)
    leverage = np.einsum("rkci,rkij,rkcj->rkc", A, inverse, A.conj()).real
    scaled = (A @ (found / np.where(size > 0.0, size, 1.0))[..., None])[..., 0]
    seen = sensing.weight.any(axis=2)
    return Solution(
        friction=friction,
        force=force,
        q=q,
        factor=np.concatenate([root, np.swapaxes(pushes / sensing.stiffness[..., None, :], 2, 3) @ root], axis=2),
        residual=left - scaled,
        leverage=leverage,
        resolution=np.where(seen, np.linalg.norm(root[:, :, 0], axis=2), np.inf),
    )


def nonlinear_forces(sensing: Sensing, friction: Complex, q: Complex) -> Complex:
    """Forces -T G q of friction on the deflected structure, and those of nonlinear elements, (r, H+1, n)."""
    G, elements = sensing.structure.shortening, element_forces(sensing, q)[..., :-1]
    return elements - product(friction[..., None], q @ G) if G.any() else elements


def element_forces(sensing: Sensing, q: Complex) -> Complex:
    """Forces of nonlinear elements on the modes, and last on the support, (r, H+1, n+1); none reads the excitation."""
    r, H, n = len(q), sensing.H, q.shape[2]
    if not sensing.rig.elements:
        return np.zeros((r, H + 1, n + 1), dtype=complex)
    N = 1 << int(np.ceil(np.log2(8 * H + 1)))
    at, rate = (to_samples(s, N).reshape(r * N, n) for s in (q, sensing.i_omega[..., None] * q))
    forces = forces_in_time(sensing.rig, at, rate, np.zeros(r * N))
    both = np.column_stack([forces.on_modes, forces.on_support])
    return to_amplitudes(both.reshape(r, N, n + 1), H)


def product(a: Complex, b: Complex) -> Complex:
    """Amplitudes of the product of two series along axis 1, harmonics 0..H."""
    H = a.shape[1] - 1
    N = 1 << int(np.ceil(np.log2(3 * H + 2)))  # no alias reaches 0..H
    return to_amplitudes(to_samples(a, N) * to_samples(b, N), H)


def to_samples(amplitudes: Complex, N: int) -> Array:
    """Samples (r, N, ...) of Re sum c_k exp(i k theta) from amplitudes (r, H+1, ...)."""
    half = amplitudes / 2
    half[:, 0] = amplitudes[:, 0]
    return np.asarray(np.fft.irfft(half, N, axis=1) * N)


def to_amplitudes(samples: Array, H: int) -> Complex:
    """Amplitudes (r, H+1, ...) of samples (r, N, ...)."""
    amplitudes = np.fft.rfft(samples, axis=1)[:, : H + 1] * (2.0 / samples.shape[1])
    amplitudes[:, 0] /= 2.0
    return np.asarray(amplitudes)
