"""One implicit time step of a body with joints, exact for its linear modes, as a CasADi function.

The modes are propagated exactly under forces that are linear over the step. The joints' forces at its end move the
ports, which changes the forces: CasADi's Newton method closes that relation, and differentiates it by the implicit
function theorem, so that the derivative of the step is exact too.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.linalg import expm

from hbm.aft.jointstep import JointStep, signals_of, values
from models.jointed import JointedRig
from models.structure import Array

NEWTON = {"abstol": 1e-11, "abstolStep": 1e-14, "max_iter": 60, "error_on_fail": False}


@dataclass(frozen=True)
class Layout:
    """Where the parts of a state (q, q', f, memory, signals) stand in it.

    Attributes
    ----------
    modes, ports : int
    memory, signals : tuple of int
        For each joint: internal states, and signals of the sample before that its law uses.
    """

    modes: int
    ports: int
    memory: tuple[int, ...]
    signals: tuple[tuple[int, ...], ...]

    @property
    def size(self) -> int:
        """Length of the state."""
        return 2 * self.modes + self.ports + sum(self.memory) + sum(map(len, self.signals))

    @property
    def f(self) -> slice:
        """The forces."""
        return slice(2 * self.modes, 2 * self.modes + self.ports)

    def split(self, x: ca.MX) -> tuple[ca.MX, ca.MX, ca.MX, list[ca.MX], list[ca.MX]]:
        """Modes (q, q'), forces, and memory and signals before of each joint."""
        lengths = [2 * self.modes, self.ports, *self.memory, *map(len, self.signals)]
        parts = ca.vertsplit(x, np.cumsum([0, *lengths]).tolist())
        joints = len(self.memory)
        return parts[0], x[self.modes : 2 * self.modes], parts[1], parts[2 : 2 + joints], parts[2 + joints :]


class JointedStep:
    """The step of a rig at one time step.

    Forces are counted in units of the excitation's amplitude `level` within the Newton iteration.

    Attributes
    ----------
    layout : Layout
    function : casadi.Function
        `(state, (F before, F now, F' now)) -> (state, residual)`.
    jacobian : casadi.Function
        Derivative of the new state to the old one, same inputs.
    """

    def __init__(self, rig: JointedRig, dt: float, level: float) -> None:
        s, n, m = rig.structure, rig.structure.n, rig.ports
        laws = [JointStep(j.law) for j in rig.joints]
        used = [tuple(i - signals_of(law.ports) for i in law.reads if i >= signals_of(law.ports)) for law in laws]
        self.layout = Layout(n, m, tuple(law.states for law in laws), tuple(used))
        self.rig = rig
        E, old, new = _propagated(s.omega_n, s.damping, dt)
        own, folded = self._own(new[:n])
        x, F = ca.MX.sym("x", self.layout.size), ca.MX.sym("F", 3)
        y, _, f_old, memory, before = self.layout.split(x)
        self.unit = level or rig.excitation.amplitude  # forces are solved for in it
        unknown = ca.MX.sym("f", m)
        f = unknown * self.unit

        def modal(forces: ca.MX, excitation: ca.MX) -> ca.MX:
            return ca.DM(s.joints.T) @ forces + ca.DM(s.excitation) * excitation

        g = modal(f, F[1])
        y_new = ca.DM(E) @ y + ca.DM(old) @ modal(f_old, F[0]) + ca.DM(new) @ g
        q, v = y_new[:n], y_new[n:]
        f_rate = (f - f_old) / dt
        beyond = ca.DM(s.flexibility - np.diag(own))
        folds = np.concatenate([np.full(j.law.ports, j.law.folds) for j in rig.joints])
        of_rate = ca.DM(np.where(folds[:, None], 0.0, s.flexibility))
        # a set-valued law takes what the step itself yields into account, in place of the motion
        u = ca.DM(s.joints) @ q + beyond @ f + ca.DM(s.flexibility_to_force) * F[1] - ca.DM(folded) * f
        speed = ca.DM(s.joints) @ v + of_rate @ f_rate + ca.DM(s.flexibility_to_force) * F[2]
        acceleration = g - ca.DM(s.damping) @ v - ca.DM(s.omega_n**2) * q
        load = ca.DM(s.loads_inertia) @ acceleration + ca.DM(s.loads_damping) @ v
        load += ca.DM(s.loads_by_joints) @ f + ca.DM(s.loads_by_force) * F[1]
        forces, memory_new, seen, at = [], [], [], 0
        for j, law in enumerate(laws):
            here = slice(at, at + law.ports)
            now = ca.vertcat(u[here], speed[here], load[j])
            earlier = ca.MX.zeros(signals_of(law.ports))
            for place, i in enumerate(used[j]):
                earlier[i] = before[j][place]
            answer = ca.Function(
                "law",
                [law.f, law.z, law.f_before, law.before, law.now, law.environment, law.p],
                [law.force, law.z_new],
                {"cse": True},
            )
            environment = ca.DM([dt, own[at] + folded[at]])
            force, z_new = answer(
                f[here], memory[j], f_old[here], earlier, now, environment, ca.DM(values(rig.joints[j].law))
            )
            forces.append(force)
            memory_new.append(z_new)
            seen.append(ca.vertcat(*(now[i] for i in used[j])) if used[j] else ca.MX(0, 1))
            at += law.ports
        gap = (f - ca.vertcat(*forces)) / self.unit
        close = ca.rootfinder("close", "newton", {"x": unknown, "p": ca.vertcat(x, F), "g": gap}, NEWTON)
        after = ca.vertcat(y_new, f, *memory_new, *seen)
        there = ca.Function("there", [unknown, x, F], [after, ca.norm_inf(gap)])
        x_in, F_in = ca.MX.sym("x", self.layout.size), ca.MX.sym("F", 3)
        solved = close(x0=x_in[self.layout.f] / self.unit, p=ca.vertcat(x_in, F_in))["x"]
        x_out, residual = there(solved, x_in, F_in)
        self.function = ca.Function("step", [x_in, F_in], [x_out, residual])
        slope = ca.Function(
            "slope",
            [unknown, x, F],
            [ca.jacobian(gap, unknown), ca.jacobian(gap, x), ca.jacobian(after, unknown), ca.jacobian(after, x)],
        )
        self._slopes = slope

    def _own(self, new: Array) -> tuple[Array, Array]:
        """Compliances of the body, and of the step, that laws take into account at their ports, (m,) each."""
        s = self.rig.structure
        own, folded, at = np.zeros(len(s.flexibility)), np.zeros(len(s.flexibility)), 0
        of_step = np.einsum("pn,nk,pk->p", s.joints, new, s.joints)
        for j in self.rig.joints:
            if j.law.folds:
                own[at] = max(float(s.flexibility[at, at]), 0.0)
            if j.law.set_valued:
                folded[at] = of_step[at]
            at += j.law.ports
        return own, folded

    def jacobians(self, X: Array, X_next: Array, F: Array) -> Array:
        """Derivative of every step's state to that before, (steps, size, size).

        Parameters
        ----------
        X, X_next : (steps, size) array
            States before and after.
        F : (steps, 3) array
            As the step is told of the excitation.
        """
        mapped = self._slopes.map(len(X))
        by = [np.asarray(part.full()) for part in mapped((X_next[:, self.layout.f] / self.unit).T, X.T, F.T)]
        gap_f, gap_x, out_f, out_x = (part.reshape(part.shape[0], len(X), -1).transpose(1, 0, 2) for part in by)
        return np.asarray(out_x - out_f @ np.linalg.solve(gap_f, gap_x))


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
