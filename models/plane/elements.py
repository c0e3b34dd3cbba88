"""Plane finite elements of Table 2: stiffness and mass of a mesh, assembled by scikit-fem.

Incompatible modes: E. L. Wilson et al. 1973 with the correction of R. L. Taylor et al. 1976, by which the element
passes the patch test. Hourglass stiffness: D. P. Flanagan and T. Belytschko 1981.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from scipy import sparse

from models.bounds import bounded
from models.plane.library import skfem
from models.structure import Array

State = Literal["plane-stress", "plane-strain"]

STATES: tuple[str, ...] = get_args(State)
HOURGLASS = 0.005  # of the shear modulus, Abaqus' default for the element


@dataclass(frozen=True)
class Material:
    """An isotropic plate or slice.

    Attributes
    ----------
    youngs_modulus : float
        [Pa]
    poissons_ratio, density : float
        [-], [kg/m3]
    width : float
        Out of the plane [m].
    state : str
        ``plane-stress`` where it is free to change its width, ``plane-strain`` where it is not.
    """

    youngs_modulus: float
    poissons_ratio: float
    density: float
    width: float
    state: State

    def __post_init__(self) -> None:
        """Refuse numbers that no material has."""
        for name in ("youngs_modulus", "density", "width"):
            bounded(f"Material: {name}", getattr(self, name), 0.0, strict=True)
        bounded("Material: poissons_ratio", self.poissons_ratio, 0.0, 0.499)
        if self.state not in STATES:
            raise ValueError(f'Material: state = "{self.state}"; must be one of {", ".join(STATES)}')

    @property
    def shear(self) -> float:
        """Shear modulus [Pa]."""
        return self.youngs_modulus / (2 * (1 + self.poissons_ratio))

    @property
    def dilatation(self) -> float:
        """Lame's first parameter, of the plane [Pa]."""
        nu = self.poissons_ratio
        return self.youngs_modulus * nu / ((1 + nu) * (1 - 2 * nu) if self.state == "plane-strain" else 1 - nu**2)


class Assembled(NamedTuple):
    """Matrices of a mesh.

    Attributes
    ----------
    stiffness, mass : (d, d) sparse matrix
        [N/m], [kg]; the mass consistent.
    places : (2, d) array
        Where each degree of freedom is [m].
    along : (d,) array of int
        Which direction, 0 or 1, it is.
    """

    stiffness: Any
    mass: Any
    places: Array
    along: Any


class _IncompatibleModes(skfem.element.ElementH1):  # type: ignore[misc]
    """Two bubbles per displacement that vanish at the corners; their gradients as in the middle of the element."""

    interior_dofs = 2
    maxdeg = 2
    dofnames = ("a", "b")
    doflocs = np.array([[0.5, 0.5], [0.5, 0.5]])
    refdom = skfem.refdom.RefQuad

    def lbasis(self, X: Array, i: int) -> tuple[Array, Array]:
        """Bubble across and upwards, with its gradient."""
        slope = np.zeros_like(X)
        slope[i] = 4 - 8 * X[i]
        return 4 * X[i] * (1 - X[i]), slope

    def gbasis(self, mapping: Any, X: Array, i: int, tind: Any = None) -> Any:
        """With the inverse mapping of the middle, scaled by its determinant over that of the point."""
        middle = np.full((2, 1), 0.5)
        value, slope = self.lbasis(X, i)
        scale = mapping.detDF(middle, tind) / mapping.detDF(X, tind)
        gradient = np.einsum("ijk,il->jkl", mapping.invDF(middle, tind)[..., 0], slope) * scale
        return (skfem.element.DiscreteField(value=np.broadcast_to(value, scale.shape), grad=gradient),)


def _elastic(material: Material) -> Any:
    """Bilinear form of the stiffness."""

    def form(u: Any, v: Any, _: Any) -> Any:
        strain, virtual = (0.5 * (w.grad + np.swapaxes(w.grad, 0, 1)) for w in (u, v))
        volume = (strain[0, 0] + strain[1, 1]) * (virtual[0, 0] + virtual[1, 1])
        return material.width * (material.dilatation * volume + 2 * material.shear * np.sum(strain * virtual, (0, 1)))

    return skfem.BilinearForm(form)


def _full(mesh: Any, element: Any, order: int, material: Material) -> Any:
    """Stiffness integrated to an order."""
    return _elastic(material).assemble(skfem.Basis(mesh, element, intorder=order))


