"""Alternating frequency/time: the steady force of a friction law over one period, with exact derivatives.

The law's step is differentiated by CasADi sample by sample; what couples the samples (its internal
state) is a banded recurrence, solved backwards for the Fourier coefficients of the force.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from scipy.linalg import lapack

from hbm.fourier import Array, FourierBasis
from hbm.lawstep import BEFORE, ENVIRONMENT, SIGNALS, LawStep, law_step, per_law
from models.friction import FrictionLaw

DT = len(SIGNALS)
"""Index of the time step among the inputs of a sample: (signals, dt, signals of the sample before)."""

NEWTON, THOROUGH = 3, 9
"""Iterations on T = law(T) at each sample; and where those left more than CLOSURE."""

CLOSURE = 1e-12
"""A loop counts as closed when the state after a period repeats to this fraction of its range."""


NEUTRAL = 1e-9
"""A loop whose state returns undiminished to this accuracy never slips: its history decides its mean force."""


@dataclass(frozen=True)
class Environment:
    """Run-time inputs of a law besides the signals.

    Attributes
    ----------
    compliance : float
        Series compliance C [m/N].
    load : float
        Static normal load P [N].
    parameters : (p,) array
        Law parameters, ordered as :func:`models.friction.parameters`.
    """

    compliance: float
    load: float
    parameters: Array


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
    sample : (carried, signals before, signals, environment, p) -> (carried, T)
    march : (carried, signals, environment, p) -> carried
    period : (carried, signals, environment, p) -> (T, gap, local, carried)
        `gap` is what T = law(T) is short of, sample by sample; `local` holds the derivatives of (T, states) to (states
        before, active inputs).
    by_parameters : like `period`, with derivatives to (states before, p); built when first asked for.
    """

    states: int
    active: tuple[int, ...]
    sample: ca.Function
    march: ca.Function
    period: ca.Function
    by_parameters: Callable[[], ca.Function]


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
            return ca.substitute(expressions, [self.T], [self.force])
        rest = [self.z, self.T_before, self.before, self.signals, self.environment, self.p]
        improved = self.T + (self.force - self.T) / (1.0 - self.slope)
        newton = ca.Function("newton", [self.T, *rest], [improved], {"cse": True})
        T = self.T_before
        for _ in range(iterations):
            T = newton(T, *rest)
        # not differentiated through: the iterations are no part of the derivative
        return ca.Function("there", [self.T, *rest], expressions, {"cse": True}).call([T, *rest])

    def carry(self) -> Any:
        """What the next sample needs."""
        return ca.vertcat(self.z_new, self.T) if self.carries_force else self.z_new

    def slopes(self, to: Any) -> Any:
        """Derivatives of (T, states) to (states before, `to`), by the implicit function theorem."""
        x = ca.vertcat(self.states, to)
        T_slopes = ca.jacobian(self.force, x) / (1.0 - self.slope)
        rows = [T_slopes, ca.jacobian(self.z_new, x) + ca.jacobian(self.z_new, self.T) @ T_slopes]
        return ca.vertcat(*rows, T_slopes) if self.step.uses_force else ca.vertcat(*rows)


def _unrolled(step: ca.Function, N_t: int) -> ca.Function:
    """Chain (carried, signals before, signals, environment, p) -> (carried, outputs...) over the samples of a period.

    Unrolled to scalar instructions, which run five times faster than the calls of a mapaccum. Before the first
    sample comes the last.
    """
    carried, signals = ca.SX.sym("carried", step.size1_in(0)), ca.SX.sym("signals", len(SIGNALS), N_t)
    environment, p = ca.SX.sym("environment", len(ENVIRONMENT)), ca.SX.sym("p", step.size1_in(4))
    samples = ca.horzsplit(signals)
    y, collected = carried, []
    for before, sample in zip([samples[-1], *samples], samples, strict=False):
        y, *outputs = step.call([y, before, sample, environment, p])
        collected.append(outputs)
    per_output = [ca.densify(ca.horzcat(*column)) for column in zip(*collected, strict=True)]
    return ca.Function("period", [carried, signals, environment, p], [*per_output, ca.densify(y)])


