"""Exact derivatives of a periodic solution of a rig with joints to the numbers of its joints, its force and frequency.

The implicit function theorem, with the matrix that Newton's method uses: nothing is left out of it.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hbm.balance.jointed import JointBalance
from hbm.balance.jointednewton import JointLinearization
from hbm.balance.solution import PeriodicSolution
from hbm.channels import DERIVATIVES, read
from hbm.fourier import Array
from hbm.parallel import one_thread
from hbm.sensitivity.channels import ChannelSensitivity, largest, smooth_peak
from models.display import Displayed
from models.friction.law import Parameter
from models.jointed import JointedRig
from models.joints.law import described, numbers

Peak = Callable[[Array, Array], Array]
"""Derivatives (p,) of the peak of a sampled signal, from its samples and theirs."""

FORCE, HZ = "excitation.amplitude", "frequency_hz"
UNBALANCED = 1e-6
"""A state that misses the balance by more than this fraction of the excitation is not a solution of the rig."""


def joint_scalars(rig: JointedRig, hz: float, level: float) -> dict[str, tuple[float, Parameter]]:
    """Numbers that a solution depends on and their bounds, with keys such as ``joints.tip.mu``."""
    found = {
        f"joints.{j.name}.{name}": (float(value), described(j.law)[name])
        for j in rig.joints
        for name, value in numbers(j.law).items()
    }
    found[FORCE] = level, Parameter("N", "force amplitude", "")
    found[HZ] = hz, Parameter("Hz", "excitation frequency", "")
    return found


def joint_balance_change(here: JointLinearization, keys: Sequence[str]) -> Array:
    """Exact derivatives (size, p) of the scaled balance to numbers of the rig, the scaled unknowns held."""
    problem, basis = here.problem, here.problem.basis
    split = basis.size * problem.structure.n
    out = np.zeros((problem.size, len(keys)))
    for j, (joint, at) in enumerate(zip(problem.rig.joints, problem.slices, strict=True)):
        names = [f"joints.{joint.name}.{name}" for name in numbers(joint.law)]
        columns = [i for i, key in enumerate(keys) if key in names]
        if columns:
            change = np.zeros((len(names), len(columns)))
            change[[names.index(keys[i]) for i in columns], range(len(columns))] = 1.0
            by = problem.joints[j].along(here.signals[j], here.state.Omega, change, np.zeros(len(columns)))
            rows = out[split:].reshape(basis.size, len(problem.own), -1)
            rows[:, at, columns] -= by / problem.f_ref[at, None]
    if FORCE in keys:
        out[:, keys.index(FORCE)] = here.along("force") / problem.F_ref
    if HZ in keys:
        out[:, keys.index(HZ)] = here.along("frequency") / problem.hz_ref
    return out


@dataclass(frozen=True, eq=False)
class JointSensitivities(Displayed):
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

    solution: PeriodicSolution
    parameters: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    Q: Array
    T: Array
    channels: Mapping[str, ChannelSensitivity]

    def __repr__(self) -> str:
        """Name the numbers and the steady state, and how much the drive's peak changes with each."""
        s, changes = self.solution, self.logarithmic("drive")
        head = (
            f"sensitivities at {s.hz:.6g} Hz, {s.level:g} N; of the drive's peak, relative, to each number, relative:"
        )
        lines = [
            f"  {name:32s} {value:12.6g} {'' if unit == '1' else unit:8s} {changes[name]:+.4g}"
            for name, value, unit in zip(self.parameters, self.values, self.units, strict=True)
        ]
        return "\n".join([head, *lines])

    def __getitem__(self, name: str) -> ChannelSensitivity:
        """Channel by name."""
        return self.channels[name]

    def logarithmic(self, channel: str) -> dict[str, float]:
        """Derivative d ln(peak) / d ln(p) of a channel's peak to each parameter: per cent per per cent."""
        relative = self.values * self[channel].peak / self.solution[channel].peak
        return dict(zip(self.parameters, relative.tolist(), strict=True))