def _incompatible(mesh: Any, element: Any, order: int, material: Material) -> Any:
    """Stiffness with incompatible modes, condensed element by element."""
    basis = skfem.Basis(mesh, element, intorder=order)
    inner = skfem.Basis(mesh, skfem.ElementVector(_IncompatibleModes()), intorder=order)
    form = _elastic(material)
    coupling, own = form.assemble(inner, basis).tocsr(), form.assemble(inner).tocsr()
    dofs = inner.element_dofs.T
    blocks = np.asarray(own[dofs[:, :, None].repeat(4, 2).ravel(), dofs[:, None].repeat(4, 1).ravel()])
    each = np.arange(len(dofs) + 1)
    inverse = sparse.bsr_matrix((np.linalg.inv(blocks.reshape(-1, 4, 4)), each[:-1], each))
    by_element = coupling[:, dofs.ravel()]
    return form.assemble(basis) - by_element @ inverse @ by_element.T


def _hourglass(mesh: Any, element: Any, _: int, material: Material) -> Any:
    """Stiffness integrated in the middle, with a small one against the hourglass mode that this does not see."""
    middle = np.full((2, 1), 0.5), np.ones(1)
    basis = skfem.Basis(mesh, element, quadrature=middle)
    x = mesh.p[:, mesh.t]  # (2, 4, e)
    diagonals = np.stack([x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]])
    area = 0.5 * (diagonals[0, 0] * diagonals[1, 1] - diagonals[0, 1] * diagonals[1, 0])
    half = 0.5 / area
    by_x = half * np.stack([x[1, 1] - x[1, 3], x[1, 2] - x[1, 0], x[1, 3] - x[1, 1], x[1, 0] - x[1, 2]])
    by_y = half * np.stack([x[0, 3] - x[0, 1], x[0, 0] - x[0, 2], x[0, 1] - x[0, 3], x[0, 2] - x[0, 0]])
    mode = np.array([1.0, -1.0, 1.0, -1.0])[:, None]
    bent = np.einsum("i,dik->dk", mode[:, 0], x)
    shape = 0.25 * (mode - bent[0] * by_x - bent[1] * by_y)
    size = HOURGLASS * material.shear * material.width * area * (by_x**2 + by_y**2).sum(axis=0)
    blocks = (size * shape[:, None] * shape[None]).transpose(2, 0, 1)  # (e, 4, 4)
    held = _elastic(material).assemble(basis)
    for direction in range(2):
        dofs = basis.nodal_dofs[direction][mesh.t].T  # (e, 4)
        rows, columns = dofs[:, :, None].repeat(4, 2), dofs[:, None].repeat(4, 1)
        held = held + sparse.coo_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=held.shape)
    return held.tocsr()


@dataclass(frozen=True)
class PlaneElement:
    """One of Table 2.

    Attributes
    ----------
    name : str
        Abaqus' name.
    meaning : str
        A few words.
    scalar : str
        Name of scikit-fem's element of one component.
    triangles : bool
        Whether each quadrilateral is cut in two.
    order, mass_order : int
        Degree of polynomials that the stiffness and the mass integrate exactly.
    method : callable
        Stiffness of a mesh, the vector element, an order and a material.
    """

    name: str
    meaning: str
    scalar: str
    triangles: bool
    order: int
    mass_order: int
    method: Callable[[Any, Any, int, Material], Any] = _full

    def assemble(self, mesh: Any, material: Material) -> Assembled:
        """Stiffness and consistent mass of a mesh of quadrilaterals."""
        mesh = mesh.to_meshtri() if self.triangles else mesh
        element = skfem.ElementVector(getattr(skfem, self.scalar)())
        basis = skfem.Basis(mesh, element, intorder=self.mass_order)
        weight = material.density * material.width
        mass = skfem.BilinearForm(lambda u, v, _: weight * np.sum(u * v, 0)).assemble(basis)
        along = np.zeros(basis.N, dtype=int)
        for dofs in (basis.nodal_dofs, basis.facet_dofs):
            along[dofs[1::2]] = 1
        stiffness = self.method(mesh, element, self.order, material)
        return Assembled(_symmetric(stiffness), _symmetric(mass), basis.doflocs, along)


def _symmetric(matrix: Any) -> Any:
    return ((matrix + matrix.T) / 2).tocsc()


ELEMENTS: dict[str, PlaneElement] = {
    e.name: e
    for e in (
        PlaneElement("CPS4", "4-node bilinear", "ElementQuad1", False, 3, 3),
        PlaneElement("CPS4R", "4-node, reduced integration", "ElementQuad1", False, 1, 3, _hourglass),
        PlaneElement("CPS4I", "4-node, incompatible modes", "ElementQuad1", False, 3, 3, _incompatible),
        PlaneElement("CPS8", "8-node biquadratic", "ElementQuadS2", False, 5, 5),
        PlaneElement("CPS8R", "8-node, reduced integration", "ElementQuadS2", False, 3, 5),
        PlaneElement("CPS3", "3-node linear", "ElementTriP1", True, 1, 2),
        PlaneElement("CPS6", "6-node quadratic", "ElementTriP2", True, 2, 4),
    )
}
"""Elements by Abaqus' names; in plane strain Abaqus calls them CPE. Its own CPS6M is not published, and left out."""
