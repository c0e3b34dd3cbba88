"""From slopes at the samples of a period to those of Fourier coefficients.

Most friction has one state or several side by side, anchors that stay where they are or are dragged along, their past
forgotten. Between those events the period is linear: an anchor moves as it did where it was dragged last, and nothing
is marched.
"""

from collections.abc import Callable, Sequence
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hbm.aft.recurrence import apart, gradients, is_anchor, stays
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
    local: Array, outputs: int, basis: FourierBasis, inputs: Sequence[Shown], virgin: Callable[[], Array]
) -> list[Array]:
    """Derivatives of the coefficients of each output to what makes up each input, of a loop that is steady.

    Parameters
    ----------
    local, outputs, virgin
        As for :func:`hbm.aft.recurrence.gradients`.
    basis : FourierBasis
    inputs : sequence of Shown

    Returns
    -------
    list of (outputs, 2H+1, c) arrays
    """
    n = local.shape[1] - outputs
    anchors = _anchors(local, outputs, basis.analysis, virgin)
    if anchors is None:
        by_samples = gradients(local, outputs, basis.analysis, virgin)
        return [by @ shown.samples for by, shown in zip(by_samples, inputs, strict=True)]
    at_once = _at_once(local[:, :outputs, n:], basis)
    found = [by if shown.series is None else by @ shown.series for by, shown in zip(at_once, inputs, strict=True)]
    for pulls in anchors:
        if not len(pulls.samples):
            continue
        there = {id(shown): shown.samples[pulls.samples] for shown in inputs}
        force = pulls.force.reshape(len(pulls.force), -1).T
        for by, shown, followed in zip(found, inputs, pulls.followed.T, strict=True):
            by += (force @ (followed[:, None] * there[id(shown)])).reshape(by.shape)
    return found


class Pulls(NamedTuple):
    """What an anchor that was dragged at J samples does to the coefficients of the outputs while it then stays.

    Attributes
    ----------
    samples : sequence of J int
    followed : (J, inputs) array
        Derivatives of the anchor to the inputs of these samples.
    force : (J, outputs, m) array
        Derivatives of the coefficients to the anchor.
    """

    samples: Sequence[int]
    followed: Array
    force: Array


def _anchors(local: Array, outputs: int, W: Array, virgin: Callable[[], Array]) -> list[Pulls] | None:
    """What each of the states does that is an anchor; None where they are others, or act on each other."""
    n = local.shape[1] - outputs
    if n == 1:
        alone = _pulls(local, outputs, W, virgin)
        return None if alone is None else [alone]
    if n and not apart(local[:, outputs:, :n]):
        return None
    found, first = list[Pulls](), cache(virgin)
    for i in range(n):
        of = np.ix_(range(len(local)), [*range(outputs), outputs + i], [i, *range(n, local.shape[2])])
        pulls = _pulls(local[of], outputs, W, lambda of=of: first()[of])  # type: ignore[misc]
        if pulls is None:
            return None
        found.append(pulls)
    return found


def _pulls(local: Array, outputs: int, W: Array, virgin: Callable[[], Array]) -> Pulls | None:
    """Where an anchor was dragged and then stayed; None where the state is no such anchor."""
    if not _is_anchor(local, outputs):
        return None
    dragged, slopes = _dragged(local, outputs), local[:, :outputs, 0]
    if len(dragged):
        stays = [(int(dragged[i]), int(dragged[i + 1])) for i in np.flatnonzero(dragged[1:] - dragged[:-1] > 1)]
        if dragged[-1] - dragged[0] < len(local) - 1:
            stays.append((int(dragged[-1]), int(dragged[0])))
        begins = [begin for begin, _ in stays]
        force = np.array([_sum_between(W, slopes, *stay) for stay in stays]).reshape(-1, outputs, len(W))
        return Pulls(begins, local[begins, outputs, 1:], force)
    held, first = np.asarray((W @ slopes).T), virgin()
    if not _is_anchor(first, outputs):
        return None
    last = _dragged(first, outputs)[-1:]
    return Pulls(last.tolist(), first[last, outputs, 1:], held[None][: len(last)])


def _is_anchor(local: Array, outputs: int) -> bool:
    """Whether the state is an anchor whose place before does not act where it is dragged."""
    dragged = ~stays(local[:, outputs, 0])
    return is_anchor(local[:, outputs]) and not (local[:, :outputs, 0].T * dragged).any()


def _dragged(local: Array, outputs: int) -> npt.NDArray[np.intp]:
    return np.flatnonzero(~stays(local[:, outputs, 0]))


def _sum_between(W: Array, slopes: Array, begin: int, end: int) -> Array:
    """Sum of W slopes (outputs, m) over the samples behind `begin` and before `end`, around the period."""
    if begin < end:
        return np.asarray((W[:, begin + 1 : end] @ slopes[begin + 1 : end]).T)
    return np.asarray((W[:, begin + 1 :] @ slopes[begin + 1 :] + W[:, :end] @ slopes[:end]).T)


def _at_once(slopes: npt.NDArray[np.float64], basis: FourierBasis) -> Array:
    """Slopes (N_t, outputs, inputs) to the inputs of the same sample, as (inputs, outputs, 2H+1, 2H+1)."""
    N_t, outputs, inputs = slopes.shape
    if N_t > 4 * basis.H and not basis.many:  # the map to products is as large as the square of a matrix's side
        series = basis.doubled.coefficients(slopes.reshape(N_t, -1))
        matrices = basis.multiplication(series).reshape(basis.size**2, -1)
        return np.ascontiguousarray(matrices.T).reshape(outputs, inputs, basis.size, basis.size).swapaxes(0, 1)
    return np.asarray((np.ascontiguousarray(slopes.T)[:, :, None] * basis.analysis) @ basis.synthesis)
