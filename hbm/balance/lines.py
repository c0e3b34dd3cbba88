"""Harmonic balance of a body with joints under a periodic force of many lines: thousands of harmonics, no dense matrix.

The modes are eliminated harmonic by harmonic; what is left are the forces at the joints, f = law(motion(f)). Newton's
method solves for these with fast Fourier transforms between lines and samples and a Krylov method (GMRES) for its step.
Its preconditioner is the linear structure with each joint replaced by the spring and dashpot that come nearest to its
force in the mean square (statistical linearisation), which also is where an iteration starts.

References
----------
T. M. Cameron, J. H. Griffin, J. Appl. Mech. 56 (1989) 149-154 (alternating frequency and time); Y. Saad, M. H. Schultz,
SIAM J. Sci. Stat. Comput. 7 (1986) 856-869 (GMRES); J. B. Roberts, P. D. Spanos, Random Vibration and Statistical
Linearization (1990).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from continuation import ConvergenceError
from hbm.balance.jointednewton import Modes
from hbm.balance.jointequations import Complex, JointEquations
from hbm.balance.krylov import solved
from hbm.balance.scaled import State
from hbm.fourier import Array, FourierBasis
from models.jointed import JointedRig

CLOSED = 1e-9
"""The forces balance when what they miss is this share of the largest."""

ITERATIONS, SHORTEST = 40, 1.0 / 64.0
"""Newton steps, and the shortest that is tried of one."""

FIRST, LONGER, SHORTEST_RAISE = 0.1, 1.5, 0.01
"""Share of the excitation from which it is raised, growth of the steps that succeed, and the shortest that is tried."""

STATISTICAL = 4
"""Times the start is linearised anew."""

INEXACT, EXACT = 1e-2, 1e-8
"""Accuracy of a step of Newton's method, and of derivatives, relative to the right side."""

KRYLOV, RESTARTS = 60, 5
"""Directions that GMRES keeps, and how often it begins anew."""


