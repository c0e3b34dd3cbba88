"""Figure of what the extended model gains: the error of each model on records fitted and held out."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from matplotlib.lines import Line2D

from hbm.figures.compared import MODELS
from hbm.figures.diagnosis import COLORS, FIVE_COLUMNS
from hbm.figures.scales import logarithmic
from hbm.figures.style import FAINT, INK, AxesArray, dressed, legend_above, panels

if TYPE_CHECKING:
    from hbm.diagnosis.verdict import Diagnosis


def plot_gain(diagnosis: "Diagnosis", axes: AxesArray | None = None) -> AxesArray:
    """Error of each model on the records fitted and on those held out.

    Parameters
    ----------
    diagnosis : Diagnosis
    axes : array of two Axes, optional

    Returns
    -------
    (2,) array of Axes
    """
    pair = panels(axes, 1, 2, 1.9, sharey=True).ravel()
    names = [name for name in MODELS if name in diagnosis.errors]
    for ax, (key, factor, label) in zip(
        pair, (("nrmse", 100.0, "Error [%]"), ("chi2_reduced", 1.0, "Misfit [noise variances]")), strict=True
    ):
        logarithmic(ax.xaxis)
        low, high = _ends([factor * getattr(e, key) for name in names for e in diagnosis.errors[name].values()])
        ax.set_xlim(low, high)
        for y, name in enumerate(names):
            parts = diagnosis.errors[name]
            values = {part: factor * getattr(e, key) for part, e in parts.items()}
            ax.plot(list(values.values()), [y] * len(values), color=FAINT, linewidth=1.2, zorder=1)
            for part, value in values.items():
                face = COLORS[name] if part == "train" else "white"
                ax.plot(value, y, "o", color=COLORS[name], markerfacecolor=face, markersize=6, zorder=2)
        dressed(ax, label, "")
    pair[1].axvline(1.0, color=FAINT, linewidth=0.9, zorder=0)
    pair[0].set_yticks(range(len(names)), names)
    pair[0].set_ylim(len(names) - 0.5, -0.5)
    shown: dict[str, Any] = {"markersize": 5, "linestyle": "", "marker": "o", "color": INK}
    handles = [
        Line2D([], [], label="records fitted", **shown),
        Line2D([], [], label="records held out", markerfacecolor="white", **shown),
    ]
    legend_above(pair, handles, **FIVE_COLUMNS)
    return pair


def _ends(values: Sequence[float]) -> tuple[float, float]:
    """Ends of a logarithmic axis about values, which may all be alike."""
    positive = [v for v in values if v > 0.0] or [1.0]
    low, high = min(positive), max(positive)
    margin = 1.3 * (high / low) ** 0.05
    return low / margin, high * margin
