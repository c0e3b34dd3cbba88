"""Figures of identified friction laws: loops beside the measured ones, residuals, parameters by level, ranking.

A law is told by colour, line style and marker together. What laws predict is given as plain arrays, so that laws from
anywhere can be compared.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch
from matplotlib.ticker import MaxNLocator

from hbm.figures.inverse import BAND, HARMONIC, loop_band, loop_labels, representative, unit_of
from hbm.figures.scales import OneStyle, log_numbers, logarithmic
from hbm.figures.style import (
    FAINT,
    INK,
    SMALL,
    AxesArray,
    as_written,
    closed,
    dressed,
    label_all,
    legend_above,
    panels,
    wrapped_panels,
)
from hbm.figures.units import prefixed
from hbm.fourier import Array

if TYPE_CHECKING:
    from hbm.inverse.reconstruction import Reconstruction

Predicted = Mapping[str, Array]
"""Signal of each law at the samples of the reconstruction's records, (r, N), nan where a record was held out."""

LAW_COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#000000", "#E69F00", "#56B4E9")  # Wong 2011
LAW_STYLES = ("-", (0, (5, 1.5)), (0, (2, 1)), (0, (5, 1, 1, 1)), (0, (1, 1)))
LAW_MARKERS = "osD^vPX"

APART = 0.25
"""Least distance of numbers on an axis that is half as wide as the page, beside long names, as a share of it."""

LINEAR = 10.0
"""BIC up to this is drawn to scale, over the width of a power of ten, more by its logarithm."""


@dataclass(frozen=True, eq=False)
class ParameterByLevel:
    """A parameter of a law, fitted to each level alone and to all together.

    Attributes
    ----------
    law, name, unit : str
    level : (l,) array
        Force levels [N].
    value, std : (l,) array
    overall, overall_std : float
        Value for all levels together and its standard deviation; nan where not fitted.
    """

    law: str
    name: str
    unit: str
    level: Array
    value: Array
    std: Array
    overall: float = np.nan
    overall_std: float = np.nan


def law_style(index: int) -> dict[str, Any]:
    """Colour, line style and marker of a law by its place."""
    return {
        "color": LAW_COLORS[index % len(LAW_COLORS)],
        "linestyle": LAW_STYLES[index % len(LAW_STYLES)],
        "marker": LAW_MARKERS[index % len(LAW_MARKERS)],
    }


# -------------------------------------------------------------------------------------------------------------- loops


def plot_law_loops(
    reconstruction: "Reconstruction",
    predicted: Predicted,
    records: Sequence[int] | None = None,
    axes: AxesArray | None = None,
    *,
    slip: Predicted | None = None,
) -> AxesArray:
    """Loops of fitted laws on the reconstructed ones, a panel per record; the 95 % band in grey.

    Parameters
    ----------
    reconstruction : Reconstruction
    predicted : mapping of str to (r, N) array
        Friction of each law under the reconstructed slip and reaction [N].
    records : sequence of int, optional
        Numbers of records; the two of each level that slip most where omitted, as far as they slip.
    axes : array of Axes, optional
        One per record.
    slip : mapping of str to (r, N) array, optional
        Slip of each law [m]; the reconstructed one where omitted.

    Returns
    -------
    (records,) array of Axes

    Raises
    ------
    InputError
        If there is no such record.
    """
    chosen = loop_records(reconstruction) if records is None else list(records)
    found = wrapped_panels(axes, len(chosen), 0.6, 1.9, sharey=True)
    for record, ax in zip(chosen, found, strict=True):
        _draw_laws(ax, reconstruction, predicted, slip or {}, reconstruction.index(record))
    label_all(found, *loop_labels(reconstruction))
    legend_above(found, found[0].get_legend_handles_labels()[0], ncols=3)
    return found


def loop_records(reconstruction: "Reconstruction") -> list[int]:
    """Two records of each level that slip, or where none does the one that moves most."""
    chosen = representative(reconstruction, 2)
    slipping = [record for record in chosen if reconstruction.slips[reconstruction.index(record)]]
    return slipping or representative(reconstruction, 1)


