"""The command ``hbm inverse``: what happens at the contact, from measured spectra."""

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from hbm.commands.budgets import RunSeconds, seconds_of, within
from hbm.commands.options import (
    LARGEST_H,
    UNSOLVABLE,
    AllowCode,
    Formulation,
    RigFile,
    check_order,
    check_out,
    console,
    named,
    positive,
    print_written,
    quoted,
    whole,
)
from hbm.commands.tolerance import Tolerance, tolerances_of
from hbm.errors import InputError

if TYPE_CHECKING:
    from hbm.identification.contacterrors import ContactErrors
    from hbm.inverse.reconstruction import Reconstructed, Reconstruction
    from hbm.measurement.spectra import MeasuredSpectra
    from models.jointed import AnyRig, JointedRig
    from models.rig import Rig

COMMAND = "inverse"
ADVICE = "try fewer records (--record), fewer harmonics in SPECTRA, or a larger --max-seconds"
Made = tuple[Mapping[str, str | bytes], Callable[[], None]]
"""What goes into a folder, and what prints what was found."""
MOST_SENSORS = 1000

LENGTH, LENGTH_TOLERANCE = "beam.length", 0.003
"""Clamps are soft and supports are wide: the length between them is hardly known better, relative."""

SpectraFile = Annotated[
    Path,
    typer.Argument(metavar="SPECTRA", help="Spectra file (csv, npz, nc or mat), see hbm spectra.", show_default=False),
]


Repeatability = Annotated[
    str | None,
    typer.Option(
        metavar="PERCENT",
        help="What the structure does differently from one mounting to the next, of its response: part of the noise, "
        "or all of it where SPECTRA has no std.",
    ),
]


def inverse(
    rig: RigFile,
    spectra: SpectraFile,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write everything into this folder; made if its parent exists.")
    ] = None,
    formulation: Formulation = None,
    record: Annotated[
        list[str] | None, typer.Option("--record", metavar="N ...", help="Only these records, and draw all of them.")
    ] = None,
    design: Annotated[
        bool,
        typer.Option("--design", help="Print where sensors see friction best, for these frequencies and this noise."),
    ] = False,
    sensors: Annotated[
        str | None, typer.Option(metavar="COUNT", help="With --design: how many; as many as measured where omitted.")
    ] = None,
    tolerance: Tolerance = None,
    repeatability: Repeatability = None,
    max_seconds: RunSeconds = "600",
    allow_code: AllowCode = False,
) -> None:
    """Friction force, reaction, slip and slip velocity with uncertainty, from measured spectra.

    Of a rig with joints: force and motion at every port. Uncertain by noise, and by what the numbers of the rig file
    may be off by (--tolerance); where sensors agree better with others, calibrated.toml is a rig file with these.

    Writes signals, energy and harmonics as tables and arrays, figures with the numbers of each curve, and one page that
    opens offline, report.html.

    Example:  hbm inverse rig.toml spectra.csv --out contact
    """
    check_order(COMMAND, rig, spectra)
    count, limit = _count(sensors, design), seconds_of(COMMAND, max_seconds)
    records, percent = different(COMMAND, "--record", record), share(COMMAND, repeatability)
    if out is not None:
        check_out(COMMAND, out, _files())
    if formulation is not None:
        check_formulation(COMMAND, formulation)
    from hbm.rigfiles.load import load_rig
    from models.jointed import JointedRig

    loaded = load_rig(rig, allow_code=allow_code or None)
    measured = noisy(loaded, _selected(spectra, loaded, records, percent), percent)
    tolerances = tolerances_of(COMMAND, loaded, tolerance)
    if out is None and not design:  # after all that is wrong otherwise
        raise InputError(f"{COMMAND}: --out is missing; must name a folder, or --design be asked for")
    numbers = measured.records.tolist() if records else None
    made = None
    with within(COMMAND, limit, lambda: f"at {len(measured)} records", ADVICE):
        if isinstance(loaded, JointedRig):
            _refuse_of_joints(rig, loaded, {"--design": design, "--formulation": formulation})
            made = _made_of_joints(loaded, measured, numbers, _Given(rig, tolerances, out or Path()))
        else:
            if design:
                _print_design(loaded, measured, count)
            if out is not None:
                contact = reconstructed(COMMAND, loaded, measured, formulation)
                made = _made(contact, numbers, _Given(rig, tolerances, out))
    if made is not None and out is not None:
        _write(*made, out)


