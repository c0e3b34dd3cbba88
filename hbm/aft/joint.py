"""Alternating frequency/time for a joint: steady forces at its ports over one period, with exact derivatives.

CasADi differentiates the law sample by sample; what couples the samples (its memory) is a linear recurrence, solved
backwards for the Fourier coefficients of the forces.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hbm.aft.jointstep import ENVIRONMENT, JointFunctions, joint_functions, signals_of, values
from hbm.aft.projection import projected, shown
from hbm.aft.recurrence import Loop, undying
from hbm.aft.steady import SteadyPeriod
from hbm.fourier import Array, FourierBasis
from models.joints.law import JointLaw


@dataclass(frozen=True)
class JointForces:
    """Forces of a joint over one period, and how their coefficients change.

    Attributes
    ----------
    f : (N_t, m) array
        At the samples [N].
    used : tuple of int
        Which of the 2 m + 1 signals they depend on.
    by_used : (u, m, 2H+1, 2H+1) array
        Derivatives of the coefficients of the force at each port to those of each signal used.
    by_Omega : (2H+1, m) array
        Derivative to the fundamental frequency at fixed coefficients.
    """

    f: Array
    used: tuple[int, ...]
    by_used: Array
    by_Omega: Array

    @cached_property
    def by_signals(self) -> Array:
        """Derivatives of the coefficients of the forces to those of all signals, (2H+1, m, 2H+1, 2 m + 1)."""
        _, m, size, _ = self.by_used.shape
        found = np.zeros((size, m, size, signals_of(m)))
        found[..., list(self.used)] = self.by_used.transpose(2, 1, 3, 0)
        return found


class JointOverPeriod(SteadyPeriod):
    """A law on a Fourier basis: coefficients of the signals at a joint in, of its forces out.

    Signals are the displacements of the ports, the displacements whose rates are the velocities that the law is shown
    (the same, or without what the modes leave out), and last what the load differs by from that at rest.

    One object serves one thread: it owns the buffers that CasADi reads and fills.

    Attributes
    ----------
    closure : float
        Of the last forces, see :meth:`forces`.
    """

    choices = (3, 9)

    def __init__(self, law: JointLaw, basis: FourierBasis, compliance: float = 0.0, *, loaded: bool = True) -> None:
        self.law, self.basis, self.compliance, self.ports = law, basis, compliance, law.ports
        self._sampled = np.zeros((basis.N_t, signals_of(law.ports)))
        self._shown: tuple[Array | None, float] = (None, 0.0)
        self._loop: Loop | None = None
        self._fades, self._loaded, self.closure = False, loaded, 0.0
        self._environment = np.zeros(len(ENVIRONMENT))
        self._bind(self.choices[0])

    def _bind(self, iterations: int) -> None:
        yields = self.compliance != 0.0
        self.functions: JointFunctions = joint_functions(self.law, self.basis.N_t, iterations, yields=yields)
        self._memory, self._outputs, self._iterations = self.functions.memory, self.ports, iterations
        self._allocate(self.functions, self._sampled, self._environment, values(self.law))

    # ---- the steady forces

    def forces(self, signals: Array, Omega: float) -> tuple[Array, float]:
        """Steady forces at the samples, (N_t, m) [N], and the closure of the loop.

        Parameters
        ----------
        signals : (2H+1, 2 m + 1) array
            Coefficients of the displacements, of those that the velocities are the rates of, and of the load.
        Omega : float
            Fundamental frequency [rad/s].
        """
        m, basis = self.ports, self.basis
        shown = signals.copy()
        shown[:, m : 2 * m] = Omega * basis.derivative(signals[:, m : 2 * m])
        found = self.forces_of_samples(basis.samples(shown), Omega)
        self._shown = signals, Omega
        return found

    def shown(self, signals: Array, Omega: float) -> tuple[Array, float]:
        """As :meth:`forces`, which are known where these are the signals and the frequency of the last time."""
        known, at = self._shown
        if known is None or at != Omega or not (known is signals or np.array_equal(known, signals)):
            return self.forces(signals, Omega)
        return self._forces.reshape(self.basis.N_t, self.ports), self.closure

    def forces_of_samples(self, shown: Array, Omega: float) -> tuple[Array, float]:
        """As :meth:`forces`, of displacements, velocities and load at the samples, (N_t, 2 m + 1)."""
        self._shown, self._loop = (None, Omega), None
        self._sampled[:] = shown
        self._environment[:] = 2 * np.pi / (Omega * self.basis.N_t), self.compliance
        self.closure = self._steady()
        return self._forces.reshape(self.basis.N_t, self.ports), self.closure

    @property
    def memory(self) -> Array:
        """State of the law before the first sample of the last period computed, (memory,)."""
        return self._carried[: self.functions.memory].copy()

    def at_first(self) -> tuple[Array, Array]:
        """Internal states after the first sample of the last period computed, and that sample's signals."""
        first, last = self._sampled[0], self._sampled[-1]
        carried = self.functions.sample(self._carried, last, first, self._environment, self._inputs[3])
        return np.asarray(carried.full()[: self.law.states, 0]), first.copy()

    @property
    def conservative(self) -> bool:
        """Whether the force follows from the displacement alone: what the body gives it comes back within a period."""
        alone = not self.functions.memory and not self.functions.timed and set(self.functions.reads) <= {0}
        return self.ports == 1 and alone

    @property
    def undying(self) -> int:
        """How many disturbances of the memory return undiminished where the motion is held: anchors that stick."""
        return undying(self._transitions)

    # ---- derivatives

    def linearize(self, signals: Array, Omega: float) -> JointForces:
        """Steady forces with the derivatives of their coefficients; arguments as :meth:`forces`."""
        basis, m, all_signals = self.basis, self.ports, signals_of(self.ports)
        f = self.shown(signals, Omega)[0].copy()
        (now, before, ever), reads, timed = shown(basis), self.functions.reads, self.functions.timed
        inputs = [*(now if i < all_signals else before for i in reads), *([ever] if timed else [])]
        by_inputs = projected(self._local, basis, inputs, self._first_period)
        found: dict[int, Array] = {}
        for by, i in zip(by_inputs, reads, strict=False):  # the time between samples comes last
            i = i % all_signals
            if i != 2 * m or self._loaded:
                found[i] = found[i] + by if i in found else by
        found = dict(sorted(found.items()))
        by_used = np.array(list(found.values())).reshape(-1, m, basis.size, basis.size)
        by_Omega = np.zeros((m, basis.size))
        for i, by in zip(found, by_used, strict=True):
            if m <= i < 2 * m:
                by_Omega += by @ basis.derivative(signals[:, i])
                by[:] = Omega * basis.derivative_on_right(by.reshape(-1, basis.size)).reshape(by.shape)
        if timed:
            by_Omega -= by_inputs[-1][:, :, 0] * 2 * np.pi / (Omega**2 * basis.N_t)
        return JointForces(f, tuple(found), by_used, by_Omega.T)

    def along(self, signals: Array, Omega: float, numbers: Array) -> Array:
        """Derivatives of the coefficients of the forces to numbers of the law or its compliance, (2H+1, m, c).

        Signals are held.

        Parameters
        ----------
        signals, Omega
            As for :meth:`forces`.
        numbers : (p + 1, c) array
            Changes of the law's parameters, and of the compliance that it takes into account.
        """
        numbered = slice(len(self.functions.reads) + self.functions.timed, None)
        inputs = np.broadcast_to(numbers, (self.basis.N_t, *numbers.shape))
        return self.basis.coefficients(self._changed(signals, Omega, inputs, numbered))

    def moved(self, signals: Array, Omega: float, change: Array, faster: Array, numbers: Array) -> Array:
        """Derivatives of the forces at the samples, (N_t, m, c) [N].

        Parameters
        ----------
        signals, Omega
            As for :meth:`forces`.
        change : (2H+1, 2 m + 1, c) array
            Of the signals.
        faster : (c,) array
            Of the frequency [rad/s].
        numbers : (p + 1, c) array
            As for :meth:`along`.
        """
        basis, m, (size, all_signals, c) = self.basis, self.ports, change.shape
        shown, rates = change.copy(), slice(m, 2 * m)
        rated = Omega * basis.derivative(change[:, rates].reshape(size, m * c)).reshape(size, m, c)
        shown[:, rates] = rated + np.multiply.outer(basis.derivative(signals[:, rates]), faster)
        if not self._loaded:
            shown[:, 2 * m] = 0.0
        now = basis.samples(shown.reshape(size, all_signals * c)).reshape(-1, all_signals, c)
        read = np.concatenate([now, np.roll(now, 1, axis=0)], axis=1)[:, list(self.functions.reads)]
        dt = [-2 * np.pi / (Omega**2 * basis.N_t) * faster] * self.functions.timed
        constant = np.vstack([*dt, numbers])
        inputs = np.concatenate([read, np.broadcast_to(constant, (len(now), *constant.shape))], axis=1)
        return self._changed(signals, Omega, inputs, slice(None))

    def _changed(self, signals: Array, Omega: float, inputs: Array, chosen: slice) -> Array:
        """Change (N_t, m, c) of the steady forces with some of the signals read, the time step and the numbers."""
        self.shown(signals, Omega)
        return self._followed(self.functions.by_numbers, chosen).changed(inputs)

    def alike(self, signals: Array, Omega: float) -> Array | None:
        """Slopes (m, 2 m + 1) of the forces to the signals, where they are the same at all samples and nothing is kept.

        None for any other law.
        """
        if self.functions.memory or self.functions.timed:
            return None
        self.shown(signals, Omega)
        by_inputs = self._local.outputs_by_inputs
        if np.any(by_inputs != by_inputs[0]):
            return None
        found = np.zeros((self.ports, signals_of(self.ports)))
        found[:, list(self.functions.reads)] = by_inputs[0]
        return found

    def pushed(self, signals: Array, Omega: float, change: Array) -> Array:
        """Change (2H+1, m, c) of the coefficients of the forces with small changes of the signals, no matrix made.

        Parameters
        ----------
        signals, Omega
            As for :meth:`forces`.
        change : (2H+1, 2 m + 1, c) array
            Of the signals.
        """
        self.shown(signals, Omega)
        m, basis, all_signals = self.ports, self.basis, signals_of(self.ports)
        now: dict[int, Array] = {}
        for i in {i % all_signals for i in self.functions.reads}:
            rate = m <= i < 2 * m
            now[i] = basis.samples(Omega * basis.derivative(change[:, i]) if rate else change[:, i])
        before = {i: np.roll(samples, 1, axis=0) for i, samples in now.items()}
        inputs = np.empty((basis.N_t, len(self.functions.reads), change.shape[2]))
        for at, i in enumerate(self.functions.reads):
            inputs[:, at] = (now, before)[i // all_signals][i % all_signals]
        if self._loop is None:
            moving = slice(len(self.functions.reads))  # the time between samples, which is held, comes last
            self._loop = Loop(self._local.to(moving), lambda: self._first_period().to(moving), often=True)
        return basis.coefficients(self._loop.changed(inputs))
