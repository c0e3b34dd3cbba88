"""What commands make of measurements of others before any rig, where they are; docs/validation/measurements.md."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hbm import harmonic_spectra, load_history, load_spectra
from hbm.identification.loops import fit_loop
from hbm.measurement.decay import free_decay
from hbm.measurement.loopsfile import load_loops
from hbm.measurement.multisine import contents
from hbm.measurement.recording import recording

DATA = Path(__file__).parents[3] / "shared" / "data"
AIRCRAFT, DAMPER, DOUBLE_BEAM = (
    DATA / "f16_ground_vibration",
    DATA / "brfd_friction_damper",
    DATA / "resonant_double_beam",
)

pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"measured sets are not there: {DATA}")


def read_rows(path: Path) -> list[dict[str, str]]:
    """Rows of a table, by column."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("name", ["SW1", "SW3", "SW5", "SW7"])
def test_a_sweep_is_not_taken_for_a_steady_state(name):
    """Four seconds about 7.2 Hz, 29 cycles over which the sweep moves 0.2 Hz."""
    sweep = np.load(AIRCRAFT / "sine_sweep_time_5p6_to_9p6hz.npz")
    at = int(np.abs(sweep[f"{name}_frequency_hz"] - 7.2).argmin())
    piece = slice(at - 800, at + 800)
    channels = {c: sweep[f"{name}_{c}"][piece] for c in ("force", "acc3")}
    found = harmonic_spectra(recording(name, sweep[f"{name}_time_s"][piece], channels), 7.2, 3)
    assert not found.quality[-1].steadiness.steady


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
    found = contents(load_spectra(AIRCRAFT / "odd_multisine_harmonics.csv"), "force")
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
