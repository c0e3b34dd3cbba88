"""How the forces of nonlinear elements follow parameters of the rig, with the unknowns of the balance held."""

from dataclasses import dataclass

import numpy as np

from hbm.balance.elements import ElementChange, ElementsOverPeriod, stacked
from hbm.fourier import Array
from models.change import elements_change
from models.elements import ElementRows
from models.rig import Rig
from models.scalars import HZ


def element_change(rig: Rig, keys: tuple[str, ...], force: Array) -> ElementChange:
    """Derivatives of the elements of a rig to p numbers, which change the excitation by `force` (2H+1, p)."""
    own = np.array([[key == name for key in keys] for name in rig.of_elements], dtype=float)
    Omega = 2 * np.pi * np.array([float(key == HZ) for key in keys])
    return ElementChange(stacked(elements_change(rig, keys), axis=1), own.reshape(-1, len(keys)), Omega, force)


@dataclass(frozen=True, eq=False)
class HeldElements:
    """Derivatives to p parameters with the unknowns held.

    Attributes
    ----------
    elements : ElementsOverPeriod
    forces : (2H+1, r) array
        Along the rows.
    change : (2H+1, r, p) array
        Theirs.
    rows : ElementRows
        Changes of the rows, p first.
    """

    elements: ElementsOverPeriod
    forces: Array
    change: Array
    rows: ElementRows

    def onto_modes(self) -> Array:
        """Change of the forces on the modes, (2H+1, n, p)."""
        changed = np.einsum("krp,ri->kip", self.change, self.elements.rows, optimize=True)
        return np.asarray(changed + np.einsum("kr,pri->kip", self.forces, self.rows.rows, optimize=True))

    def onto_support(self) -> Array:
        """Change of the forces on the support, (2H+1, p)."""
        changed = np.einsum("krp,r->kp", self.change, self.elements.onto[:, -1])
        return np.asarray(changed + self.forces @ self.rows.share.T)

    def beyond(self, place: int, moved: Array) -> Array:
        """Change of what they move drive (0) or a response channel (from 1) by beyond the modes, (2H+1, p).

        Parameters
        ----------
        place : int
        moved : (2H+1, r, p) array
            Change of the forces that the unknowns bring.
        """
        changed = np.einsum("krp,r->kp", self.change + moved, self.elements.static[:, place])
        return np.asarray(changed + self.forces @ self.rows.static[:, :, place].T)

    def tension(self, moved: Array, load: float, d_load: Array) -> Array:
        """Change of what a tip off its support under a load (p changes d_load) does not bear, (2H+1, p)."""
        weight, d_weight = self.elements.weight[-1], self.rows.weight[:, -1]
        per_force = (d_load - load * d_weight / weight) / weight
        return np.asarray(load / weight * (self.change[:, -1] + moved[:, -1]) + np.outer(self.forces[:, -1], per_force))
