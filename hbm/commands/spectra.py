"""The command ``hbm spectra``: time histories to a spectra file."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hbm.commands.options import LARGEST_H, AllowCode, console, is_number, named, positive, print_written, quoted, whole
from hbm.errors import InputError

if TYPE_CHECKING:
    from hbm.measurement.harmonicestimate import HarmonicEstimate
    from hbm.measurement.recording import Recording
    from models.rig import Rig

COMMAND = "spectra"
FORCE = "force"


def spectra(
    histories: Annotated[
        list[Path],
        typer.Argument(
            metavar="HISTORY",
            help="Time histories, one steady state each: CSV (time_s and one column per channel), MAT, UFF58 or TDMS.",
            show_default=False,
        ),
    ],
    fundamental: Annotated[
        list[str],
        typer.Option(
            "--fundamental", metavar="HZ ...", help="Excitation frequency: one, or one per file.", show_default=False
        ),
    ],
    out: Annotated[Path, typer.Option(metavar="SPECTRA", help="Write here (csv, nc, mat or uff).", show_default=False)],
    level: Annotated[
        list[str] | None,
        typer.Option(
            "--level",
            metavar="N ...",
            help="Nominal force amplitude: one, or one per file; where omitted, the fundamental of the force channel.",
        ),
    ] = None,
    harmonics: Annotated[str, typer.Option(metavar="H", help="Highest harmonic.")] = "9",
    settle: Annotated[str, typer.Option(metavar="S", help="Seconds left out at the beginning.")] = "0",
    rig: Annotated[
        Path | None, typer.Option(metavar="RIG", help="Rig file (TOML); only its channels are accepted.")
    ] = None,
    channel: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=COLUMN", help="Keep a channel of the files under another name; repeated for each."),
    ] = None,
    refine: Annotated[
        bool, typer.Option("--refine", help="Refine each fundamental with the force channel (without one: the first).")
    ] = False,
    allow_code: AllowCode = False,
) -> None:
    """Harmonic coefficients with standard deviations from time histories of steady states.

    Whole periods are fitted by least squares; standard deviations come from the scatter between blocks of them.
    Records that are not steady, lines between harmonics, flat-topped and dead channels are warned of.

    Example:  hbm spectra run1.csv run2.csv --fundamental 48 49.5 --settle 2 --rig rig.toml --out spectra.csv
    """
    from hbm.measurement.spectrafile import WRITTEN
    from hbm.textfiles import check_output

    with named(COMMAND):
        check_output(out, WRITTEN, "--out")
    hz = _per_file("--fundamental", fundamental, "Hz", histories)
    levels = _per_file("--level", level, "N", histories) if level else None
    H, seconds, columns = whole(COMMAND, "--harmonics", harmonics, LARGEST_H), _settle(settle), _columns(channel or ())
    from hbm.commands.tables import print_spectra
    from hbm.measurement.harmonicestimate import spectra_of_records
    from hbm.measurement.harmonics import harmonic_spectra
    from hbm.measurement.spectrafile import write_spectra
    from hbm.rigfiles.load import load_contact_rig

    loaded = None if rig is None else load_contact_rig(rig, "spectra", allow_code=allow_code or None)
    recordings = [_recorded(path, columns, loaded) for path in histories]
    force = _force_name(loaded)
    estimates = [
        harmonic_spectra(r, f, H, settle=seconds, refine=_reference(r, force) if refine else None)
        for r, f in zip(recordings, hz, strict=True)
    ]
    levels = levels or [_level(e, force) for e in estimates]
    write_spectra(out, spectra_of_records(estimates, levels, _names(recordings, loaded), str(out)), _units(estimates))
    print_spectra(console(), estimates, levels)
    print_written([out])


# ---------------------------------------------------------------------------------------------------------- options


def _per_file(option: str, texts: Sequence[str], unit: str, files: Sequence[Path]) -> list[float]:
    """One number for all files, or one for each."""
    values = [positive(COMMAND, option, text, unit) for text in texts]
    if len(values) not in (1, len(files)):
        raise InputError(f"{COMMAND}: {option} has {len(values)} numbers; must have 1, or {len(files)}, one per file")
    return values * len(files) if len(values) == 1 else values


def _settle(text: str) -> float:
    if not is_number(text) or not 0.0 <= float(text) < math.inf:
        raise InputError(f"{COMMAND}: --settle = {quoted(text)}; must be a number >= 0 [s]")
    return float(text)


def _columns(texts: Sequence[str]) -> dict[str, str]:
    columns: dict[str, str] = {}
    for text in texts:
        name, _, column = text.partition("=")
        if not name or not column:
            raise InputError(f"{COMMAND}: --channel = {quoted(text)}; must be NAME=COLUMN")
        if name in columns:
            raise InputError(f"{COMMAND}: --channel {name} twice; must be once")
        columns[name] = column
    return columns


# --------------------------------------------------------------------------------------------------------- channels


def _recorded(path: Path, columns: dict[str, str], rig: "Rig | None") -> "Recording":
    """A history whose channels are the rig's, in their units."""
    from hbm.measurement.historyfile import load_history
    from models.parts import UNITS

    recorded = load_history(path, columns)
    quantities = {} if rig is None else {c.name: c.quantity for c in rig.channels}
    for name in recorded.channels if rig else ():
        if name not in quantities:
            raise InputError(
                f'{path}: channel "{name}" is not in the rig; channels are {", ".join(quantities) or "none"}; '
                "try --channel NAME=COLUMN"
            )
        unit, accepted = recorded.units.get(name, ""), UNITS[quantities[name]]
        if unit not in ("", accepted):
            raise InputError(f"{path}: channel {name} is in {unit}; must be {quantities[name]}, {accepted}, in the rig")
    known = {name: UNITS[quantities[name]] for name in recorded.channels} if rig else recorded.units
    return replace(recorded, units=known)


def _force_name(rig: "Rig | None") -> str:
    forces = [] if rig is None else [c.name for c in rig.channels if c.quantity == "force"]
    return forces[0] if forces else FORCE


def _reference(recorded: "Recording", force: str) -> str:
    return force if force in recorded.channels else next(iter(recorded.channels))


def _level(estimate: "HarmonicEstimate", force: str) -> float:
    if force not in estimate.channels:
        raise InputError(
            f"{COMMAND}: {estimate.source} has no channel {force} that moves; must have it, or give --level"
        )
    return estimate.amplitude(force)


def _names(recordings: Sequence["Recording"], rig: "Rig | None") -> list[str]:
    """Channels in the order of the rig, or of their first appearance."""
    if rig is not None:
        return [c.name for c in rig.channels]
    return list(dict.fromkeys(name for recorded in recordings for name in recorded.channels))


def _units(estimates: Sequence["HarmonicEstimate"]) -> dict[str, str]:
    return {name: unit for e in estimates for name, unit in e.units.items() if unit}
