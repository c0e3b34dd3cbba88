"""The command ``hbm modal``: a modal rig from measurements at a low level."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hbm.commands.budgets import RunSeconds, seconds_of, within
from hbm.commands.inverse import Repeatability, SpectraFile, different, share
from hbm.commands.options import both_ends, console, named, print_written, quoted, whole
from hbm.errors import InputError

if TYPE_CHECKING:
    from hbm.identification.modes import Modes

COMMAND = "modal"
FITS = 4.0
"""Misfit above which it is doubted that there are such modes."""


def modal(
    spectra: SpectraFile,
    out: Annotated[Path, typer.Option(metavar="RIG", help="Write the rig file here (toml).", show_default=False)],
    drive: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Channel at the place of the force and along it: it gives shapes their scale."
        ),
    ] = None,
    force: Annotated[str, typer.Option(metavar="NAME", help="Channel of the force.")] = "force",
    phase: Annotated[
        bool,
        typer.Option("--phase", help="The force leads what --force names by a phase to be found: a shaker's voltage."),
    ] = False,
    quantity: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=QUANTITY",
            help="displacement, velocity or acceleration; repeated. Accelerations where omitted.",
        ),
    ] = None,
    record: Annotated[
        list[str] | None, typer.Option(metavar="N ...", help="Only these records, those of the lowest level.")
    ] = None,
    begin: Annotated[str | None, typer.Option("--from", metavar="HZ", help="Lowest frequency.")] = None,
    end: Annotated[str | None, typer.Option("--to", metavar="HZ", help="Highest frequency; with --from.")] = None,
    modes: Annotated[
        str | None, typer.Option(metavar="N", help="How many in the band; as the data ask for where omitted.")
    ] = None,
    repeatability: Repeatability = None,
    max_seconds: RunSeconds = "600",
) -> None:
    """A rig file of modes, their residuals and uncertainties, from spectra of a structure at a low level.

    Stepped sines, sweeps and multisines: every harmonic that the force excites is a point of a frequency response.

    Example:  hbm modal low_level.csv --drive acc1 --from 5 --to 40 --out rig.toml
    """
    from hbm.textfiles import check_output

    with named(COMMAND):
        check_output(out, (".toml",), "--out")
    band = both_ends(COMMAND, begin, end, "Hz")
    limit = seconds_of(COMMAND, max_seconds)
    count = None if modes is None else whole(COMMAND, "--modes", modes, 100)
    records, floor = different(COMMAND, "--record", record), share(COMMAND, repeatability)
    from hbm.files.modalrig import modal_rig_text
    from hbm.identification.modalfit import fit_modes
    from hbm.identification.responses import frequency_responses
    from hbm.measurement.repeatability import with_floor
    from hbm.measurement.spectrafile import load_spectra
    from hbm.textfiles import write_together

    measured = load_spectra(spectra, repeatability=floor)
    measured = measured.select(records=records) if records else measured
    channels = _channels([name for name in measured.channels if name != force], quantity or ())
    responses = frequency_responses(with_floor(measured, channels, floor), force, channels)
    responses = responses.between(*band) if band else responses
    with within(
        COMMAND,
        limit,
        lambda: f"at {len(responses.hz)} frequencies",
        "try --from and --to, fewer --modes, or a larger --max-seconds",
    ):
        found = fit_modes(responses, count, phase=phase, drive=drive)
    text = modal_rig_text(found, spectra.stem, force, float(measured.level.min()), drive)
    write_together({out: text})
    _print(found)
    print_written([out])


def _channels(names: Sequence[str], texts: Sequence[str]) -> dict[str, str]:
    """Quantity of each response."""
    from hbm.channels import DERIVATIVES

    channels = dict.fromkeys(names, "acceleration")
    for text in texts:
        name, _, quantity = text.partition("=")
        if name not in channels or quantity not in DERIVATIVES:
            raise InputError(
                f"{COMMAND}: --quantity = {quoted(text)}; must be NAME=QUANTITY, of {', '.join(names)} and "
                f"{', '.join(DERIVATIVES)}"
            )
        channels[name] = quantity
    return channels


def _print(found: "Modes") -> None:
    from hbm.commands.tables import print_lines, print_rows

    rows = [
        {
            "mode": str(i),
            "frequency\nHz": f"{f:.7g} ± {sf:.2g}",
            "damping\n%": f"{100 * z:.4g} ± {100 * sz:.2g}",
        }
        for i, (f, sf, z, sz) in enumerate(zip(found.hz, found.hz_std, found.ratio, found.ratio_std, strict=True), 1)
    ]
    low, high = found.responses.hz[[0, -1]]
    print_rows(console(), f"{len(found)} modes from {low:.5g} to {high:.5g} Hz", rows)
    lines = [f"misfit {found.chi2_reduced:.3g} noise variances at {len(found.responses.hz)} frequencies"]
    if found.phase_std:
        lines.append(f"the force leads the channel that stands for it by {found.phase:.4f} ± {found.phase_std:.1g} rad")
    if found.chi2_reduced > 1.0:
        lines.append("standard deviations are multiplied by the root of the misfit")
    if found.chi2_reduced > FITS:
        lines.append(
            "warning: not linear at this level, its shapes are not real, or a mode near the band is not in it: some of "
            "these may be no modes; the next mode on either side should be in the band"
        )
    print_lines(console(), lines)
