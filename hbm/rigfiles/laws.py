"""Friction laws by name: those of :data:`models.LAWS`, and one's own from a Python file, ``file.py:Class``.

A file named so is run, as any program is: one that the user names, or, where a rig file names it, with the user's
:class:`Consent`. A law found in it is held against what every solver expects of a law before anything is computed with
it.
"""

import difflib
import hashlib
import os
import sys
import traceback
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import fields
from enum import Enum
from functools import lru_cache
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

from hbm.aft.step import law_step
from hbm.errors import InputError
from models import LAWS
from models.friction import Parameter, Setting, defaults, describe, settings

OWN = "own_file_"
"""Beginning of the names of the modules that files are run as."""

ALLOW_CODE = "HBM_ALLOW_CODE"
"""Environment variable: 1 where Python files that rig files name may be run."""


class Consent(Enum):
    """Which Python files may be run."""

    NAMED = "any that the user names: on the command line, or to a function"
    IN_FOLDER = "those in the folder of the rig file that names them, as the user allowed"
    NONE = "none that a rig file names: it may come from anybody"

    @staticmethod
    def of_data(allow_code: bool | None) -> "Consent":
        """For names in a rig file: what was said, otherwise what the environment says."""
        allowed = os.environ.get(ALLOW_CODE) == "1" if allow_code is None else allow_code
        return Consent.IN_FOLDER if allowed else Consent.NONE


PARTS: dict[str, tuple[Any, str]] = {
    "name": (str, 'name: ClassVar[str] = "..."'),
    "states": ((int, property), "states: ClassVar[int] = ..."),
    "set_valued": (bool, "set_valued: ClassVar[bool] = False"),
    "advance": (Callable, "a method advance(self, z, before, now)"),
}
"""What a class must have to be a law: of which type, and in words."""


def find_law(name: str, folder: Path, consent: Consent = Consent.NAMED, known: Mapping[str, type] = LAWS) -> type:
    """Class of a law, of friction unless others are known.

    Parameters
    ----------
    name : str
        One that is known, or ``file.py:Class``. The file is run.
    folder : Path
        Where a relative file is looked for.
    consent : Consent
        Whether the file may be run.
    known : mapping of str to type
        Laws by their names.

    Raises
    ------
    InputError
        If there is no such law, it is none, or its file may not be run; the message says what is wrong, not where the
        name stands.
    """
    if name in known:
        return known[name]
    return _own_law(*file_and_class(name, folder, known, accepted_laws(known), consent))


def file_and_class(
    name: str, folder: Path, known: Collection[str], accepted: str, consent: Consent = Consent.NAMED
) -> tuple[Path, str]:
    """Split ``file.py:Class``, for a name that is none of those known.

    Parameters
    ----------
    name : str
    folder : Path
        Where a relative file is looked for.
    known : collection of str
        Names that may have been meant.
    accepted : str
        Names that are accepted, in words.
    consent : Consent

    Returns
    -------
    Path
        Absolute, without symbolic links; it may be run.
    str
        Name of the class.

    Raises
    ------
    InputError
        If it is not written so, or the file may not be run.
    """
    file, _, class_name = name.rpartition(":")
    if name.endswith(".py"):
        raise InputError(f"must name a class too, {name}:Class")
    if not (file.endswith(".py") and class_name.isidentifier()):
        close = difflib.get_close_matches(name, known, n=1)
        hint = f"; did you mean {close[0]}?" if close else ""
        raise InputError(f"must be {accepted}{hint}")
    if not file.isprintable():
        raise InputError("must name a file without control characters")
    path = _resolved(folder / file)
    _refuse_without_consent(path, folder, consent)
    return path, class_name


def _refuse_without_consent(path: Path, folder: Path, consent: Consent) -> None:
    """Refuse a Python file that a rig file names and the user did not allow, or that is not beside the rig file."""
    if consent is Consent.NONE:
        raise InputError(
            f"would run the Python file {path}; if you trust it, allow it with --allow-code, {ALLOW_CODE}=1 or "
            "load_rig(path, allow_code=True)"
        )
    if consent is Consent.IN_FOLDER and not path.is_relative_to(_resolved(folder)):
        raise InputError(f"is the Python file {path}; must be in the folder of the rig file, {_resolved(folder)}")


def _resolved(path: Path) -> Path:
    try:
        return path.resolve()
    except (OSError, RuntimeError):  # a link to itself
        raise InputError(f"there is no file {path}") from None


def accepted_laws(known: Collection[str] = LAWS) -> str:
    """Names that a law may have, in words."""
    return f"one of {', '.join(known)}, or file.py:Class"


def class_in_file(path: Path, class_name: str) -> type:
    """Class of a Python file, which is run once as long as it does not change.

    Parameters
    ----------
    path : Path
        Absolute.
    class_name : str

    Raises
    ------
    InputError
        If there is no such file or class, or the file fails.
    """
    module = _module(path, _stamp(path))
    found = getattr(module, class_name, None)
    if not isinstance(found, type):
        raise InputError(f"{path} has no class {class_name}; it has {', '.join(classes_in_file(path)) or 'none'}")
    return found