@one_thread
def joint_sensitivities(
    rig: JointedRig, solution: PeriodicSolution, keys: Sequence[str] | None = None
) -> JointSensitivities:
    """Exact derivatives of a periodic solution of a rig with joints; all of :func:`joint_scalars` where no keys.

    Raises
    ------
    ValueError
        If the solution is not one of this rig, or a key not one of its numbers.
    ArithmeticError
        At a fold, where the solution has no derivative at held frequency and force.
    """
    problem = JointBalance(rig, solution.basis, level=solution.level)
    here = problem.linearize(*problem.pack(solution.state))
    missed = float(np.abs(here.residual).max())
    if not missed < UNBALANCED:
        raise ValueError(
            f"sensitivities: the state misses the rig's balance by {missed:.2g} of the excitation; "
            "must be a solution of this rig"
        )
    known = joint_scalars(rig, solution.hz, solution.level)
    keys = tuple(known) if keys is None else tuple(keys)
    unknown = [key for key in keys if key not in known]
    if unknown or not keys:
        found = f"{unknown[0]} is not a number of the rig" if unknown else "no keys"
        raise ValueError(f"sensitivities: {found}; must be some of {', '.join(known)}")
    row = np.zeros(problem.size)
    x, _ = here.newton.solve_columns(row, 1.0, -joint_balance_change(here, keys), 0.0)  # the parameter itself is held
    if not np.isfinite(x).all():
        raise ArithmeticError(f"sensitivities: no derivative at {solution.hz:.6g} Hz, a fold of the curve")
    split = problem.basis.size * problem.structure.n
    Q = x[:split].reshape(problem.basis.size, problem.structure.n, -1) * problem.q_ref
    T = x[split:].reshape(problem.basis.size, len(problem.own), -1) * problem.f_ref[:, None]
    numbers_of = [known[key] for key in keys]
    return JointSensitivities(
        solution=solution,
        parameters=keys,
        units=tuple(p.unit for _, p in numbers_of),
        values=np.array([value for value, _ in numbers_of]),
        Q=Q,
        T=T,
        channels=_Channels(problem, solution, keys, Q, T),
    )


class _Channels(Mapping[str, ChannelSensitivity]):
    """Derivatives of the channels, each worked out when it is asked for."""

    def __init__(
        self, problem: JointBalance, solution: PeriodicSolution, keys: Sequence[str], Q: Array, T: Array
    ) -> None:
        self._problem, self._solution, self._Q, self._T = problem, solution, Q, T
        shape, p = problem.force_shape, len(keys)
        self._force, self._hz = np.zeros((len(shape), p)), np.zeros(p)
        if FORCE in keys:
            self._force[:, keys.index(FORCE)] = shape
        if HZ in keys:
            self._hz[keys.index(HZ)] = 1.0

    def __iter__(self) -> Iterator[str]:
        return iter(self._solution.channels)

    def __len__(self) -> int:
        return len(self._solution.channels)

    def __getitem__(self, name: str) -> ChannelSensitivity:
        rig, s, basis = self._problem.rig, self._problem.structure, self._problem.basis
        if name in rig.forces:
            return self._sampled(name, self._T[:, rig.forces.index(name)], largest)
        if name in rig.motions:
            i = rig.motions.index(name)
            moved = self._seen(s.joints[i], s.flexibility[i], float(s.flexibility_to_force[i]))
            return self._sampled(name, moved, largest)
        if name == "drive":
            return self._sampled(name, self._seen(s.excitation, s.flexibility_to_force, s.drive_by_force))
        channel = next(c for c in rig.channels if c.name == name)
        if channel.quantity == "force":
            return self._sampled(name, self._force)
        i = [c.name for c in rig.response_channels].index(name)
        moved = self._seen(s.channels[i], s.channels_by_joints[i], float(s.channels_by_force[i]))
        Omega, there = self._solution.state.Omega, self._solution[name].coefficients
        coefficients = read(channel, basis, moved, Omega)
        faster = DERIVATIVES[channel.quantity] * there / self._solution.hz
        faster = faster - 2 * np.pi * channel.delay * basis.derivative(there)
        return self._sampled(name, coefficients + np.outer(faster, self._hz))

    def _seen(self, row: Array, by_joints: Array, by_force: float) -> Array:
        """Change of a displacement of the body, (2H+1, p)."""
        moved = np.einsum("n,knp->kp", row, self._Q) + np.einsum("m,kmp->kp", by_joints, self._T)
        return np.asarray(moved + by_force * self._force)

    def _sampled(self, name: str, coefficients: Array, peak: Peak = smooth_peak) -> ChannelSensitivity:
        samples = self._problem.basis.synthesis @ coefficients
        return ChannelSensitivity(coefficients, samples, peak(self._solution[name].samples, samples))