def _draw_laws(ax: Axes, reconstruction: "Reconstruction", predicted: Predicted, slips: Predicted, i: int) -> None:
    slip, friction = reconstruction["slip"], reconstruction["friction"]
    (by, _), (by_force, _) = unit_of(reconstruction, "slip"), unit_of(reconstruction, "friction")
    u, T = slip.samples[i] * by, friction.samples[i] * by_force
    band = loop_band(u, T, slip.std[i] * by, friction.std[i] * by_force)
    ax.add_patch(PathPatch(band, facecolor="0.86", linewidth=0, zorder=1))
    ax.plot(closed(u), closed(T), color="0.55", linewidth=2.2, zorder=2, label="reconstructed")
    for n, (law, forces) in enumerate(predicted.items()):
        style = law_style(n) | {"marker": ""}
        own = slips[law][i] * by if law in slips else u
        ax.plot(closed(own), closed(forces[i] * by_force), linewidth=1.2, zorder=3, label=as_written(law), **style)
    ax.autoscale_view()
    ax.xaxis.set_major_locator(MaxNLocator(4))
    dressed(ax, "", "")
    spectra = reconstruction.spectra
    ax.set_title(f"{spectra.level[i]:g} N, {spectra.hz[i]:.4g} Hz", fontsize=SMALL, loc="left", color=INK)


# ---------------------------------------------------------------------------------------------------------- residuals