class LineBalance(JointEquations):
    """The balance of a rig with joints under a force of many lines.

    The mean of a motion of 0 Hz is held at zero: no channel sees it, and what moves it in a measurement (a suspension,
    modes below the band) is not in the rig.

    Parameters
    ----------
    rig : JointedRig
    basis : FourierBasis
    hz : float
        Base frequency, of which all lines are multiples [Hz].
    force : (2H+1,) array
        Coefficients of the excitation [N].
    """

    def __init__(self, rig: JointedRig, basis: FourierBasis, hz: float, force: Array) -> None:
        super().__init__(rig, basis, parameter="force", hz=hz, level=1.0)
        self.force_shape = force
        self.Omega = 2 * np.pi * hz

    @cached_property
    def modes(self) -> Modes:
        """The modes at the lines."""
        return Modes(self, self.Omega)

    @cached_property
    def yielding(self) -> Complex:
        """Motion at every port per force at every port, harmonic by harmonic, (H+1, m, m) [m/N]."""
        s = self.structure
        return self.modes.between(s.joints, s.joints) + self.flexibility

    @cached_property
    def signalled(self) -> list[Complex]:
        """Signals at each joint per force at every port, harmonic by harmonic, (H+1, 2 ports + 1, m)."""
        s, rate = self.structure, 1j * self.Omega * np.arange(self.basis.H + 1)[:, None, None]
        moved, between = self.modes.between(s.joints, s.joints), self.modes.between
        loads = rate**2 * between(s.loads_inertia, s.joints) + rate * between(s.loads_damping, s.joints)
        u, w, loads = moved + self.flexibility, moved + self.flexibility_of_rate, loads + s.loads_by_joints
        return [np.concatenate([u[:, at], w[:, at], loads[:, [j]]], axis=1) for j, at in enumerate(self.slices)]

    def state(self, f: Array, F: float = 1.0) -> State:
        """State in which the joints push with forces (2H+1, m), under a share of the excitation."""
        return State(self.modes.moved(self.modal_forces(f, F)), f, self.Omega, F)

    def law(self, f: Array, F: float = 1.0) -> "LinesHere":
        """Answer of the joints to the motion under forces (2H+1, m)."""
        state = self.state(f, F)
        signals = self.signals(state)
        answers = [
            self.basis.coefficients(j.forces(s, self.Omega)[0]) for j, s in zip(self.joints, signals, strict=True)
        ]
        return LinesHere(self, state, signals, np.hstack([np.zeros((self.basis.size, 0)), *answers]))

    def solved(self, f: Array | None = None) -> "LinesHere":
        """Steady state, from forces (2H+1, m) or from nothing: if need be with the excitation raised in steps.

        Raises
        ------
        ConvergenceError
            If it is not found.
        """
        if f is not None:
            return self._newton(self.law(f))
        try:
            return self._newton(self._linearized(1.0))
        except ConvergenceError:
            return self._raised()

    def _linearized(self, F: float) -> "LinesHere":
        """A state near the steady one, by statistical linearisation."""
        here = self.law(np.zeros((self.basis.size, len(self.own))), F)
        for _ in range(STATISTICAL):
            missed = here.answer[:, :, None] - here.held(here.state.T[:, :, None])
            here = self.law(here.preconditioned(missed)[:, :, 0], F)
        return here

    def _raised(self) -> "LinesHere":
        """Steady state with the excitation raised in steps, shorter ones where one fails."""
        step = FIRST
        here = self._newton(self._linearized(step))
        while here.state.F < 1.0:
            F = min(1.0, here.state.F + step)
            try:
                here, step = self._newton(self.law(here.state.T * F / here.state.F, F)), step * LONGER
            except ConvergenceError:
                step /= 2.0
                if step < SHORTEST_RAISE:
                    raise
        return here

    def _newton(self, here: "LinesHere") -> "LinesHere":
        for _ in range(ITERATIONS):
            if here.missed <= CLOSED * np.abs(here.answer).max(initial=0.0):
                return here
            here = self._nearer(here, here.followed((here.answer - here.state.T)[:, :, None], INEXACT)[:, :, 0])
        raise ConvergenceError(f"{self._failed}: forces miss their balance by {here.missed:.2g} N")

    def _nearer(self, here: "LinesHere", step: Array) -> "LinesHere":
        """A state that misses less, along a step."""
        length, before = 1.0, np.linalg.norm(here.answer - here.state.T)
        while length >= SHORTEST:
            there = self.law(here.state.T + length * step, here.state.F)
            if np.linalg.norm(there.answer - there.state.T) < before:
                return there
            length /= 2.0
        raise ConvergenceError(f"{self._failed}: no step of Newton's method brings it nearer")

    @property
    def _failed(self) -> str:
        return f"no steady state under the lines of {self.fixed_hz:.6g} Hz"


