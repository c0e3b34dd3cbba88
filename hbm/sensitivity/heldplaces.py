"""How what places of a beam give follows numbers of the rig, of many records at once, with the unknowns held."""

from dataclasses import dataclass

import numpy as np

from hbm.balance.batchednewton import Matrices, Solved
from hbm.balance.elements import stacked
from hbm.balance.places import Places
from hbm.fourier import Array
from hbm.sensitivity.elementchange import element_change
from models.change import clamp_change, elements_change
from models.rig import Rig
from models.scalars import LIMIT


def places_change(rig: Rig, keys: tuple[str, ...]) -> Places:
    """Derivatives of the places of a rig that give way to numbers of it, p first."""
    p, n, c = len(keys), rig.structure.n, len(rig.response_channels)
    rows, residual = [np.zeros((p, 0, n))], [np.zeros((p, 0, 3 + c))]
    if rig.acting:
        d = stacked(elements_change(rig, keys), axis=1)
        rows.append(d.rows)
        residual.append(np.concatenate([np.zeros((*d.share.shape, 1)), d.static, -d.share[..., None]], axis=2))
    port = clamp_change(rig, keys)
    if port is not None and rig.attachments.clamp_limit is not None:
        rows.append(port.row[:, None])
        residual.append(port.residual[:, None])
    return Places(np.concatenate(rows, axis=1), np.concatenate(residual, axis=1))


@dataclass(frozen=True, eq=False)
class HeldPlaces:
    """Derivatives to p numbers.

    Attributes
    ----------
    places : Places
    d : Places
        Their derivatives, p first.
    given : (R, 2H+1, j) array
        What each gives.
    change : (R, 2H+1, j, p) array
        Its derivatives, with the unknowns held.
    """

    places: Places
    d: Places
    given: Array
    change: Array

    @classmethod
    def of(cls, found: Solved[Matrices], keys: tuple[str, ...], force: Array) -> "HeldPlaces":
        """Of records that were solved together, `force` (2H+1, p) the change of their excitation."""
        batch, given = found.matrices.batch, found.seen.given
        first, parts = batch.first, [np.zeros((*given.shape[:2], 0, len(keys)))]
        if first.elements is not None:
            moved = element_change(first.rig, keys, force)
            states = zip(found.motions.Q, batch.Omega[:, 0].tolist(), batch.force, strict=True)
            parts.append(np.stack([first.elements.along(*state, moved) for state in states]))
        port = clamp_change(first.rig, keys)
        if first.clamp is not None and port is not None:
            limit = np.array([float(key == LIMIT) for key in keys])
            at = zip(*found.motions, batch.force, strict=True)
            changes = [batch.slid_along(i, first.clamp.change(port, limit, force, *s)) for i, s in enumerate(at)]
            parts.append(np.stack(changes)[:, :, None])
        change = np.concatenate(parts, axis=2)
        return cls(batch.places, places_change(first.rig, keys), given, change)

    def onto_modes(self) -> Array:
        """Change of the forces on the modes, (R, 2H+1, n, p)."""
        pushed = self.places.onto_modes(self.change)
        j, rows = len(self.places), self.d.rows.transpose(1, 2, 0)
        return np.asarray(pushed + (self.given @ rows.reshape(j, -1)).reshape(pushed.shape))

    def onto(self, place: int) -> Array:
        """Change of slip (0) or reaction (-1) beyond the modes, (R, 2H+1, p)."""
        return np.asarray(self.places.onto(place, self.change) + self.given @ self.d.residual[:, :, place].T)
