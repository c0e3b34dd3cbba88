"""Measurements of others, where they are: what docs/validation/measurements.md says of them."""

from pathlib import Path

import pytest

from hbm import diagnose, load_rig, load_spectra
from hbm.outputerror.nominal import tolerances
from models.causes import WrongParameter
from models.causes.joints import CubicStiffness, LocalFriction, LocalSpring

ROOT = Path(__file__).parents[2]
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
