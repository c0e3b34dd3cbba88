"""A friction law under observed signals: its force, how that changes with its parameters and with noise."""

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from hbm.aft.force import ContactForce, Environment, InputChange, LawOverPeriod
from hbm.errors import InputError
from hbm.fourier import Array, FourierBasis
from hbm.inverse.observed import Observed, ObservedRecord
from models.friction import FrictionLaw

BALANCED = 1e-5
"""Force and motion above the measured harmonics are iterated to this fraction of the force; one step more follows."""

MOST_ITERATIONS = 20

OPEN = 1e-2
"""A law whose force is short of its own by more than this share of its peak is too stiff to be solved."""

FORCE_FLOOR = 2e-4
"""Numerical floor of each coefficient of the force, as a fraction of its largest harmonic."""


@dataclass(frozen=True, eq=False)
class Answer:
    """Force of a law in one record.

    Attributes
    ----------
    T : (2H+1,) array
        Coefficients on the wide basis [N].
    signals : (2H+1, 4) array
        Signals that the law was shown.
    slopes : ContactForce
        Derivatives of the law's force to what it was shown.
    matrix : (2H+1, 2H+1) array
        Takes a change of the force to the change of the signals' part that made it.
    balanced : bool
        Whether the motion above the measured harmonics was found; else it is left out.
    """

    T: Array
    signals: Array
    slopes: ContactForce
    matrix: Array
    balanced: bool


