"""Alternating frequency/time for a joint: steady forces at its ports over one period, with exact derivatives.

CasADi differentiates the law sample by sample; what couples the samples (its memory) is a linear recurrence, solved
backwards for the Fourier coefficients of the forces.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hbm.aft.jointstep import JointFunctions, joint_functions, signals_of, values
from hbm.aft.period import SlopesWhenAsked, buffered
from hbm.aft.recurrence import NEUTRAL, forwards, gradients, monodromy, radius
from hbm.fourier import Array, FourierBasis
from models.joints.law import JointLaw

ITERATIONS = (3, 9)
"""On f = law(f) at each sample, enough for most; more where those left more than CLOSURE."""

MOST_PERIODS = 8
"""Newton iterations on the memory that a period maps on itself."""

CLOSURE = 1e-12
"""A loop counts as closed when the forces after a period repeat to this fraction of the largest."""


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


class JointOverPeriod(SlopesWhenAsked):
    """A law on a Fourier basis: coefficients of the signals at a joint in, of its forces out.

    Signals are the displacements of the ports, the displacements whose rates are the velocities that the law is shown
    (the same, or without what the modes leave out), and last what the load differs by from that at rest.

    One object serves one thread: it owns the buffers that CasADi reads and fills.
    """

    def __init__(self, law: JointLaw, basis: FourierBasis, compliance: float = 0.0, *, loaded: bool = True) -> None:
        self.law, self.basis, self.compliance, self.ports = law, basis, compliance, law.ports
        self._sampled = np.zeros((basis.N_t, signals_of(law.ports)))
        self._shown: tuple[Array | None, float] = (None, 0.0)
        self._fades, self._loaded = False, loaded
        self._bind(ITERATIONS[0])

    def _bind(self, iterations: int) -> None:
        self._iterations = iterations
        self.functions: JointFunctions = joint_functions(self.law, self.basis.N_t, iterations)
        period = self.functions.period
        self._carried, self._environment = np.zeros(period.size1_in(0)), np.zeros(period.size1_in(2))
        self._inputs = [self._carried, self._sampled, self._environment, values(self.law)]
        self._march, (self._marched,) = buffered(self.functions.march, self._inputs)
        self._with_slopes, (f, self._gap, slopes, self._end) = buffered(period, self._inputs)
        self._without_slopes, _ = buffered(self.functions.force, self._inputs, [f, self._gap, self._end])
        N_t, m, n_z = self.basis.N_t, self.ports, self.functions.memory
        self._f = f.reshape(N_t, m)
        # rows: forces, memory; columns: memory before, signals read, dt
        self._slopes = slopes.reshape(N_t, m + n_z, -1)
        self._sloped = False

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
        self._shown = (signals, Omega)
        m, basis = self.ports, self.basis
        shown = signals.copy()
        shown[:, m : 2 * m] = Omega * basis.derivative(signals[:, m : 2 * m])
        self._sampled[:] = basis.samples(shown)
        closure = self._close(Omega)
        while closure > CLOSURE and np.abs(self._gap).max() > CLOSURE * np.abs(self._f).max():
            if self._iterations == ITERATIONS[-1]:
                break
            self._bind(ITERATIONS[-1])
            closure = self._close(Omega)
        return self._f, closure

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
    def undying(self) -> int:
        """How many disturbances of the memory return undiminished where the motion is held: anchors that stick."""
        if not self.functions.memory:
            return 0
        return int(np.count_nonzero(np.abs(np.linalg.eigvals(monodromy(self._transitions))) >= 1.0 - NEUTRAL))

    def _close(self, Omega: float) -> float:
        """March until the loop is measured closed, from the virgin state unless its memory fades."""
        self._environment[:] = 2 * np.pi / (Omega * self.basis.N_t), self.compliance
        if self._fades:
            closure = self._close_from_here()
            if closure <= CLOSURE and radius(self._transitions) < 1.0 - NEUTRAL:
                return closure
        self._carried[:] = 0.0
        return self._close_from_here()

    def _close_from_here(self) -> float:
        n = self.functions.memory
        if len(self._carried):
            self._march()
            self._carried[:] = self._marched
        closure = 0.0
        for _ in range(MOST_PERIODS):
            self._period()
            gap = self._end[:n] - self._carried[:n]
            if not gap.any() and not self._gap.any():  # friction that slips forgets where it came from
                return 0.0
            pull = self._pull
            largest = float(np.abs(self._f).max())
            missing = max(float(np.abs(pull * gap).max(initial=0.0)), float(np.abs(self._gap).max()))
            closure = missing / largest if largest > 0.0 else 0.0
            if not closure > CLOSURE or not n:
                break
            self._fades = True
            slope = np.eye(n) - monodromy(self._transitions) * pull[:, None] / pull
            self._carried[:n] += np.linalg.lstsq(slope, pull * gap, rcond=1e-9)[0] / pull
        return closure

    @property
    def _transitions(self) -> Array:
        n = self.functions.memory
        return self._local[:, self.ports :, :n]

    @property
    def _pull(self) -> Array:
        """Largest change of a force per unit of each memory, (memory,): they have units of their own."""
        pull = np.abs(self._local[:, : self.ports, : self.functions.memory]).max(axis=(0, 1))
        return np.where(pull > 0.0, pull, 1.0)

    # ---- derivatives

    def _show(self, signals: Array, Omega: float) -> None:
        if self._shown[0] is not signals or self._shown[1] != Omega:
            self.forces(signals, Omega)

    def linearize(self, signals: Array, Omega: float) -> JointForces:
        """Steady forces with the derivatives of their coefficients; arguments as :meth:`forces`."""
        self._show(signals, Omega)
        basis, m, all_signals, f = self.basis, self.ports, signals_of(self.ports), self._f.copy()
        by_samples = gradients(self._local, m, basis.analysis, self._first_period)
        found: dict[int, Array] = {}
        for by, i in zip(by_samples, self.functions.reads, strict=False):  # the time between samples comes last
            now, i = i < all_signals, i % all_signals
            if i != 2 * m or self._loaded:
                by = by if now else np.roll(by, -1, axis=-1)  # the sample before the first is the last
                found[i] = found[i] + by if i in found else by
        found = dict(sorted(found.items()))
        by_used = np.array([by @ basis.synthesis for by in found.values()]).reshape(-1, m, basis.size, basis.size)
        by_Omega = np.zeros((m, basis.size))
        for i, by in zip(found, by_used, strict=True):
            if m <= i < 2 * m:
                by_Omega += by @ basis.derivative(signals[:, i])
                by[:] = Omega * basis.derivative_on_right(by.reshape(-1, basis.size)).reshape(by.shape)
        if self.functions.timed:
            by_Omega -= by_samples[-1].sum(axis=-1) * 2 * np.pi / (Omega**2 * basis.N_t)
        return JointForces(f, tuple(found), by_used, by_Omega.T)

    def _first_period(self) -> Array:
        """Derivatives along the period from the virgin state; the buffers go on holding the steady one."""
        steady, local = self._carried.copy(), self._local.copy()
        self._carried[:] = 0.0
        self._with_slopes()
        first = self._slopes.copy()
        self._carried[:] = steady
        self._slopes[:] = local
        return first

    def along(self, signals: Array, Omega: float, numbers: Array, compliance: Array) -> Array:
        """Derivatives of the coefficients of the forces to numbers of the law, signals held, (2H+1, m, c).

        Parameters
        ----------
        signals, Omega
            As for :meth:`forces`.
        numbers : (p, c) array
            Changes of the law's parameters.
        compliance : (c,) array
            Change of the compliance that the law takes into account.
        """
        self._show(signals, Omega)
        m, n, basis = self.ports, self.functions.memory, self.basis
        held = self._slopes.shape[2]
        evaluate, (_, _, local, _) = buffered(self.functions.by_numbers, self._inputs)

        def read() -> Array:
            evaluate()
            table = local.reshape(basis.N_t, m + n, -1)
            return np.concatenate([table[:, :, :n], table[:, :, held:]], axis=2)

        def virgin() -> Array:
            kept = self._carried.copy()
            self._carried[:] = 0.0
            found = read()
            self._carried[:] = kept
            return found

        inputs = np.broadcast_to(np.vstack([numbers, compliance]), (basis.N_t, len(numbers) + 1, numbers.shape[1]))
        return self._followed(read(), inputs, virgin)

    def pushed(self, signals: Array, Omega: float, change: Array) -> Array:
        """Change (2H+1, m, c) of the coefficients of the forces with small changes of the signals, no matrix made.

        Parameters
        ----------
        signals, Omega
            As for :meth:`forces`.
        change : (2H+1, 2 m + 1, c) array
            Of the signals.
        """
        self._show(signals, Omega)
        m, basis, all_signals = self.ports, self.basis, signals_of(self.ports)
        shown = change.copy()
        for i in range(m, 2 * m):
            shown[:, i] = Omega * basis.derivative(change[:, i])
        now = basis.samples(shown)
        before = np.roll(now, 1, axis=0)
        inputs = np.stack([(now, before)[i // all_signals][:, i % all_signals] for i in self.functions.reads], axis=1)
        n = self.functions.memory + len(self.functions.reads)  # the time between samples, which is held, comes last
        return self._followed(self._local[:, :, :n], inputs, lambda: self._first_period()[:, :, :n])

    def _followed(self, by: Array, inputs: Array, virgin: Callable[[], Array]) -> Array:
        """Change (2H+1, m, c) of the coefficients of the forces with inputs (N_t, i, c) of a loop that stays closed.

        `by` (N_t, m + memory, memory + i) are slopes along the steady period, those that `virgin` makes along the
        period before, from the virgin state.
        """
        m, n, basis = self.ports, self.functions.memory, self.basis

        def march(by: Array, start: Array) -> tuple[Array, Array]:
            driven = np.matmul(by[:, :, n:], inputs)
            if n == 0:
                return driven, start
            z = forwards(by[:, m:, :n], start, driven[:, m:])
            return driven[:, :m] + np.matmul(by[:, :m, :n], z[:-1]), z[-1]

        start: Array = np.zeros((n, inputs.shape[2]))
        transitions = by[:, m:, :n]
        if n and radius(transitions) < 1.0 - NEUTRAL:
            start[:] = np.linalg.solve(np.eye(n) - monodromy(transitions), march(by, start)[1])
        elif n:  # a joint that stays stuck remembers the period before, which started from its virgin state
            start = march(virgin(), start)[1]
        return basis.coefficients(march(by, start)[0])
