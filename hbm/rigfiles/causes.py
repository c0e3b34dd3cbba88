"""Causes by name: those of :data:`models.causes.CAUSES`, and one's own from a Python file, ``file.py:Class``.

A file named so is run, as any program is. What is in it is held against what a cause must have.
"""

from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any, get_type_hints

from hbm.errors import InputError
from hbm.rigfiles.laws import Consent, class_in_file, classes_in_file, file_and_class, is_frozen_dataclass
from models.causes import CAUSES

TEXTS = ("name", "meaning", "looks_like", "confused_with")
METHODS = {
    "candidates": "a class method candidates(cls, rig)",
    "unknowns": "a method unknowns(self, rig)",
    "extend": "a method extend(self, rig, values)",
}
ONE_VALUE = "parameter:"
"""Beginning of the names of the causes that are a wrong value of the rig file."""

NAMED = tuple(name for name in CAUSES if name != "parameter")
"""Causes that are named as they are."""


def find_cause(name: str, folder: Path, consent: Consent = Consent.NAMED) -> type:
    """Class of a cause.

    Parameters
    ----------
    name : str
        Key of :data:`models.causes.CAUSES`, ``parameter:<key>``, or ``file.py:Class``. The file is run.
    folder : Path
        Where a relative file is looked for.
    consent : Consent
        Whether the file may be run.

    Raises
    ------
    InputError
        If there is no such cause, it is none, or its file may not be run; the message says what is wrong, not where the
        name stands.
    """
    if name.startswith(ONE_VALUE):
        return CAUSES["parameter"]
    if name in NAMED:
        return CAUSES[name]
    path, class_name = file_and_class(name, folder, NAMED, accepted_causes(), consent)
    cause = class_in_file(path, class_name)
    for missing in _wrong_with(cause):
        raise InputError(f"{class_name} in {path} is no cause: {missing}")
    return cause


def named_cause(name: str) -> Any:
    """A cause by its name: its class, or the wrong value that ``parameter:<key>`` is.

    Parameters and errors as of :func:`find_cause`; relative files are looked for in the working directory.
    """
    kind = find_cause(name, Path())
    return kind(name.removeprefix(ONE_VALUE)) if name.startswith(ONE_VALUE) else kind


def causes_in_file(path: Path) -> list[type]:
    """All causes of a Python file, which is run; classes that lack something are refused.

    Raises
    ------
    InputError
        If there is no such file, or no cause in it.
    """
    names = [name for name in classes_in_file(path.resolve()) if not name.startswith("_")]
    if not names:
        raise InputError(f"{path} has no class; must have a cause")
    return [find_cause(f"{path}:{name}", Path()) for name in names]


def accepted_causes() -> str:
    """Names that a cause may have, in words."""
    return f"one of {', '.join(NAMED)}, {ONE_VALUE}<key>, or file.py:Class"


def _wrong_with(cause: Any) -> Iterator[str]:
    """Name what a class lacks to be a cause."""
    for text in TEXTS:
        if not isinstance(getattr(cause, text, None), str):
            yield f'it needs {text}: ClassVar[str] = "..."'
    if not isinstance(getattr(cause, "label", None), property):
        yield "it needs a property label"
    for method, words in METHODS.items():
        if not isinstance(getattr(cause, method, None), Callable):  # type: ignore[arg-type]
            yield f"it needs {words}"
    if getattr(cause, "name", None) in CAUSES:
        yield f'its name "{cause.name}" is taken by a cause that comes with the package'
    if not is_frozen_dataclass(cause):
        yield "it must be decorated with @dataclass(frozen=True)"
        return
    hints = get_type_hints(cause)
    for f in fields(cause):
        if hints[f.name] not in (str, int, float):
            yield f"its field {f.name} must be a str, an int or a float"
