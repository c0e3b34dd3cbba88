"""Results of a model about its cause: name, numbers, and for how long the tip is off its support."""

from collections.abc import Iterator
from dataclasses import fields, is_dataclass

from hbm.diagnosis.verdict import Estimate
from hbm.fourier import Array
from hbm.outputerror.fit import Evaluation
from models.causes.addedjoint import AddedJoint
from models.causes.parameter import WrongParameter


def name_of(e: Evaluation) -> str:
    """Name of the first cause, as docs/reference/causes.md has it."""
    cause = e.model.causes[0]
    return cause.label if isinstance(cause, WrongParameter) else cause.name


def told_of(e: Evaluation) -> str:
    """The same as one of several: of a joint with its place, which may be all that differs."""
    cause = e.model.causes[0]
    return cause.label if isinstance(cause, AddedJoint) else name_of(e)


def estimates(e: Evaluation, std: Array | None = None) -> dict[str, Estimate]:
    """Parameters of the first cause of a fitted model; with standard deviations of its own unless given, (n,)."""
    cause, std = e.model.causes[0], e.std if std is None else std
    named: dict[str, Estimate] = {}
    if is_dataclass(cause) and not isinstance(cause, WrongParameter):
        named = {
            f.name: Estimate(v) for f in fields(cause) for v in [getattr(cause, f.name)] if isinstance(v, str) and v
        }
    return named | {
        f.name: Estimate(f.value(x), float(s), f.unit)
        for f, x, s in zip(e.model.free, e.x, std, strict=True)
        if f.cause == 0
    }


def off_support(base: Evaluation) -> Iterator[str]:
    """For how long the tip is off its support."""
    share = {number: solution.off for number, solution in base.solutions.items()}
    lifted = [number for number, off in share.items() if off > 0.0]
    if lifted:
        yield (
            f"The tip is off its support in records {', '.join(map(str, lifted))}, for up to "
            f"{max(share.values()):.2g} of the period."
        )
