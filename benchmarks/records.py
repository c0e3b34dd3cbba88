"""What a record costs in a fit: solved and differentiated one by one, and together, in one run.

The records of examples/diagnosed_beam and those of a structure of some modes, and of each some; with the beam as it is
and with more that is solved together, and with joints on the structure.
CPU milliseconds a record, the least of five, in turn.

Run: python -m benchmarks.records
"""

import time
from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.modal_cases import draw
from hbm import load_rig, load_spectra
from hbm.balance.scaled import State
from hbm.diagnosis.calibrate import trusted
from hbm.fourier import FourierBasis
from hbm.measurement.spectra import MeasuredSpectra
from hbm.outputerror.evaluation import evaluate
from hbm.outputerror.measured import campaign_of
from hbm.outputerror.records import Measurement, Record
from hbm.outputerror.simulated import Simulated, simulated, steady
from hbm.outputerror.together import simulated_together
from hbm.parallel import one_thread
from models import ImpactStop, Jenkins, Rig
from models.jointed import AnyRig, JointedRig
from models.joints import Friction, Joint, PolynomialSpring, Stop
from models.parts import Drift

EXAMPLE, REPEATS, MOVED = Path(__file__).parents[1] / "examples" / "diagnosed_beam", 5, 0.3
"""How far a step of the fit goes, in tolerances of every number."""

SEED, CUBIC, SLIP, GAP = 1, 3e11, 2e-5, 3e-5


def _difference(mine: Simulated, other: Simulated) -> float:
    """Largest difference of amplitudes and derivatives, each relative to its largest."""
    pairs = [(getattr(mine, name), getattr(other, name)) for name in ("amplitudes", "by_keys", "by_force", "by_hz")]
    return max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in pairs)


def _kinds(rig: AnyRig) -> Mapping[str, AnyRig]:
    """The rig as it is, and with more of what is solved together; on modes, with joints."""
    if isinstance(rig, JointedRig):
        spring = Joint("spring", PolynomialSpring(cubic=CUBIC), ("p2",))
        rub, stop = (Joint("rub", Friction(Jenkins(0.4, SLIP), 0.1), ("p3",)), Joint("stop", Stop(1e3, GAP), ("p4",)))
        return {
            "a cubic spring": replace(rig, joints=(spring,)),
            "a Jenkins element": replace(rig, joints=(rub,)),
            "both and a stop": replace(rig, joints=(spring, rub, stop)),
        }
    assert isinstance(rig, Rig)
    struck = ImpactStop(gap=2e-5, stiffness=3e3, position=0.5)
    return {
        "contact alone": rig,
        "a stop that is struck": replace(rig, elements=(struck,)),
        "a clamp that slips": replace(rig, attachments=replace(rig.attachments, clamp_stiffness=2e5, clamp_limit=0.05)),
        "a load that drifts": replace(rig, drift=(Drift("contact.normal_load", 1e-3),)),
    }


@one_thread
def main() -> None:
    """Time a step of a fit and print the table."""
    table = Table("rig", "records", "one by one, ms", "together, ms", "times", "largest difference")
    beam, on_modes = load_rig(EXAMPLE / "rig.toml"), draw("null", SEED)
    for rig, spectra in ((beam, load_spectra(EXAMPLE / "spectra.csv", beam)), (on_modes.rig, on_modes.spectra)):
        _add_rows(table, rig, spectra)
    Console().print(table)


def _add_rows(table: Table, rig: AnyRig, spectra: MeasuredSpectra) -> None:
    campaign, _ = campaign_of(rig, spectra)
    model, working = trusted(rig, campaign.data.channels, None), campaign.numerics.working
    here = evaluate(model, campaign, model.start, {})
    x = model.start + MOVED * np.array([f.std for f in model.free])
    before, there = (_kinds(working.rig(model.rig(at))) for at in (model.start, x))
    keys, _ = model.by_x(x, model.rig(x))
    basis, starts = working.basis, here.states(x)
    whole = [r for r in campaign.data.records if r.number in starts]
    for kind, number in product(there, (3, 6, 12, len(whole))):
        found = [(r, steady(before[kind], basis, r, starts[r.number])) for r in whole[:: max(1, len(whole) // number)]]
        known = [(r, s.state) for r, s in found if s is not None][:number]
        table.add_row(kind, *_timed(there[kind], basis, campaign.data, keys, *map(list, zip(*known, strict=True))))


def _timed(
    rig: AnyRig,
    basis: FourierBasis,
    data: Measurement,
    keys: tuple[str, ...],
    records: list[Record],
    begin: list[State],
) -> tuple[str, ...]:
    """How many records, milliseconds for each either way, their ratio, and how far the answers are apart."""
    spent: dict[str, list[float]] = {"alone": [], "together": []}
    for _ in range(REPEATS):
        t = time.process_time()
        alone = [simulated(rig, basis, data, keys, r, s) for r, s in zip(records, begin, strict=True)]
        spent["alone"].append((time.process_time() - t) / len(records) * 1e3)
        t = time.process_time()
        together = list(simulated_together(rig, basis, data, keys, records, begin))
        spent["together"].append((time.process_time() - t) / len(records) * 1e3)
    found = [(a, b) for a, b in zip(together, alone, strict=True) if a is not None and b is not None]
    off = max(_difference(a, b) for a, b in found)
    one, all_at_once = min(spent["alone"]), min(spent["together"])
    return f"{len(records)}", f"{one:.2f}", f"{all_at_once:.2f}", f"{one / all_at_once:.2f}", f"{off:.1g}"


if __name__ == "__main__":
    main()
