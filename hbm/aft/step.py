"""One sample of a friction law as a CasADi function, and the closing of T = law(T).

What a law depends on is read off its expressions: whether the force it returns depends on the force it is told, and
which quantities of the sample before it uses. The harmonic balance and the time integration both build on this.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from models.friction import ContactSample, FrictionLaw, chosen, describe, with_symbols

SIGNALS = ("u", "v", "rho", "eta")
"""Signals of the contact, in the order of :class:`models.friction.ContactSample`."""

BEFORE = (*SIGNALS, "T")
"""What a law may use of the sample before."""

ENVIRONMENT = ("C", "P", "dt")
"""Inputs of a law that stay the same over a period."""


@dataclass(frozen=True)
class LawStep:
    """One sample of a law.

    Attributes
    ----------
    states : int
        Internal states of the law.
    implicit : bool
        Whether the force depends on itself.
    remembered : tuple of int
        Indices of BEFORE that the law uses.
    function : casadi.Function
        `(T, z, before (5,), C before, signals (4,), environment (3,), p) -> (force, z new)`; solved where force = T.
    """

    states: int
    implicit: bool
    remembered: tuple[int, ...]
    function: ca.Function

    @property
    def memory_size(self) -> int:
        """Length of :meth:`memory`."""
        return self.states + len(self.remembered)

    def memory(self, z: Any, signals: Any, T: Any, load: Any) -> Any:
        """Values that the law takes from one sample to the next: its state, and the parts of the sample that it uses.

        Zero before anything has moved. A NumPy array, or a CasADi vector of expressions.
        """
        u, v, rho, eta = (signals[i] for i in range(len(SIGNALS)))
        values = u, v, rho - load, eta, T
        kept = [values[i] for i in self.remembered]
        return np.array([*z, *kept]) if isinstance(z, np.ndarray) else ca.vertcat(z, *kept)

    def recall(self, memory: Any, load: Any) -> tuple[Any, Any]:
        """Inverse of :meth:`memory`: the state z and the sample (5,), zero where the law does not look at it."""
        sample = [ca.SX(0.0)] * len(BEFORE)
        for at, i in enumerate(self.remembered):
            sample[i] = memory[self.states + at]
        sample[2] += load
        return memory[: self.states], ca.vertcat(*sample)

    @property
    def uses_force(self) -> bool:
        """Whether the law uses the force of the sample before."""
        return BEFORE.index("T") in self.remembered


Form = tuple[type, tuple[tuple[str, Any], ...]]
"""What decides the instructions of a law, its class and settings; parameters are run-time inputs."""


def form(law: FrictionLaw) -> Form:
    """Class and settings of a law, to remember what is built of it by."""
    return type(law), tuple(chosen(law).items())


def per_law(build: Callable[..., Any]) -> Callable[..., Any]:
    """Remember what is built of a law by its form."""

    @lru_cache(maxsize=64)
    def remembered(of: Form, *rest: Any) -> Any:
        law_type, made_of = of
        ones = dict.fromkeys(describe(law_type), 1.0)
        return build(law_type(**ones, **dict(made_of)), *rest)

    def built(law: FrictionLaw, *rest: Any) -> Any:
        return remembered(form(law), *rest)

    return built


@per_law
def law_step(law: FrictionLaw) -> LawStep:
    """Build the step of a law."""
    symbolic, p = with_symbols(law)
    z, T, C_before = ca.SX.sym("z", law.states), ca.SX.sym("T"), ca.SX.sym("C_before")
    before, signals = ca.SX.sym("before", len(BEFORE)), ca.SX.sym("signals", len(SIGNALS))
    environment = ca.SX.sym("environment", len(ENVIRONMENT))
    C, P, dt = ca.vertsplit(environment)
    u_before, v_before, rho_before, eta_before, T_before = ca.vertsplit(before)
    u, v, rho, eta = ca.vertsplit(signals)
    z_new, force = symbolic.advance(
        z,
        ContactSample(u_before, v_before, rho_before, eta_before, C_before, P, dt, T_before),
        ContactSample(u, v, rho, eta, C, P, dt, T),
    )
    force, z_new = ca.densify(ca.SX(force)), ca.densify(ca.SX(z_new))
    used = ca.sum1(ca.DM(ca.jacobian(ca.vertcat(force, z_new), before).sparsity(), 1)).full().ravel()
    return LawStep(
        states=law.states,
        implicit=bool(ca.jacobian(force, T).nnz()),
        remembered=tuple(i for i, count in enumerate(used) if count),
        function=ca.Function(
            "law",
            [T, z, before, C_before, signals, environment, p],
            [force, z_new],
            ["T", "z", "before", "C_before", "signals", "environment", "p"],
            ["force", "z_new"],
        ),
    )
