"""Places of a beam that give way, of many records at once: elements at points, and a clamp that slips.

Each reads the motion along a row, and what it gives pushes the structure along the same row: a force, or a rotation
slid. A Newton system is corrected for it as in :mod:`hbm.balance.slipping`, all places together.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hbm.balance.clamp import ClampMotion
from hbm.balance.equations import Balance
from hbm.fourier import Array


class Given(NamedTuple):
    """What the places of one record give.

    Attributes
    ----------
    series : (2H+1, j) array
        Coefficients, along each row.
    elements : (2H+1, r) array or None
        Those of the elements; None where there are none.
    clamp : ClampMotion or None
        Motion of a clamp that slips.
    """

    series: Array
    elements: Array | None
    clamp: ClampMotion | None


@dataclass(frozen=True, eq=False)
class Places:
    """Rows of the elements at points, and last that of a clamp that slips.

    Attributes
    ----------
    rows : (j, n) array
        What each reads of the modes, and how it pushes them.
    residual : (j, 3 + c) array
        Slip, drive, channels and reaction per unit given, beyond the modes; by reciprocity, the first two are what the
        row reads of friction and excitation.
    """

    rows: Array
    residual: Array

    @classmethod
    def of(cls, problem: Balance) -> "Places":
        """Those of a balance; none where nothing gives way."""
        c = len(problem.rig.response_channels)
        rows, residual = [np.zeros((0, problem.structure.n))], [np.zeros((0, 3 + c))]
        if problem.elements is not None:
            e = problem.elements
            rows.append(e.rows)
            residual.append(np.column_stack([np.zeros(len(e.rows)), e.static, -e.onto[:, -1]]))
        if problem.clamp is not None:
            rows.append(problem.clamp.port.row[None])
            residual.append(problem.clamp.port.residual[None])
        return cls(np.concatenate(rows), np.concatenate(residual))

    def __len__(self) -> int:
        """How many there are."""
        return len(self.rows)

    def given(self, problem: Balance, Q: Array, T: Array, F: Array, Omega: float) -> Given:
        """What they give in a state of a record: Q (2H+1, n), T and the excitation F (2H+1,)."""
        parts, elements, clamp = [np.zeros((len(T), 0))], None, None
        if problem.elements is not None:
            elements = problem.elements.along_rows(Q, Omega, F)
            parts.append(elements)
        if problem.clamp is not None:
            clamp = problem.clamp.motion(problem.clamp.held(Q, T, F), Omega)
            parts.append(clamp.slid[:, None])
        return Given(np.hstack(parts), elements, clamp)

    def slope(self, problem: Balance, given: Given, Q: Array, F: Array, Omega: float) -> Array:
        """Derivative of what they give to what they read, (2H+1, j, 2H+1, j), of a record."""
        size, j = given.series.shape
        slope = np.zeros((size, j, size, j))
        if problem.elements is not None:
            r = len(problem.elements.rows)
            found = problem.elements.linearize(Q, Omega, F).by_readings(np.arange(r))
            slope[:, :r, :, :r] = found.transpose(1, 0, 3, 2)
        if problem.clamp is not None and given.clamp is not None:
            slope[:, -1, :, -1] = problem.clamp.slope(given.clamp, Omega)
        return slope

    def read(self, Q: Array, T: Array) -> Array:
        """Change (R, 2H+1, j, p) of what they read with motions (R, 2H+1, n, p) and friction (R, 2H+1, p)."""
        return np.asarray(self.rows @ Q + self.residual[:, :1] * T[:, :, None])

    def onto_modes(self, given: Array) -> Array:
        """Forces (R, 2H+1, n, p) on the modes by what is given, (R, 2H+1, j, p)."""
        return np.asarray(self.rows.T @ given)

    def onto(self, place: int, given: Array) -> Array:
        """Slip (0), drive, channels or reaction (-1) by what is given (R, 2H+1, j, p), beyond the modes."""
        return np.asarray(self.residual[:, place] @ given)
