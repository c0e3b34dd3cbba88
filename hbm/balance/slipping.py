"""Newton's system where one place gives way, a clamp that slips or a tip that lifts off.

That is the system with what is slid or lifted held, and a correction of the rank of one signal: exact, however stiff
the place is while it holds.
"""

from functools import cached_property
from typing import Protocol

import numpy as np

from hbm.aft.force import ContactForce
from hbm.balance.clamp import ClampMotion, ClampOverPeriod
from hbm.balance.elements import ElementSlope, ElementsOverPeriod
from hbm.balance.elimination import Elimination
from hbm.balance.equations import Balance, Kinematics
from hbm.balance.scaled import State
from hbm.fourier import Array


class Yielding(Protocol):
    """A motion that gives way at one place.

    Attributes
    ----------
    slid : (2H+1, 2H+1) array
        Derivative of what is slid to the load on the place if nothing had.
    by_slid : (size, 2H+1) array
        Part of the scaled balances that it takes off.
    """

    slid: Array

    @property
    def by_slid(self) -> Array:
        """Part of the scaled balances that a slid motion takes off."""
        ...

    def load(self, x: Array, force: Array | float = 0.0) -> Array:
        """Change (2H+1, r) of that load with scaled unknowns (size, r) and force (2H+1, r)."""
        ...


class LiftedTip:
    """A tip off its support, as :class:`Yielding`: slid is the force along its row, its load the row's reading."""

    def __init__(self, problem: Balance, elements: ElementsOverPeriod, contact: ContactForce, slope: Array) -> None:
        self._problem, self._elements, self._contact = problem, elements, contact
        self.slid = (problem.basis.analysis * slope) @ problem.basis.synthesis

    @cached_property
    def by_slid(self) -> Array:
        """Part of the scaled balances that the force along the row takes off, (size, 2H+1)."""
        *row, share = self._elements.onto[-1]
        return _lost(self._problem, np.array(row), [(self._contact.by_rho, -share)])

    def load(self, x: Array, force: Array | float = 0.0) -> Array:
        """Change (2H+1, r) of the reading with scaled unknowns (size, r) and force (2H+1, r)."""
        problem, size, r = self._problem, self._problem.basis.size, x.shape[1]
        Q = x[: size * problem.structure.n].reshape(size, -1, r) * problem.q_ref
        return np.asarray(np.einsum("knr,n->kr", Q, self._elements.rows[-1]) + self._elements.static[-1, 0] * force)


def lifted_tip(problem: Balance, contact: ContactForce, slope: ElementSlope | None) -> LiftedTip | None:
    """The tip of a balance where it is off its support; None where it never is."""
    lifting = None if slope is None else slope.lifting
    if problem.elements is None or lifting is None:
        return None
    return LiftedTip(problem, problem.elements, contact, lifting)


class SlidRotation:
    """The rotation slid in the clamp, as it follows the unknowns of a balance and changes it.

    Attributes
    ----------
    slid : (2H+1, 2H+1) array
        Derivative of what is slid to the moment of the clamp if nothing had slid.
    """

    def __init__(self, problem: Balance, state: State, kin: Kinematics, contact: ContactForce) -> None:
        self._problem, self._contact = problem, contact
        self._clamp, motion = _slipping(problem, kin)
        self.slid = self._clamp.slope(motion, state.Omega)

    @cached_property
    def by_slid(self) -> Array:
        """Part of the scaled balances that a slid rotation takes off, (size, 2H+1)."""
        contact, port = self._contact, self._clamp.port
        seen = [(contact.by_u, port.residual[0]), (contact.by_rho, port.residual[-1])]
        return _lost(self._problem, port.row, seen)

    def load(self, x: Array, force: Array | float = 0.0) -> Array:
        """Change (2H+1, r) of the moment if nothing had slid with scaled unknowns (size, r) and force (2H+1, r)."""
        problem, size, r = self._problem, self._problem.basis.size, x.shape[1]
        split = size * problem.structure.n
        Q, T = x[:split].reshape(size, -1, r) * problem.q_ref, x[split:] * problem.F_ref
        return self._clamp.held(Q, T, np.zeros_like(T) + force)

    @cached_property
    def slid_by_unknowns(self) -> Array:
        """Derivative of what is slid to the scaled unknowns, (2H+1, size)."""
        return np.asarray(self.slid @ self.load(np.eye(self._problem.size)))

    def complete(self, held: Array) -> Array:
        """Derivative (size, size) of the scaled balances to the scaled unknowns, of that with the rotation held."""
        return np.asarray(held - self.by_slid @ self.slid_by_unknowns)


