"""Backbones: how frequency, damping and shape of a vibration change with its amplitude.

:func:`nonlinear_mode` gives a :class:`NonlinearMode`: the motion of a rig left to itself, made periodic at every
amplitude by the damping that it has there (extended periodic motion). :func:`phase_resonance` gives a
:class:`PhaseResonance`: the motion that lags its force by 90 degrees, with that force. Both are a :class:`Backbone`:
amplitude, frequency, damping ratio, energy lost and force along a branch of periodic solutions.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from continuation import Branch, Correction, Point, Settings
from hbm.balance.solution import PeriodicSolution, describe
from hbm.balance.tones import USUAL, basis_for
from hbm.errors import expect_rig
from hbm.fourier import Array, FourierBasis, default_samples
from hbm.labelled import dataset, frame
from hbm.modes.amplitudes import alone, solved, traced
from hbm.modes.columns import columns_of
from hbm.modes.epmc import DriveAmplitude, ForcedMotion, FreeMotion
from hbm.parallel import one_thread
from hbm.response.budget import Budget, OnPoint
from models.jointed import AnyRig

Complex = npt.NDArray[np.complex128]

LINES = 1e-5
"""Largest distance of lines between the motions of a dense backbone to its cubics, as a share of the motion."""


@dataclass(frozen=True, eq=False)
class Backbone(ABC):
    """A branch of periodic motions at growing amplitude.

    Attributes
    ----------
    rig : Rig or JointedRig
    points : tuple of PeriodicSolution
        In the order of travel; the drive displacement lags a cosine by 90 degrees.
    branch : continuation.Branch
        The branch in scaled unknowns: tangents, flags, why it ended.
    problem : DriveAmplitude
        Problem that the branch solves.
    """

    rig: AnyRig
    points: tuple[PeriodicSolution, ...]
    branch: Branch
    problem: DriveAmplitude

    def __repr__(self) -> str:
        """Range of amplitude and frequency, why it ended, and what is not known of it."""
        first, last = self.points[0], self.points[-1]
        begin, end = self.amplitude.min(), self.amplitude.max()
        unknown = "numerical error not estimated here, but by numerical_change(it)"
        what = {"NonlinearMode": "nonlinear mode", "PhaseResonance": "phase resonance"}[type(self).__name__]
        return (
            f"{what}: {len(self.points)} motions, drive amplitude {begin:.4g} to {end:.4g} m, "
            f"{first.hz:.6g} to {last.hz:.6g} Hz; {self.branch.message}; {unknown}"
        )

    @cached_property
    def amplitude(self) -> Array:
        """Fundamental amplitude of the drive displacement, (points,) [m]."""
        return np.asarray(10.0**self.branch.lam)

    @cached_property
    def hz(self) -> Array:
        """Frequency, (points,) [Hz]."""
        return np.array([p.hz for p in self.points])

    @property
    @abstractmethod
    def lost(self) -> Array:
        """Energy lost in one period, (points,) [J]."""

    @cached_property
    def rubbed(self) -> Array:
        """Energy lost to friction, or to all joints (dashpots too), in one period, (points,) [J]."""
        return np.array([p.friction_loss for p in self.points])

    @cached_property
    def damping_ratio(self) -> Array:
        """Damping ratio of an oscillator that loses as much from the same motion, (points,)."""
        return np.asarray(self.lost / (2 * np.pi * np.array([_squared_velocity(p) for p in self.points])))

    @property
    def decay_rate(self) -> Array:
        """Rate at which the drive amplitude of a free decay falls, (points,) [1/s]; nan: only a free motion decays."""
        return np.full(len(self.points), np.nan)

    @property
    def decaying_hz(self) -> Array:
        """Frequency of a free decay that passes through each motion, (points,) [Hz]."""
        return np.asarray(self.hz * np.sqrt(np.maximum(1.0 - self.damping_ratio**2, 0.0)))

    @cached_property
    def force(self) -> Array:
        """Amplitude of the force at the drive that supplies what is lost, (points,) [N]."""
        return np.asarray(self.lost / (np.pi * self.amplitude))

    @cached_property
    def shape(self) -> Complex:
        """Fundamental of each mode per drive displacement, (points, n) [1/sqrt(kg)]; complex, conjugate for a lag."""
        drive = np.array([_fundamental(p["drive"].coefficients) for p in self.points])
        return np.asarray(np.array([_fundamental(p.state.Q) for p in self.points]) / drive[:, None])

    @cached_property
    def participation(self) -> Array:
        """Share of each mode in the kinetic energy of the fundamental, (points, n)."""
        squared = np.abs(self.shape) ** 2
        return np.asarray(squared / squared.sum(axis=1, keepdims=True))

    @property
    def columns(self) -> dict[str, Array]:
        """Columns of a table, a row for each motion; names end in units."""
        return columns_of(self)

    def to_dataframe(self) -> Any:
        """The :attr:`columns`, those of a file of ``hbm backbone``, as a pandas.DataFrame.

        Raises
        ------
        InputError
            If pandas is not installed.
        """
        return frame("to_dataframe", self.columns)

    def to_xarray(self) -> Any:
        """The :attr:`columns` over the point, as an xarray.Dataset.

        Raises
        ------
        InputError
            If xarray is not installed.
        """
        variables = {name: (("point",), values, "") for name, values in self.columns.items()}
        return dataset("to_xarray", variables, {"point": variables.pop("point")}, rig=self.rig.name)

    @property
    def lift_off(self) -> float | None:
        """Amplitude beyond which the tip would first lift off [m], between two points; None where it never would.

        Joints that can separate do; for them it is never said.
        """
        if "normal" not in self.points[0].channels:
            return None
        least, lam = np.array([p["normal"].samples.min() for p in self.points]), self.branch.lam
        lifted = np.flatnonzero(least < 0.0)
        if not lifted.size or lifted[0] == 0:
            return float(self.amplitude[0]) if lifted.size else None
        i = int(lifted[0])
        return float(10.0 ** np.interp(0.0, least[[i, i - 1]], lam[[i, i - 1]]))

    @cached_property
    def dense(self) -> Self:
        """The backbone with motions between its points, so many that lines from one to the next draw it.

        They lie on the cubics between its points, as those of :attr:`hbm.response.curve.ResponseCurve.dense` do, closer
        together: the damping is a small part of the motion.
        """
        branch = self.branch.dense(LINES)
        return replace(self, branch=branch, points=described(self.problem, branch.points))

    @property
    def complete(self) -> bool:
        """Whether the last amplitude was reached."""
        return self.branch.complete

    @property
    def folds(self) -> list[float]:
        """Amplitudes at which the branch turns back [m]."""
        return [float(10.0 ** (p.fold_lam if p.fold_lam is not None else p.lam)) for p in self.branch.points if p.fold]

    def at(self, amplitudes: Sequence[float]) -> Self:
        """The motions at given amplitudes [m], solved there, each where the branch first comes to it.

        Raises
        ------
        ValueError
            If the branch does not come to one of them.
        continuation.ConvergenceError
            If one cannot be solved.
        """
        return self._solved(self.near(amplitudes), np.log10(amplitudes))

    def at_force(self, forces: Sequence[float]) -> Self:
        """The motions at given forces [N], each where the branch first comes to it; errors as :meth:`at`."""
        crossings = [self._crossing("force", "N", self.force, F) for F in forces]
        lams = [self._lam_of(F, i) for F, i in zip(forces, crossings, strict=True)]
        return self._solved([self._between(i, lam) for i, lam in zip(crossings, lams, strict=True)], lams)

    def _crossing(self, what: str, unit: str, values: Array, wanted: float) -> int:
        """First point behind which a quantity passes a value."""
        beyond = values / wanted - 1.0
        beyond[np.abs(beyond) < 1e-12] = 0.0  # an end of the branch is on it
        passed = np.flatnonzero(beyond[:-1] * beyond[1:] <= 0.0)
        if not passed.size:
            span = f"must lie between {values.min():.4g} and {values.max():.4g} {unit}"
            raise ValueError(f"backbone: {what} = {wanted:g} {unit}; {span}")
        return int(passed[0])

    def _lam_of(self, force: float, i: int) -> float:
        ends = (float(self.branch.points[i].lam), float(self.branch.points[i + 1].lam))

        def missing(lam: float) -> float:
            return float(np.log(self._solved([self._between(i, lam)], [lam]).force[0] / force))

        return float(brentq(missing, *ends, xtol=1e-12, rtol=1e-12))

    def _solved(self, near: Sequence[Array], lams: Sequence[float] | Array) -> Self:
        """Motions at given parameters, from unknowns near them."""
        found = [solved(self.problem, x, float(lam)) for x, lam in zip(near, lams, strict=True)]
        motions = described(self.problem, points := tuple(point_of(self.problem, f) for f in found))
        return replace(self, points=motions, branch=alone(points, self.branch.settings))

    def _between(self, i: int, lam: float) -> Array:
        """Unknowns between a point and the next, to first order."""
        a, b = self.branch.points[i], self.branch.points[i + 1]
        return np.asarray(a.x + (lam - a.lam) / (b.lam - a.lam) * (b.x - a.x))

    def near(self, amplitudes: Sequence[float] | Array) -> list[Array]:
        """Unknowns at given amplitudes [m] to first order, where :meth:`at` would begin; errors as there."""
        return [
            self._between(self._crossing("amplitude", "m", self.amplitude, a), float(np.log10(a))) for a in amplitudes
        ]


@dataclass(frozen=True, eq=False, repr=False)
class NonlinearMode(Backbone):
    """A damped nonlinear normal mode: free motion, with the mass-proportional damping xi that would keep it up.

    A free decay has, at each amplitude it comes through, this frequency, damping ratio xi / (2 Omega) and shape.
    """

    @staticmethod
    def of(
        problem: DriveAmplitude, found: Sequence[Correction], motions: tuple[PeriodicSolution, ...]
    ) -> "NonlinearMode":
        """Motions that were solved at some amplitudes, on no traced branch, and what they are in physical terms."""
        points = tuple(point_of(problem, f) for f in found)
        return NonlinearMode(problem.rig, motions, alone(points, Settings(lam_end=points[-1].lam)), problem)

    @cached_property
    def lost(self) -> Array:
        """Energy lost in one period, (points,) [J]: what the damping taken away would give back."""
        relief = np.array([self.problem.unpack(p.x, p.lam)[0].relief for p in self.branch.points])
        squared = np.array([_squared_velocity(p) for p in self.points])
        return np.asarray(relief / (2 * self.hz) * squared)

    @cached_property
    def decay_rate(self) -> Array:
        """Rate -A'/A at which the drive amplitude A of a free decay falls, (points,) [1/s]; nan where it tells nothing.

        Averaged over a period, the action (sum of the squared velocities over the frequency) falls at the rate xi; the
        amplitude falls at half that rate where frequency and shape do not change with it. Of the motion of a single
        mode the shape changes little. It is nan where its change changes the action by more than half of what amplitude
        and frequency do, or harmonics hold more of the action than the fundamental: beside internal resonances.
        """
        by_frequency, by_shape, harmonics = np.array([self._action_growth(p) for p in self.branch.points]).T
        alike = 2.0 + by_frequency
        rate = 4 * np.pi * self.hz * self.damping_ratio / (alike + by_shape)
        return np.where((np.abs(by_shape) < 0.5 * alike) & (harmonics < 0.5), rate, np.nan)

    def _action_growth(self, point: Point) -> tuple[float, float, float]:
        """Derivatives d ln(action) / d ln A by frequency and shape, from the tangent; share of the harmonics from 2."""
        balance, split = self.problem.balance, self.problem.balance.basis.size * self.problem.balance.structure.n
        k = np.repeat(balance.basis.k, balance.structure.n)
        Q, by_step = point.x[:split], point.tangent_x
        action, along = float(k**2 * Q @ Q), np.log(10.0) * point.tangent_lam
        by_shape = 2 * float(k**2 * Q @ by_step[:split]) / action
        harmonics = float(np.sum((k * Q)[k > 1] ** 2)) / action
        return float(by_step[-2] / point.x[-2] / along), float(by_shape / along), harmonics


@dataclass(frozen=True, eq=False, repr=False)
class PhaseResonance(Backbone):
    """Motions at phase resonance, the drive displacement 90 degrees behind the force."""

    @cached_property
    def lost(self) -> Array:
        """Work of the force in one period, (points,) [J], which is lost."""
        return np.array([_work(p, self.problem.balance.force_shape) for p in self.points])


@one_thread
def nonlinear_mode(
    rig: AnyRig,
    mode: int = 1,
    *,
    amplitudes: tuple[float, float] | None = None,
    harmonics: int | None = None,
    samples: int | None = None,
    on_point: OnPoint | None = None,
    budget: Budget | None = None,
) -> NonlinearMode:
    """Damped nonlinear normal mode of a rig, by the extended periodic motion concept.

    Parameters
    ----------
    rig : Rig or JointedRig
        Its excitation gives the place of the drive; no force acts.
    mode : int
        Number of the mode, counted from 1, of those with the contact stuck.
    amplitudes : (float, float), optional
        First and last fundamental amplitude of the drive displacement [m]; where omitted, from a contact that sticks to
        one that slides, :func:`hbm.modes.amplitudes.default_amplitudes`.
    harmonics, samples : int, optional
        Highest harmonic H, 15 where omitted, and samples per period N_t.
    on_point : callable, optional
        Progress: called with amplitude and point number.
    budget : Budget, optional
        Most points and seconds of the trace; :data:`hbm.modes.amplitudes.BUDGET` where omitted.

    Returns
    -------
    NonlinearMode
        Partial where a step could not be made, the budget was spent, or the branch turns in place; see `complete`.

    Raises
    ------
    ValueError
        If there is no such mode, or the amplitudes do not grow.
    continuation.ConvergenceError, ArithmeticError
        If there is no first motion; if joints that push find no balance at rest.

    Examples
    --------
    >>> from hbm.models.published import paper_rig
    >>> mode = nonlinear_mode(paper_rig(), amplitudes=(1e-6, 1e-4), harmonics=3)
    >>> mode.hz[[0, -1]].round(2)
    array([56.  , 51.08])
    """
    expect_rig(rig, "nonlinear_mode", joints=True)
    H = USUAL if harmonics is None else harmonics  # no force acts, whose harmonics they had to hold
    motion = FreeMotion(rig, FourierBasis(H, samples or default_samples(H)))
    branch = traced(motion, mode, amplitudes, on_point, budget)
    return NonlinearMode(rig, described(motion, branch.points), branch, motion)


@one_thread
def phase_resonance(
    rig: AnyRig,
    mode: int = 1,
    *,
    amplitudes: tuple[float, float] | None = None,
    harmonics: int | None = None,
    samples: int | None = None,
    on_point: OnPoint | None = None,
    budget: Budget | None = None,
) -> PhaseResonance:
    """Motions whose drive displacement lags the force by 90 degrees; parameters and errors as :func:`nonlinear_mode`.

    Harmonics are to hold those of the force, as of :func:`hbm.steady_state`.

    Returns
    -------
    PhaseResonance
    """
    expect_rig(rig, "phase_resonance", joints=True)
    motion = ForcedMotion(rig, basis_for(rig, harmonics, samples, "phase_resonance"))
    branch = traced(motion, mode, amplitudes, on_point, budget)
    return PhaseResonance(rig, described(motion, branch.points), branch, motion)


def point_of(problem: DriveAmplitude, found: Correction) -> Point:
    """A motion solved at an amplitude, with the tangent of the branch through it."""
    none = np.zeros_like(found.x)
    tangent, _ = found.linearization.solve_bordered(none, 1.0, none, 1.0)
    alone = float("nan")
    return Point(found.x, found.lam, tangent, 1.0, alone, alone, found.iterations, found.residual_norm)


def described(problem: DriveAmplitude, points: Sequence[Point]) -> tuple[PeriodicSolution, ...]:
    """The motions at points of a branch."""
    return tuple(describe(*problem.unpack(p.x, p.lam)) for p in points)


def _squared_velocity(point: PeriodicSolution) -> float:
    """Integral over a period of the squared modal velocities, over pi / Omega: sum of their squared coefficients."""
    return float(np.sum((2 * np.pi * point.hz * point.basis.derivative(point.state.Q)) ** 2))


def _work(point: PeriodicSolution, force_shape: Array) -> float:
    """Work of the excitation in one period [J]."""
    moved = point.basis.derivative(point["drive"].coefficients)
    return float(np.pi * point.level * (force_shape @ moved))


def _fundamental(coefficients: Array) -> Complex:
    """Complex fundamental of coefficients (2H+1, ...)."""
    H = len(coefficients) // 2
    return np.asarray(coefficients[1] - 1j * coefficients[H + 1])
