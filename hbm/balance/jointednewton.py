"""Newton's system of a balance of joints: the modes eliminated, the core as large as the joint signals."""

import weakref
from functools import cached_property

import numpy as np

from hbm.aft.joint import JointForces
from hbm.balance.factors import BorderedCore, holds_parameter
from hbm.balance.jointequations import Complex, JointEquations
from hbm.balance.scaled import Parameter, State
from hbm.fourier import Array

SINGULAR = 1e-9
"""Least dynamic stiffness of an undamped mode in Newton's system, in units of its own: at its frequency it has none."""


def inverted(stiffness: Complex, omega_n: Array, *, diagonal: bool) -> Complex:
    """Receptance of modes by their dynamic stiffness, (..., n) where nothing couples them, else (..., n, n)."""
    if not diagonal:
        return np.asarray(np.linalg.inv(stiffness), dtype=np.complex128)
    least = SINGULAR * omega_n**2
    return np.asarray(1.0 / np.where(np.abs(stiffness) < least, least, stiffness))


class Modes:
    """The modes at a frequency: their answer to forces, harmonic by harmonic."""

    def __init__(self, problem: JointEquations, Omega: float) -> None:
        self.basis, self.diagonal = problem.basis, problem.diagonal
        stiffness: Complex = problem.dynamic_stiffness(Omega)
        # the mean of a rigid motion is not eliminated: the joints decide it
        at = (0, problem.rigid) if self.diagonal else (0, problem.rigid, problem.rigid)
        stiffness[at] = 1.0
        self.receptance = inverted(stiffness, problem.structure.omega_n, diagonal=self.diagonal)
        self.receptance[at] = 0.0

    def moved(self, forces: Array) -> Array:
        """Coefficients (2H+1, n, ...) of the modes under modal forces of the same shape."""
        amplitudes = self.basis.complex(forces)
        if self.diagonal:
            shape = (*self.receptance.shape, *(1,) * (amplitudes.ndim - 2))
            return self.basis.real(amplitudes * self.receptance.reshape(shape))
        flat = amplitudes.reshape(*amplitudes.shape[:2], -1)
        return self.basis.real((self.receptance @ flat).reshape(amplitudes.shape))

    def pulled(self, values: Array) -> Array:
        """Adjoint of :meth:`moved` for values (2H+1, n)."""
        amplitudes = self.basis.complex(values)
        if self.diagonal:
            return self.basis.real(amplitudes * self.receptance.conj())
        return self.basis.real(np.einsum("kji,kj->ki", self.receptance.conj(), amplitudes))

    def between(self, left: Array | Complex, right: Array) -> Complex:
        """Left rows (r, n) or (H+1, r, n), times the receptance, times right rows (m, n) transposed: (H+1, r, m)."""
        if self.diagonal:
            return np.asarray((left * self.receptance[:, None]) @ right.T)
        return np.asarray(left @ (self.receptance @ right.T))


def felt(by_used: Array, seen: Complex) -> Array:
    """Change of the forces of a joint with series whose effect on its signals is `seen`, record by record.

    Parameters
    ----------
    by_used : (R, u, ports, 2H+1, 2H+1) array
        Derivatives of the forces, see :class:`hbm.aft.joint.JointForces`.
    seen : (R, H+1, u, r) array

    Returns
    -------
    (R, 2H+1, ports, 2H+1, r) array
    """
    R, u, ports, size, _ = by_used.shape
    H = size // 2
    A = np.ascontiguousarray(by_used.transpose(0, 4, 2, 3, 1)).reshape(R, size, ports * size, u)
    cosine, sine = A[:, : H + 1], A[:, H + 1 :]
    out = np.empty((R, size, ports * size, seen.shape[3]))
    out[:, : H + 1] = cosine @ seen.real
    # a - i b is turned by what is seen: the sine column feeds the cosine with +imag, the cosine the sine with -imag
    out[:, 1 : H + 1] -= sine @ seen.imag[:, 1:]
    out[:, H + 1 :] = sine @ seen.real[:, 1:] + cosine[:, 1:] @ seen.imag[:, 1:]
    return out.reshape(R, size, ports, size, seen.shape[3]).transpose(0, 3, 2, 1, 4)


