"""The top of a curve: points added until a parabola through three of them has its own among them."""

from dataclasses import replace

import numpy as np

from continuation import Border, NewtonSettings, correct
from hbm.balance.problem import TOLERANCE
from hbm.balance.solution import describe
from hbm.parallel import one_thread
from hbm.response.curve import ResponseCurve

PEAK_ACCURACY = 1e-6
"""A peak is located to this fraction of its height."""


@one_thread
def with_peak(curve: ResponseCurve) -> ResponseCurve:
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


def _inserted(curve: ResponseCurve, i: int, offset: float) -> ResponseCurve:
    """Add the point at arclength `offset` from point i, solved across the chord to its neighbour."""
    a, b = curve.branch.points[i], curve.branch.points[i + 1 if offset > 0 else i - 1]
    chord = np.append(b.x - a.x, b.lam - a.lam)
    guess = np.append(a.x, a.lam) + offset / (b.arclength - a.arclength) * chord
    weights = curve.branch.settings.weights
    row = chord[:-1] if weights is None else weights * chord[:-1]
    newton = NewtonSettings(tolerance=TOLERANCE, max_iterations=10)
    result = correct(curve.problem, guess, Border(row, float(chord[-1])), newton)
    if not result.converged:
        return curve
    point = replace(
        a,
        x=result.x,
        lam=result.lam,
        arclength=a.arclength + offset,
        residual_norm=result.residual_norm,
        fold=False,
        corner=False,
        branch_point=False,
    )
    at = i + 1 if offset > 0 else i
    points, found = list(curve.branch.points), list(curve.points)
    points.insert(at, point)
    found.insert(at, describe(curve.problem, result.x, result.lam))
    return replace(curve, branch=replace(curve.branch, points=tuple(points)), points=tuple(found))
