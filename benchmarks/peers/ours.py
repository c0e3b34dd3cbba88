"""A case by this package."""

from importlib.metadata import PackageNotFoundError, version

import numpy as np
from cases import Case, Row, load, seconds, timed

from hbm.parallel import one_thread
from hbm.response.curve import ResponseCurve
from hbm.response.trace import trace_frequency


def traced(case: Case, *, finer: int = 1) -> ResponseCurve:
    """Trace a case; `finer` divides the default step."""
    begin, end = case.hz
    step = (end - begin) / (50 * finer)
    return trace_frequency(case.rig, case.hz, harmonics=case.H, samples=case.N_t, step_hz=step)


def row(case: Case) -> Row:
    """Time a case."""
    curve, wall, cpu = timed(lambda _: traced(case))
    problem = curve.problem
    top = curve.branch.points[int(np.argmax(curve["drive"].peak))]
    ahead = np.ones(problem.size)

    def newton_iteration() -> None:
        linear = problem.linearize(top.x, top.lam)
        linear.solve_bordered(ahead, 1.0, -linear.residual, 0.0)

    try:
        name = f"casadi-hbm {version('casadi-hbm')}"
    except PackageNotFoundError:
        name = "casadi-hbm"
    return Row(
        tool=name,
        wall=wall,
        cpu=cpu,
        hz=curve.hz.tolist(),
        drive=curve["drive"].coefficients.tolist(),
        rejected=0,
        linearize=one_thread(seconds)(newton_iteration),
        load=load(),
    )
