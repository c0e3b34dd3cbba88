"""Newton's system where a place gives way: a clamp that slips, a tip that lifts off, elements at points.

That is the system with what gives way held, and a correction of the rank of its few signals: exact, however stiff the
place is.
"""

from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from hbm.aft.force import ContactForce
from hbm.balance.clamp import ClampMotion, ClampOverPeriod
from hbm.balance.elements import ElementSlope, ElementsOverPeriod
from hbm.balance.elimination import Elimination
from hbm.balance.equations import Balance, Kinematics
from hbm.balance.factors import Border, Factors
from hbm.balance.scaled import State
from hbm.fourier import Array


class Yielding(Protocol):
    """A motion that gives way at one place.

    Attributes
    ----------
    slid : (s, s) array
        Derivative of what is slid, s coefficients, to the load on the place if nothing had.
    by_slid : (size, s) array
        Part of the scaled balances that it takes off.
    """

    slid: Array

    @property
    def by_slid(self) -> Array:
        """Part of the scaled balances that a slid motion takes off."""
        ...

    def load(self, x: Array) -> Array:
        """Change (s, r) of that load with scaled unknowns (size, r)."""
        ...


class PointForces:
    """Forces of elements at points, as :class:`Yielding`: slid are those along their rows, the load what these read.

    Row by row, (j (2H+1),) for j rows. A tip off its support is one of them: what it lacks of the normal load.
    """

    def __init__(
        self, problem: Balance, elements: ElementsOverPeriod, contact: ContactForce, slope: ElementSlope
    ) -> None:
        self._problem, self._elements, self._contact = problem, elements, contact
        self._rows = slope.rows
        side = len(self._rows) * problem.basis.size
        self.slid = slope.by_readings(self._rows).reshape(side, side)

    @cached_property
    def by_slid(self) -> Array:
        """Part of the scaled balances that the forces take off, (size, j (2H+1))."""
        onto, by_rho = self._elements.onto[self._rows], self._contact.by_rho
        return np.hstack([_lost(self._problem, row[:-1], [(by_rho, -float(row[-1]))]) for row in onto])

    def load(self, x: Array) -> Array:
        """Change (j (2H+1), r) of the readings with scaled unknowns (size, r)."""
        problem, (size, r) = self._problem, (self._problem.basis.size, x.shape[1])
        Q = x[: size * problem.structure.n].reshape(size, -1, r) * problem.q_ref
        read = np.matmul(self._elements.rows[self._rows], Q)
        return np.ascontiguousarray(read.swapaxes(0, 1)).reshape(-1, r)


class SlidRotation:
    """The rotation slid in the clamp, as it follows the unknowns of a balance and changes it.

    Attributes
    ----------
    slid : (2H+1, 2H+1) array
        Derivative of what is slid to the moment of the clamp if nothing had slid.
    """

    def __init__(self, problem: Balance, state: State, kin: Kinematics, contact: ContactForce) -> None:
        self._problem, self._contact = problem, contact
        self._clamp, motion = slipping(problem, kin.clamp)
        self.slid = self._clamp.slope(motion, state.Omega)

    @cached_property
    def by_slid(self) -> Array:
        """Part of the scaled balances that a slid rotation takes off, (size, 2H+1)."""
        contact, port = self._contact, self._clamp.port
        seen = [(contact.by_u, port.residual[0]), (contact.by_rho, port.residual[-1])]
        return _lost(self._problem, port.row, seen)

    def load(self, x: Array) -> Array:
        """Change (2H+1, r) of the moment if nothing had slid with scaled unknowns (size, r)."""
        problem, size, r = self._problem, self._problem.basis.size, x.shape[1]
        split = size * problem.structure.n
        Q, T = x[:split].reshape(size, -1, r) * problem.q_ref, x[split:] * problem.F_ref
        return self._clamp.held(Q, T, np.zeros_like(T))

    def load_by_force(self, force: Array) -> Array:
        """Change (2H+1,) of that moment with an excitation (2H+1,) at held unknowns."""
        Q = np.zeros((len(force), self._problem.structure.n))
        return self._clamp.held(Q, np.zeros_like(force), force)

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


class Yielded(NamedTuple):
    """What a place that gives way adds to solutions with it held.

    Attributes
    ----------
    border : Border
        The row that it belongs to.
    x, lam : (size, s) and (s,) array
        Motion and parameter per slid motion.
    factors : Factors
        Of what is slid less what that slides, (s, s).
    """

    border: Border
    x: Array
    lam: Array
    factors: Factors


class SlippingBalance:
    """Linearised balance with what is slid at a place following the unknowns (Sherman, Morrison and Woodbury).

    Attributes
    ----------
    held : Elimination or SlippingBalance
        The balance with what is slid held.
    place : Yielding
    load_by_parameter : (s,) array, optional
        Change of the load with the parameter at held unknowns that the border column of `held` leaves out; none where
        omitted.
    """

    def __init__(
        self, held: "Elimination | SlippingBalance", place: Yielding, load_by_parameter: Array | None = None
    ) -> None:
        self.held, self.place, self._load_by_parameter = held, place, load_by_parameter
        self._known: Yielded | None = None

    @property
    def slid(self) -> Array:
        """Derivative of what is slid to the load if nothing had, (s, s)."""
        return self.place.slid

    def _load(self, x: Array, lam: Array) -> Array:
        load, by_parameter = self.place.load(x), self._load_by_parameter
        return load if by_parameter is None else load + np.outer(by_parameter, lam)

    def _yielded(self, row: Array, row_lam: float) -> Yielded:
        known = self._known
        if known is None or not known.border.is_again(row, row_lam):
            x, lam = self.held.solve_columns(row, row_lam, self.place.by_slid, 0.0)
            factors = Factors.of(np.eye(len(self.slid)) - self.slid @ self._load(x, lam))
            known = self._known = Yielded(Border(row.copy(), row_lam), x, lam, factors)
        return known

    def solve_bordered(self, row: Array, row_lam: float, rhs: Array, rhs_row: float) -> tuple[Array, float]:
        """Solve the bordered Newton system, see :class:`continuation.Linearization`."""
        x, lam = self.solve_columns(row, row_lam, rhs[:, None], rhs_row)
        return x[:, 0], float(lam[0])

    def solve_columns(self, row: Array, row_lam: float, rhs: Array, rhs_row: float) -> tuple[Array, Array]:
        """Solve the bordered Newton system for right sides (size, r) with the same last entry, (size, r) and (r,)."""
        x, lam = self.held.solve_columns(row, row_lam, rhs, rhs_row)
        yielded = self._yielded(row, row_lam)
        slid = yielded.factors.solve(self.slid @ self._load(x, lam))
        return x + yielded.x @ slid, lam + yielded.lam @ slid

    def determinant_sign(self, row: Array, row_lam: float) -> int:
        """Sign of the determinant of the bordered matrix."""
        return self.held.determinant_sign(row, row_lam) * self._yielded(row, row_lam).factors.sign


def slipping(problem: Balance, motion: ClampMotion | None) -> tuple[ClampOverPeriod, ClampMotion]:
    """Clamp and its motion.

    Raises
    ------
    ValueError
        If the clamp does not slip.
    """
    if problem.clamp is None or motion is None:
        raise ValueError(f"{problem.rig.name}: no clamp that slips")
    return problem.clamp, motion
