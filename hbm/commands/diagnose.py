"""The command ``hbm diagnose``: what a simulation gets wrong, the cause, and what the extended model gains."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hbm.commands.budgets import RunSeconds, seconds_of, within
from hbm.commands.inverse import Repeatability, different, share, working
from hbm.commands.options import (
    UNSOLVABLE,
    AllowCode,
    OutFolder,
    RigFile,
    both_ends,
    check_order,
    check_out,
    console,
    named,
    print_written,
    quoted,
    say,
)
from hbm.commands.tolerance import Tolerance, tolerances_of
from hbm.errors import InputError

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from hbm.diagnosis.discrepancy import Discrepancy
    from hbm.diagnosis.verdict import Diagnosis
    from hbm.files.diagnosed import Diagnosed
    from hbm.measurement.decay import Decay
    from hbm.measurement.spectra import MeasuredSpectra
    from models.jointed import AnyRig

COMMAND = "diagnose"
ADVICE = "a verdict needs all causes; try fewer records, the causes in question with --cause, or a larger --max-seconds"

NEARLY_DONE = 0.97
"""Fraction of the work that is done when the verdict is known."""


def diagnose(
    rig: RigFile,
    spectra: Annotated[
        Path,
        typer.Argument(
            metavar="SPECTRA",
            help="Spectra file (csv, npz, nc or mat), see hbm spectra; or the table of hbm decay.",
            show_default=False,
        ),
    ],
    out: OutFolder,
    hold_out: Annotated[
        list[str] | None,
        typer.Option(
            "--hold-out",
            metavar="N ...",
            help="Records no fit sees, on which the gain is measured; where omitted a level and a band of frequencies, "
            "of a decay every third amplitude.",
        ),
    ] = None,
    cause: Annotated[
        list[str] | None,
        typer.Option(
            "--cause",
            metavar="NAME",
            help="A cause to try, or one's own, file.py:Class; repeated for each. The whole catalogue where omitted.",
        ),
    ] = None,
    causes_file: Annotated[
        Path | None,
        typer.Option(metavar="F.py", help="Try the causes of one's own in this file too; the file is run."),
    ] = None,
    tolerance: Tolerance = None,
    repeatability: Repeatability = None,
    begin: Annotated[
        str | None, typer.Option("--from", metavar="HZ", help="Compare no response below, where no mode of RIG is.")
    ] = None,
    end: Annotated[
        str | None,
        typer.Option("--to", metavar="HZ", help="Compare no response above, nor harmonics there; with --from."),
    ] = None,
    max_seconds: RunSeconds = "1800",
    allow_code: AllowCode = False,
) -> None:
    """What the simulation gets wrong, its cause, the extended rig, and what it gains on records held out.

    Writes the verdict, diagnosis.json, the extended rig, extended.toml, figures with the numbers of each curve, and one
    page that opens offline, report.html. Where nothing is named, candidates/ has the rigs that came nearest.

    Of a free decay (the table of hbm decay) joints are fitted through the nonlinear mode of the rig.

    Example:  hbm diagnose rig.toml spectra.csv --hold-out 3 7 --out diagnosis
    """
    from hbm.files.diagnosed import Diagnosed
    from hbm.files.diagnosisfiles import FILES
    from hbm.files.extendedrig import CANDIDATES

    check_order(COMMAND, rig, spectra)
    held, floor = different(COMMAND, "--hold-out", hold_out), share(COMMAND, repeatability)
    limit, band = seconds_of(COMMAND, max_seconds), both_ends(COMMAND, begin, end, "Hz")
    check_out(COMMAND, out, (*FILES, f"{CANDIDATES}/1.toml"))
    candidates, own = _causes(cause, causes_file)
    from hbm.measurement.decay import Decay
    from hbm.rigfiles.load import load_rig

    loaded = load_rig(rig, allow_code=allow_code or None)
    measured = _measured(spectra, loaded, floor, band)
    _check_apply(loaded, candidates if cause else ())
    from hbm.commands.progress import Work
    from hbm.diagnosis.curves import traced_responses
    from hbm.parallel import all_cores
    from hbm.rigfiles.laws import files_run, run_files

    tolerances = tolerances_of(COMMAND, loaded, tolerance)
    with (
        _failing(measured.source),
        Work() as work,
        within(COMMAND, limit, work.doing, ADVICE),
        all_cores(partial(run_files, files_run())) as executor,
    ):
        search = _search(measured, floor, executor)
        found = search(loaded, held_out=held or None, causes=candidates, tolerances=tolerances, on_progress=work.show)
        work.show("the force that is missing", NEARLY_DONE)
        force, failure = _missing_force(found, executor)
        work.show("response curves", NEARLY_DONE)
        traced = () if isinstance(measured, Decay) else traced_responses(found, measured, executor)
    result = Diagnosed(found, loaded, measured, force, traced, tuple(_warnings(found, failure)))
    _deliver(result, rig, out, own)
    if failure:
        raise typer.Exit(say(failure, 1))


# --------------------------------------------------------------------------------------------- options and measurements


def _measured(
    path: Path, rig: "AnyRig", repeatability: float, band: tuple[float, float] | None
) -> "MeasuredSpectra | Decay":
    """Spectra of a file, within a band of frequencies, or a decay."""
    from hbm.measurement.decayfile import is_decay, load_decay
    from hbm.measurement.spectrafile import load_spectra

    if is_decay(path):
        for option, given in (("--repeatability", repeatability), ("--from and --to", band)):
            if given:
                raise InputError(f"{COMMAND}: {option}: {path} is a decay; must be of spectra")
        return load_decay(path)
    measured = load_spectra(path, rig, repeatability=repeatability)
    return measured.between(*band, _sensors(rig, measured)) if band else measured


def _causes(names: Sequence[str] | None, file: Path | None) -> tuple[list[Any] | None, dict[type, str]]:
    """Causes to try, None for the whole catalogue; and the names of one's own."""
    if not names and file is None:
        return None, {}
    from hbm.rigfiles.causes import causes_in_file
    from models.causes import CAUSES

    chosen = [_cause(name) for name in names or ()] or list(CAUSES.values())
    own = {
        kind: f"{Path(name.rpartition(':')[0]).resolve()}:{kind.__name__}"
        for name, kind in zip(names or (), chosen, strict=False)
        if name.rpartition(":")[0].endswith(".py")
    }
    if file is not None:
        with named(f"{COMMAND}: --causes-file = {quoted(str(file))}"):
            found = causes_in_file(file)
        chosen += [kind for kind in found if kind not in chosen]
        own |= {kind: f"{file.resolve()}:{kind.__name__}" for kind in found}
    return chosen, own


