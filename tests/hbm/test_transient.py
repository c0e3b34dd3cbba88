"""What transients leave in the harmonics of a record: closed form of linear modes, and time integration."""

from dataclasses import replace

import numpy as np
import pytest

from hbm.integration import integrate
from hbm.outputerror.transients import transients
from hbm.response import trace as response
from models import Channel, Contact, Damping, Excitation, Frictionless, Jenkins, ModalBody, Rig
from models.published import paper_rig

H = 4


def left_over(columns: np.ndarray, vector: np.ndarray) -> float:
    """Share of a vector (m,) that no combination of columns (m, k) is."""
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 0.0] / size[size > 0.0]
    best, *_ = np.linalg.lstsq(columns, vector, rcond=1e-10)
    return float(np.linalg.norm(vector - columns @ best) / np.linalg.norm(vector))


def test_linear_modes_leave_what_the_closed_form_says():
    """Of exp(mu t) in a record of whole periods the mean of exp(mu t - i k Omega t) goes with 1 / (mu - i k Omega)."""
    alpha, hz, frequencies, shapes = 3.0, 52.0, (50.0, 90.0), ((1.0, 2.0), (1.5, -0.5))
    channels = (Channel("a", "acceleration"), Channel("v", "velocity"))
    body = ModalBody(frequencies, shapes, (0.1, 0.2), (1.0, 1.0))
    rig = Rig("two modes", body, Damping(alpha), Contact(1.0, Frictionless()), Excitation(1.0), channels)
    found = transients(rig, response.steady_state(rig, hz, harmonics=8, samples=64), H)
    assert found.decay == pytest.approx([alpha / 2] * 2)
    columns = found.coefficients.reshape(-1, 4)
    for mode, f in enumerate(frequencies):
        mu = -alpha / 2 + 1j * np.sqrt((2 * np.pi * f) ** 2 - alpha**2 / 4)
        moving = mu ** np.array([2, 1]) * np.array(shapes)[:, mode]
        left = moving / (mu - 2j * np.pi * hz * np.arange(-H, H + 1)[:, None])
        for turned in (left, 1j * left):
            amplitudes = turned[H:] + turned[H::-1].conj()
            amplitudes[0] /= 2.0
            expected = np.concatenate([amplitudes.real, -amplitudes.imag[1:]])
            assert left_over(columns, expected.ravel()) < 1e-9
            assert left_over(columns, expected[::-1].ravel()) > 0.1


@pytest.mark.parametrize(("level", "hz"), [(0.5, 54.0), (6.5, 54.0)], ids=["sticks", "slips"])
def test_records_of_a_transient_are_superpositions_of_its_motions(level, hz):
    """By time integration from beside the steady state, to first order; however long the record, whenever it began."""
    rig = replace(paper_rig(Jenkins(mu=0.52, critical_slip=4.15e-6)), damping=Damping(mass_proportional=0.6))
    solution = response.steady_state(rig, hz, level=level, harmonics=31, samples=1024)
    found = transients(rig, solution, H)
    columns = found.coefficients.reshape(*found.coefficients.shape[:2], -1)
    steady = integrate.steady_state(rig, hz, level=level, steps_per_period=1024)
    assert steady.converged
    slowest = -np.log(np.abs(steady.multipliers[int(level < 1.0)])) * hz  # of what sticks one does not fade
    assert found.decay.min() == pytest.approx(slowest, rel=0.02)

    def read(history, periods=1):
        return np.array([history.coefficients(c.name, H, periods) for c in rig.response_channels]).T

    for wait, periods in ((12, 5), (15, 30)):
        start = steady.history.state
        pushed = replace(start, qdot=(1.0 - 1e-3) * start.qdot)
        marched = integrate.simulate(
            rig, hz, level=level, start=pushed, duration=(wait + periods) / hz, steps_per_period=1024
        )
        change = read(marched, periods) - read(steady.history)
        assert left_over(columns.reshape(-1, columns.shape[2]), change.ravel()) < 0.02
        assert left_over(np.roll(columns, 1, axis=0).reshape(-1, columns.shape[2]), change.ravel()) > 0.1
