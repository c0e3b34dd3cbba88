"""One implicit time step of a body with joints, exact for its linear modes, as a CasADi function.

The modes are propagated exactly under forces that are linear over the step. The joints' forces at its end move the
ports, which changes the forces: CasADi's Newton method closes that relation, and differentiates it by the implicit
function theorem, so that the derivative of the step is exact too.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
from scipy.linalg import expm

from hbm.aft.jointstep import joint_step, signals_of, values
from hbm.aft.steady import buffered
from models.jointed import JointedRig
from models.joints.law import Form, JointLaw, form, of_form
from models.structure import Array

SOLVED = 1e-7
"""Largest difference between joint forces and their laws after a step, in units of the excitation."""

Pattern = tuple[tuple[int, ...], bytes]
"""Shape of a matrix, and which of its entries are not zero."""

NEWTON = {"abstol": 1e-11, "abstolStep": 1e-14, "max_iter": 60, "error_on_fail": False}


@dataclass(frozen=True)
class Place:
    """Position of one joint in the vectors of a step.

    Attributes
    ----------
    forces, signals : slice
        Among the forces and the signals of all joints.
    memory, before : slice
        In the state: its internal states, and the signals of the sample before that its law uses.
    used : tuple of int
        Which signals those are.
    """

    forces: slice
    signals: slice
    memory: slice
    before: slice
    used: tuple[int, ...]


@dataclass(frozen=True)
class Layout:
    """Slices of the parts of a state: q, q', f, memory, signals.

    Attributes
    ----------
    modes, ports : int
    size : int
        Length of the state.
    joints : tuple of Place
    """

    modes: int
    ports: int
    size: int
    joints: tuple[Place, ...]

    @staticmethod
    def of(modes: int, joints: Sequence[JointLaw]) -> "Layout":
        """Layout of joints with such laws, one after another."""
        laws = [joint_step(law) for law in joints]
        used = [tuple(i - signals_of(w.ports) for i in w.reads if i >= signals_of(w.ports)) for w in laws]
        forces = _slices(w.ports for w in laws)
        signals = _slices(signals_of(w.ports) for w in laws)
        ports = sum(w.ports for w in laws)
        memory = _slices((w.states for w in laws), 2 * modes + ports)
        before = _slices(map(len, used), 2 * modes + ports + sum(w.states for w in laws))
        places = tuple(map(Place, forces, signals, memory, before, used))
        size = 2 * modes + ports + sum(w.states for w in laws) + sum(map(len, used))
        return Layout(modes, ports, size, places)

    @property
    def y(self) -> slice:
        """Displacements and velocities of the modes."""
        return slice(2 * self.modes)

    @property
    def f(self) -> slice:
        """The forces."""
        return slice(2 * self.modes, 2 * self.modes + self.ports)


@dataclass(frozen=True, eq=False)
class LinearStep:
    """Linear part of a step: the motion at its end, and the inputs of the joints there.

    Attributes
    ----------
    y_by_y, y_by_old, y_by_new : array
        (q, q') at the end, (2n, .), by (q, q') at the start and by the forces at the start and at the end.
    y_by_excitation : (2n, 3) array
        By the excitation before, now, and its rate now.
    s_by_y, s_by_old, s_by_new, s_by_excitation : array
        Signals of all joints one after another at the end, by (q, q') at the end and by the same forces.
    compliances : (joints,) array
        Of the body and of the step, that each joint's law takes into account.
    """

    y_by_y: Array
    y_by_old: Array
    y_by_new: Array
    y_by_excitation: Array
    s_by_y: Array
    s_by_old: Array
    s_by_new: Array
    s_by_excitation: Array
    compliances: Array

    @staticmethod
    def of(rig: JointedRig, dt: float, layout: Layout) -> "LinearStep":
        """Step of a rig."""
        s, n, m = rig.structure, rig.structure.n, rig.ports
        E, old, new = _propagated(s.omega_n, s.damping, dt)
        of_body, of_step = _counted(rig, new[:n], layout)
        folds = np.array([j.law.folds for j in rig.joints for _ in range(j.law.ports)], dtype=bool)
        of_rate = np.where(folds[:, None], 0.0, s.flexibility)
        nothing = np.zeros_like(s.joints)
        # a set-valued law takes what the step itself yields into account, in place of the motion
        u = (np.hstack([s.joints, nothing]), np.zeros((m, m)), s.flexibility - np.diag(of_body) - np.diag(of_step))
        speed = (np.hstack([nothing, s.joints]), -of_rate / dt, of_rate / dt)
        by_motion = np.hstack([-s.loads_inertia * s.omega_n**2, s.loads_damping - s.loads_inertia @ s.damping])
        load = (by_motion, np.zeros((len(by_motion), m)), s.loads_inertia @ s.joints.T + s.loads_by_joints)
        to_force, load_by_force = s.flexibility_to_force, s.loads_inertia @ s.excitation + s.loads_by_force
        zero = np.zeros_like(to_force)
        told = (
            np.column_stack([zero, to_force, zero]),
            np.column_stack([zero, zero, to_force]),
            np.column_stack([0.0 * load_by_force, load_by_force, 0.0 * load_by_force]),
        )
        # displacements, velocities and loads of all joints, put joint by joint
        ports = np.arange(m)
        order = [
            i for j, at in enumerate(layout.joints) for i in (*ports[at.forces], *(m + ports[at.forces]), 2 * m + j)
        ]
        by_y, by_old, by_new = (np.vstack(parts)[order] for parts in zip(u, speed, load, strict=True))
        first = [at.forces.start for at in layout.joints]
        return LinearStep(
            E,
            old @ s.joints.T,
            new @ s.joints.T,
            np.column_stack([old @ s.excitation, new @ s.excitation, np.zeros(2 * n)]),
            by_y,
            by_old,
            by_new,
            np.vstack(told)[order],
            (of_body + of_step)[first],
        )

    def signals(self, y: Any, f_old: Any, f: Any, F: Any) -> Any:
        """Signals at the end of a step; numbers or symbols, one column a step."""
        return self.s_by_y @ y + self.s_by_old @ f_old + self.s_by_new @ f + self.s_by_excitation @ F


class JointedStep:
    """The step of a rig at one time step.

    Forces are counted in units of the excitation's amplitude `level` within the Newton iteration.

    Attributes
    ----------
    layout : Layout
    """

    def __init__(self, rig: JointedRig, dt: float, level: float) -> None:
        self.rig, self.layout = rig, Layout.of(rig.structure.n, [j.law for j in rig.joints])
        self.linear = LinearStep.of(rig, dt, self.layout)
        self.environments = [np.array([dt, C]) for C in self.linear.compliances]
        self.unit = level or rig.excitation.amplitude  # forces are solved for in it

    def march(self, x: Array, told: Array) -> tuple[Array, Array]:
        """States after steps from a state, (steps, size), and the residual of each.

        Parameters
        ----------
        x : (size,) array
        told : (steps, 3) array
            Excitation before and after each step, and its rate after.
        """
        made_of, numbers = self._compiled
        now, F = np.array(x, dtype=float).ravel(), np.zeros(told.shape[1])
        inputs = [now, F, *numbers]
        evaluate, (after, residual) = buffered(_step(*made_of, "fast_newton"), inputs)
        X, residuals = np.empty((len(told), len(now))), np.empty(len(told))
        for k, F[:] in enumerate(told):
            evaluate()
            if not residual[0] < SOLVED:  # full steps lead nowhere: shorten them
                buffered(_step(*made_of, "newton"), inputs, [after, residual])[0]()
            X[k] = now[:] = after
            residuals[k] = residual[0]
        return X, residuals

    @cached_property
    def _compiled(self) -> tuple[tuple[tuple[Form, ...], int, tuple[Pattern, ...]], list[Array]]:
        """What decides the function of a step, see :func:`_step`, and the numbers that it is told."""
        of, joints = self.linear, self.rig.joints
        free = np.hstack([of.y_by_y, of.y_by_old, of.y_by_excitation])
        seen = of.s_by_y @ free + np.hstack([np.zeros_like(of.s_by_y), of.s_by_old, of.s_by_excitation])
        matrices = [free, of.y_by_new, seen, of.s_by_y @ of.y_by_new + of.s_by_new]
        own = np.concatenate([[self.unit], *self.environments, *(values(j.law) for j in joints)])
        made_of = tuple(form(j.law) for j in joints), self.rig.structure.n, tuple(map(_pattern, matrices))
        return made_of, [*(a.T[a.T != 0.0] for a in matrices), own]

    def jacobians(self, X: Array, X_next: Array, F: Array) -> Array:
        """Derivative of every step's state to that before, (steps, size, size).

        Parameters
        ----------
        X, X_next : (steps, size) array
            States before and after.
        F : (steps, 3) array
            As the step is told of the excitation.
        """
        layout, (x_by_x, x_by_f) = self.layout, self._with_given_forces(X, X_next, F)
        # what the forces at the end are by f = law(x, f): those rows hold the law's own derivatives until here
        gap = np.eye(layout.ports) - x_by_f[:, layout.f]
        f_by_x = np.linalg.solve(gap, x_by_x[:, layout.f])
        x_by_x[:, layout.f], x_by_f[:, layout.f] = 0.0, np.eye(layout.ports)
        return np.asarray(x_by_x + x_by_f @ f_by_x)

    def _with_given_forces(self, X: Array, X_next: Array, F: Array) -> tuple[Array, Array]:
        """State after each step by that before and by the forces at its end; in their rows, the laws' answers."""
        of, layout, N = self.linear, self.layout, len(X)
        signals = of.signals(X_next[:, layout.y].T, X[:, layout.f].T, X_next[:, layout.f].T, F.T)
        by_x, by_f = np.zeros((N, layout.size, layout.size)), np.zeros((N, layout.size, layout.ports))
        by_x[:, layout.y, layout.y], by_x[:, layout.y, layout.f] = of.y_by_y, of.y_by_old
        by_f[:, layout.y] = of.y_by_new
        s_by_x, s_by_f = of.s_by_y @ by_x[0, layout.y], of.s_by_y @ of.y_by_new + of.s_by_new
        s_by_x[:, layout.f] += of.s_by_old
        for joint, at, environment in zip(self.rig.joints, layout.joints, self.environments, strict=True):
            now = signals[at.signals].T
            before = np.zeros(now.shape)
            before[:, list(at.used)] = X[:, at.before]
            f, f_old, z = X_next[:, layout.f][:, at.forces], X[:, layout.f][:, at.forces], X[:, at.memory]
            sample = [np.ascontiguousarray(a) for a in (f, z, f_old, before, now, environment, values(joint.law))]
            evaluate, (slopes,) = buffered(_slopes(form(joint.law), at.used, N), sample)
            evaluate()
            ports, states = f.shape[1], z.shape[1]
            blocks = slopes.reshape(N, -1, ports + states).transpose(0, 2, 1)
            lengths = np.cumsum([ports, states, ports, len(at.used)])
            by_force, by_memory, by_old, by_before, by_signals = np.split(blocks, lengths, axis=2)
            answer_by_x, answer_by_f = by_signals @ s_by_x[at.signals], by_signals @ s_by_f[at.signals]
            answer_by_f[:, :, at.forces] += by_force
            answer_by_x[:, :, at.memory] += by_memory
            answer_by_x[:, :, layout.f][:, :, at.forces] += by_old
            answer_by_x[:, :, at.before] += by_before
            for whole, answer, told in ((by_x, answer_by_x, s_by_x), (by_f, answer_by_f, s_by_f)):
                whole[:, layout.f][:, at.forces] = answer[:, :ports]
                whole[:, at.memory] = answer[:, ports:]
                whole[:, at.before] = told[at.signals][list(at.used)]
        return by_x, by_f


def _pattern(matrix: Array) -> Pattern:
    return matrix.shape, (matrix != 0.0).tobytes()


def _symbol(name: str, pattern: Pattern) -> ca.SX:
    shape, entries = pattern
    return ca.SX.sym(name, ca.sparsify(ca.DM(np.frombuffer(entries, dtype=bool).reshape(shape))).sparsity())


@lru_cache(maxsize=32)
def _step(forms: tuple[Form, ...], modes: int, patterns: tuple[Pattern, ...], newton: str) -> ca.Function:
    """Solve the relation of one step at the joints, and go there.

    `(state, told, matrices..., numbers) -> (state, residual)`: matrices take (q, q'), forces and excitation before to
    (q, q') and to the signals after, each without the forces after and by them; numbers are the unit of the forces,
    the environments of the laws, and their parameters.
    """
    laws = [of_form(made_of) for made_of in forms]
    layout, steps = Layout.of(modes, laws), [joint_step(law) for law in laws]
    x, told, unknown = ca.SX.sym("x", layout.size), ca.SX.sym("told", 3), ca.SX.sym("f", layout.ports)
    matrices = [_symbol(name, pattern) for name, pattern in zip("ABCD", patterns, strict=True)]
    unit, environments = ca.SX.sym("unit"), [ca.SX.sym("environment", w.environment.numel()) for w in steps]
    numbers = [ca.SX.sym("p", w.p.numel()) for w in steps]
    f, f_old, start = unknown * unit, x[layout.f], ca.vertcat(x[layout.y], x[layout.f], told)
    y_free, y_by_f, s_free, s_by_f = matrices
    free = ca.SX.sym("free", s_free.size1())
    signals = free + s_by_f @ f
    forces, memory, seen = [], [], []
    for w, at, environment, p in zip(steps, layout.joints, environments, numbers, strict=True):
        now = signals[at.signals]
        earlier = ca.SX(now.numel(), 1)
        earlier[list(at.used)] = x[at.before]
        sample = [f[at.forces], x[at.memory], f_old[at.forces], earlier, now, environment, p]
        force, z = ca.Function("law", w.told, [w.force, w.z_new], {"cse": True})(*sample)
        forces.append(force)
        memory.append(z)
        seen.append(now[list(at.used)])
    gap = (f - ca.vertcat(*forces)) / unit
    own = ca.vertcat(unit, *environments, *numbers)
    relation = {"x": unknown, "p": ca.vertcat(x, free, s_by_f.nz[:], own), "g": gap}
    close = ca.rootfinder("close", newton, relation, NEWTON)
    given = [x, told, *matrices, own]
    begin = ca.Function("begin", given, [x[layout.f] / unit, s_free @ start])
    after = ca.vertcat(y_free @ start + y_by_f @ f, f, *memory, *seen)
    there = ca.Function("there", [unknown, free, *given], [after, ca.norm_inf(gap)], {"cse": True})
    inputs = [ca.MX.sym("input", part.sparsity()) for part in given]
    guess, s = begin(*inputs)
    solved = close(x0=guess, p=ca.vertcat(inputs[0], s, inputs[5].nz[:], inputs[6]))["x"]
    return ca.Function("step", inputs, list(there(solved, s, *inputs)))


@lru_cache(maxsize=64)
def _slopes(made_of: Form, used: tuple[int, ...], steps: int) -> ca.Function:
    """Derivatives of (force, memory) to (force, memory, force before, signals before that matter, signals), by step."""
    w = joint_step(of_form(made_of))
    to = ca.vertcat(w.f, w.z, w.f_before, w.before[list(used)], w.now)
    slope = ca.densify(ca.jacobian(ca.vertcat(w.force, w.z_new), to))
    one = ca.Function("slope", w.told, [slope], {"cse": True})
    return one.map("slopes", "serial", steps, [5, 6], [])  # all steps have the same environment and parameters


def _slices(lengths: Iterable[int], first: int = 0) -> list[slice]:
    """Parts of such lengths, one after another."""
    return [slice(*ends) for ends in pairwise(np.cumsum([first, *lengths]).tolist())]


def _counted(rig: JointedRig, new: Array, layout: Layout) -> tuple[Array, Array]:
    """Compliances of the body, and of the step, that laws take into account at their ports, (m,) each."""
    s = rig.structure
    of_body, of_step = np.zeros(rig.ports), np.zeros(rig.ports)
    yields = np.einsum("pn,nk,pk->p", s.joints, new, s.joints)
    for j, at in zip(rig.joints, layout.joints, strict=True):
        port = at.forces.start
        if j.law.folds:
            of_body[port] = max(float(s.flexibility[port, port]), 0.0)
        if j.law.set_valued:
            of_step[port] = yields[port]
    return of_body, of_step


def _propagated(omega_n: Array, damping: Array, dt: float) -> tuple[Array, Array, Array]:
    """Propagator (2n, 2n) of (q, q'), and what forces at the start and the end of a step do, (2n, n) each."""
    n = len(omega_n)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(omega_n**2), -damping]])
    B = np.vstack([np.zeros((n, n)), np.eye(n)])
    # first-order hold: the exponential of the system with the force and its slope beside the motion
    block = np.zeros((4 * n, 4 * n))
    block[: 2 * n, : 2 * n], block[: 2 * n, 2 * n : 3 * n] = A * dt, B * dt
    block[2 * n : 3 * n, 3 * n :] = np.eye(n)
    whole = expm(block)
    constant, ramp = whole[: 2 * n, 2 * n : 3 * n], whole[: 2 * n, 3 * n :]
    return whole[: 2 * n, : 2 * n], constant - ramp, ramp