@per_law
def _build(law: FrictionLaw, N_t: int, iterations: int) -> LawFunctions:
    sample = _Sample(law_step(law))
    depends = ca.sum1(ca.DM(sample.slopes(sample.inputs).sparsity(), 1)).full().ravel()[sample.states.numel() :]
    active = tuple(int(i) for i in np.flatnonzero(depends))
    gap = sample.force - sample.T if sample.step.implicit else ca.SX(0.0)

    def stepped(*outputs: Any) -> ca.Function:
        results = sample.at_solution([sample.carry(), *outputs], iterations)
        return ca.Function("step", sample.arguments, results, {"cse": True})

    def with_derivatives(to: Any) -> ca.Function:
        local = ca.densify(ca.vec(sample.slopes(to).T))
        return _unrolled(stepped(sample.T, gap, local), N_t)

    return LawFunctions(
        states=sample.states.numel(),
        active=active,
        sample=stepped(sample.T),
        march=_unrolled(stepped(), N_t),
        period=with_derivatives(sample.inputs[list(active)]),
        by_parameters=lru_cache(lambda: with_derivatives(sample.p)),
    )


def _buffered(function: ca.Function, arguments: list[Array]) -> tuple[Callable[[], None], list[Array]]:
    """Bind arrays to a function's inputs; return the call and the arrays it fills."""
    buffer, evaluate = function.buffer()
    results = [np.zeros(function.numel_out(i)) for i in range(function.n_out())]
    for i, argument in enumerate(arguments):
        buffer.set_arg(i, argument.data)
    for i, result in enumerate(results):
        buffer.set_res(i, result.data)

    def call(_alive: object = (buffer, arguments, results)) -> None:  # CasADi holds plain pointers into these
        evaluate()

    return call, results


@dataclass(frozen=True)
class ContactForce:
    """Friction over one period, and how its coefficients change.

    Attributes
    ----------
    T : (N_t,) array
        Force at the samples [N].
    coefficients : (2H+1,) array
        Its Fourier coefficients [N].
    by_u, by_rho, by_eta : (2H+1, 2H+1) arrays or None
        Derivatives of the coefficients to those of u (its velocity included), rho and eta;
        None where the law does not depend on them.
    by_Omega : (2H+1,) array
        Derivative to the fundamental frequency at fixed coefficients.
    """

    T: Array
    coefficients: Array
    by_u: Array | None
    by_rho: Array | None
    by_eta: Array | None
    by_Omega: Array


