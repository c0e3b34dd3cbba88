"""The commands of docs/validation/measurements.md, word for word: what each diagnosis says, and how long it takes.

    python -m benchmarks.measurements                    # every section of the page
    python -m benchmarks.measurements F-16 Silverbox     # some; the F-16 alone takes some ten minutes

The measurements of others are not part of this repository: DATA of the page is ../shared/data beside it. What comes out
is for the one who runs it to hold against the page; tests/docs/test_measurement_commands.py does so for what is quick.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from hbm.figures.compared import MODELS

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "validation" / "measurements.md"
DATA = ROOT.parent / "shared" / "data"

DIAGNOSIS = "hbm diagnose"
COLUMNS = (
    "section",
    "verdict",
    "cause",
    "rig file\n%",
    "calibrated\n%",
    "extended\n%",
    "confidence",
    "wall\ns",
    "CPU\ns",
)


def sections() -> dict[str, str]:
    """Text of each section of the page that has commands, by its heading."""
    parts = re.split(r"^##+ (.+)\n", PAGE.read_text(encoding="utf-8"), flags=re.M)
    return {name: text for name, text in zip(parts[1::2], parts[2::2], strict=True) if "```sh\n" in text}


def commands(section: str) -> list[str]:
    """Lines of the commands of a section, those joined that the page breaks."""
    blocks = re.findall(r"^```sh\n(.*?)^```$", sections()[section], re.M | re.S)
    return re.sub(r"\\\n\s*", " ", "".join(blocks)).splitlines()


def run(lines: list[str], folder: Path) -> "subprocess.CompletedProcess[str]":
    """Run commands in a folder beside which the examples and DATA are."""
    for name, target in (("examples", ROOT / "examples"), ("DATA", DATA)):
        if not (folder / name).exists():
            (folder / name).symlink_to(target)
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = os.environ | {"PATH": path, "PYTHONPATH": str(ROOT), "COLUMNS": "200"}
    environment.pop("PYTHONWARNINGS", None)
    script = ["sh", "-e", "-c", "\n".join(lines)]
    return subprocess.run(script, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def _up_to_each_diagnosis(lines: list[str]) -> Iterator[list[str]]:
    """Commands in parts, each of which ends with a diagnosis or with the section."""
    part: list[str] = []
    for line in lines:
        part.append(line)
        if line.startswith(DIAGNOSIS):
            yield part
            part = []
    if part:
        yield part


def _said(folder: Path) -> tuple[str, ...]:
    """What the diagnosis in a folder says; the errors are of the records held out."""
    told: dict[str, Any] = json.loads((folder / "diagnosis" / "diagnosis.json").read_text())
    held = (told["errors"].get(model, {}).get("held_out", {}).get("nrmse") for model in MODELS)
    errors = ("-" if error is None else f"{100.0 * error:.3g}" for error in held)
    return told["verdict"], told["cause"] or "-", *errors, f"{told['confidence']:.2f}"


def _row(section: str, part: list[str], folder: Path) -> tuple[str, ...]:
    begun, used = time.perf_counter(), os.times()
    done = run(part, folder)
    after = os.times()
    cpu = after.children_user + after.children_system - used.children_user - used.children_system
    if done.returncode:
        said: tuple[str, ...] = (f"failed: {done.stderr.strip().splitlines()[-1]}", *[""] * 5)
    else:
        said = _said(folder) if part[-1].startswith(DIAGNOSIS) else ("no diagnosis", *[""] * 5)
    return section, *said, f"{time.perf_counter() - begun:.0f}", f"{cpu:.0f}"


def main() -> None:
    """Run the sections that are named, or all, and print a table; each row as soon as it is known."""
    if not DATA.is_dir():
        sys.exit(f"the measurements of others are not at {DATA}")
    console, table = Console(width=200), Table(*COLUMNS)
    for section in sys.argv[1:] or sections():
        with tempfile.TemporaryDirectory() as folder:
            for part in _up_to_each_diagnosis(commands(section)):
                row = _row(section, part, Path(folder))
                table.add_row(*row)
                console.print(" | ".join(row))
    console.print(table)


if __name__ == "__main__":
    main()
