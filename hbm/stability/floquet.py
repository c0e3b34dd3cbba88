"""Monodromy of a disturbance of a harmonic balance solution: of the modes, and of all that the friction law remembers.

The balance is linearised sample by sample, as the time integration would be, without integrating anything: each mode
is propagated exactly under forces that are linear from sample to sample, and friction follows by the derivatives of the
law at the samples of the balance, its internal states included. Friction of a sample moves the contact, which changes
friction: with a force at a single point that is one division per sample. The product of the steps over a period is the
monodromy of the state (q, q', T, z).

Hill's matrix of the balance with the law's periodic slopes is not that: it closes the loop of the law over each period,
although a disturbance that grows or fades does not return to where it started. It holds at the multiplier 1 only, where
folds are; :mod:`hbm.stability.hill` does better.
"""

from collections.abc import Callable, Iterable, Iterator
from functools import cached_property
from itertools import chain

import numpy as np
import numpy.typing as npt

from hbm.aft.force import LawSteps
from hbm.aft.recurrence import monodromy
from hbm.balance.equations import Balance
from hbm.balance.scaled import State
from hbm.fourier import Array
from hbm.integration.propagation import propagators, weights

Complex = npt.NDArray[np.complex128]
Modes = tuple[Array, Array, Array]
"""Propagator (2n, 2n) of the motion, and what it follows the force at both ends of a step by, (2n, 1) each."""

HELD = 50_000
"""Numbers in the steps that are held at once: what stays in a processor's cache, and what memory is not asked for again
and again."""


def _check(problem: Balance) -> None:
    name = problem.rig.name
    if problem.clamp is not None:
        raise ValueError(f"stability: {name} has a clamp that slips; must have none, or a joint at slope(0) for it")
    if problem.dynamic_lagrangian:
        raise ValueError(
            f"stability: {name} is rigid where {problem.rig.contact.law.name} sticks; "
            "must have residual_compliance = true, or a law that yields"
        )