class JointLinearization:
    """Residual at a state, and its derivative when asked for; a :class:`continuation.Linearization`."""

    def __init__(self, problem: JointEquations, state: State, signals: list[Array], residual: Array) -> None:
        self.problem, self.state, self.signals, self.residual = problem, state, signals, residual

    @cached_property
    def forces(self) -> list[JointForces]:
        """Forces of the joints with their derivatives."""
        problem = self.problem
        return [j.linearize(s, self.state.Omega) for j, s in zip(problem.joints, self.signals, strict=True)]

    @cached_property
    def modes(self) -> Modes:
        """The modes at this frequency."""
        return Modes(self.problem, self.state.Omega)

    def _used(self, j: int) -> tuple[list[int], list[int], bool]:
        """Signals that the forces of joint j depend on: ports displaced, ports whose rates matter, whether the load."""
        at, used = self.problem.slices[j], self.forces[j].used
        m = at.stop - at.start
        moved = [at.start + i for i in used if i < m]
        return moved, [at.start + i - m for i in used if m <= i < 2 * m], 2 * m in used

    def loads(self, j: int) -> Complex:
        """What loads joint j per mode, (H+1, 1, n)."""
        s, k = self.problem.structure, np.arange(self.problem.basis.H + 1)[:, None, None] * self.state.Omega
        return np.asarray(1j * k * s.loads_damping[j] - k**2 * s.loads_inertia[j])

    @cached_property
    def _between(self) -> Complex:
        """Displacement at every port per force at every port, through the modes, (H+1, m, m)."""
        joints = self.problem.structure.joints
        return self.modes.between(joints, joints)

    def _seen(self, j: int) -> Complex:
        """Signals used of joint j per force at every port, modes following, (H+1, u, m)."""
        problem = self.problem
        moved, rated, loaded = self._used(j)
        seen = [self._between[:, moved] + problem.flexibility[moved]]
        if rated:
            seen.append(self._between[:, rated] + problem.flexibility_of_rate[rated])
        if loaded:
            s = problem.structure
            seen.append(self.modes.between(self.loads(j), s.joints) + s.loads_by_joints[j])
        return np.concatenate(seen, axis=1) if len(seen) > 1 else seen[0]

    def _beyond(self, j: int) -> Array:
        """The same with the modes held, (u, m)."""
        problem = self.problem
        moved, rated, loaded = self._used(j)
        loads = problem.structure.loads_by_joints[[j] * loaded]
        return np.vstack([problem.flexibility[moved], problem.flexibility_of_rate[rated], loads])

    def _by_modes(self, j: int) -> Complex:
        """Signals used of joint j per mode, (H+1, u, n)."""
        moved, rated, loaded = self._used(j)
        H, rows = self.problem.basis.H, self.problem.structure.joints[[*moved, *rated]] + 0j
        seen = np.broadcast_to(rows, (H + 1, *rows.shape))
        return np.concatenate([seen, self.loads(j)], axis=1) if loaded else seen

    @cached_property
    def core(self) -> Array:
        """Derivative of the joint balances to the joint forces, modes following, (2H+1 m, 2H+1 m), unscaled."""
        size, m = self.problem.basis.size, len(self.problem.own)
        core = np.eye(size * m).reshape(size, m, size, m)
        for j, at in enumerate(self.problem.slices):
            core[:, at] -= felt(self.forces[j].by_used[None], self._seen(j)[None])[0]
        return core.reshape(size * m, size * m)

    @cached_property
    def complete(self) -> Array:
        """Derivative of the residual to the scaled unknowns, (size, size), with nothing eliminated."""
        problem, s = self.problem, self.problem.structure
        size, n, m = problem.basis.size, s.n, len(problem.own)
        by_modes, by_joints = np.zeros((size, m, size, n)), np.eye(size * m).reshape(size, m, size, m)
        for j, at in enumerate(problem.slices):
            beyond = self._beyond(j) + 0j
            by_used = self.forces[j].by_used[None]
            by_modes[:, at] -= felt(by_used, self._by_modes(j)[None])[0]
            by_joints[:, at] -= felt(by_used, np.broadcast_to(beyond, (1, problem.basis.H + 1, *beyond.shape)))[0]
        pushed = -np.einsum("kl,mn->knlm", np.eye(size), s.joints)
        J = np.block(
            [
                [problem.stiffness_matrix(self.state.Omega), pushed.reshape(size * n, size * m)],
                [by_modes.reshape(size * m, size * n), by_joints.reshape(size * m, size * m)],
            ]
        )
        units = np.concatenate([np.full(size * n, problem.q_ref), np.tile(problem.f_ref, size)])
        balances = np.concatenate([np.full(size * n, problem.modal_force_ref), np.tile(problem.f_ref, size)])
        return np.asarray(J * units / balances[:, None])

    @cached_property
    def by_parameter(self) -> Array:
        """Derivative of the scaled balances to the scaled continuation parameter, (size,)."""
        return self.along(self.problem.parameter)

    def along(self, parameter: Parameter) -> Array:
        """Derivative of the scaled balances to the scaled frequency or force, (size,)."""
        problem, s, basis, state = self.problem, self.problem.structure, self.problem.basis, self.state
        law = np.zeros((basis.size, len(problem.own)))
        if parameter == "frequency":
            faster = (2 * state.Omega * basis.k**2)[:, None]
            modal = basis.derivative(state.Q) @ s.damping.T - faster * state.Q
            for j, (at, force) in enumerate(zip(problem.slices, self.forces, strict=True)):
                law[:, at] = -force.by_Omega
                if self._used(j)[2]:
                    load = basis.derivative(state.Q @ s.loads_damping[j]) - faster[:, 0] * (
                        state.Q @ s.loads_inertia[j]
                    )
                    law[:, at] -= (force.by_used[-1] @ load).T
        else:
            modal = -np.outer(problem.force_shape, s.excitation)
            for j, (at, force) in enumerate(zip(problem.slices, self.forces, strict=True)):
                moved, rated, loaded = self._used(j)
                reads = [*s.flexibility_to_force[[*moved, *rated]], *s.loads_by_force[[j] * loaded]]
                law[:, at] = -np.tensordot(reads, force.by_used @ problem.force_shape, axes=1).T
        scaled = np.concatenate([(modal / problem.modal_force_ref).ravel(), (law / problem.f_ref).ravel()])
        return np.asarray(scaled * (problem.Omega_ref if parameter == "frequency" else problem.F_ref))

    @cached_property
    def newton(self) -> "JointNewton":
        """The derivative, bordered by that to the problem's parameter."""
        # it holds this object weakly: matrices in a circle of references stay in memory long after their use
        return JointNewton(weakref.proxy(self))

    def bordered(self, column: Array) -> "JointNewton":
        """The derivative, with another column (size,) in place of that of the problem's parameter."""
        return JointNewton(self, column)

    def solve_bordered(self, row: Array, row_lam: float, rhs: Array, rhs_row: float) -> tuple[Array, float]:
        """Solve the bordered Newton system, see :class:`continuation.Linearization`."""
        return self.newton.solve_bordered(row, row_lam, rhs, rhs_row)

    def determinant_sign(self, row: Array, row_lam: float) -> int:
        """Sign of the determinant of the bordered matrix."""
        return self.newton.determinant_sign(row, row_lam)

    def law_of(self, Q: Array) -> Array:
        """Change (2H+1, m, r) of the joints' forces with modes (2H+1, n, r), the forces that load them held."""
        problem, basis = self.problem, self.problem.basis
        out, moved = np.zeros((basis.size, len(problem.own), Q.shape[2])), problem.structure.joints @ Q
        for j, (at, force) in enumerate(zip(problem.slices, self.forces, strict=True)):
            displaced, rated, loaded = self._used(j)
            for by, port in zip(force.by_used, [*displaced, *rated], strict=False):
                out[:, at] += (by @ moved[:, port]).transpose(1, 0, 2)
            if loaded:
                load = basis.real((self.loads(j) @ basis.complex(Q))[:, 0])
                out[:, at] += (force.by_used[-1] @ load).transpose(1, 0, 2)
        return out


