"""What a record costs in a fit: solved and differentiated one by one, and together, in one run.

The records of examples/diagnosed_beam, and of each some; CPU milliseconds a record, the least of five, in turn.

Run: python -m benchmarks.records
"""

import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from hbm import load_rig, load_spectra
from hbm.diagnosis.calibrate import trusted
from hbm.outputerror.evaluation import evaluate
from hbm.outputerror.measured import campaign_of
from hbm.outputerror.simulated import Simulated, simulated
from hbm.outputerror.together import simulated_together
from hbm.parallel import one_thread

EXAMPLE, REPEATS, MOVED = Path(__file__).parents[1] / "examples" / "diagnosed_beam", 5, 0.3
"""How far a step of the fit goes, in tolerances of every number."""


def _difference(mine: Simulated, other: Simulated) -> float:
    """Largest difference of amplitudes and derivatives, each relative to its largest."""
    pairs = [(getattr(mine, name), getattr(other, name)) for name in ("amplitudes", "by_keys", "by_force", "by_hz")]
    return max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in pairs)


@one_thread
def main() -> None:
    """Time a step of a fit and print the table."""
    rig = load_rig(EXAMPLE / "rig.toml")
    campaign, _ = campaign_of(rig, load_spectra(EXAMPLE / "spectra.csv", rig))
    model = trusted(rig, campaign.data.channels, None)
    here = evaluate(model, campaign, model.start, {})
    x = model.start + MOVED * np.array([f.std for f in model.free])
    there = campaign.numerics.working.rig(model.rig(x))
    keys, _ = model.by_x(x, model.rig(x))
    basis, starts = campaign.numerics.working.basis, here.states(x)
    table = Table("records", "one by one, ms", "together, ms", "times", "largest difference")
    for number in (3, 6, 12, len(campaign.numbers)):
        records = [r for r in campaign.data.records if r.number in starts][:: max(1, len(starts) // number)][:number]
        begin = [starts[r.number] for r in records]
        spent: dict[str, list[float]] = {"alone": [], "together": []}
        for _ in range(REPEATS):
            t = time.process_time()
            alone = [simulated(there, basis, campaign.data, keys, r, s) for r, s in zip(records, begin, strict=True)]
            spent["alone"].append((time.process_time() - t) / len(records) * 1e3)
            t = time.process_time()
            together = list(simulated_together(there, basis, campaign.data, keys, records, begin))
            spent["together"].append((time.process_time() - t) / len(records) * 1e3)
        found = [(a, b) for a, b in zip(together, alone, strict=True) if a is not None and b is not None]
        off = max(_difference(a, b) for a, b in found)
        one, all_at_once = min(spent["alone"]), min(spent["together"])
        cells = f"{len(records)}", f"{one:.2f}", f"{all_at_once:.2f}", f"{one / all_at_once:.2f}", f"{off:.1g}"
        table.add_row(*cells)
    Console().print(table)
    print(f"{campaign.numerics}; {len(keys)} numbers, {len(model.free)} free")


if __name__ == "__main__":
    main()
