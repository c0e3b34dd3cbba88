"""Linear recurrences over the samples of a period: z_k = A_k z_(k-1) + ..., forwards and as adjoints.

Transitions A are (N_t, n, n), or (N_t, n) where no state acts on another one: then they have one diagonal each.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.linalg import lapack

from hbm.aft.slopes import FEW_STATES, Slopes
from hbm.fourier import Array

ROUNDING = 1e-12
"""An anchor stays where its slope to itself is one and those to the inputs are none, to this fraction."""

STRETCH, MOST_STATES = 64, 24
"""Samples of a stretch, and states up to which a recurrence is worth its being cut into some."""

NEUTRAL = 1e-9
"""A loop whose state returns undiminished to this accuracy never slips: its history decides its mean force."""


def monodromy(A: Array) -> Array:
    """Product (n, n) of the state transitions over a period."""
    if A.ndim == 2:
        return np.diag(np.multiply.reduce(A))
    while len(A) > 1:  # pairwise, so that the products are batched
        pairs = A[1::2] @ A[: len(A) - 1 : 2]
        A = np.concatenate([pairs, A[-1:]]) if len(A) % 2 else pairs
    return np.asarray(A[0])


def returns(A: Array) -> Array:
    """Magnitudes (n,) of the eigenvalues of the product of the transitions; infinite where a law left the numbers."""
    over_period = np.multiply.reduce(A) if A.ndim == 2 else monodromy(A)
    if not np.isfinite(over_period).all():
        return np.full(A.shape[1], np.inf)
    return np.abs(over_period if A.ndim == 2 else np.linalg.eigvals(over_period))


def radius(A: Array) -> float:
    """Spectral radius of the product of the state transitions; infinite where a law left the numbers."""
    return float(returns(A).max(initial=0.0))


def undying(A: Array) -> int:
    """How many disturbances of the states return undiminished after a period: anchors that stick."""
    return int(np.count_nonzero(returns(A) >= 1.0 - NEUTRAL))


def gradients(slopes: Slopes, W: Array, virgin: Callable[[], Slopes]) -> Array:
    """Derivatives of W times each output to each sample of each input, of a loop that is steady.

    Parameters
    ----------
    slopes : Slopes
        Along the steady period.
    W : (m, N_t) array
    virgin : callable
        The slopes along the period before, from the virgin state. A contact that stays stuck remembers it.

    Returns
    -------
    (inputs, outputs, m, N_t) array
    """
    steady = np.ascontiguousarray(slopes.outputs_by_inputs.T)[:, :, None] * W
    if slopes.states == 0:
        return steady
    c, A = slopes.outputs_by_states, slopes.transitions
    if radius(A) < 1.0 - NEUTRAL:
        steady += _through_states(_periodic_adjoint(c, A, W), slopes.states_by_inputs, steady.shape)
        return steady
    lam = backwards(A, _sources(c, W))
    steady += _through_states(lam, slopes.states_by_inputs, steady.shape)
    before, right = virgin(), np.zeros(lam.shape)
    right[:, -1] = lam[:, 0]
    lam = backwards(before.transitions, right)
    steady += _through_states(lam, before.states_by_inputs, steady.shape)
    return steady


@dataclass(frozen=True, eq=False)
class Loop:
    """A loop that stays closed while what drives it changes a little; what this takes is worked out once.

    Attributes
    ----------
    slopes : Slopes
        Along the steady period.
    virgin : callable
        The slopes along the period before, from the virgin state. A contact that stays stuck remembers it.
    often : bool
        Whether it is asked many times, for which a matrix is worth its making.
    """

    slopes: Slopes
    virgin: Callable[[], Slopes]
    often: bool = False

    @cached_property
    def _open(self) -> Array | None:
        """1 less the product of the state transitions over a period; None where a loop returns undiminished."""
        A = self.slopes.transitions
        return None if radius(A) >= 1.0 - NEUTRAL else np.asarray(np.eye(A.shape[1]) - monodromy(A))

    @cached_property
    def _before(self) -> "Loop":
        return Loop(self.virgin(), self.virgin, self.often)

    @cached_property
    def _stretches(self) -> "Stretches | None":
        """What many questions about states that act on one another are answered by."""
        A = self.slopes.transitions
        return Stretches.of(A) if self.often and A.ndim == 3 and FEW_STATES < A.shape[1] <= MOST_STATES else None

    @cached_property
    def _anchors(self) -> tuple[npt.NDArray[np.intp], Array] | None:
        """Where anchors stand, as :func:`anchored`; None where a state is none."""
        return anchored(self.slopes, lambda: self._before.slopes)

    def _dragged(self, before: npt.NDArray[np.intp], by_inputs: Array, inputs: Array) -> Array:
        """Change of the outputs (N_t, outputs, c) where all states are anchors."""
        states, c = before.shape[1], inputs.shape[2]
        moved = np.concatenate([by_inputs @ inputs, np.zeros((1, states, c))])  # the last for what nothing has dragged
        z = moved[before, np.arange(states)]
        return np.asarray(self.slopes.outputs_by_inputs @ inputs + self.slopes.outputs_by_states @ z)

    @cached_property
    def _of_anchors(self) -> sparse.csr_array:
        """Outputs (N_t outputs) by inputs (N_t inputs) where all states are anchors."""
        assert self._anchors is not None
        before, by_inputs = self._anchors
        k, i = np.nonzero(before >= 0)
        at, steps, inputs = before[k, i], np.arange(len(before)), by_inputs.shape[2]
        outputs = self.slopes.outputs
        pulled = self.slopes.outputs_by_states[k, :, i][:, :, None] * by_inputs[at, i][:, None]
        rows = np.concatenate([k, steps])[:, None, None] * outputs + np.arange(outputs)[:, None]
        columns = np.concatenate([at, steps])[:, None, None] * inputs + np.arange(inputs)
        values = np.concatenate([pulled, self.slopes.outputs_by_inputs])
        entries = values.ravel(), tuple(np.broadcast_to(a, values.shape).ravel() for a in (rows, columns))
        return sparse.csr_array(entries, shape=(len(before) * outputs, len(before) * inputs))

    def changed(self, inputs: Array) -> Array:
        """Change of the outputs (N_t, outputs, c) with inputs (N_t, inputs, c)."""
        slopes, n, (N_t, sizes, c) = self.slopes, self.slopes.states, inputs.shape
        if self._anchors is not None and self.often:
            return np.asarray((self._of_anchors @ inputs.reshape(N_t * sizes, c)).reshape(N_t, slopes.outputs, c))
        if self._anchors is not None:
            return self._dragged(*self._anchors, inputs)
        begin = np.zeros((n, c))
        if self._open is None:
            begin = self._before._states(begin, inputs)[-1]
        else:
            begin = np.linalg.solve(self._open, self._states(begin, inputs)[-1])
        z = self._states(begin, inputs)
        return np.asarray(slopes.outputs_by_inputs @ inputs + slopes.outputs_by_states @ z[:-1])

    def _states(self, start: Array, inputs: Array) -> Array:
        """Change (N_t + 1, states, c) of the states over a period from `start` (states, c)."""
        driven = self.slopes.states_by_inputs @ inputs
        if self._stretches is not None:
            return self._stretches.states(start, driven)
        return forwards(self.slopes.transitions, start, driven)


@dataclass(frozen=True, eq=False)
class Stretches:
    """A recurrence cut into stretches that are followed side by side, a sample of each at a time, and then joined.

    Attributes
    ----------
    transitions : (STRETCH, s, n, n) array
        Of each sample of s stretches; the last one is filled up with samples at which nothing happens.
    reached : (STRETCH, s, n, n) array
        Their products from the beginning of each stretch on.
    """

    transitions: Array
    reached: Array

    @classmethod
    def of(cls, A: Array) -> "Stretches":
        """Those of transitions (N_t, n, n)."""
        count, n = -(-len(A) // STRETCH), A.shape[1]
        filled = np.concatenate([A, np.broadcast_to(np.eye(n), (count * STRETCH - len(A), n, n))])
        transitions = np.ascontiguousarray(filled.reshape(count, STRETCH, n, n).swapaxes(0, 1))
        reached = transitions.copy()
        for before, after, transition in zip(reached, reached[1:], transitions[1:], strict=False):
            np.matmul(transition, before, out=after)
        return cls(transitions, reached)

    def states(self, start: Array, driven: Array) -> Array:
        """As :func:`forwards`."""
        length, count = self.transitions.shape[:2]
        N_t, n, c = driven.shape
        filled = np.concatenate([driven, np.zeros((count * length - N_t, n, c))])
        z = np.ascontiguousarray(filled.reshape(count, length, n, c).swapaxes(0, 1))  # from rest in each stretch
        for before, after, transition in zip(z, z[1:], self.transitions[1:], strict=False):
            after += transition @ before
        begins = np.empty((count, n, c))
        begins[0] = start
        for i in range(count - 1):
            begins[i + 1] = self.reached[-1, i] @ begins[i] + z[-1, i]
        z += self.reached @ begins
        return np.concatenate([start[None], z.swapaxes(0, 1).reshape(-1, n, c)[:N_t]])


def anchored(slopes: Slopes, virgin: Callable[[], Slopes]) -> tuple[npt.NDArray[np.intp], Array] | None:
    """Where anchors stand: each follows from the sample that dragged it last alone.

    That is one of this period, or of the one before, or where none of them drags it of the virgin one.

    Parameters
    ----------
    slopes, virgin
        As for :func:`gradients`.

    Returns
    -------
    (N_t, states) array of int
        Number of the sample that dragged each anchor last before each sample, -1 for none.
    (N_t, states, inputs) array
        Slopes of the anchors to the inputs of these samples.

    None where a state is no anchor.
    """
    dragged = last_dragged(slopes)
    if dragged is None:
        return None
    last, by_inputs = dragged[-1], slopes.states_by_inputs
    stuck = last < 0
    if stuck.any():
        first = virgin()
        dragged_first = last_dragged(first)
        if dragged_first is None:
            return None
        last = np.where(stuck, dragged_first[-1], last)
        by_inputs = np.where(stuck[:, None], first.states_by_inputs, by_inputs)
    before = np.concatenate([last[None], dragged[:-1]])
    return np.where(before < 0, last, before), by_inputs


def last_dragged(slopes: Slopes) -> npt.NDArray[np.intp] | None:
    """Number of the last sample that dragged each of some anchors, (N_t, states), -1 for none.

    None where a state is no anchor, that either stays where it is or is dragged along, its past forgotten; or acts on
    another one.
    """
    kept, by_inputs = slopes.transitions, slopes.states_by_inputs
    if kept.ndim == 3:
        return None
    neither, drift = kept * kept - kept, kept[:, :, None] * by_inputs
    if neither.any() and not (_squares(neither) < ROUNDING**2).all():
        return None
    if drift.any() and (_squares(drift) > ROUNDING**2 * _squares(by_inputs)).any():
        return None
    return np.maximum.accumulate(np.where(stays(kept), -1, np.arange(len(kept))[:, None]), axis=0)


def stays(kept: Array) -> npt.NDArray[np.bool_]:
    """Whether an anchor with these slopes to itself, one or none, stays where it is."""
    return kept > 0.5


def _squares(a: Array) -> Array:
    """Sum of the squares over the samples, (N_t, ...) to (...)."""
    return np.asarray(np.einsum("k...,k...->...", a, a))


def backwards(A: Array, right: Array) -> Array:
    """Solve lambda_{k-1} = right_k + A_k' lambda_k from the last sample to the first.

    Parameters
    ----------
    A : (N_t, n_z, n_z) or (N_t, n_z) array
        dz_k / dz_{k-1}.
    right : (m, N_t + 1, n_z) array
        Right sides of m outputs, the last for behind the last sample; overwritten.

    Returns
    -------
    (m, N_t + 1, n_z) array
        lambda in the order of time; the first stands before the first sample.
    """
    N_t, n_z = A.shape[:2]
    if A.ndim == 2:
        band = np.zeros((n_z * (N_t + 1), 2))  # the chain of a state ends where that of the next begins
        band.reshape(n_z, N_t + 1, 2)[:, 1:, 0] = -A.T
        return _solved(band.T, np.ascontiguousarray(right.transpose(0, 2, 1)), "U").transpose(0, 2, 1)
    if n_z > FEW_STATES:
        lam = np.ascontiguousarray(right.transpose(1, 0, 2))
        for before, after, transition in zip(lam[-2::-1], lam[::-1], A[::-1], strict=False):
            before += after @ transition
        return lam.transpose(1, 0, 2)
    band = np.zeros(((N_t + 1) * n_z, 2 * n_z)).T  # unit upper triangular, stored by columns
    for i in range(n_z):
        for j in range(n_z):
            band[n_z - 1 + i - j, n_z + j :: n_z] = -A[:, j, i]
    return _solved(band, right, "U")


def forwards(A: Array, start: Array, driven: Array) -> Array:
    """States (N_t + 1, n_z, p) of z_k = A_k z_{k-1} + driven_k from `start` (n_z, p)."""
    N_t, n_z = A.shape[:2]
    z = np.concatenate([start[None], driven])
    if A.ndim == 2:
        band = np.zeros((n_z * (N_t + 1), 2))
        band.reshape(n_z, N_t + 1, 2)[:, :-1, 1] = -A.T
        return _solved(band.T, np.ascontiguousarray(z.transpose(2, 1, 0)), "L").transpose(2, 1, 0)
    if n_z > FEW_STATES:
        for before, after, transition in zip(z, z[1:], A, strict=False):
            after += transition @ before
        return z
    band = np.zeros(((N_t + 1) * n_z, 2 * n_z)).T  # unit lower triangular, stored by columns
    for i in range(n_z):
        for j in range(n_z):
            band[n_z + i - j, j : N_t * n_z : n_z] = -A[:, i, j]
    return _solved(band, np.ascontiguousarray(z.transpose(2, 0, 1)), "L").transpose(1, 2, 0)


def _solved(band: Array, right: Array, triangle: str) -> Array:
    """Solve a unit triangular banded system for every row of `right`, which is overwritten."""
    solution, _ = lapack.dtbtrs(band, right.reshape(len(right), -1).T, uplo=triangle, diag="U", overwrite_b=1)
    return np.asarray(solution.T.reshape(right.shape))


def _sources(c: Array, W: Array) -> Array:
    """Right sides c_k W_k of outputs with slopes c (N_t, outputs, n_z) to the states, (outputs m, N_t + 1, n_z)."""
    N_t, outputs, n_z = c.shape
    right = np.empty((outputs, len(W), N_t + 1, n_z))
    np.multiply(W[:, :, None], c.transpose(1, 0, 2)[:, None], out=right[:, :, :-1])
    right[:, :, -1] = 0.0
    return right.reshape(-1, N_t + 1, n_z)


def _periodic_adjoint(c: Array, A: Array, W: Array) -> Array:
    """Adjoint states of a loop that closes: those behind the last sample stand before the first."""
    n_z = A.shape[1]
    lam = backwards(A, _sources(c, W))
    if A.ndim == 2:
        decay = np.multiply.accumulate(A[::-1])[::-1]  # from behind the last sample to before each
        seed = lam[:, :1] / (1.0 - decay[0])
        lam[:, :-1] += seed * decay
        lam[:, -1:] += seed
    else:
        right = np.zeros((n_z, len(A) + 1, n_z))
        right[:, -1] = np.eye(n_z)
        decay = backwards(A, right)
        seed = np.linalg.solve(np.eye(n_z) - decay[:, 0].T, lam[:, 0].T).T
        lam += np.tensordot(seed, decay, axes=1)
    return lam


def _through_states(lam: Array, by_inputs: Array, shape: tuple[int, ...]) -> Array:
    """Chain adjoint states (outputs m, N_t + 1, n_z) with the slopes (N_t, n_z, inputs) of the states to the inputs."""
    if lam.shape[2] == 1:
        chained = np.ascontiguousarray(by_inputs[:, 0].T)[:, None] * lam[:, 1:, 0]
    else:
        chained = np.matmul(lam[:, 1:].transpose(1, 0, 2), by_inputs).transpose(2, 1, 0)
    return chained.reshape(shape)
