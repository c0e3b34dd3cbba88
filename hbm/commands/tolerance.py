"""The option ``--tolerance``: what numbers of a rig file may be off by."""

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from hbm.commands.options import positive, quoted
from hbm.errors import InputError

if TYPE_CHECKING:
    from models.jointed import AnyRig

Tolerance: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--tolerance",
        metavar="KEY=VALUE",
        help="What a number of the rig file may be off by, relative standard deviation; repeated for each.",
    ),
]


def tolerances_of(
    command: str, rig: "AnyRig", measured: Collection[str], texts: Sequence[str] | None
) -> Mapping[str, float] | None:
    """Tolerances of the numbers of a rig of which some channels were measured, with the options; None without any."""
    if not texts:
        return None
    from hbm.outputerror.nominal import nominal_scalars, tolerances

    known, chosen = nominal_scalars(rig), tolerances(rig, measured)
    for text in texts:
        key, equals, value = text.partition("=")
        if not equals:
            raise InputError(f"{command}: --tolerance = {quoted(text)}; must be KEY=VALUE")
        if not (known.get(key) or (key in known and key.endswith(".delay"))):
            accepted = ", ".join(name for name, number in known.items() if number)
            raise InputError(f"{command}: --tolerance {key}; must be a number of the rig file, not 0: {accepted}")
        chosen[key] = positive(command, f"--tolerance {key}", value, "relative")
    return chosen
