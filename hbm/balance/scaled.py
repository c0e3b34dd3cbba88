"""Unknowns of a balance in units of their own, of a rig with one contact as of one with joints.

Scaling. Modal rows are divided by the largest generalised excitation, the rows where it touches by the excitation
amplitude: a residual of 1e-10 means that every force balance, harmonic by harmonic, closes to 1e-10 of the
excitation.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import prod
from typing import Any, Generic, Literal, NamedTuple, Self, TypeVar

import numpy as np

from hbm.errors import InputError
from hbm.fourier import Array, FourierBasis
from models.jointed import JointedRig
from models.parts import Excitation
from models.rig import Rig

Parameter = Literal["frequency", "force"]


@dataclass(frozen=True)
class State:
    """Unknowns in physical units: Q (2H+1, n), T (2H+1,) [N], Omega [rad/s] and force F [N]."""

    Q: Array
    T: Array
    Omega: float
    F: float


def force_shape(excitation: Excitation, basis: FourierBasis, periods: int) -> Array:
    """Coefficients of the excitation per amplitude of its fundamental, (2H+1,).

    Harmonics beyond H are left out, as on the way to a solution; :mod:`hbm.balance.tones` says how many hold them all.
    """
    shape = np.zeros(basis.size)
    for k, cosine, sine in excitation.tones:
        if k * periods <= basis.H:
            shape[k * periods], shape[basis.H + k * periods] = cosine, sine
    return shape


class Units(NamedTuple):
    """Units of the scaled unknowns and balances.

    Attributes
    ----------
    hz, F : float
        Frequency [Hz], force [N].
    modal_force, q : float
        Generalised force and coordinate of a mass-normalised mode.
    f : float or (m,) array
        Force where it touches, at each port of the joints.
    """

    hz: float
    F: float
    modal_force: float
    q: float
    f: Any


AnyRigKind = TypeVar("AnyRigKind", Rig, JointedRig)


class Scaled(ABC, Generic[AnyRigKind]):
    """Unknowns of a rig on a Fourier basis with one free parameter, in units of their own.

    Parameters
    ----------
    rig : Rig or JointedRig
    basis : FourierBasis
        Harmonics and samples.
    parameter : {"frequency", "force"}
        Continuation parameter: the frequency in units of `hz_ref`, or F / amplitude.
    hz : float
        Excitation frequency where the parameter is the force [Hz].
    level : float, optional
        Force amplitude where the parameter is the frequency [N]; the rig's where omitted.
    like : the same, optional
        Balance of a similar rig whose units the unknowns and equations take.
    periods : int
        Periods of the force in one of the motion; frequencies are those of the force, Omega that of the motion.
    """

    rig: AnyRigKind
    structure: Any
    basis: FourierBasis
    parameter: Parameter
    level: float
    fixed_hz: float
    periods: int
    omega_1: float

    def __init__(
        self,
        rig: AnyRigKind,
        basis: FourierBasis,
        *,
        parameter: Parameter = "frequency",
        hz: float = 0.0,
        level: float | None = None,
        like: Self | None = None,
        periods: int = 1,
    ) -> None:
        s = rig.structure
        self.rig, self.structure, self.basis, self.parameter = rig, s, basis, parameter
        self.level = rig.excitation.amplitude if level is None else level
        if self.level == 0.0:  # it is the unit of all forces
            raise InputError(f"{rig.name}: excitation.amplitude = 0; must be > 0 [N]")
        self.fixed_hz, self.periods = hz, periods
        elastic = s.omega_n[s.omega_n > 0.0]
        self.omega_1 = float(elastic[0]) if elastic.size else 2 * np.pi
        self._in_units(self._units() if like is None else like.units)
        self.force_shape = force_shape(rig.excitation, basis, periods)
        self._set_up(like)

    def _in_units(self, units: Units) -> None:
        """Take these units."""
        self.units = units
        self.hz_ref, self.F_ref, self.modal_force_ref, self.q_ref, self.f_ref = units
        self.Omega_ref = 2 * np.pi * self.hz_ref / self.periods
        self.lam_ref = self.Omega_ref if self.parameter == "frequency" else self.F_ref

    def _units(self) -> Units:
        modal_force = self.level * float(np.abs(self.structure.excitation).max())
        return Units(
            hz=2.0 ** round(float(np.log2(self.omega_1 / (2 * np.pi)))),  # a power of two: scaling back loses no digit
            F=self.level,
            modal_force=modal_force,
            q=10.0 * modal_force / self.omega_1**2,  # a tenfold dynamic amplification of the static response of mode 1
            f=self.level * self._levers(),
        )

    @abstractmethod
    def _levers(self) -> Any:
        """Units of the forces where it touches, in those of the excitation."""

    @abstractmethod
    def _set_up(self, like: Self | None) -> None:
        """Make ready what the equations need."""

    @property
    @abstractmethod
    def touching(self) -> tuple[int, ...]:
        """Shape of the coefficients of the forces where it touches."""

    # ---- vectors

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.basis.size * int(self.structure.n) + prod(self.touching)

    def pack(self, state: State) -> tuple[Array, float]:
        """Scaled unknowns and continuation parameter of a state."""
        x = np.concatenate([(state.Q / self.q_ref).ravel(), (state.T / self.f_ref).ravel()])
        return x, state.Omega / self.Omega_ref if self.parameter == "frequency" else state.F / self.F_ref

    def unpack(self, x: Array, lam: float) -> State:
        """State in physical units of scaled unknowns."""
        split = self.basis.size * self.structure.n
        Q = x[:split].reshape(self.basis.size, -1) * self.q_ref
        Omega, F = self.at(lam)
        return State(Q, x[split:].reshape(self.touching) * self.f_ref, Omega, F)

    def at(self, lam: float) -> tuple[float, float]:
        """Frequency [rad/s] and force amplitude [N] at a value of the continuation parameter."""
        if self.parameter == "frequency":
            return lam * self.Omega_ref, self.level
        return 2 * np.pi * self.fixed_hz / self.periods, lam * self.F_ref

    def hz_at(self, lam: float) -> float:
        """Frequency [Hz] at a value of the continuation parameter."""
        return lam * self.hz_ref if self.parameter == "frequency" else self.fixed_hz

    def lam_at(self, hz: float) -> float:
        """Value of the continuation parameter at a frequency [Hz], where the frequency is the parameter."""
        return hz / self.hz_ref

    def on(self, basis: FourierBasis) -> Self:
        """Return the same problem with other harmonics and samples."""
        return type(self)(
            self.rig, basis, parameter=self.parameter, hz=self.fixed_hz, level=self.level, periods=self.periods
        )

    def on_these_harmonics(self, coefficients: Array) -> Array:
        """Coefficients (2H'+1, ...) cut to these harmonics (2H+1, ...); new ones are zero."""
        H, given = self.basis.H, len(coefficients) // 2
        keep, out = min(H, given), np.zeros((self.basis.size, *coefficients.shape[1:]))
        source, target = (np.r_[0 : keep + 1, n + 1 : n + 1 + keep] for n in (given, H))
        out[target] = coefficients[source]
        return out
