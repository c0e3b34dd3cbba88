"""What the history of a contact that sticks does to a record."""

from dataclasses import replace

import numpy as np

import hbm.integration.integrate
from hbm import steady_state
from hbm.outputerror.records import Measurement
from hbm.outputerror.simulated import held_beside, history, spare_friction, sticks
from hbm.sensitivity.derivatives import disturbed, sensitivities
from models.published import PAPER_PENALTY, paper_rig
from models.scalars import FORCE

PAPER = paper_rig().with_modes(5)
RIG, HZ, LEVEL, H = replace(PAPER, contact=replace(PAPER.contact, law=PAPER_PENALTY)), 54.0, 0.3, 3
CHANNELS = ("a1", "a6")


def test_motion_depends_on_the_mean_friction_as_time_integration_says():
    """Foreshortening: the mean of T stiffens the beam. Time integration starts from a contact that was pushed aside."""
    balanced = steady_state(RIG, HZ, level=LEVEL, harmonics=9, samples=512)
    plain = hbm.integration.integrate.steady_state(RIG, HZ, level=LEVEL, steps_per_period=512)
    state = plain.history.state
    pushed = hbm.integration.integrate.steady_state(
        RIG, HZ, level=LEVEL, steps_per_period=512, start=replace(state, z=state.z + 2e-7)
    )
    assert plain.converged and pushed.converged and sticks(balanced)
    mean = pushed.history.friction[:-1].mean() - plain.history.friction[:-1].mean()
    spare = RIG.contact.law.mu * RIG.contact.normal_load - np.ptp(balanced["friction"].samples) / 2
    assert spare_friction(RIG, balanced) == spare
    by = sensitivities(RIG, balanced, [FORCE], held_beside(balanced))
    change = history(spare, by.disturbed, balanced, Measurement((), CHANNELS, H, np.zeros(0)))
    alone = disturbed(RIG, balanced, held_beside(balanced))
    assert all(np.allclose(by.disturbed[name], alone[name], rtol=1e-9, atol=0.0) for name in alone)
    by_mean = change[:, :, 0] / (spare / np.sqrt(3))
    for name, predicted in zip(CHANNELS, by_mean.T, strict=True):
        moved = pushed.history.coefficients(name, H) - plain.history.coefficients(name, H)
        marched = np.array([moved[1], -moved[H + 1]]) / mean
        np.testing.assert_allclose(predicted, marched, atol=0.01 * np.abs(marched).max())
        assert np.abs(mean * predicted).max() > 1e-4 * np.abs(plain.history.coefficients(name, H)[1])


def test_contact_that_slips_has_no_say_in_its_mean():
    slipping = steady_state(RIG, 50.0, harmonics=15)
    assert not sticks(slipping)
    assert spare_friction(RIG, slipping) == 0.0
