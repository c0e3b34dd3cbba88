"""The balance of a rig at a solution, which has to be one of that rig."""

from math import prod
from typing import overload

import numpy as np

from hbm.balance.jointed import JointBalance
from hbm.balance.jointednewton import JointLinearization
from hbm.balance.problem import AnyBalance, AnyLinearization, HarmonicBalance, Linearization
from hbm.balance.solution import PeriodicSolution

UNBALANCED = 1e-6
"""A state that misses the balance by more than this fraction of the excitation is not a solution of the rig."""


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
