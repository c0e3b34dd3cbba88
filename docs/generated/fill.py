"""Tables of keys in the pages themselves, for those who read the Markdown. A test holds them to the code.

Run: PYTHONPATH=docs python -m generated.fill
"""

import re
from pathlib import Path

from generated.tables import TABLES

MARKER = re.compile(r"^<!-- generated: (.+) -->$(?:\n\n\|.*(?:\n\|.*)*)?", re.M)
"""A marker, with the table that was written after it."""

REFERENCE = Path(__file__).parents[1] / "reference"
PAGES = ("rig_files.md", "joints.md")


def filled(text: str) -> str:
    """A page with a fresh table of keys after each marker that asks for one."""

    def table(marker: re.Match[str]) -> str:
        name = marker[1]
        return f"<!-- generated: {name} -->\n\n{TABLES[name]()}" if name.startswith("keys of ") else marker[0]

    return MARKER.sub(table, text)


if __name__ == "__main__":
    for page in PAGES:
        path = REFERENCE / page
        path.write_text(filled(path.read_text(encoding="utf-8")), encoding="utf-8")