def _files() -> tuple[str, ...]:
    """All that the command may write."""
    from hbm.files import inversereport, jointinverse

    return tuple(dict.fromkeys([*inversereport.FILES, *jointinverse.FILES]))


def _refuse_of_joints(rig: Path, loaded: "JointedRig", options: Mapping[str, object]) -> None:
    if not loaded.joints:
        raise InputError(f"{COMMAND}: {rig} has no [contact] and no [[joints]]; must have one, whose forces are found")
    for name, given in options.items():
        if given:
            raise InputError(f"{COMMAND}: {name} and {rig}, which has [[joints]]; must be a rig with [contact]")


def _count(text: str | None, design: bool) -> int | None:
    if text is None:
        return None
    if not design:
        raise InputError(f"{COMMAND}: --sensors without --design; must have both")
    return whole(COMMAND, "--sensors", text, MOST_SENSORS)


def _print_design(rig: "Rig", spectra: "MeasuredSpectra", count: int | None) -> None:
    """Where to put sensors, for the frequencies, the harmonics and the noise of the measurement."""
    import numpy as np

    from hbm.inverse.placement import place_sensors

    channels = {c.name: c.quantity for c in rig.channels if c.name in spectra.channels}
    responses = [name for name, quantity in channels.items() if quantity != "force"]
    if not responses:
        raise InputError(f"{spectra.source}: holds no response channel; must hold one, its noise is designed for")
    quantity = channels[responses[0]]

    def noise(names: Sequence[str]) -> float:
        return float(np.nanmedian(np.concatenate([spectra.std[:, spectra.index(name), 1:].ravel() for name in names])))

    forces = [name for name, quantity in channels.items() if quantity == "force"]
    with named(COMMAND), working("trying positions"):
        placed = place_sensors(
            rig,
            count=count or len(responses),
            hz=(float(spectra.hz.min()), float(spectra.hz.max())),
            harmonics=spectra.H,
            noise=noise([name for name in responses if channels[name] == quantity]),
            quantity=quantity,
            force_noise=noise(forces) if forces else None,
        )
    print(placed)


# ---------------------------------------------------------------------------------------------------------- shared


def different(command: str, option: str, records: Sequence[str] | None) -> list[str]:
    """Records that an option names, each once."""
    for i, text in enumerate(records or ()):
        if text in (records or ())[:i]:
            raise InputError(f"{command}: {option} = {quoted(text)} twice; must be different records")
    return list(records or ())


def check_formulation(command: str, name: str) -> None:
    """Refuse a formulation that there is not."""
    from hbm.inverse.reconstruct import FORMULATIONS

    if name not in FORMULATIONS:
        raise InputError(f"{command}: --formulation = {quoted(name)}; must be one of {', '.join(FORMULATIONS)}")


def share(command: str, percent: str | None) -> float:
    """Repeatability as a share of the response."""
    if percent is None:
        return 0.0
    found = positive(command, "--repeatability", percent, "%") / 100.0
    if found >= 1.0:
        raise InputError(f"{command}: --repeatability = {percent}; must be below 100 %")
    return found


def load(rig: Path, spectra: Path, repeatability: float, *, allow_code: bool) -> tuple["Rig", "MeasuredSpectra"]:
    """The rig and its spectra; the repeatability stands in for standard deviations where there are none."""
    from hbm.rigfiles.load import load_contact_rig

    loaded = load_contact_rig(rig, "this command", allow_code=allow_code or None)
    measured = _selected(spectra, loaded, (), repeatability)
    if measured.H > LARGEST_H:
        raise InputError(
            f"{spectra}: harmonics up to {measured.H}; must be at most {LARGEST_H} for a command that simulates them"
        )
    return loaded, measured


