"""The command ``hbm modal``: a modal rig from measurements at a low level."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hbm.commands.budgets import RunSeconds, seconds_of, within
from hbm.commands.inverse import Repeatability, different, share
from hbm.commands.options import both_ends, console, named, print_written, quoted, whole
from hbm.errors import InputError

if TYPE_CHECKING:
    from hbm.identification.modes import Modes
    from hbm.measurement.responses import FrequencyResponses

COMMAND = "modal"
VAGUE = 0.3
"""A mode is doubted whose damping ratio is no better known than to this part of it."""


Measured = Annotated[
    Path,
    typer.Argument(
        metavar="MEASURED",
        help="Spectra file (csv, npz, nc or mat), see hbm spectra; frequency responses (uff, unv, or csv with columns "
        "frequency_hz,channel,real,imag,std); or with --transient a time history.",
        show_default=False,
    ),
]


def modal(
    measured: Measured,
    out: Annotated[Path, typer.Option(metavar="RIG", help="Write the rig file here (toml).", show_default=False)],
    drive: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Channel at the place of the force and along it: it gives shapes their scale."
        ),
    ] = None,
    force: Annotated[str, typer.Option(metavar="NAME", help="Channel of the force.")] = "force",
    transient: Annotated[
        bool,
        typer.Option(
            "--transient",
            help="MEASURED is a time history that begins and ends at rest: hits with a hammer, a burst, a chirp.",
        ),
    ] = False,
    phase: Annotated[
        bool,
        typer.Option("--phase", help="The force leads what --force names by a phase to be found: a shaker's voltage."),
    ] = False,
    quantity: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=QUANTITY",
            help="displacement, velocity or acceleration, where MEASURED does not say; repeated. Accelerations where "
            "omitted.",
        ),
    ] = None,
    record: Annotated[
        list[str] | None, typer.Option(metavar="N ...", help="Only these records, those of the lowest level.")
    ] = None,
    begin: Annotated[str | None, typer.Option("--from", metavar="HZ", help="Lowest frequency.")] = None,
    end: Annotated[
        str | None, typer.Option("--to", metavar="HZ", help="Highest frequency, also of harmonics; with --from.")
    ] = None,
    modes: Annotated[
        str | None, typer.Option(metavar="N", help="How many in the band; as the data ask for where omitted.")
    ] = None,
    repeatability: Repeatability = None,
    max_seconds: RunSeconds = "600",
) -> None:
    """A rig file of modes, their residuals and uncertainties, from measurements of a structure at a low level.

    Of spectra, of stepped sines, sweeps or multisines, every harmonic that the force excites is a point of a frequency
    response. Responses of an analyser are taken as they are; hits with a hammer as one recording from rest to rest.

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
    from hbm.textfiles import write_together

    responses, levels = _responses(measured, force, quantity or (), records, floor, transient=transient)
    responses = _within(responses, band) if band else responses
    with within(
        COMMAND,
        limit,
        lambda: f"at {len(responses.hz)} frequencies",
        "try --from and --to, fewer --modes, or a larger --max-seconds",
    ):
        found = fit_modes(responses, count, phase=phase, drive=drive)
    text = modal_rig_text(found, measured.stem, force, levels[0], drive)
    write_together({out: text})
    _print(found, drive, levels)
    print_written([out])


def _within(responses: "FrequencyResponses", band: tuple[float, float]) -> "FrequencyResponses":
    """Those in a band of frequencies, refused where they are in it once they are taken for rad/s."""
    from math import tau

    found, (low, high) = responses.between(*band), band
    if not len(found.hz) and len(responses.between(tau * low, tau * high).hz):
        raise InputError(
            f"{COMMAND}: --from {low:g} --to {high:g}: frequencies are {responses.hz[0]:.4g} to "
            f"{responses.hz[-1]:.4g}, and in the band if they are in rad/s; must be in Hz"
        )
    return found


def _responses(
    path: Path,
    force: str,
    quantities: Sequence[str],
    records: Sequence[str],
    floor: float,
    *,
    transient: bool,
) -> tuple["FrequencyResponses", Sequence[float]]:
    """Frequency responses, and amplitudes of the force, the lowest first: 1 N where nothing had one."""
    from hbm.measurement.frffile import is_frf, load_responses
    from hbm.measurement.groups import levels
    from hbm.measurement.repeatability import with_floor
    from hbm.measurement.responses import frequency_responses
    from hbm.measurement.spectrafile import load_spectra

    if transient:
        found = _from_rest(path, force, quantities)
    elif is_frf(path):
        found = load_responses(path)
        found = replace(found, channels=_channels(found.channels, quantities))
    else:
        spectra = load_spectra(path, repeatability=floor)
        spectra = spectra.select(records=records) if records else spectra
        channels = _channels({name: "" for name in spectra.channels if name != force}, quantities)
        responses = frequency_responses(with_floor(spectra, channels, floor), force, channels)
        known = sorted(set(levels(spectra.level).tolist()))
        return replace(responses, warnings=(*spectra.warnings, *responses.warnings)), known
    if records:
        raise InputError(f"{COMMAND}: --record, and {path} has no records; must be left out")
    return found.unrepeatable(floor), (1.0,)


