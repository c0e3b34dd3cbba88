"""What docstrings, comments and pages cite is there: pages, their sections, links and their anchors."""

import re
from collections.abc import Iterator
from pathlib import Path

import prose
import pytest

ROOT = prose.ROOT
CODE = sorted(
    path
    for folder in ("hbm", "models", "continuation", "tests", "benchmarks", "examples", "notebooks", "docs")
    for path in (ROOT / folder).rglob("*.py")
    if path != Path(__file__)
)
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "examples").rglob("*.md")])
CITED = re.compile(r"(?<![\w./-])((?:[\w-]+/)*[\w-]+\.md)\b(?: section (\d+))?")
LINK = re.compile(r"(?<!\\)\]\(([^)\s]+)\)")
FENCE = re.compile(r"^( *)(```|~~~).*?^\1\2[^\n]*$", re.M | re.S)


def exists(path: Path) -> bool:
    """Whether a page is in the repository, or is made from a notebook that is."""
    made = path.parent == ROOT / "docs" / "tutorials" and (ROOT / "notebooks" / f"{path.stem}.ipynb").exists()
    return path.exists() or made


def anchors(path: Path) -> set[str]:
    """Anchors of the headings of a page, as GitHub and MyST make them."""
    text = FENCE.sub("", path.read_text(encoding="utf-8"))
    headings = re.findall(r"^#+ (.*?)\s*$", text, re.M)
    return {re.sub(r"[^\w\- ]", "", re.sub(r"\]\([^)]*\)", "", h).lower()).replace(" ", "-") for h in headings}


@pytest.mark.parametrize("path", CODE, ids=lambda path: str(path.relative_to(ROOT)))
def test_pages_that_code_cites_are_in_the_repository(path: Path) -> None:
    for page, section in CITED.findall(path.read_text(encoding="utf-8")):
        target = ROOT / page if "/" in page else path.parent / page
        assert exists(target) or page in made_by(path), f"{page} is cited and not there"
        if section:
            assert any(a.startswith(f"{section}-") for a in anchors(target)), f"{page} has no section {section}"


def made_by(path: Path) -> set[str]:
    """Pages that a script writes, reads from a folder of its own, or has as an example."""
    return {
        page
        for line in path.read_text(encoding="utf-8").splitlines()
        for page in re.findall(r"[\"']([\w-]+\.md)[\"']", line)
    } | {"PAGE.md", "notes.md", "ABOUT.md", "README.md", "CONTRIBUTING.md"}


def links(path: Path) -> Iterator[str]:
    """Targets of a page's links within the repository."""
    for target in LINK.findall(FENCE.sub("", path.read_text(encoding="utf-8"))):
        if not re.match(r"[a-z]+:", target):
            yield target


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_of_pages_lead_somewhere(path: Path) -> None:
    for target in links(path):
        name, _, anchor = target.partition("#")
        page = (path.parent / name).resolve() if name else path
        assert exists(page), f"{target} is not there"
        if anchor:
            assert anchor in anchors(page), f"{name or path.name} has no heading #{anchor}"


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_pages_named_in_text_are_in_the_repository(path: Path) -> None:
    named = re.findall(
        r"`((?:docs|notebooks|examples|benchmarks|tests|hbm|models)/[\w./-]+\.(?:md|py|ipynb|toml))`",
        path.read_text(encoding="utf-8"),
    )
    missing = [name for name in named if not exists(ROOT / name)]
    assert not missing
