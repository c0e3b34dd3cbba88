"""Which further measurement would tell two fitted models apart, and how clearly.

Both models are simulated at each experiment that is feasible. What the rival could still do to follow, within what the
records leave free, is projected out (Fisher information): what is left is the chi2 that the experiment would decide by.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from hbm.balance.problem import balance_of
from hbm.balance.solution import PeriodicSolution, describe
from hbm.fourier import sampled
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation
from hbm.outputerror.simulated import FAILURES
from hbm.outputerror.whitened import uncorrelated
from hbm.response.start import first_solution
from hbm.sensitivity.derivatives import sensitivities
from models.jointed import AnyRig
from models.parts import Channel

HARMONICS = (15, 256)
READABLE = 9
"""Harmonics that can be read where fewer were."""


@dataclass(frozen=True)
class Experiment:
    """Records that could be measured: forces [N] and frequencies [Hz], so many harmonics, with a sensor more or not."""

    said: str
    points: tuple[tuple[float, float], ...]
    sensor: float | None = None
    harmonics: int = READABLE


@dataclass(frozen=True)
class Separation:
    """An experiment and the chi2 by which it would tell two models apart."""

    experiment: Experiment
    chi2: float

    def __repr__(self) -> str:
        return f"{self.experiment.said} (predicted difference of chi2: {self.chi2:.3g})"


def separate(best: Evaluation, rival: Evaluation, campaign: Campaign) -> Separation | None:
    """The experiment that tells two models apart most clearly; None where none can be simulated."""
    found = []
    for experiment in _read(experiments(best, campaign), campaign.data.H):
        chi2 = _predicted(best, rival, campaign, experiment)
        if chi2 is not None:
            found.append(Separation(experiment, chi2))
    return max(found, key=lambda s: s.chi2, default=None)


def _read(experiments: Iterable[Experiment], measured: int) -> Iterator[Experiment]:
    """Experiments with as many harmonics as were measured, and with more."""
    for experiment in experiments:
        yield replace(experiment, harmonics=measured)
        if measured < READABLE:
            said = f"{experiment.said}, their harmonics 1 to {READABLE} read"
            yield replace(experiment, said=said, harmonics=READABLE)


def experiments(best: Evaluation, campaign: Campaign) -> Iterator[Experiment]:
    """Experiments that could be made beside those that were."""
    records = campaign.data.records
    forces, hz = np.array([r.force for r in records]), np.array([r.hz for r in records])
    rig = best.model.rig(best.x)
    low, middle, high = float(hz.min()), float(np.median(hz)), float(hz.max())
    top = float(forces.max())
    for factor in (0.3, 1.5):
        level = top * factor if factor > 1 else float(forces.min()) * factor
        yield Experiment(
            f"three records at {level:.3g} N, {low:.4g}, {middle:.4g} and {high:.4g} Hz",
            tuple((level, f) for f in (low, middle, high)),
        )
    elastic = rig.structure.omega_n[rig.structure.omega_n > 0.0]
    second = float(elastic[1] / 2 / np.pi) if len(elastic) > 1 else middle
    if len(elastic) > 1 and not np.any(np.abs(hz / second - 1) < 0.1):
        near = tuple(second * f for f in (0.97, 1.03, 1.08))
        yield Experiment(
            f"three records at {top:.3g} N about the second mode, {near[0]:.4g}, {near[1]:.4g} and {near[2]:.4g} Hz",
            tuple((top, f) for f in near),
        )
    places = [c.position for c in rig.response_channels]
    length = getattr(rig.body, "length", None)
    if length is not None and places:
        for place, where in ((0.04 * length, "the clamp"), (0.985 * length, "the support")):
            if min(abs(place - p) for p in places) > 0.02 * length:
                yield Experiment(
                    f"an accelerometer near {where}, at {place:.3g} m, three records at {top:.3g} N, "
                    f"{low:.4g}, {middle:.4g} and {high:.4g} Hz",
                    tuple((top, f) for f in (low, middle, high)),
                    place,
                )


def _predicted(best: Evaluation, rival: Evaluation, campaign: Campaign, experiment: Experiment) -> float | None:
    rows, slopes = [], []
    keys, by_x = rival.model.by_x(rival.x, rival.model.rig(rival.x))
    std = {
        name: float(np.nanmedian([r.std[i] for r in campaign.data.records]))
        for i, name in enumerate(campaign.data.channels)
    }
    force_std = float(np.median([r.force_std for r in campaign.data.records]))
    k = np.arange(1, min(experiment.harmonics, HARMONICS[0]) + 1)
    for force, hz in experiment.points:
        try:
            found = [_solved(e, campaign, experiment, force, hz) for e in (best, rival)]
            by = sensitivities(found[1][1], found[1][0], (*keys, "excitation.amplitude"))
        except FAILURES:
            continue
        names = [*campaign.data.channels, *(["_added"] if experiment.sensor is not None else [])]
        for name in names:
            s = std.get(name, float(np.median(list(std.values()))))
            seen = np.concatenate([k, found[0][0].basis.H + k])
            d = (found[0][0][name].coefficients - found[1][0][name].coefficients)[seen] / s
            columns = by[name].coefficients[seen] / s
            d, *_ = uncorrelated(force_std * columns[:, -1:], d[:, None]).T
            rows.append(d)
            slopes.append(columns[:, :-1] @ by_x)
    if not rows:
        return None
    values, vectors = np.linalg.eigh(rival.covariance)
    free = np.concatenate(slopes) @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    left = uncorrelated(free, np.concatenate(rows)[:, None])[:, 0]
    return float(left @ left)


def _solved(
    e: Evaluation, campaign: Campaign, experiment: Experiment, force: float, hz: float
) -> tuple[PeriodicSolution, AnyRig]:
    rig = campaign.numerics.working.rig(e.model.rig(e.x))
    if experiment.sensor is not None:
        rig = replace(rig, channels=(*rig.channels, Channel("_added", "acceleration", experiment.sensor)))
    H, N_t = HARMONICS
    problem = balance_of(rig, sampled(max(H, campaign.numerics.holding), N_t), level=force)
    lam = problem.lam_at(hz)
    return describe(problem, first_solution(problem, lam), lam), rig
