"""One self-contained HTML page of a result: key numbers, warnings, figures, tables, links to the numbers of each curve.

A :class:`Page` is what it says, in order; :func:`page_html` makes the text of the file. It opens without a network, in
light and dark, and prints.
"""

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import matplotlib as mpl
from matplotlib.figure import Figure

LARGEST = 5_000_000
"""Bytes of a page, at most."""

LARGEST_SVG = 500_000
"""Larger vector graphics are shown as pixels."""

RESOLUTIONS = (200, 150, 100, 70)
"""Dots per inch of pixel graphics, twice a screen's, or as many as the page has room for."""


@dataclass(frozen=True)
class Table:
    """Rows of entries that are shown as they are.

    Attributes
    ----------
    headings : sequence of str
    rows : sequence of sequences of str
    caption : str
    """

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""

    def __post_init__(self) -> None:
        """Refuse ragged rows."""
        for row in self.rows:
            if len(row) != len(self.headings):
                raise ValueError(f"row {list(row)} has {len(row)} entries; must have {len(self.headings)}")

    @property
    def texts(self) -> list[int]:
        """Columns that hold no numbers."""
        return [i for i in range(len(self.headings)) if any(row[i][:1].isalpha() for row in self.rows)]


@dataclass(frozen=True, eq=False)
class Drawing:
    """Lines in a box, drawn by the page itself in its own colours.

    Attributes
    ----------
    heading : str
    width, height : int
        Of the box, in units of the points.
    lines : mapping of str to str
        Points "x,y x,y ..." by the name of the line, of which :attr:`Choice.lines` is the legend.
    """

    heading: str
    width: int
    height: int
    lines: Mapping[str, str]


@dataclass(frozen=True, eq=False)
class Option:
    """One of the things that a reader can choose to see."""

    label: str
    drawings: Sequence[Drawing]
    table: Table


@dataclass(frozen=True, eq=False)
class Choice:
    """Things of which a page shows one, and others as a reader chooses; without scripts the first alone.

    Attributes
    ----------
    label : str
        What is chosen.
    options : sequence of Option
    first : int
        Place of the one that is shown until another is chosen.
    lines : sequence of str
        Names of the lines in all drawings: measured, nominal, calibrated or extended.
    """

    label: str
    options: Sequence[Option]
    first: int
    lines: Sequence[str]


@dataclass(frozen=True, eq=False)
class Section:
    """A part of a page; everything but the heading may be left out.

    Attributes
    ----------
    heading : str
    text : sequence of str
        Paragraphs.
    figure : Figure or None
    file : str
        File of the figure, relative to the page, where it can be seen larger.
    caption : str
        How to read the figure.
    table : Table or None
    csv : sequence of str
        Files with the numbers of the section, relative to the page.
    choice : Choice or None
    """

    heading: str
    text: Sequence[str] = ()
    figure: Figure | None = None
    file: str = ""
    caption: str = ""
    table: Table | None = None
    csv: Sequence[str] = ()
    choice: Choice | None = None


@dataclass(frozen=True, eq=False)
class Page:
    """Content of an HTML page, from top to bottom.

    Attributes
    ----------
    title : str
    lead : sequence of str
        Paragraphs under the title: what was done, what came out.
    warnings : sequence of str
    tables : sequence of Table
        Short ones that stand side by side on the first screen.
    first : Section or None
        The one figure that says most; its heading is not shown.
    summary : sequence of (str, str)
        Key numbers, each with its name.
    sections : sequence of Section
    foot : str
    """

    title: str
    lead: Sequence[str] = ()
    warnings: Sequence[str] = ()
    tables: Sequence[Table] = ()
    first: Section | None = None
    summary: Sequence[tuple[str, str]] = ()
    sections: Sequence[Section] = field(default=())
    foot: str = ""


def page_html(page: Page) -> str:
    """Text of the HTML file, of at most `LARGEST` bytes.

    Raises
    ------
    ValueError
        If its text and tables alone are larger.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    template = Environment(
        loader=PackageLoader("hbm.figures", "."), autoescape=True, undefined=StrictUndefined
    ).get_template("page.html")
    for dpi in RESOLUTIONS:
        shown = [section for section in (page.first, *page.sections) if section is not None]
        images = {section: embedded(section.figure, dpi) for section in shown if section.figure is not None}
        text = template.render(page=page, images=images)
        size = len(text.encode())
        if size <= LARGEST:
            return text
    raise ValueError(f'page "{page.title}": {size} bytes; must be at most {LARGEST}')


def embedded(figure: Figure, dpi: int = RESOLUTIONS[0]) -> str:
    """A figure as the address of an image that holds it: vector graphics where they are small, else pixels."""
    vector = figure_bytes(figure, "svg")
    if len(vector) <= LARGEST_SVG and dpi == RESOLUTIONS[0]:
        return "data:image/svg+xml;base64," + base64.b64encode(vector).decode()
    return "data:image/png;base64," + base64.b64encode(figure_bytes(figure, "png", dpi)).decode()


def settle(figure: Figure) -> Figure:
    """Fix the layout of a figure, so that saving it is quick; return it, detached from `pyplot`."""
    import matplotlib.pyplot as plt

    plt.close(figure)
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine(None)  # "none" would draw it once more for each file
    return figure


def figure_bytes(figure: Figure, kind: str, dpi: int = RESOLUTIONS[0]) -> bytes:
    """Content of a figure's file, the same each time.

    Parameters
    ----------
    figure : Figure
    kind : str
        ``png``, ``pdf`` or ``svg``.
    dpi : int
    """
    content = io.BytesIO()
    dated = {"svg": "Date", "pdf": "CreationDate"}
    with mpl.rc_context({"svg.hashsalt": "hbm"}):
        figure.savefig(content, format=kind, dpi=dpi, metadata={dated[kind]: None} if kind in dated else None)
    return content.getvalue()
