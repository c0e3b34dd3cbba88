"""The command ``hbm spectra``: time histories to a spectra file."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hbm.commands.budgets import RunSeconds, seconds_of, within
from hbm.commands.options import AllowCode, console, named, not_negative, positive, print_written, quoted, whole
from hbm.errors import InputError

if TYPE_CHECKING:
    from hbm.measurement.harmonicestimate import HarmonicEstimate
    from hbm.measurement.manifest import Entry
    from hbm.measurement.recording import Recording
    from hbm.measurement.spectra import MeasuredSpectra
    from models.jointed import AnyRig

COMMAND = "spectra"
ADVICE = "try fewer or shorter recordings, or a larger --max-seconds"
FORCE = "force"

FAR_OFF = 4.0
"""A level is not the force that was measured where they are so many times apart: pounds and newtons are 4.4."""


def spectra(
    histories: Annotated[
        list[Path],
        typer.Argument(
            metavar="HISTORY",
            help="Time histories, one steady state each: CSV (time and one column per channel), MAT, NPZ, UFF58 or "
            "TDMS; or a folder of them, or a manifest (CSV or TOML) that lists them with all that is known of each.",
            show_default=False,
        ),
    ],
    out: Annotated[Path, typer.Option(metavar="SPECTRA", help="Write here (csv, nc, mat or uff).", show_default=False)],
    fundamental: Annotated[
        list[str] | None,
        typer.Option(
            "--fundamental",
            metavar="HZ ...",
            help="Excitation frequency: one, or one per file; where omitted, what the manifest or the file names say.",
        ),
    ] = None,
    level: Annotated[
        list[str] | None,
        typer.Option(
            "--level",
            metavar="N ...",
            help="Nominal force amplitude: one, or one per file; where omitted, what the manifest or the file names "
            "say, or the fundamental of the force channel, of a multisine its rms.",
        ),
    ] = None,
    harmonics: Annotated[str, typer.Option(metavar="H", help="Highest harmonic.")] = "9",
    settle: Annotated[str, typer.Option(metavar="S", help="Seconds left out at the beginning.")] = "0",
    rig: Annotated[
        Path | None, typer.Option(metavar="RIG", help="Rig file (TOML); only its channels are accepted.")
    ] = None,
    channel: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=COLUMN", help="Call a channel of the files otherwise; repeated for each."),
    ] = None,
    sweep: Annotated[
        bool,
        typer.Option("--sweep", help="Histories are slow sine sweeps: many records each, of 4 cycles."),
    ] = False,
    reference: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="With --sweep: channel that gives the phase; the force where omitted."),
    ] = None,
    refine: Annotated[
        bool, typer.Option("--refine", help="Refine each fundamental with the force channel (without one: the first).")
    ] = False,
    max_seconds: RunSeconds = "600",
    allow_code: AllowCode = False,
) -> None:
    """Harmonic coefficients with standard deviations from time histories of steady states.

    Whole periods are fitted by least squares; standard deviations come from the scatter between blocks of them.
    Records that are not steady, lines between harmonics, flat-topped and dead channels are warned of, here and in the
    spectra file.

    Example:  hbm spectra run1.csv run2.csv --fundamental 48 49.5 --settle 2 --rig rig.toml --out spectra.csv

    Of slow sweeps (--sweep): harmonics along the phase of the sweep, less what linear modes lag by behind their steady
    states; standard deviations hold what is not known of the lag. Sweeps too fast for their resonances are warned of.

    Example:  hbm spectra recordings/ --settle 2 --rig rig.toml --out spectra.csv

    Example:  hbm spectra up.csv down.csv --sweep --harmonics 5 --out spectra.csv
    """
    from hbm.measurement.spectrafile import LARGEST_HARMONIC, WRITTEN
    from hbm.textfiles import check_output

    with named(COMMAND):
        check_output(out, WRITTEN, "--out")
    limit, entries = seconds_of(COMMAND, max_seconds), _entries(histories)
    if sweep:
        for option, given in (("--fundamental", fundamental), ("--level", level), ("--refine", refine)):
            if given:
                raise InputError(f"{COMMAND}: {option} with --sweep; must have one of them")
        with within(COMMAND, limit, lambda: f"at {len(entries)} recordings", ADVICE):
            chosen = _columns(channel or ())
            found, units = _sweeps(entries, chosen, rig, reference, harmonics, settle, str(out), allow_code)
        _deliver_sweeps(found, units, out)
        return
    if reference:
        raise InputError(f"{COMMAND}: --reference without --sweep; must have both")
    hz = _hz(fundamental, entries)
    levels = _per_file("--level", level, "N", entries) if level else [entry.level for entry in entries]
    H, seconds, columns = (
        whole(COMMAND, "--harmonics", harmonics, LARGEST_HARMONIC),
        not_negative(COMMAND, "--settle", settle, "s"),
        _columns(channel or ()),
    )
    from hbm.commands.tables import print_lines, print_spectra
    from hbm.measurement.harmonicestimate import spectra_of_records
    from hbm.measurement.harmonics import harmonic_spectra
    from hbm.measurement.spectrafile import write_spectra
    from hbm.rigfiles.load import load_rig

    loaded = None if rig is None else load_rig(rig, allow_code=allow_code or None)
    force = _force_name(loaded)
    with within(COMMAND, limit, lambda: f"at {len(entries)} recordings", ADVICE):
        recordings = [_recorded(entry, columns, loaded) for entry in entries]
        estimates = [
            harmonic_spectra(r, f, H, settle=seconds, refine=_reference(r, force) if refine else None)
            for r, f in zip(recordings, hz, strict=True)
        ]
    known = [_level(e, force) if level is None else level for e, level in zip(estimates, levels, strict=True)]
    write_spectra(out, spectra_of_records(estimates, known, _names(recordings, loaded), str(out)), _units(estimates))
    print_spectra(console(), estimates, known)
    print_lines(console(), _contradicted(estimates, known, force))
    print_written([out])


def _sweeps(
    entries: Sequence["Entry"],
    columns: dict[str, str],
    rig: Path | None,
    reference: str | None,
    harmonics: str,
    settle: str,
    source: str,
    allow_code: bool,
) -> tuple["MeasuredSpectra", Mapping[str, str]]:
    """Spectra of slow sweeps, and the units of their channels."""
    from hbm.commands.options import LARGEST_H
    from hbm.measurement.sweep import sweep_spectra, swept
    from hbm.rigfiles.load import load_rig

    H, seconds = whole(COMMAND, "--harmonics", harmonics, LARGEST_H), not_negative(COMMAND, "--settle", settle, "s")
    loaded = None if rig is None else load_rig(rig, allow_code=allow_code or None)
    recordings = [_recorded(entry, columns, loaded, reference) for entry in entries]
    force = _force_name(loaded)
    settled = [r.between(float(r.time[0]) + seconds, math.inf) for r in recordings]
    return sweep_spectra([swept(r, reference or force, H) for r in settled], force, source), _units(recordings)


def _deliver_sweeps(found: "MeasuredSpectra", units: Mapping[str, str], out: Path) -> None:
    from hbm.commands.tables import print_lines
    from hbm.measurement.spectrafile import write_spectra

    write_spectra(out, found, units)
    print_lines(console(), [str(found), *(f"warning: {line}" for line in found.warnings)])
    print_written([out])


# ---------------------------------------------------------------------------------------------------------- options


def _entries(histories: Sequence[Path]) -> list["Entry"]:
    from hbm.measurement.manifest import entries_of

    return entries_of(histories)


def _hz(texts: Sequence[str] | None, entries: Sequence["Entry"]) -> list[float]:
    """Excitation frequency of each recording: of the option, of the manifest or of the file's name."""
    if texts:
        return _per_file("--fundamental", texts, "Hz", entries)
    if all(entry.hz is None for entry in entries):
        raise InputError(f"hbm {COMMAND}: missing option '--fundamental'; see hbm {COMMAND} --help")
    for entry in entries:
        if entry.hz is None:
            raise InputError(
                f"{COMMAND}: {entry.file} has no frequency; must have it in the manifest, in its name "
                "(run_48.5Hz.csv), or by --fundamental"
            )
    return [entry.hz for entry in entries if entry.hz is not None]


