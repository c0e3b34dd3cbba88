"""Resolution of the harmonics of friction by the sensors, over all records, and the share that the prior adds."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from hbm.fourier import Array
from hbm.inverse.contactforce import ForceEstimate, last_counted

UNRESOLVED = 1.0
"""A harmonic is not resolved whose standard deviation by the sensors exceeds this share of its size."""

ILL_CONDITIONED = 30.0
"""Condition number from which friction and excitation are hard to tell apart."""

HALF = 0.5
"""Share of the records in which a harmonic must be unresolved to be named."""

RELEVANT = 0.01
"""Unresolved harmonics are named where they add this share of friction's rms to its uncertainty."""

MOST_ABOVE = 0.5
"""Harmonics above those measured are named where they may be this share of friction's rms."""


@dataclass(frozen=True, eq=False)
class Resolution:
    """Uncertainty of harmonics 1..H of friction, medians over records.

    Attributes
    ----------
    size : (H,) array
        Size of the estimate: rms of cosine and sine [N].
    by_sensors : (H,) array
        Standard deviation by the sensors alone, of each of cosine and sine; inf where nothing was measured [N].
    std : (H,) array
        The same with the prior [N].
    prior_share : (H,) array
        Share of the information that is the prior's, 0..1.
    condition : (H,) array
        Condition number of telling friction from the excitation.
    unresolved : (H,) array
        Share of the records in which the sensors do not resolve the harmonic.
    above : float
        What may be above harmonic H, as the prior expects, rms [N].
    records : int
    """

    size: Array
    by_sensors: Array
    std: Array
    prior_share: Array
    condition: Array
    unresolved: Array
    above: float
    records: int

    @property
    def warnings(self) -> tuple[str, ...]:
        """At most four lines on what the sensors do not resolve."""
        return tuple(self._lines())

    def _lines(self) -> Iterator[str]:
        total = np.linalg.norm(self.size)
        poor = np.flatnonzero((self.unresolved > HALF) & np.isfinite(self.by_sensors))
        adds = float(np.linalg.norm(self.std[poor]))
        if adds > RELEVANT * total:
            k = poor[np.argmax(self.by_sensors[poor])]
            yield (
                f"{harmonics(poor)} of friction: not resolved in most of {self.records} records, {adds:.2g} N of "
                f"uncertainty beside {total:.2g} N rms; the worst, {k + 1}: the sensors resolve "
                f"{self.by_sensors[k]:.2g} N of {self.size[k]:.2g} N (condition {self.condition[k]:.2g}), "
                f"{100 * self.prior_share[k]:.0f} % rests on the prior"
            )
        ill = np.flatnonzero((self.condition > ILL_CONDITIONED) & np.isfinite(self.condition))
        if len(ill):
            k = ill[np.argmax(self.condition[ill])]
            yield (
                f"{harmonics(ill)}: friction and excitation are hard to tell apart, condition up to "
                f"{self.condition[k]:.3g}; the sensors resolve {self.by_sensors[k]:.2g} N of {self.size[k]:.2g} N there"
            )
        unseen = np.flatnonzero(np.isinf(self.by_sensors))
        if len(unseen):
            yield (
                f"{harmonics(unseen)} of friction: measured by no sensor; zero to "
                f"{np.linalg.norm(self.std[unseen]):.2g} N rms beside {total:.2g} N, as the prior expects"
            )
        if self.above > MOST_ABOVE * total:
            alone = "were" if len(self.size) > 1 else "was"
            yield (
                f"{harmonics(range(len(self.size)))} alone {alone} measured; friction above may be up to "
                f"{self.above:.2g} N rms beside {total:.2g} N, as the prior expects: its shape and peak are not known"
            )


def harmonics(places: Iterable[int]) -> str:
    """Harmonics in words, from their places, which count from 0.

    >>> harmonics([1, 2, 3, 4, 6])
    'harmonics 2..5, 7'
    """
    groups: list[list[int]] = []
    for k in places:
        if groups and groups[-1][-1] == k:
            groups[-1].append(int(k) + 1)
        else:
            groups.append([int(k) + 1])
    listed = ", ".join(f"{g[0]}..{g[-1]}" if len(g) > 2 else ", ".join(map(str, g)) for g in groups)
    return f"harmonic{'s' if sum(map(len, groups)) > 1 else ''} {listed}"


def resolution_of(estimate: ForceEstimate) -> Resolution:
    """Work out what an estimate of the friction force resolves."""
    size = np.abs(estimate.friction[:, 1:]) / np.sqrt(2.0)
    by_sensors, std = estimate.resolution[:, 1:], np.linalg.norm(estimate.factor[:, 1:, 0], axis=2)
    poor = by_sensors > UNRESOLVED * size
    known = np.where(np.isfinite(by_sensors), by_sensors, np.inf)
    H = size.shape[1]
    above = np.linalg.norm(estimate.expected(np.arange(H + 1, last_counted(H) + 1)), axis=1)
    return Resolution(
        size=np.median(size, axis=0),
        by_sensors=np.median(by_sensors, axis=0),
        std=np.median(std, axis=0),
        prior_share=np.median(np.clip(1.0 - (std / known) ** 2, 0.0, 1.0), axis=0),
        condition=np.median(estimate.condition[:, 1:], axis=0),
        unresolved=poor.mean(axis=0),
        above=float(np.median(above)),
        records=len(size),
    )
