"""Sphinx extension: notebooks become pages, and markers become tables.

A line ``<!-- generated: NAME -->`` in a page, with the table after it, is replaced by the table of that name in
``tables.py``.
"""

import re
from pathlib import Path
from typing import Any

import nbformat
from nbconvert import MarkdownExporter
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util.nodes import make_refnode

from generated.fill import MARKER
from generated.tables import TABLES

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"
CITED = re.compile(r"docs/([\w/]+)\.md")


def setup(app: Sphinx) -> dict[str, Any]:
    """Register what this extension does."""
    app.connect("builder-inited", write_notebooks)
    app.connect("source-read", fill_in)
    app.connect("autodoc-process-docstring", prepare)
    app.connect("missing-reference", by_public_name)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def write_notebooks(app: Sphinx) -> None:
    """Write a page for every notebook as it was executed, beside the tutorials that are Markdown already."""
    folder = Path(app.srcdir) / "tutorials"
    for path in sorted(NOTEBOOKS.glob("[0-9]*.ipynb")):
        text, figures = notebook_page(path)
        write_changed(folder / f"{path.stem}.md", text.encode())
        for name, png in figures.items():
            write_changed(folder / name, png)


def write_changed(path: Path, content: bytes) -> None:
    """Leave a file that is the same alone, so that it is not read again."""
    path.parent.mkdir(exist_ok=True)
    if not path.exists() or path.read_bytes() != content:
        path.write_bytes(content)


def notebook_page(path: Path) -> tuple[str, dict[str, bytes]]:
    """Markdown of a notebook, and its figures by file name."""
    resources: dict[str, Any] = {"unique_key": path.stem, "output_files_dir": path.stem}
    text, resources = MarkdownExporter().from_notebook_node(nbformat.read(path, as_version=4), resources)
    text = re.sub(r"`docs/(\S+\.md)`", r"[\1](../\1)", text)
    note = f"*This is `notebooks/{path.name}` as it was executed. Its source is `notebooks/{path.stem}.py`.*"
    heading, _, rest = text.lstrip().partition("\n")
    return f"{heading}\n\n{note}\n{rest}", resources["outputs"]


def fill_in(app: Sphinx, page: str, source: list[str]) -> None:
    """Replace the markers of a page by tables made from the code."""

    def table(marker: re.Match[str]) -> str:
        if marker[1] not in TABLES:
            raise ExtensionError(f"{page}: no table {marker[1]!r}; tables are {', '.join(TABLES)}")
        return TABLES[marker[1]]()

    source[0] = MARKER.sub(table, source[0])


def prepare(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Link the pages that a docstring cites, and keep docutils from taking |v| for one of its substitutions."""
    for i, line in enumerate(lines):
        parts = line.split("`")  # what is between backticks stays as it is
        parts[::2] = [CITED.sub(r":doc:`/\1`", part.replace("|", r"\|")) for part in parts[::2]]
        lines[i] = "`".join(parts)


def by_public_name(app: Sphinx, env: Any, node: Any, content: Any) -> Any:
    """Link ``hbm.response.accuracy.frequency_response``, as docstrings say it, to ``hbm.frequency_response``."""
    last = node.get("reftarget", "").rpartition(".")[2]
    known = env.get_domain("py").objects
    found = [f"{package}.{last}" for package in ("hbm", "models", "continuation") if f"{package}.{last}" in known]
    if node.get("refdomain") != "py" or len(found) != 1:
        return None
    entry = known[found[0]]
    return make_refnode(app.builder, node["refdoc"], entry.docname, entry.node_id, content, found[0])
