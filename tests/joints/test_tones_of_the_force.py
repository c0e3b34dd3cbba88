"""Harmonics of the force: as many harmonics are kept as hold them, and fewer are refused.

The structure is linear but for a spring that hardly pushes, so every tone answers by its own receptance.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

from hbm import (
    InputError,
    follow_peak,
    force_response,
    frequency_response,
    parameter_response,
    phase_resonance,
    steady_state,
    synthesize,
    trace_frequency,
)
from hbm.diagnosis.screen import coarse
from hbm.outputerror.measured import campaign_of
from hbm.response.accuracy import choose_harmonics
from models.bodies.matrix import MatrixBody
from models.jointed import JointedRig
from models.joints import CubicSpring, Joint
from models.parts import Channel, Damping, Excitation

M, LEVEL, SHARE = np.diag([1.0, 0.8, 0.5]), 8.0, 0.3
K = np.array([[35e3, -15e3, 0.0], [-15e3, 25e3, -10e3], [0.0, -10e3, 12e3]])
C = 0.4 * M + 2e-5 * K
THIRD = float(np.sqrt(np.linalg.eigvalsh(np.linalg.solve(M, K)).max()) / (2 * np.pi))


def rig(tone: int, cubic: float = 1.0) -> JointedRig:
    body = MatrixBody(*map(sparse.csc_array, (M, K)), ("a", "b", "c"), modes=3, damping_matrix=sparse.csc_array(C))
    force = Excitation(LEVEL, at="a", harmonics=((tone, SHARE, 0.0),))
    channels = (Channel("x", "displacement", at="a"),)
    return JointedRig("three masses", body, Damping(), (Joint("j", CubicSpring(cubic), ("a",)),), force, channels)


def rms(hz: float, tone: int) -> float:
    """Of the displacement at a: each tone by its receptance, the second one third of the first."""
    w = 2 * np.pi * hz * np.array([1, tone])
    per_force = [np.linalg.inv(K + 1j * o * C - o**2 * M)[0, 0] for o in w]
    return float(LEVEL * np.linalg.norm(np.array([1.0, SHARE]) * np.abs(per_force)) / np.sqrt(2))


@pytest.mark.parametrize("tone", [12, 20, 60])
def test_a_tone_on_a_resonance_is_in_the_answer_whatever_its_number(tone: int) -> None:
    hz = THIRD / tone
    assert steady_state(rig(tone), hz)["x"].rms == pytest.approx(rms(hz, tone), rel=1e-8)


def test_harmonics_of_a_curve_are_chosen_among_those_that_hold_the_force() -> None:
    hz = THIRD / 20
    curve = frequency_response(rig(20), (0.98 * hz, 1.02 * hz))
    assert curve.basis.H > 20
    exact = np.array([rms(f, 20) for f in curve.hz])
    np.testing.assert_allclose(curve["x"].rms, exact, rtol=1e-8)
    assert choose_harmonics(replace(rig(20), excitation=Excitation(LEVEL, at="a")), (0.98 * hz, 1.02 * hz))[0] == 7


def test_a_number_of_the_rig_and_peaks_are_followed_with_the_tone() -> None:
    hz = THIRD / 20
    curve = parameter_response(rig(20), "joints.j.cubic", (1.0, 2.0), hz=hz)
    np.testing.assert_allclose(curve["x"].rms, rms(hz, 20), rtol=1e-8)
    ramp = force_response(rig(20), hz, (LEVEL / 2, LEVEL))
    assert ramp["x"].rms[-1] == pytest.approx(rms(hz, 20), rel=1e-8)


CALLS: dict[str, Callable[[JointedRig, int], object]] = {
    "steady_state": lambda r, H: steady_state(r, 2.0, harmonics=H),
    "trace_frequency": lambda r, H: trace_frequency(r, (2.0, 2.1), harmonics=H),
    "frequency_response": lambda r, H: frequency_response(r, (2.0, 2.1), harmonics=H),
    "force_response": lambda r, H: force_response(r, 2.0, (4.0, 8.0), harmonics=H),
    "parameter_response": lambda r, H: parameter_response(r, "joints.j.cubic", (1.0, 2.0), hz=2.0, harmonics=H),
    "follow_peak": lambda r, H: follow_peak(r, [4.0, 8.0], harmonics=H),
    "phase_resonance": lambda r, H: phase_resonance(r, harmonics=H),
}


@pytest.mark.parametrize("name", CALLS)
def test_fewer_harmonics_than_the_force_has_are_refused(name: str) -> None:
    with pytest.raises(InputError) as refused:
        CALLS[name](rig(20), 15)
    assert str(refused.value) == (
        f"{name}: harmonics = 15 and harmonic 20 in excitation.harmonics of three masses; must be >= 20; "
        "more where joints or contact answer to it"
    )


def test_as_many_harmonics_as_the_force_has_are_accepted() -> None:
    hz = THIRD / 20
    assert steady_state(rig(20), hz, harmonics=20)["x"].rms == pytest.approx(rms(hz, 20), rel=1e-8)


def test_records_are_simulated_with_the_tone_on_coarse_grids_too() -> None:
    """A diagnosis looks on few harmonics at what need not be exact: a tone that shakes the joints is in the rest."""
    excited = rig(30)
    spectra = synthesize(excited, [LEVEL], [THIRD / 30, 1.1 * THIRD / 30], harmonics=3).spectra
    campaign, _ = campaign_of(excited, spectra)
    few = coarse(campaign, campaign.numbers)
    assert min(campaign.numerics.working.basis.H, few.numerics.working.basis.H) > 30
