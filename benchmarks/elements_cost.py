"""What an iteration of Newton's method costs with nonlinear elements: modes eliminated, and the whole system solved.

The paper's beam at 48.5 Hz and 6.5 N, on grids as quick fits, fits and their correction use them; both ways on the same
steady state, in turn. The last column is how far the steps are apart, of their length.

Run: python benchmarks/elements_cost.py
"""

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from continuation import DenseLinearization
from hbm.balance.problem import HarmonicBalance, Linearization
from hbm.fourier import Array
from hbm.parallel import one_thread
from hbm.response.trace import steady_state
from models import Rig
from models.elements import ImpactStop, MidplaneStretching, QuadraticDrag
from models.published import PAPER_PENALTY, paper_rig

HZ, RUNS = 48.5, 3
GRIDS = ((15, 256, 8), (21, 512, 15), (60, 1024, 27))
"""Harmonics, samples and modes."""

ELEMENTS = (QuadraticDrag(60.0), MidplaneStretching(3e8), ImpactStop(2e-4, 2e5, 0.3))
HEADING = f"{'ms of an iteration':<34}{'eliminated':>12}{'whole':>10}{'ratio':>8}{'difference':>12}"


def rig_with(element: object, modes: int) -> Rig:
    return replace(paper_rig(PAPER_PENALTY).with_modes(modes), elements=(element,))


def eliminated(here: Linearization, row: Array, right: Array) -> Array:
    return here.newton.solve_bordered(row, 1.0, right, 0.0)[0]


def whole(here: Linearization, row: Array, right: Array) -> Array:
    by_parameter = here.problem.by_parameter(here.state, here.contact, here.slope)
    dense = DenseLinearization(here.residual, here.complete, by_parameter)
    return dense.solve_bordered(row, 1.0, right, 0.0)[0]


def timed(
    solve: Callable[[Linearization, Array, Array], Array], problem: HarmonicBalance, x: Array, lam: float
) -> Array:
    """Least milliseconds of some runs, then the step."""
    row, right = np.zeros(problem.size), np.ones(problem.size)
    spent = []
    for _ in range(RUNS):
        start = time.perf_counter()
        step = solve(problem.linearize(x, lam), row, right)
        spent.append(1e3 * (time.perf_counter() - start))
    return np.append(min(spent), step)


@one_thread
def measured(element: object, grid: tuple[int, int, int]) -> str:
    """One line of the table."""
    H, N_t, modes = grid
    solution = steady_state(rig_with(element, modes), HZ, harmonics=H, samples=N_t)
    problem = HarmonicBalance(rig_with(element, modes), solution.basis)
    (a, *step), (b, *exact) = (timed(solve, problem, *problem.pack(solution.state)) for solve in (eliminated, whole))
    apart = np.linalg.norm(np.subtract(step, exact)) / np.linalg.norm(exact)
    name = f"{type(element).name}, H {H}, {modes} modes"
    return f"{name:<34}{a:>12.1f}{b:>10.1f}{b / a:>8.1f}{apart:>12.1e}"


if __name__ == "__main__":
    print(HEADING)
    for element in ELEMENTS:
        for grid in GRIDS:
            print(measured(element, grid), flush=True)
