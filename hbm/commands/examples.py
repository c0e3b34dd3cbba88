"""The command ``hbm examples``: lists the examples that come with the package, and copies one out."""

import re
import shutil
import tomllib
from pathlib import Path
from typing import Annotated

import typer

from hbm.commands.options import console, print_written, quoted
from hbm.errors import InputError

COMMAND = "examples"
ENDINGS = (".toml", ".py")
RIG = "rig.toml"


def examples(
    name: Annotated[
        str | None, typer.Argument(metavar="NAME", help="Example to copy; all are listed if omitted.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="PATH", help="Copy it to this new file or folder; here, as NAME, if omitted.")
    ] = None,
) -> None:
    """Examples: rig files, measured spectra, a law and a cause of one's own. With a name: copy it.

    Example:  hbm examples paper_beam.toml
    """
    from hbm.commands.tables import print_table

    found = _examples()
    if name is None:
        if out is not None:
            raise InputError(f"{COMMAND}: --out without NAME; must have both")
        rows = [[name, _about(path)] for name, path in found.items()]
        print_table(console(), "hbm examples NAME copies one here", ["example", "about"], rows)
        return
    path = next((path for known, path in found.items() if name in (known, path.stem)), None)
    if path is None:
        raise InputError(f"{COMMAND}: {quoted(name)}; must be one of {', '.join(found)}")
    target = out or Path(path.name)
    beside = {file: target.parent / file.name for file in _named_by(path)}
    copies = {path: target} | {file: copy for file, copy in beside.items() if not _same(file, copy)}
    for copy in copies.values():
        _refuse(copy)
    print_written([_copy(file, copy) for file, copy in copies.items()])


def _examples() -> dict[str, Path]:
    """Examples by name: those of the package, or of the sources it is run from."""
    package = Path(__file__).parents[1]
    folder = next(f for f in (package / "examples", package.parent / "examples") if f.is_dir())
    files = sorted(f for f in folder.iterdir() if f.suffix in ENDINGS or (f / RIG).is_file())
    return {file.name: file for file in files}


def _about(path: Path) -> str:
    """Title of an example: the name in its rig file, or the first line of its docstring."""
    if path.suffix == ".py":
        return path.read_text(encoding="utf-8").strip('"').partition("\n")[0].strip('"')
    file = path / RIG if path.is_dir() else path
    title = tomllib.loads(file.read_text(encoding="utf-8"))["name"]
    return f"{title}, with measured spectra" if path.is_dir() else str(title)


def _named_by(path: Path) -> list[Path]:
    """Files beside a rig file that it names, such as that of a law of one's own, ``file.py:Class``."""
    if path.suffix != ".toml":
        return []
    texts = re.findall(r'"([^":]+)(?::\w+)?"', path.read_text(encoding="utf-8"))
    return [file for text in dict.fromkeys(texts) if (file := path.parent / text).is_file()]


def _same(file: Path, copy: Path) -> bool:
    return copy.is_file() and copy.read_bytes() == file.read_bytes()


def _refuse(target: Path) -> None:
    """Refuse a copy over what is there, or in no directory."""
    if target.exists():
        raise InputError(f"{COMMAND}: {target} is there already; must be new, try --out")
    if not target.absolute().parent.is_dir():
        raise InputError(f"{COMMAND}: there is no directory {quoted(str(target.parent))}, create it first")


def _copy(path: Path, target: Path) -> Path:
    try:
        if path.is_dir():
            shutil.copytree(path, target, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copyfile(path, target)
    except OSError as refused:
        raise InputError(f"{COMMAND}: {target} cannot be written ({refused.strerror or refused})") from None
    return target
