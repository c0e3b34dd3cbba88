"""Points on the way of a step: next to its corner, at its fold, and where the cubic between its ends is not true.

The cubic is judged at two places, where a residual and the slope at the far end tell how far the curve is from it: a
Newton step that is not taken. Where that is more than `Settings.curve_tolerance` the curve is solved in the middle, and
both halves are judged. A step that is off by more than halving mends is refused.
"""

import math
from dataclasses import replace

import numpy as np

from .corner import Corner
from .geometry import Frame, Metric, Stretch, arc_length, frame_along
from .newton import Border, correct, max_norm
from .problem import Array, Linearization, Problem
from .settings import Settings
from .step import Step

_JUDGED = (0.3, 0.7)
_LARGER = 1.417  # in the middle of a smooth curve the error is that much larger than there
_HALVINGS = 6
_HALVED = 64.0  # times what is allowed: where the curve is smooth, a halving gains 16
_BESIDE = 1e-3  # of the way: closer solutions are no points of their own


class Filling:
    """Parts of steps, judged by the cubic.

    Parameters
    ----------
    problem, metric, settings
        The system, and how lengths, residuals and the cubic are judged.
    """

    def __init__(self, problem: Problem, metric: Metric, settings: Settings) -> None:
        self.problem, self.metric, self.settings = problem, metric, settings

    def around_corner(self, before: Frame, step: Step, corner: Corner) -> tuple[Step, ...]:
        """To the corner, over it, and on from it."""
        steps: tuple[Step, ...] = ()
        apart = _BESIDE * step.length
        if self.metric.norm(corner.before.state - before.state) > apart:
            steps = self._smooth(before, self._to(corner.before, before, step))
            before = corner.before
        if self.metric.norm(step.frame.state - corner.behind.state) <= apart:
            return (*steps, replace(step, length=self.metric.norm(step.frame.state - before.state)))
        over = replace(self._to(corner.behind, before, step), corner=corner, branch_point=step.branch_point)
        return (*steps, over, *self._smooth(corner.behind, self._to(step.frame, corner.behind, step)))

    def _smooth(self, before: Frame, step: Step) -> tuple[Step, ...]:
        """A smooth part in parts, or whole where it cannot be parted."""
        return self.parted(before, step)[0] or (step,)

    def _to(self, frame: Frame, before: Frame, step: Step) -> Step:
        """Smooth part of a step to a known solution."""
        slope = self.problem.linearize(frame.state[:-1], float(frame.state[-1]))
        return Step(frame, step.iterations, max_norm(slope.residual), step.size, *self._arc(before, frame), slope=slope)

    @np.errstate(all="ignore")
    def parted(self, before: Frame, step: Step, halvings: int = _HALVINGS) -> tuple[tuple[Step, ...], float]:
        """Parts of a smooth step over which the cubic is true, none where it is too long for that; and its error.

        The error is that over the whole step, as a fraction of the motion, infinite where the curve is not found.
        """
        if step.slope is None:
            return (step,), 0.0
        cubic, border = Stretch.between(before, step.frame, step.length), self._across(before, step.frame)
        misses = [self._newton_step(cubic.at(u), step.slope, border) for u in _JUDGED]
        known = [away for away in misses if away is not None]
        if len(known) < len(misses):
            return (), math.inf
        guess, away = cubic.at(0.5), _LARGER * np.mean(known, axis=0)
        error = _LARGER * max(map(self.metric.norm, known)) / self.metric.motion(guess)
        allowed = self.settings.curve_tolerance
        if error <= allowed or not halvings:
            return self._at_fold(before, step, cubic, border), error
        halves = self._halves(before, step, guess + away, border) if error <= _HALVED * allowed else None
        if halves is None:
            return (), error
        parts: tuple[Step, ...] = ()
        for half in halves:
            found, _ = self.parted(before, half, halvings - 1)
            if not found:
                return (), error
            parts, before = parts + found, half.frame
        return parts, error

    def _at_fold(self, before: Frame, step: Step, cubic: Stretch, border: Border) -> tuple[Step, ...]:
        """The step with a point at its fold, where it has one: the cubic then tells well where that is."""
        if float(before.tangent[-1]) * float(step.frame.tangent[-1]) >= 0.0:
            return (step,)
        u = cubic.fold
        inside = _BESIDE < u < 1.0 - _BESIDE
        return (inside and self._halves(before, step, cubic.at(u), border, slack=0.0)) or (step,)

    def _across(self, before: Frame, behind: Frame) -> Border:
        """Row of the hyperplane across the chord."""
        row = self.metric.weights * self.metric.unit(behind.state - before.state)
        return Border(row[:-1], float(row[-1]))

    def _newton_step(self, guess: Array, slope: Linearization, border: Border) -> Array | None:
        """Where Newton's method with another slope would go from a guess, or None where there is no telling."""
        residual = self.problem.residual(guess[:-1], float(guess[-1]))
        try:
            dx, dlam = slope.solve_bordered(border.row, border.row_lam, -residual, 0.0)
        except np.linalg.LinAlgError:
            return None
        away = np.append(dx, dlam)
        return away if np.isfinite(away).all() else None

    def _halves(
        self, before: Frame, step: Step, guess: Array, border: Border, slack: float | None = None
    ) -> tuple[Step, Step] | None:
        """The step in two, by a solution close to a guess; None where there is none.

        The tangent there is that of an iterate no further than `slack`, by default of the settings; 0 at folds, which
        are located by its sign.
        """
        metric, behind = self.metric, step.frame
        found = correct(self.problem, guess, border, self.settings)
        if not found.converged or metric.norm(found.state - guess) > 0.5 * step.length:
            return None
        near = found.near(metric.norm, self.settings.tangent_slack * step.length if slack is None else slack)
        source = found.solved_with if near else found.linearization
        frame = frame_along(metric, found.state, source, np.append(border.row, border.row_lam))
        if frame is None:
            return None
        (to_frame, first), (from_frame, second) = (self._arc(before, frame), self._arc(frame, behind))
        crossed = frame.sign * before.sign < 0
        size = step.size
        return (
            Step.to(
                frame, found, 0.5 * size, to_frame, first, slope=source, branch_point=step.branch_point and crossed
            ),
            replace(
                step, size=0.5 * size, length=from_frame, angle=second, branch_point=step.branch_point and not crossed
            ),
        )

    def _arc(self, before: Frame, behind: Frame) -> tuple[float, float]:
        """Length and turn from one frame to the next."""
        angle = self.metric.angle(before.tangent, behind.tangent)
        return arc_length(self.metric.norm(behind.state - before.state), angle), angle
