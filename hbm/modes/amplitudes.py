"""How a motion at given amplitudes of the drive is started and followed: from a linear mode with the contact stuck."""

from dataclasses import dataclass, replace

import numpy as np

from continuation import Branch, ConvergenceError, Correction, End, NewtonSettings, Point, Predictor, Settings, solve_at
from hbm.balance.scaled import State
from hbm.balance.touching import Touching
from hbm.errors import expect_positive, expect_two, expect_whole
from hbm.fourier import Array
from hbm.modes.epmc import DriveAmplitude
from hbm.response.budget import Along, Budget, OnPoint, Until, continue_within
from models.jointed import AnyRig

TOLERANCE = 1e-10
"""Every balance closes to this fraction of ten times the motion's elastic force, the contact's in proportion."""

RANGE = (1e-2, 1e2)
"""Default range of amplitudes: force that a stuck contact would need, in units of the static load."""

STEP = 0.1
"""Largest step in decades of the amplitude; a tenth of the frequency, or of damping, counts as one."""

RELATIVE_STEP = 0.1 * STEP
"""The same of a large motion per amplitude, as beside internal resonances; by its frequency alone it counts 10."""

BUDGET = Budget(points=2000)

FOLDS, ADVICE = 40, "try a smaller range or fewer harmonics; the branch turns where another mode answers at one of them"
"""Few backbones fold more than twenty times in all; more in a tenth of the range are internal resonances of a motion
that strikes or sticks, and each harmonic that meets a mode adds some."""

EXCURSION = 0.5
"""How far a branch is followed beyond its ends, in decades."""

DOWN = 3.0
"""How far below the first amplitude, in decades, the contact is taken to stick where it does not stick there."""

RIGID = 1e-6
"""A mode below this fraction of the highest frequency is a rigid motion."""

NODE = 1e-3
"""Where a joint pushes a mode by less than this fraction of its elastic forces, it stands at a node or nearly so."""

STILL = 1e-6
"""A mode that moves the drive by less than this share of what all modes do together has a node there."""

FRICTIONLESS = (1e-6, 1e-2)
"""Default amplitudes where friction sets no scale [m]."""

CURVE_TOLERANCE = 1.5e-3
"""Largest error of a backbone between its points, of the motion: where slip begins it has a corner."""

NEWTON = NewtonSettings(tolerance=TOLERANCE, max_iterations=30)


def default_amplitudes(rig: AnyRig, mode: int = 1) -> tuple[float, float]:
    """Drive amplitudes [m] from contacts that all stick to contacts that all slide freely, or nearly so."""
    linear = StuckMode.of(rig, mode)
    pushed = np.abs(linear.forces) * np.linalg.norm(rig.structure.joints, axis=1)
    per_drive = np.where(pushed > NODE * linear.omega**2, np.abs(linear.forces / linear.drive), 0.0)
    scales = [load / per_drive[ports].max() for load, ports in rig.pressed if load > 0.0 and per_drive[ports].any()]
    return (RANGE[0] * min(scales), RANGE[1] * max(scales)) if scales else FRICTIONLESS


