"""Linear recurrences over the samples of a period: z_k = A_k z_(k-1) + ..., forwards and as adjoints.

A law over a period is told by its local slopes, (N_t, outputs + states, states + inputs): the derivatives of its
outputs and of its internal states after a sample to the states before it and to the inputs of the sample.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.linalg import lapack

from hbm.fourier import Array

FEW_STATES = 5
"""Up to so many internal states the recurrence is solved as one banded system, else sample by sample."""

ROUNDING = 1e-12
"""An anchor stays where its slope to itself is one and those to the inputs are none, to this fraction."""

NEUTRAL = 1e-9
"""A loop whose state returns undiminished to this accuracy never slips: its history decides its mean force."""


def monodromy(A: Array) -> Array:
    """Product of the state transitions (N, n, n) over a period."""
    if A.shape[1] == 1:
        return np.asarray(np.multiply.reduce(A[:, 0, 0])).reshape(1, 1)
    while len(A) > 1:  # pairwise, so that the products are batched
        pairs = A[1::2] @ A[: len(A) - 1 : 2]
        A = np.concatenate([pairs, A[-1:]]) if len(A) % 2 else pairs
    return np.asarray(A[0])


def radius(A: Array) -> float:
    """Spectral radius of the product of the state transitions; infinite where a law left the numbers."""
    over_period = monodromy(A)
    if not np.isfinite(over_period).all():
        return float("inf")
    return float(np.abs(over_period if len(over_period) == 1 else np.linalg.eigvals(over_period)).max(initial=0.0))


def gradients(local: Array, outputs: int, W: Array, virgin: Callable[[], Array]) -> Array:
    """Derivatives of W times each output to each sample of each input, of a loop that is steady.

    Parameters
    ----------
    local : (N_t, outputs + states, states + inputs) array
        Slopes along the steady period.
    outputs : int
    W : (m, N_t) array
    virgin : callable
        The slopes along the period before, from the virgin state. A contact that stays stuck remembers it.

    Returns
    -------
    (inputs, outputs, m, N_t) array
    """
    n = local.shape[1] - outputs
    steady = np.ascontiguousarray(local[:, :outputs, n:].T)[:, :, None] * W
    if n == 0:
        return steady
    c, A = local[:, :outputs, :n], local[:, outputs:, :n]
    if radius(A) < 1.0 - NEUTRAL:
        steady += _through_states(_periodic_adjoint(c, A, W), local[:, outputs:, n:], steady.shape)
        return steady
    lam = backwards(A, _sources(c, W))
    steady += _through_states(lam, local[:, outputs:, n:], steady.shape)
    before, right = virgin(), np.zeros(lam.shape)
    right[:, -1] = lam[:, 0]
    lam = backwards(before[:, outputs:, :n], right)
    steady += _through_states(lam, before[:, outputs:, n:], steady.shape)
    return steady


@dataclass(frozen=True, eq=False)
class Loop:
    """A loop that stays closed while what drives it changes a little; what this takes is worked out once.

    Attributes
    ----------
    local : (N_t, outputs + states, states + inputs) array
        Slopes along the steady period.
    outputs : int
    virgin : callable
        The slopes along the period before, from the virgin state. A contact that stays stuck remembers it.
    """

    local: Array
    outputs: int
    virgin: Callable[[], Array]

    @property
    def states(self) -> int:
        """Number of internal states."""
        return int(self.local.shape[1]) - self.outputs

    @cached_property
    def _open(self) -> Array | None:
        """1 less the product of the state transitions over a period; None where a loop returns undiminished."""
        over_period = monodromy(self.local[:, self.outputs :, : self.states])
        if not np.isfinite(over_period).all() or np.abs(np.linalg.eigvals(over_period)).max() >= 1.0 - NEUTRAL:
            return None
        return np.asarray(np.eye(self.states) - over_period)

    @cached_property
    def _before(self) -> "Loop":
        return Loop(self.virgin(), self.outputs, self.virgin)

    @cached_property
    def _of_anchors(self) -> sparse.csr_array | None:
        """Outputs (N_t outputs) by inputs (N_t inputs) where all states are anchors; None where one is not.

        An anchor follows from the sample that dragged it last alone: of this period, or of the one before, or where
        none of them drags it of the virgin one.
        """
        n, outputs = self.states, self.outputs
        dragged = last_dragged(self.local[:, outputs:])
        if dragged is None:
            return None
        last, by_inputs = dragged[-1], self.local[:, outputs:, n:]
        stuck = last < 0
        if stuck.any():
            first = last_dragged(self._before.local[:, outputs:])
            if first is None:
                return None
            last = np.where(stuck, first[-1], last)
            by_inputs = np.where(stuck[:, None], self._before.local[:, outputs:, n:], by_inputs)
        before = np.concatenate([last[None], dragged[:-1]])
        before = np.where(before < 0, last, before)
        k, i = np.nonzero(before >= 0)
        at, steps, inputs = before[k, i], np.arange(len(before)), by_inputs.shape[2]
        pulled = self.local[k, :outputs, i][:, :, None] * by_inputs[at, i][:, None]
        rows = np.concatenate([k, steps])[:, None, None] * outputs + np.arange(outputs)[:, None]
        columns = np.concatenate([at, steps])[:, None, None] * inputs + np.arange(inputs)
        values = np.concatenate([pulled, self.local[:, :outputs, n:]])
        entries = values.ravel(), tuple(np.broadcast_to(a, values.shape).ravel() for a in (rows, columns))
        return sparse.csr_array(entries, shape=(len(before) * outputs, len(before) * inputs))

    def changed(self, inputs: Array) -> Array:
        """Change of the outputs (N_t, outputs, c) with inputs (N_t, inputs, c)."""
        if self._of_anchors is not None:
            N_t, sizes, c = inputs.shape
            return np.asarray((self._of_anchors @ inputs.reshape(N_t * sizes, c)).reshape(N_t, self.outputs, c))
        n = self.states
        driven, begin = np.matmul(self.local[:, :, n:], inputs), np.zeros((n, inputs.shape[2]))
        if self._open is None:
            before = self._before
            begin = before._states(begin, np.matmul(before.local[:, self.outputs :, n:], inputs))[-1]
        else:
            begin = np.linalg.solve(self._open, self._states(begin, driven[:, self.outputs :])[-1])
        z = self._states(begin, driven[:, self.outputs :])
        return np.asarray(driven[:, : self.outputs] + np.matmul(self.local[:, : self.outputs, :n], z[:-1]))

    def _states(self, start: Array, driven: Array) -> Array:
        """Change (N_t + 1, states, c) of the states over a period from `start` (states, c)."""
        return forwards(self.local[:, self.outputs :, : self.states], start, driven)


def last_dragged(after: Array) -> npt.NDArray[np.intp] | None:
    """Number of the last sample that dragged each of some anchors, -1 for none.

    Parameters
    ----------
    after : (N_t, n, n + inputs) array
        Slopes of the states after a sample to those before it and to its inputs.

    Returns
    -------
    (N_t, n) array of int or None
        None where a state is no anchor, that either stays where it is or is dragged along, its past forgotten; or acts
        on another one.
    """
    n = after.shape[1]
    inputs = range(n, after.shape[2])
    if not apart(after[:, :, :n]) or not all(is_anchor(after[:, i, [i, *inputs]]) for i in range(n)):
        return None
    dragged = ~stays(np.diagonal(after[:, :, :n], axis1=1, axis2=2))
    return np.maximum.accumulate(np.where(dragged, np.arange(len(after))[:, None], -1), axis=0)


def is_anchor(own: Array) -> bool:
    """Whether a state with slopes (N_t, 1 + inputs) to itself and its inputs stays at a sample or is dragged along."""
    kept, *by_inputs = np.ascontiguousarray(own.T)
    neither = kept * kept - kept
    if not neither @ neither < ROUNDING**2:
        return False
    for by_input in by_inputs:
        drift = kept * by_input
        if drift @ drift > ROUNDING**2 * (by_input @ by_input):
            return False
    return True


def stays(kept: Array) -> npt.NDArray[np.bool_]:
    """Whether an anchor with these slopes to itself, one or none, stays where it is."""
    return kept > 0.5


def backwards(A: Array, right: Array) -> Array:
    """Solve lambda_{k-1} = right_k + A_k' lambda_k from the last sample to the first.

    Parameters
    ----------
    A : (N_t, n_z, n_z) array
        dz_k / dz_{k-1}.
    right : (m, N_t + 1, n_z) array
        Right sides of m outputs, the last for behind the last sample; overwritten.

    Returns
    -------
    (m, N_t + 1, n_z) array
        lambda in the order of time; the first stands before the first sample.
    """
    N_t, n_z = A.shape[:2]
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
    if n_z > FEW_STATES and apart(A):
        alone = [forwards(A[:, i : i + 1, i : i + 1], start[i : i + 1], driven[:, i : i + 1]) for i in range(n_z)]
        return np.concatenate(alone, axis=1)
    z = np.concatenate([start[None], driven])
    if n_z > FEW_STATES:
        for before, after, transition in zip(z, z[1:], A, strict=False):
            after += transition @ before
        return z
    band = np.zeros(((N_t + 1) * n_z, 2 * n_z)).T  # unit lower triangular, stored by columns
    for i in range(n_z):
        for j in range(n_z):
            band[n_z + i - j, j : N_t * n_z : n_z] = -A[:, i, j]
    return _solved(band, np.ascontiguousarray(z.transpose(2, 0, 1)), "L").transpose(1, 2, 0)


def apart(A: Array) -> bool:
    """Whether no state acts on another one: elements side by side."""
    return not A[:, ~np.eye(A.shape[1], dtype=bool)].any()


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
    if n_z == 1:
        decay = np.multiply.accumulate(A[::-1, 0, 0])[::-1]  # from behind the last sample to before each
        seed = lam[:, 0, 0] / (1.0 - decay[0])
        begin = int(np.argmax(decay != 0.0))  # nothing passes a sample that slips
        if decay[begin] != 0.0:
            lam[:, begin:-1, 0] += np.multiply.outer(seed, decay[begin:])
        lam[:, -1, 0] += seed
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