def _per_file(option: str, texts: Sequence[str], unit: str, files: Sequence[object]) -> list[float]:
    """One number for all files, or one for each."""
    values = [positive(COMMAND, option, text, unit) for text in texts]
    if len(values) not in (1, len(files)):
        several = f", or {len(files)}, one per file" if len(files) > 1 else ""
        raise InputError(f"{COMMAND}: {option} has {len(values)} numbers; must have 1{several or ', for one file'}")
    return values * len(files) if len(values) == 1 else values


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


def _recorded(
    entry: "Entry", columns: dict[str, str], rig: "AnyRig | None", reference: str | None = None
) -> "Recording":
    """A history whose channels are the rig's, in their units; what only a simulation knows is left out.

    Without a rig only the force is known by its name. It may be a voltage, and so may what gives a sweep its phase.
    """
    from hbm.measurement.historyfile import load_history
    from models.parts import UNITS

    path, computed = entry.file, rig.computed if rig else ()
    drives = (_force_name(rig), reference or "")
    known = [c.name for c in rig.channels] if rig else ()
    recorded = load_history(path, columns or entry.channels, entry.units, drives=drives, known=known)
    recorded = entry.part(recorded)
    measured = {name: values for name, values in recorded.channels.items() if name not in computed}
    recorded = replace(recorded, channels=measured)
    quantities = {FORCE: "force"} if rig is None else {c.name: c.quantity for c in rig.channels}
    for name in recorded.channels:
        if rig and name not in quantities:
            raise InputError(
                f'{path}: channel "{name}" is not in the rig; channels are {", ".join(quantities) or "none"}; '
                "try --channel NAME=COLUMN"
            )
        if name in quantities:
            recorded.expect_quantity(name, quantities[name], "the rig" if rig else "")
    if rig is None:
        return recorded
    return replace(recorded, units={n: recorded.units[n] or UNITS[quantities[n]] for n in recorded.channels})


