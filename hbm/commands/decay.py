"""The command ``hbm decay``: frequency and damping ratio over amplitude, from free decays."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hbm.commands.budgets import RunSeconds, seconds_of, within
from hbm.commands.options import AllowCode, console, named, not_negative, positive, print_written, say, whole
from hbm.errors import InputError

if TYPE_CHECKING:
    from hbm.measurement.decay import Decay
    from hbm.modes.backbone import NonlinearMode
    from models.jointed import AnyRig

COMMAND = "decay"


def decay(
    histories: Annotated[
        list[Path],
        typer.Argument(
            metavar="HISTORY",
            help="Free decays of one structure after blows alike: time histories, a folder of them, or a manifest.",
            show_default=False,
        ),
    ],
    channel: Annotated[
        list[str],
        typer.Option(
            metavar="NAME",
            help="What moves; repeated where a file has several decays, one a column.",
            show_default=False,
        ),
    ],
    band: Annotated[
        tuple[str, str],
        typer.Option(metavar="HZ HZ", help="Frequencies between which the mode is alone.", show_default=False),
    ],
    begin: Annotated[
        str, typer.Option("--settle", metavar="S", help="Seconds left out at the beginning, the blow among them.")
    ] = "0",
    rig: Annotated[
        Path | None,
        typer.Option(metavar="RIG", help="Compare with the nonlinear mode of this rig, which has the channel."),
    ] = None,
    mode: Annotated[str, typer.Option(metavar="N", help="With --rig: number of its mode, counted from 1.")] = "1",
    out: Annotated[Path | None, typer.Option(metavar="F.csv", help="Write the table here.")] = None,
    max_seconds: RunSeconds = "600",
    allow_code: AllowCode = False,
) -> None:
    """Frequency and damping ratio of a mode over its amplitude, from free decays.

    Of several decays: means in classes of amplitude, with uncertainties by what they differ by and what
    changes within a window. What is clipped is left out, with a warning.

    Example:  hbm decay blow1.csv blow2.csv --channel velocity --band 95 150 --settle 0.15 --out decay.csv
    """
    from hbm.rigfiles.load import load_rig
    from hbm.textfiles import check_output

    ends = positive(COMMAND, "--band", band[0], "Hz"), positive(COMMAND, "--band", band[1], "Hz")
    settle = not_negative(COMMAND, "--settle", begin, "s")
    number, limit = whole(COMMAND, "--mode", mode, 1000), seconds_of(COMMAND, max_seconds)
    with named(COMMAND):
        if out is not None:
            check_output(out, (".csv",), "--out")
    with within(COMMAND, limit, lambda: f"at {len(histories)} histories", "try fewer, or a larger --max-seconds"):
        found = _decays(histories, channel, ends, settle)
        mode_of_rig, short = None, ""
        if rig is not None:
            loaded = load_rig(rig, allow_code=allow_code or None)
            found = _in_unit_of(loaded, rig, found)
            mode_of_rig, short = _mode(loaded, number, found)
    _deliver(found, mode_of_rig, out)
    if short:
        raise typer.Exit(say(short, 1))


def _decays(histories: list[Path], names: list[str], band: tuple[float, float], settle: float) -> "Decay":
    from hbm.measurement.decay import free_decay, over_amplitude
    from hbm.measurement.historyfile import load_history
    from hbm.measurement.manifest import entries_of
    from hbm.measurement.recording import TIMES

    decays = []
    for entry in entries_of(histories):
        # what else is in the file may be a hammer in volts, or a temperature
        columns = {name: entry.channels.get(name, name) for name in names}
        columns |= {name: vector for name, vector in entry.channels.items() if name == TIMES[0]}
        units = {name: unit for name, unit in entry.units.items() if name in columns}
        recorded = entry.part(load_history(entry.file, columns, units))
        kept = recorded.between(float(recorded.time[0]) + settle, float(recorded.time[-1]))
        decays += [free_decay(kept, name, band) for name in names]
    return decays[0] if len(decays) == 1 else over_amplitude(decays, source=f"{len(decays)} decays")


def _in_unit_of(rig: "AnyRig", path: Path, found: "Decay") -> "Decay":
    """The decay, in the unit that its channel has in the rig where the recording says none."""
    from models.parts import UNITS

    quantity = next((c.quantity for c in rig.channels if c.name == found.channel), None)
    if quantity is None:
        raise InputError(f"{COMMAND}: channel {found.channel} is not in {path}; must be one of its channels")
    return found if found.unit else replace(found, unit=UNITS[quantity])


def _mode(rig: "AnyRig", number: int, found: "Decay") -> tuple["NonlinearMode | None", str]:
    """Nonlinear mode over the amplitudes of the decay, and a little more; and what it does not reach, in words."""
    from continuation import ConvergenceError
    from hbm.modes.decaying import span, toward_channel

    if not 1 <= number <= rig.structure.n:
        raise InputError(f"{COMMAND}: --mode = {number}; must be from 1 to {rig.structure.n}")
    named = f"{COMMAND}: {rig.name}: mode {number}"
    try:
        mode = toward_channel(rig, number, found.channel, (float(found.amplitude.min()), float(found.amplitude.max())))
    except (ConvergenceError, ArithmeticError) as failed:
        return None, f"{named} is not compared: {failed}"
    low, high = span(mode, found.channel)
    beyond = sum(not low <= amplitude <= high for amplitude in found.amplitude.tolist())
    if not beyond:
        return mode, ""
    return mode, (
        f"{named} reaches {found.channel} = {low:.3g} to {high:.3g}: {beyond} of {len(found)} amplitudes are not "
        f"compared; {mode.branch.message}"
    )


def _deliver(found: "Decay", mode: "NonlinearMode | None", out: Path | None) -> None:
    from hbm.commands.tables import dashed, print_lines, print_rows
    from hbm.files.outputs import columns_text
    from hbm.modes.decaying import predicted
    from hbm.textfiles import write_together

    columns = found.columns
    if mode is not None:
        hz, ratio = predicted(mode, found.channel, found.amplitude)
        columns = {**columns, "simulated_hz": hz, "simulated_damping_ratio": ratio}
    if out is not None:
        write_together({out: columns_text(columns)})
    rows = []
    for i in range(len(found)):
        row = {
            f"{found.channel}\n{found.unit or 'unit not stated'}": f"{found.amplitude[i]:.4g}",
            "frequency\nHz": f"{found.hz[i]:.7g} ± {found.hz_std[i]:.1g}",
            "damping\n%": f"{100 * found.damping_ratio[i]:.4g} ± {100 * found.damping_ratio_std[i]:.1g}",
        }
        if mode is not None:
            row |= {"simulated\nHz": dashed(hz[i], ".7g"), "simulated\n%": dashed(100 * ratio[i], ".4g")}
        rows.append(row)
    print_rows(console(), found.source, rows)
    print_lines(console(), [f"warning: {line}" for line in found.warnings])
    print_written([] if out is None else [out])
