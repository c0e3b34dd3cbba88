"""What the history of joints that never slip in a record does to it: each keeps the mean force that was left in it.

Beside another joint that is not linear that mean moves what was measured: a cubic spring that is pulled aside gives
even harmonics.
"""

from collections.abc import Iterator

import numpy as np

from hbm.balance.jointednewton import JointLinearization
from hbm.balance.jointequations import JointEquations
from hbm.balance.solution import PeriodicSolution
from hbm.channels import read
from hbm.fourier import Array
from hbm.outputerror.records import Measurement, parts
from hbm.sensitivity.jointed import followed
from models.jointed import JointedRig
from models.joints.law import numbers
from models.joints.rubbing import Friction, PlaneFriction

LOSSLESS = 1e-9
"""Of the largest loop that force and motion could close, the loss of a contact or a joint that sticks."""


def history_of_joints(here: JointLinearization, solution: PeriodicSolution, data: Measurement) -> Array | None:
    """Change of the amplitudes (2, c, H, k) with one standard deviation of the mean force of each joint that sticks.

    The mean may be anything that friction can hold beside what oscillates. None where no joint sticks.

    Parameters
    ----------
    here : JointLinearization
        The balance at the solution.
    solution : PeriodicSolution
    data : Measurement

    Raises
    ------
    ArithmeticError
        At a fold.
    """
    problem = here.problem
    kept = dict(spare_forces(problem, solution))
    if not kept:
        return None
    ports, basis, s = list(kept), problem.basis, problem.structure
    change = np.zeros((problem.size, len(ports)))
    laws = change[basis.size * s.n :].reshape(basis.size, len(problem.own), len(ports))
    laws[0, ports, range(len(ports))] = -1.0 / problem.f_ref[ports]
    Q, f = followed(here, change)
    size = np.array(list(kept.values())) / np.sqrt(3.0) / f[0, ports, range(len(ports))]
    moved = np.einsum("cn,knp->ckp", s.channels, Q) + np.einsum("cm,kmp->ckp", s.channels_by_joints, f)
    channels = zip(problem.rig.response_channels, moved, strict=True)
    seen = {c.name: parts(basis, read(c, basis, u, here.state.Omega), data.H) for c, u in channels}
    return np.asarray(np.stack([seen[name] for name in data.channels], axis=1) * size)


def spare_forces(problem: JointEquations, solution: PeriodicSolution) -> Iterator[tuple[int, float]]:
    """Ports of joints that never slip, and what each can hold beside what oscillates [N]."""
    rig, s, basis = problem.rig, problem.structure, problem.basis
    port, signals = 0, problem.signals(solution.state)
    for j, joint in enumerate(rig.joints):
        law = joint.law
        if isinstance(law, Friction | PlaneFriction):
            along = range(port, port + law.drifting)
            forces = np.column_stack([solution[name].samples for name in rig.forces[port : port + law.ports]])
            spare = _spare(law, forces, basis.samples(signals[j][:, -1]), s.loads_by_joints[j, along])
            if spare.min() > 0.0 and all(_sticks(rig, solution, i) for i in along):
                yield from zip(along, spare.tolist(), strict=True)
        port += law.ports


def _spare(law: Friction | PlaneFriction, forces: Array, reaction: Array, by_mean: Array) -> Array:
    """Half of the range of the mean along each tangential port (t,) of a law with such forces (N, ports) [N].

    A reaction (N,) that loads it changes with the mean itself, by so much of it (t,).
    """
    known, tangential = numbers(law), forces[:, : law.drifting]
    mu = max((known[n] for n in ("mu", "mu_static") if n in known), default=0.0)
    pressed = np.maximum(max(known["normal_load"], 0.0) + reaction - forces[:, law.drifting :].sum(axis=1), 0.0)
    across = np.sum(tangential**2, axis=1, keepdims=True) - tangential**2
    room = np.sqrt(np.maximum((mu * pressed[:, None]) ** 2 - across, 0.0))
    forth, back = np.min(room - tangential, axis=0), np.min(room + tangential, axis=0)
    return np.asarray((forth / (1.0 - mu * by_mean) + back / (1.0 + mu * by_mean)) / 2.0)


def _sticks(rig: JointedRig, solution: PeriodicSolution, port: int) -> bool:
    """Whether a port takes no energy."""
    force, motion = solution[rig.forces[port]], solution[rig.motions[port]]
    basis = solution.basis
    rate = basis.samples(basis.derivative(motion.coefficients))
    lost = 2.0 * np.pi * float(np.mean(basis.samples(force.coefficients) * rate))
    return lossless(lost, force.samples, motion.samples)


def lossless(lost: float, force: Array, motion: Array) -> bool:
    """Whether a loop of samples loses nothing: what rubs there never slips."""
    return abs(lost) <= LOSSLESS * float(np.ptp(force) * np.ptp(motion))
