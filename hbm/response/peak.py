"""The top of a curve: points added until a parabola through three of them has its own among them."""

from dataclasses import replace
from typing import TypeVar

import numpy as np

from continuation import ConvergenceError
from continuation.segment import Segment
from hbm.parallel import one_thread
from hbm.response.curve import ResponseCurve

Curve = TypeVar("Curve", bound=ResponseCurve)

PEAK_ACCURACY = 1e-6
"""A peak is located to this fraction of its height."""


@one_thread
def with_peak(curve: Curve) -> Curve:
    """Add points around the largest drive displacement until a parabola through them has its top among them."""
    for _ in range(8):
        drive = np.array([p.channels["drive"].peak for p in curve.points])
        i = int(np.argmax(drive))
        if not 0 < i < len(drive) - 1:
            return curve
        s = np.array([p.arclength for p in curve.branch.points[i - 1 : i + 2]]) - curve.branch.points[i].arclength
        quadratic = np.polyfit(s, drive[i - 1 : i + 2], 2)
        offset = -quadratic[1] / (2 * quadratic[0]) if quadratic[0] < 0.0 else np.nan
        gain = np.polyval(quadratic, offset) / drive[i] - 1.0
        if not (s[0] < offset < s[2] and gain > PEAK_ACCURACY):
            return curve
        curve = _inserted(curve, i, float(offset))
    return curve


def _inserted(curve: Curve, i: int, offset: float) -> Curve:
    """Add the point at arclength `offset` from point i; the curve itself where it is not found."""
    points, found = list(curve.branch.points), list(curve.points)
    at = i + 1 if offset > 0 else i
    before, behind = points[at - 1 : at + 1]
    if behind.corner or behind.jumped:
        return curve
    stretch = Segment(curve.traced, before, behind, curve.branch.settings, sharply=False)
    try:
        points[at : at + 1] = stretch.parted(offset / stretch.length % 1.0)
    except ConvergenceError:
        return curve
    found.insert(at, curve.solution_at(points[at].x, points[at].lam))
    return replace(curve, branch=replace(curve.branch, points=tuple(points)), points=tuple(found))