def _cause(name: str) -> Any:
    from hbm.rigfiles.causes import named_cause

    with named(f"{COMMAND}: --cause = {quoted(name)}", ";"):
        return named_cause(name)


def _check_apply(rig: "AnyRig", candidates: Sequence[Any] | None) -> None:
    """Refuse causes that a rig cannot have."""
    from models.causes.cause import candidates_of

    for cause in candidates or ():
        one = not isinstance(cause, type)
        possible = [other.label for other in candidates_of(type(cause) if one else cause, rig)]
        if one and cause.label not in possible:
            raise InputError(f"{COMMAND}: --cause = {quoted(cause.label)}; must be one of {', '.join(possible)}")
        if not possible:
            raise InputError(f"{COMMAND}: --cause = {quoted(cause.name)}; there is nothing in this rig it can act on")


def _sensors(rig: "AnyRig", measured: "MeasuredSpectra | Decay") -> list[str]:
    """Channels of motion that were measured."""
    return [c.name for c in rig.response_channels if c.name in measured.channels]


# -------------------------------------------------------------------------------------------------------- computing


def _search(
    measured: "MeasuredSpectra | Decay", repeatability: float, executor: "Executor | None"
) -> "Callable[..., Diagnosis]":
    """The diagnosis of such measurements."""
    from hbm.diagnosis.backbones import diagnose_backbone
    from hbm.diagnosis.diagnose import diagnose as search
    from hbm.measurement.decay import Decay

    if isinstance(measured, Decay):
        return partial(diagnose_backbone, decay=measured)
    return partial(search, spectra=measured, repeatability=repeatability, executor=executor)


@contextmanager
def _failing(source: str) -> Iterator[None]:
    """Say what cannot be computed, with the command's name."""
    from numpy.linalg import LinAlgError

    from continuation import ConvergenceError

    try:
        yield
    except LinAlgError:
        raise ArithmeticError(f"{COMMAND}: {source}: {UNSOLVABLE}; nothing written") from None
    except ConvergenceError as failed:
        raise ArithmeticError(f"{COMMAND}: {source}: {failed}; nothing written") from None


def _missing_force(found: "Diagnosis", executor: "Executor | None") -> tuple["Discrepancy | None", str]:
    """What the model lacks, or why that could not be worked out."""
    from hbm.diagnosis.discrepancy import best_placed
    from hbm.outputerror.simulated import FAILURES

    if found.calibrated is None or found.campaign is None or found.floored or found.verdict == "consistent":
        return None, ""
    try:
        return best_placed(found.calibrated, found.nominal, found.campaign, executor), ""
    except FAILURES as failed:
        return None, f"{COMMAND}: the missing force could not be worked out, the rest is written: {failed}"


def _warnings(found: "Diagnosis", failure: str) -> list[str]:
    from hbm.diagnosis.noise import said, understated

    lines = [f"Partial result. {failure}."] * bool(failure)
    if found.calibrated is not None and found.campaign is not None and not found.floored:
        others = [e for e in (found.extended_fit, *found.tried) if e is not None]
        k = understated(found.calibrated, found.campaign, others)
        lines += [] if k is None else [said(k, found.noise)]
    return lines


# --------------------------------------------------------------------------------------------------------- delivery


def _deliver(result: "Diagnosed", rig: Path, out: Path, own: Mapping[type, str]) -> None:
    from hbm.commands.diagnosistables import print_diagnosis
    from hbm.files.diagnosisfiles import FILES, diagnosis_contents
    from hbm.files.extendedrig import earlier_candidates
    from hbm.files.outputs import write_folder

    with working("drawing"):
        contents = diagnosis_contents(result, rig, own)
    written = write_folder(out, contents, (*FILES, *earlier_candidates(out)))
    print_diagnosis(console(), result)
    print_written(written)
