"""Continuation: solution curves of F(x, lam) = 0, through folds and corners, onto crossing and detached curves.

In reading order:

- `Problem` and `Linearization` say what is asked of a system: residual, bordered solves, a determinant's sign.
  `DenseProblem` makes one from two plain functions.
- `Settings` says where to go, with which steps and tolerances; it is checked when made.
- `trace` is a generator of `Point`s: a solution, its tangent, and flags for folds, corners and branch points.
- `continue_branch` collects them in a `Branch`, with an `End` that says in words why it ended.
  `Branch.require_complete` raises `ConvergenceError`, which carries the partial branch.
- `trace_along` and `continue_along` start in a direction instead: at a fold, or on a closed curve, which ends where it
  began.
- `refine` locates the folds and branch points of a branch, `locate` the sign changes of any test function, each a
  `SpecialPoint` of a `Kind`; `refine_fold` and `refine_branch_point` look between two points.
- `switch_branch` goes from a branch point along the other curve, both ways; `leave_along` one way.
- `TwoParameterProblem` is what is asked of F(x, lam, mu); `DenseTwoParameterProblem` makes one from plain functions,
  `AtMu` a `Problem` at one mu.
- `fold_curve` follows a fold in (lam, mu), a `FoldCurve`, with its cusps and the births of closed curves;
  `FoldCurve.at` are the folds at one mu, `isolas` the curves there that no other trace has met.
- `chord_curve` does so where F is only piecewise smooth, as with dry friction: a `ChordCurve`.
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
from .chord import ChordCurve, chord_curve
from .crossing import refine_branch_point
from .foldcurve import FoldCurve, fold_curve
from .foldsystem import SecondDerivative
from .isolas import isolas
from .newton import Border, Correction, Reason, correct, solve_at
from .problem import Array, DenseLinearization, DenseProblem, Linearization, Problem
from .refine import locate, refine, refine_fold
from .settings import NewtonSettings, Predictor, Settings
from .special import Kind, SpecialPoint
from .switching import leave_along, switch_branch
from .trace import Ending, continue_along, continue_branch, trace, trace_along
from .twoparameter import (
    AtMu,
    DenseTwoParameterLinearization,
    DenseTwoParameterProblem,
    TwoParameterLinearization,
    TwoParameterProblem,
)

__all__ = [
    "Array",
    "AtMu",
    "Border",
    "Branch",
    "ChordCurve",
    "ConvergenceError",
    "Correction",
    "DenseLinearization",
    "DenseProblem",
    "DenseTwoParameterLinearization",
    "DenseTwoParameterProblem",
    "End",
    "Ending",
    "FoldCurve",
    "Kind",
    "Linearization",
    "NewtonSettings",
    "Point",
    "Predictor",
    "Problem",
    "Reason",
    "SecondDerivative",
    "Settings",
    "SpecialPoint",
    "TwoParameterLinearization",
    "TwoParameterProblem",
    "chord_curve",
    "continue_along",
    "continue_branch",
    "correct",
    "fold_curve",
    "isolas",
    "leave_along",
    "locate",
    "refine",
    "refine_branch_point",
    "refine_fold",
    "solve_at",
    "switch_branch",
    "trace",
    "trace_along",
]
