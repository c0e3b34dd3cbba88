"""Stiffness and mass of what is free to move, factorised once for the modes and for the response of all the others."""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import eigh

from models.structure import Array

Matrix = Any  # of scipy.sparse, which has no types

SHIFT = 1e-10  # of the squares of the mesh's own frequencies: the factors lose no more than ten digits to rigid motion
DENSE = 400  # degrees of freedom up to which all modes are worked out
ROUNDING = 32 * float(np.finfo(float).eps)
HALF = 2.0**11  # of a mantissa in half precision
FEW = 20_000  # degrees of freedom up to which minimum degree is an order as good as any
LIGHT = 1e-13  # a motion of this share of the largest inertia per stiffness has none


class Modes(NamedTuple):
    """Lowest modes of a pencil.

    Attributes
    ----------
    squares : (n,) array
        omega_n^2 [1/s2], ascending; exactly 0 for rigid motion.
    shapes : (f, n) array
        Mass-normalised.
    following : float
        omega^2 of the first mode left out, inf where there is none.
    """

    squares: Array
    shapes: Array
    following: float

    def refuse_rigid_rest(self, when: str) -> None:
        """Refuse to leave out rigid motion, which has no static response."""
        if self.following == 0.0:
            n = len(self.squares)
            raise ValueError(f"MatrixBody: modes = {n}; must be more, it moves as a rigid body in over {n} ways{when}")


class Pencil:
    """Stiffness and mass, symmetric and not negative, of what is free to move.

    ``stiffness + shift mass`` is factorised: regular for a body that moves as a rigid one.
    """

    def __init__(self, stiffness: Matrix, mass: Matrix) -> None:
        self.stiffness, self.mass = stiffness, mass
        self.shift = SHIFT * _own_square(stiffness.diagonal(), mass.diagonal())
        # whatever has no stiffness at all: springs to nothing
        self.shift = self.shift if self.shift > 0.0 else 1.0
        self._factors = factors(added(stiffness, self.shift * mass), pivoting=0.0)
        if self._factors.negative:
            raise _indefinite(stiffness, "")

    def lowest(self, n: int) -> Modes:
        """The n lowest modes."""
        size = self.mass.shape[0]
        dense = size <= DENSE or 2 * (n + 1) >= size
        basis = np.eye(size) if dense else self._lanczos(n + 1)
        squares, shapes, _ = ritz(self.stiffness, self.mass, basis, self.shift)
        if len(squares) < n:
            raise ValueError(f"MatrixBody: modes = {n}; must be <= {len(squares)}, the mass has no more")
        return Modes(squares[:n], shapes[:, :n], float(squares[n]) if len(squares) > n else np.inf)

    def rest(self, modes: Modes, load: Array) -> Array:
        """Static response (f, p) of all but some modes to loads (f, p); by inertia relief, where those are rigid."""
        forces = self.mass @ modes.shapes
        left = load - forces @ (modes.shapes.T @ load)
        # (K + s M) x = left + s M x: each step leaves this share of the error
        share = self.shift / (modes.following + self.shift)
        steps = 2 if share == 0.0 else 2 + int(np.log(ROUNDING) / np.log(share))
        response = np.zeros_like(load)
        for _ in range(steps if load.size else 0):
            response = self._factors.solve(left + self.shift * (self.mass @ response))
            response -= modes.shapes @ (forces.T @ response)
        return response

    def static(self, modes: Modes, load: Array) -> Array:
        """Static response (f, p) of a body that does not move as a rigid one."""
        return np.asarray(modes.shapes @ ((modes.shapes.T @ load) / modes.squares[:, None]) + self.rest(modes, load))

    def _lanczos(self, n: int) -> Array:
        from scipy.sparse.linalg import LinearOperator, eigsh  # a beam needs none of it

        start = np.random.default_rng(0).standard_normal(self.mass.shape[0])  # the same modes whenever asked
        inverse = LinearOperator(self.mass.shape, self._factors.solve, dtype=float)
        return np.asarray(eigsh(self.stiffness, n, self.mass, sigma=-self.shift, OPinv=inverse, v0=start)[1])


def _own_square(stiffness: Array, mass: Array) -> float:
    """Square of the mesh's own frequency where half of the mass is: small elements have much higher ones."""
    with_mass = mass > 0.0
    squares, weights = stiffness[with_mass] / mass[with_mass], mass[with_mass]
    order = squares.argsort()
    below = weights[order].cumsum()
    return float(squares[order[below.searchsorted(below[-1] / 2)]])


def ritz(stiffness: Matrix, mass: Matrix, basis: Array, shift: float) -> tuple[Array, Array, Array]:
    """Modes within a basis.

    Parameters
    ----------
    stiffness, mass : (f, f) sparse matrix
    basis : (f, m) array
    shift : float
        > 0 [1/s2]; makes ``stiffness + shift mass`` definite.

    Returns
    -------
    (n,) array
        omega_n^2 [1/s2], ascending; 0 where the strain energy is no more than what rounding makes of it.
    (f, n) array
        Mass-normalised modes.
    (f, m - n) array
        Motions without inertia, normalised to unit stiffness.

    Raises
    ------
    ValueError
        If a strain energy is negative.
    """
    inertia = basis.T @ (mass @ basis)
    elastic = basis.T @ (stiffness @ basis) + shift * inertia
    per_stiffness, shapes = eigh((inertia + inertia.T) / 2, (elastic + elastic.T) / 2)
    per_stiffness, shapes = per_stiffness[::-1], basis @ shapes[:, ::-1]
    moves = per_stiffness > LIGHT * per_stiffness[0]
    modes = shapes[:, moves] / np.sqrt(per_stiffness[moves])
    squares = np.einsum("ij,ij->j", modes, stiffness @ modes)
    rounding = ROUNDING * (shift + np.einsum("ij,ij->j", np.abs(modes), abs(stiffness) @ np.abs(modes)))
    if (squares < -rounding).any():
        raise _indefinite(stiffness, f", its lowest omega^2 is {squares.min():.3g} /s2")
    squares[squares <= rounding] = 0.0
    modes *= np.sign(modes[np.abs(modes).argmax(axis=0), range(modes.shape[1])])
    order = np.argsort(squares, kind="stable")
    return squares[order], modes[:, order], shapes[:, ~moves]


