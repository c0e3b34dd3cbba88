"""How far a model is from records: in all, by record, channel and harmonic; and how improbable that is.

Standard deviations are themselves known to a few per cent only: a misfit counts as one beyond :data:`NOISE_KNOWN`.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy import special

from hbm.diagnosis.coherent import alike
from hbm.fourier import Array
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation
from hbm.outputerror.whitened import Whitened, uncorrelated

NOISE_KNOWN = 0.03
"""Standard deviations in a spectra file may be this much too small, relatively."""

SIGNIFICANCE = 0.003
"""A misfit less probable than this by noise alone is one."""

Labels = npt.NDArray[np.generic]


@dataclass(frozen=True)
class Cell:
    """A part of the measurement that fits worst of its kind: `probability` of so bad a worst one by noise alone.

    `chi2_reduced` is how much larger it is than noise makes it.
    """

    what: str
    chi2_reduced: float
    points: int
    probability: float


@dataclass(frozen=True)
class Misfit:
    """A model beside records.

    Attributes
    ----------
    chi2, dof : float
        In all.
    nrmse : float
        |measured - simulated| / |measured|, each channel by its own rms.
    cells : tuple of Cell
        Everything together, then the worst record, channel, harmonic...; and what all channels miss alike.
    """

    chi2: float
    dof: float
    nrmse: float
    cells: tuple[Cell, ...]

    @property
    def chi2_reduced(self) -> float:
        """Mean square, in standard deviations."""
        return self.chi2 / self.cells[0].points

    @property
    def probability(self) -> float:
        """Probability that noise alone makes as bad a misfit, anywhere it was looked for."""
        return float(min(1.0, len(self.cells) * min(c.probability for c in self.cells)))

    @property
    def fits(self) -> bool:
        """Whether noise explains it."""
        return self.probability > SIGNIFICANCE

    @property
    def worst(self) -> Cell:
        """The least probable part."""
        return min(self.cells, key=lambda c: c.probability)

    @property
    def clearest(self) -> str:
        """The least probable part in words, with how much larger than noise it is; nothing where that is everything."""
        worst = self.worst
        return "" if worst is self.cells[0] else f"{worst.what} ({worst.chi2_reduced:.3g})"


def misfit(e: Evaluation, campaign: Campaign) -> Misfit:
    """Misfit of a model to the records it was fitted to."""
    J = e.white.jacobian
    used = float(np.sum(e.covariance * (J.T @ J)))  # a number that nothing is seen of uses nothing
    return _misfit(e.white, e.white.residual, used, campaign)


def misfit_of_new(e: Evaluation, x: Array, covariance: Array, campaign: Campaign) -> Misfit:
    """Misfit of a model to records it was not fitted to; its numbers were found to be `x` (n,) with a covariance.

    It may be evaluated elsewhere within that, where the records are less far from linear.
    """
    J = e.white.jacobian
    if not J.shape[1]:
        return _misfit(e.white, e.white.residual, 0.0, campaign)
    back = e.white.residual + J @ (e.x - x)
    return _misfit(e.white, uncorrelated(J @ root(covariance), back[:, None])[:, 0], 0.0, campaign)


def likeliest(e: Evaluation, x: Array, covariance: Array) -> Array:
    """Numbers (n,) that new records make likeliest, if they were `x` with a covariance before."""
    J, L = e.white.jacobian, root(covariance)
    A = J @ L
    back = e.white.residual + J @ (e.x - x)
    return np.asarray(x + L @ np.linalg.solve(np.eye(A.shape[1]) + A.T @ A, A.T @ back))


def root(covariance: Array) -> Array:
    """L with L L' the covariance."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def nrmse(white: Whitened) -> float:
    """|measured - simulated| / |measured|, each channel scaled by its own rms."""
    channels = np.unique(white.channel)
    rms = {c: np.sqrt(np.mean(white.measured[white.channel == c] ** 2)) or 1.0 for c in channels}
    scale = np.array([rms[c] for c in white.channel])
    return float(np.linalg.norm(white.raw / scale) / np.linalg.norm(white.measured / scale))


def _misfit(white: Whitened, residual: Array, used: float, campaign: Campaign) -> Misfit:
    r2, points = residual**2, len(residual)
    hz = {r.number: r.hz for r in campaign.data.records}
    label = {r.number: r.name for r in campaign.data.records}
    names, wide = campaign.data.channels, campaign.data.H + 1
    share = 1.0 - used / points
    cells = [_worst("all", np.zeros(points, dtype=int), r2, share, lambda _: "all coefficients")]
    kinds = (
        ("record", white.record, lambda n: f"record {label[int(n)]} ({hz[int(n)]:.5g} Hz)"),
        ("channel", white.channel, lambda c: f"channel {names[int(c)]}"),
        ("harmonic", white.harmonic, lambda k: f"harmonic {k}"),
        (
            "channel and harmonic",
            white.channel * wide + white.harmonic,
            lambda i: f"harmonic {int(i) % wide} of {names[int(i) // wide]}",
        ),
    )
    cells += [_worst(kind, labels, r2, share, name) for kind, labels, name in kinds]
    cells += _alike(replace(white, residual=residual), hz)
    return Misfit(float(r2.sum()), points - used, nrmse(white), tuple(cells))


def _alike(white: Whitened, hz: Mapping[int, float]) -> Iterator[Cell]:
    """The harmonic that the channels miss most alike, if it can be told."""
    found = list(alike(white, hz, (1.0 + NOISE_KNOWN) ** 2))
    if found:
        worst = min(found, key=lambda a: a.probability)
        what = f"harmonic {worst.harmonic} of all channels together about {worst.hz:.3g} Hz"
        yield Cell(what, worst.size, worst.points, _of_several(worst.probability, len(found)))


def _worst(kind: str, labels: Labels, r2: Array, share: float, name: object) -> Cell:
    _, inverse = np.unique(labels, return_inverse=True)
    inverse = inverse.ravel()
    chi2, n = np.bincount(inverse, r2), np.bincount(inverse)
    p = special.chdtrc(np.maximum(n * share, 1e-9), chi2 / (1.0 + NOISE_KNOWN) ** 2)
    i = int(p.argmin())
    first = labels[int(np.flatnonzero(inverse == i)[0])]
    assert callable(name)
    return Cell(name(first), float(chi2[i] / n[i]), int(n[i]), _of_several(float(p[i]), len(n)))


def _of_several(probability: float, number: int) -> float:
    """Probability that the least probable of so many is as improbable as that."""
    return float(-np.expm1(number * np.log1p(-min(probability, 1 - 1e-16))))
