"""Figures of reconstructed joint forces: loops and signals at every port, with 95 % bands."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch

from hbm.figures.inverse import BAND, BANDS, MOST_LEVELS, loop_band, stds
from hbm.figures.style import (
    INK,
    SMALL,
    AxesArray,
    align_labels,
    closed,
    dressed,
    graded,
    label_all,
    legend_above,
    panels,
    tint,
    wrapped_panels,
)
from hbm.figures.units import prefixed

if TYPE_CHECKING:
    from hbm.inverse.jointreconstruction import JointReconstruction


def representative(found: "JointReconstruction") -> list[int]:
    """Numbers of the records that move most at their joints, one of each level, of at most `MOST_LEVELS` levels."""
    spectra, sizes = found.spectra, [np.abs(found[name].samples).max(axis=1) for name in found.rig.motions]
    moved = np.sum([size / max(float(size.max()), np.finfo(float).tiny) for size in sizes], axis=0)
    levels = np.unique(spectra.level)[::-1][:MOST_LEVELS][::-1]
    own = [np.flatnonzero(spectra.level == level) for level in levels]
    return [int(spectra.records[i[moved[i].argmax()]]) for i in own]


def plot_joint_loops(
    found: "JointReconstruction", records: Sequence[int] | None = None, axes: AxesArray | None = None
) -> AxesArray:
    """Force over motion at each port, with 95 % bands, a colour per record.

    Parameters
    ----------
    found : JointReconstruction
    records : sequence of int, optional
        Numbers of records; :func:`representative` ones where omitted.
    axes : array of Axes, optional
        One per port.

    Returns
    -------
    (ports,) array of Axes

    Raises
    ------
    InputError
        If there is no such record.
    """
    chosen = representative(found) if records is None else list(records)
    rig, places = found.rig, [found.index(record) for record in chosen]
    grid = wrapped_panels(axes, rig.ports, 0.6, 2.1)
    colors = graded(list(range(len(chosen))))
    for ax, name, motion, units in zip(grid, rig.forces, rig.motions, rig.units, strict=True):
        force, moved = found[name], found[motion]
        (by, m), (by_force, N) = (prefixed(u, s.samples[places]) for u, s in zip(units, (moved, force), strict=True))
        for i, color in zip(places, colors, strict=True):
            u, f = moved.samples[i] * by, force.samples[i] * by_force
            if f.any():
                for share, u_std, f_std in zip(BANDS, stds(moved), stds(force), strict=True):
                    band = loop_band(u, f, u_std[i] * by, f_std[i] * by_force)
                    ax.add_patch(PathPatch(band, facecolor=tint(color, share), linewidth=0, zorder=1))
            ax.plot(closed(u), closed(f), color=color, linewidth=1.1, zorder=3)
        ax.autoscale_view()
        dressed(ax, f"Motion [{m}]", f"Force [{N}]")
        ax.set_title(name.replace(".force", ""), fontsize=SMALL + 1, color=INK)
    _name_records(grid, found, chosen)
    return grid


def plot_joint_signals(
    found: "JointReconstruction", records: Sequence[int] | None = None, axes: AxesArray | None = None
) -> AxesArray:
    """Force and motion at each port over a period with 95 % bands; parameters and errors as :func:`plot_joint_loops`.

    Returns
    -------
    (ports, 2) array of Axes
    """
    chosen = representative(found) if records is None else list(records)
    rig, places = found.rig, [found.index(record) for record in chosen]
    grid = panels(axes, rig.ports, 2, 0.8 + 1.3 * rig.ports, sharex=True)
    phase, colors = np.append(found.phase, 1.0), graded(list(range(len(chosen))))
    for row, name, motion, units in zip(grid, rig.forces, rig.motions, rig.units, strict=True):
        where = name.replace(".force", "")
        sides = ((name, units[1], f"{where},\nforce"), (motion, units[0], "motion"))
        for ax, (signal, plain, label) in zip(row, sides, strict=True):
            scale, unit = prefixed(plain, found[signal].samples[places])
            for i, color in zip(places, colors, strict=True):
                y = scale * closed(found[signal].samples[i])
                for share, std in zip(BANDS, stds(found[signal]), strict=True):
                    reach = BAND * scale * closed(std[i])
                    ax.fill_between(phase, y - reach, y + reach, color=tint(color, share), linewidth=0, zorder=1)
                ax.plot(phase, y, color=color, linewidth=1.1, zorder=3)
            ax.set_xlim(0.0, 1.0)
            dressed(ax, "", f"{label} [{unit}]")
    label_all(grid, "Phase of the period")
    _name_records(grid, found, chosen)
    return align_labels(grid)


def _name_records(grid: AxesArray, found: "JointReconstruction", chosen: Sequence[int]) -> None:
    spectra = found.spectra
    names = [f"{spectra.level[i]:g} N, {spectra.hz[i]:g} Hz" for i in (found.index(record) for record in chosen)]
    colors: list[Any] = list(graded(list(range(len(chosen)))))
    handles = [Line2D([], [], color=color, label=name) for color, name in zip(colors, names, strict=True)]
    legend_above(grid, handles, ncols=min(len(handles), 3))
