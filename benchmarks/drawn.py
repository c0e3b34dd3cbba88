"""How true curves are between their points: each beside a trace with ten times as many, in seconds a case.

python -m benchmarks.drawn
"""

import time
import warnings
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks.cases import Case, Traced, beam, damped, duffing, oscillator, paper
from benchmarks.peers import ours
from benchmarks.speed import FINER, chord_error
from hbm.rigfiles.load import load_rig
from models import Frictionless, Rig, Stribeck, Viscous
from models.plausible import PlausibilityWarning
from models.published import paper_rig

JOINTED = Path(__file__).parents[1] / "examples" / "jointed_beam.toml"
COLUMNS = ("case", "points", "CPU s", "peak off", "chord error", "by lines", "folds", "in the fine trace")


def sliding(law: Frictionless | Viscous | Stribeck, *, lift_off: bool = False) -> Rig:
    """Return the paper's beam with more damping and another law."""
    rig = damped(paper_rig())
    return replace(rig, contact=replace(rig.contact, law=law, lift_off=lift_off))


CASES = {
    "linear": lambda: Case(sliding(Frictionless()), (40.0, 65.0), 3, 64),
    "Duffing": duffing,
    "Jenkins oscillator": oscillator,
    "Jenkins beam": beam,
    "paper's beam": paper,
    "Stribeck": lambda: Case(sliding(Stribeck(0.57, 0.52, 5e-3, critical_slip=4.15e-6)), (40.0, 65.0), 15, 256),
    "lift-off": lambda: Case(sliding(Viscous(500.0), lift_off=True), (46.5, 49.0), 9, 128),
    "joints": lambda: Case(load_rig(JOINTED), (40.0, 65.0), 9, 256),
}


def row(name: str) -> list[str]:
    """A case beside its fine trace."""
    case = CASES[name]()
    used = time.process_time()
    curve = ours.curve_of(case)
    used = time.process_time() - used
    fine = ours.curve_of(case, finer=FINER)
    found, true = ours.traced(curve), ours.traced(fine)
    lines = Traced(found.tool, found.hz, found.drive, found.samples)
    return [
        name,
        f"{len(curve.points)}",
        f"{used:.2f}",
        f"{found.height.max() / true.height.max() - 1.0:.1e}",
        *(f"{chord_error(c, true, case.hz):.1e}" for c in (found.drawn or found, lines)),
        f"{len(curve.folds)}",
        f"{len(fine.folds)}",
    ]


def main() -> None:
    """Measure and print."""
    warnings.simplefilter("ignore", PlausibilityWarning)
    table = Table(*COLUMNS)
    for name in CASES:
        table.add_row(*row(name))
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
