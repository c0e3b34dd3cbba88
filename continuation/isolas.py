"""Curves that no trace from afar meets: closed ones, found by their folds."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .branch import Branch
from .foldcurve import FoldCurve
from .problem import Array
from .refine import refine
from .settings import Settings
from .special import Kind
from .trace import continue_along
from .twoparameter import AtMu

_SAME = 1e-5


def isolas(curve: FoldCurve, mu: float, branches: Sequence[Branch], settings: Settings) -> tuple[Branch, ...]:
    """Branches at one mu that own folds of a fold curve and are none of those already traced.

    Parameters
    ----------
    curve : FoldCurve
        Folds in (lam, mu).
    mu : float
        Where to look.
    branches : sequence of Branch
        Traced already, at this mu.
    settings : Settings
        As for a trace in lam; `lam_end`, `lam_min` and `lam_max` should lie beyond the closed curves. A bound that is
        omitted is none.

    Returns
    -------
    tuple of Branch
        Detached curves, each once, from close to one of its folds; those that are closed end with `End.CLOSED`.

    Raises
    ------
    ConvergenceError
        If a fold at `mu` cannot be solved.
    """
    problem = AtMu(curve.problem, mu)
    low = -np.inf if settings.lam_min is None else settings.lam_min
    high = np.inf if settings.lam_max is None else settings.lam_max
    bounded = replace(settings, lam_min=low, lam_max=high)
    met = [point.state for branch in branches for point in refine(problem, branch) if point.kind is Kind.FOLD]
    found = []
    for fold in curve.at(mu):
        state = fold.state
        if any(_same(state, other) for other in met):
            continue
        ahead = state + 0.5 * settings.step * fold.tangent  # the fold itself is passed at the end
        branch = continue_along(problem, ahead[:-1], float(ahead[-1]), fold.tangent, bounded)
        found.append(branch)
        met += [state, *(point.state for point in refine(problem, branch) if point.kind is Kind.FOLD)]
    return tuple(found)


def _same(a: Array, b: Array) -> bool:
    return bool(np.linalg.norm(a - b) <= _SAME * (1.0 + np.linalg.norm(b)))
