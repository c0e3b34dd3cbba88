"""Laws that have no finite force: why nothing is found, whatever the way."""

from dataclasses import replace

import numpy as np

from hbm.balance.problem import AnyBalance, State, balance_of
from models.jointed import AnyRig, JointedRig


def without_force(problem: AnyBalance, lam: float) -> str:
    """What has no finite force where every mode moves both ways, in words; nothing where all have."""
    rig = problem.rig
    alone: list[tuple[str, AnyRig]] = [("contact", rig)]
    if isinstance(rig, JointedRig):
        alone = [(f"joint {j.name}", replace(rig, joints=(j,))) for j in rig.joints]
    return ", ".join(f"{name} ({one.law_name})" for name, one in alone if not _finite(one, problem, lam))


def _finite(rig: AnyRig, like: AnyBalance, lam: float) -> bool:
    """Whether the balance of a rig has a residual where every mode moves by its unit."""
    Omega, F = like.at(lam)
    problem = balance_of(rig, like.basis, level=F)
    Q, T = np.zeros((like.basis.size, problem.structure.n)), np.zeros(problem.touching)
    Q[like.basis.fundamental] = problem.q_ref
    x, there = problem.pack(State(Q, T, Omega, F))
    return bool(np.isfinite(problem.residual(x, there)).all())
