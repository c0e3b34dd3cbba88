"""What is known of the accuracy of a curve."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Probe:
    """A point of a curve, or a solution alone, that was solved again with finer numerics.

    Attributes
    ----------
    hz : float
        Its frequency [Hz].
    harmonics, samples, modes, total : float
        Largest change over the period of drive displacement or friction force, relative to the peak of that channel
        on the curve or of the solution alone, when only the harmonics, the samples, the modes, or everything is
        refined; nan where the finer problem was not solved, and of modes where the body has no more (the single sources
        are told apart at the peak and where the total is largest).
    """

    hz: float
    harmonics: float
    samples: float
    modes: float
    total: float

    def __repr__(self) -> str:
        """Say the error, what it is made of, and where."""
        return f"{self.shares('')} at {self.hz:.5g} Hz"

    def shares(self, where: str) -> str:
        """The error and what it is made of, in words."""
        parts = ", ".join(f"{name} {_share(getattr(self, name))}" for name in ("harmonics", "samples", "modes"))
        return f"{_share(self.total)}{where} ({parts})"


def _share(error: float) -> str:
    return "not estimated" if np.isnan(error) else f"{error:.2%}"


def worst_of(probes: Sequence[Probe]) -> Probe:
    """The probe of largest total error; the first where none is known."""
    return max(probes, key=lambda p: -1.0 if np.isnan(p.total) else p.total)


@dataclass(frozen=True)
class NumericalError:
    """Estimated numerical error of a curve, relative to the peak of each judged channel.

    Attributes
    ----------
    probes : tuple of Probe
        The points that were solved again: the one at the peak, then others in order of travel.
    at_peak : Probe
        The one at the largest drive displacement.
    closure : float
        Largest change of the friction state over a period, relative to its range.
    chosen : int
        Points that were to be solved again; fewer were where the time was over.
    """

    probes: tuple[Probe, ...]
    at_peak: Probe
    closure: float
    chosen: int

    @property
    def worst(self) -> Probe:
        """The probe of largest total error."""
        return worst_of(self.probes)

    @property
    def lost(self) -> tuple[Probe, ...]:
        """Probes near which nothing was found with finer numerics: what is said of the others says nothing of them."""
        return tuple(p for p in self.probes if np.isnan(p.total))

    def largest(self, source: str) -> float:
        """Largest error of one source ("harmonics", "samples", "modes" or "total") over the probes."""
        values = [getattr(p, source) for p in self.probes]
        return float(np.nanmax(values)) if not np.all(np.isnan(values)) else float("nan")

    def __repr__(self) -> str:
        """Say the estimate and where it comes from."""
        w = self.worst
        at_most = f"at most {_share(w.total)} near {w.hz:.5g} Hz"
        if self.lost:
            at_most += f", not estimated at {len(self.lost)} of {len(self.probes)} points"
        if len(self.probes) < self.chosen:
            at_most += f", of {len(self.probes)} of {self.chosen} points in the time"
        return f"{self.at_peak.shares(' at the peak')}, {at_most}; loop closure {self.closure:.0e}"


@dataclass(frozen=True)
class Assessment:
    """Accuracy of a curve.

    Attributes
    ----------
    error : NumericalError
    reason : str
        Why this number of harmonics and samples.
    warnings : tuple of str
        Warnings that a user should know before trusting the curve.
    """

    error: NumericalError
    reason: str
    warnings: tuple[str, ...]
