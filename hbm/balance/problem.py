"""Multi-harmonic residual of a rig, as a problem for continuation.

The equations are those of :class:`hbm.balance.equations.Balance`. Newton's system is reduced to the friction force
(:class:`hbm.balance.elimination.Elimination`); for a clamp that slips it is corrected
(:class:`hbm.balance.slipping.SlippingBalance`).
"""

from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from hbm.aft.force import ContactForce
from hbm.balance.elements import ElementSlope
from hbm.balance.elimination import Elimination
from hbm.balance.equations import Balance, Kinematics
from hbm.balance.jacobian import CompleteBalance
from hbm.balance.jointed import JointBalance
from hbm.balance.jointednewton import JointLinearization
from hbm.balance.scaled import Parameter, State
from hbm.balance.slipping import PointForces, SlidRotation, SlippingBalance
from hbm.fourier import Array, FourierBasis
from models.jointed import AnyRig, JointedRig

__all__ = [
    "TOLERANCE",
    "AnyBalance",
    "AnyLinearization",
    "AnyRig",
    "HarmonicBalance",
    "Kinematics",
    "Linearization",
    "Newton",
    "Parameter",
    "State",
    "balance_of",
]

TOLERANCE = 1e-10
"""Newton's method closes every balance of forces to this fraction of the excitation."""

Newton = Elimination | SlippingBalance


class HarmonicBalance(Balance):
    """The balance of a rig as a :class:`continuation.Problem`."""

    @property
    def remembers(self) -> bool:
        """Whether friction depends on what was before."""
        return bool(self.law.functions.states)

    def residual(self, x: Array, lam: float) -> Array:
        """Scaled force balance of every mode and harmonic, then of the contact, (size,)."""
        return self.linearize(x, lam).residual

    def linearize(self, x: Array, lam: float) -> "Linearization":
        """Residual with its linearisation, which is worked out when first solved with."""
        state = self.unpack(x, lam)
        kin = self.kinematics(state)
        T, _ = self.law.force(kin.signals, state.Omega, self.environment)
        modal, contact = self._modal_balance(state, kin), state.T - self.basis.analysis @ T
        residual = np.concatenate([(modal / self.modal_force_ref).ravel(), contact / self.F_ref])
        return Linearization(self, state, kin, residual)


AnyBalance: TypeAlias = HarmonicBalance | JointBalance


def balance_of(rig: AnyRig, basis: FourierBasis, **settings: Any) -> AnyBalance:
    """The balance of a rig with one contact or with joints; settings as of :class:`hbm.balance.equations.Balance`."""
    return (
        JointBalance(rig, basis, **settings) if isinstance(rig, JointedRig) else HarmonicBalance(rig, basis, **settings)
    )


class Linearization:
    """Residual at a state, and its derivative when asked for; a :class:`continuation.Linearization`."""

    def __init__(self, problem: HarmonicBalance, state: State, kin: Kinematics, residual: Array) -> None:
        self.problem, self.state, self.kin, self.residual = problem, state, kin, residual

    @cached_property
    def contact(self) -> ContactForce:
        """The friction force with its derivatives."""
        return self.problem.law.linearize(self.kin.signals, self.state.Omega, self.problem.environment)

    @cached_property
    def by_T(self) -> Array | None:
        """Matrix (2H+1, 2H+1) that multiplies a series by T; None where the structure is not drawn in."""
        return None if self.kin.pull is None else self.problem.basis.multiplication(self.state.T)

    @property
    def _parts(self) -> tuple[Balance, State, Kinematics, ContactForce]:
        return self.problem, self.state, self.kin, self.contact

    @cached_property
    def slope(self) -> ElementSlope | None:
        """Derivatives of the forces of the elements; None where none acts."""
        elements, state = self.problem.elements, self.state
        if elements is None:
            return None
        found = elements.linearize(state.Q, state.Omega, state.F * self.problem.force_shape)
        return found if found.acts else None

    @cached_property
    def rotation(self) -> SlidRotation | None:
        """Rotation slid in the clamp; None where it does not slip."""
        return None if self.problem.clamp is None else SlidRotation(*self._parts)

    @cached_property
    def newton(self) -> Newton:
        """The derivative."""
        return self.bordered()

    def bordered(self, column: Array | None = None) -> Newton:
        """The derivative, with another column (size,) in place of that of the problem's parameter."""
        problem, state, contact, slope = self.problem, self.state, self.contact, self.slope
        spread = None if slope is None or not slope.spread.acts else slope.spread

        def own() -> Array:  # holds nothing that holds it
            return problem.by_parameter(state, contact, slope) if column is None else column

        newton: Newton = Elimination(*self._parts, self.by_T, spread, own)
        if problem.elements is not None and slope is not None and slope.at_points.acts:
            newton = SlippingBalance(newton, PointForces(problem, problem.elements, contact, slope.at_points))
        if self.rotation is None:
            return newton
        slides = column is None and problem.parameter == "force"
        turned = self.rotation.load_by_force(problem.lam_ref * problem.force_shape) if slides else None
        return SlippingBalance(newton, self.rotation, turned)

    @cached_property
    def complete(self) -> Array:
        """Derivative of the residual to the scaled unknowns, (size, size), with nothing left out."""
        held = CompleteBalance(*self._parts, self.by_T, self.slope).by_unknowns
        return held if self.rotation is None else self.rotation.complete(held)

    def solve_bordered(self, row: Array, row_lam: float, rhs: Array, rhs_row: float) -> tuple[Array, float]:
        """Solve the bordered Newton system, see :class:`continuation.Linearization`."""
        return self.newton.solve_bordered(row, row_lam, rhs, rhs_row)

    def determinant_sign(self, row: Array, row_lam: float) -> int:
        """Sign of the determinant of the bordered matrix."""
        return self.newton.determinant_sign(row, row_lam)


AnyLinearization: TypeAlias = Linearization | JointLinearization
