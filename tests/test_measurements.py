"""Measurements of others, where they are: what docs/validation/measurements.md says of them."""

from pathlib import Path

import numpy as np
import pytest

from hbm import diagnose, load_rig, load_spectra
from hbm.identification.loops import fit_loop
from hbm.measurement.decay import free_decay
from hbm.measurement.loopsfile import load_loops
from hbm.measurement.recording import recording
from hbm.outputerror.nominal import tolerances
from models.causes import WrongParameter
from models.causes.joints import CubicStiffness, LocalFriction, LocalSpring

ROOT = Path(__file__).parents[1]
DATA = ROOT.parent / "shared" / "data"
REAL = ROOT / "examples" / "real"


def data(path: str) -> Path:
    """A file of the data, which a test does without where they are not."""
    if not (DATA / path).is_file():
        pytest.skip(f"no {DATA / path}")
    return DATA / path


def test_silverbox_has_a_cubic_spring() -> None:
    file = data("silverbox_circuit/multisine_harmonics.csv")
    rig = load_rig(REAL / "silverbox" / "rig.toml")
    spectra = load_spectra(file, rig).select(records=["REAL01", "REAL04", "REAL10"])
    known = tolerances(rig, ["v2_output"]) | {"modal.frequencies_hz[1]": 0.02}
    tried = [CubicStiffness, LocalSpring, LocalFriction, WrongParameter]
    found = diagnose(rig, spectra, held_out=["REAL10"], tolerances=known, causes=tried)
    assert (found.verdict, found.cause) == ("cause-found", "cubic-stiffness")
    k3 = found.parameters["cubic"]
    assert isinstance(k3.value, float)
    assert abs(k3.value - 3.93) < 3 * k3.std < 0.3
    assert found.errors["calibrated"]["held_out"].nrmse > 0.12
    assert found.errors["extended"]["held_out"].nrmse < 0.0055


def test_double_beam_decays_in_straight_lines() -> None:
    kept = np.load(data("resonant_double_beam/decays.npz"))
    rung = kept["time_s"] > 0.15
    v = kept["D05_velocity_ms"].astype(float)[rung]
    decay = free_decay(recording("D05", kept["time_s"][rung], {"v": v}), "v", (95.0, 150.0))
    amplitude = decay.amplitude
    seen = (amplitude > 0.1) & (amplitude < 0.5)
    assert np.abs(decay.hz[seen] - (122.45 - 0.47 * amplitude[seen])).max() < 0.05


@pytest.mark.parametrize("name", ["BRFD1_0.5Hz_35lb_1in", "BRFD3_0.5Hz_30lb_1.5in"])
def test_friction_damper_has_backlash(name: str) -> None:
    (loop,) = [x for x in load_loops(data("brfd_friction_damper/hysteresis_loops.csv")) if x.name == name]
    best = fit_loop(loop)[0]
    assert "backlash" in best.values
    assert 3.5e-3 < best.values["backlash"] < 4.5e-3
    assert abs(best.work_error) < 0.05
