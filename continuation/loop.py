"""Closed curves: a trace that comes back to its start."""

from dataclasses import replace

from .geometry import Frame, Metric, arc_length
from .newton import Border, correct_sharply
from .problem import Problem
from .settings import Settings
from .step import Step

_SAME = 1e-4


def closing_step(
    problem: Problem, metric: Metric, start: Frame, before: Frame, step: Step, settings: Settings
) -> Step | None:
    """Step from `before` to the start itself, if `step` passes it in the same direction, or None.

    Another branch may run close by: where the step crosses the start's hyperplane the solution is corrected, and must
    be the start.
    """
    behind = float(start.row @ (before.state - start.state))
    beyond = float(start.row @ (step.frame.state - start.state))
    if step.jumped or not behind < 0.0 <= beyond:
        return None
    chord = metric.norm(step.frame.state - before.state)
    crossing = before.state + behind / (behind - beyond) * (step.frame.state - before.state)
    if metric.norm(crossing - start.state) > chord:
        return None
    border = Border(start.row[:-1], float(start.row[-1]))
    met, again = (correct_sharply(problem, state, border, settings) for state in (crossing, start.state))
    found = max(met.residual_norm, again.residual_norm) <= settings.tolerance
    if not found or metric.norm(met.state - again.state) > _SAME * chord:
        return None
    angle = metric.angle(before.tangent, start.tangent)
    length = arc_length(metric.norm(start.state - before.state), angle)
    return replace(
        step,
        frame=start,
        iterations=again.iterations,
        residual_norm=again.residual_norm,
        length=length,
        angle=angle,
    )
