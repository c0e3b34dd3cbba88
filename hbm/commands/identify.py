"""The command ``hbm identify``: parameters of friction laws from measured spectra, compared."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hbm.commands.budgets import RunSeconds, seconds_of, within
from hbm.commands.inverse import (
    Repeatability,
    SpectraFile,
    check_formulation,
    different,
    load,
    noisy,
    reconstructed,
    share,
    working,
)
from hbm.commands.options import (
    AllowCode,
    Formulation,
    OutFolder,
    RigFile,
    check_order,
    check_out,
    console,
    named,
    print_written,
    say,
)
from hbm.commands.tolerance import Tolerance, tolerances_of

if TYPE_CHECKING:
    from hbm.identification.identify import Identification
    from hbm.identification.rigerrors import RigErrors
    from hbm.identification.spectra import SpectraFit
    from hbm.inverse.reconstruction import Reconstruction
    from hbm.measurement.spectra import MeasuredSpectra
    from models.rig import Rig

COMMAND = "identify"
ADVICE = "a comparison needs all laws; try fewer of them with --law, or a larger --max-seconds"


def identify(
    rig: RigFile,
    spectra: SpectraFile,
    out: OutFolder,
    law: Annotated[
        list[str] | None,
        typer.Option(
            "--law",
            metavar="NAME",
            help="A friction law (see hbm laws), or one's own, file.py:Class; repeated for each. "
            "Those that the paper identifies where omitted.",
        ),
    ] = None,
    by_level: Annotated[bool, typer.Option("--by-level", help="Fit each force level by itself too.")] = False,
    held_out: Annotated[
        list[str] | None,
        typer.Option(
            "--held-out",
            "--hold-out",
            metavar="N ...",
            help="Records no fit sees and all laws are scored on; each fifth of the records in turn where omitted.",
        ),
    ] = None,
    output_error: Annotated[
        bool,
        typer.Option(
            "--output-error", help="Then fit the best law to the spectra themselves, through the whole model."
        ),
    ] = False,
    formulation: Formulation = None,
    tolerance: Tolerance = None,
    repeatability: Repeatability = None,
    max_seconds: RunSeconds = "600",
    allow_code: AllowCode = False,
) -> None:
    """Parameters of friction laws, with uncertainty, from measured spectra; which law is best.

    Writes the laws and their parameters as tables, figures with the numbers of each curve, and one page that opens
    offline, report.html.

    Example:  hbm identify rig.toml spectra.csv --law coulomb-penalty --law stribeck --by-level --out laws
    """
    from hbm.files.identifyreport import FILES
    from hbm.rigfiles.laws import find_law

    check_order(COMMAND, rig, spectra)
    held, percent = different(COMMAND, "--held-out", held_out), share(COMMAND, repeatability)
    limit = seconds_of(COMMAND, max_seconds)
    check_out(COMMAND, out, FILES)
    if formulation is not None:
        check_formulation(COMMAND, formulation)
    for name in law or ():
        with named(f'{COMMAND}: --law = "{name}"', ";"):
            find_law(name, Path())
    loaded, read = load(rig, spectra, percent, allow_code=allow_code)
    measured = noisy(loaded, read, percent)
    from hbm.commands.progress import Work
    from hbm.identification.identify import LAWS
    from hbm.identification.identify import identify as fit_laws
    from hbm.identification.rigerrors import rig_errors

    tolerances = tolerances_of(COMMAND, loaded, tolerance)
    contact = reconstructed(COMMAND, loaded, measured, formulation)
    again, failure = None, ""
    with Work() as work, within(COMMAND, limit, work.doing, ADVICE):
        found = fit_laws(loaded, contact, law or LAWS, held_out=held or None, by_level=by_level, on_progress=work.show)
        work.show(f"{found.best.name}: what the rig file may be off by", 1.0)
        errors = rig_errors(found.best, contact, tolerances)
        if output_error:
            again, failure = _on_spectra(loaded, measured, held, found, contact, work.show)
    _deliver(found, contact, errors, again, out)
    if failure:
        raise typer.Exit(say(failure, 1))


def _on_spectra(
    rig: "Rig",
    spectra: "MeasuredSpectra",
    held: Sequence[str],
    found: "Identification",
    contact: "Reconstruction",
    tell: Callable[[str, float], None],
) -> tuple["SpectraFit | None", str]:
    """The best law fitted to the spectra of the records that are not held out, or why it failed."""
    from continuation import ConvergenceError
    from hbm.identification.spectra import fit_spectra

    used, known = (spectra.split(held)[0], None) if held else (spectra, contact)
    try:
        return fit_spectra(rig, used, found.best, reconstruction=known, on_progress=tell), ""
    except ConvergenceError as failed:
        return None, f"{COMMAND}: --output-error: {failed}"


def _deliver(
    found: "Identification", contact: "Reconstruction", errors: "RigErrors", again: "SpectraFit | None", out: Path
) -> None:
    from hbm.commands.inversetables import print_laws_found
    from hbm.files.identifiedlaw import identified_law, law_warnings
    from hbm.files.identifyreport import FILES, identify_contents
    from hbm.files.outputs import write_folder

    by_level = {name: {level: fits[name] for level, fits in found.levels.items()} for name in found.fits}
    ranking = found.comparison.ranking
    laws = [identified_law(found.fits[r.name], contact, r.bic, by_level[r.name]) for r in ranking]
    warnings: Sequence[str] = [*contact.warnings, *(line for fit in found.fits.values() for line in law_warnings(fit))]
    with working("drawing"):
        verdict = found.comparison.verdict
        contents = identify_contents(
            contact, laws, verdict=verdict, errors=errors, output_error=again, warnings=warnings
        )
    written = write_folder(out, contents, FILES)
    print_laws_found(console(), contact, laws, warnings)
    print(errors)
    print(verdict)
    if again is not None:
        print(again)
    print_written(written)
