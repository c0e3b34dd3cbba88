"""Flat tops: whether a sensor or an amplifier was clipped, and the words for it, of steady states, decays and hits."""

import numpy as np
import numpy.typing as npt

from hbm.fourier import Array

RESOLVED = 1e-12
"""Part of the largest value that arithmetic resolves: values of one phase of a cosine that was computed are one."""

FLATTER = 5
"""Samples at a flat top over those beside it, at least; a cosine in steps has 2.4, of four steps as many."""

FEWEST, SHARE = 8, 0.003
"""Samples of a flat top: so many, and of a motion that goes on this part of all."""

BAND, BESIDE, ROUGHLY = 8.0, 4.0, 2.5
"""Width of a top that noise has roughened, in its standard deviations, how far what is beside it reaches in tops, and
samples at the top over those beside it, at least. Any other top is a parabola, of which there are as many; of one that
begins with a fourth power there are 2.4 times as many."""

SAME = 3
"""Samples of one value at an extreme, at least, where the noise makes values differ: hits are over in a few samples."""


def clipped(values: Array) -> bool:
    """Whether a channel is flat-topped: far more samples at its extreme than at the value next to it."""
    step = RESOLVED * float(np.max(np.abs(values))) or 1.0
    found, counts = np.unique(np.round(values / step), return_counts=True)
    fewest = max(FEWEST, SHARE * len(values))

    def flat(top: int, beside: int) -> bool:
        return bool(top >= max(fewest, FLATTER * beside))

    return len(found) > 2 and (flat(*counts[-1:-3:-1]) or flat(*counts[:2]))


def between_tops(values: Array) -> npt.NDArray[np.bool_]:
    """Which samples of a channel are at neither of its extremes."""
    within = RESOLVED * float(np.max(np.abs(values)))
    return np.asarray((values < values.max() - within) & (values > values.min() + within))


def clipped_from_rest(values: Array, noise: float) -> bool:
    """Whether a motion from rest to rest is flat-topped, also where noise was added to its tops.

    How long it rests says nothing: what counts is that it stays at its extreme and is hardly ever beside it.

    Parameters
    ----------
    values : (N,) array
        Less their mean at rest.
    noise : float
        Standard deviation at rest.
    """
    fine = 0.0 < float(np.diff(np.unique(values)).min(initial=np.inf)) < noise
    return any(_flat(side, noise) or (fine and _stuck(side, noise)) for side in (values, -values))


def _stuck(values: Array, noise: float) -> bool:
    """Whether the largest values are one, and few are beside it, in spite of noise that the converter resolves."""
    highest = float(values.max())
    same, near = (int(np.sum(highest - values < within)) for within in (RESOLVED * highest, BAND * noise))
    return same >= max(SAME, ROUGHLY * (near - same))


def _flat(values: Array, noise: float) -> bool:
    """Whether the largest values are a flat top."""
    highest = float(values.max())
    depth = highest - values
    lower = depth[depth > RESOLVED * highest]
    step = max(BAND * noise, float(lower.min(initial=np.inf)))  # or one of a coarse converter
    top: npt.NDArray[np.bool_] = depth < step
    beside = int(np.sum(depth < BESIDE * step)) - int(top.sum())
    stays = int(np.sum(top[:-2] & top[1:-1] & top[2:]))
    return highest > BESIDE * step and stays >= FEWEST and int(top.sum()) >= ROUGHLY * beside


def flat_topped(channel: str, when: str = "") -> str:
    """What is said of a channel that is clipped, and when."""
    return f"{channel} is flat-topped{when}: was it clipped?"