class Disturbance:
    """A disturbance (q, q', T, states) of a solution of a balance, from sample to sample.

    Raises
    ------
    ValueError
        If the clamp slips: its friction is not among the states. If nothing yields where a set-valued law sticks: its
        force jumps at instants that move with the disturbance, which samples do not see.
    """

    def __init__(self, problem: Balance, state: State) -> None:
        _check(problem)
        self.problem, self.state = problem, state
        self.kin = problem.kinematics(state)
        self.law: LawSteps = problem.law.steps(self.kin.signals, state.Omega, problem.environment)

    @cached_property
    def _slip(self) -> tuple[Array, Array]:
        """du/dq = c - G q and its rate, (N_t, n)."""
        s, basis = self.problem.structure, self.problem.basis
        direction = s.slip_row - basis.synthesis @ self.kin.Gq
        return direction, -self.state.Omega * (basis.synthesis @ basis.derivative(self.kin.Gq))

    @cached_property
    def _tangent(self) -> tuple[Array, Array]:
        """What the forces on modes, and last on the support, lose with (q, q') at held friction, (N_t, n+1, 2n)."""
        s, n = self.problem.structure, self.problem.structure.n
        lost = np.zeros((self.problem.basis.N_t, n + 1, 2 * n))
        if self.kin.pull is not None:
            lost[:, :n, :n] += self.law.T[:, None, None] * s.shortening
        if self.problem.elements is not None:
            force = self.state.F * self.problem.force_shape
            by_q, by_v = self.problem.elements.slopes_in_time(self.state.Q, self.state.Omega, force)
            lost[:, :, :n] -= by_q
            lost[:, :, n:] -= by_v
        return lost[:, :n], lost[:, n]

    @cached_property
    def _unsupported(self) -> Array:
        """What the reaction gains with (q, q') by what forces lose, (N_t, 2n)."""
        s, n = self.problem.structure, self.problem.structure.n
        if self.problem.elements is not None:
            on_modes, on_support = self._tangent
            return np.asarray(on_support - np.tensordot(on_modes, s.reaction.inertia, axes=(1, 0)))
        gained = np.zeros((self.problem.basis.N_t, 2 * n))
        if self.kin.pull is not None:
            gained[:, :n] = np.outer(-self.law.T, s.reaction.inertia @ s.shortening)
        return gained

    @cached_property
    def _signals(self) -> tuple[Array, Array]:
        """Derivatives of u, v, rho, eta to (q, q'), (N_t, 4, 2n), and to T, (N_t, 4)."""
        problem, n = self.problem, self.problem.structure.n
        s, r = problem.structure, problem.structure.reaction
        direction, turning = self._slip
        seen, by_T = np.zeros((problem.basis.N_t, 4, 2 * n)), np.zeros((problem.basis.N_t, 4))
        seen[:, 0, :n] = seen[:, 1, n:] = direction
        seen[:, 1, :n] = turning
        if r.varies:
            seen[:, 2] = self._unsupported
            seen[:, 2, :n] += r.stiffness - r.inertia * s.omega_n**2
            seen[:, 2, n:] += r.damping - r.inertia * s.damping
            seen[:, 3, :n] = r.stretch
            by_T[:, 2] = direction @ r.inertia
        return seen, by_T

    @property
    def _size(self) -> int:
        """Of the state."""
        return int(2 * self.problem.structure.n + 1 + self.law.by_states.shape[2])

    def _modes(self, stride: int) -> Modes:
        """Over so many samples."""
        problem, n = self.problem, self.problem.structure.n
        dt = 2 * np.pi / (self.state.Omega * problem.basis.N_t) * stride
        E = propagators(problem.structure, self.state.Omega, dt)
        _, w = weights(E, dt, None)
        free, i = np.zeros((2 * n, 2 * n)), np.arange(n)
        for a in (0, 1):
            for b in (0, 1):
                free[a * n + i, b * n + i] = E[:, a, b]
        old, new = (np.concatenate([w[f"q_{name}"], w[f"v_{name}"]])[:, None] for name in ("old", "new"))
        return free, old, new

    def _per_force(self, modes: Modes, now: slice) -> tuple[Array, Array]:
        """(q, q') at samples per T there, and per T at those before, (N, 2n) each; elements answer later."""
        n, direction, (_, old, new) = self.problem.structure.n, self._slip[0][now], modes
        if self.problem.elements is not None:
            return np.tile(direction, 2) * new[:, 0], np.tile(_before(direction), 2) * old[:, 0]
        # of the force at each end, in one product: what it moves, and what T at the end takes of that
        pushes, i = np.zeros((n, 2, 2, 2 * n)), np.arange(n)
        taken = np.tile(self.problem.structure.shortening, 2) * new[:, 0]
        for k, weight in enumerate((new[:, 0], old[:, 0])):
            pushes[i, k, 0, i], pushes[i, k, 0, n + i] = weight[:n], weight[n:]
            pushes[:, k, 1] = weight[:n, None] * taken
        moved = (direction @ pushes.reshape(n, -1)).reshape(-1, 2, 2, 2 * n)
        T, before = self.law.T[now, None], _before(moved[:, 1])
        return moved[:, 0, 0] - T * moved[:, 0, 1], before[:, 0] - T * before[:, 1]

    def _driven(self, modes: Modes, now: slice) -> Callable[[slice], tuple[Array, Array]]:
        """Of some samples: (q, q') from (q, q', T) at those before, in (N, size, size), and per T there, (N, 2n)."""
        n, size = self.problem.structure.n, self._size
        motion, (free, old, new) = slice(0, 2 * n), modes
        per_T, per_T_before = self._per_force(modes, now)
        if self.problem.elements is not None:
            lost = self._tangent[0][now]
            lost_before = _before(lost)

            def answering(k: slice) -> tuple[Array, Array]:
                J = np.zeros((len(per_T[k]), size, size))
                J[:, motion, motion], J[:, motion, 2 * n] = free, per_T_before[k]
                return J, _implicit(J[:, motion, : 2 * n + 1], per_T[k], lost[k], lost_before[k], old, new)

            return answering
        G, T = self.problem.structure.shortening, self.law.T[now]
        # what T shortens at the end of a step is taken of the motion without it: dt^2 T G is small beside 1
        parts = np.zeros((3, size, size))
        parts[0, motion, motion] = free
        parts[1, motion, :n] = -old * np.tile(G, (2, 1))
        parts[2, motion, motion] = -new * np.tile(G @ free[:n], (2, 1))
        shares = np.column_stack([np.ones_like(T), _before(T), T])

        def shortened(k: slice) -> tuple[Array, Array]:
            J = (shares[k] @ parts.reshape(3, -1)).reshape(-1, size, size)
            J[:, motion, 2 * n] = per_T_before[k]
            return J, per_T[k]

        return shortened

    def _told(self, now: slice) -> Array:
        """What the law makes of the state at the samples before, their motion since left out, (N, 1 + n_z, size)."""
        n, by_states = self.problem.structure.n, self.law.by_states[now]
        told = np.zeros((*by_states.shape[:2], self._size))
        told[:, :, 2 * n + 1 :] = by_states
        if self.law.by_signals_before.any():
            by_signals, (seen, seen_T) = self.law.by_signals_before[now], self._signals
            told[:, :, : 2 * n] = by_signals @ _before(seen[now])
            told[:, :, 2 * n] = _times(by_signals, _before(seen_T[now]))
        return told

    def _blocks(self, stride: int) -> Iterator[Array]:
        """Derivative of the state at every so many samples to that at those before, in blocks (N, size, size)."""
        n, now = self.problem.structure.n, slice(stride - 1, None, stride)
        by_signals, (seen, seen_T) = self.law.by_signals[now], self._signals
        driven, told = self._driven(self._modes(stride), now), self._told(now)
        by_motion = by_signals @ seen[now]  # (N, 1 + n_z, 2n)
        by_T_alone = _times(by_signals, seen_T[now])
        N = len(told)
        length = -(-N // -(-N * self._size**2 // HELD))
        for k in (slice(start, start + length) for start in range(0, N, length)):
            J, per_T = driven(k)  # motion without T of the sample itself
            known = by_motion[k] @ J[:, : 2 * n]  # (N, 1 + n_z, size)
            known += told[k]
            # T = known + by_T T
            by_T = _times(by_motion[k], per_T) + by_T_alone[k]
            T = known[:, 0] / (1.0 - by_T[:, :1])
            J[:, 2 * n + 1 :] = known[:, 1:]
            J += np.einsum("ki,kj->kij", np.hstack([per_T, np.ones((len(J), 1)), by_T[:, 1:]]), T)
            yield J

    @cached_property
    def _by_sample(self) -> list[Array]:
        return list(self._blocks(1))

    @property
    def monodromy(self) -> Array:
        """Derivative of the state (q, q', T, states) after a period to that before, (size, size).

        The product of the steps is accurate to second order. Where the law remembers nothing, it is extrapolated to
        fourth from steps of two samples (Richardson).
        """
        few = self.problem.basis.N_t * self._size**2 <= HELD  # they are kept, for motions
        fine = _product(self._by_sample if few else self._blocks(1))
        if self.law.remembers or self.problem.basis.N_t % 2:
            return fine
        return np.asarray((4.0 * fine - _product(self._blocks(2))) / 3.0)

    def motion(self, starts: Complex) -> Complex:
        """Disturbances (q, q', T, states) at the samples from those at the sample before the first.

        Parameters
        ----------
        starts : (size, m) array

        Returns
        -------
        (N_t, size, m) array
        """
        m = starts.shape[1]
        y = np.hstack([starts.real, starts.imag])  # steps are real
        out = np.empty((self.problem.basis.N_t, *y.shape))
        for k, step in enumerate(chain.from_iterable(self._by_sample)):
            y = np.matmul(step, y, out=out[k])
        return np.asarray(out[:, :, :m] + 1j * out[:, :, m:])

    @property
    def rate(self) -> Array:
        """Matrix A of (q, q')' = A (q, q') at the samples, for a law that remembers nothing, (N_t, 2n, 2n)."""
        s, n = self.problem.structure, self.problem.structure.n
        A = np.zeros((self.problem.basis.N_t, 2 * n, 2 * n))
        A[:, :n, n:] = np.eye(n)
        A[:, n:] = self.forces(np.broadcast_to(np.eye(2 * n, dtype=complex), A.shape), 1.0).real
        A[:, n:, :n] -= np.diag(s.omega_n**2)
        A[:, n:, n:] -= np.diag(s.damping)
        return A

    def forces(self, y: Complex, kept: complex) -> Complex:
        """Forces on the modes that follow motions of the period, (N_t, n, m).

        Parameters
        ----------
        y : (N_t, 2n, m) array
            Disturbances of (q, q'), periodic.
        kept : complex
            Share that remains of the sample before: exp(-lambda dt) for disturbances times exp(lambda t).
        """
        law, (seen, seen_T) = self.law, self._signals
        signals, before = seen @ y, kept * np.roll(y, 1, axis=0)
        # T = known + by_T T + by_T_before T before + by_states z before
        by_T = law.by_signals @ seen_T[:, :, None]
        driven = law.by_signals @ signals + law.by_signals_before @ (np.roll(seen, 1, axis=0) @ before)
        back = np.concatenate([law.by_signals_before @ np.roll(seen_T, 1, axis=0)[:, :, None], law.by_states], axis=2)
        gain = 1.0 / (1.0 - by_T[:, :1])
        driven = np.concatenate([driven[:, :1] * gain, driven[:, 1:] + by_T[:, 1:] * gain * driven[:, :1]], axis=1)
        back = np.concatenate([back[:, :1] * gain, back[:, 1:] + by_T[:, 1:] * gain * back[:, :1]], axis=1)
        T = _periodic(kept * back, driven)[:, :1]
        return np.asarray(self._slip[0][:, :, None] * T - self._tangent[0] @ y)


def _product(blocks: Iterable[Array]) -> Array:
    """Product of the steps of a period, (size, size)."""
    return monodromy(np.stack([monodromy(block) for block in blocks]))


def _before(along: Array) -> Array:
    """What was at the sample before, (N, ...), of what is at the samples of a period."""
    return np.concatenate([along[-1:], along[:-1]])


def _times(matrices: Array, vectors: Array) -> Array:
    """Products (N, m) of matrices (N, m, n) and vectors (N, n), in less than half the time of `@`."""
    return np.asarray(np.einsum("kij,kj->ki", matrices, vectors))


def _implicit(Y: Array, per_T: Array, lost: Array, lost_before: Array, old: Array, new: Array) -> Array:
    """Take of motions `Y`, in place, and per T the forces (N, n, 2n) that motion at both ends of the steps takes."""
    n = lost.shape[1]
    Y[:, :, : 2 * n] -= old * np.tile(lost_before, (1, 2, 1))
    free = np.concatenate([Y, per_T[:, :, None]], axis=2)
    forces = np.linalg.solve(np.eye(n) + lost[:, :, :n] * new[:n, 0] + lost[:, :, n:] * new[n:, 0], lost @ free)
    free -= new * np.tile(forces, (1, 2, 1))
    Y[:] = free[:, :, :-1]
    return free[:, :, -1]


def _periodic(back: Complex, driven: Complex) -> Complex:
    """Periodic x_k = back_k x_{k-1} + driven_k, (N, size, m)."""
    size, m = driven.shape[1:]
    x = np.eye(size, m + size, m, dtype=complex)  # from nothing, and from each state undriven
    for step, push in zip(back, driven, strict=True):
        x = step @ x
        x[:, :m] += push
    x = np.linalg.solve(np.eye(size, dtype=complex) - x[:, m:], x[:, :m])
    out = np.empty(driven.shape, dtype=complex)
    for k, (step, push) in enumerate(zip(back, driven, strict=True)):
        out[k] = x = step @ x + push
    return out
