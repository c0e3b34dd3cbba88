"""Shared parts of the commands: options read and refused, outputs checked, the console, lines on stderr."""

import json
import math
import sys
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from hbm.errors import InputError, visible

FIGURES = (".png", ".pdf", ".svg")
RIG_ENDING = ".toml"
LARGEST_H = 200

UNSOLVABLE = "no finite solution with these numbers; look for readings, or standard deviations, far from the others"
"""What is said where linear algebra gives up, in place of a library's words."""

RigFile = Annotated[Path, typer.Argument(metavar="RIG", help="Rig file (TOML).", show_default=False)]


AllowCode = Annotated[
    bool,
    typer.Option("--allow-code", help="Run the Python files that RIG names in its folder (always: HBM_ALLOW_CODE=1)."),
]

OutFolder = Annotated[
    Path, typer.Option(metavar="DIR", help="Write everything here; made if its parent exists.", show_default=False)
]
Formulation = Annotated[
    str | None, typer.Option(metavar="NAME", help="How the force is found; regularised where omitted.")
]
Harmonics = Annotated[str, typer.Option(metavar="H|auto", help="Harmonics; auto: as many as the accuracy needs.")]
Plot = Annotated[Path | None, typer.Option(metavar="F.png", help="Save a figure here (png, pdf or svg).")]


def spreading(*flags: str) -> type[TyperCommand]:
    """Kind of command with flags that take several numbers, ``--level 2 4 6``."""

    class Spread(TyperCommand):
        def parse_args(self, ctx: Any, args: list[str]) -> Any:
            """Put the flag before each of the numbers."""
            for flag in flags:
                args = spread(flag, args)
            return super().parse_args(ctx, args)

    return Spread


def spread(flag: str, args: Sequence[str]) -> list[str]:
    """Repeat a flag before each of the numbers after it.

    >>> spread("--level", ["rig.toml", "--level", "2", "4", "--out", "a.csv"])
    ['rig.toml', '--level', '2', '--level', '4', '--out', 'a.csv']
    """
    out: list[str] = []
    for arg in args:
        if len(out) > 1 and out[-2] == flag and is_number(arg):
            out.append(flag)
        out.append(arg)
    return out


@contextmanager
def named(command: str, mark: str = ":") -> Iterator[None]:
    """Put the command's name, or more of where it was, before what is refused."""
    try:
        yield
    except InputError as refused:
        raise InputError(f"{command}{mark} {refused}") from None


def check_out(command: str, out: Path, files: Iterable[str]) -> None:
    """Refuse a folder in which files could not be written, before anything is computed."""
    from hbm.files.outputs import check_folder

    with named(command):
        check_folder(out, files, "--out")


def both_ends(command: str, begin: str | None, end: str | None, unit: str) -> tuple[float, float] | None:
    """Numbers of ``--from`` and ``--to``, None where both are left out; one alone is refused."""
    if begin is None and end is None:
        return None
    if begin is None or end is None:
        given, missing = ("--from", "--to") if end is None else ("--to", "--from")
        raise InputError(f"{command}: {given} without {missing}; must have both or neither")
    return positive(command, "--from", begin, unit), positive(command, "--to", end, unit)


def check_outputs(command: str, out: Path | None, plot: Path | None) -> None:
    """Refuse a table (csv) or a figure that could not be written, before anything is computed."""
    if out is None and plot is None:
        return
    from hbm.textfiles import check_output

    with named(command):
        if out is not None:
            check_output(out, (".csv",), "--out")
        if plot is not None:
            check_output(plot, FIGURES, "--plot")


def check_order(command: str, rig: Path, spectra: Path) -> None:
    """Refuse a rig file and what was measured where each is in the place of the other."""
    if spectra.suffix.lower() == RIG_ENDING and rig.suffix.lower() != RIG_ENDING:
        raise InputError(f"{command}: RIG = {quoted(str(rig))}, SPECTRA = {quoted(str(spectra))}; must be exchanged")


def positive(command: str, option: str, text: str, unit: str) -> float:
    """A number > 0 of an option's text, or a refusal."""
    if not is_number(text) or not (math.isfinite(float(text)) and float(text) > 0.0):
        raise InputError(f"{command}: {option} = {quoted(text)}; must be a number > 0 [{unit}]")
    return float(text)


def not_negative(command: str, option: str, text: str, unit: str) -> float:
    """A number >= 0 of an option's text, or a refusal."""
    if not is_number(text) or not 0.0 <= float(text) < math.inf:
        raise InputError(f"{command}: {option} = {quoted(text)}; must be a number >= 0 [{unit}]")
    return float(text)


def whole(command: str, option: str, text: str, largest: int, otherwise: str = "") -> int:
    """A whole number from 1 on of an option's text, or a refusal, which also names what else is accepted."""
    if not (text.isascii() and text.isdigit() and 1 <= int(text[:9]) <= largest):
        accepted = f"{otherwise}a whole number from 1 to {largest}"
        raise InputError(f"{command}: {option} = {quoted(text)}; must be {accepted}")
    return int(text)


def harmonics_or_auto(command: str, text: str) -> int | None:
    """Number of harmonics of ``--harmonics``, None for auto."""
    return None if text == "auto" else whole(command, "--harmonics", text, LARGEST_H, "auto or ")


def is_number(text: str) -> bool:
    """Whether :class:`float` reads it."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def quoted(text: str) -> str:
    """Text as it is shown in a refusal: numbers bare, the rest in quotation marks."""
    return text if is_number(text) else json.dumps(text, ensure_ascii=False)


def say(line: str, status: int) -> int:
    """Say one line on stderr, and return the status."""
    print(visible(" ".join(line.split())), file=sys.stderr)
    return status


@contextmanager
def warnings_in_one_line() -> Iterator[None]:
    """Say doubts about the numbers of a rig file on stderr; none about those that a search tries."""
    with warnings.catch_warnings():
        warnings.filterwarnings("always", message=".*; usual are ")
        warnings.filterwarnings("ignore", message=".*; usual are ", module=r"models\.plausible")
        plain = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *where: Any, **more: Any) -> None:
            if issubclass(category, UserWarning):
                say(f"warning: {message}", 0)
            else:
                plain(message, category, *where, **more)

        warnings.showwarning = show
        yield


def console() -> Any:
    """Where tables are printed, a :class:`rich.console.Console`."""
    from rich.console import Console

    if sys.stdout.isatty():
        return Console(width=max(80, Console().width))  # a narrow terminal wraps lines, no number is cut
    return Console(width=120, force_terminal=False, color_system=None)  # piped: no escapes, nothing cut


def print_written(files: Sequence[Path]) -> None:
    """Name the files, which exist before anything is printed: a closed pipe loses no result."""
    for file in files:
        print(f"wrote {file}")
