"""A curve over what is varied: its stretches that are stable, unstable, and in doubt."""

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes

from hbm.figures.style import Color
from hbm.fourier import Array

if TYPE_CHECKING:
    from hbm.response.curve import ResponseCurve

DASHES = {"unstable": (0, (3, 1.5)), "in doubt": (0, (1, 1))}


def draw_line(
    ax: Axes,
    curve: "ResponseCurve",
    y: Array,
    color: Color,
    linewidth: float = 1.4,
    label: str | None = None,
    **style: Any,
) -> None:
    """Draw a line over what is varied, dashed where the curve says it is unstable, dotted in doubt."""
    label = ", ".join(curve.held) if label is None else label
    style |= {"color": color, "linewidth": linewidth}
    if curve.stable is None or curve.doubtful is None:
        ax.plot(curve.values, y, label=label, **style)
        return
    unstable = ~curve.stable & ~curve.doubtful
    ax.plot(curve.values, np.where(unstable | curve.doubtful, np.nan, y), label=label, **style)
    for name, chosen in (("unstable", unstable), ("in doubt", curve.doubtful)):
        if chosen.any():
            part = np.where(_with_neighbours(chosen), y, np.nan)
            ax.plot(curve.values, part, linestyle=DASHES[name], label=f"_{name}", **style)


def _with_neighbours(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Mask that also covers the entries beside it: the segments that lead there."""
    wide = mask.copy()
    wide[1:] |= mask[:-1]
    wide[:-1] |= mask[1:]
    return wide