class LawOverPeriod:
    """A friction law on a Fourier basis: coefficients of the contact signals in, of the force out.

    One object serves one thread: it owns the buffers that CasADi reads and fills.
    """

    def __init__(self, law: FrictionLaw, basis: FourierBasis) -> None:
        self.basis = basis
        self._law, self._step = law, law_step(law)
        self._shown: tuple[Array | None, float] = (None, 0.0)
        self._signals, self._environment = np.zeros((basis.N_t, len(SIGNALS))), np.zeros(len(ENVIRONMENT))
        self._fades = False  # whether the state before the period fades without ever being forgotten
        self._bind(NEWTON)

    def _bind(self, iterations: int) -> None:
        """Functions that solve T = law(T) with so many iterations, and the buffers they read and fill."""
        self.functions = _build(self._law, self.basis.N_t, iterations)
        self._carried = np.zeros(self.functions.period.size1_in(0))
        self._z = self._carried[: self.functions.states]
        self._parameters = np.zeros(self.functions.period.size1_in(3))
        self._inputs = [self._carried, self._signals, self._environment, self._parameters]
        self._march, (self._marched,) = _buffered(self.functions.march, self._inputs)
        self._period, (self._T, self._unsolved, local, self._end) = _buffered(self.functions.period, self._inputs)
        # rows: T, states; columns: states before, active inputs
        self._local = local.reshape(self.basis.N_t, 1 + self.functions.states, -1)

    def force(self, signals: Array, Omega: float, environment: Environment) -> tuple[Array, float]:
        """Steady friction force at the samples.

        Parameters
        ----------
        signals : (2H+1, 4) array
            Coefficients of u, v, rho, eta.
        Omega : float
            Fundamental frequency [rad/s].
        environment : Environment

        Returns
        -------
        (N_t,) array
            Force T [N].
        float
            Closure of the loop: change of the force with the state that the period leads to, and what T = law(T) is
            short of, relative to its peak.
        """
        self._shown = (signals, Omega)
        np.matmul(self.basis.synthesis, signals, out=self._signals)
        self._environment[:] = environment.compliance, environment.load, 2 * np.pi / (Omega * self.basis.N_t)
        self._parameters[:] = environment.parameters
        closure = self._close()
        if not closure <= CLOSURE and self._unsolved.any():
            self._bind(THOROUGH)
            self._parameters[:] = environment.parameters
            closure = self._close()
        return self._T, closure

    @property
    def memory(self) -> Array:
        """What the law knows before the first sample of the last period computed, as a time integration keeps it."""
        z = self._carried[: self._step.states]
        return self._step.memory(z, self._signals[-1], float(self._T[-1]), float(self._environment[1]))

    def _close(self) -> float:
        """March until the loop is measured closed.

        From the virgin state, for a contact that never slips keeps what its history left. A state that fades,
        like a bristle's, has one orbit only, and the last one found is a better start.
        """
        if self._fades:
            closure = self._close_from_here()
            if closure <= CLOSURE and _radius(self._transitions) < 1.0 - NEUTRAL:
                return closure
        self._carried[:] = 0.0
        return self._close_from_here()

    def _close_from_here(self) -> float:
        if len(self._carried) == 0:
            self._period()
            return 0.0
        self._march()
        self._carried[:] = self._marched
        n, closure = self.functions.states, np.inf
        for _ in range(20):
            self._period()
            gap = self._end[:n] - self._z
            if not (
                gap.any() or self._unsolved.any()
            ):  # the usual case: friction that slips forgets where it came from
                return 0.0
            self._fades = True
            pull = self._pull
            closure = self._open_force(pull * gap)
            if not closure > CLOSURE:
                break
            # states have units of their own: measured by the force each of them makes
            slope = np.eye(n) - _monodromy(self._transitions) * pull[:, None] / pull
            self._z += np.linalg.lstsq(slope, pull * gap, rcond=1e-9)[0] / pull
        return closure

    @property
    def _transitions(self) -> Array:
        """Derivative of the state after each sample to that before, (N_t, states, states)."""
        return self._local[:, 1:, : self.functions.states]

    @property
    def _pull(self) -> Array:
        """Largest change of the force over the period per unit of each state, (states,)."""
        pull = np.abs(self._local[:, 0, : self.functions.states]).max(axis=0)
        return np.where(pull > 0.0, pull, 1.0)

    def _open_force(self, by_state: Array) -> float:
        """Largest force that stands between two periods or is short of T = law(T), over the largest force."""
        missing = max(float(np.abs(by_state).max(initial=0.0)), float(np.abs(self._unsolved).max()))
        largest = float(np.abs(self._T).max())
        return missing / largest if largest > 0.0 else 0.0

    def linearize(self, signals: Array, Omega: float, environment: Environment) -> ContactForce:
        """Friction force with the derivatives of its coefficients; arguments as :meth:`force`."""
        if self._shown[0] is not signals or self._shown[1] != Omega:  # else the buffers hold this period already
            self.force(signals, Omega, environment)
        T, basis = self._T.copy(), self.basis
        gradients = dict(zip(self.functions.active, self._gradients(self._local, self._period), strict=True))
        for i in range(DT):
            if (earlier := gradients.get(DT + 1 + i)) is not None:  # the sample before the first is the last
                earlier = np.roll(earlier, -1, axis=1)
                gradients[i] = gradients[i] + earlier if i in gradients else earlier
        by_u, by_v, by_rho, by_eta = (gradients[i] @ basis.synthesis if i in gradients else None for i in range(4))
        by_Omega = np.zeros(basis.size)
        if DT in gradients:
            by_Omega -= gradients[DT].sum(axis=1) * 2 * np.pi / (Omega**2 * basis.N_t)
        if by_v is not None:
            chained = Omega * basis.derivative_on_right(by_v)
            by_u = chained if by_u is None else by_u + chained
            by_Omega += by_v @ signals[:, 1] / Omega
        return ContactForce(T, basis.analysis @ T, by_u, by_rho, by_eta, by_Omega)

    def by_parameters(self, signals: Array, Omega: float, environment: Environment) -> Array:
        """Derivatives of the force's coefficients to the law's parameters, (2H+1, p)."""
        self.force(signals, Omega, environment)
        evaluate, (_, _, local, _) = _buffered(self.functions.by_parameters(), self._inputs)
        evaluate()
        gradients = self._gradients(local.reshape(self.basis.N_t, 1 + self.functions.states, -1), evaluate)
        return np.array([g.sum(axis=1) for g in gradients]).reshape(-1, self.basis.size).T

    def _gradients(self, local: Array, evaluate: Callable[[], None]) -> list[Array]:
        """Derivatives of the force's coefficients to each sample of each input of `local`, (2H+1, N_t).

        `evaluate` fills `local` anew from the present start state.
        """
        n_z, W = self.functions.states, self.basis.analysis
        inputs = range(n_z, local.shape[2])
        if n_z == 0:
            return [local[:, 0, i] * W for i in inputs]
        c, A = local[:, 0, :n_z], local[:, 1:, :n_z]
        monodromy = _monodromy(A)
        if _radius(A) < 1.0 - NEUTRAL:
            adjoint = _periodic_adjoint(c, A, W, monodromy)
            return [local[:, 0, i] * W + _through_states(adjoint, local, i) for i in inputs]
        lam = _backwards(A, _sources(c, W, 0))
        adjoint, seed = _in_time(lam), lam[:, -1]
        steady = [local[:, 0, i] * W + _through_states(adjoint, local, i) for i in inputs]
        # a contact that stays stuck remembers the period before, which started from its virgin state
        self._carried[:] = 0.0
        self._shown = (None, 0.0)
        evaluate()
        right = np.zeros((len(W), self.basis.N_t + 1, n_z))
        right[:, 0] = seed
        adjoint = _in_time(_backwards(local[:, 1:, :n_z], right))
        return [part + _through_states(adjoint, local, i) for part, i in zip(steady, inputs, strict=True)]


