"""Plates: figures of a page with the files that hold them and the numbers of their curves."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

from hbm.figures.page import Section, figure_bytes, settle
from hbm.figures.style import AxesArray
from hbm.files.outputs import Columns, columns_text

FOLDER = "figures"


@dataclass(frozen=True, eq=False)
class Plate:
    """A figure with its numbers and how it is read.

    Attributes
    ----------
    name : str
        Name of its files, ``figures/<name>.png`` and ``figures/<name>.csv``.
    heading, caption : str
    axes : array of Axes
        All that the figure shows.
    columns : mapping of str to (n,) array
        Columns that are drawn, in SI units.
    more : sequence of str
        Other files with its numbers, relative to the page.
    """

    name: str
    heading: str
    caption: str
    axes: AxesArray
    columns: Columns
    more: Sequence[str] = ()

    def __post_init__(self) -> None:
        """Lay the figure out, for it is saved several times."""
        settle(self.figure)

    @property
    def figure(self) -> Figure:
        """The whole figure."""
        figure: Figure = self.axes.flat[0].figure
        return figure

    @property
    def section(self) -> Section:
        """The plate as a part of a page."""
        return Section(
            self.heading, figure=self.figure, caption=self.caption, csv=(plate_files(self.name)[1], *self.more)
        )


def plate_files(name: str) -> tuple[str, str]:
    """Files of a plate, figure and numbers, relative to the page."""
    return f"{FOLDER}/{name}.png", f"{FOLDER}/{name}.csv"


def plate_contents(plates: Iterable[Plate]) -> dict[str, str | bytes]:
    """Contents of the files of plates by their names."""
    contents: dict[str, str | bytes] = {}
    for plate in plates:
        png, csv = plate_files(plate.name)
        contents |= {png: figure_bytes(plate.figure, "png"), csv: columns_text(plate.columns)}
    return contents