def plot_law_residuals(
    reconstruction: "Reconstruction", predicted: Predicted, axes: AxesArray | None = None
) -> AxesArray:
    """Draw the friction that laws leave in each harmonic, beside the resolution of the sensors.

    Left: rms over the records [N]. Right: relative to the resolution of the sensors in each record; near 1 where a law
    leaves noise alone, to which that of the slip adds through the law's stiffness.

    Parameters
    ----------
    reconstruction : Reconstruction
    predicted : mapping of str to (r, N) array
        Friction of each law [N].
    axes : array of two Axes, optional

    Returns
    -------
    (2,) array of Axes
    """
    pair = panels(axes, 1, 2, 2.8).ravel()
    left, right = pair
    k, noise = np.arange(1, reconstruction.H + 1), residual_noise(reconstruction)
    found = {law: law_residuals(reconstruction, forces) for law, forces in predicted.items()}
    scale, unit = prefixed("N", noise, *(rms for rms, _ in found.values()))
    left.plot(
        k,
        scale * noise,
        color="0.5",
        linewidth=0.9,
        drawstyle="steps-mid",
        label="resolution of the sensors, std",
    )
    right.axhline(1.0, color="0.5", linewidth=0.9)
    for n, (law, (rms, relative)) in enumerate(found.items()):
        for ax, values in ((left, scale * rms), (right, relative)):
            ax.plot(k, values, linewidth=1.1, markersize=3.5, label=as_written(law), **law_style(n))
    for ax, least in ((left, scale * float(noise[noise > 0.0].min(initial=1.0))), (right, 1.0)):
        logarithmic(ax.yaxis)
        ax.set_ylim(bottom=0.05 * least)
        ax.set_xticks(k[:: 1 + len(k) // 12])
    dressed(left, HARMONIC, f"Residual, rms [{unit}]")
    dressed(right, HARMONIC, "Residual / resolution")
    legend_above(pair, left.get_legend_handles_labels()[0], ncols=3)
    return pair


def law_residuals(reconstruction: "Reconstruction", forces: Array) -> tuple[Array, Array]:
    """Rms over records of what a law leaves of each cosine and sine of friction: [N], and relative to resolution."""
    friction, H = reconstruction["friction"], reconstruction.H
    left = 2.0 * np.fft.rfft(forces, axis=1)[:, 1 : H + 1] / forces.shape[1] - friction.complex[:, 1:]
    std = reconstruction.resolution[:, 1:]
    relative = np.divide(np.abs(left), std, out=np.full(std.shape, np.nan), where=np.isfinite(std) & (std > 0.0))
    return _rms(np.abs(left)) / np.sqrt(2.0), _rms(relative) / np.sqrt(2.0)


def residual_noise(reconstruction: "Reconstruction") -> Array:
    """Rms over records of what the sensors resolve of each harmonic of friction, (H,) [N]; nan where nothing."""
    resolution = reconstruction.resolution[:, 1:]
    return _rms(np.where(np.isfinite(resolution), resolution, np.nan))


def _rms(values: Array) -> Array:
    known = np.isfinite(values)
    sums, counts = np.sum(np.where(known, values, 0.0) ** 2, axis=0), known.sum(axis=0)
    return np.asarray(np.sqrt(np.divide(sums, counts, out=np.full(len(sums), np.nan), where=counts > 0)))


# --------------------------------------------------------------------------------------------------------- parameters


def plot_parameters(
    parameters: Sequence[ParameterByLevel], laws: Sequence[str] = (), axes: AxesArray | None = None
) -> AxesArray:
    """Values of parameters by level with 95 % bars, a panel each; the value of all levels as a line in its band.

    Parameters
    ----------
    parameters : sequence of ParameterByLevel
    laws : sequence of str
        All laws of the other figures, in their order: each keeps its colour and marker.
    axes : array of Axes, optional
        One per parameter.

    Returns
    -------
    (parameters,) array of Axes
    """
    found = wrapped_panels(axes, len(parameters), 0.3, 1.85)
    order = list(dict.fromkeys([*laws, *(p.law for p in parameters)]))
    for p, ax in zip(parameters, found, strict=True):
        _draw_parameter(ax, p, law_style(order.index(p.law)))
    label_all(found, "Force level [N]")
    return found


def _draw_parameter(ax: Axes, p: ParameterByLevel, style: dict[str, Any]) -> None:
    bar = BAND * p.std
    if np.isfinite(p.overall):
        ax.axhline(p.overall, color="0.45", linewidth=0.9, zorder=1)
        if np.isfinite(p.overall_std):
            reach = BAND * p.overall_std
            ax.axhspan(p.overall - reach, p.overall + reach, color="0.88", linewidth=0, zorder=0)
    ax.vlines(p.level, p.value - bar, p.value + bar, color=style["color"], linewidth=1.2, zorder=2)
    ax.plot(p.level, p.value, style["marker"], color=style["color"], markersize=4.5, zorder=3, label=p.name)
    ax.margins(x=0.15, y=0.2)
    _keep_in_view(ax, p, style)
    ax.ticklabel_format(axis="y", scilimits=(-3, 4), useMathText=True)
    ax.yaxis.get_offset_text().set(fontsize=SMALL, color=INK, ha="right")
    ax.set_xticks(p.level, [f"{level:g}" for level in p.level])
    ax.yaxis.set_major_locator(MaxNLocator(4))
    dressed(ax, "", "" if p.unit in ("", "1") else f"[{p.unit}]")
    ax.set_title(f"{p.law}\n{p.name}", fontsize=SMALL, loc="left", color=INK, y=1.12)


def _keep_in_view(ax: Axes, p: ParameterByLevel, style: dict[str, Any]) -> None:
    """Show values that a level does not determine hollow, and let their bars leave the panel."""
    determined = np.isfinite(p.std) & (p.std < np.abs(p.value))
    if determined.all():
        return
    hollow = {"color": style["color"], "markerfacecolor": "white", "markersize": 4.5, "zorder": 4}
    ax.plot(p.level[~determined], p.value[~determined], style["marker"], **hollow)
    value, bar = (p.value[determined], BAND * p.std[determined]) if determined.any() else (p.value, 0.5 * p.value)
    low, high = float(np.nanmin(value - bar)), float(np.nanmax(value + bar))
    ax.set_ylim(low - 0.2 * (high - low), high + 0.2 * (high - low))


# ------------------------------------------------------------------------------------------------------------ ranking


def plot_ranking(
    laws: Sequence[str],
    bic: Array,
    error: Array | None = None,
    axes: AxesArray | None = None,
    *,
    clear: float,
) -> AxesArray:
    """Laws in the order of their BIC, the best on top, and the error of each on records it was not fitted to.

    Parameters
    ----------
    laws : sequence of str
    bic : (l,) array
    error : (l,) array, optional
        On held-out records, relative.
    axes : array of Axes, optional
        One, or two with errors.
    clear : float
        Difference of BIC that a rule asks for, marked by a line.

    Returns
    -------
    (1,) or (2,) array of Axes
    """
    order = np.argsort(bic)
    found = panels(axes, 1, 1 if error is None else 2, 0.9 + 0.26 * len(laws), sharey=True).ravel()
    y = np.arange(len(laws))
    _bars(found[0], y, (bic - bic.min())[order], ".4g")
    found[0].set_xscale("symlog", linthresh=LINEAR)
    if np.ptp(bic) >= LINEAR:
        found[0].set_xticks([0.0, *(v for v in log_numbers(1.0, float(np.ptp(bic)), APART) if v >= LINEAR)])
        found[0].xaxis.set_major_formatter(OneStyle())
    dressed(found[0], f"BIC above the best; line: {clear:g}", "")
    found[0].axvline(clear, color=FAINT, linewidth=0.8, zorder=0)
    found[0].set_yticks(y, [as_written(laws[i]) for i in order])
    found[0].invert_yaxis()
    if error is not None:
        _bars(found[1], y, 100.0 * error[order], ".3g")
        dressed(found[1], "Held-out error [%]", "")
    return found


def _bars(ax: Axes, y: npt.NDArray[np.intp], width: Array, form: str) -> None:
    bars = ax.barh(y, width, height=0.62, color="0.72")
    bars[0].set_color(LAW_COLORS[0])
    ax.bar_label(bars, [format(w, form) for w in width], padding=3, fontsize=SMALL, color=INK)
    ax.margins(x=0.18)
    ax.tick_params(axis="y", length=0)
