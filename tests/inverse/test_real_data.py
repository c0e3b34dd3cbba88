"""What measurements say through the reconstruction, where beyond doubt; all of it: benchmarks/real_data.py."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.real import brb_beam, eth_beam, f16_interface, silverbox
from benchmarks.real.common import DATA, read_rows
from hbm import harmonic_spectra, load_history, load_spectra
from hbm.identification.loops import fit_loop
from hbm.measurement.decay import free_decay
from hbm.measurement.loopsfile import load_loops
from hbm.measurement.multisine import contents

DAMPER, DOUBLE_BEAM = DATA / "brfd_friction_damper", DATA / "resonant_double_beam"

pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"measured sets are not there: {DATA}")


# ---------------------------------------------------------------------------------------------------- silverbox


@pytest.fixture(scope="module")
def circuit() -> silverbox.Circuit:
    """One record to fit and one held out of the seven: the conclusions are the same, in less time."""
    return silverbox.first_and_last(silverbox.circuit())


@pytest.fixture(scope="module")
def lines(circuit):
    model = silverbox.fit(circuit, 2)
    return model, silverbox.line_by_line(circuit, model)


def test_silverbox_hardens_and_its_cube_explains_a_record_not_fitted(circuit, lines):
    """The circuit is built as a cubic spring (Wigren and Schoukens 2013).

    What is left of the held-out record is noise: a chi square of 1 per coefficient would leave 2 / mean |T / std|^2 of
    the force, 0.1 %. The set's standard deviations are upper bounds; 1342 lines scatter by 3 %, three times that is let
    pass. The cubic coefficient is known from another path, least squares on the equation of motion; the prior of the
    reconstruction takes less than 2 / mean |T / std|^2 off, the noise of either path is 0.2 %: together 0.5 %.
    """
    model, found = lines
    law = silverbox.restoring(circuit, found, powers=(3,))
    signal = np.mean(np.abs(found.T[circuit.held] / found.T_std[circuit.held]) ** 2)
    assert 1 - law.weighted < 1.1 * 2 / signal
    assert law.k[0] > 10 * law.std[0] > 0
    assert law.k[0] == pytest.approx(model.k3 / model.b, rel=0.005)


def test_silverbox_has_no_hysteresis(lines):
    """A spring takes no energy; beyond 4 std once in 16 000 records by chance."""
    _, found = lines
    assert np.all(np.abs(found.energy) < 4 * found.energy_std)


def test_anti_alias_filter_is_seen_in_a_record_not_fitted(circuit, lines):
    """Chi square per coefficient of 1342 lines scatters by 3 %; without the filter's phase it more than doubles."""
    model, _ = lines
    assert model.chi2[-1] < 1.1
    assert silverbox.fit(circuit, 0).chi2[-1] > 2 * model.chi2[-1]


# --------------------------------------------------------------------------------------------------- bolted beam


def test_bolted_joint_softens_then_stiffens_and_always_damps_more():
    """Two paths: reconstructed joint force at constant force, and a linear fit of each record at constant response.

    A bolted joint differs from run to run, far more than the points scatter. The paths must agree so well that neither
    mistakes a level for its neighbour: to half the fall of frequency, and half the least step of damping.
    """
    _, joints = brb_beam.implied()
    peaks = brb_beam.own_peaks()
    own_f, own_z = np.array([(fit.mode.hz, fit.mode.ratio) for _, fit, _ in peaks]).T
    f, z = np.array([brb_beam.at_amplitude(joints, a)[:2] for *_, a in peaks]).T
    for frequency, ratio in ((f, z), (own_f, own_z)):
        assert np.all(np.diff(frequency) * [-1, -1, 1, 1] > 0)
        assert np.all(np.diff(ratio) > 0)
    assert np.abs(f - own_f).max() < (own_f[0] - own_f[2]) / 2
    assert np.abs(np.log(z / own_z)).max() < np.diff(np.log(own_z)).min() / 2


# ------------------------------------------------------------------------------------------------ beam in vacuum


def test_beam_in_vacuum_softens_and_damps_in_proportion_to_amplitude():
    """Points at three voltages lie on one line; phase resonance, read off the curves, does within their scatter."""
    found, joints = eth_beam.implied()
    softening, damping = eth_beam.slopes(joints)
    assert softening[0] > 0 and damping[0] > 0

    def line(amplitude):
        return softening[1] * (1 - softening[0] * amplitude)

    scatter = np.std(np.concatenate([e.frequency - line(e.amplitude) for e in joints]))
    fall = np.ptp(np.concatenate([e.frequency for e in joints]))
    assert scatter < 0.05 * fall  # a straight line explains all but 1 - 12 * 0.05^2 = 97 % of a uniform fall
    for sweep, own in zip(eth_beam.sweeps(), found, strict=True):
        hz, amplitude, _ = eth_beam.phase_resonance(sweep, own.mode)
        assert hz == pytest.approx(line(amplitude), abs=3 * scatter)


