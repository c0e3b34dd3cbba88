"""The balance of a rig with any of its numbers as the continuation parameter.

The derivative to the number is exact (:func:`hbm.sensitivity.derivatives.balance_change`): of the structure by CasADi,
of the law along its marched period, of the modes among each other where the structure that they belong to changes.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hbm.balance.jointednewton import JointNewton
from hbm.balance.problem import AnyBalance, AnyLinearization, HarmonicBalance, Newton, State, balance_of
from hbm.balance.solution import PeriodicSolution, describe
from hbm.fourier import Array, FourierBasis
from hbm.sensitivity.derivatives import balance_change
from models.friction.law import Parameter
from models.jointed import AnyRig
from models.numbers import no_such_number
from models.rig import Rig
from models.scalars import FORCE, FRICTION, HZ, solution_numbers

REFERENCES = 33
"""Values over the range at which the modes are kept, so that their signs follow from one to the next."""


class Key(NamedTuple):
    """A number of a rig that a curve can be followed along.

    Attributes
    ----------
    name : str
        Its key in the rig file; ``frequency_hz`` for the excitation frequency.
    value : float
        Value that the rig has.
    accepted : Parameter
        Its unit and bounds.
    """

    name: str
    value: float
    accepted: Parameter


def parameter_key(rig: AnyRig, name: str, hz: float, level: float) -> Key:
    """Look up a number of a rig.

    Parameters
    ----------
    rig : Rig
    name : str
    hz, level : float
        Frequency [Hz] and force amplitude [N] of the excitation.

    Raises
    ------
    ValueError
        If the rig has no such number; the closest ones are named.
    """
    known = {key: n for key, n in solution_numbers(rig, hz, level).items() if key not in rig.drifting}  # does nothing
    if name not in known:
        raise no_such_number(name, known, rig.name)
    return Key(name, *known[name])


def check_value(rig: AnyRig, key: Key, value: float) -> None:
    """Refuse a value that the rig file would not have.

    Raises
    ------
    ValueError
        If it is out of its bounds, or of those that other parameters of the law set.
    """
    _check_bounds(key, value)
    if key.name in rig.numbers:
        _check_others(key, value, rig.with_number(key.name, value))


def _check_bounds(key: Key, value: float) -> None:
    p = key.accepted
    above = value > p.lower if p.strict else value >= p.lower
    if not (above and value <= p.upper and np.isfinite(value)):
        raise ValueError(f"{key.name} = {value:g}; must be {p.bound}")


def _check_others(key: Key, value: float, there: AnyRig) -> None:
    """Refuse a rig with a value that other parameters of the law do not allow."""
    for low, other in there.too_low:
        name, least = (k.rpartition(".")[2] for k in (low, other))
        raise ValueError(f"{key.name} = {value:g}; {name} must be >= {least}")


class ParameterBalance:
    """The balance of a rig at a frequency and a force, along one of its numbers; a :class:`continuation.Problem`.

    The continuation parameter runs from 0 to 1 between two values. The units of the unknowns are those of the first
    rig, the signs of its modes follow those of the rigs before.

    Parameters
    ----------
    rig : Rig
    key : Key
    values : (float, float)
        Values of the number at 0 and at 1.
    basis : FourierBasis
    hz, level : float
        Frequency [Hz] and force amplitude [N], where they are not the number.
    """

    def __init__(
        self, rig: AnyRig, key: Key, values: tuple[float, float], basis: FourierBasis, *, hz: float, level: float
    ) -> None:
        self.rig, self.key, self.values, self.basis = rig, key, values, basis
        self._hz, self._level = hz, level
        self._last_rig = float("nan"), rig  # of no value yet
        self.first: AnyBalance = balance_of(self.rig_at(0.0), basis, level=self.level_at(0.0))
        self._last = 0.0, self.first

    def value_at(self, lam: float) -> float:
        """Value of the number."""
        begin, end = self.values
        return end if lam == 1.0 else begin + lam * (end - begin)

    def lam_at(self, value: float) -> float:
        """Value of the continuation parameter."""
        begin, end = self.values
        return (value - begin) / (end - begin)

    def hz_at(self, lam: float) -> float:
        """Excitation frequency [Hz]."""
        return self.value_at(lam) if self.key.name == HZ else self._hz

    def level_at(self, lam: float) -> float:
        """Force amplitude [N]."""
        return self.value_at(lam) if self.key.name == FORCE else self._level

    def rig_at(self, lam: float) -> AnyRig:
        """The rig with that value."""
        if self.key.name in (HZ, FORCE):
            return self.rig
        if self._last_rig[0] != lam:
            self._last_rig = lam, self.rig.with_number(self.key.name, self.value_at(lam))
        return self._last_rig[1]

    def at(self, lam: float) -> AnyBalance:
        """The balance of the rig with that value, in the units of the first."""
        if self._last[0] != lam:
            self._last = lam, self._balance(lam)
        return self._last[1]

    def _accepted(self, lam: float) -> bool:
        if self._last[0] == lam:
            return True
        try:
            _check_bounds(self.key, self.value_at(lam))
            _check_others(self.key, self.value_at(lam), self.rig_at(lam))
        except ValueError:
            return False
        return True

    def _balance(self, lam: float) -> AnyBalance:
        if self.key.name == HZ:
            return self.first
        rig = self.rig_at(lam)
        if isinstance(rig, Rig) and isinstance(self.first, HarmonicBalance) and self.key.name.startswith(FRICTION):
            return self.first.with_contact_of(rig)
        return balance_of(rig, self.basis, level=self.level_at(lam), like=self.first)

    # ---- signs of the modes

    @cached_property
    def _references(self) -> list[Array]:
        """Modes at values over the range, each with the signs that follow from those before."""
        each = [self.rig_at(float(lam)).followed_modes for lam in np.linspace(0.0, 1.0, REFERENCES)]
        first, *others = [kept for kept in each if kept is not None]
        modes = [first]
        for kept in others:
            if kept.shape != modes[-1].shape:  # modes come or go with a resonator's frequency
                break
            modes.append(kept * _signs(modes[-1], kept))
        return modes

    def signs(self, problem: AnyBalance, lam: float) -> Array:
        """Sign (size,) of each unknown here against that of the balance of the rig at `lam`."""
        signs, kept = np.ones(problem.size), problem.rig.followed_modes
        if kept is not None and not self.key.name.startswith(FRICTION):
            i = round(min(max(lam, 0.0), 1.0) * (REFERENCES - 1))
            modes = signs[: -self.basis.size].reshape(self.basis.size, -1)
            modes[:] = _signs(self._references[min(i, len(self._references) - 1)], kept)
        return signs

    # ---- the interface of continuation.Problem

    def residual(self, x: Array, lam: float) -> Array:
        """Scaled force balance, (size,)."""
        return self.linearize(x, lam).residual

    def linearize(self, x: Array, lam: float) -> "ParameterLinearization | Undefined":
        """Residual with its linearisation; undefined where no rig has such a number, or it has other modes.

        A predictor near the end of the range may step over what the number may be.
        """
        problem = self.at(lam) if self._accepted(lam) else None
        if problem is None or problem.size != x.size:
            return Undefined(np.full(x.size, np.nan))
        signs = self.signs(problem, lam)
        here = problem.linearize(signs * x, problem.lam_at(self.hz_at(lam)))
        return ParameterLinearization(here, signs, self.key.name, self.values[1] - self.values[0])

    def state(self, x: Array, lam: float) -> tuple[AnyBalance, State]:
        """The balance of the rig with a value of the number, and the state of unknowns."""
        problem = self.at(lam)
        return problem, problem.unpack(self.signs(problem, lam) * x, problem.lam_at(self.hz_at(lam)))

    def describe(self, x: Array, lam: float) -> PeriodicSolution:
        """Physical channels of a solution."""
        problem = self.at(lam)
        return describe(problem, self.signs(problem, lam) * x, problem.lam_at(self.hz_at(lam)))


def _signs(before: Array, kept: Array) -> Array:
    return np.where(np.einsum("dn,dn->n", before, kept) < 0.0, -1.0, 1.0)


@dataclass(frozen=True, eq=False)
class Undefined:
    """Placeholder where there is no balance: a :class:`continuation.Linearization` that solves nothing."""

    residual: Array

    def solve_bordered(self, row: Array, row_lam: float, rhs: Array, rhs_row: float) -> tuple[Array, float]:
        """No solution."""
        return np.full_like(rhs, np.nan), float("nan")

    def determinant_sign(self, row: Array, row_lam: float) -> int:
        """No sign."""
        return 0


class ParameterLinearization:
    """Residual at a state, and its derivative when asked for; a :class:`continuation.Linearization`."""

    def __init__(self, here: AnyLinearization, signs: Array, key: str, width: float) -> None:
        self.here, self.signs, self.key, self.width = here, signs, key, width
        self.residual = signs * here.residual

    @cached_property
    def J_lam(self) -> Array:
        """Derivative of the residual to the continuation parameter, (size,)."""
        return np.asarray(self.signs * balance_change(self.here, (self.key,))[:, 0] * self.width)

    @cached_property
    def _newton(self) -> Newton | JointNewton:
        return self.here.bordered(self.signs * self.J_lam)

    def solve_bordered(self, row: Array, row_lam: float, rhs: Array, rhs_row: float) -> tuple[Array, float]:
        """Solve the bordered Newton system, see :class:`continuation.Linearization`."""
        x, lam = self._newton.solve_bordered(self.signs * row, row_lam, self.signs * rhs, rhs_row)
        return self.signs * x, lam

    def determinant_sign(self, row: Array, row_lam: float) -> int:
        """Sign of the determinant of the bordered matrix."""
        return self._newton.determinant_sign(self.signs * row, row_lam)
