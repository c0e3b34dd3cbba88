"""What a mode that is a little off does to a record, beside records of a rig that has other modes."""

from dataclasses import replace

import numpy as np
import pytest

from hbm.diagnosis.modesoff import _change
from hbm.outputerror.nominal import FREQUENCY, RATIO
from hbm.response.trace import steady_state
from models import Channel, Contact, Damping, Excitation, Jenkins, ModalBody, Rig

HZ, RATIOS, SMALL = (50.0, 148.0), (0.01, 0.02), 1e-4
RIG = Rig(
    name="two modes",
    body=ModalBody(HZ, ((1.0, 1.2), (0.7, -0.9)), (0.6, 0.4), (1.0, 0.8)),
    damping=Damping(modal_ratios=RATIOS),
    contact=Contact(20.0, Jenkins(0.4, 2e-5)),
    excitation=Excitation(8.0),
    channels=(Channel("a", "acceleration"), Channel("b", "displacement")),
)


def solved(rig, start=None):
    """At a third of the second natural frequency, where the third harmonic of friction meets it."""
    return steady_state(rig, 49.0, harmonics=9, samples=256, start=start)


def amplitudes(solution):
    return np.concatenate([solution[name].coefficients for name in ("a", "b")])


@pytest.mark.parametrize("mode", [0, 1])
@pytest.mark.parametrize("what", ["frequency", "ratio"])
def test_columns_are_what_one_tolerance_of_a_mode_changes(mode, what):
    """Beside two solutions of rigs whose mode is off by a small share of that, either way."""

    def off(share):
        hz, ratios = np.array(HZ), np.array(RATIOS)
        if what == "frequency":
            ratios[mode] /= 1.0 + FREQUENCY * share  # the damping stays
            hz[mode] *= 1.0 + FREQUENCY * share
        else:
            ratios[mode] *= 1.0 + RATIO * share
        return replace(
            RIG, body=replace(RIG.body, frequencies_hz=tuple(hz)), damping=Damping(modal_ratios=tuple(ratios))
        )

    here = solved(RIG)
    assert np.ptp(here["slip"].samples) > 4e-5  # it slips
    column = mode + (0 if what == "frequency" else len(HZ))
    change = _change(RIG, here, RIG.structure.damping)
    told = np.concatenate([change[name][:, column] for name in ("a", "b")])
    up, down = (amplitudes(solved(off(share), here)) for share in (SMALL, -SMALL))
    assert told == pytest.approx((up - down) / (2.0 * SMALL), rel=1e-3, abs=1e-4 * np.abs(told).max())