def _selected(spectra: Path, rig: "AnyRig", records: Sequence[str], repeatability: float) -> "MeasuredSpectra":
    from hbm.measurement.spectrafile import load_spectra

    measured = load_spectra(spectra, rig, repeatability=repeatability)
    return measured.select(records=records) if records else measured


def noisy(rig: "AnyRig", spectra: "MeasuredSpectra", repeatability: float) -> "MeasuredSpectra":
    """Spectra whose noise holds a repeatability, once."""
    from hbm.measurement.repeatability import with_floor

    moves = [c.name for c in rig.channels if c.quantity != "force" and c.name in spectra.channels]
    return with_floor(spectra, moves, repeatability)


def reconstructed(command: str, rig: "Rig", spectra: "MeasuredSpectra", formulation: str | None) -> "Reconstruction":
    """Contact signals; what cannot be computed is said with the command's name."""
    from numpy.linalg import LinAlgError

    from hbm.inverse.reconstruct import reconstruct

    try:
        with working(f"reconstructing {len(spectra)} records"):
            if formulation is None:
                return reconstruct(rig, spectra)
            return reconstruct(rig, spectra, formulation=formulation)
    except LinAlgError:
        raise ArithmeticError(f"{command}: {spectra.source}: {UNSOLVABLE}") from None


@contextmanager
def working(doing: str) -> Iterator[None]:
    """Show on a terminal what is being done."""
    from rich.console import Console

    terminal = Console(stderr=True)
    if not sys.stderr.isatty():
        yield
        return
    with terminal.status(doing):
        yield


class _Given(NamedTuple):
    """The rig file, what its numbers may be off by, and the folder that is written."""

    rig: Path
    tolerances: Mapping[str, float] | None
    out: Path


def _made(found: "Reconstruction", records: Sequence[int] | None, given: _Given) -> Made:
    from hbm.commands.inversetables import print_contact_errors, print_reconstruction
    from hbm.files.inversereport import inverse_contents

    tolerances = with_length(found.rig, given.tolerances)
    errors = None if found.unit else _errors(found, tolerances)  # in a wrong unit sensors ask for any number
    with working("drawing"):
        contents = inverse_contents(found, records, errors, given.rig)

    def tell() -> None:
        print_reconstruction(console(), found)
        if errors is not None:
            print_contact_errors(console(), errors, given.out)

    return contents, tell


def _made_of_joints(
    rig: "JointedRig", spectra: "MeasuredSpectra", records: Sequence[int] | None, given: _Given
) -> Made:
    from hbm.commands.inversetables import print_contact_errors, print_joint_reconstruction
    from hbm.files.jointinverse import joint_inverse_contents
    from hbm.inverse.jointed import reconstruct_joints

    with working(f"reconstructing {len(spectra)} records"):
        found = reconstruct_joints(rig, spectra)
    errors = _errors(found, given.tolerances)
    with working("drawing"):
        contents = joint_inverse_contents(found, records, errors, given.rig)

    def tell() -> None:
        print_joint_reconstruction(console(), found)
        print_contact_errors(console(), errors, given.out)

    return contents, tell


def with_length(rig: "Rig", tolerances: Mapping[str, float] | None) -> Mapping[str, float]:
    """Tolerances of a rig's numbers, and that of the length of its beam where none is stated."""
    return ({LENGTH: LENGTH_TOLERANCE} if rig.beam is not None else {}) | dict(tolerances or {})


def _errors(found: "Reconstructed", tolerances: Mapping[str, float] | None) -> "ContactErrors":
    from hbm.identification.contacterrors import contact_errors

    with working("what the rig file may be off by"):
        return contact_errors(found, tolerances)


def _write(contents: Mapping[str, str | bytes], tell: Callable[[], None], out: Path) -> None:
    """Write a folder, tell what was found, and what was written."""
    from hbm.files.inversefiles import NEEDED_FOR_NETCDF, NETCDF_FILE, has_netcdf
    from hbm.files.outputs import write_folder

    written = write_folder(out, contents, _files())
    tell()
    print_written(written)
    if not has_netcdf():
        print(f"no {NETCDF_FILE}: needs {NEEDED_FOR_NETCDF}; pip install 'casadi-hbm[io]'")