def _lost(problem: Balance, row: Array, seen: list[tuple[Array | None, float]]) -> Array:
    """Part of the scaled balances that a signal takes off by pushing the modes along a row, (size, 2H+1).

    `seen` are slopes of the law, and the share of the signal in what each is a slope to.
    """
    size = problem.basis.size
    friction = np.zeros((size, size))
    for slope, share in seen:
        if slope is not None:
            friction += share * slope
    modal = np.kron(np.eye(size), row[:, None])
    return np.concatenate([modal / problem.modal_force_ref, friction / problem.F_ref])


class SlippingBalance:
    """Linearised balance with what is slid at a place following the unknowns (Sherman, Morrison and Woodbury).

    Attributes
    ----------
    held : Elimination
        The balance with what is slid held.
    place : Yielding

    The border column is that of `held`; where it is the problem's own, what the parameter slides is added.
    """

    def __init__(self, held: Elimination, place: Yielding, problem: Balance, own_column: bool) -> None:
        self.held, self.place = held, place
        slides = own_column and problem.parameter == "force"
        self._force_by_parameter = problem.lam_ref * problem.force_shape * slides

    @property
    def slid(self) -> Array:
        """Derivative of what is slid to the load if nothing had, (2H+1, 2H+1)."""
        return self.place.slid

    def _load(self, x: Array, lam: Array) -> Array:
        return self.place.load(x, np.outer(self._force_by_parameter, lam))

    def _correction(self, row: Array, row_lam: float) -> tuple[Array, Array, Array]:
        """Motion and parameter per slid rotation, (size, 2H+1) and (2H+1,), and what is slid less what that slides."""
        x, lam = self.held.solve_columns(row, row_lam, self.place.by_slid, 0.0)
        return x, lam, np.eye(len(self.slid)) - self.slid @ self._load(x, lam)

    def solve_bordered(self, row: Array, row_lam: float, rhs: Array, rhs_row: float) -> tuple[Array, float]:
        """Solve the bordered Newton system, see :class:`continuation.Linearization`."""
        x, lam = self.solve_columns(row, row_lam, rhs[:, None], rhs_row)
        return x[:, 0], float(lam[0])

    def solve_columns(self, row: Array, row_lam: float, rhs: Array, rhs_row: float) -> tuple[Array, Array]:
        """Solve the bordered Newton system for right sides (size, r) with the same last entry, (size, r) and (r,)."""
        x, lam = self.held.solve_columns(row, row_lam, rhs, rhs_row)
        by_slid, lam_by_slid, matrix = self._correction(row, row_lam)
        if not np.isfinite(matrix).all():
            return np.full_like(x, np.nan), np.full_like(lam, np.nan)
        slid = np.linalg.solve(matrix, self.slid @ self._load(x, lam))
        return x + by_slid @ slid, lam + lam_by_slid @ slid

    def determinant_sign(self, row: Array, row_lam: float) -> int:
        """Sign of the determinant of the bordered matrix."""
        _, _, matrix = self._correction(row, row_lam)
        return self.held.determinant_sign(row, row_lam) * int(np.sign(np.linalg.det(matrix)))


def _slipping(problem: Balance, kin: Kinematics) -> tuple[ClampOverPeriod, ClampMotion]:
    """Clamp and its motion.

    Raises
    ------
    ValueError
        If the clamp does not slip.
    """
    if problem.clamp is None or kin.clamp is None:
        raise ValueError(f"{problem.rig.name}: no clamp that slips")
    return problem.clamp, kin.clamp
