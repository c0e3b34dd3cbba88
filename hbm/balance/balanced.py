"""The balance of a rig at a solution, which has to be one of that rig; motions of other joints are refused."""

from math import prod
from typing import overload

import numpy as np

from hbm.balance.jointed import JointBalance
from hbm.balance.jointednewton import JointLinearization
from hbm.balance.problem import AnyBalance, AnyLinearization, HarmonicBalance, Linearization
from hbm.balance.solution import PeriodicSolution
from hbm.errors import InputError
from models.jointed import AnyRig, JointedRig

UNBALANCED = 1e-6
"""A state that misses the balance by more than this fraction of the excitation is not a solution of the rig."""


def expect_joints_of(rig: AnyRig, motion: PeriodicSolution, where: str) -> None:
    """Refuse to start from a motion of other joints than those of a rig.

    Joints are the same that have the same names, numbers of places and order. Their laws and numbers may be others.

    Raises
    ------
    InputError
        With the first joint that differs.
    """
    own, found = rig.motions if isinstance(rig, JointedRig) else ["slip"], motion.motions
    if missing := [name for name in own if name not in found]:
        raise InputError(f"{where}: start has no {missing[0]}; must be a motion of {rig.name}")
    if foreign := [name for name in found if name not in own]:
        raise InputError(f"{where}: start has {foreign[0]}; must be a motion of {rig.name}, which has no such joint")
    if found != own:
        raise InputError(f"{where}: start has its joints in another order; must be as in {rig.name}, {', '.join(own)}")


@overload
def balanced(problem: HarmonicBalance, solution: PeriodicSolution, where: str) -> Linearization: ...


@overload
def balanced(problem: JointBalance, solution: PeriodicSolution, where: str) -> JointLinearization: ...


def balanced(problem: AnyBalance, solution: PeriodicSolution, where: str) -> AnyLinearization:
    """The balance at a solution of its rig.

    Parameters
    ----------
    problem : HarmonicBalance or JointBalance
        On the harmonics of the solution.
    solution : PeriodicSolution
    where : str
        Beginning of the message.

    Raises
    ------
    ValueError
        If the rig has other modes or ports, or a balance is missed by :data:`UNBALANCED` or more.
    """
    state, touching = solution.state, prod(problem.touching[1:])
    modes, ports = state.Q.shape[1], prod(state.T.shape[1:])
    if (modes, ports) != (problem.structure.n, touching):
        found, needed = f"{modes} modes and {ports} ports", f"{problem.structure.n} and {touching}"
        raise ValueError(f"{where}: the state has {found}; must be a solution of this rig, which has {needed}")
    here = problem.linearize(*problem.pack(state))
    missed = float(np.abs(here.residual).max())
    if not missed < UNBALANCED:
        raise ValueError(
            f"{where}: the state misses the rig's balance by {missed:.2g} of the excitation; "
            "must be a solution of this rig"
        )
    return here
