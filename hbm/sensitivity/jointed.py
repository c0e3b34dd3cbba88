"""Exact derivatives of a periodic solution of a rig with joints to the numbers of its joints, its force and frequency.

The implicit function theorem, with the matrix that Newton's method uses: nothing is left out of it.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hbm.balance.balanced import balanced
from hbm.balance.jointed import JointBalance
from hbm.balance.jointednewton import JointLinearization
from hbm.balance.jointequations import JointEquations
from hbm.balance.solution import PeriodicSolution
from hbm.channels import DERIVATIVES, read
from hbm.errors import expect_joints
from hbm.fourier import Array
from hbm.parallel import one_thread
from hbm.sensitivity.channels import (
    ChannelSensitivity,
    Derivatives,
    Peak,
    SeriesSensitivity,
    described,
    largest,
    smooth_peak,
)
from hbm.sensitivity.scalars import FORCE, HZ, solution_numbers
from models.change import tone_scalars
from models.jointed import JointedRig, JointedStructure
from models.joints.law import numbers


def joint_balance_change(here: JointLinearization, keys: Sequence[str]) -> Array:
    """Exact derivatives (size, p) of the scaled balance to numbers of the rig, the scaled unknowns held."""
    problem, basis = here.problem, here.problem.basis
    split = basis.size * problem.structure.n
    out = np.zeros((problem.size, len(keys)))
    rows = out[split:].reshape(basis.size, len(problem.own), len(keys))
    moving, changes = problem.rig.structure_changes(tuple(keys))
    balance, signals = problem.moved_balance(here.state, changes), problem.moved_signals(here.state, changes)
    out[:, moving] = _scaled(here, balance, signals)
    for at, columns, by in law_changes(problem, here.signals, here.state.Omega, keys):
        rows[:, at, columns] -= by / problem.f_ref[at, None]
    tones = tone_changes(problem, keys)
    if tones.any():
        out += forces_change(here, here.state.F * tones, problem.structure)
    if FORCE in keys:
        out[:, keys.index(FORCE)] = here.along("force") / problem.F_ref
    if HZ in keys:
        out[:, keys.index(HZ)] = here.along("frequency") / problem.hz_ref
    return out


def law_changes(
    problem: JointEquations, signals: Sequence[Array], Omega: float, keys: Sequence[str]
) -> Iterator[tuple[slice, list[int], Array]]:
    """How the forces of the joints change with numbers of the rig, signals held: of their laws, of their compliances.

    Yields
    ------
    slice, list of int, (2H+1, ports, c) array
        Ports of a joint, which of the keys it depends on, and the derivatives to these.
    """
    moving, changes = problem.rig.structure_changes(tuple(keys))
    own = np.zeros((len(problem.own), len(keys)))
    own[:, moving] = problem.moved_own(changes)
    for j, (joint, at) in enumerate(zip(problem.rig.joints, problem.slices, strict=True)):
        names = [f"joints.{joint.name}.{name}" for name in numbers(joint.law)]
        change = np.vstack([np.array(names, dtype=str)[:, None] == np.array(keys), own[at.start]]).astype(float)
        columns = np.flatnonzero(change.any(axis=0)).tolist()
        if columns:
            yield at, columns, problem.joints[j].along(signals[j], Omega, change[:, columns])


def forces_change(here: JointLinearization, forces: Array, s: JointedStructure) -> Array:
    """Derivatives (size, p) of the scaled balance to forces (2H+1, p) where a structure has its excitation."""
    problem = here.problem
    signals = []
    for j, at in enumerate(problem.slices):
        moved = np.einsum("kp,s->ksp", forces, s.flexibility_to_force[at])
        load = s.loads_by_force[j] * forces[:, None]
        signals.append(np.concatenate([moved, moved, load], axis=1))
    return _scaled(here, -np.einsum("kp,n->knp", forces, s.excitation), signals)


def _scaled(here: JointLinearization, modal: Array, signals: Sequence[Array]) -> Array:
    """Changes (2H+1, n, p) of the modal balances, and of the joints' through signals (2H+1, s, p), scaled."""
    problem, p = here.problem, modal.shape[2]
    law = np.zeros((problem.basis.size, len(problem.own), p))
    for at, force, seen in zip(problem.slices, here.forces, signals, strict=True):
        law[:, at] = -np.tensordot(force.by_signals, seen, axes=2)
    scaled = modal / problem.modal_force_ref, law / problem.f_ref[:, None]
    return np.concatenate([balance.reshape(balance.shape[0] * balance.shape[1], p) for balance in scaled])


def tone_changes(problem: JointEquations, keys: Sequence[str]) -> Array:
    """Derivatives (2H+1, p) of the shape of the force to numbers: the coefficients of its harmonics."""
    out, H = np.zeros((problem.basis.size, len(keys))), problem.basis.H
    places = [(k, part) for k, *_ in problem.rig.excitation.harmonics for part in (0, H)]
    for key, (k, part) in zip(tone_scalars(problem.rig.excitation), places, strict=True):
        if key in keys and k <= H:
            out[k + part, keys.index(key)] = 1.0
    return out


@dataclass(frozen=True, eq=False, repr=False)
class JointSensitivities(Derivatives):
    """How a periodic solution of a rig with joints changes with its numbers, everything else held.

    Attributes
    ----------
    solution : PeriodicSolution
        Solution that is differentiated.
    parameters, units : tuple of str, (p,)
        Keys of the rig file.
    values : (p,) array
    Q, T : (2H+1, n, p) and (2H+1, m, p) arrays
        Derivatives of the coefficients of modes and joint forces.
    channels : mapping of str to ChannelSensitivity
    """

    @property
    def own_Q(self) -> Array:
        """Derivatives of Q in the modes that the changed rig has: they are the same."""
        return self.Q

    @property
    def disturbed(self) -> Mapping[str, Array]:
        """No disturbance goes beside."""
        return {}


