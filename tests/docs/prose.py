"""Reading ease of Markdown pages: the words of each sentence.

Run: python tests/docs/prose.py [PAGE.md ...]
"""

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from statistics import median

ROOT = Path(__file__).parents[2]
MARK = re.compile(r"^\s*(?:[-*+]|\d+\.|>)\s+")
ABBREVIATED = re.compile(r"\b(?:e\.g|i\.e|et al|Fig|Eq|Eqs|vs|ref|p|pp|No|[A-Z])$")


def pages() -> list[Path]:
    """The README and every page of the documentation except the archive, which holds tables of past scores."""
    found = [path for path in sorted((ROOT / "docs").rglob("*.md")) if "archive" not in path.parts]
    return [ROOT / "README.md", *found]


def paragraphs(text: str) -> Iterator[str]:
    """Prose of a page: no code, tables, headings, equations, HTML or link definitions."""
    text = re.sub(r"^( *)(```|~~~).*?^\1\2[^\n]*$", "\n", text, flags=re.M | re.S)
    text = re.sub(r"^\$\$.*?\$\$\s*$|<!--.*?-->", "\n", text, flags=re.M | re.S)
    block: list[str] = []
    for line in [*text.splitlines(), ""]:
        bare = line.strip()
        aside = bare.startswith(("|", "#", "<", "![", "[", ":::", "!!!")) and not re.match(r"\[[^\]]*\]\(", bare)
        if not bare or aside or MARK.match(line) or (line.startswith("    ") and not block):
            if block:
                yield " ".join(block)
            block = [MARK.sub("", line).strip()] if MARK.match(line) else []
        else:
            block.append(bare)


def sentences(text: str) -> Iterator[str]:
    """Sentences of a page, of three words or more."""
    for paragraph in paragraphs(text):
        bare = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", paragraph)
        bare = re.sub(r"\$[^$]*\$|`[^`]*`", "x", bare)  # a formula or a name counts as one word
        bare = re.sub(r"[*_]", "", bare)
        start = 0
        for end in re.finditer(r"[.!?:;](?=[\"')]*\s+|$)", bare):
            if end[0] in ":;" or ABBREVIATED.search(bare[: end.start()]):
                continue
            if len(bare[start : end.end()].split()) >= 3:
                yield bare[start : end.end()].strip()
            start = end.end()
        if len(bare[start:].split()) >= 3:
            yield bare[start:].strip()


def lengths(path: Path) -> list[int]:
    """Words of each sentence of a page."""
    return [len(s.split()) for s in sentences(path.read_text(encoding="utf-8"))]


def main(paths: list[Path]) -> None:
    """Print the median of each page and of all."""
    every: list[int] = []
    for path in paths:
        found = lengths(path)
        every += found
        if found:
            name = path.resolve().relative_to(ROOT)
            print(f"{median(found):5.1f}  {sorted(found)[int(0.9 * len(found))]:4d}  {len(found):4d}  {name}")
    print(f"{median(every):5.1f}  {sorted(every)[int(0.9 * len(every))]:4d}  {len(every):4d}  all")


if __name__ == "__main__":
    main([Path(name) for name in sys.argv[1:]] or pages())