def _force_name(rig: "AnyRig | None") -> str:
    forces = [] if rig is None else [c.name for c in rig.channels if c.quantity == "force"]
    return forces[0] if forces else FORCE


def _reference(recorded: "Recording", force: str) -> str:
    return force if force in recorded.channels else next(iter(recorded.channels))


def _level(estimate: "HarmonicEstimate", force: str) -> float:
    if force not in estimate.channels:
        raise InputError(
            f"{COMMAND}: {estimate.source} has no channel {force} that moves; must have it (--channel {force}=COLUMN), "
            "or give --level where no force was measured"
        )
    return estimate.amplitude(force)


def _contradicted(estimates: Sequence["HarmonicEstimate"], levels: Sequence[float], force: str) -> list[str]:
    """Warnings of levels far from the force that was measured, as in another unit."""
    lines = []
    for e, level in zip(estimates, levels, strict=True):
        if force in e.channels and e.units.get(force) in ("", "N"):
            measured = e.amplitude(force)
            if not level / FAR_OFF <= measured <= level * FAR_OFF:
                lines.append(
                    f"warning: {e.source}: level = {level:g} N, where the fundamental of {force} is {measured:.4g} N; "
                    "check both and their units"
                )
    return lines


def _names(recordings: Sequence["Recording"], rig: "AnyRig | None") -> list[str]:
    """Channels in the order of the rig, or of their first appearance."""
    if rig is not None:
        return [c.name for c in rig.channels]
    return list(dict.fromkeys(name for recorded in recordings for name in recorded.channels))


def _units(found: Sequence["HarmonicEstimate | Recording"]) -> dict[str, str]:
    """Units of the channels, which are those of every file that says one."""
    units: dict[str, str] = {}
    for one in found:
        for name, unit in one.units.items():
            if unit and units.setdefault(name, unit) != unit:
                raise InputError(f"{one.source}: {name} is in {unit}; must be in {units[name]}, as in the files before")
    return units
