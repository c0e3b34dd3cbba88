"""The option ``--stability`` of the commands that trace curves."""

from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

if TYPE_CHECKING:
    from hbm.response.curve import ResponseCurve

Curve = TypeVar("Curve", bound="ResponseCurve")

Stability = Annotated[
    bool, typer.Option("--stability/--no-stability", help="Work out which points are stable, and the bifurcations.")
]


def judged(curve: Curve) -> Curve:
    """The curve with its stability, or as it is where that cannot be told, and why."""
    from hbm.response.bifurcations import with_stability

    try:
        return with_stability(curve)
    except ValueError as refused:
        print(f"{curve.level:g} N: {refused}")
        return curve
