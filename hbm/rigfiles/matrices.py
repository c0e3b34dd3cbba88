"""Matrices of finite-element models: NumPy, SciPy, Matrix Market and MAT files, and the text that Abaqus writes."""

import re
import warnings
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt
from scipy import sparse

from hbm.errors import InputError
from hbm.measurement.matfile import load_mat
from hbm.measurement.npzfile import load_npz
from hbm.textfiles import StrPath, damage, refuse_endless, why
from models.bodies.matrixchecks import is_half, real
from models.bodies.pencil import added

Matrix = Any  # of scipy.sparse, which has no types
ENDINGS = (".npz", ".npy", ".mtx", ".mat")
LARGEST = 10_000_000
"""Degrees of freedom; a file may claim any number of them."""
LARGEST_LABEL = 1e15
"""Numbers of nodes are read as floats: larger ones would not stay apart."""
DIRECTIONS = {1: "x", 2: "y", 3: "z", 4: "rx", 5: "ry", 6: "rz"}
ABAQUS = "lines of row node, row dof, column node, column dof, value, as *MATRIX OUTPUT, FORMAT=MATRIX INPUT writes"


def read_matrix(path: StrPath, key: str | None = None) -> Matrix:
    """Read a matrix.

    Parameters
    ----------
    path : str or path
        ``.npz`` of :func:`scipy.sparse.save_npz` or of named arrays, ``.npy``, ``.mat`` (v5 to v7), or ``.mtx``, Matrix
        Market or the text of :func:`read_abaqus`.
    key : str, optional
        Name of the array in an ``.npz`` or ``.mat`` that has several; ``model.K`` of a struct `model`.

    Returns
    -------
    (m, n) sparse array
        The whole of a square matrix of which either half is given; a column of an array of one dimension.

    Raises
    ------
    InputError
        If it cannot be read, or has no such matrix of real numbers.
    """
    ending = Path(path).suffix.lower()
    if ending not in ENDINGS:
        raise InputError(f"{path}: ends in {ending or 'nothing'}; must end in {', '.join(ENDINGS)}")
    _refuse_absent(path)
    if ending in (".mtx", ".npy"):
        if key is not None:
            raise InputError(f'{path}: key = "{key}"; must be absent, a {ending} file has one matrix')
        if ending == ".npy":
            return _of(path, _npy(path))
        return _of(path, _matrix_market(path)) if is_matrix_market(path) else read_abaqus(path)[0]
    return _npz(path, key) if ending == ".npz" else _mat(path, key)


def read_abaqus(path: StrPath, names: tuple[str, ...] | None = None) -> tuple[Matrix, tuple[str, ...]]:
    """Read a symmetric matrix of ``*MATRIX GENERATE`` and ``*MATRIX OUTPUT, FORMAT=MATRIX INPUT``.

    Parameters
    ----------
    path : str or path
        Text; either half or the whole matrix.
    names : tuple of str, (d,), optional
        Degrees of freedom of another file: a mass has no lines for those without any.

    Returns
    -------
    (d, d) sparse array
    tuple of str, (d,)
        Names such as ``12.rx``, by node and direction, unless given.

    Raises
    ------
    InputError
        If it cannot be read or a line is none of a symmetric matrix.
    """
    _refuse_absent(path)
    lines = _abaqus_lines(path)
    if bad := int((~np.isfinite(lines[:, 4])).sum()):
        raise InputError(f"{path}: has {bad} entries that are nan or infinite; must be finite")
    ends = lines[:, :4].astype(np.int64).reshape(-1, 2)
    places, numbers = np.unique(ends, axis=0, return_inverse=True)
    own = tuple(f"{node}.{DIRECTIONS.get(dof, dof)}" for node, dof in places.tolist())
    rows, columns = numbers.reshape(-1, 2).T
    if names is not None:
        position = {name: i for i, name in enumerate(names)}
        if stranger := next((name for name in own if name not in position), None):
            said = ", ".join(names[:4]) + (", ..." if len(names) > 4 else "")
            raise InputError(f"{path}: has {stranger}; must be on the {len(names)} degrees of freedom {said}")
        order = np.array([position[name] for name in own], dtype=np.intp)
        rows, columns = order[rows], order[columns]
    return _symmetric(path, rows, columns, lines[:, 4], names or own), names or own


