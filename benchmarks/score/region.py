"""The page of where names can be trusted: by size of effect and background and by what was measured, from scores.

    python -m benchmarks.score.region docs/validation/archive/score-20262611*.md > docs/validation/region.md

Reads the tables that `benchmarks.diagnosis` writes; scores of one set are added up.
"""

import re
import sys
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.score.rates import wilson

SET = re.compile(r"^set (\S+), cases (\d+), ", re.M)
SIZES = re.compile(r"^\| effect (.+?), (no background|background .+?) \|[^|]*\| (\d+)/(\d+) \|", re.M)
TRUSTED = 0.9
"""Share of right names from which on they are relied on."""

MEASURED = {
    "E": "two modes, six sensors, three levels, harmonics 1 to 9",
    "D": "the first mode, six sensors, three levels, harmonics 1 to 9",
    "C": "the first mode, six sensors, three levels, fundamental alone",
    "A": "the first mode, one sensor, one level, fundamental alone",
    "one-level": "the first mode, six sensors, one level, harmonics 1 to 9",
    "one-sensor": "two modes, one sensor, three levels, harmonics 1 to 9",
    "40dB": "two modes, six sensors, three levels, harmonics 1 to 9, noise at 40 dB",
}

SCORES = "scores.md"
"""Page beside the one that is made."""


@dataclass
class Region:
    """Right names and cases of a set by size of effect and background, and the names of the scores."""

    cases: int = 0
    scores: list[str] = field(default_factory=list)
    right: Counter[tuple[str, str]] = field(default_factory=Counter)
    tried: Counter[tuple[str, str]] = field(default_factory=Counter)


def regions(paths: Iterable[Path]) -> dict[str, Region]:
    """By set, the richest first, from tables of scores.

    Raises
    ------
    ValueError
        If a file is no score, or does not say the sizes.
    """
    found: dict[str, Region] = {}
    for path in paths:
        page = path.read_text(encoding="utf-8")
        head, rows = SET.search(page), SIZES.findall(page)
        if head is None or not rows:
            raise ValueError(f"{path}: no right causes by effect and background; must be a score of this benchmark")
        region = found.setdefault(head[1], Region())
        region.cases += int(head[2])
        region.scores.append(path.stem)
        for effect, background, k, n in rows:
            region.right[effect, background] += int(k)
            region.tried[effect, background] += int(n)
    return {which: found[which] for which in MEASURED if which in found}


def markdown(found: dict[str, Region]) -> str:
    """The page."""
    parts = [
        "# Where names can be trusted",
        "",
        f"Made by `python -m benchmarks.score.region` from the [scores]({SCORES}); do not edit. Each cell: right",
        "cause first, of the cases drawn there, and its 95 % interval. **Bold** is below "
        f"{100 * TRUSTED:.0f} %: do not rely",
        "on the name there without the check that the report proposes. *Italic* is at or above it, in too few cases",
        "to exclude less. Effect and background are relative rms changes of the response, by the simulator, without",
        "noise.",
    ]
    for which, region in found.items():
        effects = list(dict.fromkeys(effect for effect, _ in region.tried))
        backgrounds = list(dict.fromkeys(background for _, background in region.tried))
        parts += ["", f"## {MEASURED[which][0].upper()}{MEASURED[which][1:]}", ""]
        told = ", ".join(f"[{name}](archive/{name}.md)" for name in region.scores)
        parts += [f"Set {which}, {region.cases} cases: {told}.", ""]
        parts += [f"| effect | {' | '.join(backgrounds)} |", "|---|" + "---:|" * len(backgrounds)]
        for effect in effects:
            cells = (cell(region.right[effect, b], region.tried[effect, b]) for b in backgrounds)
            parts.append(f"| {effect} | {' | '.join(cells)} |")
    return "\n".join(parts) + "\n"


def cell(k: int, n: int) -> str:
    """Right ones of so many.

    >>> cell(1, 4), cell(2, 2), cell(0, 0)
    ('**1 of 4** (5 to 70 %)', '*2 of 2* (34 to 100 %)', '-')
    """
    if n == 0:
        return "-"
    low, high = wilson(k, n)
    mark = "**" if k < TRUSTED * n else "*" if low < TRUSTED else ""
    return f"{mark}{k} of {n}{mark} ({100 * low:.0f} to {100 * high:.0f} %)"


if __name__ == "__main__":
    print(markdown(regions(map(Path, sys.argv[1:]))), end="")
