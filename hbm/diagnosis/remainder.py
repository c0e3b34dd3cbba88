"""The misfit that a model leaves: how much was explained, how large the rest is, where it is, how it looks."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from hbm.diagnosis.misfit import NOISE_KNOWN, nrmse
from hbm.outputerror.background import LARGEST
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.groups import near_each_other
from hbm.outputerror.whitened import Whitened

BAND, LEVEL = 1.5, 1.12
"""Records are of one band, and of one level, whose frequencies, and forces, follow by less than this factor."""

TELLING, MOST = 0.15, 3
"""Parts are named that hold this share of what remains, and so many at most."""

NEARLY_ALL = 0.999
"""More is not told apart."""

LEFT = 0.7
"""Share of what one cause leaves that a second one may leave of it, at most, where nothing more is asked for."""

NOISE = 5.0
"""Chi2 that noise makes is known to so many standard deviations."""

UNTESTED = "The records held out do not test the cause: noise alone is left of them without it, too. "

TOGETHER = 0.6
"""Share of one channel from which on it is said to be the one that reads otherwise."""


UNLIKE = "noise variances), but not spread like it"
"""What is said of a remainder that is no larger than noise as a whole, and improbable by noise in some part."""


@dataclass(frozen=True)
class Remainder:
    """The misfit that the model chosen leaves.

    That of the records fitted; of those held out where a cause was named, and these alone are more than noise.

    Attributes
    ----------
    explained : dict of str to float
        Share of the misfit beyond noise that is explained, of the records fitted (train) and held out: of the rig file
        that the cause extends, calibrated or as it is. Without those held out where they do not test the cause.
    size : float
        Rms of what remains beyond noise, relative to the response.
    noise_variances : float
        Mean square of what remains, in standard deviations of the noise: 1 where noise alone is left.
    structured : bool
        Whether noise does not make the like of it.
    places : tuple of str
        Where it is, in words.
    harmonics : dict of int to float
        Share of what remains beyond noise by harmonic; those that count.
    untested : bool
        Whether records were held out that fit as well without the cause.
    missed : float
        Error of the records held out, relative to their response, where these alone are more than noise; else 0.
    uncertain : float
        Noise variances of the records held out where they are noise but for how uncertain the fitted numbers are; else
        0.
    """

    explained: Mapping[str, float]
    size: float
    noise_variances: float
    structured: bool
    places: tuple[str, ...] = ()
    harmonics: Mapping[int, float] = field(default_factory=dict)
    untested: bool = False
    missed: float = 0.0
    uncertain: float = 0.0

    @property
    def sentence(self) -> str:
        """All of it in words."""
        told = ", ".join(
            f"{nearly_all(share)} of the misfit on the records {where}"
            for where, share in zip(("fitted", "held out"), self.explained.values(), strict=False)
        )
        explained = f"Explained: {told}. " if told else ""
        explained += UNTESTED if self.untested else ""
        if not self.structured:
            return f"{explained}What remains is noise{self._held_out}."
        where = f": {'; '.join(self.places)}" if self.places else ""
        if self.missed:
            return (
                f"{explained}What remains is noise on the records fitted; those held out are missed by "
                f"{percent(self.size)} of the response ({self.noise_variances:.3g} noise variances){where}."
            )
        if not self.size:
            return f"{explained}What remains is no larger than noise ({self.noise_variances:.3g} {UNLIKE}{where}."
        return (
            f"{explained}What remains is {percent(self.size)} of the response ({self.noise_variances:.3g} noise "
            f"variances) and more than noise{where}."
        )

    @property
    def _held_out(self) -> str:
        """What of the records held out is not noise as it stands, where those fitted are noise."""
        if self.missed:
            return f" on the records fitted; those held out are missed by {percent(self.missed)}"
        if self.uncertain:
            return (
                f"; those held out leave {self.uncertain:.3g} noise variances, no more than the fitted numbers are "
                "uncertain by"
            )
        return ""

    def json(self) -> dict[str, Any]:
        """As in a diagnosis file."""
        return {
            "explained": dict(self.explained),
            "size": self.size,
            "noise_variances": self.noise_variances,
            "structured": self.structured,
            "places": list(self.places),
            "harmonics": {str(k): share for k, share in self.harmonics.items()},
            "sentence": self.sentence,
        }


def percent(share: float) -> str:
    """A share in per cent, to two digits; to three from a tenth on.

    >>> percent(0.00452), percent(0.998), percent(1.196)
    ('0.45 %', '99.8 %', '120 %')
    """
    return f"{100.0 * share:.{2 if share < 0.1 else 3}g} %"


def nearly_all(share: float) -> str:
    """A share in per cent, as far as it is told apart from all."""
    return "over 99.9 %" if share > NEARLY_ALL else percent(share)


def first_of(words: Sequence[str], most: int) -> str:
    """The first of some words, and how many more there are.

    >>> first_of(["a", "b", "c"], 2)
    'a, b and 1 more'
    """
    return ", ".join(words[:most]) + (f" and {len(words) - most} more" if len(words) > most else "")


def excess(white: Whitened) -> float:
    """Chi2 beyond noise, freedom charged for."""
    return max(white.charged - len(white), 0.0)


def beyond_noise(white: Whitened) -> float:
    """Rms misfit beyond noise, relative to the response."""
    return nrmse(white) * float(np.sqrt(excess(white) / max(white.charged, 1e-300)))


def explained(before: Whitened, after: Whitened) -> float:
    """Share of the misfit beyond noise that another model does not leave; 0 where there was none."""
    was = excess(before)
    return float(np.clip(1.0 - excess(after) / was, 0.0, 1.0)) if was > 0.0 else 0.0


def tells(before: Whitened, after: Whitened) -> bool:
    """Whether records tell a model from another: what the other takes is more than the chi2 of noise scatters by.

    The noise itself is the same beside both, so that the difference hardly depends on its draw.
    """
    return bool(before.charged - after.charged > np.sqrt(2.0 * len(before)))


def remainder(
    white: Whitened, campaign: Campaign, structured: bool, shares: Mapping[str, float], told: tuple[str, ...] = ()
) -> Remainder:
    """Work out the misfit that a model leaves of records.

    Parameters
    ----------
    white : Whitened
        Records beside the model, in standard deviations of the noise.
    campaign : Campaign
    structured : bool
        Whether it is more than noise.
    shares : mapping of str to float
        Explained, on the records fitted and held out.
    told : tuple of str
        What else shows its structure, in words.
    """
    if not structured:
        return Remainder(shares, 0.0, white.chi2 / len(white), False)
    places = (*told, *_records(white, campaign), *_channels(white, campaign), *_harmonics_said(white))
    return Remainder(shares, beyond_noise(white), white.chi2 / len(white), True, places, _by_harmonic(white))


def _by_harmonic(white: Whitened) -> dict[int, float]:
    parts = _shares(white, white.harmonic)
    return {int(k): share for k, share in sorted(parts.items(), key=lambda p: -p[1]) if share > TELLING}


def _harmonics_said(white: Whitened) -> Iterator[str]:
    told = list(_by_harmonic(white).items())[:MOST]
    if told:
        yield "by harmonic " + ", ".join(f"{k} ({share:.0%})" for k, share in told)


def _records(white: Whitened, campaign: Campaign) -> Iterator[str]:
    """Bands and levels that hold most of it."""
    records = [r for r in campaign.data.records if r.number in set(white.record.tolist())]
    bands = list(near_each_other(records, lambda r: r.hz, BAND))
    levels = list(near_each_other(records, lambda r: r.force, LEVEL))
    band_of = {r.number: i for i, band in enumerate(bands) for r in band}
    level_of = {r.number: i for i, level in enumerate(levels) for r in level}
    label = np.array([band_of[int(n)] * len(levels) + level_of[int(n)] for n in white.record])
    told = sorted(_shares(white, label).items(), key=lambda p: -p[1])[:MOST]
    if len(bands) * len(levels) == 1 or not told or told[0][1] < TELLING:
        return
    words = []
    for i, share in told:
        own = [r for r in bands[int(i) // len(levels)] if level_of[r.number] == int(i) % len(levels)]
        if share >= TELLING and own:
            force = float(np.mean([r.force for r in own]))
            words.append(
                f"{min(r.hz for r in own):.4g} to {max(r.hz for r in own):.4g} Hz at {force:.3g} N ({share:.0%})"
            )
    yield "most in records " + ", ".join(words)


def _channels(white: Whitened, campaign: Campaign) -> Iterator[str]:
    """Whether the structure moves otherwise, or a channel reads otherwise."""
    names, parts = campaign.data.channels, _shares(white, white.channel)
    if len(parts) < 2:
        return
    worst, share = max(parts.items(), key=lambda p: p[1])
    if share > TOGETHER:
        yield f"in channel {names[int(worst)]} ({share:.0%})"
    elif share < 2.0 / len(parts):
        yield "alike in all channels"


def _shares(white: Whitened, labels: npt.NDArray[Any]) -> dict[Any, float]:
    """Share of chi2 beyond noise by label, of those that have any."""
    found, inverse = np.unique(labels, return_inverse=True)
    beyond = np.maximum(np.bincount(inverse.ravel(), white.residual**2 - 1.0), 0.0)
    whole = float(beyond.sum())
    return {label.item(): float(part) / whole for label, part in zip(found, beyond, strict=True)} if whole else {}


def within_noise(white: Whitened) -> bool:
    """Whether what a model leaves of records may be noise."""
    n = len(white)
    return bool(white.chi2 < (1 + NOISE_KNOWN) ** 2 * (n + NOISE * np.sqrt(2 * n)))


def negligible(white: Whitened) -> bool:
    """Whether what a model leaves of records may be noise, or is hardly more."""
    return beyond_noise(white) <= LARGEST or within_noise(white)