class LawOnRecords:
    """A law (its class and settings; parameters are arguments) beside observed records.

    One object serves one thread, and remembers the last answers to start from.
    """

    def __init__(self, law: FrictionLaw, observed: Observed) -> None:
        if law.set_valued and not observed.compliance > 0.0:
            raise InputError(
                f"identify: law {law.name} sticks rigidly and the structure has no residual compliance: slip "
                "tells nothing of the force; take a law with a stiffness"
            )
        self.observed = observed
        # a loop closes fastest from its own last state: one for each record
        self._laws = {record.number: LawOverPeriod(law, observed.basis) for record in observed.records}
        self._last: dict[int, Array] = {}
        self.evaluations = 0

    @property
    def basis(self) -> FourierBasis:
        """Harmonics and samples."""
        return self.observed.basis

    def environment(self, values: Array) -> Environment:
        """Inputs of the law besides signals, for parameters `values` (p,)."""
        return Environment(self.observed.compliance, self.observed.load, values)

    def start_from(self, other: "LawOnRecords") -> None:
        """Start from the answers that another object of the same law found last."""
        self._last.update(other._last)

    # ---- force

    def answer(self, record: ObservedRecord, values: Array) -> Answer:
        """Force of the law with parameters `values` (p,), by Newton's method from the last answer."""
        if record.gains.any():
            start = self._last.get(record.number)
            tries = [np.zeros(self.basis.size)] if start is None else [start, np.zeros(self.basis.size)]
            for T in tries:
                found = self._balanced(record, values, T)
                if found is not None:
                    self._last[record.number] = found.T
                    return found
        return self._truncated(record, values, balanced=not record.gains.any())

    def _balanced(self, record: ObservedRecord, values: Array, T: Array) -> Answer | None:
        for _ in range(MOST_ITERATIONS):
            signals, slopes = self._law_of(record, values, T)
            matrix = np.eye(len(T)) - _feedback(slopes, record)
            missing = slopes.coefficients - T
            size = np.abs(slopes.coefficients).max()
            if not np.isfinite(size) or self._laws[record.number].closure > OPEN:
                return None
            if np.abs(missing).max() <= BALANCED * size:
                return Answer(T + np.linalg.solve(matrix, missing), signals, slopes, matrix, True)
            T = T + np.linalg.solve(matrix, missing)
        return None

    def _truncated(self, record: ObservedRecord, values: Array, balanced: bool) -> Answer:
        """Answer to the measured harmonics alone."""
        signals, slopes = self._law_of(record, values, record.friction * (np.arange(self.basis.size) == 0))
        return Answer(slopes.coefficients, signals, slopes, np.eye(self.basis.size), balanced)

    def _law_of(self, record: ObservedRecord, values: Array, T: Array) -> tuple[Array, ContactForce]:
        self.evaluations += 1
        basis, change = self.basis, T.copy()
        change[0] -= record.friction[0]  # the mean that the reconstruction assumed is in the signals already
        own = basis.complex(change)
        u, rho, eta = (record.signals[:, i] + basis.real(gain * own) for i, gain in enumerate(record.gains))
        signals = np.stack([u, record.Omega * basis.derivative(u), rho, eta], axis=1)
        return signals, self._laws[record.number].linearize(signals, record.Omega, self.environment(values))

    # ---- its derivatives

    def by_parameters(self, record: ObservedRecord, answer: Answer, values: Array) -> Array:
        """Derivatives of the force's coefficients to the law's parameters, (2H+1, p)."""
        p = len(values)
        change = InputChange(np.zeros((self.basis.size, 3, p)), np.zeros(p), np.eye(p + 1, p))
        along = self._laws[record.number].along(answer.signals, record.Omega, self.environment(values), change)
        return np.asarray(np.linalg.solve(answer.matrix, self.basis.analysis @ along))

    # ---- beside the reconstruction

    def residual(self, record: ObservedRecord, answer: Answer) -> Array:
        """Reconstructed less predicted force, the coefficients compared (2 harmonics,) [N]."""
        shift = record.by_mean * (answer.T[0] - record.friction[0])
        return np.asarray((record.friction + shift - answer.T)[self.observed.compared])

    def residual_change(self, record: ObservedRecord, change: Array) -> Array:
        """Change of the residual with that of the law's force (2H+1, p)."""
        moved = np.outer(record.by_mean, change[0]) - change
        return np.asarray(moved[self.observed.compared])

    def _deviations(self, record: ObservedRecord, answer: Answer) -> Array:
        """Deviations (2 harmonics, m) of the residual by those of the record [N].

        By noise of the reconstructed force and, through the law's slope, of the slip and reaction it is shown.
        """
        law: Array = np.zeros(record.noise.shape[1:])
        slopes = (answer.slopes.by_u, answer.slopes.by_rho, answer.slopes.by_eta)
        for slope, noise in zip(slopes, record.noise[1:], strict=True):
            if slope is not None:
                law += slope @ noise
        law = np.asarray(np.linalg.solve(answer.matrix, law))
        return np.asarray(record.noise[0][self.observed.compared] + self.residual_change(record, law))

    def root(self, record: ObservedRecord, answer: Answer) -> Array:
        """Lower factor L of the covariance L L' of the residual [N]."""
        return self._root(record, self._deviations(record, answer))

    def _root(self, record: ObservedRecord, deviations: Array) -> Array:
        """The same by its deviations (2 harmonics, m).

        A floor for what numerics leave, and for the second order of the law's slope: the square of the largest
        deviation over the force. It is factored as it is: squared, deviations of a loop that hardly closes would drown
        the rest.
        """
        force = max(float(np.abs(record.friction[1:]).max()), np.finfo(float).tiny)
        second_order = float(np.linalg.norm(deviations, 2)) ** 2 / force
        floor = np.hypot(FORCE_FLOOR * force, min(second_order, force))
        return np.asarray(np.linalg.qr(np.vstack([deviations.T, floor * np.eye(len(deviations))]), mode="r")).T

    def by_noise(self, record: ObservedRecord, answer: Answer) -> float:
        """The chi2 of a record that noise alone makes, less than its coefficients: standard deviations have floors."""
        deviations = self._deviations(record, answer)
        noise = deviations[:, : deviations.shape[1] - record.numerical]
        white = linalg.solve_triangular(self._root(record, deviations), noise, lower=True)
        return float(np.sum(white**2))


def _feedback(slopes: ContactForce, record: ObservedRecord) -> Array:
    """Change of the law's force with its own, through the motion above the measured harmonics."""
    out = np.zeros((len(slopes.coefficients),) * 2)
    for slope, gain in zip((slopes.by_u, slopes.by_rho, slopes.by_eta), record.gains, strict=True):
        if slope is not None:
            out += _through(slope, gain)
    return out


def _through(slope: Array, gain: Array) -> Array:
    """Product of a slope (2H+1, 2H+1) with the multiplication of each harmonic by a complex gain (H+1,)."""
    H = len(gain) - 1
    out = slope * np.concatenate([gain.real, gain.real[1:]])
    # a - i b is turned by the gain: the sine column feeds the cosine with +imag, the cosine the sine with -imag
    out[:, 1 : H + 1] -= slope[:, H + 1 :] * gain.imag[1:]
    out[:, H + 1 :] += slope[:, 1 : H + 1] * gain.imag[1:]
    return np.asarray(out)
