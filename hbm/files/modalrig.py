"""Rig files of modes that were fitted to measurements."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from hbm.fourier import Array
from hbm.identification.modes import Modes
from hbm.outputerror.nominal import FREQUENCY, RATIO, SHAPE

DRIVE = "excitation"
"""Port of the force where no channel is at its place."""

CLEAR = 5.0
"""Modes below the band are written as one of 0 Hz where they stand out by so many standard deviations."""


def modal_rig_text(modes: Modes, name: str, force: str, level: float, drive: str | None = None) -> str:
    """Text of a rig file with ``[modal]``: ports named as the channels, residuals, and deviations as tolerances.

    Where more than noise is left a number has the tolerance of one that nobody measured, if that is larger: what a
    friction that hardly slips at this level does to a damping ratio is many of its deviations, and no noise.

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
    below, beyond = _below(modes, drive), _beyond(modes, drive)
    own = _Written(modes.hz, modes.hz_std, modes.ratio, modes.ratio_std, *modes.shapes(drive))
    own = own.doubted() if modes.leaves_more else own
    hz, hz_std, ratio, ratio_std, shapes, std, root = _together([part for part in (below, own, beyond) if part])
    channels = list(modes.responses.channels)
    damping, damping_std = _damping(modes, below, beyond)
    ports = {channel: (row, spread) for channel, row, spread in zip(channels, shapes, std, strict=True)}
    if drive is None:
        ports[DRIVE] = root, np.zeros(len(root))
    at = drive or DRIVE
    flexibility = _flexibility(modes, list(ports), at, masses=below is not None, beyond=beyond is not None)
    said = [*(["0: all modes below the band"] if below else []), *(["the last: those above it"] if beyond else [])]
    lines = [
        f"# {len(modes)} modes fitted from {modes.responses.hz[0]:.6g} to {modes.responses.hz[-1]:.6g} Hz, misfit "
        f"{modes.chi2_reduced:.3g} noise variances",
        f'name = "{name}"',
        "",
        "[modal]",
        f"frequencies_hz = {_row(hz)}" + (f"  # {'; '.join(said)}" if said else ""),
        f"flexibility = {_matrix(flexibility)}  # of other modes in the band, where it was seen",
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
        *([] if beyond is None else [f"flexibility = {_matrix(_unseen(beyond, list(ports), at), 2)}"]),
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


class _Written(NamedTuple):
    """Modes as they are written: shapes (c, r), and r of all else; roots are shapes at the drive."""

    hz: Array
    hz_std: Array
    ratio: Array
    ratio_std: Array
    shapes: Array
    std: Array
    root: Array

    def doubted(self) -> "_Written":
        """The same with the tolerances of numbers that nobody measured, where these are larger."""
        return self._replace(
            hz_std=np.maximum(self.hz_std, FREQUENCY * self.hz),
            ratio_std=np.maximum(self.ratio_std, RATIO * self.ratio),
            std=np.maximum(self.std, SHAPE * np.abs(self.shapes).max(axis=0)),
        )


def _together(parts: Sequence[_Written]) -> _Written:
    return _Written(*(np.concatenate(rows, axis=-1) for rows in zip(*parts, strict=True)))


def _below(modes: Modes, drive: str | None) -> _Written | None:
    """All modes below the band as one of 0 Hz, where they are seen: phi_j phi_drive = L_j."""
    at = None if drive is None else list(modes.responses.channels).index(drive)
    own = 1.0 if at is None else float(modes.below[at])
    clear = modes.below_std * CLEAR < np.abs(modes.below)
    if own <= 0.0 or not (clear.any() if at is None else clear[at]):
        return None
    none, root = np.zeros(1), np.sqrt(own)
    shapes, std = modes.below[:, None] / root, modes.below_std[:, None] / root
    return _Written(none, none, none, none, shapes, std, np.array([root]))


def _beyond(modes: Modes, drive: str | None) -> _Written | None:
    """All modes above the band as one, where it is seen: held, for what it answers is known better than its numbers.

    Its damping is not seen there, and taken for that of the others.
    """
    found = modes.shape_beyond(drive)
    if modes.beyond is None or found is None:
        return None
    hz, like, held = np.array([modes.beyond.hz]), np.median(modes.ratio, keepdims=True), np.zeros(1)
    shapes = found[0][:, None]
    return _Written(hz, held, like, like, shapes, np.zeros_like(shapes), np.array([found[1]]))


def _flexibility(modes: Modes, ports: list[str], at: str, *, masses: bool, beyond: bool) -> Array:
    """Flexibility between the ports; only that to the place of the force was seen."""
    out = np.zeros((len(ports), len(ports)))
    seen = [ports.index(channel) for channel in modes.responses.channels]
    out[seen, ports.index(at)] = out[ports.index(at), seen] = modes.flexibility(masses=masses, beyond=beyond)
    return out


def _unseen(beyond: _Written, ports: list[str], at: str) -> Array:
    """Deviations of the flexibility that no force at its place has shown: the most that the mode above answers.

    There are more modes above it than the one that is seen from the place of the force, which may hardly move where
    others do.
    """
    shapes = np.append(beyond.shapes[:, 0], beyond.root)[: len(ports)]
    most = np.full((len(ports), len(ports)), np.max(shapes**2) / (2 * np.pi * beyond.hz[0]) ** 2)
    most[ports.index(at)] = most[:, ports.index(at)] = 0.0
    return np.asarray(most)


def _damping(modes: Modes, below: _Written | None, beyond: _Written | None) -> tuple[Array, Array] | tuple[None, None]:
    """Damping between modes, with those below and above the band, and its deviations; of normal modes there is none."""
    if modes.damping is None or modes.damping_std is None:
        return None, None
    around = ((int(below is not None), int(beyond is not None)),) * 2
    D, std = modes.damping, modes.damping_std
    if modes.leaves_more:
        std = np.maximum(std, RATIO * np.sqrt(np.outer(D.diagonal(), D.diagonal())))
    D, std = np.pad(D, around), np.pad(std, around)
    if beyond:
        D[-1, -1] = std[-1, -1] = 4 * np.pi * beyond.ratio[0] * beyond.hz[0]
    return D, std


def _row(values: Iterable[float], digits: int = 9) -> str:
    """Numbers as TOML has them: behind a point there is a digit."""
    written = (f"{value:#.{digits}g}" for value in values)
    return "[" + ", ".join(number + "0" * number.endswith(".") for number in written) + "]"


def _matrix(values: Array, digits: int = 9) -> str:
    return "[" + ", ".join(_row(row, digits) for row in values) + "]"
