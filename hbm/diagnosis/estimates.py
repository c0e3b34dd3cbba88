"""Results of a model about its cause: name, numbers, and for how long the tip is off its support."""

from collections.abc import Iterator
from dataclasses import fields, is_dataclass

import numpy as np
from scipy.special import ndtr

from hbm.diagnosis.verdict import Estimate, Ranked
from hbm.fourier import Array
from hbm.outputerror.evaluation import Evaluation
from hbm.outputerror.model import Free
from models.causes.friction import OtherFriction
from models.causes.parameter import WrongParameter

RIGID = 0.01
"""Of its standard deviation: records do not tell a compliance so small from none."""

FAR, COMPARED = 8.0, 4000
"""Standard deviations beyond which no compliance is possible; how many are compared."""

ONSET = 3.0
"""Records in which the tip would lift off show that it does where they leave so many times what the others leave."""


def name_of(e: Evaluation) -> str:
    """Name of the first cause, as docs/reference/causes.md has it."""
    cause = e.model.causes[0]
    return cause.label if isinstance(cause, WrongParameter) else cause.name


def told_of(e: Evaluation) -> str:
    """The same as one of several: of a joint with its place or its name, which may be all that differs."""
    cause = e.model.causes[0]
    return cause.label if cause.placed or isinstance(cause, OtherFriction) else name_of(e)


def beside_it(e: Evaluation, i: int = 1) -> str:
    """A cause beside the first one, with its numbers."""
    said = ", ".join(f"{name} = {value:.4g}" for name, value in e.model.values(e.x, i).items())
    return f"{e.model.causes[i].label}{f' ({said})' if said else ''}"


def estimates(e: Evaluation, std: Array | None = None) -> dict[str, Estimate]:
    """Parameters of the first cause of a fitted model; with standard deviations of its own unless given, (n,)."""
    cause, std = e.model.causes[0], e.std if std is None else std
    named: dict[str, Estimate] = {}
    if is_dataclass(cause) and not isinstance(cause, WrongParameter):
        named = {
            f.name: Estimate(v) for f in fields(cause) for v in [getattr(cause, f.name)] if isinstance(v, str) and v
        }
    return named | {
        f.name: Estimate(f.value(x), _told(f, x, float(s)), f.unit)
        for f, x, s in zip(e.model.free, e.x, std, strict=True)
        if f.cause == 0
    }


def _told(f: Free, x: float, std: float) -> float:
    return std_upwards(f.value(x), std) if f.form == "inverse" else std


def std_upwards(stiffness: float, std: float) -> float:
    """Standard deviation of a stiffness that records tell by its compliance, as far as it may be larger.

    What is nearly rigid may be many times stiffer, but not many times softer, and one number for both sides says the
    larger one. Compliances are equally likely before by their logarithm, down to where records see none.

    Parameters
    ----------
    stiffness, std : float
        As the records give them, so that the compliance is off by ``std / stiffness**2``.

    Returns
    -------
    float
        At least `std`; so far above lie no more than 16 of 100 stiffnesses that the records leave possible.
    """
    if not np.isfinite(stiffness) or std <= 0.0:
        return std
    told = stiffness / std  # the compliance, as all here in its own deviations
    possible = np.geomspace(max(RIGID, told - FAR), told + FAR, COMPARED)
    share = np.cumsum(np.exp(-0.5 * (possible - told) ** 2))
    return max(std, float(stiffness * (told / np.interp(ndtr(-1.0) * share[-1], share, possible) - 1.0)))


def ranked(e: Evaluation, held_out: float | None) -> Ranked:
    """A fitted model in the ranking, with its error on the records held out."""
    return Ranked(e.model.label, name_of(e), estimates(e), e.bic, e.chi2, held_out)


def off_support(base: Evaluation) -> Iterator[str]:
    """For how long the tip is off its support."""
    share = {number: max(solution.off.values()) for number, solution in base.solutions.items()}
    lifted = [number for number, off in share.items() if off > 0.0]
    if lifted:
        yield (
            f"The tip is off its support in records {', '.join(map(str, lifted))}, for up to "
            f"{max(share.values()):.2g} of the period."
        )


def lifted(base: Evaluation) -> Iterator[str]:
    """Where the simulation has left what it can say."""
    if base.model.rig(base.x).lift_off:
        yield from off_support(base)
        return
    records = [number for number, solution in base.solutions.items() if solution.lift_off]
    own = np.isin(base.white.record, records)
    if not records:
        return
    yield (
        f"In the simulation the normal force reaches zero in records {', '.join(map(str, records))}: the tip may "
        "lift off there (contact-loss), which this model does not simulate."
    )
    if not own.all():
        there, elsewhere = (float(np.mean(base.white.residual[part] ** 2)) for part in (own, ~own))
        told = "nothing more is missing there"
        if there > ONSET * max(elsewhere, 1.0):
            told = "what is missing sets in where the tip would lift off; leave these records out to judge the others"
        yield f"These leave {there:.3g} noise variances, all others {elsewhere:.3g}: {told}."
