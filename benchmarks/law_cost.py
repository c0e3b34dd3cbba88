"""What a converged point costs with each friction law, beside the penalty law, in one run.

The paper's beam with ten times its damping (alpha 0.6 1/s), all couplings, H = 9, 256 samples, 44 to 62 Hz at 6.5 N.
The penalty law is timed anew before each of the others; the ratio is that of the two. Two more columns have the same
for one evaluation of the law over a period with its derivatives.

Run: python benchmarks/law_cost.py
"""

from time import perf_counter

from every_law import CASES
from rich.console import Console
from rich.table import Table
from two_paths import damped

from hbm.balance.problem import HarmonicBalance
from hbm.fourier import FourierBasis
from hbm.parallel import one_thread
from hbm.response.trace import trace_frequency
from models import FrictionLaw
from models.published import PAPER_PENALTY, paper_rig

SWEEP, H, N_T, RUNS = (44.0, 62.0), 9, 256, 3


def per_point(law: FrictionLaw) -> tuple[float, int]:
    """Least seconds per converged point of three curves, and the points of a curve; functions are built before."""
    rig, spent = damped(paper_rig(law), 5), []
    trace_frequency(rig, SWEEP, harmonics=H, samples=N_T)
    for _ in range(RUNS):
        t = perf_counter()
        points = len(trace_frequency(rig, SWEEP, harmonics=H, samples=N_T).points)
        spent.append((perf_counter() - t) / points)
    return min(spent), points


@one_thread
def per_period(law: FrictionLaw) -> float:
    """Least seconds of a law over a period with derivatives, at a motion near resonance."""
    rig = damped(paper_rig(law), 5)
    point = trace_frequency(rig, (50.9, 51.1), harmonics=H, samples=N_T).points[0]
    problem = HarmonicBalance(rig, FourierBasis(H, N_T))
    signals, spent = problem.kinematics(point.state).signals, []
    for _ in range(50):
        t = perf_counter()
        problem.law.linearize(signals.copy(), point.state.Omega, problem.environment)
        spent.append(perf_counter() - t)
    return min(spent)


def main() -> None:
    """Time every law and print the table."""
    table = Table("law", "points", "ms per point", "of penalty's", "law over a period, ms", "of penalty's")
    for law in CASES:
        reference, reference_period = per_point(PAPER_PENALTY)[0], per_period(PAPER_PENALTY)
        (spent, points), period = per_point(law), per_period(law)
        table.add_row(
            law.name,
            str(points),
            f"{1e3 * spent:.2f}",
            f"{spent / reference:.2f}",
            f"{1e3 * period:.3f}",
            f"{period / reference_period:.1f}",
        )
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