@dataclass(frozen=True, eq=False)
class StuckMode:
    """A linear mode with everything that touches stuck.

    Attributes
    ----------
    omega, damping : float
        Natural frequency [rad/s] and damping 2 zeta omega [1/s].
    shape : (n,) array
        Mass-normalised, of the modes of the structure.
    forces : (m,) array
        Force on the structure at each port where something touches, per unit of its coordinate.
    drive : float
        Drive displacement per unit of its coordinate.
    """

    omega: float
    damping: float
    shape: Array
    forces: Array
    drive: float

    @staticmethod
    def of(rig: AnyRig, mode: int) -> "StuckMode":
        """Mode of a rig by its number, counted from 1.

        Raises
        ------
        ValueError
            If there is no such mode, it is a rigid motion, or the drive stands at a node of it.
        """
        touching = Touching(rig)
        omega, shapes = touching.modes()
        if not 1 <= mode <= len(omega):
            raise ValueError(f"backbone: mode = {mode}; must be from 1 to {len(omega)}")
        rigid = np.count_nonzero(omega < RIGID * omega[-1])
        if mode <= rigid:
            raise ValueError(f"backbone: mode = {mode} is a rigid motion; must be from {rigid + 1} to {len(omega)}")
        found, shape, s = float(omega[mode - 1]), shapes[:, mode - 1], rig.structure
        forces = -touching.stiffness(found).real @ (s.joints @ shape)
        if held := touching.rigid:
            short = (s.omega_n**2 - found**2) * shape - s.joints.T @ forces
            forces[held] += np.linalg.lstsq(s.joints[held].T, short, rcond=None)[0]
        drive = float(s.excitation @ shape + s.flexibility_to_force @ forces)
        if abs(drive) < STILL * np.linalg.norm(s.excitation):
            raise ValueError(
                f"backbone: mode = {mode} ({found / (2.0 * np.pi):.5g} Hz) does not move the drive, by whose amplitude "
                "it is followed; must be a mode that does, or an excitation elsewhere"
            )
        return StuckMode(found, touching.damping(found, shape), shape, np.asarray(forces, dtype=float), drive)

    def motion(self, problem: DriveAmplitude, lam: float) -> Array:
        """Unknowns of its motion at an amplitude."""
        basis, q = problem.balance.basis, 10.0**lam / self.drive
        Q, T = np.zeros((basis.size, len(self.shape))), np.zeros((basis.size, len(self.forces)))
        sine = problem.fundamental[1]
        Q[sine], T[sine] = q * self.shape, q * self.forces
        moved, Omega = problem.balance.pack(State(Q, T, self.omega, 0.0))
        sustain = problem.pack_sustain(self.sustain(problem, self.damping, q), problem.scale(lam))
        return np.concatenate([moved / problem.scale(lam), [Omega, sustain]])

    def sustain(self, problem: DriveAmplitude, damping: float, q: float) -> float:
        """Relief [1/s], or force [N] whose work that is, against a damping [1/s] at an amplitude of its coordinate."""
        return damping * self.omega * q / self.drive if problem.grows else damping

    def weights(self, problem: DriveAmplitude, lam: float) -> Array:
        """Weights of the unknowns for continuation, from an amplitude on.

        The shape counts as much as a decade of the amplitude, a tenth of frequency or damping too. The forces where
        something touches follow from the motion and turn much faster: they hardly count.
        """
        x, unit = self.motion(problem, lam), self.sustain(problem, self.omega, 10.0**lam / self.drive)
        split = problem.balance.basis.size * len(self.shape)
        weights = np.full(problem.size, 1.0 / float(x[:split] @ x[:split]))
        weights[split:-2] *= 1e-3
        weights[-2] = 100.0 / x[-2] ** 2
        weights[-1] = 100.0 / problem.pack_sustain(unit, problem.scale(lam)) ** 2
        return weights


def traced(
    problem: DriveAmplitude,
    mode: int,
    amplitudes: tuple[float, float] | None,
    on_point: OnPoint | None,
    budget: Budget | None,
    until: Until | None = None,
) -> Branch:
    """Branch of a mode between two amplitudes [m], or to where it is of use.

    Raises
    ------
    ValueError
        If there is no such mode, or the amplitudes do not grow.
    ConvergenceError
        If there is no first motion.
    """
    expect_whole(mode, "mode", "backbone")
    given = default_amplitudes(problem.rig, mode) if amplitudes is None else amplitudes
    first, last = expect_two(given, "amplitudes", "backbone")
    for end in (first, last):
        expect_positive(end, "amplitudes", "backbone", "m")
    if not 0.0 < first < last:
        raise ValueError(f"backbone: amplitudes {first:g} to {last:g} m; must be > 0 and grow")
    lam, linear = (float(np.log10(first)), float(np.log10(last))), StuckMode.of(problem.rig, mode)
    first_motion = _first_motion(problem, linear, lam[0])
    return _continued(problem, linear, first_motion, lam, budget or BUDGET, on_point, until)


