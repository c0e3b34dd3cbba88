"""What the stability of a point costs beside the point itself, and what bifurcations cost beside the curve.

python benchmarks/stability_cost.py
"""

import time
from dataclasses import replace

from hbm.response.bifurcations import with_stability
from hbm.response.curve import ResponseCurve
from hbm.response.trace import trace_frequency
from hbm.stability.hill import hill
from hbm.stability.multipliers import floquet
from models import Damping, Frictionless, Rig
from models.elements import MidplaneStretching, QuadraticDrag
from models.published import (
    ASSUMED_IWAN,
    PAPER_COULOMB,
    PAPER_DAHL,
    PAPER_LUGRE,
    PAPER_PENALTY,
    PAPER_STRIBECK,
    paper_rig,
)

SWEEP, RUNS = (44.0, 60.0), 3
HEADING = (
    f"{'CPU, ms':<26}{'points':>7}{'point':>8}{'floquet':>9}{'share':>7}{'Hill':>8}{'bifurcations':>14}{'each':>8}"
)


def rigs() -> dict[str, Rig]:
    """Laws of the paper with transients of a sixth of a second, five modes; more modes; elements."""
    laws = (PAPER_PENALTY, PAPER_COULOMB, PAPER_DAHL, PAPER_LUGRE, ASSUMED_IWAN)
    damped = {law.name: replace(paper_rig(law), damping=Damping(mass_proportional=6.0)) for law in laws}
    many = {f"coulomb-penalty, {n} modes": damped["coulomb-penalty"].with_modes(n) for n in (10, 20)}
    held = replace(paper_rig(Frictionless()), elements=(MidplaneStretching(1e8), QuadraticDrag(100.0)))
    return {
        **damped,
        **many,
        "elements, no friction": replace(held.with_modes(3), damping=Damping(mass_proportional=6.0)),
    }


def measured(name: str, rig: Rig) -> str:
    """One line of the table; the least of some runs of each, in turn."""
    trace_frequency(rig, (44.0, 44.1), harmonics=15)  # builds what is built once
    points, own = [], []
    for _ in range(RUNS):
        start = time.process_time()
        curve = trace_frequency(rig, SWEEP, harmonics=15, step_hz=0.4)
        traced = time.process_time()
        for p in curve.points:
            floquet(curve.problem, p.state)
        points.append(1e3 * (traced - start) / len(curve.points))
        own.append(1e3 * (time.process_time() - traced) / len(curve.points))
    start = time.process_time()
    found = with_stability(curve).bifurcations
    whole = 1e3 * (time.process_time() - start) - len(curve.points) * min(own)
    each = f"{whole / len(found):8.0f}" if found else f"{'':>8}"
    row = f"{name:<26}{len(curve.points):>7}{min(points):>8.2f}{min(own):>9.2f}{min(own) / min(points):>7.0%}"
    return f"{row}{_hill(curve)}{len(found):>14}{each}"


def _hill(curve: ResponseCurve) -> str:
    p = curve.points[len(curve.points) // 2]
    start = time.process_time()
    try:
        hill(curve.problem, p.state)
    except ValueError:
        return f"{'':>8}"
    return f"{1e3 * (time.process_time() - start):>8.1f}"


if __name__ == "__main__":
    print(HEADING)
    for name, rig in rigs().items():
        print(measured(name, rig), flush=True)
    stribeck = replace(paper_rig(PAPER_STRIBECK), damping=Damping(mass_proportional=20.0))
    print(measured("stribeck, damped more", stribeck), flush=True)
