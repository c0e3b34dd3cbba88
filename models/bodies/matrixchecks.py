"""Matrices that no body may have, refused."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import sparse

from models.bodies.pencil import DENSE, part
from models.plausible import plausible
from models.structure import Array

Matrix = Any  # of scipy.sparse, which has no types

ASYMMETRY = 1e-8  # of an entry, or of the diagonal it is bounded by: what text files lose

ROUNDING = {"mass": 1e-8, "damping_matrix": 1e-6}
"""Of the diagonal: of stiffness-proportional damping from a text file, rigid motion is not quite free."""
HELD = 1e36  # of Abaqus, on the diagonal of what a boundary condition holds
SLOW = 1e-3  # Hz, of the fastest part of a mesh
EMPTY = 1e-15  # of the largest row: what turning axes leaves of a row of zeros


def some(names: Sequence[str]) -> str:
    """The first few of some names."""
    return ", ".join(names[:4]) + (f" and {len(names) - 4} others" if len(names) > 4 else "")


def size(matrix: Matrix) -> str:
    """Size of a matrix, in words."""
    return " x ".join(str(n) for n in matrix.shape)


def real(given: Any) -> Any:
    """What is stored as complex numbers without imaginary parts, as real ones; anything else as it is."""
    return given.real if np.iscomplexobj(given) and not (given.imag != 0.0).sum() else given


def is_half(matrix: Matrix) -> bool:
    """Whether a square matrix has entries on one side of its diagonal alone."""
    return bool(sparse.triu(matrix, 1).count_nonzero()) != bool(sparse.tril(matrix, -1).count_nonzero())


def square(name: str, given: Matrix) -> Matrix:
    """The matrix by columns; refuse what is not square, real and finite."""
    given = real(given if sparse.issparse(given) else _array(name, given))
    if given.shape[0] != given.shape[1] or not given.shape[0]:
        raise ValueError(f"MatrixBody: {name} is {size(given)}; must be square")
    if np.iscomplexobj(given):
        raise ValueError(f"MatrixBody: {name} is complex; must be real")
    matrix = sparse.csc_array(given, dtype=float)
    matrix.sum_duplicates()
    if bad := int((~np.isfinite(matrix.data)).sum()):
        raise ValueError(f"MatrixBody: {name} has {bad} entries that are nan or infinite; must be finite")
    return matrix


def _array(name: str, given: Any) -> Any:
    """Rows of numbers, as lists or otherwise, as one array."""
    try:
        array = np.asarray(given)
    except ValueError:  # rows of different lengths
        array = np.zeros(0)
    if array.ndim != 2 or array.dtype.kind not in "biufc":
        raise ValueError(f"MatrixBody: {name} = {given!r:.40}; must be a square matrix")
    return array


def refuse_names(key: str, names: Sequence[object]) -> None:
    """Refuse names that are none, or are there twice."""
    for name in names:
        if not isinstance(name, str):
            raise ValueError(f'MatrixBody: {key} has {name!r}; must be names, such as "{name}"')
    if len(set(names)) < len(names):
        twice = next(name for i, name in enumerate(names) if name in names[:i])
        raise ValueError(f'MatrixBody: {key} has "{twice}" twice; names must differ')


def refuse_size(name: str, matrix: Matrix, dofs: Sequence[str], held: npt.NDArray[np.intp]) -> None:
    """Refuse entries that no structure has, but on the diagonal of what is held, which nobody reads."""
    diagonal = matrix.diagonal()
    apart = sparse.coo_array(matrix - sparse.diags_array(diagonal))
    diagonal[held] = 0.0
    if (by_abaqus := diagonal == HELD).any():
        found = f"is {HELD:g} on its diagonal at {dofs[int(by_abaqus.argmax())]}"
        why = "as Abaqus writes of what a boundary condition holds"
        raise ValueError(
            f"MatrixBody: {name} {found}, {why}; must be in fixed, or generated without boundary conditions"
        )
    largest = float(max(np.abs(diagonal).max(), np.abs(apart.data).max(initial=0.0)))
    plausible(f"MatrixBody: the largest entry of {name}", largest, "inertia" if name == "mass" else "entry")


class Exchanged(NamedTuple):
    """Mass and stiffness that may be each other, to be doubted like a proportion.

    Attributes
    ----------
    key : str
    hz : float
        How fast the fastest degree of freedom swings by itself, all others held.
    """

    key: str
    hz: float

    @property
    def doubt(self) -> str | None:
        """Doubt about the matrices, in words: nothing that is meshed swings once in a quarter of an hour."""
        if not 0.0 < self.hz < SLOW:
            return None
        found = f"no degree of freedom swings faster than {self.hz:.3g} Hz by itself, the others held"
        return f"{self.key}: {found}; usual are more than {SLOW:g} Hz; are the two exchanged?"


def exchanged(mass: Array, stiffness: Array) -> Exchanged:
    """How fast what has mass and stiffness on the diagonals of the matrices swings by itself."""
    moves = (mass > 0.0) & (stiffness > 0.0)
    fastest = np.sqrt((stiffness[moves] / mass[moves]).max(initial=0.0)) / (2 * np.pi)
    return Exchanged("matrix.mass and matrix.stiffness", float(fastest))


def refuse_asymmetry(name: str, matrix: Matrix, dofs: Sequence[str]) -> None:
    """Refuse a matrix that differs from its transpose."""
    apart = (matrix - matrix.T).tocoo()
    diagonal = np.sqrt(np.abs(matrix.diagonal()))
    i, j = apart.coords
    size = np.asarray((abs(matrix) + abs(matrix.T)).tocsc()[i, j]).ravel() if len(i) else np.zeros(0)
    excess = np.abs(apart.data) - ASYMMETRY * (size + diagonal[i] * diagonal[j])
    if excess.size and excess.max() > 0.0:
        worst = int(np.argmax(excess))
        at, value = f"{dofs[i[worst]]}, {dofs[j[worst]]}", abs(apart.data[worst])
        accepted = "; of one half A of a matrix, A + A.T - diags_array(A.diagonal()) is the whole"
        whole = accepted if is_half(matrix) else ""
        raise ValueError(
            f"MatrixBody: {name} differs from its transpose by {value:.3g} at {at}; must be symmetric{whole}"
        )


def refuse_indefinite(name: str, matrix: Matrix, dofs: Sequence[str]) -> None:
    """Refuse a mass or a damping with a negative eigenvalue, beyond rounding."""
    diagonal = matrix.diagonal()
    entries = np.asarray(abs(matrix).sum(axis=0)).ravel()
    felt = entries > EMPTY * entries.max(initial=0.0)
    if (bad := (diagonal <= 0.0) & felt).any():
        i = int(np.argmax(bad))
        what = f"is {diagonal[i]:.3g} on its diagonal at {dofs[i]}"
        raise ValueError(f"MatrixBody: {name} {what}; must be > 0, or nothing in that row")
    at = np.flatnonzero(felt)
    if not at.size:
        return
    scale = sparse.diags_array(1 / np.sqrt(diagonal[at]))
    lowest = _lowest_eigenvalue(scale @ part(matrix, at, at) @ scale)
    if lowest < -ROUNDING[name]:
        scaled = f"with its diagonal scaled to 1 an eigenvalue is {lowest:.3g}"
        raise ValueError(f"MatrixBody: {name} is indefinite, {scaled}; must be >= 0")


def refuse_nothing(stiffness: Matrix, mass: Matrix, dofs: Sequence[str], free: npt.NDArray[np.intp]) -> None:
    """Refuse what is free to move without stiffness and mass, such as drilling rotations of flat shells."""
    entries = np.asarray((abs(stiffness) + abs(mass)).sum(axis=0)).ravel()
    if nothing := [dofs[i] for i in free[entries[free] == 0.0]]:
        accepted = "must hold what nothing else does"
        raise ValueError(f"MatrixBody: fixed lacks {some(nothing)}, where stiffness and mass have nothing; {accepted}")


def _lowest_eigenvalue(matrix: Matrix) -> float:
    """Lowest eigenvalue of a matrix with a unit diagonal; never below it, and close above."""
    size = matrix.shape[0]
    if size <= DENSE:
        return float(np.linalg.eigvalsh(matrix.toarray())[0])
    from scipy.sparse.linalg import ArpackError, eigsh  # a beam needs none of it

    shifted = matrix + sparse.eye_array(size)  # what is found is then not close to 0, to which it would be relative
    try:
        start = np.random.default_rng(0).standard_normal(size)
        found = eigsh(shifted, 1, which="SA", v0=start, tol=1e-4, maxiter=100, return_eigenvectors=False)
    except ArpackError:  # nothing is proven
        return 0.0
    return float(found[0]) - 1.0
