"""Exact derivatives of a periodic solution to the parameters of its rig.

The balance J [dQ; dT] = -dF/dp of the implicit function theorem is solved with the matrix that Newton's method uses.
An elimination leaves weak foreshortening out of it, so the solution is refined against the complete linearised balance
until nothing changes: the derivatives are those of the discretised equations, to rounding.

Where a sample changes between stick and slip, the discretised balance has a kink and its derivative is one-sided: that
of the side the solution lies on. Between such changes the derivative is exact for the samples given; its jumps fall
with their number (on the paper's beam near resonance, a few per cent with 256 samples).

Held, too, is the compliance lent to a set-valued law of a rigid structure
(:class:`hbm.balance.problem.HarmonicBalance`), on which a solution depends only through the harmonics left out.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np

from continuation import Correction
from hbm.balance.balanced import balanced
from hbm.balance.jointednewton import JointLinearization
from hbm.balance.problem import AnyLinearization, HarmonicBalance, Linearization, Newton
from hbm.balance.solution import PeriodicSolution
from hbm.channels import read
from hbm.fourier import Array
from hbm.parallel import one_thread
from hbm.sensitivity.channels import Change, Channels, Derivatives, described
from hbm.sensitivity.held import HeldBalance, law_change, mixed, mixing_of
from hbm.sensitivity.jointed import (
    JointSensitivities,
    joint_balance_change,
    joint_sensitivities,
    joint_sensitivities_at,
)
from hbm.sensitivity.moving import Disturbance, LinearBalance, refined
from models.jointed import AnyRig, JointedRig
from models.rig import Rig
from models.scalars import ALPHA, FORCE, HZ, LOAD, law_keys


@dataclass(frozen=True, eq=False, repr=False)
class Sensitivities(Derivatives):
    """How a periodic solution changes with the parameters of its rig, everything else held.

    Attributes
    ----------
    solution : PeriodicSolution
        Solution that is differentiated.
    parameters, units : tuple of str, (p,)
        Keys of the rig file.
    values : (p,) array
        Their values; force and frequency are those of the solution.
    Q, T : (2H+1, n, p) and (2H+1, p) arrays
        Derivatives of the unknowns, :class:`hbm.balance.problem.State`; where the structure changes, in the modes it
        has now.
    channels : dict of str to ChannelSensitivity
        The channels of the solution, each worked out when it is asked for.
    refinements : int
        Corrections of the first back-substitution.
    mixing : (p, n, n) array
        Derivatives of the modes within each other: columns are the changed modes in those there are now.
    disturbed : dict of str to (2H+1, d) array
        What the disturbances beside do, as of :func:`disturbed`.
    """

    refinements: int
    mixing: Array
    disturbed: Mapping[str, Array]

    @property
    def own_Q(self) -> Array:
        """Derivatives of Q in the modes that the changed rig has, (2H+1, n, p)."""
        return self.Q - mixed(self.solution.state.Q, self.mixing)


@overload
def sensitivities(
    rig: Rig, solution: PeriodicSolution, keys: Sequence[str] | None = None, beside: Disturbance | None = None
) -> Sensitivities: ...


@overload
def sensitivities(
    rig: JointedRig, solution: PeriodicSolution, keys: Sequence[str] | None = None, beside: None = None
) -> JointSensitivities: ...


@one_thread
def sensitivities(
    rig: AnyRig, solution: PeriodicSolution, keys: Sequence[str] | None = None, beside: Disturbance | None = None
) -> Sensitivities | JointSensitivities:
    """Exact derivatives of a periodic solution to the numbers of its rig.

    Parameters
    ----------
    rig : Rig or JointedRig
        The rig of the solution; its force amplitude may differ.
    solution : PeriodicSolution
        Steady state or point of a curve.
    keys : sequence of str, optional
        What to differentiate to, of :func:`models.scalars.solution_numbers`; where omitted the friction
        law's parameters, normal load, force, frequency and mass-proportional damping, of a rig with joints all.
    beside : Disturbance, optional
        Disturbance to solve for along with it, at next to no cost; of a rig with one contact alone.

    Returns
    -------
    Sensitivities or JointSensitivities

    Raises
    ------
    ValueError
        If the solution is not one of this rig, a key not one of its numbers, or a disturbance goes beside the
        derivatives of a rig with joints.
    ArithmeticError
        At a fold, where the solution has no derivative at held frequency and force.

    Examples
    --------
    >>> from hbm.response.trace import steady_state
    >>> from hbm.models.published import paper_rig
    >>> rig = paper_rig()
    >>> s = sensitivities(rig, steady_state(rig, 51.0, harmonics=5))
    >>> s.parameters[:3]
    ('contact.friction.mu', 'contact.friction.critical_slip', 'contact.normal_load')
    >>> round(s.logarithmic("drive")["contact.friction.mu"], 2)
    -0.46
    """
    if isinstance(rig, JointedRig):
        if beside is not None:
            raise ValueError(f"sensitivities: beside, and {rig.name} has no [contact]; must be without a disturbance")
        return joint_sensitivities(rig, solution, keys)
    here = balanced(HarmonicBalance(rig, solution.basis, level=solution.level), solution, "sensitivities")
    return _sensitivities(here, solution, keys, beside)


def _sensitivities(
    here: Linearization,
    solution: PeriodicSolution,
    keys: Sequence[str] | None,
    beside: Disturbance | None,
    near: Newton | None = None,
) -> Sensitivities:
    """As :func:`sensitivities`, of a balance that is linearised; with a matrix from nearby, where one is known."""
    problem, rig = here.problem, here.problem.rig
    keys = (*law_keys(rig), LOAD, FORCE, HZ, ALPHA) if keys is None else tuple(keys)
    units, values = described(rig, solution, keys)
    held, balance = HeldBalance(here, keys), LinearBalance(here)
    right = balance.scaled(-held.modal, law_change(here, held.inputs))
    also = np.zeros((len(right), 0)) if beside is None else balance.disturbed(beside)
    x, refinements = refined(here, balance, np.hstack([right, also]), near)
    d_Q, d_T = balance.unpack(x[:, : len(keys)])
    slid = held.slid + balance.slid(d_Q, d_T)
    signals = held.inputs.signals + balance.signals(d_Q, d_T)
    channels = Channels(here, solution, held, Change(d_Q, d_T, signals, slid, balance.by_elements(d_Q)))
    mixing = mixing_of(held.structure, problem.structure.omega_n**2)
    moved = {} if beside is None else _seen_of(balance, beside, x[:, len(keys) :])
    return Sensitivities(solution, keys, units, values, d_Q, d_T, channels, refinements, mixing, moved)


@one_thread
def changes_where_solved(
    solved: Correction, solution: PeriodicSolution, keys: Sequence[str] | None, beside: "Disturbance | None" = None
) -> Sensitivities | JointSensitivities:
    """As :func:`sensitivities`, of a solution just found, for a rig with one contact or with joints.

    Parameters
    ----------
    solved : Correction
        Where Newton's method found it: of a balance of this package.
    solution, keys, beside
        As for :func:`sensitivities`; a disturbance is of the contact alone.
    """
    here, last = solved.linearization, solved.solved_with
    if isinstance(here, JointLinearization):
        return joint_sensitivities_at(here, solution, keys)
    if not isinstance(here, Linearization) or not isinstance(last, Linearization):
        raise TypeError(f"changes: {type(here).__name__} is not of a harmonic balance; must be one")
    return _sensitivities(here, solution, keys, beside, last.newton)


@one_thread
def disturbed(rig: Rig, solution: PeriodicSolution, disturbance: Disturbance) -> dict[str, Array]:
    """Change of response channels and friction under small disturbances: receptances of the linearised steady state.

    Parameters
    ----------
    rig : Rig
        The rig of the solution.
    solution : PeriodicSolution
    disturbance : Disturbance

    Returns
    -------
    dict of str to (2H+1, p) array
        Coefficients, in each channel's unit per unit of the disturbance; `friction` [N] with what was beside the law.

    Raises
    ------
    ArithmeticError
        At a fold.
    """
    problem = HarmonicBalance(rig, solution.basis, level=solution.level)
    balance = LinearBalance(problem.linearize(*problem.pack(solution.state)))
    x, _ = refined(balance.here, balance, balance.disturbed(disturbance))
    return _seen_of(balance, disturbance, x)


def _seen_of(balance: "LinearBalance", disturbance: Disturbance, x: Array) -> dict[str, Array]:
    """Change of response channels and friction by a disturbance, and by the scaled unknowns (size, p) it moves."""
    problem, (d_Q, d_T) = balance.problem, balance.unpack(x)
    s, basis, Omega = problem.structure, problem.basis, balance.state.Omega
    slid, pushed = balance.slid(d_Q, d_T), balance.by_elements(d_Q)
    out = {"friction": d_T}
    for place, c in enumerate(problem.rig.response_channels, start=2):
        _, by_friction = s.residual.channels.get(c.name, (0.0, 0.0))
        moved = np.einsum("kip,i->kp", d_Q, s.channel_rows[c.name]) + by_friction * d_T
        moved = moved + disturbance.channels.get(c.name, 0.0)
        if problem.clamp is not None:
            moved += problem.clamp.port.residual[place] * slid
        if problem.elements is not None:
            moved += np.einsum("krp,r->kp", pushed, problem.elements.static[:, place - 1])
        out[c.name] = read(c, basis, moved, Omega)
    return out


def balance_change(here: AnyLinearization, keys: Sequence[str]) -> Array:
    """Exact derivatives of the scaled balance to numbers of the rig, the scaled unknowns and their units held.

    The unknowns are those of the rig's own modes, which a change of its structure mixes among each other.

    Parameters
    ----------
    here : Linearization or JointLinearization
        Any state, solution or not.
    keys : sequence of str, (p,)
        Keys of :func:`models.scalars.solution_numbers`.

    Returns
    -------
    (size, p) array
    """
    if isinstance(here, JointLinearization):
        return joint_balance_change(here, keys)
    held, balance = HeldBalance(here, tuple(keys)), LinearBalance(here)
    change = balance.scaled(held.modal, -law_change(here, held.inputs))
    mixing = mixing_of(held.structure, here.problem.structure.omega_n**2)
    if mixing.any():
        split = here.problem.basis.size * here.problem.structure.n
        moved = mixed(here.state.Q, mixing).reshape(split, -1) / here.problem.q_ref
        change += balance @ np.concatenate([moved, np.zeros((here.problem.basis.size, len(keys)))])
        residual = here.residual[:split].reshape(here.state.Q.shape)
        change[:split] += np.einsum("ki,pij->kjp", residual, mixing).reshape(split, -1)
    return np.asarray(change)
