"""One sample of a joint's law in symbols: its forces solved where they depend on themselves, and differentiated there.

Harmonic balance and time integration both build on this.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from hbm.aft.period import unrolled
from hbm.aft.slopes import Layout, packed
from models.joints.law import Form, JointLaw, JointSample, form, numbers, of_form, with_symbols

ENVIRONMENT = ("dt", "C")
"""Inputs of a law that stay the same over a period: the time between samples, the compliance it takes into account."""


def signals_of(ports: int) -> int:
    """Signals of a sample: displacements, velocities, and what the load differs by."""
    return 2 * ports + 1


class JointStep:
    """One sample of a law.

    Parameters
    ----------
    law : JointLaw
    yields : bool
        Whether the law may be told of a compliance. Without one most forces do not depend on themselves.

    Attributes
    ----------
    states : int
        Internal states of the law.
    implicit : bool
        Whether the forces depend on themselves.
    remembers : bool
        Whether the forces of the sample before matter.
    reads : tuple of int
        Signals of the sample, then of the one before, that matter.
    told : list of SX
        All that `force` and `z_new` depend on.
    """

    def __init__(self, law: JointLaw, *, yields: bool = True) -> None:
        symbolic, self.p = with_symbols(law)
        m, n = law.ports, signals_of(law.ports)
        self.ports, self.states = m, law.states
        self.z, self.f, self.f_before = ca.SX.sym("z", law.states), ca.SX.sym("f", m), ca.SX.sym("f_before", m)
        self.now, self.before = ca.SX.sym("now", n), ca.SX.sym("before", n)
        self.environment = ca.SX.sym("environment", len(ENVIRONMENT))
        dt, C = ca.vertsplit(self.environment)
        C = C if yields else ca.SX(0.0)

        def sample(s: Any, f: Any) -> JointSample:
            return JointSample(ca.vertsplit(s[:m]), ca.vertsplit(s[m : 2 * m]), s[2 * m], C, dt, ca.vertsplit(f))

        z_new, force = symbolic.advance(self.z, sample(self.before, self.f_before), sample(self.now, self.f))
        self.force, self.z_new = ca.densify(ca.vertcat(*force)), ca.densify(ca.SX(z_new))
        both = ca.vertcat(self.force, self.z_new)
        self.implicit = bool(ca.jacobian(self.force, self.f).nnz())
        self.remembers = bool(ca.jacobian(both, self.f_before).nnz())
        used = ca.sum1(ca.DM(ca.jacobian(both, ca.vertcat(self.now, self.before)).sparsity(), 1)).full().ravel()
        self.reads = tuple(int(i) for i in np.flatnonzero(used))
        self.uses_time = bool(ca.jacobian(both, dt).nnz())
        self.carries_force = self.implicit or self.remembers
        self.carried = ca.vertcat(self.z, self.f_before) if self.carries_force else self.z
        self.memory = ca.vertcat(self.z, self.f_before) if self.remembers else self.z
        self.arguments = [self.carried, self.before, self.now, self.environment, self.p]
        self.told = [self.f, self.z, self.f_before, self.before, self.now, self.environment, self.p]
        self.slope = ca.jacobian(self.force, self.f)

    def carry(self) -> Any:
        """Values that the next sample needs."""
        return ca.vertcat(self.z_new, self.f) if self.carries_force else self.z_new

    def at_solution(self, expressions: list[Any], iterations: int) -> list[Any]:
        """Return expressions in the forces with f = law(f) solved."""
        if not self.implicit:
            return list(ca.substitute(expressions, [self.f], [self.force]))
        newton = ca.Function("newton", self.told, [self.f + self._closed(self.force - self.f)], {"cse": True})
        f, rest = self.f_before, self.told[1:]
        for _ in range(iterations):
            f = newton(f, *rest)
        # not differentiated through: the iterations are no part of the derivative
        return list(ca.Function("there", self.told, expressions, {"cse": True}).call([f, *rest]))

    def _closed(self, open_change: Any) -> Any:
        """Change of the forces with their own answer to it."""
        matrix = ca.SX.eye(self.ports) - self.slope
        return open_change / matrix if self.ports == 1 else ca.mtimes(ca.inv(matrix), open_change)

    def slopes(self, to: Any) -> tuple[Any, Layout]:
        """Derivatives of (forces, memory after) to (memory before, `to`), see :func:`hbm.aft.slopes.packed`."""
        x, after = ca.vertcat(self.memory, to), ca.vertcat(self.z_new, self.f) if self.remembers else self.z_new
        by_x = ca.jacobian(self.force, x)
        of_force = self._closed(by_x) if self.implicit else by_x
        return packed(ca.vertcat(of_force, ca.jacobian(after, x)), ca.jacobian(after, self.f))


@dataclass(frozen=True)
class JointFunctions:
    """CasADi functions of one law over one period of N_t samples.

    Attributes
    ----------
    memory : int
        How many of the carried values decide what follows.
    reads : tuple of int
        Which signals (of the sample, then of the one before) the law depends on.
    timed : bool
        Whether it depends on the time between samples.
    layout : Layout
        How slopes are stored.
    sample : (carried, signals before, signals, environment, p) -> carried
    march : (carried, signals, environment, p) -> carried
    force : (carried, signals, environment, p) -> (forces, gap, carried)
        `gap` is what f = law(f) is short of.
    period : (carried, signals, environment, p) -> (forces, gap, local, carried)
        `local` (forces, memory) by (memory, signals read, dt if it matters).
    by_numbers : like `period`, with derivatives to (memory, signals read, dt if..., p, C).
    """

    memory: int
    reads: tuple[int, ...]
    timed: bool
    layout: Layout
    sample: ca.Function
    march: ca.Function
    force: ca.Function
    period: ca.Function
    by_numbers: ca.Function


def joint_step(law: JointLaw) -> JointStep:
    """One sample of a law, the same for all of its form."""
    return _in_symbols(form(law), True)


@lru_cache(maxsize=128)
def _in_symbols(made_of: Form, yields: bool) -> JointStep:
    return JointStep(of_form(made_of), yields=yields)


def joint_functions(law: JointLaw, N_t: int, iterations: int, *, yields: bool = True) -> JointFunctions:
    """Functions of a law over N_t samples that solve f = law(f) with so many iterations, see :class:`JointStep`."""
    return _functions(form(law), N_t, iterations, yields)


@lru_cache(maxsize=64)
def _functions(made_of: Form, N_t: int, iterations: int, yields: bool) -> JointFunctions:
    step = _in_symbols(made_of, yields)
    inputs = ca.vertcat(step.now, step.before)[list(step.reads)]
    inputs = ca.vertcat(inputs, step.environment[ENVIRONMENT.index("dt")]) if step.uses_time else inputs
    gap = step.force - step.f if step.implicit else ca.SX.zeros(step.ports)

    def stepped(*outputs: Any) -> ca.Function:
        return ca.Function(
            "step", step.arguments, step.at_solution([step.carry(), *outputs], iterations), {"cse": True}
        )

    def with_derivatives(to: Any) -> ca.Function:
        return unrolled(stepped(step.f, gap, step.slopes(to)[0]), N_t)

    return JointFunctions(
        memory=step.memory.numel(),
        reads=step.reads,
        timed=step.uses_time,
        layout=step.slopes(inputs)[1],
        sample=stepped(),
        march=unrolled(stepped(), N_t),
        force=unrolled(stepped(step.f, gap), N_t),
        period=with_derivatives(inputs),
        by_numbers=with_derivatives(ca.vertcat(inputs, step.p, step.environment[ENVIRONMENT.index("C")])),
    )


def values(law: JointLaw) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Parameters of a law as solvers pass them, (p,)."""
    return np.array([float(v) for v in numbers(law).values()])
