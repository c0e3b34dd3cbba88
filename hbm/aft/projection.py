"""From slopes at the samples of a period to those of Fourier coefficients.

Most friction has one state or several side by side, anchors that stay where they are or are dragged along, their past
forgotten. Between those events the period is linear: an anchor moves as it did where it was dragged last, and nothing
is marched.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hbm.aft.recurrence import anchored, gradients, stays
from hbm.aft.slopes import Slopes
from hbm.fourier import Array, FourierBasis


class Shown(NamedTuple):
    """An input of a law, for units of what makes it up.

    Attributes
    ----------
    samples : (N_t, c) array
    series : (2H+1, c) array or None
        Their coefficients; None where these themselves make it up.
    """

    samples: Array
    series: Array | None


@lru_cache(maxsize=32)
def shown(basis: FourierBasis) -> tuple[Shown, Shown, Shown]:
    """A signal at a sample, the signal at the sample before, and what is the same at all samples."""
    earlier, ever = np.roll(basis.synthesis, 1, axis=0), np.ones((basis.N_t, 1))
    return (
        Shown(basis.synthesis, None),
        Shown(earlier, basis.analysis @ earlier),
        Shown(ever, basis.analysis @ ever),
    )


def projected(
    slopes: Slopes, basis: FourierBasis, inputs: Sequence[Shown], virgin: Callable[[], Slopes]
) -> list[Array]:
    """Derivatives of the coefficients of each output to what makes up each input, of a loop that is steady.

    Parameters
    ----------
    slopes, virgin
        As for :func:`hbm.aft.recurrence.gradients`.
    basis : FourierBasis
    inputs : sequence of Shown

    Returns
    -------
    list of (outputs, 2H+1, c) arrays
    """
    pulls = _pulls(slopes, basis.analysis, virgin) if slopes.states else NONE
    if pulls is None:
        by_samples = gradients(slopes, basis.analysis, virgin)
        return [by @ shown.samples for by, shown in zip(by_samples, inputs, strict=True)]
    at_once = _at_once(slopes.outputs_by_inputs, basis)
    found = [by if shown.series is None else by @ shown.series for by, shown in zip(at_once, inputs, strict=True)]
    if len(pulls.samples):
        there = {id(shown): shown.samples[pulls.samples] for shown in inputs}
        for by, shown, followed in zip(found, inputs, pulls.followed.T, strict=True):
            by += pulls.force @ (followed[:, None] * there[id(shown)])
    return found


class Pulls(NamedTuple):
    """What anchors that were dragged, J times, do to the coefficients of the outputs while they then stay.

    Attributes
    ----------
    samples : (J,) array of int
        Which dragged them.
    followed : (J, inputs) array
        Derivatives of the anchor to the inputs of these samples.
    force : (outputs, m, J) array
        Derivatives of the coefficients to the anchor.
    """

    samples: npt.NDArray[np.intp]
    followed: Array
    force: Array


NONE = Pulls(np.zeros(0, dtype=np.intp), np.zeros((0, 0)), np.zeros((0, 0, 0)))


def _pulls(slopes: Slopes, W: Array, virgin: Callable[[], Slopes]) -> Pulls | None:
    """Where anchors were dragged and then stayed; None where a state is no such anchor."""
    anchors = anchored(slopes, virgin)
    if anchors is None:
        return None
    before, by_inputs = anchors
    if slopes.states == 1:
        return _pulls_of_one(slopes, W, int(before[0, 0]), by_inputs[:, 0])
    pull = slopes.outputs_by_states.transpose(2, 0, 1)
    state, k = np.nonzero(pull.any(axis=2) & (before.T >= 0))
    at = before[k, state]
    if not len(at):
        return NONE
    held = at + len(W.T) * state
    starts = np.append(0, 1 + np.flatnonzero(held[1:] != held[:-1]))
    there, which = at[starts], state[starts]
    force = np.add.reduceat(W[:, k] * pull[state, k].T[:, None], starts, axis=2)
    return Pulls(there, by_inputs[there, which], force)


def _pulls_of_one(slopes: Slopes, W: Array, last: int, by_inputs: Array) -> Pulls:
    """The same of a single anchor, dragged last before the period at a sample, -1 for none: a product for each stay."""
    pull, dragged = slopes.outputs_by_states[:, :, 0], np.flatnonzero(~stays(slopes.transitions[:, 0]))
    if not len(dragged):
        begins = [last] * (last >= 0)
        return Pulls(np.array(begins, dtype=np.intp), by_inputs[begins], (W @ pull).T[:, :, None][:, :, : len(begins)])
    pairs = [(int(dragged[i]), int(dragged[i + 1])) for i in np.flatnonzero(np.diff(dragged) > 1)]
    if dragged[-1] - dragged[0] < len(pull) - 1:
        pairs.append((int(dragged[-1]), int(dragged[0])))
    begins = [begin for begin, _ in pairs]
    force = np.array([_sum_between(W, pull, *pair) for pair in pairs]).reshape(-1, pull.shape[1], len(W))
    return Pulls(np.array(begins, dtype=np.intp), by_inputs[begins], force.transpose(1, 2, 0))


def _sum_between(W: Array, pull: Array, begin: int, end: int) -> Array:
    """Sum of W pull (outputs, m) over the samples behind `begin` and before `end`, around the period."""
    if begin < end:
        return np.asarray((W[:, begin + 1 : end] @ pull[begin + 1 : end]).T)
    return np.asarray((W[:, begin + 1 :] @ pull[begin + 1 :] + W[:, :end] @ pull[:end]).T)


def _at_once(slopes: npt.NDArray[np.float64], basis: FourierBasis) -> Array:
    """Slopes (N_t, outputs, inputs) to the inputs of the same sample, as (inputs, outputs, 2H+1, 2H+1)."""
    N_t, outputs, inputs = slopes.shape
    if N_t > 4 * basis.H and not basis.many:  # the map to products is as large as the square of a matrix's side
        series = basis.doubled.coefficients(slopes.reshape(N_t, -1))
        matrices = basis.multiplication(series).reshape(basis.size**2, -1)
        return np.ascontiguousarray(matrices.T).reshape(outputs, inputs, basis.size, basis.size).swapaxes(0, 1)
    return np.asarray((np.ascontiguousarray(slopes.T)[:, :, None] * basis.analysis) @ basis.synthesis)
