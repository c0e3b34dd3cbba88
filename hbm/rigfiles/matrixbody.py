"""``[matrix]``: a body of matrices in files beside the rig file."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field
from scipy import sparse

from hbm.errors import InputError, visible
from hbm.rigfiles.matrices import ENDINGS, is_matrix_market, read_abaqus, read_matrix
from hbm.rigfiles.schema import PRINTABLE, Table
from hbm.textfiles import refuse_endless, why
from models.bodies.matrix import MatrixBody, Method

Shown = Annotated[str, Field(pattern=PRINTABLE)]

FAULT = re.compile(
    r"(?:.*: )?MatrixBody: (?P<of>the largest entry of )?"
    r"(?P<name>mass|stiffness|damping_matrix|dofs|fixed|modes|reduction)\b (?P<found>.*)"
)
"""What a body says of an argument of its own."""


FILES = ("mass", "stiffness", "damping", "dofs")
"""Keys that name files."""


class MatrixTable(Table):
    """``[matrix]``: files of matrices, each as ``file`` or ``file:key``."""

    mass: Shown
    stiffness: Shown
    damping: Shown | None = None
    dofs: Shown | None = None
    fixed: list[str] = Field(default_factory=list)
    modes: Annotated[int, Field(ge=1, le=1000)] = 20
    reduction: Method = "modes"
    stiffness_factor: Annotated[float, Field(gt=0.0)] = 1.0


def matrix_body(matrix: MatrixTable, folder: Path, places: Sequence[str]) -> MatrixBody:
    """Body of the matrices that a table names, of files in a folder, touched at some places.

    Raises
    ------
    ValueError
        If one cannot be read, or they are of no body.
    """
    stiffness, names = _read(matrix.stiffness, folder, None)
    mass, _ = _read(matrix.mass, folder, names)
    if 1 in mass.shape:  # lumped: what each degree of freedom has alone
        mass = sparse.diags_array(mass.toarray().ravel())
    damping = None if matrix.damping is None else _read(matrix.damping, folder, names)[0]
    if matrix.dofs is not None:
        names = _names(matrix.dofs, folder, mass.shape[0])
    names = names or tuple(str(i + 1) for i in range(mass.shape[0]))
    known = _by_place(names)
    fixed = dict.fromkeys(name for given in matrix.fixed for name in known.get(given, [given]))
    modes = matrix.modes
    if "modes" not in matrix.model_fields_set:  # what nobody asked for is no reason to refuse a small model
        held = {*fixed, *(places if matrix.reduction == "craig-bampton" else ())}
        moving = sum(m > 0.0 and name not in held for name, m in zip(names, mass.diagonal(), strict=False))
        modes = max(min(modes, moving), 1)
    return MatrixBody(
        mass,
        stiffness,
        names,
        modes=modes,
        damping_matrix=damping,
        fixed=tuple(fixed),
        reduction=matrix.reduction,
        stiffness_factor=matrix.stiffness_factor,
    )


def in_its_file(refused: str, matrix: MatrixTable | None) -> str:
    """What a body says of its matrices, with the key of the rig file and the file that they are from.

    >>> table = MatrixTable(mass="M.npz", stiffness="K.npz")
    >>> in_its_file("chain: MatrixBody: stiffness is 3 x 2; must be square", table)
    'matrix.stiffness = "K.npz": is 3 x 2; must be square'
    >>> in_its_file("MatrixBody: modes = 20; must be <= 12", table)
    'matrix.modes = 20; must be <= 12'
    """
    fault = FAULT.fullmatch(refused)
    if fault is None or matrix is None:
        return refused
    key = fault["name"].removesuffix("_matrix")
    file = getattr(matrix, key)
    if key in ("fixed", "modes", "reduction"):
        return f"matrix.{key} {fault['found']}"
    if file is None:  # names that are counted, or of the file of the stiffness
        return refused
    return f'matrix.{key} = "{visible(file)}": {"its largest entry " if fault["of"] else ""}{fault["found"]}'


def _names(file: str, folder: Path, rows: int) -> tuple[str, ...]:
    """Names of the degrees of freedom in a text file."""
    where = f'matrix.dofs = "{file}"'
    refuse_endless(folder / file, where)
    try:
        names = (folder / file).read_text(encoding="utf-8-sig").split()
    except (OSError, UnicodeDecodeError) as refused:
        raise InputError(f"{where}: cannot be read ({why(refused)}); must be a text file of names") from None
    if len(names) != rows:
        accepted = f"must have {rows}, one per row of the matrices, separated by blanks or line ends"
        raise InputError(f"{where}: has {len(names)} names; {accepted}")
    return tuple(names)


def _by_place(names: Sequence[str]) -> dict[str, list[str]]:
    """Degrees of freedom by their own names, by those of their nodes, and by ``*.rz``, which stand for several."""
    known: dict[str, list[str]] = {}
    for name in names:
        parts = name.split(".")
        if len(parts) > 1:
            known.setdefault(f"*.{parts[-1]}", []).append(name)
        for end in range(1, len(parts) + 1):
            known.setdefault(".".join(parts[:end]), []).append(name)
    return known


def _read(named: str, folder: Path, names: tuple[str, ...] | None) -> tuple[Any, tuple[str, ...] | None]:
    """A matrix, and the names of its degrees of freedom where its file says them."""
    file = folder / file_of(named)
    if file.suffix.lower() not in ENDINGS or (file.suffix.lower() == ".mtx" and not is_matrix_market(file)):
        return read_abaqus(file, names)
    return read_matrix(file, named.rpartition(":")[2] if ":" in named else None), names


def file_of(named: str) -> str:
    """The file of a matrix that is named as ``file`` or ``file:key``."""
    return named.rpartition(":")[0] or named
