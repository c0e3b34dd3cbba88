"""Exact derivatives of a periodic solution of a rig with joints to the numbers of its joints, its force and frequency.

The implicit function theorem, with the matrix that Newton's method uses: nothing is left out of it.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from hbm.balance.balanced import balanced
from hbm.balance.jointed import JointBalance
from hbm.balance.jointednewton import JointLinearization
from hbm.balance.jointequations import JointEquations
from hbm.balance.solution import PeriodicSolution, Signal
from hbm.channels import DERIVATIVES, read
from hbm.errors import expect_joints
from hbm.fourier import Array, FourierBasis
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
from models.change import tone_scalars
from models.jointed import JointedRig
from models.jointedstructure import JointedStructure
from models.joints.law import numbers
from models.scalars import FORCE, HZ, solution_numbers


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
    for at, change, joint, seen in zip(problem.slices, of_laws(problem, keys), problem.joints, signals, strict=True):
        columns = np.flatnonzero(change.any(axis=0)).tolist()
        if columns:
            yield at, columns, joint.along(seen, Omega, change[:, columns])


def of_laws(problem: JointEquations, keys: Sequence[str]) -> Iterator[Array]:
    """Changes (numbers + 1, p) of the numbers of each joint's law and of its compliance with numbers of the rig."""
    moving, changes = problem.rig.structure_changes(tuple(keys))
    own = np.zeros((len(problem.own), len(keys)))
    own[:, moving] = problem.moved_own(changes)
    for joint, at in zip(problem.rig.joints, problem.slices, strict=True):
        names = [f"joints.{joint.name}.{name}" for name in numbers(joint.law)]
        yield np.vstack([np.array(names, dtype=str)[:, None] == np.array(keys), own[at.start]]).astype(float)


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


class PortSensitivity(SeriesSensitivity):
    """Derivatives of a force or a motion at a port, which a law tells at the samples beyond the harmonics kept."""

    _at: Callable[[], Array]

    def __init__(self, coefficients: Array, basis: FourierBasis, signal: Signal, at: Callable[[], Array]) -> None:
        super().__init__(coefficients, basis, signal, largest)
        self.__dict__["_at"] = at

    @cached_property
    def samples(self) -> Array:
        """Derivatives of its values at the phases of the basis, (N_t, p)."""
        return self._at()


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
            i = rig.forces.index(name)
            return self._at_port(name, self._T[:, i], lambda: self._forces[:, i])
        if name in rig.motions:
            i = rig.motions.index(name)
            moved = self._seen(lambda s: (s.joints[i], s.flexibility[i], s.flexibility_to_force[i]))
            return self._at_port(name, moved, lambda: self._motion(i, moved))
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

    @cached_property
    def _forces(self) -> Array:
        """Derivatives of the joint forces at the samples, beyond the harmonics kept, (N_t, m, p)."""
        problem, state, p = self._problem, self._solution.state, len(self._keys)
        faster = 2 * np.pi / problem.periods * self._hz
        along = problem.signals_along(state, self._Q, self._T, self._force, faster)
        found = np.zeros((problem.basis.N_t, len(problem.own), p))
        laws = zip(problem.slices, problem.joints, problem.signals(state), along, strict=True)
        by_rows, numbered = problem.moved_signals(state, self._structure), of_laws(problem, self._keys)
        for (at, joint, signals, change), moved, of_law in zip(laws, by_rows, numbered, strict=True):
            change[:, :, self._moving] += moved
            found[:, at] = joint.moved(signals, state.Omega, change, faster, of_law)
        return found

    def _motion(self, i: int, moved: Array) -> Array:
        """Derivatives of the motion at a port at the samples, (N_t, p), from those of its coefficients.

        A compliance of the body that its law takes into account follows the force beyond the harmonics kept.
        """
        problem, own = self._problem, np.zeros(len(self._keys))
        own[self._moving] = problem.moved_own(self._structure)[i]
        kept = min(problem.own[i], problem.structure.flexibility[i, i]) if problem.own[i] > 0.0 else 0.0
        force = self._solution[problem.rig.forces[i]]
        rest = force.samples - problem.basis.samples(force.coefficients)
        beyond = self._forces[:, i] - problem.basis.samples(self._T[:, i])
        return np.asarray(problem.basis.samples(moved) + kept * beyond + np.outer(rest, own))

    def _at_port(self, name: str, coefficients: Array, samples: Callable[[], Array]) -> ChannelSensitivity:
        return PortSensitivity(coefficients, self._problem.basis, self._solution[name], samples)

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
