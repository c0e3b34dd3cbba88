"""The option ``--tolerance``: what numbers of a rig file may be off by."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from hbm.commands.options import not_negative, quoted
from hbm.errors import InputError

if TYPE_CHECKING:
    from models.jointed import AnyRig

Tolerance: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--tolerance",
        metavar="KEY=VALUE",
        help="What a number of the rig file may be off by, relative standard deviation, 0 if it is exact; repeated "
        "for each.",
    ),
]


def tolerances_of(command: str, rig: "AnyRig", texts: Sequence[str] | None) -> dict[str, float]:
    """Tolerances that the options state of numbers of a rig."""
    from hbm.outputerror.nominal import tolerances

    stated: dict[str, float] = {}
    for text in texts or ():
        key, equals, value = text.partition("=")
        if not equals:
            raise InputError(f"{command}: --tolerance = {quoted(text)}; must be KEY=VALUE")
        stated[key] = not_negative(command, f"--tolerance {key}", value, "relative")
    tolerances(rig, (), stated, command)  # refuses what is no number of the rig
    return stated
