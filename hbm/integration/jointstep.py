"""One implicit time step of a body with joints, exact for its linear modes, as a CasADi function.

The modes are propagated exactly under forces that are linear over the step. The joints' forces at its end move the
ports, which changes the forces: CasADi's Newton method closes that relation, and differentiates it by the implicit
function theorem, so that the derivative of the step is exact too.
"""

from dataclasses import dataclass
from itertools import pairwise

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


@dataclass(frozen=True, eq=False)
class LinearStep:
    """What of a step is linear: the motion at its end, and what the joints see there.

    Attributes
    ----------
    y_by_y, y_by_old, y_by_new : array
        (q, q') at the end, (2n, .), by (q, q') at the start and by the forces at the start and at the end.
    y_by_excitation : (2n, 3) array
        By the excitation before, now, and its rate now.
    s_by_y, s_by_old, s_by_new, s_by_excitation : array
        Signals of all joints one after another at the end, by (q, q') at the end and by the same forces.
    """

    y_by_y: Array
    y_by_old: Array
    y_by_new: Array
    y_by_excitation: Array
    s_by_y: Array
    s_by_old: Array
    s_by_new: Array
    s_by_excitation: Array

    @staticmethod
    def of(rig: JointedRig, dt: float) -> tuple["LinearStep", list[tuple[float, float]]]:
        """Step of a rig; and of each joint the compliances of the body and of the step that its law counts in."""
        s, n = rig.structure, rig.structure.n
        E, old, new = _propagated(s.omega_n, s.damping, dt)
        own, folded = _folded(rig, new[:n])
        folds = np.concatenate([np.full(j.law.ports, j.law.folds) for j in rig.joints])
        of_rate = np.where(folds[:, None], 0.0, s.flexibility)
        nothing, m = np.zeros_like(s.joints), rig.ports
        # a set-valued law takes what the step itself yields into account, in place of the motion
        u = (np.hstack([s.joints, nothing]), np.zeros((m, m)), s.flexibility - np.diag(own) - np.diag(folded))
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
        order, at = [], 0
        for j, joint in enumerate(rig.joints):
            here = range(at, at + joint.law.ports)
            order += [*here, *(m + i for i in here), 2 * m + j]
            at += joint.law.ports
        by_y, by_old, by_new = (np.vstack(parts)[order] for parts in zip(u, speed, load, strict=True))
        linear = LinearStep(
            E,
            old @ s.joints.T,
            new @ s.joints.T,
            np.column_stack([old @ s.excitation, new @ s.excitation, np.zeros(2 * n)]),
            by_y,
            by_old,
            by_new,
            np.vstack(told)[order],
        )
        firsts = np.cumsum([0, *(j.law.ports for j in rig.joints)])[:-1]
        return linear, [(float(own[i]), float(folded[i])) for i in firsts]