# ---------------------------------------------------------------------------------------------------------- Abaqus text


def _abaqus_lines(path: StrPath) -> npt.NDArray[np.float64]:
    """Numbers (lines, 5)."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # of a file without a line
            lines = np.loadtxt(path, delimiter=",", comments=["*"], ndmin=2, encoding="utf-8-sig", usecols=range(5))
        ends = lines[:, :4]
        whole = lines.size > 0 and np.array_equal(ends, np.rint(ends)) and np.abs(ends).max() < LARGEST_LABEL
        if whole and (lines[:, [1, 3]] > 0).all() and _fields(path) == 5:
            return lines
    except UnicodeDecodeError:
        raise InputError(f"{path}: is no text; must end in {', '.join(ENDINGS)}, or have {ABAQUS}") from None
    except (OSError, ValueError, UserWarning):
        pass
    _refuse_bad_line(path)


def _fields(path: StrPath) -> int:
    """Number of entries in the first line of numbers: lines of another format may begin alike."""
    with open(path, encoding="utf-8-sig") as file:
        return next((len(line.rstrip().rstrip(",").split(",")) for line in file if line.split("*")[0].strip()), 0)


def _refuse_bad_line(path: StrPath) -> NoReturn:
    node = r"[+-]?\d{1,15}"
    number = r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*"
    line_of = re.compile(rf"\s*{node}\s*,\s*\d*[1-9]\d*\s*,\s*{node}\s*,\s*\d*[1-9]\d*\s*,{number},?\s*")
    with open(path, encoding="utf-8-sig") as file:
        for i, line in enumerate(file, start=1):
            said = line.split("*")[0].strip()
            if said and not line_of.fullmatch(said):
                raise InputError(f'{path} line {i}: "{said:.60}"; must be {ABAQUS}')
    raise InputError(f"{path}: has no line of numbers; must be {ABAQUS}")


def _symmetric(path: StrPath, rows: Any, columns: Any, values: Any, names: tuple[str, ...]) -> Matrix:
    """The whole of a matrix of which either half, or all, is given."""
    d = len(names)
    keys = rows.astype(np.int64) * d + columns
    order = np.argsort(keys, kind="stable")
    keys, rows, columns, values = keys[order], rows[order], columns[order], values[order]
    if (twice := np.flatnonzero(np.diff(keys) == 0)).size:
        i = twice[0]
        raise InputError(f"{path}: gives {names[rows[i]]}, {names[columns[i]]} twice; must give each entry once")
    mirrored = columns.astype(np.int64) * d + rows
    at = np.minimum(np.searchsorted(keys, mirrored), len(keys) - 1)
    both = keys[at] == mirrored
    apart = np.where(both, np.abs(values - values[at]), 0.0)
    if (bad := apart > 1e-8 * (np.abs(values) + np.abs(values[at]))).any():
        i = int(np.argmax(bad))
        here, there = f"{values[i]:g} at {names[rows[i]]}, {names[columns[i]]}", f"{values[at[i]]:g}"
        raise InputError(f"{path}: has {here} and {there} at its mirror image; must be symmetric")
    alone = ~both
    whole = (
        np.concatenate([values, values[alone]]),
        (np.concatenate([rows, columns[alone]]), np.concatenate([columns, rows[alone]])),
    )
    return sparse.csc_array(whole, shape=(d, d))


# --------------------------------------------------------------------------------------------------------- other files


def _refuse_absent(path: StrPath) -> None:
    refuse_endless(path, str(path))
    try:
        with open(path, "rb"):
            pass
    except OSError as refused:
        raise InputError(f"{path}: cannot be read ({why(refused)}); must be a file with a matrix") from None


def is_matrix_market(path: StrPath) -> bool:
    """Whether a file begins as Matrix Market files do."""
    _refuse_absent(path)
    with open(path, "rb") as file:
        return file.read(64).lstrip().lower().startswith(b"%%matrixmarket")


def _matrix_market(path: StrPath) -> Any:
    from scipy.io import mmread

    try:
        content = Path(path).read_bytes()
        if b"\0" in content:
            raise ValueError  # SciPy's reader ends the process at it, and at a number that is cut short at the end
        for number in content.rstrip().rpartition(b"\n")[2].split():
            float(number)
        return mmread(path, spmatrix=False)
    except Exception as refused:  # SciPy lets through whatever its reader raises
        raise InputError(f"{path}: cannot be read ({damage(refused)}); must be Matrix Market") from None


def _npy(path: StrPath) -> Any:
    try:
        with Path(path).open("rb") as file:
            return np.lib.format.read_array(file, allow_pickle=False)
    except Exception as refused:  # NumPy lets through whatever its headers raise
        raise InputError(f"{path}: cannot be read ({damage(refused)}); must be .npy of numpy.save") from None


def _npz(path: StrPath, key: str | None) -> Matrix:
    accepted = "must be .npz of scipy.sparse.save_npz, or of named arrays"
    arrays = load_npz(path, accepted)
    if not {"format", "shape", "data"} <= set(arrays):
        return _named(path, arrays, key)
    if key is not None:
        raise InputError(f'{path}: key = "{key}"; must be absent, the file is one sparse matrix')
    try:
        return _of(path, sparse.load_npz(path))
    except InputError:
        raise
    except Exception as refused:  # SciPy lets through whatever damaged arrays make it do
        raise InputError(f"{path}: cannot be read ({damage(refused)}); {accepted}") from None


def _mat(path: StrPath, key: str | None) -> Matrix:
    try:
        variables = load_mat(path)
    except NotImplementedError:  # HDF5
        raise InputError(f"{path}: is a MAT file v7.3; must be v5 to v7, save it with -v7") from None
    except Exception as refused:  # SciPy lets through whatever a damaged file makes it do
        raise InputError(f"{path}: cannot be read ({damage(refused)}); must be a MAT file, v5 to v7") from None
    arrays = (_fields_of(name, value) for name, value in variables.items() if not name.startswith("__"))
    return _named(path, dict(chain.from_iterable(arrays)), key)


def _fields_of(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """A variable of a MAT file by its name, and each field of a struct as ``name.field``."""
    fields = getattr(getattr(value, "dtype", None), "names", None)
    if fields is None or value.size != 1:
        yield name, value
        return
    for field in fields:
        yield from _fields_of(f"{name}.{field}", value[field].item())


def _named(path: StrPath, arrays: dict[str, Any], key: str | None) -> Matrix:
    if key is None and len(arrays) == 1:
        (key,) = arrays
    if key not in arrays:
        found = "no key" if key is None else f'key = "{key}"'
        raise InputError(f"{path}: {found}; must be one of {', '.join(sorted(arrays)) or 'none, the file is empty'}")
    return _of(path, arrays[key], f" {key}")


def _of(path: StrPath, found: Any, name: str = "") -> Matrix:
    """What was found as a sparse array, the whole of it where it is either half of a square one."""
    found = real(found)
    kind = getattr(getattr(found, "dtype", None), "kind", "O")
    if kind in "iufb" and getattr(found, "ndim", 0) == 1:
        found = found.reshape((-1, 1))
    if kind not in "iufb" or len(getattr(found, "shape", ())) != 2:
        shape = " x ".join(str(n) for n in getattr(found, "shape", ())) or "no"
        what = {"c": "complex", "O": "not numbers", "U": "text"}.get(kind, "numbers")
        lossy = "; losses of a material are damping ratios of half its loss factor" if kind == "c" else ""
        raise InputError(f"{path}:{name} is {what}, {shape} entries; must be a matrix of real numbers{lossy}")
    if max(found.shape) > LARGEST:
        raise InputError(f"{path}:{name} has {max(found.shape)} rows or columns; must have {LARGEST} at most")
    try:
        if hasattr(found, "check_format"):  # what indices beyond the matrix would touch is not its own
            found.check_format(full_check=True)
    except ValueError:
        raise InputError(f"{path}:{name} has indices beyond its size; must be a matrix of real numbers") from None
    return _whole(sparse.csc_array(found, dtype=float))


def _whole(matrix: Matrix) -> Matrix:
    """Both halves of a matrix of which nothing but either is given: no other is symmetric."""
    if matrix.shape[0] != matrix.shape[1] or not is_half(matrix):
        return matrix
    return added(added(matrix, sparse.triu(matrix, 1).T), sparse.tril(matrix, -1).T)
