"""One step along a curve: predict, correct, judge; smaller steps, corners and jumps where that fails.

A step is accepted if the corrector converges close to its guess, the tangent turns less than `max_angle`, and the
chord agrees with both tangents. The orientation comes from two rules. The new tangent makes an acute angle
with the old one; and the sign of det [J; tangent] stays. Where they disagree, a corner search decides
(`corner.py`); without a corner, the curve is followed straight on as through a simple branch point, provided
a solution half way confirms that the curve is smooth there (otherwise the step jumped to another branch).
"""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from .corner import locate_corner, turn_corner
from .filling import Filling
from .geometry import Frame, Metric, arc_length, frame_along
from .newton import Border, Correction, correct, solve_at
from .problem import Array, Linearization, Problem
from .settings import Predictor, Settings
from .step import Step
from .stepsize import StepSize

_SUDDEN = 3.0
_SAME_ANGLE = 0.7
_THOROUGH = 0.02
_SKEW_ALLOWED, _SKEW_PER_ANGLE = 0.1, 0.25
_BRANCH_SKEW = 0.1
_JUMPS_IN_A_ROW = 3
_ORDINARY_STEPS = 10
_LONGEST_JUMP = 5.0
_STEEP = 0.3


class Stepper:
    """Walks along a curve; remembers the last two frames, the step and the curvature.

    Parameters
    ----------
    problem : Problem
        The system.
    metric : Metric
        Measures lengths and angles.
    frame : Frame
        Start, in the direction of travel.
    settings : Settings
        Steps and tolerances.
    interval : tuple of float
        Bounds of the parameter.
    """

    def __init__(
        self, problem: Problem, metric: Metric, frame: Frame, settings: Settings, interval: tuple[float, float]
    ) -> None:
        self._problem, self._metric, self._settings = problem, metric, settings
        self._interval = interval
        self.frame = frame
        self._bend: Array | None = None  # change of the tangent per length over the last step
        self._chord = frame.tangent
        self._pace = StepSize(metric, settings)
        self._jumps = self._since_jump = 0
        self._refused_angle = math.inf  # of the last step refused for its angle, from the same frame
        self._filling = Filling(problem, metric, settings) if math.isfinite(settings.curve_tolerance) else None
        self.refusal = "nothing tried"

    def advance(self) -> tuple[Step, ...]:
        """Next steps, none where every means failed; the stepper then stays where it is.

        There are several where a corner or the error of the cubic asks for points on the way.
        """
        self._refused_angle = math.inf
        step = self._shrinking() or self._jump()
        if step is None:
            return ()
        if self._filling is not None and step.corner is not None:
            step = replace(step, parts=self._filling.around_corner(self.frame, step, step.corner))
        self._remember(step)
        return step.parts or (step,)

    def _shrinking(self) -> Step | None:
        size, smallest = self._pace.size, self._settings.step_min
        first = True
        while True:
            found = self._try(size, lenient=size <= smallest)
            if found is None and not first:
                found = self._turn(size)
            if found is not None or size <= smallest:
                return found
            size, first = max(0.5 * size, smallest), False

    @np.errstate(all="ignore")
    def _try(self, size: float, *, lenient: bool) -> Step | None:
        """One prediction and correction; `lenient` at the smallest step, where angles are accepted as they are."""
        guess, border = self._predict(size)
        bound = self._bound_beyond(float(guess[-1]))
        if bound is not None:
            at_bound = self._aim_at(bound, size)
            if at_bound is not None:
                return at_bound
        correction = self._correct(guess, border)
        if correction is None or self._is_far(correction, guess, size):
            return None
        bound = self._bound_beyond(correction.lam)
        if bound is not None:
            correction = self._cut_at(bound, correction.state)
        step = None if correction is None else self._judge(correction, size, lenient=lenient)
        return step if step is None or lenient else self._filled(step)

    def _filled(self, step: Step) -> Step | None:
        """A smooth step with the points on its way that the cubic asks for, or None if it should be smaller."""
        if self._filling is None or step.corner is not None:
            return step
        parts, error = self._filling.parted(self.frame, step)
        if parts:
            return replace(step, parts=parts, error=error)
        self.refusal = f"residual {step.residual_norm:.2g}, but the curve on the way is off the cubic by {error:.2g}"
        return None

    def _predict(self, size: float) -> tuple[Array, Border]:
        frame = self.frame
        predictor = self._settings.predictor
        if predictor is Predictor.SECANT:
            row = self._metric.weights * self._chord
            return frame.state + size * self._chord, Border(row[:-1], float(row[-1]))
        guess = frame.state + size * frame.tangent
        if predictor is Predictor.CURVED and self._bend is not None:
            guess += (0.5 * size**2) * self._bend
        return guess, Border(frame.row[:-1], float(frame.row[-1]))

    def _correct(self, guess: Array, border: Border) -> Correction | None:
        return self._converged(correct(self._problem, guess, border, self._settings))

    def _solve_at(self, guess: Array, lam: float) -> Correction | None:
        return self._converged(solve_at(self._problem, guess[:-1], lam, self._settings))

    def _converged(self, correction: Correction) -> Correction | None:
        if correction.converged:
            return correction
        self.refusal = f"residual {correction.residual_norm:.2g}, {correction.reason.value}"
        return None

    def _is_far(self, correction: Correction, guess: Array, limit: float) -> bool:
        if self._metric.norm(correction.state - guess) <= limit:
            return False
        self.refusal = f"residual {correction.residual_norm:.2g}, but the solution is far from its guess"
        return True

    def _tangent_source(self, correction: Correction, size: float) -> Linearization:
        """Linearization for the tangent: that of the iterate before where it is as good as the last one."""
        near = correction.near(self._metric.norm, self._settings.tangent_slack * size)
        near &= abs(float(self.frame.tangent[-1])) > _STEEP  # a fold is located by its tangents
        return correction.solved_with if near else correction.linearization

    def _judge(self, correction: Correction, size: float, *, lenient: bool) -> Step | None:
        """Step that a correction makes, or None if it should be smaller."""
        old, metric, settings = self.frame, self._metric, self._settings
        source = self._tangent_source(correction, size)
        new = frame_along(metric, correction.state, source, old.row)
        if new is None:  # no unique tangent, as on a branch point: straight on
            new = Frame(correction.state, old.tangent, old.row, old.sign)
        chord = metric.norm(new.state - old.state)
        angle = metric.angle(old.tangent, new.tangent)
        flipped = new.sign * old.sign < 0
        if (flipped and angle > settings.corner_angle) or self._is_suspicious(angle, chord):
            step = self._corner_between(new, correction, size)
            if step is not None:
                return step
        skew = self._skew(old, new)
        if not lenient and (
            angle > settings.max_angle or skew > _SKEW_ALLOWED * settings.max_angle + _SKEW_PER_ANGLE * angle
        ):
            self._refused_angle = angle
            turns = f"tangent turned by {angle:.2g} rad, chord off by {skew:.2g} rad"
            self.refusal = f"residual {correction.residual_norm:.2g}, but {turns}"
            return None
        if flipped and not self._crosses_branch(new, skew):
            self.refusal = f"residual {correction.residual_norm:.2g}, but on another branch"
            return None
        sign = new.sign or old.sign
        frame = Frame(new.state, new.tangent, new.row, sign)
        length = arc_length(chord, angle)
        return Step.to(frame, correction, size, length, angle, slope=source, branch_point=flipped)

    def _is_suspicious(self, angle: float, chord: float) -> bool:
        """Whether a corner search is worth its price: a sudden turn that a smaller step would not prevent."""
        if angle > self._settings.max_angle:  # refused anyway unless a corner; see if the angle shrinks
            return angle > _SAME_ANGLE * self._refused_angle and math.isfinite(self._refused_angle)
        return angle > self._settings.corner_angle and angle > _SUDDEN * self._pace.curvature * chord

    def _corner_between(self, new: Frame, correction: Correction, size: float) -> Step | None:
        """Step over a corner, oriented by the chord; the determinant only says which orientation to try first."""
        flipped = new.sign * self.frame.sign < 0
        for frame in (new.reversed(), new) if flipped else (new,):
            corner = locate_corner(self._problem, self._metric, self.frame, frame, self._settings)
            if corner is not None:
                angle = self._metric.angle(self.frame.tangent, frame.tangent)
                crossed = flipped and frame is new
                return Step.to(frame, correction, size, corner.length, angle, corner=corner, branch_point=crossed)
        return None

    def _skew(self, old: Frame, new: Frame) -> float:
        """Angle between the chord and the mean of both tangents: small on one smooth curve.

        Infinite where lam went back although both tangents point onwards: two folds missed, or a jump to the
        neighbouring branch across a narrow gap.
        """
        metric = self._metric
        chord = new.state - old.state
        length = metric.norm(chord)
        onwards = math.copysign(1.0, old.tangent[-1])
        if onwards * float(new.tangent[-1]) > 0.0 and onwards * float(chord[-1]) < -1e-9 * length:
            return math.inf
        return metric.angle(chord / length, metric.unit(old.tangent + new.tangent)) if length > 0.0 else 0.0

    def _crosses_branch(self, new: Frame, skew: float) -> bool:
        """Whether the curve to `new` is one smooth curve: a solution lies close to the middle of the chord."""
        chord = new.state - self.frame.state
        row = self._metric.weights * chord
        middle = self.frame.state + 0.5 * chord
        halfway = self._correct(middle, Border(row[:-1], float(row[-1])))
        if halfway is None or skew > _BRANCH_SKEW:
            return False
        return self._metric.norm(halfway.state - middle) < _BRANCH_SKEW * self._metric.norm(chord)

    def _bound_beyond(self, lam: float) -> float | None:
        """Target or bound between the current parameter and `lam` (`lam` included)."""
        here, target = float(self.frame.state[-1]), self._settings.lam_end
        if (here < target <= lam) or (lam <= target < here):
            return target
        low, high = self._interval
        if lam > high or (lam == high != here):
            return high
        return low if lam < low or (lam == low != here) else None

    def _aim_at(self, bound: float, size: float) -> Step | None:
        """Last step, at fixed parameter from the tangent's point there."""
        frame = self.frame
        slope = float(frame.tangent[-1])
        distance = (bound - float(frame.state[-1])) / slope if slope != 0.0 else math.inf
        if not 0.0 < distance <= size:
            return None
        guess = frame.state + distance * frame.tangent
        correction = self._solve_at(guess, bound)
        if correction is None or self._is_far(correction, guess, distance):
            return None
        return self._judge(correction, distance, lenient=False)

    def _cut_at(self, bound: float, beyond: Array) -> Correction | None:
        """Solution at a bound that was overstepped, from the chord's point there."""
        chord = beyond - self.frame.state
        fraction = (bound - float(self.frame.state[-1])) / float(chord[-1])
        guess = self.frame.state + fraction * chord
        correction = self._solve_at(guess, bound)
        if correction is None or self._is_far(correction, guess, self._metric.norm(chord)):
            return None
        return correction

    def _turn(self, size: float) -> Step | None:
        turn = turn_corner(
            self._problem,
            self._metric,
            self.frame,
            size,
            self._settings,
            both_ways=size < _THOROUGH * self._pace.size,
        )
        if turn is None or self._bound_beyond(turn.correction.lam) is not None:
            return None  # bounds are left to the ordinary step or to a smaller turn
        angle = self._metric.angle(self.frame.tangent, turn.frame.tangent)
        crossed = turn.frame.sign * self.frame.sign < 0
        return Step.to(
            turn.frame, turn.correction, size, turn.corner.length, angle, corner=turn.corner, branch_point=crossed
        )

    @np.errstate(all="ignore")
    def _jump(self) -> Step | None:
        """Way out where small steps fail: fixed parameter, then longer steps along tangent and chord."""
        if self._jumps >= _JUMPS_IN_A_ROW:
            return None
        usual, smallest = self._settings.step, self._settings.step_min
        for size in (usual, 0.1 * usual, max(4.0 * smallest, 1e-3 * usual), 2.0 * usual, 4.0 * usual):
            for correction, forwards in self._jumps_of(size):
                step = self._landed(correction, forwards, size)
                if step is not None:
                    return step
        return None

    def _jumps_of(self, size: float) -> Iterator[tuple[Correction, Array]]:
        """Converged attempts at one size, each with the row that says what is forwards."""
        frame, metric = self.frame, self._metric
        forwards = np.zeros(frame.state.size)
        forwards[-1] = math.copysign(1.0, frame.tangent[-1])
        ahead = frame.state + size * frame.tangent
        bound = self._bound_beyond(float(ahead[-1]))
        for guess in (ahead, frame.state):
            correction = self._solve_at(guess, float(ahead[-1]) if bound is None else bound)
            if correction is not None:
                yield correction, forwards
        for direction in (frame.tangent, self._chord):
            row = metric.weights * direction
            correction = self._correct(frame.state + size * direction, Border(row[:-1], float(row[-1])))
            if correction is not None:
                yield correction, row

    def _landed(self, correction: Correction, forwards: Array, size: float) -> Step | None:
        """Step that a jump makes, if it went forwards and not too far; over a corner, if one is found between."""
        metric = self._metric
        chord = correction.state - self.frame.state
        length = metric.norm(chord)
        inside = self._bound_beyond(correction.lam) in (None, correction.lam)
        if not (inside and float(forwards @ chord) > 0.0 and self._settings.step_min < length < _LONGEST_JUMP * size):
            return None
        frame = frame_along(metric, correction.state, correction.linearization, forwards)
        if frame is None:
            return None
        angle = metric.angle(self.frame.tangent, frame.tangent)
        corner = None
        if angle > self._settings.corner_angle:
            corner = locate_corner(self._problem, metric, self.frame, frame, self._settings)
        crossed = corner is not None and frame.sign * self.frame.sign < 0
        if corner is not None:
            length = corner.length
        jumped = corner is None
        return Step.to(frame, correction, size, length, angle, corner=corner, jumped=jumped, branch_point=crossed)

    def _remember(self, step: Step) -> None:
        last = step.parts[-1] if step.parts else step
        before = step.parts[-2].frame if len(step.parts) > 1 else self.frame
        if step.corner is None and not step.jumped:
            length = max(last.length, self._settings.step_min)
            self._pace.proceed(step, curvature=last.angle / length)
            self._bend = (last.frame.tangent - before.tangent) / length
            self._chord = self._metric.unit(last.frame.state - before.state)
        else:
            self._pace.restart(step)
            self._bend, self._chord = None, step.frame.tangent
        self._since_jump = 0 if step.jumped else self._since_jump + 1
        if step.jumped or self._since_jump > _ORDINARY_STEPS:
            self._jumps = self._jumps + 1 if step.jumped else 0
        self.frame = step.frame