def _from_rest(path: Path, force: str, quantities: Sequence[str]) -> "FrequencyResponses":
    """Responses of a time history."""
    from hbm.measurement.historyfile import load_history
    from hbm.measurement.responses import QUANTITIES
    from hbm.measurement.transient import responses_from_rest

    recorded = load_history(path, drives=(force,))
    recorded.expect_quantity(force, "force")
    known = {name: QUANTITIES.get(unit, "") for name, unit in recorded.units.items() if name != force}
    return responses_from_rest(recorded, force, _channels(known, quantities))


def _channels(known: Mapping[str, str], texts: Sequence[str]) -> dict[str, str]:
    """Quantity of each response: as the file says, empty where it does not, or is stated, or an acceleration."""
    from hbm.channels import DERIVATIVES

    channels = dict(known)
    for text in texts:
        name, _, quantity = text.partition("=")
        if name not in channels or quantity not in DERIVATIVES:
            raise InputError(
                f"{COMMAND}: --quantity = {quoted(text)}; must be NAME=QUANTITY, of {', '.join(channels)} and "
                f"{', '.join(DERIVATIVES)}"
            )
        if channels[name] not in ("", quantity):
            raise InputError(f"{COMMAND}: --quantity = {quoted(text)}, and {name} is {channels[name]} in the file")
        channels[name] = quantity
    return {name: quantity or "acceleration" for name, quantity in channels.items()}


def _print(found: "Modes", drive: str | None, levels: Sequence[float] = (1.0,)) -> None:
    """Say what was found in records of some levels, in ascending order."""
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
    lines += _between(found, driven=drive is not None)
    if found.beyond:
        left_out = found.shape_beyond(drive) is None
        lines.append(
            f"modes above the band answer as one at {found.beyond.hz:.4g} ± {found.beyond.hz_std:.2g} Hz, beside a "
            "constant" + (f"; {drive} hardly moves in it: left out of the rig file" if left_out else "")
        )
    if found.phase_std:
        lines.append(f"the force leads the channel that stands for it by {found.phase:.4f} ± {found.phase_std:.1g} rad")
    if not found.responses.sized:
        lines[:1] = [
            f"{len(found.responses.hz)} frequencies; no standard deviations are known, these are of the misfit"
        ]
    elif found.chi2_reduced > 1.0:
        lines.append("standard deviations are multiplied by the root of the misfit")
    if found.leaves_more:
        lines += [
            "tolerances in the rig file are those of a number that nobody measured, where these are larger: what is "
            "left is no noise",
            "warning: not linear at this level, its shapes are not real, or a mode near the band is not in it: some of "
            "these may be no modes; the next mode on either side should be in the band",
        ]
        if len(levels) > 1:
            lines.append(
                f"warning: records of {levels[0]:.4g} to {levels[-1]:.4g} N were fitted as one; --record takes those "
                "of the lowest level alone"
            )
    lines += [f"warning: {line}" for line in (*found.responses.warnings, *found.warnings)]
    vague = [str(i) for i, (z, std) in enumerate(zip(found.ratio, found.ratio_std, strict=True), 1) if std > VAGUE * z]
    if vague:
        several = len(vague) > 1
        lines.append(
            f"warning: {'modes' if several else 'mode'} {', '.join(vague)}: damping is hardly known; "
            f"{'they' if several else 'it'} may stand for what is beyond the band or not linear: see --modes"
        )
    print_lines(console(), lines)


def _between(found: "Modes", *, driven: bool) -> list[str]:
    """Which modes damp one another most, and whether shapes are still not real."""
    lines = []
    if found.damping is not None and found.damping_std is not None:
        D, size = found.damping, found.damping.diagonal() ** 0.5
        pairs = [(abs(D[i, j]) / (size[i] * size[j]), i, j) for j in range(len(found)) for i in range(j)]
        _, i, j = max(pairs)
        lines.append(
            f"modes damp one another, {i + 1} and {j + 1} most: {D[i, j]:.4g} ± {found.damping_std[i, j]:.2g} 1/s; the "
            "rig file has a damping matrix"
        )
    if found.phases_misfit is not None:
        advice = "" if driven or len(found) == 1 else "; --drive lets damping between these modes be found"
        lines.append(
            "warning: shapes are not real, and the rig file cannot hold them: with a phase of each channel in each "
            f"mode {found.phases_misfit:.3g} noise variances would be left{advice}"
        )
    return lines