def _indefinite(stiffness: Matrix, found: str) -> ValueError:
    """What is wrong with a stiffness, and what may have made it so."""
    single = "; its entries are rounded to single precision, which may do that: write them in double"
    why = single if _single(stiffness.data) and _nearly_definite(stiffness) else ""
    return ValueError(f"MatrixBody: stiffness is indefinite{found}; must have no negative eigenvalue{why}")


def _nearly_definite(stiffness: Matrix) -> bool:
    """Whether its negative eigenvalues are as small as rounding its entries to single precision makes them (Weyl)."""
    from scipy.sparse import eye_array  # a beam needs none of it

    reach = float(np.finfo(np.float32).eps) * abs(stiffness).sum(axis=1).max()
    return not factors(stiffness + reach * eye_array(stiffness.shape[0]), pivoting=0.0).negative


def _single(entries: Array) -> bool:
    """Whether entries have no more digits than single precision has, and need these."""
    if not np.array_equal(entries, entries.astype(np.float32)):
        return False
    digits = np.frexp(entries)[0] * HALF  # whole where half precision would do
    return bool(np.mean(digits != np.rint(digits)) > 0.5)


class Factors(NamedTuple):
    """Factors of a symmetric matrix, its rows and columns in an order that keeps them sparse.

    Attributes
    ----------
    lu : SuperLU
    order : (n,) array of int
        Row of the matrix in each row of what was factorised.
    """

    lu: Any
    order: npt.NDArray[np.intp]

    def solve(self, load: Array) -> Array:
        """Solution for loads (n,) or (n, p)."""
        ordered: Array = self.lu.solve(load[self.order])
        response = np.empty_like(ordered)
        response[self.order] = ordered
        return response

    @property
    def negative(self) -> bool:
        """Whether there is a negative eigenvalue: symmetric pivots have the signs of these (Sylvester)."""
        return bool((self.lu.U.diagonal() < 0.0).any())


def factors(matrix: Matrix, pivoting: float) -> Factors:
    """Factors of a symmetric matrix; pivots stay on the diagonal unless below that share of their column."""
    from scipy.sparse.linalg import splu  # a beam needs none of it

    order = _dissected(matrix) if matrix.shape[0] > FEW else None
    ordered, by = (matrix, "MMD_AT_PLUS_A") if order is None else (part(matrix, order, order), "NATURAL")
    try:
        lu = splu(ordered.tocsc(), permc_spec=by, diag_pivot_thresh=pivoting, options={"SymmetricMode": True})
    except RuntimeError:
        found = "a motion has neither stiffness nor mass"
        raise ValueError(f"MatrixBody: {found}; must have one of them for every motion that is not fixed") from None
    return Factors(lu, np.arange(matrix.shape[0]) if order is None else order)


def _dissected(matrix: Matrix) -> npt.NDArray[np.intp] | None:
    """Order by nested dissection, which of solids leaves fewer entries; None without the library for it.

    George, "Nested dissection of a regular finite element mesh", SIAM Journal on Numerical Analysis 10 (1973).
    """
    try:
        from pymetis import CSRAdjacency, nested_dissection
    except ImportError:  # SuperLU's own order does too
        return None
    from scipy.sparse import coo_array

    row, column = matrix.tocoo().coords
    others = row != column
    graph = coo_array((others[others], (row[others], column[others])), shape=matrix.shape).tocsr()
    order, _ = nested_dissection(CSRAdjacency(graph.indptr, graph.indices))
    return np.array(order, dtype=np.intp)


def added(one: Matrix, other: Matrix) -> Matrix:
    """Sum of two sparse matrices with all that either stores, zeros too.

    SciPy's drops zeros. An ordering finds the degrees of freedom of a node alike with them, and factors of solids have
    half as many entries.
    """
    from scipy.sparse import coo_array

    a, b = one.tocoo(), other.tocoo()
    at = tuple(np.concatenate(pair) for pair in zip(a.coords, b.coords, strict=True))
    return coo_array((np.concatenate([a.data, b.data]), at), shape=one.shape).tocsc()


def part(matrix: Matrix, rows: npt.NDArray[np.intp], columns: npt.NDArray[np.intp]) -> Matrix:
    """Some rows and columns of a sparse matrix."""
    return matrix[:, columns][rows]


def unit_loads(size: int, at: npt.NDArray[np.intp]) -> Array:
    """A unit load at each of some degrees of freedom, (size, p)."""
    load = np.zeros((size, len(at)))
    load[at, range(len(at))] = 1.0
    return load
