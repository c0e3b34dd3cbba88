"""Figures of results. Functions take the axes to draw into and return them; none shows or saves anything.

Without axes a function makes a figure of its own, in `pyplot`; what it returns, an `Axes` or an array of them where
there are several panels, has it as ``.figure``.

Colour carries the level, line style the stability (dashed where unstable). Nothing global is changed: a user's own
style stays in force for everything that is not said here. Figures of the inverse problem are in
:mod:`hbm.figures.inverse`, of identified laws in :mod:`hbm.figures.identification`; :mod:`hbm.figures.page` makes the
one HTML page that holds figures, tables and what to beware of.

Names are imported when they are first used: what draws a reconstruction needs nothing of curves.
"""

from typing import TYPE_CHECKING

from hbm.lazy import first_used

if TYPE_CHECKING:
    from hbm.figures.curves import (
        least_reaction,
        phase_degrees,
        plot_contact,
        plot_curves,
        plot_frequency_response,
        plot_phase,
    )
    from hbm.figures.histories import plot_history
    from hbm.figures.loops import plot_loop, plot_loops
    from hbm.figures.sensors import plot_channel, plot_sensors

__all__ = [
    "least_reaction",
    "phase_degrees",
    "plot_channel",
    "plot_contact",
    "plot_curves",
    "plot_frequency_response",
    "plot_history",
    "plot_loop",
    "plot_loops",
    "plot_phase",
    "plot_sensors",
]

__getattr__ = first_used(
    __name__,
    {
        "hbm.figures.curves": (
            "least_reaction",
            "phase_degrees",
            "plot_contact",
            "plot_curves",
            "plot_frequency_response",
            "plot_phase",
        ),
        "hbm.figures.histories": ("plot_history",),
        "hbm.figures.loops": ("plot_loop", "plot_loops"),
        "hbm.figures.sensors": ("plot_channel", "plot_sensors"),
    },
)
