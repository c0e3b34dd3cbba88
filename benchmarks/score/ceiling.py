"""What Fisher information allows: how often the truth is the nearest of all candidates, whatever the method.

Local-linear likelihood at the nominal rig. A cause of length rho adds rho times its unit signature to the records, an
exact derivative in standard deviations; tolerances of the rig file (:data:`hbm.outputerror.nominal.TOLERANCES`) add
what they can do as a correlated noise, in which all candidates are compared. A number that only shapes an effect is
scanned, each shape a direction of its own. Left out: causes without a derivative to their size (exchanged channels,
drift, a stop, contact loss), candidates whose next to no effect has no steady state for a fifth of the records, and
that candidates with several numbers can bend.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import groupby, product
from typing import Any

import numpy as np
import numpy.typing as npt

from hbm.diagnosis.calibrate import trusted
from hbm.diagnosis.screen import coarse
from hbm.fourier import Array
from hbm.measurement.spectra import MeasuredSpectra
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import evaluate
from hbm.outputerror.measured import campaign_of
from hbm.outputerror.model import Free, Model
from hbm.outputerror.simulated import FAILURES, Solutions
from hbm.outputerror.whitened import uncorrelated
from models.causes import all_candidates
from models.causes.cause import Cause, Unknown
from models.causes.parameter import WrongParameter
from models.rig import Rig

Places = npt.NDArray[np.int64]

RHO = (5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0, 5000.0)
TIED = 9.0
SHAPES = 6
"""At most so many of each candidate."""

MISSING = 0.2
"""Share of the records without a steady state from which on a candidate is left out."""

DRAWS = 400
"""Of each candidate at each rho, over all its shapes."""


@dataclass(frozen=True)
class Direction:
    """A candidate of one shape: label and name of the cause, place among its shapes.

    Attributes
    ----------
    sign : int
        Of its amplitude, where physics allows but one; 0 where both.
    """

    label: str
    name: str
    shape: int
    sign: int


@dataclass(frozen=True, eq=False)
class Signatures:
    """Derivatives of records.

    Attributes
    ----------
    directions : tuple of Direction, (k,)
    raw : (m, k) array
        Of the records to the size of each, in standard deviations.
    left : (m, k) array
        The same where tolerances are part of the noise, in standard deviations of both.
    """

    directions: tuple[Direction, ...]
    raw: Array
    left: Array

    def lengths(self) -> dict[Direction, float]:
        """Of the raw ones."""
        return dict(zip(self.directions, np.linalg.norm(self.raw, axis=0).tolist(), strict=True))

    def exact(self) -> "Signatures":
        """The same where the rig file has no tolerances."""
        return replace(self, left=self.raw)


@dataclass(frozen=True)
class Ceiling:
    """Of one cause: probability to be nearest, and mean number of causes within `TIED` of the nearest, over `RHO`."""

    top1: tuple[float, ...]
    ties: tuple[float, ...]


def signatures(rig: Rig, spectra: MeasuredSpectra) -> Signatures:
    """Exact derivatives of all records to every candidate that has one."""
    whole, _ = campaign_of(rig, spectra)
    campaign = coarse(whole, whole.numbers)
    trust = trusted(rig)
    candidates = [c for c in all_candidates(rig) if c.unknowns(rig)]
    last = evaluate(trust, campaign, trust.start, {}).solutions
    calibrated = _evaluated(trust, campaign, trust.start, last)
    wrong = {c.key: np.inf for c in candidates if isinstance(c, WrongParameter)}
    found = list(_wrong_numbers(Model(rig, {**trust.calibrated, **wrong}), campaign, last))
    found += _missing_effects(trust, campaign, last, candidates)
    allowed = calibrated * np.array([f.std for f in trust.free])
    seen = [(direction, column) for direction, column in found if np.linalg.norm(column) > 0.0]
    raw = np.column_stack([column for _, column in seen])
    return Signatures(tuple(direction for direction, _ in seen), raw, uncorrelated(allowed, raw))


def _evaluated(model: Model, campaign: Campaign, x: Array, last: Solutions) -> Array:
    """Derivatives (m, n); zero in the records of which no steady state is found."""
    e = evaluate(model, campaign, x, last)
    if len(e.missing) > MISSING * len(campaign.numbers):
        raise ValueError(f"no steady state of {model.label} for records {', '.join(map(str, e.missing))}")
    rows = np.concatenate([np.full(int(r.listed.sum()), r.number) for r in campaign.data.records])
    out = np.zeros((len(rows), len(x)))
    out[~np.isin(rows, e.missing)] = e.white.jacobian
    return out


def _wrong_numbers(model: Model, campaign: Campaign, last: Solutions) -> Iterator[tuple[Direction, Array]]:
    derivatives = _evaluated(model, campaign, model.start, last)
    for i, free in enumerate(model.free):
        label = f"{WrongParameter.name}:{free.name}"
        yield Direction(label, label, 0, 0), derivatives[:, i]


def _missing_effects(
    trust: Model, campaign: Campaign, last: Solutions, candidates: Sequence[Cause]
) -> Iterator[tuple[Direction, Array]]:
    """Those of one name next to none in one rig, where they do not meet; other friction laws one by one."""
    for _, alike in groupby((c for c in candidates if not isinstance(c, WrongParameter)), lambda c: c.name):
        extensions = [Extension(c, i, start) for c in alike for i, start in enumerate(_shapes(c, trust.nominal))]
        first = extensions[0]
        changed = type(first.cause.extend(trust.nominal, first.start).contact.law)
        apart = changed is not type(trust.nominal.contact.law)
        for group in [[e] for e in extensions] if apart else [extensions]:
            yield from _derivatives(trust, campaign, last, group)


@dataclass(frozen=True)
class Extension:
    """A cause next to no effect, in one of its shapes."""

    cause: Cause
    shape: int
    start: Mapping[str, float]


def _shapes(cause: Cause, rig: Rig) -> list[dict[str, float]]:
    """Values of a cause next to no effect, of some shapes."""
    size, *shape = cause.unknowns(rig)
    every = list(product(*(u.starts for u in shape)))
    return [
        {size.name: size.starts[0]} | dict(zip((u.name for u in shape), values, strict=True))
        for values in every[:: -(-len(every) // SHAPES)]
    ]


def _derivatives(
    trust: Model, campaign: Campaign, last: Solutions, extensions: Sequence[Extension]
) -> Iterator[tuple[Direction, Array]]:
    """To the sizes of causes in one rig; none where that has no steady states."""
    model = Model(trust.nominal, trust.calibrated, tuple(e.cause for e in extensions))
    x = np.array([f.of(extensions[f.cause].start[f.name] if f.cause >= 0 else f.start) for f in model.free])
    try:
        derivatives = _evaluated(model, campaign, x, last)
    except FAILURES:
        return
    for i, extension in enumerate(extensions):
        size = model.unknowns[i][0]
        column = next(j for j, f in enumerate(model.free) if f.cause == i and f.name == size.name)
        direction = Direction(
            extension.cause.label, extension.cause.name, extension.shape, _sign(size, model.free[column])
        )
        yield direction, derivatives[:, column]


def _sign(size: Unknown, free: Free) -> int:
    """Side of no effect on which the coordinate of a size lies; 0 for both."""
    if size.lower < size.neutral < size.upper:
        return 0
    return 1 if free.of(size.starts[-1]) >= free.of(size.starts[0]) else -1


def ceilings(part: Signatures, whole: Signatures, rng: np.random.Generator) -> dict[str, Ceiling]:
    """By the name of the truth; rho is the length in `whole`, all records, of which `part` holds some.

    Of a rig with several sensors or places the mean over these, with equal weight; what `part` does not see at all is
    never named.
    """
    lengths = whole.lengths()
    norms = np.linalg.norm(part.left, axis=0)
    keep = [
        i for i, d in enumerate(part.directions) if norms[i] > 1e-9 * np.linalg.norm(part.raw[:, i]) and d in lengths
    ]
    unit = part.left[:, keep] / norms[keep]
    chosen = [part.directions[i] for i in keep]
    shares = [norms[i] / lengths[part.directions[i]] for i in keep]
    cosines = unit.T @ unit
    root = np.linalg.cholesky(cosines + 1e-10 * np.eye(len(keep)))
    signs = np.array([d.sign for d in chosen])
    _, owner = np.unique([d.label for d in chosen], return_inverse=True)
    found: dict[str, list[Array]] = {}
    for i, direction in enumerate(chosen):
        draws = max(50, DRAWS // sum(owner == owner[i]))
        here = np.array([
            _nearest(cosines[:, i], root, rho * shares[i], signs, owner, i, rng.standard_normal((draws, len(keep))))
            for rho in RHO
        ])  # fmt: skip
        found.setdefault(direction.name, []).append(here)
    for direction in set(whole.directions) - set(chosen):
        unseen = np.array([[0.0, owner.max() + 1.0]] * len(RHO))
        found.setdefault(direction.name, []).append(unseen)
    return {name: _mean(tables) for name, tables in found.items()}


def _mean(tables: Sequence[Array]) -> Ceiling:
    top1, ties = np.mean(tables, axis=0).T
    return Ceiling(tuple(top1.tolist()), tuple(ties.tolist()))


def _nearest(
    cosines: Array, root: Array, length: float, signs: Array, owner: Places, truth: int, noise: Array
) -> tuple[float, float]:
    """Share of draws in which the truth's label has the least chi2, and mean number of labels that are tied."""
    side = np.where(np.arange(len(noise)) % 2, 1.0, -1.0) if signs[truth] == 0 else np.full(len(noise), signs[truth])
    z = length * side[:, None] * cosines + noise @ root.T
    z = np.where(signs == 0, np.abs(z), np.maximum(z * signs, 0.0))
    drop = np.full((len(noise), owner.max() + 1), -1.0)
    for i, label in enumerate(owner):
        drop[:, label] = np.maximum(drop[:, label], z[:, i] ** 2)
    best = drop.max(axis=1)
    tied = (best[:, None] - drop < TIED).sum(axis=1)
    return float((drop.argmax(axis=1) == owner[truth]).mean()), float(tied.mean())


