"""Display of objects in notebooks: their words as a heading, a table or lines."""

import re
from html import escape
from itertools import groupby

COLUMNS = re.compile(r"\s{2,}")
"""Separator of columns in words."""


class Displayed:
    """An object that is shown in a notebook as in a terminal: its ``str``, with columns as a table."""

    def _repr_html_(self) -> str:
        return html_of(str(self))


def html_of(text: str) -> str:
    r"""Words of an object in HTML: the first line as a heading, lines with columns as rows of tables.

    >>> html_of("3 modes\n  1  47.8 Hz\nin all")
    '<div><strong>3 modes</strong><table><tr><td>1</td><td>47.8 Hz</td></tr></table><div>in all</div></div>'
    """
    first, *lines = text.splitlines() or [""]
    rows = [[escape(cell) for cell in COLUMNS.split(line.strip())] for line in lines]
    parts = [f"<strong>{escape(first)}</strong>"]
    for tabular, group in groupby(rows, key=lambda cells: len(cells) > 1):
        listed = list(group)
        parts.append(_table(listed) if tabular else "".join(f"<div>{cells[0]}</div>" for cells in listed))
    return f"<div>{''.join(parts)}</div>"


def _table(rows: list[list[str]]) -> str:
    """Rows in HTML, short ones to the right: the headings of numbered rows have none for the number."""
    columns = max(map(len, rows))
    filled = [[""] * (columns - len(cells)) + cells for cells in rows]
    return f"<table>{''.join(f'<tr>{_cells(cells)}</tr>' for cells in filled)}</table>"


def _cells(cells: list[str]) -> str:
    return "".join(f"<td>{cell}</td>" for cell in cells)