class JointNewton(BorderedCore):
    """Newton's system reduced to the joint forces, bordered by a column (size,): of the problem's parameter if none."""

    def __init__(self, here: JointLinearization, column: Array | None = None) -> None:
        self.here, self.problem, self.modes, self._column = here, here.problem, here.modes, column
        self._core = self._with_means()

    def _with_means(self) -> Array:
        """The core with the means of rigid motions beside the joint forces, (2H+1 m + rigid, 2H+1 m + rigid)."""
        problem, rigid = self.problem, self.problem.rigid
        if not len(rigid):
            return self.here.core
        size, n, m = problem.basis.size, problem.structure.n, len(problem.own)
        unit = np.zeros((size, n, len(rigid)))
        unit[0, rigid] = np.eye(len(rigid))
        pushed = np.zeros((len(rigid), size, m))
        pushed[:, 0] = -problem.structure.joints[:, rigid].T
        return np.block(
            [
                [self.here.core, -self.here.law_of(unit).reshape(size * m, len(rigid))],
                [pushed.reshape(len(rigid), size * m), problem.adrift],
            ]
        )

    @cached_property
    def _border(self) -> tuple[Array, Array]:
        """What the border column reduces to."""
        return self._reduced((self.here.by_parameter if self._column is None else self._column)[:, None])

    def _reduced(self, rhs: Array) -> tuple[Array, Array]:
        """Motion (2H+1, n, r) under scaled right sides (size, r), the core held, and what it asks of the core."""
        problem, r = self.problem, rhs.shape[1]
        size, n, m = problem.basis.size, problem.structure.n, len(problem.own)
        forces = rhs[: size * n].reshape(size, n, r) * problem.modal_force_ref
        motion = self.modes.moved(forces)
        core = rhs[size * n :].reshape(size, m, r) * problem.f_ref[:, None] + self.here.law_of(motion)
        return motion, np.vstack([core.reshape(size * m, r), forces[0, problem.rigid]])

    def _bordered(self, row: Array, row_lam: float) -> tuple[Array, Array]:
        """Bordered core, and the row's part on the modes (2H+1, n)."""
        problem = self.problem
        size, n, m = problem.basis.size, problem.structure.n, len(problem.own)
        modes = row[: size * n].reshape(size, n) / problem.q_ref
        by_joints = self.modes.pulled(modes) @ problem.structure.joints.T
        by_joints += row[size * n :].reshape(size, m) / problem.f_ref
        motion, column = self._border
        matrix = np.empty((len(column) + 1, len(column) + 1), order="F")
        matrix[:-1, :-1], matrix[:-1, -1] = self._core, column[:, 0]
        matrix[-1, :-1] = np.append(by_joints, modes[0, problem.rigid])
        matrix[-1, -1] = row_lam - np.vdot(modes, motion[:, :, 0])
        return matrix, modes

    def solve_columns(self, row: Array, row_lam: float, rhs: Array, rhs_row: float) -> tuple[Array, Array]:
        """Solve the bordered Newton system for right sides (size, r) with the same last entry, (size, r) and (r,)."""
        d_Q, core = self._reduced(rhs)
        if holds_parameter(row, row_lam, rhs_row):
            return self._moved(d_Q, self._alone.solve(core)), np.zeros(rhs.shape[1])
        factored = self._factor_with(row, row_lam)
        right = np.vstack([core, rhs_row - factored.modes @ d_Q.reshape(-1, rhs.shape[1])])
        solution = factored.factors.solve(right)
        d_Q -= self._border[0] * solution[-1]
        return self._moved(d_Q, solution[:-1]), solution[-1]

    def _moved(self, d_Q: Array, d_core: Array) -> Array:
        """Scaled unknowns (size, r) of the motion (2H+1, n, r) with the core held, which its unknowns move further."""
        problem, (size, n, r) = self.problem, d_Q.shape
        m = len(problem.own)
        d_f, d_mean = d_core[: size * m].reshape(size, m, r), d_core[size * m :]
        d_Q += self.modes.moved(problem.structure.joints.T @ d_f)
        d_Q[0, problem.rigid] += d_mean
        x = [(d_Q / problem.q_ref).reshape(size * n, r), (d_f / problem.f_ref[:, None]).reshape(size * m, r)]
        return np.concatenate(x)

    def determinant_sign(self, row: Array, row_lam: float) -> int:
        """Sign of the determinant of the bordered matrix; the modes that are eliminated contribute positive blocks."""
        return self._factor_with(row, row_lam).factors.sign