@one_thread
def joint_sensitivities(
    rig: JointedRig, solution: PeriodicSolution, keys: Sequence[str] | None = None
) -> JointSensitivities:
    """Exact derivatives of a periodic solution of a rig with joints; to all that it depends on where no keys.

    Raises
    ------
    InputError
        If the rig is not one with joints.
    ValueError
        If the solution is not one of this rig, or a key not one of its numbers.
    ArithmeticError
        At a fold, where the solution has no derivative at held frequency and force.
    """
    expect_joints(rig, "joint_sensitivities")
    return joint_sensitivities_at(linearized(rig, solution), solution, keys)


def joint_sensitivities_at(
    here: JointLinearization, solution: PeriodicSolution, keys: Sequence[str] | None
) -> JointSensitivities:
    """As :func:`joint_sensitivities`, of a balance that is linearised."""
    problem = here.problem
    keys = tuple(solution_numbers(problem.rig, solution.hz, solution.level) if keys is None else keys)
    units, values = described(problem.rig, solution, keys)
    Q, T = followed(here, joint_balance_change(here, keys))
    return JointSensitivities(
        solution=solution,
        parameters=keys,
        units=units,
        values=values,
        Q=Q,
        T=T,
        channels=JointChannels(problem, solution, keys, Q, T),
    )


def linearized(rig: JointedRig, solution: PeriodicSolution) -> JointLinearization:
    """The balance at a solution.

    Raises
    ------
    ValueError
        If the solution is not one of this rig.
    """
    return balanced(JointBalance(rig, solution.basis, level=solution.level), solution, "sensitivities")


def followed(here: JointLinearization, change: Array) -> tuple[Array, Array]:
    """Derivatives of the modes (2H+1, n, p) and joint forces (2H+1, m, p) that balance a change (size, p).

    Raises
    ------
    ArithmeticError
        At a fold.
    """
    problem = here.problem
    x, _ = here.newton.solve_columns(np.zeros(problem.size), 1.0, -change, 0.0)  # the parameter itself is held
    if not np.isfinite(x).all():
        hz = here.state.Omega * problem.periods / (2 * np.pi)
        raise ArithmeticError(f"sensitivities: no derivative at {hz:.6g} Hz, a fold of the curve")
    size, n, m = problem.basis.size, problem.structure.n, len(problem.own)
    split = size * n
    p = change.shape[1]
    return x[:split].reshape(size, n, p) * problem.q_ref, x[split:].reshape(size, m, p) * problem.f_ref[:, None]


class JointChannels(Mapping[str, ChannelSensitivity]):
    """Derivatives of the channels, each worked out when it is asked for."""

    def __init__(
        self, problem: JointEquations, solution: PeriodicSolution, keys: Sequence[str], Q: Array, T: Array
    ) -> None:
        self._problem, self._solution, self._Q, self._T, self._keys = problem, solution, Q, T, tuple(keys)
        self._moving, self._structure = problem.rig.structure_changes(self._keys)
        self._force, self._hz = solution.level * tone_changes(problem, keys), np.zeros(len(keys))
        if FORCE in keys:
            self._force[:, keys.index(FORCE)] = problem.force_shape
        if HZ in keys:
            self._hz[keys.index(HZ)] = 1.0

    def __iter__(self) -> Iterator[str]:
        return iter(self._solution.channels)

    def __len__(self) -> int:
        return len(self._solution.channels)

    def __getitem__(self, name: str) -> ChannelSensitivity:
        rig, basis = self._problem.rig, self._problem.basis
        if name in rig.forces:
            return self._sampled(name, self._T[:, rig.forces.index(name)], largest)
        if name in rig.motions:
            i = rig.motions.index(name)
            moved = self._seen(lambda s: (s.joints[i], s.flexibility[i], s.flexibility_to_force[i]))
            return self._sampled(name, moved, largest)
        if name == "drive":
            return self._sampled(name, self._seen(lambda s: (s.excitation, s.flexibility_to_force, s.drive_by_force)))
        channel = next(c for c in rig.channels if c.name == name)
        if channel.quantity == "force":
            return self._sampled(name, self._force)
        i = [c.name for c in rig.response_channels].index(name)
        moved = self._seen(lambda s: (s.channels[i], s.channels_by_joints[i], s.channels_by_force[i]))
        Omega, there = self._solution.state.Omega, self._solution[name].coefficients
        later = -Omega * basis.derivative(there)
        faster = (DERIVATIVES[channel.quantity] * there + channel.delay * later) / self._solution.hz
        coefficients = read(channel, basis, moved, Omega) + np.outer(faster, self._hz)
        for key, change in ((f"channels.{name}.gain", there / channel.gain), (f"channels.{name}.delay", later)):
            if key in self._keys:
                coefficients[:, self._keys.index(key)] += change
        return self._sampled(name, coefficients)

    def _seen(self, rows: Callable[[JointedStructure], tuple[Array, Array, Any]]) -> Array:
        """Change (2H+1, p) of a displacement that reads modes, joint forces and excitation by rows of the structure."""
        row, by_joints, by_force = rows(self._problem.structure)
        moved = np.asarray(row @ self._Q + by_joints @ self._T + by_force * self._force)
        state, force = self._solution.state, self._solution.state.F * self._problem.force_shape
        row, by_joints, by_force = rows(self._structure)
        moved[:, self._moving] += state.Q @ row + state.T @ by_joints + np.outer(force, by_force)
        return moved

    def _sampled(self, name: str, coefficients: Array, peak: Peak = smooth_peak) -> ChannelSensitivity:
        return SeriesSensitivity(coefficients, self._problem.basis, self._solution[name], peak)