def _first_motion(problem: DriveAmplitude, linear: StuckMode, lam: float) -> Array:
    """Motion at the first amplitude: that of a stuck contact, or one reached from it."""
    result = solve_at(problem, linear.motion(problem, lam), lam, NEWTON)
    if result.converged:
        return result.x
    low = lam - DOWN
    stuck = solve_at(problem, linear.motion(problem, low), low, NEWTON)
    if not stuck.converged:
        raise ConvergenceError(
            f"backbone: no first motion at a drive amplitude of {10.0**lam:.6g} m, last residual "
            f"{result.residual_norm:.2g}, nor at {10.0**low:.6g} m; {stuck.reason.value}; try another amplitude, more "
            "harmonics, or the excitation where this mode moves most: where others outweigh it, none lags by 90°"
        )
    branch = _continued(problem, linear, stuck.x, (low, lam), BUDGET)
    return branch.require_complete().points[-1].x


def _continued(
    problem: DriveAmplitude,
    linear: StuckMode,
    x: Array,
    lam: tuple[float, float],
    budget: Budget,
    on_point: OnPoint | None = None,
    until: Until | None = None,
) -> Branch:
    along = Along(lambda at: float(10.0**at), "m", FOLDS, ADVICE)
    settings = _settings(linear.weights(problem, lam[0]), lam)
    branch = continue_within(budget, along, problem, x, lam[0], settings, on_point, until)
    return branch if branch.complete else replace(branch, message=branch.message + _answer(problem, branch.points[-1]))


def _answer(problem: DriveAmplitude, last: Point) -> str:
    """The harmonic that moves more than the fundamental where a branch ended early, in words; nothing where none does.

    A mode answers it: beside an internal resonance the drive may all but come to rest as that mode grows.
    """
    balance, (H, n) = problem.balance, (problem.balance.basis.H, problem.balance.structure.n)
    velocities = balance.basis.k[1:, None] * last.x[n : balance.basis.size * n].reshape(2 * H, n)
    energy = np.sum(velocities.reshape(2, H, n) ** 2, axis=0)
    k, share = int(energy.sum(axis=1).argmax()), energy.sum(axis=1).max() / energy.sum()
    at = (k + 1) * float(last.x[-2]) * balance.Omega_ref / (2.0 * np.pi)
    mode = int(energy[k].argmax()) + 1
    where = f"harmonic {k + 1}, {at:.5g} Hz, most in mode {mode}"
    return f"; internal resonance: {share:.0%} of the kinetic energy is in {where}" if k else ""


def _settings(weights: Array, lam: tuple[float, float]) -> Settings:
    return Settings(
        lam_end=lam[1],
        lam_min=lam[0] - EXCURSION,  # a branch may fold back past its start and return
        lam_max=lam[1] + EXCURSION,
        step=STEP / 5,
        step_min=STEP * 1e-6,
        step_max=STEP,
        relative_step=RELATIVE_STEP,
        tolerance=TOLERANCE,
        curve_tolerance=CURVE_TOLERANCE,
        weights=weights,
        max_points=20000,
        max_angle=1.0,
        corner_angle=0.5,
        tangent_slack=0.01,
        predictor=Predictor.CURVED,
    )


def solved(problem: DriveAmplitude, x: Array, lam: float) -> Correction:
    """Motion at an amplitude by Newton from a guess."""
    result = solve_at(problem, x, lam, NEWTON)
    if not result.converged:
        raise ConvergenceError(
            f"backbone: no convergence at a drive amplitude of {10.0**lam:.6g} m, last residual "
            f"{result.residual_norm:.2g}; {result.reason.value}; try another amplitude or more harmonics"
        )
    return result


def alone(points: tuple[Point, ...], settings: Settings) -> Branch:
    """Points each solved for itself: how a trace ended that led near them does not concern them."""
    return Branch(points, End.REACHED_END, "each solved at its amplitude or force", settings)