class JointedStep:
    """The step of a rig at one time step.

    Forces are counted in units of the excitation's amplitude `level` within the Newton iteration.

    Attributes
    ----------
    layout : Layout
    function : casadi.Function
        `(state, (F before, F now, F' now)) -> (state, residual)`.
    """

    def __init__(self, rig: JointedRig, dt: float, level: float) -> None:
        self.rig, self.laws = rig, [JointStep(j.law) for j in rig.joints]
        used = [tuple(i - signals_of(w.ports) for i in w.reads if i >= signals_of(w.ports)) for w in self.laws]
        self.layout = Layout(rig.structure.n, rig.ports, tuple(w.states for w in self.laws), tuple(used))
        self.linear, compliances = LinearStep.of(rig, dt)
        self.environments = [ca.DM([dt, own + folded]) for own, folded in compliances]
        self.unit = level or rig.excitation.amplitude  # forces are solved for in it
        self.function = self._function()

    def _function(self) -> ca.Function:
        """Solve the relation of one step at the joints, and go there."""
        of, dm = self.linear, ca.DM
        x, F = ca.MX.sym("x", self.layout.size), ca.MX.sym("F", 3)
        y, _, f_old, memory, before = self.layout.split(x)
        unknown = ca.MX.sym("f", self.layout.ports)
        f = unknown * self.unit
        y_new = dm(of.y_by_y) @ y + dm(of.y_by_old) @ f_old + dm(of.y_by_new) @ f + dm(of.y_by_excitation) @ F
        signals = dm(of.s_by_y) @ y_new + dm(of.s_by_old) @ f_old + dm(of.s_by_new) @ f
        signals += dm(of.s_by_excitation) @ F
        forces, memory_new, seen = [], [], []
        for j, (law, (here, told)) in enumerate(zip(self.laws, self._places(), strict=True)):
            now, used = signals[told], self.layout.signals[j]
            earlier = ca.MX.zeros(signals_of(law.ports))
            for place, i in enumerate(used):
                earlier[i] = before[j][place]
            given = [f[here], memory[j], f_old[here], earlier, now, self.environments[j]]
            force, z_new = self._answer(j)(*given, ca.DM(values(self.rig.joints[j].law)))
            forces.append(force)
            memory_new.append(z_new)
            seen.append(ca.vertcat(*(now[i] for i in used)) if used else ca.MX(0, 1))
        gap = (f - ca.vertcat(*forces)) / self.unit
        close = ca.rootfinder("close", "newton", {"x": unknown, "p": ca.vertcat(x, F), "g": gap}, NEWTON)
        after = ca.vertcat(y_new, f, *memory_new, *seen)
        there = ca.Function("there", [unknown, x, F], [after, ca.norm_inf(gap)])
        solved = close(x0=x[self.layout.f] / self.unit, p=ca.vertcat(x, F))["x"]
        return ca.Function("step", [x, F], list(there(solved, x, F)))

    def _places(self) -> list[tuple[slice, slice]]:
        """Of each joint, where its forces and its signals stand among those of all."""
        ports = np.cumsum([0, *(w.ports for w in self.laws)]).tolist()
        signals = np.cumsum([0, *(signals_of(w.ports) for w in self.laws)]).tolist()
        pairs = zip(pairwise(ports), pairwise(signals), strict=True)
        return [(slice(*of_ports), slice(*of_signals)) for of_ports, of_signals in pairs]

    def _answer(self, j: int) -> ca.Function:
        """Force and memory of a law as it is told."""
        w = self.laws[j]
        inputs = [w.f, w.z, w.f_before, w.before, w.now, w.environment, w.p]
        return ca.Function("law", inputs, [w.force, w.z_new], {"cse": True})

    def _slope(self, j: int) -> ca.Function:
        """Derivative of (force, memory) to (force, memory, force before, signals before that matter, signals)."""
        w, used = self.laws[j], list(self.layout.signals[j])
        to = ca.vertcat(w.f, w.z, w.f_before, w.before[used], w.now)
        inputs = [w.f, w.z, w.f_before, w.before, w.now, w.environment, w.p]
        slope = ca.densify(ca.jacobian(ca.vertcat(w.force, w.z_new), to))
        return ca.Function("slope", inputs, [slope], {"cse": True})

    def jacobians(self, X: Array, X_next: Array, F: Array) -> Array:
        """Derivative of every step's state to that before, (steps, size, size).

        Parameters
        ----------
        X, X_next : (steps, size) array
            States before and after.
        F : (steps, 3) array
            As the step is told of the excitation.
        """
        of, layout, n = self.linear, self.layout, 2 * self.layout.modes
        N, size, f = len(X), layout.size, layout.f
        y, f_old, f_new = X_next[:, :n], X[:, f], X_next[:, f]
        signals = y @ of.s_by_y.T + f_old @ of.s_by_old.T + f_new @ of.s_by_new.T + F @ of.s_by_excitation.T
        # all that does not go through the forces at the end: motion, signals, and what laws make of both
        y_x = np.zeros((n, size))
        y_x[:, :n], y_x[:, f] = of.y_by_y, of.y_by_old
        s_x, s_f = of.s_by_y @ y_x, of.s_by_y @ of.y_by_new + of.s_by_new
        s_x[:, f] += of.s_by_old
        out_x, out_f = np.zeros((N, size, size)), np.zeros((N, size, layout.ports))
        out_x[:, :n], out_f[:, :n] = y_x, of.y_by_new
        gap_x, gap_f = np.zeros((N, layout.ports, size)), np.zeros((N, layout.ports, layout.ports))
        gap_f[:] = np.eye(layout.ports)
        parts = np.cumsum([f.stop, *layout.memory, *map(len, layout.signals)]).tolist()
        joints = len(self.laws)
        for j, (w, (here, told)) in enumerate(zip(self.laws, self._places(), strict=True)):
            used, z, b = list(layout.signals[j]), slice(*parts[j : j + 2]), slice(*parts[joints + j : joints + j + 2])
            before = np.zeros((signals_of(w.ports), N))
            before[used] = X[:, b].T
            given = (f_new[:, here].T, X[:, z].T, f_old[:, here].T, before, signals[:, told].T)
            p = np.tile(values(self.rig.joints[j].law)[:, None], N)
            found = self._slope(j)(*given, self.environments[j], p).full()
            rows = w.ports + w.states
            blocks = found.reshape(rows, N, -1).transpose(1, 0, 2)
            by_f, by_z, by_old, by_before, by_s = np.split(
                blocks, np.cumsum([w.ports, w.states, w.ports, len(used)]), axis=2
            )
            total_f, total_x = by_s @ s_f[told], by_s @ s_x[told]
            total_f[:, :, here] += by_f
            total_x[:, :, z] += by_z
            total_x[:, :, f][:, :, here] += by_old
            total_x[:, :, b] += by_before
            gap_f[:, here] -= total_f[:, : w.ports]
            gap_x[:, here] -= total_x[:, : w.ports]
            out_f[:, z], out_x[:, z] = total_f[:, w.ports :], total_x[:, w.ports :]
            out_f[:, b], out_x[:, b] = s_f[told][used], s_x[told][used]
        f_x = -np.linalg.solve(gap_f, gap_x)
        out_f[:, f] = np.eye(layout.ports)
        return np.asarray(out_x + out_f @ f_x)


def _folded(rig: JointedRig, new: Array) -> tuple[Array, Array]:
    """Compliances of the body, and of the step, that laws take into account at their ports, (m,) each."""
    s = rig.structure
    own, folded, at = np.zeros(len(s.flexibility)), np.zeros(len(s.flexibility)), 0
    of_step = np.einsum("pn,nk,pk->p", s.joints, new, s.joints)
    for j in rig.joints:
        if j.law.folds:
            own[at] = max(float(s.flexibility[at, at]), 0.0)
        if j.law.set_valued:
            folded[at] = of_step[at]
        at += j.law.ports
    return own, folded


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
