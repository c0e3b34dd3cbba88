"""Alternating frequency/time: the steady force of a friction law over one period, with exact derivatives.

The law's step is differentiated by CasADi sample by sample; what couples the samples (its internal
state) is a banded recurrence, solved backwards for the Fourier coefficients of the force.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from scipy.linalg import lapack

from hbm.fourier import Array, FourierBasis
from models.friction import ContactSample, FrictionLaw, with_symbols

SIGNALS = ("u", "v", "rho", "eta")
"""Columns of the contact signals, in the order of :class:`models.friction.ContactSample`."""

DT = len(SIGNALS)
"""Index of the time step among the inputs of a law."""

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

    Attributes
    ----------
    states : int
        Internal states n_z.
    active : tuple of int
        Which of (u, v, rho, eta, dt) the law depends on.
    step : (z, signals, environment, p) -> (z_new, T), one sample
    march : (z0, signals, environment, p) -> z_end
    period : (z0, signals, environment, p) -> (T, z_end, local)
        `local` holds, sample by sample, the derivatives of (T, z) to (z before, active inputs).
    by_parameters : like `period`, with derivatives to (z before, p); built when first asked for.
    """

    states: int
    active: tuple[int, ...]
    step: ca.Function
    march: ca.Function
    period: ca.Function
    by_parameters: Callable[[], ca.Function]


def _step(law: FrictionLaw) -> tuple[list[Any], Any, Any, Any]:
    """One sample of a law as expressions: arguments, T, the new state, and (u, v, rho, eta, dt)."""
    symbolic, p = with_symbols(law)
    z = ca.SX.sym("z", law.states)
    signals, environment = ca.SX.sym("signals", len(SIGNALS)), ca.SX.sym("environment", 3)
    u, v, rho, eta = ca.vertsplit(signals)
    C, P, dt = ca.vertsplit(environment)
    z_new, T = symbolic.advance(z, ContactSample(u, v, rho, eta, C, P, dt))
    return [z, signals, environment, p], T, z_new, ca.vertcat(signals, dt)


def _unrolled(step: ca.Function, N_t: int) -> ca.Function:
    """Chain (z, signals, environment, p) -> (z_new, outputs...) over the samples of a period.

    Unrolled to scalar instructions, which run five times faster than the calls of a mapaccum.
    """
    states, n_p = step.size1_in(0), step.size1_in(3)
    z0, signals = ca.SX.sym("z0", states), ca.SX.sym("signals", len(SIGNALS), N_t)
    environment, p = ca.SX.sym("environment", 3), ca.SX.sym("p", n_p)
    z, collected = z0, []
    for sample in ca.horzsplit(signals):
        z, *outputs = step.call([z, sample, environment, p])
        collected.append(outputs)
    per_output = [ca.densify(ca.horzcat(*column)) for column in zip(*collected, strict=True)]
    return ca.Function("period", [z0, signals, environment, p], [*per_output, ca.densify(z)])


def _build(law: FrictionLaw, N_t: int) -> LawFunctions:
    arguments, T, z_new, inputs = _step(law)
    z, p = arguments[0], arguments[3]
    response = ca.vertcat(T, z_new)
    depends = ca.sum1(ca.DM(ca.jacobian(response, inputs).sparsity(), 1)).full().ravel()
    active = tuple(int(i) for i in np.flatnonzero(depends))

    def with_derivatives(to: Any) -> ca.Function:
        slopes = ca.jacobian(response, ca.vertcat(z, to))
        return _unrolled(ca.Function("step", arguments, [z_new, T, ca.densify(ca.vec(slopes.T))], {"cse": True}), N_t)

    return LawFunctions(
        states=law.states,
        active=active,
        step=ca.Function("step", arguments, [z_new, T]),
        march=_unrolled(ca.Function("step", arguments, [z_new]), N_t),
        period=with_derivatives(inputs[list(active)]),
        by_parameters=lru_cache(lambda: with_derivatives(p)),
    )


@lru_cache(maxsize=64)
def _build_by_type(law_type: type, N_t: int) -> LawFunctions:
    return _build(law_type(**{f.name: 1.0 for f in fields(law_type)}), N_t)


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
        self.functions = _build_by_type(type(law), basis.N_t)
        self._shown: tuple[Array | None, float] = (None, 0.0)
        self._z = np.zeros(self.functions.states)
        self._signals = np.zeros((basis.N_t, len(SIGNALS)))
        self._environment = np.zeros(3)
        self._parameters = np.zeros(self.functions.period.size1_in(3))
        self._inputs = [self._z, self._signals, self._environment, self._parameters]
        self._march, (self._z_marched,) = _buffered(self.functions.march, self._inputs)
        self._period, (self._T, local, self._z_end) = _buffered(self.functions.period, self._inputs)
        # rows: T, z; columns: z before, active inputs
        self._local = local.reshape(basis.N_t, 1 + self.functions.states, -1)

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
            Closure of the loop: change of the internal state over the period, relative to its range.
        """
        self._shown = (signals, Omega)
        np.matmul(self.basis.synthesis, signals, out=self._signals)
        self._environment[:] = environment.compliance, environment.load, 2 * np.pi / (Omega * self.basis.N_t)
        self._parameters[:] = environment.parameters
        return self._T, self._close()

    @property
    def memory(self) -> Array:
        """Internal state before the first sample of the last period computed, (states,)."""
        return self._z.copy()

    def _close(self) -> float:
        """March from the virgin state until the loop is measured closed."""
        self._z[:] = 0.0
        if not self.functions.states:
            self._period()
            return 0.0
        self._march()
        self._z[:] = self._z_marched
        closure = np.inf
        for _ in range(20):
            self._period()
            gap = self._z_end - self._z
            if not gap.any():  # the usual case: friction that slips forgets where it came from
                return 0.0
            scale = max(float(np.abs(self._signals[:, 0]).max()), float(np.abs(self._z_end).max()))
            closure = float(np.abs(gap).max()) / scale if scale > 0.0 else 0.0
            if not closure > CLOSURE:
                break
            slope = np.eye(len(gap)) - _monodromy(self._local[:, 1:, : len(gap)])
            self._z += np.linalg.lstsq(slope, gap, rcond=1e-9)[0]
        return closure

    def linearize(self, signals: Array, Omega: float, environment: Environment) -> ContactForce:
        """Friction force with the derivatives of its coefficients; arguments as :meth:`force`."""
        if self._shown[0] is not signals or self._shown[1] != Omega:  # else the buffers hold this period already
            self.force(signals, Omega, environment)
        T, basis = self._T.copy(), self.basis
        gradients = dict(zip(self.functions.active, self._gradients(self._local, self._period), strict=True))
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
        evaluate, (_, local, _) = _buffered(self.functions.by_parameters(), self._inputs)
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
        if np.abs(monodromy).max() < 1.0 - NEUTRAL:
            adjoint = _periodic_adjoint(c, A, W, monodromy)
            return [local[:, 0, i] * W + _through_states(adjoint, local, i) for i in inputs]
        lam = _backwards(A, _sources(c, W, 0))
        adjoint, seed = _in_time(lam), lam[:, -1]
        steady = [local[:, 0, i] * W + _through_states(adjoint, local, i) for i in inputs]
        # a contact that stays stuck remembers the period before, which started from its virgin state
        self._z[:] = 0.0
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
    product = np.eye(A.shape[1])
    for transition in A:
        product = transition @ product
    return product


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
