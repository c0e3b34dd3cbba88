"""Joints at both payloads, fitted: python both_payloads.py rig.toml multisines.csv MS5 OM3, which are held out.

The payload at the other wing tip has no sensor. Its joint is felt through the modes alone, so its shapes are free.
"""

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from hbm import load_rig, load_spectra
from hbm.diagnosis.calibrate import off, trusted
from hbm.diagnosis.diagnose import repeatability_of, unrepeatable
from hbm.diagnosis.misfit import nrmse
from hbm.outputerror.fit import Evaluation, evaluate, fit_model
from hbm.outputerror.lines import line_campaign
from models.causes.addedjoint import AddedJoint, Number
from models.causes.joints import JointMicroslip, JointSlip
from models.friction.law import Value, parameter
from models.joints.law import Memoryless

FLOOR, REPEATS = 0.15, 0.01
OTHER = (0.0, 0.03, 0.03, 0.03, 0.06, 0.03, 0.03)  # begins as the interface; the mode at 6.6 Hz sets the scale


@dataclass(frozen=True, eq=False)
class GivesWay(Memoryless):
    """What a spring lacks beyond a displacement either way, where it is held no more; without a loss."""

    name = "gives-way"
    stiffness: Value = field(metadata=parameter("N/m", "stiffness lost", "textbook"))
    gap: Value = field(metadata=parameter("m", "displacement from which on", "textbook"))

    def force(self, u: Value, v: Value) -> list[Value]:
        """Push on."""
        return [self.stiffness * (u[0] - ca.fmin(ca.fmax(u[0], -self.gap), self.gap))]


class Opens(AddedJoint):
    """A joint that the modes hold opens beyond a displacement either way."""

    name = "joint-opens"
    meaning = "a joint that holds in the modes as they were identified opens"
    numbers = (Number("stiffness", "N/m", "stiffness", (1, -1, 0)), Number("gap", "m", "gap", (0, 1, 0), (0.2,)))
    made = GivesWay


def told(e: Evaluation, unseen: Evaluation, names: Mapping[int, str]) -> str:
    """Errors by record, and all numbers of the joints."""
    errors = []
    for part in (e, unseen):
        for number in part.found:
            own = part.white.record == number
            missed, measured = (np.linalg.norm(a[own]) for a in (part.white.raw, part.white.measured))
            errors.append(f"{names[number]} {missed / measured:.1%}")
    joints = [f"{f.name} {f.value(x):.4g} {f.unit}" for f, x in zip(e.model.free, e.x, strict=True) if f.cause >= 0]
    totals = f"fitted {nrmse(e.white):.1%}, held out {nrmse(unseen.white):.1%}"
    return f"{e.model.label}: {totals}; {', '.join(errors)}; {', '.join(joints)}; at bounds: {list(off(trust, e))}"


one = load_rig(sys.argv[1])
size = len(one.body.ports) + 1
wider = np.zeros((size, size))
wider[:-1, :-1] = one.body.flexibility
ports = {**one.body.ports, "other": OTHER}
stated = {f"modal.ports.other[{i}]": 0.03 / shape if shape else 0.03 for i, shape in enumerate(OTHER, 1) if i != 5}
rig = replace(one, body=replace(one.body, ports=ports, flexibility=wider.tolist()), tolerances=one.tolerances | stated)
spectra = load_spectra(sys.argv[2], rig, repeatability=REPEATS)
spectra = spectra.between(2.0, 12.0, ["acc1", "acc2", "acc3"])
spectra = unrepeatable(spectra, repeatability_of(rig, spectra, REPEATS))
train, hidden = spectra.split(spectra.numbers(sys.argv[3:]))
campaign, held = replace(line_campaign(rig, train), floor=FLOOR), line_campaign(rig, hidden)
names = {r.number: r.name for r in (*campaign.data.records, *held.data.records)}
trust = trusted(rig, campaign.data.channels)

known = {
    (0, "stiffness"): 1.06e5,
    (0, "limit"): 306.0,
    (1, "limit"): 57.7,
    (1, "critical_slip"): 9.1e-4,
    (2, "stiffness"): 5.8e3,
    (2, "gap"): 2.6e-4,
}
model, last = trust, {}
for cause in (JointMicroslip("interface"), JointSlip("other"), Opens("interface")):
    model = model.extended_by(cause)
    start = [f.of(known.get((f.cause, f.name), f.start)) for f in model.free]
    fit = fit_model(model, campaign, np.array(start), last, steps=30, settled=5.0)
    last = fit.solutions
    known |= {(f.cause, f.name): f.value(x) for f, x in zip(model.free, fit.x, strict=True)}
    print(told(fit, evaluate(model, held, fit.x, {}), names), flush=True)
