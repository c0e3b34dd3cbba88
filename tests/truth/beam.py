"""The beam in Hermite elements, and what of it the march needs.

Everything is consistent: mass, bending stiffness and the geometric matrix Int N' N'^T come from the same cubic shape
functions. The equation of the tip's vertical displacement, which the support holds, is kept: its residual is the
reaction of the support.
"""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.linalg import eigh

Array = np.ndarray


def hermite(xi: float, h: float) -> Array:
    """Cubic shape functions of an element of length h at xi = x / h."""
    return np.array(
        [1 - 3 * xi**2 + 2 * xi**3, h * (xi - 2 * xi**2 + xi**3), 3 * xi**2 - 2 * xi**3, h * (xi**3 - xi**2)]
    )


def element_matrices(h: float) -> tuple[Array, Array, Array]:
    """Mass, bending and geometric matrix of an element with rho A = E I = 1."""
    mass = [[156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2]]
    mass += [[54, 13 * h, 156, -22 * h], [-13 * h, -3 * h**2, -22 * h, 4 * h**2]]
    bend = [[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2]]
    bend += [[-12, -6 * h, 12, -6 * h], [6 * h, 2 * h**2, -6 * h, 4 * h**2]]
    geometric = [[36, 3 * h, -36, 3 * h], [3 * h, 4 * h**2, -3 * h, -(h**2)]]
    geometric += [[-36, -3 * h, 36, -3 * h], [3 * h, -(h**2), -3 * h, 4 * h**2]]
    return np.array(mass) * h / 420, np.array(bend) / h**3, np.array(geometric) / (30 * h)


@dataclass
class FiniteElements:
    """Assembled matrices, which hidden effects may change; degrees of freedom w_0, theta_0, w_1, theta_1, ..., extras.

    Mass per length and bending stiffness are those of the beam, or of each element.

    `fixed` are the degrees of freedom held at zero: the clamp's two and the tip's deflection, unless an effect frees
    one. `support` is the stiffness of the support under the tip where it yields.
    """

    nodes: Array
    mass_per_length: float | Array
    bending: float | Array
    M: Array = field(init=False)
    K: Array = field(init=False)
    G: Array = field(init=False)
    fixed: set[int] = field(init=False)
    support: float = 0.0

    def __post_init__(self) -> None:
        size = 2 * len(self.nodes)
        self.M, self.K, self.G = (np.zeros((size, size)) for _ in range(3))
        lengths = np.diff(self.nodes)
        heavy, stiff = (np.broadcast_to(x, lengths.shape) for x in (self.mass_per_length, self.bending))
        for i, h in enumerate(lengths):
            at = np.ix_(range(2 * i, 2 * i + 4), range(2 * i, 2 * i + 4))
            mass, bend, geometric = element_matrices(h)
            self.M[at] += heavy[i] * mass
            self.K[at] += stiff[i] * bend
            self.G[at] += geometric
        self.fixed = {0, 1, self.tip}

    @property
    def tip(self) -> int:
        """Degree of freedom of the tip's deflection; the next one is its rotation."""
        return 2 * len(self.nodes) - 2

    @property
    def size(self) -> int:
        return len(self.M)

    def free(self) -> Array:
        return np.array([i for i in range(self.size) if i not in self.fixed])

    def row(self, x: float) -> Array:
        """Deflection at x as a row over the degrees of freedom."""
        i = int(np.clip(np.searchsorted(self.nodes, x) - 1, 0, len(self.nodes) - 2))
        h = self.nodes[i + 1] - self.nodes[i]
        row = np.zeros(self.size)
        row[2 * i : 2 * i + 4] = hermite((x - self.nodes[i]) / h, h)
        return row

    def unit(self, dof: int) -> Array:
        return np.eye(self.size)[dof]

    def extra(self) -> int:
        """A further degree of freedom, without mass and stiffness yet."""
        for name in "MKG":
            setattr(self, name, np.pad(getattr(self, name), ((0, 1), (0, 1))))
        return self.size - 1


def nodes(length: float, elements: int, places: list[float]) -> Array:
    """About `elements` elements, with a node at every place."""
    stops = [0.0, *sorted({float(p) for p in places if 0.0 < p < length}), length]
    pieces = [np.linspace(a, b, max(1, round((b - a) / length * elements)) + 1) for a, b in pairwise(stops)]
    return np.unique(np.concatenate(pieces))


@dataclass(frozen=True)
class Reduced:
    """The structure in its own coordinates: modes, then static shapes of what acts on it (modes without inertia).

    y = V q, and with generalised forces p, `inertia` 1 or 0:
    inertia q'' + damping q' + omega2 q = p = F drive + T (contact - G q) + forces of hidden effects along `rows`.
    The `tip_` rows give the residual of the tip's own equation, R - P.
    """

    V: Array
    omega2: Array
    damping: Array
    inertia: Array
    contact: Array
    drive: Array
    G: Array
    sensors: Array
    axial: float
    tip_mass_row: Array
    tip_damping_row: Array
    tip_stiffness_row: Array
    tip_geometric_row: Array
    tip_loads: Array
    rows: Array


def modes_of(fe: FiniteElements, count: int | None = None) -> tuple[Array, Array]:
    """Squared natural frequencies, and mass-normalised shapes over all degrees of freedom, of the sliding structure."""
    free = fe.free()
    last = len(free) if count is None else min(count, len(free))
    omega2, shapes = eigh(fe.K[np.ix_(free, free)], fe.M[np.ix_(free, free)], subset_by_index=(0, last - 1))
    V = np.zeros((fe.size, last))
    V[free] = shapes
    return omega2, V


def flexibility(fe: FiniteElements, loads: Array) -> Array:
    """Static deflection under each column of loads."""
    free = fe.free()
    out = np.zeros((fe.size, loads.shape[1]))
    out[free] = np.linalg.solve(fe.K[np.ix_(free, free)], loads[free])
    return out


def static_shapes(fe: FiniteElements, omega2: Array, V: Array, loads: Array) -> tuple[Array, Array]:
    """What the modes leave of the static deflection under the loads, as coordinates that stiffness keeps apart.

    Returns stiffnesses, all scaled to 1e12, and shapes: orthogonal to the modes and to each other.
    """
    rest = flexibility(fe, loads) - V @ ((V.T @ loads) / omega2[:, None])
    rest -= V @ (V.T @ (fe.M @ rest))  # rounding leaves more of the modes in it than it is long
    rest = rest / np.sqrt(np.maximum(np.einsum("ij,ij->j", rest, fe.K @ rest), 1e-300))
    energy, mix = np.linalg.eigh(rest.T @ fe.K @ rest)
    kept = energy > 1e-6
    return np.full(kept.sum(), 1e12), rest @ (mix[:, kept] / np.sqrt(energy[kept])) * 1e6
