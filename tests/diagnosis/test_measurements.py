"""Measurements of others, where they are: what docs/validation/measurements.md says of them."""

import re
from pathlib import Path

import pytest

from hbm import diagnose, diagnose_backbone, load_history, load_rig, load_spectra
from hbm.measurement.decay import free_decay
from hbm.outputerror.nominal import tolerances
from models.causes import WrongParameter
from models.causes.joints import CubicStiffness, JointMicroslip, JointSlip, LocalFriction, LocalSpring, OneSidedStop

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


def test_a_bolted_joint_slips_in_parts() -> None:
    """One blow on the Brake-Reuss beam; published fits are within 0.05 % of the frequency and 10 % of the damping.

    Of the catalogue what the whole of it comes to, and some that it does not.
    """
    recorded = load_history(data("brb_jointed_beam/hammer_impact.csv"))
    decay = free_decay(
        recorded.between(float(recorded.time[0]) + 0.2, float(recorded.time[-1])), "acc3_ms2", (70.0, 90.0)
    )
    rig = load_rig(REAL / "bolted_beam" / "rig.toml")
    found = diagnose_backbone(rig, decay, causes=[JointMicroslip, JointSlip, CubicStiffness, OneSidedStop])
    assert (found.verdict, found.cause) == ("main-cause", "joint-microslip")
    row = next(line for line in found.evidence if line.startswith("The extended model"))
    hz, ratio = (float(x) for x in re.findall(r"within ([0-9.]+) %", row))
    assert hz < 0.05
    assert ratio < 10.0
