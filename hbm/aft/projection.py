"""From slopes at the samples of a period to those of Fourier coefficients.

Most friction has one state, an anchor that stays where it is or is dragged along, its past forgotten. Between those
events the period is linear: an anchor moves as it did where it was dragged last, and nothing is marched.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hbm.aft.recurrence import gradients
from hbm.fourier import Array, FourierBasis

ROUNDING = 1e-12
"""An anchor stays where its slope to itself is one and those to the inputs are none, to this fraction."""


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
    stays = _stays(local, outputs) if n == 1 else []
    if stays is None or n > 1:
        by_samples = gradients(local, outputs, basis.analysis, virgin)
        return [by @ shown.samples for by, shown in zip(by_samples, inputs, strict=True)]
    at_once = _at_once(local[:, :outputs, n:], basis)
    found = [by if shown.series is None else by @ shown.series for by, shown in zip(at_once, inputs, strict=True)]
    if stays:
        anchors = [begin for begin, _ in stays]
        pulled = np.stack([_sum_between(basis.analysis, local[:, :outputs, 0], *stay) for stay in stays], axis=2)
        for by, shown, dragged in zip(found, inputs, local[anchors, outputs, n:].T, strict=True):
            by += (pulled * dragged) @ shown.samples[anchors]
    return found


def _stays(local: Array, outputs: int) -> list[tuple[int, int]] | None:
    """Stretches over which an anchor stays: the samples around each, at which it is dragged.

    None where the state is no such anchor, or one that is never dragged.
    """
    kept, by_inputs = local[:, outputs, 0], local[:, outputs, 1:]
    dragged = np.flatnonzero(kept == 0.0)
    neither, squares = kept * kept - kept, by_inputs * by_inputs
    largest = _ones(len(local)) @ squares
    if not dragged.size or not neither @ neither < ROUNDING**2 or local[dragged, :outputs, 0].any():
        return None
    if (kept @ squares > ROUNDING**2 * largest).any():  # it drifts while it stays
        return None
    begins = np.flatnonzero(dragged[1:] - dragged[:-1] > 1)
    around = [(int(dragged[-1]), int(dragged[0]))] if dragged[-1] - dragged[0] < len(local) - 1 else []
    return [(int(dragged[i]), int(dragged[i + 1])) for i in begins] + around


@lru_cache(maxsize=32)
def _ones(N_t: int) -> Array:
    return np.ones(N_t)


def _sum_between(W: Array, slopes: Array, begin: int, end: int) -> Array:
    """Sum of W slopes (outputs, m) over the samples behind `begin` and before `end`, around the period."""
    if begin < end:
        return np.asarray((W[:, begin + 1 : end] @ slopes[begin + 1 : end]).T)
    return np.asarray((W[:, begin + 1 :] @ slopes[begin + 1 :] + W[:, :end] @ slopes[:end]).T)


def _at_once(slopes: npt.NDArray[np.float64], basis: FourierBasis) -> Array:
    """Slopes (N_t, outputs, inputs) to the inputs of the same sample, as (inputs, outputs, 2H+1, 2H+1)."""
    N_t, outputs, inputs = slopes.shape
    if N_t > 4 * basis.H:
        series = basis.doubled.coefficients(slopes.reshape(N_t, -1))
        matrices = basis.multiplication(series).reshape(basis.size**2, -1)
        return np.ascontiguousarray(matrices.T).reshape(outputs, inputs, basis.size, basis.size).swapaxes(0, 1)
    return np.asarray((np.ascontiguousarray(slopes.T)[:, :, None] * basis.analysis) @ basis.synthesis)