def classes_in_file(path: Path) -> list[str]:
    """Names of the classes that a Python file defines; it is run, see :func:`class_in_file`."""
    module = _module(path, _stamp(path))
    return [n for n, c in vars(module).items() if isinstance(c, type) and c.__module__ == module.__name__]


def files_run() -> tuple[Path, ...]:
    """Files whose classes are in use: what another process runs, by :func:`run_files`, before it is sent any."""
    return tuple(Path(str(module.__file__)) for name, module in sys.modules.items() if name.startswith(OWN))


def run_files(paths: Sequence[Path]) -> None:
    """Run Python files, so that their classes are known here.

    Parameters
    ----------
    paths : sequence of Path
        Paths that :func:`files_run` returns.

    Raises
    ------
    InputError
        If a file is gone, or fails.
    """
    for path in paths:
        _module(path, _stamp(path))


def _own_law(path: Path, class_name: str) -> type:
    law = class_in_file(path, class_name)
    for missing in _wrong_with(law):
        raise InputError(f"{class_name} in {path} is no friction law: {missing}")
    _try(law, path)
    return law


def _stamp(path: Path) -> tuple[int, int]:
    """Time of change and size of a file."""
    try:
        stat = path.stat()
    except OSError:
        raise InputError(f"there is no file {path}") from None
    return stat.st_mtime_ns, stat.st_size


@lru_cache
def _module(path: Path, stamp: tuple[int, int]) -> ModuleType:
    """Run a file, once as long as it does not change: solvers remember what they built by the law's class."""
    # the name is the same in every process, and has no dots, so that classes can be sent from one to another
    spec = spec_from_file_location(OWN + hashlib.sha256(str(path).encode()).hexdigest(), path)
    assert spec is not None
    module = module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    try:
        # compiled here, not by the spec's loader: no __pycache__ beside the file, and nothing stale from one
        exec(compile(path.read_bytes(), str(path), "exec"), vars(module))
    except (Exception, SystemExit) as failed:
        del sys.modules[spec.name]
        raise InputError(_failure(failed, path)) from None
    return module


def _failure(failed: BaseException, path: Path) -> str:
    """Where and with what a file failed, in one line."""
    line = _line_of(failed, path)
    said = str(failed.msg if isinstance(failed, SyntaxError) else failed).split("\n")
    last = [text.strip() for text in said if text.strip()][-1:]  # CasADi's come last, after where it found them
    return f"{path}{f' line {line}' if line else ''}: {': '.join([type(failed).__name__, *last])}"


def _line_of(failed: BaseException, path: Path) -> int | None:
    """Last line of a file that a failure went through."""
    if isinstance(failed, SyntaxError) and failed.filename == str(path):
        return failed.lineno
    lines = [frame.lineno for frame in traceback.extract_tb(failed.__traceback__) if frame.filename == str(path)]
    return lines[-1] if lines else None


def _wrong_with(law: Any) -> Iterator[str]:
    """Name what a class lacks to be a friction law."""
    for part, (kind, words) in PARTS.items():
        if not isinstance(getattr(law, part, None), kind):
            yield f"it needs {words}"
    if getattr(law, "name", None) in LAWS:
        yield f'its name "{law.name}" is taken by a law that comes with the package'
    if is_frozen_dataclass(law):
        yield from _wrong_with_fields(law)
    else:
        yield "it must be decorated with @dataclass(frozen=True, eq=False)"


def is_frozen_dataclass(law: Any) -> bool:
    """Whether a class was itself decorated with @dataclass(frozen=True)."""
    made: Any = vars(law).get("__dataclass_params__")
    return made is not None and bool(made.frozen)


def _wrong_with_fields(law: Any) -> Iterator[str]:
    names = [f.name for f in fields(law)]
    for f in fields(law):
        known = f.metadata.get("parameter", f.metadata.get("setting"))
        if not isinstance(known, Parameter | Setting):
            yield f"its field {f.name} needs metadata=parameter(unit, meaning, source), of models.friction"
            continue
        if isinstance(known, Setting) and f.name not in defaults(law):
            yield f"its setting {f.name} needs a default"
        others = known.instead_of if isinstance(known, Setting) else (known.at_least or f.name,)
        for other in set(others).difference(names):
            yield f"its field {f.name} refers to {other}, which it does not have"


def _try(law: Any, path: Path) -> None:
    """Advance a law in symbols, as every solver does first."""
    chosen = {name: value for name, value in defaults(law).items() if name in settings(law)}
    example = law(**dict.fromkeys(describe(law), 1.0), **chosen)
    wrong = f"{law.__name__} in {path} is no friction law: advance must return"
    try:
        step = law_step(example).function
    except Exception as failed:
        if _line_of(failed, path) is None:  # it went wrong with what advance returned
            raise InputError(f"{wrong} the new states and the force, (z, T)") from None
        raise InputError(_failure(failed, path)) from None
    force, states = step.numel_out(0), step.numel_out(1)
    if (force, states) != (1, example.states):
        raise InputError(f"{wrong} {example.states} states and one force, not {states} and {force}")