@dataclass(frozen=True)
class Allowed:
    """Ceilings by the cause: with tolerances of the rig file, and where that is exact."""

    tolerances: Mapping[str, Ceiling]
    exact: Mapping[str, Ceiling]

    def json(self) -> dict[str, object]:
        both = {"tolerances": self.tolerances, "exact": self.exact}
        return {kind: {name: asdict(c) for name, c in found.items()} for kind, found in both.items()}


def allowed(rig: Rig, spectra: MeasuredSpectra, part: MeasuredSpectra, rng: np.random.Generator) -> Allowed:
    """Ceilings for some of the records of a rig, `part`, over the length of all of them."""
    whole = signatures(rig, spectra)
    seen = whole if part is spectra else signatures(rig, part)
    return Allowed(ceilings(seen, whole, rng), ceilings(seen.exact(), whole, rng))


def average(found: Sequence[Mapping[str, Any]]) -> Allowed:
    """Of several rigs, as in their files."""

    def of(kind: str) -> dict[str, Ceiling]:
        names = sorted({name for one in found for name in one[kind]})
        return {
            name: _mean([np.array([c["top1"], c["ties"]]).T for one in found for c in [one[kind].get(name)] if c])
            for name in names
        }

    return Allowed(of("tolerances"), of("exact"))


def at(ceiling: Ceiling, rho: float) -> tuple[float, float]:
    """Top 1 and ties at a rho, between those computed by its logarithm."""
    x, grid = np.log(max(rho, 1e-9)), np.log(RHO)
    return float(np.interp(x, grid, ceiling.top1)), float(np.interp(x, grid, ceiling.ties))
