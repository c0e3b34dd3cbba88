"""Figures of backbones: frequency and damping over amplitude, and frequency responses with their backbone."""

from collections.abc import Sequence

from matplotlib.axes import Axes

from hbm.errors import one_or_several
from hbm.figures.curves import Curves, listed
from hbm.figures.scales import logarithmic, wide_enough
from hbm.figures.style import (
    FAINT,
    INK,
    SMALL,
    AxesArray,
    align_labels,
    dressed,
    headed,
    level_colors,
    new_axes,
    panels,
)
from hbm.figures.units import prefixed
from hbm.fourier import Array
from hbm.modes.backbone import Backbone, NonlinearMode
from hbm.modes.linear import linear_modes

MODE, RESONANCE = "#1f4e79", "#c8553d"
"""Inks of the nonlinear mode and of phase resonance; distinct in grey."""


Backbones = Backbone | Sequence[Backbone]


def plot_backbones(
    backbones: Backbones,
    curves: Curves = (),
    axes: AxesArray | None = None,
    *,
    number: int = 1,
) -> AxesArray:
    """Page of a mode's frequency and damping over amplitude, and of its backbones over frequency responses.

    Parameters
    ----------
    backbones : Backbone or sequence of them
        Backbones of one mode of one rig.
    curves : ResponseCurve or sequence of them
        Levels to draw beneath them.
    axes : array of three Axes, optional
    number : int
        Number of the mode, for the linear limits.

    Returns
    -------
    (3,) array of Axes
    """
    backbones = _listed(backbones, "plot_backbones")
    rows = panels(axes, 3, 1, 7.6, height_ratios=(1, 1, 1.5)).ravel()
    frequency, damping, response = rows
    plot_frequency(backbones, frequency, number=number)
    plot_damping(backbones, damping, number=number)
    if axes is None:
        damping.sharex(frequency)
    plot_backbone_over_responses(backbones, curves, response)
    frequency.set_xlabel("")
    rig = backbones[0].rig
    headed(frequency, rig.headline)
    return align_labels(rows)


def plot_frequency(backbones: Backbones, ax: Axes | None = None, *, number: int = 1) -> Axes:
    """Frequency over drive amplitude, with those of the contact stuck and sliding as thin lines."""
    backbones = [b.dense for b in _listed(backbones, "plot_frequency")]
    ax, linear = new_axes(ax), linear_modes(backbones[0].rig)
    _mark_limits(ax, backbones, linear.stuck_hz[number - 1], linear.sliding_hz[number - 1])
    scale, unit = prefixed("m", *(b.amplitude for b in backbones))
    _draw(ax, [(b, b.amplitude * scale, b.hz) for b in backbones])
    logarithmic(ax.xaxis)
    wide_enough(ax.yaxis)
    _shade_lift_off(ax, backbones, scale)
    ax.legend(frameon=False, fontsize=SMALL, labelcolor=INK, loc="best")
    return dressed(ax, f"Drive displacement, fundamental [{unit}]", "Frequency [Hz]")


def plot_damping(backbones: Backbones, ax: Axes | None = None, *, number: int = 1) -> Axes:
    """Damping ratio over drive amplitude, with those of the contact stuck and sliding as thin lines."""
    backbones = [b.dense for b in _listed(backbones, "plot_damping")]
    ax, rig = new_axes(ax), backbones[0].rig
    linear = linear_modes(rig)
    held, free = linear.stuck_damping_ratio[number - 1], linear.damping_ratio[number - 1]
    _mark_limits(ax, backbones, 100 * held, 100 * free)
    scale, unit = prefixed("m", *(b.amplitude for b in backbones))
    _draw(ax, [(b, b.amplitude * scale, 100 * b.damping_ratio) for b in backbones])
    logarithmic(ax.xaxis)
    logarithmic(ax.yaxis)
    wide_enough(ax.yaxis)
    _shade_lift_off(ax, backbones, scale)
    return dressed(ax, f"Drive displacement, fundamental [{unit}]", "Damping ratio [%]")


def plot_backbone_over_responses(backbones: Backbones, curves: Curves = (), ax: Axes | None = None) -> Axes:
    """Drive amplitude over frequency: backbones over frequency responses."""
    backbones = [b.dense for b in ([backbones] if isinstance(backbones, Backbone) else backbones)]
    curves, ax = listed(curves, "plot_backbone_over_responses") if curves else [], new_axes(ax)
    responses = [curve["drive"].amplitude[:, 1] for curve in curves]
    scale, unit = prefixed("m", *(responses or (b.amplitude for b in backbones)))
    for curve, own, color in zip(curves, responses, level_colors(curves) if curves else [], strict=True):
        ax.plot(curve.hz, own * scale, color=color, linewidth=1.0, label=f"{curve.level:g} N")
    _draw(ax, [(b, b.hz, b.amplitude * scale) for b in backbones])
    logarithmic(ax.yaxis)
    if curves:
        ax.set_xlim(min(float(c.hz.min()) for c in curves), max(float(c.hz.max()) for c in curves))
        lowest, tallest = min(float(own.min()) for own in responses), max(float(own.max()) for own in responses)
        ax.set_ylim(lowest * scale / 1.5, tallest * scale * 2.0)
        ax.legend(frameon=False, fontsize=SMALL, labelcolor=INK, loc="best")
    wide_enough(ax.xaxis)
    return dressed(ax, "Frequency [Hz]", f"Drive displacement,\nfundamental [{unit}]")


def _listed(backbones: Backbones, where: str) -> list[Backbone]:
    return one_or_several(backbones, Backbone, where, "backbones")  # type: ignore[type-abstract]


def _draw(ax: Axes, lines: Sequence[tuple[Backbone, Array, Array]]) -> None:
    for backbone, x, y in lines:
        free = isinstance(backbone, NonlinearMode)
        ax.plot(
            x,
            y,
            color=MODE if free else RESONANCE,
            linewidth=1.6 if free else 1.1,
            linestyle="-" if free else (0, (4, 1.5)),
            label="nonlinear mode" if free else "phase resonance",
        )


def _mark_limits(ax: Axes, backbones: Sequence[Backbone], stuck: float, sliding: float) -> None:
    """Thin lines at two limits, each with its label, above the upper and below the lower; none of a rigid motion."""
    held, free = backbones[0].rig.limits
    names = {stuck: held, sliding: free} if stuck != sliding else {stuck: f"{held},\n{free}"}
    for value, name in names.items():
        if value == 0.0:
            continue
        ax.axhline(value, color=FAINT, linewidth=0.8, zorder=0)
        side = "center" if len(names) == 1 else "bottom" if value == max(names) else "top"
        ax.annotate(name, (1.0, value), (3, 0), ax.get_yaxis_transform(), "offset points", va=side, fontsize=SMALL)


def _shade_lift_off(ax: Axes, backbones: Sequence[Backbone], scale: float) -> None:
    """Shade the amplitudes at which the tip would lift off in the first backbone."""
    first = backbones[0].lift_off
    if first is not None:
        ax.axvspan(first * scale, backbones[0].amplitude.max() * scale, color="0.95", zorder=-1, linewidth=0)
        across = ax.get_xaxis_transform()
        ax.text(first * scale, 0.5, "lift-off ", transform=across, ha="right", va="center", fontsize=SMALL)
