"""What sensors of a rig with joints say of each other where they contradict: a unit, or a channel at fault."""

from dataclasses import replace
from functools import cache

import pytest

from hbm.inverse.jointed import reconstruct_joints
from hbm.measurement.spectra import MeasuredSpectra
from hbm.response.synthesis import synthesize
from models import Jenkins
from models.jointed import JointedRig
from models.joints import Friction, Joint
from models.parts import Channel
from tests.joints.rigs import beam_rig

SENSORS = tuple(f"a{i}" for i in range(1, 6))


@cache
def measured() -> tuple[JointedRig, MeasuredSpectra]:
    rub = Friction(Jenkins(0.4, 1e-6), 5.0)
    channels = (*(Channel(name, "acceleration", 0.1 * i) for i, name in enumerate(SENSORS, 1)), Channel("f", "force"))
    rig = replace(beam_rig(rub), joints=(Joint("rub", rub, ("y(0.25)",)),), channels=channels)
    return rig, synthesize(rig, (20.0,), (43.0, 45.0, 47.0), snr=50.0, seed=1, harmonics=5).spectra


def found(factors: dict[str, float]) -> tuple[str, ...]:
    rig, spectra = measured()
    coefficients, std = spectra.coefficients.copy(), spectra.std.copy()
    for name, factor in factors.items():
        coefficients[:, spectra.index(name)] *= factor
        std[:, spectra.index(name)] *= abs(factor)
    return reconstruct_joints(rig, replace(spectra, coefficients=coefficients, std=std)).findings


@pytest.mark.parametrize(
    ("factors", "said"),
    [
        (dict.fromkeys(SENSORS, 1.0 / 9.80665), "all accelerations are in g instead of m/s2"),
        (dict.fromkeys(SENSORS, 1e3), "all responses are in mm instead of m"),
        ({"f": 1e-3}, "the force is in kN instead of N"),
        ({"f": -1.0}, "the force has the opposite sign"),
    ],
)
def test_a_unit_in_which_all_would_agree_is_named(factors: dict[str, float], said: str) -> None:
    (finding,) = found(factors)
    assert finding.startswith(f"units: the sensors read as if {said}, ")


@pytest.mark.parametrize("factor", [-1.0, 0.102, 1.1])
def test_a_channel_that_contradicts_all_others_is_named(factor: float) -> None:
    (finding,) = found({"a2": factor})
    assert finding.startswith("a2: contradicts the other channels, without which the misfit of the sensors falls ")


def test_nothing_is_said_where_they_agree_or_where_the_body_is_wrong() -> None:
    assert found({}) == ()
    assert found({"a2": -1.0, "a4": 0.5}) == ()
    rig, spectra = measured()
    stiffer = rig.with_number("beam.youngs_modulus", 1.1 * rig.number("beam.youngs_modulus"))
    assert reconstruct_joints(stiffer, spectra).findings == ()
