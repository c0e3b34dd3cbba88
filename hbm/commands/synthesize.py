"""The command ``hbm synthesize``: what a test of a rig would have measured, with noise."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hbm.commands.budgets import RunSeconds, seconds_of, within
from hbm.commands.options import (
    LARGEST_H,
    AllowCode,
    RigFile,
    console,
    is_number,
    positive,
    print_written,
    quoted,
    whole,
)
from hbm.errors import InputError

if TYPE_CHECKING:
    from hbm.response.synthesis import Synthesis

COMMAND = "synthesize"
ADVICE = "try fewer levels, a narrower range of frequencies, or a larger --max-seconds"
MANIFEST = "manifest.csv"
RECORDING = re.compile(r"record_\d{3,}\.csv")
LARGEST_SEED = 10**9


def synthesize(
    rig: RigFile,
    levels: Annotated[
        list[str], typer.Option("--levels", metavar="N ...", help="Force amplitudes.", show_default=False)
    ],
    frequencies: Annotated[
        list[str],
        typer.Option(
            "--frequencies", metavar="HZ ...", help="Excitation frequencies, all at every level.", show_default=False
        ),
    ],
    out: Annotated[Path, typer.Option(metavar="SPECTRA", help="Write here (csv, nc, mat or uff).", show_default=False)],
    snr: Annotated[
        str, typer.Option("--snr", metavar="DB", help="Largest fundamental of a channel over the std of a coefficient.")
    ] = "60",
    seed: Annotated[str, typer.Option("--seed", metavar="N", help="Of the noise.")] = "1",
    harmonics: Annotated[str, typer.Option(metavar="H", help="Highest harmonic.")] = "9",
    histories: Annotated[
        Path | None,
        typer.Option(
            "--histories",
            metavar="DIR",
            help="Write the recordings here too, with a manifest for hbm spectra; empty, or of an earlier run.",
        ),
    ] = None,
    max_seconds: RunSeconds = "600",
    allow_code: AllowCode = False,
) -> None:
    """Measured-like spectra of a rig: its steady states, sampled, with noise, and estimated as a measurement is.

    Curves as of hbm frf say which steady states there are; each record is then solved on a finer discretisation. Where
    several steady states are stable, the record is that of a slow sweep from the lowest frequency.

    Example:  hbm synthesize rig.toml --levels 2 6.5 --frequencies 46 48 50 52 --snr 60 --seed 1 --out spectra.csv
    """
    from hbm.commands.options import named
    from hbm.measurement.spectrafile import WRITTEN, spectra_content
    from hbm.textfiles import check_output, write_together

    with named(COMMAND):
        check_output(out, WRITTEN, "--out")
    forces, hz = _numbers("--levels", levels, "N"), _numbers("--frequencies", frequencies, "Hz")
    limit = seconds_of(COMMAND, max_seconds)
    decibels, H = _decibels(snr), whole(COMMAND, "--harmonics", harmonics, LARGEST_H)
    number = whole(COMMAND, "--seed", seed, LARGEST_SEED)
    earlier = _earlier(histories) if histories is not None else []
    from continuation import ConvergenceError
    from hbm.commands.progress import Work
    from hbm.files.outputs import write_folder
    from hbm.response.synthesis import synthesize as simulate
    from hbm.rigfiles.load import load_rig
    from models.parts import UNITS

    loaded = load_rig(rig, allow_code=allow_code or None)
    try:
        with Work() as work, within(COMMAND, limit, work.doing, ADVICE):
            made = simulate(loaded, forces, hz, snr=decibels, seed=number, harmonics=H, on_progress=work.show)
    except ConvergenceError as failed:
        raise ArithmeticError(f"{COMMAND}: {str(failed).removeprefix('synthesize: ')}; nothing written") from None
    table = {out: spectra_content(out, made.spectra, {c.name: UNITS[c.quantity] for c in loaded.channels})}
    if histories is None:
        write_together(table)
    else:
        write_folder(histories, _histories(made), earlier, beside=table)
    _print(made)
    print_written([out] if histories is None else [histories / MANIFEST, out])


def _earlier(folder: Path) -> list[str]:
    """Files of an earlier run in the folder for the recordings; one that holds anything else is refused."""
    from hbm.commands.options import named
    from hbm.files.outputs import check_folder

    with named(COMMAND):
        check_folder(folder, (MANIFEST,), "--histories")
    names = sorted(path.name for path in folder.glob("[!.]*"))  # none where there is no folder yet
    other = [name for name in names if name != MANIFEST and not (RECORDING.fullmatch(name) and MANIFEST in names)]
    if other:
        raise InputError(
            f"{COMMAND}: --histories = {quoted(str(folder))}; holds {quoted(other[0])}, must be empty, or hold the "
            "recordings of an earlier run and their manifest alone"
        )
    return names


def _numbers(option: str, texts: Sequence[str], unit: str) -> list[float]:
    values = [positive(COMMAND, option, text, unit) for text in texts]
    for i, value in enumerate(values):
        if value in values[:i]:
            raise InputError(f"{COMMAND}: {option} = {value:g} twice; must be different")
    return values


def _decibels(text: str) -> float:
    from hbm.response.synthesis import LEAST_SNR, MOST_SNR

    if not is_number(text) or not LEAST_SNR <= float(text) <= MOST_SNR:
        raise InputError(f"{COMMAND}: --snr = {text}; must be a number from {LEAST_SNR:g} to {MOST_SNR:g} [dB]")
    return float(text)


def _histories(made: "Synthesis") -> dict[str, str | bytes]:
    """Contents of the recordings and of the manifest that lists them, by file name."""
    from hbm.textfiles import csv_text

    contents: dict[str, str | bytes] = {}
    for r in made.recordings:
        columns = (values.tolist() for values in (r.time, *r.channels.values()))
        contents[r.source] = csv_text([["time_s", *r.channels], *zip(*columns, strict=True)])
    states = zip(made.recordings, made.spectra.hz.tolist(), made.spectra.level.tolist(), strict=True)
    rows = [[r.source, hz, level] for r, hz, level in states]
    contents[MANIFEST] = csv_text([["file", "frequency_hz", "level"], *rows])
    return contents


def _print(made: "Synthesis") -> None:
    from hbm.commands.tables import print_lines, print_rows

    print_rows(
        console(),
        f"{made.curves[0].rig.name}: {len(made.recordings)} records",
        (
            {
                "channel": name,
                "largest fundamental\n|c1|": f"{abs(made.spectra.complex(name)[:, 1]).max():.5g}",
                "std\n ": f"{made.spectra.std[:, j, 1].mean():.2g}",
                "unit": made.estimates[0].units.get(name, ""),
            }
            for j, name in enumerate(made.spectra.channels)
        ),
    )
    print_lines(console(), [f"warning: {line}" for line in made.remarks])