@dataclass(frozen=True, eq=False)
class LinesHere:
    """A state under the lines: signals at the joints and their answer (2H+1, m), which in balance is the forces."""

    problem: LineBalance
    state: State
    signals: list[Array]
    answer: Array

    @property
    def missed(self) -> float:
        """Largest coefficient that the forces miss [N]."""
        return float(np.abs(self.answer - self.state.T).max(initial=0.0))

    @cached_property
    def alike(self) -> list[Array | None]:
        """Slopes (ports, 2 ports + 1) of each joint that answers to all motions alike: a spring or a dashpot."""
        joints = zip(self.problem.joints, self.signals, strict=True)
        return [j.alike(s, self.problem.Omega) for j, s in joints]

    @cached_property
    def linearized(self) -> Complex:
        """Stiffness (H+1, m, m) of springs and dashpots that come nearest to the joints' forces [N/m]."""
        problem, m = self.problem, len(self.problem.own)
        rate = 1j * self.problem.Omega * np.arange(problem.basis.H + 1)[:, None, None]
        out = np.zeros((problem.basis.H + 1, m, m), dtype=complex)
        joints = zip(problem.joints, problem.slices, self.signals, self.alike, strict=True)
        for j, at, signals, slopes in joints:
            if slopes is None:
                moved = signals[1:, : j.ports]
                moving = problem.basis.derivative(signals[:, : j.ports])[1:] * problem.Omega
                both = np.hstack([moved, moving])
                size = np.linalg.norm(both, axis=0)
                size[size == 0.0] = 1.0
                slopes = (np.linalg.lstsq(both / size, self.answer[1:, at], rcond=None)[0] / size[:, None]).T
            out[:, at, at] = slopes[:, : j.ports] + rate * slopes[:, j.ports : 2 * j.ports]
        return out

    @cached_property
    def closed(self) -> Complex:
        """Forces at all ports per force put in at each, springs and dashpots answering for the joints, (H+1, m, m)."""
        return np.asarray(np.linalg.inv(np.eye(len(self.problem.own)) - self.linearized @ self.problem.yielding))

    def _times(self, matrices: Complex, forces: Array) -> Array:
        basis = self.problem.basis
        return basis.real(matrices @ basis.complex(forces))

    def preconditioned(self, forces: Array) -> Array:
        """Forces (2H+1, m, c) with which springs and dashpots in place of the joints answer to what is missed."""
        return self._times(self.closed, forces)

    def held(self, forces: Array) -> Array:
        """Answer of the same springs and dashpots to the motion that forces (2H+1, m, c) make."""
        return self._times(self.linearized @ self.problem.yielding, forces)

    def answered(self, change: Sequence[Array]) -> Array:
        """Change (2H+1, m, c) of the joints' answer with the signals at each, (2H+1, 2 ports + 1, c)."""
        joints = zip(self.problem.joints, self.signals, change, strict=True)
        return np.concatenate([j.pushed(s, self.problem.Omega, d) for j, s, d in joints], axis=1)

    @cached_property
    def _other(self) -> list[tuple[int, slice, Complex, Complex]]:
        """Joints that these only stand for: number, ports, signals and answer of springs and dashpots to a force."""
        problem, held = self.problem, self.linearized @ self.problem.yielding @ self.closed
        joints = enumerate(zip(problem.slices, self.alike, strict=True))
        return [(j, at, problem.signalled[j] @ self.closed, held[:, at]) for j, (at, same) in joints if same is None]

    def followed(self, missed: Array, accuracy: float = EXACT) -> Array:
        """Changes of the forces that balance what is missed, (2H+1, m, c), all joints answering to each.

        With springs and dashpots in place of the joints it is what is missed that is looked for, at those joints alone
        that these only stand for.

        Raises
        ------
        ConvergenceError
            If GMRES does not get there.
        """
        there, out = np.flatnonzero(missed.any(axis=(0, 1))), np.zeros_like(missed)
        if not len(there):
            return out
        basis, right = self.problem.basis, missed[:, :, there]
        own = np.concatenate([np.arange(at.start, at.stop) for _, at, _, _ in self._other] or [np.arange(0)])

        def unlike(forces: Array) -> Array:
            """What joints answer to forces (2H+1, m, c) otherwise than springs and dashpots, (2H+1, own, c)."""
            amplitudes, found = basis.complex(forces), []
            for j, _, seen, held in self._other:
                joint, change = self.problem.joints[j], basis.real(seen @ amplitudes)
                found.append(joint.pushed(self.signals[j], self.problem.Omega, change) - basis.real(held @ amplitudes))
            return np.concatenate(found, axis=1)

        def whole(rows: Array) -> Array:
            forces = np.zeros_like(right)
            forces[:, own] = rows.T.reshape(len(right), len(own), -1)
            return forces

        def unanswered(rows: Array) -> Array:
            return rows - self._rows(unlike(whole(rows)))

        reached, found = True, right.copy()
        if len(own):
            again = RESTARTS if accuracy < INEXACT else 1  # a step that is not near is shortened, or the force raised
            known = right.copy()
            known[:, own] = 0.0
            known_rows = self._rows(right[:, own] + (unlike(known) if known.any() else 0.0))
            rows, reached = solved(unanswered, np.asarray, known_rows, accuracy, KRYLOV, again)
            found[:, own] = rows.T.reshape(len(right), len(own), -1)
        if not reached and accuracy < INEXACT:
            raise ConvergenceError(
                f"no derivative under the lines of {self.problem.fixed_hz:.6g} Hz: GMRES does not end"
            )
        out[:, :, there] = self.preconditioned(found)
        return out

    @staticmethod
    def _rows(forces: Array) -> Array:
        """Forces (2H+1, m, c) as vectors (c, ...)."""
        return forces.reshape(-1, forces.shape[2]).T
