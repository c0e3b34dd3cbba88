"""A cause once more from where it was found: over another model of the rig file, or beside what it leaves."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from hbm.diagnosis.candidates import EXPLAINED
from hbm.diagnosis.fullfits import refinable
from hbm.diagnosis.judge import background_of, beside_noise
from hbm.fourier import Array
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation
from hbm.outputerror.fit import best_start, fit_model, refine
from hbm.outputerror.model import FAR, Model
from hbm.outputerror.simulated import FAILURES, Solutions
from models.causes.cause import Cause
from models.causes.parameter import WrongParameter

POWERS = (1.0, -1.0, 0.5, -0.5, 2.0, -2.0)
"""A number in place of another one may change with it to one of these powers: a thickness with the square root of a
modulus, a density with its inverse."""


def started(base: Evaluation, found: Evaluation, causes: Sequence[Cause], campaign: Campaign) -> list[Evaluation]:
    """Fit of a model with some of the causes of another one, from where these were found.

    Parameters
    ----------
    base : Evaluation
        Fit of the model without the causes.
    found : Evaluation
        Fit of a model with them, maybe with others before them and over other calibrated numbers.
    causes : sequence of Cause
        Of that model, the last ones or others.
    campaign : Campaign

    Returns
    -------
    list of Evaluation
        Empty where there is no fit.
    """
    model = base.model
    for added in causes:
        model = model.extended_by(added)
    place = {i: model.causes.index(c) for i, c in enumerate(found.model.causes) if c in model.causes} | {-1: -1}
    known = base.values
    known |= {(place[cause], name): value for (cause, name), value in found.values.items() if cause in place}
    known |= _blamed(model, found)
    starts = [model.at(known)]
    if base.model.calibrated and not found.model.calibrated:
        # calibration without the causes may have gone far to do without them
        starts.append(np.array([f.expected if f.cause < 0 else x for f, x in zip(model.free, starts[0], strict=True)]))
    try:
        start = best_start(model, campaign, starts, found.solutions)[0][1] if len(starts) > 1 else starts[0]
        return [_fitted(model, campaign, start, found.solutions, EXPLAINED * len(found.white))]
    except FAILURES:
        return []


def in_place_of(found: Evaluation, i: int, number: WrongParameter, campaign: Campaign) -> Evaluation:
    """Fit of a wrong number in place of one that is a cause of a model and acts alike, from where that is.

    Raises
    ------
    ConvergenceError, ArithmeticError
        If there is none.
    """
    model, blamed = found.model.with_cause(i, number), found.model.causes[i]
    assert isinstance(blamed, WrongParameter)
    known = {at: value for at, value in found.values.items() if at[0] != i}
    change = found.values[i, "value"] / found.model.nominal.number(blamed.key)
    now = known.get((-1, number.key), found.model.nominal.number(number.key))
    starts = [model.at(known | {(i, "value"): now * change**power}) for power in POWERS]
    return _fitted(model, campaign, best_start(model, campaign, starts, found.solutions)[0][1], found.solutions)


def moving_alike(found: Evaluation, i: int, least: float) -> set[str]:
    """Labels of calibrated numbers that move the records as one does that is a cause, by the cosine of derivatives."""
    J, free = found.white.jacobian, found.model.free
    directions = J / np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    cosines = np.abs(directions[:, [f.cause for f in free].index(i)] @ directions)
    return {WrongParameter(f.name).label for f, c in zip(free, cosines, strict=True) if f.cause < 0 and c >= least}


def alone(nominal: Evaluation, calibrated: Evaluation, keys: Sequence[str], campaign: Campaign) -> Iterator[Evaluation]:
    """Fits of one number at a time over the rig file as it is, from where calibration has it, if within tolerance."""
    values = calibrated.model.values(calibrated.x, -1)
    for f in calibrated.model.free:
        if f.cause >= 0 or f.name not in keys:
            continue
        model = nominal.model.extended_by(WrongParameter(f.name))
        start = np.array([model.free[-1].of(values[f.name])])
        with suppress(*FAILURES):
            e = _fitted(model, campaign, start, calibrated.solutions)
            if abs(f.of(model.free[-1].value(float(e.x[-1]))) - f.expected) <= FAR * f.std:
                yield e


def _fitted(model: Model, campaign: Campaign, x: Array, last: Solutions, reach: float = np.inf) -> Evaluation:
    """A fit, the discretisation corrected anew where that may be what it is missing."""
    best = fit_model(model, campaign, x, last, reach=reach)
    return refine(best, campaign) if refinable(best) else best


def _blamed(model: Model, found: Evaluation) -> dict[tuple[int, str], float]:
    """Values of calibrated numbers, where a number is a cause of its own in another model."""
    causes = enumerate(found.model.causes)
    blamed = [(i, c.key) for i, c in causes if isinstance(c, WrongParameter) and c not in model.causes]
    return {(-1, key): found.values[i, "value"] for i, key in blamed}


def apart(base: Evaluation, pair: Evaluation, campaign: Campaign) -> list[Evaluation]:
    """Fits of each of two causes alone, from where both were found.

    The first may only have led to where the second is found; and the second only have carried the first out of a
    valley, or onto the branch, that it was caught in.
    """
    return [*started(base, pair, pair.model.causes[:1], campaign), *led_to(base, pair, campaign)]


def led_to(base: Evaluation, pair: Evaluation, campaign: Campaign) -> list[Evaluation]:
    """Fit of the second of two causes alone: the first may only have led to where it is found. Of one cause nothing."""
    causes = pair.model.causes
    return started(base, pair, causes[1:], campaign) if len(causes) > 1 else []


def less_moved(e: Evaluation, nominal: Evaluation, campaign: Campaign) -> Iterator[Evaluation]:
    """Fits of the causes of a model that move the rig file less: beside what the model leaves, and not at all."""
    wide = replace(campaign, background=background_of(e, campaign), corrections=e.corrections)
    with suppress(*FAILURES):
        yield beside_noise(fit_model(e.model, wide, e.x, e.solutions), wide)
    yield from started(nominal, e, e.model.causes, campaign)
