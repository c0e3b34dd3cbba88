"""Alternating frequency/time: the steady force of a friction law over one period, with exact derivatives.

The law's step is differentiated by CasADi sample by sample; what couples the samples (its internal
state) is a banded recurrence, solved backwards for the Fourier coefficients of the force.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hbm.aft.period import DT, law_functions
from hbm.aft.projection import projected, shown
from hbm.aft.recurrence import undying
from hbm.aft.steady import SteadyPeriod
from hbm.aft.step import ENVIRONMENT, SIGNALS, law_step
from hbm.fourier import Array, FourierBasis
from models.friction import FrictionLaw


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


@dataclass(frozen=True)
class InputChange:
    """Changes, in p columns, of everything that a law is shown over a period.

    Attributes
    ----------
    signals : (2H+1, 3, p) array
        Changes of the coefficients of u (the velocity follows), rho and eta.
    Omega : (p,) array
        Change of the fundamental frequency.
    law : (parameters + 1, p) array
        Changes of the law's parameters, then of the static load (the load within rho not included).
    compliance : (p,) array, optional
        Change of the series compliance; none where omitted.
    """

    signals: Array
    Omega: Array
    law: Array
    compliance: Array | None = None


@dataclass(frozen=True)
class LawSteps:
    """How a disturbance passes the samples of a law: derivatives of the force, then of the states.

    Attributes
    ----------
    T : (N_t,) array
        The force [N].
    by_states : (N_t, 1 + states, states) array
        To the states before each sample.
    by_signals, by_signals_before : (N_t, 1 + states, 4) array
        To u, v, rho, eta (:data:`SIGNALS`) of the sample, and of the one before.
    """

    T: Array
    by_states: Array
    by_signals: Array
    by_signals_before: Array

    @property
    def remembers(self) -> bool:
        """Whether the force depends on samples before."""
        return bool(self.by_states.size or self.by_signals_before.any())

    @cached_property
    def undying(self) -> int:
        """How many disturbances of the states return undiminished where the motion is held: anchors that stick."""
        return undying(self.by_states[:, 1:])


class LawOverPeriod(SteadyPeriod):
    """A friction law on a Fourier basis: coefficients of the contact signals in, of the force out.

    One object serves one thread: it owns the buffers that CasADi reads and fills.

    Attributes
    ----------
    closure : float
        Of the last force, see :meth:`force`.
    """

    choices = (2, 3, 9)

    def __init__(self, law: FrictionLaw, basis: FourierBasis) -> None:
        self.basis = basis
        self._law, self._step = law, law_step(law)
        self._shown: tuple[Array | None, float] = (None, 0.0)
        self._signals, self._environment = np.zeros((basis.N_t, len(SIGNALS))), np.zeros(len(ENVIRONMENT))
        self._fades = False  # whether the state before the period fades without ever being forgotten
        self.closure = 0.0
        self._parameters = np.zeros(self._step.function.size1_in(6))
        self._bind(self.choices[0])

    def _bind(self, iterations: int) -> None:
        """Functions that solve T = law(T) with so many iterations, and the buffers they read and fill."""
        self.functions, self._iterations = law_functions(self._law, self.basis.N_t, iterations), iterations
        self._memory, self._outputs = self.functions.states, 1
        self._allocate(self.functions, self._signals, self._environment, self._parameters)

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
        self.closure = self._steady()
        return self._forces, self.closure

    @property
    def memory(self) -> Array:
        """State of the law before the first sample of the last period computed, as a time integration keeps it."""
        z = self._carried[: self._step.states]
        memory = self._step.memory(z, self._signals[-1], float(self._forces[-1]), float(self._environment[1]))
        return np.asarray(memory)

    def linearize(self, signals: Array, Omega: float, environment: Environment) -> ContactForce:
        """Friction force with the derivatives of its coefficients; arguments as :meth:`force`."""
        self.shown(signals, Omega, environment)
        T, basis = self._forces.copy(), self.basis
        by: dict[int, Array] = {}
        now, before, ever = shown(basis)
        inputs = [now if i < DT else before if i > DT else ever for i in self.functions.active]
        projections = projected(self._local, basis, inputs, self._first_period)
        for i, (slope,) in zip(self.functions.active, projections, strict=True):
            i = i if i <= DT else i - DT - 1
            by[i] = by[i] + slope if i in by else slope
        by_u, by_v = by.get(0), by.get(1)
        by_Omega = np.zeros(basis.size)
        if DT in by:
            by_Omega -= by[DT][:, 0] * 2 * np.pi / (Omega**2 * basis.N_t)
        if by_v is not None:
            chained = Omega * basis.derivative_on_right(by_v)
            by_u = chained if by_u is None else by_u + chained
            by_Omega += by_v @ signals[:, 1] / Omega
        return ContactForce(T, basis.analysis @ T, by_u, by.get(2), by.get(3), by_Omega)

    def shown(self, signals: Array, Omega: float, environment: Environment) -> tuple[Array, float]:
        """As :meth:`force`, which is not worked out again where the buffers hold this period already."""
        if self._shown[0] is not signals or self._shown[1] != Omega:
            return self.force(signals, Omega, environment)
        return self._forces, self.closure

    def steps(self, signals: Array, Omega: float, environment: Environment) -> "LawSteps":
        """Derivatives of every sample of the steady force; arguments as :meth:`force`."""
        self.shown(signals, Omega, environment)
        n_z, N_t, by_inputs = self.functions.states, self.basis.N_t, self._local.by_inputs
        now, before = (np.zeros((N_t, 1 + n_z, len(SIGNALS))) for _ in range(2))
        for at, i in enumerate(self.functions.active):
            if i != DT:  # a perturbation does not change the time between samples
                inputs, column = (now, i) if i < DT else (before, i - DT - 1)
                inputs[:, :, column] = by_inputs[:, :, at]
        return LawSteps(self._forces.copy(), self._local.by_states, now, before)

    def along(self, signals: Array, Omega: float, environment: Environment, change: InputChange) -> Array:
        """Change of the force at the samples with everything that it depends on, (N_t, p).

        Marches forwards, for few changes and all samples; :meth:`linearize` for few outputs and all signals.
        """
        self.shown(signals, Omega, environment)
        followed = self._followed(self.functions.tangent())
        return followed.changed(self._sampled(signals, Omega, change))[:, 0]

    def _sampled(self, signals: Array, Omega: float, change: InputChange) -> Array:
        """Change of the active inputs, the parameters, the load and the compliance at the samples, (N_t, inputs, p)."""
        u, rho, eta = change.signals.transpose(1, 0, 2)
        v = Omega * self.basis.derivative(u) + np.outer(signals[:, 1] / Omega, change.Omega)
        now = [self.basis.synthesis @ coefficients for coefficients in (u, v, rho, eta)]
        before = [np.roll(moving, 1, axis=0) for moving in now]
        dt = np.broadcast_to(-2 * np.pi / (Omega**2 * self.basis.N_t) * change.Omega, now[0].shape)
        inputs = [*now, dt, *before]
        compliance = np.zeros_like(change.Omega) if change.compliance is None else change.compliance
        law = [np.broadcast_to(value, dt.shape) for value in (*change.law, compliance)]
        return np.stack([*(inputs[i] for i in self.functions.active), *law], axis=1)
