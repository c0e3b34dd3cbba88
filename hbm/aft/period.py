"""A friction law over one period of samples, unrolled, with its derivatives: functions of one law and one N_t.

What couples the samples (the internal state, the force of the sample before) is chained; T = law(T) is solved at each
of them, and differentiated by the implicit function theorem.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from hbm.aft.slopes import Layout, packed
from hbm.aft.step import ENVIRONMENT, SIGNALS, LawStep, law_step, per_law
from models.friction import FrictionLaw

DT = len(SIGNALS)
"""Index of the time step among the inputs of a sample: (signals, dt, signals of the sample before)."""


@dataclass(frozen=True)
class LawFunctions:
    """CasADi functions of one law over one period of N_t samples.

    The chain of samples carries (z, T) where a law needs the force of the sample before, or a first guess of its own.

    Attributes
    ----------
    states : int
        How many of the carried values decide what follows.
    active : tuple of int
        Which of (signals, dt, signals before) the law depends on.
    layout : Layout
        How slopes are stored.
    sample : (carried, signals before, signals, environment, p) -> (carried, T)
    march : (carried, signals, environment, p) -> carried
    force : (carried, signals, environment, p) -> (T, gap, carried)
        `gap` is what T = law(T) is short of, sample by sample.
    period : (carried, signals, environment, p) -> (T, gap, local, carried)
        `local` holds the derivatives of (T, states) to (states before, active inputs).
    tangent : like `period`, with derivatives to (states before, active inputs, p, static load, compliance); built when
        first asked for.
    """

    states: int
    active: tuple[int, ...]
    layout: Layout
    sample: ca.Function
    march: ca.Function
    force: ca.Function
    period: ca.Function
    tangent: Callable[[], ca.Function]


BLOCK = 32
"""Most samples that are unrolled at once."""


class _Sample:
    """One sample of a law in symbols: T solved, and the derivatives at the solution."""

    def __init__(self, step: LawStep) -> None:
        law = step.function
        self.step, self.T = step, ca.SX.sym("T")
        self.z, self.p = ca.SX.sym("z", step.states), ca.SX.sym("p", law.size1_in(6))
        self.before, self.signals = ca.SX.sym("before", len(SIGNALS)), ca.SX.sym("signals", len(SIGNALS))
        self.environment, self.T_before = ca.SX.sym("environment", len(ENVIRONMENT)), ca.SX.sym("T_before")
        before = ca.vertcat(self.before, self.T_before)
        known = [self.z, before, self.environment[0], self.signals, self.environment, self.p]
        self.force, self.z_new = law.call([self.T, *known])
        self.slope = ca.jacobian(self.force, self.T)
        self.carries_force = step.implicit or step.uses_force
        self.carried = ca.vertcat(self.z, self.T_before) if self.carries_force else self.z
        self.states = ca.vertcat(self.z, self.T_before) if step.uses_force else self.z
        self.inputs = ca.vertcat(self.signals, self.environment[ENVIRONMENT.index("dt")], self.before)
        self.arguments = [self.carried, self.before, self.signals, self.environment, self.p]

    def at_solution(self, expressions: list[Any], iterations: int) -> list[Any]:
        """Return expressions in T with T solved for."""
        if not self.step.implicit:
            return list(ca.substitute(expressions, [self.T], [self.force]))
        rest = [self.z, self.T_before, self.before, self.signals, self.environment, self.p]
        improved = self.T + (self.force - self.T) / (1.0 - self.slope)
        newton = ca.Function("newton", [self.T, *rest], [improved], {"cse": True})
        T = self.T_before
        for _ in range(iterations):
            T = newton(T, *rest)
        # not differentiated through: the iterations are no part of the derivative
        return list(ca.Function("there", [self.T, *rest], expressions, {"cse": True}).call([T, *rest]))

    def carry(self) -> Any:
        """Values that the next sample needs."""
        return ca.vertcat(self.z_new, self.T) if self.carries_force else self.z_new

    def slopes(self, to: Any) -> tuple[Any, Layout]:
        """Derivatives of (T, states) to (states before, `to`), by the implicit function theorem, as they are stored."""
        x, after = ca.vertcat(self.states, to), ca.vertcat(self.z_new, self.T) if self.step.uses_force else self.z_new
        T_slopes = ca.jacobian(self.force, x) / (1.0 - self.slope)
        return packed(ca.vertcat(T_slopes, ca.jacobian(after, x)), ca.jacobian(after, self.T))


def unrolled(step: ca.Function, N_t: int) -> ca.Function:
    """Chain (carried, signals before, signals, environment, p) -> (carried, outputs...) over the samples of a period.

    Before the first sample comes the last. A block of samples is unrolled to scalar instructions, which run five times
    faster than the calls of a mapaccum; the blocks are called one after the other, which saves memory and build time.
    """
    length = max(n for n in range(1, BLOCK + 1) if N_t % n == 0)
    block = _block(step, length)
    carried, signals = ca.MX.sym("carried", step.size1_in(0)), ca.MX.sym("signals", step.size1_in(2), N_t)
    environment, p = ca.MX.sym("environment", step.size1_in(3)), ca.MX.sym("p", step.size1_in(4))
    blocks = ca.horzsplit(signals, length)
    y, collected = carried, []
    for before, samples in zip([blocks[-1], *blocks], blocks, strict=False):
        y, *outputs = block.call([y, before[:, -1], samples, environment, p])
        collected.append(outputs)
    per_output = [ca.horzcat(*column) for column in zip(*collected, strict=True)]
    return ca.Function("period", [carried, signals, environment, p], [*per_output, y])


def _block(step: ca.Function, length: int) -> ca.Function:
    """Several samples in scalar instructions, with the sample before the first as an input."""
    carried, signals = ca.SX.sym("carried", step.size1_in(0)), ca.SX.sym("signals", step.size1_in(2), length)
    environment, p = ca.SX.sym("environment", step.size1_in(3)), ca.SX.sym("p", step.size1_in(4))
    first, samples = ca.SX.sym("before", step.size1_in(1)), ca.horzsplit(signals)
    y, collected = carried, []
    for before, sample in zip([first, *samples], samples, strict=False):
        y, *outputs = step.call([y, before, sample, environment, p])
        collected.append(outputs)
    per_output = [ca.densify(ca.horzcat(*column)) for column in zip(*collected, strict=True)]
    return ca.Function("block", [carried, first, signals, environment, p], [ca.densify(y), *per_output])


@per_law
def law_functions(law: FrictionLaw, N_t: int, iterations: int) -> LawFunctions:
    """Functions of a law over N_t samples that solve T = law(T) with so many iterations."""
    sample = _Sample(law_step(law))
    by_inputs = ca.jacobian(ca.vertcat(sample.force, sample.z_new), sample.inputs)
    depends = ca.sum1(ca.DM(by_inputs.sparsity(), 1)).full().ravel()
    active = tuple(int(i) for i in np.flatnonzero(depends))
    inputs = sample.inputs[list(active)]
    constants = [sample.environment[ENVIRONMENT.index(name)] for name in ("P", "C")]
    gap = sample.force - sample.T if sample.step.implicit else ca.SX(0.0)

    def stepped(*outputs: Any) -> ca.Function:
        results = sample.at_solution([sample.carry(), *outputs], iterations)
        return ca.Function("step", sample.arguments, results, {"cse": True})

    def with_derivatives(to: Any) -> ca.Function:
        return unrolled(stepped(sample.T, gap, sample.slopes(to)[0]), N_t)

    return LawFunctions(
        states=sample.states.numel(),
        active=active,
        layout=sample.slopes(inputs)[1],
        sample=stepped(sample.T),
        march=unrolled(stepped(), N_t),
        force=unrolled(stepped(sample.T, gap), N_t),
        period=with_derivatives(inputs),
        tangent=lru_cache(lambda: with_derivatives(ca.vertcat(inputs, sample.p, *constants))),
    )