# ------------------------------------------------------------------------------------------------------ the others


def test_interface_of_the_aircraft_softens_and_loses_more():
    """The two lowest levels, where little slips, differ by 6 % in stiffness and loss; the fall is beyond that."""
    k = [x.stiffness for x in f16_interface.levels()]
    assert k[-1].real < 0.5 * k[0].real
    assert k[-1].imag / k[-1].real > 1.5 * k[0].imag / k[0].real


def test_a_sweep_is_not_taken_for_a_steady_state():
    assert not any(
        f16_interface.sweep_piece(name, 7.2).quality[-1].steadiness.steady for name in ("SW1", "SW3", "SW5", "SW7")
    )


@pytest.mark.parametrize("name", ["BRFD1_0.5Hz_20lb_1in", "BRFD2_0.25Hz_36lb_1in", "BRFD3_0.5Hz_30lb_0.5in"])
def test_damper_has_backlash_and_limits_that_differ(name):
    """Three set-ups; energy to 5 %, about half of what Coulomb friction leaves, limits as in the set's table."""
    loop = next(x for x in load_loops(DAMPER / "hysteresis_loops.csv") if x.name == name)
    given = next(r for r in read_rows(DAMPER / "loop_table.csv") if r["loop"] == name)
    assert loop.work / 3 == pytest.approx(float(given["energy_per_cycle_j"]), rel=1e-3)
    fits = fit_loop(loop, ["coulomb", "asymmetric", "backlash"])
    assert fits[0].law == "backlash"
    assert abs(fits[0].work_error) < 0.05
    assert fits[0].left < 0.55 * next(fit.left for fit in fits if fit.law == "coulomb")
    for key, column in (("forward", "median_force_forward_n"), ("backward", "median_force_backward_n")):
        assert fits[0].values[key] == pytest.approx(abs(float(given[column])), rel=0.1)


def test_double_beam_decays_as_published():
    """f = 122.45 - 0.47 A Hz, zeta = 4.2e-4 + 9.8e-4 A (arXiv:2110.01929), by straight lines through all windows."""
    names = [f"D{i:02d}_velocity_ms" for i in (1, 2, 4, 5, 7, 8, 10, 11)]
    recorded = load_history(DOUBLE_BEAM / "decays.npz").between(0.15, 3.1)
    decays = [free_decay(recorded, name, (95.0, 150.0)) for name in names]
    A, hz, ratio = (np.concatenate([getattr(d, x) for d in decays]) for x in ("amplitude", "hz", "damping_ratio"))
    assert np.polyfit(A, hz, 1) == pytest.approx([-0.47, 122.45], rel=0.02)
    assert np.polyfit(A, ratio, 1) == pytest.approx([9.8e-4, 4.2e-4], rel=0.02)


def test_aircraft_is_more_nonlinear_at_the_higher_level():
    """The lower level is far above its noise too: what is there is odd more than even."""
    found = contents(load_spectra(f16_interface.FOLDER / "odd_multisine_harmonics.csv"), "force")
    low, high = ([c for c in found if c.record == name and c.channel != "force"] for name in ("OM1", "OM3"))
    assert all(c.db("noise") < -50.0 for c in (*low, *high))
    assert all(-40.0 < c.db("even") < c.db("odd") - 5.0 < -25.0 for c in low)
    assert all(-20.0 < c.db(kind) < -14.0 for c in high for kind in ("even", "odd"))


def test_a_decay_is_not_taken_for_a_steady_state():
    """The rate falls by 15 to 20 % within the window, one exponential and a rest exaggerates that: a quarter."""
    recorded = load_history(DOUBLE_BEAM / "decays.npz").between(1.5, 3.0)
    rows = [r for r in read_rows(DOUBLE_BEAM / "instantaneous_frequency_damping.csv") if r["mode"] == "1"]
    for name in ("D01", "D02", "D04", "D05", "D07", "D08", "D10", "D11"):
        own = [r for r in rows if r["record"] == name and 1.5 <= float(r["time_s"]) <= 3.0]
        hz, ratio = (np.array([float(r[key]) for r in own]) for key in ("frequency_hz", "damping_ratio"))
        one = replace(recorded, channels={"v": recorded.channels[f"{name}_velocity_ms"]})
        seen = harmonic_spectra(one, float(hz.mean()), 3).quality[0].steadiness
        assert not seen.steady
        assert seen.decay_rate == pytest.approx(np.mean(2 * np.pi * hz * ratio), rel=0.25)
