"""Rig files of modes that were fitted to measurements."""

from collections.abc import Iterable

import numpy as np

from hbm.fourier import Array
from hbm.identification.modes import Modes

DRIVE = "excitation"
"""Port of the force where no channel is at its place."""

CLEAR = 5.0
"""Modes below the band are written as one of 0 Hz where they stand out by so many standard deviations."""


def modal_rig_text(modes: Modes, name: str, force: str, level: float, drive: str | None = None) -> str:
    """Text of a rig file with ``[modal]``: ports named as the channels, residuals, and deviations as tolerances.

    Parameters
    ----------
    modes : Modes
    name : str
        Of the rig.
    force : str
        Channel of the force.
    level : float
        Amplitude of the force [N].
    drive : str, optional
        Channel at the place of the force, see :meth:`hbm.identification.modes.Modes.shapes`.

    Raises
    ------
    InputError
        As :meth:`hbm.identification.modes.Modes.shapes`.
    """
    shapes, std, root = modes.shapes(drive)
    channels = list(modes.responses.channels)
    hz, ratio, hz_std, ratio_std = modes.hz, modes.ratio, modes.hz_std, modes.ratio_std
    own = 1.0 if drive is None else float(modes.below[channels.index(drive)])
    clear = modes.below_std * CLEAR < np.abs(modes.below)
    rigid = own > 0.0 and bool(clear.any() if drive is None else clear[channels.index(drive)])
    if rigid:  # phi_j phi_drive = L_j
        hz, ratio, hz_std, ratio_std = (np.append(0.0, row) for row in (hz, ratio, hz_std, ratio_std))
        first = modes.below / np.sqrt(own)
        shapes, std = np.column_stack([first, shapes]), np.column_stack([modes.below_std / np.sqrt(own), std])
        root = np.append(np.sqrt(own), root)
    damping, damping_std = _damping(modes, rigid)
    ports = {channel: (row, spread) for channel, row, spread in zip(channels, shapes, std, strict=True)}
    if drive is None:
        ports[DRIVE] = root, np.zeros(len(root))
    at = drive or DRIVE
    lines = [
        f"# {len(modes)} modes fitted from {modes.responses.hz[0]:.6g} to {modes.responses.hz[-1]:.6g} Hz, misfit "
        f"{modes.chi2_reduced:.3g} noise variances",
        f'name = "{name}"',
        "",
        "[modal]",
        f"frequencies_hz = {_row(hz)}" + ("  # 0: all modes below the band" if rigid else ""),
        f"flexibility = {_matrix(_flexibility(modes, list(ports), at, rigid))}  # of other modes, where it was seen",
        *([] if damping is None else [f"damping_matrix = {_matrix(damping, 13)}"]),
        "",
        "[modal.ports]" + ("" if drive else "  # the force acts on 1 of each mode: shapes carry the scale"),
        *(f'"{port}" = {_row(row)}' for port, (row, _) in ports.items()),
        "",
        "[modal.tolerances]  # one standard deviation",
        f"frequencies_hz = {_row(hz_std, 2)}",
        f"modal_ratios = {_row(ratio_std, 2)}"
        if damping_std is None
        else f"damping_matrix = {_matrix(damping_std, 2)}",
        "",
        "[modal.tolerances.ports]",
        *(f'"{port}" = {_row(spread, 2)}' for port, (_, spread) in ports.items()),
        "",
        *(["[damping]", f"modal_ratios = {_row(ratio)}", ""] if damping is None else []),
        "[excitation]",
        f'at = "{at}"',
        f"amplitude = {level:.6g}",
        "",
        "[[channels]]",
        f'name = "{force}"',
        'quantity = "force"',
    ]
    for channel, quantity in modes.responses.channels.items():
        lines += ["", "[[channels]]", f'name = "{channel}"', f'quantity = "{quantity}"', f'at = "{channel}"']
    return "\n".join(lines) + "\n"


def _flexibility(modes: Modes, ports: list[str], at: str, rigid: bool) -> Array:
    """Flexibility between the ports; only that to the place of the force was seen."""
    out = np.zeros((len(ports), len(ports)))
    seen = [ports.index(channel) for channel in modes.responses.channels]
    out[seen, ports.index(at)] = out[ports.index(at), seen] = modes.flexibility(rigid)
    return out


def _damping(modes: Modes, rigid: bool) -> tuple[Array, Array] | tuple[None, None]:
    """Damping between modes, a rigid one before them, and its deviations; of normal modes there is none."""
    if modes.damping is None or modes.damping_std is None:
        return None, None
    before = ((int(rigid), 0),) * 2
    return np.pad(modes.damping, before), np.pad(modes.damping_std, before)


def _row(values: Iterable[float], digits: int = 9) -> str:
    return "[" + ", ".join(f"{value:#.{digits}g}" for value in values) + "]"


def _matrix(values: Array, digits: int = 9) -> str:
    return "[" + ", ".join(_row(row, digits) for row in values) + "]"
