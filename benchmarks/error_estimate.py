"""The estimated numerical error of a curve against the true one, at 20 points.

The truth: four times the modes, three times the harmonics, four times the samples, solved from each point.
An estimate is honest if it is within a factor 3 of the truth wherever the truth is worth speaking of.

Run: python benchmarks/error_estimate.py
"""

from dataclasses import replace

from rich.console import Console
from rich.table import Table

import hbm.response.accuracy
from hbm.response.accuracy import difference, estimate_error, frequency_response
from hbm.response.trace import steady_state
from models import Damping
from models.published import paper_rig

POINTS = 20
WORTH = 1e-4


def main() -> None:
    """Trace, estimate at 20 points, solve the references, print the table."""
    hbm.response.accuracy.SPREAD = POINTS
    rig = replace(paper_rig(), damping=Damping(mass_proportional=0.6))
    curve = frequency_response(rig, (40.0, 65.0))
    H, N_t = curve.basis.H, curve.basis.N_t
    scales = {name: float(curve[name].peak.max()) for name in hbm.response.accuracy.judged(rig)}
    table = Table("Hz", "estimated\n%", "true\n%", "ratio", title=f"H = {H}, {N_t} samples, 5 modes")
    ratios = []
    for probe in estimate_error(curve).probes:
        point = min(curve.points, key=lambda p, hz=probe.hz: abs(p.hz - hz))
        reference = steady_state(rig.with_modes(20), point.hz, harmonics=3 * H, samples=4 * N_t, start=point)
        true = max(difference(point, reference, name) / scale for name, scale in scales.items())
        ratio = probe.total / true if true > WORTH else float("nan")
        ratios.append(ratio)
        shown = f"{ratio:.2f}" if true > WORTH else "-"
        table.add_row(f"{probe.hz:.3f}", f"{100 * probe.total:.4f}", f"{100 * true:.4f}", shown)
    counted = [r for r in ratios if r == r]
    Console().print(
        table,
        f"{len(counted)} points with a true error above {WORTH:.2%}: "
        f"estimate / truth from {min(counted):.2f} to {max(counted):.2f}",
    )


if __name__ == "__main__":
    main()
