"""Continuation: solution curves of F(x, lam) = 0, through folds and corners.

In reading order:

- `Problem` and `Linearization` say what is asked of a system: residual, bordered solves, a determinant's sign.
  `DenseProblem` makes one from two plain functions.
- `Settings` says where to go, with which steps and tolerances; it is checked when made.
- `trace` is a generator of `Point`s: a solution, its tangent, and flags for folds, corners and branch points.
- `continue_branch` collects them in a `Branch`, with an `End` that says in words why it ended.
  `Branch.require_complete` raises `ConvergenceError`, which carries the partial branch.
- `solve_at` and `correct` are the Newton solvers underneath, at fixed parameter and in a hyperplane;
  both return a `Correction`, with a `Reason`.

>>> import numpy as np
>>> cubic = DenseProblem(lambda x, lam: x**3 - x - lam, lambda x, lam: (np.diag(3.0 * x**2 - 1.0), -np.ones(1)))
>>> branch = continue_branch(cubic, np.array([-1.5]), -2.0, Settings(lam_end=2.0))
>>> branch.end
<End.REACHED_END: 'reached lam_end'>
>>> [round(point.fold_lam, 3) for point in branch.folds]
[0.385, -0.385]
"""

from .branch import Branch, ConvergenceError, End, Point
from .newton import Border, Correction, Reason, correct, solve_at
from .problem import Array, DenseLinearization, DenseProblem, Linearization, Problem
from .settings import NewtonSettings, Predictor, Settings
from .trace import Ending, continue_branch, trace

__all__ = [
    "Array",
    "Border",
    "Branch",
    "ConvergenceError",
    "Correction",
    "DenseLinearization",
    "DenseProblem",
    "End",
    "Ending",
    "Linearization",
    "NewtonSettings",
    "Point",
    "Predictor",
    "Problem",
    "Reason",
    "Settings",
    "continue_branch",
    "correct",
    "solve_at",
    "trace",
]
