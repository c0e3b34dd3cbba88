"""Figures of results. Functions take the axes to draw into and return them; none shows or saves anything.

Without axes a function makes a figure of its own, in `pyplot`; what it returns, an `Axes` or an array of them where
there are several panels, has it as ``.figure``.

Colour carries the level, line style the stability (dashed where unstable). Nothing global is changed: a user's own
style stays in force for everything that is not said here. Figures of the inverse problem are in
:mod:`hbm.figures.inverse`, of identified laws in :mod:`hbm.figures.identification`; :mod:`hbm.figures.page` makes the
one HTML page that holds figures, tables and what to beware of.

Names are imported when they are first used: what draws a reconstruction needs nothing of curves.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
