"""The calibrated nominal: numbers of the rig file moved within what they may be off by.

Calibrated are the friction law, the normal load, Young's modulus, the mass-proportional damping, and gain, delay and
place of each sensor (:data:`hbm.outputerror.nominal.TOLERANCES`). `trusted` holds them near the rig file by those
tolerances; `profiled` lets those of friction, material and damping go free, so that nothing they can explain is blamed
on anything else. The load stays where friction sees only its product with mu.
"""

from collections.abc import Collection, Mapping

import numpy as np

from hbm.diagnosis.screen import coarse, spread
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation, evaluate
from hbm.outputerror.fit import fall, fit_from, fit_model
from hbm.outputerror.model import FAR, Model
from hbm.outputerror.nominal import RESIDUALS, SHAPES, tolerances
from hbm.outputerror.simulated import FAILURES, Solutions
from models.causes.parameter import WrongParameter
from models.jointed import AnyRig
from models.scalars import SENSORS

FEW = 8
LAST_STEPS = 4
"""Records of the first fit; steps of the second."""

COUNTS = 0.3
"""A calibrated number that moved by this share of its tolerance is worth a word."""

ROUNDING = 1e-6
"""A calibrated number is at its bound to within this share."""


def trusted(rig: AnyRig, channels: Collection[str] = (), stated: Mapping[str, float] | None = None) -> Model:
    """The nominal rig within tolerances, of the sensors of some channels too; those stated before the usual ones."""
    return Model(rig, tolerances(rig, channels, stated, "diagnose"))


def profiled(model: Model) -> Model:
    """The same with its calibrated numbers free, but for those of places and sensors, what is 0, and constant loads."""
    numbers, of_places = model.nominal.numbers, (SENSORS, SHAPES, RESIDUALS, "excitation.")
    loads = {f"joints.{j.name}.normal_load" for j in getattr(model.nominal, "joints", ()) if j.varying_load}

    def held(key: str) -> bool:
        constant = key.endswith(".normal_load") and key not in loads
        return key.startswith(of_places) or constant or not numbers[key][0]

    return Model(model.nominal, {key: std if held(key) else np.inf for key, std in model.calibrated.items()})


def lighter(e: Evaluation) -> Model:
    """The model with its sensors held where they are."""
    values = {f.name: f.value(x) for f, x in zip(e.model.free, e.x, strict=True) if f.name.startswith(SENSORS)}
    calibrated = {key: std for key, std in e.model.calibrated.items() if not key.startswith(SENSORS)}
    return Model(e.model.nominal.with_numbers(values), calibrated, e.model.causes)


def calibrate(model: Model, campaign: Campaign, last: Solutions) -> Evaluation:
    """Fit the calibrated numbers, first on few records, coarsely; it never ends worse than it started.

    Where the few are missed by much, what lowers their misfit may raise that of the others, or lose a steady state:
    then the fit on all records starts where that on the few did.
    """
    start = evaluate(model, campaign, model.start, last)
    few = coarse(campaign, [n for n in spread(campaign, FEW) if n in last])
    try:
        rough = fit_model(model, few, model.start, last, settled=1.0)
        there = evaluate(model, campaign, rough.x, last, needed=start.found)
    except FAILURES:
        return fit_from(start, campaign, last)
    if fall(start, there) < 0.0:
        return fit_from(start, campaign, last)
    return fit_from(there, campaign, last, LAST_STEPS)


def tolerable(trust: Model, e: Evaluation) -> bool:
    """Whether no number of the rig file is off by more than its tolerance explains, nor one blamed for less."""
    return not _named_within(trust, e) and not off(trust, e)


def _named_within(trust: Model, e: Evaluation) -> bool:
    expected = {t.name: t for t in trust.free}
    for f, x in zip(e.model.free, e.x, strict=True):
        cause = e.model.causes[f.cause] if f.cause >= 0 else None
        t = expected.get(cause.key) if isinstance(cause, WrongParameter) else None
        if t is not None and abs(t.of(f.value(x)) - t.expected) <= FAR * t.std:
            return True
    return False


def off(trust: Model, e: Evaluation) -> dict[str, float]:
    """Calibrated numbers that are as far from the rig file as they may be, or free and farther, in tolerances."""
    expected = {t.name: t for t in trust.free}
    pulls = {
        f.name: (float(x) - t.expected) / t.std
        for f, x in zip(e.model.free, e.x, strict=True)
        if f.cause < 0
        for t in [expected[f.name]]
    }
    far = (1.0 - ROUNDING) * FAR
    return {key: pull for key, pull in sorted(pulls.items(), key=lambda p: -abs(p[1])) if abs(pull) > far}


def off_beside_sensors(trust: Model, e: Evaluation) -> list[str]:
    """Numbers of the rig file, those of sensors aside, that a model moves by more than tolerances explain."""
    return [key for key in off(trust, e) if not key.startswith(SENSORS)]


def told(trust: Model, e: Evaluation) -> list[str]:
    """As :func:`off_beside_sensors`, of the numbers that the records tell to be off: the others may be anything."""
    expected = {t.name: t.expected for t in trust.free}
    std = np.sqrt(np.diag(e.covariance))
    known = {f.name: abs(x - expected[f.name]) > FAR * s for f, x, s in zip(e.model.free, e.x, std, strict=True)}
    return [key for key in off_beside_sensors(trust, e) if known[key]]


def blamed(trust: Model, freed: Evaluation, calibrated: Evaluation, campaign: Campaign) -> Evaluation | None:
    """Fit of a model in which each wrong number of the rig file is a cause, from where they are in one of none.

    Wrong are those that a model `freed` of tolerances tells to be off, else those that are calibrated to their bounds;
    None where none is.
    """
    wrong = told(trust, freed) or off_beside_sensors(trust, calibrated)
    if not wrong:
        return None
    model = Model(trust.nominal, trust.calibrated, tuple(WrongParameter(key) for key in wrong))
    values = {f.name: f.value(v) for f, v in zip(freed.model.free, freed.x, strict=True)}
    names = [f.name if f.cause < 0 else wrong[f.cause] for f in model.free]
    start = np.array([f.of(values[name]) for f, name in zip(model.free, names, strict=True)])
    return fit_model(model, campaign, start, freed.solutions)


def moved(e: Evaluation) -> list[str]:
    """Calibrated numbers that are off by a share of their tolerance that counts, in words, the furthest first."""
    free = [(f, float(x)) for f, x in zip(e.model.free, e.x, strict=True) if f.cause < 0 and np.isfinite(f.std)]
    pulls = sorted(((f, x, (x - f.expected) / f.std) for f, x in free), key=lambda p: -abs(p[2]))
    return [
        f"{f.name} {f.value(x):.5g} instead of {e.model.nominal.number(f.name):.5g} ({pull:+.1f} tolerances)"
        for f, x, pull in pulls
        if abs(pull) >= COUNTS
    ]