def _monodromy(A: Array) -> Array:
    """Product of the state transitions (N_t, n_z, n_z) over the period."""
    if A.shape[1] == 1:
        return np.asarray(np.multiply.reduce(A[:, 0, 0])).reshape(1, 1)
    while len(A) > 1:  # pairwise, so that the products are batched
        last = A[-1:] if len(A) % 2 else A[:0]
        A = np.concatenate([A[1::2] @ A[: len(A) - 1 : 2], last])
    return A[0]


def _radius(A: Array) -> float:
    """Spectral radius of the product of the state transitions."""
    return float(np.abs(np.linalg.eigvals(_monodromy(A))).max(initial=0.0))


def _through_states(adjoint: Array, local: Array, i: int) -> Array:
    """Chain the adjoint states with the derivatives of the states to input `i` of `local`, (2H+1, N_t)."""
    if adjoint.shape[2] == 1:
        return adjoint[:, :, 0] * local[:, 1, i]
    return np.asarray(np.einsum("mkz,kz->mk", adjoint, local[:, 1:, i]))


def _backwards(A: Array, right: Array) -> Array:
    """Solve lambda_{N-1} = right_0 and lambda_{k-1} = right_{N-k} + A_k' lambda_k for falling k.

    Parameters
    ----------
    A : (N_t, n_z, n_z) array
        dz_k / dz_{k-1}.
    right : (m, N_t + 1, n_z) array
        Right sides of m outputs, in the order of solution; overwritten.

    Returns
    -------
    (m, N_t + 1, n_z) array
        lambda in the order of solution; the last stands before the first sample.
    """
    N_t, n_z = A.shape[:2]
    band = np.zeros(((N_t + 1) * n_z, 2 * n_z)).T  # unit lower triangular, stored by columns
    for i in range(n_z):
        for j in range(n_z):
            band[n_z + i - j, j : N_t * n_z : n_z] = -A[::-1, j, i]
    solution, _ = lapack.dtbtrs(band, right.reshape(len(right), -1).T, uplo="L", diag="U", overwrite_b=1)
    return np.asarray(solution.T.reshape(right.shape))


def _in_time(lam: Array) -> Array:
    """Order the solution of :func:`_backwards` as derivative to the state after each sample, (m, N_t, n_z)."""
    return lam[:, -2::-1]


def _sources(c: Array, W: Array, extra: int) -> Array:
    """Right sides c_k W_k of the force samples, with `extra` empty outputs, (m + extra, N_t + 1, n_z)."""
    N_t, n_z = c.shape
    right = np.zeros((len(W) + extra, N_t + 1, n_z))
    np.multiply(W[:, ::-1, None], c[::-1], out=right[: len(W), 1:])
    return right


def _periodic_adjoint(c: Array, A: Array, W: Array, monodromy: Array) -> Array:
    """Adjoint states (m, N_t, n_z) of a loop that closes: lambda after the last sample is lambda before the first."""
    m, n_z = len(W), A.shape[1]
    right = _sources(c, W, n_z)
    right[m:, 0] = np.eye(n_z)
    lam = _backwards(A, right)
    if n_z == 1:
        lam[:m, :, 0] += np.multiply.outer(lam[:m, -1, 0] / (1.0 - monodromy[0, 0]), lam[m, :, 0])
    else:
        seed = np.linalg.solve(np.eye(n_z) - monodromy.T, lam[:m, -1].T).T
        lam[:m] += np.tensordot(seed, lam[m:], axes=1)
    return _in_time(lam[:m])
