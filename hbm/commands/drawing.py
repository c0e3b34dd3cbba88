"""Options of ``hbm frf`` that say how curves are drawn, and the measured points that are drawn over them."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hbm.errors import InputError

if TYPE_CHECKING:
    from hbm.measurement.spectra import MeasuredSpectra
    from models.jointed import AnyRig

SAME = 0.02
"""Forces are one level which differ by less than this share."""

Measured = Annotated[
    Path | None,
    typer.Option(
        metavar="SPECTRA",
        help="With --plot: draw what was measured over the curves of the sensors; levels are those measured "
        "where --level is omitted.",
    ),
]
Sensors = Annotated[
    bool, typer.Option("--sensors", help="With --plot: draw the drive and every sensor instead of the contact.")
]
Log = Annotated[bool, typer.Option("--log", help="With --sensors or --measured: logarithmic amplitudes.")]
PerForce = Annotated[
    bool, typer.Option("--per-force", help="With --sensors or --measured: amplitudes per newton of force.")
]


def check_drawing(
    command: str, plot: Path | None, measured: Path | None, *, sensors: bool, flags: Mapping[str, bool]
) -> None:
    """Refuse options of a figure that is not drawn."""
    wanted = {"--measured": measured is not None, "--sensors": sensors}
    for option, given in wanted.items():
        if given and plot is None:
            raise InputError(f"{command}: {option} without --plot; must have both")
    for option, given in flags.items():
        if given and not any(wanted.values()):
            raise InputError(f"{command}: {option} without --sensors or --measured; must have one of them")


def load_points(path: Path | None, rig: "AnyRig") -> "MeasuredSpectra | None":
    """What was measured of a rig, None where no file is named."""
    if path is None:
        return None
    from hbm.measurement.spectrafile import load_spectra

    return load_spectra(path, rig)


def levels_of(measured: "MeasuredSpectra") -> list[float]:
    """Levels of a measurement; forces that differ by little are one."""
    groups: list[list[float]] = []
    for level in sorted(measured.level.tolist()):
        if groups and level <= groups[-1][0] * (1.0 + SAME):
            groups[-1].append(level)
        else:
            groups.append([level])
    return [group[len(group) // 2] for group in groups]
