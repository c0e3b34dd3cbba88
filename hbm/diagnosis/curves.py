"""Response curves of the models of a diagnosis, at the levels and in the bands of frequencies that were measured."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from hbm.balance.solution import amplitudes
from hbm.diagnosis.verdict import Diagnosis
from hbm.fourier import Array
from hbm.measurement.groups import frequency_bands, levels
from hbm.measurement.spectra import MeasuredSpectra
from hbm.outputerror.simulated import FAILURES
from hbm.parallel import each
from hbm.response.budget import Budget
from hbm.response.peak import with_peak
from hbm.response.trace import scout_frequency
from models.jointed import AnyRig

MARGIN = 0.015
"""Share of its frequencies by which a curve goes beyond the records of its band."""

SPARE, LEAST = 2, 11
"""Harmonics beyond those measured, and the fewest, of a curve."""

MOST_LEVELS = 4
"""Levels that are traced, at most: the lowest, the highest, and some between."""

BUDGET = Budget(points=1500, seconds=30.0)
"""Most that one curve may take."""


@dataclass(frozen=True, eq=False)
class TracedResponse:
    """Response of one model over the frequency, at one level.

    Attributes
    ----------
    model : str
        nominal, calibrated or extended.
    level, force : float
        Mean of the nominal forces of the records of the level, and of the forces that were measured in them, which the
        curve is traced with [N].
    hz : (points,) array
        In the order of travel: where the curve folds it goes back [Hz]. Lines from one to the next draw the curve.
    amplitudes : mapping of str to (points, H+1) array
        Amplitude of each harmonic of each channel that was measured.
    """

    model: str
    level: float
    force: float
    hz: Array
    amplitudes: Mapping[str, Array]


def traced_responses(
    d: Diagnosis, spectra: MeasuredSpectra, executor: Executor | None = None
) -> tuple[TracedResponse, ...]:
    """Response curves of the models of a diagnosis over the bands of frequencies that were measured.

    Parameters
    ----------
    d : Diagnosis
    spectra : MeasuredSpectra
        The records that were diagnosed.
    executor : concurrent.futures.Executor, optional
        Traces them side by side; one after the other where omitted.

    Returns
    -------
    tuple of TracedResponse
        Without models whose response is none of the frequency alone, such as a rig that drifts from record to record,
        without bands of a single frequency, and without curves that have no first solution.
    """
    if d.campaign is None or d.floored:
        return ()
    grid, channels = d.campaign.numerics.working, d.campaign.data.channels
    H = max(d.campaign.data.H + SPARE, LEAST)
    tasks = [
        (name, grid.rig(rig), level, force * rig.excitation.gain(level), band)
        for name, rig in _models(d).items()
        for level, force, band in _sweeps(d, spectra)
    ]
    if not tasks:
        return ()
    names, rigs, of_levels, forces, bands = (list(column) for column in zip(*tasks, strict=True))
    same = len(tasks)
    found = each(executor, _traced, names, rigs, of_levels, forces, bands, [tuple(channels)] * same, [H] * same)
    return tuple(response for response in found if response is not None)


def _models(d: Diagnosis) -> dict[str, AnyRig]:
    """Rigs of the models that have a response over the frequency."""
    fitted = {"nominal": d.nominal, "calibrated": d.calibrated, "extended": d.extended_fit}
    rigs = {name: e.model.rig(e.x) for name, e in fitted.items() if e is not None}
    return {name: rig for name, rig in rigs.items() if _alike_in_all_records(rig)}


def _alike_in_all_records(rig: AnyRig) -> bool:
    """Whether nothing but force and frequency tells the records of a rig apart."""
    return not rig.drift and rig.excitation.settled and not rig.excitation.measured_harmonics


def _sweeps(d: Diagnosis, spectra: MeasuredSpectra) -> list[tuple[float, float, tuple[float, float]]]:
    """Level, measured force and ends of each curve."""
    campaigns = [c for c in (d.campaign, d.held_campaign) if c is not None]
    measured = {r.number: r.force for c in campaigns for r in c.data.records}
    known = np.isin(spectra.records, list(measured))
    hz, level = spectra.hz[known], levels(spectra.level[known])
    force = np.array([measured[number] for number in spectra.records[known].tolist()])
    out = []
    for low, high in frequency_bands(hz):
        inside = (hz >= low) & (hz <= high)
        for one in _spread(np.unique(level[inside])):
            own = inside & (level == one)
            ends = float(hz[own].min()), float(hz[own].max())
            if ends[0] < ends[1]:
                out.append((float(one), float(force[own].mean()), (ends[0] * (1 - MARGIN), ends[1] * (1 + MARGIN))))
    return out


def _spread(found: Array) -> Array:
    """At most so many levels, the ends among them."""
    chosen = np.unique(np.linspace(0, len(found) - 1, min(len(found), MOST_LEVELS)).round().astype(int))
    return np.asarray(found[chosen])


def _traced(
    model: str,
    rig: AnyRig,
    level: float,
    force: float,
    band: tuple[float, float],
    channels: Sequence[str],
    H: int,
) -> TracedResponse | None:
    try:
        curve = with_peak(scout_frequency(rig, band, level=force, harmonics=H, budget=BUDGET))
    except FAILURES:
        return None
    dense = curve.dense
    of_channels = {name: amplitudes(dense[name].coefficients) for name in channels}
    return TracedResponse(model, level, force, dense.hz, of_channels)
